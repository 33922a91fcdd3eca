"""Which changes the data do not constrain: directions, parameters without effect, equal fits.

A direction has a finite change: the model was evaluated there, at the very numbers that are
printed, and the largest move of any row is given.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitting.campaign.parameters import canonical, search_bounds, to_model, to_search
from fitting.fit.levenberg import Expansion, Goal, minimise
from fitting.fit.likelihood import Exhausted, Likelihood, LikelihoodEvaluator, Request
from fitting.fit.optimum import Optimum
from fitting.fit.search import SAME as SAME_MINIMUM
from fitting.fit.search import Box
from fitting.fit.twins import Twin
from fitting.inference.likelihood.knowledge import STOPPED, Direction, Equivalent, Profile
from fitting.inference.likelihood.profile import ScanPoint, Scans, Side
from fitting.text.arrays import FloatArray
from fitting.text.estimate import FittedEstimate, Verdict
from fitting.text.finding import Finding, Kind, note

#: A direction counts as unseen where half a box along it moves the rows by less than one sigma.
UNSEEN = 1.0
#: Digits of the changes that are printed, the fewest first.
DIGITS = (2, 3, 4)
#: Sigmas that a parameter moves the rows by over its bounds, as its slope has it, from which it has
#: an effect; places within the bounds at which the others are tried.
STEEP, PLACES = 3.0, (0.0, 0.27, 0.61, 1.0)
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
    half the bounds' distance along it, as far as the linearisation holds, stays below one sigma.

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
    led = [row * np.sign(row[int(np.argmax(np.abs(row)))]) for row in rows]
    longest = [float(np.max(np.abs(row) / likelihood.widths)) for row in led]
    shares = [float(value) / length for value, length in zip(values, longest, strict=True)]
    unseen = {k: led[k] for k, share in enumerate(shares) if 0.5 * share < UNSEEN}
    changes = _changes(evaluator, optimum, unseen)
    names, nothing = [p.name for p in likelihood.parameters], (np.zeros(len(led)), math.nan)
    every = []
    for k, row in enumerate(led):
        by, largest = changes.get(k, nothing)
        every.append(
            Direction(
                singular=float(values[k]),
                share=shares[k],
                vector=dict(zip(names, map(float, row), strict=True)),
                change={name: float(v) for name, v in zip(names, by, strict=True) if v},
                largest=largest,
            )
        )
    return tuple(every)


def _met_exactly(optimum: Optimum) -> Likelihood:
    """The likelihood of data that the model meets exactly at the optimum, and of priors there."""
    likelihood = optimum.likelihood
    left = likelihood.residuals(optimum.expansion.sample.rows[: likelihood.data_rows])
    return replace(
        likelihood, shift=likelihood.shift + left, prior_shift=np.array(optimum.expansion.x)
    )


def _largest_move(exact: Likelihood, rows: FloatArray) -> float:
    """Largest change of any row of data that the optimum meets exactly, in sigma of that row."""
    # in the noise as it is stated, whatever errors are widened by
    white = rows[: exact.data_rows]
    return float(np.max(np.abs(exact.residuals(white)) / exact.noise.row_sigma))


def _changes(
    evaluator: LikelihoodEvaluator, optimum: Optimum, rows: Mapping[int, FloatArray]
) -> dict[int, tuple[FloatArray, float]]:
    """A change (n,) along each direction that moves nothing, or least of those that were tried.

    In the parameters' units, with the most that it moves a row, in sigma. Each direction is
    followed by shares of the bounds' distance, brought back onto the rows, rounded, and evaluated.
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
    best: dict[int, tuple[FloatArray, float]] = {}
    if not begins:
        return best
    p, tried = to_model(exact.parameters, here.x), list[tuple[int, FloatArray]]()
    try:
        with evaluator.of(exact):
            [samples] = evaluator([Request(tuple(x for _, x in begins), outputs=False)])
            started = [Expansion(sample, here.matrix, here.outward, age=1) for sample in samples]
            ends = minimise(evaluator, started, goal=Goal(promise=RETURNED, confirmed=False))
            for (k, _), end in zip(begins, ends, strict=True):
                by = to_model(exact.parameters, end.end.x) - p
                by[np.abs(end.end.x - here.x) < TRIFLE * exact.widths] = 0.0
                if end.reached and np.any(by):
                    for digits in DIGITS:
                        rounded = [float(f"{each:.{digits - 1}e}") for each in by]
                        tried.append((k, np.array(rounded)))
            places = tuple(to_search(exact.parameters, p + by) for _, by in tried)
            [samples] = evaluator([Request(places, outputs=False)]) if places else [[]]
    except Exhausted:
        return best
    # the largest step first: one that moves nothing stands
    for (k, by), sample in zip(tried, samples, strict=True):
        largest = _largest_move(exact, sample.rows)
        if k not in best or best[k][1] > max(NO_CHANGE, largest):
            best[k] = by, largest
    return best


def without_effect(
    evaluator: LikelihoodEvaluator, optimum: Optimum, values: Mapping[str, FittedEstimate]
) -> tuple[str, ...]:
    """Parameters that alone, anywhere within the bounds, move no row by a tenth of a sigma.

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
        own, width = values.get(parameter.name), likelihood.widths[i]
        if own is None or own.status is not Verdict.UNCONSTRAINED:
            continue
        if float(np.linalg.norm(optimum.expansion.matrix[:, i])) * width > STEEP:
            continue
        low = lower[i] if np.isinf(likelihood.periods[i]) else x[i] - 0.5 * width
        places = []
        for share in PLACES:
            places.append(x.copy())
            places[-1][i] = low + share * width
        try:
            with evaluator.of(exact):
                [samples] = evaluator([Request(tuple(places), outputs=False)])
        except Exhausted:
            continue
        if max(_largest_move(exact, sample.rows) for sample in samples) <= IDLE:
            idle.append(parameter.name)
    return tuple(idle)


def gap(likelihood: Likelihood, one: FloatArray, other: FloatArray) -> FloatArray:
    """Distance of two points along every axis as a share of the bounds, periods taken off, (n,).

    Args:
        likelihood: with the bounds.
        one: search vector, (n,).
        other: another, (n,).
    """
    apart = np.mod(np.abs(one - other), likelihood.periods)  # those without one are infinite
    return np.asarray(np.minimum(apart, likelihood.periods - apart) / likelihood.widths)


def equivalents(
    evaluator: LikelihoodEvaluator, scans: Scans, twins: Sequence[Twin]
) -> tuple[Equivalent, ...]:
    """Separate minima that fit as well: outside what the profiles of the optimum go through.

    They are possible where every output has a value there, or near by at something that fits as
    well: at the image, by a symmetry that leads there, of some point that fits.

    Args:
        evaluator: of the likelihood.
        scans: minima, and both sides of the profiles.
        twins: exact symmetries of the model.
    """
    likelihood, optimum = scans.optimum.likelihood, scans.optimum.expansion.x
    parameters, box = likelihood.parameters, Box(likelihood.parameters)
    # a parameter that no data close, or that nobody asked for, tells no two minima apart
    closed = [
        p.name in scans.sides and any(side.closed == "data" for side in scans.sides[p.name])
        for p in parameters
    ]
    kept: list[Equivalent] = []
    places = [optimum]
    for point in sorted(scans.minima, key=lambda each: each.delta):
        gaps = [gap(likelihood, point.x, other) for other in places]
        if not all(np.any((each > SAME) & closed) for each in gaps):
            continue
        is_outside = False  # of the interval of some parameter
        for q in scans.quantities:
            if q.index < 0 or not closed[q.index]:
                continue
            down, up = scans.sides[q.name]
            low = q.low if math.isnan(down.own95) else down.own95
            high = q.high if math.isnan(up.own95) else up.own95
            slack = SAME * (high - low)
            is_outside |= not low - slack <= q.of(point.at.sample) <= high + slack
        if not is_outside:
            continue
        places.append(point.x)
        shown = canonical(parameters, to_model(parameters, point.x))
        possible = bool(np.all(np.isfinite(point.outputs)))
        for twin in twins if not possible else ():
            image = twin.of(parameters, optimum)
            if image is not None and box.apart(image, point.x) <= SAME_MINIMUM:
                near = [*scans.shared, *(p for both in scans.sides.values() for p in _points(both))]
                xs = [twin.of(parameters, x) for x in (optimum, *(each.x for each in near))]
                request = Request(tuple(x for x in xs if x is not None), rows=False)
                try:
                    [read] = evaluator([request])
                except Exhausted:
                    continue
                possible |= any(np.all(np.isfinite(sample.outputs)) for sample in read)
        kept.append(
            Equivalent(
                parameters={p.name: float(v) for p, v in zip(parameters, shown, strict=True)},
                derived=dict(zip(likelihood.names, map(float, point.outputs), strict=True)),
                delta=max(0.0, point.delta),
                origin="start",
                possible=possible,
            )
        )
    return tuple(kept)


def _points(sides: tuple[Side, Side]) -> tuple[ScanPoint, ...]:
    return (*sides[0].points, *sides[1].points)


def scan_findings(profiles: Mapping[str, Profile]) -> Iterator[Finding]:
    """Intervals that end where other parameters are at their bounds, and scans that ended early.

    The latter before anything closed them, where that leaves a status open.

    Args:
        profiles: by name of the value.
    """
    by_bounds: dict[tuple[str, ...], list[str]] = {}
    for name, profile in profiles.items():
        if profile.scan.held:
            by_bounds.setdefault(profile.scan.held, []).append(name)
    for held, names in by_bounds.items():
        yield note(Kind.interval_at_bound, ", ".join(names), {"values": tuple(names), "held": held})
    for why in STOPPED.values():
        stopped = [
            name
            for name, profile in profiles.items()
            if why in profile.scan.stopped and profile.value.status not in FINAL
        ]
        if stopped:
            yield note(Kind.profiles_incomplete, why, {"values": tuple(stopped)})
