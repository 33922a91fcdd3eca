"""A design as a campaign for the laboratory: every setting written, the peaks left to be filled in.

The new campaign is the old one, table by table, but for the experiments, the drift and the limits.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fitting import Drive
from fitting.campaign import SweepData
from fitting.design.candidates import Limits, base_settings, levels_and_more
from fitting.design.continued import continued_of
from fitting.design.recordings import traces_of
from fitting.design.result import Design, Proposal
from fitting.design.sweep_campaign import SWEEPS_NAME, edit_for_sweeps, fill_in, sweeps_csv
from fitting.design.table import written_times
from fitting.design.trace_campaign import edit_for_traces, recording_files
from fitting.extension.records import BoundCampaign
from fitting.fmu.variables import VariableLike
from fitting.text.arrays import Scalar
from fitting.text.csv_cells import csv_line
from fitting.text.files import path_from
from fitting.text.notation import hertz, in_its_unit, number, prefixed
from fitting.text.tables import read_text
from fitting.text.toml import Tables, inline, put, rewritten

CAMPAIGN_NAME, EXPERIMENTS_NAME, SWEEP_NAME = "campaign.toml", "experiments.csv", "sweep"
#: Keys of [drift] that tell times of the measurements.
TIMES = ("time", "before_time", "after_time")
#: How the columns of peaks begin, before their number.
PEAK = "peak_"
#: Tones from here on are written in MHz.
_MEGA = 1e6


def campaign_files(
    design: Design,
    bound: BoundCampaign,
    variables: Mapping[str, VariableLike],
    limits: Limits,
    folder: Path,
    command: str,
) -> dict[str, str | bytes]:
    """Contents by file name of the folder that the laboratory takes along.

    `folder` is where they will be written, for the paths between; `command` is told in their heads.

    Args:
        design: the proposed next measurement.
        bound: campaign, bound to its FMU.
        variables: of the FMU, by name.
        limits: what the design may use.
        folder: where the files go.
        command: command line that made it, for the record.
    """
    text = _campaign(design, bound, limits, folder, command)
    if limits.sweeps is not None:
        written = tomllib.loads(text)
        return {CAMPAIGN_NAME: text, SWEEPS_NAME: sweeps_csv(design, bound, written, command)}
    if limits.traces is not None:
        return {CAMPAIGN_NAME: text, **recording_files(design, bound, command, variables)}
    files: dict[str, str | bytes] = {
        CAMPAIGN_NAME: text,
        EXPERIMENTS_NAME: _experiments(design, bound, limits, command),
    }
    if bound.sweep is not None:
        files[_sweep_name(bound.sweep)] = bound.sweep.source.read_bytes()
    return files


def _sweep_name(sweep: SweepData) -> str:
    return SWEEP_NAME + sweep.source.suffix


def _campaign(
    design: Design, bound: BoundCampaign, limits: Limits, folder: Path, command: str
) -> str:
    """The campaign's own text, what is different in the new one put right."""

    def edit(tables: Tables) -> None:
        tables["title"] = f"Next: {design.title}"
        if "file" in tables["fmu"]:
            named = bound.path.parent / str(tables["fmu"]["file"])
            tables["fmu"]["file"] = path_from(folder, named)
        kept = _kept_table(bound, limits)
        for name in bound.measurements:
            if name != kept:
                tables.pop(name, None)  # other data, which are not measured again
        if limits.sweeps is not None:
            edit_for_sweeps(tables, design, bound, limits)
            return
        if limits.traces is not None:
            edit_for_traces(tables, design, bound, limits)
            return
        if bound.sweep is not None:
            name = _sweep_name(bound.sweep)
            put(tables["sweep"], "file", name, "take it anew if the gain has changed")
            tables["sweep"]["use"] = "scale"  # fitted once, in the campaign it was taken for
            tables["sweep"].pop("set_sigma", None)
        _edit_drive(tables["drive"], design, bound.setup.drive, limits)
        what = "what to measure: a row each, with its peaks"
        put(tables, "experiments", _experiments_table(design, bound, limits), what)
        if bound.drift.ends:
            drift = _drift_table(tables["drift"])
            put(tables, "drift", drift, "to be measured before and after these, again")
        what = "the instrument's limits; spectra averaged per row"
        put(tables, "design", _design_table(design, bound, limits), what)

    head = [
        "Next measurements, to be made: fill in the peaks of experiments.csv, measure anew what",
        "drifts, and take the sweep anew if the gain of the detection has changed.",
    ]
    if limits.sweeps is not None:
        head = [f"Next sweeps, to be made. {fill_in(bound)} of {SWEEPS_NAME}."]
    if limits.traces is not None:
        head = ["Next recordings, to be made: put each in the place of its file."]
    return rewritten(read_text(bound.path), edit, [*head, f"Proposed by: {command}"])


def _kept_table(bound: BoundCampaign, limits: Limits) -> str:
    """The table of a kind of its own whose measurements are continued; none: empty."""
    if limits.traces is not None:
        return traces_of(bound).table
    return "" if limits.sweeps is None else continued_of(bound).table


def _edit_drive(drive: Tables, design: Design, source: Drive, limits: Limits) -> None:
    """As many tones as are proposed; the tones alone are read, but for a design of other lines."""
    tones = len(design.proposals[0].tones_hz)
    if tones < len(source.frequency_names):
        drive["frequencies"] = list(source.frequency_names[:tones])
        if source.kind == "tones":
            drive["amplitudes"] = list(source.amplitude_names[:tones])
    if not limits.lines:
        drive.pop("read", None)


def _experiments_table(design: Design, bound: BoundCampaign, limits: Limits) -> dict[str, Any]:
    peaks = range(len(design.proposals[0].peaks_v))
    columns: dict[str, Any] = {"peaks": [_peak(k) for k in peaks]}
    if limits.phases:
        columns = {"x": [f"X_{k + 1}" for k in peaks], "y": [f"Y_{k + 1}" for k in peaks]}
    table = {
        "file": EXPERIMENTS_NAME,
        **columns,
        "peak_sigmas": [_sigma(k) for k in peaks],
        "amplitude": f"{bound.amplitude_unit} peak",
    }
    return {**table, "unknown": "phase"} if limits.phases else table


def _peak(index: int) -> str:
    return f"{PEAK}{index + 1}"


def _measured_columns(design: Design, limits: Limits) -> list[str]:
    """Heads of the columns that the laboratory fills in."""
    peaks = range(len(design.proposals[0].peaks_v))
    if limits.phases:
        return [f"{name}_{k + 1}" for name in ("X", "Y") for k in peaks]
    return [_peak(k) for k in peaks]


def _sigma(index: int) -> str:
    return f"sigma_{index + 1}"


def _drift_table(old: Mapping[str, Any]) -> dict[str, Any]:
    """What drifts begins where it ended; there are no time stamps yet."""
    settings = {k: v for k, v in old.items() if not isinstance(v, Mapping) and k not in TIMES}
    ends = {name: both["after"] for name, both in old.items() if isinstance(both, Mapping)}
    return settings | {
        name: inline({"before": after, "after": after}) for name, after in ends.items()
    }


def _design_table(design: Design, bound: BoundCampaign, limits: Limits) -> dict[str, Any]:
    """The limits, so that the design after this one, and a virtual laboratory, know them."""
    unit = bound.amplitude_unit
    table: dict[str, Any] = {
        "target": design.target,
        "criterion": design.criterion,
        "outputs": list(limits.outputs),
        "centres": [f"{f!r} Hz" for f in limits.centres_hz],
        "frequency_step": f"{limits.frequency_step_hz!r} Hz",
        "least_spacing": f"{limits.least_spacing_hz!r} Hz",
        "farthest": f"{limits.farthest_hz!r} Hz",
        "both_sides": limits.both_sides,
        "tones": limits.tones,
        "levels": list(limits.levels),
        "repeats": list(limits.repeats),
        "noise_floor": f"{limits.noise_floor_v!r} {unit}",
        "relative_noise": limits.relative_noise,
        "phases": limits.phases,
        "largest": f"{limits.largest_v!r} {unit}",
        "number": limits.number,
        **written_times(limits),
        "averaged": [p.repeats for p in design.proposals],
    }
    if limits.noise_floor_v == 0.0:
        del table["noise_floor"]
    if limits.settings:
        table["settings"] = {name: list(values) for name, values in limits.settings.items()}
    if limits.setting_sigmas:
        table["setting_sigma"] = dict(limits.setting_sigmas)
    return table


def _experiments(design: Design, bound: BoundCampaign, limits: Limits, command: str) -> str:
    """The rows to be measured; remarks between them say what, how often and what is expected."""
    drive = bound.setup.drive
    factor, unit = _amplitudes(design)
    mega = min(f for p in design.proposals for f in p.tones_hz) >= _MEGA
    columns = {
        name: value
        for name, value in base_settings(bound).items()
        if name not in bound.drift.ends and name not in drive.frequency_names
    }
    first = design.proposals[0]
    columns |= levels_and_more(drive, len(first.tones_hz), 1.0, first.settings)
    hertz_unit = "MHz" if mega else "Hz"
    driven = drive.frequency_names[: len(first.tones_hz)]
    head = ["experiment", *(f"{name} ({hertz_unit})" for name in driven), "output"]
    units = bound.setup.laws.controls
    head += [f"{name} ({units[name]})" if name in units else name for name in columns]
    filled = _measured_columns(design, limits)
    head += [f"{name} ({unit or 1})" for name in filled]
    head += [f"{_sigma(k)} ({unit or 1})" for k in range(len(first.peaks_v))]
    lines = [
        f"# Next measurements. Fill in the columns {'X_* and Y_*' if limits.phases else 'peak_*'}; "
        "replace sigma_* by what you find.",
        f"# Proposed by: {command}",
        csv_line(head),
    ]
    for p in design.proposals:
        settings = {**columns, **levels_and_more(drive, len(p.tones_hz), p.level, p.settings)}
        tones = [repr(f / _MEGA if mega else f) for f in p.tones_hz]
        cells = [f"next{p.rank}", *tones, p.output, *map(_cell, settings.values())]
        cells += ["" for _ in filled]
        cells += [f"{s / factor:.4g}" for s in p.sigmas_v]
        lines += [f"# {_what(p, design)}", csv_line(cells)]
    return "\n".join(lines) + "\n"


def _amplitudes(design: Design) -> tuple[float, str]:
    """Unit of the amplitudes in the file, with a prefix that suits them, and its factor."""
    factor, unit = prefixed(
        min(a for p in design.proposals for a in p.peaks_v), design.amplitude_unit
    )
    return factor, unit.replace("\u00b5", "u")


def _what(p: Proposal, design: Design) -> str:
    """One proposal as an instruction, in plain ASCII."""
    factor, unit = _amplitudes(design)
    peaks = in_its_unit(" and ".join(number(a / factor, 3) for a in p.peaks_v), unit)
    sigma = in_its_unit(number(p.expected.mean, 3), design.unit)
    spectra = "one spectrum" if p.repeats == 1 else f"average {p.repeats} spectra"
    offsets = " and ".join(f"{f - p.centre_hz:+.4g}" for f in p.tones_hz)
    return (
        f"next{p.rank}: {p.output}, {spectra}, drive level x {p.level:g}, tones {offsets} Hz from "
        f"{hertz(p.centre_hz)}; expected {peaks}; sigma({design.target}) is then {sigma} on average"
    ).replace("\u00a0", " ")


def _cell(value: Scalar) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, float) else str(value)
