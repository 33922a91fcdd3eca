"""Which measurement next: candidates, information, choice, campaign."""
