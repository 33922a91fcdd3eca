"""Proposed sweeps as part of a campaign: its tables, and a file with the amplitudes left open."""

from __future__ import annotations

from typing import Any

from fitting.campaign import BoundCampaign
from fitting.design.candidates import DriveChoice, Limits
from fitting.design.result import Design, Proposal
from fitting.design.sweeps import control_sweep_of, frequencies_hz
from fitting.text.arrays import Scalar
from fitting.text.notation import hertz, number, prefixed
from fitting.text.toml import Tables, inline, put

SWEEPS_NAME = "sweeps.csv"
#: Tables of data that are not measured again.
MEASURED_BEFORE = ("experiments", "drift", "sweep")
#: Keys of [control_sweep] that tell of the files measured before.
OF_FILES = ("layout", "range")


def edit_for_sweeps(tables: Tables, design: Design, bound: BoundCampaign, limits: Limits) -> None:
    """Put the campaign's tables right for new sweeps, its other data left out.

    Args:
        tables: of the campaign's text.
        design: the proposed sweeps.
        bound: campaign, bound to its FMU.
        limits: what the design may use.
    """
    for name in MEASURED_BEFORE:
        tables.pop(name, None)
    table = tables["control_sweep"]
    for key in OF_FILES:
        table.pop(key, None)
    fixed = constants_of(design, bound)
    if fixed:
        table["controls"] = [name for name in table["controls"] if name not in fixed]
        units = control_sweep_of(bound).units
        given = {name: _quantity(value, units[name]) for name, value in fixed.items()}
        put(tables, "constants", {**tables.get("constants", {}), **given})
    put(table, "file", SWEEPS_NAME, "what to measure: a sweep each, with its amplitudes")
    what = "the instrument's limits"
    put(tables, "design", _design_table(design, bound, limits), what)


def constants_of(design: Design, bound: BoundCampaign) -> dict[str, Scalar]:
    """Control quantities of laws that are the same in all proposed sweeps: constants there.

    Args:
        design: the proposed sweeps.
        bound: campaign, bound to its FMU.
    """
    first, *others = (p.settings for p in design.proposals)
    quantities = bound.setup.laws.controls
    return {
        name: value
        for name, value in first.items()
        if name in quantities and all(s[name] == value for s in others)
    }


def _quantity(value: Scalar, unit: str) -> Scalar:
    return value if unit in ("", "1") else f"{value} {unit}"


def _design_table(design: Design, bound: BoundCampaign, limits: Limits) -> dict[str, Any]:
    unit, wanted = control_sweep_of(bound).unit, limits.sweeps
    table: dict[str, Any] = {
        "target": design.target,
        "criterion": design.criterion,
        "centres": [f"{f!r} Hz" for f in limits.centres_hz],
        "relative_noise": limits.relative_noise,
        "largest": f"{limits.largest_v!r} {unit}",
        "number": limits.number,
    }
    if limits.noise_floor_v > 0.0:
        table["noise_floor"] = f"{limits.noise_floor_v!r} {unit}"
    if wanted is not None:
        fixed = constants_of(design, bound)
        controls = {n: list(values) for n, values in wanted.controls.items() if n not in fixed}
        span = f"{wanted.span_hz!r} Hz"
        table["sweeps"] = inline({"span": span, "points": wanted.points, "controls": controls})
    return table


def sweeps_csv(design: Design, bound: BoundCampaign, amplitude: str, command: str) -> str:
    """The points to be measured, a remark before each sweep says what is expected.

    Args:
        design: the proposed sweeps.
        bound: campaign, bound to its FMU.
        amplitude: unit of the amplitudes in the file.
        command: command line that made it, for the record.
    """
    units = control_sweep_of(bound).units
    fixed = constants_of(design, bound)
    names = [name for name in design.proposals[0].settings if name not in fixed]
    heads = [f"{name} ({units.get(name) or 1})" for name in names]
    lines = [
        "# Next sweeps. Fill in the column amplitude.",
        f"# Proposed by: {command}",
        ",".join([*heads, "frequency (Hz)", f"amplitude ({amplitude})"]),
    ]
    for p in design.proposals:
        lines.append(f"# {_what(p, design)}")
        controls = [str(p.settings[name]) for name in names]
        lines += [",".join([*controls, repr(float(f)), ""]) for f in _frequencies(p)]
    return "\n".join(lines) + "\n"


def _frequencies(p: Proposal) -> list[float]:
    choice = DriveChoice(
        centre_hz=p.centre_hz,
        tones_hz=p.tones_hz,
        output=p.output,
        level=p.level,
        settings=p.settings,
        points=p.points,
    )
    return list(map(float, frequencies_hz(choice)))


def _what(p: Proposal, design: Design) -> str:
    """One proposal as an instruction, in plain ASCII."""
    first, last = p.tones_hz
    factor, unit = prefixed(p.peaks_v[0], design.amplitude_unit)
    controls = ", ".join(f"{name} = {value}" for name, value in p.settings.items())
    said = (
        f"next{p.rank}: {p.output} at {controls}, {p.points} points over {hertz(last - first)}; "
        f"expected {number(p.peaks_v[0] / factor, 3)} {unit} at most; sigma({design.target}) is "
        f"then {number(p.expected.mean, 3)} {design.unit} on average"
    )
    return said.replace("\u00a0", " ").replace("\u00b5", "u")
