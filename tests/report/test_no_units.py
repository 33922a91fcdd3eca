"""A design whose values have no unit: no empty brackets anywhere."""

from __future__ import annotations

from dataclasses import replace

import matplotlib.pyplot as plt

from fitting.design.api import proposal_table, screen_lines
from fitting.extension.report import csv_text, table
from tests.support import plot_records
from tests.support import plots as plot


def test_a_design_without_units_has_no_empty_brackets() -> None:
    design = replace(plot_records.design(), target="r", unit="", amplitude_unit="")
    figure, axes = plt.subplots(2)
    plot.expected_errors(design, ax=axes[0])
    plot.candidates(design, ax=axes[1])
    labels = [text for one in axes for text in (one.get_xlabel(), one.get_ylabel())]
    plt.close(figure)
    heads = [head.text for head in proposal_table(design).heads]
    rows = csv_text(table("design/csv", design=design))
    for text in (*screen_lines(design), *labels, *heads, rows):
        assert "()" not in text
        assert "( " not in text
