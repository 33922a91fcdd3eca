"""Lines of a noise spectrum: frequency, width, quality and power, by the likelihood that it has.

Heat moves a mode all the time, and its displacement has a density that is a line on a white floor,

    own        S = sum_k a_k |g_k|^2 + b          modes with forces of their own, as heat has them
    together   S = a |g_1 + r g_2|^2 + b          modes under one force, r of either sign
    coupled    S = -a c Im chi(f)/f + b           coupled modes in heat, the first one observed

    chi = D_2/(D_1 D_2 - K^2)     D_k = f_k^2 - f^2 + i f w_k     c = f_1^2 w_1     K = 2 f_0 k

g of `fitting.lines.lorentzian`, f_0 the mean of all f. Heights a and the floor b are linear.
Coupled modes have lines at the roots of D_1 D_2 = K^2; without k they are the first of own ones.

    power of the line  P = pi/2 a w,   rms = sqrt(P),   Q = f/w

A density that is the mean of M periodograms scatters by itself over sqrt(M). M is not known: the
spectrum has the least

    D = sum 2 (P/S - 1 - ln(P/S))      with      D/(n - k) = 2 (ln M - psi(M))

of n densities P and k unknowns, psi the digamma function. A second line is there where chance does
not explain what it gains at any of the points; how two modes are moved is taken from the density
where it shows that, else each has a force of its own.

Sources: P. Whittle, Ark. Mat. 2 (1953) 423; D. Percival and A. Walden, Spectral Analysis for
Physical Applications (1993), section 4.7; P. McCullagh and J. Nelder, Generalized Linear Models
(1989), section 8.3, on the shape of a gamma distribution from its deviance.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import digamma, gammainc, gammaincc, ndtri

from fitting.lines.choice import PLAINLY, PRESENT_P, gain_p
from fitting.lines.record import (
    Fitted,
    LineNumber,
    Matrix,
    MeasuredLine,
    Numbers,
    SecondLine,
    common_fields,
    number_of_line,
)
from fitting.lines.solve import Columns, Fit, fit_densities
from fitting.lines.sweep_model import Place, Shapes
from fitting.lines.trace import NoiseRecord
from fitting.signal.residual_tests import residual_structure
from fitting.signal.student import ratio95
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput

#: How modes may be moved: each by itself, both by one force, or by heat with a coupling.
OWN, TOGETHER, COUPLED = "own", "together", "coupled"
#: Points that are averaged where a line is looked for.
SMOOTHED = 5
#: Widths over the spacing of the points with which a line starts.
WIDTHS = np.exp([1.0, 2.0, 3.0, 4.0])
#: Widths of modes under one force over those of lines that add up, which interference narrows.
WIDER = (1.0, 3.0)
#: Smallest density over the largest one, and deviance.
LEAST = 1e-12
#: Least distance of two lines over the sum of their widths, and least width over the spacing.
APART, NARROWEST = 0.2, 0.2
#: Fewest and most averages that a scatter may show; halvings that find their number.
AVERAGES, HALVINGS = (0.1, 1e12), 60
#: The smallest tail of a distribution that differs from none.
SMALLEST_TAIL = 1e-300


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseSpectrum:
    """Lines in noise; x: the lines as in `Shapes`, then r, or k over the first start's width.

    Attributes:
        frequency_hz: rising, shape (n,), Hz.
        starts: where each line, of coupled modes each mode, starts.
        kind: `OWN`, `TOGETHER` or `COUPLED`.
    """

    frequency_hz: FloatArray
    starts: Sequence[Place]
    kind: str = OWN

    @property
    def shapes(self) -> Shapes:
        """The lines, or modes."""
        return Shapes(frequency_hz=self.frequency_hz, starts=self.starts)

    @property
    def count(self) -> int:
        """Unknowns that do not enter linearly."""
        return self.shapes.count + (self.kind != OWN)

    def columns(self, x: FloatArray) -> Columns:
        """The lines, and 1."""
        parts = [self._in_heat(x)] if self.kind == COUPLED else self._powers(x)
        one = np.ones_like(self.frequency_hz)
        values = np.stack([*(value for value, _ in parts), one], axis=1)
        slopes = np.zeros((self.count, *values.shape))
        for k, (_, slope) in enumerate(parts):
            slopes[:, :, k] = slope
        return Columns(values, slopes)

    def _powers(self, x: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
        """|h|^2 of each wave h with its slopes, (count, n)."""
        waves = [(g.values, g.slopes) for g in self.shapes.responses(x[: self.shapes.count])]
        if self.kind == TOGETHER:
            (one, of_one), (two, of_two) = waves
            r = float(x[self.shapes.count])
            waves = [(one + r * two, np.concatenate([of_one + r * of_two, two[None]]))]
        return [(np.abs(h) ** 2, 2.0 * (np.conj(h) * slopes).real) for h, slopes in waves]

    def coupling(self, x: FloatArray) -> tuple[float, float]:
        """K at x, Hz^2, and its derivative by k."""
        by_k = 2.0 * float(np.mean(self.frequency_hz)) * self.starts[0].width_hz
        return by_k * float(x[self.shapes.count]), by_k

    def _in_heat(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Of coupled modes, one in size where the first is by itself, with its slopes."""
        f, (one, two) = self.frequency_hz, self.shapes.places(x[:4])
        k, by_k = self.coupling(x)
        d1, d2 = (
            (p.frequency_hz - f) * (p.frequency_hz + f) + 1j * f * p.width_hz for p in (one, two)
        )
        whole = d1 * d2 - k**2
        chi = d2 / whole
        by_1, by_2, by_k2 = -(chi**2), -((k / whole) ** 2), d2 / whole**2
        scales = [start.width_hz for start in self.starts]
        by_x = [
            by_1 * 2.0 * one.frequency_hz * scales[0],
            by_1 * 1j * f * one.width_hz,
            by_2 * 2.0 * two.frequency_hz * scales[1],
            by_2 * 1j * f * two.width_hz,
            by_k2 * 2.0 * k * by_k,
        ]
        size = one.frequency_hz**2 * one.width_hz
        value = -size * chi.imag / f
        slopes = np.stack([-size * slope.imag / f for slope in by_x])
        slopes[0] += value * 2.0 * scales[0] / one.frequency_hz
        slopes[1] += value
        return np.asarray(value), slopes

    def lines(self, x: FloatArray) -> list[tuple[Place, FloatArray]]:
        """Frequency and FWHM of each line with their derivatives by x, (2, count)."""
        made = []
        places, scales = self.shapes.places(x[: self.shapes.count]), self.starts
        if self.kind != COUPLED:
            for j, (place, start) in enumerate(zip(places, scales, strict=True)):
                slopes = np.zeros((2, self.count))
                slopes[0, 2 * j], slopes[1, 2 * j + 1] = start.width_hz, place.width_hz
                made.append((place, slopes))
            return made
        (f1, w1), (f2, w2) = ((p.frequency_hz, p.width_hz) for p in places)
        k, by_k = self.coupling(x)
        whole = np.polymul([-1.0, 1j * w1, f1**2], [-1.0, 1j * w2, f2**2])
        whole[-1] -= k**2
        # a root p moves by -dF/dx over dF/dp, F = D_1 D_2 - K^2
        for p in sorted(np.roots(whole), key=lambda root: float(root.real))[-2:]:
            d1, d2 = f1**2 - p**2 + 1j * p * w1, f2**2 - p**2 + 1j * p * w2
            by_x = np.array(
                [
                    2.0 * f1 * d2 * scales[0].width_hz,
                    1j * p * w1 * d2,
                    2.0 * f2 * d1 * scales[1].width_hz,
                    1j * p * w2 * d1,
                    -2.0 * k * by_k,
                ]
            )
            moved = -by_x / ((1j * w1 - 2.0 * p) * d2 + (1j * w2 - 2.0 * p) * d1)
            size = float(abs(p))
            slopes = np.stack([(np.conj(p) * moved).real / size, 2.0 * moved.imag])
            made.append((Place(size, 2.0 * float(p.imag)), slopes))
        return made


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseFit(Fitted):
    """Lines of a density.

    Correlations are those of frequency, FWHM and power of the first line, without the power where
    it is NaN; ``squares`` is the deviance D.

    Attributes:
        lines: the lowest frequency first.
        height: density of each at its frequency without the floor, in the unit of the density; of
            `TOGETHER` that of the second is negative where it answers against the first.
        power: of each over all frequencies, pi/2 times height times FWHM; NaN of lines that are
            moved in another way than each by itself.
        floor: white density under them.
        first: number of the highest line among the points.
        averages: M.
        kind: how modes are moved.
        modes: frequency and FWHM, Hz, of the observed mode and of the other one by themselves, then
            the root of K, Hz; empty but of `COUPLED`.
        is_kind_determined: whether the density shows that both modes have forces of their own, or
            how else they are moved.
    """

    lines: tuple[SecondLine, ...]
    height: tuple[float, ...]
    power: tuple[LineNumber, ...]
    floor: LineNumber
    first: int
    averages: float
    kind: str
    modes: tuple[float, ...] = ()
    is_kind_determined: bool = True


def noise_lines(frequency_hz: FloatArray, density: FloatArray) -> NoiseFit | None:
    """As many lines as a density shows, two at most; None where it shows none.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        density: shape (n,), zero or more, in any unit.

    Raises:
        ValueError: it shows a line whose frequency or FWHM is not among the points.
    """
    top = float(np.max(density))
    y = np.maximum(density / top, LEAST)
    ratio = y / np.mean(y)
    level = 2.0 * float(np.sum(ratio - 1.0 - np.log(ratio)))
    nothing = NoiseSpectrum(frequency_hz=frequency_hz, starts=[])
    one = _lowest(nothing, y, _further(frequency_hz, y))
    if one is None or not _gains(level, 1, one[1], y.size):
        return None
    if not _is_resolved(*one):
        raise ValueError("a line whose width does not show in its points")
    two = _lowest(one[0], y, _further(frequency_hz, y, one))
    if two is None or not _gains(one[1].squares, one[1].unknowns, two[1], y.size):
        return _result(*one, y, top)
    # two lines have to be apart, and neither a single point: of one line that is no Lorentzian
    # curve two together make more
    near, far = sorted(two[0].shapes.places(two[1].x))
    apart = far.frequency_hz - near.frequency_hz > APART * (near.width_hz + far.width_hz)
    spacing = float(np.median(np.diff(frequency_hz)))
    if not (_is_resolved(*two) and apart and min(near.width_hz, far.width_hz) > spacing):
        return _result(*one, y, top)
    best, is_determined = _moved(*two, y)
    return replace(_result(*best, y, top), is_kind_determined=is_determined)


def averages_of(deviance: float, dof: int) -> float:
    """M: of how many periodograms points with such deviances are averages.

    Args:
        deviance: D, the sum over all points.
        dof: points less unknowns, n - k.
    """
    mean = deviance / dof
    low, high = map(math.log, AVERAGES)
    for _ in range(HALVINGS):  # 2 (ln M - psi(M)) falls with M
        middle = 0.5 * (low + high)
        falls = 2.0 * (middle - float(digamma(math.exp(middle)))) > mean
        low, high = (middle, high) if falls else (low, middle)
    return math.exp(0.5 * (low + high))


# --- fits ----------------------------------------------------------------------------------------

Candidate = tuple[NoiseSpectrum, Fit]


def _lowest(
    model: NoiseSpectrum, y: FloatArray, starts: Sequence[tuple[Sequence[Place], Sequence[float]]]
) -> Candidate | None:
    """The fit of least deviance from lines with other unknowns, among the points if one is."""
    ends: list[Candidate] = []
    for places, others in starts:
        there = replace(model, starts=places)
        start = np.array([*np.zeros(2 * len(places)), *others])
        with contextlib.suppress(ValueError, np.linalg.LinAlgError):
            ends.append((there, fit_densities(there, y, start)))
    ends = [end for end in ends if np.isfinite(end[1].squares)]
    ends.sort(key=lambda end: (not _is_resolved(*end), end[1].squares))
    return ends[0] if ends else None


def _further(
    f: FloatArray, y: FloatArray, fewer: Candidate | None = None
) -> list[tuple[list[Place], list[float]]]:
    """Where fits with one line more start: where what the fewer leave is largest."""
    size = min(SMOOTHED, y.size)
    places: list[Place] = []
    heights: list[float] = []
    rest, floor = y, max(float(np.quantile(y, 0.1)), LEAST)
    if fewer is not None:
        model, fit = fewer
        places = model.shapes.places(fit.x)
        *heights, floor = (float(each) for each in np.real(fit.coefficients))
        rest = y / np.maximum(fit.curve, LEAST)
    smooth, rest = (np.convolve(v, np.ones(size) / size, mode="same") for v in (y, rest))
    at, spacing = int(np.argmax(rest)), float(np.median(np.diff(f)))
    top = max(float(smooth[at]), LEAST)
    return [
        ([*places, Place(float(f[at]), spacing * float(wide))], [*heights, top, max(floor, LEAST)])
        for wide in WIDTHS
    ]


def _moved(model: NoiseSpectrum, fit: Fit, y: FloatArray) -> tuple[Candidate, bool]:
    """Two lines as modes that are moved as the density shows, and whether it shows that."""
    places = sorted(zip(model.shapes.places(fit.x), fit.coefficients, strict=False))
    (one, a), (two, b) = ((place, max(float(height), LEAST)) for place, height in places)
    floor, r = max(float(fit.coefficients[-1]), LEAST), math.sqrt(b / a)
    together, coupled = (replace(model, kind=kind) for kind in (TOGETHER, COUPLED))
    by_one_force = [
        ([Place(f, wider * w) for f, w in (one, two)], [sign * r, a, floor])
        for wider in WIDER
        for sign in (1.0, -1.0)
    ]
    # coupled modes start from both lines, whichever of the modes is observed: strengths r of lines
    # go with height times width, their sum is that of the observed mode, the other one is at
    # z = (r1 p2 + r2 p1)/(r1 + r2), and k^2 = (p1 - z)(z - p2) over (2 f0)^2
    (f1, w1), (f2, w2) = one, two
    own = a * w1 / (a * w1 + b * w2)
    other = 1.0 - own
    k = math.sqrt(own * other) * math.hypot(f2 - f1, 0.5 * (w2 - w1))
    observed = Place(own * f1 + other * f2, own * w1 + other * w2)
    by_heat = [
        (
            [observed, Place(other * f1 + own * f2, width)],
            [k / observed.width_hz, max(a, b), floor],
        )
        for width in (other * w1 + own * w2, 0.3 * min(w1, w2))
    ]
    tried = [_lowest(together, y, by_one_force), _lowest(coupled, y, by_heat)]
    others = [each for each in tried if each is not None and _is_resolved(*each)]
    closest = min(others, key=lambda each: each[1].squares, default=(model, fit))
    unit = min(fit.squares, closest[1].squares) / max(1, y.size - fit.unknowns)
    plainly = PLAINLY * max(unit, LEAST)
    if fit.squares - closest[1].squares > plainly:
        return closest, True
    single = [each[1].squares for each in others if each[0].kind == TOGETHER]
    return (model, fit), min(single, default=math.inf) - fit.squares > plainly


def _gains(before: float, unknowns: int, fit: Fit, points: int) -> bool:
    """Whether chance does not explain what a further line gains, at any of the points."""
    dof = points - fit.unknowns
    if dof < 1:
        return False
    more = fit.unknowns - unknowns
    return points * gain_p(before, max(fit.squares, LEAST), more, dof) < PRESENT_P


def _is_resolved(model: NoiseSpectrum, fit: Fit) -> bool:
    """Whether a line is among the points, and each is as wide as points may show.

    A further one may be beyond an end, from where its flank reaches the points.
    """
    f = model.frequency_hz
    spacing, span = float(np.median(np.diff(f))), float(np.ptp(f))
    places = [place for place, _ in model.lines(fit.x)]
    return (
        bool(np.all(fit.coefficients[:-1] > 0.0))
        and any(f[0] <= place.frequency_hz <= f[-1] for place in places)
        and all(f[0] - span < place.frequency_hz < f[-1] + span for place in places)
        and all(NARROWEST * spacing < place.width_hz < span for place in places)
    )


# --- numbers -------------------------------------------------------------------------------------


def _result(model: NoiseSpectrum, fit: Fit, y: FloatArray, top: float) -> NoiseFit:
    """The lines with their errors: those of M averages, widened for what the scores show."""
    averages = averages_of(fit.squares, fit.dof)
    curve, f = np.asarray(fit.curve, dtype=float), model.frequency_hz
    # normal deviates as probable as the points are, over sqrt(M)
    share = averages * y / curve
    tails = gammainc(averages, share), gammaincc(averages, share)
    low, high = (ndtri(np.maximum(tail, SMALLEST_TAIL)) for tail in tails)
    scores = np.asarray(np.where(tails[0] < 0.5, low, -high) / math.sqrt(averages))
    structure = residual_structure(scores, fit.jacobian)
    numbers = Numbers(fit, structure=structure, variance=1.0 / averages)

    # lines by their frequency, and their heights, which only modes of their own have as unknowns
    places = model.lines(fit.x)
    order = sorted(range(len(places)), key=lambda j: places[j][0])
    heights = [float(a) for a in fit.coefficients[:-1]]
    floor = float(fit.coefficients[-1])
    if model.kind == TOGETHER:
        r = float(fit.x[-1])
        heights.append(heights[0] * r * abs(r))
    elif model.kind == COUPLED:
        at = [place.frequency_hz for place, _ in places]
        heights = (np.interp(at, f, curve) - floor).tolist()
    among = [j for j in order if f[0] <= places[j][0].frequency_hz <= f[-1]]
    first = max(among, key=lambda j: abs(heights[j]))

    correl: Matrix = ()
    made, powers = [], []
    for j in order:
        place, slopes = places[j][0], np.zeros((2, fit.unknowns))
        slopes[:, : model.count] = places[j][1]
        line = numbers.line(*place, [*slopes], q_by_width=True)
        made.append(SecondLine(**line, share=abs(heights[j] / heights[first])))
        power, along = math.nan, []
        if model.kind == OWN:
            power = top * 0.5 * math.pi * heights[j] * place.width_hz
            along = [(2 * j + 1, power), (model.count + j, power / heights[j])]
        powers.append(numbers.number("power", power, along))
        if j == first:
            correl = numbers.correl([*slopes, *([numbers.gradient(along)] if along else [])])
    modes: tuple[float, ...] = ()
    if model.kind == COUPLED:
        observed, other = model.shapes.places(fit.x[:4])
        modes = (*observed, *other, math.sqrt(abs(model.coupling(fit.x)[0])))
    return NoiseFit(
        lines=tuple(made),
        height=tuple(top * heights[j] for j in order),
        power=tuple(powers),
        floor=numbers.number("floor", top * floor, [(fit.unknowns - 1, top)]),
        first=order.index(first),
        averages=averages,
        kind=model.kind,
        modes=modes,
        correl=correl,
        structure=structure,
        dof=numbers.dof,
        unknowns=fit.unknowns,
        squares=fit.squares,
        curve=top * curve,
    )


@dataclass(frozen=True, kw_only=True)
class NoiseLine(MeasuredLine):
    """One resonance of a noise spectrum; its width is that of the density.

    Attributes:
        power: of the line over all frequencies, in ``unit`` squared, pi/2 times height times width;
            NaN of two modes moved by one force or through each other.
        rms: its root, in ``unit``.
        height: density of the line at its frequency, ``unit`` squared per Hz.
        floor: white density, ``unit`` squared per Hz, with error ``floor_std``.
        averages: averaged periodograms, estimated from the scatter.
        kind: two modes moved by their "own" forces, "together" by one, or "coupled".
        spacing_hz: of the points, Hz.
    """

    power: LineNumber
    rms: LineNumber
    height: float
    floor: float
    floor_std: float
    averages: float
    kind: str
    spacing_hz: float

    @property
    def var_names(self) -> tuple[str, ...]:
        """Names of the numbers that were fitted and are printed."""
        return ("frequency", "width", "power")[: len(self.correl)]

    @property
    def minus_two_log_likelihood(self) -> float:
        """Minus twice the logarithm of Whittle's likelihood, but for a constant."""
        return self.chisqr


def noise_line_of(record: NoiseRecord) -> NoiseLine:
    """The resonance of a noise spectrum, by the likelihood of averages of periodograms.

    Args:
        record: what was measured.

    Raises:
        BadInput: no line, or one that does not exceed the floor.
    """
    try:
        fit = noise_lines(record.frequency_hz, np.asarray(record.values, dtype=float))
    except ValueError as error:
        raise BadInput(
            f"{record.source}: shows {error}; wanted more of them in it, or a longer range around "
            "it"
        ) from error
    if fit is None:
        raise BadInput(
            f"{record.source}: shows no line as a noise spectrum: its density is level within its "
            "scatter; wanted one line at least"
        )
    line, power, half = fit.lines[fit.first], fit.power[fit.first], ratio95(fit.dof)
    rms = math.sqrt(power.value) if power.value > 0.0 else math.nan
    return NoiseLine(
        **common_fields(record, fit, line, frequency_hz=record.frequency_hz),
        power=replace(power, unit=f"({record.unit})**2"),
        rms=number_of_line("rms", rms, 0.5 * power.std / rms, record.unit, half=half),
        height=abs(fit.height[fit.first]),
        floor=fit.floor.value,
        floor_std=fit.floor.std,
        averages=fit.averages,
        kind=fit.kind,
        second=next((other for other in fit.lines if other is not line), None),
        spacing_hz=float(np.median(np.diff(record.frequency_hz))),
        chisqr=fit.averages * fit.squares,
    )
