"""Sentences of terminal and report, by subject: verdicts, settings, plans, agreement."""
