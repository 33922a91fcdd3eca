"""How a fit ended, in words, for chi squares whose place in their distribution is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
import pytest
from scipy.stats import chi2

from fitting.fit.fit import Status
from fitting.inference.ending import (
    DESCRIBES,
    MISFIT,
    NOT_CONVERGED,
    ending_of,
    extent_of,
)
from fitting.inference.likelihood.knowledge import Adequacy, Ending
from fitting.measurements.complex.curve import ComplexCurve
from fitting.measurements.complex.sweep import ComplexSweep
from fitting.measurements.dataset import Dataset
from fitting.measurements.measurement import Measurement
from fitting.measurements.sweep import Sweep
from fitting.signal.residual_tests import TOGETHER, UNEQUAL, Structure
from fitting.text.arrays import FloatArray
from fitting.text.rendering import phrase
from tests.support.complex_data import mode
from tests.support.one_mode import SETUP

#: Of noise that was not stated.
UNSTATED = "the noise was not stated"


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


def test_large_chi_squares_are_written_out() -> None:
    assert "34400 on 1760 " in phrase("status", "chi", adequacy(34412.0, 1764.0, describes=False))


@pytest.mark.parametrize("share", [0.01, 0.5, 0.99])
def test_only_a_chi_square_that_noise_explains_is_wholly_good(share: float) -> None:
    found = adequacy(float(chi2.ppf(share, 9.0)), 9.0)
    ending = ending_of(Status.CONVERGED, found, inflation=1.0, structure=None)
    assert ending.whole
    assert ending.words == DESCRIBES
    assert " on 9 " in ending.ground
    assert "stated noise" in ending.ground
    told = ending_of(
        Status.CONVERGED, found, inflation=1.0, structure=None, noise="estimated noise"
    )
    assert "estimated noise" in told.ground


def test_errors_that_are_as_wide_as_before_are_not_told_as_wider() -> None:
    """1.003 would be printed as "1 times as wide"."""
    ending = ending_of(Status.CONVERGED, None, inflation=1.003, structure=widened(1.003))
    assert "times" not in ending.ground


def test_a_chi_square_far_below_its_freedom_is_not() -> None:
    found = adequacy(float(chi2.ppf(1e-6, 9.0)), 9.0)
    ending = ending_of(Status.CONVERGED, found, inflation=1.0, structure=None)
    assert (ending.words, ending.whole) == (DESCRIBES, False)
    assert "less" in ending.ground


@pytest.mark.parametrize(
    ("inflation", "structure", "told"),
    [
        (1.7, None, ("by 1.7",)),
        (1.0, widened(12.3), ("by 12.3", TOGETHER)),
        (1.0, widened(3.1, p_value=0.4, sizes_p=1e-6), ("by 3.1", UNEQUAL)),
        (1.0, widened(3.1, sizes_p=1e-6), ("by 3.1", TOGETHER, UNEQUAL)),
    ],
    ids=["inflation", "together", "unequal", "both"],
)
def test_widened_errors_are_told(
    inflation: float, structure: Structure | None, told: tuple[str, ...]
) -> None:
    found = adequacy(26.0, 9.0)
    how = "to 2 % of the largest amplitude"
    ending = ending_of(
        Status.CONVERGED, found, inflation=inflation, structure=structure, extent=how
    )
    assert (ending.words, ending.whole) == (DESCRIBES, False)
    assert "26 on 9 " in ending.ground
    assert all(words in ending.ground for words in told)
    assert all((words in ending.ground) is (words in told) for words in (TOGETHER, UNEQUAL))
    # how far is said where residuals of a curve are no noise of one size
    assert ending.extent == ("" if structure is None else how)
    assert ending.extent in phrase("status", "message", ending, "", "")


F = 1000.0 + np.linspace(-40.0, 40.0, 33)


def sweeps(count: int) -> ComplexSweep:
    """Complex sweeps of one line: the second one twice as high."""
    curves = [ComplexCurve(F, (k + 1) * mode(F, 1000.0, 12.5), label=f"{k}") for k in range(count)]
    return ComplexSweep(setup=SETUP, curves=tuple(curves))


def off(measurement: ComplexSweep, *shares: float) -> FloatArray:
    """Rows of values that are off by a share of the top, each in a direction of its own."""
    turns = np.exp(1j * np.arange(F.size))
    pairs = zip(measurement.records, shares, strict=True)
    return np.concatenate([c.rows_of(share * c.largest * turns) for c, share in pairs])


def test_how_far_is_the_distance_from_the_model_of_the_worst_curve() -> None:
    both = sweeps(2)
    rows = off(both, 0.02, 0.003)
    assert extent_of(Dataset((both,)), rows).startswith("to 2 % ")
    amplitude = np.abs(mode(F, 1000.0, 12.5))
    one = Sweep(setup=SETUP, frequency_hz=F, amplitude_v=amplitude, fitted=True)
    seen = Dataset((one,))
    assert extent_of(seen, np.full(F.size, -0.0123)).startswith("to 1.2 % ")


def test_of_rows_beside_curves_nothing_is_said() -> None:
    """A peak that is half its size off is not "described to 2 %"."""
    curve = sweeps(1)
    tones = Other(1)
    rows = np.concatenate([[0.5], off(curve, 0.02)])
    told = extent_of(Dataset((cast(Measurement, tones), curve)), rows)
    assert told.startswith("(curves to 2 % ")
    assert extent_of(Dataset((cast(Measurement, tones),)), rows[:1]) == ""


def test_a_misfit_and_a_fit_that_did_not_converge_are_told_apart() -> None:
    bad = ending_of(Status.MISFIT, adequacy(173.0, 9.0, False), inflation=4.4, structure=None)
    assert bad == Ending(words=MISFIT, ground=bad.ground)
    assert "173 on 9 " in bad.ground
    message = phrase("status", "message", bad, "Advice.", "Why so.")
    assert message.lower().startswith(MISFIT)
    assert message.endswith(f"{bad.ground}. Advice. Why so.")
    ragged = adequacy(4780.0, 8.034, False)
    said = ending_of(Status.MISFIT, ragged, inflation=24.4, structure=None)
    assert "4780 on 8.03 " in said.ground
    assert "595 times" in phrase("status", "advice", ragged)
    for status in (Status.NOT_CONVERGED, Status.INTERRUPTED):
        ending = ending_of(status, adequacy(4.0, 4.0), inflation=1.0, structure=None)
        assert ending == Ending(words=NOT_CONVERGED)
    message = phrase("status", "message", Ending(words=NOT_CONVERGED), "", "Why so.")
    assert message.lower() == f"{NOT_CONVERGED}. why so."


def test_where_nothing_can_be_held_against_the_noise_no_chi_square_is_claimed() -> None:
    for found, why in (
        (None, "nothing tested it"),
        (adequacy(3.0, 0.0), "as many values"),
        (adequacy(float("nan"), 0.0), UNSTATED),
    ):
        ending = ending_of(Status.CONVERGED, found, inflation=1.0, structure=None, extent="to 2 %")
        assert (ending.words, ending.whole) == (DESCRIBES, False)
        assert ending.ground.startswith(why)
        assert ending.extent == ("to 2 %" if why is UNSTATED else "")
        assert "χ²" not in ending.ground
