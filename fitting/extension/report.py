"""Tables, screens and pages from templates: a package has its own next to its modules."""

from __future__ import annotations

from fitting.measurements.figure import Figure
from fitting.report.page import render, write_page
from fitting.report.screen import lines_of, phrase, phrases, printed_lines
from fitting.report.table import Table, csv_text, exact_text, markdown_lines, table

__all__ = [
    "Figure",
    "Table",
    "csv_text",
    "exact_text",
    "lines_of",
    "markdown_lines",
    "phrase",
    "phrases",
    "printed_lines",
    "render",
    "table",
    "write_page",
]
