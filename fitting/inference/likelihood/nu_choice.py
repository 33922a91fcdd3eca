"""nu as the data would choose it: L-curve and discrepancy principle, beside the given schedule.

Corner of the L-curve: the nu at which the curve (ln J_fit, ln |x|) bends most, between where the
prior costs misfit and where it costs nothing. Discrepancy principle: the largest nu whose chi
square is no more than noise explains, that of all m data at the true parameters: nothing is taken
off for the fitted ones. Where a criterion chooses nothing, that is said.

Source: P. Hansen and D. O'Leary, SIAM J. Sci. Comput. 14 (1993) 1487; V. Morozov (1966).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fitting.fit.likelihood import Likelihood, LikelihoodEvaluator, Request
from fitting.fit.path import HistoryRow, PathLevel
from fitting.inference.likelihood.knowledge import NuChoice, NuRow
from fitting.signal.chi_square import largest

#: Probability with which noise alone stays below the allowed chi square.
ALLOWED_P = 0.95
#: Length in logarithms that the L-curve must go along both axes before a corner means anything.
SHORT = 0.05


def choose_nu(
    likelihood: Likelihood,
    steps: Sequence[PathLevel],
    history: Sequence[HistoryRow],
    *,
    describes: bool = True,
) -> NuChoice:
    """Corner and discrepancy over the levels of Algorithm 2.

    Args:
        likelihood: of the stated noise, without inflation.
        steps: levels of Algorithm 2, at least one.
        history: their rows (and others), for parameters and outputs.
        describes: whether the model describes the data: else no misfit is within the noise.

    Raises:
        FmuFailure: the model failed at one of the levels.
    """
    evaluator = LikelihoodEvaluator(likelihood)
    xs = [np.array(step.x) for step in steps]
    [samples] = evaluator([Request(tuple(xs), outputs=False)])
    m, own = likelihood.data_rows, likelihood.inverse_prior_sigma == 0.0
    distances = [float(np.linalg.norm(x[own])) for x in xs]
    bends = curvatures([step.j_fit for step in steps], distances)
    rows_at, rows = {row.level: row for row in history}, []
    for step, distance, sample, bend in zip(steps, distances, samples, bends, strict=True):
        there = rows_at.get(step.level)
        rows.append(
            NuRow(
                nu=step.nu,
                j_fit=step.j_fit,
                distance=distance,
                chi_square=float(np.sum(sample.rows[:m] ** 2)),
                curvature=bend,
                parameters={} if there is None else dict(there.parameters),
                derived={} if there is None else dict(there.derived),
            )
        )
    allowed = largest(ALLOWED_P, m, likelihood.objective.data.noise_freedom)
    within = [row.nu for row in rows if row.chi_square <= allowed] if describes else []
    return NuChoice(
        rows=tuple(rows),
        corner=corner_of(rows),
        discrepancy=max(within, default=math.nan),
        allowed=allowed,
        last=rows[-1].nu,
        prior={p.name: p.reference for p in likelihood.parameters},
        widths={p.name: p.upper - p.lower for p in likelihood.parameters},
        describes=describes,
    )


def curvatures(misfit: Sequence[float], distance: Sequence[float]) -> list[float]:
    """Signed curvature of the curve (ln misfit, ln distance) at its inner points, NaN at its ends.

    That of the circle through a point and its neighbours (Menger); positive where the curve, passed
    from large to small nu, turns from falling misfit to growing distance: the corner of an L.

    Args:
        misfit: J_fit of each level.
        distance: from the prior of each level, in units of x.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        curve = np.log(np.column_stack([misfit, distance]))
    bends = [math.nan] * len(curve)
    for i in range(1, len(curve) - 1):
        if not np.all(np.isfinite(curve[i - 1 : i + 2])):
            continue
        a, b = curve[i] - curve[i - 1], curve[i + 1] - curve[i]
        chord = curve[i + 1] - curve[i - 1]
        size = float(np.linalg.norm(a) * np.linalg.norm(b) * np.linalg.norm(chord))
        turn = float(b[0] * a[1] - b[1] * a[0])  # clockwise is positive
        bends[i] = 2.0 * turn / size if size > 0.0 and math.isfinite(size) else math.nan
    return bends


def corner_of(rows: Sequence[NuRow]) -> float:
    """nu of the sharpest corner; NaN where the curve is too short along an axis to have one.

    Args:
        rows: one per level, nu falling.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        curve = np.log([[row.j_fit, row.distance] for row in rows])
    whole = curve[np.all(np.isfinite(curve), axis=1)]
    if len(whole) < 3 or np.min(np.ptp(whole, axis=0)) < SHORT:
        return math.nan
    bent = [row for row in rows if row.curvature > 0.0]
    return max(bent, key=lambda row: row.curvature).nu if bent else math.nan
