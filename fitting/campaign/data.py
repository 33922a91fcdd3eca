"""Campaign file plus its data files -> checked records, in the units they were written in."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from fitting.campaign.file import (
    WrittenCampaign,
    WrittenExperiments,
    WrittenSweep,
    read_campaign_file,
)
from fitting.campaign.instruments import read_trace
from fitting.campaign.instruments.recording import RawTrace, unit_of
from fitting.campaign.kind import MeasurementTable, ReadMeasurement
from fitting.campaign.measured import (
    UNKNOWN,
    Experiment,
    Spectrum,
    SweepData,
    checked_experiment,
)
from fitting.lines.excluded import clipped_top
from fitting.signal.amplitudes import Amplitude, to_peak
from fitting.signal.peaks import read_peaks
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, Complaints, did_you_mean, gathered
from fitting.text.finding import Kind, left_out, of_kind
from fitting.text.notation import hertz
from fitting.text.tables import Column, Table, hertz_of, parse_number, read_table, read_text
from fitting.text.toml import read_toml
from fitting.text.units import Written, convert

#: Column of the experiments file that names the FMU output an experiment observes.
OUTPUT_COLUMN = "output"


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """The campaign with its data; what depends on the FMU's variables is still as written.

    ``path`` is the campaign file, ``file`` what it states; ``measurements`` are those of further
    kinds, by their tables; ``unit`` is that of the amplitudes, empty for the declared one.
    """

    path: Path
    file: WrittenCampaign
    experiments: tuple[Experiment, ...]
    sweep: SweepData | None
    measurements: Mapping[str, ReadMeasurement] = field(default_factory=dict)
    unit: str = ""

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that were read, the campaign file first."""
        result = [
            self.path,
            *([] if self.file.experiments is None else [self.file.experiments.file]),
        ]
        result += [e.spectrum.source for e in self.experiments if e.spectrum is not None]
        result += [] if self.sweep is None else [self.sweep.source]
        return (*result, *(file for m in self.measurements.values() for file in m.files))

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
        return self.unit or (declared.detector.unit if declared is not None else "V")


def read_campaign(path: str | Path, kinds: Sequence[type[MeasurementTable]] = ()) -> Campaign:
    """Read a campaign file and every data file that it names.

    Args:
        path: of the file.
        kinds: of measurements that it may hold, next to experiments and a sweep.

    Raises:
        BadInput: one line with file, row, column or key, what was found, what is wanted.
    """
    path = Path(path)
    try:
        file = read_campaign_file(path, kinds)
    except BadInput as error:
        raise BadInput(*error.args, *_missing_files(path, kinds)) from None
    stated = Complaints()
    read = stated.read
    experiments: tuple[Experiment, ...] = ()
    sweep: SweepData | None = None
    if file.experiments is not None:
        experiments = read(_read_experiments, file, file.experiments, path.parent)
    if file.sweep is not None:
        sweep = read(_read_sweep, file.sweep)
    measurements = {
        name: read(tables[0].read_together, tables) if tables[0].REPEATED else read(tables[0].read)
        for name, tables in file.further.items()
    }
    stated.check()
    if file.experiments is not None and file.sweep is not None:
        # peaks and sweep are compared with each other, so they must share the detector's unit
        unit, other = (t.detector.unit for t in (file.experiments, file.sweep))
        if unit != other:
            raise BadInput(
                f"{path}: [sweep] amplitude is declared in {other}, [experiments] in {unit}; "
                "wanted the same unit, because they are compared"
            )
    return Campaign(
        path=path, file=file, experiments=experiments, sweep=sweep, measurements=measurements
    )


def _missing_files(path: Path, kinds: Sequence[type[MeasurementTable]]) -> list[str]:
    """Errors of measured files that are not there, where keys are wrong besides."""
    try:
        data = read_toml(path)
    except BadInput:
        return []
    named = [data.get(name) for name in ("experiments", "sweep", *(kind.TABLE for kind in kinds))]
    tables = [t for each in named for t in (each if isinstance(each, list) else [each])]
    files = [t.get("file") for t in tables if isinstance(t, Mapping)]
    stated = Complaints()
    for file in (path.parent / name for name in files if isinstance(name, str)):
        if not file.exists():
            stated.read(read_text, file)
    return stated.lines


def _read_sweep(written: WrittenSweep) -> SweepData:
    unit = written.detector.unit
    raw = read_trace(written.file, written.layout, written.selection(written.columns))
    frequency_hz, amplitude_v = _calibrated(raw, written.detector)
    phase_rad = None
    if raw.phase is not None:
        phase_rad = raw.phase * convert(1.0, raw.phase_unit, "rad", where=f"{raw.path}: phase")
    sigma_v = _sigmas(raw, amplitude_v, written.detector)
    cut, omitted = clipped_top(amplitude_v), raw.left_out
    # a ratio of maxima has none without them: there the scale is told to be in doubt
    if np.any(cut) and written.use == "fit" and written.scale not in ("maximum", "grid"):
        at = np.flatnonzero(cut)
        limit, places = float(np.max(amplitude_v)), (raw.places[at[0]], raw.places[at[-1]])
        result = left_out(str(raw.path), at.size, *places, limit=limit)
        omitted += (replace(result, names={**result.names, "unit": (unit,)}),)
        frequency_hz, amplitude_v = frequency_hz[~cut], amplitude_v[~cut]
        phase_rad = None if phase_rad is None else phase_rad[~cut]
        sigma_v = None if sigma_v is None else sigma_v[~cut]
    return SweepData(
        frequency_hz=frequency_hz,
        amplitude_v=amplitude_v,
        phase_rad=phase_rad,
        sigma_v=sigma_v,
        source=written.file,
        unit=unit,
        notes=dict(raw.notes),
        left_out=omitted,
        use=written.use,
        scale=written.scale,
        background=written.background,
    )


def _sigmas(raw: RawTrace, amplitude_v: FloatArray, detector: Amplitude) -> FloatArray | None:
    """Standard errors of peak amplitudes, in their unit; None where the campaign names none."""
    if raw.sigma is None:
        return None
    where = f"{raw.path}: standard errors"
    for i in np.flatnonzero(raw.sigma <= 0.0)[:1]:
        raise BadInput(
            f"{where}: {raw.places[i]}: found {raw.sigma[i]:.6g} {raw.sigma_unit}; wanted more "
            "than zero"
        )
    if detector.kind not in ("dB", "dBm"):
        return to_peak(raw.sigma, raw.sigma_unit, detector, str(raw.path), raw.places, "sigma")
    # a level's: an error of 1 dB is a share ln(10)/20 of the amplitude
    if raw.sigma_unit not in ("dB", "dBm"):
        raise BadInput(f"{where}: are in {raw.sigma_unit}, wanted dB like the amplitudes")
    return np.asarray(amplitude_v * math.log(10.0) / 20.0 * raw.sigma)


def _calibrated(raw: RawTrace, detector: Amplitude) -> tuple[FloatArray, FloatArray]:
    """Frequency in Hz and peak amplitude in the declared unit."""
    where = f"{raw.path}: column 'frequency'"
    frequency = hertz_of(raw.frequency, raw.frequency_unit, where=where)
    amplitude = to_peak(raw.amplitude, raw.amplitude_unit, detector, str(raw.path), raw.places)
    for i in np.flatnonzero(frequency <= 0.0)[:1]:
        raise BadInput(
            f"{raw.path}: {raw.places[i]}: frequency {raw.frequency[i]:.9g} {raw.frequency_unit}; "
            "wanted a positive one"
        )
    return frequency, amplitude


def _read_experiments(
    file: WrittenCampaign, written: WrittenExperiments, folder: Path
) -> tuple[Experiment, ...]:
    """All experiments, or errors of every row and spectrum that has one."""
    table, names = read_table(written.file), file.driven.frequencies
    wanted = [("experiment", ""), *((name, "") for name in names)]
    wanted += [
        (name, " of phases" if name in written.phases else " of ready peaks")
        for name in written.data_columns
    ]
    columns = [c.name for c in table.columns]
    missing = [
        f"{table.path}: no column '{name}'{what}{did_you_mean(name, columns)}"
        for name, what in wanted
        if table.find(name) is None
    ]
    if missing:
        raise BadInput(*missing)
    labels = table.texts(table.column("experiment"))
    for i, label in enumerate(labels):
        if not label or label in labels[:i]:
            what = "is empty" if not label else f"'{label}' appears twice"
            raise BadInput(
                f"{table.path}: row {table.lines[i]}, column 'experiment': {what}; "
                "wanted a name of its own for every experiment"
            )
    tones_hz = np.column_stack(
        [
            hertz_of(
                table.numbers(column),
                unit_of(table, column, f"{name} (MHz)"),
                where=f"{table.path}: column '{name}'",
            )
            for name, column in ((name, table.column(name)) for name in names)
        ]
    )
    for row, line in zip(tones_hz, table.lines, strict=True):
        if np.any(row <= 0.0) or np.unique(row).size < row.size:
            raise BadInput(
                f"{table.path}: row {line}: drive frequencies "
                f"{hertz(*row, digits=8, joined=', ')}; wanted positive ones that differ"
            )
    for label in written.restarted:
        if label not in labels:
            raise BadInput(
                f"{table.path}: no experiment '{label}', which [experiments] restarted "
                f"names{did_you_mean(label, labels)}"
            )
    ready = {} if written.spectra is not None else _ready_peaks(table, written)
    read = partial(_experiment, file, written, folder, table, ready)
    rows = enumerate(zip(labels, tones_hz.tolist(), strict=True))
    return tuple(gathered(partial(read, i, label, tuple(own)) for i, (label, own) in rows))


def _ready_peaks(table: Table, written: WrittenExperiments) -> dict[str, FloatArray]:
    """Peaks that are columns of a table, (m, l) each, by the fields of an experiment."""
    path, rows = table.path, [f"row {n}" for n in table.lines]

    def read(names: Sequence[str], example: str, reader: Callable[..., FloatArray]) -> FloatArray:
        """Columns, (m, l), or one error for each that has any."""
        columns = [table.column(name) for name in names]
        units = [unit_of(table, c, f"{c.name} ({example})") for c in columns]
        values = gathered(map(partial, itertools.repeat(reader), columns, units))
        return np.array(values, dtype=float).reshape(len(names), len(rows)).T

    def amplitudes(column: Column, unit: str) -> FloatArray:
        """Peak amplitudes, in the declared unit; a part of complex values has a sign."""
        values, is_part = table.numbers(column), column.name in (*written.x, *written.y)
        sizes = np.abs(values) if is_part else values
        peaks = to_peak(sizes, unit, written.detector, str(path), rows, column.name)
        return np.copysign(peaks, values) if is_part else peaks

    def radians(column: Column, unit: str) -> FloatArray:
        values = table.numbers(column)
        beyond = np.flatnonzero(np.abs(values) > 2.0 * np.pi)
        if unit == "rad" and beyond.size:
            raise BadInput(
                f"{path}: {rows[beyond[0]]}, column '{column.name}': found {values[beyond[0]]:.6g} "
                f"rad, in {beyond.size} of {values.size} rows more than a turn; wanted phases "
                "within one turn, 2 pi, or the unit deg"
            )
        where = f"{path}: column '{column.name}'"
        return np.array([convert(float(value), unit, "rad", where=where) for value in values])

    names = written.x or written.peaks
    peaks, phases = read(names, "uV", amplitudes), read(written.phases, "deg", radians)
    if phases.size > 2 and np.ptp(phases) == 0.0:
        column = table.column(written.phases[0])
        raise BadInput(
            f"{path}: column '{column.name}': the phase is {table.numbers(column)[0]:.6g} "
            f"{column.unit} of every line; wanted values that change over a resonance"
        )
    if written.x:
        values = peaks + 1j * read(written.y, "uV", amplitudes)
        peaks, phases = np.abs(values), np.angle(values)
    for i, k in np.argwhere(peaks <= 0.0):
        raise BadInput(
            f"{path}: {rows[i]}, column '{names[k]}': the peak is zero; wanted a positive amplitude"
        )
    made = {"peaks_v": peaks, "sigmas_v": read(written.peak_sigmas, "uV", amplitudes)}
    return made | ({"phases_rad": -phases if written.conjugate else phases} if phases.size else {})


def _experiment(  # noqa: PLR0913 - a row of the file, and what it means
    file: WrittenCampaign,
    written: WrittenExperiments,
    folder: Path,
    table: Table,
    ready: Mapping[str, FloatArray],
    i: int,
    label: str,
    tones_hz: tuple[float, ...],
) -> Experiment:
    """The experiment of one row, with its spectrum or its ready peaks."""
    path, row, detector = table.path, f"row {table.lines[i]}", written.detector
    drive, time = file.driven, file.drift.time

    def setting(column: Column, *, is_stamp: bool = False) -> Written:
        """A cell as a Boolean, a text, a whole number or a number; a stamp may be an ISO date."""
        text, unit = table.cells[i][column.index], column.unit
        where = f"{path}: {row}, column '{column.name}'"
        value: Scalar = text
        numeric = not text or text[0] in "+-.0123456789" or text.lower() in ("nan", "inf")
        if text.lower() in ("true", "false") and not is_stamp:
            value = text.lower() == "true"
        elif unit is not None or (
            not any(mark in text for mark in "-:T") if is_stamp else numeric
        ):  # else a String variable's value, a quantity, or a date
            value = parse_number(text, where, decimal_comma=table.decimal_comma)
            whole = unit is None and value.is_integer() and not set(text.lower()) & set(".,e")
            value = int(value) if whole and not is_stamp else value
        return Written(value, unit, where)

    # columns that are no data set variables of the FMU
    data = {*written.data_columns, time, *(drive.frequencies if drive.kind == "input" else ())}
    settings = {
        column.name: setting(column)
        for column in table.columns
        if column.name not in data and column.name.lower() != "experiment"
    }
    lines_hz = tuple(line.frequency_hz(tones_hz) for line in drive.lines)
    for line, f in zip(drive.lines, lines_hz, strict=True):
        if f <= 0.0:
            raise BadInput(
                f"{path}: {row}: {line.text} is at {hertz(f)}, wanted a positive frequency"
            )
    read = partial(
        Experiment,
        label=label,
        tones_hz=tones_hz,
        lines_hz=lines_hz,
        observed=settings.pop(OUTPUT_COLUMN, None),
        written=settings,
        stamp=setting(table.column(time), is_stamp=True) if time else None,
    )
    if ready:
        own = {key: values[i] for key, values in ready.items()}
        unknown, restarted = written.unknown or UNKNOWN[0], label in written.restarted
        return checked_experiment(read(**own, unknown=unknown, restarted=restarted))
    source, unit = folder / str(written.spectra).replace("{experiment}", label), detector.unit
    raw = read_trace(source, written.layout, written.selection(written.columns))
    other = of_kind(raw.left_out, Kind.other_columns)
    calibrated = _calibrated(raw, detector)
    spectrum = Spectrum(*calibrated, source=source, unit=unit, left_out=other)
    measured, kind = (spectrum.frequency_hz, spectrum.amplitude_v), written.noise_floor
    reading = read_peaks(*measured, lines_hz, kind, source=str(source))
    floor_v = 0.0 if kind == "none" else reading.floor.level_v
    peaks_v, sigmas_v = reading.peaks_v, reading.sigmas_v
    return checked_experiment(
        read(peaks_v=peaks_v, sigmas_v=sigmas_v, floor_v=floor_v, spectrum=spectrum)
    )
