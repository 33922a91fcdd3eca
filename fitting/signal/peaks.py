"""Laboratory traces to numbers: noise floor, amplitude at known tones, resonance of a sweep.

Works on plain arrays in Hz and volts (or whatever unit the detector was declared in).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import ive

from fitting.signal.least_squares import LeastSquaresFit, folded, minimise_squares
from fitting.signal.line_record import (
    LineNumber,
    LineValues,
    SecondLine,
    line_numbers,
    number_of_line,
)
from fitting.signal.residual_tests import SMALLEST_RESIDUAL, Structure, residual_structure
from fitting.signal.student import ROOT_68, ratio95, reach
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import hertz, how_many

FLOOR_KINDS = ("robust", "mean", "none")
#: And what else amplitudes may carry: a constant that is added to them, with a slope or without,
#: noise, of which powers or amplitudes were averaged, or the tail of another line.
OFFSET, SLOPE, FLOOR, RICE, TAIL = "offset", "slope", "floor", "rice", "tail"
#: Or every point is one reading of the line in noise, see `fitting.signal.single_readings`.
SINGLE = "single"
#: Backgrounds of which fits are made elsewhere than in `fit_resonance`.
ELSEWHERE = (TAIL, SINGLE)
#: Unknowns of a line of amplitudes with what may stand beside it.
UNKNOWNS = {
    "none": 3,
    SINGLE: 3,
    OFFSET: 4,
    SLOPE: 5,
    FLOOR: 4,
    RICE: 4,
    "complex": 5,
    TAIL: 7,
}
#: What a campaign may declare beside the line of a sweep.
BACKGROUNDS = ("none", "complex", OFFSET, SLOPE)
#: Those of them that are added to amplitudes, and solved beside an FMU's.
ADDED = (OFFSET, SLOPE)
#: What may stand beside a line, in words; "complex slope" only beside complex values.
BESIDE_WORDS = {
    "complex": "a complex constant",
    "complex slope": "a complex background that changes linearly with frequency",
    OFFSET: "a constant that is added to its amplitude",
    SLOPE: "a background that changes linearly with frequency and is added to its amplitude",
    FLOOR: "noise whose power is added to its own",
    RICE: "noise, of which amplitudes were averaged",
    SINGLE: "noise that is in every single reading",
    TAIL: "the tail of another line",
}
#: Evaluations after which the tail of another line that is still looked for is none, and the fall
#: of the sum of squares that counts.
ROUNDS_FOR_TAIL, GAIN_OF_TAIL = 80, 1e-8
#: Phases of another line with which its fit begins.
TURNS = (1.0, complex(np.exp(2j * np.pi / 3.0)), complex(np.exp(-2j * np.pi / 3.0)))
#: Chi square by which a second amplitude may be worse that is told beside the best one.
ALLOWED = 9.0
#: What a tail is refused for that is none.
AMONG = "stands among the points"
#: Median of the modulus of a normal deviate, and deviation of a second difference of noise.
NORMAL_MEDIAN, SECOND_DIFFERENCE = 0.6745, math.sqrt(6.0)
#: Power of a line over that of noise from which two terms of a series are exact to rounding.
RICE_LARGE = 1e8

# |n| of complex Gaussian noise with sigma per quadrature is Rayleigh distributed.
RAYLEIGH_MEAN = math.sqrt(math.pi / 2.0)
RAYLEIGH_MEDIAN = math.sqrt(2.0 * math.log(2.0))

GUARD_POINTS = 6  # a resolution filter sampled at its own bandwidth is below 1e-20 there
MIN_FLOOR_POINTS = 10
DETECTION_SIGMA = 4.0  # noise alone exceeds it in one trace point of 3000
MIN_SWEEP_POINTS = 8
CHANCE = 1e-6  # of an unknown line of noise alone, in a whole spectrum


@dataclass(frozen=True)
class NoiseFloor:
    """Noise of a magnitude trace: mean magnitude ``level_v`` and ``sigma_v`` per quadrature."""

    level_v: float
    sigma_v: float


@dataclass(frozen=True, kw_only=True)
class PeakReading:
    """Amplitudes at the known tones of one spectrum.

    ``peaks_v`` (n,) with the floor removed, ``sigmas_v`` (n,) standard deviations, ``raw_v`` (n,)
    as read, ``floor`` of the trace. All in the trace's amplitude unit.
    """

    peaks_v: FloatArray
    sigmas_v: FloatArray
    raw_v: FloatArray
    floor: NoiseFloor


@dataclass(frozen=True, kw_only=True)
class Resonance(LineValues):
    """One damped mode fitted to a sweep.

    Errors are widened for correlated residuals, see ``structure``; they are Student's, with ``dof``
    degrees of freedom of the noise, infinite where it is known.

    Attributes:
        amplitude: of the line alone at its eigenfrequency, in the unit of the points. Of two with
            the same curve the lower one.
        background: the constant, zero without; of noise its root mean square, of a slope its value
            at the eigenfrequency.
        slope: what a slope changes by with every Hz.
        residual: root mean square of the residuals over the amplitude.
        correlation: between frequency and width.
        curve: fitted values, shape (n,).
        message: how the fit ended.
        structure: what the order of the residuals shows.
        dof: degrees of freedom of the noise.
        mirrored: the other amplitude that has the same curve, with a complex constant, or about it,
            with a tail; None elsewhere.
    """

    amplitude: LineNumber
    background: complex
    residual: float
    correlation: float
    curve: FloatArray | ComplexArray
    message: str
    structure: Structure
    dof: float
    mirrored: LineNumber | None = None
    slope: float = 0.0


def noise_floor(
    frequency_hz: FloatArray,
    amplitude_v: FloatArray,
    tones_hz: Sequence[float],
    kind: str,
    *,
    source: str = "spectrum",
) -> NoiseFloor:
    """Noise level of a magnitude spectrum from the points away from every tone.

    "mean": level = average (the paper's xi), sigma = level / sqrt(pi/2). "robust" and "none":
    sigma = median / sqrt(2 ln 2), level = sigma sqrt(pi/2); spurious lines and skirts on up to
    half of the points shift it little. Rayleigh statistics of the magnitude in both.

    Args:
        frequency_hz: frequencies (n,), Hz.
        amplitude_v: amplitudes (n,), V peak.
        tones_hz: frequencies of the tones, Hz.
        kind: how the floor is taken: "mean", "robust" or "none".
        source: of the data, for complaints.

    Raises:
        BadInput: too few points away from the tones.
    """
    away = np.ones(frequency_hz.size, dtype=bool)
    for tone in tones_hz:
        nearest = int(np.argmin(np.abs(frequency_hz - tone)))
        away[max(0, nearest - GUARD_POINTS) : nearest + GUARD_POINTS + 1] = False
    quiet = amplitude_v[away]
    if quiet.size < MIN_FLOOR_POINTS:
        raise BadInput(
            f"{source}: {how_many(quiet.size, 'point')} more than {GUARD_POINTS} points away from "
            f"the tones; the noise floor wants at least {MIN_FLOOR_POINTS} (a wider span, or ready "
            "peaks)"
        )
    if kind == "mean":
        level = float(np.mean(quiet))
        return NoiseFloor(level, level / RAYLEIGH_MEAN)
    sigma = float(np.median(quiet)) / RAYLEIGH_MEDIAN
    return NoiseFloor(sigma * RAYLEIGH_MEAN, sigma)


def read_peaks(
    frequency_hz: FloatArray,
    amplitude_v: FloatArray,
    tones_hz: Sequence[float],
    kind: str = "robust",
    *,
    source: str = "spectrum",
) -> PeakReading:
    """Amplitudes at ``tones_hz`` of a magnitude spectrum, noise floor removed.

    "mean" subtracts the average floor, z* = z - xi, as the paper does. "robust" takes the noise off
    in quadrature, z* = sqrt(z^2 - sigma^2), which leaves a bias of order sigma^4 / z^3; the plain
    difference takes 1 percent off a peak 100 times the floor. "none" leaves z.

    Args:
        frequency_hz: frequencies (n,), Hz.
        amplitude_v: amplitudes (n,), V peak.
        tones_hz: frequencies of the tones, Hz.
        kind: how the floor is taken: "mean", "robust" or "none".
        source: of the data, for complaints.

    Raises:
        BadInput: a tone outside the trace, or one that does not stand out of the floor.

    Source: the paper, section on the laboratory data; Gudbjartsson and Patz, The Rician
    distribution of noisy MRI data, Magn. Reson. Med. 34 (1995) 910, for the quadrature.
    """
    if kind not in FLOOR_KINDS:
        raise ValueError(f"noise floor kind {kind!r}, wanted one of {FLOOR_KINDS}")
    for tone in tones_hz:
        _check_inside(frequency_hz, tone, source)
    raw = np.array([_amplitude_at(frequency_hz, amplitude_v, tone) for tone in tones_hz])
    if kind == "none" and frequency_hz.size < MIN_FLOOR_POINTS + (2 * GUARD_POINTS + 1) * len(raw):
        floor = NoiseFloor(0.0, 0.0)  # a bare list of lines has no floor to read
    else:
        floor = noise_floor(frequency_hz, amplitude_v, tones_hz, kind, source=source)
    for tone, height in zip(tones_hz, raw, strict=True):
        if not height > DETECTION_SIGMA * floor.sigma_v:
            raise BadInput(
                f"{source}: no peak at the tone {hertz(tone, digits=8)}: {height:.3g} read on "
                f"a noise floor of {floor.level_v:.3g}; wanted at least "
                f"{DETECTION_SIGMA * floor.sigma_v:.3g} (wrong file, or wrong drive frequency?)"
            )
    if kind == "mean":
        peaks = raw - floor.level_v
    elif kind == "robust":
        peaks = raw * np.sqrt(1.0 - (floor.sigma_v / raw) ** 2)  # no square of a volt: any scale
    else:
        peaks = raw
    return PeakReading(
        peaks_v=peaks, sigmas_v=np.full(raw.shape, floor.sigma_v), raw_v=raw, floor=floor
    )


def unknown_line(
    frequency_hz: FloatArray, amplitude_v: FloatArray, known_hz: Sequence[float]
) -> tuple[float, float] | None:
    """The largest line of a spectrum at none of the known frequencies: (Hz, amplitude), or None.

    Told where noise alone reaches that height at any of the points less often than `CHANCE`:
    a > sigma sqrt(2 ln(n/CHANCE)) for n Rayleigh-distributed magnitudes.

    Args:
        frequency_hz: frequencies (n,), Hz.
        amplitude_v: amplitudes (n,), any unit.
        known_hz: lines that are expected, Hz.
    """
    away = np.ones(frequency_hz.size, dtype=bool)
    for tone in known_hz:
        nearest = int(np.argmin(np.abs(frequency_hz - tone)))
        away[max(0, nearest - GUARD_POINTS) : nearest + GUARD_POINTS + 1] = False
    rest = np.flatnonzero(away)
    if rest.size < MIN_FLOOR_POINTS:
        return None
    sigma = float(np.median(amplitude_v[rest])) / RAYLEIGH_MEDIAN
    top = int(rest[np.argmax(amplitude_v[rest])])
    if not amplitude_v[top] > sigma * math.sqrt(2.0 * math.log(rest.size / CHANCE)):
        return None
    return float(frequency_hz[top]), float(amplitude_v[top])


def _check_inside(frequency_hz: FloatArray, tone_hz: float, source: str) -> None:
    first, last = float(frequency_hz[0]), float(frequency_hz[-1])
    slack = 0.5 * (last - first) / max(1, frequency_hz.size - 1)
    if not first - slack <= tone_hz <= last + slack:
        raise BadInput(
            f"{source}: does not contain the tone {hertz(tone_hz, digits=8)}; its points run "
            f"from {hertz(first, last, digits=8, joined=' to ')}"
        )


def _amplitude_at(frequency_hz: FloatArray, amplitude_v: FloatArray, tone_hz: float) -> float:
    """Amplitude of a line at a known frequency: the point itself, or the crest between points.

    Where the tone lies on a point, that point is the amplitude and nothing is fitted to noise.
    Between points the crest of the parabola through the logarithms of three points is taken: exact
    for the Gaussian resolution filter of a spectrum analyser.
    """
    nearest = int(np.argmin(np.abs(frequency_hz - tone_hz)))
    neighbours = frequency_hz[max(0, nearest - 1) : nearest + 2]
    step = float(np.min(np.diff(neighbours))) if neighbours.size > 1 else 0.0
    if abs(float(frequency_hz[nearest]) - tone_hz) <= 1e-3 * step or not 0 < nearest < (
        frequency_hz.size - 1
    ):
        return float(amplitude_v[nearest])
    f, a = neighbours - tone_hz, amplitude_v[nearest - 1 : nearest + 2]
    if np.any(a <= 0.0):
        return float(np.max(a))
    curvature, slope, height = np.polyfit(f / step, np.log(a), 2)
    crest = -slope / (2.0 * curvature) if curvature < 0.0 else math.inf
    if abs(crest) > 1.0:  # no line within a point of the tone: leave it to the detection limit
        return float(np.max(a))
    return float(math.exp(height - slope**2 / (4.0 * curvature)))


def mode_response(frequency_hz: FloatArray, eta_hz: float, width_hz: float) -> ComplexArray:
    """Response of one driven damped mode, 1 at eta in magnitude, shape of ``frequency_hz``.

    g(f) = w eta / ((eta - f)(eta + f) + i f w); the difference of squares is factored because at
    high Q it cancels. |g|^2 is a Lorentzian of full width w close to eta.

    Args:
        frequency_hz: frequencies (n,), Hz.
        eta_hz: resonance frequency, Hz.
        width_hz: full line width, Hz.
    """
    detuning = (eta_hz - frequency_hz) * (eta_hz + frequency_hz)
    return np.asarray(width_hz * eta_hz / (detuning + 1j * frequency_hz * width_hz))


def fit_resonance(
    frequency_hz: FloatArray,
    amplitude_v: FloatArray,
    *,
    background: str = "none",
    sigma_v: float | None = None,
    dip: bool = False,
    source: str = "sweep",
) -> Resonance:
    """Fit ``|A g(f) + b|`` to a sweep of amplitudes, see :func:`mode_response` for g.

    ``b`` is zero, or with background="complex" one complex constant (direct crosstalk of the
    drive). Magnitudes fix eta, width and ``|b|``, but not which of two mirrored pairs (A, b) it
    is: with a background the amplitude is one of two candidates. What knows no phase is not added
    to the line but to its amplitude: "offset" is ``|A g(f)| + c`` (a detector's zero), "slope"
    ``|A g(f)| + c + c' (f - f0)`` (one that drifts, or changes with frequency), "floor" is
    ``sqrt(|A g(f)|^2 + c^2)`` (noise of that root mean square, powers averaged), "rice" the mean
    amplitude of the same noise, see :func:`rice_mean`. ``sigma_v`` is the noise of a
    point if known, otherwise the residual tells it. Errors are those of the linearised problem
    times the widening that structured residuals ask for, see
    `fitting.signal.residual_tests.residual_structure`.

    Args:
        frequency_hz: frequencies (n,), Hz.
        amplitude_v: amplitudes (n,), V peak.
        background: model of what is added to the line.
        sigma_v: standard deviations (n,), V.
        dip: begin at the smallest amplitude, a line that takes away from a background.
        source: of the data, for complaints.

    Raises:
        BadInput: too few points, no resonance within the sweep, or one that the points do not hold.
    """
    if background not in UNKNOWNS or background in ELSEWHERE:
        wanted = tuple(name for name in UNKNOWNS if name not in ELSEWHERE)
        raise ValueError(f"background {background!r}, wanted one of {wanted}")
    check_count(frequency_hz, background, source)
    eta0, width0, height = (_dip_guess if dip else first_guess)(frequency_hz, amplitude_v)
    run = along(frequency_hz)

    def curve(x: FloatArray) -> FloatArray:
        wave = x[2] * mode_response(frequency_hz, eta0 + width0 * x[0], width0 * math.exp(x[1]))
        return height * _amplitudes(wave, x[3:], background, run)

    def left(x: FloatArray) -> FloatArray:
        return np.asarray((curve(x) - amplitude_v) / height)

    start = _start(amplitude_v / height, background, dip=dip)
    sigma = None if sigma_v is None else sigma_v / height
    fit = minimise_squares(left, start, residual_sigma=sigma)
    if background == "complex":
        fit = folded(left, fit)
    line = as_resonance(frequency_hz, fit, curve(fit.values), (eta0, width0, height), source)
    line = _with_added(line, background, fit.values[3:], frequency_hz, height)
    return _lower_first(line, fit, height, left) if background == "complex" else line


def along(frequency_hz: FloatArray) -> FloatArray:
    """From -1 at the first frequency to 1 at the last one, shape (n,).

    Args:
        frequency_hz: frequencies (n,), Hz.
    """
    first, last = float(frequency_hz[0]), float(frequency_hz[-1])
    return np.asarray((2.0 * frequency_hz - first - last) / max(last - first, math.ulp(last)))


def _lower_first(
    line: Resonance,
    fit: LeastSquaresFit,
    height: float,
    left: Callable[[FloatArray], FloatArray],
) -> Resonance:
    """A line beside a complex constant with both amplitudes that have its curve, the lower first.

        |a g + b| = |a' g + b'|        a' = -a + 2 i b*,  b' = -b*        where g = -i/(1 + i x)

    At low Q that holds only about: where the points tell them apart, the fitted one stays the
    first.
    """
    x = fit.values
    beside = complex(*x[3:])
    other = -float(x[2]) + 2j * beside.conjugate()
    size = max(abs(other), np.finfo(float).tiny)
    turn = other.conjugate() / size
    slopes = np.zeros(x.size)
    slopes[2:] = -turn.real, -2.0 * turn.imag, 2.0 * turn.real
    std = height * math.sqrt(max(0.0, float(slopes @ fit.covariance @ slopes)))
    std *= reach(ROOT_68, line.dof) * line.structure.widening
    there = -beside.conjugate() * turn
    mirror = np.array([x[0], x[1], size, there.real, there.imag])
    off = float(np.sum(left(mirror) ** 2)) - _squares(fit)
    mirrored = number_of_line("amplitude", height * size, std, "", half=ratio95(line.dof))
    if not (height * size < line.amplitude.value and off < fit.variance):
        return replace(line, mirrored=mirrored)
    return replace(
        line,
        amplitude=mirrored,
        background=height * there,
        residual=line.residual * line.amplitude.value / (height * size),
        mirrored=line.amplitude,
    )


def check_count(frequency_hz: FloatArray, background: str, source: str) -> None:
    """Complain of too few points.

    Args:
        frequency_hz: frequencies (n,), Hz.
        background: what stands beside the line, one of `UNKNOWNS`.
        source: of the data, for complaints.

    Raises:
        BadInput: fewer points than unknowns and one, or than `MIN_SWEEP_POINTS`.
    """
    least = max(MIN_SWEEP_POINTS, UNKNOWNS[background] + 1)
    if frequency_hz.size < least:
        raise BadInput(
            f"{source}: {how_many(frequency_hz.size, 'point is', 'points are')} too few for a "
            "resonance fit; "
            f"wanted at least {least}"
        )


def point_noise(amplitude_v: FloatArray) -> float:
    """Standard deviation of a point, from the median of second differences, unit of the points.

    Args:
        amplitude_v: along a smooth curve, shape (n,).
    """
    differences = np.abs(np.diff(amplitude_v, 2))
    return float(np.median(differences)) / NORMAL_MEDIAN / SECOND_DIFFERENCE


def fit_beside_tail(
    frequency_hz: FloatArray,
    amplitude_v: FloatArray,
    others: Sequence[tuple[float, float]],
    *,
    room: float = 1.0,
    source: str = "sweep",
) -> Resonance:
    """Fit ``|A g(f) + c g'(f)|``, the line and the tail of another one outside of the points.

    g' is the response of another mode, see :func:`mode_response`, c a complex height: seven
    unknowns. Points that show a tail alone hardly tell from how far it comes: the other line is
    kept near to where it was seen, by two rows that are the noise at ``room`` of its widths and
    at a factor exp(``room``) on its width. As magnitudes hardly tell A from its mirror image, both
    are fitted: the better one is taken, and ``mirrored`` is the other one, NaN where its chi square
    is larger by `ALLOWED`.

    Args:
        frequency_hz: frequencies (n,), Hz.
        amplitude_v: amplitudes (n,), V peak.
        others: where the other line may be, Hz, and how wide, Hz: the fit begins at each.
        room: standard deviation of that place, and of the logarithm of that width.
        source: of the data, for complaints.

    Raises:
        BadInput: too few points, no resonance among them, another line that stands among them.
    """
    check_count(frequency_hz, TAIL, source)
    height = float(np.max(amplitude_v))
    shares = amplitude_v / height
    eta0, width0, _ = first_guess(frequency_hz, _over_chord(frequency_hz, amplitude_v))
    pull = max(point_noise(shares), SMALLEST_RESIDUAL) / room
    tried = [
        _TailFit(frequency_hz, shares, (eta0, width0), other, pull).begun(turn)
        for other in others
        for turn in TURNS
    ]
    fit, tail = min(tried, key=lambda each: _squares(each[0]))
    second = tail.minimised(tail.mirrored(fit.values))
    eta, _ = tail.line(second.values[5:], tail.other)
    if _squares(second) < _squares(fit) and not frequency_hz[0] <= eta <= frequency_hz[-1]:
        fit, second = second, fit
    eta, _ = tail.line(fit.values[5:], tail.other)
    if frequency_hz[0] <= eta <= frequency_hz[-1]:
        if residual_structure(fit.residuals[:-2], fit.jacobian[:-2]).order == 0:
            raise BadInput(f"{source}: another line, at {hertz(eta)}, {AMONG}")
        raise BadInput(f"{source}: has no tail of another line outside of the points")
    fit = folded(tail.residuals, fit)
    own = replace(fit, residuals=fit.residuals[:-2], jacobian=fit.jacobian[:-2])
    curve = height * (own.residuals + shares)
    line = as_resonance(frequency_hz, own, curve, (eta0, width0, height), source)
    if not (second.converged and _squares(second) - _squares(fit) < ALLOWED * fit.variance):
        return line
    return _with_mirrored(line, second, height)


def fit_beside_second(
    frequency_hz: FloatArray,
    amplitude_v: FloatArray,
    first: tuple[float, float],
    second: tuple[float, float, complex],
    *,
    background: str = "none",
    source: str = "sweep",
) -> tuple[Resonance, SecondLine]:
    """Fit ``|A g(f) + c g'(f)|``, the line and a second one among the points, with a background.

    As `fit_beside_tail`, but that the points show where the other line is. "offset", "slope",
    "floor" and "rice" stand beside both, see `fit_resonance`.

    Args:
        frequency_hz: frequencies (n,), Hz.
        amplitude_v: amplitudes (n,), V peak.
        first: frequency and width at which the fit begins, Hz.
        second: the same of the second line, Hz, and its height over the largest amplitude.
        background: model of what is added to both lines; none that is complex.
        source: of the data, for complaints.

    Raises:
        BadInput: too few points, or lines that the points do not hold.
    """
    least = UNKNOWNS[background] + UNKNOWNS[TAIL] - UNKNOWNS["none"] + 1
    if frequency_hz.size < max(MIN_SWEEP_POINTS, least):
        raise BadInput(f"{source}: has too few points for a second line")
    height = float(np.max(amplitude_v))
    shares = amplitude_v / height
    lines = _TailFit(frequency_hz, shares, first, second[:2], 0.0, background, along(frequency_hz))
    beside = _start(shares, background, dip=False)[2:]
    # its height counts from the phase of the first line there
    there = complex(mode_response(np.array([second[0]]), *first)[0])
    tried = [
        lines.minimised(np.array([0.0, 0.0, beside[0], size.real, size.imag, 0, 0, *beside[1:]]))
        for size in (second[2] * there / abs(there) * turn for turn in TURNS)
    ]
    fit = min(tried, key=_squares)
    other = lines.minimised(lines.mirrored(fit.values))
    if _squares(other) < _squares(fit):
        fit, other = other, fit
    eta, width = lines.line(fit.values[5:], second[:2])
    steps = np.diff(frequency_hz)
    inside = frequency_hz[0] < eta < frequency_hz[-1]
    if not (inside and float(np.median(steps)) < 2.0 * width < float(np.ptp(frequency_hz))):
        raise BadInput(f"{source}: has no second line among its points")
    curve = height * (fit.residuals + shares)
    first_line = as_resonance(frequency_hz, fit, curve, (*first, height), source)
    if not first_line.amplitude.std < first_line.amplitude.value:
        raise BadInput(
            f"{source}: the points do not determine how high its line is above a second one"
        )
    first_line = _with_added(first_line, background, fit.values[7:], frequency_hz, height)
    share = complex(*fit.values[3:5]) / float(fit.values[2])
    if not (other.converged and _squares(other) - _squares(fit) < ALLOWED * fit.variance):
        return first_line, SecondLine.at(eta, width, share)
    mirrored = abs(complex(*other.values[3:5]) / float(other.values[2]))
    return _with_mirrored(first_line, other, height), SecondLine.at(eta, width, share, mirrored)


def _with_mirrored(line: Resonance, other: LeastSquaresFit, height: float) -> Resonance:
    """A line with the other amplitude that describes the points, and its error."""
    std = height * math.sqrt(float(other.covariance[2, 2]))
    std = std * reach(ROOT_68, line.dof) * line.structure.widening
    size = height * abs(float(other.values[2]))
    mirrored = number_of_line("amplitude", size, std, "", half=ratio95(line.dof))
    return replace(line, mirrored=mirrored)


def _with_added(
    line: Resonance, background: str, beside: FloatArray, frequency_hz: FloatArray, height: float
) -> Resonance:
    """A line with what is added to its amplitude, from the unknowns of that, over the height."""
    constant = height * _constant(beside, background)
    if background != SLOPE:
        return replace(line, background=constant)
    slope = 2.0 * height * float(beside[1]) / float(np.ptp(frequency_hz))
    middle = 0.5 * float(frequency_hz[0] + frequency_hz[-1])
    return replace(line, background=constant + slope * (line.frequency.value - middle), slope=slope)


@dataclass(frozen=True)
class _TailFit:
    """A line and another one, from where they may be: frequency and width, Hz.

    Unknowns: shift and logarithm of the width of the line, its height, both parts of the height of
    the other one, its shift and logarithm of the width, and what stands beside both. Without a pull
    the other one may be anywhere.
    """

    f: FloatArray
    shares: FloatArray
    own: tuple[float, float]
    other: tuple[float, float]
    pull: float
    background: str = "none"
    run: FloatArray = field(default_factory=lambda: np.empty(0))

    @staticmethod
    def line(x: FloatArray, begin: tuple[float, float]) -> tuple[float, float]:
        eta, width = begin
        return eta + width * float(x[0]), width * math.exp(float(np.clip(x[1], -50.0, 50.0)))

    def residuals(self, x: FloatArray) -> FloatArray:
        one = mode_response(self.f, *self.line(x[:2], self.own))
        two = mode_response(self.f, *self.line(x[5:], self.other))
        wave = x[2] * one + complex(x[3], x[4]) * two
        left = _amplitudes(wave, x[7:], self.background, self.run) - self.shares
        return np.concatenate([left, self.pull * x[5:7]]) if self.pull else left

    def begun(self, turn: complex) -> tuple[LeastSquaresFit, _TailFit]:
        near = 0 if self.other[0] < self.f[0] else -1
        there = abs(mode_response(self.f[[near]], *self.other)[0])
        size = min(float(self.shares[near]) / there, 1e3) * complex(turn)
        start = np.array([0.0, 0.0, 1.0, size.real, size.imag, 0.0, 0.0])
        return self.minimised(start), self

    def mirrored(self, x: FloatArray) -> FloatArray:
        """Where the fit of the other amplitude begins: the numerator's zero on the other side.

        Both lines over one denominator have a numerator with a zero z near them, and f - z has the
        modulus of f - z* at every real f; heights (A, c) are fitted to what that makes.
        """
        (eta, width), (eta2, width2) = self.line(x[:2], self.own), self.line(x[5:], self.other)
        one, two = x[2] * width * eta, complex(x[3], x[4]) * width2 * eta2
        numerator = [-(one + two), 1j * (one * width2 + two * width), one * eta2**2 + two * eta**2]
        zeros = np.roots(numerator)
        if not zeros.size:
            return x
        zero = zeros[int(np.argmax(zeros.real))]
        lines = np.stack(
            [mode_response(self.f, eta, width), mode_response(self.f, eta2, width2)], 1
        )
        wave = lines @ np.array([x[2], complex(x[3], x[4])])
        turned = wave * (self.f - np.conj(zero)) / (self.f - zero)
        height, beside = np.linalg.lstsq(lines, turned, rcond=None)[0]
        size = max(abs(height), np.finfo(float).tiny)
        beside = beside * np.conj(height) / size
        return np.array([x[0], x[1], size, beside.real, beside.imag, *x[5:]])

    def minimised(self, start: FloatArray) -> LeastSquaresFit:
        return minimise_squares(self.residuals, start, rounds=ROUNDS_FOR_TAIL, gain=GAIN_OF_TAIL)


def _squares(fit: LeastSquaresFit) -> float:
    return float(fit.residuals @ fit.residuals)


def _amplitudes(
    wave: ComplexArray, beside: FloatArray, background: str, run: FloatArray
) -> FloatArray:
    """Amplitudes (n,) of a line with what stands beside it; noise is given by its power.

    A slope has its value in the middle, and what it changes by from there to the last point.
    """
    if background == "complex":
        wave = wave + complex(*beside)
    size = np.abs(wave)
    if background == OFFSET:
        return np.asarray(size + beside[0])
    if background == SLOPE:
        return np.asarray(size + beside[0] + beside[1] * run)
    if background == FLOOR:
        return np.asarray(np.sqrt(np.maximum(size**2 + beside[0], 0.0)))
    if background == RICE:
        return rice_mean(size, math.sqrt(abs(beside[0])))
    return np.asarray(size)


def rice_mean(amplitude: FloatArray, noise: float) -> FloatArray:
    """Mean of |a + n| with complex Gaussian noise n of root mean square c, (n,), unit of a.

        (c/2) sqrt(pi) ((1 + x) I0(x/2) + x I1(x/2)) exp(-x/2)        x = a^2/c^2

    Args:
        amplitude: a, shape (n,).
        noise: c.

    Source: S. O. Rice, Bell Syst. Tech. J. 24 (1945) 46, equation 3.10-12.
    """
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        x = (amplitude / noise) ** 2 if noise > 0.0 else np.full(amplitude.shape, np.inf)
        above = amplitude * (1.0 + 0.25 / x)  # to order 1/x^2, where the functions below overflow
    x = np.minimum(x, RICE_LARGE)
    laguerre = (1.0 + x) * ive(0, 0.5 * x) + x * ive(1, 0.5 * x)
    return np.where(x < RICE_LARGE, 0.5 * math.sqrt(math.pi) * noise * laguerre, above)


def _start(shares: FloatArray, background: str, *, dip: bool) -> FloatArray:
    """Where a fit begins: shift, logarithm of the width, height and what is beside the line."""
    least = float(np.min(shares))
    if background == OFFSET:
        return np.array([0.0, 0.0, 1.0 - least, least])
    if background == SLOPE:
        return np.array([0.0, 0.0, 1.0 - least, least, 0.0])
    if background in (FLOOR, RICE):
        return np.array([0.0, 0.0, math.sqrt(max(0.0, 1.0 - least**2)), least**2])
    if background == "none":
        return np.array([0.0, 0.0, 1.0])
    if dip:  # g is -i at eta: what it is taken from
        return np.array([0.0, 0.0, 1.0 - least, 0.0, 1.0])
    return np.array([0.0, 0.0, 1.0, 0.0, 0.0])


def _constant(beside: FloatArray, background: str) -> complex:
    """What stands beside the line, over its height; of noise the root of its power."""
    if background == "complex":
        return complex(*beside)
    if background in (FLOOR, RICE):
        return complex(math.copysign(math.sqrt(abs(beside[0])), beside[0]))
    if background == SLOPE:
        return complex(beside[0])
    return complex(*beside) if beside.size else 0j


def first_guess(frequency_hz: FloatArray, amplitude_v: FloatArray) -> tuple[float, float, float]:
    """Crest, the width of the region above 1/sqrt(2) of it, and its height.

    Args:
        frequency_hz: frequencies (n,), Hz.
        amplitude_v: amplitudes (n,), V peak.
    """
    top = int(np.argmax(amplitude_v))
    height = float(amplitude_v[top])
    high = frequency_hz[amplitude_v >= height / math.sqrt(2.0)]
    spacing = float(np.median(np.diff(frequency_hz)))
    width = max(float(high[-1] - high[0]), spacing)
    return float(frequency_hz[top]), width, height if height > 0.0 else 1.0


def _over_chord(frequency_hz: FloatArray, amplitude_v: FloatArray) -> FloatArray:
    """What stands above the straight line between the ends: a top beside a higher flank, too."""
    chord = np.interp(frequency_hz, frequency_hz[[0, -1]], amplitude_v[[0, -1]])
    return np.asarray(amplitude_v - chord)


def _dip_guess(frequency_hz: FloatArray, amplitude_v: FloatArray) -> tuple[float, float, float]:
    """The lowest point, the width of the region below half of the squared depth, and the top."""
    bottom, top = int(np.argmin(amplitude_v)), float(np.median(np.sort(amplitude_v)[-5:]))
    half = math.sqrt(0.5 * (float(amplitude_v[bottom]) ** 2 + top**2))
    low = frequency_hz[amplitude_v <= half]
    spacing = float(np.median(np.diff(frequency_hz)))
    width = max(float(low[-1] - low[0]), spacing)
    return float(frequency_hz[bottom]), width, top if top > 0.0 else 1.0


def as_resonance(
    frequency_hz: FloatArray,
    fit: LeastSquaresFit,
    curve: FloatArray,
    guess: tuple[float, float, float],
    source: str,
) -> Resonance:
    """A line as it was fitted, of unknowns that begin with shift, log width and height.

    Args:
        frequency_hz: frequencies (n,), Hz.
        fit: of shares of the height that was guessed.
        curve: fitted amplitudes (n,), V peak.
        guess: frequency and width, Hz, and height, V peak, from which the unknowns are counted.
        source: of the data, for complaints.

    Raises:
        BadInput: no resonance within the sweep, or one that the points do not hold.
    """
    eta0, width0, height = guess
    structure = residual_structure(fit.residuals, fit.jacobian)
    dof = fit.freedom / structure.widening**2
    spread = (reach(ROOT_68, dof) * structure.widening) ** 2 * fit.covariance
    x, variance = fit.values, np.diag(spread)
    eta, width = eta0 + width0 * float(x[0]), width0 * math.exp(min(float(x[1]), 50.0))
    span = float(frequency_hz[-1] - frequency_hz[0])
    inside = frequency_hz[0] <= eta <= frequency_hz[-1] and width < 3.0 * span
    if not (fit.converged and inside):
        raise BadInput(
            f"{source}: no resonance between {frequency_hz[0]:.10g} and {frequency_hz[-1]:.10g} Hz "
            f"(the fit ended at {eta:.10g} Hz, width {width:.4g} Hz: {fit.message})"
        )
    if not np.all(np.isfinite(variance[:2])):
        raise BadInput(
            f"{source}: the sweep does not determine its line near {eta:.10g} Hz, width "
            f"{width:.4g} Hz (a grid too coarse for it, or at the rounding of the frequencies)"
        )
    eta_std, log_width_std = width0 * math.sqrt(variance[0]), math.sqrt(variance[1])
    covariance = width0 * width * float(spread[0, 1])
    correlation = covariance / (eta_std * width * log_width_std) if eta_std * log_width_std else 0.0
    q = eta / width
    q_variance = (eta_std / eta) ** 2 + log_width_std**2 - 2.0 * covariance / (eta * width)
    return Resonance(
        **line_numbers(
            (eta, eta_std),
            (width, width * log_width_std),
            (q, q * math.sqrt(max(0.0, q_variance))),
            dof,
        ),
        amplitude=number_of_line(
            "amplitude",
            height * abs(float(x[2])),
            height * math.sqrt(variance[2]),
            "",
            half=ratio95(dof),
        ),
        background=0j,
        residual=float(np.sqrt(np.mean(fit.residuals**2))) / abs(float(x[2])),
        correlation=correlation,
        curve=curve,
        message=fit.message,
        structure=structure,
        dof=dof,
    )
