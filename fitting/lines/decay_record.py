"""What was recorded of a free decay: samples, demodulated values or amplitudes over time."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fitting.lines.names import MIN_SWEEP_POINTS
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind, note
from fitting.text.notation import how_many, number

#: What was recorded: the motion itself, X and Y, or amplitudes alone; None: it has to be seen.
SAMPLES, PHASORS, AMPLITUDES = KINDS = ("samples", "phasors", "amplitudes")


@dataclass(frozen=True, kw_only=True, eq=False)
class DecayRecord:
    """A recording over time.

    Attributes:
        source: what complaints name it by.
        time_s: evenly spaced, shape (n,), s.
        values: samples or amplitudes, or complex ones that were demodulated, shape (n,).
        unit: of the values.
        kind: one of `KINDS`; empty: samples or amplitudes, as the values tell.
        reference_hz: what was demodulated at, Hz; NaN: nobody told.
        reading: how the file was read.
    """

    source: str
    time_s: FloatArray
    values: FloatArray | ComplexArray
    unit: str
    kind: str = ""
    reference_hz: float = math.nan
    reading: tuple[Finding, ...] = ()

    @property
    def is_complex(self) -> bool:
        """Whether it was demodulated with its phase."""
        return np.iscomplexobj(self.values)

    @property
    def spacing_s(self) -> float:
        """Between two samples, s."""
        return float(self.time_s[-1] - self.time_s[0]) / (self.time_s.size - 1)

    @property
    def span_s(self) -> float:
        """Length of the record, s."""
        return self.spacing_s * self.values.size

    @property
    def top(self) -> float:
        """The largest modulus, in ``unit``."""
        return float(np.max(np.abs(self.values)))

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
        low = -math.inf if low_s is None else low_s
        high = math.inf if high_s is None else high_s
        kept = np.flatnonzero((self.time_s >= low) & (self.time_s <= high))
        first, last = number(float(self.time_s[0]), 6), number(float(self.time_s[-1]), 6)
        if kept.size < MIN_SWEEP_POINTS:
            raise BadInput(
                f"{self.source}: {how_many(kept.size, 'sample lies', 'samples lie')} between "
                f"--from and --to, wanted at least {MIN_SWEEP_POINTS}; its samples run from "
                f"{first} to {last} s"
            )
        taken = note(Kind.part_taken, "sample", taken=kept.size, count=self.time_s.size)
        return replace(self.part(int(kept[0]), int(kept[-1]) + 1), reading=(*self.reading, taken))

    def part(self, first: int, end: int) -> DecayRecord:
        """The samples from one to another.

        Args:
            first: number of the first one.
            end: of the one behind the last.
        """
        return replace(self, time_s=self.time_s[first:end], values=self.values[first:end])
