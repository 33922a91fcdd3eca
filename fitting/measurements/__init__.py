"""What was measured and what the FMU says to it: a file per kind of measurement."""
