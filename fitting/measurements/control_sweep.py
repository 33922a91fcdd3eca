"""Control sweep: spectra of the response over drive frequency, one at each value of a control.

A control is a voltage, a capacitance, a flux, a temperature; laws of a campaign define which
variables of the FMU follow it. Whole spectra are fitted, and no line is assigned to a branch:

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
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from fitting.campaign.instruments.plain import LEAST_POINTS
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import Axis, Figure
from fitting.measurements.maps import MOST_LINES, ControlMaps, MappedSpectrum, lines_figure
from fitting.measurements.measurement import (
    Predicting,
    Prediction,
    Sampled,
    Scale,
    Values,
    without_drive,
)
from fitting.measurements.records import Curve, SweepsTogether
from fitting.measurements.residuals import ResidualCurve, mistakes
from fitting.signal.roughness import quadrature_noise, rician, roughness, roughness_freedom
from fitting.signal.scale import half_power_width
from fitting.signal.student import joined_freedom
from fitting.simulate.batch import Batch
from fitting.text.arguments import checked
from fitting.text.arrays import FloatArray, IntArray, Scalar, as_numbers, require_size
from fitting.text.errors import BadInput, NoScale
from fitting.text.finding import Finding, Kind


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
        if u.ndim != 1 or u.shape != y.shape or u.size < LEAST_POINTS:
            raise BadInput(
                f"{where}: frequencies of the shape {u.shape}, amplitudes {y.shape}; wanted (n,) "
                f"each, n at least {LEAST_POINTS}"
            )
        if not np.all(np.isfinite(u) & (u > 0.0)) or np.any(np.diff(u) <= 0.0):
            raise BadInput(f"{where}: wanted positive frequencies that rise strictly")
        if not np.all(np.isfinite(y) & (y >= 0.0)) or not np.any(y > 0.0):
            raise BadInput(f"{where}: wanted amplitudes from zero on, not all of them zero")
        require_size(u, f"{where}: frequencies")
        require_size(y, f"{where}: amplitudes")
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
    NOUN = "control sweep"

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
    def estimates_noise(self) -> bool:
        """Where it is estimated from each spectrum."""
        return self.estimated

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
        result = np.zeros((self.rows, self.solved_inside))
        values = self.scaled(prediction, 1.0)
        if self._is_rectified:
            values = rician(values, self._quadrature_noise(values)).slope * values
        values = values / self.sizes
        if self.logarithmic:
            values = np.ones(self.rows)
        for column, mine in zip(result.T, self.slices, strict=False):
            column[mine] = values[mine]
        return result

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
        result = []
        for s, mine in zip(self.spectra, self.slices, strict=True):
            values, share = s.y + residuals[mine] * s.largest, np.ones(s.y.size)
            slope = np.full(s.y.size, 1.0 / s.largest)
            if self.logarithmic:
                values, share = s.y * np.exp(residuals[mine]), s.y / s.largest
                slope = 1.0 / values
            result.append(
                ResidualCurve(
                    rows=np.arange(mine.start, mine.stop),
                    share=share,
                    axis=s.u_hz,
                    name=s.label,
                    columns=mistakes(s.u_hz, values, slope),
                    first_order=frozenset({Kind.offset} if self.logarithmic else ()),
                    model=values,
                    measured=s.y,
                )
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
