"""Whole sweeps as candidates: what each says of the parameters, through the FMU.

With the rows y of a sweep, amplitudes or both quadratures (`fitting.design.continued`), their noise
sigma and the mean M of magnitudes of noisy quadratures (`fitting.signal.magnitude`; the values
themselves where rows are no magnitudes), its rows as a fit weighs them are

    W = M'(y) dy/dx/sigma        s = M'(y) dy/dc/sigma

What is solved inside (c: a scale, a complex gain, a background) is projected out,
F = W^T (1 - s s^+) W; what all new sweeps share is a variable of the choice.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from fitting.design.candidates import Limits, combinations
from fitting.design.continued import Continued, Responses, SweepRows, continued_of
from fitting.design.information import Place, Series
from fitting.design.result import DriveChoice
from fitting.extension.problem import (
    SMALLEST_SIGMA,
    central,
    planning_points,
    search_bounds,
    to_model,
)
from fitting.extension.records import BoundCampaign, Prediction
from fitting.measurements.curve_survey import plan_curve
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.plan import Plan
from fitting.measurements.response_curve import ResponseCurve
from fitting.signal.magnitude import mean_magnitude
from fitting.simulate.batch import Batch, answered, together
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput

#: Candidates at most.
MOST_SWEEPS = 1000
#: Directions of what is solved inside that are smaller than this share of the largest are rounding.
RANK = 1e-10


def check_controls(names: Iterable[str], sweeps: Continued, where: str) -> None:
    """Complain of what the campaign's sweeps have no column for.

    Args:
        names: of controls.
        sweeps: that are continued.
        where: what complaints name.

    Raises:
        BadInput: an unknown control.
    """
    known = list(sweeps.last)
    for name in names:
        if name not in known:
            raise BadInput(
                f"{where}: '{name}' is no control of [{sweeps.table}]; wanted some of "
                f"{', '.join(known)}"
            )


def sweep_choices(bound: BoundCampaign, limits: Limits) -> tuple[DriveChoice, ...]:
    """Every sweep within the limits, one at each combination of the controls.

    Args:
        bound: the campaign that is to be continued.
        limits: with sweeps.

    Raises:
        BadInput: too many combinations.
    """
    wanted = limits.sweeps
    if wanted is None:
        return ()
    combined = combinations(wanted.controls)
    if len(combined) > MOST_SWEEPS:
        raise BadInput(
            f"{bound.path}: {len(combined)} sweeps lie within the limits, wanted at most "
            f"{MOST_SWEEPS}: fewer values in [design] sweeps"
        )
    [centre_hz] = limits.centres_hz
    so_far = continued_of(bound)
    check_controls(wanted.controls, so_far, "limits: sweeps")
    half = 0.5 * wanted.span_hz
    return tuple(
        DriveChoice(
            centre_hz=centre_hz,
            tones_hz=(centre_hz - half, centre_hz + half),
            output=limits.outputs[0],
            level=1.0,
            settings={**so_far.last, **chosen},
            points=wanted.points,
        )
        for chosen in combined
    )


def frequencies_hz(choice: DriveChoice) -> FloatArray:
    """Frequencies of a sweep, (points,), Hz.

    Args:
        choice: a sweep.
    """
    first, last = choice.tones_hz
    return np.linspace(first, last, choice.points)


def simulated_sweeps(
    series: Series,
    so_far: Continued,
    choices: Sequence[DriveChoice],
    places: Sequence[Place],
    steps: FloatArray,
) -> list[SweepRows]:
    """Rows of all sweeps and their derivatives at every place.

    Args:
        series: the data so far, for the scale, the plan and the FMU.
        so_far: its sweeps that are continued.
        choices: sweeps, all of the same frequencies.
        places: where they are wanted.
        steps: difference steps in x, shape (n,).
    """
    series.plan = _planned(series, choices)
    return [
        so_far.rows(_prediction(series, so_far, place), _responses(series, choices, place, steps))
        for place in places
    ]


def _curves(model: DrivenModel, choices: Sequence[DriveChoice]) -> list[ResponseCurve]:
    return [ResponseCurve(model, c.settings, c.output) for c in choices]


def _planned(series: Series, choices: Sequence[DriveChoice]) -> Plan:
    """The plan with few runs for each sweep where the FMU is linear."""
    parameters = series.bound.parameters
    points = planning_points(parameters)
    model = series.model(series.bound.alternatives[0])
    for choice in choices:
        [curve] = _curves(model, [choice])
        plan = plan_curve(curve, frequencies_hz(choice), points, series.workers)
        model = replace(model, plan=plan)
    return model.plan


def _responses(
    series: Series, choices: Sequence[DriveChoice], place: Place, steps: FloatArray
) -> Responses:
    parameters = series.bound.parameters
    around = central(place.x, steps, *search_bounds(parameters))
    table = np.array([to_model(parameters, x) for x in (place.x, *around.nodes)])
    frequency_hz, batch = frequencies_hz(choices[0]), Batch()
    curves = _curves(series.model(place.alternative), choices)
    task = together([curve.predict(table, frequency_hz, batch) for curve in curves])
    here, *nodes = np.stack(answered(task, batch, series.workers), axis=1)
    return Responses(
        frequency_hz=frequency_hz,
        values=here,
        by_x=np.asarray(around.quotients(nodes), dtype=complex),
        parameters=parameters,
        p=table[0],
    )


def _prediction(series: Series, so_far: Continued, place: Place) -> Prediction:
    """Of the sweeps so far, at a place."""
    [answer] = series.response(place.alternative).evaluate_many(
        [to_model(series.bound.parameters, place.x)]
    )
    pairs = zip(series.data.measurements, answer.predictions, strict=True)
    [seen] = [prediction for m, prediction in pairs if so_far.is_made_of(m)]
    return seen


def information_of_sweeps(rows: SweepRows, sigmas: FloatArray, kept: Sequence[int]) -> FloatArray:
    """Information (kept, n + 1 + l, n + 1 + l) of sweeps that have l unknowns in common.

    The variable behind the parameters is the scale of what was measured before, of which new
    sweeps say nothing; the last ones are what they share.

    Args:
        rows: of all sweeps at a place.
        sigmas: standard deviations of all points, of each quadrature where both are rows, shape
            (sweeps, m), in the detector's unit.
        kept: sweeps.
    """
    index = list(kept)
    noise = np.maximum(sigmas[index], SMALLEST_SIGMA * rows.largest[index])
    weights = 1.0 / noise
    if rows.rectified:
        flat = mean_magnitude(rows.amplitude[index].ravel(), sigmas[index].ravel())
        weights = flat.slope.reshape(noise.shape) / noise
    by_x = rows.by_x[index]
    weights = np.tile(weights, (1, by_x.shape[1] // weights.shape[1]))[..., np.newaxis]
    nothing = np.zeros((*by_x.shape[:-1], 1))
    matrix = weights * np.concatenate([by_x, nothing, rows.shared[index]], axis=-1)
    along = _directions(weights * rows.inside[index])
    matrix = matrix - along @ (np.swapaxes(along, 1, 2) @ matrix)
    return np.asarray(np.swapaxes(matrix, 1, 2) @ matrix)


def _directions(columns: FloatArray) -> FloatArray:
    """Orthonormal columns that span each sweep's, (sweeps, r, k); zero beyond their rank."""
    sizes = np.linalg.norm(columns, axis=1, keepdims=True)
    if not columns.size:
        return columns
    found, values, _ = np.linalg.svd(
        columns / np.where(sizes > 0.0, sizes, 1.0), full_matrices=False
    )
    return np.asarray(found * (values > RANK * values[:, :1])[:, np.newaxis])
