"""What a campaign needs to know about a variable of an FMU, of whatever version it is."""

from __future__ import annotations

from fitting.fmu.description import FmuVariable as VariableLike

#: Causalities whose value an importer may set, for any FMI version.
SETTABLE = ("parameter", "structuralParameter", "input", "local")
READABLE = ("output", "local", "calculatedParameter")
#: What a report may show beside parameters that are fitted: laws may set others.
REPORTABLE = (*READABLE, "parameter")

__all__ = ["READABLE", "REPORTABLE", "SETTABLE", "VariableLike"]
