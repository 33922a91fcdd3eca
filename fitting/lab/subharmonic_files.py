"""Sweeps under a pump at two subharmonics as the files of a campaign; their truth read again."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from fitting.lab.names import SUBHARMONIC, TRUTH_NAME
from fitting.lab.pumped_files import SWEEPS_NAME
from fitting.lab.string import TwoModes
from fitting.lab.subharmonic import (
    PumpedSweep,
    SubharmonicBench,
    SubharmonicSweeps,
    measure_subharmonic,
)
from fitting.lab.truth import REMARK, plain, values_of
from fitting.lab.writer import CAMPAIGN_NAME, csv_text, head_lines, written_mhz
from fitting.text.errors import BadInput
from fitting.text.toml import Tables, rewritten, toml_text

#: Fields of a bench with tables of their own.
ELSEWHERE = ("string", "sweeps")


def subharmonic_bench_of(tables: dict[str, Any], truth: Path) -> SubharmonicBench:
    """The bench that the tables of a truth file describe.

    Args:
        tables: of the file.
        truth: its path.

    Raises:
        BadInput: they do not describe one.
    """
    names = [f.name for f in dataclasses.fields(SubharmonicBench) if f.name not in ELSEWHERE]
    bench = values_of(tables, SUBHARMONIC, names, truth)
    modes = values_of(tables, "modes", [f.name for f in dataclasses.fields(TwoModes)], truth)
    try:
        sweeps = tuple(PumpedSweep(**sweep) for sweep in tables["sweep"])
        return SubharmonicBench(string=TwoModes(**modes), sweeps=sweeps, **bench)
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput(f"{truth}: does not describe a virtual laboratory: {error}") from error


def subharmonic_files(
    bench: SubharmonicBench, seed: int, command: str
) -> tuple[SubharmonicSweeps, dict[str, Any], dict[str, str]]:
    """What was measured, its truth, and the files of the campaign by relative name.

    Args:
        bench: the truth and how it is swept.
        seed: of the noise.
        command: command line that made it, for the record.
    """
    measured = measure_subharmonic(bench, seed)
    head = head_lines(seed, command)
    campaign = resources.files("fitting.lab") / "campaigns" / f"{SUBHARMONIC}.toml"
    truth = subharmonic_truth(bench, seed)
    files = {
        CAMPAIGN_NAME: rewritten(
            campaign.read_text("utf-8"), lambda tables: _edit(tables, bench), list(head)
        ),
        SWEEPS_NAME: _sweeps(measured, head),
        TRUTH_NAME: toml_text(truth, [*head, REMARK]),
    }
    return measured, truth, files


def _edit(tables: Tables, bench: SubharmonicBench) -> None:
    tables["control_sweep"]["sigma"] = f"{bench.noise_v!r} V"
    constants = tables["constants"]
    constants["plus"] = written_mhz(bench.string.eta_plus_hz)
    constants["minus"] = written_mhz(bench.string.eta_minus_hz)


def _sweeps(measured: SubharmonicSweeps, head: Sequence[str]) -> str:
    bench = measured.bench
    columns = {
        "volts (V)": np.repeat([s.volts for s in bench.sweeps], bench.points),
        "pump (kHz)": np.repeat([s.pump_hz / 1e3 for s in bench.sweeps], bench.points),
        "frequency (MHz)": np.concatenate([bench.frequency_hz(s) / 1e6 for s in bench.sweeps]),
        "amplitude (uV)": measured.amplitude_v.ravel() * 1e6,
    }
    return csv_text(columns, head)


def subharmonic_truth(bench: SubharmonicBench, seed: int) -> dict[str, Any]:
    """Everything that was put in; [string_pumped], [[sweep]] and [modes] make the bench again.

    Args:
        bench: the truth and how it is swept.
        seed: of the noise.
    """
    widths, sample = bench.string.widths_hz(), bench.sample(0.0, bench.eta_apart_hz)
    return {
        SUBHARMONIC: plain(bench, ELSEWHERE),
        "modes": plain(bench.string),
        "outcome": {
            "seed": seed,
            "width_plus_hz": widths[0],
            "width_minus_hz": widths[1],
            "f1_hz": sample.f_hz[0],
            "f2_hz": sample.f_hz[1],
            "lambda_hz": sample.coupling_hz[0, 1],
        },
        "sweep": [dataclasses.asdict(sweep) for sweep in bench.sweeps],
    }
