"""A design as a campaign for the laboratory: every setting written, the values to be filled in.

The new campaign is the old one, table by table, but for what is measured, the drift and the limits.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

from fitting.design.candidates import base_settings, frequencies_hz, levels_and_more, recording_of
from fitting.design.limits import SWEEPS, TRACES, Limits, required
from fitting.design.result import Design
from fitting.extension.records import BoundCampaign, Recorded, TimeRecord, Trace
from fitting.extension.report import phrases
from fitting.fmu.description import FmuVariable
from fitting.measurements.time_record import DETECTED
from fitting.text.files import path_from
from fitting.text.tables import csv_line, read_text
from fitting.text.toml import Tables, inline, put, rewritten

CAMPAIGN_NAME, EXPERIMENTS_NAME = "campaign.toml", "experiments.csv"
SWEEP_NAME, SWEEPS_NAME = "sweep", "sweeps.csv"
#: Keys of [drift] that are times of the measurements; of a table of sweeps that describe its file.
TIMES, OF_SWEEPS = ("time", "before_time", "after_time"), ("layout", "range", "columns")
#: Tables of data that are not measured again with sweeps or recordings.
MEASURED_BEFORE = ("experiments", "drift", "sweep")
#: What a CSV file has in place of other signs.
_ASCII = str.maketrans({"\u00a0": " ", "\u00b5": "u", "×": "x", "−": "-", "σ": "sigma"})


def campaign_files(
    design: Design,
    bound: BoundCampaign,
    variables: Mapping[str, FmuVariable],
    limits: Limits,
    folder: Path,
) -> dict[str, str | bytes]:
    """Contents by file name of the folder that the laboratory takes along.

    Args:
        design: the proposed next measurements.
        bound: campaign, bound to its FMU.
        variables: of the FMU, by name.
        limits: what the design may use.
        folder: where they will be written, for the paths between.
    """
    first, *others = (p.settings for p in design.proposals)
    like, fixed = None, {}
    if limits.kind != "tones":
        like = required(bound, SWEEPS if limits.kind == "sweeps" else TRACES)
        # a control quantity of laws that is the same in all proposed sweeps is a constant there
        controls = {n: v for n, v in first.items() if n in bound.setup.laws.controls}
        fixed = {n: v for n, v in controls.items() if all(s[n] == v for s in others)}

    def edit(tables: Tables) -> None:
        tables["title"] = f"Next: {design.title}"
        if "file" in tables["fmu"]:
            named = bound.path.parent / str(tables["fmu"]["file"])
            tables["fmu"]["file"] = path_from(folder, named)
        # other data, which are not measured again
        for name in {*bound.measurements, *(MEASURED_BEFORE if like is not None else ())}:
            if like is None or name != like.table:
                tables.pop(name, None)
        if like is None:
            _edit_for_tones(tables, design, bound, limits)
        elif limits.kind == "sweeps":
            table, units = tables[like.table], like.kind.units
            for key in OF_SWEEPS:
                table.pop(key, None)
            if fixed:
                table["controls"] = [name for name in table["controls"] if name not in fixed]
                plain = ("", "1")
                given = {n: v if units[n] in plain else f"{v} {units[n]}" for n, v in fixed.items()}
                put(tables, "constants", {**tables.get("constants", {}), **given})
            put(table, "file", SWEEPS_NAME, "what to measure: each sweep, point by point")
        else:
            old, made = list(tables.pop(like.table)), []
            for p in design.proposals:
                trace = deepcopy(old[like.labels.index(recording_of(p).trace)])
                trace.pop("columns", None)
                made.append({**trace, "file": f"next{p.rank}.csv", "label": f"next{p.rank}"})
            put(tables, like.table, made)
        put(tables, "design", tomllib.loads("\n".join(stated)), "the instrument's limits")

    tried = {} if limits.sweeps is None else limits.sweeps.controls
    tried = {name: values for name, values in tried.items() if name not in fixed}
    stated = phrases("design/files", "limits", design, limits, tried)
    command = f"Proposed by: {design.provenance['command']}"
    head = [*phrases("design/text", "task", limits.kind), command]
    text = rewritten(read_text(bound.path), edit, head)
    files: dict[str, str | bytes] = {CAMPAIGN_NAME: text}
    if like is None:
        drive, columns = bound.setup.drive, _columns(design, limits)
        base = {
            name: value
            for name, value in base_settings(bound).items()
            if name not in bound.drift.ends and name not in drive.frequency_names
        }
        settings = [
            base | levels_and_more(drive, len(p.tones_hz), p.level, p.settings)
            for p in design.proposals
        ]
        driven = drive.frequency_names[: len(design.proposals[0].tones_hz)]
        quantities = bound.setup.laws.controls
        files[EXPERIMENTS_NAME] = _csv(
            "experiments", design, limits, settings, quantities, driven, *columns
        )
        if bound.sweep is not None:
            files[SWEEP_NAME + bound.sweep.source.suffix] = bound.sweep.source.read_bytes()
    elif limits.kind == "sweeps":
        unit = str(tomllib.loads(text)[like.table].get("amplitude", like.unit)).split()[0]
        points = [frequencies_hz(p) for p in design.proposals]
        files[SWEEPS_NAME] = _csv(
            "sweeps", design, like.columns, unit, like.kind.units, fixed, points
        )
    else:
        for p in design.proposals:
            record = like.records[like.labels.index(recording_of(p).trace)]
            heads = _heads(record, p.output, variables)
            files[f"next{p.rank}.csv"] = _csv(
                "recording", design, p, heads, record.begin == DETECTED
            )
    return files


def _heads(record: TimeRecord, output: str, variables: Mapping[str, FmuVariable]) -> list[str]:
    """Of the columns of a recording: X and Y, or the output and what drives it."""
    if not isinstance(record, Trace):
        return ["time (s)", f"X ({record.unit})", f"Y ({record.unit})"]
    inputs = [name for name, w in record.waveforms.items() if isinstance(w, Recorded)]
    driven = [f"{name} ({variables[name].unit or '1'})" for name in inputs]
    return ["time (s)", f"{output} ({record.unit})", *driven]


def _csv(macro: str, *records: Any) -> str:
    """A file to be filled in, in plain ASCII."""
    lines = phrases("design/files", macro, *records, csv_line)
    return "\n".join([*lines, ""]).translate(_ASCII)


def _columns(design: Design, limits: Limits) -> tuple[list[str], list[str]]:
    """Names of the columns of values that are to be filled in, and of their noise."""
    lines = range(1, len(design.proposals[0].peaks_v) + 1)
    names = ("X", "Y") if limits.phases else ("peak",)
    return [f"{name}_{k}" for name in names for k in lines], [f"sigma_{k}" for k in lines]


def _edit_for_tones(tables: Tables, design: Design, bound: BoundCampaign, limits: Limits) -> None:
    """As many tones as are proposed, read alone but for a design of other lines."""
    if bound.sweep is not None:
        name = SWEEP_NAME + bound.sweep.source.suffix
        put(tables["sweep"], "file", name, "take it anew if the gain has changed")
        tables["sweep"]["use"] = "scale"  # fitted once, in the campaign it was taken for
        tables["sweep"].pop("set_sigma", None)
    drive, source = tables["drive"], bound.setup.drive
    tones = len(design.proposals[0].tones_hz)
    if tones < len(source.frequency_names):
        drive["frequencies"] = list(source.frequency_names[:tones])
        if source.kind == "tones":
            drive["amplitudes"] = list(source.amplitude_names[:tones])
    if not limits.lines:
        drive.pop("read", None)
    values, sigmas = _columns(design, limits)
    columns: dict[str, Any] = {"peaks": values}
    if limits.phases:
        half = len(values) // 2
        columns = {"x": values[:half], "y": values[half:], "unknown": "phase"}
    amplitude = f"{bound.amplitude_unit} peak"
    table = {"file": EXPERIMENTS_NAME, **columns, "peak_sigmas": sigmas, "amplitude": amplitude}
    put(tables, "experiments", table, "what to measure: a row each, with its peaks")
    if bound.drift.ends:
        # what drifts begins where it ended; there are no time stamps yet
        drift = {}
        for name, value in tables["drift"].items():
            if isinstance(value, Mapping):
                drift[name] = inline({"before": value["after"], "after": value["after"]})
            elif name not in TIMES:
                drift[name] = value
        put(tables, "drift", drift, "to be measured before and after these, again")
