"""Sweeps of a tone against amplitudes in closed form, with branches that end at told places."""

from __future__ import annotations

import math

import pytest

from fitting.simulate.frf import Curve, Jump, Sweep, SweepResponse, take_sweep
from fitting.simulate.planner import PlanOptions, plan_drives
from fitting.simulate.probe import Knowledge
from fitting.text.errors import BadInput
from tests.support.line_workers import BranchWorkers

F_HZ = tuple(float(f) for f in range(1000, 1021, 2))


def sweep_of(directions: tuple[str, ...] = ("up", "down"), unit: str = "Hz") -> Sweep:
    return Sweep(
        start_values={"damping": 1.0},
        tone="u",
        tone_unit=unit,
        frequencies_hz=F_HZ,
        output="x",
        directions=directions,
    )


def taken(workers: BranchWorkers, what: Sweep) -> SweepResponse:
    """As planned at one of its points, come to from the far end."""
    options = PlanOptions(examples=True, of_largest=True)
    plan = plan_drives(
        (what.drive(F_HZ[0], F_HZ[-1]), what.drive(F_HZ[-1], F_HZ[0])),
        1e-4,
        workers,
        Knowledge(),
        options,
    )
    return take_sweep(workers, what, plan)


def one_branch(f: float, rising: bool) -> float:
    return 2.0 / math.hypot(1.0, (f - 1009.0) / 3.0)


def two_branches(f: float, rising: bool) -> float:
    """The upper one ends above 1014 Hz on the way up, the lower one below 1006 on the way down."""
    return (5.0 if f <= 1014.0 else 1.0) if rising else (1.0 if f >= 1006.0 else 5.0)


@pytest.mark.parametrize(("unit", "size"), [("Hz", 1.0), ("kHz", 1e3)])
def test_amplitudes_are_those_of_each_way_ascending(unit: str, size: float) -> None:
    found = taken(BranchWorkers(one_branch, size), sweep_of(unit=unit))
    assert [curve.direction for curve in found.curves] == ["up", "down"]
    for curve in found.curves:
        truth = [one_branch(f, True) for f in F_HZ]
        assert curve.amplitudes == pytest.approx(truth, rel=1e-6)
    assert found.jumps == ()
    assert found.difference == pytest.approx(0.0, abs=1e-6)
    assert found.steady
    assert found.accuracy <= 1e-4


def test_one_simulation_visits_all_points_in_their_order() -> None:
    workers = BranchWorkers(one_branch)
    taken(workers, sweep_of())
    up, down = workers.asked[-2:]
    # the first point is come to from itself: a segment of its own
    assert up.start_values["u"] == F_HZ[0]
    assert [s.value for s in up.segments] == list(F_HZ[1:])
    assert down.start_values["u"] == F_HZ[-1]
    assert [s.value for s in down.segments] == list(F_HZ[-2::-1])
    assert up.moved == "u"
    assert up.start_values["damping"] == 1.0


def test_branches_end_where_each_way_leaves_them() -> None:
    found = taken(BranchWorkers(two_branches), sweep_of())
    assert found.jumps == (Jump("up", 1014.0, 1016.0), Jump("down", 1004.0, 1006.0))
    assert found.difference == pytest.approx(0.8, rel=1e-6)
    assert found.curves[0].amplitudes == pytest.approx([5.0] * 8 + [1.0] * 3, rel=1e-6)
    turned = taken(BranchWorkers(two_branches), sweep_of(("down", "up")))
    assert turned.jumps == found.jumps


@pytest.mark.parametrize(
    ("apart", "jumps"),
    [
        (slice(3, 6), (Jump("up", 1010.0, 1012.0), Jump("down", 1004.0, 1006.0))),
        (slice(0, 3), (Jump("up", 1004.0, 1006.0),)),
        (slice(8, 11), (Jump("down", 1014.0, 1016.0),)),
        (slice(0, 11), ()),
    ],
)
@pytest.mark.parametrize(("share", "differ"), [(0.021, True), (0.019, False)])
def test_ways_differ_from_two_per_cent_of_the_larger_on(
    apart: slice, jumps: tuple[Jump, ...], share: float, differ: bool
) -> None:
    places = {F_HZ[k] for k in range(*apart.indices(len(F_HZ)))}
    for larger in (True, False):

        def amplitude(f: float, rising: bool, larger: bool = larger) -> float:
            return 3.0 * (1.0 - share) if f in places and rising is larger else 3.0

        # the very first point of each way is come to from nowhere: both are the same there
        found = taken(BranchWorkers(amplitude), sweep_of())
        inner = jumps if differ else ()
        if apart.start > 0 and apart.stop < 11:
            assert found.jumps == inner
            assert found.difference == pytest.approx(share, rel=1e-3)


def test_of_several_stretches_the_widest_counts() -> None:
    places = {1004.0, 1010.0, 1012.0, 1014.0, 1018.0}

    def amplitude(f: float, rising: bool) -> float:
        return 2.0 if f in places and rising else 1.0

    found = taken(BranchWorkers(amplitude), sweep_of())
    assert found.jumps == (Jump("up", 1014.0, 1016.0), Jump("down", 1008.0, 1010.0))


def test_one_way_tells_nothing_of_another() -> None:
    found = taken(BranchWorkers(two_branches), sweep_of(("down",)))
    assert found.jumps == ()
    assert found.difference is None
    assert isinstance(found.curves[0], Curve)
    assert found.curves[0].amplitudes[0] == pytest.approx(5.0, rel=1e-6)


@pytest.mark.parametrize("f", [(1.0,), (2.0, 1.0), (1.0, 1.0), (0.0, 1.0), (-1.0, 1.0)])
def test_points_that_do_not_rise_are_refused(f: tuple[float, ...]) -> None:
    with pytest.raises(BadInput, match="rising points"):
        Sweep(start_values={}, tone="u", tone_unit="Hz", frequencies_hz=f, output="x")


def test_what_both_ways_differ_by_is_an_error_where_no_branch_ends() -> None:
    """The plan looks at a point on its way from the upper end alone: what is off upwards is not."""

    def hovering(f: float, rising: bool) -> float:
        return one_branch(f, rising) * (1.0 + (1e-3 if rising and f == 1004.0 else 0.0))

    found = taken(BranchWorkers(hovering), sweep_of())
    truth = [one_branch(f, True) for f in F_HZ]
    off = max(
        abs(a - t) for curve in found.curves for a, t in zip(curve.amplitudes, truth, strict=True)
    )
    assert off / max(truth) < (1.0 + 1e-9) * found.accuracy < 2e-3
    assert not found.steady
    assert found.jumps == ()
