"""What a plan decided, in words: the one place where its sentences are made."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from fitting.signal.window import LONGEST_WINDOW_S, Window
from fitting.simulate.budget import Basis, Budget, Decision, Kind, PlanRecord
from fitting.simulate.drive_plan import DrivePlan
from fitting.simulate.frf import SweepResponse
from fitting.simulate.response import Remainder, RemainderKind, Spectrum
from fitting.text.arrays import Scalar
from fitting.text.notation import hertz, how_many, number, prefixed

SUBJECTS = {
    Kind.MAXIMUM: "maximum of the sweep",
    Kind.CURVE: "response curve",
    Kind.STEP: "communication step",
    Kind.GRID: "communication grid",
}


def plan_in_words(budget: Budget, of: str = "themselves") -> tuple[str, ...]:
    """A line per decision, and the sum; "settling: 66 ms; transient below 1.0e-09, ...".

    `of`: what errors are relative to.

    Args:
        budget: what the decisions of a plan promise together.
        of: what errors are relative to.
    """
    lines = (decision_in_words(decision) for decision in budget.decisions)
    return (*lines, sum_in_words(budget, of))


def decision_in_words(decision: Decision) -> str:
    """One decision as a line: subject, choice, reason.

    Args:
        decision: of the plan.
    """
    mark = " (as asked for)" if decision.forced and decision.taken else ""
    most = f"; at most {decision.bound:.1e}" if decision.cost > 0.0 else ""
    reason = reason_in_words(decision)
    return f"{subject_in_words(decision)}: {choice_in_words(decision)}{mark}; {reason}{most}"


def subject_in_words(decision: Decision) -> str:
    """What was decided on.

    Args:
        decision: of the plan.
    """
    if decision.kind == Kind.MODEL:
        return decision.subject
    return SUBJECTS.get(decision.kind, str(decision.kind))


def choice_in_words(decision: Decision) -> str:
    """What was chosen.

    Args:
        decision: of the plan.
    """
    return _CHOICES[decision.kind](decision)


def reason_in_words(decision: Decision) -> str:
    """Why, and what the bound rests on.

    Args:
        decision: of the plan.
    """
    if decision.kind == Kind.MODEL:
        return _model_reason(decision)
    return _REASONS[decision.basis](decision)


def sum_in_words(budget: Budget | PlanRecord, of: str = "themselves") -> str:
    """The sum of the bounds against what was wanted; `of`: what errors are relative to.

    Args:
        budget: what the decisions of a plan promise together.
        of: what errors are relative to.
    """
    if budget.promised <= budget.wanted:
        return (
            f"In all: amplitudes within {budget.promised:.1e} of {of}, wanted {budget.wanted:.1e}."
        )
    largest = max(budget.decisions, key=lambda decision: decision.cost)
    return (
        f"In all: {budget.promised:.1e} is what can be promised, not the {budget.wanted:.1e} that "
        f"was wanted; most of it is due to {subject_in_words(largest)} "
        f"({choice_in_words(largest)})."
    )


def warnings_in_words(budget: Budget) -> tuple[str, ...]:
    """What a user must know: a promise that cannot be given, reductions beyond their bound.

    Args:
        budget: what the decisions of a plan promise together.
    """
    said = [] if budget.kept else [f"Accuracy: {sum_in_words(budget).removeprefix('In all: ')}"]
    said += [
        f"{subject_in_words(d)} ({choice_in_words(d)}) is forced beyond its bound: it may be off "
        f"by {d.bound:.1e}, wanted {budget.wanted:.1e}."
        for d in budget.decisions
        if d.taken and d.forced and d.bound > budget.wanted
    ]
    return tuple(said)


def window_in_words(window: Window) -> str:
    """Why a window does: whole periods and no folding, or the condition of a tone fit.

    Args:
        window: settling and samples of a run.
    """
    if window.coherent:
        said = (
            f"{hertz(*window.tones_hz)}: {window.length_s:.6g} s hold whole periods; "
            f"{window.samples} samples keep the tones apart and off 0 and half the rate, so that a "
            "fit of the tones is the Fourier bin"
        )
    else:
        said = (
            f"{' and '.join(f'{tone!r} Hz' for tone in window.tones_hz)}: no common period of "
            f"reasonable length; amplitudes by a tone fit of {window.samples} samples (condition "
            f"number {window.condition:.2f})"
        )
    if window.mixtures:
        said += f", clear of the {window.mixtures} mixtures that a nonlinear response may have"
    if window.held_steps:
        said += f"; the drive is held over steps of {window.input_step_s:.6g} s"
    return said


# -- what came of a drive, of a sweep ---------------------------------------------------------


def spectrum_in_words(spectrum: Spectrum) -> str:
    """How a spectrum was taken, and what proves that its tones are apart.

    Args:
        spectrum: of the response.
    """
    shown = f"{spectrum.window_s:.9g} s in {spectrum.samples} samples"
    if spectrum.coherent:
        return (
            f"spectrum of {shown}: whole periods of every tone, each alone on bins "
            f"{spectrum.bins}, none folded onto another one, onto 0 or onto half the sampling rate"
        )
    return (
        f"the tones have no common period up to {LONGEST_WINDOW_S:g} s: spectrum of {shown}, "
        "tapered"
    )


def settling_in_words(plan: DrivePlan) -> str:
    """When sampling begins, and why then.

    Args:
        plan: settings, settling and windows, with what they promise.
    """
    decision = plan.budget.of(Kind.SETTLING)[0]
    asked = ", as asked for" if decision.forced else ""
    return f"sampling begins after {plan.settle_s:.9g} s{asked}: {reason_in_words(decision)}"


def remainder_in_words(remainder: Remainder) -> str:
    """What there is beside the tones, and what it is.

    Args:
        remainder: the most beside the tones.
    """
    what = {
        RemainderKind.UNEXPLAINED: f"most at {hertz(remainder.at_hz)}, which is no combination of "
        "the tones but a free oscillation that has not died away, or a drive that is not among "
        "the tones",
        RemainderKind.UNKNOWN: "harmonics, mixtures of the tones, or free oscillations, which are "
        "not told apart without a common period of the tones",
        RemainderKind.COMBINATION: f"most at {hertz(remainder.at_hz)}, a combination of the tones, "
        "as in a response that is not linear",
        RemainderKind.SMALL: "rounding, or the rest of a transient",
        RemainderKind.ROUNDING: "rounding",
    }[remainder.kind]
    return f"beside the tones there is {remainder.share:.1e} of the largest peak: {what}"


def difference_in_words(response: SweepResponse) -> str:
    """By how much the directions of a sweep differ.

    Args:
        response: of the FMU, both ways.
    """
    if response.difference is None:
        return "one way only: whether there is another branch would show in --direction both"
    said = "upward and downward sweep differ by at most "
    said += f"{response.difference:.1e} of the largest amplitude"
    return said + (": hysteresis" if response.jumps else "")


# -- choices ----------------------------------------------------------------------------------


def _settings(decision: Decision) -> str:
    def word(value: Scalar) -> str:
        return str(value).lower() if isinstance(value, bool) else str(value)

    return ", ".join(f"{name} = {word(value)}" for name, value in decision.settings.items())


def _time(decision: Decision) -> str:
    settle_s = float(decision.numbers["settle_s"])
    if settle_s == 0.0:
        return "none"
    factor, unit = prefixed(settle_s, "s")
    return f"{number(settle_s / factor, 4)} {unit}"


def _window(decision: Decision) -> str:
    n = decision.numbers
    lengths = [f"{float(n[key]):.4g}" for key in ("shortest_s", "longest_s")]
    return f"{' to '.join(dict.fromkeys(lengths))} s, {_span(n)} samples"


def _samples(decision: Decision) -> str:
    order = decision.numbers["order"]
    how = f"{_span(decision.numbers)} per run"
    if int(order) > 1:
        how += f", no combination of tones up to order {order} folded onto a tone"
    return how


def _span(numbers: Mapping[str, Scalar]) -> str:
    return " to ".join(dict.fromkeys(str(numbers[key]) for key in ("least", "most")))


def _curve(decision: Decision) -> str:
    n = decision.numbers
    among = f" of {n['curves']} curves" if int(n["curves"]) > 1 else ""
    if decision.taken:
        tones = int(n.get("tones", 1))  # results of earlier versions do not tell
        each = f" of up to {tones} tones" if tones > 1 else ""
        return f"{how_many(str(n['runs']), 'run')}{each} for {n['points']} points{among}"
    return f"a run for each of {n['points']} points{among}"


def _grid(decision: Decision) -> str:
    factor, unit = prefixed(float(decision.numbers["step_s"]), "s")
    whole = f"whole steps of {number(float(decision.numbers['step_s']) / factor, 6)} {unit}"
    offset = float(decision.numbers["offset"])
    return f"{whole}, and {number(offset, 2)} of one more" if offset else whole


def _step(decision: Decision) -> str:
    if "per_period" in decision.numbers:
        step_s, count = (float(decision.numbers[key]) for key in ("step_s", "per_period"))
        factor, unit = prefixed(step_s, "s")
        return f"{number(step_s / factor, 4)} {unit} at most, {number(count, 4)} in a period"
    shortest, longest = (float(decision.numbers[key]) for key in ("step_s", "longest_s"))
    factor, unit = prefixed(shortest, "s")
    count = int(decision.numbers["per_sample"])
    pair = ", extrapolated with a run of half as many"
    how = pair if "extrapolated" in decision.numbers else ""
    if longest > shortest:
        return f"{number(shortest / factor, 4)} {unit} and longer, up to {count} in a sample{how}"
    return f"{number(shortest / factor, 4)} {unit}, {count} in a sample{how}"


_CHOICES: Mapping[Kind, Callable[[Decision], str]] = {
    Kind.MODEL: _settings,
    Kind.SETTLING: _time,
    Kind.WINDOW: _window,
    Kind.SOLVER: lambda d: ", ".join(
        f"{name} = {float(value):.3g}" for name, value in d.settings.items()
    ),
    Kind.INPUT: lambda d: f"held over {d.numbers['steps_per_period']} steps per period",
    Kind.SAMPLES: _samples,
    Kind.ROUNDING: lambda d: "double precision",
    Kind.CURVE: _curve,
    Kind.STEP: _step,
    Kind.GRID: _grid,
    Kind.ACCURACY: lambda d: f"{float(d.numbers['given']):.1e} of an amplitude",
    Kind.MAXIMUM: lambda d: (
        f"{d.numbers['points']} points {float(d.numbers['spacing_hz']):.4g} Hz apart"
    ),
}


# -- reasons ----------------------------------------------------------------------------------


def _compared(decision: Decision) -> str:
    safety = f"{float(decision.numbers['safety']):g} times the change"
    if decision.kind == Kind.SOLVER:
        part = "a hundredth" if float(decision.numbers["part"]) < 0.1 else "half"
        return f"{safety} of the amplitudes at {part} of it"
    if decision.kind == Kind.INPUT:
        return f"{safety} with twice as many"
    if decision.kind == Kind.STEP:
        return f"the FMU integrates by it: {safety} from steps of twice that length"
    finer = decision.numbers["finer"]
    return f"{safety} with combinations up to order {finer} kept off"


def _coherent(decision: Decision) -> str:
    said = (
        f"{decision.subject}: whole periods of every tone, none folded onto another, onto 0 or "
        "onto half the rate: the fit of the tones is the Fourier bin, without leakage"
    ).removeprefix(": ")
    if decision.numbers.get("mixtures"):
        mixtures = decision.numbers["mixtures"]
        said += f", clear of the {mixtures} mixtures that a nonlinear response may have"
    return said


def _prescribed(decision: Decision) -> str:
    if decision.kind == Kind.SOLVER:
        return _compared(decision)
    return f"transient below {decision.bound:.1e}, against amplitudes that stand still"


def _less_damping(decision: Decision) -> str:
    factor, unit = prefixed(float(decision.numbers["seen_s"]), "s")
    return (
        f"{number(float(decision.numbers['seen_s']) / factor, 3)} {unit} were seen to do: "
        f"{_watched(decision)}; longer for less damping"
    )


def _watched(decision: Decision) -> str:
    return (
        f"transient below {decision.bound:.1e}, by watching the amplitudes while the time doubled"
    )


def _maximum(decision: Decision) -> str:
    centre = hertz(float(decision.numbers["centre_hz"]))
    if "bend" not in decision.numbers:
        return (
            f"the simulated maximum is interpolated around {centre} (1/A^2 as a polynomial of "
            "degree four); more points are added where its bias exceeds the bound"
        )
    bend, safety = (float(decision.numbers[key]) for key in ("bend", "safety"))
    return (
        f"a parabola through 1/A^2 around {centre}; its remainder is bounded by its third "
        f"derivative, {bend:.1e}/Hz of the second ({safety:g} times that at start and reference), "
        "and more points are added where that exceeds the bound"
    )


def _rational(decision: Decision) -> str:
    n = decision.numbers
    whole, planned = int(n["curves"]), int(n["interpolated"])
    rest = "" if planned == whole else f" for {planned} of {whole} curves, the rest point by point"
    return (
        f"half the drive gives half the response, and a rational function of degree {n['degree']} "
        f"goes through it{rest}; both are checked in every evaluation, at every point by "
        f"{n['safety']} times the change that leaving out a run makes; where that exceeds the "
        "bound runs are added"
    )


def _ordered(decision: Decision) -> str:
    n = decision.numbers
    return (
        f"the FMU integrates by it, and errors fall as its power {n['order']}, seen over three "
        f"steps: {float(n['safety']):g} times the error that this leaves"
    )


def _own_step(decision: Decision) -> str:
    told = "as it tells" if decision.numbers["told"] else "by watching its outputs stand still"
    return (
        f"the FMU's own step, {told}; at other times it repeats amplitudes and phases only to "
        f"{float(decision.numbers['repeats']):.1e}"
    )


def _usual(decision: Decision) -> str:
    usual = f"none was asked for, and the usual {float(decision.numbers['usual']):.0e}"
    if decision.numbers["by"] == Kind.STEP:
        return f"{usual} would take many more steps (--accuracy asks for it)"
    if decision.numbers["by"] == Kind.INPUT:
        return f"{usual} would want an input that is held over shorter steps"
    return f"{usual} is beyond this FMU"


def _other_steps(decision: Decision) -> str:
    told = (
        "the one that it was made for"
        if decision.numbers["told"]
        else "the shortest tried that it takes"
    )
    return f"the FMU refuses other steps; this is {told}"


def _halved(decision: Decision) -> str:
    own_s = float(decision.numbers["own_s"])
    said = (
        f"half of it changes a trace by {float(decision.numbers['change']):.1e} of its largest "
        f"value, in {decision.numbers['runs']} runs"
    )
    if own_s:
        said += f"; the FMU's own step of {own_s:.4g} s is longer than the sampling interval"
    if "stands_s" in decision.numbers:
        said += (
            f"; the FMU advances in steps of its own of {float(decision.numbers['stands_s']):.4g} "
            "s, which cannot be shortened from outside: what Euler's method would leave is taken "
            "for its error"
        )
    if "shifted" in decision.numbers:
        said += (
            ", with twice what it shifts an oscillation in time; where that is far from a sine, or "
            "its period depends on its size, it may be more"
        )
    if "few" in decision.numbers:
        few, of = (int(decision.numbers[key]) for key in ("few", "of"))
        said += f"; a free decay of {of} samples follows from {few} of them"
    return said


_REASONS: Mapping[Basis, Callable[[Decision], str]] = {
    Basis.STEADY: lambda d: (
        "the response is steady from the start: amplitudes do not change with time"
    ),
    Basis.WATCHED: _watched,
    Basis.UNSTEADY: lambda d: (
        "amplitudes still change by half as much when the time is doubled: not steady"
    ),
    Basis.REPEATED: lambda d: (
        f"this FMU repeats amplitudes and phases only to {float(d.numbers['repeats']):.1e}, "
        "however long it runs: at times a hundredth of a period apart they differ by that"
    ),
    Basis.OWN_STEP: _own_step,
    Basis.FIXED_STEP: lambda d: "the fixed step of the FMU's solver, as it declares",
    Basis.OTHER_STEPS: _other_steps,
    Basis.USUAL: _usual,
    Basis.ORDER: _ordered,
    Basis.PRESCRIBED: _prescribed,
    Basis.DECLARED: lambda d: "the FMU is declared to start on its periodic orbit",
    Basis.LINE_WIDTH: lambda d: (
        f"exp(-pi w t) falls below {d.bound:.1g} for half the line width of "
        f"{float(d.numbers['width_hz']):.6g} Hz"
    ),
    Basis.LESS_DAMPING: _less_damping,
    Basis.COHERENT: _coherent,
    Basis.FITTED: lambda d: (
        "tones without a common period of reasonable length are fitted, which leaves no leakage "
        "either"
    ),
    Basis.COMPARED: _compared,
    Basis.HALVED: _halved,
    Basis.DOUBLE: lambda d: "samples of the weakest tone beside the strongest value",
    Basis.POLYNOMIAL: _maximum,
    Basis.RATIONAL: _rational,
    Basis.NONLINEAR: lambda d: (
        f"not interpolated: half the drive does not give half the response (off by "
        f"{float(d.numbers['found']):.1e}, wanted {float(d.numbers['wanted']):.1e})"
    ),
    Basis.IRREGULAR: lambda d: (
        f"not interpolated: rational functions through up to {d.numbers['tried']} runs are "
        f"uncertain by {float(d.numbers['found']):.1e}, wanted {float(d.numbers['wanted']):.1e}"
    ),
}


def _model_reason(decision: Decision) -> str:
    """Why a reduction is taken or not: its bound, what is left for it, what it saves."""
    n = decision.numbers
    if decision.basis == Basis.FORBIDDEN:
        return "not taken: forbidden"
    if decision.basis == Basis.REFUSED:
        return f"not taken: the FMU refuses ({n['message']})"
    saved = f"a run takes {number(float(n['work']), 2)} of the work" if "work" in n else ""
    if not decision.taken and saved:
        return f"not taken: no cheaper ({saved})"
    how, left = _how(decision), float(n["left"])
    fits = decision.bound <= left
    if decision.forced:
        return how if fits else f"{how}, beyond the {left:.1e} that is left for it"
    if not saved:
        return f"not taken: {how}, and {left:.1e} is left for it"
    if fits:
        return f"{how}; {saved}"
    return f"{how}, more than is left for it, but a run without it would take too long"


def _how(decision: Decision) -> str:
    n = decision.numbers
    if decision.basis == Basis.UNMEASURED:
        return "its error cannot be measured, a run without it would take too long"
    if decision.basis == Basis.STATED:
        return f"by the FMU's {n['outputs']}"
    safety = f"{float(n['safety']):g} times the"
    if decision.basis == Basis.COMPARED:
        return f"{safety} change"
    return (
        f"measured: {safety} {float(n['difference']):.1e} by which it differs from the full model "
        f"with {n['substep']} = {float(n['step']):.3g} and that one's own {float(n['own']):.1e} "
        f"(by halving); by the FMU's {n['outputs']} it would be {float(n['stated']):.1e}"
    )
