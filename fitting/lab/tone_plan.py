"""Planned tones at values of a control -> the same campaign measured by a virtual laboratory.

A line of a spectrum is the closed form S at its tone, times the drive's amplitude. Averaged over n
spectra, with complex noise of the floor and r of the relative noise, each drawn anew,

    X + i Y = (S + floor n/sqrt(averaged)) (1 + r) e^(i reference),    or its magnitude
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fitting.extension.records import KINDS, read_campaign_file
from fitting.lab.filled import FilledTable, mark_synthetic, numbers_in, of_volts, sweep_beside
from fitting.lab.names import TRUTH_NAME
from fitting.lab.sweep_plan import SweptBench, bench_truth
from fitting.lab.truth import REMARK
from fitting.lab.writer import CAMPAIGN_NAME, head_lines
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import listed
from fitting.text.tables import Table, read_table, read_text
from fitting.text.toml import Tables, rewritten, toml_text
from fitting.text.written import positive_in

#: Of the noise of planned tones, apart from that of sweeps.
STREAM = 5


class TonePlan:
    """A campaign whose peaks at values of a control wait, as the virtual laboratory understands it.

    Rows, drives and controls are those of its experiments file, the noise is its table [design].

    Raises:
        BadInput: no plan of this kind, or one that asks of the laboratory what it cannot do.
    """

    def __init__(self, path: Path, bench: SweptBench) -> None:
        file = read_campaign_file(path, KINDS)
        design, experiments = file.design, file.experiments
        if design.averaged is None or experiments is None:
            raise BadInput(
                f"{path}: [design] averaged: is missing, wanted a campaign that fmu-fit design made"
            )
        self.path, self._bench, self._sweep = path, bench, file.sweep
        self._table: Table = read_table(experiments.file)
        self._frequencies = file.driven.frequencies
        self._amplitudes = file.driven.amplitudes or ()
        self._filled, self._phases = experiments.data_columns, experiments.is_complex
        self._averaged = design.averaged
        self._floor_v = positive_in(design.noise_floor, "V") if design.noise_floor else 0.0
        self._relative = design.relative_noise or 0.0
        self._refuse_unknown()

    def _refuse_unknown(self) -> None:
        """Complain of what the laboratory does not set or see."""
        settable = (*self._frequencies, *self._amplitudes, *self._bench.UNITS)
        for column in self._table.columns:
            if column.name not in {"experiment", "output", *settable, *self._filled}:
                raise BadInput(
                    f"{self._table.path}: column '{column.name}': the virtual laboratory cannot "
                    f"set it, wanted {listed(settable)}"
                )
        for name in self._table.texts(self._table.column("output")):
            if name != self._bench.OUTPUT:
                raise BadInput(
                    f"{self._table.path}: column 'output': the virtual laboratory does not observe "
                    f"'{name}', wanted '{self._bench.OUTPUT}'"
                )
        if len(self._averaged) != len(self._table.cells):
            raise BadInput(
                f"{self.path}: [design] averaged: found {len(self._averaged)} numbers, wanted "
                f"{len(self._table.cells)}, one for every row of {self._table.path}"
            )

    def _numbers(self, name: str, unit: str) -> FloatArray:
        """A column in a unit; ones where there is no column of an amplitude."""
        column = self._table.find(name)
        if column is None and name in self._amplitudes:
            return np.ones(len(self._table.cells))
        return numbers_in(self._table, column or self._table.column(name), unit)

    def measure(self, seed: int) -> tuple[FloatArray, ...]:
        """Values in V of every row, in the order of its columns; the same seed gives the same ones.

        Args:
            seed: of the noise and of the reference phase.
        """
        rng = np.random.default_rng([seed, STREAM])
        reference = np.exp(2j * np.pi * rng.uniform())
        tones = np.stack([self._numbers(name, "Hz") for name in self._frequencies], axis=1)
        ones = [np.ones(len(tones))] * len(self._frequencies)
        levels = [self._numbers(name, "1") for name in self._amplitudes] or ones
        units = self._bench.UNITS
        controls = {name: self._numbers(name, unit) for name, unit in units.items()}
        result = []
        for row, u_hz in enumerate(tones):
            at = {name: float(values[row]) for name, values in controls.items()}
            level = np.array([each[row] for each in levels])
            true_v = level * self._bench.swept_at(at, u_hz)
            observed = self._noisy(true_v, self._averaged[row], rng)
            rotated = observed * reference
            parts = [rotated.real, rotated.imag] if self._phases else [np.abs(observed)]
            floor_v = self._floor_v / math.sqrt(self._averaged[row])
            sigmas = np.hypot(floor_v, self._relative * np.abs(observed))
            result.append(np.concatenate([*parts, sigmas]))
        return tuple(result)

    def _noisy(self, true_v: ComplexArray, averaged: int, rng: np.random.Generator) -> ComplexArray:
        one, other, *relative = rng.standard_normal((4, true_v.size))
        floor_v = self._floor_v / math.sqrt(averaged)
        factor = 1.0 + self._relative * (relative[0] + 1j * relative[1])
        return np.asarray((true_v + floor_v * (one + 1j * other)) * factor)

    def files(
        self, measured: Sequence[FloatArray], seed: int, command: str
    ) -> tuple[dict[str, Any], dict[str, str | bytes]]:
        """The truth, and contents by relative file name.

        Args:
            measured: what the laboratory measured.
            seed: of the noise.
            command: command line that made it, for the record.
        """
        head = head_lines(seed, command)
        truth = bench_truth(self._bench, seed, phases=self._phases)
        return truth, {
            CAMPAIGN_NAME: self._campaign(head),
            self._table.path.name: self._experiments(measured, head),
            TRUTH_NAME: toml_text(truth, [*head, REMARK]),
            **sweep_beside(self.path, self._sweep),
        }

    def _experiments(self, measured: Sequence[FloatArray], head: Sequence[str]) -> str:
        filled = FilledTable(self._table)
        for k, name in enumerate(self._filled):
            column = self._table.column(name)
            factor = of_volts(self._table, column)
            for row, reading in enumerate(measured):
                filled.put(column, row, float(reading[k]) * factor)
        return filled.text(head)

    def _campaign(self, head: Sequence[str]) -> str:
        """The plan's text, marked as synthetic."""

        def edit(tables: Tables) -> None:
            mark_synthetic(tables)

        return rewritten(read_text(self.path), edit, head)
