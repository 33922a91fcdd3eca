"""Lines of a noise spectrum: frequency, width, quality and power, by the likelihood that it has.

Heat moves a mode all the time, and its displacement has the density

    S(f) = a |g(f)|^2 + b,   |g| the line of `fitting.lines.lorentzian`, b a white floor
    power of the line  P = pi/2 a w,   rms = sqrt(P),   Q = f/w

A density that is the mean of M periodograms scatters by itself over sqrt(M). M is not known: the
spectrum of `fitting.lines.noise_model` has the least

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
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from scipy.special import digamma, gammainc, gammaincc, ndtri

from fitting.lines.choice import gain_p
from fitting.lines.likelihood import Whittle
from fitting.lines.noise_model import COUPLED, OWN, TOGETHER, NoiseSpectrum
from fitting.lines.numbers import Numbers
from fitting.lines.record import (
    LineNumber,
    LineValues,
    Matrix,
    MeasuredLine,
    Points,
    SecondLine,
    fields_of,
    line_numbers,
    number_of_line,
)
from fitting.lines.solve import Fit, fit_model
from fitting.lines.sweep_model import Place
from fitting.lines.trace import above_zero, within
from fitting.signal.residual_tests import Structure, residual_structure
from fitting.signal.student import ratio95
from fitting.text.arrays import FloatArray, as_numbers, require_size
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind, note
from fitting.text.notation import hertz

#: Gain in chi square from which a way in which modes are moved is told from forces of their own.
PLAINLY = 10.0
#: Points that are averaged where a line is looked for.
SMOOTHED = 5
#: Widths over the spacing of the points with which a line begins.
BEGINS = np.exp([1.0, 2.0, 3.0, 4.0])
#: Widths of modes under one force over those of lines that add up, which interference narrows.
WIDER = (1.0, 3.0)
#: Smallest density over the largest one, and deviance.
LEAST = 1e-12
#: Probability below which chance does not explain what a further line gains.
BY_CHANCE = 1e-3
#: Least distance of two lines over the sum of their widths, and least width over the spacing.
APART, NARROWEST = 0.2, 0.2
#: Fewest and most averages that a scatter may show; halvings that find their number.
AVERAGES, HALVINGS = (0.1, 1e12), 60
#: The smallest tail of a distribution that differs from none.
SMALLEST_TAIL = 1e-300


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseFit:
    """Lines of a density.

    Attributes:
        lines: the lowest frequency first.
        height: density of each at its frequency without the floor, in the unit of the density; of
            `TOGETHER` that of the second is negative where it answers against the first.
        power: of each over all frequencies, pi/2 times height times FWHM; NaN of lines that are
            moved in another way than each by itself.
        floor: white density under them.
        correl: correlations of frequency, FWHM and power of the first line; without the power where
            it is NaN.
        first: number of the highest line among the points.
        averages: M.
        modes: frequency and FWHM, Hz, of the seen mode and of the other one by themselves, then
            the root of K, Hz; empty but of `COUPLED`.
        is_kind_determined: whether the density shows that both modes have forces of their own, or
            how else they are moved.
        model: shapes and terms.
        fit: to the densities over the largest one.
        structure: what the residuals show.
        dof: degrees of freedom; correlated points count as fewer.
        curve: fitted densities, (n,).
    """

    lines: tuple[SecondLine, ...]
    height: tuple[float, ...]
    power: tuple[LineNumber, ...]
    floor: LineNumber
    first: int
    correl: Matrix
    averages: float
    modes: tuple[float, ...] = ()
    is_kind_determined: bool = True
    model: NoiseSpectrum
    fit: Fit
    structure: Structure
    dof: float
    curve: FloatArray = field(repr=False)

    @property
    def kind(self) -> str:
        """How modes are moved."""
        return self.model.kind


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
    level = float(np.sum(Whittle(1.0).residuals(y, np.full(y.size, np.mean(y)))[0] ** 2))
    best = _lowest(
        NoiseSpectrum(frequency_hz=frequency_hz, starts=[]), y, _further(frequency_hz, y)
    )
    if best is None or not _gains(level, 1, best[1], y.size):
        return None
    if not _is_seen(*best):
        raise ValueError("a line whose width does not show in its points")
    two = _lowest(best[0], y, _further(frequency_hz, y, best))
    if (
        two is not None
        and _are_two(*two)
        and _gains(best[1].squares, best[1].unknowns, two[1], y.size)
    ):
        best, is_determined = _moved(*two, y)
        return replace(_result(*best, y, top), is_kind_determined=is_determined)
    return _result(*best, y, top)


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

Found = tuple[NoiseSpectrum, Fit]


def _lowest(
    model: NoiseSpectrum, y: FloatArray, begins: Sequence[tuple[Sequence[Place], Sequence[float]]]
) -> Found | None:
    """The fit of least deviance from lines with other unknowns, among the points if one is."""
    ends: list[Found] = []
    for places, others in begins:
        there = replace(model, starts=places)
        start = np.array([*np.zeros(2 * len(places)), *others])
        with contextlib.suppress(ValueError, np.linalg.LinAlgError):
            ends.append((there, fit_model(there, y, [start], likelihood=Whittle(1.0))))
    ends = [end for end in ends if np.isfinite(end[1].squares)]
    ends.sort(key=lambda end: (not _is_seen(*end), end[1].squares))
    return ends[0] if ends else None


def _further(
    f: FloatArray, y: FloatArray, fewer: Found | None = None
) -> list[tuple[list[Place], list[float]]]:
    """Where fits with one line more begin: where what the fewer leave is largest."""
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
        for wide in BEGINS
    ]


def _moved(model: NoiseSpectrum, fit: Fit, y: FloatArray) -> tuple[Found, bool]:
    """Two lines as modes that are moved as the density shows, and whether it shows that."""
    places = sorted(zip(model.shapes.places(fit.x), fit.coefficients, strict=False))
    (one, a), (two, b) = ((place, max(float(height), LEAST)) for place, height in places)
    floor, r = max(float(fit.coefficients[-1]), LEAST), math.sqrt(b / a)
    together, coupled = (replace(model, kind=kind) for kind in (TOGETHER, COUPLED))
    starts = [
        ([Place(f, wider * w) for f, w in (one, two)], [sign * r, a, floor])
        for wider in WIDER
        for sign in (1.0, -1.0)
    ]
    tried = [
        _lowest(together, y, starts),
        _lowest(coupled, y, _coupled((one, a), (two, b), floor)),
    ]
    others = [other for other in tried if other is not None and _is_seen(*other)]
    closest = min(others, key=lambda other: other[1].squares, default=(model, fit))
    unit = min(fit.squares, closest[1].squares) / max(1, y.size - fit.unknowns)
    plainly = PLAINLY * max(unit, LEAST)
    if fit.squares - closest[1].squares > plainly:
        return closest, True
    by_one = [other[1].squares for other in others if other[0].kind == TOGETHER]
    return (model, fit), min(by_one, default=math.inf) - fit.squares > plainly


def _coupled(
    one: tuple[Place, float], two: tuple[Place, float], floor: float
) -> list[tuple[list[Place], list[float]]]:
    """Where fits of coupled modes begin: from both lines, whichever of the modes is seen.

    Strengths r of lines go with height times width, their sum is that of the seen mode: the other
    one stands at z = (r1 p2 + r2 p1)/(r1 + r2), and k^2 = (p1 - z)(z - p2) over (2 f0)^2.
    """
    (first, a), (last, b) = one, two
    f1, w1, f2, w2 = first.frequency_hz, first.width_hz, last.frequency_hz, last.width_hz
    own = a * w1 / (a * w1 + b * w2)
    other = 1.0 - own
    k = math.sqrt(own * other) * math.hypot(f2 - f1, 0.5 * (w2 - w1))
    seen = Place(own * f1 + other * f2, own * w1 + other * w2)
    widths = (other * w1 + own * w2, 0.3 * min(w1, w2))
    return [
        ([seen, Place(other * f1 + own * f2, width)], [k / seen.width_hz, max(a, b), floor])
        for width in widths
    ]


def _gains(before: float, unknowns: int, fit: Fit, points: int) -> bool:
    """Whether chance does not explain what a further line gains, at any of the points."""
    dof = points - fit.unknowns
    if dof < 1:
        return False
    more = fit.unknowns - unknowns
    return points * gain_p(before, max(fit.squares, LEAST), more, dof) < BY_CHANCE


def _is_seen(model: NoiseSpectrum, fit: Fit) -> bool:
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


def _are_two(model: NoiseSpectrum, fit: Fit) -> bool:
    """Whether two lines stand apart, and neither is a single point.

    Of one line that is no Lorentzian curve two together make more.
    """
    one, two = sorted(model.shapes.places(fit.x))
    apart = two.frequency_hz - one.frequency_hz > APART * (one.width_hz + two.width_hz)
    spacing = float(np.median(np.diff(model.frequency_hz)))
    return _is_seen(model, fit) and apart and min(one.width_hz, two.width_hz) > spacing


# --- numbers -------------------------------------------------------------------------------------


def _scores(y: FloatArray, curve: FloatArray, averages: float) -> FloatArray:
    """Normal deviates as probable as the points are, over sqrt(M), shape (n,)."""
    share = averages * y / curve
    below, above = gammainc(averages, share), gammaincc(averages, share)
    low, high = (ndtri(np.maximum(tail, SMALLEST_TAIL)) for tail in (below, above))
    return np.asarray(np.where(below < 0.5, low, -high) / math.sqrt(averages))


def _result(model: NoiseSpectrum, fit: Fit, y: FloatArray, top: float) -> NoiseFit:
    """The lines with their errors: those of M averages, widened for what the scores show."""
    averages = averages_of(fit.squares, fit.dof)
    curve = np.asarray(fit.curve, dtype=float)
    structure = residual_structure(_scores(y, curve, averages), fit.jacobian)
    numbers = Numbers(fit, structure=structure, variance=1.0 / averages)
    places = model.lines(fit.x)
    order = sorted(range(len(places)), key=lambda j: places[j][0])
    heights = [float(a) for a in fit.coefficients[:-1]]
    floor = float(fit.coefficients[-1])
    if model.kind == TOGETHER:
        r = float(fit.x[-1])
        heights.append(heights[0] * r * abs(r))
    elif model.kind == COUPLED:
        at = [place.frequency_hz for place, _ in places]
        heights = (np.interp(at, model.frequency_hz, curve) - floor).tolist()
    f = model.frequency_hz
    among = [j for j in order if f[0] <= places[j][0].frequency_hz <= f[-1]]
    first = max(among, key=lambda j: abs(heights[j]))
    correl: Matrix = ()
    made, powers = [], []
    for j in order:
        whole = np.zeros((2, fit.unknowns))
        whole[:, : model.count] = places[j][1]
        made.append(_line(numbers, places[j][0], whole, abs(heights[j] / heights[first])))
        power = top * 0.5 * math.pi * heights[j] * places[j][0].width_hz
        slopes = [(2 * j + 1, power), (model.count + j, power / heights[j])]
        own = model.kind == OWN
        powers.append(numbers.number("power", power if own else math.nan, slopes if own else []))
        if j == first:
            correl = numbers.correl([*whole, *([numbers.gradient(slopes)] if own else [])])
    modes: tuple[float, ...] = ()
    if model.kind == COUPLED:
        seen, unseen = model.shapes.places(fit.x[:4])
        modes = (*seen, *unseen, math.sqrt(abs(model.coupling(fit.x)[0])))
    return NoiseFit(
        lines=tuple(made),
        height=tuple(top * heights[j] for j in order),
        power=tuple(powers),
        floor=numbers.number("floor", top * floor, [(fit.unknowns - 1, top)]),
        first=order.index(first),
        correl=correl,
        averages=averages,
        modes=modes,
        model=model,
        fit=fit,
        structure=structure,
        dof=numbers.dof,
        curve=top * curve,
    )


def _line(numbers: Numbers, place: Place, slopes: FloatArray, share: float) -> SecondLine:
    """A line with its errors, from gradients of its frequency and FWHM."""
    f, w = place.frequency_hz, place.width_hz
    q = f / w
    made = line_numbers(
        (f, numbers.std(slopes[0])),
        (w, numbers.std(slopes[1])),
        (q, numbers.std(q * (slopes[0] / f - slopes[1] / w))),
        numbers.dof,
        q_by_width=True,
    )
    return SecondLine(**made, share=share)


#: Points that a noise spectrum has at least.
LEAST_POINTS = 12


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseRecord:
    """A noise spectrum.

    Attributes:
        source: what complaints name it by.
        frequency_hz: rising, shape (n,), Hz.
        density: above zero, shape (n,), in ``unit`` squared per Hz.
        unit: of what is seen, as V; "1": the numbers are relative.
        reading: how the file was read.
    """

    source: str
    frequency_hz: FloatArray
    density: FloatArray
    unit: str
    reading: tuple[Finding, ...] = ()

    def within(self, low_hz: float | None, high_hz: float | None) -> NoiseRecord:
        """The part between two frequencies.

        Args:
            low_hz: Hz, None: from the first.
            high_hz: Hz, None: to the last.

        Raises:
            BadInput: too few points are left.
        """
        if low_hz is None and high_hz is None:
            return self
        kept = within(self.frequency_hz, (low_hz, high_hz), LEAST_POINTS, self.source)
        taken = note(Kind.part_taken, "point", taken=int(np.sum(kept)), count=kept.size)
        return replace(
            self,
            frequency_hz=self.frequency_hz[kept],
            density=self.density[kept],
            reading=(*self.reading, taken),
        )


def noise_record_of(
    frequency_hz: npt.ArrayLike, density: npt.ArrayLike, unit: str, source: str = "arrays"
) -> NoiseRecord:
    """A checked noise spectrum of arrays.

    Args:
        frequency_hz: shape (n,), Hz, in any order.
        density: above zero, shape (n,), in ``unit`` squared per Hz.
        unit: of what is seen; "1": the numbers are relative.
        source: what complaints name it by.

    Raises:
        BadInput: shapes that differ, too few points, numbers that are not finite or not above zero,
            a frequency twice.
    """
    f = as_numbers(frequency_hz, f"{source}: frequencies")
    y = as_numbers(density, f"{source}: densities")
    if f.ndim != 1 or f.shape != y.shape:
        raise BadInput(f"{source}: frequencies {f.shape} and densities {y.shape}; wanted (n,)")
    kept = above_zero(f)
    f, y = f[kept], y[kept]
    reading = () if np.all(kept) else (note(Kind.zero_frequency),)
    if f.size < LEAST_POINTS:
        raise BadInput(f"{source}: {f.size} points, wanted at least {LEAST_POINTS}")
    for i in np.flatnonzero(~(np.isfinite(f) & np.isfinite(y)))[:1]:
        raise BadInput(f"{source}: point {i + 1} is {f[i]} Hz, {y[i]}; wanted finite numbers")
    require_size(f, f"{source}: frequencies")
    require_size(y, f"{source}: densities")
    if np.any(y <= 0.0):
        i = int(np.flatnonzero(y <= 0.0)[0])
        raise BadInput(
            f"{source}: point {i + 1}, at {hertz(f[i], digits=7)}, has a density of {y[i]:.6g}; "
            "wanted densities above zero"
        )
    order = np.argsort(f)
    if np.any(np.diff(f[order]) == 0.0):
        raise BadInput(f"{source}: has a frequency twice, wanted each once")
    return NoiseRecord(
        source=source, frequency_hz=f[order], density=y[order], unit=unit, reading=reading
    )


@dataclass(frozen=True, kw_only=True)
class NoiseLine(MeasuredLine):
    """One resonance of a noise spectrum; its width is that of the density.

    Attributes:
        power: of the line over all frequencies, in ``unit`` squared, pi/2 times height times width;
            NaN of two modes that are moved by one force or through each other.
        rms: its root, in ``unit``.
        height: density of the line at its frequency, without the floor, ``unit`` squared per Hz.
        floor: white density under it, ``unit`` squared per Hz; ``floor_std`` its error.
        averages: of how many periodograms the points are averages, as they scatter.
        kind: how two modes are moved: "own" forces, "together" by one, "coupled".
        spacing_hz: between two points, Hz.
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
    def minus_twice_likely(self) -> float:
        """Minus twice the logarithm of Whittle's likelihood, but for a constant."""
        return self.chisqr


def noise_line_of(record: NoiseRecord) -> NoiseLine:
    """The resonance of a noise spectrum, by the likelihood of averages of periodograms.

    Args:
        record: what was measured.

    Raises:
        BadInput: no line, or one that is not told from the floor.
    """
    try:
        fit = noise_lines(record.frequency_hz, record.density)
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
        **fields_of(line, LineValues),
        source=record.source,
        unit=record.unit,
        power=replace(power, unit=f"({record.unit})**2"),
        rms=number_of_line("rms", rms, 0.5 * power.std / rms, record.unit, half=half),
        height=abs(fit.height[fit.first]),
        floor=fit.floor.value,
        floor_std=fit.floor.std,
        averages=fit.averages,
        kind=fit.kind,
        second=next((other for other in fit.lines if other is not line), None),
        spacing_hz=float(np.median(np.diff(record.frequency_hz))),
        dof=fit.dof,
        structure=fit.structure,
        chisqr=fit.averages * fit.fit.squares,
        unknowns=fit.fit.unknowns,
        correl=fit.correl,
        reading=record.reading,
        points=Points.of(record.density, fit.curve, frequency_hz=record.frequency_hz),
    )
