"""Settings and values in words."""

from __future__ import annotations

import math
from collections.abc import Mapping

from fitting.fit.result import DerivedResult
from fitting.text.arrays import Scalar
from fitting.text.notation import number, prefixed, span


def settings_words(settings: Mapping[str, Scalar]) -> str:
    """Settings as "name = value, ..."."""
    return ", ".join(f"{name} = {scalar_words(value)}" for name, value in settings.items())


def scalar_words(value: Scalar) -> str:
    """A setting as a campaign file writes it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return number(value, 12) if isinstance(value, float) else str(value)


def box_words(derived: DerivedResult) -> str:
    """What a derived output could be without data: "63 to 781 kHz"."""
    low, high = derived.box
    if not (math.isfinite(low) and math.isfinite(high)):
        return "any value to any other"
    factor, unit = prefixed(max(abs(low), abs(high)), derived.unit)
    return span(low / factor, high / factor, unit)
