"""Profiles that ended at a limit of another value, in closed form: who ends them, limit or data.

p - 1 = h(q) is measured with noise S; h(q) = q up to the limit of q at 6, and beyond it as each
test says. Held at the limit p crosses at 1 + 6 + 1.96 S, and is asked for 3 per cent farther out.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting.fit.likelihood.descent import Optimum, expansion_at
from fitting.fit.likelihood.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.likelihood.lockstep import run_in_lockstep
from fitting.inference.likelihood.inverses import Branches
from fitting.inference.likelihood.limits import released
from fitting.inference.likelihood.profiles import ProfileBranch, ProfilePoint, Quantity
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure
from tests.support.whitened import SIGMA, Z95, parameter, whitened

S = 0.1
LIMIT = 6.0
#: How far the crossing is from the best value, and how far the value that is asked for.
CROSSING = LIMIT + Z95 * S
ASKED = 1.03 * CROSSING

Beyond = Callable[[float], float]
BOTH_WAYS = pytest.mark.parametrize(
    ("side", "way"), [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)], ids=str
)


def flat(q: float) -> float:
    """Nothing is gained beyond the limit."""
    return 0.0


def at_doubling(k: int) -> float:
    """Where q may go as far as 2^k times its room of 12."""
    return LIMIT + (2.0**k - 1.0) * 2.0 * LIMIT


class Scene:
    """p goes down (side 0) or up (side 1) as q goes to its lower (way -1) or upper limit."""

    def __init__(
        self,
        beyond: Beyond,
        side: int = 1,
        way: float = 1.0,
        *,
        box: float = LIMIT,
        least: float = -math.inf,
    ) -> None:
        self.side = side
        out = 1.0 if side else -1.0

        def rows(x: FloatArray) -> FloatArray:
            q = way * float(x[1])
            height = max(q, least) if q <= LIMIT else LIMIT + beyond(q)
            return np.full(3, (x[0] - 1.0 - out * height) / (S * math.sqrt(3.0)))

        p = parameter("p", -50.0, 50.0, start=1.0, reference=0.0)
        objective = whitened(rows, p, parameter("q", -box, box), own=lambda x: float(x[0]))
        whole = likelihood_of(objective, np.full(3, SIGMA), np.zeros((3, 0)), ("own",))
        ends = np.array([50.0, LIMIT])
        self.room = replace(whole, lower=-ends, upper=ends)
        self.evaluator = LikelihoodEvaluator(self.room)
        best = np.array([1.0, 0.0])
        [here] = run_in_lockstep([expansion_at(self.room, best)], self.evaluator)
        assert here is not None
        self.optimum = Optimum(
            likelihood=self.room,
            expansion=here,
            chi_square=0.0,
            degrees_of_freedom=2.0,
            converged=True,
        )

        def point(value: float, q: float, root: float) -> ProfilePoint:
            x = np.array([1.0 + out * value, way * q])
            return ProfilePoint(value=float(x[0]), delta=root**2, x=x, outputs=x[:1])

        # the first fits, with q off its best value in the other direction
        self.held = ProfileBranch(
            points=(point(0.1, -0.05, 1.5), point(LIMIT + 2.0 * S, LIMIT, 2.0)),
            end="held",
            at_68=1.0 + out * (LIMIT + S),
            at_95=1.0 + out * CROSSING,
            held=(1,),
        )
        self.farther = 1.0 + out * ASKED

    def after(
        self,
        other: str | ProfileBranch = "crossed",
        *,
        output: bool = False,
        low: float = -50.0,
        high: float = 50.0,
    ) -> ProfileBranch:
        """The branch afterwards, the other one having ended as told; all else is as it was."""
        if isinstance(other, str):
            other = ProfileBranch(points=(), end=other, at_68=math.nan, at_95=math.nan)
        quantity = Quantity(
            name="p",
            index=-1 if output else 0,
            output=0 if output else -1,
            best=1.0,
            sigma=S,
            low=low,
            high=high,
        )
        before: Branches = (other, self.held) if self.side else (self.held, other)
        told = {"p": before}
        after = released(self.evaluator, self.optimum, [quantity], told)["p"]
        assert after[1 - self.side] is other
        assert told == {"p": before}
        assert self.evaluator.likelihood is self.room
        return after[self.side]

    def frees(self, branch: ProfileBranch) -> bool:
        """Whether a branch is this one as if it had crossed at the value that was asked for."""
        crossed = replace(self.held, end="crossed", at_95=branch.at_95, held=())
        return branch == crossed and math.isclose(branch.at_95, self.farther)


@pytest.mark.parametrize("output", [False, True])
@BOTH_WAYS
def test_where_nothing_fits_beyond_a_limit_the_data_end_it(
    side: int, way: float, output: bool
) -> None:
    """3 per cent farther out than it crosses."""
    scene = Scene(flat, side, way)
    assert scene.frees(scene.after(output=output))


def test_a_value_over_decades_is_asked_for_three_per_cent_more_of_its_ratio() -> None:
    """From 1 to 7.2 it goes on to 7.2^1.03; a share of the way down would lead below nought."""
    scene = Scene(flat)
    scene.farther = (1.0 + CROSSING) ** 1.03
    assert scene.frees(scene.after(output=True, low=0.5))
    assert not scene.frees(scene.after(output=True, low=6.0))


@pytest.mark.parametrize("side", [0, 1])
def test_nothing_is_asked_for_beyond_the_end_of_a_range(side: int) -> None:
    """3 per cent farther out lies beyond it; half of the way there is asked for."""
    scene, end = Scene(flat, side), CROSSING + 0.05
    scene.farther = 1.0 + (1.0 if side else -1.0) * (CROSSING + 0.025)
    assert scene.frees(scene.after(output=True, low=1.0 - end, high=1.0 + end))


@pytest.mark.parametrize("output", [False, True])
@BOTH_WAYS
def test_where_q_leads_on_beyond_its_limit_that_limit_ended_it(
    side: int, way: float, output: bool
) -> None:
    scene = Scene(lambda q: q - LIMIT, side, way)
    assert scene.after(output=output) is scene.held


def test_a_branch_that_was_gone_on_with_is_released_at_its_last_crossing() -> None:
    """The first lies where q is at its lower limit, where h is flat: nothing leads on."""
    scene = Scene(lambda q: q - LIMIT, least=-1.0)
    first = replace(scene.held.points[1], value=2.0, x=np.array([2.0, -LIMIT]))
    fitting, crossed = scene.held.points
    scene.held = replace(scene.held, points=(first, fitting, crossed))
    assert scene.after() is scene.held


@pytest.mark.parametrize(("root", "fits"), [(1.95, True), (1.97, False)])
@BOTH_WAYS
def test_beyond_a_limit_fits_what_is_within_95_per_cent(
    side: int, way: float, root: float, fits: bool
) -> None:
    """h goes on to so many sigma below the value that is asked for."""
    most = ASKED - root * S - LIMIT
    scene = Scene(lambda q: min(q - LIMIT, most), side, way)
    after = scene.after()
    assert after is scene.held if fits else scene.frees(after)


@pytest.mark.parametrize(("k", "fits"), [(1, True), (3, True), (10, True), (11, False)])
@BOTH_WAYS
def test_what_no_slope_leads_to_is_found_in_ten_doublings(
    side: int, way: float, k: int, fits: bool
) -> None:
    """h is flat about the limit, and what p wants about one place far out."""

    def beyond(q: float) -> float:
        return ASKED - LIMIT if abs(q / at_doubling(k) - 1.0) < 0.05 else 0.0

    scene = Scene(beyond, side, way)
    after = scene.after()
    assert after is scene.held if fits else scene.frees(after)


def test_what_a_slope_leads_to_is_found_between_the_doublings() -> None:
    """A slope that leads to 1006 soon comes to its end, yet h is what p wants there."""
    wanted = ASKED - LIMIT
    assert at_doubling(6) < 900.0 < 1100.0 < at_doubling(7)

    def beyond(q: float) -> float:
        return wanted if 900.0 < q < 1100.0 else wanted * min((q - LIMIT) / 1000.0, 0.2)

    scene = Scene(beyond, box=1000.0)
    assert 0.8 * wanted > Z95 * S
    assert scene.after() is scene.held


@pytest.mark.parametrize("other", ["bound", "round", "lost", "cost"])
@pytest.mark.parametrize("side", [0, 1])
def test_nothing_is_released_where_the_other_side_is_not_ended(side: int, other: str) -> None:
    scene = Scene(flat, side)
    spent = scene.evaluator.evaluations
    assert scene.after(other) is scene.held
    assert scene.evaluator.evaluations == spent


@BOTH_WAYS
def test_a_side_is_released_beside_another_that_stays_held(side: int, way: float) -> None:
    """On the other side h goes on beyond the other limit of q as it did before."""
    scene = Scene(flat, side, way)
    assert scene.frees(scene.after(Scene(flat, 1 - side, -way).held))


@pytest.mark.parametrize("end", ["crossed", "bound", "lost"])
def test_a_side_that_no_limit_held_stays_as_it_is(end: str) -> None:
    scene = Scene(flat)
    scene.held = replace(scene.held, end=end, held=())
    assert scene.after() is scene.held


def test_what_is_not_found_out_leaves_it_to_the_limit() -> None:
    """Nobody answers beyond the limit, or there is no more to spend."""

    def nobody(q: float) -> float:
        raise FmuFailure("overdamped", {}, Path("test.fmu"))

    silent, spent = Scene(nobody), Scene(flat)
    assert silent.after() is silent.held
    for more in (0, 4):
        spent.evaluator.limit = spent.evaluator.spent + more
        assert spent.after() is spent.held
