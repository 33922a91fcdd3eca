"""What is minimised: residual rows and Tikhonov rows, kept apart, without the minimiser.

An `Evaluator` is its interface to a solver: values and Jacobians, remembered and counted.

    r_i(p) = (chi(p) z_i(p) - z*_i)/z*_i        J_fit = sum |r_i|        J_reg = nu/2 |x|^2

with the search vector x = (p - p_ref)/scale. Evaluating changes nothing: points are records.

A parameter with a Gaussian prior of its own (standard deviation s, scale = s) does not fade with
nu: it keeps a weight in units of the noise. With rows of relative noise sigma the posterior's
-2 log is sum r^2/sigma^2 + x^2, so sum r^2 is added to sigma^2 x^2. The sum of absolute values is
the -log of Laplace noise, sum |r|/b, whose mean absolute value is that of the Gaussian noise where
b = sqrt(2/pi) sigma: it is added to b/2 x^2.

First derivatives are quotients of differences of finite size,

    df/dx_i = (f(a_i) - f(b_i))/(a_i - b_i)_i

Where one side has no room, two quotients to the other side are extrapolated to none.

A stencil holds the points at which a function of the search vector is wanted, so that all of them
go to the model in one batch, and makes the derivatives from the values there, be they residual
rows or derived outputs.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from fitting.campaign.parameters import Parameter, search_bounds, starts, to_model, to_search
from fitting.measurements.dataset import Dataset
from fitting.measurements.measurement import Evaluation, ReadingResponse, Response, Values
from fitting.text.arrays import BoolArray, FloatArray
from fitting.text.errors import FmuFailure, NoAnswer, NoScale

#: Of the values at two nodes, by their places, the minuend first; and its weight in a derivative.
Quotient = tuple[int, int, float]


@dataclass(frozen=True)
class Stencil:
    """Points of difference quotients along every axis.

    `nodes` are search vectors (n,); `along` has for each axis the quotients whose weighted sum is
    the derivative, each of two nodes that differ along it.
    """

    nodes: tuple[FloatArray, ...]
    along: tuple[tuple[Quotient, ...], ...]

    def quotients(
        self,
        values: Sequence[npt.ArrayLike],
        difference: Callable[[FloatArray, FloatArray], FloatArray] = np.subtract,
    ) -> FloatArray:
        """Derivatives, the axis last: (m, n) of rows (m,), (n,) of numbers.

        Args:
            values: of the function at every node, in their order, numbers or arrays of one shape.
            difference: of two values, e.g. of their logarithms.
        """
        columns = []
        # an output may be infinite, as Q without damping is: NaN says that it has no slope there
        with np.errstate(invalid="ignore"):
            for axis, parts in enumerate(self.along):
                quotients = []
                for above, below, weight in parts:
                    way = self.nodes[above][axis] - self.nodes[below][axis]
                    rise = difference(np.asarray(values[above]), np.asarray(values[below]))
                    quotients.append(weight * rise / way)
                columns.append(sum(quotients[1:], quotients[0]))
        return np.stack(columns, axis=-1)

    def between(self, axis: int, above: FloatArray, below: FloatArray) -> Stencil:
        """The stencil whose quotient along one axis is taken between two other points.

        Args:
            axis: place in the search vector.
            above: search vector, shape (n,).
            below: another that differs along the axis, shape (n,).
        """
        count, along = len(self.nodes), list(self.along)
        along[axis] = ((count, count + 1, 1.0),)
        return Stencil((*self.nodes, above, below), tuple(along))

    def reversed_along(self, axes: Sequence[int]) -> Stencil:
        """The stencil of `forward` with the steps along some axes taken the other way.

        Args:
            axes: places in the search vector.
        """
        nodes = list(self.nodes)
        for axis in axes:
            nodes[axis + 1] = 2.0 * nodes[0] - nodes[axis + 1]
        return Stencil(tuple(nodes), self.along)


def central(
    x: FloatArray,
    steps: npt.ArrayLike,
    lower: FloatArray,
    upper: FloatArray,
    one_sided: BoolArray | None = None,
) -> Stencil:
    """Central differences about x; inward where the box has no room for a step to both sides.

    (f(x + h) - f(x - h))/(2 h), two nodes along an axis, above and below in turn. Where a side has
    no room the quotient is taken from x to h and to 2 h on the other side, 2 q(h) - q(2 h), which
    are three nodes. The error is that of the step squared either way.

    Args:
        x: search vector, shape (n,).
        steps: half the distance of the nodes along each axis, in units of x, (n,) or one for all.
        lower: bounds of the box, shape (n,).
        upper: likewise.
        one_sided: axes (n,) along which a forward difference from x, then the first node, is
            enough; None: none.
    """
    forward_only = np.zeros(x.size, dtype=bool) if one_sided is None else one_sided
    nodes: list[FloatArray] = [x] if np.any(forward_only) else []
    along: list[tuple[Quotient, ...]] = []
    for i, step in enumerate(np.broadcast_to(steps, x.shape)):
        down, up, first = x[i] - lower[i], upper[i] - x[i], len(nodes)
        if forward_only[i]:
            shifts, parts = [step if up >= step else -step], [(first, 0, 1.0)]
        elif min(up, down) >= step or max(up, down) < 2.0 * step:
            shifts, parts = [step, -step], [(first, first + 1, 1.0)]
        else:
            inward = step if up > down else -step
            shifts = [0.0, inward, 2.0 * inward]
            parts = [(first + 1, first, 2.0), (first + 2, first, -1.0)]
        for shift in shifts:
            moved = np.array(x, dtype=float)
            moved[i] = min(max(x[i] + shift, lower[i]), upper[i])
            nodes.append(moved)
        along.append(tuple(parts))
    return Stencil(tuple(nodes), tuple(along))


def forward(x: FloatArray, steps: npt.ArrayLike, upper: FloatArray) -> Stencil:
    """Forward differences, inward where the box ends: n + 1 nodes, x itself the first.

    The error is that of the step: enough to descend by, and half the evaluations.

    Args:
        x: search vector, shape (n,).
        steps: distance of the nodes along each axis, in units of x, (n,) or one for all.
        upper: bounds of the box, shape (n,), infinite where there is none.
    """
    nodes = [x]
    for i, step in enumerate(np.broadcast_to(steps, x.shape)):
        moved = np.array(x, dtype=float)
        moved[i] += step if x[i] + step <= upper[i] else -step
        nodes.append(moved)
    return Stencil(tuple(nodes), tuple(((i + 1, 0, 1.0),) for i in range(x.size)))


# --- rows -----------------------------------------------------------------------------------------

Key = TypeVar("Key")
Kept = TypeVar("Kept")
Answer = TypeVar("Answer")

#: Points and Jacobians that are remembered; a solver goes back by one or two iterates at most.
REMEMBERED = 8
#: A weight for all variables, or one for each, (n,).
Nu = float | FloatArray

#: A relative residual beyond which its square is near the end of the range of numbers.
LARGEST = 1e150

#: Relative noise of a row, for the weight of a prior, where nobody knows it.
ASSUMED_NOISE = 0.01


@dataclass(frozen=True, kw_only=True)
class Objective:
    """Response, parameters and data; `steps` (n,) are the finite-difference steps in x."""

    response: Response
    parameters: tuple[Parameter, ...]
    data: Dataset
    steps: FloatArray


@dataclass(frozen=True, kw_only=True)
class Point:
    """One evaluated search vector.

    `residuals` (m,) of all measurements; `chis` the scale of every series; `scaled` chi times what
    the model predicts, one array per measurement; `scale_bias` the relative error that simulated
    grids leave in chi, at most; `runs` the number of simulations; `squares` and `row_weights` (m,)
    are those of `Dataset.squares`; `promised` and `shift` those of
    `Evaluation`.
    """

    x: FloatArray
    parameters: FloatArray
    residuals: FloatArray
    chis: tuple[float, ...]
    scaled: tuple[Values, ...]
    scale_bias: float
    runs: int = 0
    squares: float = float("nan")
    row_weights: FloatArray = field(default_factory=lambda: np.empty(0))
    promised: tuple[float, ...] = ()
    shift: FloatArray = field(default_factory=lambda: np.empty(0))

    @property
    def chi(self) -> float:
        """Scale of the first series."""
        return self.chis[0]

    @property
    def j_fit(self) -> float:
        """J_fit = sum |r_i|."""
        return float(np.sum(np.abs(self.residuals)))


def j_reg(x: FloatArray, nu: Nu) -> float:
    """J_reg = sum nu_i/2 x_i^2, x the search vector (the paper's p - p_ref over its scale).

    Args:
        x: search vector (n,).
        nu: weight of the Tikhonov term, one number or (n,).
    """
    return 0.5 * float(np.sum(nu * x * x))


def total(point: Point, nu: Nu, misfit: str) -> float:
    """What is minimised at one point: misfit + J_reg.

    Args:
        point: residual rows at a search vector.
        nu: weight of the Tikhonov term, one number or (n,).
        misfit: "slack" or "absolute" (sum of absolute values), or "squares".
    """
    misfit_here = point.squares if misfit == "squares" else point.j_fit
    return misfit_here + j_reg(point.x, nu)


def weights(objective: Objective, nu: float, misfit: str) -> FloatArray:
    """nu_i of every parameter, (n,): nu, or the noise's own weight where it has a Gaussian prior.

    With a prior: 2 sigma^2 for "squares", sqrt(2/pi) sigma for sums of absolute values, sigma the
    relative noise of the rows (see the module).

    Args:
        objective: rows, parameters and weights.
        nu: weight of the Tikhonov term.
        misfit: "slack" or "absolute" (sum of absolute values), or "squares".
    """
    sigma = objective.data.sigma
    known = sigma[sigma > 0.0]
    if known.size == 0:
        known = np.array([ASSUMED_NOISE])
    if misfit == "squares":
        kept = 2.0 / float(np.mean(known**-2))
    else:
        kept = float(np.sqrt(2.0 / np.pi) * np.mean(known))
    weighted = [
        (p.scale / p.prior_sigma) ** 2 * kept if p.prior_sigma else nu for p in objective.parameters
    ]
    return np.array(weighted, dtype=float)


def _point(objective: Objective, x: FloatArray, evaluation: Evaluation) -> Point:
    data, p = objective.data, to_model(objective.parameters, x)
    free = [float(p[k]) for k, q in enumerate(objective.parameters) if q.role == "scale"]
    scales = data.scales(evaluation.predictions, free)
    by_series = dict(zip(data.series, scales, strict=True))
    rows, scaled = [], []
    for m, prediction in zip(data.measurements, evaluation.predictions, strict=True):
        chi = by_series[m.series].value
        rows.append(m.residuals(prediction, chi))
        scaled.append(m.scaled(prediction, chi))
        largest = float(np.max(np.abs(rows[-1]), initial=0.0))
        if largest > LARGEST:  # its square is no number
            series = f"{m.series}: " if m.series else ""
            raise NoScale(
                f"{series}the model is {largest:.3g} times the data away from them, "
                f"wanted {LARGEST:g} at most (is a level or a unit wrong?)"
            )
    residuals = np.concatenate(rows)
    squares, row_weights = data.squares(residuals)
    return Point(
        x=x.copy(),
        parameters=p,
        residuals=residuals,
        chis=tuple(scale.value for scale in scales),
        scaled=tuple(scaled),
        scale_bias=max(scale.bias for scale in scales),
        runs=evaluation.runs,
        squares=squares,
        row_weights=row_weights,
        promised=evaluation.promised,
        shift=evaluation.shift,
    )


def answered_apart(
    ask: Callable[[Sequence[FloatArray]], list[Answer]],
    xs: Sequence[FloatArray],
    failed: Callable[[FloatArray, Exception], Answer],
) -> list[Answer]:
    """Answers at several search vectors in one batch; where that fails, in halves of it.

    Args:
        ask: answers of a batch, one each.
        xs: search vectors, shape (n,) each.
        failed: answer at one where the model fails, or raises the failure.

    Raises:
        NoAnswer: the model does not answer any more.
    """
    try:
        return ask(xs)
    except NoAnswer:
        raise
    except (FmuFailure, NoScale) as failure:  # a model that answers with zeros has failed, too
        if len(xs) == 1:
            return [failed(xs[0], failure)]
    half = len(xs) // 2
    return [*answered_apart(ask, xs[:half], failed), *answered_apart(ask, xs[half:], failed)]


def evaluate_many(
    objective: Objective,
    xs: Sequence[FloatArray],
    *,
    whole: bool = False,
    read: Collection[int] = (),
) -> list[Point]:
    """Points at several search vectors, in one batch of simulations.

    `whole`: with a prediction of everything that was measured, also of what the fit needs not.
    Derived outputs at the vectors of some numbers, `read`, cost less afterwards.

    Args:
        objective: rows, parameters and weights.
        xs: search vectors, (n,) each.
        whole: whether everything is wanted that reports show, not residuals only.
        read: numbers of the vectors at which derived outputs are wanted, too.
    """
    ps, response = [to_model(objective.parameters, x) for x in xs], objective.response
    if read and isinstance(response, ReadingResponse):
        answers = response.evaluate_and_read(ps, read)
    else:
        answers = response.evaluate_many(ps, whole=whole)
    return [_point(objective, x, answer) for x, answer in zip(xs, answers, strict=True)]


def stencil(objective: Objective, x: FloatArray) -> Stencil:
    """Points of a central-difference Jacobian at x, kept inside the box.

    Args:
        objective: rows, parameters and weights.
        x: search vector (n,).
    """
    return central(x, objective.steps, *search_bounds(objective.parameters))


def jacobian_of(around: Stencil, points: Sequence[Point]) -> FloatArray:
    """dr/dx, shape (n_rows, n), from the points at the nodes of a stencil.

    Args:
        around: the stencil.
        points: evaluated at its nodes, in their order.
    """
    return around.quotients([point.residuals for point in points])


def jacobian(objective: Objective, x: FloatArray) -> FloatArray:
    """dr/dx by central differences in one batch, shape (n_rows, n).

    The steps balance truncation against the noise of the response (`make_objective`).

    Args:
        objective: rows, parameters and weights.
        x: search vector (n,).
    """
    around = stencil(objective, x)
    return jacobian_of(around, evaluate_many(objective, around.nodes))


def make_objective(
    response: Response, parameters: tuple[Parameter, ...], data: Dataset
) -> Objective:
    """Objective whose difference steps suit the response at the start and at the reference.

    A central difference of a function known to eps, that varies over a length L, is best at
    h = L (3 eps)^(1/3); eps is measured (`noise_level`), the length along x_i is taken as
    1/max|dr/dx_i|, at most one unit of x and a tenth of the box.

    Args:
        response: predictions and derived outputs at parameters.
        parameters: the fitted parameters.
        data: the measurements.
    """
    lower, upper = search_bounds(parameters)
    longest = np.minimum(1.0, 0.1 * (upper - lower))
    start = to_search(parameters, starts(parameters))
    middle = np.clip(np.zeros_like(start), lower, upper)
    draft = Objective(response=response, parameters=parameters, data=data, steps=1e-3 * longest)
    one, other = stencil(draft, start), stencil(draft, middle)
    points = evaluate_many(draft, [*one.nodes, *other.nodes])
    first = len(one.nodes)
    slopes = np.maximum(
        np.max(np.abs(jacobian_of(one, points[:first])), axis=0),
        np.max(np.abs(jacobian_of(other, points[first:])), axis=0),
    )
    lengths = np.minimum(longest, 1.0 / np.maximum(slopes, np.finfo(float).tiny))
    unit = float(np.cbrt(3.0 * noise_level(draft, middle, lengths)))
    return Objective(
        response=response,
        parameters=parameters,
        data=data,
        steps=min(max(unit, 1e-5), 1e-2) * lengths,
    )


def noise_level(objective: Objective, x: FloatArray, lengths: FloatArray) -> float:
    """Relative numerical noise of the rows at x, from a table of fourth differences.

    Differences of order k of a smooth function at close points vanish; what is left is noise times
    sqrt((2k)!/(k!)^2). At least the rounding of a double.

    Source: R. Hamming, Introduction to Applied Numerical Analysis; J. More and S. Wild,
    "Estimating computational noise", SIAM J. Sci. Comput. 33 (2011).

    Args:
        objective: rows, parameters and weights.
        x: search vector (n,).
        lengths: of the difference steps, (n,), in units of x.
    """
    lower, upper = search_bounds(objective.parameters)
    inward = np.where(x > 0.5 * (lower + upper), -1.0, 1.0)
    nodes = [x + 1e-6 * k * inward * lengths for k in range(9)]
    rows = np.stack([point.residuals for point in evaluate_many(objective, nodes)])
    fourth = np.diff(rows, n=4, axis=0)
    noise = np.sqrt(np.mean(fourth**2, axis=0) / 70.0)  # 8!/(4!)^2
    return max(float(np.max(noise)), float(np.finfo(float).eps))


# --- what a solver sees ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Counts:
    """Objective evaluations in all (inside Jacobians too), Jacobians, simulation runs."""

    evaluations: int = 0
    jacobians: int = 0
    runs: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            self.evaluations + other.evaluations,
            self.jacobians + other.jacobians,
            self.runs + other.runs,
        )


class Evaluator:
    """Memory and counter in front of one objective; x outside the box is a programming error."""

    def __init__(self, objective: Objective) -> None:
        self.objective = objective
        self.lower, self.upper = search_bounds(objective.parameters)
        self.counts = Counts()
        self._points: dict[bytes, Point] = {}
        self._matrices: dict[tuple[bool, bytes], FloatArray] = {}

    def point(self, x: FloatArray) -> Point:
        """The point at x, simulated at most once while it is remembered.

        Args:
            x: search vector (n,).
        """
        return _remembered(self._points, x.tobytes(), lambda: self.points([x])[0])

    def trial(self, x: FloatArray) -> Point:
        """The point at x, from which a solver turns away where the model fails.

        Args:
            x: search vector (n,).

        Raises:
            NoAnswer: the model does not answer any more.
        """
        [point] = answered_apart(lambda xs: [self.point(xs[0])], [x], self._away)
        return point

    def trials(self, xs: Sequence[FloatArray]) -> list[Point]:
        """Points at several search vectors; where the model fails every residual is LARGEST.

        Args:
            xs: search vectors, (n,) each.

        Raises:
            NoAnswer: the model does not answer any more.
        """
        return answered_apart(self.points, xs, self._away)

    def _away(self, x: FloatArray, _: Exception) -> Point:
        """The point where the model fails: as far from the data as can be."""
        rows = self.objective.data.sigma.size
        return Point(
            x=x.copy(),
            parameters=to_model(self.objective.parameters, x),
            residuals=np.full(rows, LARGEST),
            chis=(),
            scaled=(),
            scale_bias=np.nan,
            squares=LARGEST**2,
            row_weights=np.zeros(rows),
        )

    def points(self, xs: Sequence[FloatArray], *, whole: bool = False) -> list[Point]:
        """Points at several search vectors, in one batch.

        Args:
            xs: search vectors, (n,) each.
            whole: with predictions of everything that was measured.
        """
        points = evaluate_many(self.objective, xs, whole=whole) if xs else []
        self.counts += Counts(evaluations=len(xs), runs=sum(point.runs for point in points))
        if whole:
            self._points.update((point.x.tobytes(), point) for point in points)
        return points

    def jacobian(self, x: FloatArray, *, is_central: bool = True) -> FloatArray:
        """dr/dx at x, shape (n_rows, n), one batch.

        Args:
            x: search vector (n,).
            is_central: by central differences, else by forward ones: half the evaluations, to solve
                by.
        """

        def quotients() -> FloatArray:
            self.counts += Counts(jacobians=1)
            if is_central:
                around = stencil(self.objective, x)
                return jacobian_of(around, self.points(around.nodes))
            here, around = self.point(x), forward(x, self.objective.steps, self.upper)
            return jacobian_of(around, [here, *self.points(around.nodes[1:])])

        return _remembered(self._matrices, (is_central, x.tobytes()), quotients)


def _remembered(memory: dict[Key, Kept], key: Key, evaluate: Callable[[], Kept]) -> Kept:
    """What the memory holds, else evaluated; of more than a few the oldest goes."""
    if key not in memory:
        value = evaluate()
        if len(memory) >= REMEMBERED:
            memory.pop(next(iter(memory)))
        memory[key] = value
    return memory[key]
