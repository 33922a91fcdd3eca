"""What a plan decided, in sentences of the template `text/templates/plan.txt.j2`."""

from __future__ import annotations

from fitting.signal.window import LONGEST_PERIODS, Window
from fitting.simulate.budget import Budget, Decision, Kind, PlanRecord
from fitting.simulate.frf import SweepResponse
from fitting.simulate.planner import DrivePlan
from fitting.simulate.response import Remainder, Spectrum
from fitting.text.rendering import blocks


def decision_in_words(decision: Decision) -> str:
    """One decision as a line: subject, choice, reason, bound.

    Args:
        decision: of the plan.
    """
    return str(blocks("plan").decision(decision))


def sum_in_words(budget: Budget | PlanRecord, of: str = "themselves") -> str:
    """The sum of the bounds, and the accuracy that was requested.

    Args:
        budget: what the decisions of a plan promise together.
        of: what errors are relative to.
    """
    return str(blocks("plan").total(budget, of))


def warnings_in_words(budget: Budget) -> tuple[str, ...]:
    """An accuracy that cannot be promised, and reductions that are forced beyond their bound.

    Args:
        budget: what the decisions of a plan promise together.
    """
    missed = () if budget.kept else (str(blocks("plan").missed(budget)),)
    forced = (d for d in budget.decisions if d.taken and d.forced and d.bound > budget.wanted)
    return (*missed, *(str(blocks("plan").forced(d, budget)) for d in forced))


def window_in_words(window: Window) -> str:
    """Why a window is suitable: whole periods without aliases, or the condition of a tone fit.

    Args:
        window: settling and samples of a run.
    """
    return str(blocks("plan").window(window))


def spectrum_in_words(spectrum: Spectrum) -> str:
    """How a spectrum was taken, and what proves that its tones are separate.

    Args:
        spectrum: of the response.
    """
    return str(blocks("plan").spectrum(spectrum, LONGEST_PERIODS))


def settling_in_words(plan: DrivePlan) -> str:
    """When sampling starts, and why then.

    Args:
        plan: settings, settling and windows, with what they promise.
    """
    return str(blocks("plan").settling(plan, plan.budget.of(Kind.SETTLING)[0]))


def remainder_in_words(remainder: Remainder) -> str:
    """What there is apart from the tones, and what it is.

    Args:
        remainder: the largest line apart from the tones.
    """
    return str(blocks("plan").remainder(remainder))


def difference_in_words(response: SweepResponse) -> str:
    """By how much the directions of a sweep differ.

    Args:
        response: of the FMU, both ways.
    """
    return str(blocks("plan").difference(response))
