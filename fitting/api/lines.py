"""The lines of many files as one table over the control of the files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

from fitting.api.early import LINES_FILES
from fitting.api.line import (
    NOISE,
    RINGDOWN,
    Columns,
    Line,
    NoiseLine,
    Ringdown,
    kind_of_file,
    line_in,
    noise_line,
    ringdown,
)
from fitting.api.printed import data_frame, written
from fitting.lines.names import form_of_terms
from fitting.lines.record import LineNumber
from fitting.report.table import Table, html_table, table, terminal_text, text_lines
from fitting.resonance.file_control import differing_quantity
from fitting.resonance.reading import read_trace_of
from fitting.text.arguments import checked
from fitting.text.errors import BadInput, SeveralSweeps

#: Name of the control where the files have none: their number.
NUMBER = "file number"


@dataclass(frozen=True, kw_only=True)
class LineRow:
    """The line of one file, or one of several lines or sweeps in it.

    Attributes:
        file: its path.
        control: the value in its name or head; else the number of the file.
        line: the fit; None where it failed.
        reason: of the failure; else empty.
        sweep: its name in a file with several; else empty.
        number: of the line in its sweep, from 0, which has the largest amplitude.
        is_one_of_several: whether as many lines were requested as were fitted.
    """

    file: str
    control: float
    line: Line | Ringdown | NoiseLine | None
    reason: str = ""
    sweep: str = ""
    number: int = 0
    is_one_of_several: bool = False

    @property
    def name(self) -> str:
        """The file, with the sweep in it."""
        return f"{self.file}: {self.sweep}" if self.sweep else self.file

    @property
    def numbers(self) -> dict[str, LineNumber]:
        """Frequency, FWHM, Q and amplitude, of a noise spectrum the rms in place of it."""
        whole = self.line
        if whole is None:
            return {}
        each: Any = whole
        if self.number and isinstance(whole, Line):
            each = whole.others[self.number - 1]
        last = whole.rms if isinstance(whole, NoiseLine) else each.amplitude
        return {"frequency": each.frequency, "width": each.width, "q": each.q, "amplitude": last}

    @property
    def findings(self) -> tuple[str, ...]:
        """What contradicts a single line with noise of one size."""
        fit = self.line
        if fit is None:
            return ()
        made = [f"residuals {what}" for what in fit.structure.deviations]
        made += ["second line"] * (fit.second is not None and not self.is_one_of_several)
        if isinstance(fit, Line):
            made += [fault.fault.value for fault in fit.faults]
            made += ["frequency depends on the amplitude"] * (fit.bend is not None)
        elif isinstance(fit, Ringdown):
            made += ["frequency depends on the amplitude"] * (fit.shift.value != 0.0)
            made += ["damping depends on the amplitude"] * (fit.extra.value != 0.0)
        return tuple(made)

    def to_dict(self) -> dict[str, str | float]:
        """A flat row, as ``pandas.DataFrame`` takes it; NaN and empty where it failed."""
        made: dict[str, str | float] = {"file": self.name, "control": self.control}
        for name in ("frequency", "width", "q", "amplitude"):
            each = self.numbers.get(name)
            made[name] = math.nan if each is None else each.value
            made[f"{name}_std"] = math.nan if each is None else each.std
        unit = "" if self.line is None else self.line.unit
        made |= {"unit": unit, "findings": "; ".join(self.findings), "reason": self.reason}
        return made


@dataclass(frozen=True, kw_only=True, repr=False)
class Lines:
    """The lines of many files, in their order, those of one sweep by rising frequency.

    Attributes:
        rows: one for each file, sweep or requested line.
        control: quantity that differs from file to file.
        unit: of it; "1": none.
    """

    rows: tuple[LineRow, ...]
    control: str
    unit: str

    @property
    def fitted(self) -> tuple[LineRow, ...]:
        """Rows of files that have a line."""
        return tuple(row for row in self.rows if row.line is not None)

    @property
    def head(self) -> str:
        """The control with its unit."""
        return self.control if self.unit == "1" else f"{self.control} ({self.unit})"

    @property
    def table(self) -> Table:
        """The rows as a table."""
        return table("lines", rows=self.rows, head=self.head)

    def to_dict(self) -> list[dict[str, str | float]]:
        """A flat row per file, as ``pandas.DataFrame`` takes them."""
        return [row.to_dict() for row in self.rows]

    def to_dataframe(self) -> Any:
        """A row per file as a ``pandas.DataFrame``, with the files as its index.

        Raises:
            BadInput: pandas is not installed.
        """
        return data_frame(self.to_dict(), "file")

    def __repr__(self) -> str:
        failed = [f"{row.name}: {row.reason}" for row in self.rows if row.reason]
        return terminal_text("\n".join([*text_lines(self.table), *failed]))

    def _repr_html_(self) -> str:
        return html_table(self.table)


@checked
def lines(  # noqa: PLR0913 - what lines may be asked to be
    files: Sequence[str | Path],
    *,
    kind: str = "",
    within: tuple[float | None, float | None] = (None, None),
    wiring: str = "",
    shape: str = "",
    background: str = "",
    noise: str = "",
    delay: bool | None = None,
    demodulated_at_hz: float | None = None,
    count: int | str = 1,
    columns: Columns | None = None,
) -> Lines:
    """The lines of many files or sweeps, with the control that differs from file to file.

    The control is a number in the files' names, as ``Vg=-6`` or ``20mK``, else above their tables.
    A file that fails is a row with the reason; several sweeps in a file (HDF5, MATLAB, TDMS,
    LabOne) have a row each.

    Args:
        files: Paths of sweeps, ringdowns or noise spectra; a single one with several sweeps, or
            with ``count``.
        kind: Of files over frequency: "noise" or "sweep"; empty: by unit and name.
        within: First and last frequency, Hz, of ringdowns time, s; None: all.
        wiring: "transmission", "fano", "sloped", "notch" or "reflection"; of amplitudes also
            "offset", "floor", "rice", "single" or "tail"; empty: compared.
        shape: "lorentzian", "fano", "duffing", "notch" or "reflection", instead of ``wiring``;
            empty: compared, or Lorentzian if ``background`` or ``noise`` is given.
        background: "none", "constant", "slope", or "tail" of a line beyond the points; empty:
            compared, or none.
        noise: Of amplitudes: "normal"; averaged "power" or "amplitude"; single "readings", in noise
            of X and Y; empty: compared, or normal.
        delay: Whether the delay of a cable is fitted to complex values; None: compared.
        demodulated_at_hz: Frequency of the demodulator, Hz; None: the file's.
        count: Lines of each sweep, fitted together, a row each; "auto": as many as the points show.
        columns: Of a file, what it does not state.

    Raises:
        BadInput: one file with one sweep, or none of the files has a line.
    """
    paths = [Path(file) for file in ([files] if isinstance(files, str | PathLike) else files)]
    if count != "auto" and not (isinstance(count, int) and count >= 1):
        raise BadInput(f'count: found {count!r}, wanted a number of lines, or "auto"')
    if wiring and (shape or background or noise):
        raise BadInput("wiring: is shape, background and noise in one; wanted these or wiring")
    terms = form_of_terms(shape, background, noise)

    parts = [part for path in paths for part in _parts(path, columns or Columns(), kind)]
    if len(parts) < 2 and count == 1:
        raise BadInput("lines: found one file, wanted two or more; of one file: line")
    # the number of each where no quantity differs from file to file, or two do
    control, control_unit, values = NUMBER, "1", tuple(float(k + 1) for k in range(len(parts)))
    if len(parts) == len(paths):
        with suppress(BadInput):
            if differing := differing_quantity(paths, None):
                _, control, control_unit, values = differing

    rows, errors = [], []
    for (path, sweep, known), value in zip(parts, values, strict=True):
        fit: Line | Ringdown | NoiseLine | None = None
        numbers, reason = [0], ""
        try:
            what = kind_of_file(path, known, kind)
            if what == RINGDOWN:
                fit = ringdown(
                    path, within_s=within, demodulated_at_hz=demodulated_at_hz, columns=known
                )
            elif what == NOISE:
                fit = noise_line(path, within_hz=within, columns=known)
            else:
                trace = read_trace_of(path, known).within(*within)
                wanted = None if isinstance(count, str) else count
                fit = line_in(trace, wiring, terms, delay=delay, count=wanted)
                if count != 1:
                    each = [fit, *fit.others]
                    numbers = sorted(range(len(each)), key=lambda k: each[k].frequency.value)
        except BadInput as error:
            errors.append(str(error))
            reason = str(error).removeprefix(f"{path}: ")
        rows += [
            LineRow(
                file=str(path),
                control=value,
                line=fit,
                reason=reason,
                sweep=sweep,
                number=k,
                is_one_of_several=len(numbers) > 1,
            )
            for k in numbers
        ]
    if len(errors) == len(parts):
        raise BadInput(*errors)
    return Lines(rows=tuple(rows), control=control, unit=control_unit)


def _parts(path: Path, columns: Columns, kind: str) -> list[tuple[Path, str, Columns]]:
    """Each sweep of a file, by its name, and the columns that choose it."""
    try:
        kind_of_file(path, columns, kind)
    except SeveralSweeps as error:
        return [
            (path, str(name), replace(columns, **{key: name}))
            for part in error.parts
            for key, name in part.items()
        ]
    except BadInput:
        pass  # what reads it states why
    return [(path, "", columns)]


def write_lines(result: Lines, out: str | Path) -> tuple[Path, ...]:
    """Write lines.csv and a figure of frequency and FWHM over the control.

    Args:
        result: Of `lines`.
        out: Folder, made where there is none.

    Returns:
        The files.

    Raises:
        BadInput: the folder cannot be written, or holds other files of these names.
    """
    from fitting.report.line import write_lines as write  # matplotlib takes a second to import

    control = result.control, result.unit
    return written(out, "line", LINES_FILES, partial(write, result.to_dict(), control))
