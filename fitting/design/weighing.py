"""Which measurement next: candidates within the instrument's limits, weighed through the FMU.

The point is not known where a design is needed most. So it is judged at the given point and, since
data that do not determine the parameters are fitted as well elsewhere, at points of equal fit far
from it; the choice is the best on average (geometric mean of the expected standard deviations).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fitting.design.choice import DesignProblem, choose, target_sigmas
from fitting.design.continued import SWEEPS, required
from fitting.design.information import (
    Place,
    Series,
    StartFit,
    equal_fits,
    prior_sigmas_in_box,
    spread_out,
    start_fit,
)
from fitting.design.limits import Limits
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
from fitting.text.arguments import checked
from fitting.text.arrays import FloatArray, IntArray, Scalar
from fitting.text.choices import CRITERIA
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
#: An alternative and the parameters (n,) in their units.
Start = tuple[Mapping[str, Scalar], FloatArray]


@checked
@dataclass(frozen=True)
class Goal:
    """Purpose of the next measurements.

    Args:
        target: A parameter or derived output; empty: the campaign's, else its first output.
        criterion: "target": error of the target; "D" or "A" of all parameters; empty: the
            campaign's, else "target".
        number: Most measurements, 1 to 50; None: the limits'.
        seed: Of points that fit equally well, at least 0.
        time_s: Time for all measurements, s; None: the limits'.

    Raises:
        BadInput: a criterion, number, seed or time that there is not.
    """

    target: str = ""
    criterion: str = ""
    number: int | None = None
    seed: int = 1
    time_s: float | None = None

    def __post_init__(self) -> None:
        if self.criterion and self.criterion not in CRITERIA:
            raise BadInput(
                f"goal: criterion {self.criterion!r}, wanted one of {', '.join(CRITERIA)}"
            )
        if self.seed < 0:
            raise BadInput(f"goal: seed {self.seed}, wanted at least 0")
        if self.time_s is not None and not 0.0 < self.time_s < math.inf:
            raise BadInput(f"goal: time_s {self.time_s}, wanted a positive number of seconds")


@dataclass(frozen=True, kw_only=True)
class Known:
    """What is known before anything new is measured, at the `places` where a design is judged.

    `values` (k,) of the target there, `spread_values` at all points of equal fit, in its unit;
    `start_fit` is the fit set out from.
    """

    places: tuple[Place, ...]
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
    proportional to the drive level. `chosen` are the candidates to be measured, in order of use.
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
    chosen: tuple[int, ...] = ()

    def sigmas(self, chosen: Sequence[int], *, and_each: bool = False) -> FloatArray:
        """Expected standard deviation of the target at every place, no more than its spread.

        Args:
            chosen: candidates that are measured.
            and_each: with each of all candidates added to these, shape (candidates, places).
        """
        information = self.problem.information(chosen)
        if and_each:
            information = information + np.swapaxes(self.problem.gains, 0, 1)
        sigmas = target_sigmas(self.problem, information)
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

    def choosing(self, criterion: str) -> Weighed:
        """The same with the best candidates chosen.

        Args:
            criterion: "target", "D" or "A".

        Raises:
            BadInput: the criterion is the target's, and it can be differentiated at no point.
        """
        gradients, limits = self.problem.gradients, self.limits
        if criterion == "target" and not np.any(np.all(np.isfinite(gradients), 1)):
            raise BadInput(
                "the target has no value, or none that can be differentiated, at any point of "
                'equal fit; wanted another --target, or --criterion "D" or "A"'
            )
        chosen = choose(self.problem, limits.number, criterion, limits.time_s)
        return replace(self, chosen=tuple(chosen))


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
    bounds: Sequence[BoundCampaign],
    workers: Workers,
    ways: Sequence[Limits],
    goal: Goal,
    start: Start | None = None,
    progress: Callable[[str], None] = lambda state: None,
) -> tuple[Weighed, ...]:
    """Information of the data so far and of every candidate of several ways to continue them.

    The problems of all ways have the same variables and base: the parameters, the scale of the data
    so far, and what the new measurements of each way have in common, so that candidates of several
    can be joined.

    Args:
        bounds: the campaign to be continued, and others of the same FMU and parameters, each with a
            scale of its own, whose data count as known.
        workers: of the FMU.
        ways: limits of the instrument, of each way.
        goal: the target, its criterion and the seed of points of equal fit.
        start: where it is to be known, an alternative and the parameters (n,) in their units; None:
            at the fit that is nearest to the references.
        progress: is called with a line of what is under way.

    Raises:
        BadInput: an unknown target, no candidate within the limits, or another campaign with other
            parameters.
        FmuFailure: the FMU failed.
    """
    bound, parameters = bounds[0], bounds[0].parameters
    names = (*(parameter.name for parameter in parameters), *bound.derived)
    if goal.target not in names:
        hint = did_you_mean(goal.target, names)
        raise BadInput(f"{bound.path}: target '{goal.target}' is neither fitted nor derived{hint}")
    refined = any(way.sweeps is not None or way.traces is not None for way in ways)
    data = Series(bound, workers, refined=refined)
    series = (data, *(_alike(each, data) for each in bounds[1:]))
    prior = prior_sigmas_in_box(parameters)
    errors = {name: sigma for way in ways for name, sigma in way.setting_sigmas.items()}
    progress("points of equal fit")
    first, given, alike = _equal_fits(series, goal, start, prior, errors)
    spread_values = _values(data, goal.target, [given, *alike])
    useful = [p for p, v in zip(alike, spread_values[1:], strict=True) if np.isfinite(v)]
    eligible = useful if goal.criterion == "target" else alike
    places = spread_out(parameters, given, eligible, PLACES, prior)
    progress(f"{len(alike)} points of equal fit; what the data determine at {len(places)} of them")
    known = Known(
        places=tuple(places),
        values=_values(data, goal.target, places),
        spread_values=spread_values,
        start_fit=first,
    )
    # what the new measurements of each way share, of which the data so far say nothing
    shared = [
        [ANY_PHASE] * way.phases if way.sweeps is None else shared_sigmas(required(bound, SWEEPS))
        for way in ways
    ]
    is_fitted = any(parameter.role == "scale" for parameter in parameters)
    scale = KNOWN if is_fitted else max(data.scale_sigma, KNOWN)
    unit = np.concatenate([prior, [scale], *shared])
    so_far = prior.size + 1
    base = np.zeros((len(places), unit.size, unit.size))
    base[:, :so_far, :so_far] = [_information_at(series, place, errors) for place in places]
    gradients = np.zeros((len(places), unit.size))
    gradients[:, : prior.size] = _gradients(data, goal.target, places) * prior
    problem = DesignProblem(
        base=np.eye(unit.size) + base * np.outer(unit, unit),
        gains=np.zeros((len(places), 0, unit.size, unit.size)),
        gradients=gradients,
        shown=prior.size,
        costs=np.zeros(0),
    )
    progress("candidates")
    own = pairwise(np.cumsum([so_far, *map(len, shared)]))
    return tuple(
        _weighed(data, limits, known, problem, unit, np.arange(*ends))
        for limits, ends in zip(ways, own, strict=True)
    )


def _alike(other: BoundCampaign, data: Series) -> Series:
    """Another campaign's data, in the search vector of the first and with its steps."""
    bound = data.bound
    names, wanted = ({p.name for p in b.parameters} for b in (other, bound))
    if names != wanted:
        raise BadInput(
            f"{other.path}: fits {', '.join(sorted(names))}, but {bound.path} fits "
            f"{', '.join(sorted(wanted))}; wanted the same parameters"
        )
    same = replace(other, parameters=bound.parameters, alternatives=bound.alternatives)
    return Series(same, data.workers, refined=data.refined, steps=data.steps)


def _information_at(
    series: Sequence[Series], place: Place, errors: Mapping[str, float]
) -> FloatArray:
    """Information (n + 1, n + 1) of all data at a place; only the first shares its scale."""
    first, *others = series
    total = np.array(first.linearised(place, errors).information)
    for other in others:
        rows = other.linearised(place, errors)
        covariance = rows.covariance.beside(other.scale_sigma * rows.columns[:, -1])
        total[:-1, :-1] += information(rows.columns[:, :-1], covariance)
    return total


def _equal_fits(
    series: tuple[Series, ...],
    goal: Goal,
    start: Start | None,
    prior: FloatArray,
    errors: dict[str, float],
) -> tuple[StartFit, Place, list[Place]]:
    """Where it sets out, the given point (that, or the one asked for), and others of equal fit."""
    bound = series[0].bound
    lower, upper = search_bounds(bound.parameters)
    alternative, x = bound.alternatives[0], np.zeros(len(prior))
    if start is not None:
        alternative, x = start[0], to_search(bound.parameters, start[1])
    place = Place(alternative, np.clip(x, lower, upper))
    # a point that was asked for is kept, also where it fits badly: nothing else is searched
    first = start_fit(series, place, prior, errors, goal.seed if start is None else None)
    data, given = first.data, first.fitted
    others: list[Place] = []
    for k, alternative in enumerate(bound.alternatives):
        here = given
        if alternative != given.place.alternative:
            here = data.nearest_fit(Place(alternative, given.place.x))
            others.append(here.place)
        others += [fit.place for fit in equal_fits(data, here, goal.seed + k)]
    return first, (given.place if start is None else place), others


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


def _weighed(
    data: Series,
    limits: Limits,
    known: Known,
    nothing: DesignProblem,
    unit: FloatArray,
    own: IntArray,
) -> Weighed:
    """Candidates of one way that show and that the detector bears, and their information.

    They are added to `nothing`, a problem without candidates, whose variables have the standard
    deviations `unit`; `own` are the places of what the new measurements have in common.
    """
    place = known.places[0]
    made: ToneCandidates | SweepCandidates | RecordingCandidates
    if limits.sweeps is not None:
        made = SweepCandidates(data, limits)
    elif limits.traces is not None:
        made = RecordingCandidates(data, limits, place)
    else:
        made = ToneCandidates(data, limits, place)
    setups, index = made.choices, np.append(np.arange(nothing.shown + 1), own)
    counts = (len(limits.repeats), len(known.places), len(setups))
    gains, shows = np.zeros((*counts, unit.size, unit.size)), np.zeros(counts, dtype=bool)
    allowed, peaks = np.ones(len(setups), dtype=bool), list[FloatArray]()
    for rank, each in enumerate(known.places):
        begin = 0
        for rows in made.rows(each):
            mine = slice(begin, begin + len(rows.values))
            begin = mine.stop
            # of sweeps and recordings the largest value counts, of tones every one
            sizes = rows.peaks
            if not isinstance(made, ToneCandidates):
                sizes = np.max(sizes, axis=1, keepdims=True)
            allowed[mine] &= np.all(sizes > 0.0, axis=1)
            if rank == 0:
                peaks += list(sizes)
                allowed[mine] &= np.max(sizes, axis=1) <= limits.largest_v
            for k, count in enumerate(limits.repeats):
                noise, of_sizes = (limits.sigmas(v, count) for v in (rows.peaks, sizes))
                if made.noise is not None:
                    noise = of_sizes = made.noise[mine, np.newaxis]
                shows[k, rank, mine] = np.all(sizes >= LEAST_SIGNAL * of_sizes, axis=1)
                gains[k, rank, mine][:, index[:, np.newaxis], index] = rows.information(noise)
    ranks, which = np.nonzero((np.mean(shows, axis=1) >= 0.5) & allowed)
    if not which.size:
        refused = ", or a fit would refuse it, as a decay of less than a period"
        raise BadInput(
            f"none of {len(setups)} setups can be measured: every peak is below {LEAST_SIGNAL:g} "
            "standard deviations of the noise or above the largest amplitude"
            + refused
            * (limits.traces is not None)
        )
    repeats = [limits.repeats[k] for k in ranks]
    # of two that take as long the gentler drive, or fewer samples, come first
    efforts = np.array([c.level if (r := c.recording) is None else r.samples for c in setups])
    seconds = [limits.takes_s(setups[i], n) for i, n in zip(which, repeats, strict=True)]
    problem = replace(
        nothing,
        gains=np.swapaxes(gains[ranks, :, which], 0, 1) * np.outer(unit, unit),
        costs=np.array(seconds) * (1.0 + 1e-6 * efforts[which] / efforts[which].max()),
        once=limits.sweeps is not None,
    )
    return Weighed(
        known=known,
        limits=limits,
        problem=problem,
        setups=tuple(setups),
        repeats=tuple(repeats),
        setup_of=tuple(map(int, which)),
        peaks=peaks,
        linear=made.linear,
        noise=made.noise,
    )
