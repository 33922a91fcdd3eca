"""What is searched in the likelihood of the data: optima, profiles, ranges, directions, samples."""
