"""A planned campaign -> the same campaign measured by the virtual laboratory, as texts by name."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fitting.campaign.section import Section
from fitting.lab.planned import Noise, Planned, PlannedSeries, measure_planned
from fitting.lab.string import Bench
from fitting.lab.synthesis import CAMPAIGN_NAME, OUTPUTS, TRUTH_NAME
from fitting.text.errors import BadInput
from fitting.text.tables import Column, Table, read_table, read_text
from fitting.text.toml import read_toml
from fitting.text.units import convert, parse_quantity

#: Drift that the bench knows, in the order of its eigenfrequencies.
DRIFTING = ("eta_plus", "eta_minus")
#: Columns of a plan that the bench can set beside drive frequencies and amplitudes.
GAINS = ("g1", "g2")


def planned_files(plan: Path, bench: Bench, seed: int, command: str) -> dict[str, str | bytes]:
    """Measure the campaign of a plan on a bench: contents by relative file name.

    Drives, outputs, settings and averaged spectra are the rows of its experiments file, the noise
    of a peak is its table [design].

    Raises:
        BadInput: no plan of this kind, or one that asks of the bench what it cannot do.
    """
    top = Section(plan, "", read_toml(plan))
    design = top.sub("design")
    if "averaged" not in design:
        raise BadInput(
            f"{design.where('averaged')}: is missing, wanted a campaign that fmu-fit design made"
        )
    rows = _Rows(top)
    floor = _volts(design, "noise_floor") if "noise_floor" in design else 0.0
    noise = Noise(floor, design.number("relative_noise", 0.0))
    series = measure_planned(bench, rows.planned(design.required("averaged")), noise, seed)
    mark = (
        f"# synthetic data of a virtual laboratory, not measured; seed {seed}\n# made by: {command}"
    )
    files: dict[str, str | bytes] = {
        CAMPAIGN_NAME: _campaign(read_text(plan), series, mark),
        rows.table.path.name: rows.filled(series, mark),
        TRUTH_NAME: _truth(series, mark),
    }
    sweep = top.sub("sweep")
    if "file" in sweep:
        source = plan.parent / sweep.text("file")
        if not source.is_file():
            raise BadInput(f"{sweep.where('file')}: {source}: no such file")
        files[source.name] = source.read_bytes()
    return files


class _Rows:
    """The experiments file of a plan, as the bench understands it."""

    def __init__(self, top: Section) -> None:
        self.drive = top.sub("drive")
        self.experiments = top.sub("experiments")
        self.table: Table = read_table(top.path.parent / self.experiments.text("file"))
        self.frequencies = self.drive.texts("frequencies")
        self.amplitudes = self.drive.texts("amplitudes")
        self.peaks = self.experiments.texts("peaks")
        self.sigmas = self.experiments.texts("peak_sigmas")
        known = {
            "experiment",
            "output",
            *self.frequencies,
            *self.amplitudes,
            *self.peaks,
            *self.sigmas,
            *GAINS,
        }
        for column in self.table.columns:
            if column.name not in known:
                raise BadInput(
                    f"{self.table.path}: column '{column.name}': the virtual laboratory cannot set "
                    f"it, wanted {', '.join((*self.frequencies, *self.amplitudes, *GAINS))}"
                )

    def planned(self, averaged: Any) -> tuple[Planned, ...]:
        """The rows as measurements; ``averaged`` as the file has it, a number per row."""
        labels = self.table.texts(self.table.column("experiment"))
        good = isinstance(averaged, list) and len(averaged) == len(labels)
        if not good or not all(type(n) is int and n >= 1 for n in averaged):
            raise BadInput(
                f"[design] averaged: found {averaged!r}, wanted {len(labels)} whole numbers, a "
                f"number of spectra for every row of {self.table.path}"
            )
        rows = []
        for i, label in enumerate(labels):
            tones = tuple(self._number(name, i, "Hz") for name in self.frequencies)
            amplitudes = tuple(self._number(name, i) for name in self.amplitudes)
            gains = (self._number(GAINS[0], i), self._number(GAINS[1], i))
            rows.append(Planned(label, tones, amplitudes, self._mode(i), averaged[i], gains))
        return tuple(rows)

    def _number(self, name: str, row: int, unit: str | None = None) -> float:
        """A cell as a number, in ``unit`` if its header has one; 1 without such a column."""
        column = self.table.find(name)
        if column is None and unit is None:
            return 1.0
        column = column or self.table.column(name)
        value = float(self.table.numbers(column)[row])
        where = f"{self.table.path}: column '{name}'"
        return convert(value, column.unit, unit, where=where) if unit and column.unit else value

    def _mode(self, row: int) -> int:
        column = self.table.column("output")
        output = self.table.texts(column)[row]
        if output not in OUTPUTS:
            raise BadInput(
                f"{self.table.path}: row {self.table.lines[row]}, column 'output': the virtual "
                f"laboratory does not observe '{output}', wanted {' or '.join(OUTPUTS)}"
            )
        return OUTPUTS.index(output)

    def filled(self, series: PlannedSeries, mark: str) -> str:
        """The file's text with peaks and their standard deviations."""
        columns = [self.table.column(name) for name in (*self.peaks, *self.sigmas)]
        lines = [mark, ",".join(_head(column) for column in self.table.columns)]
        for i, row in enumerate(self.table.cells):
            cells = list(row)
            volts = (*series.peaks_v[i], *series.sigmas_v[i])
            for column, value in zip(columns, volts, strict=True):
                cells[column.index] = repr(_in_unit(float(value), column, self.table.path))
            lines.append(",".join(cells))
        return "\n".join(lines) + "\n"


def _head(column: Column) -> str:
    return column.name if column.unit is None else f"{column.name} ({column.unit})"


def _in_unit(volts: float, column: Column, path: Path) -> float:
    return convert(volts, "V", column.unit or "V", where=f"{path}: column '{column.name}'")


def _volts(design: Section, key: str) -> float:
    number, unit = parse_quantity(design.text(key), where=design.where(key))
    return convert(number, unit or "V", "V", where=design.where(key))


def _campaign(text: str, series: PlannedSeries, mark: str) -> str:
    """The plan's text, with what drifts as it was measured, and marked as synthetic."""
    kept = text.splitlines()
    while kept and kept[0].startswith("#"):
        kept.pop(0)
    ends: Mapping[str, tuple[float, float]] = dict(
        zip(DRIFTING, zip(series.eta_before_hz, series.eta_after_hz, strict=True), strict=True)
    )
    for i, line in enumerate(kept):
        match = re.match(r"(eta_plus|eta_minus)(\s*=\s*)\{\s*before", line)
        if match:
            before, after = (f"{f / 1e6!r} MHz" for f in ends[match[1]])
            kept[i] = f'{match[1]}{match[2]}{{ before = "{before}", after = "{after}" }}'
        elif line.startswith("synthetic"):
            kept[i] = "synthetic = true"
        elif line.startswith("title") and "synthetic" not in line:
            kept[i] = re.sub(r'"\s*$', ' (synthetic)"', line)
    return "\n".join([mark, *kept]) + "\n"


def _truth(series: PlannedSeries, mark: str) -> str:
    lines = [mark, "# The truth behind this campaign. No reader of a fit opens this file.", ""]
    values = dataclasses.asdict(series.bench)
    modes = values.pop("modes")
    lines += ["[bench]", *_lines(values), "", "[modes]", *_lines(modes)]
    lines += ["", "[outcome]", f"seed = {series.seed}"]
    rows = zip(series.planned, series.true_modes, series.true_peaks_v, strict=True)
    for planned, state, peaks in rows:
        lines += ["", "[[experiment]]"]
        lines += _lines({"label": planned.label, "eta_plus_hz": state.eta_plus_hz})
        lines += _lines({"eta_minus_hz": state.eta_minus_hz, "peaks_v": peaks.tolist()})
    return "\n".join(lines) + "\n"


def _lines(values: Mapping[str, Any]) -> list[str]:
    """Lines of a TOML table; JSON's numbers, texts, lists and Booleans are TOML's."""
    return [f"{name} = {json.dumps(value)}" for name, value in values.items()]
