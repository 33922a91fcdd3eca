"""Sweeps of many points through the FMU and `ff.fit`: the truth comes back from few runs."""

from __future__ import annotations

import numpy as np
import pytest

import fitting as ff
from fitting.campaign import Setup
from fitting.measurements.complex_sweep import ComplexCurve, Wiring
from tests.support.complex_data import mode
from tests.support.one_mode import DRIVE, START

ETA, WIDTH = 1000.0, 12.5
SEEN = ETA + np.linspace(-60.0, 60.0, 1001)
PARAMETERS = (
    ff.Parameter("d1", 20.0, bounds=(1.0, 100.0), scale=5.0),
    ff.Parameter("eta_plus", 1003.0, bounds=(980.0, 1020.0), scale=5.0),
)


@pytest.mark.parametrize(("scale", "within", "most"), [("fit", 1e-6, 9), ("maximum", 1e-4, 9 + 11)])
def test_a_long_sweep_takes_nine_runs_and_gives_the_truth(
    scale: str, within: float, most: int, swift: ff.Fmu
) -> None:
    """The largest of the points is 2e-5 below the maximum: so far the paper's scale is off.

    Where the maximum sets the scale, three to eleven runs more look for it.
    """
    setup = ff.Setup(DRIVE, "q1_hybrid", start_values=START, steady_start=True)
    amplitude_v = 1e7 * np.abs(mode(SEEN, ETA, WIDTH))
    sweep = ff.Sweep(setup, SEEN, amplitude_v, use="fit", scale=scale)
    problem = ff.Problem(
        swift, PARAMETERS, [sweep], noise=ff.Noise(absolute_v=1e-3 * np.max(amplitude_v))
    )
    fit = ff.fit(problem, ff.Tikhonov(misfit="squares"), starts=1)
    assert fit.x[:2] == pytest.approx([WIDTH, ETA], rel=within)
    cost = fit.result.evaluations
    assert cost.fmu_runs <= most * cost.objective
    assert fit.result.plan is not None
    [decision] = [d for d in fit.result.plan.decisions if d.kind == "curve"]
    assert decision.taken
    assert int(decision.numbers["runs"]) <= 9
    assert decision.bound <= 1e-9
    assert any("1001 points" in said for said in fit.result.provenance.plan)


def test_a_long_complex_sweep_does_so_too(swift: ff.Fmu) -> None:
    """Two of them under two drives, which share a batch, with a gain and a constant background."""
    setup = Setup(DRIVE, "q1_hybrid", start_values=START, steady_start=True)
    curves = [
        ComplexCurve(
            SEEN[::5],
            level * 3.0 * np.exp(0.7j) * mode(SEEN[::5], ETA, WIDTH) + 2e-7,
            settings={"A1": level},
            label=f"level {level:g}",
            wiring=Wiring(background="constant"),
        )
        for level in (1.0, 4.0)
    ]
    problem = ff.Problem(swift, PARAMETERS, ff.ComplexSweep(setup, curves))
    fit = ff.fit(problem, ff.Tikhonov(misfit="squares"), starts=1)
    assert fit.x == pytest.approx([WIDTH, ETA], rel=1e-6)
    cost = fit.result.evaluations
    assert cost.fmu_runs <= 2 * 9 * cost.objective
    assert fit.result.plan is not None
    [decision] = [d for d in fit.result.plan.decisions if d.kind == "curve"]
    assert decision.numbers["curves"] == decision.numbers["interpolated"] == 2
    assert decision.bound <= 1e-9
