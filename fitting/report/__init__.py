"""Draws and words, computes nothing: figures, tables, pages."""
