"""Shares, pulls and coverage of an ensemble against closed forms, and what is drawn of them."""

from __future__ import annotations

import csv
import io
import math
from typing import Any

import numpy as np
import pytest
from mpmath import mp, mpf

from fitting.ensembles.figure import draw
from fitting.ensembles.report import csv_of, markdown, screen_lines
from fitting.ensembles.result import FAILED, Ensemble, EnsembleRow, EnsembleValue, Share
from fitting.report.figures.style import style
from fitting.text.estimate import Verdict


def tail(k: int, n: int, p: float) -> float:
    """P(X >= k) of n tries, summed by mpmath."""
    with mp.workdps(40):
        q = mpf(p)
        return float(
            mp.fsum(mp.binomial(n, j) * q**j * (1 - q) ** (n - j) for j in range(k, n + 1))
        )


@pytest.mark.parametrize(("k", "n"), [(1, 4), (66, 70), (190, 200), (999, 1000)])
def test_ends_of_a_share_leave_a_fortieth_on_each_side(k: int, n: int) -> None:
    low, high = Share(k, n).interval
    assert tail(k, n, low) == pytest.approx(0.025, rel=1e-8)
    assert 1.0 - tail(k + 1, n, high) == pytest.approx(0.025, rel=1e-8)


@pytest.mark.parametrize("n", [1, 10, 200])
def test_ends_of_none_and_all(n: int) -> None:
    assert Share(0, n).interval == pytest.approx((0.0, 1.0 - 0.025 ** (1.0 / n)), rel=1e-12)
    assert Share(n, n).interval == pytest.approx((0.025 ** (1.0 / n), 1.0), rel=1e-12)
    assert math.isnan(Share(0, 0).part)


def value(estimate: float, verdict: Verdict = Verdict.DETERMINED) -> EnsembleValue:
    """An estimate of 10 with an error of 2, intervals of one and two of it."""
    return EnsembleValue(
        name="d1",
        unit="Hz",
        status=verdict,
        value=math.nan if verdict is Verdict.ABOVE else estimate,
        std=math.nan if verdict is Verdict.ABOVE else 2.0,
        ci68=(estimate - 2.0, estimate + 2.0),
        ci95=(estimate - 4.0, estimate + 4.0),
        truth=10.0,
    )


#: Why an item has failed, with a sign that is another thing in a table.
WHY = "no file | of that name"


def row(index: int, *values: EnsembleValue) -> EnsembleRow:
    status, message = ("converged", "") if values else (FAILED, WHY)
    return EnsembleRow(
        index=index, label=f"seed {index}", status=status, message=message, values=values
    )


@pytest.fixture
def several() -> Ensemble:
    withdrawn = value(90.0, Verdict.WITHDRAWN)
    rows = [value(11.0), value(13.0), value(4.0), value(9.0, Verdict.ABOVE), withdrawn]
    return Ensemble(
        title="Laboratories",
        synthetic=True,
        status="finished",
        message="6 of 6 items have ended, 1 of them without a fit",
        total=6,
        rows=(*(row(k, v) for k, v in enumerate(rows)), row(5)),
    )


def test_intervals_are_counted_where_they_are_promised(several: Ensemble) -> None:
    [c] = several.coverage
    assert (c.judged, c.determined, c.withheld) == (4, 3, 1)
    assert c.held68 == Share(2, 4)  # 11 and 9
    assert c.held95 == Share(3, 4)  # and 13
    assert c.pulls == (0.5, 1.5, -3.0)
    assert c.pull_mean == pytest.approx(-1.0 / 3.0)
    assert c.pull_std == pytest.approx(math.sqrt(((5 / 6) ** 2 + (11 / 6) ** 2 + (8 / 3) ** 2) / 2))


def test_every_item_is_in_the_table_and_a_failure_says_why(several: Ensemble) -> None:
    rows = list(csv.DictReader(io.StringIO(csv_of(several))))
    assert [r["label"] for r in rows] == [f"seed {k}" for k in range(6)]
    assert [r["pull"] for r in rows] == ["0.5", "1.5", "-3.0", "", "40.0", ""]
    assert rows[5]["message"] == WHY
    assert rows[5]["value"] == ""
    assert f"| seed 5 | {WHY.replace('|', f'{chr(92)}|')} |" in markdown(several)
    words = "\n".join(screen_lines(several))
    assert "2/4 = 50.0 % (6.8 to 93.2)" in words  # Clopper and Pearson's table
    assert "seed 5" in words


def test_the_figure_has_the_shares_with_their_ends(several: Ensemble) -> None:
    with style():
        figure = draw(several).drawn
    left, right = figure.axes
    pulls = next(line for line in left.lines if line.get_marker() == ".")
    assert np.asarray(pulls.get_xdata()).tolist() == [0.5, 1.5, -3.0]
    shares = [line for line in right.lines if line.get_marker() in ("o", "s")]
    assert [np.asarray(line.get_xdata()).tolist() for line in shares] == [[50.0], [75.0]]
    bars: Any = right.containers[0]
    [ends] = bars.lines[2]
    low, high = Share(2, 4).interval
    assert [x for x, _ in ends.get_segments()[0]] == pytest.approx([100.0 * low, 100.0 * high])
