"""Whether campaigns that were fitted together agree, and the peaks of a series with its sweep.

Of campaigns, by generalised least squares at the joint solution,

    chi^2(S) = min_d |rho_S + W_S d|^2        W = V^-1/2 dr/dx,  rho = V^-1/2 r, rows of campaigns S

Only directions that the data of S determine better than the bounds take part: along the others the
rows are curved and nothing is known. What the sets A and B both determine is then tested by

    chi^2(A and B) - chi^2(A) - chi^2(B)  ~  chi^2 with  rank(A) + rank(B) - rank(A and B)

degrees of freedom, the chi square of the difference of their common numbers.

A sweep that only gives a scale is not among the rows of the fit; yet it shows a line. Its points
become rows, with a free scale c and their own scatter,

    r_k = (c A_k(p) - L_k)/max L

and with S the peaks, T the sweep,

    chi^2(S and T) - chi^2(S) - chi^2(T)

is the chi square of what both determine, where each is at its own minimum. A factor between their
amplitudes is fitted as well: sqrt 2 is a peak value taken for rms.

Source: the parameter goodness of fit of M. Maltoni and T. Schwetz, Phys. Rev. D 68 (2003) 033020.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np

from fitting.campaign.joint import is_shared
from fitting.campaign.parameters import drift_square, inverse_priors, prior_sigmas, search_bounds
from fitting.fit.covariance import RowCovariance
from fitting.fit.fit import Solution
from fitting.fit.levenberg import Expansion, Goal, minimise
from fitting.fit.likelihood import Request, Sample, Space
from fitting.fit.linearisation import DETERMINED, Linearisation, Minimum, joined
from fitting.fit.noise import noise_of
from fitting.fit.objective import evaluate_many, forward
from fitting.fit.problem import Problem
from fitting.inference.estimates import Outputs
from fitting.inference.likelihood.knowledge import (
    CONTRADICT,
    WORTH_A_WARNING,
    JointResult,
    PairTest,
    SeriesPart,
    ValueAlone,
)
from fitting.measurements.sweep import Sweep
from fitting.signal.least_squares import damped_step
from fitting.signal.misfit import excess_share
from fitting.signal.residual_tests import residual_structure
from fitting.signal.scale import laboratory_maximum
from fitting.signal.student import as_sigmas, tail, widening95
from fitting.text.arrays import BoolArray, FloatArray
from fitting.text.errors import FmuFailure
from fitting.text.finding import Finding, Kind, warning
from fitting.text.rendering import phrase

#: A direction counts as determined from this many times the precision of the bounds.
BETTER_THAN_BOX = 3.0
#: Standard deviations from which the values of two campaigns that contradict each other differ.
APART = 3.0


class _System:
    """Linearisation of each campaign, and the Gaussian priors as rows of their own, one per value.

    All campaigns have their own noise as it is stated or scatters, wider by `inflation`, one each,
    where residuals are beyond it; `owners` (n,) mark the parameters that their rows depend on.
    """

    def __init__(self, solution: Solution) -> None:
        point, data, parameters = solution.final, solution.objective.data, solution.parameters
        noise, prior = noise_of(solution.objective, point).loosest, prior_sigmas(parameters)
        inverse = [p.scale / p.prior_sigma if p.prior_sigma else 0.0 for p in parameters]
        rows = np.array(inverse) * point.x
        self.priors = Linearisation(rows=rows, matrix=np.diag(inverse), prior=prior)
        self.parts: list[Linearisation] = []
        self.owners: list[BoolArray] = []
        for k in range(len(data.series)):
            mine = data.series_of_rows == k
            own, matrix = noise.restricted(mine), solution.matrix[mine]
            white = own.whitened(point.residuals[mine]), own.whitened(matrix)
            self.parts.append(Linearisation(rows=white[0], matrix=white[1], prior=prior))
            self.owners.append(np.asarray(np.any(matrix != 0.0, axis=0)))
        self.inflation = []
        for k, part in enumerate(self.parts):
            least, count = self.minimum([k]), part.rows.size + self._priors_of([k]).rows.size
            excess = least.chi_square / max(count - least.rank, 1)
            self.inflation.append(max(1.0, math.sqrt(excess)))
        pairs = zip(self.parts, self.inflation, strict=True)
        self.parts = [part.widened(factor) for part, factor in pairs]

    def minimum(self, parts: Sequence[int]) -> Minimum:
        """Least chi square of some campaigns, priors of their own values included."""
        each = [*(self.parts[k] for k in parts), self._priors_of(parts)]
        return joined(each).minimum(BETTER_THAN_BOX)

    def _priors_of(self, parts: Sequence[int]) -> Linearisation:
        mine = np.any([self.owners[k] for k in parts], axis=0)
        rows = np.flatnonzero((np.diag(self.priors.matrix) > 0.0) & mine)
        return replace(self.priors, rows=self.priors.rows[rows], matrix=self.priors.matrix[rows])

    def pair_test(self, one: Sequence[int], other: Sequence[int], names: Sequence[str]) -> PairTest:
        """The difference of what two sets of campaigns both determine."""
        a, b, both = (self.minimum(parts) for parts in (one, other, (*one, *other)))
        freedom = a.rank + b.rank - both.rank
        square, p_value, sigmas = 0.0, math.nan, math.nan
        if freedom > 0:
            square = max(0.0, both.chi_square - a.chi_square - b.chi_square)
            p_value = tail(square, freedom)
            sigmas = as_sigmas(square, p_value)
        return PairTest(
            one=" + ".join(names[k] for k in one),
            other=" + ".join(names[k] for k in other),
            chi_square=square,
            freedom=max(freedom, 0),
            p_value=p_value,
            sigmas=sigmas,
        )


def consistency(problem: Problem, solution: Solution, outputs: Outputs) -> JointResult:
    """Each campaign alone, against the rest and against each other one.

    Residuals beyond a campaign's noise widen its errors first.

    Args:
        problem: several campaigns of one sample.
        solution: the end of their joint fit.
        outputs: derived outputs there and around.
    """
    data, x, names = problem.data, solution.final.x, tuple(problem.campaigns)
    system = _System(solution)
    # value and gradient in x of shared parameters and of the means of derived outputs
    gradients = {
        p.name: (float(solution.final.parameters[i]), p.scale * np.eye(x.size)[i])
        for i, p in enumerate(solution.parameters)
        if is_shared(p)
    }
    for name in outputs.values[0]:
        gradients[name] = (float(outputs.means(name)[0]), outputs.gradient(name))
    series = []
    for k, (name, bound) in enumerate(problem.campaigns.items()):
        # the sweep of the series as the model has it, scaled, at the start and at the end
        own = [
            i for i, m in enumerate(data.measurements) if m.series == name and isinstance(m, Sweep)
        ]
        before, after = (
            tuple(float(a) for i in own for a in point.scaled[i].real)
            for point in (solution.initial, solution.final)
        )
        least = system.minimum([k])
        series.append(
            SeriesPart(
                name=name,
                campaign=str(bound.path),
                scale_kind="none" if bound.sweep is None else bound.sweep.scale,
                chi=solution.final.chis[k],
                rows=system.parts[k].rows.size,
                determined=least.rank,
                chi_square_joint=system.parts[k].chi_square,
                chi_square_alone=least.chi_square,
                inflation=system.inflation[k],
                alone={n: _alone(least, *about) for n, about in gradients.items()},
                swept_initial_v=before,
                swept_final_v=after,
            )
        )
    every = range(len(names))
    tests = [system.pair_test([a], [b], names) for a, b in itertools.combinations(every, 2)]
    for k in every if len(names) > 2 else ():
        tests.append(system.pair_test([k], [j for j in every if j != k], names))
    return JointResult(tuple(series), tuple(tests))


def _alone(minimum: Minimum, value: float, gradient: FloatArray) -> ValueAlone:
    """A value and its error, where the data of a campaign determine it by themselves."""
    known = float(gradient @ minimum.covariance @ gradient)
    unknown = float(gradient @ minimum.unseen @ gradient)
    if not np.isfinite(known + unknown) or known < DETERMINED * (known + unknown):
        return ValueAlone(math.nan, math.nan)
    return ValueAlone(value + float(gradient @ minimum.step), float(np.sqrt(known)))


def without_values(joint: JointResult | None) -> JointResult | None:
    """The same; what each campaign determines by itself is withdrawn, as all values are.

    Args:
        joint: the tests of their agreement; None: nothing was tested.
    """
    if joint is None:
        return None
    nothing = ValueAlone(math.nan, math.nan)
    series = tuple(replace(s, alone=dict.fromkeys(s.alone, nothing)) for s in joint.series)
    return replace(joint, series=series)


# --- contradictions -------------------------------------------------------------------------------


def contradictions(joint: JointResult | None) -> tuple[PairTest, ...]:
    """Pairs of campaigns whose data cannot be of one set of values; each fact once.

    Campaigns that contradict each other are not compared together with a third. Where one of three
    or more contradicts others that agree, it is the one that differs: it alone is named, against
    the rest.

    Args:
        joint: the tests of their agreement; None: nothing was tested.
    """
    if joint is None:
        return ()
    names = {part.name for part in joint.series}
    tests = [test for test in joint.tensions if test.sigmas > CONTRADICT]
    pairs = tuple(test for test in tests if test.other in names)
    odd = differs(joint)
    if odd:
        return tuple(t for t in tests if t.one == odd and t.other not in names) or pairs
    return pairs or tuple(tests)


def differs(joint: JointResult | None) -> str:
    """The one campaign that contradicts others, which agree; empty where it is not one.

    Args:
        joint: the tests of their agreement; None: nothing was tested.
    """
    if joint is None or len(joint.series) < 3:
        return ""
    names = [part.name for part in joint.series]
    pairs = [t for t in joint.tensions if t.other in names]
    against = [t for t in pairs if t.sigmas > CONTRADICT]
    common = [n for n in names if against and all(n in (t.one, t.other) for t in against)]
    if len(common) == 1:
        return common[0]
    # of a single pair, the one that agrees badly with the rest, too, where the other one does not
    poor = [t for t in pairs if WORTH_A_WARNING < t.sigmas <= CONTRADICT]
    worse = [n for n in common if any(n in (t.one, t.other) for t in poor)]
    return worse[0] if len(worse) == 1 else ""


def contradicted(joint: JointResult | None, units: Mapping[str, str]) -> dict[str, str]:
    """Why values have no status, by name, where campaigns contradict each other; mostly empty.

    Args:
        joint: the tests of their agreement; None: nothing was tested.
        units: of the values, by name.
    """
    tests = contradictions(joint)
    if joint is None or not tests:
        return {}
    sides = {side for test in tests for side in (test.one, test.other)}
    every = {part.name for part in joint.series}
    # a side of several campaigns is the rest of them all
    parts = [part for part in joint.series if part.name in sides or not sides <= every]
    names, reasons = [part.name for part in parts], {}
    for name, unit in units.items():
        known = {
            part.name: part.alone[name]
            for part in parts
            if name in part.alone and math.isfinite(part.alone[name].std)
        }
        differ = any(
            abs(one.value - other.value) > APART * math.hypot(one.std, other.std)
            for one, other in itertools.combinations(known.values(), 2)
        )
        if differ or len(known) < len(parts):
            reasons[name] = phrase("status", "contradicted", known, unit, names, differ)
    return reasons


def share_apart(joint: JointResult | None) -> float:
    """Share of the misfit that is left where each campaign has values of its own.

    Args:
        joint: the tests of their agreement; None: there is one.

    Returns:
        One where no campaigns contradict each other.
    """
    if joint is None or not contradictions(joint):
        return 1.0
    alone = sum(part.chi_square_alone for part in joint.series)
    together = sum(part.chi_square_joint for part in joint.series)
    return excess_share(alone, together, sum(part.rows for part in joint.series))


def pair_findings(joint: JointResult | None, *, searched: bool) -> tuple[Finding, ...]:
    """Campaigns that contradict each other, or agree poorly.

    Args:
        joint: the tests of their agreement; None: there is one.
        searched: whether a better joint fit was searched for: else one may exist at which they
            agree.
    """
    if joint is None:
        return ()
    against, odd = contradictions(joint), differs(joint)
    poor = () if against else tuple(t for t in joint.tensions if t.sigmas > WORTH_A_WARNING)
    if (against or poor) and not searched:
        return (warning(Kind.disagreement_unsearched, "measurements"),)
    return tuple(
        warning(
            Kind.contradiction if against else Kind.tension,
            (odd if against else "") or f"{test.one}, {test.other}",
            {"sets": (test.one, test.other)},
            sigmas=test.sigmas,
            chi_square=test.chi_square,
            freedom=float(test.freedom),
            p_value=test.p_value,
        )
        for test in against or poor
    )


# --- peaks and sweep ------------------------------------------------------------------------------

#: Chi square over its degrees of freedom up to which a factor between them explains both.
EXPLAINED = 3.0
#: Share of the chi square of a contradiction below which the linearised test is taken as it is.
CLEAR = 0.5
#: Relative scatter of a sweep's points, at least: simulations and rounding.
LEAST_SCATTER = 1e-5
#: Damping of a linearised step, and precision (over that of the bounds) from which it follows a
#: direction.
GENTLE, LEAST_PRECISION = 1e-6, 1.0
#: Searches: chi square that is worth a step; of logarithms of factors the most, and a step of
#: differences.
PROMISE, LONGEST, LOG_STEP = 0.1, 7.0, 1e-6
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
    """The test of every series with peaks and a sweep that gives their scale.

    None of a series where the model fails near the solution.

    Args:
        solution: the end of a fit.
    """
    data, tests = solution.objective.data, []
    if len(solution.parameters) > MOST_PARAMETERS:
        return ()
    for place, sweep in enumerate(data.measurements):
        others = [m for m in data.measurements if m.series == sweep.series and not m.is_curve]
        if not isinstance(sweep, Sweep) or not any(m.rows for m in others):
            continue
        if not data.scale_sigmas[data.series.index(sweep.series)] < 1.0:  # it is no scale at all
            continue
        try:
            tests.append(_Both(solution, sweep, place).agreement())
        except (FmuFailure, np.linalg.LinAlgError):
            continue
    return tuple(test for test in tests if test is not None)


def explained_by_model(solution: Solution, series: str) -> bool:
    """Whether the model leaves noise of a sweep where it is fitted to the peaks of its series, too.

    A single line has to take a second mode for a background.

    Args:
        solution: the end of a fit.
        series: of the sweep and of the peaks.
    """
    measurements = solution.objective.data.measurements
    for place, sweep in enumerate(measurements):
        if isinstance(sweep, Sweep) and sweep.series == series:
            try:
                few = len(solution.parameters) <= MOST_PARAMETERS
                return few and _Both(solution, sweep, place).leaves_noise()
            except (FmuFailure, np.linalg.LinAlgError):  # the model fails nearby
                return False
    return False


class _Both:
    """Whitened rows of the peaks of a series (S) and of its sweep (T) at y = (x, ln c, ln factor).

    F among the parts means a free factor between their amplitudes. Expansions are about such y.
    """

    def __init__(self, solution: Solution, sweep: Sweep, place: int) -> None:
        self.solution, self.sweep, self.place = solution, sweep, place
        data, parameters = solution.objective.data, solution.parameters
        series = data.series.index(sweep.series)
        rows = np.arange(solution.final.residuals.size)
        self.peaks = (data.series_of_rows == series) & (rows < data.curve_rows.start)
        self.measured = data.measured_rows[self.peaks]
        # peaks of an unknown gain have no factor
        self.factor = "F" if np.any(self.measured) else ""
        noise = noise_of(solution.objective, solution.final)
        # the error of the scale moves all peaks together as they were measured, not as a fit has
        # them that a contradiction has bent
        common = data.scale_sigmas[series] * self.measured
        own = RowCovariance(noise.sigma[self.peaks], common[:, np.newaxis])
        self.covariance = own.loosened(noise.bounded.restricted(self.peaks))
        low, high = search_bounds(parameters)
        self.bounds = np.append(low, [-LONGEST] * 2), np.append(high, [LONGEST] * 2)
        self.units = np.append(prior_sigmas(parameters), [1.0, 1.0])
        self.inverse_prior = inverse_priors(parameters)
        self.scatter = LEAST_SCATTER
        # the scale rests on what the top shows of the noise, where that is not stated
        top = laboratory_maximum(sweep.frequency_hz, sweep.amplitude_v)
        self.freedom = math.inf if sweep.known else top.freedom
        self.start = np.append(solution.final.x, [0.0, 0.0])
        self._known: dict[tuple[str, bytes], FloatArray] = {}
        steps = np.append(solution.objective.steps, [LOG_STEP] * 2)
        endless = np.full(self.units.size, np.inf)
        self.space = Space(steps, *self.bounds, self.units, endless)
        self.parts = ""

    def agreement(self) -> SweepAgreement | None:
        """The test; None where they agree at once, or one determines nothing of the other."""
        if self._linear_test() < CLEAR * CONTRADICT**2:
            return None
        swept = self._least("T", self.start)
        freedom = self.sweep.amplitude_v.size - self._rank(swept) - 1
        if freedom < 3:
            return None
        self.scatter = self._scatter(swept, freedom)
        swept, peaks = self._least("T", swept.x), self._least("S", self.start)
        shared = self._rank(swept) + self._rank(peaks) - self._rank(self._at("ST", self.start))
        if shared < 1:
            return None
        both = self._least("ST", self.start, swept.x)
        rows = both.sample.rows.size
        # a factor that leaves far more than noise of the peaks alone explains nothing
        if self.factor and self._least("SF", self.start).chi_square < EXPLAINED * rows:
            free = self._least("STF", both.x, swept.x)
            # what a factor led to may be lower without it, too
            without = self._least("ST", np.append(free.x[:-1], 0.0))
            both = min(both, without, key=attrgetter("chi_square"))
            excess = max(1.0, free.chi_square / max(1, rows - self._rank(free) - 2))
            gain = both.chi_square - free.chi_square - self._by_priors(both, free)
            sigmas = self._sigmas(gain / excess, 1)
            if sigmas > CONTRADICT and excess < EXPLAINED:
                factor = math.exp(float(free.x[-1]))
                inverse = np.linalg.pinv(free.matrix * self.units, rcond=1e-10)
                std = factor * math.sqrt(excess * float(inverse[-1] @ inverse[-1]))
                return SweepAgreement(
                    series=self.sweep.series, sigmas=sigmas, factor=factor, factor_std=std
                )
        excess = max(1.0, peaks.chi_square / max(1, peaks.sample.rows.size - self._rank(peaks)))
        apart = both.chi_square - swept.chi_square - peaks.chi_square - self._by_priors(both, peaks)
        return SweepAgreement(series=self.sweep.series, sigmas=self._sigmas(apart / excess, shared))

    def leaves_noise(self) -> bool:
        """Whether the sweep's residuals are white where peaks and sweep are fitted together."""
        swept = self._least("T", self.start)
        self.scatter = self._scatter(swept, max(1, swept.sample.rows.size - self._rank(swept) - 1))
        both = self._least("ST", self.start, swept.x)
        own = slice(-self.sweep.amplitude_v.size, None)
        return residual_structure(both.sample.rows[own], both.matrix[own]).order == 0

    def _linear_test(self) -> float:
        """The test with everything linearised at the solution: one expansion and no descent.

        Of data that agree it is exact, as the solution then lies near both minima. The scatter of
        the sweep's points is about that of the linearised line from here on.
        """
        alone = self._at("T", self.start)
        freedom = max(1, alone.sample.rows.size - self._rank(alone) - 1)
        self.scatter *= max(1.0, math.sqrt(self._linear("T") / freedom))
        both, swept, peaks = map(self._linear, ("ST", "T", f"S{self.factor}"))
        return both - swept - peaks

    def _by_priors(self, one: Expansion, other: Expansion) -> float:
        """Chi square that priors of what drifts have more at one end: no data contradict there."""
        parameters = self.solution.parameters
        more = drift_square(parameters, one.x[:-2]) - drift_square(parameters, other.x[:-2])
        return max(0.0, more)

    def _sigmas(self, chi_square: float, freedom: int) -> float:
        """A chi square as standard deviations of a normal distribution, of noise from few points.

        The error of the scale is as wide as Student's t at 95 %, which is undone for all of it.
        """
        value = max(0.0, chi_square) * widening95(self.freedom) ** 2
        return as_sigmas(value, tail(value, freedom, self.freedom))

    def _scatter(self, end: Expansion, freedom: int) -> float:
        """Scatter of the sweep's points about their own minimum, wider if correlated."""
        scatter = self.scatter * math.sqrt(end.chi_square / freedom)
        if self.sweep.known:
            scatter = max(scatter, float(np.median(self.sweep.sigmas_v)) / self.sweep.maximum_v)
        return max(
            LEAST_SCATTER, scatter * residual_structure(end.sample.rows, end.matrix).widening
        )

    def _rank(self, end: Expansion) -> int:
        """How many combinations of the parameters the rows of an end determine."""
        matrix, free = (end.matrix * self.units)[:, :-2], end.matrix[:, -2:]
        free = free[:, np.linalg.norm(free, axis=0) > 0.0]
        if free.size:  # what a free scale takes away
            basis, _ = np.linalg.qr(free)
            matrix = matrix - basis @ (basis.T @ matrix)
        return int(np.sum(np.linalg.svd(matrix, compute_uv=False) > BETTER_THAN_BOX))

    # --- descents ---

    def _least(self, parts: str, *starts: FloatArray) -> Expansion:
        """The lowest end of searches from some points."""
        self.parts = parts
        begins = [self._at(parts, np.clip(start, *self.bounds)) for start in starts]
        ends = minimise(self, begins, goal=Goal(promise=PROMISE))
        # slopes of the lowest end alone: a Jacobian of the sweep costs as much as a search
        return self._at(parts, min(ends, key=attrgetter("chi_square")).end.x)

    def __call__(self, requests: Sequence[Request]) -> list[list[Sample]]:
        """Rows of the present parts for the requests of a round, in one batch."""
        part = "T" if "T" in self.parts else "S"
        self._values(part, [y[:-2] for request in requests for y in request.xs])
        nothing = np.empty(0)
        return [[Sample(y, self._rows(self.parts, y), nothing) for y in r.xs] for r in requests]

    def _linear(self, parts: str) -> float:
        """Chi square that a linearised model would have after a step from the solution."""
        here = self._at(parts, self.start)
        scaled = here.matrix * self.units
        step = damped_step(scaled, here.sample.rows, GENTLE, None, LEAST_PRECISION)
        left = here.sample.rows + scaled @ step
        return float(left @ left)

    def _at(self, parts: str, y: FloatArray) -> Expansion:
        around = forward(y, self.space.steps, self.bounds[1])
        self._values("T" if "T" in parts else "S", [node[:-2] for node in around.nodes])
        rows = [self._rows(parts, node) for node in around.nodes]
        sample = Sample(x=y, rows=rows[0], outputs=np.empty(0))
        return Expansion(sample, around.quotients(rows), np.empty((0, y.size)))

    def _rows(self, parts: str, y: FloatArray) -> FloatArray:
        x, scale, factor, rows = y[:-2], float(y[-2]), float(y[-1]), []
        if "S" in parts:
            [peaks] = self._values("S", [x])
            values = math.exp(-factor * ("F" in parts)) * (peaks + self.measured)
            rows.append(self.covariance.whitened(values - self.measured))
            rows.append((self.inverse_prior * x)[self.inverse_prior > 0.0])
        if "T" in parts:
            [swept] = self._values("T", [x])
            measured = self.sweep.amplitude_v / self.sweep.maximum_v
            rows.append((math.exp(scale) * swept - measured) / self.scatter)
        return np.concatenate(rows)

    def _values(self, part: str, xs: Sequence[FloatArray]) -> list[FloatArray]:
        """Relative rows of the peaks (S), or A/max L of the sweep (T), at each x; remembered."""
        new = {x.tobytes(): x for x in xs if (part, x.tobytes()) not in self._known}
        if new:
            points = evaluate_many(self.solution.objective, [*new.values()], whole=part == "T")
            for key, point in zip(new, points, strict=True):
                self._known["S", key] = point.residuals[self.peaks]
                if part == "T":
                    curve = np.asarray(point.scaled[self.place], dtype=float)
                    self._known["T", key] = curve / self.sweep.maximum_v
        return [self._known[part, x.tobytes()] for x in xs]
