"""Lines in a power spectral density, by the likelihood that averages of periodograms have.

    S(f) = sum_k a_k L_k(f) + b               modes with forces of their own, as heat has them
    S(f) = |sum_k h_k g_k(f)|^2 + b           modes under one force, h_k of either sign
    S(f) = -a Im chi(f)/f + b                 coupled modes in heat, of which the first is seen
    chi = D2/(D1 D2 - K^2),   D_k = f_k^2 - f^2 + i f w_k

g of `fitting.signal.peaks.mode_response`, L = |g|^2, one at the top of its line. The last is the
first where both widths are alike; its lines are the roots of D1 D2 = K^2. An average of M
periodograms scatters by its own size over sqrt(M); with an M that nobody told least is

    D = sum 2 (P/S - 1 - ln(P/S)),      M = (n - k)/D

of n densities P and k unknowns. Sources: P. Whittle, Ark. Mat. 2 (1953) 423; D. Percival and
A. Walden, Spectral Analysis for Physical Applications (1993), section 4.7.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtrc

from fitting.signal.least_squares import LeastSquaresFit, minimise_squares
from fitting.signal.peaks import mode_response
from fitting.text.arrays import FloatArray

#: How two modes may be moved: heat, each by itself, or one force, or heat with a coupling.
OWN, TOGETHER, COUPLED = "own", "together", "coupled"
#: Gain in chi square from which a way in which modes are moved is told from forces of their own.
PLAINLY = 10.0
#: Points that are averaged where a line is looked for.
SMOOTHED = 5
#: Widths over the spacing of the points, logarithms, with which a line begins.
BEGINS = (1.0, 2.0, 3.0, 4.0)
#: Smallest density over the largest one that is told from zero, and of the floor.
LEAST = 1e-12
#: Probability below which chance does not explain what a further line gains.
BY_CHANCE = 1e-3
#: How far apart two lines are at least, over the sum of their widths.
APART = 0.2
#: Logarithms of sizes stay within.
LARGEST = 60.0
#: Evaluations of a fit at most, and relative fall that ends it.
ROUNDS, GAIN = 100, 1e-9
#: Step of an unknown that the density does not tell.
SMALL = 1e-3
#: Unknowns of each line.
OF_A_LINE = 3


@dataclass(frozen=True, kw_only=True)
class NoiseLines:
    """Lines of a density, the lowest frequency first: frequencies and full widths, Hz, and errors.

    `height` of each is its density at its frequency, in the unit of the density; of `TOGETHER`
    that of the second is negative where it answers against the first. `power` is that of each line
    over all frequencies, pi/2 times height times width, with errors; none of lines that are moved
    in another way than each by itself. `floor` is that of the density, `deviance` D, `points` n,
    `slopes` (n, k) the derivatives of ln S by what was fitted. `kind` is how two modes are moved,
    `plainly` whether the density tells that; else each has a force of its own. `modes` are
    frequency and width, Hz, of the seen mode and of the other one by themselves, then the root of
    K, Hz, where they are `COUPLED`.
    """

    frequency_hz: tuple[float, ...]
    frequency_std_hz: tuple[float, ...]
    width_hz: tuple[float, ...]
    width_std_hz: tuple[float, ...]
    height: tuple[float, ...]
    floor: float
    kind: str
    deviance: float
    points: int
    curve: FloatArray
    slopes: FloatArray
    power: tuple[float, ...] = ()
    power_std: tuple[float, ...] = ()
    plainly: bool = True
    modes: tuple[float, ...] = ()

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
        if found is None or not (
            _are_lines(found, frequency_hz) and _gains(before, unknowns, found)
        ):
            break
        best, before, unknowns = found, found.deviance, found.unknowns
    return None if best is None else _in_unit(best, float(np.max(density)))


def _in_unit(found: NoiseLines, unit: float) -> NoiseLines:
    return replace(
        found,
        height=tuple(unit * height for height in found.height),
        power=tuple(unit * power for power in found.power),
        power_std=tuple(unit * std for std in found.power_std),
        floor=unit * found.floor,
        curve=unit * found.curve,
    )


def _gains(before: float, unknowns: int, found: NoiseLines) -> bool:
    """Whether chance does not explain what a further line gains, at any of the points."""
    more, freedom = found.unknowns - unknowns, found.points - found.unknowns
    if freedom < 1:
        return False
    gain = max(0.0, before / max(found.deviance, LEAST) - 1.0) * freedom / more
    return found.points * float(fdtrc(more, freedom, gain)) < BY_CHANCE


def _are_lines(found: NoiseLines, f: FloatArray) -> bool:
    """Whether two lines stand apart, and neither is a single point.

    Of one line that is no Lorentzian curve two together make more.
    """
    if len(found.frequency_hz) < 2:
        return True
    apart = found.frequency_hz[1] - found.frequency_hz[0] > APART * sum(found.width_hz)
    return apart and min(found.width_hz) > float(np.median(np.diff(f)))


def _closest(
    f: FloatArray, y: FloatArray, fewer: NoiseLines | None, count: int
) -> NoiseLines | None:
    """So many lines that leave least: with forces of their own, or moved in another way."""
    best = _Fit(f, y).lowest(_further(f, y, fewer))
    if best is None or count == 1:
        return best
    begin = _x_of(f, best)
    tried = [_Fit(f, y, TOGETHER, sign).lowest([begin]) for sign in (1.0, -1.0)]
    tried.append(_Fit(f, y, COUPLED).lowest(_coupled(begin)))
    others = sorted(filter(None, tried), key=lambda each: each.deviance)
    others = [each for each in others if f[0] < each.frequency_hz[0] < each.frequency_hz[1] < f[-1]]
    if not others:
        return best
    unit = min(best.deviance, others[0].deviance) / max(1, best.points - best.unknowns)
    gains = {each.kind: (best.deviance - each.deviance) / max(unit, LEAST) for each in others[::-1]}
    if gains[others[0].kind] > PLAINLY:
        return others[0]
    return replace(best, plainly=gains.get(TOGETHER, -math.inf) < -PLAINLY)


def _coupled(x: FloatArray) -> list[FloatArray]:
    """Where fits of coupled modes begin: from both lines, whichever of the modes is seen.

    Strengths r of lines go with height times width, their sum is that of the seen mode: the other
    one stands at z = (r1 p2 + r2 p1)/(r1 + r2), and k^2 = (p1 - z)(z - p2) over (2 f0)^2.
    """
    (u1, wide1, size1), (u2, wide2, size2) = x[:-1].reshape(2, OF_A_LINE)
    r1, r2 = (_power(each) for each in (size1 + wide1, size2 + wide2))
    share = r1 / (r1 + r2)
    w1, w2 = _power(wide1), _power(wide2)
    k = math.sqrt(share * (1.0 - share)) * math.hypot(u2 - u1, 0.5 * (w2 - w1))
    own, other = share, 1.0 - share
    seen = (own * u1 + other * u2, math.log(own * w1 + other * w2), max(size1, size2))
    unseen = own * u2 + other * u1
    widths = {own * w2 + other * w1, 0.3 * min(w1, w2)}
    return [np.array([*seen, unseen, math.log(wide), k, x[-1]]) for wide in widths]


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

    Frequencies and widths stay among the points. Of coupled modes K over 2 f0 and the spacing takes
    the place of the second height.
    """

    def __init__(self, f: FloatArray, y: FloatArray, kind: str = OWN, sign: float = 1.0) -> None:
        self.f, self.y, self.kind, self.sign = f, y, kind, sign
        self.spacing = float(np.median(np.diff(f)))
        self.ends = float(f[0]), float(f[-1])

    def lines(self, x: FloatArray) -> list[tuple[float, float, float]]:
        """Frequency and width, Hz, and third number of each line."""
        low, high = self.ends
        return [
            (
                _within(low + self.spacing * shift, low, high),
                _within(self.spacing * _power(wide), 0.2 * self.spacing, high - low),
                third,
            )
            for shift, wide, third in x[:-1].reshape(-1, OF_A_LINE).tolist()
        ]

    def curve(self, x: FloatArray) -> FloatArray:
        """S at x, (n,)."""
        floor = _power(float(x[-1]))
        if self.kind == COUPLED:
            return np.asarray(self.in_heat(x) + floor)
        parts = [(mode_response(self.f, f, w), _power(a)) for f, w, a in self.lines(x)]
        if self.kind == OWN:
            return np.asarray(np.sum([a * np.abs(g) ** 2 for g, a in parts], axis=0) + floor)
        (one, a), (two, b) = parts
        return np.asarray(np.abs(math.sqrt(a) * one + self.sign * math.sqrt(b) * two) ** 2 + floor)

    def in_heat(self, x: FloatArray) -> FloatArray:
        """Of coupled modes, as high as the seen one would be by itself, (n,)."""
        (f1, w1, size), (f2, w2, _) = self.lines(x)
        one, two = (f0**2 - self.f**2 + 1j * self.f * w for f0, w in ((f1, w1), (f2, w2)))
        chi = two / (one * two - self.coupling(x) ** 2)
        return np.asarray(-chi.imag / self.f * f1**2 * w1 * _power(size))

    def coupling(self, x: FloatArray) -> float:
        """K at x, Hz^2."""
        return 2.0 * float(np.mean(self.f)) * self.spacing * float(x[5])

    def places(self, x: FloatArray) -> FloatArray:
        """Frequencies of the lines at x, the lowest first, then their widths, Hz."""
        modes = [(f, w) for f, w, _ in self.lines(x)]
        if self.kind == COUPLED:
            both = np.polymul(*([-1.0, 1j * w, f * f] for f, w in modes))
            both[-1] -= self.coupling(x) ** 2
            roots = sorted(np.roots(both), key=lambda root: float(root.real))[-2:]
            modes = [(float(abs(p)), float(2.0 * p.imag)) for p in roots]
        return np.array(sorted(modes)).T.ravel()

    def slopes(self, x: FloatArray) -> FloatArray:
        """Derivatives of ln S by x, (n, k)."""
        ends = [(self.curve(x + step), self.curve(x - step)) for step in SMALL * np.eye(x.size)]
        return np.transpose([np.log(up / down) / (2.0 * SMALL) for up, down in ends])

    def powers(self, x: FloatArray) -> FloatArray:
        """Of lines with forces of their own over all frequencies at x, the lowest line first."""
        lines = sorted(self.lines(x))
        return np.array([0.5 * math.pi * width * _power(size) for _, width, size in lines])

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
        return None if best is None else self.result(best)

    def result(self, fit: LeastSquaresFit) -> NoiseLines:
        """The lines at the end of a fit."""
        x, places, curve = fit.values, self.places(fit.values), self.curve(fit.values)
        f, w = places.reshape(2, -1)
        f_std, w_std = self.errors(fit, self.places).reshape(2, -1)
        heights = [_power(a) for _, _, a in sorted(self.lines(x))]
        modes: tuple[float, ...] = ()
        power, power_std = np.empty(0), np.empty(0)
        if self.kind == OWN:
            power, power_std = self.powers(x), self.errors(fit, self.powers)
        if self.kind == COUPLED:
            heights = np.interp(f, self.f, curve).tolist()
            modes = (*self.lines(x)[0][:2], *self.lines(x)[1][:2], math.sqrt(abs(self.coupling(x))))
        if self.kind == TOGETHER:
            heights[-1] *= self.sign
        return NoiseLines(
            frequency_hz=tuple(f.tolist()),
            frequency_std_hz=tuple(f_std.tolist()),
            width_hz=tuple(w.tolist()),
            width_std_hz=tuple(w_std.tolist()),
            height=tuple(heights),
            floor=_power(float(x[-1])),
            kind=self.kind,
            deviance=float(fit.residuals @ fit.residuals),
            points=self.y.size,
            curve=curve,
            slopes=self.slopes(x),
            power=tuple(power.tolist()),
            power_std=tuple(power_std.tolist()),
            modes=modes,
        )

    def errors(self, fit: LeastSquaresFit, of: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """Errors of numbers of the lines, by slopes over a hundredth of an error."""
        spread = np.array(fit.covariance)
        unseen = ~np.isfinite(np.diag(spread))
        spread[unseen, :] = spread[:, unseen] = 0.0
        steps = np.where(unseen, SMALL, 0.01 * np.sqrt(np.maximum(np.diag(spread), LEAST)))
        slopes = np.transpose(
            [
                (of(fit.values + step) - of(fit.values - step)) / (2.0 * step[k])
                for k, step in enumerate(np.diag(steps))
            ]
        )
        errors = np.sqrt(np.maximum(np.diag(slopes @ spread @ slopes.T), 0.0))
        errors[np.any(slopes[:, unseen] != 0.0, axis=1)] = np.inf
        return np.asarray(errors)


def _power(logarithm: float) -> float:
    return math.exp(_within(logarithm, -LARGEST, LARGEST))


def _within(number: float, low: float, high: float) -> float:
    """As numpy's clip, which takes ten times as long for a single number; nan stays nan."""
    return min(max(number, low), high)


def _deviances(y: FloatArray, s: FloatArray) -> FloatArray:
    """P/S - 1 - ln(P/S), (n,)."""
    ratio = y / s
    return np.asarray(np.maximum(ratio - 1.0 - np.log(ratio), 0.0))
