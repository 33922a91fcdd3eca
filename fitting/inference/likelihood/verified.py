"""Intervals from the covariance where chi square confirms them: one run at each predicted end."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.fit.levenberg import UNCONSTRAINED, Expansion
from fitting.fit.likelihood import Exhausted, Request
from fitting.fit.optimum import active_bounds_at
from fitting.inference.likelihood.profile import Key, Quantity, ScanPoint, Side, data_covariance
from fitting.inference.likelihood.shared import Shared, by_data_or_priors, with_simulation
from fitting.signal.student import ROOT_68, reach
from fitting.text.arrays import FloatArray
from fitting.text.error_bars import ROOT_95

#: Disagreement of chi square, or of an output, with its linearised prediction that is none.
AGREES = 0.05
#: Share of the increase that the other parameters may gain by the stored slopes, which see no more
#: than a part of what they gain in a valley that bends.
FOLLOWED = 0.005


def verify(
    shared: Shared, wanted: Sequence[Quantity], sides: dict[Key, Side]
) -> dict[Key, list[Expansion]]:
    """Sides whose linearised ends chi square confirms; where it does not, the points tried.

    One run at each predicted end, all values in one batch. x + z C g/sigma is where the linearised
    problem has its least chi square at that value.
    """
    optimum, here = shared.optimum, shared.optimum.expansion
    covariance, likelihood = data_covariance(optimum), optimum.likelihood
    tried: list[tuple[Quantity, int, float, FloatArray]] = []
    for q in wanted:
        if not (np.all(np.isfinite(q.slope)) and q.sigma > 0.0):
            continue
        along = covariance @ q.slope / q.sigma
        for side, sign in ((0, -1.0), (1, 1.0)):
            for root in (ROOT_68, ROOT_95):
                x = here.x + sign * reach(root, q.freedom) * along
                tried.append((q, side, root, np.clip(x, likelihood.lower, likelihood.upper)))
    if not tried:
        return {}
    try:
        answers = shared.evaluator([Request((x,), outputs=q.output >= 0) for q, _, _, x in tried])
    except Exhausted:
        return {}
    predicted: dict[Key, list[tuple[Expansion, bool]]] = {}
    for (q, side, root, _), [sample] in zip(tried, answers, strict=True):
        at = Expansion(sample, here.matrix, here.outward, age=1)
        predicted.setdefault(q.key(side), []).append((at, _agrees(shared, q, side, root, at)))
    for q in wanted:
        for side in (0, 1):
            both = predicted.get(q.key(side), [])
            points = [shared.point(q, at) for at, _ in both]
            # a scan accepts what its search has followed; these, what stored slopes have followed
            shared.accept([p for p, (_, agrees) in zip(points, both, strict=True) if agrees])
            if both and all(agrees for _, agrees in both) and not _is_other_there(shared, q, side):
                sides[q.key(side)] = _verified(shared, q, side, points)
    return {key: [at for at, _ in both] for key, both in predicted.items()}


def _agrees(shared: Shared, q: Quantity, side: int, root: float, at: Expansion) -> bool:
    """Whether chi square at a predicted end is as foreseen, also after the others have followed.

    Both are upper bounds of the profile: the second one is that of the stored slopes, which see a
    valley that bends away from the predicted end.
    """
    optimum, here = shared.optimum, shared.optimum.expansion
    foreseen = reach(root, q.freedom) ** 2
    rows = at.sample.rows
    increase = float(rows @ rows) - optimum.least
    if not abs(increase / foreseen - 1.0) <= AGREES:
        return False
    step = (-1.0, 1.0)[side] * reach(root, q.freedom) * q.sigma
    value = q.of(at.sample, shared.periods)
    if not abs(value - q.best - step) <= AGREES * abs(step):
        return False
    scale = optimum.likelihood.widths
    normal = q.slope * scale / np.linalg.norm(q.slope * scale)
    scaled = here.matrix * scale
    tangent = scaled - np.outer(scaled @ normal, normal)
    # directions that the data hardly see are not followed: nothing moves along them
    left, singular, _ = np.linalg.svd(tangent, full_matrices=False)
    pull = left.T @ rows
    gain = float(np.sum(singular**2 / (singular**2 + 1.0) * pull**2))
    before = left.T @ here.sample.rows
    gain -= float(np.sum(singular**2 / (singular**2 + 1.0) * before**2))
    if gain > FOLLOWED * foreseen:
        return False
    besides = [q.index] if q.index >= 0 else []
    constraint = q.constraint(value, step) if q.output >= 0 else UNCONSTRAINED
    return not active_bounds_at(optimum.likelihood, at, besides, constraint)


def _is_other_there(shared: Shared, q: Quantity, side: int) -> bool:
    """Whether a known point of a side fits better than the linearised profile has it there."""
    sign = (-1.0, 1.0)[side]
    for p in shared.fitting():
        foreseen = sign * (q.of(p.at.sample, shared.periods) - q.best) / q.sigma
        if foreseen - reach(p.root, q.freedom) > 2.0 * AGREES * ROOT_95:
            return True
    return False


def _verified(shared: Shared, q: Quantity, side: int, points: Sequence[ScanPoint]) -> Side:
    """A side with the ends where sqrt(Dchi^2), straight through the points, has its thresholds."""
    ends = [
        q.best + (p.value - q.best) * root / p.root
        for p, root in zip(points, (ROOT_68, ROOT_95), strict=True)
    ]
    return with_simulation(
        q,
        side,
        Side(
            points=tuple(points),
            closed=by_data_or_priors(shared, points[-1]),
            end68=ends[0],
            end95=ends[1],
            own95=ends[1],
            is_verified=True,
        ),
        q.best,
    )
