"""Complex sweep: amplitude and phase of the response to one tone after another, over frequency.

    r = [Re(S - y), Im(S - y)]/max|y|        y measured, S as `complex.wiring` has it

Two rows for each value, all real parts of a curve before its imaginary parts. Gain and background
are complex, unknown, and solved inside. Lock-in amplifiers and network analysers give such curves;
output(t) = Re[H A exp(i (2 pi u t + phase))], A and phase those of the drive.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from fitting.campaign import Setup
from fitting.campaign.parameters import Parameter
from fitting.measurements.complex.curve import ComplexCurve
from fitting.measurements.complex.figure import complex_figure
from fitting.measurements.complex.gain import SharedGain, Solved
from fitting.measurements.complex.maps import complex_maps
from fitting.measurements.curve_survey import plan_curve
from fitting.measurements.dip import dip_qualities
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.few_places import few_of
from fitting.measurements.figure import Figure
from fitting.measurements.measurement import (
    Estimated,
    MeasurementKind,
    Predicting,
    Prediction,
    Sampled,
    Values,
    without_drive,
)
from fitting.measurements.plan import Plan
from fitting.measurements.residual_curve import ResidualCurve, mistakes
from fitting.measurements.response_curve import ResponseCurve
from fitting.measurements.tones import PLATEAU
from fitting.simulate.batch import Batch, Workers, together
from fitting.simulate.drive import Drive
from fitting.text.arguments import checked
from fitting.text.arrays import BoolArray, ComplexArray, FloatArray, Scalar
from fitting.text.errors import BadInput

#: Role of a parameter that is a cable's delay.
DELAY = "delay"
#: Half the box of a delay, in 1/span: a turn more or less over the sweep is no better fit.
DELAY_REACH = 2.0


@dataclass(frozen=True, kw_only=True)
class Wired(Prediction):
    """Complex sweeps as predicted: `responses` H of each, and what was solved."""

    responses: tuple[ComplexArray, ...] = ()
    solved: tuple[Solved, ...] = ()


@checked
@dataclass(frozen=True, eq=False)
class ComplexSweep:
    """Amplitude and phase of a steady response to one tone after another, of one or several sweeps.

    Args:
        setup: How the FMU is driven and what is observed.
        curves: The sweeps; one alone will do.
        units: Units of the control quantities that settings of the sweeps name, for laws.
        one_delay: Whether all delays that are fitted are one, that of the cable.
        series: Measurements of one series share their setup.

    Raises:
        BadInput: no sweep, two of one name, or a delay that a sweep cannot resolve.
    """

    setup: Setup
    curves: ComplexCurve | Sequence[ComplexCurve]
    _: KW_ONLY
    units: Mapping[str, str] = field(default_factory=dict)
    one_delay: bool = False
    series: str = ""

    def __post_init__(self) -> None:
        self.within(self.setup, self.series)

    @property
    def rows(self) -> int:
        """Number of residual rows: two for each value."""
        return self.within(self.setup, self.series).rows

    @property
    def places(self) -> tuple[tuple[str, Mapping[str, Scalar]], ...]:
        """Label and settings of every sweep."""
        return self.within(self.setup, self.series).places

    @property
    def control_units(self) -> Mapping[str, str]:
        """Units of the controls."""
        return self.within(self.setup, self.series).control_units

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The delays that are fitted."""
        return self.within(self.setup, self.series).parameters

    def within(self, setup: Setup, series: str) -> ComplexSweeps:
        """The measurement, as part of a series that is driven so.

        Args:
            setup: how the series drives the FMU.
            series: its name.
        """
        given = self.curves
        curves = (given,) if isinstance(given, ComplexCurve) else tuple(given)
        return ComplexSweeps(
            setup=setup,
            curves=curves,
            units=self.units,
            one_delay=self.one_delay,
            series=series,
        )


@dataclass(frozen=True, kw_only=True)
class ComplexSweeps(MeasurementKind):
    """One or several complex sweeps `curves` that are fitted together, two rows for each value.

    `units` are those of the controls that their settings name; `one_delay`: those that are fitted
    are one, that of the cable.

    Raises:
        BadInput: no sweep, or two of one name.
    """

    setup: Setup
    curves: tuple[ComplexCurve, ...]
    units: Mapping[str, str] = field(default_factory=dict)
    one_delay: bool = False
    series: str = ""

    def __post_init__(self) -> None:
        labels = [c.label for c in self.curves]
        if not labels or len(set(labels)) < len(labels):
            raise BadInput(
                f"complex sweep: labels {', '.join(labels) or 'of no curve'}; wanted one curve at "
                "least, each with a name of its own"
            )
        for k, curve in enumerate(self.curves):
            for other in self.curves[:k]:
                if np.array_equal(curve.u_hz, other.u_hz) and np.array_equal(curve.y, other.y):
                    raise BadInput(
                        f"complex sweep '{curve.label}' ({curve.source}): is the data of "
                        f"'{other.label}' again; wanted every measurement once"
                    )
        for curve in self._telling_delays:
            curve.check_delay()

    @property
    def is_curve(self) -> bool:
        """Its values follow each other."""
        return True

    @property
    def has_phases(self) -> bool:
        """Two rows for each value."""
        return True

    @property
    def left_out(self) -> tuple[str, ...]:
        """Points that an instrument cut off."""
        return tuple(c.left_out for c in self.curves if c.left_out)

    @property
    def line_width_hz(self) -> float | None:
        """Width of the line that the first sweep follows, Hz."""
        line = self.curves[0].line
        inside = 0.0 < abs(line.width_hz) < np.ptp(self.curves[0].u_hz)
        return abs(line.width_hz) if inside and line.misfit < PLATEAU else None

    @property
    def rows(self) -> int:
        """Two for each value."""
        return 2 * sum(c.y.size for c in self.curves)

    @cached_property
    def sigma(self) -> FloatArray:
        """Standard deviation of every row, (rows,); zero where unknown."""
        return np.concatenate([np.full(2 * c.y.size, c.sigma / c.largest) for c in self.curves])

    @property
    def places(self) -> tuple[tuple[str, Mapping[str, Scalar]], ...]:
        """Label and settings of every sweep."""
        return tuple((c.label, c.settings) for c in self.curves)

    @property
    def control_units(self) -> Mapping[str, str]:
        """Units of the controls."""
        return {name: unit for name, unit in self.units.items() if unit}

    @property
    def setting_sigmas(self) -> Mapping[str, Mapping[str, float]]:
        """Declared standard deviations of settings, by label."""
        return {c.label: c.setting_sigma for c in self.curves}

    def named(self, label: str) -> Self:
        """The same with a label for the sweep that has none.

        Args:
            label: of the sweep.
        """
        curves = tuple(c if c.label else replace(c, label=label) for c in self.curves)
        return replace(self, curves=curves)

    @cached_property
    def _gains(self) -> tuple[SharedGain, ...]:
        """The gains of all sweeps: those of single ones, then the one that others share."""
        shared = tuple(k for k, c in enumerate(self.curves) if c.shared)
        alone = [SharedGain((k,)) for k, c in enumerate(self.curves) if not c.shared]
        turned = any(self.curves[k].restarted for k in shared)
        return (*alone, *([SharedGain(shared, turned=turned)] if shared else []))

    @property
    def solved_inside(self) -> int:
        """Real unknowns: two for every gain and background, shared ones once."""
        columns = [c.wiring.columns for c in self.curves]
        return sum(gain.unknowns(columns) for gain in self._gains)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The delay of every sweep that has it fitted, about the one that its phases show.

        Where all have one it is looked for about that of the sweep that one mode describes best.
        """
        return tuple(self._delay(c) for c in self._telling_delays)

    @property
    def _telling_delays(self) -> list[ComplexCurve]:
        """The sweeps by which delays that are fitted are looked for."""
        fitted = [c for c in self.curves if c.delay_s is None]
        if self.one_delay and fitted:
            return [min(fitted, key=lambda c: c.line.misfit)]
        return fitted

    def delay_name(self, curve: ComplexCurve) -> str:
        """Name of the parameter that a fitted delay is.

        Args:
            curve: one of the sweeps.
        """
        tag = self.series if self.one_delay else curve.label or self.series
        return f"{DELAY}[{tag}]" if tag else DELAY

    def without_delay(self, curve: ComplexCurve, values: Mapping[str, float]) -> ComplexArray:
        """Measured values (n,) of a sweep, the delay of its cable taken off.

        Args:
            curve: one of the sweeps.
            values: of the fitted parameters, by name.
        """
        known = curve.delay_s
        tau = values[self.delay_name(curve)] if known is None else known
        turned = np.exp(2j * np.pi * (curve.u_hz - 0.5 * (curve.u_hz[0] + curve.u_hz[-1])) * tau)
        return np.asarray(curve.y * turned)

    def _delay(self, curve: ComplexCurve) -> Parameter:
        turn = 1.0 / float(np.ptp(curve.u_hz))
        start = curve.line.delay_s
        return Parameter(
            name=self.delay_name(curve),
            unit="s",
            lower=start - DELAY_REACH * turn,
            upper=start + DELAY_REACH * turn,
            start=start,
            reference=start,
            scale=0.1 * turn,
            role=DELAY,
        )

    def drives(self, model: DrivenModel, p: FloatArray) -> list[Drive]:
        """Those of the first sweep's first point, its line's and its last one's."""
        curve = self.curves[0]
        f = curve.u_hz
        line = float(np.clip(curve.line.eta_hz, f[0], f[-1]))
        tones = dict.fromkeys(map(float, (f[0], f[int(np.argmin(np.abs(f - line)))], f[-1])))
        output = curve.output or self.setup.output
        return [
            model.drive(
                model.single_tone_values(p, curve.settings, u, curve.label or None), (u,), output
            )
            for u in tones
        ]

    def refined(self, model: DrivenModel, points: Sequence[FloatArray], workers: Workers) -> Plan:
        """The plan with few runs for each sweep, where the response is measured to be rational."""
        for curve in self.curves:
            top_hz = float(np.clip(curve.line.eta_hz, curve.u_hz[0], curve.u_hz[-1]))
            plan = plan_curve(self._curve(model, curve), curve.u_hz, points, workers, top_hz)
            model = replace(model, plan=plan)
        return model.plan

    def predict(
        self, model: DrivenModel, table: FloatArray, batch: Batch, *, whole: bool = False
    ) -> Predicting:
        """Complex responses at all frequencies, wired; see `Measurement.predict`."""
        curves = [(self._curve(model, c), c.u_hz) for c in self.curves]
        found = yield from together([each.predict(table, u, batch) for each, u in curves])
        return [
            self.wired([responses[k] for responses in found], tuple(map(float, delay)))
            for k, delay in enumerate(self._delays(model, table))
        ]

    def _curve(self, model: DrivenModel, curve: ComplexCurve) -> ResponseCurve:
        return ResponseCurve(model, curve.settings, curve.output, label=curve.label or None)

    def _delays(self, model: DrivenModel, table: FloatArray) -> FloatArray:
        """Delay of every sweep, s, for every row of the table: (k, sweeps)."""
        places = {q.name: i for i, q in enumerate(model.parameters) if q.role == DELAY}
        columns = [
            np.full(len(table), c.delay_s)
            if c.delay_s is not None
            else table[:, places[self.delay_name(c)]]
            for c in self.curves
        ]
        return np.stack(columns, axis=1)

    def wired(self, responses: Sequence[ComplexArray], delays_s: Sequence[float]) -> Wired:
        """What is seen of responses, with the gains and backgrounds that suit the data best.

        Args:
            responses: H of every sweep, (n,), in the FMU's unit.
            delays_s: of every sweep, s.
        """
        u = self.curves[0].u_hz
        middle = 0.5 * float(u[0] + u[-1])  # of all: gains that are shared are of one phase
        designs = [
            c.wiring.design(c.u_hz, h, tau, middle)
            for c, h, tau in zip(self.curves, responses, delays_s, strict=True)
        ]
        measured = [c.y for c in self.curves]
        weights = [1.0 / (c.sigma or c.largest) for c in self.curves]
        solved: dict[int, Solved] = {}
        for gain in self._gains:
            solved |= gain.solve(designs, measured, weights)
        each = tuple(solved[k] for k in range(len(self.curves)))
        return Wired(
            np.concatenate([s.values for s in each]), responses=tuple(responses), solved=each
        )

    def sampled(self, model: DrivenModel, p: FloatArray, batch: Batch) -> list[Sampled]:
        """The run at the first point of every sweep."""
        found = []
        for curve in self.curves:
            window = model.single_tone_window(float(curve.u_hz[0]))
            [tone] = window.tones_hz
            values = model.single_tone_values(p, curve.settings, tone, curve.label or None)
            output, signal = curve.output or self.setup.output, model.signal(window, (tone,))
            run = batch.ask(values, window, signal, output)
            found.append(Sampled(run, window, output))
        return found

    def first_drive(self, *, driven: bool) -> ComplexSweeps:
        """Its first sweep, which begins with its first point."""
        curve = self.curves[0]
        if driven:
            return replace(self, curves=(curve,))
        setup, settings = without_drive(self.setup, curve.settings)
        return replace(self, setup=setup, curves=(replace(curve, settings=settings),))

    def residuals(self, prediction: Prediction, chi: float) -> FloatArray:
        """Real and imaginary part of (S - y)/max|y|, (rows,)."""
        pairs = zip(self.curves, self._split(prediction.values), strict=True)
        return np.concatenate([c.rows_of(s - c.y) for c, s in pairs])

    def scaled(self, prediction: Prediction, chi: float) -> Values:
        """S itself: the gain is in it."""
        return prediction.values

    def solved_columns(self, prediction: Prediction) -> FloatArray:
        """Derivatives of the rows by real and imaginary parts of gains and backgrounds."""
        solved = dict(enumerate(_wired(prediction).solved))
        rows = [
            [
                c.rows_of(column.get(k, np.zeros(c.y.size, dtype=complex)))
                for k, c in enumerate(self.curves)
            ]
            for gain in self._gains
            for column in gain.columns(solved)
        ]
        return np.stack([np.concatenate(row) for row in rows], axis=1)

    def amplitude_rows(self, prediction: Prediction, rows: FloatArray) -> FloatArray:
        """Real parts of exp(-i arg S) dS: what a change is along S."""
        made, begin = [], 0
        for s in self._split(prediction.values):
            real, imaginary = np.split(rows[begin : begin + 2 * s.size], 2)
            begin += 2 * s.size
            turn = np.exp(-1j * np.angle(s))[:, None]
            made.append((turn * (real + 1j * imaginary)).real)
        return np.concatenate(made)

    def qualities(self, prediction: Prediction, sigma: FloatArray) -> Mapping[str, Estimated]:
        """Coupling and internal quality of every notch or reflection that one mode makes."""
        wired = _wired(prediction)
        ends = np.cumsum([2 * c.y.size for c in self.curves])[:-1]
        spreads = [float(np.mean(each)) for each in np.split(sigma, ends)]
        found: dict[str, Estimated] = {}
        each = zip(self.curves, wired.responses, wired.solved, spreads, strict=True)
        for curve, response, solved, spread in each:
            tag = f"[{curve.label}]" if curve.label else ""
            values = dip_qualities(curve, response, solved, curve.largest * spread)
            found |= {f"{name}{tag}": value for name, value in values.items()}
        return found

    def share_left(self, residuals: FloatArray) -> float:
        """Distance from the model, root mean square over the largest modulus, of the worst one."""
        ends = np.cumsum([2 * c.y.size for c in self.curves])[:-1]
        return max(float(np.sqrt(2.0 * np.mean(r**2))) for r in np.split(residuals, ends))

    def residual_curves(self, residuals: FloatArray) -> Sequence[ResidualCurve]:
        """Every sweep over frequency, its real parts, then its imaginary ones."""
        found, begin = [], 0
        for c in self.curves:
            rows = np.arange(begin, begin + 2 * c.y.size)
            begin += rows.size
            real, imaginary = np.split(residuals[rows], 2)
            values = c.y + c.largest * (real + 1j * imaginary)
            found.append(
                ResidualCurve(
                    rows=rows,
                    share=np.full(rows.size, np.sqrt(2.0)),  # of the distance from the model
                    axis=np.tile(c.u_hz, 2),
                    name=c.label,
                    columns=mistakes(c.u_hz, values, 1.0 / c.largest),
                )
            )
        return tuple(found)

    @property
    def rows_without_response(self) -> FloatArray:
        """What a constant, and what is declared beside the response, leave of each sweep, (rows,).

        Behind the delay that the best single line has.
        """
        return np.concatenate([c.rows_of(self._less_beside(c)) for c in self.curves])

    @staticmethod
    def _less_beside(curve: ComplexCurve) -> ComplexArray:
        middle = 0.5 * float(curve.u_hz[0] + curve.u_hz[-1])
        delay = curve.line.delay_s if curve.delay_s is None else curve.delay_s
        # the first column is that of the response: without one it is a constant
        columns = curve.wiring.design(curve.u_hz, np.ones_like(curve.y), delay, middle)
        found = np.linalg.lstsq(columns, curve.y, rcond=None)[0]
        return np.asarray(curve.y - columns @ found)

    def unexplained(self, residuals: FloatArray) -> str:
        """Sweeps of whose variance less than half is explained are not described.

        Those with so much noise that it is most of their variance may be.

        Args:
            residuals: rows (rows,).
        """
        y = np.concatenate([c.rows_of(c.y - np.mean(c.y)) for c in self.curves])
        if self._leaves_most(y, residuals) and not self._leaves_noise(residuals, self.sigma):
            return "the simulated complex sweep does not follow the measured one"
        return ""

    def part(self, labels: Collection[str]) -> Self | None:
        """The sweeps at the places of these labels.

        Args:
            labels: of places.

        Raises:
            BadInput: others have a delay of their own that is fitted.
        """
        if not self.one_delay and self.parameters:
            return super().part(labels)
        kept = tuple(c for c in self.curves if c.label in labels)
        return replace(self, curves=kept) if kept else None

    def few_places(self) -> tuple[Self, BoolArray] | None:
        """Sweeps at few values of the controls, the outermost ones and others evenly between."""
        kept = few_of([c.settings for c in self.curves]) if self.units else None
        if kept is None:
            return None
        rows = np.repeat(kept, [2 * c.y.size for c in self.curves])
        curves = tuple(c for c, keep in zip(self.curves, kept, strict=True) if keep)
        return replace(self, curves=curves), rows

    def figures(self, before: Values, after: Values) -> Sequence[Figure]:
        """X and Y of every sweep and what the fit leaves of them; of many, maps of both."""
        if self.units:
            return (complex_maps(self, self._split(after)),)
        trios = zip(self.curves, self._split(before), self._split(after), strict=True)
        return tuple(complex_figure(c, b, a, self.series) for c, b, a in trios)

    def _split(self, values: Values) -> list[ComplexArray]:
        ends = np.cumsum([c.y.size for c in self.curves])[:-1]
        return list(np.split(np.asarray(values, dtype=complex), ends))

    def within(self, setup: Setup, series: str) -> Self:
        """The same as part of a series, whose name its labels carry."""
        curves = self.curves
        if series and series != self.series:
            curves = tuple(
                replace(c, label=f"{series}/{c.label}") if c.label else c for c in curves
            )
        return replace(self, setup=setup, series=series, curves=curves)


def _wired(prediction: Prediction) -> Wired:
    if not isinstance(prediction, Wired):
        raise TypeError(f"a complex sweep is predicted by {prediction!r}")
    return prediction
