"""What a design promises, in words."""

from __future__ import annotations

import math

from fitting.design.result import Design
from fitting.text.notation import number, plain, prefixed, span


def promise_sentence(design: Design) -> str:
    """How much better the target will be known.

    Args:
        design: the proposed next measurement.
    """
    return (
        f"With them the standard deviation of {plain(design.target)} is expected to be "
        f"{number(design.improvement, 3)} times smaller on average."
    )


def candidates_sentence(design: Design) -> str:
    """What was chosen from, and how.

    Args:
        design: the proposed next measurement.
    """
    return (
        f"{design.candidates} candidates ({design.setups} settings of drive and output, and "
        "numbers of spectra; those whose peaks could not be seen or would overload the detector "
        f"left out), chosen by criterion {design.criterion}, greedy with exchanges."
    )


def equal_fits_sentences(design: Design) -> tuple[str, ...]:
    """At how many points the data are fitted as well, and how far the target goes over them.

    Args:
        design: the proposed next measurement.
    """
    said = [f"The data so far are fitted as well at {design.equal_fits} points that were found."]
    if all(map(math.isfinite, design.span)):
        low, high = design.span
        size, shown = prefixed(max(abs(low), abs(high)), design.unit)
        said.append(
            f"Over them {plain(design.target)} goes from {span(low / size, high / size, shown)}."
        )
    return tuple(said)
