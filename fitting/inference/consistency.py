"""Do campaigns that were fitted together agree? Generalised least squares at the joint solution.

    chi^2(S) = min_d |rho_S + W_S d|^2        W = V^-1/2 dr/dx,  rho = V^-1/2 r, rows of campaigns S

Only directions that the data of S determine better than the box does take part: along the others
the rows are curved and nothing is known. What the sets A and B both determine is then tested by

    chi^2(A and B) - chi^2(A) - chi^2(B)  ~  chi^2 with  rank(A) + rank(B) - rank(A and B)

degrees of freedom, the chi square of the difference of their common numbers.
Source: the parameter goodness of fit of M. Maltoni and T. Schwetz, Phys. Rev. D 68 (2003) 033020.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.joint import is_shared
from fitting.campaign.parameters import prior_sigmas, search_bounds
from fitting.fit.differences import central
from fitting.fit.linearisation import DETERMINED, Linearisation, Minimum, joined
from fitting.fit.noise import noise_of
from fitting.fit.objective import Point
from fitting.fit.outputs import output_means
from fitting.fit.problem import Problem
from fitting.fit.solution import Solution
from fitting.inference.joint_result import (
    CONTRADICT,
    WORTH_A_WARNING,
    JointResult,
    PairTest,
    SeriesPart,
    ValueAlone,
)
from fitting.measurements.measurement import Measurement
from fitting.measurements.sweep import Sweep
from fitting.signal.chi_square import as_sigmas, tail
from fitting.text.arrays import BoolArray, FloatArray
from fitting.text.rendering import phrase

#: A direction counts as determined from this many times the precision of the box.
BETTER_THAN_BOX = 3.0
#: Step in x for the gradient of a derived output.
OUTPUT_STEP = 1e-4


@dataclass(frozen=True)
class _System:
    """Linearisation of each campaign, and the Gaussian priors as rows of their own, one per value.

    `owners` (n,) of each campaign mark the parameters that its rows depend on.
    """

    parts: tuple[Linearisation, ...]
    priors: Linearisation
    owners: tuple[BoolArray, ...]

    def minimum(self, parts: Sequence[int]) -> Minimum:
        """Least chi square of some campaigns, priors of their own values included."""
        return joined([*(self.parts[k] for k in parts), self._priors_of(parts)]).minimum(
            BETTER_THAN_BOX
        )

    def _priors_of(self, parts: Sequence[int]) -> Linearisation:
        mine = np.any([self.owners[k] for k in parts], axis=0)
        held = np.diag(self.priors.matrix) > 0.0
        rows = np.flatnonzero(held & mine)
        priors = self.priors
        return Linearisation(rows=priors.rows[rows], matrix=priors.matrix[rows], prior=priors.prior)

    def degrees_of_freedom(self, part: int, least: Minimum) -> int:
        """Rows of a campaign and priors of its values, less what they determine; at least one."""
        rows = self.parts[part].rows.size + self._priors_of([part]).rows.size
        return max(rows - least.rank, 1)


def consistency(problem: Problem, solution: Solution) -> JointResult:
    """Each campaign alone, against the rest and against each other one.

    Residuals beyond a campaign's noise widen its errors first.

    Args:
        problem: several campaigns of one sample.
        solution: the end of their joint fit.
    """
    gradients = _gradients(solution)
    data, names = problem.data, tuple(problem.campaigns)
    system, inflation = _whitened(solution)
    everything = tuple(range(len(names)))
    minima = [system.minimum([k]) for k in everything]
    series = tuple(
        SeriesPart(
            name=name,
            campaign=str(problem.campaigns[name].path),
            scale_kind="none" if (sweep := problem.campaigns[name].sweep) is None else sweep.scale,
            chi=solution.final.chis[k],
            rows=system.parts[k].rows.size,
            determined=minima[k].rank,
            chi_square_joint=system.parts[k].chi_square,
            chi_square_alone=minima[k].chi_square,
            inflation=inflation[k],
            alone=_alone(minima[k], gradients),
            swept_initial_v=_swept(data.measurements, solution.initial, name),
            swept_final_v=_swept(data.measurements, solution.final, name),
        )
        for k, name in enumerate(names)
    )
    pairs: list[tuple[tuple[int, ...], tuple[int, ...]]] = [
        ((a,), (b,)) for a, b in itertools.combinations(everything, 2)
    ]
    if len(names) > 2:
        pairs += [((k,), tuple(j for j in everything if j != k)) for k in everything]
    tensions = tuple(_pair_test(system, one, other, names) for one, other in pairs)
    return JointResult(series, tensions)


def _swept(measurements: Sequence[Measurement], point: Point, series: str) -> tuple[float, ...]:
    """A series' sweep as the model gives it at a point, scaled."""
    pairs = zip(measurements, point.scaled, strict=True)
    mine = (scaled for m, scaled in pairs if m.series == series and isinstance(m, Sweep))
    return tuple(float(a) for scaled in mine for a in scaled.real)


def _gradients(solution: Solution) -> dict[str, tuple[float, FloatArray]]:
    """Value and gradient in x of shared parameters and of the means of derived outputs."""
    parameters, x = solution.parameters, solution.final.x
    found = {}
    for i, p in enumerate(parameters):
        if is_shared(p):
            found[p.name] = (float(solution.final.parameters[i]), p.scale * np.eye(x.size)[i])
    around = central(x, OUTPUT_STEP, *search_bounds(parameters))
    means = output_means(solution.objective.response, parameters, [x, *around.nodes])
    for name, values in means.items():
        found[name] = (float(values[0]), around.quotients(list(values[1:])))
    return found


def without_values(joint: JointResult | None) -> JointResult | None:
    """The same; what each campaign determines by itself is withdrawn, as all values are.

    Args:
        joint: the tests of their agreement; None: nothing was tested.
    """
    if joint is None:
        return None
    nothing = ValueAlone(float("nan"), float("nan"))
    series = tuple(replace(s, alone=dict.fromkeys(s.alone, nothing)) for s in joint.series)
    return replace(joint, series=series)


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
    found = [test for test in joint.tensions if test.sigmas > CONTRADICT]
    pairs = [test for test in found if test.other in names]
    odd = differs(joint)
    if odd:
        whole = [t for t in joint.tensions if t.one == odd and t.other not in names]
        return tuple(t for t in whole if t.sigmas > CONTRADICT) or tuple(pairs)
    return tuple(pairs or found)


def differs(joint: JointResult | None) -> str:
    """The one campaign that contradicts others, which agree; empty where it is not one.

    Args:
        joint: the tests of their agreement; None: nothing was tested.
    """
    if joint is None or len(joint.series) < 3:
        return ""
    names = [part.name for part in joint.series]
    pairs = [t for t in joint.tensions if t.other in names]
    found = [t for t in pairs if t.sigmas > CONTRADICT]
    common = [name for name in names if found and all(name in (t.one, t.other) for t in found)]
    if len(common) == 1:
        return common[0]
    # of a single pair, the one that agrees badly with the rest, too, where the other one does not
    doubted = [t for t in pairs if t.sigmas > WORTH_A_WARNING and t not in found]
    worse = [name for name in common if any(name in (t.one, t.other) for t in doubted)]
    return worse[0] if len(worse) == 1 else ""


def _whitened(solution: Solution) -> tuple[_System, list[float]]:
    """The system of all campaigns, residuals beyond a campaign's noise widened; and by how much."""
    point, data = solution.final, solution.objective.data
    noise = noise_of(solution.objective, point).loosest
    prior = prior_sigmas(solution.parameters)
    inverse = [p.scale / p.prior_sigma if p.prior_sigma else 0.0 for p in solution.parameters]
    own_priors = Linearisation(
        rows=np.array(inverse) * point.x, matrix=np.diag(inverse), prior=prior
    )
    parts, owners = [], []
    for k in range(len(data.series)):
        mine = data.series_of_rows == k
        own = noise.restricted(mine)
        rows, matrix = point.residuals[mine], solution.matrix[mine]
        parts.append(
            Linearisation(rows=own.whitened(rows), matrix=own.whitened(matrix), prior=prior)
        )
        owners.append(np.asarray(np.any(matrix != 0.0, axis=0)))
    system = _System(tuple(parts), own_priors, tuple(owners))
    inflation = []
    for k in range(len(parts)):
        least = system.minimum([k])
        square = least.chi_square / system.degrees_of_freedom(k, least)
        inflation.append(max(1.0, float(np.sqrt(square))))
    widened = [part.widened(factor) for part, factor in zip(parts, inflation, strict=True)]
    return replace(system, parts=tuple(widened)), inflation


def _alone(
    minimum: Minimum, gradients: Mapping[str, tuple[float, FloatArray]]
) -> dict[str, ValueAlone]:
    """What a campaign determines by itself: value and error along what its data see."""
    found = {}
    for name, (value, gradient) in gradients.items():
        known = float(gradient @ minimum.covariance @ gradient)
        unknown = float(gradient @ minimum.unseen @ gradient)
        if not np.isfinite(known + unknown) or known < DETERMINED * (known + unknown):
            found[name] = ValueAlone(float("nan"), float("nan"))
            continue
        found[name] = ValueAlone(value + float(gradient @ minimum.step), float(np.sqrt(known)))
    return found


def _pair_test(
    system: _System, one: Sequence[int], other: Sequence[int], names: Sequence[str]
) -> PairTest:
    a, b, both = (system.minimum(parts) for parts in (one, other, (*one, *other)))
    freedom = a.rank + b.rank - both.rank
    first, second = (" + ".join(names[k] for k in parts) for parts in (one, other))
    if freedom <= 0:
        return PairTest(
            one=first,
            other=second,
            chi_square=0.0,
            freedom=0,
            p_value=float("nan"),
            sigmas=float("nan"),
        )
    value = max(0.0, both.chi_square - a.chi_square - b.chi_square)
    p = tail(value, freedom)
    sigmas = as_sigmas(value, p)
    return PairTest(
        one=first, other=second, chi_square=value, freedom=freedom, p_value=p, sigmas=sigmas
    )


#: Standard deviations from which the values of two campaigns that contradict each other differ.
APART = 3.0


def contradicted(joint: JointResult | None, units: Mapping[str, str]) -> dict[str, str]:
    """Why values have no verdict, by name, where campaigns contradict each other; mostly empty.

    Args:
        joint: the tests of their agreement; None: nothing was tested.
        units: of the values, by name.
    """
    found = contradictions(joint)
    if joint is None or not found:
        return {}
    sides = {side for test in found for side in (test.one, test.other)}
    every = {part.name for part in joint.series}
    # a side of several campaigns is the rest of them all
    parts = [part for part in joint.series if part.name in sides or not sides <= every]
    reasons = {}
    for name, unit in units.items():
        known = {p.name: p.alone[name] for p in parts if name in p.alone}
        known = {series: each for series, each in known.items() if math.isfinite(each.std)}
        differ = any(_apart(one, other) for one, other in itertools.combinations(known.values(), 2))
        if not differ and len(known) == len(parts):
            continue
        names = [part.name for part in parts]
        reasons[name] = phrase("status", "contradicted", known, unit, names, differ)
    return reasons


def _apart(one: ValueAlone, other: ValueAlone) -> bool:
    return abs(one.value - other.value) > APART * math.hypot(one.std, other.std)
