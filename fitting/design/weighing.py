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

from fitting.design.choice import DesignProblem, choose, target_sigmas
from fitting.design.continued import SWEEPS, required
from fitting.design.information import Place, Series, prior_sigmas_in_box
from fitting.design.limits import Limits
from fitting.design.points import StartFit, equal_fits, spread_out, start_fit
from fitting.design.recordings import RecordingCandidates
from fitting.design.result import DriveChoice, Expected
from fitting.design.sweeps import ANY_PHASE, SweepCandidates, shared_sigmas
from fitting.design.tones import ToneCandidates
from fitting.extension.problem import (
    canonical,
    central,
    information,
    output_means,
    search_bounds,
    to_model,
    to_search,
)
from fitting.extension.records import BoundCampaign
from fitting.simulate.batch import Workers
from fitting.text.arrays import FloatArray, IntArray, Scalar
from fitting.text.errors import BadInput, did_you_mean

#: Points at which a design is judged, the given one included.
PLACES = 8
#: Peaks below this many standard deviations are not proposed: they might not show at all.
LEAST_SIGNAL = 3.0
#: Step in x for the gradient of a derived output.
GRADIENT_STEP = 1e-4
#: Points of equal fit from which their spread bounds what is known of the target.
ENOUGH = 5
#: Prior of the scale's logarithm where there is none, or where it is fitted.
KNOWN = 1e-9


@dataclass(frozen=True)
class DesignGoal:
    """What is asked for: target (parameter or derived output), criterion, where, seed of walkers.

    `start` is an alternative and the parameters (n,) in their units, None for the fit that is
    nearest to the references.
    """

    target: str
    _: KW_ONLY
    criterion: str = "target"
    start: tuple[Mapping[str, Scalar], FloatArray] | None = None
    seed: int = 1


@dataclass(frozen=True, kw_only=True)
class Known:
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
    start_fit: StartFit

    @property
    def spread(self) -> float:
        """Standard deviation of the target over points of equal fit; infinite for too few."""
        known = self.spread_values[np.isfinite(self.spread_values)]
        return float(np.std(known)) if known.size >= ENOUGH else float("inf")


@dataclass(frozen=True, kw_only=True)
class Weighed:
    """Everything that a choice rests on: candidates are a choice of the drive and `repeats`.

    `problem` in variables of unit prior variance; `setup_of` each candidate the number of its
    choice in `setups`, of which `peaks` are sizes of the values at the given point and `noise`
    (setups,) is that of recordings, None where the `limits` state it. `linear`: amplitudes are
    proportional to the drive level.
    """

    known: Known
    limits: Limits
    problem: DesignProblem
    setups: tuple[DriveChoice, ...]
    repeats: tuple[int, ...]
    setup_of: tuple[int, ...]
    peaks: Sequence[FloatArray]
    linear: bool
    noise: FloatArray | None

    def sigmas(self, chosen: Sequence[int]) -> FloatArray:
        """Expected standard deviation of the target at every place, no more than its spread."""
        return self._within(target_sigmas(self.problem, self.problem.information(chosen)))

    def sigmas_with(self, chosen: Sequence[int]) -> FloatArray:
        """The same with each candidate added to the chosen, shape (candidates, places)."""
        gains = np.swapaxes(self.problem.gains, 0, 1)
        return self._within(target_sigmas(self.problem, self.problem.information(chosen) + gains))

    def _within(self, sigmas: FloatArray) -> FloatArray:
        return np.asarray(sigmas / np.hypot(1.0, sigmas / self.known.spread))

    def expected(self, chosen: Sequence[int]) -> Expected:
        """The error of the target with these candidates measured."""
        return expected_of(self.sigmas(chosen))

    def choice(self, candidate: int) -> DriveChoice:
        """What is measured for a candidate."""
        return self.setups[self.setup_of[candidate]]

    def takes_s(self, chosen: Sequence[int]) -> float:
        """What candidates take of the laboratory, s."""
        return sum(self.limits.takes_s(self.choice(i), self.repeats[i]) for i in chosen)

    def chosen_by(self, criterion: str) -> list[int]:
        """Candidates to measure, in order of use.

        Args:
            criterion: "target", "D" or "A".

        Raises:
            BadInput: the criterion is the target's, and it can be differentiated at no point.
        """
        gradients = self.problem.gradients
        if criterion == "target" and not np.any(np.all(np.isfinite(gradients), 1)):
            raise BadInput(
                "the target has no value, or none that can be differentiated, at any point of "
                'equal fit; wanted another --target, or --criterion "D" or "A"'
            )
        return choose(self.problem, self.limits.number, criterion, self.limits.time_s)


def expected_of(sigmas: FloatArray) -> Expected:
    """At the given point, on (geometric) average and at worst over points of equal fit.

    Args:
        sigmas: expected standard deviations at the points, the given one first, shape (k,).
    """
    known = sigmas[np.isfinite(sigmas)]
    if not known.size:
        return Expected(float("nan"), float("nan"), float("nan"))
    return Expected(float(sigmas[0]), float(np.exp(np.mean(np.log(known)))), float(np.max(known)))


def weigh(
    bound: BoundCampaign,
    workers: Workers,
    ways: Sequence[Limits],
    goal: DesignGoal,
    progress: Callable[[str], None] = lambda state: None,
    also: Sequence[BoundCampaign] = (),
) -> tuple[Weighed, ...]:
    """Information of the data so far and of every candidate of several ways to continue them.

    The campaign is the one to be continued; what was measured in others (`also`, of the same FMU
    and parameters, each with a scale of its own) counts as known. The problems of all ways have the
    same variables and base: the parameters, the scale of the data so far, and what the new
    measurements of each way have in common, so that candidates of several can be joined.

    Args:
        bound: the campaign to be continued.
        workers: of its FMU.
        ways: limits of the instrument, of each way.
        goal: the target and where it is to be known.
        progress: is called with a line of what is under way.
        also: further campaigns that have been measured.

    Raises:
        BadInput: an unknown target, no candidate within the limits, or another campaign with other
            parameters.
        FmuFailure: the FMU failed.
    """
    names = (*(parameter.name for parameter in bound.parameters), *bound.derived)
    if goal.target not in names:
        hint = did_you_mean(goal.target, names)
        raise BadInput(f"{bound.path}: target '{goal.target}' is neither fitted nor derived{hint}")
    refined = any(way.sweeps is not None or way.traces is not None for way in ways)
    data = Series(bound, workers, refined=refined)
    series = (data, *(_alike(other, data) for other in also))
    known = _known(series, goal, ways, progress)
    progress("candidates")
    return tuple(
        _weighed(data, limits, known, own) for limits, own in zip(ways, known.own, strict=True)
    )


def _alike(other: BoundCampaign, data: Series) -> Series:
    """Another campaign's data, in the search vector of the first."""
    bound = data.bound
    names, wanted = ({p.name for p in b.parameters} for b in (other, bound))
    if names != wanted:
        raise BadInput(
            f"{other.path}: fits {', '.join(sorted(names))}, but {bound.path} fits "
            f"{', '.join(sorted(wanted))}; wanted the same parameters"
        )
    same = replace(other, parameters=bound.parameters, alternatives=bound.alternatives)
    return Series(same, data.workers, refined=data.refined)


def _known(
    series: tuple[Series, ...],
    goal: DesignGoal,
    ways: Sequence[Limits],
    progress: Callable[[str], None],
) -> Known:
    """Points of equal fit, and what the data so far determine of the target at some of them."""
    data, parameters = series[0], series[0].bound.parameters
    prior = prior_sigmas_in_box(parameters)
    errors = {name: sigma for way in ways for name, sigma in way.setting_sigmas.items()}
    progress("points of equal fit")
    start, given, others = _equal_fits(series, goal, prior, errors)
    spread_values = _values(data, goal.target, [given, *others])
    useful = [p for p, v in zip(others, spread_values[1:], strict=True) if np.isfinite(v)]
    eligible = useful if goal.criterion == "target" else others
    places = spread_out(parameters, given, eligible, PLACES, prior)
    progress(f"{len(others)} points of equal fit; what the data determine at {len(places)} of them")
    # what the new measurements of each way share, of which the data so far say nothing
    new = [_shared(data.bound, way) for way in ways]
    fitted = any(parameter.role == "scale" for parameter in parameters)
    scale = KNOWN if fitted else max(data.scale_sigma, KNOWN)
    unit = np.append(prior, [scale, *(sigma for each in new for sigma in each)])
    ends = np.cumsum([len(prior) + 1, *map(len, new)])
    base = np.zeros((len(places), unit.size, unit.size))
    known = len(prior) + 1
    for k, place in enumerate(places):
        base[k, :known, :known] = _information_at(series, place, errors)
    gradients = np.zeros((len(places), unit.size))
    gradients[:, : len(prior)] = _gradients(data, goal.target, places) * prior
    return Known(
        places=tuple(places),
        unit=unit,
        own=tuple(np.arange(first, last) for first, last in pairwise(ends)),
        base=np.eye(unit.size) + base * np.outer(unit, unit),
        gradients=gradients,
        values=_values(data, goal.target, places),
        spread_values=spread_values,
        start_fit=start,
    )


def _shared(bound: BoundCampaign, limits: Limits) -> list[float]:
    """Prior standard deviations of what all new measurements share: a phase, a scale, a gain."""
    if limits.sweeps is not None:
        return shared_sigmas(required(bound, SWEEPS))
    return [ANY_PHASE] if limits.phases else []


def _information_at(
    series: Sequence[Series], place: Place, errors: Mapping[str, float]
) -> FloatArray:
    """Information (n + 1, n + 1) of all data at a place; only the first shares its scale."""
    steps, (first, *others) = series[0].steps(), series
    total = np.array(first.linearised(place, steps, errors).information)
    for other in others:
        rows = other.linearised(place, steps, errors)
        covariance = rows.covariance.beside(other.scale_sigma * rows.columns[:, -1])
        total[:-1, :-1] += information(rows.columns[:, :-1], covariance)
    return total


def _equal_fits(
    series: tuple[Series, ...], goal: DesignGoal, prior: FloatArray, errors: dict[str, float]
) -> tuple[StartFit, Place, list[Place]]:
    """Where it sets out, the given point (that, or the one asked for), and others of equal fit."""
    bound = series[0].bound
    lower, upper = search_bounds(bound.parameters)
    alternative, x = bound.alternatives[0], np.zeros(len(prior))
    if goal.start is not None:
        alternative, x = goal.start[0], to_search(bound.parameters, goal.start[1])
    start = Place(alternative, np.clip(x, lower, upper))
    # a point that was asked for is kept, also where it fits badly: nothing else is searched
    seed = goal.seed if goal.start is None else None
    first = start_fit(series, start, prior, errors, seed)
    data, given = first.data, first.fitted
    others: list[Place] = []
    for k, alternative in enumerate(bound.alternatives):
        here = given
        if alternative != given.place.alternative:
            here = data.nearest_fit(Place(alternative, given.place.x))
            others.append(here.place)
        others += [fit.place for fit in equal_fits(data, here, goal.seed + k)]
    return first, (given.place if goal.start is None else start), others


def _gradients(data: Series, target: str, places: Sequence[Place]) -> FloatArray:
    """Gradients of the target in x, (k, n), by central differences; NaN where it has none."""
    parameters = data.bound.parameters
    names = [parameter.name for parameter in parameters]
    if target in names:
        gradients = np.zeros((len(places), len(names)))
        gradients[:, names.index(target)] = parameters[names.index(target)].scale
        return gradients
    around = [central(place.x, GRADIENT_STEP, *search_bounds(parameters)) for place in places]
    pairs = list(zip(places, around, strict=True))
    nodes = [Place(place.alternative, x) for place, each in pairs for x in each.nodes]
    values = iter(_values(data, target, nodes))
    return np.stack([each.quotients([next(values) for _ in each.nodes]) for each in around])


def _values(data: Series, target: str, places: Sequence[Place]) -> FloatArray:
    """The target at every place, a derived output as its mean over the experiments; NaN: none."""
    parameters = data.bound.parameters
    names = [parameter.name for parameter in parameters]
    if target in names:
        each = [canonical(parameters, to_model(parameters, p.x)) for p in places]
        return np.array([p[names.index(target)] for p in each])
    values = np.full(len(places), np.nan)
    for alternative in data.bound.alternatives:
        here = [k for k, place in enumerate(places) if place.alternative == alternative]
        if here:
            xs = [places[k].x for k in here]
            values[here] = output_means(data.response(alternative), parameters, xs)[target]
    return values


def _weighed(data: Series, limits: Limits, known: Known, own: IntArray) -> Weighed:
    """Candidates of one way that show and that the detector bears, and their information.

    `own` are the places of what the new measurements have in common.
    """
    steps, place = data.steps(), known.places[0]
    made: ToneCandidates | SweepCandidates | RecordingCandidates
    if limits.sweeps is not None:
        made = SweepCandidates(data, limits, steps)
    elif limits.traces is not None:
        made = RecordingCandidates(data, limits, place, steps)
    else:
        made = ToneCandidates(data, limits, place, steps)
    setups, shown = made.choices, place.x.size
    index = np.append(np.arange(shown + 1), own)
    gains = np.zeros((len(limits.repeats), len(known.places), len(setups), *known.base.shape[1:]))
    shows = np.zeros((len(limits.repeats), len(known.places), len(setups)), dtype=bool)
    borne, positive = np.zeros(len(setups), dtype=bool), np.ones(len(setups), dtype=bool)
    peaks: list[FloatArray] = []
    for rank, each in enumerate(known.places):
        begin = 0
        for rows in made.rows(each):
            mine = slice(begin, begin + len(rows.values))
            begin = mine.stop
            # of sweeps and recordings the largest value counts, of tones every one
            sizes = rows.peaks if isinstance(made, ToneCandidates) else _largest(rows.peaks)
            positive[mine] &= np.all(sizes > 0.0, axis=1)
            if rank == 0:
                peaks += list(sizes)
                borne[mine] = np.max(sizes, axis=1) <= limits.largest_v
            for k, count in enumerate(limits.repeats):
                noise = limits.sigmas(rows.peaks, count)
                of_sizes = limits.sigmas(sizes, count)
                if made.noise is not None:
                    noise = of_sizes = made.noise[mine, np.newaxis]
                shows[k, rank, mine] = np.all(sizes >= LEAST_SIGNAL * of_sizes, axis=1)
                gains[k, rank, mine][:, index[:, np.newaxis], index] = rows.information(noise)
    unit = known.unit
    measurable = (np.mean(shows, axis=1) >= 0.5) & positive & borne  # (repeats, setups)
    which = [(k, i) for k in range(len(limits.repeats)) for i in np.flatnonzero(measurable[k])]
    if not which:
        refused = ", or a fit would refuse it, as a decay of less than a period"
        raise BadInput(
            f"none of {len(setups)} setups can be measured: every peak is below {LEAST_SIGNAL:g} "
            "standard deviations of the noise or above the largest amplitude"
            + refused
            * (limits.traces is not None)
        )
    setup_of, repeats = [int(i) for _, i in which], [limits.repeats[k] for k, _ in which]
    efforts = np.array([_effort(setups[i]) for i in setup_of])
    pairs = zip(setup_of, repeats, strict=True)
    seconds = np.array([limits.takes_s(setups[i], count) for i, count in pairs])
    chosen = [gains[k, :, i] for k, i in which]
    problem = DesignProblem(
        base=known.base,
        gains=np.stack(chosen, axis=1) * np.outer(unit, unit),
        gradients=known.gradients,
        shown=shown,
        # of two that take as long the gentler drive, or fewer samples, come first
        costs=seconds * (1.0 + 1e-6 * efforts / efforts.max()),
        once=limits.sweeps is not None,
    )
    return Weighed(
        known=known,
        limits=limits,
        problem=problem,
        setups=tuple(setups),
        repeats=tuple(repeats),
        setup_of=tuple(setup_of),
        peaks=peaks,
        linear=made.linear,
        noise=made.noise,
    )


def _largest(peaks: FloatArray) -> FloatArray:
    largest: FloatArray = np.max(peaks, axis=1, keepdims=True)
    return largest


def _effort(choice: DriveChoice) -> float:
    """What is rather spared of what takes as long: drive, samples."""
    return choice.level if choice.recording is None else float(choice.recording.samples)
