"""The variables of the shipped FMUs, from the modelDescription.xml of each."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import build_fmu
from docs.site.markdown import code, escaped
from fitting.fmu.description import FmuDescription, FmuVariable, read_description

MODELS = ("CoupledOscillator", "DuffingOscillator", "CoupledModes2")
TITLES = {"parameter": "Parameters", "input": "Inputs", "output": "Outputs"}
INTRODUCTION = """\
# FMU variables

What the models of this project declare in their `modelDescription.xml`, with unit, start value and
range; an FMU with other numbers of modes (`python build_fmu.py --model CoupledModes --modes 3`) has
the variables of `CoupledModes2` for each mode and pair. What several variables mean alike is
described of the first one. [The model](../explanation/model.md) has the equations."""
#: Words of a description that is repeated.
SHORT = 10
#: What differs between variables that mean alike: numbers, and the signs of two modes.
DIFFERENT = re.compile(r"readout(?!\d)|q\d+_hybrid|q\d+|\d+|plus|minus")


def page() -> str:
    """The page: parameters, inputs and outputs of each model."""
    parts, described, forms = [INTRODUCTION], dict[str, str](), dict[str, str]()
    with tempfile.TemporaryDirectory() as folder:
        for name in MODELS:
            model = read_description(build_fmu.build(name, Path(folder)))
            parts += [f"## {name}", escaped(model.description), *_lists(model, described, forms)]
    return "\n\n".join(parts)


def _lists(
    model: FmuDescription, described: dict[str, str], forms: dict[str, str]
) -> Iterator[str]:
    """Variables by causality; of those that an earlier model describes the names alone.

    Args:
        model: whose variables.
        described: facts and descriptions by name, of earlier models; is added to.
        forms: the first variable of each description but for numbers and modes; is added to.
    """
    earlier = dict(described)
    for causality, title in TITLES.items():
        alike = dict[tuple[str, str], list[FmuVariable]]()
        names = []
        for variable in model.variables.values():
            if variable.causality != causality:
                continue
            text = f"{_facts([variable])}{variable.description}"
            if earlier.get(variable.name) == text:
                names.append(code(variable.name))
                continue
            described[variable.name] = text
            form = (DIFFERENT.sub("#", variable.name), DIFFERENT.sub("#", variable.description))
            alike.setdefault(form, []).append(variable)
        lines = []
        for (_, words), group in alike.items():
            first = forms.setdefault(words, group[0].name)
            text = escaped(group[0].description)
            if first != group[0].name and len(text.split()) > SHORT:
                text = f"as {code(first)}"
            lines.append(f"- {', '.join(code(v.name) for v in group)}{_facts(group)}: {text}")
        lines += [f"- {', '.join(names)}: as above"] if names else []
        if lines:
            yield f"{title}:"
            yield "\n".join(lines)


def _facts(group: Sequence[FmuVariable]) -> str:
    """Unit, start values and range of variables that mean alike, in brackets."""
    first = group[0]
    values = [variable.start for variable in group]
    starts = dict.fromkeys(
        f"{value:.12g}" if isinstance(value, float) else str(value).lower() for value in values
    )
    least, most = first.min, first.max
    if most is not None:
        extent = f"{least:g} to {most:g}"
    else:
        extent = "" if least is None else f"from {least:g}"
    facts = [
        "" if first.kind == "Real" else first.kind,
        first.unit or "",
        "" if first.causality == "output" else f"= {' and '.join(starts)}",
        extent,
    ]
    return f" ({', '.join(fact for fact in facts if fact)})" if any(facts) else ""
