"""Control sweep: spectra of the response over drive frequency, one at each value of a control.

A control is a voltage, a capacitance, a flux, a temperature; laws of a campaign define which
variables of the FMU follow it. A place is one value of the controls. Whole spectra are fitted, and
no line is assigned to a branch; points that an instrument cut off are left out, with a finding:

    r_ki = (chi_k D_ki A_k(f_i) - L_ki)/max_i L_k

L measured, A simulated amplitude under the unit drive, D the drive at each frequency. The scale
chi_k is that of its spectrum, solved inside by weighted least squares, or one of all. Of amplitudes
in dB the rows are logarithms, ln(chi_k D A) - ln L: noise that is a share of each point would bias
a ratio whose denominator it is. Other amplitudes whose noise is known are magnitudes of quadratures
that have it, and larger than the response by what noise makes of it on average
(`fitting.signal.roughness`): M(chi_k D A) stands in place of chi_k D A.

Scales are real factors from simulated to measured amplitudes. For the rows i of
one scale chi, of all spectra or of a single one, with A simulated and L measured amplitudes and
weights w,

    chi = sum_i w_i A_i L_i / sum_i w_i A_i^2                     amplitudes
    ln chi = sum_i w_i (ln L_i - ln A_i) / sum_i w_i              amplitudes in dB
    chi minimises sum_i w_i (M(chi A_i) - L_i)^2                  magnitudes of noisy quadratures

(variable projection); M is the mean of a magnitude (`fitting.signal.roughness`). Unlike complex
gains (`fitting.measurements.gain`) scales are positive, there is no background with them, and the
last two do not enter linearly: the one is a mean of logarithms, the other takes steps.

Noise by the scatter about a smooth curve is too large where lines are a few points wide, and M(0)
with it: then the squares of each spectrum determine it, whose mean is
chi^2 A^2 + 2 s^2, as far as that is less,

    s^2 = sum_i v_i (L_i^2 - chi^2 A_i^2)/(2 sum_i v_i)           v_i = 1/(chi^2 A_i^2 + s^2)

Source: G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import numpy.typing as npt

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.instruments import LAYOUTS, read_trace
from fitting.campaign.instruments.plain import LEAST_POINTS, read_spectra_table
from fitting.campaign.instruments.recording import Channel, Recording, Selection, of_table, unit_of
from fitting.campaign.instruments.roles import AMPLITUDE, FREQUENCY
from fitting.campaign.kind import MeasurementTable
from fitting.campaign.measured import check_count, check_rising
from fitting.fmu.description import READABLE
from fitting.lines.excluded import clipped_points
from fitting.lines.names import MIN_SWEEP_POINTS
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import Axis, Figure
from fitting.measurements.maps import MOST_LINES, ControlMaps, MappedSpectrum, lines_figure
from fitting.measurements.measurement import (
    Measurement,
    Predicting,
    Prediction,
    Sampled,
    Scale,
    Scaling,
    Values,
)
from fitting.measurements.records import Curve, SweepsTogether, check_pair, check_words
from fitting.measurements.residuals import ResidualCurve, mistakes
from fitting.signal.amplitudes import Amplitude, declared_amplitude, to_peak
from fitting.signal.roughness import quadrature_noise, rician, roughness, roughness_freedom
from fitting.signal.scale import half_power_width
from fitting.signal.student import joined_freedom
from fitting.simulate.batch import Batch
from fitting.text.arguments import checked
from fitting.text.arrays import (
    BoolArray,
    ComplexArray,
    FloatArray,
    IntArray,
    Scalar,
    as_numbers,
)
from fitting.text.errors import BadInput, NoScale, gathered
from fitting.text.finding import Finding, Kind, left_out, of_kind
from fitting.text.formula import Formula
from fitting.text.notation import hertz, how_many
from fitting.text.schema import (
    FileName,
    Frequencies,
    Keys,
    Missing,
    OneOf,
    Quantity,
    Refused,
    Share,
    Text,
    Texts,
    Usually,
    Value,
    refusing,
)
from fitting.text.tables import Table, hertz_of, named_column
from fitting.text.units import Written, in_unit, sigma_in


@checked
@dataclass(frozen=True, eq=False)
class ControlSpectrum(Curve):
    """Amplitudes over drive frequency at one value of the controls.

    Args:
        frequency_hz: Frequencies of the tone, shape (n,), Hz, rising.
        amplitude: Peak amplitudes, shape (n,), in the unit of the control sweep.
        settings: Values of the controls and of variables of the FMU, by name.
        label: Its name; empty: the values of the controls.
        sigma: Standard deviations of the amplitudes, shape (n,) or one; 0: unknown.
        drive: Amplitude of the drive over its level, shape (n,) or one.
        left_out: Points of the file that are left out, with reasons.
        scattered: Whether ``sigma`` is the scatter about a smooth curve.

    Raises:
        BadInput: fewer than 8 points, shapes that differ, frequencies that do not rise, amplitudes
            that are negative or no numbers.
    """

    NOUN = "control sweep"

    frequency_hz: npt.ArrayLike
    amplitude: npt.ArrayLike
    settings: Mapping[str, Scalar]
    _: KW_ONLY
    label: str = ""
    sigma: npt.ArrayLike = 0.0
    drive: npt.ArrayLike = 1.0
    left_out: tuple[Finding, ...] = ()
    scattered: bool = False
    u_hz: FloatArray = field(init=False)
    y: FloatArray = field(init=False)
    sigmas: FloatArray = field(init=False)
    level: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        where = f"control sweep: spectrum at {self.label or dict(self.settings)}"
        u, y = (as_numbers(v, where) for v in (self.frequency_hz, self.amplitude))
        check_pair(where, "frequencies", u, "amplitudes", y)
        check_count(u.size, where)
        check_rising(u, where)
        if np.any(y < 0.0) or not np.any(y > 0.0):
            raise BadInput(f"{where}: wanted amplitudes from zero on, not all of them zero")
        object.__setattr__(self, "u_hz", u)
        object.__setattr__(self, "y", y)
        for name, value in (("sigmas", self.sigma), ("level", self.drive)):
            object.__setattr__(self, name, np.broadcast_to(as_numbers(value, where), u.shape))

    @cached_property
    def largest(self) -> float:
        """The largest amplitude."""
        return float(np.max(self.y))

    def scatter(self, *, rectified: bool = False) -> float:
        """Standard deviation of the amplitudes about a smooth curve; 0 where there are too few.

        Args:
            rectified: they are magnitudes of two quadratures; the result is the noise of each.
        """
        return quadrature_noise(self.y) if rectified else roughness(self.y)


#: A scale for each spectrum, one for all, or none.
SCALES = ("each", "shared", "none")
#: Steps towards the scale of magnitudes, and the share of itself that it keeps in one at least.
SCALE_STEPS, LEAST_SCALE = 2, 0.1
#: Rounds of weights by the noise that they tell, and the share of the scatter that is left of it.
NOISE_STEPS, LEAST_NOISE = 2, 0.3


@checked
@dataclass(frozen=True, kw_only=True)
class ControlSweep(SweepsTogether[ControlSpectrum]):
    """Spectra at several values of control quantities, one row for each point.

    Args:
        setup: How the FMU is driven and observed; its laws name the controls.
        spectra: Two or more.
        units: Units of the controls by name; not needed for variables of the FMU.
        scaled_by: "each": a scale for every spectrum; "shared": one for all; "none": 1.
        rectified: Whether amplitudes are magnitudes of two quadratures with noise sigma each.
        estimated: Whether unknown noise is the scatter of each spectrum; else it is that of the
            residuals of all.
        logarithmic: Whether the rows are differences of logarithms.
        output: The observed output of the FMU; empty: the setup's.
        unit: Of the amplitudes.
        series: Measurements of one series share their setup.

    Raises:
        BadInput: fewer than two spectra, two of one place, controls that differ from one another.
    """

    FIELD = "spectra"

    spectra: tuple[ControlSpectrum, ...]
    scaled_by: str = "each"
    rectified: bool = True
    estimated: bool = True
    logarithmic: bool = False
    output: str = ""
    unit: str = "V"

    def __post_init__(self) -> None:
        named = tuple(s if s.label else replace(s, label=self._label(s)) for s in self.spectra)
        if self.estimated:
            whole = self.rectified and not self.logarithmic
            named = tuple(
                s
                if np.all(s.sigmas > 0.0)
                else replace(s, sigma=s.scatter(rectified=whole), scattered=True)
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
        check_words(self, "control sweep", scaled_by=SCALES)

    def _label(self, spectrum: ControlSpectrum) -> str:
        return ", ".join(
            f"{value:g} {self.units.get(name, '')}".strip()
            if isinstance(value, float)
            else f"{name} = {value}"
            for name, value in spectrum.settings.items()
        )

    @property
    def noise_freedom(self) -> float:
        """Degrees of freedom of the noise of all rows, where each spectrum has its own noise."""
        if not self.estimated:
            return math.inf
        return joined_freedom((s.y.size, roughness_freedom(s.y.size)) for s in self.spectra)

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

    def detected_mean(self, amplitude: FloatArray) -> FloatArray:
        """What a detector makes of amplitudes on average, (rows,).

        Args:
            amplitude: under the drive and the scale, (rows,), in the unit of the control sweep.
        """
        if not self._is_rectified:
            return amplitude
        return rician(amplitude, self._quadrature_noise(amplitude)).mean

    @cached_property
    def measured_rows(self) -> FloatArray:
        """Measured amplitudes as rows; none where the scale is solved inside."""
        return self.measured / self.sizes if self.scaled_by == "shared" else np.zeros(self.rows)

    @property
    def scaling(self) -> Scaling:
        """Chi is the least-squares one over all points, where they share it."""
        return Scaling(from_rows=self.scaled_by == "shared")

    @property
    def solved_inside(self) -> int:
        """A scale for each spectrum."""
        return len(self.spectra) if self.scaled_by == "each" else 0

    def solved_blocks(self, prediction: Prediction) -> Sequence[FloatArray]:
        """Derivatives of the rows by each spectrum's own scale.

        Args:
            prediction: of all spectra, without scale.
        """
        if self.scaled_by != "each":
            return super().solved_blocks(prediction)
        values = self.scaled(prediction, 1.0)
        if self._is_rectified:
            values = rician(values, self._quadrature_noise(values)).slope * values
        values = np.ones(self.rows) if self.logarithmic else values / self.sizes
        return [values[mine, np.newaxis] for mine in self.slices]

    @property
    def line_width_hz(self) -> float | None:
        """Width of the line that the first spectrum shows, Hz."""
        first = self.spectra[0]
        result = half_power_width(first.u_hz, first.y)
        return result if result < np.ptp(first.u_hz) else None

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
        result = yield from self.responses(model, table, batch)
        levels = [s.level for s in self.spectra]
        return [
            Prediction(
                np.concatenate([np.abs(c[k]) * d for c, d in zip(result, levels, strict=True)])
            )
            for k in range(len(table))
        ]

    @property
    def ends(self) -> tuple[ControlSpectrum, ...]:
        """By whose drives the plan of the series is measured: the first and the last one."""
        return (self.spectra[0], self.spectra[-1])

    def output_of(self, record: ControlSpectrum) -> str:
        """The FMU's output, one for all.

        Args:
            record: one of the spectra.
        """
        return self.output or self.setup.output

    def sampled(self, model: DrivenModel, p: FloatArray, batch: Batch) -> list[Sampled]:
        """The run at the first point of the first spectrum.

        Args:
            model: how the FMU is driven, and by which plan.
            p: parameters (n,), each in its own unit.
            batch: where runs are asked for.
        """
        return [self.sampled_at(self.spectra[0], model, p, batch)]

    def scale(self, prediction: Prediction) -> Scale | None:
        """The least-squares scale of all points, where they share it.

        Args:
            prediction: of all spectra, without scale.
        """
        if self.scaled_by != "shared":
            return None
        [chi] = self._scales(np.asarray(prediction.values, dtype=float))
        return Scale(float(chi))

    def scaled(self, prediction: Prediction, chi: float) -> FloatArray:
        """Simulated amplitudes for the measured ones, (rows,), without noise.

        Args:
            prediction: of all spectra, without scale.
            chi: the scale of the series.
        """
        values = np.asarray(prediction.values, dtype=float)
        if self.scaled_by != "each":
            return chi * values
        return np.asarray(np.repeat(self._scales(values), self._counts) * values)

    def residuals(self, prediction: Prediction, chi: float) -> FloatArray:
        """(M(chi D A) - L)/max L of each spectrum, shape (rows,).

        Args:
            prediction: of all spectra, without scale.
            chi: the scale of the series.
        """
        scaled = self.scaled(prediction, chi)
        if self.logarithmic:
            return np.asarray(np.log(scaled / self.measured))
        return (self.detected_mean(scaled) - self.measured) / self.sizes

    # --- scales, solved inside -------------------------------------------------------------------

    @cached_property
    def _lengths(self) -> IntArray:
        """Rows of each spectrum, (spectra,), if squares determine its noise; else empty."""
        scattered = all(s.scattered for s in self.spectra)
        return np.array([s.y.size for s in self.spectra] if scattered else [])

    @cached_property
    def _counts(self) -> IntArray:
        """Numbers of rows that share a scale, (scales,), one after another."""
        shared = self.scaled_by == "shared"
        return np.array([self.rows] if shared else [s.y.size for s in self.spectra])

    def _scales(self, values: FloatArray) -> FloatArray:
        """Least-squares factors from values to measured amplitudes, (scales,).

        Args:
            values: simulated amplitudes under the drive, (rows,).

        Raises:
            NoScale: the model answers with nothing.
        """
        last = self._remembered.get(0)
        if last is None or last[0] is not values:
            last = self._remembered[0] = (values, self._solved(values))
        return last[1]

    def _quadrature_noise(self, scaled: FloatArray) -> FloatArray:
        """Noise of each quadrature under amplitudes, (rows,), at most that of the scatter.

        Args:
            scaled: simulated amplitudes under the drive and the scale, (rows,).
        """
        most = self._quadrature_sigma
        if not self._lengths.size:
            return most
        first, sigma = np.cumsum(self._lengths) - self._lengths, most
        for _ in range(NOISE_STEPS):
            weights = 1.0 / np.maximum(scaled**2 + sigma**2, np.finfo(float).tiny)
            left = np.add.reduceat(weights * (self.measured**2 - scaled**2), first)
            square = np.repeat(0.5 * left / np.add.reduceat(weights, first), self._lengths)
            sigma = np.sqrt(np.clip(square, (LEAST_NOISE * most) ** 2, most**2))
        return sigma

    @cached_property
    def _remembered(self) -> dict[int, tuple[FloatArray, FloatArray]]:
        """The last values and their scales: rows and figures ask for the same, no state."""
        return {}

    @cached_property
    def _starts(self) -> IntArray:
        """First row of every scale, (scales,)."""
        return np.cumsum(self._counts) - self._counts

    @cached_property
    def _weights(self) -> FloatArray:
        """Weights of all rows, (rows,), equal to a factor."""
        if self.logarithmic:
            sigma, unknown = self.sigma, np.ones(self.measured.size)
        else:
            sigma, unknown = self.sigma * self.sizes, self.sizes
        known = np.repeat(np.minimum.reduceat(sigma, self._starts) > 0.0, self._counts)
        return np.where(known, np.where(known, sigma, 1.0), unknown) ** -2

    def _sums(self, rows: FloatArray) -> FloatArray:
        """Sums over the rows of each scale, (scales,)."""
        return np.asarray(np.add.reduceat(rows, self._starts))

    def _solved(self, values: FloatArray) -> FloatArray:
        weights, output = self._weights, self.output or self.setup.output
        if self.logarithmic:
            if not np.all(values > 0.0):
                raise NoScale(f"{output}: the model answers with zero, which has no logarithm")
            apart = np.log(self.measured) - np.log(values)
            return np.exp(self._sums(weights * apart) / self._sums(weights))
        power = self._sums(weights * values**2)
        if not np.all(power > 0.0):
            raise NoScale(f"{output}: the model answers with nothing; wanted a response")
        result = self._sums(weights * values * self.measured) / power
        if np.any(self._quadrature_sigma > 0.0):
            return self._of_magnitudes(values, LEAST_SCALE * result)
        return result

    def _of_magnitudes(self, values: FloatArray, least: FloatArray) -> FloatArray:
        """Scales from the squares, whose mean is chi^2 values^2 + 2 sigma^2, by steps.

        They are those of Gauss and Newton; a fixed number of them keeps the rows smooth.
        """
        weights = self._weights
        shape = weights * values**2
        square = self._sums(shape * (self.measured**2 - 2.0 * self._quadrature_sigma**2))
        result = np.sqrt(np.maximum(square / self._sums(shape * values**2), least**2))
        for _ in range(SCALE_STEPS):
            scaled = np.repeat(result, self._counts) * values
            observed = rician(scaled, self._quadrature_noise(scaled))
            slopes = observed.slope * values
            pull = self._sums(weights * slopes * (self.measured - observed.mean))
            result = np.maximum(result + pull / self._sums(weights * slopes**2), least)
        return result

    # --- what the rows say -----------------------------------------------------------------------

    def share_left(self, residuals: FloatArray) -> float:
        """Root mean square of the worst spectrum; of logarithms NaN, they are shares of each point.

        Args:
            residuals: rows (rows,).
        """
        return math.nan if self.logarithmic else super().share_left(residuals)

    def residual_curves(self, residuals: FloatArray) -> Sequence[ResidualCurve]:
        """Every spectrum over frequency.

        Args:
            residuals: rows (rows,).
        """
        curves = super().residual_curves(residuals)
        if not self.logarithmic:
            return curves
        result = []
        for s, curve in zip(self.spectra, curves, strict=True):
            values = s.y * np.exp(residuals[curve.rows])
            columns = mistakes(s.u_hz, values, 1.0 / values)
            first = frozenset({Kind.offset})
            share = s.y / s.largest
            result.append(
                replace(curve, share=share, columns=columns, first_order=first, model=values)
            )
        return tuple(result)

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
        missed = self._misses_curve(self._shape - np.mean(self._shape), residuals)
        return "the simulated spectra do not follow the measured ones" if missed else ""

    def figures(self, before: Values, after: Values) -> Sequence[Figure]:
        """Maps over control and frequency, or few lines: measured, simulated, and what is left.

        Amplitudes in dB are drawn as such.

        Args:
            before: predictions (rows,) at the start parameters.
            after: the same at the fitted parameters.
        """
        fitted = self.scaled(Prediction(np.asarray(after, dtype=float)), 1.0)
        known = bool(np.all(self.sigma > 0.0))
        size = self.sigma * self.sizes if known else 0.01 * self.sizes
        left = (self.detected_mean(fitted) - self.measured) / size
        unit = "σ" if known else "% of maximum"
        measured, simulated, amplitude_unit = self.measured, fitted, self.unit
        if self.logarithmic:
            left, unit = 20.0 * np.log10(fitted / self.measured), "dB"
            measured, simulated = 20.0 * np.log10(measured), 20.0 * np.log10(fitted)
            amplitude_unit = "dB" if self.unit == "1" else f"dB({self.unit})"
        most = float(np.max(np.abs(left), initial=0.0)) or 1.0
        maps = ControlMaps(
            spectra=tuple(
                MappedSpectrum(
                    label=s.label,
                    settings=s.settings,
                    frequency_hz=s.u_hz,
                    measured=measured[mine],
                    fitted=simulated[mine],
                    left=left[mine],
                    response=fitted[mine] / s.level,
                )
                for s, mine in zip(self.spectra, self.slices, strict=True)
            ),
            units=self.units,
            amplitude=Axis("amplitude", amplitude_unit),
            rest=Axis("simulated - measured", unit, low=-most, high=most),
            series=self.series,
        )
        return (lines_figure(maps) if len(self.spectra) <= MOST_LINES else maps.figure,)


def cut_off(
    u_hz: FloatArray, values: FloatArray | ComplexArray, unit: str, source: str
) -> tuple[BoolArray, tuple[Finding, ...]]:
    """Points that are cut off, (n,), and a finding on them; none where too few would be left.

    Args:
        u_hz: frequencies of the tone, rising, shape (n,), Hz.
        values: amplitudes, or X + i Y, shape (n,).
        unit: of the values.
        source: name of the file, with the curve.
    """
    cut, limit = clipped_points(u_hz, values)
    if not np.any(cut) or np.sum(~cut) < MIN_SWEEP_POINTS:
        return np.zeros(cut.size, dtype=np.bool_), ()
    ends = {"low_hz": float(u_hz[cut][0]), "high_hz": float(u_hz[cut][-1])}
    numbers = {"limit": limit, "parts": float(np.iscomplexobj(values)), **ends}
    result = left_out(source, int(np.sum(cut)), **numbers)
    return cut, (replace(result, names={**result.names, "unit": (unit,)}),)


#: Column that names the file of each spectrum.
FILE = "file"
#: Columns that a spectrum's own points, or their file, are in.
OWN_COLUMNS = ("frequency", "amplitude", FILE)


@dataclass(frozen=True, kw_only=True)
class ControlPlace:
    """One value of the controls: its label, the controls as written, its rows in the table (n,).

    ``file`` is that of the spectrum: its own, or the table.
    """

    label: str
    controls: Mapping[str, Written]
    rows: IntArray
    file: Path


@dataclass(frozen=True, kw_only=True)
class ControlTable(MeasurementTable):
    """What was changed from spectrum to spectrum, and what of each is fitted."""

    controls: Texts
    """Columns with units of the control quantities: of laws, or variables of the FMU."""
    range: Annotated[Frequencies | None, Usually(None)] = None
    """First and last fitted frequency."""
    file: FileName
    """A table of all points, or of a spectrum's own file in each row."""

    def check_controls(self, *own: str) -> None:
        """Refuse controls that are none, and a range that is none.

        Args:
            own: further columns of a spectrum's own points.

        Raises:
            Refused: names the key.
        """
        if not self.controls:
            raise Refused("is empty, wanted at least one column", "controls")
        points = {named_column(each, 0).name.lower() for each in (*OWN_COLUMNS, *own) if each}
        for name in self.controls:
            if name.lower() in points:
                raise Refused(
                    f"'{name}' is the axis of a spectrum or a measured quantity; wanted columns of "
                    "what was changed from spectrum to spectrum",
                    "controls",
                )
        if self.range is None:
            return
        if len(self.range) != 2:
            raise Refused(
                f"{how_many(len(self.range), 'value')}, wanted the first and last one", "range"
            )
        with refusing("range"):
            low, high = self.range_hz
        if not low < high:
            raise Refused(
                f"from {hertz(low)} to {hertz(high)}, wanted the smaller frequency first", "range"
            )

    @property
    def range_hz(self) -> tuple[float, float]:
        """First and last frequency that is fitted, Hz; without a range all."""
        if self.range is None:
            return 0.0, float("inf")
        low, high = (in_unit(w, "Hz") for w in self.range)
        return low, high

    def read(self) -> ReadSpectra:
        """Its files: spectra in Hz, controls as written.

        Raises:
            BadInput: one line with file, row, column or key, what was found, what is wanted.
        """
        table = read_spectra_table(self.file)
        places = self._places(table)
        read = partial(self.spectrum_at, of_table(table))
        try:
            spectra = gathered([partial(read, place) for place in places])
        except BadInput as error:
            if table.find(FILE) is not None:
                raise
            # one table: what is wrong with its first spectrum is mostly wrong with all
            further = f" (and {len(error.args) - 1} more such complaints)" * (len(error.args) > 1)
            raise BadInput(f"{error.args[0]}{further}") from error
        return ReadSpectra(self, places, tuple(spectra))

    def spectrum_at(self, recording: Recording, place: ControlPlace) -> Any:
        """The spectrum of a place, without what depends on the FMU.

        Args:
            recording: of the table.
            place: one value of the controls.

        Raises:
            BadInput: the spectrum cannot be read.
        """
        raise NotImplementedError

    def bind_spectra(
        self, places: Sequence[ControlPlace], spectra: Sequence[Any], binder: Binder, setup: Setup
    ) -> Measurement:
        """The spectra in the names and units of the FMU, as one measurement.

        Args:
            places: one value of the controls each.
            spectra: of the places.
            binder: of the campaign to its FMU.
            setup: how the campaign drives the FMU.

        Raises:
            BadInput: a variable that is not there, a unit or a value that does not fit.
        """
        raise NotImplementedError

    def control_units(self, binder: Binder) -> dict[str, str]:
        """Units of the controls: of laws, or of the FMU's own variables.

        Args:
            binder: of the campaign to its FMU.
        """
        return {
            name: binder.control_units.get(name)
            or getattr(binder.variables.get(name), "unit", None)
            or ""
            for name in self.controls
        }

    def inside(self, frequency_hz: FloatArray, where: str) -> BoolArray:
        """Which points of a spectrum lie within the range that is fitted, (n,).

        Args:
            frequency_hz: of the points, (n,), Hz.
            where: what errors name.

        Raises:
            BadInput: fewer than a spectrum has.
        """
        low, high = self.range_hz
        kept = (frequency_hz >= low) & (frequency_hz <= high)
        kept &= frequency_hz > 0.0  # spectra of Fourier transforms begin with a constant
        count = int(np.count_nonzero(kept))
        if count < LEAST_POINTS:
            between = "" if high == np.inf else f" from {hertz(low)} to {hertz(high)}"
            raise BadInput(
                f"{where} has {how_many(count, 'point')} to fit{between}; wanted at least "
                f"{LEAST_POINTS}"
            )
        return np.asarray(kept)

    def _places(self, table: Table) -> tuple[ControlPlace, ...]:
        """The values of the controls in a table, in its order: a row each, where it names files."""
        columns = [table.column(name) for name in self.controls]
        units = [unit_of(table, c, f"{c.name} (V)") for c in columns]
        values = np.column_stack([table.numbers(c) for c in columns])
        listed = table.find(FILE)
        if listed is not None:
            rows = [np.array([i]) for i in range(len(values))]
            files = [table.path.parent / name for name in table.texts(listed)]
        else:
            _, first, group = np.unique(values, axis=0, return_index=True, return_inverse=True)
            order = np.argsort(first)  # as the file has them
            rows = [np.flatnonzero(group.ravel() == k) for k in order]
            files = [table.path] * len(rows)
        places: dict[str, ControlPlace] = {}
        for own, file in zip(rows, files, strict=True):
            line, names = table.lines[own[0]], zip(columns, values[own[0]], units, strict=True)
            controls = {
                c.name: Written(float(v), unit, f"{table.path}: row {line}, '{c.name}'")
                for c, v, unit in names
            }
            label = ", ".join(f"{w.value:g} {w.unit}".removesuffix(" 1") for w in controls.values())
            if label in places:
                raise BadInput(
                    f"{table.path}: row {line}: is the second spectrum at {label}; wanted one"
                )
            places[label] = ControlPlace(label=label, controls=controls, rows=own, file=file)
        control_names = ", ".join(self.controls)
        if len(places) < 2:
            raise BadInput(
                f"{table.path}: one spectrum, at {next(iter(places))}; wanted several values of "
                f"{control_names}"
            )
        most = max(place.rows.size for place in places.values())
        if listed is None and most < LEAST_POINTS:
            raise BadInput(
                f"{table.path}: {len(places)} values of {control_names}, at each "
                f"{how_many(most, 'point')} or fewer; wanted at least {LEAST_POINTS} at each (rows "
                f"of one spectrum have the very same value of {control_names})"
            )
        return tuple(places.values())


@dataclass(frozen=True)
class ReadSpectra:
    """Spectra of a table as their files have them, one for each of its `places`."""

    table: ControlTable
    places: tuple[ControlPlace, ...]
    spectra: tuple[Any, ...]

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that were read, each once."""
        return tuple(dict.fromkeys((self.table.file, *(place.file for place in self.places))))

    def bind(self, binder: Binder, setup: Setup) -> Measurement:
        """The same with the controls in the units of laws and of the FMU."""
        return self.table.bind_spectra(self.places, self.spectra, binder, setup)


#: A line is looked for so far from its harmonic, in fundamentals: odd ones are two apart.
REACH = 0.8


@dataclass(frozen=True, kw_only=True)
class WrittenSpectrumColumns(Keys):
    """Names of a spectrum's columns where they are not the usual ones (empty)."""

    frequency: Text = ""
    """Column of frequencies."""
    amplitude: Text = ""
    """Column of amplitudes."""


@dataclass(frozen=True, kw_only=True)
class ControlSweepTable(ControlTable):
    """Spectra over drive frequency at several values of a control quantity, fitted as a whole."""

    TABLE: ClassVar[str] = "control_sweep"

    file: FileName
    """A row for each point: controls, frequency, amplitude; or for each spectrum: controls, and its
    file in the column file; or amplitudes of each value of one control: a column headed as "V=1.2
    V", or a row below a head of frequencies."""
    amplitude: Annotated[
        Text, Missing('wanted "V peak", "V rms", "dBm" or "dB"; files do not state which they mean')
    ]
    """Unit of the amplitudes: "V peak", "V rms", "dBm", "dB" (to an unknown reference), or another
    as "m peak"."""
    impedance: Annotated[float | None, Quantity("ohm")] = None
    """Required with dBm, and only there."""
    layout: Annotated[Text | None, OneOf(LAYOUTS)] = None
    """Format of the instrument; without it recognised."""
    columns: WrittenSpectrumColumns = field(default_factory=WrittenSpectrumColumns)
    """Columns of other than the usual names, with unit as "X1 (mV)" if the file states none."""
    sigma: Value | None = None
    """Standard deviation of every amplitude, as "0.1 uV"; without it and relative each spectrum's
    scatter about a smooth curve."""
    relative: Share = 0.0
    """Standard deviation of every amplitude over it, next to sigma."""
    scale: Annotated[Text, OneOf(SCALES)] = "each"
    """From simulated to measured amplitudes: one for "each" spectrum, one "shared" by all; "none":
    1."""
    rectified: bool = True
    """Whether amplitudes are magnitudes of two quadratures with noise sigma each, as of lock-in
    amplifiers and analysers."""
    drive: Text | None = None
    """Amplitude of the drive over its level: a column, or a formula of frequency f and constants,
    as "f0/f" of a square wave."""
    lines: Annotated[float | None, Quantity("Hz")] = None
    """Fundamental of a periodic drive: only the odd harmonics of each spectrum are used, the peak
    within 0.8 of it."""
    output: Text | None = None
    """The observed FMU output; without it that of [observe]."""

    def __post_init__(self) -> None:
        with refusing("amplitude"):
            declared_amplitude(self.amplitude, self.impedance, "")
        self.check_controls(*vars(self.columns).values())
        if self.scale == "none" and self.amplitude == "dB":
            raise Refused(
                'wanted "each" or "shared": dB have a reference that is not known', "scale"
            )

    @property
    def detector(self) -> Amplitude:
        """What the amplitudes mean."""
        return declared_amplitude(self.amplitude, self.impedance, "")

    def spectrum_at(self, recording: Recording, place: ControlPlace) -> ControlSpectrum:
        """The peak amplitudes of a place in Hz, with the drive where a column states it."""
        drive: FloatArray | None = None
        if place.file != recording.path:
            wanted = Selection(frequency=self.columns.frequency, amplitude=self.columns.amplitude)
            raw = read_trace(place.file, self.layout, wanted)
            f = raw.frequency * _hertz(raw.frequency_unit, f"{place.file}: column 'frequency'")
            sizes, unit, rows = raw.amplitude, raw.amplitude_unit, raw.places
            other = of_kind(raw.left_out, Kind.other_columns)
        else:
            f, sizes, unit, drive, other = self._points(recording, place.rows)
            rows = tuple(recording.places[i] for i in place.rows)
        amplitude = to_peak(sizes, unit, self.detector, str(place.file), rows)
        if self.lines is not None:
            f, amplitude, bins = odd_harmonics(f, amplitude, self.lines)
            drive = None if drive is None else drive[bins]
        where = f"{place.file}: the spectrum at {place.label}"
        kept = self.inside(f, where)
        if not np.any(amplitude[kept] > 0.0):
            raise BadInput(f"{where}: every amplitude is zero; wanted a resonance")
        return ControlSpectrum(
            f[kept],
            amplitude[kept],
            {},
            label=place.label,
            drive=1.0 if drive is None else drive[kept],
            left_out=other,
        )

    def _points(
        self, recording: Recording, rows: IntArray
    ) -> tuple[FloatArray, FloatArray, str, FloatArray | None, tuple[Finding, ...]]:
        """Frequencies in Hz, amplitudes, their unit and the drive in rows of a table, (n,) each.

        And a note of columns that vary within a spectrum and are not used.
        """
        path, places = recording.path, [recording.places[i] for i in rows]
        taken = {name.lower() for name in (*self.controls, self.drive or "")}

        def column(name: str, usual: Sequence[str]) -> Channel:
            """The column of the wanted name, else of the first usual one that is no control."""
            if name:
                return recording.column(name)
            there = (recording.find(each) for each in usual if each not in taken)
            first = next((each for each in there if each is not None), None)
            return first or recording.column(usual[0])

        frequency = column(self.columns.frequency, FREQUENCY)
        amplitude = column(self.columns.amplitude, AMPLITUDE)
        unit = unit_of(recording, frequency, "frequency (Hz)")
        hertz = _hertz(unit, f"{path}: column '{frequency.name}'")
        f = hertz * recording.numbers(frequency)[rows]
        for i in np.flatnonzero(f < 0.0)[:1]:
            raise BadInput(
                f"{path}: {places[i]}: frequency {f[i]:.12g} Hz; wanted one from zero on"
            )
        for i in np.flatnonzero(np.diff(f) <= 0.0)[:1]:
            raise BadInput(
                f"{path}: {places[i + 1]}: frequency {f[i + 1]:.12g} Hz follows {f[i]:.12g} Hz; "
                "wanted strictly rising ones at each value of the controls"
            )
        unit = unit_of(recording, amplitude, "amplitude (uV)")
        values = recording.numbers(amplitude)[rows]
        driven = recording.find(self.drive) if self.drive else None
        drive = None if driven is None else recording.numbers(driven)[rows]
        if drive is not None and np.any(drive <= 0.0):
            bad = places[int(np.argmax(drive <= 0.0))]
            raise BadInput(f"{path}: {bad}, column '{self.drive}': wanted more than zero")
        other = recording.part(rows).unused(frequency, amplitude, driven)
        return f, values, unit, drive, other

    def bind_spectra(
        self,
        places: Sequence[ControlPlace],
        spectra: Sequence[ControlSpectrum],
        binder: Binder,
        setup: Setup,
    ) -> ControlSweep:
        """The spectra with the controls in the units of laws and of the FMU."""
        where, unit = f"{setup.source}: [control_sweep]", self.detector.unit
        names: list[Callable[[], object]] = []
        if self.output:
            names += [partial(binder.real, self.output, f"{where} output", READABLE, "observed")]
        # one column: what is wrong with it is reported once
        names += [partial(sigma_in, self.sigma, unit), partial(binder.settings, places[0].controls)]
        gathered(names)
        sigma = sigma_in(self.sigma, unit)
        bound = []
        for place, spectrum in zip(places, spectra, strict=True):
            level = self._level(spectrum, f"{where} drive")
            source = f"{place.file}{f', {place.label}' * bool(place.label)}"
            cut, left_out = cut_off(spectrum.u_hz, spectrum.y, unit, source)
            settings = {n: float(binder.setting(n, w)) for n, w in place.controls.items()}
            bound.append(
                replace(
                    spectrum,
                    frequency_hz=spectrum.u_hz[~cut],
                    amplitude=spectrum.y[~cut],
                    settings=settings,
                    sigma=np.hypot(sigma, self.relative * spectrum.y)[~cut],
                    drive=level[~cut],
                    left_out=(*spectrum.left_out, *left_out),
                )
            )
        return ControlSweep(
            setup=setup,
            spectra=tuple(bound),
            units=self.control_units(binder),
            scaled_by=self.scale,
            rectified=self.rectified,
            estimated=self.sigma is None and not self.relative and self.lines is None,
            logarithmic=self.detector.kind == "dB",
            output=self.output or "",
            unit=unit,
        )

    def _level(self, spectrum: ControlSpectrum, where: str) -> FloatArray:
        """Amplitude of the drive over its level, at every point of a spectrum."""
        if self.drive is None or np.ndim(spectrum.drive):  # none, or a column of the file
            return spectrum.level
        formula = Formula(self.drive, where)
        if formula.names != ("f",):
            raise BadInput(
                f"{formula.where}: '{formula.text}' is neither a column of the file nor a formula "
                "of the frequency f alone, in Hz"
            )
        values = formula.value({"f": spectrum.u_hz})
        if not np.all(np.isfinite(values) & (values > 0.0)):
            raise BadInput(
                f"{formula.where}: '{formula.text}' is no positive number at all frequencies"
            )
        return np.asarray(values)


def _hertz(unit: str, where: str) -> float:
    """Hz in one of the unit: of many points at once, each rounded twice."""
    return float(hertz_of([1.0], unit, where=where)[0])


def odd_harmonics(
    frequency_hz: FloatArray, amplitude: FloatArray, fundamental_hz: float
) -> tuple[FloatArray, FloatArray, IntArray]:
    """The odd harmonics of a periodic drive that a spectrum shows: Hz, amplitude, point, (k,) each.

    Of the points within 0.8 fundamentals of a harmonic the highest is taken if it is above both
    its neighbours; the amplitude is that of the parabola through the logarithms of the three, which
    is the line's own where the window of the transform is smooth, not the one of the nearest bin.

    Args:
        frequency_hz: of the points, (n,), Hz, rising.
        amplitude: of the points, (n,).
        fundamental_hz: frequency of the drive's period, Hz.
    """
    f, a = frequency_hz, amplitude
    result = []
    for n in range(1, int(f[-1] / fundamental_hz) + 1, 2):
        near = np.flatnonzero(np.abs(f - n * fundamental_hz) < REACH * fundamental_hz)
        k = int(near[np.argmax(a[near])]) if near.size else 0
        if not 0 < k < f.size - 1 or min(a[k - 1 : k + 2]) <= 0.0:
            continue
        left, top, right = np.log(a[k - 1 : k + 2])
        bend = left - 2.0 * top + right
        if bend < 0.0 and top >= max(left, right):
            height = top - (left - right) ** 2 / (8.0 * bend)
            result.append((n * fundamental_hz, float(np.exp(height)), k))
    lines, heights, points = np.array(result).reshape(-1, 3).T
    return lines, heights, points.astype(int)
