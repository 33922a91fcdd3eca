"""Records of lines: numbers with their errors, forms as fitted, results with their points."""

from __future__ import annotations

import cmath
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from fitting.lines.solve import Fit
from fitting.lines.trace import Measured
from fitting.signal.residual_tests import Structure
from fitting.signal.student import ROOT_68, ratio95, reach
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.estimate import NOWHERE, Estimate, Interval, Verdict
from fitting.text.finding import Finding
from fitting.text.old_names import AsNumber
from fitting.text.rendering import sentence_lines

#: Rows of a matrix.
Matrix = tuple[tuple[float, ...], ...]
#: Of what was not fitted.
NO_STRUCTURE = Structure(
    p_value=math.nan,
    sizes_p=math.nan,
    order=0,
    points=math.nan,
    widening=math.nan,
    together=math.nan,
)
#: Numbers of a line, with what their names of 0.2.0 ended in.
NUMBERS = {
    **dict.fromkeys(("frequency", "width", "offset", "shift"), "_hz"),
    **dict.fromkeys(("delay", "decay_time"), "_s"),
    **dict.fromkeys(("q", "amplitude", "power", "rms", "q_coupling", "q_internal"), ""),
}
#: Names of 0.2.0, which work with a warning until 0.4, and where their numbers are now.
RENAMED = {
    **{f"{name}{end}": f"{name}.value" for name, end in NUMBERS.items() if end},
    **{f"{name}_std{end}": f"{name}.std" for name, end in NUMBERS.items()},
    **{f"{name}_ci95{end}": f"{name}.ci95" for name, end in NUMBERS.items()},
    "amplitude_mirrored": "mirrored.value",
    "amplitude_mirrored_std": "mirrored.std",
    "beside": "background",
    "beside_std": "background_std",
    "beside_slope": "slope",
    "freedom": "dof",
    "independent_points": "structure.points",
    "independent_samples": "structure.points",
    "points": "structure.points",
    "widening": "structure.widening",
    "structure_p": "structure.p_value",
    "sizes_p": "structure.sizes_p",
    "asked": "is_requested",
    "turned": "phases_reversed",
    "describes": "is_noise",
    "said": "remarks",
    "fits": "forms",
}


@dataclass(frozen=True, kw_only=True)
class LineNumber(Estimate, AsNumber):
    """A number of a line with its error; it also works as the plain number that 0.2.0 had."""


def number_of_line(
    name: str,
    value: float,
    std: float = math.nan,
    unit: str = "Hz",
    *,
    half: float = math.nan,
    ci95: Interval | None = None,
) -> LineNumber:
    """A number of a line; its status is that no profile was made, or that it is not known.

    Args:
        name: of the number, "frequency".
        value: in ``unit``.
        std: half of its 68 % interval.
        unit: of both; "1": none.
        half: half of its 95 % interval over ``std``, where that is symmetric.
        ci95: where it is not.
    """
    return LineNumber(
        name=name,
        value=value,
        unit=unit,
        std=std,
        ci95=(value - half * std, value + half * std) if ci95 is None else ci95,
        status=Verdict.UNKNOWN if math.isnan(value) else Verdict.LINEARISED,
    )


class Renamed:
    """A record of which names of 0.2.0 work; see `RENAMED`."""

    if not TYPE_CHECKING:  # a type checker knows the names of now alone

        def __getattr__(self, name: str) -> Any:
            owner, _, part = RENAMED.get(name, "").partition(".")
            kind = type(self)
            if not owner or not (owner in kind.__dataclass_fields__ or hasattr(kind, owner)):
                raise AttributeError(f"{kind.__name__} has no '{name}'")
            text = f"'{name}' is '{RENAMED[name]}' now; the old name goes with 0.4"
            warnings.warn(text, DeprecationWarning, stacklevel=2)
            there = getattr(self, owner)
            if there is None:  # a number that there is not
                return NOWHERE if part == "ci95" else math.nan
            return getattr(there, part) if part else there


@dataclass(frozen=True, kw_only=True)
class LineValues(Renamed):
    """One line: ``frequency`` and ``width`` (FWHM), Hz, and their ratio ``q``.

    ``std`` is half of the 68 % interval; it and ``ci95`` are Student's.
    """

    frequency: LineNumber
    width: LineNumber
    q: LineNumber


def no_line() -> dict[str, Any]:
    """The numbers of a line that could not be fitted."""
    names = {"frequency": "Hz", "width": "Hz", "q": "1"}
    return {name: number_of_line(name, math.nan, unit=unit) for name, unit in names.items()}


def line_numbers(
    frequency: tuple[float, float],
    width: tuple[float, float],
    q: tuple[float, float],
    dof: float = math.nan,
    *,
    q_by_width: bool = False,
) -> dict[str, Any]:
    """The fields of `LineValues`, with symmetric intervals.

    Args:
        frequency: eigenfrequency and half of its 68 % interval, Hz.
        width: full width at half of the power, the same, Hz.
        q: quality factor, the same.
        dof: degrees of freedom of the noise; NaN: errors are unknown.
        q_by_width: whether the interval of the quality factor is that of the width.
    """
    half = math.nan if math.isnan(dof) else ratio95(dof)
    fwhm, ci95 = number_of_line("width", *width, half=half), None
    if q_by_width:
        slow, fast = (max(end, 1e-300) for end in fwhm.ci95)
        ci95 = q[0] * width[0] / fast, q[0] * width[0] / slow
    return {
        "frequency": number_of_line("frequency", *frequency, half=half),
        "width": fwhm,
        "q": number_of_line("q", *q, "1", half=half, ci95=ci95),
    }


@dataclass(frozen=True, kw_only=True)
class TriedForm(LineValues):
    """A form of a line or its background, as fitted; NaN where that failed.

    Attributes:
        name: of the form.
        rms_residual: over the line's amplitude.
        criterion: ΔAIC from the best form, 10 is plainly worse. NaN: not compared.
        structure: tests of the residuals.
        message: why it failed, or how the fit ended.
        delayed: with the delay of a cable.
        second: with a second line.
        offset: of phasors, from the demodulation frequency, Hz.
    """

    name: str
    rms_residual: float = math.nan
    criterion: float = math.nan
    structure: Structure = NO_STRUCTURE
    message: str = ""
    delayed: bool = False
    second: bool = False
    offset: LineNumber | None = None


@dataclass(frozen=True, kw_only=True)
class SecondLine(LineValues):
    """A further line that is fitted with the first one.

    Attributes:
        share: its height over the first one's; of a ringdown at the first sample.
        amplitude: of a sweep, alone at its eigenfrequency.
        phase_rad: relative to the first one; NaN: not measured.
        mirrored: the other share with the same amplitudes; NaN without.
        decays: of a ringdown; False: a constant tone.
        offset: of phasors, from the demodulation frequency, Hz.
        decay_time: of a ringdown, of the amplitude to 1/e, s.
    """

    share: float
    amplitude: LineNumber | None = None
    phase_rad: float = math.nan
    mirrored: float = math.nan
    decays: bool = True
    offset: LineNumber | None = None
    decay_time: LineNumber | None = None

    @property
    def height(self) -> complex:
        """Complex height over that of the first one."""
        return cmath.rect(self.share, self.phase_rad)


@dataclass(frozen=True, kw_only=True, eq=False)
class Fitted:
    """What every fit of lines has.

    Attributes:
        structure: what the residuals show of the noise.
        dof: degrees of freedom of the noise; correlated values count as fewer.
        correl: correlations of the numbers of the first line, (k, k).
        unknowns: real numbers that were fitted.
        squares: sum of the squared residuals over the square of the largest value.
        curve: fitted values, (n,), in the unit of the data.
    """

    structure: Structure
    dof: float
    correl: Matrix = ()
    unknowns: int
    squares: float
    curve: FloatArray | ComplexArray = field(repr=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class FormFit(Fitted, LineValues):
    """A form as fitted: the numbers of its first line, and what it is compared with others by.

    Attributes:
        name: of the form.
        amplitude: of the first line alone.
        others: further lines that were fitted with it.
        rms_residual: root mean square of the residuals over the amplitude.
        likely_squares: those with which normal noise of one size is as likely.
    """

    name: str
    amplitude: LineNumber
    others: tuple[SecondLine, ...] = ()
    rms_residual: float
    likely_squares: float

    @property
    def second(self) -> SecondLine | None:
        """The first of the further lines; None without."""
        return self.others[0] if self.others else None

    def tried(self, criterion: float, **more: Any) -> TriedForm:
        """The form as it is listed.

        Args:
            criterion: Akaike's, over the least of all forms.
            more: further fields of `TriedForm`.
        """
        return TriedForm(
            **fields_of(self, LineValues),
            name=self.name,
            rms_residual=self.rms_residual,
            criterion=criterion,
            structure=self.structure,
            **more,
        )


@dataclass(frozen=True, kw_only=True)
class LineResult(LineValues):
    """What fits of a line to a sweep, a ringdown and a noise spectrum have in common.

    Attributes:
        source: the file, or "arrays".
        unit: of amplitudes; "1": none.
        rms_residual: over the amplitude; NaN of a noise spectrum.
        dof: degrees of freedom of the noise.
        structure: tests of the residuals.
        forms: compared forms; the chosen one first.
        second: a further line; None without.
        instrument: its own "frequency_hz" and "q", if the file has them.
    """

    source: str = ""
    unit: str
    rms_residual: float = math.nan
    dof: float = math.inf
    structure: Structure = NO_STRUCTURE
    forms: tuple[TriedForm, ...] = ()
    second: SecondLine | None = None
    instrument: Mapping[str, float] = field(default_factory=dict)

    @property
    def ratio95(self) -> float:
        """The half of a 95 % interval over that of a 68 % one."""
        return ratio95(self.dof)

    @property
    def is_noise(self) -> bool:
        """Whether the residuals are noise of one size, by all tests."""
        return self.structure.is_noise


def fields_of(record: Any, kind: type) -> dict[str, Any]:
    """The fields of a record that another one has, too, as arguments.

    Args:
        record: the one.
        kind: class of the other.
    """
    return {of.name: getattr(record, of.name) for of in fields(kind)}


Floats = tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Points:
    """Measured and fitted values, (n,) each; imaginary parts are empty without phases.

    One of ``frequency_hz`` and ``time_s`` is empty. Phases of a sweep are those of Re[value exp(i 2
    pi f t)] and fall over a resonance; densities are in the unit squared per Hz.
    """

    measured: Floats
    fitted: Floats
    frequency_hz: Floats = ()
    time_s: Floats = ()
    measured_imaginary: Floats = ()
    fitted_imaginary: Floats = ()

    @classmethod
    def of(
        cls,
        measured: FloatArray | ComplexArray,
        fitted: FloatArray | ComplexArray,
        *,
        frequency_hz: FloatArray | None = None,
        time_s: FloatArray | None = None,
    ) -> Points:
        """Points of arrays, (n,) each.

        Args:
            measured: values, complex ones with phases.
            fitted: at the same places.
            frequency_hz: of a sweep or a spectrum, Hz.
            time_s: of a recording over time, s.
        """
        imaginary = {}
        if np.iscomplexobj(measured):
            imaginary = {
                "measured_imaginary": tuple(measured.imag.tolist()),
                "fitted_imaginary": tuple(fitted.imag.tolist()),
            }
        return cls(
            measured=tuple(measured.real.tolist()),
            fitted=tuple(fitted.real.tolist()),
            frequency_hz=() if frequency_hz is None else tuple(frequency_hz.tolist()),
            time_s=() if time_s is None else tuple(time_s.tolist()),
            **imaginary,
        )

    @property
    def place(self) -> Floats:
        """Frequencies, Hz, or times, s."""
        return self.frequency_hz or self.time_s

    def arrays(self) -> tuple[FloatArray | ComplexArray, FloatArray | ComplexArray]:
        """Measured and fitted values, real or complex, (n,) each."""
        measured, fitted = np.array(self.measured), np.array(self.fitted)
        if not self.measured_imaginary:
            return measured, fitted
        return (
            measured + 1j * np.array(self.measured_imaginary),
            fitted + 1j * np.array(self.fitted_imaginary),
        )


@dataclass(frozen=True, kw_only=True)
class MeasuredLine(LineResult):
    """One resonance of a file or of arrays.

    Attributes:
        chisqr: sum of the weighted squared residuals, in the squared unit; of a noise spectrum the
            deviance over its expectation per point.
        unknowns: fitted real numbers.
        correl: correlations of the numbers of ``var_names``, (k, k).
        reading: how the file was read.
        points: measured and fitted values.
    """

    chisqr: float
    unknowns: int
    correl: Matrix
    reading: tuple[Finding, ...]
    points: Points = field(repr=False)

    @property
    def var_names(self) -> tuple[str, ...]:
        """Names of the numbers that were fitted and are printed."""
        return ("frequency", "width", "amplitude")

    @property
    def rows(self) -> int:
        """Number of residuals: of complex values two at every point."""
        return len(self.points.place) * (2 if self.is_complex else 1)

    @property
    def minus_two_log_likelihood(self) -> float:
        """Minus twice the logarithm of the likelihood of normal noise, but for a constant."""
        return self.rows * math.log(self.chisqr / self.rows) if self.chisqr > 0.0 else -math.inf

    @property
    def remarks(self) -> tuple[str, ...]:
        """How the file was read, in sentences."""
        return sentence_lines(self.reading)

    @property
    def is_complex(self) -> bool:
        """Whether phases were measured."""
        return bool(self.points.measured_imaginary)


def common_fields(
    record: Measured, fit: Fitted, line: LineValues, **axis: FloatArray
) -> dict[str, Any]:
    """The fields of `MeasuredLine` that all kinds of measurement fill alike.

    Args:
        record: what was measured.
        fit: of its lines.
        line: the one that is printed.
        axis: frequency_hz or time_s of the values, (n,).
    """
    # of complex values both parts are rows: their points are worth half of them
    points = fit.structure.points / (2.0 if record.is_complex else 1.0)
    return {
        **fields_of(line, LineValues),
        "source": record.source,
        "unit": record.unit,
        "dof": fit.dof,
        "structure": replace(fit.structure, points=points),
        "unknowns": fit.unknowns,
        "correl": fit.correl,
        "reading": record.reading,
        "points": Points.of(record.values, fit.curve, **axis),
    }


#: Slopes of a number by single unknowns: the number of each, and the slope.
Slopes: TypeAlias = Sequence[tuple[int, float]]


class Numbers:
    """Numbers of a fit; their errors are halves of 68 % intervals.

    Attributes:
        fit: of which they are.
        structure: what the order of its residuals shows.
        dof: degrees of freedom of the noise; correlated values count as fewer.
        variance: of a residual.
        covariance: of all unknowns, (unknowns, unknowns).
    """

    def __init__(
        self,
        fit: Fit,
        structure: Structure | None = None,
        variance: float | None = None,
    ) -> None:
        """Numbers of a fit.

        Args:
            fit: of which they are.
            structure: of the residuals; None: that of all of them.
            variance: of a residual, where it is estimated otherwise than from their squares.
        """
        self.fit = fit
        self.structure = fit.structure if structure is None else structure
        self.dof = fit.dof / self.structure.widening**2
        self.variance = fit.squares / fit.dof if variance is None else variance
        widened = self.structure.widening**2 * self.variance * fit.inverse
        self.covariance = reach(ROOT_68, self.dof) ** 2 * widened

    def std(self, gradient: FloatArray) -> float:
        """Half of the 68 % interval of a number with this gradient (unknowns,)."""
        at = np.flatnonzero(gradient)
        part = self.covariance[np.ix_(at, at)]
        size = float(np.max(np.abs(gradient), initial=0.0))  # its square may be no number
        unit = gradient[at] / size if size else gradient[at]
        return size * math.sqrt(max(0.0, float(unit @ part @ unit)))

    def gradient(self, slopes: Slopes) -> FloatArray:
        """Derivatives (unknowns,) of a number with slopes by single unknowns."""
        gradient = np.zeros(self.fit.unknowns)
        for k, slope in slopes:
            gradient[k] += slope
        return gradient

    def std_of(self, slopes: Slopes) -> float:
        """Half of the 68 % interval of such a number."""
        return self.std(self.gradient(slopes))

    def correl(self, numbers: Sequence[FloatArray]) -> Matrix:
        """Correlations of numbers with gradients (unknowns,) each."""
        each = np.array(numbers)
        stds = np.array([self.std(gradient) for gradient in each])
        with np.errstate(all="ignore"):
            unit = each / stds[:, None]
            made = np.clip(unit @ self.covariance @ unit.T, -1.0, 1.0)
        return tuple(tuple(float(v) for v in row) for row in made)

    def line(
        self,
        frequency_hz: float,
        width_hz: float,
        slopes: Sequence[FloatArray],
        *,
        q_by_width: bool = False,
    ) -> dict[str, Any]:
        """The fields of `LineValues` of a line, by the gradients of its frequency and its FWHM."""
        q = frequency_hz / width_hz
        of_q = q * (slopes[0] / frequency_hz - slopes[1] / width_hz)
        return line_numbers(
            (frequency_hz, self.std(slopes[0])),
            (width_hz, self.std(slopes[1])),
            (q, self.std(of_q)),
            self.dof,
            q_by_width=q_by_width,
        )

    def number(self, name: str, value: float, slopes: Slopes, unit: str = "") -> LineNumber:
        """A number with its error; slopes by single unknowns."""
        return number_of_line(name, value, self.std_of(slopes), unit, half=ratio95(self.dof))
