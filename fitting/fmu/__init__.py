"""FMUs in worker processes: describe a file, run batches of simulations, fail in sentences.

The only part of `fitting` that knows fmpy. FMI 2.0 and 3.0, co-simulation and model exchange. A
worker process needs few of the modules, and starts sooner without the others.
"""
