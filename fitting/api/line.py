"""One resonance of a sweep, a ringdown or a noise spectrum, without any FMU."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
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
        return self.minus_two_log_likelihood + 2.0 * self.unknowns

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

    Attributes:
        frequency: eigenfrequency, Hz.
        width: FWHM of the power, Hz.
        q: frequency/width.
        amplitude: of the line alone at its eigenfrequency, in ``unit``.
        wiring: its form.
        forms: compared forms, the chosen one first.
        readings: meanings of a dip.
        structure: tests of the residuals.
        rms_residual: over ``amplitude``.
        points: measured and fitted values.

    Each number has ``value``, ``std``, ``ci95`` and ``unit``. `fitting.lines.line.Line` has the
    rest.
    """


class Ringdown(FittedLine, decays.Ringdown):
    """One resonance of a ringdown; printed as by the command ``line``.

    Attributes:
        frequency: of the decay, Hz; NaN where the record does not determine it.
        eigenfrequency: without damping, as in a sweep, Hz.
        offset: of demodulated values, from the reference, Hz.
        width: FWHM of the power, Hz.
        q: their ratio.
        decay_time: of the amplitude to 1/e, s.
        amplitude: at the first used sample, in ``unit``.
        is_noise: whether the residuals pass all tests for noise.
        rms_residual: over ``amplitude``.
        points: recorded and fitted values.

    Each number has ``value``, ``std``, ``ci95`` and ``unit``. `fitting.lines.ringdown.Ringdown` has
    the rest.
    """


class NoiseLine(FittedLine, spectra.NoiseLine):
    """One resonance of a noise spectrum; printed as by the command ``line``.

    Attributes:
        frequency: eigenfrequency, Hz.
        width: FWHM of the density, Hz.
        q: frequency/width.
        rms: of the line over all frequencies, in ``unit``.
        floor: white density, ``unit`` squared per Hz.
        averages: averaged periodograms, estimated from the scatter.
        second: a further line; None without.
        is_noise: whether the residuals pass all tests for noise.
        points: measured and fitted values.

    Each number has ``value``, ``std``, ``ci95`` and ``unit``.
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
    """One resonance of a measured response: eigenfrequency, FWHM and quality factor, with errors.

    Forms with nothing, a constant or a slope next to the line (`fitting.lines.form`) are compared.
    The tail of a line outside of ``within_hz`` is fitted, too. Errors are from the scatter and
    correlation of the residuals.

    Args:
        source: A file; or frequencies, shape (n,), Hz.
        values: With frequencies: amplitudes, or complex values whose phase falls over a resonance,
            shape (n,).
        unit: Of the values.
        within_hz: First and last frequency, Hz; None: all.
        wiring: "transmission", "fano", "sloped", "notch" or "reflection"; of amplitudes also
            "offset", "floor", "rice", "single" or "tail"; empty: compared.
        shape: "lorentzian", "fano", "duffing", "notch" or "reflection", instead of ``wiring``;
            empty: compared, or Lorentzian if ``background`` or ``noise`` is given.
        background: "none", "constant", "slope", or "tail" of a line beyond the points; empty:
            compared, or none.
        noise: Of amplitudes: "normal"; averaged "power" or "amplitude"; single "readings", in noise
            of X and Y; empty: compared, or normal.
        delay: Whether the delay of a cable is fitted to complex values; None: compared.
        columns: Of a file, what it does not state.

    Returns:
        ``frequency``, ``width``, ``q``, ``amplitude`` with ``std`` and ``ci95``; compared
        ``forms``.

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
    """One resonance of a free decay: frequency, FWHM, quality factor and decay time, with errors.

    Of samples, complex values of a demodulator, or amplitudes, which determine no frequency. The
    begin of the decay and a constant are fitted; a second line and a dependence on the squared
    amplitude are tested (`fitting.lines.ringdown`). Errors are from the scatter and correlation of
    the residuals.

    Args:
        source: A file; or times, evenly spaced, shape (n,), s.
        values: With times: samples, amplitudes, or complex values, phases as Re[value exp(i 2 pi f
            t)], shape (n,).
        unit: Of the values.
        within_s: First and last time, s; None: all.
        demodulated_at_hz: Frequency of the demodulator, Hz; None: the file's.
        columns: Of a file, what it does not state.

    Returns:
        ``width``, ``decay_time``, ``amplitude`` and, if determined, ``frequency`` and ``q``, with
        ``std`` and ``ci95``; compared ``forms``.

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
    """One resonance of a noise spectrum: eigenfrequency, FWHM, quality factor and rms, with errors.

    One line or two on a white floor are fitted by the likelihood of averaged periodograms, whose
    number follows from the scatter (`fitting.lines.noise_spectrum`).

    Args:
        source: A file; or frequencies, shape (n,), Hz.
        density: With frequencies: densities above zero, ``unit`` squared per Hz, shape (n,).
        unit: Of the signal, as "V"; "1": relative.
        within_hz: First and last frequency, Hz; None: all.
        columns: Of a file, what it does not state.

    Returns:
        ``frequency``, ``width``, ``q`` and ``rms``, with ``std`` and ``ci95``.

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
        result: Of `line`, `ringdown` or `noise_line`.
        out: Folder, made where there is none.

    Returns:
        The files.

    Raises:
        BadInput: the folder cannot be written, or holds other files of these names.
    """
    from fitting.report.line import write_line as write  # matplotlib takes a second to import

    return written(out, "line", LINE_FILES, partial(write, result))
