"""What a job is expected to cost, in lines."""

from __future__ import annotations

import math

from fitting.inference.cost import Expected, Range
from fitting.text.notation import how_many

#: Times up to so many seconds are told in a unit of so many.
UNITS = ((120.0, "s", 1.0), (7200.0, "min", 60.0), (math.inf, "h", 3600.0))


def cost_lines(seconds: Range, runs: Range, expected: Expected) -> list[str]:
    """What a job takes, and what that rests on: the sum first.

    Args:
        seconds: least and most, s.
        runs: of the FMU, least and most.
        expected: evaluations of its parts.
    """
    e = expected
    lines = [
        f"expected: {time_words(seconds)}, {_count(runs)} runs of the FMU, "
        f"{_count(e.evaluations)} evaluations of the model",
        f"search: {_count(e.search)} evaluations: {e.levels} levels of ν"
        + (f" and {e.starts} starts" if e.starts > 1 else "")
        + f" for {how_many(e.alternatives, 'alternative')}; a Jacobian takes 2 n + 1 = "
        f"{e.jacobian} for {how_many(e.parameters, 'parameter')}",
    ]
    if e.profiled:
        lines.append(f"profiles: {_count(e.profiles)} evaluations, for {e.profiled} values")
    if e.refits:
        lines.append(f"bootstrap: {_count(e.bootstrap)} evaluations, for {e.refits} refits")
    return lines


def measured_lines(
    planning: tuple[int, float], each: tuple[float, float], workers: int, memory_bytes: float
) -> list[str]:
    """What was measured for it.

    Args:
        planning: runs and seconds of the plan.
        each: runs and seconds of an evaluation.
        workers: processes.
        memory_bytes: that all processes held at most, NaN where it is not known.
    """
    lines = [
        f"measured: the plan took {planning[0]} runs in {planning[1]:.2g} s; an evaluation "
        f"{each[0]:.3g} runs in {1e3 * each[1]:.3g} ms with {how_many(workers, 'worker')}"
    ]
    if math.isfinite(memory_bytes):
        lines.append(
            f"memory: {memory_bytes / 1e6:.0f} MB until here, all processes together; a fit takes "
            "more, up to three times as much of one long record, several times as much of many"
        )
    return [
        *lines,
        "how it grows: evaluations go with 2 n + 1, n the number of parameters, and the runs of "
        "an evaluation with the number of experiments; points that differ by what one experiment "
        "has of its own share the runs of the others",
        "why a range: how many iterations a level and how many steps a profile takes depends on "
        "the data; the ranges are those seen on the shipped campaigns that the model describes, "
        "others take up to twice as long. Figures and report take some seconds besides.",
    ]


def time_words(seconds: Range) -> str:
    """A range of times in the unit that suits it.

    Args:
        seconds: least and most, s.
    """
    low, high = seconds
    unit, size = next((unit, size) for limit, unit, size in UNITS if high < limit)
    return f"{_two(low / size)} to {_two(high / size)} {unit}"


def _count(range_: Range) -> str:
    return f"{_two(range_[0])} to {_two(range_[1])}"


def _two(value: float) -> str:
    """Two digits, without an exponent."""
    if value <= 0.0:
        return "0"
    place = 1 - math.floor(math.log10(value))
    return f"{round(value, place):,.{max(0, place)}f}"
