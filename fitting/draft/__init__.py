"""A first campaign from files and an FMU: their kinds are determined, guessed or asked."""
