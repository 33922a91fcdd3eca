"""Virtual laboratories: what knows the oscillator. No room of the fit can import it."""
