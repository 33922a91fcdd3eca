"""How far data determine a value: the words for it, each decided in one place (`verdicts`).

A verdict measures the data. It follows from where chi square ends the 95 % interval of a value, not
from the box in which the fit was looked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

from fitting.text.notation import listed


class Verdict(StrEnum):
    """What data say of one value."""

    #: Both ends of the interval are cut by the data, and it is narrow for such a value.
    DETERMINED = "determined"
    #: Both ends are cut by the data, but they are far apart.
    BOUNDED = "bounded on both sides"
    #: The data cut the upper end alone.
    ABOVE = "bounded above"
    #: The data cut the lower end alone.
    BELOW = "bounded below"
    #: Separate values fit as well: an exchange, another minimum.
    SEVERAL = "one of several values"
    #: The data cut neither end.
    OPEN = "not determined"
    #: The search was cut or lost, or there is nothing to check the model by.
    UNKNOWN = "not known"
    #: The model does not describe the data.
    WITHDRAWN = "no verdict"
    #: No profile was walked: the errors are those of the problem linearised at its solution.
    LINEARISED = "linearised only"

    @property
    def has_value(self) -> bool:
        """Whether there is a value to report; else there is a range at most."""
        return self in (Verdict.DETERMINED, Verdict.BOUNDED, Verdict.SEVERAL, Verdict.LINEARISED)

    @property
    def is_open(self) -> bool:
        """Whether the data leave a value open on at least one side, or nothing is known of it."""
        return not self.has_value


def in_boxes(names: Sequence[str]) -> str:
    """What a verdict holds under: " in the boxes of d1 and d2"; empty where it rests on no box.

    Args:
        names: of the parameters beyond whose boxes the data may say otherwise.
    """
    if not names:
        return ""
    return f" in the {'box' if len(names) == 1 else 'boxes'} of {listed(names)}"
