"""Intervals over virtual laboratories: the benchmark's settings in small, seeded."""

from __future__ import annotations

from pathlib import Path

import pytest
from scipy.stats import binom

from tests.bench.bench_coverage import SETTINGS, Count, Counts, added, coverage

#: Laboratories per setting: few, so that bounds are wide; the benchmark has 200.
LABORATORIES = {"q1": 3, "cross": 3, "gain": 1, "cross-phases": 1}
AT_NIGHT = {"q1": 10, "q2": 6, "offsets": 2, "cross": 10, "cross-phases": 3}
IN_SMALL = [
    pytest.param((setting, counts[setting.name]), marks=marks, id=f"{setting.name}-{name}")
    for name, counts, marks in (
        ("sample", LABORATORIES, ()),
        ("night", AT_NIGHT, (pytest.mark.nightly,)),
    )
    for setting in SETTINGS
    if setting.name in counts
]


@pytest.fixture(scope="module", params=IN_SMALL)
def counted(request: pytest.FixtureRequest, swift_fmu: Path) -> tuple[str, Counts]:
    setting, laboratories = request.param
    seeds = [70_000 + k for k in range(laboratories)]
    return setting.name, coverage(setting, seeds, swift_fmu, by_fmu=False)


def test_the_truth_lies_inside_as_often_as_is_claimed(counted: tuple[str, Counts]) -> None:
    """No fewer than a coverage of 95 % leaves to chance once in a thousand."""
    for name, count in counted[1].items():
        least = int(binom.ppf(1e-3, count.total, 0.95))
        assert count.inside >= least, (name, count)


def test_what_is_not_determined_is_as_wide_as_the_box_and_holds_the_truth(
    counted: tuple[str, Counts],
) -> None:
    setting, counts = counted
    coupling = counts["lambda"]
    if setting.startswith("cross"):
        assert coupling.determined == coupling.total
        return
    assert coupling.determined == 0
    assert coupling.inside == coupling.total
    # a walk that lost its way is "not known", and rare
    assert coupling.open >= 0.8 * coupling.total
    assert coupling.narrowest > 0.9999


def test_widths_are_determined_in_every_laboratory(counted: tuple[str, Counts]) -> None:
    for name, count in counted[1].items():
        if name.startswith(("width", "Q_")):
            assert count.determined == count.total, name


def test_counts_add_up() -> None:
    one = {"a": Count(3, 4, 2, 1, 0.5, 0.1)}
    two = {"a": Count(1, 1, 0, 1, 0.25, 0.05), "b": Count(1, 1, 1, 0, 0.1, 0.1)}
    assert added([one, two]) == {
        "a": Count(4, 5, 2, 2, 0.75, 0.05),
        "b": Count(1, 1, 1, 0, 0.1, 0.1),
    }
