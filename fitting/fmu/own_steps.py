"""The steps that an FMU was made for, as its description tells them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class OwnSteps:
    """Steps that an FMU tells of itself, in s.

    ``internal_s`` is the fixed step of its own solver (``fixedInternalStepSize`` of FMI 3.0), of
    which communication steps have to be whole multiples; ``usual_s`` that of its default
    experiment; None where it tells none. ``of_any_length``: it says that communication steps may
    differ in length.
    """

    internal_s: float | None = None
    usual_s: float | None = None
    of_any_length: bool = True

    @property
    def step_s(self) -> float | None:
        """The step that it was made for: of its own solver, else of its default experiment."""
        return self.usual_s if self.internal_s is None else self.internal_s

    def aligned(self, step_s: float) -> float:
        """The whole multiple of the own step, once at least, that is nearest to a step.

        Args:
            step_s: a communication step, s; it is what comes back where the FMU tells no step.
        """
        own_s = self.step_s
        return step_s if own_s is None else own_s * max(1, round(step_s / own_s))
