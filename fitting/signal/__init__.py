"""Numbers out of signals: windows, spectra, peaks, the scale of Algorithm 1, residual tests."""
