"""One resonance of a noise spectrum: frequency, width, quality and power, without any FMU.

Heat moves a mode all the time, and its displacement has the density

    S(f) = a |g(f)|^2 + b,   |g| the line of `fitting.lines.lorentzian`, b a white floor
    power of the line  P = pi/2 a w,   rms = sqrt(P),   Q = f/w

which is fitted by the likelihood of averages of periodograms (`fitting.lines.noise_spectrum`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from fitting.lines.noise_spectrum import noise_lines
from fitting.resonance.record import MeasuredLine, Points
from fitting.resonance.trace import above_zero, within
from fitting.signal.line_record import LineNumber, LineValues, fields_of, number_of_line
from fitting.signal.student import ratio95
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind, note
from fitting.text.notation import hertz
from fitting.text.numbers import as_numbers, require_size

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
