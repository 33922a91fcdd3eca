"""Draws have to come near every value that a fit accepts: by hand, on records made up here."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fitting.inference.likelihood.knowledge import (
    Adequacy,
    Determined,
    Effort,
    Equivalent,
    Knowledge,
    Scan,
)
from fitting.posterior.summary import missed_value
from fitting.text.arrays import FloatArray
from fitting.text.estimate import ParameterEstimate
from fitting.text.finding import Finding
from tests.support.closed_posteriors import parameter


def determined(
    values: tuple[float, ...] = (0.0, 30.0, 60.0, 100.0),
    delta: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0),
    width: float = 100.0,
    equivalents: tuple[Equivalent, ...] = (),
    inflation: float = 1.0,
) -> Determined:
    """A fit of d with the points of its profile, and the width of its interval."""
    plain: dict[str, Any] = {"directions": (), "without_effect": ()}
    known = Knowledge(
        data=True,
        chi_square=4.0,
        freedom=4.0,
        adequacy=Adequacy(chi_square=4.0, freedom=4.0, p_value=0.4, describes=True),
        most_likely={"d": 40.0},
        effort=Effort(1, 0, 1),
        inflation=inflation,
        scans={"d": Scan(sigma=10.0, values=values, delta_chi2=delta, path={"d": values})},
        equivalents=equivalents,
        **plain,
    )
    own = ParameterEstimate(name="d", value=40.0, unit="", ci95=(0.0, width))
    return Determined(parameters={"d": own}, derived={}, knowledge=known)


def draws(low: float, high: float) -> FloatArray:
    return np.linspace(low, high, 400).reshape(20, 20, 1)


def missed(fit: Determined, drawn: FloatArray, **changes: Any) -> Finding | None:
    own = replace(parameter("d", 0.0, 100.0, 50.0), **changes)
    return missed_value(fit, [own], drawn, is_bent=False)


def test_an_end_that_fits_and_that_no_draw_is_near_is_missed() -> None:
    """As a chain that never saw the upper half of what its profile accepts."""
    assert missed(determined(), draws(5.0, 95.0)) is None
    found = missed(determined(), draws(5.0, 56.6))
    assert found is not None
    assert found.subject == "d"
    assert found.numbers["value"] == pytest.approx(100.0)
    assert found.numbers["nearest"] == pytest.approx(56.6)
    lower = missed(determined(), draws(40.0, 99.0))  # the farthest of two
    assert lower is not None
    assert lower.numbers["value"] == pytest.approx(0.0)


def test_a_gap_between_two_solutions_is_no_gap_but_a_missing_one_is() -> None:
    """The interval of either is 2 wide: a tenth of that is near."""
    other = Equivalent(parameters={"d": 70.0}, derived={}, delta=1.0, origin="start")
    elsewhere = replace(other, parameters={"d": 88.0}, where="reflection = true")
    both = determined((9.0, 10.0, 11.0), (1.0, 0.0, 1.0), 2.0, (other, elsewhere))
    assert missed(both, np.concatenate([draws(9.0, 11.0), draws(69.5, 70.5)])) is None
    found = missed(both, draws(9.0, 11.0))
    assert found is not None
    assert found.numbers["value"] == pytest.approx(70.0)


def test_a_value_a_period_off_is_the_same() -> None:
    known = determined((0.5, 99.5), (0.0, 0.0), 4.0)
    assert missed(known, draws(-1.0, 1.0), period=100.0) is None
    assert missed(known, draws(20.0, 24.0), period=100.0) is not None


def test_draws_take_the_noise_as_stated_and_so_does_what_they_have_to_come_near() -> None:
    """Noise that the fit widened by 2.5: Dchi^2 of the stated noise is 6.25 times as much."""
    values, delta = (20.0, 30.0, 40.0), (4.0, 1.0, 0.0)
    assert missed(determined(values, delta, 10.0), draws(39.0, 41.0)) is not None
    assert missed(determined(values, delta, 10.0, inflation=2.5), draws(39.0, 41.0)) is None


def test_without_a_profile_a_bent_posterior_cannot_be_checked() -> None:
    alone = replace(determined(), knowledge=None)  # type: ignore[arg-type]
    own = [parameter("d", 0.0, 100.0, 50.0)]
    found = missed_value(alone, own, draws(0.0, 1.0), is_bent=True)
    assert found is not None
    assert found.kind == "posterior_unchecked"
    assert missed_value(alone, own, draws(0.0, 1.0), is_bent=False) is None
