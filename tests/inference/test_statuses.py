"""Statuses against intervals that are written down by hand: which, and what closes each side."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import numpy as np
import pytest

from fitting.campaign.parameters import Parameter
from fitting.inference.likelihood.knowledge import Scan
from fitting.report.screen import phrase
from fitting.text.arrays import FloatArray
from fitting.text.estimate import FittedEstimate, Verdict
from fitting.text.finding import Kind, of_kind
from tests.support.whitened import Z95, learnt, parameter, whitened

Rows = Callable[[FloatArray], FloatArray]


def thrice(row: Callable[[float], float]) -> Rows:
    """Three equal rows of one parameter whose chi square is row(p)^2: more data than unknowns."""
    return lambda p: np.full(3, row(float(p[0])) / math.sqrt(3.0))


def profile_of(row: Callable[[float], float], own: Parameter) -> FittedEstimate:
    return learnt(whitened(thrice(row), own)).parameters[own.name]


# --- the box takes no part

#: Closed forms: the row of a value, whether it can be negative, verdict, both ends (NaN: open).
ENDED: dict[str, tuple[Callable[[float], float], bool, Verdict, tuple[float, float]]] = {
    "both, positive": (
        lambda p: (p - 4.0) / 0.5,
        False,
        Verdict.DETERMINED,
        (4.0 - 0.5 * Z95, 4.0 + 0.5 * Z95),
    ),
    "both, of either sign": (
        lambda p: (p - 4.0) / 0.5,
        True,
        Verdict.DETERMINED,
        (4.0 - 0.5 * Z95, 4.0 + 0.5 * Z95),
    ),
    "above, positive": (
        lambda p: (p - 4.0) / 3.0,
        False,
        Verdict.ABOVE,
        (math.nan, 4.0 + 3.0 * Z95),
    ),
    "below, positive": (
        lambda p: (1.0 / p - 0.25) / 0.25,
        False,
        Verdict.BELOW,
        (1.0 / (0.25 + 0.25 * Z95), math.nan),
    ),
    # ln(1 + e^p) is p where p is large and vanishes where it is not: s = 1/2 reaches its zero
    "above, of either sign": (
        lambda p: (np.logaddexp(0.0, p) - math.log(2.0)) / 0.5,
        True,
        Verdict.ABOVE,
        (math.nan, math.log(math.exp(math.log(2.0) + 0.5 * Z95) - 1.0)),
    ),
    "below, of either sign": (
        lambda p: (np.logaddexp(0.0, -p) - math.log(2.0)) / 0.5,
        True,
        Verdict.BELOW,
        (-math.log(math.exp(math.log(2.0) + 0.5 * Z95) - 1.0), math.nan),
    ),
    "neither, positive": (lambda p: 0.0, False, Verdict.UNCONSTRAINED, (math.nan, math.nan)),
    "neither, of either sign": (lambda p: 0.0, True, Verdict.UNCONSTRAINED, (math.nan, math.nan)),
}


def in_box(wider: float, *, signed: bool) -> Parameter:
    """A value with its start at 3 in a box 1, 3 or 1000 times as wide."""
    if signed:
        return parameter("p", 4.0 - 10.0 * wider, 4.0 + 10.0 * wider, start=3.0)
    return parameter("p", 0.5 / wider, 30.0 * wider, start=3.0)


@pytest.mark.parametrize("wider", [1.0, 3.0, 1000.0])
@pytest.mark.parametrize("case", ENDED)
def test_the_data_end_an_interval_and_no_box(case: str, wider: float) -> None:
    row, signed, verdict, ends = ENDED[case]
    own = in_box(wider, signed=signed)
    found = profile_of(row, own)
    assert found.status is verdict, found.reason
    for side, (end, at) in enumerate(zip(ends, found.ci95, strict=True)):
        if math.isnan(end):
            assert found.closed_by[side] == "bound"
            assert at == (own.lower, own.upper)[side]  # nothing was excluded
        else:
            assert found.closed_by[side] == "data"
            assert at == pytest.approx(end, rel=0.01)


@pytest.mark.parametrize("upper", [2.0, 20.0, 2e4])
@pytest.mark.parametrize("lower", [0.0, 1e-3, 0.01, 0.1, 0.3])
def test_a_positive_value_that_is_zero_within_its_error_is_bounded_above(
    lower: float, upper: float
) -> None:
    """p = 0 with noise 1/2: the least chi square, 4 p^2, is that at the lower bound."""
    found = profile_of(lambda p: p / 0.5, parameter("p", lower, upper, start=0.7))
    assert found.status is Verdict.ABOVE, found.reason
    assert found.ci95[0] == lower
    assert found.ci95[1] == pytest.approx(0.5 * math.hypot(Z95, 2.0 * lower), rel=0.01)


# --- as many unknowns as data


def test_with_as_many_unknowns_as_data_nothing_is_determined() -> None:
    """Two rows meet two values exactly, whatever the model; a third row tests it."""
    p, q = parameter("p", 1.0, 20.0, start=6.0), parameter("q", 1.0, 20.0, start=6.0)

    def rows(x: FloatArray) -> FloatArray:
        return np.array([(x[0] - 5.0) / 0.1, (x[0] + x[1] - 12.0) / 0.1])

    for found in learnt(whitened(rows, p, q)).parameters.values():
        assert found.status is Verdict.UNKNOWN
        assert "unknowns" in found.reason
    more = whitened(lambda x: np.append(rows(x), (x[1] - 7.0) / 0.1), p, q)
    assert {v.status for v in learnt(more).parameters.values()} == {Verdict.DETERMINED}


def test_a_gaussian_prior_is_one_more_datum() -> None:
    """That of q, far wider than what the data say of it, tests the model for both."""
    p = parameter("p", 1.0, 20.0, start=6.0)
    q = parameter("q", 1.0, 20.0, start=6.0, prior=2.0)
    rows = whitened(lambda x: np.array([(x[0] - 5.0) / 0.1, (x[0] + x[1] - 12.0) / 0.1]), p, q)
    assert {v.status for v in learnt(rows).parameters.values()} == {Verdict.DETERMINED}


# --- how narrow


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("half", "verdict", "reason"),
    [
        (0.49, Verdict.DETERMINED, "49 %"),  # 1.49/0.51 = 2.92
        (0.51, Verdict.BOUNDED, "3.1"),
        (1.02, Verdict.BOUNDED, "zero"),
    ],
)
def test_narrow_is_a_factor_of_three_between_the_ends(
    sign: float, half: float, verdict: Verdict, reason: str
) -> None:
    """An interval of 7 (1 - half) to 7 (1 + half), half its width over its value the precision."""
    own = parameter("p", -50.0, 50.0, start=3.0 * sign)
    found = profile_of(lambda p: (p - 7.0 * sign) * Z95 / (7.0 * half), own)
    assert found.status is verdict
    assert reason in found.reason
    assert found.precision == pytest.approx(half, rel=0.005)


@pytest.mark.parametrize(
    ("share", "verdict"), [(0.245, Verdict.DETERMINED), (0.255, Verdict.BOUNDED)]
)
def test_narrow_is_a_quarter_of_a_period_for_what_goes_round(
    share: float, verdict: Verdict
) -> None:
    """cos and sin of 2 theta, noise s: chi = 2 sin(theta - theta_0)/s, crossed at asin(0.98 s)."""
    half = 0.5 * share * math.pi
    s = 2.0 * math.sin(half) / Z95
    at = 2.1

    def rows(p: FloatArray) -> FloatArray:
        turned = [np.cos(2 * p[0]) - math.cos(2 * at), np.sin(2 * p[0]) - math.sin(2 * at)]
        return np.array([*turned, 0.0]) / s

    own = parameter("theta", 0.0, math.pi, start=1.0, period=math.pi)
    found = learnt(whitened(rows, own)).parameters["theta"]
    assert found.status is verdict
    assert found.ci95 == pytest.approx((at - half, at + half), rel=0.002)
    assert found.precision == pytest.approx(0.5 * share, rel=0.01)
    if verdict is Verdict.BOUNDED:
        assert "quarter" in found.reason


@pytest.mark.parametrize(
    ("tau", "verdict", "reason"),
    [
        (0.32, Verdict.UNCONSTRAINED, "prior"),
        (0.35, Verdict.BOUNDED, "prior"),
        (2.9, Verdict.BOUNDED, "prior"),
        (3.1, Verdict.DETERMINED, ""),
    ],
)
def test_what_the_prior_knows_is_not_said_of_the_data(
    tau: float, verdict: Verdict, reason: str
) -> None:
    """Variances add inversely: the data answer for tau^2/(1 + tau^2), here about 1/10 and 9/10."""
    own = parameter("p", 0.0, 200.0, start=100.0, prior=tau)
    found = profile_of(lambda p: p - 100.0, own)
    half = Z95 * tau / math.hypot(1.0, tau)
    assert found.ci95 == pytest.approx((100.0 - half, 100.0 + half), abs=0.01 * half)
    assert found.status is verdict, found.reason
    assert reason in found.reason


# --- branches that tell nothing


def test_a_jump_of_chi_square_is_no_end() -> None:
    """Beyond 5 the model is another one, ten sigma off: the data were not followed there."""

    def row(p: float) -> float:
        return (p - 4.0) / 5.0 + (10.0 if p > 5.0 else 0.0)

    found = profile_of(row, parameter("p", -50.0, 50.0, start=3.0))
    assert found.closed_by == ("data", "")
    assert found.ci95[0] == pytest.approx(4.0 - 5.0 * Z95, rel=0.01)
    assert found.ci95[1] == 50.0
    assert found.status is Verdict.UNKNOWN


def test_a_steep_end_is_an_end() -> None:
    """Without a jump, a hundred sigma per unit beyond 5 where it was a tenth before."""

    def row(p: float) -> float:
        return (p - 4.0) / 10.0 + 100.0 * max(0.0, p - 5.0)

    found = profile_of(row, parameter("p", -50.0, 50.0, start=3.0))
    assert found.closed_by == ("data", "data")
    assert found.ci95[1] == pytest.approx(5.0 + (Z95 - 0.1) / 100.1, rel=1e-3)


def test_effort_changes_nothing_but_whether_it_is_known() -> None:
    """Two values that the data determine are "not known" until there is enough, never open."""

    def rows(x: FloatArray) -> FloatArray:
        along = np.linspace(-1.0, 1.0, 9)
        return np.asarray((x[0] * np.exp(x[1] * along) - 5.0 * np.exp(0.7 * along)) / 0.2)

    own = parameter("a", 1.0, 20.0, start=6.0), parameter("k", 0.1, 3.0, start=1.0)
    objective = whitened(rows, *own)
    words = []
    for budget in (10, 20, 40, 80, 160, 320, 640):
        found = learnt(objective, budget=budget, only=("a", "k"))
        words.append({v.status for v in found.parameters.values()})
        for name, profile in found.parameters.items():
            if profile.status is Verdict.UNKNOWN:
                assert "budget" in found.scans[name].stopped
    assert set.union(*words) == {Verdict.UNKNOWN, Verdict.DETERMINED}
    assert words[0] == {Verdict.UNKNOWN}
    assert words[-1] == {Verdict.DETERMINED}


# --- limits of other values


def leaning(**limits: float) -> tuple[FittedEstimate, Scan]:
    """p - q is measured, q can follow p as far as it may."""
    p = parameter("p", -50.0, 50.0, start=1.0)
    q = parameter("q", -1.0, 1.0, start=0.0, **limits)
    rows = whitened(lambda x: np.full(3, (x[0] - x[1]) / (0.1 * math.sqrt(3.0))), p, q)
    found = learnt(rows, (0.0, 0.0))
    return found.parameters["p"], found.scans["p"]


def test_a_bound_of_another_value_that_ends_an_interval_is_named_with_it() -> None:
    """q goes to 1 either way: |p| < 1 + 1.96 sigma, within the bounds of q."""
    found, scan = leaning()
    end = 1.0 + 0.1 * Z95
    assert found.closed_by == ("data", "data")
    assert found.ci95 == pytest.approx((-end, end), rel=0.01)
    assert found.status is Verdict.BOUNDED
    assert "zero" in found.reason
    assert found.active_bounds == scan.held == ("q",)


def test_a_limit_that_the_model_declares_is_knowledge() -> None:
    """Where the model itself has no q beyond 1 the same interval rests on no bound."""
    found, scan = leaning(least=-1.0, most=1.0)
    end = 1.0 + 0.1 * Z95
    assert found.closed_by == ("data", "data")
    assert found.ci95 == pytest.approx((-end, end), rel=0.01)
    assert found.active_bounds == scan.held == ()


@pytest.mark.parametrize("power", [1.3, 0.25])
def test_where_another_value_may_vanish_the_end_is_that_at_its_bound(power: float) -> None:
    """p + q^-power = 1.2 +- 0.1 and q <= 10: p <= 1.2 - 10^-power + 1.96 sigma, named with q."""
    p = parameter("p", -50.0, 50.0, start=0.8)
    q = parameter("q", 1.0, 10.0, start=2.0)
    rows = whitened(
        lambda x: np.full(3, (x[0] + x[1] ** -power - 1.2) / (0.1 * math.sqrt(3.0))), p, q
    )
    found = learnt(rows, (0.95, 2.0)).parameters["p"]
    ends = 0.2 - 0.1 * Z95, 1.2 - 10.0**-power + 0.1 * Z95
    assert found.ci95 == pytest.approx(ends, abs=0.01)
    assert found.closed_by == ("data", "data")
    assert found.active_bounds == ("q",)


# --- several values


def valleys(barrier: float, tilt: float = 0.0) -> FittedEstimate:
    """(k^2 - 9/4)^2 with its top at k = 0 `barrier` sigma high; `tilt` sigma lift k = -3/2."""

    def rows(p: FloatArray) -> FloatArray:
        k = float(p[0])
        return np.array([barrier * (k * k / 2.25 - 1.0), tilt * (k - 1.5) / 3.0, 0.0])

    return learnt(whitened(rows, parameter("k", -3.0, 3.0, start=1.0))).parameters["k"]


def test_two_valleys_that_both_fit_are_one_of_several_values() -> None:
    found = valleys(barrier=4.0)
    end = 1.5 * math.sqrt(1.0 + Z95 / 4.0)
    assert found.ci95 == pytest.approx((-end, end), rel=0.01)
    assert found.status is Verdict.SEVERAL
    named = re.match(r"(\S+) or −(\S+), within −1\.84 to 1\.84: ", found.reason)
    assert named is not None, found.reason
    assert [float(value) for value in named.groups()] == pytest.approx([1.5, 1.5], rel=0.005)


def test_two_valleys_with_a_way_between_them_are_one_interval() -> None:
    found = valleys(barrier=1.5)
    end = 1.5 * math.sqrt(1.0 + Z95 / 1.5)
    assert found.ci95 == pytest.approx((-end, end), rel=0.01)
    assert found.status is Verdict.BOUNDED
    assert "zero" in found.reason


@pytest.mark.parametrize(("tilt", "verdict"), [(1.8, Verdict.SEVERAL), (2.2, Verdict.DETERMINED)])
def test_a_valley_counts_as_long_as_it_fits(tilt: float, verdict: Verdict) -> None:
    """Of two valleys with a wall of ten sigma between them the other one is `tilt` sigma higher."""
    found = valleys(barrier=10.0, tilt=tilt)
    assert found.status is verdict, found.reason
    assert (found.ci95[0] < 0.0) is (verdict is Verdict.SEVERAL)


@pytest.mark.parametrize(("lower", "wanted"), [(-1.2, 1.5), (-3.0, -1.5)])
def test_of_two_valleys_the_one_beyond_the_bounds_is_none(lower: float, wanted: float) -> None:
    """Valleys at k = 3/2 and, four of chi square lower, at -3/2: the latter only where it may."""

    def rows(p: FloatArray) -> FloatArray:
        k = float(p[0])
        return np.array([10.0 * (k * k / 2.25 - 1.0), 2.0 * (k + 1.5) / 3.0, *np.zeros(20)])

    found = learnt(whitened(rows, parameter("k", lower, 3.0, start=1.4)))
    k = found.parameters["k"]
    assert k.likely == pytest.approx(wanted, abs=0.1)
    assert k.status is Verdict.DETERMINED
    assert k.ci95[0] * k.ci95[1] > 0.0
    assert found.knowledge.equivalents == ()


# --- what is not noise widens nothing


@pytest.mark.parametrize(("wanted", "bound"), [(12.0, 10.0), (-1.0, 1.0)])
def test_a_bound_that_the_data_would_pass_leaves_its_side_open(wanted: float, bound: float) -> None:
    """p is 12 or -1, and its bounds go from 1 to 10: an interval that ends at a bound."""
    rows = whitened(
        lambda p: np.append((p[0] - wanted) / math.sqrt(3.0) * np.ones(3), np.zeros(12)),
        parameter("p", 1.0, 10.0),
    )
    found = learnt(rows).parameters["p"]
    side = int(bound == 10.0)
    assert found.likely == pytest.approx(bound, abs=1e-3)
    assert found.ci95[side] == bound
    assert found.closed_by == (("data", "bound") if side else ("bound", "data"))
    assert found.status is (Verdict.BELOW if side else Verdict.ABOVE)
    # chi^2 = (12 - c)^2 - 4 = 3.84
    inner = wanted + (1.0 - 2.0 * side) * math.sqrt(4.0 + Z95**2)
    assert found.ci95[1 - side] == pytest.approx(inner, abs=0.02)


@pytest.mark.parametrize("start", [-1.4, 1.4])
def test_a_poor_minimum_that_was_begun_at_widens_no_interval(start: float) -> None:
    """In the valley at -3/2 chi square is about 900, at 3/2 it vanishes."""

    def rows(p: FloatArray) -> FloatArray:
        k = float(p[0])
        return np.array([100.0 * (k * k / 2.25 - 1.0), 10.0 * (k - 1.5), 0.0, 0.0, 0.0])

    found = learnt(whitened(rows, parameter("k", -3.0, 3.0, start=start)))
    k = found.parameters["k"]
    sigma = 1.0 / math.hypot(100.0 * 2.0 * 1.5 / 2.25, 10.0)
    assert found.knowledge.inflation == 1.0
    assert found.knowledge.chi_square == pytest.approx(0.0, abs=0.01)
    assert k.ci95 == pytest.approx((1.5 - Z95 * sigma, 1.5 + Z95 * sigma), rel=1e-3)
    assert k.status is Verdict.DETERMINED


# --- of what outputs can be


@pytest.mark.parametrize(
    ("sigma", "verdict"), [(0.25, Verdict.UNCONSTRAINED), (0.02, Verdict.DETERMINED)]
)
def test_an_output_that_may_be_nearly_all_that_it_can_be_is_not_determined(
    sigma: float, verdict: Verdict
) -> None:
    """f = 100 + tanh 4a lies between 99 and 101, whatever is measured; a is known to sigma.

    Of the range 96 % are left by a = 0 ± 0.49, and 16 % by 0 ± 0.04; the ends are excluded.
    """

    def rows(p: FloatArray) -> FloatArray:
        return np.array([p[0] / sigma, 0.0, 0.0])

    def f(p: FloatArray) -> float:
        return 100.0 + float(np.tanh(4.0 * p[0]))

    known = learnt(whitened(rows, parameter("a", -1.5, 1.5), f=f)).derived["f"]
    assert known.status is verdict
    assert known.closed_by == ("data", "data")


def test_a_width_and_its_q_over_decades_have_the_same_bound() -> None:
    """The data cut the lowest of four decades of a width off: linearly that is next to nothing."""

    def rows(p: FloatArray) -> FloatArray:
        return np.array([19.6 / p[0], 0.0, 0.0])  # 1.96 at a width of 10

    def width(p: FloatArray) -> float:
        return float(p[0])

    def q(p: FloatArray) -> float:
        return 1e9 / width(p)

    a = parameter("a", 1.0, 1e4, start=20.0, least=1.0, most=1e4)
    known = learnt(whitened(rows, a, width=width, q=q)).derived
    assert (known["width"].status, known["q"].status) == (Verdict.BELOW, Verdict.ABOVE)
    assert known["width"].ci95[0] == pytest.approx(10.0, rel=1e-3)
    assert known["q"].ci95[1] == pytest.approx(1e8, rel=1e-3)


# --- bounds of other values


def test_an_end_that_another_value_makes_at_its_bound_names_that_value() -> None:
    """a + d is 5 ± 0.1 and d at most 1: the data alone would let a go to 2.8, the bound to 3.83."""

    def rows(p: FloatArray) -> FloatArray:
        return np.array([(p[0] + p[1] - 5.0) / 0.1, (p[0] - 4.0) / 0.6, 0.0])

    a, d = parameter("a", 0.5, 50.0), parameter("d", 0.1, 1.0, start=0.5)
    known = learnt(whitened(rows, a, d))
    assert known.scans["a"].held == ("d",)
    assert known.parameters["a"].active_bounds == ("d",)
    line = phrase("knowledge", "profile", "a", known.parameters["a"])
    assert "bounds of d" in line
    [at_bound] = of_kind(known.findings, Kind.interval_at_bound)
    assert (at_bound.names["values"], at_bound.names["held"]) == (("a",), ("d",))


def test_two_values_that_make_an_end_at_their_limits_are_both_named() -> None:
    def rows(p: FloatArray) -> FloatArray:
        return np.array([(p[0] + p[1] + p[2] - 5.0) / 0.1, (p[0] - 4.0) / 0.6, 0.0, 0.0])

    own = (parameter(name, 0.1, 0.5, start=0.25) for name in ("d", "e"))
    known = learnt(whitened(rows, parameter("a", 0.5, 50.0), *own))
    assert known.scans["a"].held == ("d", "e")
    assert known.parameters["a"].active_bounds == ("d", "e")


def test_an_interval_that_the_data_make_rests_on_no_bound() -> None:
    """a is 4 ± 0.1 while d, which is 10 ± 1, stays far below 1000."""

    def rows(p: FloatArray) -> FloatArray:
        a, d = p
        opening = np.full(3, (a - 4.0 - (d / 1000.0) ** 8) / 0.1 / math.sqrt(3.0))
        return np.append(opening, (d - 10.0) / 1.0)

    known = learnt(whitened(rows, parameter("a", 0.5, 50.0), parameter("d", 1.0, 100.0)))
    assert known.parameters["a"].status is Verdict.DETERMINED
    assert not of_kind(known.findings, Kind.interval_at_bound)
    assert not any(p.active_bounds for p in known.profiled.values())


# --- outputs that are functions of one another


def test_an_inverse_has_the_verdict_and_the_interval_of_what_it_is_the_inverse_of() -> None:
    """width = a to 4 ± 0.5 and open above, Q = 700/a: the interval of one is that of the other."""

    def rows(p: FloatArray) -> FloatArray:
        return np.full(3, max(0.0, 4.0 - float(p[0])) / 0.5 / math.sqrt(3.0))

    known = learnt(
        whitened(
            rows,
            parameter("a", 0.1, 100.0, start=4.0),
            width=lambda p: float(p[0]),
            Q=lambda p: 700.0 / float(p[0]),
        )
    ).derived
    assert known["width"].status is Verdict.BELOW
    assert known["Q"].status is Verdict.ABOVE
    low = 4.0 - 0.5 * Z95
    assert known["width"].ci95 == pytest.approx((low, 100.0), rel=1e-3)
    assert known["Q"].ci95 == pytest.approx((7.0, 700.0 / low), rel=1e-3)
