"""Virtual laboratories with known truth, what they measure, and a judge of the answers."""
