"""From weighed candidates to a `Design`: what is proposed, in order, and what it should do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from fitting.design.candidates import Limits, SweepLimits, TraceLimits
from fitting.design.continued import continued_of
from fitting.design.recordings import traces_of
from fitting.design.result import Design, DriveChoice, Expected, Kind, PlacePoint, Proposal
from fitting.design.weighing import DesignGoal, Weighed, chosen_by
from fitting.extension.problem import canonical, to_model
from fitting.extension.records import BoundCampaign
from fitting.text.arrays import FloatArray
from fitting.text.notation import hertz, listed, number, quantity

#: A factor on the error that nobody calls useless.
HELPFUL = 3.0


@dataclass(frozen=True)
class Choice:
    """Weighed candidates, and those of them that are to be measured, in order of use."""

    weighed: Weighed
    chosen: Sequence[int]

    def takes_s(self, limits: Limits) -> float:
        """What they take of the laboratory, s.

        Args:
            limits: of the candidates.
        """
        weighed = self.weighed
        return sum(
            limits.takes_s(weighed.setups[weighed.setup_of[i]], weighed.repeats[i])
            for i in self.chosen
        )


def propose(
    bound: BoundCampaign,
    weighed: Weighed,
    limits: Limits,
    goal: DesignGoal,
    unit: str,
    provenance: Mapping[str, str],
) -> Design:
    """Choose and tell.

    `unit` is the target's.

    Args:
        bound: the campaign that is to be continued.
        weighed: the candidates.
        limits: of the instrument.
        goal: the target and the criterion.
        unit: of the target.
        provenance: what it was made from and with.

    Raises:
        BadInput: the criterion is the target's, and it can be differentiated at no point.
    """
    choice = Choice(weighed, chosen_by(weighed, limits, goal.criterion))
    return proposed(bound, choice, limits, goal, unit, provenance)


def proposed(
    bound: BoundCampaign,
    choice: Choice,
    limits: Limits,
    goal: DesignGoal,
    unit: str,
    provenance: Mapping[str, str],
) -> Design:
    """Tell what was chosen.

    Args:
        bound: the campaign that is to be continued.
        choice: of one measurement at least.
        limits: of the instrument.
        goal: the target and the criterion.
        unit: of the target.
        provenance: what it was made from and with.
    """
    weighed, chosen = choice.weighed, list(choice.chosen)
    known = np.isfinite(weighed.spread_values)
    values = weighed.spread_values[known]
    return Design(
        title=bound.title,
        synthetic=bound.synthetic,
        campaign=str(bound.path),
        target=goal.target,
        unit=unit,
        amplitude_unit=_amplitude_unit(bound, limits),
        criterion=goal.criterion,
        before=expected_of(weighed.sigmas([])),
        spread=weighed.spread,
        span=(float(np.min(values)), float(np.max(values))) if values.size else (np.nan, np.nan),
        proposals=tuple(
            _proposal(weighed, limits, chosen, rank) for rank in range(1, len(chosen) + 1)
        ),
        kinds=_kinds(weighed, chosen),
        places=_places(bound, weighed, chosen),
        equal_fits=int(weighed.spread_values.size),
        valueless=int(np.count_nonzero(~known)),
        setups=len(weighed.setups),
        candidates=weighed.problem.candidates,
        sentences=(
            *_sentences(bound, weighed, chosen, limits, goal),
            *_doubts(weighed, chosen, goal),
        ),
        limits=_limits(bound, limits),
        provenance=dict(provenance),
    )


def _amplitude_unit(bound: BoundCampaign, limits: Limits) -> str:
    if limits.traces is not None:
        return traces_of(bound).record(limits.traces.of[0]).unit
    return bound.amplitude_unit if limits.sweeps is None else continued_of(bound).unit


def expected_of(sigmas: FloatArray) -> Expected:
    """At the given point, on (geometric) average and at worst over points of equal fit.

    Args:
        sigmas: expected standard deviations at the points, the given one first, shape (k,).
    """
    known = sigmas[np.isfinite(sigmas)]
    if not known.size:
        return Expected(float("nan"), float("nan"), float("nan"))
    mean = float(np.exp(np.mean(np.log(known))))
    return Expected(float(sigmas[0]), mean, float(np.max(known)))


def _proposal(weighed: Weighed, limits: Limits, chosen: Sequence[int], rank: int) -> Proposal:
    candidate = chosen[rank - 1]
    setup = weighed.setups[weighed.setup_of[candidate]]
    peaks = weighed.amplitudes_v[0, weighed.setup_of[candidate]]
    repeats = weighed.repeats[candidate]
    sigmas = limits.sigmas(peaks, repeats)
    if weighed.sigmas_v is not None:
        sigmas = weighed.sigmas_v[[weighed.setup_of[candidate]]]
    choice = {field.name: getattr(setup, field.name) for field in fields(DriveChoice)}
    return Proposal(
        rank=rank,
        repeats=repeats,
        peaks_v=tuple(map(float, peaks)),
        sigmas_v=tuple(map(float, sigmas)),
        expected=expected_of(weighed.sigmas(chosen[:rank])),
        **choice,
    )


def _kinds(weighed: Weighed, chosen: Sequence[int]) -> tuple[Kind, ...]:
    """Candidates by output, resonance and level, sweeps by controls, alone and beside the rest.

    The rest are the proposed ones but the last.
    """
    alone = [expected_of(sigmas).mean for sigmas in weighed.sigmas_with([])]
    beside = [expected_of(sigmas).mean for sigmas in weighed.sigmas_with(chosen[:-1])]
    if np.all(weighed.problem.singles):  # a proposed one is the last beside the others, never twice
        after = expected_of(weighed.sigmas(chosen)).mean
        beside = [after if i in chosen else value for i, value in enumerate(beside)]
    groups: dict[tuple[object, ...], list[int]] = {}
    for i, setup in enumerate(weighed.setup_of):
        s = weighed.setups[setup]
        own: tuple[object, ...] = tuple(s.settings.items()) if s.points else ()
        if s.recording is not None:
            own = (s.recording.trace, s.recording.spacing_s)
        groups.setdefault((s.output, s.centre_hz, s.level, *own), []).append(i)
    first = [weighed.setups[weighed.setup_of[group[0]]] for group in groups.values()]
    return tuple(
        Kind(
            output=s.output,
            centre_hz=s.centre_hz,
            level=s.level,
            settings=s.settings if s.points else {},
            best=min(alone[i] for i in group),
            worst=max(alone[i] for i in group),
            beside=min(beside[i] for i in group),
            count=len(group),
            trace="" if s.recording is None else s.recording.trace,
            spacing_s=0.0 if s.recording is None else s.recording.spacing_s,
        )
        for s, group in zip(first, groups.values(), strict=True)
    )


def _places(
    bound: BoundCampaign, weighed: Weighed, chosen: Sequence[int]
) -> tuple[PlacePoint, ...]:
    along = np.array([weighed.sigmas(chosen[:rank]) for rank in range(len(chosen) + 1)])
    names = [parameter.name for parameter in bound.parameters]
    points = []
    for k, place in enumerate(weighed.places):
        p = canonical(bound.parameters, to_model(bound.parameters, place.x))
        points.append(
            PlacePoint(
                alternative=dict(place.alternative),
                parameters=dict(zip(names, map(float, p), strict=True)),
                target=float(weighed.values[k]),
                sigmas=tuple(map(float, along[:, k])),
            )
        )
    return tuple(points)


def _doubts(weighed: Weighed, chosen: Sequence[int], goal: DesignGoal) -> list[str]:
    """Where the proposal does not help, or cannot be judged."""
    before, after = weighed.sigmas([]), weighed.sigmas(chosen)
    if weighed.inflation > 1.0:
        asked = goal.start is not None
        where = "The nearest fit to the given point" if asked else _where_from(weighed)
        return [
            f"{where} leaves {number(weighed.inflation, 2)} times the noise (root mean square): it "
            "does not describe the data, and errors that are expected there mean little"
            + ("." if asked else "; wanted a fit that does, --at RESULT.json.")
        ]
    if not np.isfinite(before[0]):
        return [f"{goal.target} has no value, or none that can be differentiated, here."]
    gain, usual = float(before[0] / after[0]), float(np.nanmedian(before / after))
    if gain > min(0.3 * usual, HELPFUL):
        return []
    return [
        f"At the given point itself the error of {goal.target} falls by a factor of "
        f"{gain:.2g} only, where {usual:.2g} is usual: if the truth lies there, these measurements "
        "determine it as little."
    ]


def _where_from(weighed: Weighed) -> str:
    return (
        f"The fit set out from, the lowest from the references and from {weighed.searched} points "
        "of the box,"
    )


def _sentences(
    bound: BoundCampaign, weighed: Weighed, chosen: Sequence[int], limits: Limits, goal: DesignGoal
) -> tuple[str, ...]:
    """What was assumed, and what a reader must know to judge the figures."""
    count, none = weighed.spread_values.size, int(np.sum(~np.isfinite(weighed.spread_values)))
    said = [
        f"Expected errors are those of the problem linearised at {len(weighed.places)} points: the "
        "given one, and others far from it that fit the data as well. The choice is the best on "
        "average over them."
        if len(weighed.places) > 1
        else "The data so far hold every parameter: expected errors are those of the problem "
        "linearised at the given point."
    ]
    if none:
        said.append(
            f"{goal.target} has no value at {none} of {count} points of equal fit; they are "
            "left out."
        )
    if np.isfinite(weighed.spread):
        said.append(
            f"Before anything is measured, {goal.target} is taken to be known to its standard "
            "deviation over these points, where the linearised prior is wider."
        )
    highest = max(weighed.setups[weighed.setup_of[i]].level for i in chosen)
    if highest > 1.0:
        how = (
            "the model's amplitudes are proportional to it"
            if weighed.linear
            else "the model is not linear in it"
        )
        said.append(
            f"Drive levels up to {highest:g} times the campaign's are proposed; {how}. "
            "Whether source and resonator bear it, where an output that is not observed may be "
            "resonant, has to be stated by [design] levels."
        )
    if limits.sweeps is not None:
        said.append(
            "Every control of a new sweep is taken to be as exact as in the sweeps so far; "
            f"{continued_of(bound).scale}."
        )
    if limits.traces is not None:
        said.append(
            "A new recording begins, or is driven, as the trace that it repeats was, and noise is "
            "taken to be that of a sample whatever the spacing, independent from one to the next: "
            "where a filter or the recorder makes neighbours alike, finer samples determine less "
            "than "
            "that."
        )
    if limits.setting_sigmas:
        errors = listed(
            f"{name} by {s:.3g} {bound.drift.units.get(name, '')}".rstrip()
            for name, s in limits.setting_sigmas.items()
        )
        said.append(
            f"In every experiment, what is believed of what drifts is off by a standard deviation "
            f"({errors}), common to its tones."
        )
    return tuple(said)


def _limits(bound: BoundCampaign, limits: Limits) -> dict[str, str]:
    if limits.sweeps is not None:
        return _sweep_limits(bound, limits, limits.sweeps)
    if limits.traces is not None:
        return _trace_limits(bound, limits, limits.traces)
    unit = bound.amplitude_unit
    words = {
        "outputs": listed(limits.outputs),
        "resonances": hertz(*limits.centres_hz, joined=", "),
        "frequency step": hertz(limits.frequency_step_hz),
        "least spacing of tones": hertz(limits.least_spacing_hz),
        "farthest detuning": hertz(limits.farthest_hz),
        "tones at once": f"{limits.tones}"
        + (", on both sides" if limits.both_sides and limits.tones > 1 else ""),
        "drive levels": listed(f"{level:g}" for level in limits.levels) + " times the campaign's",
        "spectra averaged": listed(str(count) for count in limits.repeats),
        "noise of a peak": _noise(limits, unit),
        "largest amplitude": quantity(limits.largest_v, float("nan"), unit),
        "measurements": str(limits.number),
        **_time(limits),
    }
    if limits.phases:
        words["phases"] = "measured, against a reference phase that is unknown"
    for name, values in limits.settings.items():
        words[name] = listed(str(v) for v in values)
    return words


def _time(limits: Limits) -> dict[str, str]:
    if limits.time_s is None:
        return {}
    each = (
        f"{limits.point_s:g} s a point" if limits.sweeps else f"{limits.spectrum_s:g} s a spectrum"
    )
    each = "as long as each recording" if limits.traces else each
    change = f", {limits.change_s:g} s for each measurement besides" if limits.change_s else ""
    return {"time": f"{limits.time_s:g} s at most: {each}{change}"}


def _noise(limits: Limits, unit: str) -> str:
    floor = quantity(limits.noise_floor_v, float("nan"), unit)
    return f"{floor} and {number(100.0 * limits.relative_noise, 3)} % of it"


def _sweep_limits(bound: BoundCampaign, limits: Limits, sweeps: SweepLimits) -> dict[str, str]:
    unit, [centre_hz] = continued_of(bound).unit, limits.centres_hz
    return {
        "output": limits.outputs[0],
        "sweep": f"{sweeps.points} points over {hertz(sweeps.span_hz)} around {hertz(centre_hz)}",
        **{name: listed(f"{v}" for v in values) for name, values in sweeps.controls.items()},
        "noise of a point": _noise(limits, unit),
        "largest amplitude": quantity(limits.largest_v, float("nan"), unit),
        "sweeps": f"{limits.number} at most",
        **_time(limits),
    }


def _trace_limits(bound: BoundCampaign, limits: Limits, traces: TraceLimits) -> dict[str, str]:
    unit = _amplitude_unit(bound, limits)
    noise = "as stated of the traces so far, else as a fit leaves it"
    if limits.noise_floor_v:
        noise = quantity(limits.noise_floor_v, float("nan"), unit)
    spacings = dict.fromkeys(s for label in traces.of for s in traces.spacings_s[label])
    return {
        "output": listed(limits.outputs),
        "begun or driven as": listed(label or "the trace" for label in traces.of),
        "lengths": listed(f"{length:g} s" for length in traces.lengths_s),
        "spacings of samples": listed(f"{spacing:g} s" for spacing in spacings),
        "samples": f"{traces.samples} at most",
        "noise of a sample": noise,
        "largest value": quantity(limits.largest_v, float("nan"), unit),
        "recordings": f"{limits.number} at most",
        **_time(limits),
    }
