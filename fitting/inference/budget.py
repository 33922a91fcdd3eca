"""How much an inference may cost where nobody says; known before any library is loaded."""

from __future__ import annotations

#: Simulation runs at most; runs that points of a batch share count once.
BUDGET = 500_000
