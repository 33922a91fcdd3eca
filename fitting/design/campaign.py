"""A design as a campaign for the laboratory: every setting written, the values to be filled in.

The new campaign is the old one, table by table, but for what is measured, the drift and the limits.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

from fitting import Drive
from fitting.design.continued import SWEEPS, TRACES, Continued, required
from fitting.design.limits import Limits
from fitting.design.recordings import recording_of
from fitting.design.result import Design
from fitting.design.sweeps import frequencies_hz
from fitting.design.tones import base_settings, levels_and_more
from fitting.extension.records import BoundCampaign, Recorded, TimeRecord, TraceRecord
from fitting.extension.report import phrase, phrases
from fitting.fmu.description import FmuVariable
from fitting.measurements.time_record import DETECTED
from fitting.text.arrays import Scalar
from fitting.text.files import path_from
from fitting.text.notation import prefixed
from fitting.text.tables import csv_line, read_text
from fitting.text.toml import Tables, inline, put, rewritten

CAMPAIGN_NAME, EXPERIMENTS_NAME = "campaign.toml", "experiments.csv"
SWEEP_NAME, SWEEPS_NAME = "sweep", "sweeps.csv"
#: Keys of [drift] that are times of the measurements; of a table of sweeps that describe its file.
TIMES, OF_SWEEPS = ("time", "before_time", "after_time"), ("layout", "range", "columns")
#: Tables of data that are not measured again with sweeps or recordings.
MEASURED_BEFORE = ("experiments", "drift", "sweep")
#: Tones from here on are written in MHz.
_MEGA = 1e6
#: What remarks of a CSV file have in place of other signs.
_ASCII = str.maketrans({"\u00a0": " ", "\u00b5": "u", "×": "x", "−": "-", "σ": "sigma"})


def campaign_files(
    design: Design,
    bound: BoundCampaign,
    variables: Mapping[str, FmuVariable],
    limits: Limits,
    folder: Path,
    command: str,
) -> dict[str, str | bytes]:
    """Contents by file name of the folder that the laboratory takes along.

    Args:
        design: the proposed next measurements.
        bound: campaign, bound to its FMU.
        variables: of the FMU, by name.
        limits: what the design may use.
        folder: where they will be written, for the paths between.
        command: command line that made it, for the record.
    """
    sweep_file = "" if bound.sweep is None else SWEEP_NAME + bound.sweep.source.suffix
    kind = "tones" if limits.sweeps is None else "sweeps"
    kind = kind if limits.traces is None else "traces"
    like = None if kind == "tones" else required(bound, SWEEPS if kind == "sweeps" else TRACES)

    def edit(tables: Tables) -> None:
        tables["title"] = f"Next: {design.title}"
        if "file" in tables["fmu"]:
            named = bound.path.parent / str(tables["fmu"]["file"])
            tables["fmu"]["file"] = path_from(folder, named)
        # other data, which are not measured again
        others = {*bound.measurements, *(MEASURED_BEFORE if like is not None else ())}
        for name in others - {like.table if like is not None else ""}:
            tables.pop(name, None)
        if like is None:
            _edit_for_tones(tables, design, bound, limits, sweep_file)
        elif kind == "sweeps":
            _edit_for_sweeps(tables, design, bound, like)
        else:
            _edit_for_traces(tables, design, like)
        put(tables, "design", _limits_table(design, bound, limits), "the instrument's limits")

    head = [*phrases("design/text", "task", kind), f"Proposed by: {command}"]
    text = rewritten(read_text(bound.path), edit, head)
    files: dict[str, str | bytes] = {CAMPAIGN_NAME: text}
    if like is None:
        files[EXPERIMENTS_NAME] = _experiments_csv(design, bound, limits, command)
        if bound.sweep is not None:
            files[sweep_file] = bound.sweep.source.read_bytes()
    elif kind == "sweeps":
        unit = str(tomllib.loads(text)[like.table].get("amplitude", like.unit)).split()[0]
        files[SWEEPS_NAME] = _sweeps_csv(design, bound, like, unit, command)
    else:
        files |= _recording_files(design, like, command, variables)
    return files


def _edit_for_tones(
    tables: Tables, design: Design, bound: BoundCampaign, limits: Limits, sweep_file: str
) -> None:
    """As many tones as are proposed, read alone but for a design of other lines."""
    if bound.sweep is not None:
        put(tables["sweep"], "file", sweep_file, "take it anew if the gain has changed")
        tables["sweep"]["use"] = "scale"  # fitted once, in the campaign it was taken for
        tables["sweep"].pop("set_sigma", None)
    first, drive, source = design.proposals[0], tables["drive"], bound.setup.drive
    tones = len(first.tones_hz)
    if tones < len(source.frequency_names):
        drive["frequencies"] = list(source.frequency_names[:tones])
        if source.kind == "tones":
            drive["amplitudes"] = list(source.amplitude_names[:tones])
    if not limits.lines:
        drive.pop("read", None)
    peaks = range(1, len(first.peaks_v) + 1)
    columns: dict[str, Any] = {"peaks": [f"peak_{k}" for k in peaks]}
    if limits.phases:
        columns = {name.lower(): [f"{name}_{k}" for k in peaks] for name in ("X", "Y")}
    table = {
        "file": EXPERIMENTS_NAME,
        **columns,
        "peak_sigmas": [f"sigma_{k}" for k in peaks],
        "amplitude": f"{bound.amplitude_unit} peak",
        **({"unknown": "phase"} if limits.phases else {}),
    }
    put(tables, "experiments", table, "what to measure: a row each, with its peaks")
    if bound.drift.ends:
        # what drifts begins where it ended; there are no time stamps yet
        old = tables["drift"]
        drift = {k: v for k, v in old.items() if not isinstance(v, Mapping) and k not in TIMES}
        for name, both in old.items():
            if isinstance(both, Mapping):
                drift[name] = inline({"before": both["after"], "after": both["after"]})
        put(tables, "drift", drift, "to be measured before and after these, again")


def _edit_for_sweeps(tables: Tables, design: Design, bound: BoundCampaign, like: Continued) -> None:
    table, fixed = tables[like.table], _constants(design, bound)
    for key in OF_SWEEPS:
        table.pop(key, None)
    if fixed:
        table["controls"] = [name for name in table["controls"] if name not in fixed]
        units = like.kind.units
        given = {n: f"{v} {u}" if (u := units[n]) not in ("", "1") else v for n, v in fixed.items()}
        put(tables, "constants", {**tables.get("constants", {}), **given})
    put(table, "file", SWEEPS_NAME, "what to measure: each sweep, point by point")


def _edit_for_traces(tables: Tables, design: Design, like: Continued) -> None:
    old, made = list(tables.pop(like.table)), []
    for p in design.proposals:
        table = deepcopy(old[like.labels.index(recording_of(p).trace)])
        for key in ("columns", "label"):
            table.pop(key, None)
        made.append({**table, "file": f"next{p.rank}.csv", "label": f"next{p.rank}"})
    put(tables, like.table, made)


def _constants(design: Design, bound: BoundCampaign) -> dict[str, Scalar]:
    """Control quantities of laws that are the same in all proposed sweeps: constants there."""
    first, *others = (p.settings for p in design.proposals)
    quantities = bound.setup.laws.controls
    return {
        name: value
        for name, value in first.items()
        if name in quantities and all(s[name] == value for s in others)
    }


def _limits_table(design: Design, bound: BoundCampaign, limits: Limits) -> dict[str, Any]:
    """The limits, so that the design after this one, and a virtual laboratory, know them."""
    unit = design.amplitude_unit
    table: dict[str, Any] = {"target": design.target, "criterion": design.criterion}
    if limits.traces is None:
        table["centres"] = [f"{f!r} Hz" for f in limits.centres_hz]
        table["relative_noise"] = limits.relative_noise
    table |= {"largest": f"{limits.largest_v!r} {unit}", "number": limits.number}
    if limits.noise_floor_v > 0.0:
        table["noise_floor"] = f"{limits.noise_floor_v!r} {unit}"
    if limits.time_s is not None:
        table |= {
            "time": f"{limits.time_s!r} s",
            "spectrum_time": f"{limits.spectrum_s!r} s",
            "point_time": f"{limits.point_s!r} s",
            "change_time": f"{limits.change_s!r} s",
        }
    sweeps, traces = limits.sweeps, limits.traces
    if sweeps is not None:
        fixed = _constants(design, bound)
        controls = {n: list(values) for n, values in sweeps.controls.items() if n not in fixed}
        span = f"{sweeps.span_hz!r} Hz"
        table["sweeps"] = inline({"span": span, "points": sweeps.points, "controls": controls})
    elif traces is not None:
        spacings = sorted({s for each in traces.spacings_s.values() for s in each})
        lengths = [f"{length!r} s" for length in traces.lengths_s]
        spaced = [f"{spacing!r} s" for spacing in spacings]
        parts = {"lengths": lengths, "spacings": spaced, "samples": traces.samples}
        table["traces"] = inline(parts)
    else:
        table |= {
            "outputs": list(limits.outputs),
            "frequency_step": f"{limits.frequency_step_hz!r} Hz",
            "least_spacing": f"{limits.least_spacing_hz!r} Hz",
            "farthest": f"{limits.farthest_hz!r} Hz",
            "both_sides": limits.both_sides,
            "tones": limits.tones,
            "levels": list(limits.levels),
            "repeats": list(limits.repeats),
            "phases": limits.phases,
            "averaged": [p.repeats for p in design.proposals],
        }
        if limits.settings:
            table["settings"] = {name: list(values) for name, values in limits.settings.items()}
        if limits.setting_sigmas:
            table["setting_sigma"] = dict(limits.setting_sigmas)
    return table


# --- files to be filled in ----------------------------------------------------------------------


def _remark(macro: str, *records: Any) -> str:
    """A line of remark of a CSV file, in plain ASCII."""
    return "# " + phrase("design/text", macro, *records).translate(_ASCII)


def _experiments_csv(design: Design, bound: BoundCampaign, limits: Limits, command: str) -> str:
    """The rows to be measured; remarks between them state what, how often and what is expected."""
    drive: Drive = bound.setup.drive
    first, controls = design.proposals[0], bound.setup.laws.controls
    factor, unit = prefixed(
        min(a for p in design.proposals for a in p.peaks_v), design.amplitude_unit
    )
    unit = unit.translate(_ASCII) or "1"
    mega = min(f for p in design.proposals for f in p.tones_hz) >= _MEGA
    settings = {
        name: value
        for name, value in base_settings(bound).items()
        if name not in bound.drift.ends and name not in drive.frequency_names
    }
    settings |= levels_and_more(drive, len(first.tones_hz), 1.0, first.settings)
    peaks = range(1, len(first.peaks_v) + 1)
    open_ = [f"peak_{k}" for k in peaks]
    if limits.phases:
        open_ = [f"{name}_{k}" for name in ("X", "Y") for k in peaks]
    driven = drive.frequency_names[: len(first.tones_hz)]
    head = [
        "experiment",
        *(f"{name} ({'MHz' if mega else 'Hz'})" for name in driven),
        "output",
        *(f"{name} ({controls[name]})" if name in controls else name for name in settings),
        *(f"{name} ({unit})" for name in (*open_, *(f"sigma_{k}" for k in peaks))),
    ]
    lines = [_remark("fill_in_peaks", limits.phases), f"# Proposed by: {command}", csv_line(head)]
    for p in design.proposals:
        own = {**settings, **levels_and_more(drive, len(p.tones_hz), p.level, p.settings)}
        tones = [repr(f / _MEGA if mega else f) for f in p.tones_hz]
        sigmas = [f"{s / factor:.4g}" for s in p.sigmas_v]
        values = [
            str(v).lower() if isinstance(v, bool) else repr(v) if isinstance(v, float) else str(v)
            for v in own.values()
        ]
        cells = [f"next{p.rank}", *tones, p.output, *values]
        lines += [
            _remark("instruction", p, design),
            csv_line([*cells, *[""] * len(open_), *sigmas]),
        ]
    return "\n".join(lines) + "\n"


def _sweeps_csv(
    design: Design, bound: BoundCampaign, like: Continued, unit: str, command: str
) -> str:
    """The points to be measured, a remark before each sweep states what is expected."""
    fixed = _constants(design, bound)
    names = [name for name in design.proposals[0].settings if name not in fixed]
    units = like.kind.units
    heads = [*(f"{name} ({units.get(name) or 1})" for name in names), "frequency (Hz)"]
    heads += [f"{name} ({unit})" for name in like.columns]
    lines = [_remark("fill_in", like.columns), f"# Proposed by: {command}", csv_line(heads)]
    for p in design.proposals:
        lines.append(_remark("instruction", p, design))
        controls = [str(p.settings[name]) for name in names]
        empty = [""] * len(like.columns)
        lines += [csv_line([*controls, repr(float(f)), *empty]) for f in frequencies_hz(p)]
    return "\n".join(lines) + "\n"


def _recording_files(
    design: Design, like: Continued, command: str, variables: Mapping[str, FmuVariable]
) -> dict[str, str | bytes]:
    """A file for each proposed recording, with the heads of its columns and what to do."""
    files: dict[str, str | bytes] = {}
    for p in design.proposals:
        record: TimeRecord = like.record(recording_of(p).trace)
        heads = ["time (s)", f"X ({record.unit})", f"Y ({record.unit})"]
        if isinstance(record, TraceRecord):
            inputs = [name for name, w in record.waveforms.items() if isinstance(w, Recorded)]
            heads = ["time (s)", f"{p.output} ({record.unit})"]
            heads += [f"{name} ({variables[name].unit or '1'})" for name in inputs]
        lines = [_remark("instruction", p, design)]
        lines += [_remark("from_decay")] if record.begin == DETECTED else []
        lines += [_remark("replaced"), f"# Proposed by: {command}", csv_line(heads), ""]
        files[f"next{p.rank}.csv"] = "\n".join(lines)
    return files
