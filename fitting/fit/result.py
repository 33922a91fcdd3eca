"""The result of a reconstruction as records; `result.json` and `history.csv` from and to them.

Ending badly is a value: `status` and `message` are stored like any number. All numbers are in the
units that stand beside them; `nan` (JSON null) where there is none.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fitting.fit.joint_result import ExternalTest, JointResult
from fitting.inference.knowledge import Knowledge
from fitting.simulate.budget import PlanRecord
from fitting.text.arrays import Scalar
from fitting.text.files import write_whole
from fitting.text.records import read_json, write_json

Floats = tuple[float, ...]

STATUSES = ("converged", "not converged", "interrupted")
IDENTIFIABLE = ("determined", "partly determined", "not determined")


@dataclass(frozen=True)
class ParameterResult:
    """One fitted parameter.

    `value` is canonical (periodic ones in [0, period)); `std` (NaN where "not determined") from the
    linearised covariance with box and Tikhonov term as prior, `ci95` likewise and within the box,
    or from the profile likelihood where there is `Result.knowledge`; `shrinkage` the share of its
    variance that comes from the data, not from the prior; `identifiable` in words.
    """

    value: float
    unit: str
    std: float
    ci95: tuple[float, float]
    reference: float
    start: float
    lower: float
    upper: float
    shrinkage: float
    identifiable: str


@dataclass(frozen=True)
class DerivedResult:
    """One derived output: `values` per experiment, `mean` and `spread` (standard deviation).

    `value` is the mean; `reference` the mean at the reference parameters; `box` the range of the
    mean over the box of the parameters: what it could be without any data. `ci95` is cut to it.
    Where it is "not determined", `std` is NaN, `ci95` is the range, that range is the answer and
    `value` is only where the optimiser stopped.
    """

    value: float
    unit: str
    values: Floats
    mean: float
    spread: float
    std: float
    ci95: tuple[float, float]
    reference: float
    shrinkage: float
    identifiable: str
    box: tuple[float, float]

    def text(self) -> str:
        """Value for people; never a value with a small error where the data do not give one."""
        if self.identifiable == IDENTIFIABLE[2]:
            low, high = self.box
            if low != low:
                return "has no value at any parameters tried"
            return f"not determined by these data (anything from {low:.6g} to {high:.6g})"
        return f"{self.value:.9g} ± {self.std:.2g}"


@dataclass(frozen=True)
class OffsetResult:
    """A fitted value of one state of the sample, such as its offset from the interpolated drift.

    It belongs to `experiments` (those of one time share it) and is added to `variables`; `prior` is
    the standard deviation it was given (NaN: none). `fitted` is the value of `parameter` itself:
    of a random walk it is the last step, while `value` is all steps together.
    """

    parameter: str
    experiments: tuple[str, ...]
    variables: tuple[str, ...]
    value: float
    unit: str
    std: float
    ci95: tuple[float, float]
    prior: float
    shrinkage: float
    identifiable: str
    fitted: float


@dataclass(frozen=True)
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


@dataclass(frozen=True)
class SweepCurves:
    """The sweep as measured and as simulated (scaled) before and after, V peak, (n,) each."""

    frequency_hz: Floats
    measured_v: Floats
    initial_v: Floats
    final_v: Floats


@dataclass(frozen=True)
class LineFit:
    """The sweep's line with one form of background; NaN where that fit failed (`message`).

    `structure_p` is the probability that white noise leaves such residuals, `points` how many
    independent points they are worth, `widening` the factor that the errors carry for it.
    """

    background: str
    frequency_hz: float
    frequency_std_hz: float
    width_hz: float
    width_std_hz: float
    q: float
    q_std: float
    residual: float
    structure_p: float
    points: float
    widening: float
    message: str


@dataclass(frozen=True)
class SweepLine:
    """One damped mode fitted to the sweep itself, without the FMU, beside what the instrument says.

    ``frequency_hz`` its eigenfrequency, ``width_hz`` the full width at half maximum of the squared
    amplitude, ``q`` their ratio, ``amplitude`` (in ``unit``, peak) at the eigenfrequency, each with
    its standard deviation; ``residual`` the root mean square of what the fit leaves, over the
    amplitude. NaN where the sweep shows no such line: ``message`` says why, or how the fit ended.
    ``instrument`` holds the instrument's own estimates ("frequency_hz", "q"), ``notes`` all that
    the head of its file says. ``fits`` are the fits without and with a complex background, whatever
    the campaign chose; ``background_p`` is the probability that noise alone lets the background
    gain as much (F-test), NaN where one of them failed or nothing is left to gain.
    """

    frequency_hz: float
    frequency_std_hz: float
    width_hz: float
    width_std_hz: float
    q: float
    q_std: float
    amplitude: float
    amplitude_std: float
    unit: str
    residual: float
    background: str
    message: str
    instrument: Mapping[str, float]
    notes: Mapping[str, str]
    fits: tuple[LineFit, ...] = ()
    background_p: float = float("nan")


@dataclass(frozen=True)
class Scale:
    """chi before and after, its grid bias, and what noise did to the laboratory's maximum.

    `maximum_bias` is the largest measured point over the fitted top of the sweep, minus one.
    """

    kind: str
    initial: float
    final: float
    grid_bias: float
    maximum_v: float
    maximum_bias: float
    maximum_bias_std: float


@dataclass(frozen=True)
class HistoryRow:
    """One nu of the reported chain; level -1 is the start itself, before any solve."""

    level: int
    nu: float
    parameters: Mapping[str, float]
    derived: Mapping[str, float]
    j_fit: float
    j_reg: float
    change: float
    optimality: float
    status: str
    message: str
    iterations: int
    evaluations: int
    seconds: float


@dataclass(frozen=True)
class StartResult:
    """Where one start led: end values (canonical), J, the start it met, why it ended."""

    begun: Mapping[str, float]
    parameters: Mapping[str, float]
    j_fit: float
    j_reg: float
    levels: int
    joined: int | None
    ended: str
    equivalent: bool


@dataclass(frozen=True)
class AlternativeResult:
    """One discrete alternative with its best start; `equal_to_best` within the tolerance of J."""

    settings: Mapping[str, Scalar]
    parameters: Mapping[str, float]
    derived: Mapping[str, float]
    j_fit: float
    j_reg: float
    status: str
    message: str
    reported: bool
    equal_to_best: bool
    starts: tuple[StartResult, ...]


@dataclass(frozen=True)
class Cost:
    """Objective evaluations (those inside Jacobians too), Jacobians, simulation runs."""

    objective: int
    jacobians: int
    fmu_runs: int


@dataclass(frozen=True)
class Provenance:
    """Where the result comes from; `plan` and `notes` in sentences.

    `notes` are about the run, not about the result. `files`: path as seen from the campaign's
    folder -> sha256.
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


@dataclass(frozen=True)
class Result:
    """A whole reconstruction, as `result.json` holds it."""

    title: str
    synthetic: bool
    status: str
    message: str
    parameters: Mapping[str, ParameterResult]
    derived: Mapping[str, DerivedResult]
    alternative: Mapping[str, Scalar]
    deviations: Deviations
    j_fit: float
    j_reg: float
    optimality: float
    scale: Scale
    peaks: tuple[Peak, ...]
    sweep: SweepCurves | None
    history: tuple[HistoryRow, ...]
    alternatives: tuple[AlternativeResult, ...]
    correlation: tuple[Floats, ...]
    evaluations: Cost
    seconds: float
    warnings: tuple[str, ...]
    provenance: Provenance
    line: SweepLine | None = None
    offsets: tuple[OffsetResult, ...] = ()
    joint: JointResult | None = None
    external: tuple[ExternalTest, ...] = ()
    knowledge: Knowledge | None = None
    plan: PlanRecord | None = None


def write_result(result: Result, folder: Path) -> tuple[Path, Path]:
    """Write `result.json` and `history.csv` into a folder, atomically; their paths."""
    history, whole = folder / "history.csv", folder / "result.json"
    write_whole(history, history_csv(result))
    write_json(whole, result)
    return whole, history


def read_result(path: Path) -> Result:
    """Read a `result.json`.

    Raises:
        BadInput: no such file, or not a result; names the key.
    """
    return read_json(path, Result)


def history_csv(result: Result) -> str:
    """The history as CSV text: a row per nu, units in the header."""
    units = {name: p.unit for name, p in result.parameters.items()}
    outputs = {name: d.unit for name, d in result.derived.items()}
    head = ["level", "nu"]
    head += [f"{name} ({unit})" for name, unit in units.items()]
    head += [f"mean {name} ({unit})" for name, unit in outputs.items()]
    head += ["j_fit", "j_reg", "change", "optimality", "status", "iterations", "evaluations"]
    head += ["seconds", "message"]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    for row in result.history:
        numbers: list[float | int] = [row.level, row.nu]
        numbers += [row.parameters[name] for name in units]
        numbers += [row.derived.get(name, float("nan")) for name in outputs]
        numbers += [row.j_fit, row.j_reg, row.change, row.optimality]
        tail = [row.status, row.iterations, row.evaluations, f"{row.seconds:.3f}", row.message]
        cells = ("" if value != value else repr(value) for value in numbers)  # none is no number
        writer.writerow([*cells, *tail])
    return text.getvalue()
