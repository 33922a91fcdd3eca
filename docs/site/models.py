"""The variables of the shipped FMUs, from the modelDescription.xml of each."""

from __future__ import annotations

import tempfile
from pathlib import Path

import build_fmu
from docs.site.markdown import code, escaped, table
from fitting.fmu.description import FmuDescription, FmuVariable, read_description

#: Columns; an output has neither start value nor range.
HEAD: tuple[str, ...] = ("variable", "meaning", "unit", "start", "range")
MODELS = ("CoupledOscillator", "DuffingOscillator", "CoupledModes2")
INTRODUCTION = """\
# FMU variables

What the models of this project declare in their `modelDescription.xml`; an FMU with other
numbers of modes (`python build_fmu.py --model CoupledModes --modes 3`) has the variables of
`CoupledModes2` for each mode and pair. [The model](../explanation/model.md) has the equations."""


def page() -> str:
    """The page: parameters, inputs and outputs of each model."""
    parts = [INTRODUCTION]
    with tempfile.TemporaryDirectory() as folder:
        for name in MODELS:
            described = read_description(build_fmu.build(name, Path(folder)))
            parts += [f"## {name}", escaped(described.description), *_tables(described)]
    return "\n\n".join(parts)


def _tables(described: FmuDescription) -> list[str]:
    parts = []
    for causality, title in (
        ("parameter", "Parameters"),
        ("input", "Inputs"),
        ("output", "Outputs"),
    ):
        chosen = [v for v in described.variables.values() if v.causality == causality]
        if chosen:
            head = HEAD[:3] if causality == "output" else HEAD
            rows = [_row(variable)[: len(head)] for variable in chosen]
            parts += [f"### {title} of {described.model_name}", table(head, rows)]
    return parts


def _row(variable: FmuVariable) -> tuple[str, ...]:
    if variable.min is None and variable.max is None:
        room = ""
    elif variable.max is None:
        room = f"from {variable.min:g}"
    elif variable.min is None:
        room = f"to {variable.max:g}"
    else:
        room = f"{variable.min:g} to {variable.max:g}"
    start = variable.start
    shown = (
        str(start).lower()
        if isinstance(start, bool)
        else f"{start:.12g}"
        if isinstance(start, float)
        else str(start if start is not None else "")
    )
    kind = "" if variable.kind == "Real" else f" ({variable.kind})"
    return (code(variable.name), variable.description + kind, variable.unit or "", shown, room)
