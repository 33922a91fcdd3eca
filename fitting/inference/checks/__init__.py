"""Checks of a fit, one question each: a record `Solved` comes in, findings come out."""
