"""Sweep: the amplitude of the response to one tone after another, over frequency (the FRF).

It gives the scale chi of its series, its points are residual rows, or both:

    r_i = (chi A(f_i) - L_i)/max L        L_i measured, A(f_i) simulated amplitude at f_i

Residuals are relative to the maximum: the far wings of a resonance are noise, not information.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from fitting.campaign import BoundCampaign, Setup, SweepData
from fitting.campaign.noise import maximum_sigma, sweep_scale_sigma, sweep_sigmas
from fitting.lines.form import LineFit, fit_resonance
from fitting.lines.names import ADDED, OFFSET
from fitting.lines.sweep_model import along
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import (
    Axis,
    Figure,
    Form,
    Layer,
    Panel,
    Role,
    compared,
    residual_points,
    root_mean_square,
    worded,
)
from fitting.measurements.measurement import (
    Measurement,
    Predicting,
    Prediction,
    Sampled,
    Scale,
    Scaling,
    Values,
)
from fitting.measurements.plan import Plan
from fitting.measurements.residuals import ResidualCurve, least_noise, mistakes, white_noise
from fitting.measurements.response_curve import ResponseCurve, plan_curve
from fitting.signal.scale import (
    FINE_POINTS,
    SCALES,
    Maximum,
    bend_of,
    chi_of_maxima,
    chi_of_sweep,
    chi_robust,
    half_power_width,
    laboratory_maximum,
    nodes_around,
    refine_maximum,
)
from fitting.simulate.batch import Batch, Workers, together
from fitting.simulate.budget import SHARES, Basis, Decision, Kind
from fitting.simulate.drive import Drive
from fitting.simulate.settling import SAFETY
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.notation import with_error

#: How the scale was taken, in words.
SCALE_WORDS = {
    "maximum": "from the ratio of the maxima",
    "grid": "from the ratio of the largest points",
    "fit": "by least squares",
    "robust": "by Huber's estimate",
    "free": "fitted with the rest",
    "none": "not scaled",
}
#: Spacings of three sweep points that are tried, in those of five.
SPACINGS = (0.5, 0.25, 0.12)
#: Rounds of further sweep points, at most, to bracket a maximum or to lower its bias.
SEARCH_ROUNDS = 12
#: Share of the scale without a constant beside the amplitudes below which the other never falls.
LEAST_SHARE = 1e-3


@dataclass(frozen=True, kw_only=True)
class Sweep(Measurement):
    """Amplitudes over frequency: the scale by them, and, if `fitted`, one row per point.

    `scale` "maximum" or "grid" (Algorithm 1), "fit", "robust" (least squares and Huber's estimate
    over all points), "free" (that of "fit" times a fitted factor) or "none"; `sigmas_v` (n,) the
    standard deviation of every point, `known` where it was declared, else it is the scatter of the
    top;
    `maximum_v` the measured maximum (found where zero), `maximum_sigma` its relative error;
    `label` is empty where nothing is fitted for it alone, as an offset is; `unit` is that of the
    amplitudes, `background` that of the line which its figure shows; with "offset" a constant
    added to the amplitudes of a fitted sweep is solved inside, too, with "slope" it changes with
    frequency:

        r_i = (chi A(f_i) + c + c' x_i - L_i)/max L        c, c' by least squares

    Raises:
        ValueError: no points, shapes that differ, an unknown scale.
    """

    setup: Setup
    frequency_hz: FloatArray
    amplitude_v: FloatArray
    settings: Mapping[str, Scalar] = field(default_factory=dict)
    label: str = ""
    series: str = ""
    fitted: bool = False
    scaled_by: str = "maximum"
    sigmas_v: FloatArray = field(default_factory=lambda: np.empty(0))
    known: bool = False
    maximum_v: float = 0.0
    maximum_sigma: float = 0.0
    unit: str = "V"
    background: str = "none"

    def __post_init__(self) -> None:
        if self.scaled_by not in SCALES:
            raise ValueError(f"scale {self.scaled_by!r} is none of {', '.join(SCALES)}")
        if self.amplitude_v.size == 0:
            raise ValueError("a scale or a fit of the sweep needs a sweep")
        if self.frequency_hz.shape != self.amplitude_v.shape:
            raise ValueError(
                f"{self.frequency_hz.size} frequencies, but {self.amplitude_v.size} amplitudes"
            )
        if self.maximum_v <= 0.0:
            places = np.arange(self.amplitude_v.size, dtype=float)
            peak = laboratory_maximum(places, self.amplitude_v)
            object.__setattr__(self, "maximum_v", peak.value_v)
        if self.sigmas_v.shape != self.amplitude_v.shape:
            object.__setattr__(self, "sigmas_v", np.zeros(self.amplitude_v.size))

    @property
    def is_curve(self) -> bool:
        """Its points follow each other."""
        return True

    @property
    def line_width_hz(self) -> float:
        """Full width of the line at half of its power, as the points show it, Hz."""
        return half_power_width(self.frequency_hz, self.amplitude_v)

    @cached_property
    def sigma(self) -> FloatArray:
        """Standard deviation of every point over the maximum, (rows,); zero where unknown."""
        if not self.fitted:
            return np.empty(0)
        return np.asarray((1.0 if self.known else 0.0) * self.sigmas_v / self.maximum_v)

    @cached_property
    def measured_rows(self) -> FloatArray:
        """Measured amplitude over the maximum, (rows,); less its background, which follows chi."""
        return self._shape / self.maximum_v if self.fitted else np.empty(0)

    @property
    def datum_noise(self) -> float:
        """Relative standard deviation of its least noisy datum, or of the scale that it gives."""
        if not self.fitted:
            return self.scaling.sigma
        stated = least_noise(self.sigma, self.measured_rows)
        return stated or white_noise(self.amplitude_v) / self.maximum_v

    @property
    def added(self) -> str:
        """Which background is solved inside: "offset", "slope", or "none"."""
        return self.background if self.fitted and self.background in ADDED else "none"

    @cached_property
    def _background_columns(self) -> FloatArray:
        """Columns (n, k), orthogonal, of what is added to the amplitudes: 1, and x."""
        if self.added == "none":
            return np.empty((self.amplitude_v.size, 0))
        whole = np.ones(self.amplitude_v.size)
        if self.added == OFFSET:
            return whole[:, None]
        x = along(self.frequency_hz)
        return np.stack([whole, x - np.mean(x)], axis=1)

    @property
    def _shape(self) -> FloatArray:
        """Measured amplitudes (n,), less their projection on the background."""
        return np.asarray(self.amplitude_v - self._projected(self.amplitude_v))

    def _projected(self, amplitudes: FloatArray) -> FloatArray:
        """What of amplitudes (n,) is a background, by least squares."""
        columns = self._background_columns
        squares = np.sum(columns**2, axis=0)
        return np.asarray(columns @ ((columns.T @ amplitudes) / np.where(squares, squares, 1.0)))

    def offset(self, prediction: Prediction, chi: float) -> FloatArray:
        """The background at the points (n,), in ``unit``; zero where none is solved for.

        Args:
            prediction: of the sweep, without scale.
            chi: scale, laboratory over simulation.
        """
        predicted = _real(prediction)
        if self.added == "none":  # of a sweep that is not fitted only the maximum may be predicted
            return np.zeros_like(predicted)
        return self._projected(self.amplitude_v - chi * predicted)

    @property
    def solved_inside(self) -> int:
        """The constant, and its slope."""
        return int(self._background_columns.shape[1])

    def solved_blocks(self, prediction: Prediction) -> Sequence[FloatArray]:
        """Derivatives (rows, k) of the rows by the background's numbers over the maximum."""
        return (self._background_columns if self.fitted else np.empty((0, 0)),)

    @cached_property
    def scaling(self) -> Scaling:
        """A factor on chi is fitted with the rest, or chi has an error of its own."""
        if self.scaled_by == "free":
            return Scaling(is_free=True)
        sigma = self.maximum_sigma if self.scaled_by in ("maximum", "grid") else 0.0
        if not sigma > 0.0:
            sigma = sweep_scale_sigma(self._shape, self.sigmas_v, self.scaled_by)
        return Scaling(from_rows=self.scaled_by in ("fit", "robust"), sigma=sigma)

    @property
    def places(self) -> tuple[tuple[str, Mapping[str, Scalar]], ...]:
        """The settings that all its points share; a label where it has values of its own."""
        return ((self.label, self.settings),)

    def drives(self, model: DrivenModel, p: FloatArray) -> list[Drive]:
        """Those of the first, the largest and the last point."""
        top_hz = self.frequency_hz[int(np.argmax(self.amplitude_v))]
        tones = (self.frequency_hz[0], top_hz, self.frequency_hz[-1])
        return self._curve(model).drives(p, tones)

    def planned(self, plan: Plan) -> Plan:
        """The plan with the points about the maximum, where that sets the scale."""
        if self.scaled_by != "maximum" or plan.budget is None:
            return plan
        centre = laboratory_maximum(self.frequency_hz, self.amplitude_v).frequency_hz
        spacing = 0.5 * self.line_width_hz
        wanted = self.setup.accuracy if plan.budget is None else plan.budget.wanted
        bias = SHARES[Kind.MAXIMUM] * wanted
        decision = Decision(
            kind=Kind.MAXIMUM,
            basis=Basis.POLYNOMIAL,
            bound=bias,
            numbers={"points": FINE_POINTS, "spacing_hz": spacing, "centre_hz": centre},
        )
        return replace(
            plan,
            nodes_hz=tuple(map(float, nodes_around(centre, spacing))),
            maximum_bias=bias,
            budget=plan.budget.with_decision(decision),
        )

    def refined(self, model: DrivenModel, points: Sequence[FloatArray], workers: Workers) -> Plan:
        """The plan with fewer runs for the maximum and for the points, where these are proven."""
        model = replace(model, plan=self._fewer_nodes(model, points, workers))
        if not self._needs_points:
            return model.plan
        top_hz = float(self.frequency_hz[int(np.argmax(self.amplitude_v))])
        return plan_curve(self._curve(model), self.frequency_hz, points, workers, top_hz)

    @property
    def _needs_points(self) -> bool:
        """Whether the fit wants more of it than a maximum."""
        return self.fitted or self.scaled_by not in ("maximum", "none")

    def _fewer_nodes(
        self, model: DrivenModel, points: Sequence[FloatArray], workers: Workers
    ) -> Plan:
        """The plan with three points about the maximum instead of five, where that is proven.

        1/A^2 is a quartic through the five points at every p; its third derivative over its second,
        times a safety factor, bounds what a parabola through three points may be off by.
        """
        plan, budget, bias = model.plan, model.plan.budget, model.plan.maximum_bias
        if len(plan.nodes_hz) != FINE_POINTS or bias is None or budget is None:
            return plan
        nodes, curve = np.array(plan.nodes_hz), self._curve(model)
        result = [bend_of(nodes, np.abs(curve.simulated(p, nodes, workers))) for p in points]
        bend = SAFETY * max(bend for bend, _ in result)
        if not np.isfinite(bend):
            return plan
        for part in SPACINGS:
            three = nodes[2] + part * (nodes[3] - nodes[2]) * np.array([-1.0, 0.0, 1.0])
            tops = []
            for _, quartic in result:
                y = np.polynomial.Polynomial(quartic)(three - nodes[2])
                amplitudes = 1.0 / np.sqrt(np.maximum(y, np.finfo(float).tiny))
                tops.append(refine_maximum(three, amplitudes, bend))
            if all(top.bracketed and top.bias <= 0.5 * bias for top in tops):
                break
        else:
            return plan
        [before] = budget.of(Kind.MAXIMUM)
        numbers = {
            "points": three.size,
            "spacing_hz": float(three[1] - three[0]),
            "centre_hz": float(three[1]),
            "bend": bend,
            "safety": SAFETY,
        }
        return replace(
            plan,
            nodes_hz=tuple(map(float, three)),
            maximum_bend=bend,
            budget=budget.with_instead(replace(before, numbers=numbers)),
        )

    def predict(
        self, model: DrivenModel, table: FloatArray, batch: Batch, *, whole: bool = False
    ) -> Predicting:
        """Amplitudes at the points that are needed, and the maximum; see `Measurement.predict`."""
        needed = whole or self._needs_points
        points = self.frequency_hz if needed else np.empty(0)
        curve, maxima_at = self._curve(model), self._maxima(model, table, batch)
        tasks: list[Generator[None, None, Any]] = [curve.predict(table, points, batch), maxima_at]
        phasors, maxima = yield from together(tasks)
        return [Prediction(np.abs(row), top) for row, top in zip(phasors, maxima, strict=True)]

    def _curve(self, model: DrivenModel) -> ResponseCurve:
        return ResponseCurve(model, self.settings, self.setup.output, label=self.label or None)

    def _maxima(
        self, model: DrivenModel, table: FloatArray, batch: Batch
    ) -> Generator[None, None, list[Maximum | None]]:
        """The simulated maximum of every row of the table, None where it is not looked for."""
        nodes, curve = np.array(model.plan.nodes_hz), self._curve(model)
        if not nodes.size:
            return [None] * len(table)
        plan = model.plan
        accuracy, bend = plan.maximum_bias or self.setup.accuracy, plan.maximum_bend
        first, group = model.groups(table, self.label or None)
        requested = [curve.ask(table[k], nodes, batch, int(k)) for k in first]
        yield
        points = [(nodes, np.abs(curve.read(batch, each))) for each in requested]
        for _ in range(SEARCH_ROUNDS):
            more = [further_nodes(f, a, refine_maximum(f, a, bend), accuracy) for f, a in points]
            if not any(m.size for m in more):
                break
            further = [
                curve.ask(table[k], f, batch, int(k)) for k, f in zip(first, more, strict=True)
            ]
            yield
            for i, (new, runs) in enumerate(zip(more, further, strict=True)):
                f = np.concatenate([points[i][0], new])
                a = np.concatenate([points[i][1], np.abs(curve.read(batch, runs))])
                order = np.argsort(f)
                points[i] = f[order], a[order]
        tops = [refine_maximum(f, a, bend) for f, a in points]
        return [tops[g] for g in group]

    def sampled(self, model: DrivenModel, p: FloatArray, batch: Batch) -> list[Sampled]:
        """The run at the first point."""
        [(run, window)] = self._curve(model).ask(p, self.frequency_hz[:1], batch)
        return [Sampled(run, window, self.setup.output)]

    def scale(self, prediction: Prediction) -> Scale | None:
        """chi of one prediction and the relative bias that the simulated grid leaves in it.

        Raises:
            ValueError: the prediction lacks what the chosen scale needs.

        Source: the paper's Algorithm 1; computed anew for every p.
        """
        if self.scaled_by == "none":
            return None
        if self.scaled_by in ("fit", "free"):
            return Scale(self._least_squares(_real(prediction)))
        if self.scaled_by == "robust":
            return Scale(chi_robust(self.amplitude_v, _real(prediction)))
        if self.scaled_by == "grid":
            return Scale(chi_of_maxima(self.maximum_v, float(np.max(_real(prediction)))))
        maximum = prediction.maximum
        if maximum is None:
            raise ValueError("the response has no sweep maximum, which the scale needs")
        bias = maximum.bias if maximum.bracketed else 0.0
        return Scale(chi_of_maxima(self.maximum_v, maximum.value), bias)

    def _least_squares(self, simulated: FloatArray) -> float:
        """chi by least squares, with the background if there is one.

        A simulated line elsewhere goes with what the constant leaves in the wrong sense: chi stays
        positive.
        """
        chi = chi_of_sweep(self.amplitude_v, simulated)
        if not self.solved_inside:
            return chi
        shape = simulated - self._projected(simulated)
        if not np.max(shape) > 0.0:
            return chi
        return max(chi_of_sweep(self._shape, shape), LEAST_SHARE * chi)

    def residuals(self, prediction: Prediction, chi: float) -> FloatArray:
        """(chi A + c - L)/max L, shape (rows,)."""
        if not self.fitted:
            return np.empty(0)
        return (self.scaled(prediction, chi) - self.amplitude_v) / self.maximum_v

    def scaled(self, prediction: Prediction, chi: float) -> FloatArray:
        """The prediction times the scale, and the background."""
        return chi * _real(prediction) + self.offset(prediction, chi)

    def share_left(self, residuals: FloatArray) -> float:
        """Root mean square: rows are over the largest amplitude."""
        return float(np.sqrt(np.mean(residuals**2)))

    def residual_curves(self, residuals: FloatArray) -> Sequence[ResidualCurve]:
        """Its points over frequency."""
        if not residuals.size:
            return ()
        values = self.amplitude_v + residuals * self.maximum_v
        return (
            ResidualCurve(
                rows=np.arange(residuals.size),
                share=np.ones(residuals.size),
                axis=self.frequency_hz,
                columns=mistakes(self.frequency_hz, values, 1.0 / self.maximum_v),
                model=values,
                measured=self.amplitude_v,
            ),
        )

    @property
    def rows_without_response(self) -> FloatArray:
        """Distances (rows,) of a fitted sweep from its mean, or from a slope solved for."""
        if not self.fitted:
            return np.empty(0)
        shape = self.amplitude_v / self.maximum_v
        nearby = np.column_stack([np.ones(shape.size), self._background_columns])
        return np.asarray(shape - nearby @ np.linalg.lstsq(nearby, shape, rcond=None)[0])

    def unexplained(self, residuals: FloatArray) -> str:
        """A fitted sweep of whose variance less than half is explained is not described.

        One with so much noise that it is most of its variance may be.

        Args:
            residuals: rows (rows,).
        """
        if not residuals.size:
            return ""
        shape = self.amplitude_v / self.maximum_v
        missed = self._misses_curve(shape - np.mean(shape), residuals)
        return "the simulated sweep does not follow the measured one" if missed else ""

    def figures(self, before: Values, after: Values) -> Sequence[Figure]:
        """The frequency response, and what is left between measured and simulated points."""
        line, f, measured = None, self.frequency_hz, self.amplitude_v
        failure, percent = "", 100.0 / float(np.max(measured))
        try:  # one damped mode, without the FMU
            line = fit_resonance(f, measured, background=self.background, source="")
        except BadInput as error:
            failure = str(error).removeprefix(":").strip().rstrip(".")
        left = percent * (after.real - measured)
        shown = response_panel(f, (measured, before.real, after.real), self.unit, line)
        parts = [("model", left)]
        if line is not None:
            parts.append(("resonance fit", percent * (np.real(line.curve) - measured)))
        figure = worded(
            "frequency_response",
            [[shown], [residual_points((shown.x, OF_MAXIMUM), f, parts)]],
            series=self.series,
            sweep=self,
            scaled=SCALE_WORDS[self.scaled_by],
            line=line,
            words=[] if line is None else resonance_words(line),
            failure=failure,
            rms=root_mean_square([left]),
        )
        return (figure,)


#: Residuals of a sweep over its largest amplitude.
OF_MAXIMUM = Axis("minus measured", "% of maximum")


def response_panel(
    frequency_hz: FloatArray,
    values: tuple[FloatArray, FloatArray, FloatArray],
    unit: str,
    line: LineFit | None = None,
) -> Panel:
    """Amplitudes over drive frequency: measured points, simulated curves before and after a fit.

    Args:
        frequency_hz: of the points, (n,), Hz.
        values: measured, and simulated times the scale before and after the fit, (n,) each.
        unit: of the amplitudes.
        line: one damped mode fitted to the same points.
    """
    axes = (Axis("drive frequency f", "Hz"), Axis("amplitude", unit, low=0.0))
    shown = compared(axes, frequency_hz, *values)
    if line is None:
        return shown
    fit = Layer(Role.OTHER, Form.CURVE, frequency_hz, np.real(line.curve), label="resonance fit")
    notes = ("resonance fit:", *resonance_words(line))
    return replace(shown, layers=(*shown.layers, fit), notes=notes)


def resonance_words(resonance: LineFit) -> list[str]:
    """Eigenfrequency, full width and Q of a fitted mode, each with its standard deviation.

    Args:
        resonance: fitted to the sweep.
    """
    return [
        f"η = {with_error(resonance.frequency.value, resonance.frequency.std, 'Hz')}",
        f"full width = {with_error(resonance.width.value, resonance.width.std, 'Hz')}",
        f"Q = {with_error(resonance.q.value, resonance.q.std)}",
    ]


def _real(prediction: Prediction) -> FloatArray:
    return np.asarray(prediction.values, dtype=float)


def sweep_of(bound: BoundCampaign, data: SweepData, series: str = "") -> Sweep:
    """A campaign's sweep as a measurement, with everything known of its noise.

    Args:
        bound: campaign, bound to its FMU.
        data: the measured sweep.
        series: name of the series.
    """
    f, a, noise = data.frequency_hz, data.amplitude_v, bound.noise
    return Sweep(
        setup=bound.setup,
        frequency_hz=f,
        amplitude_v=a,
        settings=data.settings,
        label=data.label,
        series=series,
        fitted=data.use == "fit",
        scaled_by=data.scale,
        sigmas_v=sweep_sigmas(data, noise),
        known=noise.declared or data.sigma_v is not None,
        maximum_sigma=maximum_sigma(data, noise),
        unit=data.unit,
        background=data.background,
    )


def further_nodes(
    frequency_hz: FloatArray, amplitude: FloatArray, top: Maximum, accuracy: float
) -> FloatArray:
    """Frequencies to add about a maximum, Hz: beyond the end that rises, or closer; else none.

    Args:
        frequency_hz: of the sweep so far, rising, shape (n,), Hz.
        amplitude: there, shape (n,).
        top: the maximum that these show.
        accuracy: relative error that is wanted.
    """
    f = frequency_hz
    if not top.bracketed:
        side = -1.0 if top.frequency_hz == f[0] else 1.0
        steps = top.frequency_hz + side * float(np.ptp(f)) * np.array([0.25, 0.5, 1.0, 2.0])
        return np.asarray(steps[steps > 0.0])
    if top.bias <= accuracy:
        return np.empty(0)
    k = int(np.argmax(amplitude))
    spacing = 0.25 * float(min(f[k] - f[k - 1], f[k + 1] - f[k]))
    near = nodes_around(top.frequency_hz, spacing)
    return near[~np.isin(near, f)]
