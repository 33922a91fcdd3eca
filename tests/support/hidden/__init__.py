"""Hidden laboratories: their own equations, campaigns, mistakes, and a judge of what is said."""
