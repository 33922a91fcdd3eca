"""Complex sweep: amplitude and phase of the response to one tone after another, over frequency.

    r = [Re(S - y), Im(S - y)]/max|y|        y measured, S as `Wiring` has it

Two rows for each value, all real parts of a curve before its imaginary parts. Gain and background
are complex, unknown, and solved inside. Lock-in amplifiers and network analysers give such curves;
output(t) = Re[H A exp(i (2 pi u t + phase))], A and phase those of the drive.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Self

import numpy as np

from fitting.campaign.parameters import Parameter
from fitting.measurements.complex_curve import ComplexCurve, dip_qualities
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import (
    OF_LARGEST,
    Axis,
    Figure,
    compared,
    record_figure,
    residual_points,
)
from fitting.measurements.gain import SharedGain, Solved
from fitting.measurements.maps import ControlMaps, MappedSpectrum
from fitting.measurements.measurement import Estimated, Measurement, Predicting, Prediction, Values
from fitting.measurements.records import SweepsTogether
from fitting.measurements.tones import PLATEAU
from fitting.simulate.batch import Batch
from fitting.text.arguments import checked
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import number


def complex_figure(curve: ComplexCurve, before: Values, after: Values) -> Figure:
    """X and Y over frequency with the model, and residuals of both in % of the largest modulus.

    Args:
        curve: as measured.
        before: as simulated with the start parameters, (n,), in the curve's unit.
        after: with the fitted ones.
    """
    f, x = curve.u_hz, Axis("drive frequency f", "Hz")
    sigma = np.full(f.size, curve.sigma) if curve.sigma > 0.0 else None
    panels = [
        compared(
            (x, Axis(f"quadrature {name}", curve.unit)),
            f,
            part(curve.y),
            part(before),
            part(after),
            sigma,
        )
        for name, part in (("X", np.real), ("Y", np.imag))
    ]
    left = 100.0 * (after - curve.y) / curve.largest
    panels.append(residual_points((x, OF_LARGEST), f, (("X", left.real), ("Y", left.imag))))
    rms = number(float(np.sqrt(np.mean(np.abs(left) ** 2) / 2.0)), 2)
    return record_figure(
        "complex_sweep",
        "Complex sweep",
        curve.label,
        caption=(
            f"Both quadratures at {f.size} frequencies with the model before and after the fit; "
            f"wiring: {curve.wiring.kind}, background: {curve.wiring.background}. Below: what the "
            f"fit leaves, {rms} % of the largest value in each quadrature (rms)."
        ),
        alt=f"X and Y at {f.size} frequencies with the fitted model; residual {rms} % rms.",
        panels=panels,
    )


def complex_maps(sweeps: ComplexSweep, fitted: Sequence[Values]) -> Figure:
    """Moduli of all sweeps over the control, and the modulus of what is left of both quadratures.

    Where something passes the resonance by its lines are no maxima, and none are marked.

    Args:
        sweeps: as measured.
        fitted: as simulated with the fitted parameters, (n,) each, in their unit.
    """
    curves = sweeps.records
    known = all(c.sigma > 0.0 for c in curves)
    bare = all(c.wiring.columns == 1 for c in curves)
    spectra = tuple(
        MappedSpectrum(
            label=c.label,
            settings=c.settings,
            frequency_hz=c.u_hz,
            measured=np.abs(c.y),
            fitted=np.abs(s),
            left=np.abs(s - c.y) / (c.sigma if known else 0.01 * c.largest),
            response=np.abs(s) if bare else np.empty(0),
        )
        for c, s in zip(curves, fitted, strict=True)
    )
    most = max(float(np.max(s.left)) for s in spectra) or 1.0
    return ControlMaps(
        spectra=spectra,
        units=sweeps.units,
        amplitude=Axis("modulus", curves[0].unit),
        rest=Axis("|simulated - measured|", "σ" if known else "% of largest", low=0.0, high=most),
        name="complex_control_sweep",
        what="Moduli",
        series=sweeps.series,
    ).figure


#: Role of a parameter that is a cable's delay.
DELAY = "delay"
#: Half the box of a delay, in 1/span: a turn more or less over the sweep is no better fit.
DELAY_REACH = 2.0


@checked
@dataclass(frozen=True, eq=False)
class ComplexSweep(SweepsTogether[ComplexCurve]):
    """Amplitude and phase of a steady response to one tone after another, of one or several sweeps.

    Args:
        setup: How the FMU is driven and what is observed.
        curves: One sweep or several.
        units: Units of control quantities in the settings of sweeps, for laws.
        one_delay: Whether all fitted delays are one.
        series: Measurements of one series share their setup.

    Raises:
        BadInput: no sweep, two of one name, or a delay that a sweep cannot resolve.
    """

    FIELD = "curves"
    NOUN = "complex sweep"

    curves: ComplexCurve | Sequence[ComplexCurve]
    _: KW_ONLY
    one_delay: bool = False

    def __post_init__(self) -> None:
        curves = (self.curves,) if isinstance(self.curves, ComplexCurve) else tuple(self.curves)
        object.__setattr__(self, "curves", curves)
        super().__post_init__()
        for k, curve in enumerate(curves):
            for other in curves[:k]:
                if np.array_equal(curve.u_hz, other.u_hz) and np.array_equal(curve.y, other.y):
                    raise BadInput(
                        f"complex sweep '{curve.label}' ({curve.source}): is the data of "
                        f"'{other.label}' again; wanted every measurement once"
                    )
        for curve in self._telling_delays:
            curve.check_delay()

    @property
    def table(self) -> str:
        """The table of a campaign that it is of."""
        return "[complex_control_sweep]" if self.units else "[[complex_sweep]]"

    @property
    def has_phases(self) -> bool:
        """Two rows for each value."""
        return True

    @property
    def line_width_hz(self) -> float | None:
        """Width of the line that the first sweep follows, Hz."""
        line = self.records[0].line
        inside = 0.0 < abs(line.width_hz) < np.ptp(self.records[0].u_hz)
        return abs(line.width_hz) if inside and line.misfit < PLATEAU else None

    @cached_property
    def _gains(self) -> tuple[SharedGain, ...]:
        """The gains of all sweeps: those of single ones, then the one that others share."""
        shared = tuple(k for k, c in enumerate(self.records) if c.shared)
        alone = [SharedGain((k,)) for k, c in enumerate(self.records) if not c.shared]
        rotated = any(self.records[k].restarted for k in shared)
        return (*alone, *([SharedGain(shared, modulus_only=rotated)] if shared else []))

    @property
    def solved_inside(self) -> int:
        """Real unknowns: two for every gain and background, shared ones once."""
        columns = [c.wiring.columns for c in self.records]
        return sum(gain.unknowns(columns) for gain in self._gains)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The delay of every sweep that has it fitted, about the one that its phases show.

        Where all have one it is looked for about that of the sweep that one mode describes best.
        """
        result = []
        for curve in self._telling_delays:
            turn, start = 1.0 / float(np.ptp(curve.u_hz)), curve.line.delay_s
            result.append(
                Parameter(
                    name=self.delay_name(curve),
                    unit="s",
                    lower=start - DELAY_REACH * turn,
                    upper=start + DELAY_REACH * turn,
                    start=start,
                    reference=start,
                    scale=0.1 * turn,
                    role=DELAY,
                )
            )
        return tuple(result)

    @property
    def _telling_delays(self) -> list[ComplexCurve]:
        """The sweeps by which delays that are fitted are looked for."""
        fitted = [c for c in self.records if c.delay_s is None]
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
        rotated = np.exp(2j * np.pi * (curve.u_hz - 0.5 * (curve.u_hz[0] + curve.u_hz[-1])) * tau)
        return np.asarray(curve.y * rotated)

    def predict(
        self, model: DrivenModel, table: FloatArray, batch: Batch, *, whole: bool = False
    ) -> Predicting:
        """Complex responses at all frequencies, wired; see `Measurement.predict`."""
        result = yield from self.responses(model, table, batch)
        places = {q.name: i for i, q in enumerate(model.parameters) if q.role == DELAY}
        delays_s = [
            [
                float(p[places[self.delay_name(c)]]) if c.delay_s is None else float(c.delay_s)
                for c in self.records
            ]
            for p in table
        ]
        return [
            self.wired([responses[k] for responses in result], delay_s)
            for k, delay_s in enumerate(delays_s)
        ]

    def wired(self, responses: Sequence[ComplexArray], delays_s: Sequence[float]) -> Prediction:
        """What is seen of responses, with the gains and backgrounds that suit the data best.

        Args:
            responses: H of every sweep, (n,), in the FMU's unit.
            delays_s: of every sweep, s.
        """
        u = self.records[0].u_hz
        middle = 0.5 * float(u[0] + u[-1])  # of all: gains that are shared are of one phase
        designs = [
            c.wiring.design(c.u_hz, h, tau, middle)
            for c, h, tau in zip(self.records, responses, delays_s, strict=True)
        ]
        measured = [c.y for c in self.records]
        weights = [1.0 / (c.sigma or c.largest) for c in self.records]
        solved: dict[int, Solved] = {}
        for gain in self._gains:
            solved |= gain.solve(designs, measured, weights)
        each = tuple(solved[k] for k in range(len(self.records)))
        return Prediction(
            np.concatenate([s.values for s in each]), responses=tuple(responses), solved=each
        )

    def solved_columns(self, prediction: Prediction) -> FloatArray:
        """Derivatives of the rows by real and imaginary parts of gains and backgrounds."""
        solved = dict(enumerate(prediction.solved))
        rows = [
            [
                c.rows_of(column.get(k, np.zeros(c.y.size, dtype=complex)))
                for k, c in enumerate(self.records)
            ]
            for gain in self._gains
            for column in gain.columns(solved)
        ]
        return np.stack([np.concatenate(row) for row in rows], axis=1)

    def amplitude_rows(self, prediction: Prediction, rows: FloatArray) -> FloatArray:
        """Real parts of exp(-i arg S) dS: what a change is along S."""
        made, begin = [], 0
        for s in self.split(prediction.values):
            real, imaginary = np.split(rows[begin : begin + 2 * s.size], 2)
            begin += 2 * s.size
            turn = np.exp(-1j * np.angle(s))[:, None]
            made.append((turn * (real + 1j * imaginary)).real)
        return np.concatenate(made)

    def qualities(self, prediction: Prediction, sigma: FloatArray) -> Mapping[str, Estimated]:
        """Coupling and internal quality of every notch or reflection that one mode makes."""
        spreads = [float(np.mean(sigma[mine])) for mine in self.slices]
        result: dict[str, Estimated] = {}
        each = zip(self.records, prediction.responses, prediction.solved, spreads, strict=True)
        for curve, response, solved, spread in each:
            tag = f"[{curve.label}]" if curve.label else ""
            values = dip_qualities(curve, response, solved, curve.largest * spread)
            result |= {f"{name}{tag}": value for name, value in values.items()}
        return result

    @property
    def rows_without_response(self) -> FloatArray:
        """What a constant, and what is added to the response, leave of each sweep, (rows,)."""
        return np.concatenate([c.rows_of(c.without_response()) for c in self.records])

    def part(self, labels: Collection[str]) -> Self | None:
        """The sweeps at the places of these labels.

        Args:
            labels: of places.

        Raises:
            BadInput: others have a delay of their own that is fitted.
        """
        if not self.one_delay and self.parameters:
            return Measurement.part(self, labels)
        return super().part(labels)

    def figures(self, before: Values, after: Values) -> Sequence[Figure]:
        """X and Y of every sweep and their residuals; of many, maps of both."""
        if self.units:
            return (complex_maps(self, self.split(after)),)
        return super().figures(before, after)

    def figure_of(self, record: ComplexCurve, before: Values, after: Values) -> Figure:
        """X and Y of a sweep with the model, and residuals of both."""
        return complex_figure(record, before, after)
