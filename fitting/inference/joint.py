"""Do campaigns that were fitted together agree? Generalised least squares at the joint solution.

    chi^2(S) = min_d |rho_S + W_S d|^2        W = V^-1/2 dr/dx,  rho = V^-1/2 r, rows of campaigns S

Only directions that the data of S determine better than the bounds take part: along the others the
rows are curved and nothing is known. What the sets A and B both determine is then tested by

    chi^2(A and B) - chi^2(A) - chi^2(B)  ~  chi^2 with  rank(A) + rank(B) - rank(A and B)

degrees of freedom, the chi square of the difference of their common numbers.
Source: the parameter goodness of fit of M. Maltoni and T. Schwetz, Phys. Rev. D 68 (2003) 033020.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitting.campaign.joint import is_shared
from fitting.campaign.parameters import prior_sigmas
from fitting.fit.linearisation import DETERMINED, Linearisation, Minimum, joined
from fitting.fit.noise import noise_of
from fitting.fit.problem import Problem
from fitting.fit.solution import Solution
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
from fitting.signal.chi_square import as_sigmas, tail
from fitting.signal.misfit import excess_share
from fitting.text.arrays import BoolArray, FloatArray
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
