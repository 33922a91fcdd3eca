"""A design as a campaign for the laboratory: every setting written, the peaks left to be filled in.

The new campaign is the old one, table by table, but for the experiments, the drift and the limits.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fitting.campaign import BoundCampaign, SweepData
from fitting.design.candidates import Limits, base_settings, levels_and_more
from fitting.design.result import Design, Proposal
from fitting.text.arrays import Scalar
from fitting.text.notation import hertz, number, prefixed
from fitting.text.tables import read_text
from fitting.text.toml import read_toml

CAMPAIGN_NAME, EXPERIMENTS_NAME, SWEEP_NAME = "campaign.toml", "experiments.csv", "sweep"
_HEADER = re.compile(r"\s*\[{1,2}\s*([^\[\]]+?)\s*\]{1,2}\s*(#.*)?")
#: Tables that are written anew.
_REPLACED = ("experiments", "drift", "design")
#: How the columns of peaks begin, before their number.
PEAK = "peak_"
#: Tones from here on are written in MHz.
_MEGA = 1e6


def campaign_files(
    design: Design, bound: BoundCampaign, limits: Limits, folder: Path, command: str
) -> dict[str, str | bytes]:
    """Contents by file name of the folder that the laboratory takes along.

    `folder` is where they will be written, for the paths between; `command` is told in their heads.
    """
    files: dict[str, str | bytes] = {
        CAMPAIGN_NAME: _campaign(design, bound, limits, folder, command),
        EXPERIMENTS_NAME: _experiments(design, bound, command),
    }
    if bound.sweep is not None:
        files[_sweep_name(bound.sweep)] = bound.sweep.source.read_bytes()
    return files


def _sweep_name(sweep: SweepData) -> str:
    return SWEEP_NAME + sweep.source.suffix


def _campaign(
    design: Design, bound: BoundCampaign, limits: Limits, folder: Path, command: str
) -> str:
    tables = _tables(read_text(bound.path))
    raw = read_toml(bound.path)
    lines = [
        "# Next measurements, to be made: fill in the peaks of experiments.csv, measure anew what",
        "# drifts, and take the sweep anew if the gain of the detection has changed.",
        f"# Proposed by: {command}",
        f"title = {_toml('Next: ' + design.title)}",
        f"synthetic = {_toml(bound.synthetic)}",
        "",
    ]
    written = False
    for name, block in tables:
        if name.split(".")[0] in _REPLACED:
            continue
        if not written and name not in ("fmu", "fmu.start", "observe", "drive"):
            lines += _new_tables(design, bound, limits, raw)
            written = True
        lines += _adapted(name, block, design, bound, folder)
    if not written:
        lines += _new_tables(design, bound, limits, raw)
    return "\n".join(lines).rstrip("\n") + "\n"


def _tables(text: str) -> list[tuple[str, list[str]]]:
    """The tables of a TOML file with their lines, what stands before the first left out."""
    tables: list[tuple[str, list[str]]] = []
    waiting: list[str] = []
    for line in text.splitlines():
        match = _HEADER.fullmatch(line)
        if match:
            tables.append((match[1], [*waiting, line]))
            waiting = []
        elif line.startswith("#"):
            waiting.append(line)  # a remark in front of a table belongs to that table
        elif tables:
            tables[-1][1].extend([*waiting, line])
            waiting = []
        else:
            waiting = []
    return tables


def _adapted(
    name: str, block: list[str], design: Design, bound: BoundCampaign, folder: Path
) -> list[str]:
    """The lines of a table, what is different in the new campaign put right."""
    values: dict[str, str] = {}
    if name == "fmu" and "file" in read_toml(bound.path)["fmu"]:
        named = bound.path.parent / read_toml(bound.path)["fmu"]["file"]
        values["file"] = _toml(Path(os.path.relpath(named, folder)).as_posix())
    if name == "sweep" and bound.sweep is not None:
        values["file"] = (
            f"{_toml(_sweep_name(bound.sweep))}  # take it anew if the gain has changed"
        )
        values["use"] = '"scale"'  # fitted once, in the campaign that it was taken for
    tones = len(design.proposals[0].tones_hz)
    if name == "drive" and tones < len(bound.setup.drive.frequencies):
        values["frequencies"] = _toml(bound.setup.drive.frequencies[:tones])
        values["amplitudes"] = _toml(bound.setup.drive.amplitudes[:tones])
    changed = []
    for line in block:
        match = re.match(r"\s*(\w+)\s*=", line)
        known = match is not None and match[1] in values
        changed.append(f"{match[1]} = {values[match[1]]}" if match and known else line)
    return changed


def _new_tables(
    design: Design, bound: BoundCampaign, limits: Limits, raw: Mapping[str, Any]
) -> list[str]:
    peaks = range(len(design.proposals[0].peaks_v))
    lines = [
        "[experiments]                      # what to measure: a row each, with its peaks",
        f'file = "{EXPERIMENTS_NAME}"',
        f"peaks = {_toml([_peak(k) for k in peaks])}",
        f"peak_sigmas = {_toml([_sigma(k) for k in peaks])}",
        f"amplitude = {_toml(bound.amplitude_unit + ' peak')}",
        "",
    ]
    return lines + _drift(bound, raw) + _design(design, bound, limits)


def _peak(index: int) -> str:
    return f"{PEAK}{index + 1}"


def _sigma(index: int) -> str:
    return f"sigma_{index + 1}"


def _drift(bound: BoundCampaign, raw: Mapping[str, Any]) -> list[str]:
    if not bound.drift.ends:
        return []
    lines = ["[drift]                            # to be measured before and after these, again"]
    for key, value in raw.get("drift", {}).items():
        if key not in bound.drift.ends and key != "time" and not isinstance(value, dict):
            lines.append(f"{key} = {_toml(value)}")
    for name in bound.drift.ends:
        after = raw["drift"][name]["after"]
        lines.append(f"{name} = {{ before = {_toml(after)}, after = {_toml(after)} }}")
    return [*lines, ""]


def _design(design: Design, bound: BoundCampaign, limits: Limits) -> list[str]:
    """The limits, so that the design after this one, and a virtual laboratory, know them."""
    unit = bound.amplitude_unit
    values: dict[str, Any] = {
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
        "largest": f"{limits.largest_v!r} {unit}",
        "number": limits.number,
        "averaged": [p.repeats for p in design.proposals],
    }
    if limits.noise_floor_v == 0.0:
        del values["noise_floor"]
    lines = [
        "[design]                           # the instrument's limits; spectra averaged per row"
    ]
    lines += [f"{key} = {_toml(value)}" for key, value in values.items()]
    for name, table in (("settings", limits.settings), ("setting_sigma", limits.setting_sigmas)):
        if table:
            lines += ["", f"[design.{name}]"]
            lines += [f"{key} = {_toml(v)}" for key, v in table.items()]
    return [*lines, ""]


def _experiments(design: Design, bound: BoundCampaign, command: str) -> str:
    """The rows to be measured; remarks between them say what, how often and what is expected."""
    drive = bound.setup.drive
    factor, unit = _amplitudes(design)
    mega = min(f for p in design.proposals for f in p.tones_hz) >= _MEGA
    columns = {
        name: value
        for name, value in base_settings(bound).items()
        if name not in bound.drift.ends and name not in drive.frequencies
    }
    first = design.proposals[0]
    columns |= levels_and_more(bound, len(first.tones_hz), 1.0, first.settings)
    hertz_unit = "MHz" if mega else "Hz"
    driven = drive.frequencies[: len(first.tones_hz)]
    head = ["experiment", *(f"{name} ({hertz_unit})" for name in driven), "output", *columns]
    head += [f"{_peak(k)} ({unit})" for k in range(len(first.peaks_v))]
    head += [f"{_sigma(k)} ({unit})" for k in range(len(first.peaks_v))]
    lines = [
        "# Next measurements. Fill in the columns peak_*; replace sigma_* by what you find.",
        f"# Proposed by: {command}",
        ",".join(head),
    ]
    for p in design.proposals:
        settings = {**columns, **levels_and_more(bound, len(p.tones_hz), p.level, p.settings)}
        tones = [repr(f / _MEGA if mega else f) for f in p.tones_hz]
        cells = [f"next{p.rank}", *tones, p.output, *map(_cell, settings.values())]
        cells += ["" for _ in p.peaks_v]
        cells += [f"{s / factor:.4g}" for s in p.sigmas_v]
        lines += [f"# {_what(p, design)}", ",".join(cells)]
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
    peaks = " and ".join(f"{number(a / factor, 3)}" for a in p.peaks_v) + f" {unit}"
    spectra = "one spectrum" if p.repeats == 1 else f"average {p.repeats} spectra"
    offsets = " and ".join(f"{f - p.centre_hz:+.4g}" for f in p.tones_hz)
    return (
        f"next{p.rank}: {p.output}, {spectra}, drive level x {p.level:g}, tones {offsets} Hz from "
        f"{hertz(p.centre_hz)}; expected {peaks}; sigma({design.target}) is then "
        f"{number(p.expected.mean, 3)} {design.unit} on average"
    ).replace("\u00a0", " ")


def _cell(value: Scalar) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, float) else str(value)


def _toml(value: Any) -> str:
    """A scalar or a list of scalars as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml(v) for v in value) + "]"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)
