"""The stages in which it is found what the data determine, in their order."""

from __future__ import annotations

from enum import StrEnum


class Stage(StrEnum):
    """What is being looked for; the words say so."""

    MINIMA = "other minima"
    WALKS = "scans"
    BEYOND = "beyond the bounds"
    DIRECTIONS = "what has no effect"
    REFITS = "refits of the bootstrap"
