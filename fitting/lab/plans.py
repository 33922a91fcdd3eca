"""Planned measurements -> the same campaign measured by a virtual laboratory, as texts by name.

Drive pairs go to a bench of the string, as its own series does. What sweeps one line over controls
answers with its closed form S(u). A point of a sweep has noise n of

    sigma^2 = noise_floor^2 + (relative_noise |S|)^2

on each quadrature: X + i Y = e^(i phase) e^(-i 2 pi (u - u0) tau) S + n, or its magnitude |S + n|.
A tone of a spectrum has S times the drive's amplitude. Averaged over n spectra, with complex noise
of the floor and r of the relative noise, each drawn anew, it is

    X + i Y = (S + floor n/sqrt(averaged)) (1 + r) e^(i reference),    or its magnitude
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Collection, Iterable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fitting.extension.records import KINDS, read_campaign_file
from fitting.lab.bench import DRIFTING, OUTPUTS, Bench, Cell, Row, measure_rows
from fitting.lab.curves import AvoidedCrossing
from fitting.lab.instruments import Averaged
from fitting.lab.laboratories import AnyBench, SweptBench
from fitting.lab.names import CROSSING, PUMPED, SUBHARMONIC, VOLTAGE
from fitting.lab.string import Drive
from fitting.lab.writer import synthetic_files, truth_tables, written_mhz
from fitting.measurements.complex_sweep import ComplexControlSweepTable
from fitting.measurements.control_sweep import ControlSweepTable
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.files import path_from
from fitting.text.notation import listed
from fitting.text.tables import Column, read_table, read_text
from fitting.text.toml import Tables, inline, rewritten
from fitting.text.units import convert, in_unit, positive_in

#: Of the noise of planned sweeps and tones, apart from that of the campaign which they continue.
SWEEPS_STREAM, TONES_STREAM = 4, 5
#: Columns of a plan that a bench can set besides drive frequencies and amplitudes.
GAINS = ("g1", "g2")
SweptTable = ControlSweepTable | ComplexControlSweepTable


#: What was measured, its truth, and the files of the campaign by relative name.
Made = tuple[Any, dict[str, Any], dict[str, str | bytes]]


def planned(truth: object, bench: AnyBench, path: Path, seed: int, head: Sequence[str]) -> Made:
    """Measure what a planned campaign asks for; the same seed gives the same numbers.

    Args:
        truth: of the laboratory, as it was named.
        bench: the laboratory.
        path: of the campaign that `fmu-fit design` proposed.
        seed: of the noise and of unknown phases.
        head: lines that open every file.

    Raises:
        BadInput: no plan, or one that asks of the laboratory what it cannot do.
        ValueError: a drive or pump under which the sample has no steady state.
    """
    plan = Plan(path)
    if plan.sweeps is not None:
        if isinstance(bench, SweptBench):
            return _sweeps(plan, plan.sweeps, bench, seed, head)
        raise BadInput(
            f"{truth}: is no laboratory of sweeps over a control; wanted one of "
            f"{CROSSING!r}, {PUMPED!r}, {SUBHARMONIC!r} or {VOLTAGE!r}"
        )
    if isinstance(bench, AvoidedCrossing):
        return _tones(plan, bench, seed, head)
    if isinstance(bench, Bench):
        return _pairs(plan, bench, seed, head)
    if isinstance(bench, SweptBench):
        raise BadInput(
            f"plan: the bench {bench.kind!r} measures sweeps, not the tones of a plan; wanted "
            "sweeps"
        )
    raise BadInput(
        f"plan: has no meaning for the curve {bench.kind!r}, which is driven by no pairs of tones; "
        "wanted none"
    )


class Plan:
    """A campaign whose table waits for values, as the virtual laboratory understands it.

    ``sweeps`` is its table of sweeps, None where peaks of tones are measured: its experiments. The
    noise is its table [design]: ``floor_v`` V and ``relative``, with ``averaged`` spectra a row.

    Raises:
        BadInput: no plan, or one of recordings over time, which no laboratory follows.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.file = path, read_campaign_file(path, KINDS)
        design, experiments = self.file.design, self.file.experiments
        if design.traces is not None:
            raise BadInput(
                f"{path}: proposes recordings over time, which are not measured by --plan; wanted "
                "another trace of the laboratory, as by synthesize_curves('ringdown', length_s=0.6)"
            )
        self.floor_v = positive_in(design.noise_floor, "V") if design.noise_floor else 0.0
        self.relative, self.averaged = design.relative_noise or 0.0, design.averaged or ()
        # as a design continues them, amplitudes come first
        kinds = (ControlSweepTable.TABLE, ComplexControlSweepTable.TABLE)
        tables = [table for kind in kinds for table in self.file.further.get(kind, ())]
        swept = [table for table in tables if isinstance(table, SweptTable)]
        self.sweeps = swept[0] if swept and design.sweeps is not None else None
        self.filled: tuple[str, ...] = ()
        self.is_complex = isinstance(self.sweeps, ComplexControlSweepTable)
        if self.sweeps is not None:
            self.table = read_table(self.sweeps.file)
            return
        if experiments is None:
            raise self._is_missing()
        self.table = read_table(experiments.file)
        self.filled, self.is_complex = experiments.data_columns, experiments.is_complex

    def refuse_unknown(self, settings: Collection[str], outputs: Sequence[str]) -> None:
        """Refuse rows of tones that ask for what the laboratory does not set or observe.

        Args:
            settings: that it sets besides the tones.
            outputs: that it observes.
        """
        if not self.averaged:
            raise self._is_missing()
        driven, table = self.file.driven, self.table
        settable = (*driven.frequencies, *(driven.amplitudes or ()), *settings)
        for column in table.columns:
            if column.name not in {"experiment", "output", *settable, *self.filled}:
                raise BadInput(
                    f"{self.where(column)}: the virtual laboratory cannot set it, wanted "
                    f"{listed(settable)}"
                )
        if len(self.averaged) != len(table.cells):
            raise BadInput(
                f"{self.path}: [design] averaged: found {len(self.averaged)} numbers, wanted "
                f"{len(table.cells)}, one for every row of {table.path}"
            )
        for line, output in zip(table.lines, table.texts(table.column("output")), strict=True):
            if output not in outputs:
                raise BadInput(
                    f"{table.path}: row {line}, column 'output': the virtual laboratory does not "
                    f"observe '{output}', wanted {' or '.join(outputs)}"
                )

    def _is_missing(self) -> BadInput:
        wanted = "a campaign that fmu-fit design made"
        return BadInput(f"{self.path}: [design] averaged: is missing, wanted {wanted}")

    def where(self, column: Column) -> str:
        """File and column, which open a complaint.

        Args:
            column: of the table.
        """
        return f"{self.table.path}: column '{column.name}'"

    def numbers(self, name: str, unit: str = "") -> FloatArray:
        """A column in a unit, (n,); as it is without one, or where its header has none.

        Ones where there is no column of an amplitude or of a gain of the drive.

        Args:
            name: of the column.
            unit: that is wanted.

        Raises:
            BadInput: no such column, cells that are no numbers, a unit of another kind.
        """
        column = self.table.find(name)
        if column is None and name in (*(self.file.driven.amplitudes or ()), *GAINS):
            return np.ones(len(self.table.cells))
        column = column or self.table.column(name)
        values = self.table.numbers(column)
        if not unit or not column.unit:
            return values
        where = self.where(column)
        # a cell is rounded once: a factor would move narrow lines
        return np.array([convert(float(v), column.unit, unit, where=where) for v in values])

    def cells(self, name: str, volts: Iterable[float]) -> list[float]:
        """Cells of a column.

        Args:
            name: of a column of amplitudes.
            volts: what was measured, (n,), V.

        Raises:
            BadInput: its unit is of another kind.
        """
        column = self.table.column(name)
        unit, where = column.unit or "V", self.where(column)
        return [convert(float(v), "V", unit, where=where) for v in volts]

    def files(
        self,
        values: Mapping[str, Sequence[float] | FloatArray],
        truth: Mapping[str, Any],
        head: Sequence[str],
        edit: Callable[[Tables], None] = lambda tables: None,
    ) -> dict[str, str | bytes]:
        """Contents by relative file name: the table filled, the campaign marked as synthetic.

        Args:
            values: of columns that waited, by name, in their units, (n,).
            truth: tables of truth.toml.
            head: lines that open every file.
            edit: further changes of the campaign's tables, in place.

        Raises:
            BadInput: the sweep that a plan of tones takes its scale from is not there.
        """

        def marked(tables: Tables) -> None:
            edit(tables)
            tables["synthetic"] = True
            if "synthetic" not in tables.get("title", "synthetic"):
                tables["title"] = f"{tables['title']} (synthetic)"

        columns: dict[str, Sequence[Cell] | FloatArray] = {
            c.name if c.unit is None else f"{c.name} ({c.unit})": values.get(
                c.name, self.table.texts(c)
            )
            for c in self.table.columns
        }
        campaign = rewritten(read_text(self.path), marked, head)
        texts = synthetic_files(campaign, {self.table.path.name: columns}, truth, head)
        sweep = self.file.sweep if self.sweeps is None else None
        if sweep is None:
            return {**texts}
        if not sweep.file.is_file():
            raise BadInput(f"{self.path}: [sweep] file: {sweep.file}: no such file")
        return {**texts, sweep.file.name: sweep.file.read_bytes()}


def _pairs(plan: Plan, bench: Bench, seed: int, head: Sequence[str]) -> Made:
    """Pairs of tones on a bench, each row with its gains, its mode and its number of spectra."""
    plan.refuse_unknown(GAINS, OUTPUTS)
    table, driven = plan.table, plan.file.driven

    tones = zip(*(plan.numbers(name, "Hz").tolist() for name in driven.frequencies), strict=True)
    named = [plan.numbers(name).tolist() for name in driven.amplitudes or ()]
    levels = zip(*named, strict=True) if named else [()] * len(table.cells)
    gains = zip(*(plan.numbers(name).tolist() for name in GAINS), strict=True)
    texts = [table.texts(table.column(name)) for name in ("experiment", "output")]
    rows = [
        Row(
            label=label,
            drive=Drive(pair, level, gains=(gain[0], gain[1])),
            observed=OUTPUTS.index(output),
            averaged=averaged,
        )
        for pair, level, gain, label, output, averaged in zip(
            tones, levels, gains, *texts, plan.averaged, strict=True
        )
    ]
    instrument = Averaged(plan.floor_v, plan.relative, phases=plan.is_complex)
    measured = measure_rows(bench, rows, instrument, seed)
    volts = np.array(
        [
            np.concatenate([reading.arrays[name] for name in instrument.arrays])
            for reading in measured.readings
        ]
    )
    values = {name: plan.cells(name, v) for name, v in zip(plan.filled, volts.T, strict=True)}

    def edit(tables: Tables) -> None:
        """What drifts, as it was measured."""
        ends = zip(DRIFTING, measured.eta_before_hz, measured.eta_after_hz, strict=True)
        for name, before, after in ends:
            if name in tables.get("drift", {}):
                between = {"before": written_mhz(before), "after": written_mhz(after)}
                tables["drift"][name] = inline(between)

    truth = truth_tables(measured)
    return measured, truth, plan.files(values, truth, head, edit)


def _tones(plan: Plan, bench: AvoidedCrossing, seed: int, head: Sequence[str]) -> Made:
    """Tones at values of a control: of every row values in V, in the order of its columns."""
    plan.refuse_unknown(bench.UNITS, (bench.OUTPUT,))
    driven, rng = plan.file.driven, np.random.default_rng([seed, TONES_STREAM])
    reference = np.exp(2j * np.pi * rng.uniform())
    tones = np.stack([plan.numbers(name, "Hz") for name in driven.frequencies], axis=1)
    levels = np.ones(tones.shape)
    if driven.amplitudes:
        levels = np.stack([plan.numbers(name, "1") for name in driven.amplitudes], axis=1)
    controls = {name: plan.numbers(name, unit) for name, unit in bench.UNITS.items()}
    measured = []
    for row, u_hz in enumerate(tones):
        at = {name: float(values[row]) for name, values in controls.items()}
        true_v = levels[row] * bench.swept_at(at, u_hz)
        one, other, *relative = rng.standard_normal((4, true_v.size))
        floor_v = plan.floor_v / math.sqrt(plan.averaged[row])
        factor = 1.0 + plan.relative * (relative[0] + 1j * relative[1])
        observed = (true_v + floor_v * (one + 1j * other)) * factor
        rotated = observed * reference
        parts = [rotated.real, rotated.imag] if plan.is_complex else [np.abs(observed)]
        sigmas = np.hypot(floor_v, plan.relative * np.abs(observed))
        measured.append(np.concatenate([*parts, sigmas]))
    rows = zip(*measured, strict=True)
    values = {name: plan.cells(name, volts) for name, volts in zip(plan.filled, rows, strict=False)}
    truth = replace(bench, phases=plan.is_complex).truth(seed)
    return tuple(measured), truth, plan.files(values, truth, head)


@dataclass(frozen=True)
class PlannedSweep:
    """Rows (n,) of the plan's table at one place of its controls, `at`, and what was read there.

    `u_hz` (n,) are their frequencies, `columns` (n,) the values in V, `true_v` (n,) is behind them.
    """

    at: Mapping[str, float]
    rows: Sequence[int]
    u_hz: FloatArray
    columns: tuple[FloatArray, ...]
    true_v: ComplexArray


def _sweeps(
    plan: Plan, swept: SweptTable, bench: SweptBench, seed: int, head: Sequence[str]
) -> Made:
    """Whole sweeps, one for each place of the controls in the order of the file."""
    table, file = plan.table, plan.file
    _refuse_swept(plan.path, swept, bench, swept.output or file.observe.output)
    filled = ("X", "Y") if plan.is_complex else ("amplitude",)
    settings = []
    for name, unit in bench.UNITS.items():
        if name in swept.controls and table.find(name) is not None:
            settings.append(plan.numbers(name, unit))
        elif name in file.constants:
            settings.append(np.full(len(table.cells), in_unit(file.constants[name], unit)))
        else:
            raise BadInput(
                f"{plan.path}: '{name}' is neither a control nor a constant of the plan; the "
                "virtual laboratory does not know where to set it"
            )
    frequency = plan.numbers("frequency", "Hz")
    places: dict[tuple[float, ...], list[int]] = {}
    for row, place in enumerate(zip(*settings, strict=True)):
        places.setdefault(tuple(map(float, place)), []).append(row)
    rng, measured = np.random.default_rng([seed, SWEEPS_STREAM]), []
    rms = isinstance(swept, ControlSweepTable) and swept.detector.kind == "rms"
    volts = {name: np.empty(len(table.cells)) for name in filled}
    for place, rows in places.items():
        at, u_hz = dict(zip(bench.UNITS, place, strict=True)), frequency[rows]
        true_v = bench.swept_at(at, u_hz)
        one, other = rng.standard_normal((2, true_v.size))
        noise = np.hypot(plan.floor_v, plan.relative * np.abs(true_v)) * (one + 1j * other)
        if plan.is_complex:
            observed = bench.turned(true_v, u_hz, rng) + noise
            columns: tuple[FloatArray, ...] = (observed.real, observed.imag)
        else:
            columns = ((math.sqrt(0.5) if rms else 1.0) * np.abs(true_v + noise),)
        measured.append(PlannedSweep(at, rows, u_hz, columns, true_v))
        for name, column in zip(filled, columns, strict=True):
            volts[name][rows] = column

    def edit(tables: Tables) -> None:
        """The noise that it was measured with."""
        written = tables[type(swept).TABLE]
        if "sigma" in written or "relative" in written:
            written["sigma"] = f"{plan.floor_v!r} V"
            if not plan.is_complex:
                written["relative"] = plan.relative

    if isinstance(bench, AvoidedCrossing):
        bench = replace(bench, phases=plan.is_complex)
    truth = bench.truth(seed)
    values = {name: plan.cells(name, column) for name, column in volts.items()}
    return tuple(measured), truth, plan.files(values, truth, head, edit)


def _refuse_swept(path: Path, swept: SweptTable, bench: SweptBench, output: str) -> None:
    """Refuse sweeps of what the laboratory does not set, observe or record."""
    for name in swept.controls:
        if name not in bench.UNITS:
            raise BadInput(
                f"{path}: controls: the virtual laboratory cannot set '{name}', wanted "
                f"{listed(bench.UNITS)}"
            )
    if output != bench.OUTPUT:
        raise BadInput(
            f"{path}: the virtual laboratory does not observe '{output}', wanted '{bench.OUTPUT}'"
        )
    if isinstance(swept, ComplexControlSweepTable):
        if swept.scale == "shared" and not swept.restarted:
            raise BadInput(
                f'{path}: scale = "shared": the virtual laboratory begins every sweep with another '
                'phase, wanted scale = "own", or restarted = true with it'
            )
    elif swept.drive is not None or swept.lines is not None:
        raise BadInput(
            f"{path}: the virtual laboratory drives with one amplitude and one tone at a time, "
            "wanted neither drive nor lines"
        )
    elif swept.detector.kind not in ("peak", "rms"):
        raise BadInput(
            f'{path}: amplitude = "{swept.amplitude}": the virtual laboratory reads volts, wanted '
            '"V peak" or "V rms"'
        )


def moved(text: str, source: Path, folder: Path, written: Collection[str]) -> str:
    """A campaign's text whose paths lead from another folder to where they led.

    What is written next to it is named by its own name; every other file, as the FMU, stays where
    it is.

    Args:
        text: of the campaign.
        source: folder that its paths are seen from.
        folder: that it will be in.
        written: names of the files that are written next to it.
    """

    def edit(tables: Tables) -> None:
        for name, table in tables.items():
            for one in table if isinstance(table, list) else [table]:
                value = one.get("file") if isinstance(one, MutableMapping) else None
                if not isinstance(value, str):
                    continue
                nearby = name != "fmu" and Path(value).name in written
                there = Path(value).name if nearby else path_from(folder, source / value)
                if there != value:
                    one["file"] = there

    plain = tomllib.loads(text)
    edit(plain)
    return text if plain == tomllib.loads(text) else rewritten(text, edit)
