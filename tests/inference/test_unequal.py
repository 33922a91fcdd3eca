"""Noise that grows with the amplitude, in sweeps fitted through the FMU: lines of known truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.fit.fit import Status
from fitting.inference.infer import infer
from fitting.text.finding import Kind
from tests.support.complex_data import mode
from tests.support.one_mode import SETUP

ETA, WIDTH, SHARE = 1000.0, 12.5, 0.01
F = ETA + np.linspace(-75.0, 75.0, 121)
PARAMETERS = (
    ff.Parameter("d1", 15.0, bounds=(1.0, 100.0), unit="Hz", scale=5.0),
    ff.Parameter("eta_plus", 1001.0, bounds=(980.0, 1020.0), unit="Hz", scale=5.0),
)


def fitted(fmu: Path, seed: int, noise: ff.Noise | None = None) -> ff.Fit:
    """A line whose points are off by 1 % each."""
    off = 1.0 + SHARE * np.random.default_rng(seed).standard_normal(F.size)
    sweep = ff.Sweep(SETUP, F, np.abs(mode(F, ETA, WIDTH)) * off, settings={"u2": 1500.0})
    problem = ff.Problem(fmu, PARAMETERS, sweep, noise=noise or ff.Noise())
    return ff.fit(problem, method=ff.Tikhonov(misfit="squares"), starts=1)


@pytest.fixture(scope="module")
def unstated(swift_fmu: Path) -> ff.Fit:
    """The first of them."""
    return fitted(swift_fmu, 0)


@pytest.fixture(scope="module")
def stated(swift_fmu: Path) -> ff.Fit:
    """The same, whose noise is told."""
    return fitted(swift_fmu, 0, ff.Noise(relative=SHARE))


def test_errors_hold_where_nobody_stated_that_noise_grows(
    swift_fmu: Path, unstated: ff.Fit
) -> None:
    off = []
    for fit in (unstated, *(fitted(swift_fmu, seed) for seed in (1, 2))):
        structure = fit.record.solution.structure
        assert structure is not None
        assert structure.is_unequal
        assert structure.widening > 1.5
        off += [abs(fit[n].value - v) / fit[n].std for n, v in (("d1", WIDTH), ("eta_plus", ETA))]
    assert np.max(off) < 2.5
    assert sum(each < 1.0 for each in off) >= 3


def test_the_noise_that_is_stated_is_of_one_size(stated: ff.Fit) -> None:
    """Residuals count by the noise that is stated; errors are then those of weighted points."""
    structure = stated.record.solution.structure
    assert structure is not None
    assert not structure.is_unequal
    assert structure.widening == 1.0


def test_the_warning_names_what_states_it(unstated: ff.Fit, stated: ff.Fit) -> None:
    kinds = (Kind.heteroscedastic_residuals, Kind.correlated_residuals)
    [found] = [f for f in unstated.inferred.findings if f.kind in kinds]
    assert found.numbers["can_state"]
    assert not [f for f in stated.inferred.findings if f.kind in kinds]


def test_a_search_that_was_interrupted_does_not_blame_the_noise(swift_fmu: Path) -> None:
    """Its residuals may be what the search had still to take away."""
    done = fitted(swift_fmu, 0, ff.Noise(relative=SHARE / 1.8)).record
    cut = replace(done, status=Status.INTERRUPTED)
    blames = {Kind.noise_underestimated, Kind.excess_residuals}
    kinds = [{found.kind for found in infer(fit, profiles=False).findings} for fit in (done, cut)]
    assert [bool(blames & each) for each in kinds] == [True, False]
    assert Kind.search_unfinished in kinds[1]
