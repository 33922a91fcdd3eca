"""Sweeps under a pump as the files of a campaign, and their truth read again."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

from fitting.lab.names import TRUTH_NAME
from fitting.lab.pumped import PumpedBench, PumpedString, PumpedSweeps, measure_pumped
from fitting.lab.string import TwoModes
from fitting.lab.subharmonic import PumpedSweep, SubharmonicBench
from fitting.lab.truth import REMARK, plain, values_of
from fitting.lab.writer import CAMPAIGN_NAME, csv_text, head_lines
from fitting.text.errors import BadInput
from fitting.text.toml import Tables, rewritten, toml_text

P = TypeVar("P", bound=PumpedString)
#: Built-in benches with a pump, by name.
PUMPED_BENCHES: Mapping[str, type[PumpedBench] | type[SubharmonicBench]] = {
    kind.NAME: kind for kind in (PumpedBench, SubharmonicBench)
}


def pumped_bench_of(tables: Mapping[str, Any], truth: Path) -> PumpedString | None:
    """The bench that the tables of a truth file describe; None: none with a pump.

    Args:
        tables: of the file.
        truth: its path.

    Raises:
        BadInput: they do not describe one.
    """
    kind = next((kind for name, kind in PUMPED_BENCHES.items() if name in tables), None)
    if kind is None:
        return None
    names = [f.name for f in dataclasses.fields(kind) if f.name not in kind.ELSEWHERE]
    bench = values_of(tables, kind.NAME, names, truth)
    modes = values_of(tables, "modes", [f.name for f in dataclasses.fields(TwoModes)], truth)
    try:
        if "settings" in bench:
            bench["settings"] = tuple((float(depth), float(hz)) for depth, hz in bench["settings"])
        if "sweeps" in kind.ELSEWHERE:
            bench["sweeps"] = tuple(PumpedSweep(**sweep) for sweep in tables["sweep"])
        return kind(string=TwoModes(**modes), **bench)
    except BadInput:
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput(f"{truth}: does not describe a virtual laboratory: {error}") from error


def changed_pumped(bench: P, **values: Any) -> P:
    """The bench with fields of its own or of its string replaced, by name.

    Args:
        bench: the truth and how it is swept.
        **values: new values of the fields.

    Raises:
        ValueError: values that are impossible.
        BadInput: a name that this bench does not have.
    """
    own, modes = bench.__dataclass_fields__, TwoModes.__dataclass_fields__
    for name in values:
        if name not in own and name not in modes:
            raise BadInput(f"{name}: has no meaning for the bench {bench.NAME!r}")
    string = dataclasses.replace(
        bench.string, **{name: v for name, v in values.items() if name in modes}
    )
    return dataclasses.replace(
        bench, **{"string": string, **{name: v for name, v in values.items() if name in own}}
    )


def pumped_files(
    bench: PumpedString, seed: int, command: str
) -> tuple[PumpedSweeps, dict[str, Any], dict[str, str]]:
    """What was measured, its truth, and the files of the campaign by relative name.

    Args:
        bench: the truth and how it is swept.
        seed: of the noise.
        command: command line that made it, for the record.
    """

    def edit(tables: Tables) -> None:
        tables["control_sweep"]["sigma"] = f"{bench.noise_v!r} V"
        for name, value in bench.constants().items():
            tables["constants"][name] = value

    measured = measure_pumped(bench, seed)
    head, truth = head_lines(seed, command), pumped_truth(bench, seed)
    campaign = resources.files("fitting.lab") / "campaigns" / f"{bench.NAME}.toml"
    columns = bench.columns() | {"amplitude (uV)": measured.amplitude_v.ravel() * 1e6}
    files = {
        CAMPAIGN_NAME: rewritten(campaign.read_text("utf-8"), edit, list(head)),
        "sweeps.csv": csv_text(columns, head),
        TRUTH_NAME: toml_text(truth, [*head, REMARK]),
    }
    return measured, truth, files


def pumped_truth(bench: PumpedString, seed: int) -> dict[str, Any]:
    """Everything that was put in; all tables but [outcome] make the bench again.

    Args:
        bench: the truth and how it is swept.
        seed: of the noise.
    """
    widths = bench.string.widths_hz()
    outcome = {"seed": seed, "width_plus_hz": widths[0], "width_minus_hz": widths[1]}
    return {
        bench.NAME: plain(bench, bench.ELSEWHERE),
        "modes": plain(bench.string),
        "outcome": outcome | bench.outcome(),
        **bench.tables(),
    }
