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
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.special import digamma, gammainc, gammaincc, ndtri

from fitting.resonance.record import MeasuredLine, Points
from fitting.resonance.trace import above_zero, within
from fitting.signal.line_record import (
    LineNumber,
    LineValues,
    SecondLine,
    fields_of,
    line_numbers,
    number_of_line,
)
from fitting.signal.noise_lines import NoiseLines, noise_lines
from fitting.signal.residual_tests import residual_structure
from fitting.signal.student import ROOT_68, ratio95, reach
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind, note
from fitting.text.notation import hertz
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
        floor: white density under it, ``unit`` squared per Hz.
        averages: of how many periodograms the points are averages, as they scatter.
        kind: how two modes are moved: "own" forces, "together" by one, "coupled".
        spacing_hz: between two points, Hz.
    """

    power: LineNumber
    rms: LineNumber
    height: float
    floor: float
    averages: float
    kind: str
    spacing_hz: float


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
            "of them in it, or a longer range around it"
        )
    return _result(record, lines, first)


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


def _result(record: NoiseRecord, lines: NoiseLines, first: int) -> NoiseLine:
    count = max(1, lines.points - lines.unknowns)
    averages = averages_of(lines.deviance, count)
    structure = residual_structure(_scores(record, lines, averages), lines.slopes)
    dof = max(1.0, count / structure.widening**2)
    # the lines' own errors take the mean deviance for 1/M, which it is but for few averages
    scatter = math.sqrt(count / (averages * max(lines.deviance, 1e-300)))
    factor = structure.widening * scatter * reach(ROOT_68, dof)
    both = [_line(lines, k, factor, dof) for k in range(len(lines.frequency_hz))]
    power = lines.power[first] if lines.power else math.nan
    power_std = factor * lines.power_std[first] if lines.power else math.nan
    rms = math.sqrt(power) if power > 0.0 else math.nan
    half = ratio95(dof)
    return NoiseLine(
        **fields_of(both[first], LineValues),
        source=record.source,
        unit=record.unit,
        power=number_of_line("power", power, power_std, f"({record.unit})**2", half=half),
        rms=number_of_line("rms", rms, 0.5 * power_std / rms, record.unit, half=half),
        height=abs(lines.height[first]),
        floor=lines.floor,
        averages=averages,
        kind=lines.kind,
        second=next((other for k, other in enumerate(both) if k != first), None),
        spacing_hz=float(np.median(np.diff(record.frequency_hz))),
        dof=dof,
        structure=structure,
        reading=record.reading,
        points=Points.of(record.density, lines.curve, frequency_hz=record.frequency_hz),
    )


def _line(lines: NoiseLines, k: int, factor: float, dof: float) -> SecondLine:
    """The k-th line, its errors times a factor."""
    f, w = lines.frequency_hz[k], lines.width_hz[k]
    f_std, w_std = factor * lines.frequency_std_hz[k], factor * lines.width_std_hz[k]
    q_std = f / w * math.hypot(w_std / w, f_std / f)
    numbers = line_numbers((f, f_std), (w, w_std), (f / w, q_std), dof)
    slow, fast = (max(end, 1e-300) for end in numbers["width"].ci95)
    numbers["q"] = replace(numbers["q"], ci95=(f / fast, f / slow))
    share = abs(lines.height[k]) / max(map(abs, lines.height))
    return SecondLine(**numbers, share=share)
