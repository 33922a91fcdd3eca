"""Noise spectra: power spectral densities of an FMU's output under a random force."""
