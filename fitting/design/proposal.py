"""Chosen candidates as a design: numbers, and what was assumed, as templates print it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from fitting.design.continued import SWEEPS, TRACES, required
from fitting.design.limits import Limits
from fitting.design.result import Design, DriveChoice, Kind, PlacePoint, Proposal
from fitting.design.weighing import DesignGoal, Weighed, expected_of
from fitting.extension.problem import canonical, to_model
from fitting.extension.records import BoundCampaign
from fitting.extension.report import phrases
from fitting.measurements.control.sweep import ControlSweep
from fitting.text.errors import BadInput

#: A factor on the error that is useful in any case; a share of the usual factor that is none.
HELPFUL, LITTLE = 3.0, 0.3


def proposed(
    bound: BoundCampaign,
    weighed: Weighed,
    chosen: Sequence[int],
    goal: DesignGoal,
    unit: str,
    provenance: Mapping[str, str],
) -> Design:
    """The design of chosen candidates.

    Args:
        bound: the campaign that is to be continued.
        weighed: the candidates.
        chosen: of them, in order of use.
        goal: the target and the criterion.
        unit: of the target.
        provenance: what it was made from and with.

    Raises:
        BadInput: nothing is chosen: the time allows no measurement.
    """
    known, limits = weighed.known, weighed.limits
    if not chosen:
        shortest = weighed.takes_s([int(np.argmin(weighed.problem.costs))])
        raise BadInput(
            f"design: {limits.time_s:.6g} s are too short; wanted {shortest:.6g} s at least, one "
            "measurement"
        )
    values = known.spread_values[np.isfinite(known.spread_values)]
    amplitude_unit = _amplitude_unit(bound, limits)
    facts = _facts(bound, weighed, chosen, goal, amplitude_unit)
    pairs = (line.split(" ¦ ") for line in phrases("design/text", "limits", limits, facts))
    return Design(
        title=bound.title,
        synthetic=bound.synthetic,
        campaign=str(bound.path),
        target=goal.target,
        unit=unit,
        amplitude_unit=amplitude_unit,
        criterion=goal.criterion,
        before=weighed.expected([]),
        spread=known.spread,
        span=(float(np.min(values)), float(np.max(values))) if values.size else (np.nan, np.nan),
        proposals=tuple(_proposal(weighed, chosen, rank) for rank in range(1, len(chosen) + 1)),
        kinds=_kinds(weighed, chosen),
        places=_places(bound, weighed, chosen),
        equal_fits=int(known.spread_values.size),
        valueless=int(known.spread_values.size - values.size),
        setups=len(weighed.setups),
        candidates=weighed.problem.candidates,
        sentences=phrases("design/text", "assumptions", facts),
        limits=dict(pairs),
        provenance=dict(provenance),
    )


def _amplitude_unit(bound: BoundCampaign, limits: Limits) -> str:
    if limits.traces is not None:
        return required(bound, TRACES).record(limits.traces.of[0]).unit
    return bound.amplitude_unit if limits.sweeps is None else required(bound, SWEEPS).unit


def _facts(
    bound: BoundCampaign,
    weighed: Weighed,
    chosen: Sequence[int],
    goal: DesignGoal,
    amplitude_unit: str,
) -> dict[str, Any]:
    """Numbers and words by which templates print assumptions, doubts and limits."""
    known, limits = weighed.known, weighed.limits
    before, after = weighed.sigmas([]), weighed.sigmas(chosen)
    gain, usual = float(before[0] / after[0]), float(np.nanmedian(before / after))
    facts: dict[str, Any] = {
        "kind": "tones",
        "unit": amplitude_unit,
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
        "is_given": goal.start is not None,
        "has_value": bool(np.isfinite(before[0])),
        "gain": gain,
        "usual": usual,
        "helps": gain > min(LITTLE * usual, HELPFUL),
    }
    if limits.sweeps is not None:
        like = required(bound, SWEEPS)
        facts["kind"], last = "sweeps", like.records[-1]
        if isinstance(like.kind, ControlSweep):
            facts |= {"scale": like.kind.scaled_by, "factor": "scale", "background": False}
        else:
            scale = "modulus" if last.restarted else "shared" if last.shared else "each"
            facts |= {"scale": scale, "factor": "complex gain"}
            facts["background"] = last.wiring.columns > 1
    if limits.traces is not None:
        facts["kind"] = "traces"
    return facts


def _proposal(weighed: Weighed, chosen: Sequence[int], rank: int) -> Proposal:
    candidate = chosen[rank - 1]
    setup, repeats = weighed.setup_of[candidate], weighed.repeats[candidate]
    peaks = weighed.peaks[setup]
    sigmas = weighed.limits.sigmas(peaks, repeats)
    if weighed.noise is not None:
        sigmas = weighed.noise[[setup]]
    choice = weighed.setups[setup]
    return Proposal(
        rank=rank,
        repeats=repeats,
        peaks_v=tuple(map(float, peaks)),
        sigmas_v=tuple(map(float, sigmas)),
        expected=weighed.expected(chosen[:rank]),
        **{field.name: getattr(choice, field.name) for field in fields(DriveChoice)},
    )


def _kinds(weighed: Weighed, chosen: Sequence[int]) -> tuple[Kind, ...]:
    """Candidates by output, resonance and level, sweeps by controls, alone and with the rest.

    The rest are the proposed ones but the last.
    """
    alone = [expected_of(sigmas).mean for sigmas in weighed.sigmas_with([])]
    last = [expected_of(sigmas).mean for sigmas in weighed.sigmas_with(chosen[:-1])]
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


def _places(
    bound: BoundCampaign, weighed: Weighed, chosen: Sequence[int]
) -> tuple[PlacePoint, ...]:
    along = np.array([weighed.sigmas(chosen[:rank]) for rank in range(len(chosen) + 1)])
    names = [parameter.name for parameter in bound.parameters]
    points = []
    for k, place in enumerate(weighed.known.places):
        p = canonical(bound.parameters, to_model(bound.parameters, place.x))
        points.append(
            PlacePoint(
                alternative=dict(place.alternative),
                parameters=dict(zip(names, map(float, p), strict=True)),
                target=float(weighed.known.values[k]),
                sigmas=tuple(map(float, along[:, k])),
            )
        )
    return tuple(points)
