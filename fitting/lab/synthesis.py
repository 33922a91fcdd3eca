"""The virtual laboratory's front door: a campaign with known truth, simulated without any FMU."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fitting.lab.bench import Bench, Instrument, measure
from fitting.lab.curve import Curve
from fitting.lab.duffing import CubicModes
from fitting.lab.instruments import LockIns
from fitting.lab.laboratories import AnyBench, bench_of, changed
from fitting.lab.names import CROSSING, CURVES, SYNTHETIC_FILES
from fitting.lab.plans import moved, planned
from fitting.lab.writer import CAMPAIGN_NAME, campaign_files, head_lines, truth_tables
from fitting.text.errors import BadInput
from fitting.text.results_folder import remove_earlier, results_folder, write_all


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
            files[CAMPAIGN_NAME] = moved(text, self.source, folder, tuple(files))
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
    forms.

    Args:
        kind: "transmission", "notch" or "reflection": one mode in a network analyser; "crossing":
            modes tuned through each other by a voltage; "ringdown": a beating decay; "chirp": under
            a chirp; "lock-in": X and Y of a decay at 1 MHz; "zero-span": levels of a decay.
        seed: Of all noise, at least 0; the same seed gives the same numbers.
        out: Folder for the files; None: nothing is written.
        command: Origin that the files state.
        **changes: Numbers by field of `WiredResonance`, `AvoidedCrossing`, `StringTrace` or
            `StringPhasors`: ``noise``, ``points``, ``delay_s`` (s), ``lambda_hz`` (Hz), ...

    Returns:
        Measurements and truth.

    Raises:
        BadInput: no such kind, impossible numbers, or a folder with files that were not
            synthesized.
    """
    if kind not in CURVES:
        raise BadInput(f"curve {kind!r}: wanted one of {', '.join(CURVES)}")
    return synthesize(kind, seed=seed, out=out, command=command, **changes)


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
    """A campaign with known truth, noise and drift, computed without an FMU.

    Steady amplitudes are by phasors, with cubic terms by harmonic balance.

    Args:
        truth: "q1", "q2" (the paper's series), "duffing", "pumped" (swept under a pump),
            "string_pumped", "string_vdc" (over its bias voltage, and pumped), a kind of
            `synthesize_curves`, a bench or curve, or the path of a synthetic campaign or its
            truth.toml. Of a plan of sweeps "pumped", "crossing" or a path, of tones at values of a
            control a path.
        seed: Of all noise, at least 0; the same seed gives the same numbers.
        instrument: How the series is read; None: the bench's.
        plan: A campaign proposed by `fmu-fit design` that is measured.
        out: Folder for the files; None: nothing is written.
        command: Origin that the files state.
        **changes: Numbers of the bench by field: ``noise_scale``, ``drift_hz``, ``crest_v``,
            ``d1_hz``, ``theta_rad``, ``alpha1``, ...

    Returns:
        Measurements and truth.

    Raises:
        BadInput: no such bench, impossible numbers, a plan that the bench cannot follow, or a
            folder with files that were not synthesized.
    """
    if seed < 0:
        raise BadInput(f"seed: found {seed}, wanted a whole number of at least 0")
    if truth == CROSSING and changes.get("modes") == 3:
        changes = {"volts": 13, "points": 81, **changes}  # the map is wider
    head = head_lines(seed, command)
    files: Mapping[str, str | bytes]
    try:
        bench = changed(bench_of(truth), **changes)
        if instrument is not None:
            bench = _read_by(instrument, bench, plan)
        if plan is not None:
            measured, tables, files = planned(truth, bench, plan, seed, head)
        elif isinstance(bench, Bench):
            measured = measure(bench, seed)
            tables, files = truth_tables(measured), campaign_files(measured, command)
        else:
            measured, tables, files = bench.made(seed, head)
    except BadInput:
        raise
    except ValueError as error:
        raise BadInput(f"synthesize: {error}") from error
    source = None if plan is None else plan.parent
    result = Synthetic(truth=tables, files=files, source=source, measured=measured)
    if out is not None:
        result.write(out)
    return result


def _read_by(instrument: Instrument, bench: AnyBench, plan: Path | None) -> Bench:
    """The bench, read by an instrument that is not its own."""
    if plan is not None:
        raise BadInput("instrument: a plan states how it is read, in its [design]; wanted none")
    if isinstance(bench, Curve):
        raise BadInput(
            f"instrument: has no meaning for the curve {bench.kind!r}, which is driven by no pairs "
            "of tones; wanted none"
        )
    if not isinstance(bench, Bench):
        raise BadInput(
            f"instrument: the bench {bench.kind!r} sweeps one line and records its amplitudes; "
            "phases and the other mode are not made of it, wanted none"
        )
    if isinstance(instrument, LockIns):
        if isinstance(bench.sample, CubicModes):
            raise BadInput(
                f"instrument: lock-in amplifiers have no meaning for the bench {bench.kind!r}, "
                "which is read at its lines"
            )
        pairs = len(bench.pairs_hz)
        for k in instrument.restarts:
            if not 0 < k < pairs:
                raise BadInput(
                    f"restarts: found a restart before drive pair {k + 1}, wanted one of 2 to "
                    f"{pairs}"
                )
    return replace(bench, instrument=instrument)
