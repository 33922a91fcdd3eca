"""Two modes that meet over a control: a closed form through a map gives start values.

    q1 = N2/(N1 N2 - l^4)      N_i = f_i^2 - u^2 + i u d_i      f1, f2 polynomials of the control

is what one tone on mode 1 makes of it, q1 in units of no interest: every spectrum has a scale of
its own, by least squares. One of the modes stands still where that will do. At the crossing both
lines are gap = l^2/f apart. Starts come from the ridge, the frequencies of the largest amplitudes:
mode 1 shows, so that the ridge follows it where both are far from each other.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.polynomial.polynomial import polyfit, polyval

from fitting.signal.least_squares import minimise_squares
from fitting.signal.scale import half_power_width
from fitting.text.arrays import ComplexArray, FloatArray, IntArray

#: Spectra that are looked at, at most; starts that are refined, and evaluations for each.
MOST_SPECTRA, REFINED, ROUNDS = 12, 6, 60
#: Tried: places of the crossing over the control from -1 to 1, and gaps in widths of a line.
PLACES, GAPS = np.linspace(-1.0, 1.0, 9), (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
#: Tried slopes of the tuned mode: in slopes of the ridge, or in spans over half the control.
STEEPER, SLOPES = (1.0, 1.5, 2.5), (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
#: A square of the control counts from this fall of the sum of squares, a second mode from that one,
#: and where each of its three numbers gains so many times what noise would.
BENT, SECOND, BEYOND_NOISE = 0.8, 0.9, 10.0
#: Powers of the other mode's law at most; its slopes tried, in slopes of the tuned one.
MOST_POWERS, OTHER_SLOPES = 2, (-2.0, -1.0, -0.5, 0.5)
#: Turns of a cable over a sweep, at most, and steps for each; its share of the sum of squares.
MOST_TURNS, STEPS, CABLE = 40, 16, 0.8
#: Exponents of the logarithms of gap and widths stay below it.
LARGEST = 50.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossing:
    """Two modes, one of which follows the control, as they were seen.

    Attributes:
        tuned: 1: the mode that is driven and seen follows the control, 2: the other one.
        law: coefficients of its frequency, Hz, of powers of the control, from 0.
        other: those of the other mode, one where it does not follow the control.
        coupling_hz: l.
        widths_hz: full widths of modes 1 and 2.
        gap_hz: between both lines where they come closest.
        place: of the control there, None: beyond what was measured.
        left: root mean square of what is left, over the largest amplitude of each spectrum.
        is_observed: whether a second mode is there at all, by the extra sum of squares
            (N. Draper and H. Smith, Applied Regression Analysis).
    """

    tuned: int
    law: tuple[float, ...]
    other: tuple[float, ...]
    coupling_hz: float
    widths_hz: tuple[float, float]
    gap_hz: float
    place: float | None
    left: float
    is_observed: bool


@dataclass(frozen=True, eq=False)
class Spectra:
    """Amplitudes (n,) over frequencies (n,), Hz, at each value of the control, of a map."""

    control: FloatArray
    frequency_hz: Sequence[FloatArray]
    amplitude: Sequence[FloatArray]

    @cached_property
    def middle(self) -> float:
        """Of the control."""
        return 0.5 * float(np.min(self.control) + np.max(self.control))

    @cached_property
    def half(self) -> float:
        """Half of what the control runs over."""
        return 0.5 * float(np.ptp(self.control))

    @cached_property
    def x(self) -> FloatArray:
        """The control from -1 to 1, (spectra,)."""
        return np.asarray((self.control - self.middle) / self.half)

    @cached_property
    def range_hz(self) -> tuple[float, float]:
        """First and last frequency of all."""
        first, last = ([float(f[end]) for f in self.frequency_hz] for end in (0, -1))
        return min(first), max(last)

    @cached_property
    def ridge_hz(self) -> FloatArray:
        """Frequencies of the largest amplitudes, (spectra,)."""
        pairs = zip(self.frequency_hz, self.amplitude, strict=True)
        return np.array([f[int(np.argmax(a))] for f, a in pairs])

    @cached_property
    def width_hz(self) -> float:
        """A typical width of a line, and no less than the points are apart."""
        pairs = zip(self.frequency_hz, self.amplitude, strict=True)
        widths = [half_power_width(f, a) for f, a in pairs]
        apart = float(np.median(np.concatenate([np.diff(f) for f in self.frequency_hz])))
        observed = [width for width in widths if width > 0.0 and math.isfinite(width)]
        return max(float(np.median(observed)) if observed else 0.0, apart)

    def some(self) -> Spectra:
        """A dozen of them at most, over the whole range."""
        count = self.control.size
        if count <= MOST_SPECTRA:
            return self
        order = np.argsort(self.control)
        kept = order[np.round(np.linspace(0, count - 1, MOST_SPECTRA)).astype(int)]
        return Spectra(
            self.control[kept],
            [self.frequency_hz[k] for k in kept],
            [self.amplitude[k] for k in kept],
        )


def crossing_of(spectra: Spectra) -> Crossing:
    """The two modes that describe a map best.

    Args:
        spectra: of the map, three or more.
    """
    few, fits = spectra.some(), []
    # either mode may follow the control, by a law with a square
    for tuned in (1, 2):
        model = _Model(few, tuned, 2)
        starts = sorted(model.starts(), key=model.squares)[:REFINED]
        fits.append((model, *min(map(model.fitted, starts), key=lambda each: each[1])))
    model, values, squares = min(fits, key=lambda each: each[2])
    # the square goes where a straight law leaves hardly more
    straight = replace(model, degree=1)
    fewer, left = straight.fitted(np.delete(values, 2))
    if left * BENT <= squares:
        model, values, squares = straight, fewer, left
    # the other mode follows, too, as long as one more power of its law is worth it
    rows = model.rows(values).size
    for other in range(1, MOST_POWERS + 1):
        if np.unique(few.control).size <= other + 1:
            break  # too few values of the control to determine that power
        further = replace(model, other=other)
        at = model.degree + 1 + other
        slopes = (0.0,) if other > 1 else (0.0, *(t * values[1] for t in OTHER_SLOPES))
        tried = [further.fitted(np.insert(values, at, slope)) for slope in slopes]
        best, left = min(tried, key=lambda each: each[1])
        if rows * (squares - left) < 3.0 * BEYOND_NOISE * left:
            break
        model, values, squares = further, best, left
    lone = _Model(few, 1, 2, alone=True)
    return model.crossing(values, squares, min(lone.fitted(start)[1] for start in lone.starts()))


@dataclass(frozen=True, eq=False)
class _Model:
    """The closed form over a map, as a function of values (degree + other + 5,).

    They are, in spans of the frequencies from their middle, the coefficients of the tuned mode
    (degree + 1) and of the other one (other + 1); logarithms of gap and both widths, in line
    widths. With ``alone`` there is no coupling: mode 1 is all that shows.
    """

    spectra: Spectra
    tuned: int
    degree: int
    other: int = 0
    alone: bool = False

    @cached_property
    def middle_hz(self) -> float:
        return 0.5 * sum(self.spectra.range_hz)

    @cached_property
    def span_hz(self) -> float:
        low, high = self.spectra.range_hz
        return high - low

    @cached_property
    def _flat(self) -> tuple[FloatArray, FloatArray, FloatArray, IntArray, IntArray]:
        """Frequencies, amplitudes over their largest, the control of all rows; starts, counts."""
        s = self.spectra
        counts = np.array([f.size for f in s.frequency_hz])
        sizes = [a / np.max(a) for a in s.amplitude]
        u, x = np.concatenate(s.frequency_hz), np.repeat(s.x, counts)
        return u, np.concatenate(sizes), x, np.cumsum(counts) - counts, counts

    def laws(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coefficients of the tuned mode and of the other one."""
        return values[: self.degree + 1], values[self.degree + 1 : self.degree + self.other + 2]

    def places_hz(self, values: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Frequencies of modes 1 and 2 at the control x, without coupling."""
        one, two = (
            np.asarray(self.middle_hz + self.span_hz * polyval(x, law), dtype=float)
            for law in self.laws(values)
        )
        return (one, two) if self.tuned == 1 else (two, one)

    def sizes_hz(self, values: FloatArray) -> tuple[float, float, float]:
        """Gap at the crossing and widths of modes 1 and 2."""
        unit = self.spectra.width_hz
        gap, one, two = (unit * math.exp(min(float(v), LARGEST)) for v in values[-3:])
        return (0.0 if self.alone else gap), one, two

    def rows(self, values: FloatArray) -> FloatArray:
        """What is left of all amplitudes, under a scale of each spectrum."""
        u, measured, x, starts, counts = self._flat
        gap, *widths = self.sizes_hz(values)
        square = (gap * self.middle_hz) ** 2
        made = np.abs(_response(u, self.places_hz(values, x), widths, square))
        made = made * self.middle_hz * self.spectra.width_hz
        power = np.add.reduceat(made**2, starts)
        scale = np.add.reduceat(made * measured, starts) / np.maximum(power, 1e-300)
        return np.asarray(np.repeat(scale, counts) * made - measured)

    def squares(self, values: FloatArray) -> float:
        rows = self.rows(values)
        return float(rows @ rows)

    def fitted(self, start: FloatArray) -> tuple[FloatArray, float]:
        """Values of the least sum of squares from a start, and that sum."""
        return minimise_squares(self.rows, start, rounds=ROUNDS, gain=1e-9)

    def starts(self) -> Iterator[FloatArray]:
        """Where a fit may begin, the tuned mode with a law of a square."""
        # lines and parabolas along the ridge
        s = self.spectra
        x, f = s.x, (s.ridge_hz - self.middle_hz) / self.span_hz
        pairs = [(i, j) for i, j in itertools.combinations(range(x.size), 2) if x[i] != x[j]]
        slope = float(np.median([(f[j] - f[i]) / (x[j] - x[i]) for i, j in pairs]))
        ridges = [np.array([float(np.median(f - slope * x)), slope, 0.0])]
        if np.unique(x).size > 3:
            ridges.append(polyfit(x, f, 2))
        if self.alone:
            yield from (np.array([*ridge, 0.0, 0.0, 0.0, 0.0]) for ridge in ridges)
            return
        gaps = [math.log(gap) for gap in GAPS if gap * s.width_hz < self.span_hz]
        still = float(np.median(s.ridge_hz) - self.middle_hz) / self.span_hz
        for place, gap in itertools.product(map(float, PLACES), gaps):
            if self.tuned == 1:
                # mode 1 follows the ridge or is steeper, and meets the other one at that place
                for ridge, steeper in itertools.product(ridges, STEEPER):
                    law = ridge * np.array([1.0, steeper, steeper])
                    yield np.array([*law, float(polyval(place, law)), gap, 0.0, 0.0])
                continue
            for slope, sign in itertools.product(SLOPES, (-1.0, 1.0)):
                law = np.array([still - sign * slope * place, sign * slope, 0.0])
                yield np.array([*law, still, gap, 0.0, 0.0])

    def crossing(self, values: FloatArray, squares: float, one: float) -> Crossing:
        """The same in Hz and in the control's own unit; sums of squares of both and of one mode."""
        s, rows = self.spectra, self._flat[0].size
        domain = [s.middle - s.half, s.middle + s.half]
        laws = []
        for scaled in self.laws(values):
            plain = np.polynomial.Polynomial(scaled, domain=domain).convert().coef
            law = np.zeros(scaled.size)
            law[: plain.size] = self.span_hz * np.asarray(plain, dtype=float)
            law[0] += self.middle_hz
            laws.append(tuple(float(c) for c in law))
        gap, d1, d2 = self.sizes_hz(values)
        # where both are closest, if that was measured
        x = np.linspace(-1.0, 1.0, 2001)
        f1, f2 = self.places_hz(values, x)
        k = int(np.argmin(np.abs(f1 - f2)))
        inside = 0 < k < x.size - 1
        is_better = squares < SECOND * one
        return Crossing(
            tuned=self.tuned,
            law=laws[0],
            other=laws[1],
            coupling_hz=math.sqrt(gap * self.middle_hz),
            widths_hz=(d1, d2),
            gap_hz=gap,
            place=s.middle + s.half * float(x[k]) if inside else None,
            left=math.sqrt(squares / rows),
            is_observed=is_better and rows * (one - squares) > 3.0 * BEYOND_NOISE * squares,
        )


def _response(
    u: FloatArray,
    places_hz: Sequence[FloatArray | float],
    widths_hz: Sequence[float],
    coupling: float,
) -> ComplexArray:
    """q1 (n,) at frequencies u (n,), Hz, of modes 1 and 2, to a factor; ``coupling`` is l^4."""
    one, two = ((f - u) * (f + u) + 1j * u * d for f, d in zip(places_hz, widths_hz, strict=True))
    return np.asarray(1.0 / (one - coupling / two))


def phases_of(
    crossing: Crossing, spectra: Spectra, values: Sequence[ComplexArray]
) -> tuple[bool, bool]:
    """Whether an instrument counts phases the other way, and whether a cable turns them.

    Args:
        crossing: as it was seen.
        spectra: its map.
        values: complex ones of every spectrum, (n,) each.
    """
    low, high = spectra.range_hz
    fewest = min(f.size for f in spectra.frequency_hz)
    turns = min(MOST_TURNS, fewest // 2) * STEPS
    delays = np.arange(-turns, turns + 1) / (STEPS * (high - low))
    # share of the squares that a gain of each spectrum takes, as they are and reversed, (2, delays)
    shares = np.zeros((2, delays.size))
    for control, f, observed in zip(spectra.control, spectra.frequency_hz, values, strict=True):
        places = [float(polyval(float(control), law)) for law in (crossing.law, crossing.other)]
        places = places if crossing.tuned == 1 else places[::-1]
        made = _response(f, places, crossing.widths_hz, crossing.coupling_hz**4)
        turning = np.exp(2j * np.pi * np.outer(delays, f - f[0]))
        power = np.sum(np.abs(made) ** 2) * np.sum(np.abs(observed) ** 2)
        for k, each in enumerate((observed, np.conj(observed))):
            shares[k] += np.abs(turning @ (each * np.conj(made))) ** 2 / power
    plain, reverse = 1.0 - shares / len(values)
    is_reversed = float(np.min(reverse)) < float(np.min(plain))
    left = reverse if is_reversed else plain
    return is_reversed, bool(np.min(left) < CABLE * left[turns])
