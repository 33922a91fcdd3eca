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
from collections.abc import Collection, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, ClassVar, Self

import numpy as np
import numpy.typing as npt

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.control_table import (
    LEAST_POINTS,
    MeasuredSpectrum,
    SpectraFormat,
    read_spectra,
)
from fitting.campaign.file import TraceFormat
from fitting.campaign.instruments import LAYOUTS, PLAIN, Selection
from fitting.campaign.kind import MeasurementTable
from fitting.fmu.variables import READABLE
from fitting.measurements.control_maps import ControlMaps
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import Figure
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
from fitting.measurements.response_curve import ResponseCurve, together
from fitting.measurements.tones import PLATEAU
from fitting.signal.amplitudes import declared_amplitude
from fitting.signal.magnitude import mean_magnitude
from fitting.signal.scale import half_power_width
from fitting.simulate.batch import Batch, Workers
from fitting.simulate.drive import Drive
from fitting.text.arrays import FloatArray, IntArray, Scalar
from fitting.text.errors import BadInput, NoScale
from fitting.text.formula import Formula
from fitting.text.keys import (
    FileName,
    Frequencies,
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
from fitting.text.written import in_unit

SCALES = ("each", "shared", "none")
#: Differences of this order leave noise alone where a curve is resolved; its weight on white noise.
DIFFERENCES, WEIGHT = 4, float(np.sqrt(70.0))
#: Spectra with fewer points say nothing of their noise by themselves.
LEAST_FOR_NOISE = 50
#: Median of |x| of a normal distribution of unit variance.
MEDIAN_OF_NORMAL = 0.6744897501960817
#: Steps towards the scale of magnitudes, and the share of itself that it keeps in one at least.
SCALE_STEPS, LEAST_SCALE = 2, 0.1
#: Residuals below this share of the maximum are no misfit.
SMALLEST_MISFIT = 1e-3


@dataclass(frozen=True, kw_only=True)
class ControlSweepTable(MeasurementTable):
    """Spectra over drive frequency at several values of a control quantity, fitted as a whole."""

    TABLE: ClassVar[str] = "control_sweep"

    file: FileName
    """Either all points, a row each: the controls, frequency, amplitude; or a row for each
    spectrum: the controls, and in the column file the name of the spectrum's own file."""
    controls: Texts
    """Columns of the control quantities, each with its unit: what laws name, or variables of the
    FMU."""
    amplitude: Annotated[
        Text, Missing('wanted "V peak", "V rms", "dBm" or "dB"; files do not tell which they mean')
    ]
    """What the amplitudes mean: "V peak", "V rms", "dBm", "dB" (to a reference that nobody knows),
    or another detector unit likewise, as "m peak"."""
    impedance: Annotated[float | None, Quantity("ohm")] = None
    """With dBm only, and required there."""
    layout: Annotated[Text | None, OneOf(LAYOUTS), Usually(PLAIN)] = None
    """How the instrument writes the spectra's own files."""
    sigma: Value | None = None
    """Standard deviation of every amplitude, as "0.1 uV"; without it, and without relative, that of
    every spectrum is estimated from how its points scatter about a smooth curve."""
    relative: Share = 0.0
    """Standard deviation of every amplitude as a share of it, beside sigma."""
    scale: Annotated[Text, OneOf(SCALES)] = "each"
    """From simulated to measured amplitudes: "each": one for every spectrum, "shared": one for all;
    "none": 1."""
    rectified: bool = True
    """Whether amplitudes are magnitudes of two quadratures with the noise sigma each, as those of
    lock-in and network analysers and of Fourier transforms are: noise then makes them larger."""
    drive: Text | None = None
    """Amplitude of the drive at each frequency, relative to the level: a column of the file, or a
    formula of the frequency f and of constants, as "f0/f" for the harmonics of a square wave."""
    lines: Annotated[float | None, Quantity("Hz")] = None
    """Fundamental of a periodic drive: of each spectrum the odd harmonics are picked, the highest
    point within 0.8 of it, refined by a parabola through the logarithms beside it."""
    range: Annotated[Frequencies | None, Usually(None)] = None
    """First and last frequency that is fitted."""
    output: Text | None = None
    """The FMU output that is seen; without it that of [observe]."""

    def __post_init__(self) -> None:
        with refusing("amplitude"):
            declared_amplitude(self.amplitude, self.impedance, "")
        if not self.controls:
            raise Refused("is empty, wanted at least one column", "controls")
        if self.range is not None and len(self.range) != 2:
            raise Refused(f"{len(self.range)} values, wanted the first and last one", "range")
        if self.scale == "none" and self.amplitude == "dB":
            raise Refused(
                'wanted "each" or "shared": dB have a reference that nobody knows', "scale"
            )

    def read(self) -> ReadControlSweep:
        """Its files: Hz, peak amplitudes, controls as written."""
        first, last = 0.0, float("inf")
        if self.range is not None:
            first, last = (in_unit(w, "Hz") for w in self.range)
        how = SpectraFormat(
            trace=TraceFormat(
                layout=self.layout or PLAIN,
                amplitude=declared_amplitude(self.amplitude, self.impedance, ""),
                selection=Selection(),
            ),
            controls=self.controls,
            drive_column=self.drive or "",
            fundamental_hz=self.lines,
            range_hz=(first, last),
        )
        return ReadControlSweep(self, how, read_spectra(self.file, how))


@dataclass(frozen=True)
class ReadControlSweep:
    """Spectra as `table` tells of them, and as their files have them."""

    table: ControlSweepTable
    format: SpectraFormat
    spectra: tuple[MeasuredSpectrum, ...]

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that were read."""
        own = (s.source for s in self.spectra if s.source != self.table.file)
        return (self.table.file, *own)

    def bind(self, binder: Binder, setup: Setup) -> ControlSweep:
        """The same with the controls in the units of laws and of the FMU."""
        table, where = self.table, f"{setup.source}: [control_sweep]"
        if table.output:
            binder.real(table.output, f"{where} output", READABLE, "observed")
        unit = self.format.trace.amplitude.unit
        sigma = 0.0 if table.sigma is None else in_unit(table.sigma, unit)
        return ControlSweep(
            setup=setup,
            spectra=tuple(
                ControlSpectrum(
                    s.frequency_hz,
                    s.amplitude,
                    {name: float(binder.setting(name, w)) for name, w in s.controls.items()},
                    label=s.label,
                    sigma=np.hypot(sigma, table.relative * s.amplitude),
                    drive=self._drive(s, setup, where),
                )
                for s in self.spectra
            ),
            units={
                name: binder.control_units.get(name)
                or getattr(binder.variables.get(name), "unit", None)
                or ""
                for name in table.controls
            },
            scaled_by=table.scale,
            rectified=table.rectified,
            estimated=table.sigma is None and not table.relative and table.lines is None,
            logarithmic=self.format.trace.amplitude.kind == "dB",
            output=table.output or "",
            unit=unit,
        )

    def _drive(self, spectrum: MeasuredSpectrum, setup: Setup, where: str) -> FloatArray:
        """Amplitude of the drive over its level, at every point of a spectrum."""
        if spectrum.drive is not None:
            return spectrum.drive
        if self.table.drive is None:
            return np.ones(spectrum.frequency_hz.size)
        formula = Formula(self.table.drive, f"{where} drive")
        if formula.names != ("f",):
            raise BadInput(
                f"{formula.where}: '{formula.text}' is neither a column of the file nor a formula "
                "of the frequency f alone, in Hz"
            )
        values = formula.value({"f": spectrum.frequency_hz})
        if not np.all(np.isfinite(values) & (values > 0.0)):
            raise BadInput(
                f"{formula.where}: '{formula.text}' is no positive number at all frequencies"
            )
        return np.asarray(values)


@dataclass(frozen=True, eq=False)
class ControlSpectrum:
    """Amplitudes over drive frequency at one value of the controls.

    Args:
        frequency_hz: Frequencies of the tone, shape (n,), Hz, rising.
        amplitude: Measured peak amplitudes, shape (n,), in the unit of the control sweep.
        settings: Values of the controls, and of variables of the FMU, by name.
        label: Name of the place; empty: the values of the controls.
        sigma: Standard deviations of the amplitudes, shape (n,) or one; 0: not known.
        drive: Amplitude of the drive over its level, shape (n,) or one.

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
    u_hz: FloatArray = field(init=False)
    y: FloatArray = field(init=False)
    sigmas: FloatArray = field(init=False)
    level: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        u, y = (np.asarray(v, dtype=float) for v in (self.frequency_hz, self.amplitude))
        where = f"control sweep: spectrum at {self.label or dict(self.settings)}"
        if u.ndim != 1 or u.shape != y.shape or u.size < LEAST_POINTS:
            raise BadInput(
                f"{where}: frequencies of the shape {u.shape}, amplitudes {y.shape}; wanted (n,) "
                f"each, n at least {LEAST_POINTS}"
            )
        if not np.all(np.isfinite(u) & (u > 0.0)) or np.any(np.diff(u) <= 0.0):
            raise BadInput(f"{where}: wanted positive frequencies that rise strictly")
        if not np.all(np.isfinite(y) & (y >= 0.0)) or not np.any(y > 0.0):
            raise BadInput(f"{where}: wanted amplitudes from zero on, not all of them zero")
        object.__setattr__(self, "u_hz", u)
        object.__setattr__(self, "y", y)
        for name, value in (("sigmas", self.sigma), ("level", self.drive)):
            object.__setattr__(self, name, np.broadcast_to(np.asarray(value, dtype=float), u.shape))

    @cached_property
    def largest(self) -> float:
        """The largest amplitude."""
        return float(np.max(self.y))

    def scatter(self) -> float:
        """Standard deviation of the amplitudes about a smooth curve; 0 where too few tell it.

        Median of |fourth differences|, which leave noise alone where the curve is resolved.
        """
        if self.y.size < LEAST_FOR_NOISE:
            return 0.0
        left = np.diff(self.y, DIFFERENCES) / WEIGHT
        return float(np.median(np.abs(left))) / MEDIAN_OF_NORMAL


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
            named = tuple(
                s if np.all(s.sigmas > 0.0) else replace(s, sigma=s.scatter()) for s in named
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

    def planned(self, plan: Plan) -> Plan:
        """Nothing of its own to plan before the FMU is looked at.

        Args:
            plan: settings, settling and windows.
        """
        return plan

    def refined(self, model: DrivenModel, points: Sequence[FloatArray], workers: Workers) -> Plan:
        """The plan with few runs for each spectrum, where the FMU is linear.

        Args:
            model: the FMU as the series drives it.
            points: parameter vectors (n,) at which it is measured.
            workers: of the FMU.
        """
        for s in self.spectra:
            top_hz = float(s.u_hz[int(np.argmax(s.y))])
            plan = self._curve(model, s).planned(s.u_hz, points, workers, top_hz)
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
        chi = self._scales(np.asarray(prediction.values, dtype=float))
        return Scale(float(chi[0]))

    @cached_property
    def _parts(self) -> tuple[IntArray, IntArray]:
        """Rows that share a scale: first row and number of rows of each part."""
        if self.scaled_by == "shared":
            return np.array([0]), np.array([self.rows])
        return np.array([s.start for s in self.slices]), np.array([s.y.size for s in self.spectra])

    @cached_property
    def _weights(self) -> FloatArray:
        """Weights of all rows in the least squares of a scale, (rows,), equal to a factor."""
        starts, counts = self._parts
        if self.logarithmic:
            sigma, unknown = self.sigma, np.ones(self.rows)
        else:
            sigma, unknown = self.sigma * self.sizes, self.sizes
        known = np.repeat(np.minimum.reduceat(sigma, starts) > 0.0, counts)
        return np.where(known, np.where(known, sigma, 1.0), unknown) ** -2

    @cached_property
    def _remembered(self) -> dict[int, tuple[FloatArray, FloatArray]]:
        """The last values and their scales: rows and figures ask for the same, no state."""
        return {}

    def _scales(self, values: FloatArray) -> FloatArray:
        """Weighted least-squares factors from values to measured amplitudes, (parts,)."""
        last = self._remembered.get(0)
        if last is None or last[0] is not values:
            last = self._remembered[0] = (values, self._solved_scales(values))
        return last[1]

    def _solved_scales(self, values: FloatArray) -> FloatArray:
        starts, counts = self._parts
        weights = self._weights
        if self.logarithmic:
            if not np.all(values > 0.0):
                raise NoScale(f"{self.seen}: the model answers with zero, which has no logarithm")
            apart = weights * (np.log(self.measured) - np.log(values))
            means: FloatArray = np.add.reduceat(apart, starts) / np.add.reduceat(weights, starts)
            return np.exp(means)
        power = np.add.reduceat(weights * values**2, starts)
        if not np.all(power > 0.0):
            raise NoScale(f"{self.seen}: the model answers with nothing; wanted a response")
        found = np.add.reduceat(weights * values * self.measured, starts) / power
        if not self._is_rectified:
            return found
        # from what the squares say, whose mean is chi^2 values^2 + 2 sigma^2, by steps of Gauss and
        # Newton; a fixed number of them keeps the rows smooth
        sigma, least = self._quadrature_sigma, LEAST_SCALE * found
        shape = weights * values**2
        square = np.add.reduceat(shape * (self.measured**2 - 2.0 * sigma**2), starts)
        square /= np.add.reduceat(shape * values**2, starts)
        found = np.sqrt(np.maximum(square, least**2))
        for _ in range(SCALE_STEPS):
            seen = mean_magnitude(np.repeat(found, counts) * values, sigma)
            slopes = seen.slope * values
            pull = np.add.reduceat(weights * slopes * (self.measured - seen.mean), starts)
            found = np.maximum(found + pull / np.add.reduceat(weights * slopes**2, starts), least)
        return found

    def scaled(self, prediction: Prediction, chi: float) -> FloatArray:
        """Simulated amplitudes beside the measured ones, (rows,), without noise.

        Args:
            prediction: of all spectra, without scale.
            chi: the scale of the series.
        """
        values = np.asarray(prediction.values, dtype=float)
        if self.scaled_by != "each":
            return chi * values
        return np.asarray(np.repeat(self._scales(values), self._parts[1]) * values)

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

    def unexplained(self, residuals: FloatArray) -> str:
        """Spectra of whose variance less than half is explained are not described.

        Args:
            residuals: rows (rows,).
        """
        shape = np.log(self.measured) if self.logarithmic else self.measured / self.sizes
        spread, left = float(np.sum((shape - np.mean(shape)) ** 2)), float(residuals @ residuals)
        if left > PLATEAU * spread and left > SMALLEST_MISFIT**2 * residuals.size:
            return "the simulated spectra do not follow the measured ones"
        return ""

    def figures(self, before: Values, after: Values) -> Sequence[Figure]:
        """Maps over control and frequency: measured, simulated, and what is left.

        Args:
            before: predictions (rows,) at the start parameters.
            after: the same at the fitted parameters.
        """
        fitted = self.scaled(Prediction(np.asarray(after, dtype=float)), 1.0)
        return (ControlMaps(self, fitted).figure,)

    def part(self, labels: Collection[str]) -> Self | None:
        """The spectra at the places of these labels.

        Args:
            labels: of places.

        Raises:
            BadInput: a single spectrum is left.
        """
        kept = tuple(s for s in self.spectra if s.label in labels)
        return replace(self, spectra=kept) if kept else None

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
