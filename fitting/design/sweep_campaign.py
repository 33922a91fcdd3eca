"""Proposed sweeps as part of a campaign: its tables, and a file with the values left open."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fitting.design.candidates import Limits
from fitting.design.continued import continued_of
from fitting.design.result import Design, Proposal
from fitting.design.sweeps import frequencies_hz
from fitting.design.table import written_times
from fitting.extension.records import BoundCampaign
from fitting.text.arrays import Scalar
from fitting.text.csv_cells import csv_line
from fitting.text.notation import hertz, in_its_unit, listed, number, prefixed
from fitting.text.toml import Tables, inline, put

SWEEPS_NAME = "sweeps.csv"
#: Tables of data that are not measured again.
MEASURED_BEFORE = ("experiments", "drift", "sweep")


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
    so_far = continued_of(bound)
    table = tables[so_far.table]
    for key in so_far.of_files:
        table.pop(key, None)
    fixed = constants_of(design, bound)
    if fixed:
        table["controls"] = [name for name in table["controls"] if name not in fixed]
        given = {name: _quantity(value, so_far.units[name]) for name, value in fixed.items()}
        put(tables, "constants", {**tables.get("constants", {}), **given})
    put(table, "file", SWEEPS_NAME, "what to measure: each sweep, point by point")
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
    unit, wanted = continued_of(bound).unit, limits.sweeps
    table: dict[str, Any] = {
        "target": design.target,
        "criterion": design.criterion,
        "centres": [f"{f!r} Hz" for f in limits.centres_hz],
        "relative_noise": limits.relative_noise,
        "largest": f"{limits.largest_v!r} {unit}",
        "number": limits.number,
        **written_times(limits),
    }
    if limits.noise_floor_v > 0.0:
        table["noise_floor"] = f"{limits.noise_floor_v!r} {unit}"
    if wanted is not None:
        fixed = constants_of(design, bound)
        controls = {n: list(values) for n, values in wanted.controls.items() if n not in fixed}
        span = f"{wanted.span_hz!r} Hz"
        table["sweeps"] = inline({"span": span, "points": wanted.points, "controls": controls})
    return table


def sweeps_csv(
    design: Design, bound: BoundCampaign, written: Mapping[str, Any], command: str
) -> str:
    """The points to be measured, a remark before each sweep says what is expected.

    Args:
        design: the proposed sweeps.
        bound: campaign, bound to its FMU.
        written: tables of the campaign that the file belongs to.
        command: command line that made it, for the record.
    """
    so_far = continued_of(bound)
    fixed = constants_of(design, bound)
    names = [name for name in design.proposals[0].settings if name not in fixed]
    heads = [f"{name} ({so_far.units.get(name) or 1})" for name in names]
    open_cells = [""] * len(so_far.columns)
    lines = [
        f"# Next sweeps. {fill_in(bound)}.",
        f"# Proposed by: {command}",
        csv_line([*heads, "frequency (Hz)", *so_far.heads(written[so_far.table])]),
    ]
    for p in design.proposals:
        lines.append(f"# {_what(p, design)}")
        controls = [str(p.settings[name]) for name in names]
        lines += [csv_line([*controls, repr(float(f)), *open_cells]) for f in frequencies_hz(p)]
    return "\n".join(lines) + "\n"


def fill_in(bound: BoundCampaign) -> str:
    """What the laboratory is asked to do with the file.

    Args:
        bound: campaign, bound to its FMU.
    """
    columns = continued_of(bound).columns
    return f"Fill in the column{'s' * (len(columns) > 1)} {listed(columns)}"


def _what(p: Proposal, design: Design) -> str:
    """One proposal as an instruction, in plain ASCII."""
    first, last = p.tones_hz
    factor, unit = prefixed(p.peaks_v[0], design.amplitude_unit)
    controls = ", ".join(f"{name} = {value}" for name, value in p.settings.items())
    expected = in_its_unit(number(p.peaks_v[0] / factor, 3), unit)
    sigma = in_its_unit(number(p.expected.mean, 3), design.unit)
    said = (
        f"next{p.rank}: {p.output} at {controls}, {p.points} points over {hertz(last - first)}; "
        f"expected {expected} at most; sigma({design.target}) is then {sigma} on average"
    )
    return said.replace("\u00a0", " ").replace("\u00b5", "u")
