"""Sentences of decisions that are written down: what a reader is told is what was decided."""

from __future__ import annotations

import math

import pytest

from fitting.simulate.budget import Basis, Budget, Decision, Kind
from fitting.simulate.words import (
    decision_in_words,
    sum_in_words,
    warnings_in_words,
)
from tests.support.plan_words import plan_in_words


def model(basis: Basis, bound: float, **more: object) -> Decision:
    return Decision(
        kind=Kind.MODEL,
        basis=basis,
        bound=bound,
        subject="far mode left out",
        settings={"far": False},
        **more,  # type: ignore[arg-type]
    )


@pytest.mark.parametrize(
    ("decision", "tokens"),
    [
        (
            Decision(kind=Kind.SETTLING, basis=Basis.STEADY, bound=0.0, numbers={"settle_s": 0.0}),
            ("settling: none", "steady"),
        ),
        (
            Decision(
                kind=Kind.SETTLING, basis=Basis.WATCHED, bound=2e-5, numbers={"settle_s": 0.066}
            ),
            ("settling: 66 ms; ", "below 2.0e-05", "at most 2.0e-05"),
        ),
        (
            Decision(
                kind=Kind.SETTLING,
                basis=Basis.PRESCRIBED,
                bound=3e-3,
                numbers={"settle_s": 2.5e-6},
                forced=True,
            ),
            ("settling: 2.5 µs (as requested)", "below 3.0e-03", "at most 3.0e-03"),
        ),
        (
            Decision(
                kind=Kind.INPUT,
                basis=Basis.COMPARED,
                bound=1e-6,
                numbers={"steps_per_period": 80, "safety": 2.0},
            ),
            ("input: ", "80 steps", "2 times", "at most 1.0e-06"),
        ),
        (
            Decision(
                kind=Kind.SAMPLES,
                basis=Basis.COMPARED,
                bound=4e-7,
                numbers={"least": 5, "most": 7, "order": 1, "finer": 5, "safety": 2.0},
            ),
            ("samples: 5 to 7 ", "2 times", "order 5", "at most 4.0e-07"),
        ),
        (
            Decision(
                kind=Kind.SAMPLES,
                basis=Basis.COMPARED,
                bound=4e-7,
                numbers={"least": 9, "most": 9, "order": 5, "finer": 11, "safety": 2.0},
            ),
            ("samples: 9 per run", "order 5", "2 times", "order 11", "at most 4.0e-07"),
        ),
        (
            Decision(
                kind=Kind.SAMPLES,
                basis=Basis.COMPARED,
                bound=4e-7,
                numbers={"least": 9, "most": 9, "order": 1, "finer": 1, "safety": 2.0},
            ),
            ("samples: 9 per run", "2 times the residual of the tone fit", "at most 4.0e-07"),
        ),
        (
            Decision(
                kind=Kind.SOLVER,
                basis=Basis.COMPARED,
                bound=5e-6,
                subject="h",
                numbers={"safety": 2.0, "part": 0.5},
                settings={"h": 1.25e-4},
            ),
            ("solver: h = 0.000125; ", "2 times", "half of it", "at most 5.0e-06"),
        ),
        (
            Decision(
                kind=Kind.SOLVER,
                basis=Basis.PRESCRIBED,
                bound=5e-6,
                subject="tolerance",
                numbers={"safety": 2.0, "part": 0.01},
                settings={"tolerance": 1e-6},
                forced=True,
            ),
            ("solver: tolerance = 1e-06 (as requested)", "2 times", "hundredth", "at most 5.0e-06"),
        ),
        (
            Decision(
                kind=Kind.WINDOW,
                basis=Basis.COHERENT,
                bound=0.0,
                subject="100 Hz",
                numbers={
                    "shortest_s": 0.01,
                    "longest_s": 0.02,
                    "least": 5,
                    "most": 5,
                    "mixtures": 0,
                },
            ),
            ("window: 0.01 to 0.02 s, 5 samples; 100 Hz: ", "Fourier"),
        ),
        (
            Decision(
                kind=Kind.WINDOW,
                basis=Basis.FITTED,
                bound=0.0,
                numbers={"shortest_s": 0.5, "longest_s": 0.5, "least": 9, "most": 12},
            ),
            ("window: 0.5 s, 9 to 12 samples; ", "common period"),
        ),
        (
            Decision(
                kind=Kind.CURVE,
                basis=Basis.RATIONAL,
                bound=0.0,
                numbers={
                    "runs": 14,
                    "points": 82,
                    "curves": 2,
                    "interpolated": 1,
                    "degree": 3,
                    "safety": 2.0,
                },
            ),
            ("response curve: 14 runs", "82 points", "degree 3", "1 of 2 curves", "2.0 times"),
        ),
        (
            Decision(
                kind=Kind.CURVE,
                basis=Basis.NONLINEAR,
                bound=0.0,
                numbers={"points": 41, "curves": 1, "found": 2e-3, "wanted": 1e-6},
                taken=False,
            ),
            ("response curve: ", "41 points", "off by 2.0e-03", "wanted 1.0e-06"),
        ),
        (
            Decision(
                kind=Kind.STEP,
                basis=Basis.HALVED,
                bound=1e-5,
                numbers={
                    "step_s": 1.25e-4,
                    "longest_s": 5e-4,
                    "per_sample": 4,
                    "own_s": 1e-3,
                    "change": 5e-6,
                    "runs": 3,
                },
            ),
            ("communication step: 125 µs", "up to 4 in", "5.0e-06", "3 runs", "0.001 s", "1.0e-05"),
        ),
        (
            Decision(
                kind=Kind.STEP,
                basis=Basis.HALVED,
                bound=2e-3,
                numbers={
                    "step_s": 1e-2,
                    "longest_s": 1e-2,
                    "per_sample": 1,
                    "own_s": 0.0,
                    "stands_s": 2e-3,
                    "change": 0.0,
                    "runs": 6,
                },
            ),
            ("communication step: 10 ms, 1 in", "0.0e+00", "6 runs", "of 0.002 s", "2.0e-03"),
        ),
        (
            Decision(
                kind=Kind.MAXIMUM,
                basis=Basis.POLYNOMIAL,
                bound=2e-6,
                numbers={"points": 5, "spacing_hz": 0.25, "centre_hz": 1000.0},
            ),
            ("maximum of the sweep: 5 points 0.25 Hz", "1 kHz", "at most 2.0e-06"),
        ),
        (
            model(
                Basis.STATED,
                1e-4,
                numbers={"left": 3e-4, "times_cheaper": 4.0, "outputs": "x_error"},
            ),
            ("far mode left out: far = false; ", "x_error", "1/4 of", "at most 1.0e-04"),
        ),
        (
            model(
                Basis.COMPARED, 4e-4, numbers={"left": 3e-4, "times_cheaper": 4.0, "safety": 2.0}
            ),
            ("far mode left out: far = false; ", "2 times", "too long", "at most 4.0e-04"),
        ),
        (
            model(Basis.COMPARED, 4e-4, numbers={"left": 3e-4, "safety": 2.0}, taken=False),
            ("far mode left out: far = false; not taken", "2 times", "3.0e-04"),
        ),
        (
            model(Basis.COMPARED, 4e-4, numbers={"left": 3e-4, "safety": 2.0}, forced=True),
            (
                "far mode left out: far = false (as requested)",
                "2 times",
                "3.0e-04",
                "at most 4.0e-04",
            ),
        ),
        (
            model(Basis.NO_CHEAPER, math.nan, taken=False),
            ("far mode left out: far = false; not taken", "as long"),
        ),
        (
            model(Basis.CLOSED, 0.0, numbers={"left": 3e-4, "times_cheaper": 8.0}),
            ("far mode left out: far = false; ", "orbit closes", "1/8 of"),
        ),
        (
            model(Basis.FORBIDDEN, math.nan, forced=True, taken=False),
            ("far mode left out: far = false; not taken", "forbidden"),
        ),
    ],
    ids=lambda value: "" if isinstance(value, Decision) else value[0],
)
def test_a_decision_is_told_with_its_choice_and_its_reason(
    decision: Decision, tokens: tuple[str, ...]
) -> None:
    """What it is about stands first; then every number, in this order."""
    said = decision_in_words(decision)
    assert said.startswith(tokens[0])
    places = [said.find(token) for token in tokens]
    assert -1 not in places
    assert places == sorted(places)


def settling(bound: float) -> Decision:
    return Decision(kind=Kind.SETTLING, basis=Basis.WATCHED, bound=bound, numbers={"settle_s": 0.5})


def test_a_promise_is_the_sum_and_one_that_is_not_kept_says_by_what() -> None:
    """3e-5 and 4e-4 of 1e-3; then 3e-3 of it for the settling alone."""
    small = model(Basis.STATED, 4e-4, numbers={"left": 5e-4, "work": 0.2, "outputs": "x_error"})
    kept = Budget(1e-3, (settling(3e-5), small))
    promised = plan_in_words(kept, of="the largest")[-1]
    assert "4.3e-04 of the largest" in promised
    assert "wanted 1.0e-03" in promised
    assert warnings_in_words(kept) == ()
    broken = Budget(1e-3, (small, settling(3e-3)))
    said = sum_in_words(broken)
    for token in ("3.4e-03", "1.0e-03", "settling (500 ms)"):
        assert token in said
    [warned] = warnings_in_words(broken)
    assert warned.endswith(said.partition(": ")[2])


def test_what_is_forced_beyond_the_whole_promise_is_warned_of() -> None:
    forced = model(Basis.COMPARED, 0.02, numbers={"left": 3e-4, "safety": 2.0}, forced=True)
    said = warnings_in_words(Budget(1e-3, (forced,)))
    [beyond] = said[1:]
    assert beyond.startswith("far mode left out (far = false) ")
    assert "2.0e-02" in beyond
    assert "1.0e-03" in beyond
    within = model(Basis.COMPARED, 9e-4, numbers={"left": 3e-4, "safety": 2.0}, forced=True)
    assert warnings_in_words(Budget(1e-3, (within,))) == ()
