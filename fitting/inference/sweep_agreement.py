"""Do the peaks of a series and its sweep tell the same? The sweep, fitted with a scale of its own.

A sweep that only gives a scale is not among the rows of the fit; yet it shows a line. Its points
become rows, with a free scale c and their own scatter,

    r_k = (c A_k(p) - L_k)/max L

and with S the peaks, T the sweep,

    chi^2(S and T) - chi^2(S) - chi^2(T)

is the chi square of what both determine, where each is at its own minimum. A factor between their
amplitudes is fitted as well: sqrt 2 is a peak value taken for rms.
Source: M. Maltoni and T. Schwetz, Phys. Rev. D 68 (2003) 033020.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fitting.campaign.parameters import drift_square, inverse_priors, prior_sigmas, search_bounds
from fitting.fit.covariance import RowCovariance
from fitting.fit.differences import forward
from fitting.fit.noise import noise_of
from fitting.fit.objective import Point, evaluate_many
from fitting.fit.solution import Solution
from fitting.inference.consistency import BETTER_THAN_BOX
from fitting.inference.joint_result import CONTRADICT
from fitting.measurements.sweep import Sweep
from fitting.signal.chi_square import as_sigmas, tail
from fitting.signal.least_squares import damped_step
from fitting.signal.residual_tests import residual_structure
from fitting.signal.scale import laboratory_maximum
from fitting.signal.student import widening95
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure

#: Chi square over its degrees of freedom up to which a factor between them explains both.
EXPLAINED = 3.0
#: Relative scatter of a sweep's points, at least: simulations and rounding.
LEAST_SCATTER = 1e-5
#: Descents: first damping, rounds at most, chi square that is worth a step, precision (over that of
#: the box) from which a direction is followed, and logarithms of factors at most.
GENTLE, ROUNDS, PROMISE, LEAST_SEEN, LONGEST = 1e-6, 15, 1e-2, 1.0, 7.0
#: More parameters than this are not searched again: drift offsets of a long series.
MOST_PARAMETERS = 24


@dataclass(frozen=True, kw_only=True)
class SweepAgreement:
    """Peaks and sweep of one series: how far apart, and the factor that would explain it.

    `sigmas` is the distance in standard deviations of a normal distribution; `factor` multiplies
    the sweep's amplitudes, with `factor_std`; NaN where it would explain nothing.
    """

    series: str
    sigmas: float
    factor: float = math.nan
    factor_std: float = math.nan

    @property
    def contradicts(self) -> bool:
        """Whether no noise explains the difference."""
        return self.sigmas > CONTRADICT


def sweep_agreement(solution: Solution) -> tuple[SweepAgreement, ...]:
    """Every series whose peaks contradict its sweep, or agree with it.

    Args:
        solution: the end of a fit.
    """
    data = solution.objective.data
    found = []
    for place, sweep in enumerate(data.measurements):
        others = [m for m in data.measurements if m.series == sweep.series and not m.is_curve]
        if not isinstance(sweep, Sweep) or not any(m.rows for m in others):
            continue
        if len(solution.parameters) > MOST_PARAMETERS:
            continue
        if not data.scale_sigmas[data.series.index(sweep.series)] < 1.0:  # it is no scale at all
            continue
        try:
            told = _Both(solution, sweep, place).agreement()
        except (FmuFailure, np.linalg.LinAlgError):  # the model fails nearby: nothing is said
            continue
        if told is not None:
            found.append(told)
    return tuple(found)


def explained_by_model(solution: Solution, series: str) -> bool:
    """Whether the model leaves noise of a sweep where it is fitted to the peaks beside it.

    A single line has to take a second mode for a background.

    Args:
        solution: the end of a fit.
        series: of the sweep and of the peaks.
    """
    data = solution.objective.data
    if len(solution.parameters) > MOST_PARAMETERS:
        return False
    for place, sweep in enumerate(data.measurements):
        if isinstance(sweep, Sweep) and sweep.series == series:
            try:
                return _Both(solution, sweep, place).leaves_noise()
            except (FmuFailure, np.linalg.LinAlgError):  # the model fails nearby
                return False
    return False


@dataclass(frozen=True)
class _Expansion:
    """Peaks and sweep about x: relative rows of the peaks, c A/max L of the sweep, their slopes."""

    x: FloatArray
    peaks: FloatArray
    peaks_slope: FloatArray
    swept: FloatArray
    swept_slope: FloatArray


@dataclass(frozen=True)
class _End:
    """End of a descent: x, ln c, ln factor, the rows and their slopes there."""

    y: FloatArray
    rows: FloatArray
    matrix: FloatArray

    @property
    def chi_square(self) -> float:
        return float(self.rows @ self.rows)


class _Both:
    """Whitened rows of the peaks of a series and of its sweep at y = (x, ln c, ln factor)."""

    def __init__(self, solution: Solution, sweep: Sweep, place: int) -> None:
        self.solution, self.sweep, self.place = solution, sweep, place
        data = solution.objective.data
        rows = np.arange(solution.final.residuals.size)
        series = data.series.index(sweep.series)
        mine = data.series_of_rows == series
        self.peaks = mine & (rows < data.curve_rows.start)
        self.measured = data.measured_rows[self.peaks]
        # peaks of an unknown gain know no factor
        self.factor = "F" if np.any(self.measured) else ""
        noise = noise_of(solution.objective, solution.final)
        sigma = noise.sigma[self.peaks]
        # the error of the scale moves all peaks together as they were measured, not as a fit has
        # them that a contradiction has bent
        common = data.scale_sigmas[series] * self.measured
        own = RowCovariance(sigma, common[:, np.newaxis])
        self.covariance = own.loosened(noise.bounded.restricted(self.peaks))
        self.bounds = search_bounds(solution.parameters)
        self.prior = prior_sigmas(solution.parameters)
        self.held = inverse_priors(solution.parameters)
        self.scatter = LEAST_SCATTER
        # the scale rests on what the top shows of the noise, where nobody states it
        top = laboratory_maximum(sweep.frequency_hz, sweep.amplitude_v)
        self.freedom = math.inf if sweep.known else top.freedom
        self._known: dict[bytes, _Expansion] = {}

    def agreement(self) -> SweepAgreement | None:
        """The test; None where they agree at once, or one tells nothing to contradict the other."""
        begin = np.append(self.solution.final.x, [0.0, 0.0])
        if self._could_gain(begin) < CONTRADICT**2:
            return None
        swept = self._least("T", begin)
        determined = self._rank(swept)
        freedom = self.sweep.amplitude_v.size - determined - 1
        if freedom < 3:
            return None
        self.scatter = self._scatter(swept, freedom)
        swept, peaks = self._least("T", swept.y), self._least("S", begin)
        shared = determined + self._rank(peaks) - self._rank(self._at("ST", begin))
        if shared < 1:
            return None
        both = self._least("ST", begin, swept.y)
        if self.factor:
            joined = self._least("STF", both.y, swept.y)
            # what a factor led to may be lower without it, too
            without = np.append(joined.y[:-1], 0.0)
            both = min((both, self._descend("ST", without)), key=lambda end: end.chi_square)
            told = self._told_by_factor(both, joined)
            if told is not None:
                return told
        excess = max(1.0, peaks.chi_square / max(1, peaks.rows.size - self._rank(peaks)))
        apart = both.chi_square - swept.chi_square - peaks.chi_square - self._by_priors(both, peaks)
        sigmas = _sigmas(apart / excess, shared, self.freedom)
        return SweepAgreement(series=self.sweep.series, sigmas=sigmas)

    def leaves_noise(self) -> bool:
        """Whether the sweep's residuals are white where peaks and sweep are fitted together."""
        begin = np.append(self.solution.final.x, [0.0, 0.0])
        swept = self._least("T", begin)
        self.scatter = self._scatter(swept, max(1, swept.rows.size - self._rank(swept) - 1))
        both = self._least("ST", begin, swept.y)
        own = slice(-self.sweep.amplitude_v.size, None)
        return residual_structure(both.rows[own], both.matrix[own]).order == 0

    def _could_gain(self, begin: FloatArray) -> float:
        """Chi square by which sweep, and peaks with a factor, would each fit better elsewhere.

        One step foresees it, from where both stand; what they contradict each other by is no more.
        """
        swept, peaks = self._at("T", begin), self._at(f"S{self.factor}", begin)
        (gain, left), (more, _) = self._foreseen(swept), self._foreseen(peaks)
        freedom = max(1, swept.rows.size - self._rank(swept) - 1)
        return gain / max(1.0, left / freedom) + more

    def _foreseen(self, here: _End) -> tuple[float, float]:
        """Decrease of chi square by a step, were the model straight; and what would be left."""
        units = np.append(self.prior, [1.0, 1.0])
        step = damped_step(here.matrix * units, here.rows, GENTLE, least=LEAST_SEEN)
        left = here.rows + here.matrix @ (units * step)
        square = float(left @ left)
        return here.chi_square - square, square

    def _told_by_factor(self, both: _End, joined: _End) -> SweepAgreement | None:
        """A factor between their amplitudes that makes both fit; None where it gains nothing."""
        excess = max(1.0, joined.chi_square / max(1, joined.rows.size - self._rank(joined) - 2))
        gained = both.chi_square - joined.chi_square - self._by_priors(both, joined)
        sigmas = _sigmas(gained / excess, 1, self.freedom)
        if not (sigmas > CONTRADICT and excess < EXPLAINED):
            return None
        factor = math.exp(float(joined.y[-1]))
        std = factor * math.sqrt(excess * float(self._covariance(joined)[-1, -1]))
        return SweepAgreement(
            series=self.sweep.series, sigmas=sigmas, factor=factor, factor_std=std
        )

    def _by_priors(self, one: _End, other: _End) -> float:
        """Chi square that priors of what drifts have more at one end: no data contradict there."""
        parameters = self.solution.parameters
        more = drift_square(parameters, one.y[:-2]) - drift_square(parameters, other.y[:-2])
        return max(0.0, more)

    def _least(self, parts: str, *begun: FloatArray) -> _End:
        """The lowest end of descents from some points.

        `parts`: S the peaks, T the sweep, F with a factor between them.
        """
        return min((self._descend(parts, y) for y in begun), key=lambda end: end.chi_square)

    def _descend(self, parts: str, begin: FloatArray) -> _End:
        here, damping = self._at(parts, begin), GENTLE
        room = (np.append(self.bounds[0], [-LONGEST] * 2), np.append(self.bounds[1], [LONGEST] * 2))
        units = np.append(self.prior, [1.0, 1.0])
        for _ in range(ROUNDS):
            low = np.maximum((room[0] - here.y) / units, -1.0)
            high = np.minimum((room[1] - here.y) / units, 1.0)
            step = damped_step(here.matrix * units, here.rows, damping, (low, high), LEAST_SEEN)
            left = here.rows + here.matrix @ (units * step)
            if here.chi_square - float(left @ left) < PROMISE:
                return here
            there = self._at(parts, here.y + units * step)
            if there.chi_square < here.chi_square:
                here, damping = there, max(GENTLE, 0.1 * damping)
            else:
                damping = max(100.0 * damping, 1.0)
        return here

    def _at(self, parts: str, y: FloatArray) -> _End:
        x, scale, factor = y[:-2], float(y[-2]), float(y[-1])
        known = self._expansion(x)
        rows, matrices = [], []
        if "S" in parts:
            values = math.exp(-factor) * (known.peaks + self.measured)
            slope = math.exp(-factor) * known.peaks_slope
            free = -values if "F" in parts else np.zeros(values.size)
            columns = np.column_stack([slope, np.zeros(values.size), free])
            held = self.held > 0.0
            rows += [self.covariance.whitened(values - self.measured), (self.held * x)[held]]
            priors = np.pad(np.diag(self.held)[held], ((0, 0), (0, 2)))
            matrices += [self.covariance.whitened(columns), priors]
        if "T" in parts:
            values = math.exp(scale) * known.swept
            slope = math.exp(scale) * known.swept_slope
            measured = self.sweep.amplitude_v / self.sweep.maximum_v
            rows.append((values - measured) / self.scatter)
            columns = np.column_stack([slope, values, np.zeros(values.size)])
            matrices.append(columns / self.scatter)
        return _End(y, np.concatenate(rows), np.concatenate(matrices))

    def _expansion(self, x: FloatArray) -> _Expansion:
        """Peaks and sweep at x with their slopes, one batch; remembered."""
        key = x.tobytes()
        if key not in self._known:
            around = forward(x, self.solution.objective.steps, self.bounds[1])
            points = evaluate_many(self.solution.objective, around.nodes, whole=True)
            peaks = [point.residuals[self.peaks] for point in points]
            swept = [self._shape(point) for point in points]
            self._known[key] = _Expansion(
                x, peaks[0], around.quotients(peaks), swept[0], around.quotients(swept)
            )
        return self._known[key]

    def _shape(self, point: Point) -> FloatArray:
        return np.asarray(point.scaled[self.place] / self.sweep.maximum_v, dtype=float)

    def _scatter(self, end: _End, freedom: int) -> float:
        """Scatter of the sweep's points about their own minimum, wider if correlated."""
        scatter = self.scatter * math.sqrt(end.chi_square / freedom)
        if self.sweep.known:
            scatter = max(scatter, float(np.median(self.sweep.sigmas_v)) / self.sweep.maximum_v)
        return max(LEAST_SCATTER, scatter * residual_structure(end.rows, end.matrix).widening)

    def _rank(self, end: _End) -> int:
        """How many combinations of the parameters the rows of an end determine."""
        matrix = end.matrix[:, :-2] * self.prior
        free = end.matrix[:, -2:]
        seen = np.linalg.norm(free, axis=0) > 0.0
        if np.any(seen):  # what a free scale takes away
            basis, _ = np.linalg.qr(free[:, seen])
            matrix = matrix - basis @ (basis.T @ matrix)
        return int(np.sum(np.linalg.svd(matrix, compute_uv=False) > BETTER_THAN_BOX))

    def _covariance(self, end: _End) -> FloatArray:
        units = np.append(self.prior, [1.0, 1.0])
        inverse = np.linalg.pinv(end.matrix * units, rcond=1e-10)
        return np.asarray((units[:, np.newaxis] * (inverse @ inverse.T)) * units)


def _sigmas(chi_square: float, freedom: int, noise_freedom: float) -> float:
    """A chi square as standard deviations of a normal distribution, of noise told by few points.

    The error of the scale counts for as wide as Student's t is at 95 %: taken back for all of it.
    """
    value = max(0.0, chi_square) * widening95(noise_freedom) ** 2
    return as_sigmas(value, tail(value, freedom, noise_freedom))
