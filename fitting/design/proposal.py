"""Chosen candidates as a design, and what is printed of it: numbers, assumptions, screen, page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from fitting.design.continued import SWEEPS, TRACES, required
from fitting.design.result import Design, DriveChoice, Kind, PlacePoint, Proposal, Ways
from fitting.design.weighing import Goal, Weighed, expected_of
from fitting.extension.problem import canonical, to_model
from fitting.extension.records import BoundCampaign
from fitting.extension.report import (
    Figure,
    Table,
    phrase,
    phrases,
    printed_lines,
    table,
    write_page,
)
from fitting.measurements.control_sweep import ControlSweep
from fitting.text.errors import BadInput

#: A factor on the error that is useful in any case; a share of the usual factor that is none.
HELPFUL, LITTLE = 3.0, 0.3


def proposed(
    bound: BoundCampaign,
    weighed: Weighed,
    goal: Goal,
    unit: str,
    provenance: Mapping[str, str],
    *,
    is_given: bool = False,
) -> Design:
    """The design of chosen candidates.

    Args:
        bound: the campaign that is to be continued.
        weighed: the candidates, with those that are chosen.
        goal: the target and the criterion.
        unit: of the target.
        provenance: what it was made from and with.
        is_given: whether the point that it sets out from was asked for.

    Raises:
        BadInput: nothing is chosen: the time allows no measurement.
    """
    known, limits, chosen = weighed.known, weighed.limits, weighed.chosen
    if not chosen:
        shortest = weighed.takes_s([int(np.argmin(weighed.problem.costs))])
        raise BadInput(
            f"design: {limits.time_s:.6g} s are too short; wanted {shortest:.6g} s at least, one "
            "measurement"
        )
    values = known.spread_values[np.isfinite(known.spread_values)]
    facts = _facts(bound, weighed, goal, is_given=is_given)
    pairs = (line.split(" ¦ ") for line in phrases("design/text", "limits", limits, facts))
    proposals = []
    for rank, candidate in enumerate(chosen, 1):
        setup, repeats = weighed.setup_of[candidate], weighed.repeats[candidate]
        choice, peaks = weighed.setups[setup], weighed.peaks[setup]
        sigmas = limits.sigmas(peaks, repeats) if weighed.noise is None else weighed.noise[[setup]]
        proposals.append(
            Proposal(
                rank=rank,
                repeats=repeats,
                peaks_v=tuple(map(float, peaks)),
                sigmas_v=tuple(map(float, sigmas)),
                expected=weighed.expected(chosen[:rank]),
                **{field.name: getattr(choice, field.name) for field in fields(DriveChoice)},
            )
        )
    return Design(
        title=bound.title,
        synthetic=bound.synthetic,
        campaign=str(bound.path),
        target=goal.target,
        unit=unit,
        amplitude_unit=facts["unit"],
        criterion=goal.criterion,
        before=weighed.expected([]),
        spread=known.spread,
        span=(float(np.min(values)), float(np.max(values))) if values.size else (np.nan, np.nan),
        proposals=tuple(proposals),
        kinds=_kinds(weighed),
        places=_places(bound, weighed),
        equal_fits=int(known.spread_values.size),
        valueless=int(known.spread_values.size - values.size),
        setups=len(weighed.setups),
        candidates=weighed.problem.candidates,
        sentences=phrases("design/text", "assumptions", facts),
        limits=dict(pairs),
        provenance=dict(provenance),
    )


def _facts(bound: BoundCampaign, weighed: Weighed, goal: Goal, *, is_given: bool) -> dict[str, Any]:
    """Numbers and words by which templates print assumptions, doubts and limits."""
    known, limits, chosen = weighed.known, weighed.limits, weighed.chosen
    before, after = weighed.sigmas([]), weighed.sigmas(chosen)
    gain, usual = float(before[0] / after[0]), float(np.nanmedian(before / after))
    facts: dict[str, Any] = {
        "kind": "tones",
        "unit": bound.amplitude_unit,
        "no_error": np.nan,
        "target": goal.target,
        "places": len(known.places),
        "points": int(known.spread_values.size),
        "valueless": int(np.sum(~np.isfinite(known.spread_values))),
        "has_spread": bool(np.isfinite(known.spread)),
        "highest": max(weighed.choice(i).level for i in chosen),
        "linear": weighed.linear,
        "errors": limits.setting_sigmas,
        "units": bound.drift.units,
        "inflation": known.start_fit.inflation,
        "searched": known.start_fit.searched,
        "is_given": is_given,
        "has_value": bool(np.isfinite(before[0])),
        "gain": gain,
        "usual": usual,
        "helps": gain > min(LITTLE * usual, HELPFUL),
    }
    if limits.traces is not None:
        unit = required(bound, TRACES).record(limits.traces.of[0]).unit
        facts |= {"kind": "traces", "unit": unit}
    elif limits.sweeps is not None:
        like = required(bound, SWEEPS)
        facts |= {"kind": "sweeps", "unit": like.unit}
        if isinstance(like.kind, ControlSweep):
            facts |= {"scale": like.kind.scaled_by, "factor": "scale", "background": False}
        else:
            last = like.records[-1]
            scale = "modulus" if last.restarted else "shared" if last.shared else "each"
            facts |= {"scale": scale, "factor": "complex gain"}
            facts["background"] = last.wiring.columns > 1
    return facts


def _kinds(weighed: Weighed) -> tuple[Kind, ...]:
    """Candidates by output, resonance and level, sweeps by controls, alone and with the rest.

    The rest are the proposed ones but the last.
    """
    chosen = weighed.chosen
    alone, last = (
        [expected_of(sigmas).mean for sigmas in weighed.sigmas(so_far, and_each=True)]
        for so_far in ((), chosen[:-1])
    )
    if np.all(weighed.problem.singles):  # a proposed one is the last of all, never measured twice
        after = weighed.expected(chosen).mean
        last = [after if i in chosen else value for i, value in enumerate(last)]
    groups: dict[tuple[object, ...], list[int]] = {}
    for i, setup in enumerate(weighed.setup_of):
        c = weighed.setups[setup]
        own: tuple[object, ...] = tuple(c.settings.items()) if c.points else ()
        if c.recording is not None:
            own = (c.recording.trace, c.recording.spacing_s)
        groups.setdefault((c.output, c.centre_hz, c.level, *own), []).append(i)
    kinds = []
    for group in groups.values():
        c = weighed.choice(group[0])
        kinds.append(
            Kind(
                output=c.output,
                centre_hz=c.centre_hz,
                level=c.level,
                settings=c.settings if c.points else {},
                best=min(alone[i] for i in group),
                worst=max(alone[i] for i in group),
                beside=min(last[i] for i in group),
                count=len(group),
                trace="" if c.recording is None else c.recording.trace,
                spacing_s=0.0 if c.recording is None else c.recording.spacing_s,
            )
        )
    return tuple(kinds)


def _places(bound: BoundCampaign, weighed: Weighed) -> tuple[PlacePoint, ...]:
    chosen, known, parameters = weighed.chosen, weighed.known, bound.parameters
    along = np.array([weighed.sigmas(chosen[:rank]) for rank in range(len(chosen) + 1)])
    names, points = [parameter.name for parameter in parameters], []
    for place, value, sigmas in zip(known.places, known.values, along.T, strict=True):
        p = canonical(parameters, to_model(parameters, place.x))
        points.append(
            PlacePoint(
                alternative=dict(place.alternative),
                parameters=dict(zip(names, map(float, p), strict=True)),
                target=float(value),
                sigmas=tuple(map(float, sigmas)),
            )
        )
    return tuple(points)


# --- what is printed ----------------------------------------------------------------------------


def write_report(design: Design, figures: Sequence[Figure], folder: Path) -> Path:
    """Write `report.html` into a folder, whole or not at all, and return its path.

    Args:
        design: the proposed next measurement.
        figures: saved for the page.
        folder: where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    return write_page(
        folder,
        "design/page.html.j2",
        title=f"Next measurement: {design.title}",
        kind="next measurement",
        status=f"{len(design.proposals)} measurements proposed",
        message=phrase("design/text", "promise", design),
        synthetic=design.synthetic,
        figures=figures,
        design=design,
    )


def proposal_table(design: Design) -> Table:
    """A row per proposed measurement, under one for the data so far.

    Args:
        design: the proposed next measurement.
    """
    return table("design/proposals", design=design)


def screen_lines(design: Design, files: Sequence[Path] = (), *, verbose: bool = False) -> list[str]:
    """What `fmu-fit design` prints: a row for each proposed measurement.

    Args:
        design: the proposed next measurements.
        files: design.json, design.csv, the campaign to be filled in, the report if there is one.
        verbose: whether candidates, points of equal fit and assumptions are printed.
    """
    rows = table("design/expected", of=design, rows=design.proposals)
    return printed_lines("design/text", "screen", design, rows, verbose, files)


def ways_lines(ways: Ways, files: Sequence[Path] = (), *, verbose: bool = False) -> list[str]:
    """What `fmu-fit design` prints of several kinds of measurements that are compared.

    Args:
        ways: to spend the same time, the least expected error first.
        files: ways.json, and the campaigns to be filled in.
        verbose: whether the times of each kind are printed.
    """
    rows = table("design/expected", of=ways, rows=ways.ways, takes=True)
    return printed_lines("design/text", "ways", ways, rows, verbose, files)
