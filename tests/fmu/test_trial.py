"""What a doctor tries on a running FMU, held against models whose answer is known by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from fitting.fmu import FmuWorkers
from fitting.fmu.findings import Severity, rule_findings
from fitting.fmu.trial import STEPS, halve_step, pushed_run, try_resets
from tests.support.cfmu_build import build_c_fmu, build_lag_fmu


@pytest.mark.parametrize("step_s", [0.02, 0.3])
def test_half_a_step_shows_a_solver_that_steps_with_the_host(step_s: float, tmp_path: Path) -> None:
    """Euler's steps of x' = 1 - x give 1 - (1 - h)^n, in halves 1 - (1 - h/2)^(2 n)."""
    with FmuWorkers(build_lag_fmu(tmp_path)) as workers:
        found = halve_step(workers, pushed_run(workers, step_s, {"euler": 1.0}))
    whole = [1.0 - (1.0 - step_s) ** n for n in range(STEPS + 1)]
    halves = [1.0 - (1.0 - 0.5 * step_s) ** (2 * n) for n in range(STEPS + 1)]
    difference = max(abs(a - b) for a, b in zip(whole, halves, strict=True))
    assert found is not None
    assert found.share == pytest.approx(difference / max(whole), rel=1e-9)
    assert found.output == "y"


def test_exact_steps_do_not_mind_their_length_and_counted_steps_are_no_result(
    tmp_path: Path,
) -> None:
    with FmuWorkers(build_c_fmu(tmp_path)) as workers:
        found = halve_step(workers, pushed_run(workers, 1e-3, {}))
    assert found is not None
    assert found.share < 1e-12


def test_what_changes_no_output_is_named(tmp_path: Path) -> None:
    """A lag with its input held at rest sees neither gain nor tau; pushed, it sees all of them."""
    with FmuWorkers(build_lag_fmu(tmp_path)) as workers:
        assert try_resets(workers, pushed_run(workers, 0.1, {})).idle == ()
        resting = pushed_run(workers, 0.1, {"u": 0.0})
        assert try_resets(workers, resting).idle == ("tau", "gain", "through", "euler")


def test_broken_rules_are_told_once_the_grave_ones_first() -> None:
    said = [
        "ModelStructure/InitialUnknowns does not contain the expected set of variables. "
        'Expected { "a" (line 3) } but was { }.',
        'The unit "furlong" of variable "a" (line 3) is not defined.',
        'The unit "stone" of variable "b" (line 40) is not defined.',
        'Variable "c" (line 5) has no start value.',
    ]
    found = rule_findings(said)
    assert [f.severity for f in found] == [Severity.CAREFUL, Severity.CAREFUL, Severity.COSMETIC]
    assert [f.count for f in found] == [2, 1, 1]
    assert found[0].sentence == said[1]
    assert rule_findings([]) == ()
