"""Which changes the data do not constrain: directions, parameters without effect, equal fits.

A direction has a finite change: the model was evaluated there, at the very numbers that are
printed, and the largest move of any row is given.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import canonical, search_bounds, to_model, to_search
from fitting.fit.levenberg import Expansion, Goal, minimise
from fitting.fit.likelihood import Exhausted, Likelihood, LikelihoodEvaluator, Request
from fitting.fit.optimum import Optimum
from fitting.fit.search import SAME as SAME_MINIMUM
from fitting.fit.search import Box
from fitting.fit.twins import Twin
from fitting.inference.likelihood.knowledge import STOPPED, Direction, Equivalent, Profile
from fitting.inference.likelihood.profile import Scans
from fitting.text.arrays import FloatArray
from fitting.text.estimate import FittedEstimate, Verdict
from fitting.text.finding import Finding, Kind, note

#: A direction counts as unseen where half a box along it moves the rows by less than one sigma.
UNSEEN = 1.0
#: Largest move of any row, in sigma, that is still called no change; for idle parameters likewise.
NO_CHANGE, IDLE = 0.01, 0.1
#: Shares of the box that are tried as a change, the largest first; chi square to which it is
#: brought back onto the rows.
SHARES, RETURNED = (0.05, 0.01), 1e-6
#: Share of the box that is no change.
TRIFLE = 1e-6
#: Statuses that no further scan would change.
FINAL = (Verdict.UNCONSTRAINED, Verdict.WITHDRAWN)
#: Points closer than this share of the box are one minimum.
SAME = 0.02


def directions(evaluator: LikelihoodEvaluator, optimum: Optimum) -> tuple[Direction, ...]:
    """Singular directions of the whitened sensitivities, unseen ones with a change that was tried.

    Singular values are those of J diag(scale): sigma per unit of x. A direction is unseen where
    half the box along it, as far as the linearisation holds, stays below one sigma.

    Args:
        evaluator: of the likelihood; counts what is evaluated.
        optimum: the most likely point and its likelihood.
    """
    likelihood, expansion = optimum.likelihood, optimum.expansion
    m = likelihood.data_rows
    matrix = expansion.matrix[:m] * likelihood.inflation  # of the stated noise
    _, singular, rows = np.linalg.svd(matrix, full_matrices=matrix.shape[0] < matrix.shape[1])
    values = np.zeros(rows.shape[0])
    values[: singular.size] = singular
    names = [p.name for p in likelihood.parameters]
    led = [row * np.sign(row[int(np.argmax(np.abs(row)))]) for row in rows]
    shares = [
        v / float(np.max(np.abs(row) / likelihood.widths))
        for v, row in zip(values, led, strict=True)
    ]
    open_ = [k for k, share in enumerate(shares) if 0.5 * share < UNSEEN]
    tried = _unseen(evaluator, optimum, {k: led[k] for k in open_})
    found = []
    for k, row in enumerate(led):
        change = tried.get(k)
        by = np.zeros(len(names)) if change is None else change.by
        found.append(
            Direction(
                singular=float(values[k]),
                share=float(shares[k]),
                vector=dict(zip(names, map(float, row), strict=True)),
                change={name: float(v) for name, v in zip(names, by, strict=True) if v},
                largest=math.nan if change is None else change.largest,
            )
        )
    return tuple(found)


@dataclass(frozen=True)
class _Change:
    """A change of parameters, (n,) in their units, and by how many sigma it moves a row at most."""

    by: FloatArray
    largest: float


def _met_exactly(optimum: Optimum) -> Likelihood:
    """The likelihood of data that the model meets exactly at the optimum, and of priors there."""
    likelihood = optimum.likelihood
    left = likelihood.residuals(optimum.expansion.sample.rows[: likelihood.data_rows])
    return replace(
        likelihood, shift=likelihood.shift + left, prior_shift=np.array(optimum.expansion.x)
    )


def _unseen(
    evaluator: LikelihoodEvaluator, optimum: Optimum, rows: Mapping[int, FloatArray]
) -> dict[int, _Change]:
    """A change along each unseen direction that moves nothing, or least of those that were tried.

    Each is followed by shares of the box, brought back onto the rows, rounded, and evaluated.
    """
    exact, here = _met_exactly(optimum), optimum.expansion
    begins: list[tuple[int, FloatArray]] = []
    for k, row in rows.items():
        lead = int(np.argmax(np.abs(row) / exact.widths))
        for size in SHARES:
            for sign in (1.0, -1.0):
                x = here.x + sign * size * exact.widths[lead] / abs(row[lead]) * row
                if np.all(x >= exact.lower) and np.all(x <= exact.upper):
                    begins.append((k, x))
    best: dict[int, _Change] = {}
    if not begins:
        return best
    try:
        with evaluator.of(exact):
            [samples] = evaluator([Request(tuple(x for _, x in begins), outputs=False)])
            begun = [Expansion(sample, here.matrix, here.outward, age=1) for sample in samples]
            goal = Goal(promise=RETURNED, confirmed=False)
            ends = minimise(evaluator, begun, goal=goal)
            changes = [
                (k, change)
                for (k, _), end in zip(begins, ends, strict=True)
                if end.reached
                for change in _changes(optimum, end.end.x)
            ]
            if not changes:
                return best
            p = to_model(exact.parameters, here.x)
            places = tuple(to_search(exact.parameters, p + change) for _, change in changes)
            [samples] = evaluator([Request(places, outputs=False)])
    except Exhausted:
        return best
    # the largest step first: one that moves nothing stands
    for (k, change), sample in zip(changes, samples, strict=True):
        largest = _largest_move(exact, sample.rows)
        known = best.get(k)
        if known is None or known.largest > max(NO_CHANGE, largest):
            best[k] = _Change(change, largest)
    return best


def _changes(optimum: Optimum, there: FloatArray) -> list[FloatArray]:
    """A change of parameters, in their units, with few digits and with more; none back at home."""
    likelihood, x = optimum.likelihood, optimum.expansion.x
    by = to_model(likelihood.parameters, there) - to_model(likelihood.parameters, x)
    by[np.abs(there - x) < TRIFLE * likelihood.widths] = 0.0
    if not np.any(by):
        return []
    return [np.array([_rounded(v, digits) for v in by]) for digits in (2, 3, 4)]


def _largest_move(exact: Likelihood, rows: FloatArray) -> float:
    """Largest change of any row of data that the optimum meets exactly, in sigma of that row."""
    # in the noise as it is stated, whatever errors are widened by
    white = rows[: exact.data_rows]
    return float(np.max(np.abs(exact.residuals(white)) / exact.noise.row_sigma))


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits - 1}e}") if math.isfinite(value) else value


def without_effect(
    evaluator: LikelihoodEvaluator, optimum: Optimum, values: Mapping[str, FittedEstimate]
) -> tuple[str, ...]:
    """Parameters that alone, anywhere in the box, move no row by a tenth of a sigma; evaluated.

    Args:
        evaluator: of the likelihood; counts what is evaluated.
        optimum: the most likely point and its likelihood.
        values: by name.
    """
    likelihood, x = optimum.likelihood, optimum.expansion.x
    exact = _met_exactly(optimum)
    lower, _ = search_bounds(likelihood.parameters)
    idle = []
    for i, parameter in enumerate(likelihood.parameters):
        own = values.get(parameter.name)
        if own is None or own.status is not Verdict.UNCONSTRAINED:
            continue
        if float(np.linalg.norm(optimum.expansion.matrix[:, i])) * likelihood.widths[i] > 3.0:
            continue
        width = likelihood.widths[i]
        low = lower[i] if np.isinf(likelihood.periods[i]) else x[i] - 0.5 * width
        moves = []
        for share in (0.0, 0.27, 0.61, 1.0):
            there = x.copy()
            there[i] = low + share * width
            try:
                with evaluator.of(exact):
                    moves.append(_largest_move(exact, evaluator.one(there).rows))
            except Exhausted:
                moves.append(math.inf)
        if max(moves) <= IDLE:
            idle.append(parameter.name)
    return tuple(idle)


def equivalents(scans: Scans) -> tuple[Equivalent, ...]:
    """Separate minima that fit as well: outside what the profiles of the optimum go through.

    Args:
        scans: minima, and both sides of the profiles.
    """
    optimum = scans.optimum
    likelihood = optimum.likelihood
    parameters = likelihood.parameters
    open_ = np.array([_is_open(scans, p.name) for p in parameters])
    kept: list[Equivalent] = []
    places = [optimum.expansion.x]
    for point in sorted(scans.minima, key=lambda each: each.delta):
        gaps = [gap(likelihood, point.x, other) for other in places]
        if any(not np.any((each > SAME) & ~open_) for each in gaps):
            continue
        if not _beyond(scans, point.x):
            continue
        places.append(point.x)
        shown = canonical(parameters, to_model(parameters, point.x))
        named = {p.name: float(v) for p, v in zip(parameters, shown, strict=True)}
        derived = dict(zip(likelihood.names, map(float, point.outputs), strict=True))
        kept.append(
            Equivalent(
                parameters=named,
                derived=derived,
                delta=max(0.0, point.delta),
                origin="start",
                possible=all(map(math.isfinite, derived.values())),
            )
        )
    return tuple(kept)


def _is_open(scans: Scans, name: str) -> bool:
    """Whether a parameter is free from end to end: then its value tells no two minima apart."""
    if name not in scans.sides:
        return True  # nobody asked how far it can go
    return all(side.closed != "data" for side in scans.sides[name])


def gap(likelihood: Likelihood, one: FloatArray, other: FloatArray) -> FloatArray:
    """Distance of two points along every axis as a share of the box, periods taken off, (n,).

    Args:
        likelihood: with the bounds.
        one: search vector, (n,).
        other: another, (n,).
    """
    apart = np.mod(np.abs(one - other), likelihood.periods)  # those without one are infinite
    return np.asarray(np.minimum(apart, likelihood.periods - apart) / likelihood.widths)


def _beyond(scans: Scans, x: FloatArray) -> bool:
    """Whether a point lies outside the interval of some parameter."""
    likelihood = scans.optimum.likelihood
    for quantity in scans.quantities:
        if quantity.index < 0 or _is_open(scans, quantity.name):
            continue
        down, up = scans.sides[quantity.name]
        low = quantity.low if math.isnan(down.own95) else down.own95
        high = quantity.high if math.isnan(up.own95) else up.own95
        period, at = float(likelihood.periods[quantity.index]), float(x[quantity.index])
        if math.isfinite(period):  # the image next to the optimum
            at -= period * round((at - quantity.best) / period)
        slack = SAME * (high - low)
        if not low - slack <= at <= high + slack:
            return True
    return False


def bound_findings(profiles: Mapping[str, Profile]) -> Iterator[Finding]:
    """Intervals that end where other parameters are at their bounds.

    Args:
        profiles: by name of the value.
    """
    by_bounds: dict[tuple[str, ...], list[str]] = {}
    for name, profile in profiles.items():
        if profile.scan.held:
            by_bounds.setdefault(profile.scan.held, []).append(name)
    for held, names in by_bounds.items():
        yield note(Kind.interval_at_bound, ", ".join(names), {"values": tuple(names), "held": held})


def incomplete_findings(profiles: Mapping[str, Profile]) -> Iterator[Finding]:
    """Profiles whose scans ended before anything closed them, where that leaves a status open.

    Args:
        profiles: by name of the value.
    """
    for why in STOPPED.values():
        names = tuple(
            name
            for name, profile in profiles.items()
            if why in profile.scan.stopped and profile.value.status not in FINAL
        )
        if names:
            yield note(Kind.profiles_incomplete, why, {"values": names})


def with_values_nearby(
    evaluator: LikelihoodEvaluator,
    scans: Scans,
    twins: Sequence[Twin],
    equivalents: Sequence[Equivalent],
) -> tuple[Equivalent, ...]:
    """The equivalents, those counted as possible whose valley has values of every output somewhere.

    Args:
        evaluator: of the likelihood.
        scans: profiles of the optimum.
        twins: exact symmetries of the model.
        equivalents: separate minima of this model.
    """
    parameters, optimum = scans.optimum.likelihood.parameters, scans.optimum
    box = Box(parameters)
    made = []
    for other in equivalents:
        place = to_search(parameters, np.array([other.parameters[p.name] for p in parameters]))
        mine = [
            twin
            for twin in twins
            if not other.possible
            and (image := twin.of(parameters, optimum.expansion.x)) is not None
            and box.apart(image, place) <= SAME_MINIMUM
        ]
        possible = other.possible or any(_has_values(evaluator, twin, scans) for twin in mine)
        made.append(replace(other, possible=possible))
    return tuple(made)


def _has_values(evaluator: LikelihoodEvaluator, twin: Twin, scans: Scans) -> bool:
    """Whether every output exists at the image of some point that fits."""
    parameters = evaluator.likelihood.parameters
    near = [scans.optimum.expansion.x, *(point.x for point in scans.shared)]
    near += [point.x for sides in scans.sides.values() for side in sides for point in side.points]
    images = tuple(image for x in near if (image := twin.of(parameters, x)) is not None)
    if not images:
        return False
    try:
        samples = evaluator([Request(images, rows=False)])[0]
    except Exhausted:
        return False
    return any(bool(np.all(np.isfinite(sample.outputs))) for sample in samples)
