"""Batches that fail leave what was simulated: counted runs, and numbers of the closed form.

Truth: the step response of m x'' + c x' + k x = F in `tests.fmu.test_workers`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting.fmu.pool import FmuWorkers
from fitting.measurements.fmu_response import KnownAnswers
from fitting.text.errors import FmuFailure
from tests.fmu.test_workers import FAILS_IN_STEP, PULLED, step_response
from tests.simulate.test_shared_runs import P, campaign
from tests.support.cfmu_build import build_c_fmu
from tests.support.datasets import drafted, through

LATE = replace(PULLED, settle_s=0.05)
LATER = replace(PULLED, settle_s=0.08)
BAD = replace(PULLED, start_values={**PULLED.start_values, "misbehave": FAILS_IN_STEP})


def test_what_a_failed_batch_got_answered_is_not_run_again(tmp_path: Path) -> None:
    with FmuWorkers(build_c_fmu(tmp_path)) as workers:
        known = KnownAnswers(workers)
        with pytest.raises(FmuFailure, match="cannot step"):
            known.run([PULLED, LATE, BAD, LATER])
        before = workers.counts.runs
        pulled, later, late = known.run([PULLED, LATER, LATE])
        assert workers.counts.runs == before + 1  # the one behind the failure
        for answer, settle_s in ((pulled, 0.0), (late, 0.05), (later, 0.08)):
            expected = step_response(settle_s + np.arange(6) * 1e-3)
            np.testing.assert_allclose(answer[:, 0], expected, rtol=1e-11)


def test_a_run_that_failed_fails_again_with_its_words_and_without_a_run(tmp_path: Path) -> None:
    with FmuWorkers(build_c_fmu(tmp_path)) as workers:
        known = KnownAnswers(workers)
        with pytest.raises(FmuFailure) as first:
            known.run([BAD])
        before = workers.counts
        with pytest.raises(FmuFailure) as second:
            known.run([PULLED, BAD])
        assert str(second.value) == str(first.value)
        assert workers.counts == before


def test_what_came_to_its_end_is_not_kept(tmp_path: Path) -> None:
    with FmuWorkers(build_c_fmu(tmp_path)) as workers:
        known = KnownAnswers(workers)
        known.run([PULLED])
        before = workers.counts.runs
        known.run([PULLED])
        assert workers.counts.runs > before


def test_points_beside_one_that_fails_cost_no_second_run(swift_fmu: Path, tmp_path: Path) -> None:
    bound = campaign(tmp_path, swift_fmu)
    plan = drafted(bound)
    near = P + np.array([0.0, 1.0, 0.0])
    impossible = np.array([1.3, -120.0, 90.0])  # runs go by bytes: this one comes last
    with FmuWorkers(swift_fmu, reuse="never") as workers:
        response = through(workers, bound, plan, {"reflection": False})
        begun = workers.counts.runs
        with pytest.raises(FmuFailure):
            response.evaluate_many([P, near, impossible])
        answered = workers.counts.runs - begun
        apart = response.evaluate_many([P, near])
        needed = sum(point.runs for point in apart)
        assert answered > 0
        assert workers.counts.runs - begun == needed
        again = through(workers, bound, plan, {"reflection": False}).evaluate_many([P, near])
        assert workers.counts.runs - begun == 2 * needed
    for one, other in zip(apart, again, strict=True):
        for a, b in zip(one.predictions, other.predictions, strict=True):
            np.testing.assert_array_equal(a.values, b.values)
