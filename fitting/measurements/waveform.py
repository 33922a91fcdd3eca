"""Waveform: an input over time, recorded or declared, and what steps of an FMU hold of it.

An input can only be held over a communication step. The mean of the waveform over each step is
held, so that the integral of the input is exact at the end of every step:

    held_k = 1/h integral of u over [t_k, t_k + h]

What is left falls with the square of the step where u is smooth, and is nothing where u itself is
held over whole steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from fitting.text.arrays import FloatArray, as_numbers
from fitting.text.errors import BadInput

HOLD, LINEAR = INTERPOLATIONS = ("held", "linear")
#: Nodes of the quadrature that takes the mean of a chirp over a step.
NODES = 6


class Waveform(Protocol):
    """An input over time."""

    def means(self, edges_s: FloatArray) -> FloatArray:
        """Means over intervals, (n,), of their edges (n + 1,).

        Args:
            edges_s: rising, s.
        """
        ...

    def at(self, times_s: FloatArray) -> FloatArray:
        """Values at times, (n,), those after a jump where it jumps.

        Args:
            times_s: (n,), s.
        """
        ...

    @property
    def words(self) -> str:
        """Its description in reports."""
        ...


@dataclass(frozen=True, eq=False)
class Recorded:
    """Values that were recorded, ``held`` until the next one or joined by straight lines.

    Before the first and after the last one the input stands still.

    Args:
        time_s: Times of the values, shape (n,), s, rising.
        values: Of the input, shape (n,), in the FMU's unit.
        interpolation: "held" or "linear".
        source: What complaints name it by.

    Raises:
        BadInput: shapes that differ, times that do not rise, values that are not finite.
    """

    time_s: FloatArray
    values: FloatArray
    interpolation: str = LINEAR
    source: str = "input"

    def __post_init__(self) -> None:
        for name in ("time_s", "values"):
            object.__setattr__(self, name, as_numbers(getattr(self, name), name))
        t, u = self.time_s, self.values
        if t.ndim != 1 or t.shape != u.shape or not t.size:
            raise BadInput(
                f"{self.source}: {t.shape} times and {u.shape} values, wanted equally many"
            )
        if not (np.isfinite(t).all() and np.isfinite(u).all()):
            raise BadInput(f"{self.source}: wanted finite numbers")
        if np.any(np.diff(t) <= 0.0):
            raise BadInput(
                f"{self.source}: times do not rise; wanted each later than the one before"
            )
        if self.interpolation not in INTERPOLATIONS:
            raise BadInput(
                f'{self.source}: interpolation is {self.interpolation!r}, wanted "held" or "linear"'
            )

    @cached_property
    def _until(self) -> FloatArray:
        """Integral from the first time to every one, (n,)."""
        u = self.values
        means = u[:-1] if self.interpolation == HOLD else 0.5 * (u[:-1] + u[1:])
        return np.concatenate([[0.0], np.cumsum(means * np.diff(self.time_s))])

    def _integral(self, times_s: FloatArray) -> FloatArray:
        t, u = self.time_s, self.values
        if t.size == 1:
            return np.asarray(u[0] * (times_s - t[0]))
        k = np.clip(np.searchsorted(t, times_s, side="right") - 1, 0, t.size - 2)
        past = np.clip(times_s, t[0], t[-1]) - t[k]
        slope = 0.0 if self.interpolation == HOLD else (u[k + 1] - u[k]) / (t[k + 1] - t[k])
        inside = self._until[k] + past * (u[k] + 0.5 * slope * past)
        before, after = np.minimum(times_s - t[0], 0.0), np.maximum(times_s - t[-1], 0.0)
        return np.asarray(inside + u[0] * before + u[-1] * after)

    def means(self, edges_s: FloatArray) -> FloatArray:
        """Means over intervals of their edges.

        Args:
            edges_s: of the intervals, shape (n + 1,), s, rising.
        """
        return np.diff(self._integral(edges_s)) / np.diff(edges_s)

    def at(self, times_s: FloatArray) -> FloatArray:
        """Values of the input at times.

        Args:
            times_s: shape (n,), s.
        """
        if self.interpolation == LINEAR:
            return np.interp(times_s, self.time_s, self.values)
        near = 1e-9 * float(np.ptp(self.time_s))  # a rounded time is that of its value
        k = np.searchsorted(self.time_s, times_s + near, side="right") - 1
        return np.asarray(self.values[np.maximum(k, 0)])

    @property
    def words(self) -> str:
        """Its description in reports."""
        how = "held from value to value" if self.interpolation == HOLD else "joined linearly"
        return f"input of {self.values.size} recorded values, {how}"


@dataclass(frozen=True, kw_only=True)
class Pulse:
    """An input of ``level`` from ``at_s`` on, over ``length_s``; zero before and after.

    Args:
        level: In the FMU's unit.
        at_s: Begin, s.
        length_s: Duration, s; infinite: a step.

    Raises:
        BadInput: a length that is not positive.
    """

    level: float = 1.0
    at_s: float = 0.0
    length_s: float = math.inf

    def __post_init__(self) -> None:
        if not self.length_s > 0.0:
            raise BadInput(f"pulse: its length is {self.length_s!r}, wanted a positive time")

    def means(self, edges_s: FloatArray) -> FloatArray:
        """Means over intervals of their edges.

        Args:
            edges_s: of the intervals, shape (n + 1,), s, rising.
        """
        inside = np.clip(edges_s - self.at_s, 0.0, self.length_s)
        return np.asarray(self.level * np.diff(inside) / np.diff(edges_s))

    def at(self, times_s: FloatArray) -> FloatArray:
        """Values of the input at times.

        Args:
            times_s: shape (n,), s.
        """
        past = times_s - self.at_s
        return np.where((past >= 0.0) & (past < self.length_s), self.level, 0.0)

    @property
    def words(self) -> str:
        """Its description in reports."""
        until = "" if math.isinf(self.length_s) else f" over {self.length_s:.6g} s"
        return f"declared input {self.level:.6g} from {self.at_s:.6g} s on{until}"


@dataclass(frozen=True, kw_only=True)
class Chirp:
    """An input that runs through frequencies: zero before ``at_s`` and after ``length_s``.

        u = level sin(2 pi (f0 s + (f1 - f0) s^2/(2 length))),   s = t - at

    Args:
        start_hz: f0, the first frequency, Hz.
        stop_hz: f1, the last one, Hz.
        length_s: Duration, s.
        level: Amplitude, in the FMU's unit.
        at_s: Begin, s.

    Raises:
        BadInput: a length that is not positive, negative frequencies.
    """

    start_hz: float
    stop_hz: float
    length_s: float
    level: float = 1.0
    at_s: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.length_s < math.inf:
            raise BadInput(f"chirp: its length is {self.length_s!r}, wanted a positive time")
        if not (self.start_hz >= 0.0 and self.stop_hz >= 0.0):
            raise BadInput(
                f"chirp: from {self.start_hz!r} to {self.stop_hz!r} Hz, wanted no negative one"
            )

    def at(self, times_s: FloatArray) -> FloatArray:
        """Values of the input at times.

        Args:
            times_s: shape (n,), s.
        """
        s = times_s - self.at_s
        rate = 0.5 * (self.stop_hz - self.start_hz) / self.length_s
        cycles = np.remainder(s * (self.start_hz + rate * s), 1.0)
        inside = (s >= 0.0) & (s < self.length_s)
        return np.where(inside, self.level * np.sin(2.0 * np.pi * cycles), 0.0)

    def means(self, edges_s: FloatArray) -> FloatArray:
        """Means over intervals of their edges, by Gauss's quadrature over what is inside it.

        Args:
            edges_s: of the intervals, shape (n + 1,), s, rising.
        """
        inside = np.clip(edges_s, self.at_s, self.at_s + self.length_s)
        begin, length = inside[:-1], np.diff(inside)
        nodes, weights = np.polynomial.legendre.leggauss(NODES)
        result = np.zeros(length.size)
        for x, w in zip(nodes, weights, strict=True):
            result += 0.5 * w * self.at(begin + 0.5 * (x + 1.0) * length)
        return np.asarray(result * length / np.diff(edges_s))

    @property
    def words(self) -> str:
        """Its description in reports."""
        return (
            f"declared chirp from {self.start_hz:.6g} Hz to {self.stop_hz:.6g} Hz in "
            f"{self.length_s:.6g} s"
        )
