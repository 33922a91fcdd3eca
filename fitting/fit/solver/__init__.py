"""Who minimises an objective: Algorithm 2, the solves it is made of, and their tests."""
