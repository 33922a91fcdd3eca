"""Campaign file plus its data files -> checked records, in the units they were written in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fitting.campaign.instruments import RawTrace, read_trace, unit_of
from fitting.campaign.schema import (
    CampaignFile,
    ExperimentsChoice,
    SweepChoice,
    TraceFormat,
    read_campaign_file,
)
from fitting.campaign.section import Written
from fitting.signal.amplitudes import to_peak
from fitting.signal.peaks import MIN_SWEEP_POINTS, NoiseFloor, read_peaks
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import hertz
from fitting.text.tables import Column, Table, did_you_mean, parse_number, read_table
from fitting.text.units import convert

#: Column of the experiments file that names the FMU output an experiment observes.
OUTPUT_COLUMN = "output"


@dataclass(frozen=True)
class Spectrum:
    """A measured spectrum: ``frequency_hz`` (n,), ``amplitude_v`` (n,) peak, in ``unit``."""

    frequency_hz: FloatArray
    amplitude_v: FloatArray
    source: Path
    unit: str = "V"


@dataclass(frozen=True)
class MeasuredExperiment:
    """One experiment as measured.

    ``settings`` are the file's columns as written, ``tones_hz`` the drive frequencies;
    ``lines_hz``, ``peaks_v``, ``sigmas_v`` (n,) per line read: frequency, peak amplitude with the
    noise floor removed, its standard deviation (nan where ready peaks come without one);
    ``floor_v`` mean noise magnitude; ``output`` the FMU output that this experiment observes, as
    written in that column of the file, None for the campaign's; ``stamp`` its time, if drift asks.
    """

    label: str
    settings: Mapping[str, Written]
    tones_hz: tuple[float, ...]
    lines_hz: tuple[float, ...]
    peaks_v: FloatArray
    sigmas_v: FloatArray
    floor_v: float
    spectrum: Spectrum | None
    output: Written | None = None
    stamp: Written | None = None


@dataclass(frozen=True)
class MeasuredSweep:
    """The FRF sweep: ``frequency_hz``, ``amplitude_v`` peak, ``phase_rad`` or None, (n,) each.

    ``unit`` is the detector's; ``notes`` are header entries of the instrument.
    """

    frequency_hz: FloatArray
    amplitude_v: FloatArray
    phase_rad: FloatArray | None
    source: Path
    unit: str
    notes: Mapping[str, str]


@dataclass(frozen=True)
class Campaign:
    """The campaign with its data; what depends on the FMU's variables is still as written.

    ``files`` are all files read, the campaign file first; ``unit`` is that of the amplitudes, empty
    for the declared one.
    """

    file: CampaignFile
    experiments: tuple[MeasuredExperiment, ...]
    sweep: MeasuredSweep | None
    files: tuple[Path, ...]
    unit: str = ""

    @property
    def path(self) -> Path:
        """The campaign file."""
        return self.file.path

    @property
    def is_scaled(self) -> bool:
        """Whether a sweep sets the scale between measured and simulated amplitudes."""
        return self.file.sweep is not None and self.file.sweep.scale != "none"

    @property
    def amplitude_unit(self) -> str:
        """Unit of all amplitudes."""
        return self.unit or _declared_unit(self.file)


def _declared_unit(file: CampaignFile) -> str:
    declared = file.sweep or file.experiments
    return declared.format.amplitude.unit if declared is not None else "V"


def in_other_unit(campaign: Campaign, factor: float, unit: str) -> Campaign:
    """The campaign with every amplitude multiplied by ``factor``: they are in ``unit`` then."""
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


def read_campaign(path: str | Path) -> Campaign:
    """Read a campaign file and every data file that it names.

    Raises:
        BadInput: one line with file, row, column or key, what was found, what is wanted.
    """
    file = read_campaign_file(Path(path))
    experiments: tuple[MeasuredExperiment, ...] = ()
    files = [file.path]
    if file.experiments is not None:
        experiments = _read_experiments(file, file.experiments)
        files.append(file.experiments.file)
        files += [e.spectrum.source for e in experiments if e.spectrum is not None]
    sweep = None
    if file.sweep is not None:
        sweep = _read_sweep(file.sweep)
        files.append(sweep.source)
    _check_one_unit(file, sweep)
    return Campaign(file, experiments, sweep, tuple(files))


def _check_one_unit(file: CampaignFile, sweep: MeasuredSweep | None) -> None:
    """Peaks and sweep are compared with each other, so they must share the detector's unit."""
    if file.experiments is None or sweep is None:
        return
    unit = file.experiments.format.amplitude.unit
    if unit != sweep.unit:
        raise BadInput(
            f"{file.path}: [sweep] amplitude is declared in {sweep.unit}, [experiments] in {unit}; "
            "wanted the same unit, because they are compared"
        )


def _read_sweep(choice: SweepChoice) -> MeasuredSweep:
    raw = read_trace(choice.file, choice.format.layout, choice.format.selection)
    if raw.frequency.size < MIN_SWEEP_POINTS:
        raise BadInput(
            f"{choice.file}: {raw.frequency.size} points are too few for a sweep; "
            f"wanted at least {MIN_SWEEP_POINTS}"
        )
    frequency_hz, amplitude_v = _calibrated(raw, choice.format)
    if not np.any(amplitude_v > 0.0):
        raise BadInput(f"{choice.file}: every amplitude is zero; wanted a resonance")
    phase_rad = None
    if raw.phase is not None:
        phase_rad = raw.phase * convert(1.0, raw.phase_unit, "rad", where=f"{raw.path}: phase")
    unit = choice.format.amplitude.unit
    return MeasuredSweep(frequency_hz, amplitude_v, phase_rad, choice.file, unit, dict(raw.notes))


def _calibrated(raw: RawTrace, how: TraceFormat) -> tuple[FloatArray, FloatArray]:
    """Frequency in Hz and peak amplitude in the declared unit."""
    where = f"{raw.path}: column 'frequency'"
    frequency = _hertz(raw.frequency, raw.frequency_unit, where)
    amplitude = to_peak(raw.amplitude, raw.amplitude_unit, how.amplitude, str(raw.path), raw.places)
    for i in np.flatnonzero(frequency <= 0.0)[:1]:
        raise BadInput(
            f"{raw.path}: {raw.places[i]}: frequency {raw.frequency[i]:.9g} {raw.frequency_unit}; "
            "wanted a positive one"
        )
    return frequency, amplitude


def _hertz(values: FloatArray, unit: str, where: str) -> FloatArray:
    """Values in ``unit`` as Hz, each rounded once: 6.94016 MHz is the tone 6940160 Hz exactly.

    Equal frequencies are then equal, whichever unit each file writes them in.
    """
    return np.array([convert(float(v), unit, "Hz", where=where) for v in values])


def _read_experiments(
    file: CampaignFile, choice: ExperimentsChoice
) -> tuple[MeasuredExperiment, ...]:
    table = read_table(choice.file)
    labels = _labels(table)
    tones = _tones(table, file.drive.frequencies)
    return tuple(
        _experiment(file, choice, table, i, label, tuple(float(f) for f in tones[i]))
        for i, label in enumerate(labels)
    )


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
        columns.append(_hertz(table.numbers(column), unit, where))
    tones = np.column_stack(columns)
    for row, line in zip(tones, table.lines, strict=True):
        if np.any(row <= 0.0) or np.unique(row).size < row.size:
            raise BadInput(
                f"{table.path}: row {line}: drive frequencies "
                f"{hertz(*row, digits=8, joined=', ')}; wanted positive ones that differ"
            )
    return tones


def _experiment(
    file: CampaignFile,
    choice: ExperimentsChoice,
    table: Table,
    index: int,
    label: str,
    tones_hz: tuple[float, ...],
) -> MeasuredExperiment:
    settings = _settings(file, choice, table, index)
    stamp = _stamp(file, table, index)
    lines_hz = _lines(file, tones_hz, f"{table.path}: row {table.lines[index]}")
    output = settings.pop(OUTPUT_COLUMN, None)
    if choice.spectra is None:
        peaks, sigmas = _ready_peaks(choice, table, index)
        return MeasuredExperiment(
            label, settings, tones_hz, lines_hz, peaks, sigmas, 0.0, None, output, stamp
        )
    path = file.path.parent / choice.spectra.replace("{experiment}", label)
    raw = read_trace(path, choice.format.layout, choice.format.selection)
    frequency_hz, amplitude_v = _calibrated(raw, choice.format)
    reading = read_peaks(frequency_hz, amplitude_v, lines_hz, choice.noise_floor, source=str(path))
    floor = NoiseFloor(0.0, 0.0) if choice.noise_floor == "none" else reading.floor
    spectrum = Spectrum(frequency_hz, amplitude_v, path, choice.format.amplitude.unit)
    return MeasuredExperiment(
        label,
        settings,
        tones_hz,
        lines_hz,
        reading.peaks_v,
        reading.sigmas_v,
        floor.level_v,
        spectrum,
        output,
        stamp,
    )


def _stamp(file: CampaignFile, table: Table, index: int) -> Written | None:
    """The time stamp of one row: a number in the column's unit, or an ISO date."""
    if not file.drift.time:
        return None
    column = table.column(file.drift.time)
    where = f"{table.path}: row {table.lines[index]}, column '{column.name}'"
    text = table.cells[index][column.index]
    if column.unit is None and any(mark in text for mark in "-:T"):
        return Written(text, None, where)
    return Written(parse_number(text, where, decimal_comma=table.decimal_comma), column.unit, where)


def _lines(file: CampaignFile, tones_hz: tuple[float, ...], where: str) -> tuple[float, ...]:
    """Frequencies of the lines that are read."""
    lines_hz = tuple(line.frequency_hz(tones_hz) for line in file.drive.read)
    for line, f in zip(file.drive.read, lines_hz, strict=True):
        if f <= 0.0:
            raise BadInput(f"{where}: {line.text} is at {hertz(f)}, wanted a positive frequency")
    return lines_hz


def _settings(
    file: CampaignFile, choice: ExperimentsChoice, table: Table, index: int
) -> dict[str, Written]:
    """Columns of the experiments file that set an FMU variable, one row of them."""
    data = {"experiment", *choice.peaks, *choice.peak_sigmas, file.drift.time}
    if file.drive.kind == "input":
        data |= set(file.drive.frequencies)
    settings = {}
    for column in table.columns:
        if column.name in data or column.name.lower() == "experiment":
            continue
        where = f"{table.path}: row {table.lines[index]}, column '{column.name}'"
        settings[column.name] = _cell(table, column, index, where)
    return settings


def _cell(table: Table, column: Column, index: int, where: str) -> Written:
    text = table.cells[index][column.index]
    if text.lower() in ("true", "false"):
        return Written(text.lower() == "true", column.unit, where)
    if column.unit is None and not _numeric(text):
        return Written(text, None, where)  # a String variable's value, or a quantity
    number = parse_number(text, where, decimal_comma=table.decimal_comma)
    whole = column.unit is None and number.is_integer() and not set(text.lower()) & set(".,e")
    return Written(int(number) if whole else number, column.unit, where)


def _numeric(text: str) -> bool:
    return not text or text[0] in "+-.0123456789" or text.lower() in ("nan", "inf")


def _ready_peaks(
    choice: ExperimentsChoice, table: Table, index: int
) -> tuple[FloatArray, FloatArray]:
    peaks = np.array([_amplitude_cell(choice, table, name, index) for name in choice.peaks])
    for name, value in zip(choice.peaks, peaks, strict=True):
        if value <= 0.0:
            raise BadInput(
                f"{table.path}: row {table.lines[index]}, column '{name}': "
                "the peak is zero; wanted a positive amplitude"
            )
    if not choice.peak_sigmas:
        return peaks, np.full(peaks.shape, np.nan)
    return peaks, np.array(
        [_amplitude_cell(choice, table, name, index) for name in choice.peak_sigmas]
    )


def _amplitude_cell(choice: ExperimentsChoice, table: Table, name: str, index: int) -> float:
    column = table.find(name)
    if column is None:
        hint = did_you_mean(name, [c.name for c in table.columns])
        raise BadInput(f"{table.path}: no column '{name}' of ready peaks{hint}")
    unit = unit_of(table, column, f"{name} (uV)")
    place = f"row {table.lines[index]}"
    where = f"{table.path}: {place}, column '{name}'"
    number = parse_number(
        table.cells[index][column.index], where, decimal_comma=table.decimal_comma
    )
    value = to_peak(
        np.array([number]), unit, choice.format.amplitude, str(table.path), [place], name
    )
    return float(value[0])
