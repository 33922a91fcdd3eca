"""Measured data and their prediction by the FMU: a file per kind of measurement."""
