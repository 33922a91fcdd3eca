"""The virtual laboratory's front door: a campaign with known truth, simulated without any FMU."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fitting.lab.bench import Bench, Instrument, measure
from fitting.lab.benches import bench_named, changed
from fitting.lab.curves import Curve, changed_curve, curve_named, curve_of, kind_of
from fitting.lab.duffing import CubicModes
from fitting.lab.filled import carried
from fitting.lab.instruments.lock_in import LockIns
from fitting.lab.instruments.phase_detector import PhaseDetectors
from fitting.lab.names import SYNTHETIC_FILES, TRUTH_NAME
from fitting.lab.plan import Plan
from fitting.lab.pumped import PumpedString
from fitting.lab.pumped_files import (
    PUMPED_BENCHES,
    changed_pumped,
    pumped_bench_of,
    pumped_files,
)
from fitting.lab.sweep_plan import (
    SweepPlan,
    SweptBench,
    changed_bench,
    is_crossing,
    is_of_sweeps,
    swept_bench,
)
from fitting.lab.tone_plan import TonePlan
from fitting.lab.truth import read_bench, truth_tables
from fitting.lab.writer import CAMPAIGN_NAME, campaign_files, head_lines
from fitting.text.errors import BadInput
from fitting.text.files import write_all
from fitting.text.results_folder import remove_earlier, results_folder
from fitting.text.toml import read_toml

#: What is measured: a bench, or a curve.
AnyBench = Bench | PumpedString | Curve


@dataclass(frozen=True, kw_only=True)
class Synthetic:
    """A synthetic campaign: content of truth.toml as ``truth``, ``files`` by relative name.

    ``source`` is the folder that paths in the campaign are seen from until it is written, None
    where it names no file but those. ``measured`` is a record of the bench's own: ``readings`` hold
    the arrays of the campaign, ``sweep`` (of a series) its sweep, ``answers`` the truth at every
    drive; of sweeps under a pump `PumpedSweeps`, of a curve that curve, of planned sweeps a
    `PlannedSweep` each, of tones at values of a control the values of each row.
    """

    truth: Mapping[str, Any]
    files: Mapping[str, str | bytes]
    source: Path | None = None
    measured: Any = None

    def write(self, folder: Path) -> Path:
        """Write the files below a folder; returns the path of the campaign.

        Args:
            folder: where the files go.

        Raises:
            BadInput: a file cannot be written, or is there and was not synthesized.
        """
        files = dict(self.files)
        if self.source is not None:
            text = str(files[CAMPAIGN_NAME])
            files[CAMPAIGN_NAME] = carried(text, self.source, folder, tuple(files))
        with results_folder(folder, "synthesize", files):
            write_all(folder, files)
            remove_earlier(folder, (*files, *SYNTHETIC_FILES))
        return folder / CAMPAIGN_NAME


def synthesize_curves(
    kind: str,
    *,
    seed: int = 1,
    out: Path | None = None,
    command: str = "fitting.synthesize_curves",
    **changes: Any,
) -> Synthetic:
    """A campaign of one complex sweep, of spectra over a voltage, or of a trace, with known truth.

    S = a e (1 + s x + c H) behind a wiring, |q1| of coupled modes, or q1 over time, by closed
    forms that are not the FMU.

    Args:
        kind: "transmission", "notch" or "reflection": one mode as a network analyser sees it;
            "crossing": two modes that a voltage tunes through each other, or with ``modes=3`` one
            through two that are coupled; "ringdown": two beating modes that are let go, over time;
            "chirp": the same under a chirp; "lock-in": X and Y of such a decay at 1 MHz;
            "zero-span": levels of one mode's.
        seed: Seed of the noise, a whole number of at least 0.
        out: Folder for the files; None: nothing is written.
        command: What the head of every file states that made it.
        **changes: Numbers that are different, by the names of the fields of `WiredResonance`,
            `AvoidedCrossing`, `StringTrace` or `StringPhasors`: ``noise``, ``points``,
            ``delay_s`` (s), ``lambda_hz`` (Hz), ...

    Returns:
        The files and the truth behind them.

    Raises:
        BadInput: no such kind, impossible numbers, or a folder with files that were not
            synthesized.
    """
    if seed < 0:
        raise BadInput(f"seed: found {seed}, wanted a whole number of at least 0")
    files = curve_named(kind, changes).files(seed, head_lines(seed, command))
    made = Synthetic(truth=tomllib.loads(files[TRUTH_NAME]), files=files)
    if out is not None:
        made.write(out)
    return made


def synthesize(
    truth: AnyBench | Path | str = "q1",
    *,
    seed: int = 1,
    instrument: Instrument | None = None,
    plan: Path | None = None,
    out: Path | None = None,
    command: str = "fitting.synthesize",
    **changes: Any,
) -> Synthetic:
    """A campaign with known truth, noise and drift.

    The sample of the bench answers every drive with its steady amplitudes, by phasors or, with
    cubic terms, by harmonic balance; noise and drift come from the seed. No FMU is run.

    Args:
        truth: What is measured: "q1" or "q2" (the paper's series), "duffing" (its string driven
            hard), "pumped" (its sweeps under a parametric pump), "string_pumped" (those under a
            pump at the distance of the modes and at half of it), a bench or curve, or the path of a
            synthetic campaign or of its truth.toml; of a plan of sweeps "pumped", "crossing", or
            the path of such a campaign, of tones at values of a control the latter.
        seed: Seed of all noise, a whole number of at least 0; the same seed gives the same numbers.
        instrument: How the series is read; None: as the bench has it.
        plan: A campaign that `fmu-fit design` proposed, whose rows or sweeps are measured instead
            of a series of the bench.
        out: Folder for the files; None: nothing is written.
        command: What the head of every file states that made it.
        **changes: Numbers of the bench that are different, by the names of its records:
            ``noise_scale``, ``drift_hz``, ``crest_v``, ``d1_hz``, ``theta_rad``, ``alpha1``, ...

    Returns:
        What was measured and the truth behind it.

    Raises:
        BadInput: no such bench, impossible numbers, a plan that the bench cannot follow, or a
            folder with files that were not synthesized.
    """
    if seed < 0:
        raise BadInput(f"seed: found {seed}, wanted a whole number of at least 0")
    try:
        if plan is not None and is_of_sweeps(plan):
            _refuse_instrument_of(plan, instrument)
            swept = changed_bench(swept_bench(truth), changes)
            return _written(_planned_sweeps(swept, plan, seed, command), out)
        if plan is not None and is_crossing(truth):
            _refuse_instrument_of(plan, instrument)
            swept = changed_bench(swept_bench(truth), changes)
            return _written(_planned_tones(swept, plan, seed, command), out)
        result = bench_of(truth)
        if isinstance(result, Curve):
            _refuse_of_curve(result, instrument, plan)
            return _written(_curve(result, changes, seed, command), out)
        if isinstance(result, PumpedString):
            _refuse_of_pumped(result, instrument, plan)
            return _written(_pumped(result, changes, seed, command), out)
        bench = changed(result, **changes)
        _refuse_instrument(bench, instrument, plan)
        bench = replace(bench, instrument=instrument or bench.instrument)
        made = _planned(bench, plan, seed, command) if plan else _series(bench, seed, command)
    except BadInput:
        raise
    except ValueError as error:
        raise BadInput(f"synthesize: {error}") from error
    return _written(made, out)


def _written(made: Synthetic, out: Path | None) -> Synthetic:
    if out is not None:
        made.write(out)
    return made


def _refuse_instrument_of(plan: Path | None, instrument: Instrument | None) -> None:
    if instrument is not None and plan is not None:
        raise BadInput("instrument: a plan states how it is read, in its [design]; wanted none")


def _refuse_instrument(bench: Bench, instrument: Instrument | None, plan: Path | None) -> None:
    _refuse_instrument_of(plan, instrument)
    lock_ins = isinstance(instrument, LockIns | PhaseDetectors)
    if lock_ins and isinstance(bench.sample, CubicModes):
        raise BadInput(
            f"instrument: lock-in amplifiers have no meaning for the bench {bench.series!r}, which "
            "is read at its lines"
        )
    pairs = len(bench.pairs_hz)
    for k in instrument.restarts if isinstance(instrument, PhaseDetectors) else ():
        if not 0 < k < pairs:
            raise BadInput(
                f"restarts: found a restart before drive pair {k + 1}, wanted one of 2 to {pairs}"
            )


def _refuse_of_pumped(
    bench: PumpedString, instrument: Instrument | None, plan: Path | None
) -> None:
    name = bench.NAME
    if instrument is not None:
        raise BadInput(
            f"instrument: the bench {name!r} sweeps one line and records its amplitudes; phases "
            "and the other mode are not made of it, wanted none"
        )
    if plan is not None:
        raise BadInput(
            f"plan: the bench {name!r} measures sweeps, not the tones of a plan; wanted sweeps"
        )


def _refuse_of_curve(curve: Curve, instrument: Instrument | None, plan: Path | None) -> None:
    for name, given in (("instrument", instrument), ("plan", plan)):
        if given is not None:
            raise BadInput(
                f"{name}: has no meaning for the curve {kind_of(curve)!r}, which is driven by no "
                "pairs of tones; wanted none"
            )


def _curve(curve: Curve, changes: Mapping[str, Any], seed: int, command: str) -> Synthetic:
    changed_one = changed_curve(curve, kind_of(curve), changes)
    files = changed_one.files(seed, head_lines(seed, command))
    return Synthetic(measured=changed_one, truth=tomllib.loads(files[TRUTH_NAME]), files=files)


def _pumped(bench: PumpedString, changes: Mapping[str, Any], seed: int, command: str) -> Synthetic:
    measured, truth, files = pumped_files(changed_pumped(bench, **changes), seed, command)
    return Synthetic(measured=measured, truth=truth, files=files)


def _series(bench: Bench, seed: int, command: str) -> Synthetic:
    series = measure(bench, seed)
    files = campaign_files(series, command)
    return Synthetic(measured=series, truth=truth_tables(series), files=files)


def _planned(bench: Bench, path: Path, seed: int, command: str) -> Synthetic:
    plan = Plan(path)
    measured = plan.measure(bench, seed)
    files = plan.files(measured, command)
    truth = truth_tables(measured)
    return Synthetic(measured=measured, truth=truth, files=files, source=path.parent)


def _planned_sweeps(bench: SweptBench, path: Path, seed: int, command: str) -> Synthetic:
    plan = SweepPlan(path, bench)
    measured = plan.measure(seed)
    truth, files = plan.files(measured, seed, command)
    return Synthetic(measured=measured, truth=truth, files=files, source=path.parent)


def _planned_tones(bench: SweptBench, path: Path, seed: int, command: str) -> Synthetic:
    plan = TonePlan(path, bench)
    measured = plan.measure(seed)
    truth, files = plan.files(measured, seed, command)
    return Synthetic(measured=measured, truth=truth, files=files, source=path.parent)


def bench_of(truth: AnyBench | Path | str) -> AnyBench:
    """A bench or curve as it is, by its name, or by its truth file or the campaign next to that.

    Args:
        truth: a laboratory, or the file that describes one.

    Raises:
        BadInput: no such bench or file.
    """
    if isinstance(truth, AnyBench):
        return truth
    path = Path(truth)
    if path.suffix != ".toml":
        named = PUMPED_BENCHES.get(str(truth))
        return bench_named(str(truth)) if named is None else named()
    file = path if path.name == TRUTH_NAME else path.parent / TRUTH_NAME
    tables = read_toml(file)
    curve = curve_of(tables, file)
    if curve is not None:
        return curve
    return pumped_bench_of(tables, file) or read_bench(file)
