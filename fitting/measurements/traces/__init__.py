"""Traces: time series of an FMU's output, with the input that was recorded or declared, or none."""
