"""A planned campaign -> the same campaign measured by the virtual laboratory, as texts by name."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fitting.extension.records import KINDS, read_campaign_file
from fitting.lab.bench import DRIFTING, OUTPUTS, Bench, Measured, Row, measure_rows
from fitting.lab.drive import Drive
from fitting.lab.filled import FilledTable, mark_synthetic, sweep_beside
from fitting.lab.instruments.averaged import Averaged
from fitting.lab.names import TRUTH_NAME
from fitting.lab.truth import truth_toml
from fitting.lab.writer import CAMPAIGN_NAME, head_of, written_mhz
from fitting.text.errors import BadInput
from fitting.text.tables import Table, read_table, read_text
from fitting.text.toml import Tables, inline, rewritten
from fitting.text.units import convert
from fitting.text.written import positive_in

#: Columns of a plan that the bench can set beside drive frequencies and amplitudes.
GAINS = ("g1", "g2")


class Plan:
    """A campaign that waits for its peaks, as the virtual laboratory understands it.

    Drives, outputs, settings and averaged spectra are the rows of its experiments file, the noise
    of a peak is its table [design].

    Raises:
        BadInput: no plan of this kind, or one that asks of the bench what it cannot do.
    """

    def __init__(self, path: Path) -> None:
        file = read_campaign_file(path, KINDS)
        design, experiments = file.design, file.experiments
        if design.averaged is None or experiments is None:
            raise BadInput(
                f"{path}: [design] averaged: is missing, wanted a campaign that fmu-fit design made"
            )
        self.path, self._sweep = path, file.sweep
        self._table: Table = read_table(experiments.file)
        self._frequencies = file.driven.frequencies
        self._amplitudes = file.driven.amplitudes or ()
        self._filled = experiments.data_columns
        self._refuse_unknown()
        self.rows = self._rows(design.averaged)
        floor_v = positive_in(design.noise_floor, "V") if design.noise_floor else 0.0
        phases = experiments.is_complex
        self.instrument = Averaged(floor_v, design.relative_noise or 0.0, phases=phases)

    def measure(self, bench: Bench, seed: int) -> Measured:
        """Measure its rows on a bench.

        Args:
            bench: the laboratory: sample, drives, instrument, noise.
            seed: of the random numbers.
        """
        return measure_rows(bench, self.rows, self.instrument, seed)

    def files(self, measured: Measured, command: str) -> dict[str, str | bytes]:
        """Contents by relative file name.

        Args:
            measured: what the laboratory measured.
            command: command line that made it, for the record.
        """
        head = head_of(measured, command)
        return {
            CAMPAIGN_NAME: self._campaign(measured, head),
            self._table.path.name: self._experiments(measured, head),
            TRUTH_NAME: truth_toml(measured, head),
            **sweep_beside(self.path, self._sweep),
        }

    def _refuse_unknown(self) -> None:
        settable = (*self._frequencies, *self._amplitudes, *GAINS)
        for column in self._table.columns:
            if column.name not in {"experiment", "output", *settable, *self._filled}:
                raise BadInput(
                    f"{self._table.path}: column '{column.name}': the virtual laboratory cannot "
                    f"set it, wanted {', '.join(settable)}"
                )

    def _rows(self, averaged: Sequence[int]) -> tuple[Row, ...]:
        """The rows as measurements, each with its number of averaged spectra."""
        labels = self._table.texts(self._table.column("experiment"))
        if len(averaged) != len(labels):
            raise BadInput(
                f"{self.path}: [design] averaged: found {list(averaged)!r}, wanted {len(labels)} "
                f"whole numbers, a number of spectra for every row of {self._table.path}"
            )
        return tuple(
            Row(
                label=label,
                drive=Drive(
                    tuple(self._number(name, i, "Hz") for name in self._frequencies),
                    tuple(self._number(name, i) for name in self._amplitudes),
                    gains=(self._number(GAINS[0], i), self._number(GAINS[1], i)),
                ),
                observed=self._observed(i),
                averaged=averaged[i],
            )
            for i, label in enumerate(labels)
        )

    def _number(self, name: str, row: int, unit: str | None = None) -> float:
        """A cell as a number, in ``unit`` if its header has one; 1 without such a column."""
        column = self._table.find(name)
        if column is None and unit is None:
            return 1.0
        column = column or self._table.column(name)
        value = float(self._table.numbers(column)[row])
        where = f"{self._table.path}: column '{name}'"
        return convert(value, column.unit, unit, where=where) if unit and column.unit else value

    def _observed(self, row: int) -> int:
        column = self._table.column("output")
        output = self._table.texts(column)[row]
        if output not in OUTPUTS:
            raise BadInput(
                f"{self._table.path}: row {self._table.lines[row]}, column 'output': the virtual "
                f"laboratory does not observe '{output}', wanted {' or '.join(OUTPUTS)}"
            )
        return OUTPUTS.index(output)

    def _experiments(self, measured: Measured, head: Sequence[str]) -> str:
        """The file's text with peaks and their standard deviations."""
        filled = FilledTable(self._table)
        for row, reading in enumerate(measured.readings):
            volts = np.concatenate([reading.arrays[name] for name in self.instrument.arrays])
            for name, value in zip(self._filled, volts, strict=True):
                column = self._table.column(name)
                where = f"{self._table.path}: column '{name}'"
                number = convert(float(value), "V", column.unit or "V", where=where)
                filled.put(column, row, number)
        return filled.text(head)

    def _campaign(self, measured: Measured, head: Sequence[str]) -> str:
        """The plan's text, with what drifts as it was measured, and marked as synthetic."""
        ends = zip(DRIFTING, measured.eta_before_hz, measured.eta_after_hz, strict=True)
        drift = {
            name: {"before": written_mhz(before), "after": written_mhz(after)}
            for name, before, after in ends
        }

        def edit(tables: Tables) -> None:
            for name in DRIFTING:
                if name in tables.get("drift", {}):
                    tables["drift"][name] = inline(drift[name])
            mark_synthetic(tables)

        return rewritten(read_text(self.path), edit, head)
