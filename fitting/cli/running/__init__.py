"""What surrounds a command that runs: its folder, its progress, its end."""
