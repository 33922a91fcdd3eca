"""What a campaign takes for true, and whether its data could tell: else values hold under it alone.

A start value may be one that nobody measured, as which modes a drive reaches. Let t be such values,
and T = V^-1/2 dr/dt beside the whitened derivatives W of the fit: with t free the covariance is

    C' = ([W T]^T [W T] + P)^-1,     P the prior of the parameters alone

Where C'_ii is about C_ii the data tell t so well that a wrong one would be seen. Where it is much
larger they fit as well with another t, beside other values: nothing in chi square speaks of it, and
the values are known under t alone. Where t acts by a higher power (a coupling of zero
moves lines by its fourth) so does T.

Source: C. R. Rao, Linear Statistical Inference and Its Applications (partitioned normal equations).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import prior_sigmas
from fitting.fit.fit import Fit
from fitting.fit.objective import evaluate_many
from fitting.fit.solution import Solution
from fitting.measurements.fmu_response import FmuResponse
from fitting.text.arrays import BoolArray, FloatArray
from fitting.text.errors import BadInput, FmuFailure
from fitting.text.estimate import ParameterEstimate
from fitting.text.finding import Finding, Kind

#: How much wider an error is with the condition free, from which the value rests on it: a wrong
#: condition then fits as well, with a value one standard error off.
RESTS = 1.5
#: Steps of a value that is taken, as shares of its size, or of one where it is zero.
STEPS = tuple(10.0**k for k in range(-5, 9))
#: Length of what a step changes, in standard deviations of the rows, that is seen well.
SEEN = 0.3
#: The same from which a step is too long, and how often it is shortened.
LONGEST, SHORTENED = 3.0, 6
#: The highest power with which anything goes: lines move with the fourth of a coupling lambda.
POWERS = 4
#: Share of a column that is left by others, below which they leave nothing of it.
UNTOLD = 0.05
#: Rise of chi square up to which a fit is as good.
AS_GOOD = 1.0
#: Share of a column's square that keeps columns apart that the data do not.
RIDGE = 1e-12


@dataclass(frozen=True)
class Taken:
    """A start value that nobody measured, in the FMU's unit."""

    name: str
    value: float
    unit: str


@dataclass(frozen=True)
class _Column:
    """What a step of a taken value changes of the whitened rows (m,); it goes with step^power."""

    taken: Taken
    step: float
    power: int
    change: FloatArray


def condition_findings(fit: Fit, values: Mapping[str, ParameterEstimate]) -> Iterator[Finding]:
    """Under what conditions values hold that the data do not tell; none where there are none.

    Args:
        fit: a solved problem.
        values: of the parameters, as they are reported.

    Raises:
        FmuFailure: the model failed at the solution.
    """
    # what all campaigns take, each once
    taken = {
        name: Taken(name, float(bound.setup.start_values[name]), "" if unit == "1" else unit)
        for bound in fit.problem.campaigns.values()
        for name, unit in bound.taken.items()
    }
    # parameters of the campaign that have a value and an error
    known = {n: v for n, v in values.items() if v.asked and v.status.has_value and v.std > 0.0}
    solution, response = fit.solution, fit.solution.objective.response
    if not (taken and known and isinstance(response, FmuResponse)):
        return
    whitened = solution.noise.covariance.whitened
    columns = [_column(solution, response, one) for one in taken.values()]
    moving = [c for c in columns if c is not None]
    if not moving:
        return
    prior = prior_sigmas(solution.parameters, solution.nu)
    fixed = np.vstack([whitened(solution.seen), np.diag(1.0 / prior)])
    rows = np.column_stack([c.change for c in moving])
    added = np.vstack([rows, np.zeros((prior.size, len(moving)))])
    places = {p.name: i for i, p in enumerate(solution.parameters)}
    rest = _rest(fixed, added)
    resting = [name for name in known if rest[places[name]]]
    if not resting:
        return
    numbers = {f"assumed_{c.taken.name}": c.taken.value for c in moving}
    more, example = _example(solution, moving, fixed, added, {n: known[n] for n in resting})
    yield Finding(
        kind=Kind.assumed_value,
        severity="warning",
        subject=", ".join(c.taken.name for c in moving),
        numbers=numbers | more,
        names={
            "values": tuple(resting),
            "assumed": tuple(c.taken.name for c in moving),
            "units": tuple(c.taken.unit for c in moving),
            "example": example,
        },
    )


def _column(solution: Solution, response: FmuResponse, taken: Taken) -> _Column | None:
    """What the smallest step of a taken value that is seen well changes; None where none is."""
    whitened, here = solution.noise.covariance.whitened, solution.final.residuals

    def change(step: float) -> FloatArray:
        other = response.with_settings({taken.name: taken.value + step})
        moved = replace(solution.objective, response=other)
        [point] = evaluate_many(moved, [solution.final.x])
        return whitened(point.residuals - here)

    size = abs(taken.value) or 1.0
    try:
        for share in STEPS:
            found = change(share * size)
            if np.linalg.norm(found) > SEEN:
                return _small(taken, share * size, change, found)
    except (FmuFailure, BadInput):  # the FMU does not have such a value
        return None
    return None


def _small(
    taken: Taken, step: float, change: Callable[[float], FloatArray], found: FloatArray
) -> _Column:
    """What a step changes, shortened to a few standard deviations: a longer one is bent."""
    for _ in range(SHORTENED):
        length = float(np.linalg.norm(found))
        if length < LONGEST:
            break
        step *= (0.5 * LONGEST / length) ** (1.0 / _power(change, step, found))
        found = change(step)
    power = _power(change, step, found)
    return _Column(taken, step, power, found)


def _power(change: Callable[[float], FloatArray], step: float, found: FloatArray) -> int:
    """The power of a step with which its change goes, one to `POWERS`."""
    half = float(np.linalg.norm(change(0.5 * step)))
    ratio = float(np.linalg.norm(found)) / max(half, 1e-300)
    return min(max(round(math.log2(max(ratio, 1.0))), 1), POWERS)


def _rest(fixed: FloatArray, added: FloatArray) -> BoolArray:
    """Which values rest on what is added, (n,): a wrong one would not be seen.

    All of them where nothing tells a direction of it: what moves none to first order, as a drive of
    mode 2 against a read-out of it, moves them further off.
    """
    n = fixed.shape[1]
    both = np.column_stack([fixed, added])
    untold = any(
        np.linalg.norm(left_of(np.delete(both, n + k, axis=1), added[:, k])[0])
        < UNTOLD * np.linalg.norm(added[:, k])
        for k in range(added.shape[1])
    )
    return np.asarray((np.sqrt(_variances(both)[:n] / _variances(fixed)) > RESTS) | untold)


def left_of(matrix: FloatArray, column: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What a matrix leaves of a column, (m,), and the step that it takes for it, (n,).

    Args:
        matrix: derivatives of whitened rows, those of the prior below them, shape (m, n).
        column: what changes of the rows, shape (m,).
    """
    size = np.linalg.norm(matrix, axis=0)
    follow = -np.linalg.lstsq(matrix / size, column, rcond=1e-9)[0] / size
    return column + matrix @ follow, follow


def _variances(matrix: FloatArray) -> FloatArray:
    """Variances of a linear problem, (n,), finite where columns are alike."""
    size = np.linalg.norm(matrix, axis=0)
    scaled = matrix / size
    normal = scaled.T @ scaled + RIDGE * np.eye(size.size)
    return np.asarray(np.diag(np.linalg.inv(normal)) / size**2)


def _example(
    solution: Solution,
    columns: Sequence[_Column],
    fixed: FloatArray,
    added: FloatArray,
    values: Mapping[str, ParameterEstimate],
) -> tuple[dict[str, float], tuple[str, ...]]:
    """How little of a condition moves which value by its standard error, where the fit allows.

    The step of the assumed value and the sign of the move; the names of both, with a unit between.
    """
    places = {p.name: i for i, p in enumerate(solution.parameters)}
    found: list[tuple[float, str, float, _Column]] = []
    for k, column in enumerate(columns):
        left, follow = left_of(fixed, added[:, k])
        for name, value in values.items():
            move = follow[places[name]] * solution.parameters[places[name]].scale / value.std
            if abs(move) > 0.0:
                # of the column, what moves the value by its error
                found.append((float(left @ left) / move**2, name, move, column))
    good = [each for each in found if each[0] <= AS_GOOD]
    if not good:
        return {}, ()
    _, name, move, column = min(good, key=lambda each: each[0])
    step = column.step * abs(1.0 / move) ** (1.0 / column.power)
    return {"step": step, "move": math.copysign(1.0, move)}, (
        column.taken.name,
        column.taken.unit,
        name,
    )
