"""The result of a reconstruction as records; `result.json` and `history.csv` from and to them.

Ending badly is a value: `status` and `message` are stored like any number. All numbers are in the
units that are next to them; `nan` (JSON null) where there is none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from fitting.fit.alternative import AlternativeResult
from fitting.fit.path import HistoryRow
from fitting.inference.likelihood.knowledge import ExternalTest, Inferred
from fitting.inference.sweeps import SweepLine
from fitting.result.schema import SCHEMA, upgraded
from fitting.simulate.budget import PlanRecord
from fitting.text.arrays import Scalar
from fitting.text.estimate import Floats
from fitting.text.records import read_json, write_json
from fitting.text.results_folder import write_whole
from fitting.text.tables import csv_text


@dataclass(frozen=True, kw_only=True)
class Peak:
    """One peak: measured and simulated (scaled) amplitudes, before and after, V peak."""

    experiment: str
    frequency_hz: float
    measured_v: float
    sigma_v: float
    initial_v: float
    final_v: float


@dataclass(frozen=True)
class DeviationSet:
    """Relative deviations |chi z - z*|/z* per peak, their mean per experiment and overall."""

    per_peak: Floats
    per_experiment: Floats
    mean: float


@dataclass(frozen=True)
class Deviations:
    """Before (campaign's start) and after; `improvement_percent` = 100 (1 - final/initial)."""

    initial: DeviationSet
    final: DeviationSet
    improvement_percent: float


@dataclass(frozen=True, kw_only=True)
class SweepCurves:
    """The sweep as measured and as simulated (scaled), V peak, (n,) each."""

    frequency_hz: Floats
    measured_v: Floats
    initial_v: Floats
    final_v: Floats


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Scale before and after, its grid bias, and the bias of the measured maximum.

    `maximum_bias`: the largest measured point over the fitted top of the sweep, minus one.
    """

    kind: str
    initial: float
    final: float
    grid_bias: float
    maximum_v: float
    maximum_bias: float
    maximum_bias_std: float


@dataclass(frozen=True)
class Cost:
    """Objective evaluations (those inside Jacobians too), Jacobians, simulation runs."""

    objective: int
    jacobians: int
    fmu_runs: int


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Origin of the result.

    `plan` and `notes` on the run, in sentences; `files`: sha256 by path from the campaign's folder;
    `start_values` of the FMU that are not fitted; `fmu_tool`: what
    made its binary.
    """

    fmu_name: str
    fmu_file: str
    fmu_guid: str
    fmu_sha256: str
    campaign: str
    files: Mapping[str, str]
    versions: Mapping[str, str]
    command: str
    seed: int
    settings: Mapping[str, Scalar]
    plan: tuple[str, ...]
    finished: str
    notes: tuple[str, ...] = ()
    start_values: Mapping[str, Scalar] = field(default_factory=dict)
    fmu_tool: str = ""


@dataclass(frozen=True, kw_only=True)
class Result(Inferred):
    """A whole reconstruction, as `result.json` holds it."""

    schema: int = SCHEMA
    """Version of these keys."""
    title: str
    """Heading of the campaign."""
    synthetic: bool
    """Whether the data are declared to be made by a computer."""
    alternative: Mapping[str, Scalar]
    """The discrete settings that are reported."""
    deviations: Deviations
    """Relative deviations of the peaks, before and after."""
    j_fit: float
    """Sum of |r| at the reported parameters."""
    j_reg: float
    """nu/2 |x|^2 there, at the last ν."""
    optimality: float
    """Decrease of χ² that a linearised step still promises."""
    scale: Scale
    """From simulated to measured amplitudes, before and after."""
    peaks: tuple[Peak, ...]
    """Measured and simulated amplitudes, a peak each."""
    sweep: SweepCurves | None
    """The measured and the simulated sweep."""
    history: tuple[HistoryRow, ...]
    """Algorithm 2: the campaign's start, then a row for each ν; empty if not asked for."""
    alternatives: tuple[AlternativeResult, ...]
    """All alternatives, each with its starts and where they led."""
    correlation: tuple[Floats, ...]
    """Of the parameters, in their order."""
    evaluations: Cost
    """What the fit cost."""
    seconds: float
    """Wall time of the fit, without starting processes and without the report."""
    warnings: tuple[str, ...]
    """The sentences of `findings` that are errors or warnings, for people who read the file."""
    provenance: Provenance
    """Where all of it comes from."""
    global_history: tuple[HistoryRow, ...] = ()
    """The least J of a multistart at every ν (`--global-path`)."""
    line: SweepLine | None = None
    """One damped mode fitted to the sweep without the FMU."""
    external: tuple[ExternalTest, ...] = ()
    """Distances to values from elsewhere (`--external`)."""
    plan: PlanRecord | None = None
    """How accurately the FMU was simulated, decision by decision."""

    @property
    def fitted_values(self) -> dict[str, float]:
        """Fitted values by parameter, those of single experiments too, each in its unit."""
        values = {name: p.value for name, p in self.parameters.items()}
        return values | {offset.name: offset.fitted for offset in self.offsets}


def write_result(result: Result, folder: Path) -> tuple[Path, Path]:
    """Write `result.json` and `history.csv` into a folder, atomically; their paths.

    Args:
        result: of a reconstruction.
        folder: where the files go.
    """
    history, whole = folder / "history.csv", folder / "result.json"
    write_whole(history, history_csv(result))
    write_json(whole, result)
    return whole, history


def read_result(path: Path) -> Result:
    """Read a `result.json`.

    Args:
        path: of the file.

    Raises:
        BadInput: no such file, or not a result; names the key.
    """
    return read_json(path, Result, upgraded)


def history_csv(result: Result) -> str:
    """Algorithm 2 as CSV text, units in the header: the levels as published, then the least J.

    Args:
        result: of a reconstruction.
    """
    units = {name: p.unit for name, p in result.parameters.items()}
    outputs = {name: d.unit for name, d in result.derived.items()}
    head = ["kind", "level", "nu"]
    head += [f"{name} ({unit})" for name, unit in units.items()]
    head += [f"mean {name} ({unit})" for name, unit in outputs.items()]
    head += ["j_fit", "j_reg", "change", "optimality", "second_j", "status", "iterations"]
    head += ["evaluations", "seconds", "message"]
    rows = [head]
    both = [("path", row) for row in result.history]
    both += [("global", row) for row in result.global_history]
    for kind, row in both:
        numbers: list[float | int] = [row.level, row.nu]
        numbers += [row.parameters[name] for name in units]
        numbers += [row.derived.get(name, float("nan")) for name in outputs]
        numbers += [row.j_fit, row.j_reg, row.change, row.optimality, row.second_j]
        tail = [row.status, str(row.iterations), str(row.evaluations)]
        tail += [f"{row.seconds:.3f}", row.message]
        cells = ("" if value != value else repr(value) for value in numbers)  # none is no number
        rows.append([kind, *cells, *tail])
    return csv_text(rows)
