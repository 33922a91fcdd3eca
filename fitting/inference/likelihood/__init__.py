"""What is searched in the likelihood of the data: profiles, ranges, directions, samples."""
