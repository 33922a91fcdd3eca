"""Spectra and sweeps over a control quantity: a voltage, a capacitance, a pump's depth."""
