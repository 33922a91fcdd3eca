"""Which measurement next: candidates within the instrument's limits, weighed through the FMU.

The point is not known where a design is needed most. So it is judged at the given point and, since
data that do not determine the parameters are fitted as well elsewhere, at points of equal fit far
from it; the choice is the best on average (geometric mean of the expected standard deviations).

The choice is greedy and by exchanges, on sums of information matrices:

    F(S) = F_0 + sum of F_c over the chosen c in S,      C = F^-1 without the nuisances

at each of several points, since the point is not known. A criterion is the logarithm of a standard
deviation, averaged over the points, so that differences read as ratios of errors:

    D: ln det C/(2 n)      A: ln(tr C/n)/2      target: ln(g^T C g)/2, g the gradient of the target

D is submodular; A and target are not: two measurements may be worth something only together. Every
candidate is therefore weighed anew in every step (one batch of small inverses), where a lazy greedy
search would trust gains from before; and exchanges follow the greedy choice.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from fitting.design.candidates import candidates_of
from fitting.design.information import (
    DataSoFar,
    Place,
    StartFit,
    WhitenedData,
    equal_fits,
    prior_sigmas_in_box,
    spread_out,
    start_fit,
)
from fitting.design.limits import Limits
from fitting.design.result import DriveChoice, Expected
from fitting.extension.problem import (
    RowCovariance,
    canonical,
    central,
    information,
    output_means,
    search_bounds,
)
from fitting.text.arguments import checked
from fitting.text.arrays import FloatArray
from fitting.text.choices import CRITERIA
from fitting.text.errors import BadInput, FmuFailure, did_you_mean

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
#: How much of the best criterion (a ratio of errors) may be given up for cheaper measurements.
AS_GOOD = 0.02
#: An exchange has to gain at least this much; rounds of exchanges; a share of a time that is none.
LEAST_GAIN, ROUNDS, NO_TIME = 1e-6, 50, 1e-5


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
        if self.time_s is not None and not 0.0 < self.time_s < np.inf:
            raise BadInput(f"goal: time_s {self.time_s}, wanted a positive number of seconds")


@dataclass(frozen=True, kw_only=True)
class Known:
    """What is known before anything new is measured, at the `places` where a design is judged.

    `values` (k,) of the target there and its `gradients` (k, n) in x, `spread_values` at all points
    of equal fit, in its unit; `start_fit` is the fit set out from. `information` (k, n + 1, n + 1)
    of the data in x and the scale's logarithm, whose standard deviations without them are `prior`.
    """

    data: DataSoFar
    goal: Goal
    places: tuple[Place, ...]
    values: FloatArray
    gradients: FloatArray
    spread_values: FloatArray
    start_fit: StartFit
    is_given: bool
    information: FloatArray
    prior: FloatArray

    @property
    def spread(self) -> float:
        """Standard deviation of the target over points of equal fit; infinite for too few."""
        known = self.spread_values[np.isfinite(self.spread_values)]
        return float(np.std(known)) if known.size >= ENOUGH else float("inf")


def known_of(
    data: DataSoFar,
    goal: Goal,
    start: Place | None = None,
    search: Callable[[], Place] | None = None,
    progress: Callable[[str], None] = lambda state: None,
) -> Known:
    """The points at which a design is judged, and what the data so far determine there.

    Args:
        data: so far.
        goal: the target, its criterion and the seed of points of equal fit.
        start: where the target is to be known; None: at the fit that is nearest to the references.
        search: finds the best fit in the whole box, for where noise does not explain that one.
        progress: is called with a line of what is under way.

    Raises:
        BadInput: an unknown target.
        FmuFailure: the FMU failed.
    """
    bound, parameters, alternatives = data.bound, data.parameters, data.problem.alternatives
    names = (*(parameter.name for parameter in parameters), *bound.derived)
    if goal.target not in names:
        hint = did_you_mean(goal.target, names)
        raise BadInput(f"{bound.path}: target '{goal.target}' is neither fitted nor derived{hint}")
    progress("points of equal fit")
    prior = prior_sigmas_in_box(parameters)
    place = start or Place(alternatives[0], np.zeros(prior.size))
    place = replace(place, x=np.clip(place.x, *search_bounds(parameters)))
    first, alike = start_fit(data, place, prior), list[Place]()
    if first.inflation > 1.0 and start is None and search is not None:
        progress("a fit")
        with suppress(FmuFailure):  # next to the best fit the FMU may refuse its parameters
            first = start_fit(data, search(), prior)
    # a point that was asked for is kept, also where it fits badly
    given = first.fitted.place if start is None else place
    for k, alternative in enumerate(alternatives):
        here = first.fitted
        if alternative != here.place.alternative:
            here = first.data.nearest_fit(Place(alternative, here.place.x))
            alike.append(here.place)
        alike += [fit.place for fit in equal_fits(first.data, here, goal.seed + k)]
    spread_values = target_values(data, goal.target, [given, *alike])
    useful = np.isfinite(spread_values[1:]) | (goal.criterion != "target")
    eligible = [p for p, is_useful in zip(alike, useful, strict=True) if is_useful]
    places = spread_out(parameters, [given, *eligible], PLACES, prior)
    progress(f"{len(alike)} points of equal fit; what the data determine at {len(places)} of them")
    is_fitted = any(parameter.role == "scale" for parameter in parameters)
    return Known(
        data=data,
        goal=goal,
        places=tuple(places),
        values=target_values(data, goal.target, places),
        gradients=_gradients(data, goal.target, places),
        spread_values=spread_values,
        start_fit=first,
        is_given=start is not None,
        information=np.array([_information(data, p, prior) for p in places]),
        prior=np.append(prior, KNOWN if is_fitted else max(data.scale_sigma, KNOWN)),
    )


def _information(data: DataSoFar, place: Place, prior: FloatArray) -> FloatArray:
    """J^T V^-1 J of the data so far in x and in the logarithm of their scale, (n + 1, n + 1)."""
    white, whole = WhitenedData.weighed_at(data, place, prior), data.problem.data
    [fitted] = white.at([place])
    rows, matrix = (white.covariance.coloured(each) for each in (fitted.rows, fitted.matrix))
    # the scale of what is to be continued stays a variable: the first error that rows share is its
    common = white.covariance.common[:, int(data.scale_sigma > 0.0) :]
    slopes = (rows + whole.measured_rows) * (whole.series_of_rows == 0)
    covariance = RowCovariance(white.covariance.sigma, common)
    return information(np.column_stack([matrix, slopes]), covariance)


def _gradients(data: DataSoFar, target: str, places: Sequence[Place]) -> FloatArray:
    """Gradients of the target in x, (k, n), by central differences; NaN where it has none."""
    names = [parameter.name for parameter in data.parameters]
    if target in names:
        scale = data.parameters[names.index(target)].scale
        return np.tile(scale * (np.array(names) == target), (len(places), 1))
    around = [central(p.x, GRADIENT_STEP, *search_bounds(data.parameters)) for p in places]
    nodes = [
        Place(place.alternative, x)
        for place, each in zip(places, around, strict=True)
        for x in each.nodes
    ]
    values = iter(target_values(data, target, nodes))
    return np.stack([each.quotients([next(values) for _ in each.nodes]) for each in around])


def target_values(data: DataSoFar, target: str, places: Sequence[Place]) -> FloatArray:
    """The target at every place, a derived output as its mean over the experiments; NaN: none.

    Args:
        data: so far.
        target: a parameter or derived output.
        places: of the parameters.
    """
    names = [parameter.name for parameter in data.parameters]
    if target in names:
        table = data.table([place.x for place in places])
        each = [canonical(data.parameters, p) for p in table]
        return np.array(each)[:, names.index(target)]
    values = np.full(len(places), np.nan)
    for alternative in data.problem.alternatives:
        here = [k for k, place in enumerate(places) if place.alternative == alternative]
        response = data.planned.response(alternative)
        response = replace(response, derived={data.series: response.derived[data.series]})
        if here:
            xs = [places[k].x for k in here]
            values[here] = output_means(response, data.parameters, xs)[target]
    return values


@dataclass(frozen=True)
class Candidate:
    """A choice of the drive and a number of spectra, with `peaks` and their noise `sigmas`."""

    choice: DriveChoice
    repeats: int
    peaks: FloatArray
    sigmas: FloatArray


@dataclass(frozen=True, kw_only=True)
class Weighed:
    """Everything that a choice rests on: candidates, and their information.

    `problem` in variables of unit prior variance; `setups` choices were tried; `linear`: amplitudes
    are proportional to the drive level. `chosen` are the candidates to be measured, in order of
    use.
    """

    known: Known
    limits: Limits
    problem: DesignProblem
    candidates: Sequence[Candidate]
    setups: int
    linear: bool
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

    def takes_s(self, chosen: Sequence[int]) -> float:
        """What candidates take of the laboratory, s."""
        each = [self.candidates[i] for i in chosen]
        return sum(self.limits.takes_s(c.choice, c.repeats) for c in each)

    def choosing(self) -> Weighed:
        """The same with the best candidates chosen.

        Raises:
            BadInput: the criterion is the target's, and it can be differentiated at no point; or
                the time is too short for what a campaign must have, of sweeps two.
        """
        gradients, limits = self.problem.gradients, self.limits
        criterion = self.known.goal.criterion
        if criterion == "target" and not np.any(np.all(np.isfinite(gradients), 1)):
            raise BadInput(
                "the target has no value, or none that can be differentiated, at any point of "
                'equal fit; wanted another --target, or --criterion "D" or "A"'
            )
        chosen = choose(self.problem, limits.number, criterion, limits.time_s)
        least = 1 if limits.sweeps is None else 2
        if len(chosen) < least and limits.time_s is not None:
            shortest = self.takes_s([int(np.argmin(self.problem.costs))] * least)
            raise BadInput(
                f"design: {limits.time_s:.6g} s are too short; wanted {shortest:.6g} s at least, "
                f"{'two sweeps' if least > 1 else 'one measurement'}"
            )
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


def weigh(known: Known, limits: Limits) -> Weighed:
    """Candidates that show and that the detector bears, with their information at every place.

    Variables are the parameters, the scale of the data so far, and what the new measurements have
    in common.

    Args:
        known: before anything new is measured.
        limits: of the instrument.

    Raises:
        BadInput: no candidate within the limits, or none that can be measured.
        FmuFailure: the FMU failed.
    """
    made = candidates_of(known.data, limits, known.places[0])
    unit, shown = np.append(known.prior, made.shared), known.prior.size - 1
    counts = (len(limits.repeats), len(known.places), len(made.choices))
    gains, shows = np.zeros((*counts, unit.size, unit.size)), np.zeros(counts, dtype=bool)
    allowed = np.ones(len(made.choices), dtype=bool)
    peaks, sigmas = list[FloatArray](), [list[FloatArray]() for _ in limits.repeats]
    for rank, place in enumerate(known.places):
        begin = 0
        for rows in made.rows(place):
            mine = slice(begin, begin + len(rows.values))
            begin, values = mine.stop, np.abs(rows.values)
            # of sweeps and recordings the largest value counts, of tones every one
            is_of_tones = limits.kind == "tones"
            sizes = values if is_of_tones else np.max(values, axis=1, keepdims=True)
            allowed[mine] &= np.all(sizes > 0.0, axis=1)
            if rank == 0:
                peaks += list(sizes)
                allowed[mine] &= np.max(sizes, axis=1) <= limits.largest_v
            for k, count in enumerate(limits.repeats):
                noise, of_sizes = limits.sigmas(values, count), limits.sigmas(sizes, count)
                if made.noise is not None:
                    noise = of_sizes = made.noise[mine, np.newaxis]
                if rank == 0:
                    sigmas[k] += list(of_sizes)
                shows[k, rank, mine] = np.all(sizes >= LEAST_SIGNAL * of_sizes, axis=1)
                gains[k, rank, mine] = rows.information(noise)
    ranks, which = np.nonzero((np.mean(shows, axis=1) >= 0.5) & allowed)
    if not which.size:
        refused = ", or a fit would refuse it, as a decay of less than a period"
        raise BadInput(
            f"none of {len(made.choices)} setups can be measured: every peak is below "
            f"{LEAST_SIGNAL:g} standard deviations of the noise or above the largest amplitude"
            + refused
            * (limits.traces is not None)
        )
    candidates = [
        Candidate(made.choices[i], limits.repeats[k], peaks[i], sigmas[k][i])
        for k, i in zip(ranks, which, strict=True)
    ]
    # of two that take as long the gentler drive, or fewer samples, come first
    efforts = np.array(
        [c.choice.level if (r := c.choice.recording) is None else r.samples for c in candidates]
    )
    seconds = np.array([limits.takes_s(c.choice, c.repeats) for c in candidates])
    so_far = np.pad(known.information, ((0, 0), *[(0, len(made.shared))] * 2))
    problem = DesignProblem(
        base=np.eye(unit.size) + so_far * np.outer(unit, unit),
        gains=np.swapaxes(gains[ranks, :, which], 0, 1) * np.outer(unit, unit),
        gradients=np.pad(known.gradients, ((0, 0), (0, unit.size - shown))) * unit,
        shown=shown,
        costs=seconds * (1.0 + 1e-6 * efforts / efforts.max()),
        once=limits.sweeps is not None,
    )
    return Weighed(
        known=known,
        limits=limits,
        problem=problem,
        candidates=candidates,
        setups=len(made.choices),
        linear=made.linear,
    )


# --- the choice ---------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class DesignProblem:
    """Information matrices in variables whose prior is of unit variance, at k points.

    `base` (k, n, n) of prior and data so far, positive definite; `gains` (k, c, n, n) of the
    candidates; `gradients` (k, n) of the target, NaN at a point where it has none; `shown` the
    number of leading variables that count for D and A (the rest are nuisances); `costs` (c,).
    `once`: no candidate is measured twice.
    """

    base: FloatArray
    gains: FloatArray
    gradients: FloatArray
    shown: int
    costs: FloatArray
    once: bool = False

    @property
    def candidates(self) -> int:
        """Number of candidates."""
        return int(self.gains.shape[1])

    def information(self, chosen: Sequence[int]) -> FloatArray:
        """F of prior, data and the chosen (repeated where measured again), (k, n, n)."""
        return np.asarray(self.base + self.gains[:, list(chosen)].sum(axis=1))

    def loss(self, chosen: Sequence[int], criterion: str) -> float:
        """The criterion with these candidates measured."""
        return float(losses(self, self.information(chosen), criterion))

    def losses_with(
        self, chosen: Sequence[int], criterion: str, time_s: float | None = None
    ) -> FloatArray:
        """The criterion with each candidate added to the chosen, (c,); inf: it is not allowed.

        Args:
            chosen: candidates.
            criterion: one of `CRITERIA`.
            time_s: that all of them may take, s; None: any.
        """
        information = self.information(chosen) + np.swapaxes(self.gains, 0, 1)
        allowed = ~(self.once & np.isin(np.arange(self.candidates), chosen))
        if time_s is not None:
            rest_s = time_s * (1.0 + NO_TIME) - float(self.costs[list(chosen)].sum())
            allowed &= self.costs <= rest_s
        return np.where(allowed, losses(self, information, criterion), np.inf)


def losses(problem: DesignProblem, information: FloatArray, criterion: str) -> FloatArray:
    """The criterion of matrices (..., k, n, n), averaged over the points, shape (...).

    Points where the target has no gradient are left out of "target".

    Args:
        problem: for gradients and the number of variables.
        information: matrices F, shape (..., k, n, n).
        criterion: one of `CRITERIA`.

    Raises:
        ValueError: an unknown criterion, or no point where the target has a gradient.
    """
    if criterion == "target":
        logs = np.log(target_sigmas(problem, information))
        if not np.any(np.isfinite(logs)):
            raise ValueError("the target has no gradient at any point")
        return np.asarray(np.nanmean(np.where(np.isfinite(logs), logs, np.nan), axis=-1))
    inner = np.linalg.inv(information)[..., : problem.shown, : problem.shown]
    if criterion == "D":
        return np.asarray(np.mean(np.linalg.slogdet(inner)[1], axis=-1) / (2.0 * problem.shown))
    if criterion == "A":
        traces = np.trace(inner, axis1=-2, axis2=-1) / problem.shown
        return np.asarray(np.mean(0.5 * np.log(traces), axis=-1))
    raise ValueError(f"criterion {criterion!r} is none of {', '.join(CRITERIA)}")


def target_sigmas(problem: DesignProblem, information: FloatArray) -> FloatArray:
    """Standard deviation of the target at every point, sqrt(g^T F^-1 g), shape (..., k).

    Args:
        problem: for the gradients.
        information: matrices F, shape (..., k, n, n).
    """
    g = problem.gradients
    known = np.all(np.isfinite(g), axis=-1)
    safe = np.where(known[:, np.newaxis], g, 0.0)
    solved = np.linalg.solve(information, np.broadcast_to(safe, information.shape[:-1])[..., None])
    return np.where(known, np.sqrt(np.einsum("ki,...ki->...k", safe, solved[..., 0])), np.nan)


def choose(
    problem: DesignProblem, number: int, criterion: str, time_s: float | None = None
) -> list[int]:
    """The best candidates, in the order in which each adds the most.

    Filled greedily, by what each candidate adds and, within a time, by what it adds per second, of
    the criterion and of D, which also gathers what is of use only together; each start is bettered
    by exchanges and the best end counts. Without a time there are as many as asked for, and cheaper
    ones replace them as far as 2 % of the criterion pay for that.

    Args:
        problem: candidates, their costs in s, and what is known.
        number: of measurements; within a time at most.
        criterion: one of `CRITERIA`.
        time_s: that they may take together, s; None: any.

    Source: V. Fedorov, Theory of Optimal Experiments (1972), on a finite set with repetition.
    """
    costs, ends = problem.costs, []

    def filled(chosen: Sequence[int], rule: str, seconds: FloatArray) -> list[int]:
        """The chosen with more, up to their number or time, the best by these seconds first."""
        result, value = list(chosen), problem.loss(chosen, rule)
        while len(result) < number:
            each = problem.losses_with(result, rule, time_s)
            best = int(np.argmin((each - value) / seconds))
            # where their number is asked for, one that adds nothing is better than none
            if not each[best] < (np.inf if time_s is None else value - LEAST_GAIN):
                break
            result, value = [*result, best], float(each[best])
        return result

    ways = [np.ones(costs.size)] if time_s is None else [np.ones(costs.size), costs]
    for rule, seconds in itertools.product(dict.fromkeys((criterion, "D")), ways):
        current = filled([], rule, seconds)
        value = problem.loss(current, criterion)
        for _ in range(ROUNDS):
            before = value
            for place in range(len(current)):
                rest = current[:place] + current[place + 1 :]
                each = problem.losses_with(rest, criterion, time_s)
                if float(np.min(each)) < value - LEAST_GAIN:
                    current[place], value = int(np.argmin(each)), float(np.min(each))
            # within a time one may be worth less than several that take its place
            for place, more in itertools.product(range(len(current) * (time_s is not None)), ways):
                other = filled(current[:place] + current[place + 1 :], criterion, more)
                loss = problem.loss(other, criterion)
                if loss < value - LEAST_GAIN:
                    current, value = other, loss
                    break
            if value > before - LEAST_GAIN:
                break
        ends.append((value, current))
    value, best = min(ends, key=lambda end: end[0])
    # without a time cheaper candidates in place of the chosen, as far as the criterion pays
    for place in range(len(best)) if time_s is None else ():
        each = problem.losses_with(best[:place] + best[place + 1 :], criterion)
        allowed = np.where(each <= value + AS_GOOD, costs, np.inf)
        if np.min(allowed) < costs[best[place]]:
            each[allowed > np.min(allowed)] = np.inf
            best[place] = int(np.argmin(each))
    return ordered(problem, best, criterion)


def ordered(problem: DesignProblem, chosen: Sequence[int], criterion: str) -> list[int]:
    """The same candidates, each the best of those that remain after those before it.

    Args:
        problem: candidates, and what is known.
        chosen: some of them.
        criterion: one of `CRITERIA`.
    """
    remaining, order = list(chosen), list[int]()
    while remaining:
        each = problem.losses_with(order, criterion)[remaining]
        order.append(remaining.pop(int(np.argmin(each))))
    return order
