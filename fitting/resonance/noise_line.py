"""One resonance of a noise spectrum: frequency, width, quality and power, without any FMU.

Heat moves a mode all the time, and its displacement has the density

    S(f) = a |g(f)|^2 + b,   |g| the line of `fitting.signal.peaks.mode_response`, b a white floor
    power of the line  P = pi/2 a w,   rms = sqrt(P),   Q = f/w

which is fitted by the likelihood of averages of periodograms (`fitting.signal.noise_lines`). How
many were averaged follows from the scatter: of M with deviances d = 2 (P/S - 1 - ln(P/S))

    mean d = 2 (ln M - psi(M)),   psi the digamma function, of n - k degrees of freedom

Source: P. McCullagh and J. A. Nelder, Generalized Linear Models (1989), section 8.3, on the shape
of a gamma distribution from its deviance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from scipy.special import digamma, gammainc, gammaincc, ndtri

from fitting.resonance.trace import AT_ZERO, above_zero, within
from fitting.signal.noise_lines import NoiseLines, noise_lines
from fitting.signal.residual_tests import STRUCTURED, residual_structure
from fitting.signal.student import ROOT_68, ratio95, reach
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import hertz, how_many
from fitting.text.numbers import as_numbers, require_size

#: Points that a noise spectrum has at least.
LEAST_POINTS = 12
#: Fewest and most averages that a scatter may tell.
AVERAGES = (0.1, 1e12)
#: Halvings that find their number, and the smallest tail that is told from none.
HALVINGS, LEAST = 60, 1e-300


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseRecord:
    """A noise spectrum.

    Attributes:
        source: what complaints name it by.
        frequency_hz: rising, shape (n,), Hz.
        density: above zero, shape (n,), in ``unit`` squared per Hz.
        unit: of what is seen, as V; "1": the numbers are relative.
        said: how the file was read, in sentences.
    """

    source: str
    frequency_hz: FloatArray
    density: FloatArray
    unit: str
    said: tuple[str, ...] = ()

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
        words = f"Taken: {int(np.sum(kept))} of {how_many(kept.size, 'point')}."
        return replace(
            self,
            frequency_hz=self.frequency_hz[kept],
            density=self.density[kept],
            said=(*self.said, words),
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
    said = () if np.all(kept) else (AT_ZERO,)
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
    return NoiseRecord(source=source, frequency_hz=f[order], density=y[order], unit=unit, said=said)


@dataclass(frozen=True, kw_only=True)
class FurtherNoiseLine:
    """A further line of a noise spectrum, fitted beside the first one: Hz, and errors.

    ``share`` is its height over that of the first one.
    """

    frequency_hz: float
    frequency_std_hz: float
    width_hz: float
    width_std_hz: float
    q: float
    q_std: float
    share: float


@dataclass(frozen=True, kw_only=True)
class NoisePoints:
    """Frequencies, Hz, densities as measured and as fitted, (n,) each."""

    frequency_hz: tuple[float, ...]
    measured: tuple[float, ...]
    fitted: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class NoiseLine:
    """One resonance of a noise spectrum.

    Errors (``_std``) are half of the interval that holds the truth in 68 of 100 such spectra, the
    others (``_ci95``) in 95. Both are Student's, as the scatter is known from the points alone.

    Attributes:
        source: the file, or "arrays".
        frequency_hz: eigenfrequency, Hz.
        width_hz: full width at half of the density, Hz.
        q: their ratio.
        power: of the line over all frequencies, in ``unit`` squared, pi/2 times height times width;
            NaN of two modes that are moved by one force or through each other.
        rms: its root, in ``unit``.
        height: density of the line at its frequency, without the floor, ``unit`` squared per Hz.
        floor: white density beside it, ``unit`` squared per Hz.
        unit: of what is seen, as V; "1": the numbers are relative.
        averages: of how many periodograms the points are averages, as they scatter.
        kind: how two modes are moved: "own" forces, "together" by one, "coupled".
        second: a further line that was fitted beside it; None without.
        spacing_hz: between two points, Hz.
        describes: whether what is left is the scatter of such averages, by all tests.
        freedom: degrees of freedom of the scatter.
        independent_points: how many independent points the points are worth.
        widening: factor on the errors for points that hang together or scatter unequally; else 1.
        structure_p: probability that independent points leave such residuals.
        sizes_p: probability that a scatter by one share leaves such residuals.
        said: how the file was read, in sentences.
        points: what was measured and fitted.
    """

    source: str
    frequency_hz: float
    frequency_std_hz: float
    frequency_ci95_hz: tuple[float, float]
    width_hz: float
    width_std_hz: float
    width_ci95_hz: tuple[float, float]
    q: float
    q_std: float
    q_ci95: tuple[float, float]
    power: float
    power_std: float
    rms: float
    rms_std: float
    height: float
    floor: float
    unit: str
    averages: float
    kind: str
    second: FurtherNoiseLine | None
    spacing_hz: float
    describes: bool
    freedom: float
    independent_points: float
    widening: float
    structure_p: float
    sizes_p: float
    said: tuple[str, ...]
    points: NoisePoints = field(repr=False)


def noise_line_of(record: NoiseRecord) -> NoiseLine:
    """The resonance of a noise spectrum, by the likelihood of averages of periodograms.

    Args:
        record: what was measured.

    Raises:
        BadInput: no line, or one that is not told from the floor.
    """
    lines = noise_lines(record.frequency_hz, record.density)
    if lines is None:
        raise BadInput(
            f"{record.source}: shows no line as a noise spectrum: its density is level within its "
            "scatter; wanted one line at least"
        )
    first = int(np.argmax(np.abs(lines.height)))
    if not np.isfinite(lines.frequency_std_hz[first] * lines.width_std_hz[first]):
        raise BadInput(
            f"{record.source}: shows a line whose width does not show in its points; wanted more "
            "of them in it, or a longer stretch beside it"
        )
    return _told(record, lines, first)


def averages_of(deviance: float, freedom: int) -> float:
    """M: of how many periodograms points with such deviances are averages.

    Args:
        deviance: the sum of d over all points.
        freedom: points less unknowns, n - k.
    """
    mean = deviance / freedom
    low, high = map(math.log, AVERAGES)
    for _ in range(HALVINGS):  # 2 (ln M - psi(M)) falls with M
        middle = 0.5 * (low + high)
        falls = 2.0 * (middle - float(digamma(math.exp(middle)))) > mean
        low, high = (middle, high) if falls else (low, middle)
    return math.exp(0.5 * (low + high))


def _scores(record: NoiseRecord, lines: NoiseLines, averages: float) -> FloatArray:
    """Normal deviates as probable as the points are, over sqrt(M), shape (n,)."""
    share = record.density / lines.curve
    below, above = (tail(averages, averages * share) for tail in (gammainc, gammaincc))
    found = np.where(below < 0.5, ndtri(np.maximum(below, LEAST)), -ndtri(np.maximum(above, LEAST)))
    return np.asarray(found / math.sqrt(averages))


def _told(record: NoiseRecord, lines: NoiseLines, first: int) -> NoiseLine:
    count = max(1, lines.points - lines.unknowns)
    averages = averages_of(lines.deviance, count)
    structure = residual_structure(_scores(record, lines, averages), lines.slopes)
    freedom = max(1.0, count / structure.widening**2)
    # the lines' own errors take the mean deviance for 1/M, which it is but for few averages
    scatter = math.sqrt(count / (averages * max(lines.deviance, 1e-300)))
    factor = structure.widening * scatter * reach(ROOT_68, freedom)
    found = [_one(lines, k, factor) for k in range(len(lines.frequency_hz))]
    line = found[first]
    half = ratio95(freedom)
    width_ci95 = _interval(line.width_hz, line.width_std_hz, half)
    slow, fast = (max(end, 1e-300) for end in width_ci95)
    power = lines.power[first] if lines.power else math.nan
    power_std = factor * lines.power_std[first] if lines.power else math.nan
    rms = math.sqrt(power) if power > 0.0 else math.nan
    return NoiseLine(
        source=record.source,
        frequency_hz=line.frequency_hz,
        frequency_std_hz=line.frequency_std_hz,
        frequency_ci95_hz=_interval(line.frequency_hz, line.frequency_std_hz, half),
        width_hz=line.width_hz,
        width_std_hz=line.width_std_hz,
        width_ci95_hz=width_ci95,
        q=line.q,
        q_std=line.q_std,
        q_ci95=(line.frequency_hz / fast, line.frequency_hz / slow),
        power=power,
        power_std=power_std,
        rms=rms,
        rms_std=0.5 * power_std / rms,
        height=abs(lines.height[first]),
        floor=lines.floor,
        unit=record.unit,
        averages=averages,
        kind=lines.kind,
        second=next((other for k, other in enumerate(found) if k != first), None),
        spacing_hz=float(np.median(np.diff(record.frequency_hz))),
        describes=min(structure.p_value, structure.sizes_p) >= STRUCTURED,
        freedom=freedom,
        independent_points=structure.points,
        widening=structure.widening,
        structure_p=structure.p_value,
        sizes_p=structure.sizes_p,
        said=record.said,
        points=NoisePoints(
            frequency_hz=tuple(record.frequency_hz.tolist()),
            measured=tuple(record.density.tolist()),
            fitted=tuple(lines.curve.tolist()),
        ),
    )


def _one(lines: NoiseLines, k: int, factor: float) -> FurtherNoiseLine:
    """The k-th line, its errors times a factor."""
    f, w = lines.frequency_hz[k], lines.width_hz[k]
    f_std, w_std = factor * lines.frequency_std_hz[k], factor * lines.width_std_hz[k]
    return FurtherNoiseLine(
        frequency_hz=f,
        frequency_std_hz=f_std,
        width_hz=w,
        width_std_hz=w_std,
        q=f / w,
        q_std=f / w * math.hypot(w_std / w, f_std / f),
        share=abs(lines.height[k]) / max(map(abs, lines.height)),
    )


def _interval(value: float, error: float, half: float) -> tuple[float, float]:
    return value - half * error, value + half * error
