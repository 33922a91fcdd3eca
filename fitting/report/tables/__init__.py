"""The tables of terminal and report, by subject: each is columns over records."""
