"""The benchmark of extremes judges by verdicts and numbers, and bears a range that fails."""

from __future__ import annotations

import math
from pathlib import Path

from fitting.fmu.pool import FmuWorkers
from fitting.text.estimate import Verdict
from tests.bench.bench_extremes import WHOLE, Bench, Outcome, _split


def test_a_scene_that_is_right_holds(swift_fmu: Path, tmp_path: Path) -> None:
    with FmuWorkers(swift_fmu, workers=1) as workers:
        found = Bench(workers, tmp_path)(WHOLE)
    assert found.word == Verdict.DETERMINED
    assert found.holds


def test_a_range_in_which_nothing_holds_has_a_row() -> None:
    lost = Outcome(math.nan, math.nan, "not converged", 1.0)
    assert len(_split([(1.0, lost), (2.0, lost)])) == 3
