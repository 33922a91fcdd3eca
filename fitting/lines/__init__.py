"""A line in one measurement: a shape, terms next to it, a likelihood; one least-squares call."""
