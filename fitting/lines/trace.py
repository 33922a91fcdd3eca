"""What was measured: a response or a noise spectrum over frequency, or a free decay over time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from fitting.lines.names import MIN_SWEEP_POINTS
from fitting.signal.time_grid import spacing_s
from fitting.text.arrays import (
    BoolArray,
    ComplexArray,
    FloatArray,
    as_numbers,
    as_values,
    require_size,
)
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind, note
from fitting.text.notation import hertz, how_many, number

#: Points that a noise spectrum has at least.
LEAST_POINTS = 12
#: What was recorded over time: the motion itself, X and Y, or amplitudes alone.
SAMPLES, PHASORS, AMPLITUDES = KINDS = ("samples", "phasors", "amplitudes")
#: Steps that are equal but for the last digit of a file: by which share they may differ.
UNEVEN = 0.2


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """Values over frequency or over time.

    Attributes:
        source: the file, or what errors name it by.
        values: shape (n,), complex with phases.
        unit: of the values; "1": none.
        reading: how the file was read.
    """

    source: str
    values: FloatArray | ComplexArray
    unit: str
    reading: tuple[Finding, ...] = ()

    @property
    def is_complex(self) -> bool:
        """Whether there are phases."""
        return np.iscomplexobj(self.values)

    @property
    def top(self) -> float:
        """The largest modulus, in ``unit``."""
        return float(np.max(np.abs(self.values)))

    def between(
        self, axis: FloatArray, ends: tuple[float | None, float | None], least: int, unit: str
    ) -> BoolArray:
        """Which values lie between two places of their axis, (n,).

        Args:
            axis: frequencies or times, rising, shape (n,).
            ends: both places, in the unit of the axis; None: as far as there are values.
            least: how many values are required.
            unit: of the axis, "Hz" or "s".

        Raises:
            BadInput: too few values are left.
        """
        low, high = (
            far if end is None else end
            for end, far in zip(ends, (-math.inf, math.inf), strict=True)
        )
        kept = (axis >= low) & (axis <= high)
        count = int(np.sum(kept))
        if count < least:
            what = "point" if unit == "Hz" else "sample"
            ends_words = hertz(axis[0], axis[-1], joined=" to ")
            if unit == "s":
                ends_words = f"{number(float(axis[0]), 6)} to {number(float(axis[-1]), 6)} s"
            raise BadInput(
                f"{self.source}: {how_many(count, f'{what} lies', f'{what}s lie')} between --from "
                f"and --to, wanted at least {least}; its {what}s run from {ends_words}"
            )
        return kept


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace(Measured):
    """A response over frequency: amplitudes, or complex values that count Re[v exp(i 2 pi f t)].

    Attributes:
        frequency_hz: rising, shape (n,), Hz.
        read: the columns that were taken for what, in words; empty for arrays.
        phases_reversed: whether the file counts them the other way; here they are reversed.
        instrument: the instrument's own estimates, see `LineResult`.
        places: where every point is in the file, as "row 12", (n,); of arrays its number.
        whole: the trace of which this is a part; None: it is whole.
    """

    frequency_hz: FloatArray
    read: str = ""
    phases_reversed: bool = False
    instrument: Mapping[str, float] = field(default_factory=dict)
    places: tuple[str, ...] = ()
    whole: Trace | None = None

    @property
    def amplitude(self) -> FloatArray:
        """Moduli of the values, (n,)."""
        return np.asarray(np.abs(self.values), dtype=float)

    @property
    def rows(self) -> int:
        """Number of residuals: of complex values two at every point."""
        return (2 if self.is_complex else 1) * int(self.values.size)

    def within(self, low_hz: float | None, high_hz: float | None) -> Trace:
        """The part between two frequencies.

        Args:
            low_hz: Hz, None: from the first.
            high_hz: Hz, None: to the last.

        Raises:
            BadInput: too few points are left.
        """
        if low_hz is None and high_hz is None:
            return self
        kept = self.between(self.frequency_hz, (low_hz, high_hz), MIN_SWEEP_POINTS, "Hz")
        count = int(np.sum(kept))
        low, high = self.frequency_hz[kept][[0, -1]].tolist()
        taken = note(
            Kind.part_taken, "point", taken=count, count=kept.size, low_hz=low, high_hz=high
        )
        return replace(
            self.points(kept),
            whole=self if count < self.frequency_hz.size else None,
            reading=(*self.reading, taken),
        )

    def points(self, kept: npt.NDArray[np.bool_]) -> Trace:
        """The trace of some of its points.

        Args:
            kept: whether a point is one of them, shape (n,).
        """
        return replace(
            self,
            frequency_hz=self.frequency_hz[kept],
            values=self.values[kept],
            places=tuple(p for p, taken in zip(self.places, kept, strict=True) if taken),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseRecord(Measured):
    """A noise spectrum: densities above zero, in the square of ``unit`` per Hz.

    Attributes:
        frequency_hz: rising, shape (n,), Hz.
    """

    frequency_hz: FloatArray

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
        kept = self.between(self.frequency_hz, (low_hz, high_hz), LEAST_POINTS, "Hz")
        taken = note(Kind.part_taken, "point", taken=int(np.sum(kept)), count=kept.size)
        return replace(
            self,
            frequency_hz=self.frequency_hz[kept],
            values=self.values[kept],
            reading=(*self.reading, taken),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class DecayRecord(Measured):
    """A recording over time: samples or amplitudes, or complex values that were demodulated.

    Attributes:
        time_s: evenly spaced, shape (n,), s.
        kind: one of `KINDS`; empty: samples or amplitudes, which the values decide.
        reference_hz: frequency of the demodulator, Hz; NaN: not known.
    """

    time_s: FloatArray
    kind: str = ""
    reference_hz: float = math.nan

    @property
    def spacing_s(self) -> float:
        """Between two samples, s."""
        return float(self.time_s[-1] - self.time_s[0]) / (self.time_s.size - 1)

    @property
    def span_s(self) -> float:
        """Length of the record, s."""
        return self.spacing_s * self.values.size

    def within(self, low_s: float | None, high_s: float | None) -> DecayRecord:
        """The part between two times.

        Args:
            low_s: s, None: from the first.
            high_s: s, None: to the last.

        Raises:
            BadInput: too few samples are left.
        """
        if low_s is None and high_s is None:
            return self
        kept = np.flatnonzero(self.between(self.time_s, (low_s, high_s), MIN_SWEEP_POINTS, "s"))
        taken = note(Kind.part_taken, "sample", taken=kept.size, count=self.time_s.size)
        return replace(self.part(int(kept[0]), int(kept[-1]) + 1), reading=(*self.reading, taken))

    def part(self, first: int, end: int) -> DecayRecord:
        """The samples from one to another.

        Args:
            first: number of the first one.
            end: of the one behind the last.
        """
        return replace(self, time_s=self.time_s[first:end], values=self.values[first:end])


def above_zero(frequency_hz: FloatArray) -> BoolArray:
    """Which points are not at 0 Hz, where a Fourier transform has the mean of a record; (n,).

    Args:
        frequency_hz: shape (n,), Hz; where all are zero all are kept, for errors.
    """
    kept = frequency_hz != 0.0
    return np.asarray(kept if np.any(kept) else ~kept)


def swapped(frequencies: FloatArray, sizes: FloatArray) -> bool:
    """Whether two columns have changed places: the frequencies in no order, the sizes a grid.

    Args:
        frequencies: as they stand there, shape (n,), any unit.
        sizes: amplitudes, as they stand there, shape (n,), any unit.
    """
    if frequencies.size < MIN_SWEEP_POINTS or np.min(sizes) <= 0.0:
        return False
    steps = np.diff(frequencies)
    in_order = np.all(steps >= 0.0) or np.all(steps <= 0.0)
    return not in_order and (_even(sizes) or _even(np.log(sizes)))


def _even(numbers: FloatArray) -> bool:
    """Whether numbers run one way in steps of one size, as far as digits of a file show it."""
    steps = np.diff(numbers)
    middle = float(np.median(steps))
    return middle != 0.0 and bool(np.all(np.abs(steps / middle - 1.0) < UNEVEN))


def _checked(
    axis: npt.ArrayLike, values: npt.ArrayLike, names: tuple[str, str], source: str
) -> tuple[FloatArray, FloatArray | ComplexArray]:
    """An axis and values on it as finite numbers, (n,) each."""
    x = as_numbers(axis, f"{source}: {names[0]}")
    y = as_values(values, f"{source}: values")
    if x.ndim != 1 or x.shape != y.shape:
        raise BadInput(f"{source}: {names[0]} {x.shape} and values {y.shape}; wanted (n,) for both")
    for name, numbers in ((names[1], x), ("value", y)):
        for i in np.flatnonzero(~np.isfinite(numbers))[:1]:
            raise BadInput(f"{source}: {name} number {i + 1} is {numbers[i]}, wanted a finite one")
    require_size(x, f"{source}: {names[0]}")
    require_size(y, f"{source}: values")
    return x, y


def decay_record_of(
    time_s: npt.ArrayLike, values: npt.ArrayLike, unit: str, source: str = "arrays"
) -> DecayRecord:
    """A checked record of arrays.

    Args:
        time_s: evenly spaced, shape (n,), s.
        values: samples or amplitudes, or complex ones that were demodulated, shape (n,).
        unit: of the values.
        source: what errors name it by.

    Raises:
        BadInput: shapes that differ, values that are no numbers, times that are not even.
    """
    t, y = _checked(time_s, values, ("times", "time"), source)
    spacing_s(t, source)
    kind = PHASORS if np.iscomplexobj(y) else ""
    return DecayRecord(source=source, time_s=t, values=y, unit=unit, kind=kind)


def trace_of(
    frequency_hz: npt.ArrayLike,
    values: npt.ArrayLike,
    unit: str,
    source: str = "arrays",
    places: Sequence[str] = (),
) -> Trace:
    """A checked trace; points that run downwards are turned round.

    Args:
        frequency_hz: shape (n,), Hz, in any order but each once.
        values: amplitudes or complex values, shape (n,).
        unit: of the values.
        source: what errors name it by.
        places: where every point stands, in words; empty: by its number.

    Raises:
        BadInput: shapes that differ, values that are no numbers, a frequency twice or not above
            zero, negative amplitudes, nothing but zeros.
    """
    f, y = _checked(frequency_hz, values, ("frequencies", "frequency"), source)
    if not np.iscomplexobj(y) and swapped(f, y.real):
        raise BadInput(
            f"{source}: the frequencies run neither up nor down, but the amplitudes run evenly: "
            "they look swapped; wanted frequencies, then amplitudes"
        )
    named = tuple(places) or tuple(f"point {k + 1}" for k in range(f.size))
    kept = above_zero(f)
    order = np.flatnonzero(kept)[np.argsort(f[kept], kind="stable")]
    f, y = f[order], y[order]
    if f.size and f[0] <= 0.0:
        raise BadInput(f"{source}: found the frequency {f[0]:g} Hz, wanted frequencies above zero")
    for i in np.flatnonzero(np.diff(f) == 0.0)[:1]:
        raise BadInput(
            f"{source}: the frequency {f[i]:.12g} Hz stands there twice, wanted one sweep, each "
            "frequency once (of a sweep up and down, the rows of one direction)"
        )
    if not np.iscomplexobj(y):
        for i in np.flatnonzero(y < 0.0)[:1]:
            raise BadInput(
                f"{source}: the amplitude at {f[i]:.12g} Hz is {y[i]:.6g}, wanted magnitudes (are "
                "columns exchanged, or is it in dB? --unit-amplitude dB)"
            )
    if not np.any(np.abs(y) > 0.0):
        raise BadInput(f"{source}: holds nothing but zeros, wanted a resonance")
    where = tuple(named[k] for k in order)
    reading = () if np.all(kept) else (note(Kind.zero_frequency),)
    return Trace(source=source, frequency_hz=f, values=y, unit=unit, places=where, reading=reading)


def noise_record_of(
    frequency_hz: npt.ArrayLike, density: npt.ArrayLike, unit: str, source: str = "arrays"
) -> NoiseRecord:
    """A checked noise spectrum of arrays.

    Args:
        frequency_hz: shape (n,), Hz, in any order.
        density: above zero, shape (n,), in ``unit`` squared per Hz.
        unit: of what is seen; "1": the numbers are relative.
        source: what errors name it by.

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
        source=source, frequency_hz=f[order], values=y[order], unit=unit, reading=reading
    )
