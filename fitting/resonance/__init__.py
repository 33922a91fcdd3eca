"""One resonance in one measured response, without any FMU: frequency, width, quality."""
