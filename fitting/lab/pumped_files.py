"""Pumped sweeps of the virtual laboratory as the files of a campaign, and its truth read again."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fitting.lab.names import PUMPED, SUBHARMONIC, TRUTH_NAME
from fitting.lab.pumped import PumpedBench, PumpedSweeps, measure_pumped, pumped_modes
from fitting.lab.string import TwoModes
from fitting.lab.subharmonic import SubharmonicBench
from fitting.lab.truth import REMARK, plain, values_of
from fitting.lab.writer import CAMPAIGN_NAME, csv_text, head_lines, written_mhz
from fitting.text.errors import BadInput
from fitting.text.toml import Tables, rewritten, toml_text

#: A bench that pumps its string.
AnyPumped = TypeVar("AnyPumped", PumpedBench, SubharmonicBench)
SWEEPS_NAME = "sweeps.csv"
#: Fields of a bench with a table of their own.
ELSEWHERE = ("string",)


def pumped_bench_of(tables: dict[str, Any], truth: Path) -> PumpedBench:
    """The bench that the tables of a truth file describe.

    Args:
        tables: of the file.
        truth: its path.

    Raises:
        BadInput: they do not describe one.
    """
    names = [f.name for f in dataclasses.fields(PumpedBench) if f.name not in ELSEWHERE]
    bench = values_of(tables, PUMPED, names, truth)
    modes = values_of(tables, "modes", [f.name for f in dataclasses.fields(TwoModes)], truth)
    try:
        bench["settings"] = tuple((float(depth), float(hz)) for depth, hz in bench["settings"])
        return PumpedBench(string=TwoModes(**modes), **bench)
    except (TypeError, ValueError) as error:
        raise BadInput(f"{truth}: does not describe a virtual laboratory: {error}") from error


def changed_pumped(bench: AnyPumped, **values: Any) -> AnyPumped:
    """The bench with fields of its own or of its string replaced, by name.

    Args:
        bench: the truth and how it is swept.
        **values: new values of the fields.

    Raises:
        ValueError: values that are impossible.
        BadInput: a name that this bench does not have.
    """
    series = PUMPED if isinstance(bench, PumpedBench) else SUBHARMONIC
    own, modes = bench.__dataclass_fields__, TwoModes.__dataclass_fields__
    for name in values:
        if name not in own and name not in modes:
            raise BadInput(f"{name}: has no meaning for the bench {series!r}")
    string = dataclasses.replace(
        bench.string, **{name: v for name, v in values.items() if name in modes}
    )
    return dataclasses.replace(
        bench, **{"string": string, **{name: v for name, v in values.items() if name in own}}
    )


def pumped_files(
    bench: PumpedBench, seed: int, command: str
) -> tuple[PumpedSweeps, dict[str, Any], dict[str, str]]:
    """What was measured, its truth, and the files of the campaign by relative name.

    Args:
        bench: the truth and how it is swept.
        seed: of the noise.
        command: command line that made it, for the record.
    """
    measured = measure_pumped(bench, seed)
    head = head_lines(seed, command)
    text = (resources.files("fitting.lab") / "campaigns" / "pumped.toml").read_text("utf-8")
    truth = pumped_truth(bench, seed)
    files = {
        CAMPAIGN_NAME: rewritten(text, lambda tables: _edit(tables, bench), list(head)),
        SWEEPS_NAME: _sweeps(measured, head),
        TRUTH_NAME: toml_text(truth, [*head, REMARK]),
    }
    return measured, truth, files


def _edit(tables: Tables, bench: PumpedBench) -> None:
    tables["control_sweep"]["sigma"] = f"{bench.noise_v!r} V"
    constants = tables["constants"]
    constants["plus"] = written_mhz(bench.string.eta_plus_hz)
    constants["minus"] = written_mhz(bench.string.eta_minus_hz)
    constants["apart"] = f"{bench.apart_hz!r} Hz"


def _sweeps(measured: PumpedSweeps, head: Sequence[str]) -> str:
    bench = measured.bench
    depths, detunings = (
        np.repeat(column, bench.points) for column in zip(*bench.settings, strict=True)
    )
    count = len(bench.settings)
    columns = {
        "detuning (Hz)": detunings,
        "depth (1)": depths,
        "time (h)": np.repeat([bench.time_h(k) for k in range(count)], bench.points),
        "frequency (MHz)": np.tile(bench.frequency_hz / 1e6, count),
        "amplitude (uV)": measured.amplitude_v.ravel() * 1e6,
    }
    return csv_text(columns, head)


def pumped_truth(bench: PumpedBench, seed: int) -> dict[str, Any]:
    """Everything that was put in; [pumped] and [modes] make the bench again.

    Args:
        bench: the truth and how it is swept.
        seed: of the noise.
    """
    widths = bench.string.widths_hz()
    return {
        PUMPED: plain(bench, ELSEWHERE),
        "modes": plain(bench.string),
        "outcome": {
            "seed": seed,
            "width_plus_hz": widths[0],
            "width_minus_hz": widths[1],
            "lambda_hz": pumped_modes(bench.string, 0.0, bench.apart_hz).coupling_hz[0, 1],
        },
    }
