"""Proposed recordings as part of a campaign: a table each, a file that the recorder writes."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

from fitting.design.candidates import Limits
from fitting.design.recordings import TracesSoFar, traces_of
from fitting.design.result import Design, Proposal, Recording
from fitting.design.sweep_campaign import MEASURED_BEFORE
from fitting.design.table import written_times
from fitting.extension.records import BoundCampaign, Recorded, TraceRecord
from fitting.fmu.variables import VariableLike
from fitting.measurements.traces.time_record import FOUND
from fitting.text.csv_cells import csv_line
from fitting.text.notation import in_its_unit, prefixed
from fitting.text.toml import Tables, inline, put

#: Keys of a table that tell of the file so far.
OF_FILES = ("columns", "label")


def recorded_as(proposal: Proposal) -> str:
    """Name of the file that a proposed recording is kept in.

    Args:
        proposal: of a recording.
    """
    return f"next{proposal.rank}.csv"


def edit_for_traces(tables: Tables, design: Design, bound: BoundCampaign, limits: Limits) -> None:
    """Put the campaign's tables right for new recordings, its other data left out.

    Args:
        tables: of the campaign's text.
        design: the proposed recordings.
        bound: campaign, bound to its FMU.
        limits: what the design may use.
    """
    for name in MEASURED_BEFORE:
        tables.pop(name, None)
    so_far = traces_of(bound)
    old = list(tables.pop(so_far.table))
    made = []
    for p in design.proposals:
        table = deepcopy(old[so_far.labels.index(_recording(p).trace)])
        for key in OF_FILES:
            table.pop(key, None)
        table["file"] = recorded_as(p)
        table["label"] = f"next{p.rank}"
        made.append(table)
    put(tables, so_far.table, made)
    put(tables, "design", _design_table(design, limits), "the instrument's limits")


def _recording(p: Proposal) -> Recording:
    if p.recording is None:
        raise TypeError(f"no recording: {p!r}")
    return p.recording


def _design_table(design: Design, limits: Limits) -> dict[str, Any]:
    wanted = limits.traces
    table: dict[str, Any] = {
        "target": design.target,
        "criterion": design.criterion,
        "largest": f"{limits.largest_v!r} {design.amplitude_unit}",
        "number": limits.number,
        **written_times(limits),
    }
    if limits.noise_floor_v > 0.0:
        table["noise_floor"] = f"{limits.noise_floor_v!r} {design.amplitude_unit}"
    if wanted is not None:
        spacings = sorted({s for each in wanted.spacings_s.values() for s in each})
        table["traces"] = inline(
            {
                "lengths": [f"{length!r} s" for length in wanted.lengths_s],
                "spacings": [f"{spacing!r} s" for spacing in spacings],
                "samples": wanted.samples,
            }
        )
    return table


def recording_files(
    design: Design, bound: BoundCampaign, command: str, variables: Mapping[str, VariableLike]
) -> dict[str, str | bytes]:
    """A file for each proposed recording, with the heads of its columns and what to do.

    Args:
        design: the proposed recordings.
        bound: campaign, bound to its FMU.
        command: command line that made it, for the record.
        variables: of the FMU, by name: inputs that are recorded have their units.
    """
    so_far = traces_of(bound)
    files: dict[str, str | bytes] = {}
    for p in design.proposals:
        head = [
            f"# {_what(p, design)}",
            "# To be replaced by what the recorder writes, with these columns.",
            f"# Proposed by: {command}",
        ]
        if so_far.record(_recording(p).trace).begin == FOUND:
            head.insert(1, "# Counted from where the free decay begins.")
        columns = csv_line(_columns(p, so_far, variables))
        files[recorded_as(p)] = "\n".join([*head, columns, ""])
    return files


def _columns(p: Proposal, so_far: TracesSoFar, variables: Mapping[str, VariableLike]) -> list[str]:
    record = so_far.record(_recording(p).trace)
    heads = ["time (s)"]
    if not isinstance(record, TraceRecord):
        heads += [f"X ({record.unit})", f"Y ({record.unit})"]
    else:
        heads.append(f"{p.output} ({record.unit})")
        inputs = [name for name, w in record.waveforms.items() if isinstance(w, Recorded)]
        heads += [f"{name} ({variables[name].unit or '1'})" for name in inputs]
    return heads


def _what(p: Proposal, design: Design) -> str:
    """One proposal as an instruction, in plain ASCII."""
    asked = _recording(p)
    factor, unit = prefixed(p.peaks_v[0], design.amplitude_unit)
    like = f"as trace '{asked.trace}'" if asked.trace else "as the trace so far"
    expected = in_its_unit(f"{p.peaks_v[0] / factor:.3g}", unit)
    sigma = in_its_unit(f"{p.expected.mean:.3g}", design.unit)
    said = (
        f"next{p.rank}: {p.output} {like}, {asked.samples} samples every {asked.spacing_s:.9g} s "
        f"over {asked.length_s:.9g} s; expected {expected} at most; "
        f"sigma({design.target}) is then {sigma} on average"
    )
    return said.replace("\u00b5", "u")
