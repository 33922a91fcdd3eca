"""Draws have to come near every value that a fit accepts: by hand, on records made up here."""

from __future__ import annotations

import math
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
from fitting.posterior.convergence import accepted_by, missed_by
from fitting.posterior.minima import Target
from fitting.text.arrays import FloatArray
from fitting.text.estimate import ParameterEstimate
from tests.support.closed_posteriors import parameter


def target(**changes: Any) -> Target:
    """One parameter from 0 to 100; nothing is evaluated."""
    own = replace(parameter("d", 0.0, 100.0, 50.0), **changes)

    def never(p: FloatArray) -> Any:
        raise AssertionError

    return Target(parameters=(own,), log=never, rows=never)


def draws(low: float, high: float) -> FloatArray:
    return np.linspace(low, high, 400).reshape(20, 20, 1)


def missed(known: Any, drawn: FloatArray, **changes: Any) -> float | None:
    found = missed_by(target(**changes), np.array([math.nan]), drawn, {"d": known})
    return None if found is None else found.numbers["value"]


def test_an_end_that_fits_and_that_no_draw_is_near_is_missed() -> None:
    """As a chain that never saw the upper half of what its profile accepts."""
    whole = ((0.0, 30.0, 60.0, 100.0), 100.0)
    assert missed(whole, draws(5.0, 95.0)) is None
    assert missed(whole, draws(5.0, 56.6)) == 100.0
    assert missed(whole, draws(40.0, 99.0)) == 0.0  # the farthest of two
    found = missed_by(target(), np.array([math.nan]), draws(5.0, 56.6), {"d": whole})
    assert found is not None
    assert found.subject == "d"
    assert found.numbers["nearest"] == pytest.approx(56.6)


def test_a_gap_between_two_solutions_is_no_gap_but_a_missing_one_is() -> None:
    """The interval of either is 2 wide: a tenth of that is near."""
    both = ((9.0, 10.0, 11.0, 70.0), 2.0)
    two = np.concatenate([draws(9.0, 11.0), draws(69.5, 70.5)])
    assert missed(both, two) is None
    assert missed(both, draws(9.0, 11.0)) == 70.0


def test_a_value_a_period_off_is_the_same() -> None:
    known = ((0.5, 99.5), 4.0)
    turning = target(period=100.0)
    at_both_ends = draws(-1.0, 1.0)  # about 0, in a period that begins at -50
    assert missed_by(turning, np.array([-50.0]), at_both_ends, {"d": known}) is None
    away = missed_by(turning, np.array([-50.0]), draws(20.0, 24.0), {"d": known})
    assert away is not None


def determined(inflation: float = 1.0) -> Determined:
    """Dchi^2 = (d - 40)^2/100 of a fit whose noise was widened by so much, and 100 that fits."""
    values = (20.0, 30.0, 40.0, 50.0, 60.0, 100.0)
    scan = Scan(
        sigma=10.0,
        values=values,
        delta_chi2=(4.0, 1.0, 0.0, 1.0, 4.0, 0.3),
        path={"d": values, "e": (5.0,) * 6},
    )
    other = Equivalent(parameters={"d": 77.0, "e": 5.0}, derived={}, delta=1.0, origin="start")
    elsewhere = replace(other, parameters={"d": 88.0, "e": 5.0}, where="reflection = true")
    plain: dict[str, Any] = {"directions": (), "without_effect": ()}
    known = Knowledge(
        data=True,
        chi_square=4.0,
        freedom=4.0,
        adequacy=Adequacy(chi_square=4.0, freedom=4.0, p_value=0.4, describes=True),
        most_likely={"d": 40.0, "e": 5.0},
        effort=Effort(1, 0, 1),
        inflation=inflation,
        scans={"d": scan},
        equivalents=(other, elsewhere),
        **plain,
    )
    own = ParameterEstimate(name="d", value=40.0, unit="", ci95=(20.4, 100.0))
    return Determined(parameters={"d": own}, derived={}, knowledge=known)


BOUNDS = (parameter("d", 0.0, 100.0, 50.0), parameter("e", 0.0, 10.0, 5.0))


def test_accepted_are_points_of_the_profile_and_other_minima_of_the_same_alternative() -> None:
    found = accepted_by(determined(), BOUNDS)["d"]
    assert sorted(found[0]) == [30.0, 40.0, 50.0, 77.0, 100.0]
    assert found[1] == pytest.approx(79.6)


def test_draws_take_the_noise_as_stated_and_so_does_what_they_have_to_come_near() -> None:
    """Noise that the fit widened by 2.5: Dchi^2 of the stated noise is 6.25 times as much."""
    found = accepted_by(determined(inflation=2.5), BOUNDS)["d"]
    assert sorted(found[0]) == [40.0, 77.0, 100.0]
