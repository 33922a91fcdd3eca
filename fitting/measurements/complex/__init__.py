"""Complex values: tones and sweeps with phases, behind a wiring."""
