"""Drift over a series, and the errors of stated values: where each experiment stands, and offsets.

    eta_m = before + s_m (after - before) + delta_m

s_m from the time stamps, else (m - 1)/(n - 1) as in the paper, m counting the drives: what several
outputs read of one drive is one state of the sample. "linear": delta = 0. "offsets": the
delta_m are independent, delta_m ~ N(0, prior^2). "walk": delta_m = delta_(m-1) + step_m, the steps
N(0, prior^2 dt_m/mean dt); the steps are the parameters, so that every prior stands alone.
Experiments of one state, by time stamp or by drive, share their delta.

What a sweep or another measurement is fitted at is stated by itself: v = stated + delta, delta ~
N(0, sigma^2). The eigenfrequency that ``set`` of a sweep states was read from an instrument; the
sweep itself shows it, often far better. Taken as exact, its error would be read as knowledge: how
far the line is from the stated place depends on the damping, by what it couples. So every fitted
sweep, and every further measurement, has such offsets: of what ``set_sigma`` gives an error, sigma
is that; of what drifts, it is the prior of the drift, or, where the drift is a straight line and
has none, the larger of its size and the width of the line.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial

import numpy as np

from fitting.campaign.binder import Binder, is_real
from fitting.campaign.bound import BoundCampaign, Drift
from fitting.campaign.data import Campaign
from fitting.campaign.measured import Experiment
from fitting.campaign.parameters import Parameter
from fitting.fmu.description import SETTABLE, FmuVariable
from fitting.signal.scale import half_power_width
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, Complaints, gathered
from fitting.text.finding import Kind, note
from fitting.text.units import Written, convert, in_unit, same_kind, sigma_in

#: An offset may leave the stated value by this many standard deviations of its prior.
REACH = 6.0
#: Time stamps may leave the series by so much of it.
ROUNDING = 1e-9
#: Label of a sweep that has values of its own.
SWEEP = "sweep"


@dataclass(frozen=True, kw_only=True)
class Prior:
    """Corrections that some variables share: ``sigma`` in ``unit``, ``suffix`` of their names.

    ``of_line``: where a measurement shows a line, sigma is its width at least.
    """

    variables: tuple[str, ...]
    unit: str
    sigma: float
    suffix: str
    of_line: bool = False

    def correction(
        self, labels: Sequence[str], sigma: float | None = None, word: str = "offset"
    ) -> Parameter:
        """What is added to the variables at some places.

        Args:
            labels: of the places; it is named by the first.
            sigma: its standard deviation, in the unit; None: that of the prior.
            word: how its name begins.
        """
        sigma = float(self.sigma if sigma is None else sigma)
        return Parameter(
            name=f"{word}{self.suffix}[{labels[0]}]",
            unit=self.unit,
            lower=-REACH * sigma,
            upper=REACH * sigma,
            start=0.0,
            reference=0.0,
            scale=sigma,
            experiment=labels[0],
            further=tuple(labels[1:]),
            adds_to=self.variables,
            prior=sigma,
        )


def bind_drift(campaign: Campaign, binder: Binder) -> Drift:
    """Drift of a campaign in the FMU's units.

    Args:
        campaign: campaign as it was read.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: a variable that cannot be set, time stamps that do not span the series, variables
            of different units that are to share an offset.
    """
    choice, variables = campaign.file.drift, binder.variables
    stated, ends = Complaints(), {}
    for name, both in choice.ends.items():
        # what is no variable is complained of once
        sides = (both.before, both.after) if name in variables else (both.before,)
        with stated:
            before, after = gathered(
                partial(lambda s, n: binder.number(_settable(binder, n, s), s), side, name)
                for side in sides
            )
            ends[name] = before, after
    known = [name for name in choice.ends if name in variables]
    if choice.prior is not None and known:
        stated.read(_prior, campaign, binder, (known[0],), "")
    stated.check()
    positions = _positions(campaign)
    made: list[Parameter] = []
    if choice.model != "linear" and ends:
        alone = choice.share is False
        groups = [(name,) for name in ends] if alone else [tuple(ends)]
        priors = [_prior(campaign, binder, g, f" {g[0]}" if alone else "") for g in groups]
        made = [p for prior in priors for p in _corrections(campaign, positions, prior)]
    units = {name: variables[name].unit or "1" for name in ends}
    return Drift(ends, units, positions, tuple(made))


def _settable(binder: Binder, name: str, written: Written) -> FmuVariable:
    return binder.real(name, written.where, SETTABLE, "set")


def _positions(campaign: Campaign) -> tuple[float, ...]:
    """Place of every experiment between the ends, 0 to 1."""
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


def _drives(experiments: Sequence[Experiment]) -> list[int]:
    """Number of each experiment's drive: one after the other, rows of other outputs count once."""
    numbers: list[int] = []
    drive: object = None
    read: set[str | None] = set()
    for e in experiments:
        own = e.tones_hz, {name: (w.value, w.unit) for name, w in e.written.items()}
        output = None if e.observed is None else str(e.observed.value)
        if drive != own or output in read:
            drive, read = own, set()
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
    bare = in_unit(replace(written, unit=None), None)
    return bare if written.unit is None else convert(bare, written.unit, "s", where=written.where)


def _prior(campaign: Campaign, binder: Binder, group: tuple[str, ...], suffix: str) -> Prior:
    """Unit of the correction that these variables share, and its standard deviation there."""
    units = {binder.variables[name].unit or "1" for name in group}
    if len(units) > 1:
        raise BadInput(
            f"{campaign.path}: [drift] share: {', '.join(group)} are in different units; wanted "
            "share = false"
        )
    unit, written = units.pop(), campaign.file.drift.prior
    assert written is not None  # noqa: S101 - the file's own check asked for it
    sigma = sigma_in(written, None if unit == "1" else unit)
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
    mean = (order[-1] - order[0]) / max(len(order) - 1, 1)
    for k, place in enumerate(order):
        if choice.model != "walk":
            yield prior.correction(states[place])
            continue
        labels = [label for later in order[k:] for label in states[later]]
        step = np.sqrt((place - order[k - 1]) / mean) if k and mean else 1.0
        yield prior.correction(labels, prior.sigma * step, "step")


def drift_priors(campaign: Campaign, binder: Binder, drift: Drift) -> tuple[Prior, ...]:
    """Priors of what the drift table names, for measurements that are no experiments.

    Of an experiment one offset may represent all variables that drift together; elsewhere every
    value was stated by itself, with an error of its own, unless ``share = true`` is written.

    Args:
        campaign: campaign as it was read.
        binder: of the campaign to its FMU.
        drift: its drift, bound.

    Raises:
        BadInput: variables of different units that are to share an offset.
    """
    choice, ends = campaign.file.drift, drift.ends
    if choice.model == "linear":
        each = ((name, abs(after - before)) for name, (before, after) in ends.items())
        return tuple(
            replace(_alone(name, drift.units[name], size), of_line=True) for name, size in each
        )
    if choice.share and ends:
        return (_prior(campaign, binder, tuple(ends), ""),)
    return tuple(_prior(campaign, binder, (name,), f" {name}") for name in ends)


def _alone(name: str, unit: str, sigma: float) -> Prior:
    return Prior(variables=(name,), unit=unit, sigma=sigma, suffix=f" {name}")


def bind_sigmas(written: Mapping[str, Written], binder: Binder) -> dict[str, float]:
    """Standard deviations of stated values in the FMU's units.

    Args:
        written: by variable, as they were written.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: no such Real variable that can be set, another unit, a number not above zero.
    """
    values = gathered(
        partial(lambda n, w: sigma_in(w, _settable(binder, n, w).unit), name, each)
        for name, each in written.items()
    )
    return dict(zip(written, values, strict=True))


def _priors_at(
    bound: BoundCampaign,
    binder: Binder,
    drift: Sequence[Prior],
    settings: Mapping[str, Scalar],
    sigmas: Mapping[str, float],
    width_hz: float,
) -> list[Prior]:
    """Priors of everything that has an error where these settings hold, next to a line."""
    stated = {**bound.setup.start_values, **settings}
    for name in sigmas:
        if name not in stated:
            raise BadInput(
                f"{bound.path}: set_sigma: an error of '{name}', of which no value is stated; "
                "wanted it in set, too"
            )
    made = [_alone(n, binder.variables[n].unit or "1", sigma) for n, sigma in sigmas.items()]
    for prior in drift:
        sigma = prior.sigma
        if prior.of_line and width_hz > 0.0 and same_kind(prior.unit, "Hz"):
            sigma = max(sigma, convert(width_hz, "Hz", prior.unit, where="[drift]"))
        left = tuple(n for n in prior.variables if n in stated and n not in sigmas)
        if sigma > 0.0 and left:
            made.append(replace(prior, sigma=sigma, variables=left))
    return made


def with_offsets(bound: BoundCampaign, binder: Binder, drift: Sequence[Prior]) -> BoundCampaign:
    """The campaign with an offset for every stated value of its fitted sweep and of its others.

    What is taken as exact is in its notes.

    Args:
        bound: campaign, bound to its FMU.
        binder: of the campaign to its FMU.
        drift: what is known beforehand of the error of drifting variables.

    Raises:
        BadInput: an error of what no value is stated of.
    """
    parameters, notes = list(bound.parameters), list(bound.notes)
    priors_at = partial(_priors_at, bound, binder, drift)
    taken = {e.label for e in bound.experiments}
    taken.update(label for m in bound.measurements.values() for label, _ in m.places)

    def free(label: str) -> str:
        """The label, with strokes if something else is called so."""
        while label in taken:
            label += "'"
        taken.add(label)
        return label

    def note_exact(table: str, settings: Mapping[str, Scalar], priors: Sequence[Prior]) -> None:
        """Note what is taken as exact of what was measured: real numbers with a unit."""
        moved = {name for prior in priors for name in prior.variables}
        known = ((name, binder.variables.get(name)) for name, value in settings.items() if value)
        exact = [n for n, v in known if v is not None and is_real(v) and v.unit and n not in moved]
        finding = note(Kind.stated_exactly, table, {"variables": tuple(exact)})
        if exact and finding not in notes:
            notes.append(finding)

    sweep = bound.sweep
    if sweep is not None and sweep.use == "fit":
        width_hz = half_power_width(sweep.frequency_hz, sweep.amplitude_v)
        priors = priors_at(sweep.settings, sweep.setting_sigma, width_hz)
        note_exact("sweep", sweep.settings, priors)
        if priors:
            sweep = replace(sweep, label=free(SWEEP))
            parameters += [prior.correction([sweep.label]) for prior in priors]
    measurements = dict(bound.measurements)
    for table, measurement in bound.measurements.items():
        width_hz, sigmas = measurement.line_width_hz or 0.0, measurement.setting_sigmas
        places = measurement.places
        each = [priors_at(own, sigmas.get(label, {}), width_hz) for label, own in places]
        # the only place of a measurement has a label where it has offsets
        if any(priors and not label for priors, (label, _) in zip(each, places, strict=True)):
            measurements[table] = measurement.named(free(table))
        named = [label for label, _ in measurements[table].places]
        for label, (old, settings), priors in zip(named, places, each, strict=True):
            kept = priors if label else []
            if old in sigmas:
                note_exact(table, settings, kept)
            parameters += [prior.correction([label]) for prior in kept]
    return replace(
        bound,
        sweep=sweep,
        measurements=measurements,
        parameters=tuple(parameters),
        notes=tuple(notes),
    )
