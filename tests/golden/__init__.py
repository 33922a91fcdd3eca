"""What each command prints, kept as one text per command: the only tests of whole sentences."""
