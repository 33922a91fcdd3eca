"""Sentences of decisions that are written down: what a reader is told is what was decided."""

from __future__ import annotations

import math

import pytest

from fitting.simulate.budget import Basis, Budget, Decision, Kind
from fitting.simulate.words import (
    decision_in_words,
    plan_in_words,
    sum_in_words,
    warnings_in_words,
)


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
    ("decision", "said"),
    [
        (
            Decision(kind=Kind.SETTLING, basis=Basis.STEADY, bound=0.0, numbers={"settle_s": 0.0}),
            "settling: none; the response is steady from the start: amplitudes do not change "
            "with time",
        ),
        (
            Decision(
                kind=Kind.SETTLING, basis=Basis.WATCHED, bound=2e-5, numbers={"settle_s": 0.066}
            ),
            "settling: 66 ms; transient below 2.0e-05, by watching the amplitudes while the time "
            "doubled; at most 2.0e-05",
        ),
        (
            Decision(
                kind=Kind.SETTLING,
                basis=Basis.PRESCRIBED,
                bound=3e-3,
                numbers={"settle_s": 2.5e-6},
                forced=True,
            ),
            "settling: 2.5 µs (as asked for); transient below 3.0e-03, against amplitudes that "
            "stand still; at most 3.0e-03",
        ),
        (
            Decision(
                kind=Kind.INPUT,
                basis=Basis.COMPARED,
                bound=1e-6,
                numbers={"steps_per_period": 80, "safety": 2.0},
            ),
            "input: held over 80 steps per period; 2 times the change with twice as many; "
            "at most 1.0e-06",
        ),
        (
            Decision(
                kind=Kind.SAMPLES,
                basis=Basis.COMPARED,
                bound=4e-7,
                numbers={"least": 5, "most": 7, "order": 1, "finer": 5, "safety": 2.0},
            ),
            "samples: 5 to 7 per run; 2 times the change with combinations up to order 5 kept "
            "off; at most 4.0e-07",
        ),
        (
            Decision(
                kind=Kind.SAMPLES,
                basis=Basis.COMPARED,
                bound=4e-7,
                numbers={"least": 9, "most": 9, "order": 5, "finer": 11, "safety": 2.0},
            ),
            "samples: 9 per run, no combination of tones up to order 5 folded onto a tone; "
            "2 times the change with combinations up to order 11 kept off; at most 4.0e-07",
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
            "solver: h = 0.000125; 2 times the change of the amplitudes at half of it; "
            "at most 5.0e-06",
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
            "solver: tolerance = 1e-06 (as asked for); 2 times the change of the amplitudes at a "
            "hundredth of it; at most 5.0e-06",
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
            "window: 0.01 to 0.02 s, 5 samples; 100 Hz: whole periods of every tone, none folded "
            "onto another, onto 0 or onto half the rate: the fit of the tones is the Fourier bin, "
            "without leakage",
        ),
        (
            Decision(
                kind=Kind.WINDOW,
                basis=Basis.FITTED,
                bound=0.0,
                numbers={"shortest_s": 0.5, "longest_s": 0.5, "least": 9, "most": 12},
            ),
            "window: 0.5 s, 9 to 12 samples; tones without a common period of reasonable length "
            "are fitted, which leaves no leakage either",
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
            "response curve: 14 runs for 82 points of 2 curves; half the drive gives half the "
            "response, and a rational function of degree 3 goes through it for 1 of 2 curves, the "
            "rest point by point; both are checked in every evaluation, at every point by 2.0 "
            "times the change that leaving out a run makes; where that exceeds the bound runs are "
            "added",
        ),
        (
            Decision(
                kind=Kind.CURVE,
                basis=Basis.NONLINEAR,
                bound=0.0,
                numbers={"points": 41, "curves": 1, "found": 2e-3, "wanted": 1e-6},
                taken=False,
            ),
            "response curve: a run for each of 41 points; not interpolated: half the drive does "
            "not give half the response (off by 2.0e-03, wanted 1.0e-06)",
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
            "communication step: 125 µs and longer, up to 4 in a sample; half of it changes a "
            "trace by 5.0e-06 of its largest value, in 3 runs; the FMU's own step of 0.001 s is "
            "longer than the sampling interval; at most 1.0e-05",
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
            "communication step: 10 ms, 1 in a sample; half of it changes a trace by 0.0e+00 of "
            "its largest value, in 6 runs; the FMU advances in steps of its own of 0.002 s, which "
            "cannot be shortened from outside: what Euler's method would leave is taken for its "
            "error; at most 2.0e-03",
        ),
        (
            Decision(
                kind=Kind.MAXIMUM,
                basis=Basis.POLYNOMIAL,
                bound=2e-6,
                numbers={"points": 5, "spacing_hz": 0.25, "centre_hz": 1000.0},
            ),
            "maximum of the sweep: 5 points 0.25 Hz apart; the simulated maximum is interpolated "
            "around 1 kHz (1/A^2 as a polynomial of degree four); more points are added where "
            "its bias exceeds the bound; at most 2.0e-06",
        ),
        (
            model(Basis.STATED, 1e-4, numbers={"left": 3e-4, "work": 0.25, "outputs": "x_error"}),
            "far mode left out: far = false; by the FMU's x_error; a run takes 0.25 of the work; "
            "at most 1.0e-04",
        ),
        (
            model(Basis.COMPARED, 4e-4, numbers={"left": 3e-4, "work": 0.25, "safety": 2.0}),
            "far mode left out: far = false; 2 times the change, more than is left for it, but a "
            "run without it would take too long; at most 4.0e-04",
        ),
        (
            model(Basis.COMPARED, 4e-4, numbers={"left": 3e-4, "safety": 2.0}, taken=False),
            "far mode left out: far = false; not taken: 2 times the change, and 3.0e-04 is left "
            "for it",
        ),
        (
            model(Basis.COMPARED, 4e-4, numbers={"left": 3e-4, "safety": 2.0}, forced=True),
            "far mode left out: far = false (as asked for); 2 times the change, beyond the "
            "3.0e-04 that is left for it; at most 4.0e-04",
        ),
        (
            model(Basis.UNMEASURED, math.nan, numbers={"work": 0.9}, taken=False),
            "far mode left out: far = false; not taken: no cheaper (a run takes 0.9 of the work)",
        ),
        (
            model(Basis.FORBIDDEN, math.nan, forced=True, taken=False),
            "far mode left out: far = false; not taken: forbidden",
        ),
    ],
    ids=lambda value: "" if isinstance(value, Decision) else str(value).split(";")[0],
)
def test_a_decision_is_told_with_its_choice_and_its_reason(decision: Decision, said: str) -> None:
    assert decision_in_words(decision) == said


def settling(bound: float) -> Decision:
    return Decision(kind=Kind.SETTLING, basis=Basis.WATCHED, bound=bound, numbers={"settle_s": 0.5})


def test_a_promise_is_the_sum_and_one_that_is_not_kept_says_by_what() -> None:
    """3e-5 and 4e-4 of 1e-3; then 3e-3 of it for the settling alone."""
    small = model(Basis.STATED, 4e-4, numbers={"left": 5e-4, "work": 0.2, "outputs": "x_error"})
    kept = Budget(1e-3, (settling(3e-5), small))
    assert plan_in_words(kept, of="the largest")[-1] == (
        "In all: amplitudes within 4.3e-04 of the largest, wanted 1.0e-03."
    )
    assert warnings_in_words(kept) == ()
    broken = Budget(1e-3, (small, settling(3e-3)))
    assert sum_in_words(broken) == (
        "In all: 3.4e-03 is what can be promised, not the 1.0e-03 that was wanted; most of it is "
        "due to settling (500 ms)."
    )
    assert warnings_in_words(broken) == (
        "Accuracy: 3.4e-03 is what can be promised, not the 1.0e-03 that was wanted; most of it "
        "is due to settling (500 ms).",
    )


def test_what_is_forced_beyond_the_whole_promise_is_warned_of() -> None:
    forced = model(Basis.COMPARED, 0.02, numbers={"left": 3e-4, "safety": 2.0}, forced=True)
    said = warnings_in_words(Budget(1e-3, (forced,)))
    assert said[1:] == (
        "far mode left out (far = false) is forced beyond its bound: it may be off by 2.0e-02, "
        "wanted 1.0e-03.",
    )
    within = model(Basis.COMPARED, 9e-4, numbers={"left": 3e-4, "safety": 2.0}, forced=True)
    assert warnings_in_words(Budget(1e-3, (within,))) == ()
