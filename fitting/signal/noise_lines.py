"""Lines in a power spectral density, by the likelihood that averages of periodograms have.

    S(f) = sum_k a_k L_k(f) + b               modes with forces of their own, as heat has them
    S(f) = |sum_k h_k g_k(f)|^2 + b           modes under one force, h_k of either sign

g of `fitting.signal.peaks.mode_response`, L = |g|^2, one at the top of its line. An average of M
periodograms scatters by its own size over sqrt(M); with an M that nobody told least is

    D = sum 2 (P/S - 1 - ln(P/S)),      M = (n - k)/D

of n densities P and k unknowns. Sources: P. Whittle, Ark. Mat. 2 (1953) 423; D. Percival and
A. Walden, Spectral Analysis for Physical Applications (1993), section 4.7.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtrc

from fitting.signal.least_squares import LeastSquaresFit, minimise_squares
from fitting.signal.peaks import mode_response
from fitting.text.arrays import FloatArray

#: Gain in chi square from which a force on both modes is told, or forces of their own are.
PLAINLY = 10.0
#: Points that are averaged where a line is looked for.
SMOOTHED = 5
#: Widths over the spacing of the points, logarithms, with which a line begins.
BEGINS = (1.0, 2.0, 3.0, 4.0)
#: Smallest density over the largest one that is told from zero, and of the floor.
LEAST = 1e-12
#: Probability below which chance does not explain what a further line gains.
BY_CHANCE = 1e-4
#: How far apart two lines are at least, over the sum of their widths.
APART = 0.2
#: Logarithms of sizes stay within.
LARGEST = 60.0
#: Evaluations of a fit at most, and relative fall that ends it.
ROUNDS, GAIN = 100, 1e-9
#: Unknowns of each line.
OF_A_LINE = 3


@dataclass(frozen=True, kw_only=True)
class NoiseLines:
    """Lines of a density, the lowest frequency first: frequencies and full widths, Hz, and errors.

    `height` of each is its density at its frequency, in the unit of the density; of `together`,
    modes under one force, that of the second is negative where it answers against the first.
    `floor` is that of the density, `deviance` D, `points` n. `plainly`: whether the density tells
    that two modes are, or are not, `together`; else they are taken not to be.
    """

    frequency_hz: tuple[float, ...]
    frequency_std_hz: tuple[float, ...]
    width_hz: tuple[float, ...]
    width_std_hz: tuple[float, ...]
    height: tuple[float, ...]
    floor: float
    together: bool
    deviance: float
    points: int
    curve: FloatArray
    plainly: bool = True

    @property
    def unknowns(self) -> int:
        """How many numbers were fitted."""
        return OF_A_LINE * len(self.frequency_hz) + 1

    @property
    def averages(self) -> float:
        """M: how many averaged periodograms scatter so."""
        return max(1, self.points - self.unknowns) / max(self.deviance, LEAST)


def noise_lines(frequency_hz: FloatArray, density: FloatArray) -> NoiseLines | None:
    """As many lines as a density shows, two at most; None where it shows none.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        density: shape (n,), zero or more, in any unit.
    """
    y = np.maximum(density / float(np.max(density)), LEAST)
    flat = float(np.sum(2.0 * _deviances(y, np.full(y.size, np.mean(y)))))
    best: NoiseLines | None = None
    before, unknowns = flat, 1
    for count in (1, 2):
        found = _closest(frequency_hz, y, best, count)
        if found is None or not _gains(before, unknowns, found):
            break
        best, before, unknowns = found, found.deviance, found.unknowns
    return None if best is None else _in_unit(best, float(np.max(density)))


def _in_unit(found: NoiseLines, unit: float) -> NoiseLines:
    return replace(
        found,
        height=tuple(unit * height for height in found.height),
        floor=unit * found.floor,
        curve=unit * found.curve,
    )


def _gains(before: float, unknowns: int, found: NoiseLines) -> bool:
    """Whether chance does not explain what a further line gains, at any of the points."""
    more, freedom = found.unknowns - unknowns, found.points - found.unknowns
    if freedom < 1 or not _is_seen(found):
        return False
    gain = max(0.0, before / max(found.deviance, LEAST) - 1.0) * freedom / more
    return found.points * float(fdtrc(more, freedom, gain)) < BY_CHANCE


def _is_seen(found: NoiseLines) -> bool:
    """Whether two lines stand apart: of one that is no Lorentzian curve two together make more."""
    if len(found.frequency_hz) < 2:
        return True
    return found.frequency_hz[1] - found.frequency_hz[0] > APART * sum(found.width_hz)


def _closest(
    f: FloatArray, y: FloatArray, fewer: NoiseLines | None, count: int
) -> NoiseLines | None:
    """So many lines that leave least: with forces of their own, or under one, of either sign."""
    best = _Fit(f, y, count).lowest(_further(f, y, fewer))
    if best is None or count == 1:
        return best
    begin = [_x_of(f, best)]
    signs = (_Fit(f, y, count, together=True, sign=sign).lowest(begin) for sign in (1.0, -1.0))
    other = min(filter(None, signs), key=lambda each: each.deviance, default=None)
    if other is None:
        return best
    unit = min(best.deviance, other.deviance) / max(1, best.points - best.unknowns)
    gain = (best.deviance - other.deviance) / max(unit, LEAST)
    if gain > PLAINLY:
        return other
    return replace(best, plainly=gain < -PLAINLY)


def _x_of(f: FloatArray, lines: NoiseLines) -> FloatArray:
    """Where a fit stands that has these lines."""
    spacing = float(np.median(np.diff(f)))
    each = zip(lines.frequency_hz, lines.width_hz, lines.height, strict=True)
    x = [((u - f[0]) / spacing, math.log(w / spacing), math.log(abs(a))) for u, w, a in each]
    return np.array([*np.ravel(x), math.log(max(lines.floor, LEAST))])


def _further(f: FloatArray, y: FloatArray, fewer: NoiseLines | None) -> list[FloatArray]:
    """Where fits with one line more begin: where what the fewer leave is largest."""
    size = min(SMOOTHED, y.size)
    smooth = np.convolve(y, np.ones(size) / size, mode="same")
    known = np.array([math.log(max(float(np.quantile(y, 0.1)), LEAST))])
    rest = smooth
    if fewer is not None:
        known = _x_of(f, fewer)
        rest = np.convolve(y / np.maximum(fewer.curve, LEAST), np.ones(size) / size, mode="same")
    at = int(np.argmax(rest))
    place = float((f[at] - f[0]) / np.median(np.diff(f)))
    top = math.log(max(float(smooth[at]), LEAST))
    return [np.array([*known[:-1], place, wide, top, known[-1]]) for wide in BEGINS]


class _Fit:
    """Shift over the spacing, logarithms of width over it and of the height, of each line; floor.

    Frequencies and widths stay among the points.
    """

    def __init__(
        self,
        f: FloatArray,
        y: FloatArray,
        count: int,
        *,
        together: bool = False,
        sign: float = 1.0,
    ) -> None:
        self.f, self.y, self.count = f, y, count
        self.together, self.sign = together, sign
        self.spacing = float(np.median(np.diff(f)))

    def lines(self, x: FloatArray) -> list[tuple[float, float, float]]:
        """Frequency and width, Hz, and height of each line."""
        each = x[:-1].reshape(-1, OF_A_LINE)
        return [
            (
                float(np.clip(self.f[0] + self.spacing * shift, self.f[0], self.f[-1])),
                float(np.clip(self.spacing * _power(wide), 0.2 * self.spacing, np.ptp(self.f))),
                _power(size),
            )
            for shift, wide, size in each
        ]

    def curve(self, x: FloatArray) -> FloatArray:
        """S at x, (n,)."""
        parts = [(mode_response(self.f, f, w), a) for f, w, a in self.lines(x)]
        if not self.together:
            power = np.sum([a * np.abs(g) ** 2 for g, a in parts], axis=0)
        else:
            signs = (1.0, self.sign)
            seen = [s * math.sqrt(a) * g for (g, a), s in zip(parts, signs, strict=False)]
            power = np.abs(np.sum(seen, axis=0)) ** 2
        return np.asarray(power + _power(float(x[-1])))

    def rows(self, x: FloatArray) -> FloatArray:
        """Signed roots of the deviances at x, (n,)."""
        s = np.maximum(self.curve(x), LEAST)
        return np.asarray(np.sign(self.y - s) * np.sqrt(2.0 * _deviances(self.y, s)))

    def lowest(self, begins: Sequence[FloatArray]) -> NoiseLines | None:
        """The lines of least deviance, from where fits begin; None where there is no fit."""
        ends = []
        for begin in begins:
            with contextlib.suppress(ValueError, np.linalg.LinAlgError):
                ends.append(minimise_squares(self.rows, begin, rounds=ROUNDS, gain=GAIN))
        known = [end for end in ends if np.all(np.isfinite(end.residuals))]
        best = min(known, key=lambda end: float(np.sum(end.residuals**2)), default=None)
        return None if best is None else self.told(best)

    def told(self, fit: LeastSquaresFit) -> NoiseLines:
        """The lines at the end of a fit."""
        errors = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))[:-1].reshape(-1, OF_A_LINE)
        signs = (1.0, self.sign if self.together else 1.0)
        pairs = zip(self.lines(fit.values), errors, signs, strict=False)
        each = sorted(
            (f, w, s * a, self.spacing * float(e[0]), w * float(e[1])) for (f, w, a), e, s in pairs
        )
        against = min(line[2] for line in each) < 0.0
        heights = [abs(line[2]) for line in each]
        if against:  # the sign is that of the second one against the first
            heights[-1] = -heights[-1]
        return NoiseLines(
            frequency_hz=tuple(line[0] for line in each),
            frequency_std_hz=tuple(line[3] for line in each),
            width_hz=tuple(line[1] for line in each),
            width_std_hz=tuple(line[4] for line in each),
            height=tuple(heights),
            floor=_power(float(fit.values[-1])),
            together=self.together,
            deviance=float(fit.residuals @ fit.residuals),
            points=self.y.size,
            curve=self.curve(fit.values),
        )


def _power(logarithm: float) -> float:
    return math.exp(float(np.clip(logarithm, -LARGEST, LARGEST)))


def _deviances(y: FloatArray, s: FloatArray) -> FloatArray:
    """P/S - 1 - ln(P/S), (n,)."""
    ratio = y / s
    return np.asarray(np.maximum(ratio - 1.0 - np.log(ratio), 0.0))
