"""What settings are worth: the Pareto front of error over cost, the cheapest for an accuracy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from fitting.lab.names import QUANTITIES
from fitting.lab.tradeoff.records import Measurement, Study


@dataclass(frozen=True, kw_only=True)
class Choice:
    """For one accuracy: the cheapest setting found, the plan's, and the ratio of their costs.

    None where no setting reaches the accuracy or the plan was not asked.
    """

    quantity: str
    accuracy: float
    cheapest: Measurement | None
    planned: Measurement | None

    @property
    def ratio(self) -> float | None:
        """Cost of the plan over that of the cheapest setting."""
        if self.cheapest is None or self.planned is None:
            return None
        return self.planned.cost_s / self.cheapest.cost_s

    @property
    def kept(self) -> bool | None:
        """Whether the plan's setting has the accuracy; None without a plan.

        None as well where the reference's own error is larger: then nobody can tell.
        """
        if self.planned is None:
            return None
        good = self.planned.error <= self.accuracy
        return None if self.planned.bounded and not good else good


def pareto(measurements: Sequence[Measurement]) -> list[Measurement]:
    """Those that nobody beats in one of error and cost without losing in the other, by cost.

    Of equals the first stays. Failed settings (infinite error) have no place.

    Args:
        measurements: of error and cost, one per setting.
    """
    front: list[Measurement] = []
    best = math.inf
    for found in sorted(measurements, key=lambda m: (m.cost_s, m.error)):
        if found.error < best:
            front.append(found)
            best = found.error
    return front


def cheapest(measurements: Sequence[Measurement], accuracy: float) -> Measurement | None:
    """The cheapest setting whose error is at most the accuracy, None if there is none.

    Args:
        measurements: of error and cost, one per setting.
        accuracy: relative error that is wanted.
    """
    good = [m for m in measurements if m.error <= accuracy]
    return min(good, key=lambda m: m.cost_s, default=None)


def choices(study: Study) -> list[Choice]:
    """For every quantity and accuracy: the cheapest setting and the plan's.

    Args:
        study: errors and costs of every setting.
    """
    found = []
    for quantity in QUANTITIES:
        grid, planned = study.of(quantity), study.of(quantity, planned=True)
        if not grid:
            continue
        marks = {m.planned_for: m for m in planned}
        found += [
            # the plan's own settings are settings, too
            Choice(
                quantity=quantity,
                accuracy=wanted,
                cheapest=cheapest([*grid, *planned], wanted),
                planned=marks.get(wanted),
            )
            for wanted in study.accuracies
        ]
    return found
