"""What the data determine: likelihood, profiles, intervals, verdicts."""
