"""Knowledge of an FMU before it is run: what it declares, and how accurate it is told to be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from fitting.fmu import FmuDescription, read_accuracy_annotation
from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.fmu.variables import VariableLike
from fitting.simulate.batch import Workers


class FmuLike(Workers, Protocol):
    """What is needed of `fitting.fmu.FmuWorkers`: runs, and what the FMU says of itself."""

    @property
    def description(self) -> FmuDescription:
        """What the FMU declares."""
        ...


@dataclass(frozen=True)
class Knowledge:
    """What is known of an FMU: how it is told to be accurate, and its variables by name.

    `step_s` is the step that it was made for (None: it tells none), and `fixed_step` whether its
    solver takes no other; `exchange`: its equations are integrated here, and an input is no
    staircase.
    """

    annotation: AccuracyAnnotation = field(default_factory=AccuracyAnnotation)
    variables: Mapping[str, VariableLike] = field(default_factory=dict)
    step_s: float | None = None
    fixed_step: bool = False
    exchange: bool = False


def knowledge_of(
    description: FmuDescription, annotation: AccuracyAnnotation | None = None
) -> Knowledge:
    """What an FMU says of itself, where `annotation` does not say otherwise.

    Args:
        description: of the FMU.
        annotation: what the FMU says of its own accuracy.

    Raises:
        BadInput: annotation that name variables which the FMU does not have.
    """
    merged = (annotation or AccuracyAnnotation()).over(read_accuracy_annotation(description))
    names = [name for name in (merged.tolerance, merged.substep) if name is not None]
    names += [*merged.full, *(name for r in merged.reductions for name in r.set)]
    for name in names:
        description.variable(name)
    return Knowledge(
        merged,
        description.settable,
        step_s=description.step_s,
        fixed_step=description.fixed_step,
        exchange=description.exchange is not None,
    )
