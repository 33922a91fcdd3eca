"""Few of many places: those that stand for all values of a control where not all are needed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fitting.text.arrays import BoolArray, Scalar

#: Places that stand for all, of twice as many or more.
FEW = 6


def few_of(places: Sequence[Mapping[str, Scalar]]) -> BoolArray | None:
    """Which places stand for all, (k,): the outermost ones and others evenly between.

    Args:
        places: settings of every place, by name.
    """
    if len(places) < 2 * FEW:
        return None
    order = sorted(range(len(places)), key=lambda k: _in_order(places[k]))
    kept = np.zeros(len(places), dtype=bool)
    kept[[order[k] for k in evenly(len(order), FEW)]] = True
    return kept


def evenly(count: int, most: int) -> list[int]:
    """So many numbers below `count`, all if there are fewer, from the first to the last.

    Args:
        count: how many there are.
        most: how many are kept, evenly between.
    """
    return [round(k) for k in np.linspace(0, count - 1, min(count, most))]


def _in_order(settings: Mapping[str, Scalar]) -> tuple[tuple[bool, float, str], ...]:
    """By which a place stands beside those of like controls."""
    return tuple(
        (True, 0.0, value) if isinstance(value, str) else (False, float(value), "")
        for value in settings.values()
    )
