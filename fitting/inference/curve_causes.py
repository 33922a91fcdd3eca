"""Why a model does not describe curves: a mistake of one kind that one number a curve would mend.

    min_(x, c) |r(x, c)|^2        c: a gain, an offset, a shift of the axis, a level of noise

r are the rows of all measurements, whitened, with the mistake put right in one curve, or in every
curve by a number of its own: what one curve shows may be the fault of another one that it shares
parameters with. A cause is named where it removes most of what chi square has beyond its degrees of
freedom, no other kind removes nearly as much, and what it leaves is noise by the rule that says
what a misfit does (`fitting.signal.misfit`): a number that takes a part of a misfit away is not its
cause. A shift may be of many line widths: its search sets out from the best one of a scan, and
moves all that belongs to the curve. Shifts that differ from curve to curve are a mistake of curves
with the same settings alone, as of sweeps that drift: where settings differ, too, they may as well
be what the model makes of these.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import lambertw

from fitting.campaign.parameters import inverse_priors, search_bounds
from fitting.fit.objective import evaluate_many, jacobian
from fitting.fit.solution import Solution
from fitting.measurements.measurement import Measurement
from fitting.measurements.residual_curve import ResidualCurve
from fitting.measurements.tones import Tones
from fitting.signal.chi_square import tail
from fitting.signal.misfit import Misfit, correlation, excess_share, misfit_of, scaled_solution
from fitting.signal.residual_tests import innovations
from fitting.text.arrays import FloatArray, IntArray, Scalar
from fitting.text.finding import Finding, Kind

#: Share of the misfit that a cause may leave, and how many times as much every other kind leaves.
MOST_LEFT, CLEARLY = 0.3, 2.0
#: Share that a linear step may leave where a fit with the mistake is made; for how many kinds, of
#: how many parameters at most, steps of it and of its sizes alone, and halvings of a step.
WORTH_A_FIT, CANDIDATES, MOST_FITTED, STEPS, SIZE_STEPS, HALVINGS = 0.8, 2, 12, 6, 6, 4
#: Shifts that are tried, over the whole length of a curve.
SCANNED = 81
#: Curves of which each may have a mistake of its own, and from how many on not all are named.
MOST_CURVES, NAMED = 12, 4


@dataclass(frozen=True)
class _Place:
    """A curve among the rows of all measurements: whose, of which rows, and which one of these."""

    measurement: Measurement
    rows_of: slice
    order: int
    curve: ResidualCurve

    @property
    def rows(self) -> IntArray:
        """Numbers of its rows among all."""
        return np.asarray(self.rows_of.start + self.curve.rows)

    @property
    def name(self) -> str:
        """How it is called in a finding."""
        what = "experiments" if isinstance(self.measurement, Tones) else self.curve.name
        return "/".join(filter(None, (self.measurement.series, what))) or "measurement"

    @property
    def settings(self) -> Mapping[str, Scalar]:
        """Values of the FMU's variables at which it was measured."""
        places = self.measurement.places
        return places[self.order][1] if self.order < len(places) else {}


@dataclass(frozen=True)
class _Mistake:
    """A mistake of one kind in some curves; without curves none."""

    kind: Kind
    places: tuple[_Place, ...]

    def curves(self, residuals: FloatArray) -> list[ResidualCurve]:
        """Its curves where the rows of all measurements are others, (m,)."""
        return [p.measurement.residual_curves(residuals[p.rows_of])[p.order] for p in self.places]


@dataclass(frozen=True)
class _End:
    """The end of a fit, noise of its rows, (m,), and slopes by what is solved inside, (m, k)."""

    solution: Solution
    sigma: FloatArray
    inside: FloatArray


@dataclass(frozen=True)
class _Trial:
    """What is left where a mistake is put right, chi square, its sizes, and where, (n,)."""

    left: float
    mistake: _Mistake
    sizes: FloatArray
    x: FloatArray


@dataclass(frozen=True)
class _Rows:
    """Whitened rows (m,) where a mistake is put right, and their slopes (m, k).

    Those by its sizes come first, then those by what measurements are solved for inside.
    """

    rows: FloatArray
    slopes: FloatArray


def causes_along_curves(solution: Solution) -> Iterator[Finding]:
    """The mistake that mends curves, if it is of one kind alone.

    Args:
        solution: the end of a fit.
    """
    places = [p for p in _places(solution) if not isinstance(p.measurement, Tones)]
    yield from _of_places(solution, places)


def gain_of_experiments(solution: Solution) -> Iterator[Finding]:
    """The factor on all peaks of a series that mends it: of a read-out that others do not share.

    Args:
        solution: the end of a fit.
    """
    places = [p for p in _places(solution) if isinstance(p.measurement, Tones)]
    yield from _of_places(solution, places)


def _of_places(solution: Solution, places: Sequence[_Place]) -> Iterator[Finding]:
    if not places:
        return
    inside = solved_inside(solution, solution.final.parameters)
    end = _End(solution, _sigma(solution, places), inside)
    start = _Trial(0.0, _Mistake(Kind.gain, ()), np.empty(0), solution.final.x)
    before = _promised(end, start).left
    tried = [_promising(end, mistakes) for mistakes in _mistakes(places)]
    tried.sort(key=lambda trial: trial.left)
    if excess_share(tried[0].left, before, end.sigma.size) > WORTH_A_FIT:
        return
    if len(solution.parameters) <= MOST_FITTED:
        before = _fitted(end, start).left
        by_kind = {mistakes[0].kind: mistakes for mistakes in _mistakes(places)}
        promising = [by_kind[trial.mistake.kind] for trial in tried[:CANDIDATES]]
        fits = [_mended(end, mistakes, before) for mistakes in promising]
        tried = sorted([*fits, *tried[CANDIDATES:]], key=lambda trial: trial.left)
    shares = [excess_share(trial.left, before, end.sigma.size) for trial in tried]
    clear = shares[0] <= MOST_LEFT and min(shares[1:], default=1.0) >= CLEARLY * shares[0]
    if clear and _leaves_noise(end, tried[0], places):
        yield _finding(tried[0], 1.0 - shares[0])


def _leaves_noise(end: _End, found: _Trial, places: Sequence[_Place]) -> bool:
    """Whether noise explains all curves where a mistake is put right.

    Of a mistake that is put right to first order alone this cannot be asked: it is taken for true.

    Args:
        end: of a fit.
        found: the mistake, its sizes and the parameters beside it.
        places: all curves.
    """
    if any(found.mistake.kind in place.curve.first_order for place in found.mistake.places):
        return True
    here = _sized(end, found)[1]
    known = end.solution.objective.data.sigma > 0.0
    noise, least = np.zeros(known.size, dtype=bool), 1.0
    for place in places:
        mine, curve = place.rows, place.curve
        white = here.rows[mine] - curve.centre / end.sigma[mine]
        along = correlation(white, white * end.sigma[mine] * curve.share)
        if not along.misfit.describes:
            return False
        if along.misfit is Misfit.NONE:
            noise[mine] = known[mine]
            least = min(least, along.p_value)
    freedom = np.count_nonzero(noise) - found.x.size - here.slopes.shape[1]
    if freedom < 1:
        return True
    square = float(np.sum(here.rows[noise] ** 2))
    misfit = misfit_of(square, freedom, tail(square, freedom), least)
    return misfit is Misfit.NONE


def _finding(found: _Trial, removed: float) -> Finding:
    places = found.mistake.places
    names = [place.name for place in places]
    size = float(found.sizes[np.argmax(np.abs(found.sizes))])
    if found.mistake.kind is Kind.noise_level:
        size = _level(size) - 1.0
    numbers = {"size": size, "removed": removed, "curves": float(len(names))}
    if found.mistake.kind is Kind.shift:
        numbers["time_s" if places[0].measurement.is_trace else "frequency_hz"] = size
    return Finding(
        kind=found.mistake.kind,
        severity="warning",
        subject=", ".join(names) if len(names) < NAMED else f"{names[0]} to {names[-1]}",
        numbers=numbers,
    )


def _level(root: float) -> float:
    """Factor q on a density whose deviance 2 (q - 1 - ln q) has a signed root."""
    branch = -1 if root > 0.0 else 0
    return float(-lambertw(-np.exp(-1.0 - 0.5 * root**2), branch).real)


# --- mistakes and where they are ----------------------------------------------------------------


def _places(solution: Solution) -> list[_Place]:
    """All curves whose mistakes can be tried."""
    data, residuals = solution.objective.data, solution.final.residuals
    return [
        _Place(m, at, order, curve)
        for m, at in zip(data.measurements, data.slices, strict=True)
        for order, curve in enumerate(m.residual_curves(residuals[at]))
        if curve.columns
    ]


def _mistakes(places: Sequence[_Place]) -> list[list[_Mistake]]:
    """By their kind: that of one curve, for each; last that of all, each of its own size.

    Not shifts of curves whose settings differ: a law of the settings that is wrong shifts them so.
    """
    kinds = dict.fromkeys(kind for place in places for kind in place.curve.columns)
    found = []
    for kind in kinds:
        mine = tuple(place for place in places if kind in place.curve.columns)
        found.append([_Mistake(kind, (place,)) for place in mine])
        alike = kind is not Kind.shift or all(p.settings == mine[0].settings for p in mine)
        if 1 < len(mine) <= MOST_CURVES and alike:
            found[-1].append(_Mistake(kind, mine))
    return found


def _sigma(solution: Solution, places: Sequence[_Place]) -> FloatArray:
    """Noise of all rows, (m,); what a curve leaves at random tells its own where nobody does."""
    known, sigma = solution.objective.data.sigma, solution.noise.sigma.copy()
    for mine in (place.rows for place in places):
        if not np.all(known[mine] > 0.0):
            _, news = innovations(solution.final.residuals[mine])
            sigma[mine] = float(np.sqrt(np.mean(news**2))) or 1.0
    return sigma


# --- a mistake put right ------------------------------------------------------------------------


def _begun(end: _End, mistake: _Mistake) -> _Trial:
    """What the problem linearised promises, from no mistake and from the best shift of a scan."""
    x = end.solution.final.x
    begins = [np.zeros(len(mistake.places))]
    if mistake.kind is Kind.shift:
        begins.append(_scanned(end, mistake))
    trials = (_promised(end, _Trial(0.0, mistake, sizes, x)) for sizes in begins)
    return min(trials, key=lambda trial: trial.left)


def _scanned(end: _End, mistake: _Mistake) -> FloatArray:
    """Shift of each curve that leaves least of it, parameters as they are, (k,)."""
    inside = end.inside / end.sigma[:, None]
    best = []
    for place in mistake.places:
        mine, axis = place.rows, place.curve.axis
        rows = end.solution.final.residuals[mine] / end.sigma[mine]
        course, columns = place.curve.course / end.sigma[mine], inside[mine]
        columns = columns[:, np.any(columns != 0.0, axis=0)]

        def left_at(
            shift: float,
            curve: ResidualCurve = place.curve,
            rows: FloatArray = rows,
            course: FloatArray = course,
            columns: FloatArray = columns,
        ) -> float:
            moved = rows + curve.moved(course, shift) - course
            turned = curve.moved(columns, shift)
            left = moved - turned @ scaled_solution(turned, moved)
            return float(left @ left)

        half = 0.5 * float(np.ptp(axis))
        best.append(min(np.linspace(-half, half, SCANNED), key=left_at))
    return np.array(best)


def _promising(end: _End, mistakes: Sequence[_Mistake]) -> _Trial:
    begun = (_begun(end, mistake) for mistake in mistakes)
    return min(begun, key=lambda trial: trial.left)


def _promised(end: _End, trial: _Trial) -> _Trial:
    """One step of all that is fitted, and of the sizes, of the problem linearised."""
    point, lower, upper = end.solution.final, *search_bounds(end.solution.parameters)
    here = _put_right(trial, point.residuals, end.inside, end.sigma)
    slopes = _carried(trial, end.solution.matrix) / end.sigma[:, None]
    step, left = _step(end.solution, point.x, slopes, here)
    x = np.clip(point.x + step[: point.x.size], lower, upper)
    return replace(trial, left=left, sizes=trial.sizes + _sizes(step, trial), x=x)


def _mended(end: _End, mistakes: Sequence[_Mistake], before: float) -> _Trial:
    """A fit with one mistake beside the parameters: of one curve, or of all where that is not it.

    Args:
        end: of a fit.
        mistakes: of one kind, as of `_mistakes`.
        before: chi square of a fit without it.
    """
    alone = [mistake for mistake in mistakes if len(mistake.places) == 1]
    found = _fitted(end, _promising(end, alone))
    if len(mistakes) == len(alone) or excess_share(found.left, before, end.sigma.size) <= MOST_LEFT:
        return found
    return _fitted(end, _begun(end, mistakes[-1]))


def _fitted(end: _End, trial: _Trial) -> _Trial:
    """A fit of the parameters, and of the sizes of a mistake, from a trial of it or from none."""
    lower, upper = search_bounds(end.solution.parameters)
    nothing = replace(trial, sizes=np.zeros(trial.sizes.size), x=end.solution.final.x)
    begin = min((_sized(end, t) for t in (trial, nothing)), key=lambda each: each[0].left)

    def along_step(found: _Trial, here: _Rows) -> Callable[[float], tuple[_Trial, _Rows]]:
        slopes = _carried(found, jacobian(end.solution.objective, found.x)) / end.sigma[:, None]
        step, _left = _step(end.solution, found.x, slopes, here)

        def at(part: float) -> tuple[_Trial, _Rows]:
            x = np.clip(found.x + part * step[: found.x.size], lower, upper)
            return _sized(end, replace(found, x=x, sizes=found.sizes + part * _sizes(step, found)))

        return at

    return _descended(begin, along_step, STEPS)[0]


def _descended(
    begin: tuple[_Trial, _Rows],
    along_step: Callable[[_Trial, _Rows], Callable[[float], tuple[_Trial, _Rows]]],
    steps: int,
) -> tuple[_Trial, _Rows]:
    """The end of so many steps, each halved until chi square falls; less than one is no gain.

    Args:
        begin: a trial and its rows.
        along_step: of a trial and its rows what a part of the next step leads to.
        steps: at most.
    """
    here = begin
    for _ in range(steps):
        at = along_step(*here)
        tries = (at(0.5**k) for k in range(HALVINGS))
        better = next((each for each in tries if each[0].left < here[0].left), None)
        if better is None:
            break
        gained = here[0].left - better[0].left
        here = better
        if gained < 1.0:
            break
    return here


def _sizes(step: FloatArray, trial: _Trial) -> FloatArray:
    """Those of a mistake, of a step of parameters, sizes and what is solved inside."""
    return step[trial.x.size : trial.x.size + trial.sizes.size]


def _sized(end: _End, trial: _Trial) -> tuple[_Trial, _Rows]:
    """The best sizes of a mistake, and of what is solved inside, at parameters x."""
    [point] = evaluate_many(end.solution.objective, [trial.x])
    inside = solved_inside(end.solution, point.parameters)

    def at(sizes: FloatArray) -> tuple[_Trial, _Rows]:
        moved = replace(trial, sizes=sizes)
        here = _put_right(moved, point.residuals, inside, end.sigma)
        turned = here.slopes[:, sizes.size :]
        rows = here.rows - turned @ scaled_solution(turned, here.rows)
        return replace(moved, left=float(rows @ rows)), replace(here, rows=rows)

    def along_step(found: _Trial, here: _Rows) -> Callable[[float], tuple[_Trial, _Rows]]:
        step = -scaled_solution(here.slopes, here.rows)[: trial.sizes.size]
        return lambda part: at(found.sizes + part * step)

    return _descended(at(trial.sizes), along_step, SIZE_STEPS if trial.sizes.size else 0)


def _step(
    solution: Solution, x: FloatArray, slopes: FloatArray, here: _Rows
) -> tuple[FloatArray, float]:
    """Step of parameters, sizes and what is solved inside; chi square that it leaves."""
    held = inverse_priors(solution.parameters)
    priors = np.hstack([np.diag(held), np.zeros((held.size, here.slopes.shape[1]))])
    stacked = np.vstack([np.column_stack([slopes, here.slopes]), priors])
    target = np.append(here.rows, held * x)
    step = -scaled_solution(stacked, target)
    left = (target + stacked @ step)[: here.rows.size]
    return step, float(left @ left)


def _put_right(
    trial: _Trial, residuals: FloatArray, inside: FloatArray, sigma: FloatArray
) -> _Rows:
    """Rows where a mistake of some sizes is put right, and their slopes."""
    kind, places = trial.mistake.kind, trial.mistake.places
    rows, slopes = residuals.copy(), np.zeros((residuals.size, len(places)))
    for k, (place, curve) in enumerate(zip(places, trial.mistake.curves(residuals), strict=True)):
        column, size = curve.columns[kind], float(trial.sizes[k])
        if kind is Kind.shift:
            rows[place.rows] += curve.moved(curve.course, size) - curve.course
            column = curve.moved(column, size)
        else:
            rows[place.rows] += size * column
        slopes[place.rows, k] = column
    columns = np.column_stack([slopes, _carried(trial, inside)])
    return _Rows(rows / sigma, columns / sigma[:, None])


def _carried(trial: _Trial, columns: FloatArray) -> FloatArray:
    """Slopes (m, k) of all rows, those of curves that a mistake shifts moved with them."""
    if trial.mistake.kind is not Kind.shift:
        return columns
    moved = columns.copy()
    for place, size in zip(trial.mistake.places, trial.sizes, strict=True):
        moved[place.rows] = place.curve.moved(columns[place.rows], float(size))
    return moved


def solved_inside(solution: Solution, parameters: FloatArray) -> FloatArray:
    """Derivatives (m, k) of all rows by what is solved inside them, at parameters (n,)."""
    data = solution.objective.data
    if not data.solved_inside:
        return np.empty((data.sigma.size, 0))
    [answer] = solution.objective.response.evaluate_many([parameters])
    blocks = []
    pairs = zip(data.measurements, data.slices, answer.predictions, strict=True)
    for m, at, prediction in pairs:
        columns = m.solved_columns(prediction) if m.rows else np.empty((0, 0))
        block = np.zeros((data.sigma.size, columns.shape[1]))
        block[at] = columns
        blocks.append(block)
    return np.hstack(blocks)
