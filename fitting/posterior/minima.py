"""Where walkers set out: every minimum that a fit knows, polished, with its width and weight."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise, product

import numpy as np

from fitting.extension.problem import UNIFORM_WIDTH, Parameter, bounds
from fitting.posterior.mixture import UNLIKELY, Minimum
from fitting.text.arrays import FloatArray, IntArray
from fitting.text.errors import BadInput

#: Gauss and Newton's steps of each minimum at most; those that gain less than so much of ln end it.
STEPS, GAIN = 8, 0.01
#: Points of the box that are looked at, and how many of these are followed.
SCREENED, FOLLOWED = 128, 8
#: Shares of such a step that are tried together.
SHARES = 0.5 ** np.arange(6.0)
#: Minima closer than so many standard deviations are one.
SAME = 1.0
#: Those of one valley: how often the way between is halved, by how much ln may fall on it, and how
#: far its middles may be off, over the length of the way.
HALVINGS, DIP, ASIDE = 2, 2.0, 0.4
#: Share of a period up to which a copy of a minimum may lie beyond the box, and reach into it.
BEYOND = 0.1
#: A box that is narrower than its period by less than this share holds all of it.
WHOLE = 1e-6


@dataclass(frozen=True, kw_only=True)
class Target:
    """A posterior of parameters in their units.

    `log` (k, n) -> (k,) is its ln, `rows` (n,) -> ((m,), (m, n)) whitened residuals, those of
    Gaussian priors among them, and their derivatives.
    """

    parameters: tuple[Parameter, ...]
    log: Callable[[FloatArray], FloatArray]
    rows: Callable[[FloatArray], tuple[FloatArray, FloatArray]]

    @property
    def box(self) -> tuple[FloatArray, FloatArray]:
        """Lower ends and widths, (n,) each."""
        lower, upper = bounds(self.parameters)
        return lower, upper - lower

    def in_box(self, p: FloatArray) -> FloatArray:
        """Parameters (..., n) in units of the box.

        Args:
            p: in their units.
        """
        lower, width = self.box
        return np.asarray((p - lower) / width)

    def in_units(self, u: FloatArray) -> FloatArray:
        """Parameters (..., n) in their units.

        Args:
            u: in units of the box.
        """
        lower, width = self.box
        return np.asarray(lower + width * u)


def minima_of(target: Target, known: Sequence[tuple[str, FloatArray]]) -> tuple[Minimum, ...]:
    """The minima to start from, the most likely first; those of one valley count for its first.

    Args:
        target: The posterior.
        known: Places (n,) in the parameters' units with who knows of them.

    Raises:
        BadInput: none of them is possible.
    """
    minima: list[Minimum] = []
    for origin, place in (*known, *_imaged(target, known[0][1]), *_scattered(target)):
        minimum = polished(target, origin, _moved_inside(target.parameters, place))
        if minimum is None:
            continue
        # one that is there already, perhaps whole periods off, has its first origin
        there = [c for m in minima for c in (m, *_copies(target.parameters, m, -1))]
        if all(m.distances(minimum.centre[None])[0] > SAME for m in there):
            minima.append(minimum)
    if not minima:
        raise BadInput("posterior: the model has no value where the fit ended, wanted another fit")
    least = max(m.weight for m in minima) - UNLIKELY
    minima = sorted((m for m in minima if m.weight > least), key=lambda m: -m.log)
    owners: list[int] = []
    for k, m in enumerate(minima):
        joined = {k}
        for i in range(k):
            if owners[i] not in joined and _is_one_valley(target, minima[i], m):
                joined.add(owners[i])
        owners = [min(joined) if owner in joined else owner for owner in [*owners, k]]
    parts = [m if owners[k] == k else replace(m, copy_of=owners[k]) for k, m in enumerate(minima)]
    copies = [c for k, m in enumerate(minima) for c in _copies(target.parameters, m, owners[k])]
    return (*parts, *copies)


def _is_one_valley(target: Target, one: Minimum, other: Minimum) -> bool:
    """Whether the posterior hardly falls on the way from one to the other, and leads nowhere else.

    The way is halved; its middles are points of the valley where they are as likely as the ends
    and near where they were tried: from between two wells they fall into one of these.
    """
    least, way = min(one.log, other.log) - DIP, [one.centre, other.centre]
    for _ in range(HALVINGS):
        halved = way[:1]
        for a, b in pairwise(way):
            middle = polished(target, "", target.in_units(0.5 * (a + b)))
            if middle is None or middle.log < least:
                return False
            off = float(np.linalg.norm(middle.centre - 0.5 * (a + b)))
            if off > ASIDE * float(np.linalg.norm(b - a)):
                return False
            halved += [middle.centre, b]
        way = halved
    return True


@dataclass(frozen=True)
class Image:
    """A symmetry that a model may have: two values exchanged, an angle moved or reflected.

    Points (..., n) in units of the `box` have as images

        p'_i = sign_i p_order(i) + moved_i          (n,) each, in the parameters' units

    `name` of it, in words.
    """

    name: str
    order: IntArray
    sign: FloatArray
    moved: FloatArray
    box: tuple[FloatArray, FloatArray]

    def __call__(self, u: FloatArray) -> FloatArray:
        """The image of points in units of the box."""
        lower, width = self.box
        p = self.sign * (lower + width * u)[..., self.order] + self.moved
        return np.asarray((p - lower) / width)


def images_of(target: Target) -> tuple[Image, ...]:
    """Exchanges of two parameters of one unit, half periods and reflections of one, and both.

    They preserve volumes, and with each there is its inverse: proposals of images leave any
    posterior as it is.
    """
    parameters = target.parameters
    shared = [i for i, p in enumerate(parameters) if not p.experiments]
    count, axes = len(parameters), np.eye(len(parameters))
    moves = [("", np.ones(count), np.zeros(count))]
    for i in shared:
        p = parameters[i]
        if p.period is None:
            continue
        half = 0.5 * p.period
        for shift in (half, -half):
            moves.append((f"{p.name} half a period off", np.ones(count), shift * axes[i]))
        # about multiples of a quarter of the period, those near the middle of the box
        middle = half * round((p.lower + p.upper) / half)
        for pivot in (middle - half, middle, middle + half):
            moves.append((f"{p.name} reflected", 1.0 - 2.0 * axes[i], pivot * axes[i]))
    orders = [("", np.arange(count))]
    for i, k in combinations(shared, 2):
        one, other = parameters[i], parameters[k]
        alike = (one.unit, one.period) == (other.unit, other.period)
        if alike and max(one.lower, other.lower) < min(one.upper, other.upper):
            order = np.arange(count)
            order[[i, k]] = order[[k, i]]
            orders.append((f"{one.name} and {other.name} exchanged", order))
    return tuple(
        Image(", ".join(filter(None, (exchanged, name))), order, sign, moved, target.box)
        for exchanged, order in orders
        for name, sign, moved in moves
        if exchanged or name
    )


def as_likely(target: Target, images: Sequence[Image], place: FloatArray) -> list[Image]:
    """The images under which a place is as likely as it is, by the values with a period turned.

    Args:
        target: the posterior.
        images: with each its inverse.
        place: in the parameters' units, (n,).
    """
    if not images:
        return []
    logs = target.log(np.array([place, *_image_places(target, images, place)]))
    return [image for image, log in zip(images, logs[1:], strict=True) if log > logs[0] - DIP]


def _image_places(target: Target, images: Sequence[Image], place: FloatArray) -> list[FloatArray]:
    start = target.in_box(place)
    return [_moved_inside(target.parameters, target.in_units(image(start))) for image in images]


def _imaged(target: Target, place: FloatArray) -> Iterator[tuple[str, FloatArray]]:
    """The most likely images of a place under symmetries that the model may have."""
    images = images_of(target)
    places = _image_places(target, images, place)
    logs = target.log(np.array(places)) if places else np.empty(0)
    for k in np.argsort(-logs, kind="stable")[:FOLLOWED]:
        if np.isfinite(logs[k]):
            yield images[k].name, places[k]


def _scattered(target: Target) -> Iterator[tuple[str, FloatArray]]:
    """The most likely ones of some points of the box."""
    points = np.random.default_rng(1).random((SCREENED, len(target.parameters)))
    table = target.in_units(points)
    logs = target.log(table)
    for k in np.argsort(-logs)[:FOLLOWED]:
        if np.isfinite(logs[k]):
            yield "a point of the box", table[k]


def polished(target: Target, origin: str, place: FloatArray) -> Minimum | None:
    """The minimum near a place; None where the model has no value.

    Args:
        target: the posterior.
        origin: who knows of the place.
        place: in the parameters' units, (n,).
    """
    lower, width = target.box
    p = np.clip(place, lower, lower + width)
    log = float(target.log(p[None])[0])
    if not np.isfinite(log):
        return None
    for _ in range(STEPS):
        residuals, slopes = target.rows(p)
        step = np.linalg.lstsq(slopes * width, -residuals, rcond=1e-10)[0] * width
        tried = np.clip(p + SHARES[:, None] * step, lower, lower + width)
        logs = target.log(tried)
        best = int(np.argmax(logs))
        gain = float(logs[best]) - log
        if gain > 0.0:
            p, log = tried[best], float(logs[best])
        if gain < GAIN:
            break
    _, slopes = target.rows(p)
    # the box counts as a uniform distribution: what the data do not see is left as wide as it is
    whole = np.vstack([slopes * width, UNIFORM_WIDTH * np.eye(width.size)])
    root = np.asarray(np.linalg.qr(whole, mode="r"))
    weight = log - float(np.sum(np.log(np.abs(np.diag(root)))))
    return Minimum(centre=target.in_box(p), root=root, weight=weight, origin=origin)


def _moved_inside(parameters: Sequence[Parameter], place: FloatArray) -> FloatArray:
    """The place with periodic parameters turned into the box, where that is possible."""
    inside = np.array(place, dtype=float)
    for i, p in enumerate(parameters):
        if p.period is not None:
            inside[i] += p.period * np.ceil((p.lower - inside[i]) / p.period - 1e-9)
    return inside


def _copies(parameters: Sequence[Parameter], minimum: Minimum, number: int) -> Iterator[Minimum]:
    """The same minimum whole periods off, as far as it reaches into the box."""
    turns = [_turns(p, float(c)) for p, c in zip(parameters, minimum.centre, strict=True)]
    for shift in product(*turns):
        if any(shift):
            yield replace(minimum, centre=minimum.centre + np.array(shift), copy_of=number)


def _turns(parameter: Parameter, centre: float) -> tuple[float, ...]:
    """Shifts by whole periods that stay near the box, in units of it; no shift is one of them."""
    if parameter.period is None:
        return (0.0,)
    period = parameter.period / (parameter.upper - parameter.lower)
    most = int(1.0 / period) + 2
    shifts = [k * period for k in range(-most, most + 1)]
    near = [s for s in shifts if -BEYOND * period <= centre + s <= 1.0 + BEYOND * period]
    return (*(s for s in near if s), 0.0)


def about(target: Target, minimum: Minimum, p: FloatArray) -> FloatArray:
    """Parameters (..., n) with each whose box holds a whole period turned nearest to a minimum.

    Values that differ by a period are the same system: an interval is given about the minimum.

    Args:
        target: The posterior.
        minimum: About which.
        p: In their units.
    """
    inside, centre = np.array(p, dtype=float), target.in_units(minimum.centre)
    for i, q in enumerate(target.parameters):
        if q.period is not None and q.upper - q.lower >= q.period * (1.0 - WHOLE):
            inside[..., i] -= q.period * np.round((inside[..., i] - centre[i]) / q.period)
    return inside
