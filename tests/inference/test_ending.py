"""How a fit ended, for chi squares whose place in their distribution is known, and its sentence."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import pytest
from scipy.stats import chi2

from fitting.fit.fit import Status
from fitting.inference.adequacy import ending_of
from fitting.inference.likelihood.knowledge import Adequacy, Ending
from fitting.measurements.complex_sweep import ComplexCurve, ComplexSweep
from fitting.measurements.dataset import Dataset
from fitting.measurements.measurement import Measurement
from fitting.measurements.sweep import Sweep
from fitting.signal.residual_tests import TOGETHER, UNEQUAL, Structure
from fitting.text.arrays import FloatArray
from fitting.text.rendering import phrase
from tests.support.complex_data import mode
from tests.support.one_mode import SETUP

F = 1000.0 + np.linspace(-40.0, 40.0, 33)


@dataclass(frozen=True)
class Other(Measurement):
    """Rows that are no curve."""

    count: int

    @property
    def rows(self) -> int:
        return self.count


def adequacy(chi_square: float, freedom: float, describes: bool = True) -> Adequacy:
    return Adequacy(
        chi_square=chi_square,
        freedom=freedom,
        p_value=float(chi2.sf(chi_square, freedom)),
        describes=describes,
    )


def widened(factor: float, p_value: float = 1e-9, sizes_p: float = 1.0) -> Structure:
    return Structure(
        p_value=p_value, sizes_p=sizes_p, order=1, points=20.0, widening=factor, together=factor
    )


def sweeps(count: int) -> ComplexSweep:
    """Complex sweeps of one line: the second one twice as high."""
    curves = [ComplexCurve(F, (k + 1) * mode(F, 1000.0, 12.5), label=f"{k}") for k in range(count)]
    return ComplexSweep(setup=SETUP, curves=tuple(curves))


def off(measurement: ComplexSweep, *shares: float) -> FloatArray:
    """Rows of values that are off by a share of the top, each in a direction of its own."""
    turns = np.exp(1j * np.arange(F.size))
    pairs = zip(measurement.records, shares, strict=True)
    return np.concatenate([c.rows_of(share * c.largest * turns) for c, share in pairs])


def ended(found: Adequacy | None, status: Status = Status.CONVERGED, **about: Any) -> Ending:
    """The end of a fit of a complex sweep, off by 2 %."""
    sweep = sweeps(1)
    known: dict[str, Any] = {"inflation": 1.0, "structure": None}
    known |= {"data": Dataset((sweep,)), "residuals": off(sweep, 0.02)}
    return ending_of(status, found, **(known | about))


def test_large_chi_squares_are_written_out() -> None:
    assert "34400 on 1760 " in phrase("status", "chi", adequacy(34412.0, 1764.0, describes=False))


@pytest.mark.parametrize("share", [0.01, 0.5, 0.99])
def test_only_a_chi_square_that_noise_explains_is_wholly_good(share: float) -> None:
    ending = ended(adequacy(float(chi2.ppf(share, 9.0)), 9.0))
    assert ending.is_whole
    assert (ending.kind, ending.noise) == ("described", "stated")
    assert not ending.shows_share


def test_errors_that_are_as_wide_as_before_are_not_scaled() -> None:
    """1.003 would be printed as a factor of 1."""
    ending = ended(None, inflation=1.003, structure=widened(1.003))
    assert not ending.is_scaled
    assert not ending.is_structured
    assert "scaled" not in phrase("status", "ground", ending)


def test_a_chi_square_far_below_its_freedom_is_not() -> None:
    ending = ended(adequacy(float(chi2.ppf(1e-6, 9.0)), 9.0))
    assert (ending.kind, ending.is_whole, ending.is_small) == ("described", False, True)


@pytest.mark.parametrize(
    ("inflation", "structure", "words"),
    [
        (1.7, None, ("by 1.7",)),
        (1.0, widened(12.3), ("by 12.3", TOGETHER)),
        (1.0, widened(3.1, p_value=0.4, sizes_p=1e-6), ("by 3.1", UNEQUAL)),
        (1.0, widened(3.1, sizes_p=1e-6), ("by 3.1", TOGETHER, UNEQUAL)),
    ],
    ids=["inflation", "together", "unequal", "both"],
)
def test_scaled_errors_are_printed(
    inflation: float, structure: Structure | None, words: tuple[str, ...]
) -> None:
    ending = ended(adequacy(26.0, 9.0), inflation=inflation, structure=structure)
    ground = phrase("status", "ground", ending)
    assert (ending.kind, ending.is_whole) == ("described", False)
    assert "26 on 9 " in ground
    assert all(each in ground for each in words)
    assert all((each in ground) is (each in words) for each in (TOGETHER, UNEQUAL))
    # how far curves are described, where their residuals are no noise of one size
    assert ending.shows_share is (structure is not None)
    assert ending.share == pytest.approx(0.02, rel=0.01)
    assert ("2 %" in phrase("status", "message", ending)) is ending.shows_share


def test_how_far_is_the_distance_from_the_model_of_the_worst_curve() -> None:
    both = sweeps(2)
    ending = ended(None, data=Dataset((both,)), residuals=off(both, 0.02, 0.003))
    assert ending.share == pytest.approx(0.02, rel=0.01)
    assert not ending.is_part
    amplitude = np.abs(mode(F, 1000.0, 12.5))
    one = Sweep(setup=SETUP, frequency_hz=F, amplitude_v=amplitude, fitted=True)
    ending = ended(None, data=Dataset((one,)), residuals=np.full(F.size, -0.0123))
    assert ending.share == pytest.approx(0.0123, rel=0.01)


def test_of_rows_that_are_no_curve_nothing_is_reported() -> None:
    """A peak that is half its size off is not described to 2 %."""
    curve, tones = sweeps(1), cast(Measurement, Other(1))
    rows = np.concatenate([[0.5], off(curve, 0.02)])
    ending = ended(None, data=Dataset((tones, curve)), residuals=rows)
    assert ending.share == pytest.approx(0.02, rel=0.01)
    assert ending.is_part
    assert math.isnan(ended(None, data=Dataset((tones,)), residuals=rows[:1]).share)


def test_a_misfit_and_a_fit_that_did_not_converge_are_distinguished() -> None:
    bad = ended(adequacy(173.0, 9.0, False), Status.MISFIT, inflation=4.4)
    assert (bad.kind, bad.is_whole, bad.shows_share) == ("not_described", False, False)
    assert "173 on 9 " in phrase("status", "ground", bad)
    message = phrase("status", "message", bad, "Why so.")
    assert message.endswith("Why so.")
    ragged = ended(adequacy(4780.0, 8.034, False), Status.MISFIT, inflation=24.4)
    assert "4780 on 8.03 " in phrase("status", "ground", ragged)
    assert "595 times" in phrase("status", "message", ragged)
    for status in (Status.NOT_CONVERGED, Status.INTERRUPTED):
        assert ended(adequacy(4.0, 4.0), status).kind == "not_converged"
    assert phrase("status", "message", Ending(), "Why so.") == "Not converged. Why so."


@pytest.mark.parametrize(
    ("found", "shows_share"),
    [(None, False), (adequacy(3.0, 0.0), False), (adequacy(math.nan, 0.0), True)],
    ids=["not tested", "no redundancy", "noise not stated"],
)
def test_where_nothing_is_compared_with_the_noise_no_chi_square_is_claimed(
    found: Adequacy | None, shows_share: bool
) -> None:
    ending = ended(found)
    assert (ending.kind, ending.is_whole) == ("described", False)
    assert not ending.is_tested
    assert ending.shows_share is shows_share
    assert "χ²" not in phrase("status", "ground", ending)
