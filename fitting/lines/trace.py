"""A measured response over frequency: amplitudes, or complex values, of one sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from fitting.lines.names import MIN_SWEEP_POINTS
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
from fitting.text.notation import hertz, how_many

#: Steps that are equal but for the last digit of a file: by which share they may differ.
UNEVEN = 0.2
#: Frequencies beyond which no point lies, Hz.
FAR = (-np.inf, np.inf)


def within(
    frequency_hz: FloatArray,
    ends_hz: tuple[float | None, float | None],
    least: int,
    source: str,
) -> BoolArray:
    """Which points lie between two frequencies, (n,).

    Args:
        frequency_hz: rising, shape (n,), Hz.
        ends_hz: both of them, Hz; None: as far as there are points.
        least: how many points are wanted.
        source: what a complaint names them by.

    Raises:
        BadInput: too few points are left.
    """
    low, high = (end if end is not None else far for end, far in zip(ends_hz, FAR, strict=True))
    kept = (frequency_hz >= low) & (frequency_hz <= high)
    count = int(np.sum(kept))
    if count < least:
        ends = hertz(frequency_hz[0], frequency_hz[-1], joined=" to ")
        raise BadInput(
            f"{source}: {how_many(count, 'point lies', 'points lie')} between --from and --to, "
            f"wanted at least {least}; its points run from {ends}"
        )
    return kept


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """A response over frequency.

    Attributes:
        source: what complaints name it by.
        frequency_hz: rising, shape (n,), Hz.
        values: amplitudes, or complex values with phases as Re[values exp(i 2 pi f t)], (n,).
        unit: of the values.
        read: the columns that were taken for what, in words; empty for arrays.
        phases_reversed: whether the file counts them the other way; here they are reversed.
        reading: how the file was read.
        instrument: the instrument's own estimates, see `LineResult`.
        places: where every point stands in the file, as "row 12", (n,); of arrays its number.
        whole: the trace of which this is a part; None: it is whole.
    """

    source: str
    frequency_hz: FloatArray
    values: FloatArray | ComplexArray
    unit: str
    read: str = ""
    phases_reversed: bool = False
    reading: tuple[Finding, ...] = ()
    instrument: Mapping[str, float] = field(default_factory=dict)
    places: tuple[str, ...] = ()
    whole: Trace | None = None

    @property
    def is_complex(self) -> bool:
        """Whether there are phases."""
        return np.iscomplexobj(self.values)

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
        kept = within(self.frequency_hz, (low_hz, high_hz), MIN_SWEEP_POINTS, self.source)
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


def above_zero(frequency_hz: FloatArray) -> BoolArray:
    """Which points are not at 0 Hz, where a Fourier transform has the mean of a record; (n,).

    Args:
        frequency_hz: shape (n,), Hz; where all are zero all are kept, for complaints.
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
    """Whether numbers run one way in steps of one size, as far as digits of a file tell it."""
    steps = np.diff(numbers)
    middle = float(np.median(steps))
    return middle != 0.0 and bool(np.all(np.abs(steps / middle - 1.0) < UNEVEN))


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
        source: what complaints name it by.
        places: where every point stands, in words; empty: by its number.

    Raises:
        BadInput: shapes that differ, values that are no numbers, a frequency twice or not above
            zero, negative amplitudes, nothing but zeros.
    """
    f = as_numbers(frequency_hz, f"{source}: frequencies")
    y = as_values(values, f"{source}: values")
    if f.ndim != 1 or f.shape != y.shape:
        raise BadInput(
            f"{source}: frequencies {f.shape} and values {y.shape}; wanted (n,) for both"
        )
    for name, numbers in (("frequency", f), ("value", y)):
        for i in np.flatnonzero(~np.isfinite(numbers))[:1]:
            raise BadInput(f"{source}: {name} number {i + 1} is {numbers[i]}, wanted a finite one")
    require_size(f, f"{source}: frequencies")
    require_size(y, f"{source}: values")
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
