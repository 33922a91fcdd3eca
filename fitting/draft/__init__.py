"""A first campaign from files and an FMU: what they are is looked at, guessed, asked and said."""
