"""What a doctor tries on a running FMU: steps, resets, inputs, and what they cost."""
