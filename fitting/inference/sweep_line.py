"""The line that the sweep shows by itself, before any model: what the FMU's fit can be held to."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.special import fdtrc

from fitting.campaign import SweepData
from fitting.campaign.instruments import own_estimates
from fitting.signal.peaks import (
    ADDED,
    BESIDE_WORDS,
    OFFSET,
    SLOPE,
    UNKNOWNS,
    Resonance,
    fit_resonance,
)
from fitting.signal.residual_tests import SMALLEST_RESIDUAL, TOLD, found_words
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind
from fitting.text.notation import number, quantity, with_error

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
#: Numbers of a fit of the line that a finding repeats.
PRINTED = (
    "frequency_hz",
    "frequency_std_hz",
    "width_hz",
    "width_std_hz",
    "q",
    "q_std",
    "residual",
)


@dataclass(frozen=True, kw_only=True)
class LineFit:
    """The sweep's line with one form of background; NaN where that fit failed (`message`).

    `structure_p` is the probability that white noise leaves such residuals, `sizes_p` that noise
    of one size does, `points` how many independent and equal points they are worth, `widening` the
    factor that the errors carry for it.
    """

    background: str
    frequency_hz: float
    frequency_std_hz: float
    width_hz: float
    width_std_hz: float
    q: float
    q_std: float
    residual: float
    structure_p: float
    points: float
    widening: float
    message: str
    sizes_p: float = math.nan


@dataclass(frozen=True, kw_only=True)
class SweepLine:
    """One damped mode fitted to the sweep itself, without the FMU, beside what the instrument says.

    ``frequency_hz`` its eigenfrequency, ``width_hz`` the full width at half maximum of the squared
    amplitude, ``q`` their ratio, ``amplitude`` (in ``unit``, peak) at the eigenfrequency, each with
    half of its 68 % interval (Student's, with ``freedom``
    degrees of freedom); ``residual`` the root mean square of what the fit leaves, over the
    amplitude. NaN where the sweep shows no such line: ``message`` says why, or how the fit ended.
    ``instrument`` holds the instrument's own estimates ("frequency_hz", "q"), ``notes`` all that
    the head of its file says. ``fits`` are the fits without and with a complex background, whatever
    the campaign chose, and with an offset, or one with a slope, if it chose that or that leaves
    less; ``background_p`` is the probability that noise alone lets the last of them gain as much
    (F-test), NaN where one of them failed or nothing is left to gain. ``values`` names values of
    the fit that are this line's "frequency", "width" or "q" (`line_values`).
    ``amplitude_mirrored`` is the other amplitude with which, beside a complex background, the sweep
    has the same curve, and its error, NaN where there is none.
    """

    frequency_hz: float
    frequency_std_hz: float
    width_hz: float
    width_std_hz: float
    q: float
    q_std: float
    amplitude: float
    amplitude_std: float
    unit: str
    residual: float
    background: str
    message: str
    instrument: Mapping[str, float]
    notes: Mapping[str, str]
    freedom: float = math.inf
    fits: tuple[LineFit, ...] = ()
    background_p: float = float("nan")
    values: Mapping[str, str] = field(default_factory=dict)
    amplitude_mirrored: float = math.nan
    amplitude_mirrored_std: float = math.nan


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
    instrument = own_estimates(notes)
    tried = _tried(sweep)
    fit = _held_against(tried[sweep.background], sweep, left)
    fits = tuple(_line_fit(background, found) for background, found in tried.items())
    nan = math.nan
    if isinstance(fit, str):
        return SweepLine(
            frequency_hz=nan,
            frequency_std_hz=nan,
            width_hz=nan,
            width_std_hz=nan,
            q=nan,
            q_std=nan,
            amplitude=nan,
            amplitude_std=nan,
            unit=sweep.unit,
            residual=nan,
            background=sweep.background,
            message=fit,
            instrument=instrument,
            notes=notes,
            fits=fits,
        )
    return SweepLine(
        frequency_hz=fit.eta_hz,
        frequency_std_hz=fit.eta_std_hz,
        width_hz=fit.width_hz,
        width_std_hz=fit.width_std_hz,
        q=fit.q,
        q_std=fit.q_std,
        amplitude=fit.amplitude,
        amplitude_std=fit.amplitude_std,
        unit=sweep.unit,
        residual=fit.residual_rms,
        background=sweep.background,
        message=fit.message,
        instrument=instrument,
        notes=notes,
        fits=fits,
        freedom=fit.freedom,
        amplitude_mirrored=fit.mirrored,
        amplitude_mirrored_std=fit.mirrored_std,
        background_p=background_p(sweep.of_line[1], tried["none"], *list(tried.items())[-1]),
    )


def _tried(sweep: SweepData) -> dict[str, Resonance | str]:
    """The fits without and with a complex background; last one with an offset, where that is more.

    An offset is tried where the campaign names it or it leaves less than a complex background; one
    with a slope where the campaign names it, or noise alone would not let it gain as much over all
    of them.
    """
    tried = {background: _fit(sweep, background) for background in COMPARED}
    offset, slope = _fit(sweep, OFFSET), _fit(sweep, SLOPE)
    if sweep.background == OFFSET or _is_less(offset, tried["complex"]):
        tried[OFFSET] = offset
    seen = background_p(sweep.of_line[1], offset, SLOPE, slope, of=OFFSET) < BACKGROUND_P
    if sweep.background == SLOPE or (seen and _is_less(slope, tried["complex"])):
        tried[SLOPE] = slope
    return tried


def _is_less(fit: Resonance | str, other: Resonance | str) -> bool:
    """Whether a fit leaves less than another one, or than nothing."""
    return not isinstance(fit, str) and (isinstance(other, str) or _left(fit) < _left(other))


def _left(fit: Resonance) -> float:
    """Root mean square of what a fit leaves, in the sweep's unit."""
    return fit.residual_rms * fit.amplitude


def _held_against(fit: Resonance | str, sweep: SweepData, left: float) -> Resonance | str:
    """The fit, or that it is none where a model leaves noise and it leaves far more."""
    if isinstance(fit, str) or math.isnan(left) or fit.structure.order == 0:
        return fit
    own = _left(fit) / float(np.max(sweep.of_line[1]))
    if not own > FAR_MORE * max(left, SMALLEST_RESIDUAL):
        return fit
    return (
        f"it is no single line; the best one leaves {number(100.0 * own, 2)} % of the peak, the "
        f"fitted model {number(100.0 * left, 2)} %"
    )


def _fit(sweep: SweepData, background: str) -> Resonance | str:
    """The fit, or the sentence why there is none."""
    try:
        return fit_resonance(*sweep.of_line, background=background, source=sweep.source.name)
    except BadInput as error:
        return str(error)


def _line_fit(background: str, fit: Resonance | str) -> LineFit:
    nan = math.nan
    if isinstance(fit, str):
        return LineFit(
            background=background,
            frequency_hz=nan,
            frequency_std_hz=nan,
            width_hz=nan,
            width_std_hz=nan,
            q=nan,
            q_std=nan,
            residual=nan,
            structure_p=nan,
            points=nan,
            widening=nan,
            message=fit,
        )
    found = fit.structure
    return LineFit(
        background=background,
        frequency_hz=fit.eta_hz,
        frequency_std_hz=fit.eta_std_hz,
        width_hz=fit.width_hz,
        width_std_hz=fit.width_std_hz,
        q=fit.q,
        q_std=fit.q_std,
        residual=fit.residual_rms,
        structure_p=found.p_value,
        points=found.points,
        widening=found.widening,
        sizes_p=found.sizes_p,
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
    if plain.residual_rms < SMALLEST_RESIDUAL:
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
    chosen = next((fit for fit in line.fits if fit.background == line.background), None)
    if chosen is not None and chosen.widening > WORTH_TELLING and not fitted:
        yield Finding(
            kind=Kind.line_residuals,
            severity="warning",
            subject="sweep",
            numbers={"widening": chosen.widening, "points": chosen.points},
            names={"tests": (found_words(chosen.structure_p, chosen.sizes_p),)},
        )
    if depends_on_background(line):
        plain, full = line.fits[0], line.fits[-1]
        parts = {"plain_": plain, "full_": full}
        numbers = {
            f"{part}{name}": float(getattr(fit, name))
            for part, fit in parts.items()
            for name in PRINTED
        }
        numbers |= {
            "shift_hz": full.frequency_hz - plain.frequency_hz,
            "sigmas": _apart(plain, full),
            "p_value": line.background_p,
            "fitted": float(fitted),
        }
        key = (full.background,) if full.background in ADDED else ()
        yield Finding(
            kind=Kind.line_background,
            severity="warning",
            subject="sweep",
            numbers=numbers,
            names={"background": (_background_words(full.background),), "key": key},
        )


def line_sentences(line: SweepLine) -> list[str]:
    """The line, the instrument's own estimate, its residuals, its other fit, in a sentence each.

    Args:
        line: that the sweep shows by itself.
    """
    if math.isnan(line.frequency_hz):
        return [f"Sweep by itself: {line.message}."]
    said = [
        f"Sweep by itself: f = {with_error(line.frequency_hz, line.frequency_std_hz, 'Hz')}, "
        f"width {with_error(line.width_hz, line.width_std_hz, 'Hz')}, "
        f"Q = {with_error(line.q, line.q_std)}, "
        f"A = {quantity(line.amplitude, line.amplitude_std, line.unit)}{_or_mirrored(line)}, "
        f"residual {100.0 * line.residual:.2g} % of the peak."
    ]
    own = []
    if "frequency_hz" in line.instrument:
        there = line.instrument["frequency_hz"]
        own.append(f"f = {there:.9g} Hz ({there - line.frequency_hz:+.3g} Hz from this fit)")
    if "q" in line.instrument:
        there = line.instrument["q"]
        own.append(f"Q = {there:g} ({100.0 * (there / line.q - 1.0):+.2g} %)")
    if own:
        said.append(f"The instrument's own estimate: {', '.join(own)}.")
    for fit in line.fits:
        if fit.background != line.background:
            said.append(f"The same sweep {_fit_words(fit)}.")
        elif fit.widening > TOLD:
            said.append(f"{_structure_words(fit).capitalize()}.")
    return said


def _or_mirrored(line: SweepLine) -> str:
    """The other amplitude of the same curve, where it is another one."""
    other = line.amplitude_mirrored
    if not abs(other - line.amplitude) > line.amplitude_std:
        return ""
    same = quantity(other, line.amplitude_mirrored_std, line.unit)
    return f" or, the curve being the same, {same}"


def _structure_words(fit: LineFit) -> str:
    return (
        f"a single line leaves residuals that {found_words(fit.structure_p, fit.sizes_p)}: the "
        f"points are worth {fit.points:.3g} independent and equal ones, and the errors are "
        f"{fit.widening:.3g} times as wide for it"
    )


def _background_words(background: str) -> str:
    return "a complex background" if background == "complex" else BESIDE_WORDS[background]


def _fit_words(fit: LineFit) -> str:
    name = "without background"
    if fit.background != "none":
        name = f"with {_background_words(fit.background)}"
    if math.isnan(fit.frequency_hz):
        return f"{name} cannot be fitted ({fit.message})"
    return (
        f"{name}: f = {with_error(fit.frequency_hz, fit.frequency_std_hz, 'Hz')}, "
        f"width {with_error(fit.width_hz, fit.width_std_hz, 'Hz')}, "
        f"Q = {with_error(fit.q, fit.q_std)}, residual {100.0 * fit.residual:.2g} % of the peak"
    )


def depends_on_background(line: SweepLine) -> bool:
    """Whether the two fits differ clearly, in what they find or in what they leave.

    Args:
        line: that the sweep shows by itself.
    """
    if line.background in ADDED or math.isnan(line.background_p):
        return False
    plain, full = line.fits[0], line.fits[-1]
    apart = abs(full.width_hz - plain.width_hz) / math.hypot(plain.width_std_hz, full.width_std_hz)
    return max(apart, _apart(plain, full)) > APART_SIGMA or line.background_p < BACKGROUND_P


def _apart(plain: LineFit, full: LineFit) -> float:
    """Difference of the frequencies over its standard error."""
    error = math.hypot(plain.frequency_std_hz, full.frequency_std_hz)
    return abs(full.frequency_hz - plain.frequency_hz) / error
