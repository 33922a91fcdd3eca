"""The line that the sweep shows by itself, before any model: what the FMU's fit can be held to."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.special import fdtrc

from fitting.campaign import SweepData
from fitting.campaign.instruments import own_estimates
from fitting.signal.line_record import (
    LineNumber,
    LineResult,
    LineValues,
    TriedForm,
    fields_of,
    no_line,
    number_of_line,
)
from fitting.signal.peaks import (
    ADDED,
    OFFSET,
    SLOPE,
    UNKNOWNS,
    Resonance,
    fit_resonance,
)
from fitting.signal.residual_tests import SMALLEST_RESIDUAL
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind
from fitting.text.rendering import phrase

#: Backgrounds whose fits stand beside each other, whatever the campaign chose.
COMPARED = ("none", "complex")
#: A background counts as seen where noise alone gains as much less often than this.
BACKGROUND_P = 1e-3
#: Two fits disagree from this many standard errors of their difference.
APART_SIGMA = 3.0
#: How many times what a model leaves one line has to leave for the sweep to be none.
FAR_MORE = 2.0
#: Widening of the errors from which it is worth a warning.
WORTH_TELLING = 1.5


@dataclass(frozen=True, kw_only=True)
class SweepLine(LineResult):
    """One damped mode fitted to the sweep itself, without the FMU; NaN where it shows none.

    ``forms`` are the fits without and with a complex background, whatever the campaign chose, and
    with an offset, or one with a slope, if it chose that or that leaves less.

    Attributes:
        amplitude: peak, in ``unit``, at the eigenfrequency.
        background: of the campaign, with which the line was fitted.
        message: why there is no line, or how the fit ended.
        notes: all that the head of the file contains.
        background_p: probability that noise alone lets the last form gain as much (F-test); NaN
            where one of them failed or nothing is left to gain.
        values: names of values of the fit that are this line's "frequency", "width" or "q"
            (`line_values`).
        mirrored: the other amplitude with which, with a complex background, the sweep has the same
            curve; None where there is none.
    """

    amplitude: LineNumber
    background: str
    message: str
    notes: Mapping[str, str]
    background_p: float = math.nan
    values: Mapping[str, str] = field(default_factory=dict)
    mirrored: LineNumber | None = None


def line_of_sweep(sweep: SweepData, left: float = math.nan) -> SweepLine:
    """One damped mode fitted to a sweep, with the background that the campaign declares.

    The fit with the other background stands beside it, to show what hangs on that choice. A sweep
    that shows no such line is no mistake here (another FMU may have two): every number is then NaN
    and the message says why. See `fitting.signal.peaks.fit_resonance` for the formula.

    Args:
        sweep: the measured sweep.
        left: root mean square over the largest amplitude that a fitted model leaves of it, if that
            is noise; where one line leaves far more, the sweep shows no single one.
    """
    notes = dict(sweep.notes or {})
    fits = _fits(sweep)
    fit = _held_against(fits[sweep.background], sweep, left)
    shared: dict[str, Any] = {
        "source": sweep.source.name,
        "unit": sweep.unit,
        "background": sweep.background,
        "instrument": own_estimates(notes),
        "notes": notes,
        "forms": tuple(_tried(background, each) for background, each in fits.items()),
    }
    if isinstance(fit, str):
        none = number_of_line("amplitude", math.nan, unit=sweep.unit)
        return SweepLine(**no_line(), **shared, amplitude=none, message=fit)
    return SweepLine(
        **fields_of(fit, LineValues),
        **shared,
        amplitude=replace(fit.amplitude, unit=sweep.unit),
        residual=fit.residual,
        message=fit.message,
        dof=fit.dof,
        structure=fit.structure,
        mirrored=None if fit.mirrored is None else replace(fit.mirrored, unit=sweep.unit),
        background_p=background_p(sweep.of_line[1], fits["none"], *list(fits.items())[-1]),
    )


def _fits(sweep: SweepData) -> dict[str, Resonance | str]:
    """The fits without and with a complex background; last one with an offset, where that is more.

    An offset is tried where the campaign names it or it leaves less than a complex background; one
    with a slope where the campaign names it, or noise alone would not let it gain as much over all
    of them.
    """
    fits = {background: _fit(sweep, background) for background in COMPARED}
    offset, slope = _fit(sweep, OFFSET), _fit(sweep, SLOPE)
    if sweep.background == OFFSET or _is_less(offset, fits["complex"]):
        fits[OFFSET] = offset
    gains = background_p(sweep.of_line[1], offset, SLOPE, slope, of=OFFSET) < BACKGROUND_P
    if sweep.background == SLOPE or (gains and _is_less(slope, fits["complex"])):
        fits[SLOPE] = slope
    return fits


def _is_less(fit: Resonance | str, other: Resonance | str) -> bool:
    """Whether a fit leaves less than another one, or than nothing."""
    return not isinstance(fit, str) and (isinstance(other, str) or _left(fit) < _left(other))


def _left(fit: Resonance) -> float:
    """Root mean square of what a fit leaves, in the sweep's unit."""
    return fit.residual * fit.amplitude.value


def _held_against(fit: Resonance | str, sweep: SweepData, left: float) -> Resonance | str:
    """The fit, or that it is none where a model leaves noise and it leaves far more."""
    if isinstance(fit, str) or math.isnan(left) or fit.structure.order == 0:
        return fit
    own = _left(fit) / float(np.max(sweep.of_line[1]))
    if not own > FAR_MORE * max(left, SMALLEST_RESIDUAL):
        return fit
    return phrase("status", "no_single_line", own, left)


def _fit(sweep: SweepData, background: str) -> Resonance | str:
    """The fit, or the sentence why there is none."""
    try:
        return fit_resonance(*sweep.of_line, background=background, source=sweep.source.name)
    except BadInput as error:
        return str(error)


def _tried(background: str, fit: Resonance | str) -> TriedForm:
    if isinstance(fit, str):
        return TriedForm(**no_line(), name=background, message=fit)
    return TriedForm(
        **fields_of(fit, LineValues),
        name=background,
        residual=fit.residual,
        structure=fit.structure,
        message=fit.message,
    )


def background_p(
    amplitude_v: FloatArray,
    plain: Resonance | str,
    name: str,
    full: Resonance | str,
    of: str = "none",
) -> float:
    """Probability that noise alone lets a background gain this much; NaN if not to be told.

    F = ((S0 - S1)/b)/(S1/(m - k))/w^2 with b and (m - k)/w^2 degrees of freedom: S0, S1 the sums of
    squares without and with a background of b unknowns, k in all, w the widening of the latter's
    errors, which turns points into independent points.

    Source: N. Draper and H. Smith, Applied Regression Analysis (extra sum of squares).

    Args:
        amplitude_v: amplitudes (n,), V peak.
        plain: line without a background, or with a simpler one.
        name: of the background, "complex", "offset" or "slope".
        full: line with it.
        of: name of the simpler background.
    """
    if isinstance(plain, str) or isinstance(full, str):
        return math.nan
    if plain.residual < SMALLEST_RESIDUAL:
        return math.nan
    largest = float(np.max(amplitude_v))  # shares of it: squares of any unit stay numbers
    without, left = (
        float(np.sum(((fit.curve - amplitude_v) / largest) ** 2)) for fit in (plain, full)
    )
    if not left > 0.0:
        return 0.0
    more = UNKNOWNS[name] - UNKNOWNS[of]
    freedom = (amplitude_v.size - UNKNOWNS[name]) / full.structure.widening**2
    return float(fdtrc(more, freedom, max(0.0, (without - left) / more * freedom / left)))


def line_findings(line: SweepLine, *, fitted: bool) -> Iterator[Finding]:
    """What a reader of the line must know.

    Args:
        line: that the sweep shows by itself.
        fitted: whether the campaign fits the FMU to this sweep; its structure is then told with the
            parameters and not here.
    """
    chosen = next((form for form in line.forms if form.name == line.background), None)
    if chosen is not None and chosen.structure.widening > WORTH_TELLING and not fitted:
        structure = chosen.structure
        yield Finding(
            kind=Kind.line_residuals,
            severity="warning",
            subject="sweep",
            numbers={"widening": structure.widening, "points": structure.points},
            names={"tests": (structure.departure,)},
        )
    if depends_on_background(line):
        plain, full = line.forms[0], line.forms[-1]
        numbers: dict[str, float] = {}
        for part, form in (("plain_", plain), ("full_", full)):
            numbers |= {
                f"{part}frequency_hz": form.frequency.value,
                f"{part}frequency_std_hz": form.frequency.std,
                f"{part}width_hz": form.width.value,
                f"{part}width_std_hz": form.width.std,
                f"{part}q": form.q.value,
                f"{part}q_std": form.q.std,
                f"{part}residual": form.residual,
            }
        numbers |= {
            "shift_hz": full.frequency.value - plain.frequency.value,
            "sigmas": _apart(plain, full),
            "p_value": line.background_p,
            "fitted": float(fitted),
        }
        key = (full.name,) if full.name in ADDED else ()
        yield Finding(
            kind=Kind.line_background,
            severity="warning",
            subject="sweep",
            numbers=numbers,
            names={"background": (full.name,), "key": key},
        )


def depends_on_background(line: SweepLine) -> bool:
    """Whether the two fits differ clearly, in what they find or in what they leave.

    Args:
        line: that the sweep shows by itself.
    """
    if line.background in ADDED or math.isnan(line.background_p):
        return False
    plain, full = line.forms[0], line.forms[-1]
    error = math.hypot(plain.width.std, full.width.std)
    apart = abs(full.width.value - plain.width.value) / error
    return max(apart, _apart(plain, full)) > APART_SIGMA or line.background_p < BACKGROUND_P


def _apart(plain: TriedForm, full: TriedForm) -> float:
    """Difference of the frequencies over its standard error."""
    error = math.hypot(plain.frequency.std, full.frequency.std)
    return abs(full.frequency.value - plain.frequency.value) / error
