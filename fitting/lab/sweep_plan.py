"""Planned sweeps -> the same campaign measured by a virtual laboratory, as texts by name.

At every place of the controls the laboratory answers with the closed form S(u), noise n of

    sigma^2 = noise_floor^2 + (relative_noise |S|)^2

on each quadrature: X + i Y = e^(i phase) e^(-i 2 pi (u - u0) tau) S + n, or its magnitude |S + n|.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fitting.extension.records import KINDS, WrittenCampaign, WrittenDesign, read_campaign_file
from fitting.lab.curves import CURVE, AvoidedCrossing, changed_curve, curve_of
from fitting.lab.filled import FilledTable, mark_synthetic, numbers_in, of_volts
from fitting.lab.names import CROSSING, PUMPED, SUBHARMONIC, TRUTH_NAME
from fitting.lab.pumped import PumpedString
from fitting.lab.pumped_files import (
    PUMPED_BENCHES,
    changed_pumped,
    pumped_bench_of,
    pumped_truth,
)
from fitting.lab.truth import REMARK
from fitting.lab.writer import CAMPAIGN_NAME, head_lines
from fitting.measurements.complex.table import ComplexControlSweepTable
from fitting.measurements.control.table import ControlSweepTable
from fitting.signal.amplitudes import Amplitude, declared_amplitude
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import listed
from fitting.text.tables import Column, Table, read_table, read_text
from fitting.text.toml import Tables, read_toml, rewritten, toml_text
from fitting.text.written import Written, in_unit, positive_in

#: Of the noise of planned sweeps, apart from that of the campaign which they continue.
STREAM = 4
SweptTable = ControlSweepTable | ComplexControlSweepTable
#: Values of the controls, the rows (n,) of the plan's table there, and their frequencies (n,), Hz.
Place = tuple[Mapping[str, float], Sequence[int], FloatArray]


#: A bench that sweeps one line at places of its controls.
SweptBench = AvoidedCrossing | PumpedString


def changed_bench(bench: SweptBench, values: Mapping[str, Any]) -> SweptBench:
    """The same with other numbers of its own.

    Args:
        bench: that is swept.
        values: by the names of its fields.

    Raises:
        ValueError: values that are impossible.
        BadInput: a name that this bench does not have.
    """
    if isinstance(bench, AvoidedCrossing):
        return changed_curve(bench, CROSSING, values)
    return changed_pumped(bench, **values)


def bench_truth(bench: SweptBench, seed: int, *, phases: bool) -> dict[str, Any]:
    """Tables of truth.toml.

    Args:
        bench: that is swept.
        seed: of the noise.
        phases: quadratures are recorded.
    """
    if isinstance(bench, AvoidedCrossing):
        return replace(bench, phases=phases).truth(seed)
    return pumped_truth(bench, seed)


def swept_bench(truth: object) -> SweptBench:
    """The bench of a truth: itself, its name, or its truth file or a campaign next to that.

    Args:
        truth: of which sweeps are asked.

    Raises:
        BadInput: no such laboratory, or one that makes no sweeps over a control.
    """
    if isinstance(truth, SweptBench):
        return truth
    named: Mapping[str, Callable[[], SweptBench]] = {CROSSING: AvoidedCrossing, **PUMPED_BENCHES}
    if isinstance(truth, str) and truth in named:
        return named[truth]()
    if isinstance(truth, str | Path) and Path(truth).suffix == ".toml":
        path = Path(truth)
        file = path if path.name == TRUTH_NAME else path.parent / TRUTH_NAME
        tables = read_toml(file)
        bench = pumped_bench_of(tables, file)
        if bench is not None:
            return bench
        curve = curve_of(tables, file)
        if isinstance(curve, AvoidedCrossing):
            return curve
        truth = file
    raise BadInput(
        f"{truth}: is no laboratory of sweeps over a control; wanted one of "
        f"{CROSSING!r}, {PUMPED!r} or {SUBHARMONIC!r}"
    )


def is_crossing(truth: object) -> bool:
    """Whether a truth is that of an avoided crossing: its bench, its name, or its file.

    Args:
        truth: as `swept_bench` takes it.
    """
    if isinstance(truth, str | Path) and Path(truth).suffix == ".toml":
        path = Path(truth)
        tables = read_toml(path if path.name == TRUTH_NAME else path.parent / TRUTH_NAME)
        return bool(tables.get(CURVE, {}).get("kind") == CROSSING)
    return isinstance(truth, AvoidedCrossing) or truth == CROSSING


def is_of_sweeps(path: Path) -> bool:
    """Whether a planned campaign wants sweeps to be measured, not tones.

    Args:
        path: of the campaign.

    Raises:
        BadInput: no campaign, or one of recordings over time, which no laboratory follows.
    """
    file = read_campaign_file(path, KINDS)
    if file.design.traces is not None:
        raise BadInput(
            f"{path}: proposes recordings over time, which are not measured by --plan; wanted "
            "another trace of the laboratory, as by synthesize_curves('ringdown', length_s=0.6)"
        )
    return _table_of(file) is not None


def _table_of(file: WrittenCampaign) -> SweptTable | None:
    """The table of sweeps that are proposed; as a design continues them, amplitudes come first."""
    if file.design.sweeps is None:
        return None
    for name in (ControlSweepTable.TABLE, ComplexControlSweepTable.TABLE):
        for table in file.further.get(name, ()):
            if isinstance(table, SweptTable):
                return table
    return None


@dataclass(frozen=True)
class PlannedSweep:
    """Rows (n,) of the plan's table at one place of its controls, `at`, and what was read there.

    `u_hz` (n,) are their frequencies, `columns` (n,) the values in the plan's units, `true_v` (n,)
    is behind them.
    """

    at: Mapping[str, float]
    rows: Sequence[int]
    u_hz: FloatArray
    columns: tuple[FloatArray, ...]
    true_v: ComplexArray


class SweepPlan:
    """A campaign whose sweeps wait for their values, as the virtual laboratory understands it.

    Places and frequencies are the rows of its file, the noise of a point is its table [design].

    Raises:
        BadInput: no plan of this kind, or one that asks of the laboratory what it cannot do.
    """

    def __init__(self, path: Path, bench: SweptBench) -> None:
        file = read_campaign_file(path, KINDS)
        table = _table_of(file)
        if table is None:
            raise BadInput(f"{path}: [design] sweeps: is missing, wanted a plan of sweeps")
        self.path, self._bench, self._swept = path, bench, table
        self._table: Table = read_table(table.file)
        self.phases = isinstance(table, ComplexControlSweepTable)
        self._amplitude = Amplitude("peak", "V")
        if isinstance(table, ControlSweepTable):
            self._amplitude = declared_amplitude(table.amplitude, table.impedance, str(path))
        self._refuse_unknown(table.output or file.observe.output)
        heads = ("X", "Y") if self.phases else ("amplitude",)
        self._filled: list[Column] = [self._table.column(name) for name in heads]
        self._noise = _noise_v(file.design)
        self.places = self._places(file.constants)

    def _refuse_unknown(self, output: str) -> None:
        """Complain of what the laboratory does not set, see or record."""
        swept, bench = self._swept, self._bench
        for name in swept.controls:
            if name not in bench.UNITS:
                raise BadInput(
                    f"{self.path}: controls: the virtual laboratory cannot set '{name}', wanted "
                    f"{listed(bench.UNITS)}"
                )
        if output != bench.OUTPUT:
            raise BadInput(
                f"{self.path}: the virtual laboratory does not observe '{output}', wanted "
                f"'{bench.OUTPUT}'"
            )
        if isinstance(swept, ComplexControlSweepTable):
            if swept.scale == "shared" and not swept.restarted:
                raise BadInput(
                    f'{self.path}: scale = "shared": the virtual laboratory begins every sweep '
                    'with another phase, wanted scale = "own", or restarted = true with it'
                )
            return
        if swept.drive is not None or swept.lines is not None:
            raise BadInput(
                f"{self.path}: the virtual laboratory drives with one amplitude and one tone at a "
                "time, wanted neither drive nor lines"
            )
        if self._amplitude.kind not in ("peak", "rms"):
            raise BadInput(
                f'{self.path}: amplitude = "{swept.amplitude}": the virtual laboratory reads '
                'volts, wanted "V peak" or "V rms"'
            )

    def _places(self, constants: Mapping[str, Written]) -> tuple[Place, ...]:
        """Places in the order of the file."""
        table, count = self._table, len(self._table.cells)
        values = []
        for name, unit in self._bench.UNITS.items():
            column = table.find(name) if name in self._swept.controls else None
            if column is not None:
                values.append(numbers_in(table, column, unit))
            elif name in constants:
                values.append(np.full(count, in_unit(constants[name], unit)))
            else:
                raise BadInput(
                    f"{self.path}: '{name}' is neither a control nor a constant of the plan; the "
                    "virtual laboratory does not know where to set it"
                )
        frequency = numbers_in(table, table.column("frequency"), "Hz")
        result: dict[tuple[float, ...], list[int]] = {}
        for row, at in enumerate(zip(*values, strict=True)):
            result.setdefault(tuple(map(float, at)), []).append(row)
        names = tuple(self._bench.UNITS)
        return tuple(
            (dict(zip(names, at, strict=True)), rows, frequency[rows])
            for at, rows in result.items()
        )

    def measure(self, seed: int) -> tuple[PlannedSweep, ...]:
        """Measure every sweep; the same seed gives the same numbers.

        Args:
            seed: of the noise and of the phases.

        Raises:
            ValueError: a place at which the sample has no steady state.
        """
        rng = np.random.default_rng([seed, STREAM])
        return tuple(self._measured(*place, rng) for place in self.places)

    def _measured(
        self,
        at: Mapping[str, float],
        rows: Sequence[int],
        u_hz: FloatArray,
        rng: np.random.Generator,
    ) -> PlannedSweep:
        true_v = self._bench.swept_at(at, u_hz)
        floor_v, relative = self._noise
        one, other = rng.standard_normal((2, true_v.size))
        noise = np.hypot(floor_v, relative * np.abs(true_v)) * (one + 1j * other)
        if self.phases:
            observed = self._bench.turned(true_v, u_hz, rng) + noise
            return PlannedSweep(at, rows, u_hz, (observed.real, observed.imag), true_v)
        rms = math.sqrt(0.5) if self._amplitude.kind == "rms" else 1.0
        return PlannedSweep(at, rows, u_hz, (rms * np.abs(true_v + noise),), true_v)

    def files(
        self, measured: Sequence[PlannedSweep], seed: int, command: str
    ) -> tuple[dict[str, Any], dict[str, str | bytes]]:
        """The truth, and contents by relative file name.

        Args:
            measured: what the laboratory measured.
            seed: of the noise.
            command: command line that made it, for the record.
        """
        head = head_lines(seed, command)
        truth = bench_truth(self._bench, seed, phases=self.phases)
        return truth, {
            CAMPAIGN_NAME: self._campaign(head),
            self._table.path.name: self._sweeps(measured, head),
            TRUTH_NAME: toml_text(truth, [*head, REMARK]),
        }

    def _sweeps(self, measured: Sequence[PlannedSweep], head: Sequence[str]) -> str:
        filled = FilledTable(self._table)
        for k, column in enumerate(self._filled):
            factor = of_volts(self._table, column)
            for sweep in measured:
                for row, value in zip(sweep.rows, sweep.columns[k], strict=True):
                    filled.put(column, row, float(value) * factor)
        return filled.text(head)

    def _campaign(self, head: Sequence[str]) -> str:
        """The plan's text, marked as synthetic, with the noise that it was measured with."""
        floor_v, relative = self._noise

        def edit(tables: Tables) -> None:
            table = tables[type(self._swept).TABLE]
            if "sigma" in table or "relative" in table:
                table["sigma"] = f"{floor_v!r} V"
                if not self.phases:
                    table["relative"] = relative
            mark_synthetic(tables)

        return rewritten(read_text(self.path), edit, head)


def _noise_v(design: WrittenDesign) -> tuple[float, float]:
    floor = positive_in(design.noise_floor, "V") if design.noise_floor else 0.0
    return floor, design.relative_noise or 0.0
