"""Which measurement next: candidates within the instrument's limits, weighed through the FMU.

The point is not known where a design is needed most. So it is judged at the given point and, since
data that do not determine the parameters are fitted as well elsewhere, at points of equal fit far
from it; the choice is the best on average (geometric mean of the expected standard deviations).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from itertools import pairwise

import numpy as np

from fitting.design.candidates import Limits, Setup, as_campaign, setups_of
from fitting.design.choice import DesignProblem, choose, choose_within, target_sigmas
from fitting.design.continued import ANY_PHASE, continued_of
from fitting.design.information import (
    Place,
    Rows,
    Series,
    information_of_data,
    information_of_setups,
    prior_sigmas_in_box,
    scale_sigma,
    unmeasured,
)
from fitting.design.outset import Outset, lowest_outset, nearest_outset
from fitting.design.points import equal_fits, nearest_fit, spread_out
from fitting.design.recordings import RecordingsToSimulate, recording_choices, traces_of
from fitting.design.result import DriveChoice
from fitting.design.sweeps import information_of_sweeps, simulated_sweeps, sweep_choices
from fitting.extension.problem import (
    SMALLEST_SIGMA,
    canonical,
    central,
    evaluate_many,
    information,
    output_means,
    search_bounds,
    to_model,
    to_search,
)
from fitting.extension.records import BoundCampaign
from fitting.simulate.batch import Workers
from fitting.text.arrays import FloatArray, IntArray, Scalar
from fitting.text.errors import BadInput

#: Points at which a design is judged, the given one included.
PLACES = 8
#: Peaks below this many standard deviations are not proposed: they might not be seen at all.
LEAST_SIGNAL = 3.0
#: Relative departure from proportionality up to which a model counts as linear in the drive level.
LINEAR = 1e-6
#: Step in x for the gradient of a derived output.
GRADIENT_STEP = 1e-4
#: Points of equal fit from which their spread bounds what is known of the target.
ENOUGH = 5


@dataclass(frozen=True)
class DesignGoal:
    """What is asked: target (parameter or derived output), criterion, where, seed of the walk.

    `start` is an alternative and the parameters (n,) in their units, None for the fit that is
    nearest to the references.
    """

    target: str
    _: KW_ONLY
    criterion: str = "target"
    start: tuple[Mapping[str, Scalar], FloatArray] | None = None
    seed: int = 1


@dataclass(frozen=True, kw_only=True)
class Weighed:
    """Everything that a choice rests on, candidates as (setup, repeats).

    `problem` in variables of unit prior variance; `amplitudes_v` (places, setups, tones);
    `values` of the target at the `places`, `spread_values` at all points of equal fit.
    `sigmas_v` (setups,) is the noise of recordings, None where the limits say it of peaks.
    `inflation` and `searched` are those of the `Outset`.
    """

    problem: DesignProblem
    setups: tuple[DriveChoice, ...]
    repeats: tuple[int, ...]
    setup_of: tuple[int, ...]
    amplitudes_v: FloatArray
    places: tuple[Place, ...]
    values: FloatArray
    spread_values: FloatArray
    linear: bool
    sigmas_v: FloatArray | None = None
    inflation: float = 1.0
    searched: int = 0

    @property
    def spread(self) -> float:
        """Standard deviation of the target over points of equal fit; infinite for too few."""
        known = self.spread_values[np.isfinite(self.spread_values)]
        return float(np.std(known)) if known.size >= ENOUGH else float("inf")

    def sigmas(self, chosen: Sequence[int]) -> FloatArray:
        """Expected standard deviation of the target at every place, no more than its spread.

        Args:
            chosen: candidates that are measured.
        """
        return self._within(target_sigmas(self.problem, self.problem.information(chosen)))

    def sigmas_with(self, chosen: Sequence[int]) -> FloatArray:
        """The same with each candidate beside the chosen, shape (candidates, places).

        Args:
            chosen: candidates that are measured.
        """
        gains = np.swapaxes(self.problem.gains, 0, 1)
        return self._within(target_sigmas(self.problem, self.problem.information(chosen) + gains))

    def _within(self, sigmas: FloatArray) -> FloatArray:
        return np.asarray(sigmas / np.hypot(1.0, sigmas / self.spread))


@dataclass(frozen=True, kw_only=True)
class _Known:
    """What is known before anything new is measured, at the `places` where a design is judged.

    `unit` (n + 1 + l,) are the standard deviations of the prior in x, of the scale's logarithm, and
    of what the new measurements of each way have in common, `own` the places (l_k,) of those; in
    their units `base` (k, n + 1 + l, n + 1 + l) is the information of prior and data and
    `gradients` (k, n + 1 + l) the target's. `values` (k,) of the target there, `spread_values` at
    all points of equal fit, in its unit.
    """

    places: tuple[Place, ...]
    unit: FloatArray
    own: tuple[IntArray, ...]
    base: FloatArray
    gradients: FloatArray
    values: FloatArray
    spread_values: FloatArray
    begun: Outset


def weigh(
    bound: BoundCampaign,
    workers: Workers,
    limits: Limits,
    goal: DesignGoal,
    progress: Callable[[str], None] = lambda state: None,
    also: Sequence[BoundCampaign] = (),
) -> Weighed:
    """Information of the data so far and of every candidate, at points of equal fit.

    The campaign is the one to be continued; what was measured in others (`also`, of the same FMU
    and parameters, each with a scale of its own) counts as known.

    Args:
        bound: the campaign to be continued.
        workers: of its FMU.
        limits: of the instrument.
        goal: the target and where it is to be known.
        progress: is told in words what is being done.
        also: further campaigns that have been measured.

    Raises:
        BadInput: an unknown target, no candidate within the limits, or another campaign with other
            parameters.
        FmuFailure: the FMU failed.
    """
    [found] = weigh_ways(bound, workers, [limits], goal, progress, also)
    return found


def weigh_ways(
    bound: BoundCampaign,
    workers: Workers,
    ways: Sequence[Limits],
    goal: DesignGoal,
    progress: Callable[[str], None] = lambda state: None,
    also: Sequence[BoundCampaign] = (),
) -> tuple[Weighed, ...]:
    """The candidates of several ways to continue one campaign, all at the same points.

    Their `problem`s have the same variables and the same `base`: the parameters, the scale of the
    data so far, and what the new measurements of each way have in common. So candidates of one
    stand beside those of another, `DesignProblem.beside`.

    Args:
        bound: the campaign to be continued.
        workers: of its FMU.
        ways: limits of the instrument, of each way.
        goal: the target and where it is to be known.
        progress: is told in words what is being done.
        also: further campaigns that have been measured.

    Raises:
        BadInput: see `weigh`.
        FmuFailure: the FMU failed.
    """
    _check_target(bound, goal.target)
    data = Series(
        bound,
        workers,
        refined=any(way.sweeps is not None or way.traces is not None for way in ways),
    )
    series = (data, *(_alike(other, bound, workers, refined=data.refined) for other in also))
    steps = data.steps()
    known = _known(series, steps, goal, ways, progress)
    progress("candidates")
    return tuple(
        _gathered(limits, _candidates(data, limits, known, steps), known, own)
        for limits, own in zip(ways, known.own, strict=True)
    )


def _candidates(data: Series, limits: Limits, known: _Known, steps: FloatArray) -> _Candidates:
    if limits.sweeps is not None:
        return _sweep_candidates(data, limits, known, steps)
    if limits.traces is not None:
        return _recording_candidates(data, limits, known, steps)
    return _tone_candidates(data, limits, known, steps)


def _of_data(ways: Sequence[Limits]) -> Limits:
    """What the data so far are judged by: errors of all that drifts, sweeps if there are some."""
    swept = next((way for way in ways if way.sweeps is not None), ways[0])
    errors = {name: sigma for way in ways for name, sigma in way.setting_sigmas.items()}
    return replace(swept, setting_sigmas=errors)


def _known(
    series: tuple[Series, ...],
    steps: FloatArray,
    goal: DesignGoal,
    ways: Sequence[Limits],
    progress: Callable[[str], None],
) -> _Known:
    """Points of equal fit, and what the data so far say of the target at some of them."""
    data, parameters, limits = series[0], series[0].bound.parameters, _of_data(ways)
    prior = prior_sigmas_in_box(parameters)
    progress("points of equal fit")
    begun, given, others = _equal_fits(series, goal, prior, steps, limits)
    spread_values = _values(data, goal.target, [given, *others])
    useful = [p for p, v in zip(others, spread_values[1:], strict=True) if np.isfinite(v)]
    eligible = useful if goal.criterion == "target" else others
    places = spread_out(parameters, given, eligible, PLACES, prior)
    progress(f"{len(others)} points of equal fit; what the data determine at {len(places)} of them")
    gradients = _gradients(data, goal.target, places)
    new = [_new_nuisances(data.bound, way) for way in ways]
    unit = np.append(prior, [_scale_sigma(data), *(sigma for each in new for sigma in each)])
    ends = np.cumsum([len(prior) + 1, *map(len, new)])
    nuisances = len(unit) - len(prior)
    data_information = np.stack([_information_at(series, place, steps, limits) for place in places])
    more = nuisances - 1  # the data so far say nothing of a phase or scale to come
    data_information = np.pad(data_information, ((0, 0), (0, more), (0, more)))
    return _Known(
        places=tuple(places),
        unit=unit,
        own=tuple(np.arange(first, last) for first, last in pairwise(ends)),
        base=np.eye(len(unit)) + data_information * np.outer(unit, unit),
        gradients=np.column_stack([gradients * prior, np.zeros((len(places), nuisances))]),
        values=_values(data, goal.target, places),
        spread_values=spread_values,
        begun=begun,
    )


def _alike(
    other: BoundCampaign, bound: BoundCampaign, workers: Workers, *, refined: bool
) -> Series:
    """Another campaign's data, in the search vector of the first."""
    names, wanted = ({p.name for p in b.parameters} for b in (other, bound))
    if names != wanted:
        raise BadInput(
            f"{other.path}: fits {', '.join(sorted(names))}, but {bound.path} fits "
            f"{', '.join(sorted(wanted))}; wanted the same parameters"
        )
    same = replace(other, parameters=bound.parameters, alternatives=bound.alternatives)
    return Series(same, workers, refined=refined)


def _information_at(
    known: Sequence[Series], place: Place, steps: FloatArray, limits: Limits
) -> FloatArray:
    """Information (n + 1, n + 1) of all data at a place; only the first shares its scale."""
    total = np.zeros(2 * (place.x.size + 1,))
    for k, series in enumerate(known):
        rows = series.rows([place], steps, limits.setting_sigmas)[0]
        found, covariance, columns = information_of_data(series, rows, limits.setting_sigmas)
        if k == 0:
            total += found
        else:
            own = scale_sigma(series.data) * columns[:, -1]
            total[:-1, :-1] += information(columns[:, :-1], covariance.beside(own))
    return total


def _check_target(bound: BoundCampaign, target: str) -> None:
    names = [parameter.name for parameter in bound.parameters]
    if target not in (*names, *bound.derived):
        raise BadInput(
            f"{bound.path}: target '{target}' is neither fitted nor derived; wanted one of "
            f"{', '.join((*names, *bound.derived))}"
        )


def _scale_sigma(data: Series) -> float:
    """Prior of the scale's logarithm; next to nothing where there is none or where it is fitted."""
    if any(parameter.role == "scale" for parameter in data.bound.parameters):
        return 1e-9
    return max(scale_sigma(data.data), 1e-9)


def _new_nuisances(bound: BoundCampaign, limits: Limits) -> list[float]:
    """Prior standard deviations of what all new measurements share: a phase, a scale, a gain."""
    if limits.sweeps is not None:
        return list(continued_of(bound).nuisances)
    return [ANY_PHASE] if limits.phases else []


def _equal_fits(
    known: tuple[Series, ...],
    goal: DesignGoal,
    prior: FloatArray,
    steps: FloatArray,
    limits: Limits,
) -> tuple[Outset, Place, list[Place]]:
    """Where it sets out, the given point (that, or the one asked for), and others of equal fit."""
    bound = known[0].bound
    lower, upper = search_bounds(bound.parameters)
    if goal.start is None:
        start = Place(bound.alternatives[0], np.clip(np.zeros(len(prior)), lower, upper))
    else:
        alternative, p = goal.start
        start = Place(alternative, np.clip(to_search(bound.parameters, p), lower, upper))
    near = nearest_outset(known, prior, steps, limits)
    # one that was asked for is kept: nothing else is looked for
    begun = near(start) if goal.start is not None else lowest_outset(near, start, goal.seed)
    whitened, given = begun.data, begun.fitted
    others: list[Place] = []
    for k, alternative in enumerate(bound.alternatives):
        here = given
        if alternative != given.place.alternative:
            here = nearest_fit(whitened, Place(alternative, given.place.x))
            others.append(here.place)
        others += [f.place for f in equal_fits(whitened, here, goal.seed + k)]
    # a point that was asked for is kept, also where it fits badly
    return begun, (given.place if goal.start is None else start), others


def _gradients(data: Series, target: str, places: Sequence[Place]) -> FloatArray:
    """Gradients of the target in x, (k, n), by central differences; NaN where it has none."""
    parameters = data.bound.parameters
    names = [parameter.name for parameter in parameters]
    if target in names:
        gradients = np.zeros((len(places), len(names)))
        gradients[:, names.index(target)] = parameters[names.index(target)].scale
        return gradients
    box = search_bounds(parameters)
    around = [central(place.x, GRADIENT_STEP, *box) for place in places]
    nodes = [
        Place(place.alternative, x)
        for place, each in zip(places, around, strict=True)
        for x in each.nodes
    ]
    values = iter(_values(data, target, nodes))
    return np.stack([each.quotients([next(values) for _ in each.nodes]) for each in around])


def _values(data: Series, target: str, places: Sequence[Place]) -> FloatArray:
    """The target at every place, a derived output as its mean over the experiments; NaN: none."""
    parameters = data.bound.parameters
    names = [parameter.name for parameter in parameters]
    if target in names:
        shown = [canonical(parameters, to_model(parameters, p.x)) for p in places]
        return np.array([p[names.index(target)] for p in shown])
    values = np.full(len(places), np.nan)
    for alternative in data.bound.alternatives:
        here = [k for k, place in enumerate(places) if place.alternative == alternative]
        found = output_means(data.response(alternative), parameters, [places[k].x for k in here])
        if here:
            values[here] = found[target]
    return values


def _tone_candidates(data: Series, limits: Limits, known: _Known, steps: FloatArray) -> _Candidates:
    """Candidates that are tones, and their information.

    Where the amplitude is proportional to the drive level, one is simulated, the others follow.
    """
    bound, workers, places = data.bound, data.workers, known.places
    setups, errors = setups_of(bound, limits), limits.setting_sigmas
    levels = sorted({s.level for s in setups})
    lowest = [s for s in setups if s.level == levels[0]]
    series = _unmeasured(bound, workers, lowest)
    linear = len(levels) == 1
    if not linear:
        highest = _unmeasured(bound, workers, [s for s in setups if s.level == levels[-1]])
        low, high = (
            s.peaks(evaluate_many(s.objective(places[0].alternative, steps), [places[0].x])[0])
            for s in (series, highest)
        )
        ratio = levels[-1] / levels[0]
        linear = bool(np.all(np.abs(high - ratio * low) <= LINEAR * ratio * low))
    if not linear:
        rows = _unmeasured(bound, workers, setups).rows(places, steps, errors)
        return _of_tones(limits, setups, rows, linear=False)
    index = {(s.tones_hz, s.output, tuple(s.settings.items())): i for i, s in enumerate(lowest)}
    source = np.array([index[s.tones_hz, s.output, tuple(s.settings.items())] for s in setups])
    tones = len(setups[0].experiment.read_hz)
    picked = (source[:, np.newaxis] * tones + np.arange(tones)).ravel()
    factors = np.repeat([s.level / levels[0] for s in setups], tones)
    scaled = [
        replace(
            row,
            amplitude_v=row.amplitude_v[picked] * factors,
            by_x=row.by_x[picked],
            by_setting=row.by_setting[picked],
            phase_by_x=row.phase_by_x[picked],
            phase_by_setting=row.phase_by_setting[picked],
        )
        for row in series.rows(places, steps, errors)
    ]
    return _of_tones(limits, setups, scaled, linear=True)


def _unmeasured(bound: BoundCampaign, workers: Workers, setups: Sequence[Setup]) -> Series:
    return Series(unmeasured(as_campaign(bound, setups)), workers, setups=True)


def _of_tones(
    limits: Limits, setups: Sequence[Setup], rows: Sequence[Rows], *, linear: bool
) -> _Candidates:
    """Candidates of setups with their rows at each place."""
    peaks = np.stack([r.amplitude_v.reshape(len(setups), -1) for r in rows])

    def information_at(rank: int, count: int, kept: Sequence[int]) -> FloatArray:
        amplitudes = peaks[rank, list(kept)]
        sigmas = limits.sigmas(amplitudes, count)
        return information_of_setups(
            rows[rank],
            np.maximum(sigmas / amplitudes, SMALLEST_SIGMA),
            kept,
            limits.setting_sigmas,
            phases=limits.phases,
        )

    return _Candidates(setups, peaks, information_at, linear)


def _sweep_candidates(
    data: Series, limits: Limits, known: _Known, steps: FloatArray
) -> _Candidates:
    """Candidates that are sweeps, and their information."""
    choices, so_far = sweep_choices(data.bound, limits), continued_of(data.bound)
    rows = simulated_sweeps(data, so_far, choices, known.places, steps)

    def information_at(rank: int, count: int, kept: Sequence[int]) -> FloatArray:
        sigmas = limits.sigmas(rows[rank].amplitude, count)
        return information_of_sweeps(rows[rank], sigmas, kept)

    largest = np.stack([r.largest for r in rows])
    return _Candidates(choices, largest, information_at, linear=True)


def _recording_candidates(
    data: Series, limits: Limits, known: _Known, steps: FloatArray
) -> _Candidates:
    """Candidates that are recordings over time, and their information."""
    choices, so_far = recording_choices(data.bound, limits), traces_of(data.bound)
    asked = RecordingsToSimulate(series=data, so_far=so_far, choices=choices, steps=steps)
    labels = [c.recording.trace for c in choices if c.recording is not None]
    if limits.noise_floor_v > 0.0:
        sigmas = np.full(len(labels), limits.noise_floor_v)
    else:
        noise = asked.noise(known.places[0], dict.fromkeys(labels))
        sigmas = np.array([noise[label] for label in labels])
    rows = asked.rows(known.places)

    def information_at(rank: int, count: int, kept: Sequence[int]) -> FloatArray:
        return rows[rank].information(sigmas, kept)

    largest = np.stack([r.largest[:, np.newaxis] for r in rows])
    return _Candidates(choices, largest, information_at, linear=True, sigmas_v=sigmas)


@dataclass(frozen=True)
class _Candidates:
    """Setups or sweeps, their peaks (places, setups, k), and `information_at` of some of them.

    That is asked with a place by its number, a number of spectra averaged and candidates, and
    answers with (candidates, n, n). `sigmas_v` (setups,) are the noise of those whose limits do not
    say it.
    """

    setups: Sequence[DriveChoice]
    amplitudes_v: FloatArray
    information_at: Callable[[int, int, Sequence[int]], FloatArray]
    linear: bool
    sigmas_v: FloatArray | None = None

    def sigmas(self, limits: Limits, count: int) -> FloatArray:
        """Standard deviations of the peaks, of so many spectra averaged: (places, setups, k)."""
        if self.sigmas_v is None:
            return limits.sigmas(self.amplitudes_v, count)
        return np.broadcast_to(self.sigmas_v[:, np.newaxis], self.amplitudes_v.shape)


def _gathered(limits: Limits, found: _Candidates, known: _Known, own: IntArray) -> Weighed:
    """Candidates that can be seen and that the detector bears, and their information.

    `own` are the places of what the new measurements have in common.
    """
    setups, amplitudes = found.setups, found.amplitudes_v
    size, shown = known.unit.size, known.places[0].x.size
    index = np.append(np.arange(shown + 1), own)
    unit = known.unit[index]
    gains, repeats, setup_of = [], [], []
    for count in limits.repeats:
        sigmas = found.sigmas(limits, count)
        above = np.min(amplitudes - LEAST_SIGNAL * sigmas, axis=2) >= 0.0
        seen = (np.mean(above, axis=0) >= 0.5) & np.all(amplitudes > 0.0, axis=(0, 2))
        borne = np.max(amplitudes[0], axis=1) <= limits.largest_v
        kept = np.flatnonzero(seen & borne).tolist()
        for rank in range(len(known.places)):
            gain = np.zeros((len(kept), size, size))
            gain[:, index[:, np.newaxis], index] = found.information_at(
                rank, count, kept
            ) * np.outer(unit, unit)
            gains.append((count, rank, gain))
        repeats += [count] * len(kept)
        setup_of += kept
    if not setup_of:
        recorded = limits.traces is not None
        raise BadInput(
            f"none of {len(setups)} setups can be measured: every peak is below "
            f"{LEAST_SIGNAL:g} standard deviations of the noise or above the largest amplitude"
            + ", or a fit would refuse it, as a decay of less than a period"
            * recorded
        )
    stacked = np.stack(
        [np.concatenate([g for _, k, g in gains if k == rank]) for rank in range(len(known.places))]
    )
    efforts = np.array([_effort(setups[i]) for i in setup_of])
    pairs = zip(setup_of, repeats, strict=True)
    seconds = np.array([limits.takes_s(setups[i], count) for i, count in pairs])
    # of two that take as long the gentler drive, or fewer samples, come first
    costs = seconds * (1.0 + 1e-6 * efforts / efforts.max())
    problem = DesignProblem(
        base=known.base,
        gains=stacked,
        gradients=known.gradients,
        shown=shown,
        costs=costs,
        once=limits.sweeps is not None,
    )
    return Weighed(
        problem=problem,
        setups=tuple(setups),
        repeats=tuple(repeats),
        setup_of=tuple(setup_of),
        amplitudes_v=amplitudes,
        places=known.places,
        values=known.values,
        spread_values=known.spread_values,
        linear=found.linear,
        sigmas_v=found.sigmas_v,
        inflation=known.begun.inflation,
        searched=known.begun.searched,
    )


def _effort(choice: DriveChoice) -> float:
    """What is rather spared of what takes as long: drive, samples."""
    return choice.level if choice.recording is None else float(choice.recording.samples)


def chosen_by(weighed: Weighed, limits: Limits, criterion: str) -> list[int]:
    """Candidates to measure, in order of use.

    Args:
        weighed: the candidates.
        limits: for the number of measurements.
        criterion: "target", "D" or "A".

    Raises:
        BadInput: the criterion is the target's, and it can be differentiated at no point.
    """
    if criterion == "target" and not np.any(np.all(np.isfinite(weighed.problem.gradients), 1)):
        raise BadInput(
            "the target has no value, or none that can be differentiated, at any point of equal "
            'fit; wanted another --target, or --criterion "D" or "A"'
        )
    if limits.time_s is None:
        return choose(weighed.problem, limits.number, criterion)
    return choose_within(weighed.problem, limits.time_s, limits.number, criterion)
