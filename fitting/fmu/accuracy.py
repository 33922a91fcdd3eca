"""The accuracy annotation of an FMU: how it is told to be accurate, and what may be left out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field, replace

from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.keys import Keys, Text, Texts


@dataclass(frozen=True)
class Reduction:
    """Start values under which the FMU computes less than it could.

    `bound` names an FMU output that bounds the relative error, "{output}" in it standing for the
    output that is read; without it the error is measured. `cost` is the part
    of a run's work that is left by it, by the FMU's own statement, at equal steps.

    Raises:
        BadInput: no name, nothing that is set, or a cost that is not positive.
    """

    name: str
    set: Mapping[str, Scalar]
    _: KW_ONLY
    bound: str | None = None
    cost: float = 0.5

    def __post_init__(self) -> None:
        if not (self.name and self.set):
            raise BadInput(f"reduction {self.name!r}: wanted a name and values to set")
        if not 0.0 < self.cost < math.inf:
            raise BadInput(
                f"reduction {self.name!r}: its cost is {self.cost!r}, wanted a positive number"
            )


@dataclass(frozen=True, kw_only=True)
class AccuracyNames(Keys):
    """Parameters of an FMU that set its accuracy, and reductions by their names."""

    tolerance: Text | None = None
    """FMU parameter that bounds its solver's relative error."""
    substep: Text | None = None
    """FMU parameter: longest substep, s."""
    force: Texts = ()
    """Names of reductions to take, whatever they cost."""
    forbid: Texts = ()
    """Names of reductions not to take."""


@dataclass(frozen=True, kw_only=True)
class AccuracyAnnotation(AccuracyNames):
    """What is known of an FMU: how it is told to be accurate, and what makes it cheaper.

    `tolerance` and `substep` name the parameters that bound its solver's relative error and its
    substep (s); `full` are start values of the model with nothing left out; `force` and `forbid`
    name reductions.

    Raises:
        BadInput: a name in `force` or `forbid` that is none of the reductions (where there are
            any: an FMU may have its own), or is in both.
    """

    full: Mapping[str, Scalar] = field(default_factory=dict)
    reductions: tuple[Reduction, ...] = ()

    def __post_init__(self) -> None:
        names = [r.name for r in self.reductions]
        if len(set(names)) < len(names):
            raise BadInput(f"reductions {', '.join(names)}: two have one name")
        if self.reductions:
            self.check_names()
        both = sorted(set(self.force) & set(self.forbid))
        if both:
            raise BadInput(f"'{both[0]}' is both in force and in forbid")

    def check_names(self) -> None:
        """BadInput for a name in `force` or `forbid` that is none of the reductions."""
        names = [r.name for r in self.reductions]
        for key, wanted in (("force", self.force), ("forbid", self.forbid)):
            for name in wanted:
                if name not in names:
                    known = ", ".join(names) or "none"
                    raise BadInput(f"{key}: no reduction '{name}', wanted one of: {known}")

    def over(self, own: AccuracyAnnotation) -> AccuracyAnnotation:
        """What is said here, and by an FMU's `own` annotation where nothing is.

        Raises:
            BadInput: `force` or `forbid` name none of the reductions.
        """
        merged = replace(
            self,
            tolerance=self.tolerance or own.tolerance,
            substep=self.substep or own.substep,
            full=self.full or own.full,
            reductions=self.reductions or own.reductions,
        )
        merged.check_names()
        return merged
