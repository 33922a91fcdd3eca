"""Demodulated traces: phasors or amplitudes at a frequency, over time."""
