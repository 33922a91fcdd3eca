"""Many independent pieces of work: one seam to whatever runs them, here or on other machines."""
