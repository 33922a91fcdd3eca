"""Ways to read a series, a file per kind: each a `fitting.lab.bench.Instrument`."""
