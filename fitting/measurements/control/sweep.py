"""Control sweep: spectra of the response over drive frequency, one at each value of a control.

A control is a voltage, a capacitance, a flux, a temperature; laws of a campaign say which variables
of the FMU follow it. Whole spectra are fitted, and nobody has to say which branch a line is of:

    r_ki = (chi_k D_ki A_k(f_i) - L_ki)/max_i L_k

L measured, A simulated amplitude under the unit drive, D the drive at each frequency. The scale
chi_k is that of its spectrum, solved inside by weighted least squares, or one of all. Of amplitudes
in dB the rows are logarithms, ln(chi_k D A) - ln L: noise that is a share of each point would bias
a ratio whose denominator it is. Other amplitudes whose noise is known are magnitudes of quadratures
that have it, and larger than the response by what noise makes of it on average
(`fitting.signal.magnitude`): M(chi_k D A) stands in place of chi_k D A.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from fitting.campaign import Setup
from fitting.measurements.control.lines import MOST_LINES, lines_figure
from fitting.measurements.control.maps import ControlMaps, MappedSpectrum
from fitting.measurements.control.scales import SCALES, SpectrumScales
from fitting.measurements.control.spectrum import ControlSpectrum
from fitting.measurements.curve_survey import plan_curve
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.few_places import few_of
from fitting.measurements.figure import Axis, Figure
from fitting.measurements.measurement import (
    MeasurementKind,
    Predicting,
    Prediction,
    Sampled,
    Scale,
    Values,
    without_drive,
)
from fitting.measurements.plan import Plan
from fitting.measurements.residual_curve import ResidualCurve, mistakes
from fitting.measurements.response_curve import ResponseCurve
from fitting.signal.chi_square import joined_freedom
from fitting.signal.magnitude import mean_magnitude
from fitting.signal.roughness import roughness_freedom
from fitting.signal.scale import half_power_width
from fitting.simulate.batch import Batch, Workers, together
from fitting.simulate.drive import Drive
from fitting.text.arguments import checked
from fitting.text.arrays import BoolArray, FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.finding import Kind


@checked
@dataclass(frozen=True, kw_only=True)
class ControlSweep(MeasurementKind):
    """Spectra at several values of control quantities, one row for each point.

    Args:
        setup: How the FMU is driven and what is observed; its laws name the controls.
        spectra: One for each value of the controls, two or more.
        units: Units of the controls by name; those of the FMU's own variables may be left out.
        scaled_by: "each": every spectrum has a scale of its own; "shared": one for all; "none": 1.
        rectified: Whether amplitudes are magnitudes of two quadratures with the noise sigma each.
        estimated: Whether noise that is not known is told by the scatter of each spectrum; else
            the residuals of all tell it.
        logarithmic: Whether the rows are differences of logarithms.
        output: The FMU's output that is seen; empty: the setup's.
        unit: Of the amplitudes.
        series: Measurements of one series share their setup.

    Raises:
        BadInput: fewer than two spectra, two of one place, controls that differ from one another.
    """

    setup: Setup
    spectra: tuple[ControlSpectrum, ...]
    units: Mapping[str, str] = field(default_factory=dict)
    scaled_by: str = "each"
    rectified: bool = True
    estimated: bool = True
    logarithmic: bool = False
    output: str = ""
    unit: str = "V"
    series: str = ""

    def __post_init__(self) -> None:
        named = tuple(s if s.label else replace(s, label=self._label(s)) for s in self.spectra)
        if self.estimated:
            whole = self.rectified and not self.logarithmic
            named = tuple(
                s if np.all(s.sigmas > 0.0) else replace(s, sigma=s.scatter(rectified=whole))
                for s in named
            )
        object.__setattr__(self, "spectra", named)
        labels = [s.label for s in named]
        if len(labels) < 2 or len(set(labels)) < len(labels):
            raise BadInput(
                f"control sweep: spectra at {'; '.join(labels) or 'nothing'}; wanted two or more, "
                "each at a value of its own"
            )
        if self.logarithmic and any(np.any(s.y <= 0.0) for s in named):
            raise BadInput("control sweep: an amplitude is zero, which has no logarithm")
        if self.scaled_by not in SCALES:
            raise BadInput(
                f"control sweep: scaled_by is {self.scaled_by!r}, wanted one of {', '.join(SCALES)}"
            )

    def _label(self, spectrum: ControlSpectrum) -> str:
        return ", ".join(
            f"{value:g} {self.units.get(name, '')}".strip()
            if isinstance(value, float)
            else f"{name} = {value}"
            for name, value in spectrum.settings.items()
        )

    @property
    def control_units(self) -> Mapping[str, str]:
        """Units of the controls."""
        return {name: unit for name, unit in self.units.items() if unit}

    @property
    def estimates_noise(self) -> bool:
        """Where it is estimated from each spectrum."""
        return self.estimated

    @property
    def noise_freedom(self) -> float:
        """Degrees of freedom of the noise of all rows, where each spectrum tells its own."""
        if not self.estimated:
            return math.inf
        return joined_freedom((s.y.size, roughness_freedom(s.y.size)) for s in self.spectra)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Points that an instrument cut off."""
        return tuple(s.left_out for s in self.spectra if s.left_out)

    @property
    def is_curve(self) -> bool:
        """Its points follow each other."""
        return True

    @property
    def rows(self) -> int:
        """One for each point."""
        return sum(s.y.size for s in self.spectra)

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Where the rows of each spectrum stand."""
        ends = list(itertools.accumulate(s.y.size for s in self.spectra))
        return tuple(slice(e - s.y.size, e) for s, e in zip(self.spectra, ends, strict=True))

    @cached_property
    def measured(self) -> FloatArray:
        """Measured amplitudes of all spectra, (rows,)."""
        return np.concatenate([s.y for s in self.spectra])

    @cached_property
    def sizes(self) -> FloatArray:
        """What each row is relative to, (rows,): the amplitude, or the largest of its spectrum."""
        if self.logarithmic:
            return self.measured
        return np.concatenate([np.full(s.y.size, s.largest) for s in self.spectra])

    @cached_property
    def sigma(self) -> FloatArray:
        """Standard deviation of every row, (rows,); zero where unknown."""
        return np.concatenate([s.sigmas for s in self.spectra]) / self.sizes

    @cached_property
    def _quadrature_sigma(self) -> FloatArray:
        """Noise that makes magnitudes larger, in the unit of the amplitudes, (rows,); 0: none."""
        if self.logarithmic or not self.rectified:
            return np.zeros(self.rows)
        return np.concatenate([s.sigmas for s in self.spectra])

    @cached_property
    def _is_rectified(self) -> bool:
        return bool(np.any(self._quadrature_sigma > 0.0))

    def seen_as(self, amplitude: FloatArray) -> FloatArray:
        """What a detector makes of amplitudes on average, (rows,).

        Args:
            amplitude: under the drive and the scale, (rows,), in the unit of the control sweep.
        """
        if not self._is_rectified:
            return amplitude
        return mean_magnitude(amplitude, self._quadrature_sigma).mean

    @cached_property
    def measured_rows(self) -> FloatArray:
        """Measured amplitudes as rows; none where the scale is solved inside."""
        return self.measured / self.sizes if self.scaled_by == "shared" else np.zeros(self.rows)

    @property
    def takes_scale_from_rows(self) -> bool:
        """Whether chi is the least-squares one over all points."""
        return self.scaled_by == "shared"

    @property
    def solved_inside(self) -> int:
        """A scale for each spectrum."""
        return len(self.spectra) if self.scaled_by == "each" else 0

    def solved_columns(self, prediction: Prediction) -> FloatArray:
        """Derivatives of the rows by each spectrum's own scale.

        Args:
            prediction: of all spectra, without scale.
        """
        found = np.zeros((self.rows, self.solved_inside))
        values = self.scaled(prediction, 1.0)
        if self._is_rectified:
            values = mean_magnitude(values, self._quadrature_sigma).slope * values
        values = values / self.sizes
        if self.logarithmic:
            values = np.ones(self.rows)
        for column, mine in zip(found.T, self.slices, strict=False):
            column[mine] = values[mine]
        return found

    @property
    def line_width_hz(self) -> float | None:
        """Width of the line that the first spectrum shows, Hz."""
        first = self.spectra[0]
        found = half_power_width(first.u_hz, first.y)
        return found if found < np.ptp(first.u_hz) else None

    @property
    def places(self) -> tuple[tuple[str, Mapping[str, Scalar]], ...]:
        """Label and controls of every spectrum."""
        return tuple((s.label, s.settings) for s in self.spectra)

    def drives(self, model: DrivenModel, p: FloatArray) -> list[Drive]:
        """Those of the first, the largest and the last point of the first and the last spectrum.

        Args:
            model: how the FMU is driven, and by which plan.
            p: parameters (n,), each in its own unit.
        """
        found = []
        for s in (self.spectra[0], self.spectra[-1]):
            top = s.u_hz[int(np.argmax(s.y))]
            for tone in dict.fromkeys(map(float, (s.u_hz[0], top, s.u_hz[-1]))):
                values = model.single_tone_values(p, s.settings, tone, s.label)
                found.append(model.drive(values, (tone,), self.seen))
        return found

    @property
    def seen(self) -> str:
        """The FMU's output."""
        return self.output or self.setup.output

    def refined(self, model: DrivenModel, points: Sequence[FloatArray], workers: Workers) -> Plan:
        """The plan with few runs for each spectrum, where the FMU is linear.

        Args:
            model: the FMU as the series drives it.
            points: parameter vectors (n,) at which it is measured.
            workers: of the FMU.
        """
        for s in self.spectra:
            top_hz = float(s.u_hz[int(np.argmax(s.y))])
            plan = plan_curve(self._curve(model, s), s.u_hz, points, workers, top_hz)
            model = replace(model, plan=plan)
        return model.plan

    def predict(
        self, model: DrivenModel, table: FloatArray, batch: Batch, *, whole: bool = False
    ) -> Predicting:
        """Amplitudes under the drive of every point; see `Measurement.predict`.

        Args:
            model: the FMU as the series drives it.
            table: parameter vectors, shape (k, n), in the parameters' units.
            batch: where runs are asked for.
            whole: every point is predicted anyway.
        """
        tasks = [self._curve(model, s).predict(table, s.u_hz, batch) for s in self.spectra]
        found = yield from together(tasks)
        levels = [s.level for s in self.spectra]
        return [
            Prediction(
                np.concatenate([np.abs(c[k]) * d for c, d in zip(found, levels, strict=True)])
            )
            for k in range(len(table))
        ]

    def _curve(self, model: DrivenModel, spectrum: ControlSpectrum) -> ResponseCurve:
        return ResponseCurve(model, spectrum.settings, self.seen, label=spectrum.label)

    def sampled(self, model: DrivenModel, p: FloatArray, batch: Batch) -> list[Sampled]:
        """The run at the first point.

        Args:
            model: how the FMU is driven, and by which plan.
            p: parameters (n,), each in its own unit.
            batch: where runs are asked for.
        """
        first = self.spectra[0]
        window = model.single_tone_window(float(first.u_hz[0]))
        values = model.single_tone_values(p, first.settings, window.tones_hz[0], first.label)
        run = batch.ask(values, window, model.signal(window, window.tones_hz), self.seen)
        return [Sampled(run, window, self.seen)]

    def first_drive(self, *, driven: bool) -> ControlSweep:
        """It begins with the first point of its first spectrum.

        Args:
            driven: False: every amplitude of that drive is zero.
        """
        if driven:
            return self
        setup, settings = without_drive(self.setup, self.spectra[0].settings)
        first = replace(self.spectra[0], settings=settings)
        return replace(self, setup=setup, spectra=(first, *self.spectra[1:]))

    def scale(self, prediction: Prediction) -> Scale | None:
        """The least-squares scale of all points, where they share it.

        Args:
            prediction: of all spectra, without scale.
        """
        if self.scaled_by != "shared":
            return None
        [chi] = self._scales.of(np.asarray(prediction.values, dtype=float))
        return Scale(float(chi))

    @cached_property
    def _scales(self) -> SpectrumScales:
        """The scales of the spectra, or the one of all."""
        shared = self.scaled_by == "shared"
        counts = [self.rows] if shared else [s.y.size for s in self.spectra]
        return SpectrumScales(
            measured=self.measured,
            sizes=self.sizes,
            sigma=self.sigma,
            quadrature_sigma=self._quadrature_sigma,
            counts=np.array(counts),
            logarithmic=self.logarithmic,
            output=self.seen,
        )

    def scaled(self, prediction: Prediction, chi: float) -> FloatArray:
        """Simulated amplitudes beside the measured ones, (rows,), without noise.

        Args:
            prediction: of all spectra, without scale.
            chi: the scale of the series.
        """
        values = np.asarray(prediction.values, dtype=float)
        if self.scaled_by != "each":
            return chi * values
        return self._scales.scaled(values)

    def residuals(self, prediction: Prediction, chi: float) -> FloatArray:
        """(M(chi D A) - L)/max L of each spectrum, shape (rows,).

        Args:
            prediction: of all spectra, without scale.
            chi: the scale of the series.
        """
        scaled = self.scaled(prediction, chi)
        if self.logarithmic:
            return np.asarray(np.log(scaled / self.measured))
        return (self.seen_as(scaled) - self.measured) / self.sizes

    def share_left(self, residuals: FloatArray) -> float:
        """Root mean square of the worst spectrum; of logarithms NaN, they are shares of each point.

        Args:
            residuals: rows (rows,).
        """
        if self.logarithmic:
            return math.nan
        return max(float(np.sqrt(np.mean(residuals[mine] ** 2))) for mine in self.slices)

    def residual_curves(self, residuals: FloatArray) -> Sequence[ResidualCurve]:
        """Every spectrum over frequency.

        Args:
            residuals: rows (rows,).
        """
        found = []
        for s, mine in zip(self.spectra, self.slices, strict=True):
            values = s.y * np.exp(residuals[mine]) if self.logarithmic else s.y
            if not self.logarithmic:
                values = values + residuals[mine] * s.largest
            slope = 1.0 / values if self.logarithmic else np.full(s.y.size, 1.0 / s.largest)
            share = s.y / s.largest if self.logarithmic else np.ones(s.y.size)
            found.append(
                ResidualCurve(
                    rows=np.arange(mine.start, mine.stop),
                    share=share,
                    axis=s.u_hz,
                    name=s.label,
                    columns=mistakes(s.u_hz, values, slope),
                    first_order=frozenset({Kind.offset} if self.logarithmic else ()),
                )
            )
        return tuple(found)

    @property
    def rows_without_response(self) -> FloatArray:
        """Distances (rows,) from the mean of each spectrum."""
        shape = self._shape
        return np.concatenate([shape[mine] - np.mean(shape[mine]) for mine in self.slices])

    @property
    def _shape(self) -> FloatArray:
        """Measured amplitudes as the rows see them, (rows,): logarithms, or shares."""
        return np.log(self.measured) if self.logarithmic else self.measured / self.sizes

    def unexplained(self, residuals: FloatArray) -> str:
        """Spectra of whose variance less than half is explained are not described.

        Those with so much noise that it is most of their variance may be.

        Args:
            residuals: rows (rows,).
        """
        shape = self._shape
        far = self._leaves_most(shape - np.mean(shape), residuals)
        if far and not self._leaves_noise(residuals, self.sigma):
            return "the simulated spectra do not follow the measured ones"
        return ""

    def figures(self, before: Values, after: Values) -> Sequence[Figure]:
        """Maps over control and frequency, or few lines: measured, simulated, and what is left.

        Args:
            before: predictions (rows,) at the start parameters.
            after: the same at the fitted parameters.
        """
        fitted = self.scaled(Prediction(np.asarray(after, dtype=float)), 1.0)
        maps = self._maps(fitted)
        return (lines_figure(maps) if len(self.spectra) <= MOST_LINES else maps.figure,)

    def _maps(self, fitted: FloatArray) -> ControlMaps:
        """The maps of fitted amplitudes (rows,); dB as the laboratory has them."""
        known = bool(np.all(self.sigma > 0.0))
        size = self.sigma * self.sizes if known else 0.01 * self.sizes
        left, unit = (self.seen_as(fitted) - self.measured) / size, "σ" if known else "% of maximum"
        shown, told = (self.measured, fitted), "" if self.unit == "1" else self.unit
        if self.logarithmic:
            left, unit = _decibels(fitted / self.measured), "dB"
            shown, told = (_decibels(self.measured), _decibels(fitted)), f"dB({told})"
        most = float(np.max(np.abs(left), initial=0.0)) or 1.0
        return ControlMaps(
            spectra=tuple(
                MappedSpectrum(
                    label=s.label,
                    settings=s.settings,
                    frequency_hz=s.u_hz,
                    measured=shown[0][mine],
                    fitted=shown[1][mine],
                    left=left[mine],
                    response=fitted[mine] / s.level,
                )
                for s, mine in zip(self.spectra, self.slices, strict=True)
            ),
            units=self.units,
            amplitude=Axis("amplitude", told.removesuffix("()")),
            rest=Axis("simulated - measured", unit, low=-most, high=most),
            series=self.series,
        )

    def part(self, labels: Collection[str]) -> Self | None:
        """The spectra at the places of these labels.

        Args:
            labels: of places.

        Raises:
            BadInput: a single spectrum is left.
        """
        kept = tuple(s for s in self.spectra if s.label in labels)
        return replace(self, spectra=kept) if kept else None

    def few_places(self) -> tuple[Self, BoolArray] | None:
        """Spectra at few values of the controls, the outermost ones and others evenly between."""
        kept = few_of([s.settings for s in self.spectra])
        if kept is None:
            return None
        rows = np.repeat(kept, [s.y.size for s in self.spectra])
        spectra = tuple(s for s, keep in zip(self.spectra, kept, strict=True) if keep)
        return replace(self, spectra=spectra), rows

    def within(self, setup: Setup, series: str) -> Self:
        """The same as part of a series, whose name stands before the labels.

        Args:
            setup: how the series drives the FMU.
            series: its name.
        """
        spectra = self.spectra
        if series and series != self.series:
            spectra = tuple(replace(s, label=f"{series}/{s.label}") for s in spectra)
        return replace(self, setup=setup, series=series, spectra=spectra)


def _decibels(a: FloatArray) -> FloatArray:
    return np.asarray(20.0 * np.log10(a))
