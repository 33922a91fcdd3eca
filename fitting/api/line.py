"""One resonance of a sweep, a ringdown or a noise spectrum, without any FMU."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from fitting.api.early import LINE_FILES
from fitting.api.printed import HtmlText, written
from fitting.lines import line as sweeps
from fitting.lines import noise_spectrum as spectra
from fitting.lines import ringdown as decays
from fitting.lines.line import line_of
from fitting.lines.names import FANO, OFFSET, form_of_terms
from fitting.lines.noise_spectrum import noise_line_of
from fitting.lines.record import LineNumber, MeasuredLine, fields_of
from fitting.lines.ringdown import ringdown_of
from fitting.lines.trace import (
    AMPLITUDES,
    PHASORS,
    Trace,
    decay_record_of,
    noise_record_of,
    trace_of,
)
from fitting.report.resonance import report, text
from fitting.resonance.decay_reading import is_over_time, read_decay_of
from fitting.resonance.noise_reading import is_noise_spectrum, read_noise_of
from fitting.resonance.reading import Columns as Columns
from fitting.resonance.reading import read_trace_of
from fitting.text.arguments import checked
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.old_names import renamed

#: Kinds of files.
RINGDOWN, NOISE, SWEEP = "ringdown", "noise", "sweep"
Record = TypeVar("Record")


class FittedLine(MeasuredLine, HtmlText):
    """A line that is printed as the command ``line`` prints it, with lmfit's names.

    Arrays over the parameters are in the order of ``params``.
    """

    @property
    def params(self) -> dict[str, LineNumber]:
        """The fitted numbers by name; others, as ``q``, follow from them."""
        return {name: getattr(self, name) for name in self.var_names}

    @property
    def covar(self) -> FloatArray:
        """Covariance of ``params``, shape (n, n), in their units: ``correl`` with each ``std``."""
        std = np.array([number.std for number in self.params.values()])
        return np.asarray(np.array(self.correl) * np.outer(std, std))

    @property
    def redchi(self) -> float:
        """``chisqr`` over the number of residuals less that of all that was fitted."""
        return self.chisqr / max(1, self.rows - self.unknowns)

    @property
    def aic(self) -> float:
        """Akaike's criterion, of n residuals n ln(chisqr/n) + 2 unknowns; smaller is better."""
        return self.minus_twice_likely + 2.0 * self.unknowns

    @property
    def best_fit(self) -> FloatArray | ComplexArray:
        """Fitted values at the points, shape (k,), in the unit of the data."""
        return self.points.arrays()[1]

    @property
    def residual(self) -> FloatArray | ComplexArray:
        """Data minus ``best_fit``, shape (k,), in the unit of both."""
        measured, fitted = self.points.arrays()
        return measured - fitted

    def fit_report(self) -> str:
        """What ``fmu-fit line --verbose`` prints: numbers, what they rest on, forms compared."""
        return report(self)

    def plot(self, *, ax: Any = None) -> Any:
        """Draw what was measured and the fit to it.

        Args:
            ax: Where to draw; None: pyplot's current axes.

        Returns:
            The axes. `fitting.plot.line` has the other panels.
        """
        return importlib.import_module("fitting.api.plot").line(self, ax=ax)

    def __repr__(self) -> str:
        return text(self)


class Line(FittedLine, sweeps.Line):
    """One resonance of a measured response; printed as by the command ``line``.

    Numbers are `Estimate` records: ``value``, ``std``, half of the interval that holds the truth in
    68 of 100 such sweeps, ``ci95`` that holds it in 95, and ``unit``.

    Attributes:
        frequency: eigenfrequency, Hz.
        width: full width at half of the power, Hz.
        q: their ratio.
        amplitude: of the line alone at its eigenfrequency, in ``unit``.
        wiring: the form that was taken.
        forms: every form that was tried, the one that was taken first.
        readings: where the line is a dip, what it means in each wiring.
        structure: what the residuals show of the noise, ``dof`` its degrees of freedom.
        rms_residual: root mean square of the residuals, over ``amplitude``.
        points: what was measured and fitted.

    `fitting.lines.line.Line` has the rest.
    """


class Ringdown(FittedLine, decays.Ringdown):
    """One resonance of a ringdown; printed as by the command ``line``.

    Numbers are `Estimate` records: ``value``, ``std``, half of the interval that holds the truth in
    68 of 100 such records, ``ci95`` that holds it in 95, and ``unit``.

    Attributes:
        frequency: at which it rings, Hz; NaN where the record does not determine it.
        eigenfrequency: that of the mode without damping, as a sweep has it, Hz.
        offset: of demodulated values, from the reference, Hz.
        width: full width at half of the power, Hz.
        q: their ratio.
        decay_time: in which the amplitude falls to 1/e, s.
        amplitude: at the first sample that is used, in ``unit``.
        is_noise: whether the residuals are noise, by all tests.
        rms_residual: root mean square of the residuals, over ``amplitude``.
        points: what was recorded and fitted.

    `fitting.lines.ringdown.Ringdown` has the rest.
    """


class NoiseLine(FittedLine, spectra.NoiseLine):
    """One resonance of a noise spectrum; printed as by the command ``line``.

    Numbers are `Estimate` records: ``value``, ``std``, half of the interval that holds the truth in
    68 of 100 such spectra, ``ci95`` that holds it in 95, and ``unit``.

    Attributes:
        frequency: eigenfrequency, Hz.
        width: full width at half of the density, Hz.
        q: their ratio.
        rms: root mean square of the line over all frequencies, in ``unit``.
        floor: white density under it, ``unit`` squared per Hz.
        averages: of how many periodograms the points are averages, as they scatter.
        second: a further line; None without.
        is_noise: whether the residuals are the scatter of such averages, by all tests.
        points: what was measured and fitted.

    `fitting.lines.noise_spectrum.NoiseLine` has the rest.
    """


def _record(
    given: tuple[str | Path | npt.ArrayLike, npt.ArrayLike | None, str, Columns | None],
    read: Callable[[Path, Columns], Record],
    made: Callable[[npt.ArrayLike, npt.ArrayLike, str], Record],
    names: tuple[str, str, str],
) -> Record:
    """What was measured, of a file or of two arrays.

    Args:
        given: the file, or places; values at these; their unit; what a file does not state.
        read: reads a file.
        made: of places, values and their unit.
        names: of the function, the places and the values, for errors.
    """
    (source, values, unit, columns), (function, axis, ordinate) = given, names
    if isinstance(source, str | PathLike):
        if values is not None:
            wanted = f"wanted {axis} and {ordinate}, or a file"
            raise BadInput(f"{function}: found a file and {ordinate}, {wanted}")
        return read(Path(source), columns or Columns())
    if values is None:
        raise BadInput(f"{function}: found {axis} alone, wanted {ordinate} with them, or a file")
    return made(source, values, unit)


@checked
def line(  # noqa: PLR0913 - what a line may be asked to be
    source: str | Path | npt.ArrayLike,
    values: npt.ArrayLike | None = None,
    *,
    unit: str = "1",
    within_hz: tuple[float | None, float | None] = (None, None),
    wiring: str = "",
    shape: str = "",
    background: str = "",
    noise: str = "",
    delay: bool | None = None,
    columns: Columns | None = None,
) -> Line:
    """One resonance of a measured response: eigenfrequency, full width and quality, with errors.

    What is next to the line, nothing, a constant or a slope, is found by comparing, see
    `fitting.lines.form` for the formula. Where points outside of ``within_hz`` show another
    line, its tail is fitted, too. Errors hold for noise as it is seen in what the fit
    leaves, and are wider where neighbouring points follow each other.

    Args:
        source: A file, whose kind is recognised; or frequencies, shape (n,), Hz.
        values: With frequencies: amplitudes, or complex values whose phase falls over a resonance,
            shape (n,).
        unit: Of these values.
        within_hz: First and last frequency that are taken, Hz; None: as far as there are points.
        wiring: "transmission", "fano", "sloped", "notch" or "reflection", of amplitudes also
            "offset", "floor", "rice", "single" or "tail"; empty: they are compared.
        shape: "lorentzian", "fano", "duffing", "notch" or "reflection"; with the next two in place
            of ``wiring``. Empty: compared, or a Lorentzian where one of them is given.
        background: What is added to the line: "none", "constant" or "slope", or "tail", that of a
            line beyond the points; empty: compared, or none.
        noise: Of amplitudes: "normal"; "power" or "amplitude", which were averaged; "readings",
            each in the noise of X and Y; empty: compared, or normal.
        delay: Whether the delay of a cable is fitted to complex values; None: compared.
        columns: Of a file, what it does not state.

    Returns:
        ``frequency``, ``width``, ``q`` and ``amplitude``, each with its ``std`` and ``ci95``;
        ``forms`` has what else was tried.

    Raises:
        BadInput: a file that is not read, no resonance, one that the ends of the sweep cut off, two
            of them, or too few points.
    """
    names = ("line", "frequencies", "values")
    record = _record((source, values, unit, columns), read_trace_of, trace_of, names)
    terms = form_of_terms(shape, background, noise)
    if wiring and terms:
        raise BadInput("wiring: is shape, background and noise in one; wanted these or wiring")
    return line_in(record.within(*within_hz), wiring, terms, delay=delay)


def line_in(
    trace: Trace, wiring: str, terms: str, *, delay: bool | None, count: int | None = 1
) -> Line:
    """The line of a trace, or several that are fitted together; see `line`.

    Args:
        trace: What was measured.
        wiring: The form that is wanted; empty: by its terms.
        terms: The form with the terms that are wanted; empty: forms are compared.
        delay: Whether the delay of a cable is fitted; None: compared.
        count: Number of lines; None: as many as the points show.
    """
    if terms == OFFSET and trace.is_complex:
        terms = FANO  # a complex constant
    result = line_of(trace, wiring or terms, delayed=delay, count=count)
    return Line(**fields_of(result, sweeps.Line))


@checked
def ringdown(
    source: str | Path | npt.ArrayLike,
    values: npt.ArrayLike | None = None,
    *,
    unit: str = "1",
    within_s: tuple[float | None, float | None] = (None, None),
    demodulated_at_hz: float | None = None,
    columns: Columns | None = None,
) -> Ringdown:
    """One resonance of a free decay: frequency, full width, quality and decay time, with errors.

    Samples of the motion, complex values of a demodulator, or amplitudes alone, which determine no
    frequency. Where the decay begins is found. A constant next to it is solved for; a second line,
    and a frequency or damping that follows the square of the amplitude, are looked for, see
    `fitting.lines.ringdown` for the formula. Errors hold for noise as it is seen in what the
    fit leaves, and are wider where neighbouring samples follow each other.

    Args:
        source: A file, whose kind is recognised; or times, evenly spaced, shape (n,), s.
        values: With times: samples or amplitudes, or complex values with phases as
            Re[value exp(i 2 pi f t)], shape (n,).
        unit: Of these values.
        within_s: First and last time that are taken, s; None: as far as there are samples.
        demodulated_at_hz: The frequency of the demodulator, Hz; None: the file's, if it
            states one.
        columns: Of a file, what it does not state.

    Returns:
        ``width``, ``decay_time``, ``amplitude`` and, where the record determines them,
        ``frequency`` and ``q``, each with its ``std`` and ``ci95``; ``forms`` has what else was
        tried.

    Raises:
        BadInput: a file that is not read, no free decay, or too little of one.
    """
    names = ("ringdown", "times", "values")
    record = _record((source, values, unit, columns), read_decay_of, decay_record_of, names)
    if demodulated_at_hz is not None:
        if not 0.0 < demodulated_at_hz < math.inf:
            raise BadInput(
                f"{record.source}: demodulated at {demodulated_at_hz!r} Hz, wanted a positive "
                "frequency"
            )
        if not record.is_complex and (record.values.real < 0.0).any():
            raise BadInput(
                f"{record.source}: was demodulated, and its one column of values changes sign; "
                "wanted X and Y, or amplitudes"
            )
        kind = PHASORS if record.is_complex else AMPLITUDES
        record = replace(record, reference_hz=demodulated_at_hz, kind=kind)
    return Ringdown(**fields_of(ringdown_of(record.within(*within_s)), decays.Ringdown))


@checked
def noise_line(
    source: str | Path | npt.ArrayLike,
    density: npt.ArrayLike | None = None,
    *,
    unit: str = "1",
    within_hz: tuple[float | None, float | None] = (None, None),
    columns: Columns | None = None,
) -> NoiseLine:
    """One resonance of a noise spectrum: eigenfrequency, full width, quality and rms, with errors.

    The density is fitted by the likelihood of averages of periodograms, a line, or two, on a white
    floor, see `fitting.lines.noise_spectrum` for the formula. How many were averaged follows from
    the scatter.

    Args:
        source: A file, whose kind is recognised; or frequencies, shape (n,), Hz.
        density: With frequencies: densities above zero, in ``unit`` squared per Hz, shape (n,).
        unit: Of what is seen, as "V"; "1": the numbers are relative.
        within_hz: First and last frequency that are taken, Hz; None: as far as there are points.
        columns: Of a file, what it does not state.

    Returns:
        ``frequency``, ``width``, ``q`` and ``rms``, each with its ``std`` and ``ci95``.

    Raises:
        BadInput: a file that is not read, no line, a density that is not above zero, or too few
            points.
    """
    names = ("noise_line", "frequencies", "densities")
    record = _record((source, density, unit, columns), read_noise_of, noise_record_of, names)
    return NoiseLine(**fields_of(noise_line_of(record.within(*within_hz)), spectra.NoiseLine))


def kind_of_file(source: Path, columns: Columns, kind: str = "") -> str:
    """Whether a file holds a "ringdown", a "noise" spectrum or a "sweep".

    Args:
        source: The file.
        columns: What it does not state.
        kind: Of a file over frequency, where it is stated.

    Raises:
        BadInput: a file that is not read.
    """
    if is_over_time(source, columns):
        return RINGDOWN
    return kind or (NOISE if is_noise_spectrum(source, columns) else SWEEP)


def ends_of(source: Path, columns: Columns, *, over_time: bool) -> tuple[float, float]:
    """First and last frequency of a file, Hz; of a recording over time its times, s.

    Args:
        source: The file.
        columns: What it does not state.
        over_time: Whether it holds a recording over time.

    Raises:
        BadInput: a file that is not read.
    """
    if over_time:
        axis = read_decay_of(source, columns).time_s
    else:
        axis = read_trace_of(source, columns).frequency_hz
    return float(axis[0]), float(axis[-1])


@renamed
def write_line(result: Line | Ringdown | NoiseLine, out: str | Path) -> tuple[Path, ...]:
    """Write line.json, line.csv and a figure of data, fit and residual.

    Args:
        result: What `line`, `ringdown` or `noise_line` returned.
        out: Folder, made where there is none.

    Returns:
        The files.

    Raises:
        BadInput: the folder cannot be written, or holds files of these names that are not ours.
    """
    # matplotlib takes a second to import: only where something is drawn
    report = importlib.import_module("fitting.report.line")
    files: tuple[Path, ...]
    files = written(out, "line", LINE_FILES, lambda to: report.write_line(result, to))
    return files
