"""What a calibration hands on, and what it leaves, in lines."""

from __future__ import annotations

import math

from fitting.result.calibration import Calibration, Handed
from fitting.text.error_bars import EVEN
from fitting.text.estimate import Verdict
from fitting.text.notation import listed, number, settings_words, span


def calibration_lines(found: Calibration) -> list[str]:
    """What is handed on and what is not, the answer first.

    Args:
        found: what is handed on.
    """
    sure = [p for p in found.handed if p.status is Verdict.DETERMINED]
    asked = [p for p in found.handed if p.status is not Verdict.DETERMINED]
    left = [p for p in found.parameters if p.left]
    lines = [
        f"handed on: {_listed(sure)}"
        if sure
        else "handed on: no parameter, because the data determine none; --all hands on the best fit"
    ]
    if asked:
        lines.append(f"handed on as asked, though not called determined: {_listed(asked)}")
    if found.campaign_values:
        lines.append(f"with the campaign's own: {settings_words(found.campaign_values)}")
    if found.settings:
        lines.append(f"with the alternative that fits best: {settings_words(found.settings)}")
    if left:
        lines.append(f"left at the start value of the FMU: {_listed(left)}")
    if found.open_settings:
        lines.append(
            f"left as the FMU has it: {listed(found.open_settings)}, of which the data do not "
            "tell the alternatives apart"
        )
    return lines


def _listed(parameters: list[Handed]) -> str:
    return "; ".join(f"{p.name} {_known(p)}" for p in parameters)


def _known(p: Handed) -> str:
    """A value with its error; where the data leave it open, the range and the verdict."""
    if p.status is Verdict.DETERMINED:
        bars = p.bars if p.is_most_likely else EVEN  # errors are the likelihood's
        return f"= {bars.words(p.value, p.std, p.unit, p.ci95)}"
    low, high = p.ci95
    reason = p.left or str(p.status)
    if math.isnan(low) or math.isnan(high):
        return f"({reason})"
    value = "" if p.left else f"= {number(p.value, 9)}, "
    return f"({value}{reason}: {span(low, high, p.unit)})"
