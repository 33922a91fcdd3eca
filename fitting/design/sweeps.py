"""Whole sweeps as candidates: what each says of the parameters, through the FMU.

With the amplitudes L = chi A(f; x) of a sweep at its frequencies, their noise sigma and the mean M
of magnitudes of noisy quadratures (`fitting.signal.magnitude`), its rows as a fit weighs them are

    W = M'(L) chi dA/dx/sigma        s = M'(L) L/sigma = d row/d ln chi

A scale of its own is solved inside, F = W^T W - W^T s s^T W/(s^T s); one that all new sweeps share
is a variable of the choice, a known one none.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign import BoundCampaign
from fitting.campaign.parameters import bounds, references, search_bounds, starts, to_model
from fitting.design.candidates import DriveChoice, Limits, combinations
from fitting.design.information import Place, Series
from fitting.fit.differences import central
from fitting.fit.linearisation import SMALLEST_SIGMA
from fitting.measurements.control.sweep import ControlSweep
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.plan import Plan
from fitting.measurements.response_curve import ResponseCurve, together
from fitting.signal.magnitude import mean_magnitude
from fitting.simulate.batch import Batch
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput

#: Prior of the logarithm of a scale that all new sweeps share: nothing is known of it.
ANY_SCALE = 10.0
#: Candidates at most.
MOST_SWEEPS = 1000


@dataclass(frozen=True)
class SweepRows:
    """Sweeps at one place: amplitudes (sweeps, m), scaled, and their derivatives (sweeps, m, n)."""

    amplitude: FloatArray
    by_x: FloatArray

    @property
    def largest(self) -> FloatArray:
        """Largest amplitude of every sweep, (sweeps, 1)."""
        return np.asarray(np.max(self.amplitude, axis=1, keepdims=True))


def control_sweep_of(bound: BoundCampaign) -> ControlSweep:
    """The control sweep of a campaign, which new sweeps continue.

    Args:
        bound: the campaign.

    Raises:
        BadInput: it has none.
    """
    for measurement in bound.measurements.values():
        if isinstance(measurement, ControlSweep):
            return measurement
    raise BadInput(
        f"{bound.path}: [design] sweeps: has no table [control_sweep], whose sweeps could be "
        "continued; wanted one, or no sweeps"
    )


def check_controls(names: Iterable[str], sweep: ControlSweep, where: str) -> None:
    """Complain of what the campaign's control sweep has no column for.

    Args:
        names: of controls.
        sweep: the campaign's.
        where: what complaints name.

    Raises:
        BadInput: an unknown control.
    """
    known = list(sweep.spectra[-1].settings)
    for name in names:
        if name not in known:
            raise BadInput(
                f"{where}: '{name}' is no control of [control_sweep]; wanted some of "
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
    sweep = control_sweep_of(bound)
    check_controls(wanted.controls, sweep, "limits: sweeps")
    last = sweep.spectra[-1].settings
    half = 0.5 * wanted.span_hz
    return tuple(
        DriveChoice(
            centre_hz=centre_hz,
            tones_hz=(centre_hz - half, centre_hz + half),
            output=limits.outputs[0],
            level=1.0,
            settings={**last, **chosen},
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
    series: Series, choices: Sequence[DriveChoice], places: Sequence[Place], steps: FloatArray
) -> list[SweepRows]:
    """Amplitudes of all sweeps and their derivatives at every place.

    Args:
        series: the data so far, for the scale, the plan and the FMU.
        choices: sweeps.
        places: where they are wanted.
        steps: difference steps in x, shape (n,).
    """
    series.plan = _planned(series, choices)
    return [_rows(series, choices, place, steps) for place in places]


def _curves(model: DrivenModel, choices: Sequence[DriveChoice]) -> list[ResponseCurve]:
    return [ResponseCurve(model, c.settings, c.output) for c in choices]


def _planned(series: Series, choices: Sequence[DriveChoice]) -> Plan:
    """The plan with few runs for each sweep where the FMU is linear."""
    parameters = series.bound.parameters
    points = [starts(parameters), np.clip(references(parameters), *bounds(parameters))]
    model = series.model(series.bound.alternatives[0])
    for choice in choices:
        [curve] = _curves(model, [choice])
        plan = curve.planned(frequencies_hz(choice), points, series.workers)
        model = replace(model, plan=plan)
    return model.plan


def _rows(
    series: Series, choices: Sequence[DriveChoice], place: Place, steps: FloatArray
) -> SweepRows:
    parameters = series.bound.parameters
    around = central(place.x, steps, *search_bounds(parameters))
    table = np.array([to_model(parameters, x) for x in (place.x, *around.nodes)])
    curves, batch = _curves(series.model(place.alternative), choices), Batch()
    task = together(
        [
            curve.predict(table, frequencies_hz(choice), batch)
            for curve, choice in zip(curves, choices, strict=True)
        ]
    )
    found = None
    while found is None:
        try:
            next(task)
        except StopIteration as ended:
            found = ended.value
        else:
            batch.simulate(series.workers)
    here, *nodes = _scale(series, place) * np.abs(np.stack(found, axis=1))
    return SweepRows(here, around.quotients(nodes))


def _scale(series: Series, place: Place) -> float:
    """From simulated to measured amplitudes at a place, the median of all measured spectra's."""
    [answer] = series.response(place.alternative).evaluate_many(
        [to_model(series.bound.parameters, place.x)]
    )
    pairs = zip(series.data.measurements, answer.predictions, strict=True)
    [(sweep, seen)] = [(m, p) for m, p in pairs if isinstance(m, ControlSweep)]
    shared = sweep.scale(seen)
    values = np.asarray(seen.values, dtype=float)
    scaled = sweep.scaled(seen, 1.0 if shared is None else shared.value)
    return float(np.median(scaled[values > 0.0] / values[values > 0.0]))


def information_of_sweeps(
    rows: SweepRows, sigmas: FloatArray, kept: Sequence[int], how: ControlSweep
) -> FloatArray:
    """Information (kept, n + 1, n + 1) of sweeps; (kept, n + 2, n + 2) where they share a scale.

    The variable behind the parameters is the scale of what was measured before, of which new
    sweeps say nothing; the last one the scale that they share.

    Args:
        rows: of all sweeps at a place.
        sigmas: standard deviations of all points, shape (sweeps, m), in the detector's unit.
        kept: sweeps.
        how: the scale of a sweep, and whether its amplitudes are magnitudes.
    """
    index = list(kept)
    noise = np.maximum(sigmas[index], SMALLEST_SIGMA * rows.largest[index])
    amplitude = rows.amplitude[index]
    slope = np.ones(amplitude.shape)
    if how.rectified and not how.logarithmic:
        flat = mean_magnitude(amplitude.ravel(), sigmas[index].ravel())
        slope = flat.slope.reshape(amplitude.shape)
    by_x = rows.by_x[index] * (slope / noise)[..., np.newaxis]
    by_scale = (slope * amplitude / noise)[..., np.newaxis]
    nothing = np.zeros(by_scale.shape)
    columns = [by_x, nothing]
    if how.scaled_by == "each":
        along = by_scale / np.linalg.norm(by_scale, axis=1, keepdims=True)
        columns = [by_x - along @ (np.swapaxes(along, 1, 2) @ by_x), nothing]
    elif how.scaled_by == "shared":
        columns = [by_x, nothing, by_scale]
    matrix = np.concatenate(columns, axis=-1)
    return np.asarray(np.swapaxes(matrix, 1, 2) @ matrix)
