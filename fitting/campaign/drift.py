"""Drift over a series: where each experiment stands in it, and the parameters that correct it.

    eta_m = before + s_m (after - before) + delta_m

s_m from the time stamps, else (m - 1)/(n - 1) as in the paper, m counting the drives: what several
outputs read of one drive is one state of the sample. "linear": delta = 0. "offsets": the
delta_m are independent, delta_m ~ N(0, prior^2). "walk": delta_m = delta_(m-1) + step_m, the steps
N(0, prior^2 dt_m/mean dt); the steps are the parameters, so that every prior stands alone.
Experiments of one state, by time stamp or by drive, share their delta. What a sweep or another
measurement is fitted at is stated by itself and has a delta of its own: `campaign.stated`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial

import numpy as np

from fitting.campaign.binder import Binder
from fitting.campaign.data import Campaign
from fitting.campaign.measured import MeasuredExperiment
from fitting.campaign.parameters import Parameter
from fitting.fmu.variables import SETTABLE
from fitting.text.errors import BadInput, Complaints, gathered
from fitting.text.units import convert
from fitting.text.written import Written, difference_in, in_unit

#: An offset may leave the interpolated drift by this many standard deviations of its prior.
REACH = 6.0
#: Positions in a series may leave it by so much.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Drifting:
    """Drift of a bound campaign: ``ends`` (before, after) by variable, in the FMU's units.

    ``positions`` (n,) of the experiments between them, 0 to 1; ``parameters`` correct it.

    Raises:
        BadInput: ends that are not finite, positions that are not from 0 to 1.
    """

    ends: Mapping[str, tuple[float, float]]
    positions: tuple[float, ...]
    parameters: tuple[Parameter, ...] = ()

    def __post_init__(self) -> None:
        for name, (before, after) in self.ends.items():
            if not (math.isfinite(before) and math.isfinite(after)):
                raise BadInput(
                    f"drift of {name}: from {before:g} to {after:g}, wanted finite values"
                )
        if not all(-ROUNDING <= place <= 1.0 + ROUNDING for place in self.positions):
            shown = ", ".join(f"{place:g}" for place in self.positions)
            raise BadInput(f"drift: positions {shown} of the experiments, wanted them from 0 to 1")


def bind_drift(campaign: Campaign, binder: Binder) -> Drifting:
    """Drift of a campaign in the FMU's units.

    Args:
        campaign: campaign as it was read.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: a variable that cannot be set, time stamps that do not span the series, variables
            of different units that are to share an offset.
    """
    choice = campaign.file.drift
    said = Complaints()
    ends = {}
    for name, both in choice.ends.items():
        sides = (both.before, both.after) if name in binder.variables else (both.before,)
        with said:
            before, after = gathered(partial(_end, name, side, binder) for side in sides)
            ends[name] = before, after
    known = [name for name in choice.ends if name in binder.variables]
    if choice.prior is not None and known:
        with said:
            prior_of_drift(campaign, binder, (known[0],), "")
    said.check()
    positions = _positions(campaign)
    if choice.model == "linear" or not ends:
        return Drifting(ends, positions, ())
    alone = choice.share is False
    groups = [(name,) for name in ends] if alone else [tuple(ends)]
    made = [
        prior_of_drift(campaign, binder, group, f" {group[0]}" if alone else "") for group in groups
    ]
    return Drifting(
        ends,
        positions,
        tuple(p for prior in made for p in _corrections(campaign, positions, prior)),
    )


def _end(name: str, written: Written, binder: Binder) -> float:
    return binder.number(binder.real(name, written.where, SETTABLE, "set"), written)


def _positions(campaign: Campaign) -> tuple[float, ...]:
    choice, experiments = campaign.file.drift, campaign.experiments
    if not choice.time or not choice.ends:
        drives = _drives(experiments)
        last = max(drives, default=0)
        return tuple(m / last if last else 0.5 for m in drives)
    stamps = np.array([stamp_of(e.stamp) for e in experiments])
    begin = float(np.min(stamps)) if choice.before_time is None else stamp_of(choice.before_time)
    end = float(np.max(stamps)) if choice.after_time is None else stamp_of(choice.after_time)
    if not end > begin:
        raise BadInput(
            f"{campaign.path}: [drift] time: the series begins and ends at the same time in column "
            f"'{choice.time}'; wanted before_time and after_time that differ"
        )
    places = (stamps - begin) / (end - begin)
    for e, place in zip(experiments, places, strict=True):
        if not -ROUNDING <= place <= 1.0 + ROUNDING and e.stamp is not None:
            raise BadInput(
                f"{e.stamp.where}: found {e.stamp.value!r}, which lies outside the time from "
                "before_time to after_time"
            )
    return tuple(map(float, places))


def _drives(experiments: Sequence[MeasuredExperiment]) -> list[int]:
    """Number of each experiment's drive: one after the other, rows of other outputs count once."""
    numbers: list[int] = []
    drive: object = None
    read: set[str | None] = set()
    for experiment in experiments:
        settings = {name: (w.value, w.unit) for name, w in experiment.settings.items()}
        output = None if experiment.output is None else str(experiment.output.value)
        if drive != (experiment.tones_hz, settings) or output in read:
            drive, read = (experiment.tones_hz, settings), set()
            numbers.append(numbers[-1] + 1 if numbers else 0)
        else:
            numbers.append(numbers[-1])
        read.add(output)
    return numbers


def stamp_of(written: Written | None) -> float:
    """A time stamp as a number: seconds for ISO dates and where a unit is written, else as it is.

    Args:
        written: number or quantity as the file has it.

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


@dataclass(frozen=True, kw_only=True)
class Prior:
    """Corrections that some variables share: ``sigma`` in ``unit``, ``suffix`` of their names."""

    variables: tuple[str, ...]
    unit: str
    sigma: float
    suffix: str

    def correction(
        self, labels: Sequence[str], sigma: float | None = None, word: str = "offset"
    ) -> Parameter:
        """What is added to the variables at some places.

        Args:
            labels: of the places; it is named by the first.
            sigma: its standard deviation, in the unit; None: that of the prior.
            word: how its name begins.
        """
        sigma = self.sigma if sigma is None else sigma
        return Parameter(
            name=f"{word}{self.suffix}[{labels[0]}]",
            unit=self.unit,
            lower=-REACH * sigma,
            upper=REACH * sigma,
            start=0.0,
            reference=0.0,
            scale=float(sigma),
            experiment=labels[0],
            further=tuple(labels[1:]),
            adds_to=self.variables,
            prior=float(sigma),
        )


def prior_of_drift(
    campaign: Campaign, binder: Binder, group: tuple[str, ...], suffix: str
) -> Prior:
    """Unit of the correction of these variables, and its standard deviation there.

    Args:
        campaign: campaign as it was read, whose drift has a prior.
        binder: of the campaign to its FMU.
        group: variables that share a correction.
        suffix: of its name.

    Raises:
        BadInput: variables of different units, a prior that is not above zero.
    """
    units = {binder.variables[name].unit or "1" for name in group}
    if len(units) > 1:
        raise BadInput(
            f"{campaign.path}: [drift] share: {', '.join(group)} are in different units; wanted "
            "share = false"
        )
    unit, written = units.pop(), campaign.file.drift.prior
    assert written is not None  # noqa: S101 - the file's own check asked for it
    sigma = difference_in(written, None if unit == "1" else unit)
    if sigma <= 0.0:
        raise BadInput(f"{written.where}: found {written.value!r}, wanted more than zero")
    return Prior(variables=group, unit=unit, sigma=sigma, suffix=suffix)


def _corrections(
    campaign: Campaign, positions: Sequence[float], prior: Prior
) -> Iterator[Parameter]:
    """One parameter per state of the sample: its offset, or the step of the walk to it."""
    choice = campaign.file.drift
    states: dict[float, list[str]] = {}
    places = positions if choice.time else map(float, _drives(campaign.experiments))
    for e, place in zip(campaign.experiments, places, strict=True):
        states.setdefault(place, []).append(e.label)
    order = sorted(states)
    walk = choice.model == "walk"
    mean = (order[-1] - order[0]) / max(len(order) - 1, 1)
    for k, place in enumerate(order):
        labels = states[place]
        sigma = prior.sigma
        if walk:
            labels = [label for later in order[k:] for label in states[later]]
            sigma *= np.sqrt((place - order[k - 1]) / mean) if k and mean else 1.0
        yield prior.correction(labels, float(sigma), "step" if walk else "offset")
