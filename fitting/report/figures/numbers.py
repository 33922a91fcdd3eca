"""Numbers of figures: the same on the page and before the names of their files.

They follow the order of the page and depend on the campaign alone, not on how its fit went: what a
fit may or may not have to show keeps its number, so that a figure has one number in every fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

from fitting.report.figures.style import Drawing, Planned
from fitting.result.result import Result

PROFILES, TOGETHER, OUTPUTS, NU = "profiles", "together", "outputs", "nu"
DRIVE, SPECTRA, RESPONSE = "drive", "spectra", "frequency_response"
OVER_FREQUENCY, IMPROVEMENT = "deviation_over_frequency", "improvement"
PER_EXPERIMENT, CONVERGENCE, DERIVED = (
    "deviation_per_experiment",
    "convergence",
    "derived_per_experiment",
)
#: Before and after figures that no list names: those of other kinds of measurements.
FIRST = (PROFILES, TOGETHER, OUTPUTS, DRIVE, SPECTRA, "phases", RESPONSE)
LAST = (OVER_FREQUENCY, IMPROVEMENT, PER_EXPERIMENT, CONVERGENCE, NU, DERIVED)
#: Of several figures of measurements these show least at once: any other goes first.
SELDOM_LEADING = (SPECTRA, "phases")

Known = TypeVar("Known", Drawing, Planned)


def numbered(drawings: Sequence[Known], result: Result, shown: Sequence[str]) -> list[Known]:
    """The figures of a reconstruction in the order of the page, with their numbers.

    Args:
        drawings: all figures that there is something for, drawn or not.
        result: of a reconstruction.
        shown: names of the figures of its measurements, of which one leads.
    """
    lead = _lead(drawings, shown)
    ordered: list[Known] = [drawing for drawing in drawings if drawing is not lead]
    ordered.sort(key=lambda drawing: _place(drawing.name))
    if lead is not None:
        ordered.insert(0, lead)
    missing = _reserved(result) - {d.name for d in drawings}
    count = len(ordered) + len(missing)
    numbers, digits = iter(range(1, 1 + count)), len(str(count))
    found: list[Known] = []
    for drawing in ordered:
        if drawing is not lead:
            for name in [m for m in missing if _place(m) < _place(drawing.name)]:
                missing.remove(name)
                next(numbers)
        found.append(replace(drawing, number=next(numbers), digits=digits))
    return found


def of_identification(planned: Sequence[Planned]) -> list[Planned]:
    """The figures of what data determine, each with the number of its kind.

    Args:
        planned: all figures that there is something for.
    """
    order = (PROFILES, TOGETHER, OUTPUTS, NU)
    return [replace(figure, number=1 + order.index(figure.name)) for figure in planned]


def _place(name: str) -> int:
    if name in LAST:
        return len(FIRST) + 1 + LAST.index(name)
    return FIRST.index(name) if name in FIRST else len(FIRST)


def _lead(drawings: Sequence[Known], shown: Sequence[str]) -> Known | None:
    """What shows data, fit and residual at once: of sweeps, maps, traces, else of spectra."""
    own = [drawing for drawing in drawings if drawing.name in shown]
    own.sort(key=lambda drawing: drawing.name in SELDOM_LEADING)
    own += [drawing for drawing in drawings if drawing.name == PER_EXPERIMENT]
    return next(iter(own), None)


def _reserved(result: Result) -> set[str]:
    """Figures that a fit of this campaign may have, and another may not."""
    reserved = {PROFILES, CONVERGENCE, NU}
    if len(result.parameters) > 1:
        reserved.add(TOGETHER)
    if result.parameters and result.derived:
        reserved.add(OUTPUTS)
    return reserved
