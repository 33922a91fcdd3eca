"""Drift over a series: where each experiment stands in it, and the parameters that correct it.

    eta_m = before + s_m (after - before) + delta_m

s_m from the time stamps, else (m - 1)/(n - 1) as in the paper. "linear": delta = 0. "offsets": the
delta_m are independent, delta_m ~ N(0, prior^2). "walk": delta_m = delta_(m-1) + step_m, the steps
N(0, prior^2 dt_m/mean dt); the steps are the parameters, so that every prior stands alone.
Experiments of one time stamp are one state of the sample: they share their delta.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from fitting.campaign.binder import Binder
from fitting.campaign.data import Campaign, MeasuredExperiment
from fitting.campaign.drift_table import DriftChoice
from fitting.campaign.parameters import Parameter
from fitting.campaign.section import Written, in_unit
from fitting.fmu.variables import SETTABLE
from fitting.text.errors import BadInput
from fitting.text.units import convert

#: An offset may leave the interpolated drift by this many standard deviations of its prior.
REACH = 6.0


@dataclass(frozen=True)
class Drifting:
    """Drift of a bound campaign: ``ends`` (before, after) by variable, in the FMU's units.

    ``positions`` (n,) of the experiments between them, 0 to 1; ``parameters`` correct it.
    """

    ends: Mapping[str, tuple[float, float]]
    positions: tuple[float, ...]
    parameters: tuple[Parameter, ...]


def bind_drift(campaign: Campaign, binder: Binder) -> Drifting:
    """Drift of a campaign in the FMU's units.

    Raises:
        BadInput: a variable that cannot be set, time stamps that do not span the series, variables
            of different units that are to share an offset.
    """
    choice, experiments = campaign.file.drift, campaign.experiments
    ends = {}
    for name, (before, after) in choice.ends.items():
        variable = binder.real(name, before.where, SETTABLE, "set")
        ends[name] = (binder.number(variable, before), binder.number(variable, after))
    positions = _positions(choice, experiments)
    if choice.model == "linear" or not ends:
        return Drifting(ends, positions, ())
    shared = [tuple(ends)] if choice.share else [(name,) for name in ends]
    parameters: list[Parameter] = []
    for group in shared:
        unit, prior = _prior(choice, binder, group)
        kind = "" if choice.share else f" {group[0]}"
        parameters += _corrections(choice, experiments, positions, group, unit, prior, kind)
    return Drifting(ends, positions, tuple(parameters))


def _positions(choice: DriftChoice, experiments: Sequence[MeasuredExperiment]) -> tuple[float, ...]:
    count = len(experiments)
    if not choice.time or not choice.ends:
        return tuple(0.5 if count == 1 else m / (count - 1) for m in range(count))
    stamps = np.array([stamp_of(e.stamp) for e in experiments])
    first, last = (None if w is None else stamp_of(w) for w in choice.span)
    begin = float(np.min(stamps)) if first is None else first
    end = float(np.max(stamps)) if last is None else last
    if not end > begin:
        raise BadInput(
            f"{choice.where} time: the series begins and ends at the same time in column "
            f"'{choice.time}'; wanted before_time and after_time that differ"
        )
    places = (stamps - begin) / (end - begin)
    for e, place in zip(experiments, places, strict=True):
        if not -1e-9 <= place <= 1.0 + 1e-9 and e.stamp is not None:
            raise BadInput(
                f"{e.stamp.where}: found {e.stamp.value!r}, which lies outside the time from "
                "before_time to after_time"
            )
    return tuple(map(float, places))


def stamp_of(written: Written | None) -> float:
    """A time stamp as a number: seconds for ISO dates and where a unit is written, else as it is.

    Raises:
        BadInput: neither a number, a time nor an ISO date.
    """
    if written is None:
        return 0.0
    if isinstance(written.value, str) and written.unit is None:
        try:
            return datetime.fromisoformat(written.value).timestamp()
        except ValueError:
            return in_unit(written, "s")
    if written.unit is not None:
        return convert(
            in_unit(Written(written.value, None, written.where), None),
            written.unit,
            "s",
            where=written.where,
        )
    return in_unit(written, None)


def _prior(choice: DriftChoice, binder: Binder, group: Sequence[str]) -> tuple[str, float]:
    """Unit of the offset of these variables, and its standard deviation there."""
    units = {binder.variables[name].unit or "1" for name in group}
    if len(units) > 1:
        raise BadInput(
            f"{choice.where} share: {', '.join(group)} are in different units; wanted share = false"
        )
    unit = units.pop()
    assert choice.prior is not None  # noqa: S101 - the schema asked for it
    prior = in_unit(choice.prior, None if unit == "1" else unit)
    if prior <= 0.0:
        raise BadInput(f"{choice.prior.where}: found {choice.prior.value!r}, wanted more than zero")
    return unit, prior


def _corrections(
    choice: DriftChoice,
    experiments: Sequence[MeasuredExperiment],
    positions: Sequence[float],
    group: tuple[str, ...],
    unit: str,
    prior: float,
    kind: str,
) -> list[Parameter]:
    """One parameter per state of the sample: its offset, or the step of the walk to it."""
    states: dict[float, list[str]] = {}
    for m, (e, position) in enumerate(zip(experiments, positions, strict=True)):
        states.setdefault(position if choice.time else float(m), []).append(e.label)
    order = sorted(states)
    walk = choice.model == "walk"
    mean = (order[-1] - order[0]) / max(len(order) - 1, 1)
    made = []
    for k, place in enumerate(order):
        labels = states[place]
        sigma = prior
        if walk:
            labels = [label for later in order[k:] for label in states[later]]
            sigma *= np.sqrt((place - order[k - 1]) / mean) if k and mean else 1.0
        made.append(
            Parameter(
                name=f"{'step' if walk else 'offset'}{kind}[{labels[0]}]",
                unit=unit,
                lower=-REACH * sigma,
                upper=REACH * sigma,
                start=0.0,
                reference=0.0,
                scale=float(sigma),
                experiment=labels[0],
                further=tuple(labels[1:]),
                adds_to=group,
                prior_sigma=float(sigma),
            )
        )
    return made
