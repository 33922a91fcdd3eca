"""Whole sweeps as next measurements, at values of their controls, through the FMU.

Amplitudes, `[control_sweep]`, have one row for each point and a real scale; complex values,
`[complex_control_sweep]`, a row for each quadrature, a complex gain, a background and a cable:

    A = chi |P|                          S = e (a P + b + b' x)       e = exp(-i 2 pi (u - u0) tau)

P is the response of the FMU, wirings as in `fitting.measurements.complex_curve`. Gains, scales and
backgrounds are unknown in a new sweep; where they enter derivatives they are taken to be those of
the sweep so far whose scale is the median.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fitting.design.continued import MOST_CANDIDATES, SWEEPS, Continued, required
from fitting.design.information import Place, Rows, Series
from fitting.design.limits import Limits, combinations
from fitting.design.result import DriveChoice
from fitting.extension.problem import planning_points
from fitting.extension.records import BoundCampaign, Prediction
from fitting.measurements.complex_sweep import DELAY, ComplexSweep
from fitting.measurements.control_sweep import ControlSweep
from fitting.measurements.response_curve import ResponseCurve, plan_curve
from fitting.simulate.batch import Batch, answered, together
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput

#: Prior of the logarithm of a scale, and of a phase (rad), that all new measurements share.
ANY_SCALE, ANY_PHASE = 10.0, math.pi / math.sqrt(3.0)


def shared_sigmas(like: Continued) -> list[float]:
    """Prior standard deviations of what new sweeps have in common: of a scale, of a phase."""
    if isinstance(like.kind, ControlSweep):
        return [ANY_SCALE] if like.kind.scaled_by == "shared" else []
    last = like.records[-1]
    if last.restarted:
        return [ANY_SCALE]
    return [ANY_SCALE, ANY_PHASE] if last.shared else []


def sweep_choices(bound: BoundCampaign, limits: Limits) -> tuple[DriveChoice, ...]:
    """Every sweep within the limits, one at each combination of the controls.

    Args:
        bound: the campaign that is to be continued.
        limits: with sweeps.

    Raises:
        BadInput: too many combinations.
    """
    sweeps, like = limits.sweeps, required(bound, SWEEPS)
    if sweeps is None:
        return ()
    combined = combinations(sweeps.controls)
    if len(combined) > MOST_CANDIDATES:
        raise BadInput(
            f"{bound.path}: {len(combined)} sweeps lie within the limits, wanted at most "
            f"{MOST_CANDIDATES}: fewer values in [design] sweeps"
        )
    like.require_controls(sweeps.controls, "limits: sweeps")
    [centre_hz], half = limits.centres_hz, 0.5 * sweeps.span_hz
    return tuple(
        DriveChoice(
            centre_hz=centre_hz,
            tones_hz=(centre_hz - half, centre_hz + half),
            output=limits.outputs[0],
            level=1.0,
            settings={**like.last, **controls},
            points=sweeps.points,
        )
        for controls in combined
    )


def frequencies_hz(choice: DriveChoice) -> FloatArray:
    """Frequencies of a sweep, (points,), Hz."""
    first_hz, last_hz = choice.tones_hz
    return np.linspace(first_hz, last_hz, choice.points)


class SweepCandidates:
    """Sweeps at values of the controls, all of the same frequencies.

    Args:
        data: the campaign that is to be continued.
        limits: of the instrument, with sweeps.
    """

    linear, noise = True, None

    def __init__(self, data: Series, limits: Limits) -> None:
        self.data, self.like = data, required(data.bound, SWEEPS)
        self.choices = sweep_choices(data.bound, limits)
        self.frequency_hz = frequencies_hz(self.choices[0])
        # few runs for each sweep where the FMU is linear
        model = data.model(data.bound.alternatives[0])
        points = planning_points(data.bound.parameters)
        for choice in self.choices:
            curve = ResponseCurve(model, choice.settings, choice.output)
            plan = plan_curve(curve, self.frequency_hz, points, data.workers)
            model = replace(model, plan=plan)
        self.plan = model.plan

    def rows(self, place: Place) -> list[Rows]:
        """All sweeps at a place."""
        around = self.data.around(place)
        table = self.data.parameters([place.x, *around.nodes])
        model, batch = replace(self.data.model(place.alternative), plan=self.plan), Batch()
        curves = [ResponseCurve(model, c.settings, c.output) for c in self.choices]
        task = together([curve.predict(table, self.frequency_hz, batch) for curve in curves])
        responses = np.stack(answered(task, batch, self.data.workers), axis=1)  # (nodes, c, m)
        now = self._measured(place, table[0])
        if isinstance(self.like.kind, ControlSweep):
            scale = _scale(self.like.kind, now)
            (here, *nodes), kind = scale * np.abs(responses), self.like.kind
            own, shared = (here[..., None][..., : kind.scaled_by == k] for k in ("each", "shared"))
            rectified = kind.rectified and not kind.logarithmic
        else:
            (here, *nodes), own, shared = self._wired(responses, table, now)
            rectified = False
        nothing = np.zeros((*here.shape, 1))  # new sweeps say nothing of the scale so far
        return [
            Rows(
                values=here,
                by_x=around.quotients(nodes),
                shared=np.concatenate([nothing, shared], axis=-1),
                inside=own,
                errors=nothing[..., :0],
                rectified=rectified,
            )
        ]

    def _measured(self, place: Place, p: FloatArray) -> Prediction:
        """What the sweeps so far are predicted as."""
        [answer] = self.data.response(place.alternative).evaluate_many([p])
        pairs = zip(self.data.data.measurements, answer.predictions, strict=True)
        kind = self.like.kind
        return next(q for m, q in pairs if type(m) is type(kind) and m.places == kind.places)

    def _wired(
        self, responses: ComplexArray, table: FloatArray, now: Prediction
    ) -> tuple[list[ComplexArray], ComplexArray, ComplexArray]:
        """Values (c, m) at every node; at the first columns of own and of shared unknowns."""
        sweeps: ComplexSweep = self.like.kind
        curve, u = sweeps.records[-1], self.frequency_hz
        middle_hz, coefficients = 0.5 * float(u[0] + u[-1]), _coefficients(sweeps, now, u)
        names = [q.name if q.role == DELAY else "" for q in self.data.bound.parameters]

        def designs(values: ComplexArray, p: FloatArray) -> ComplexArray:
            delay_s = curve.delay_s
            if delay_s is None:
                delay_s = float(p[names.index(sweeps.delay_name(curve))])
            return np.stack([curve.wiring.design(u, h, delay_s, middle_hz) for h in values])

        columns = designs(responses[0], table[0])  # (c, m, k)
        nodes = [designs(h, p) @ coefficients for h, p in zip(responses, table, strict=True)]
        gain = coefficients[0] * columns[..., :1]
        own, shared = [columns[..., 1:], 1j * columns[..., 1:]], [gain[..., :0]]
        (shared if curve.shared else own).append(gain)
        (shared if curve.shared and not curve.restarted else own).append(1j * gain)
        return nodes, np.concatenate(own, axis=-1), np.concatenate(shared, axis=-1)


def _scale(sweep: ControlSweep, now: Prediction) -> float:
    """From simulated to measured amplitudes, the median of all measured spectra's."""
    shared = sweep.scale(now)
    values = np.asarray(now.values, dtype=float)
    scaled = sweep.scaled(now, 1.0 if shared is None else shared.value)
    return float(np.median(scaled[values > 0.0] / values[values > 0.0]))


def _coefficients(sweeps: ComplexSweep, now: Prediction, u_hz: FloatArray) -> ComplexArray:
    """Gain and background (k,) for a sweep over u, those of the one whose gain is the median.

    A slope belongs to the middle and the span of its sweep: it is written for those of the new one.
    """
    order = np.argsort([abs(solved.coefficients[0]) for solved in now.solved])
    k = int(order[(len(order) - 1) // 2])
    coefficients, old = np.array(now.solved[k].coefficients), sweeps.records[k].u_hz
    if coefficients.size > 2:
        first = sweeps.records[0].u_hz
        old_middle, new_middle = (0.5 * float(v[0] + v[-1]) for v in (first, u_hz))
        by_hz = coefficients[2] / (0.5 * float(np.ptp(old)))
        coefficients[1] += by_hz * (new_middle - old_middle)
        coefficients[2] = by_hz * 0.5 * float(np.ptp(u_hz))
    return coefficients
