"""A fitted sweep that a line with something beside it describes, where the model does not.

Where the residuals of a sweep tell its noise, chi square cannot show that the model fails: bad
residuals count as much noise. Another form of a line with k unknowns through the same m points can:
what it leaves, S1, bounds the noise,

    chi^2 = S (m - k)/S1        P = P(F > ((S - S1)/(k - 3)) ((m - k)/w^2)/S1)

with S of the fitted model and w the widening for what hangs together in the residuals of that form;
F has k - 3 and (m - k)/w^2 degrees of freedom. Errors that are widened for residuals that hang
together hold the truth where these are small beside the line; where another form leaves a fifth of
them (rms) they are no small ones. A model of several lines leaves less than any of the
forms, and nothing is said of it.

Source: N. Draper and H. Smith, Applied Regression Analysis (extra sum of squares).
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import numpy as np
from scipy.special import fdtrc

from fitting.fit.solution import Solution
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.measurements.sweep import Sweep
from fitting.signal.peaks import (
    BESIDE_WORDS,
    FLOOR,
    OFFSET,
    RICE,
    UNKNOWNS,
    Resonance,
    fit_resonance,
)
from fitting.signal.residual_tests import SMALLEST_RESIDUAL
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput

#: The forms that are tried.
TRIED = ("complex", OFFSET, FLOOR, RICE)
#: Mean squares over those of the other form, and probability, from which the model is given up.
RATIO, IMPROBABLE = 25.0, 1e-4


def closer_form(solution: Solution) -> Adequacy | None:
    """How much more the model leaves of a sweep than a line of another form; None if it is fair.

    Of several sweeps the one that is described worst.

    Args:
        solution: the end of a fit.
    """
    if solution.structure is None or solution.structure.order == 0:  # it leaves noise
        return None
    data = solution.objective.data
    tried = [
        compared(
            sweep.frequency_hz,
            sweep.amplitude_v,
            solution.final.residuals[mine],
            beside=OFFSET if sweep.has_offset else "none",
        )
        for sweep, mine in zip(data.measurements, data.slices, strict=True)
        if isinstance(sweep, Sweep) and sweep.fitted and not np.any(sweep.sigma > 0.0)
    ]
    worse = [each for each in tried if each is not None and not each.describes]
    return max(worse, key=lambda each: each.chi_square / each.freedom, default=None)


def compared(
    frequency_hz: FloatArray,
    amplitude_v: FloatArray,
    residuals: FloatArray,
    *,
    beside: str = "none",
) -> Adequacy | None:
    """What a model leaves of a sweep, against the form that leaves least; None without any form.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        amplitude_v: peak, shape (n,), V.
        residuals: of the model, over the largest amplitude, shape (n,).
        beside: what is solved for beside the model, "none" or "offset": forms with more are tried.
    """
    largest = float(np.max(amplitude_v))
    found = [
        (float(np.sum(((form.curve - amplitude_v) / largest) ** 2)), name, form)
        for name, form in _forms(frequency_hz, amplitude_v)
        if UNKNOWNS[name] > UNKNOWNS[beside]
    ]
    if not found or residuals.size <= max(UNKNOWNS[name] for name in TRIED):
        return None
    squares, name, form = min(found, key=lambda each: each[0])
    left, free = float(residuals @ residuals), residuals.size - UNKNOWNS[name]
    least = max(squares, residuals.size * SMALLEST_RESIDUAL**2)
    freedom = free / form.structure.widening**2
    more = UNKNOWNS[name] - UNKNOWNS[beside]
    gain = max(0.0, (left - least) / more * freedom / least)
    chance = float(fdtrc(more, freedom, gain))
    bad = left > RATIO * least and chance < IMPROBABLE
    return Adequacy(
        chi_square=left * free / least,
        freedom=float(free),
        p_value=chance,
        describes=not bad,
        against=f"a line with {BESIDE_WORDS[name]}",
    )


def _forms(frequency_hz: FloatArray, amplitude_v: FloatArray) -> Iterator[tuple[str, Resonance]]:
    """Every form that can be fitted to the sweep by itself."""
    for name in TRIED:
        with contextlib.suppress(BadInput):
            yield name, fit_resonance(frequency_hz, amplitude_v, background=name)
