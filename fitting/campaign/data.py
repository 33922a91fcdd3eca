"""Campaign file plus its data files -> checked records, in the units they were written in."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from fitting.campaign.file import (
    TraceFormat,
    WrittenCampaign,
    WrittenExperiments,
    WrittenSweep,
    read_campaign_file,
)
from fitting.campaign.instruments import RawTrace, read_trace, unit_of
from fitting.campaign.kind import MeasurementTable, ReadMeasurement
from fitting.campaign.measured import (
    UNKNOWN,
    MeasuredExperiment,
    MeasuredSweep,
    Phases,
    Spectrum,
)
from fitting.signal.amplitudes import Amplitude, to_peak
from fitting.signal.clipped_top import clipped_top
from fitting.signal.peaks import read_peaks
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, Complaints, did_you_mean, gathered
from fitting.text.frequency import hertz_of
from fitting.text.notation import hertz, quantity
from fitting.text.tables import Column, Table, parse_number, read_table, read_text
from fitting.text.toml import read_toml
from fitting.text.units import convert
from fitting.text.written import Written

#: Column of the experiments file that names the FMU output an experiment observes.
OUTPUT_COLUMN = "output"


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """The campaign with its data; what depends on the FMU's variables is still as written.

    ``path`` is the campaign file, ``file`` what it says; ``measurements`` are those of further
    kinds, by their tables; ``unit`` is that of the amplitudes, empty for the declared one.
    """

    path: Path
    file: WrittenCampaign
    experiments: tuple[MeasuredExperiment, ...]
    sweep: MeasuredSweep | None
    measurements: Mapping[str, ReadMeasurement] = field(default_factory=dict)
    unit: str = ""

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that were read, the campaign file first."""
        found = [
            self.path,
            *([] if self.file.experiments is None else [self.file.experiments.file]),
        ]
        found += [e.spectrum.source for e in self.experiments if e.spectrum is not None]
        found += [] if self.sweep is None else [self.sweep.source]
        return (*found, *(file for m in self.measurements.values() for file in m.files))

    @property
    def is_scaled(self) -> bool:
        """Whether a scale stands between measured and simulated amplitudes."""
        experiments = self.file.experiments
        if experiments is not None and experiments.unknown == "gain":
            return True
        return self.file.sweep is not None and self.file.sweep.scale != "none"

    @property
    def amplitude_unit(self) -> str:
        """Unit of all amplitudes."""
        declared = self.file.sweep or self.file.experiments
        return self.unit or (declared.format.amplitude.unit if declared is not None else "V")


def in_other_unit(campaign: Campaign, factor: float, unit: str) -> Campaign:
    """The campaign with every amplitude multiplied by ``factor``: they are in ``unit`` then.

    Args:
        campaign: campaign as it was read.
        factor: by which values are multiplied.
        unit: that the amplitudes are in then.
    """
    experiments = tuple(
        replace(
            e,
            peaks_v=factor * e.peaks_v,
            sigmas_v=factor * e.sigmas_v,
            floor_v=factor * e.floor_v,
            spectrum=e.spectrum
            and replace(e.spectrum, amplitude_v=factor * e.spectrum.amplitude_v, unit=unit),
        )
        for e in campaign.experiments
    )
    sweep = campaign.sweep
    if sweep is not None:
        sweep = replace(sweep, amplitude_v=factor * sweep.amplitude_v, unit=unit)
    return replace(campaign, experiments=experiments, sweep=sweep, unit=unit)


def read_campaign(path: str | Path, kinds: Sequence[type[MeasurementTable]] = ()) -> Campaign:
    """Read a campaign file and every data file that it names.

    Args:
        path: of the file.
        kinds: of measurements that it may tell of, beside experiments and a sweep.

    Raises:
        BadInput: one line with file, row, column or key, what was found, what is wanted.
    """
    path = Path(path)
    try:
        file = read_campaign_file(path, kinds)
    except BadInput as error:
        raise BadInput(*error.args, *_missing_files(path, kinds)) from None
    experiments: tuple[MeasuredExperiment, ...] = ()
    sweep: MeasuredSweep | None = None
    measurements: dict[str, ReadMeasurement] = {}
    said = Complaints()
    if file.experiments is not None:
        with said:
            experiments = _read_experiments(file, file.experiments, path.parent)
    if file.sweep is not None:
        with said:
            sweep = _read_sweep(file.sweep)
    for name, tables in file.further.items():
        with said:
            kind, first = type(tables[0]), tables[0]
            measurements[name] = kind.read_together(tables) if kind.REPEATED else first.read()
    said.check()
    _check_one_unit(path, file)
    return Campaign(
        path=path, file=file, experiments=experiments, sweep=sweep, measurements=measurements
    )


def _missing_files(path: Path, kinds: Sequence[type[MeasurementTable]]) -> list[str]:
    """What is to be said of measured files that are not there, where keys are wrong besides."""
    try:
        data = read_toml(path)
    except BadInput:
        return []
    named = [data.get(name) for name in ("experiments", "sweep", *(kind.TABLE for kind in kinds))]
    tables = [table for each in named for table in (each if isinstance(each, list) else [each])]
    files = [table.get("file") for table in tables if isinstance(table, Mapping)]
    said: list[str] = []
    for file in files:
        if isinstance(file, str) and not (path.parent / file).exists():
            try:
                read_text(path.parent / file)
            except BadInput as error:
                said += error.args
    return said


def _check_one_unit(path: Path, file: WrittenCampaign) -> None:
    """Peaks and sweep are compared with each other, so they must share the detector's unit."""
    if file.experiments is None or file.sweep is None:
        return
    unit, other = (t.format.amplitude.unit for t in (file.experiments, file.sweep))
    if unit != other:
        raise BadInput(
            f"{path}: [sweep] amplitude is declared in {other}, [experiments] in {unit}; "
            "wanted the same unit, because they are compared"
        )


def _read_sweep(written: WrittenSweep) -> MeasuredSweep:
    how = written.format
    raw = read_trace(written.file, how.layout, how.selection)
    frequency_hz, amplitude_v = _calibrated(raw, how)
    phase_rad = None
    if raw.phase is not None:
        phase_rad = raw.phase * convert(1.0, raw.phase_unit, "rad", where=f"{raw.path}: phase")
    cut, left_out = clipped_top(amplitude_v), ""
    # a ratio of maxima has none without them: there the scale is told to be in doubt
    if np.any(cut) and written.use == "fit" and written.scale != "maximum":
        at = np.flatnonzero(cut)
        limit = quantity(float(np.max(amplitude_v)), math.nan, how.amplitude.unit)
        left_out = (
            f"{raw.path}: {raw.places[at[0]]} to {raw.places[at[-1]]} are left out, {at.size} "
            f"points of the sweep: the largest of them are equal, {limit}, as an instrument makes "
            "them at its limit."
        )
        frequency_hz, amplitude_v = frequency_hz[~cut], amplitude_v[~cut]
        phase_rad = None if phase_rad is None else phase_rad[~cut]
    return MeasuredSweep(
        frequency_hz=frequency_hz,
        amplitude_v=amplitude_v,
        phase_rad=phase_rad,
        source=written.file,
        unit=how.amplitude.unit,
        notes=dict(raw.notes),
        left_out=" ".join(filter(None, (raw.left_out, left_out))),
    )


def _calibrated(raw: RawTrace, how: TraceFormat) -> tuple[FloatArray, FloatArray]:
    """Frequency in Hz and peak amplitude in the declared unit."""
    where = f"{raw.path}: column 'frequency'"
    frequency = hertz_of(raw.frequency, raw.frequency_unit, where=where)
    amplitude = to_peak(raw.amplitude, raw.amplitude_unit, how.amplitude, str(raw.path), raw.places)
    for i in np.flatnonzero(frequency <= 0.0)[:1]:
        raise BadInput(
            f"{raw.path}: {raw.places[i]}: frequency {raw.frequency[i]:.9g} {raw.frequency_unit}; "
            "wanted a positive one"
        )
    return frequency, amplitude


#: What a column of the experiments holds, for complaints.
PEAKS, PHASES = "ready peaks", "phases"


def _read_experiments(
    file: WrittenCampaign, written: WrittenExperiments, folder: Path
) -> tuple[MeasuredExperiment, ...]:
    """All experiments, or complaints of every row and spectrum that has one."""
    table = read_table(written.file)
    wanted = [("experiment", ""), *((name, "") for name in file.driven.frequencies)]
    wanted += [(name, PHASES if name in written.phases else PEAKS) for name in written.data_columns]
    gathered(partial(_column, table, name, what) for name, what in wanted)
    labels = _labels(table)
    tones = _tones(table, file.driven.frequencies)
    for label in written.restarted:
        if label not in labels:
            raise BadInput(
                f"{table.path}: no experiment '{label}', which [experiments] restarted "
                f"names{did_you_mean(label, labels)}"
            )
    _check_phases(table, written)
    read = partial(_experiment, file, written, folder)
    rows = enumerate(zip(labels, tones, strict=True))
    return tuple(
        gathered(
            partial(read, _Cells(table, i), label, tuple(map(float, own)))
            for i, (label, own) in rows
        )
    )


def _check_phases(table: Table, written: WrittenExperiments) -> None:
    """Complain of columns of phases as a whole: all in another unit, or filled with one number."""
    columns = [c for c in map(table.find, written.phases) if c is not None]
    try:
        phases = np.array([table.numbers(column) for column in columns])
    except BadInput:
        return  # every row complains of its own cells
    for column, values in zip(columns, phases, strict=True):
        beyond = np.flatnonzero(np.abs(values) > 2.0 * np.pi)
        if column.unit == "rad" and beyond.size:
            raise BadInput(
                f"{table.path}: row {table.lines[beyond[0]]}, column '{column.name}': found "
                f"{values[beyond[0]]:.6g} rad, in {beyond.size} of {values.size} rows more than a "
                "turn; wanted phases within one turn, 2 pi, or the unit deg"
            )
    if phases.size > 2 and np.ptp(phases) == 0.0:
        raise BadInput(
            f"{table.path}: column '{columns[0].name}': the phase is {phases.flat[0]:.6g} "
            f"{columns[0].unit} of every line; wanted values that change over a resonance"
        )


def _column(table: Table, name: str, what: str) -> Column:
    """A column of a table, of ``what`` it is, for complaints."""
    found = table.find(name)
    if found is None:
        of = f" of {what}" if what else ""
        hint = did_you_mean(name, [c.name for c in table.columns])
        raise BadInput(f"{table.path}: no column '{name}'{of}{hint}")
    return found


def _labels(table: Table) -> tuple[str, ...]:
    column = table.column("experiment")
    labels = table.texts(column)
    for i, label in enumerate(labels):
        if not label or label in labels[:i]:
            what = "is empty" if not label else f"'{label}' appears twice"
            raise BadInput(
                f"{table.path}: row {table.lines[i]}, column 'experiment': {what}; "
                "wanted a name of its own for every experiment"
            )
    return labels


def _tones(table: Table, names: tuple[str, ...]) -> FloatArray:
    """Drive frequencies (experiments, tones) in Hz, positive and different within a row."""
    columns = []
    for name in names:
        column = table.column(name)
        unit = unit_of(table, column, f"{name} (MHz)")
        where = f"{table.path}: column '{name}'"
        columns.append(hertz_of(table.numbers(column), unit, where=where))
    tones = np.column_stack(columns)
    for row, line in zip(tones, table.lines, strict=True):
        if np.any(row <= 0.0) or np.unique(row).size < row.size:
            raise BadInput(
                f"{table.path}: row {line}: drive frequencies "
                f"{hertz(*row, digits=8, joined=', ')}; wanted positive ones that differ"
            )
    return tones


@dataclass(frozen=True)
class _Cells:
    """The cells of one row of the experiments file, by its columns."""

    table: Table
    index: int

    @property
    def row(self) -> str:
        """Words for the row."""
        return f"row {self.table.lines[self.index]}"

    def place(self, column: str) -> str:
        """Words for a cell."""
        return f"{self.table.path}: {self.row}, column '{column}'"

    def text(self, column: Column) -> str:
        """A cell as it stands."""
        return self.table.cells[self.index][column.index]

    def number(self, column: Column, name: str = "") -> float:
        """A cell that is to be a number; complaints call its column by the name."""
        where = self.place(name or column.name)
        return parse_number(self.text(column), where, decimal_comma=self.table.decimal_comma)

    def stamp(self, name: str) -> Written:
        """A time stamp: a number in the column's unit, or an ISO date."""
        column = self.table.column(name)
        if column.unit is None and any(mark in self.text(column) for mark in "-:T"):
            return Written(self.text(column), None, self.place(column.name))
        return Written(self.number(column), column.unit, self.place(column.name))

    def setting(self, column: Column) -> Written:
        """A cell as a Boolean, a text, a whole number or a number."""
        text, where = self.text(column), self.place(column.name)
        if text.lower() in ("true", "false"):
            return Written(text.lower() == "true", column.unit, where)
        if column.unit is None and not _numeric(text):
            return Written(text, None, where)  # a String variable's value, or a quantity
        number = self.number(column)
        whole = column.unit is None and number.is_integer() and not set(text.lower()) & set(".,e")
        return Written(int(number) if whole else number, column.unit, where)

    def amplitude(self, declared: Amplitude, name: str, *, part: bool = False) -> float:
        """A cell as peak amplitude in the declared unit; a part of a complex one has a sign."""
        column = _column(self.table, name, PEAKS)
        unit = unit_of(self.table, column, f"{name} (uV)")
        number = np.array([self.number(column, name)])
        size = np.abs(number) if part else number
        found = to_peak(size, unit, declared, str(self.table.path), [self.row], name)[0]
        return float(np.copysign(found, number[0]) if part else found)

    def radians(self, name: str) -> float:
        """A cell as a phase."""
        column = _column(self.table, name, PHASES)
        unit = unit_of(self.table, column, f"{name} (deg)")
        value = self.number(column, name)
        return convert(value, unit, "rad", where=f"{self.table.path}: column '{name}'")


def _experiment(
    file: WrittenCampaign,
    written: WrittenExperiments,
    folder: Path,
    cells: _Cells,
    label: str,
    tones_hz: tuple[float, ...],
) -> MeasuredExperiment:
    """The experiment of one row, with its spectrum or its ready peaks."""
    table, drive = cells.table, file.driven
    data = {*written.data_columns, file.drift.time}
    if drive.kind == "input":
        data |= set(drive.frequencies)
    settings = {  # what the columns that are no data set of the FMU's variables
        column.name: cells.setting(column)
        for column in table.columns
        if column.name not in data and column.name.lower() != "experiment"
    }
    lines_hz = tuple(line.frequency_hz(tones_hz) for line in drive.lines)
    for line, f in zip(drive.lines, lines_hz, strict=True):
        if f <= 0.0:
            raise BadInput(
                f"{table.path}: {cells.row}: {line.text} is at {hertz(f)}, wanted a positive "
                "frequency"
            )
    read = partial(
        MeasuredExperiment,
        label=label,
        tones_hz=tones_hz,
        lines_hz=lines_hz,
        output=settings.pop(OUTPUT_COLUMN, None),
        settings=settings,
        stamp=cells.stamp(file.drift.time) if file.drift.time else None,
    )
    how = written.format
    if written.spectra is not None:
        path = folder / written.spectra.replace("{experiment}", label)
        raw = read_trace(path, how.layout, how.selection)
        spectrum = Spectrum(*_calibrated(raw, how), source=path, unit=how.amplitude.unit)
        measured, kind = (spectrum.frequency_hz, spectrum.amplitude_v), written.noise_floor
        reading = read_peaks(*measured, lines_hz, kind, source=str(path))
        floor_v = 0.0 if kind == "none" else reading.floor.level_v
        return read(
            peaks_v=reading.peaks_v, sigmas_v=reading.sigmas_v, floor_v=floor_v, spectrum=spectrum
        )
    amplitude = partial(cells.amplitude, how.amplitude, part=bool(written.x))
    names = written.x or written.peaks
    peaks, phases = np.array([amplitude(name) for name in names]), None
    if written.x:
        values = peaks + 1j * np.array([amplitude(name) for name in written.y])
        peaks, radians = np.abs(values), np.angle(values)
    else:
        radians = np.array([cells.radians(name) for name in written.phases])
    for name, value in zip(names, peaks, strict=True):
        if value <= 0.0:
            where = cells.place(name)
            raise BadInput(f"{where}: the peak is zero; wanted a positive amplitude")
    if written.is_complex:
        phases = Phases(
            radians=-radians if written.conjugate else radians,
            unknown=written.unknown or UNKNOWN[0],
            restarted=label in written.restarted,
        )
    sigmas = [
        cells.amplitude(how.amplitude, name) for name in written.peak_sigmas
    ]  # nan where no column tells them
    sigmas_v = np.array(sigmas or np.full(peaks.size, np.nan))
    return read(peaks_v=peaks, sigmas_v=sigmas_v, phases=phases)


def _numeric(text: str) -> bool:
    return not text or text[0] in "+-.0123456789" or text.lower() in ("nan", "inf")
