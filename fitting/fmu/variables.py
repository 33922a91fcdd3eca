"""What a campaign needs to know about a variable of an FMU, of whatever version it is."""

from __future__ import annotations

from typing import Protocol

#: Causalities whose value an importer may set, for any FMI version.
SETTABLE = ("parameter", "structuralParameter", "input", "local")
READABLE = ("output", "local", "calculatedParameter")
#: What a report may show beside parameters that are fitted: laws may set others.
REPORTABLE = (*READABLE, "parameter")


class VariableLike(Protocol):
    """A variable as its modelDescription declares it."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def kind(self) -> str:
        """Real, Integer, Boolean or String; Real stands for the floats of FMI 3.0 too."""

    @property
    def unit(self) -> str | None:
        """Its unit, None if the FMU declares none."""

    @property
    def causality(self) -> str:
        """Its causality, in the words of FMI."""

    @property
    def min(self) -> float | None:
        """Least allowed value."""

    @property
    def max(self) -> float | None:
        """Largest allowed value."""
