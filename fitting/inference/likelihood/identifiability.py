"""Which changes the data do not constrain: directions, parameters without effect, equal fits.

A direction has a finite change: the model was evaluated there, at the very numbers that are
printed, and the largest move of any row is given.

nu as the data would choose it is listed next to the given schedule, by two criteria. Corner of the
L-curve: the nu at which the curve (ln J_fit, ln |x|) bends most, between where the prior costs
misfit and where it costs nothing. Discrepancy principle: the largest nu whose chi square is no more
than noise explains, that of all m data at the true parameters: nothing is taken off for the fitted
ones. Where a criterion chooses nothing it is NaN.

The parametric bootstrap draws data anew at the most likely point and fits them anew:

    r_b(x) = r(x) - r(x^) - e,   e ~ N(0, V)      prior centres: x^_j + tau_j n

Row space holds every campaign alike, joint ones too. All refits go side by side, so that each round
is one large batch for the worker processes.

Sources: P. Hansen and D. O'Leary, SIAM J. Sci. Comput. 14 (1993) 1487; V. Morozov (1966);
B. Efron and R. Tibshirani, An Introduction to the Bootstrap (1993), sections 6.5 and 13.3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitting.campaign.parameters import canonical, search_bounds, to_model, to_search
from fitting.fit.levenberg import Expansion, Goal, minimise
from fitting.fit.likelihood import (
    Exhausted,
    Likelihood,
    LikelihoodEvaluator,
    Request,
    Spent,
)
from fitting.fit.optimum import Optimum
from fitting.fit.path import HistoryRow, PathLevel
from fitting.fit.search import SAME as SAME_MINIMUM
from fitting.fit.search import Box
from fitting.fit.twins import Twin
from fitting.inference.cost import Stage
from fitting.inference.likelihood.knowledge import (
    STOPPED,
    Bootstrap,
    Direction,
    Equivalent,
    NuChoice,
    NuRow,
    Profile,
)
from fitting.inference.likelihood.profile import Scans
from fitting.signal.student import largest
from fitting.text.arrays import FloatArray, IntArray
from fitting.text.estimate import Estimate, FittedEstimate, Verdict
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
    # each with its largest component positive
    lead = np.argmax(np.abs(rows), axis=1)[:, np.newaxis]
    rows *= np.sign(np.take_along_axis(rows, lead, axis=1))
    shares = values / np.max(np.abs(rows) / likelihood.widths, axis=1)
    changes = _changes(evaluator, optimum, rows, np.flatnonzero(0.5 * shares < UNSEEN))
    names, nothing = [p.name for p in likelihood.parameters], (np.zeros(rows.shape[1]), math.nan)
    every = []
    for k, row in enumerate(rows):
        by, largest = changes.get(k, nothing)
        moved = np.flatnonzero(by)
        every.append(
            Direction(
                singular=float(values[k]),
                share=float(shares[k]),
                vector=dict(zip(names, row.tolist(), strict=True)),
                change={names[i]: float(by[i]) for i in moved},
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
    evaluator: LikelihoodEvaluator, optimum: Optimum, rows: FloatArray, unseen: IntArray
) -> dict[int, tuple[FloatArray, float]]:
    """A change (n,) along each `unseen` row that moves nothing, or least of those that were tried.

    In the parameters' units, with the most that it moves a row, in sigma. Each direction is
    followed by shares of the bounds' distance, brought back onto the rows, rounded, and evaluated.
    """
    exact, here = _met_exactly(optimum), optimum.expansion
    begins: list[tuple[int, FloatArray]] = []
    for k in map(int, unseen):
        row, lead = rows[k], int(np.argmax(np.abs(rows[k]) / exact.widths))
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
                        rounded = np.array([float(f"{each:.{digits - 1}e}") for each in by])
                        tried.append((k, rounded))
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
    # a parameter that no data close, or that was not requested, distinguishes no two minima
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
                near = list(scans.shared)
                for down, up in scans.sides.values():
                    near += [*down.points, *up.points]
                images = [twin.of(parameters, x) for x in (optimum, *(each.x for each in near))]
                request = Request(tuple(x for x in images if x is not None), rows=False)
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


def scan_findings(profiles: Mapping[str, Profile]) -> Iterator[Finding]:
    """Intervals that end where other parameters are at their bounds, and scans that ended early.

    The latter before anything closed them, where that leaves a status open.

    Args:
        profiles: by name of the value.
    """
    by_bounds: dict[tuple[str, ...], list[str]] = {}
    for name, (_, scan) in profiles.items():
        if scan.held:
            by_bounds.setdefault(scan.held, []).append(name)
    for bounds, names in by_bounds.items():
        about = {"values": tuple(names), "held": bounds}
        yield note(Kind.interval_at_bound, ", ".join(names), about)
    for why in STOPPED.values():
        stopped = [
            name
            for name, (value, scan) in profiles.items()
            if why in scan.stopped and value.status not in FINAL
        ]
        if stopped:
            yield note(Kind.profiles_incomplete, why, {"values": tuple(stopped)})


# --- nu as the data would choose it ---------------------------------------------------------------

#: Probability with which noise alone stays below the allowed chi square.
ALLOWED_P = 0.95
#: Length in logarithms that the L-curve must go along both axes before a corner means anything.
SHORT = 0.05


def choose_nu(
    likelihood: Likelihood,
    steps: Sequence[PathLevel],
    history: Sequence[HistoryRow],
    *,
    describes: bool = True,
) -> NuChoice:
    """Corner and discrepancy over the levels of Algorithm 2.

    Args:
        likelihood: of the stated noise, without inflation.
        steps: levels of Algorithm 2, at least one.
        history: their rows (and others), for parameters and outputs.
        describes: whether the model describes the data: else no misfit is within the noise.

    Raises:
        FmuFailure: the model failed at one of the levels.
    """
    evaluator = LikelihoodEvaluator(likelihood)
    xs = [np.array(step.x) for step in steps]
    [samples] = evaluator([Request(tuple(xs), outputs=False)])
    m, own = likelihood.data_rows, likelihood.inverse_prior_sigma == 0.0
    distances = [float(np.linalg.norm(x[own])) for x in xs]
    bends = curvatures([step.j_fit for step in steps], distances)
    rows_at, rows = {row.level: row for row in history}, []
    for step, distance, sample, bend in zip(steps, distances, samples, bends, strict=True):
        there = rows_at.get(step.level)
        rows.append(
            NuRow(
                nu=step.nu,
                j_fit=step.j_fit,
                distance=distance,
                chi_square=float(np.sum(sample.rows[:m] ** 2)),
                curvature=bend,
                parameters={} if there is None else dict(there.parameters),
                derived={} if there is None else dict(there.derived),
            )
        )
    allowed = largest(ALLOWED_P, m, likelihood.objective.data.noise_freedom)
    within = [row.nu for row in rows if row.chi_square <= allowed] if describes else []
    return NuChoice(
        rows=tuple(rows),
        corner=corner_of(rows),
        discrepancy=max(within, default=math.nan),
        allowed=allowed,
        last=rows[-1].nu,
        prior={p.name: p.reference for p in likelihood.parameters},
        widths={p.name: p.upper - p.lower for p in likelihood.parameters},
        describes=describes,
    )


def curvatures(misfit: Sequence[float], distance: Sequence[float]) -> list[float]:
    """Signed curvature of the curve (ln misfit, ln distance) at its inner points, NaN at its ends.

    That of the circle through a point and its neighbours (Menger); positive where the curve, passed
    from large to small nu, turns from falling misfit to growing distance: the corner of an L.

    Args:
        misfit: J_fit of each level.
        distance: from the prior of each level, in units of x.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        curve = np.log(np.column_stack([misfit, distance]))
    bends = [math.nan] * len(curve)
    for i in range(1, len(curve) - 1):
        if not np.all(np.isfinite(curve[i - 1 : i + 2])):
            continue
        a, b = curve[i] - curve[i - 1], curve[i + 1] - curve[i]
        chord = curve[i + 1] - curve[i - 1]
        size = float(np.linalg.norm(a) * np.linalg.norm(b) * np.linalg.norm(chord))
        turn = float(b[0] * a[1] - b[1] * a[0])  # clockwise is positive
        bends[i] = 2.0 * turn / size if size > 0.0 and math.isfinite(size) else math.nan
    return bends


def corner_of(rows: Sequence[NuRow]) -> float:
    """nu of the sharpest corner; NaN where the curve is too short along an axis to have one.

    Args:
        rows: one per level, nu falling.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        curve = np.log([[row.j_fit, row.distance] for row in rows])
    whole = curve[np.all(np.isfinite(curve), axis=1)]
    if len(whole) < 3 or np.min(np.ptp(whole, axis=0)) < SHORT:
        return math.nan
    bent = [row for row in rows if row.curvature > 0.0]
    return max(bent, key=lambda row: row.curvature).nu if bent else math.nan


# --- parametric bootstrap -------------------------------------------------------------------------


def bootstrap(
    optimum: Optimum,
    known: Mapping[str, FittedEstimate],
    samples: int,
    seed: int,
    progress: Callable[[Spent], None] = lambda spent: None,
) -> Bootstrap:
    """Percentile intervals of refits, for every value that has one by its verdict.

    Where they do not, a refit stays where it began, and its scatter would be a lie.

    Args:
        optimum: the most likely point and its likelihood, inflation included.
        known: values by name, for verdicts and where periods are counted from.
        samples: number of synthetic data sets.
        seed: of their noise.
        progress: receives before every batch what the refits took so far.

    Raises:
        FmuFailure: the model failed at more points than can be left out.
    """
    likelihood, here = optimum.likelihood, optimum.expansion
    generator = np.random.default_rng(seed)
    noise = generator.standard_normal((samples, here.sample.rows.size))
    noise[:, likelihood.data_rows :] *= likelihood.inverse_prior_sigma > 0.0
    evaluator = LikelihoodEvaluator(likelihood, progress=progress)
    evaluator.begin(Stage.REFITS)
    begins, offsets = list[Expansion](), list(here.sample.rows + noise)
    for offset in offsets:
        begins.append(replace(here, sample=replace(here.sample, rows=here.sample.rows - offset)))
    ends = minimise(evaluator, begins, offsets=offsets)
    xs = tuple(end.end.x for end in ends if end.reached)
    values = {}
    if len(xs) > 1:
        # periods are counted from where the value is reported
        parameters, off = likelihood.parameters, to_model(likelihood.parameters, np.array(xs))
        off -= to_model(parameters, here.x)
        [read] = evaluator([Request(xs, rows=False)])
        table = np.column_stack([off, np.array([sample.outputs for sample in read])])
        names = (*(p.name for p in parameters), *likelihood.names)
        for k, name in enumerate(names):
            own = known.get(name)
            if own is None or not own.status.has_value:
                continue
            column = table[:, k] + own.likely if k < len(parameters) else table[:, k]
            if not np.all(np.isfinite(column)):
                continue
            low, middle, high = np.percentile(column, [2.5, 50.0, 97.5])
            values[name] = Estimate(
                name=name,
                value=float(middle),
                unit=own.unit,
                std=float(np.std(column, ddof=1)),
                ci95=(float(low), float(high)),
                status=own.status,
                method="bootstrap",
            )
    return Bootstrap(samples=samples, failed=samples - len(xs), seed=seed, values=values)
