"""May an instance be reset and used again? Found out by comparison, not taken from the FMU's word.

The first run of a layout has a new instance. When a run comes that differs from it in a value that
no comparison has varied yet, both are repeated: the new run after a reset, the first one after
another reset, and the new one once more on a new instance. Bit for bit the same, twice: from now on
this value may vary between resets. Else every run gets a new instance, for good.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from fitting.fmu.log import CallFailed
from fitting.fmu.orders import Layout, Order
from fitting.text.arrays import FloatArray

Place = tuple[int, int] | str  # a value of an order: (group, position), or the input's tones

UNDECIDED = "no comparison of a reset instance with a new one was needed"
REUSED = "instances are reset and reused: runs repeated after a reset were the same bit for bit"


@dataclass
class Trial:
    """What has been compared for one layout."""

    order: Order
    result: FloatArray
    varied: set[Place] = field(default_factory=set)
    pending: tuple[Order, FloatArray] | None = None


@dataclass
class Verdict:
    """Whether instances are reused (None: undecided), and why; outlives the worker process."""

    reused: bool | None = None
    note: str = UNDECIDED
    trials: dict[int, Trial] = field(default_factory=dict)

    def refuse(self, reason: str) -> None:
        """From now on every run gets a new instance."""
        self.reused = False
        self.note = f"every run has a new instance: {reason}"
        self.trials.clear()


def run_with_reuse(
    verdict: Verdict,
    layouts: list[Layout],
    order: Order,
    fresh: Callable[[Order], FloatArray],
    again: Callable[[Order], FloatArray],
) -> FloatArray:
    """Result of a run, on a reset instance where that is proven to be as good as a new one.

    ``fresh`` runs an order on a new instance, ``again`` on the present one after a reset.
    """
    if verdict.reused is False:
        return fresh(order)
    trial = verdict.trials.get(order.layout)
    if trial is None:
        result = fresh(order)
        verdict.trials[order.layout] = Trial(order, result)
        return result
    new = _differing(trial.order, order) - trial.varied
    if not new:
        return again(order) if trial.varied else fresh(order)
    failure = None
    if trial.pending is None or trial.pending[0] != order:
        failure = _repeat(verdict, trial, layouts[order.layout], order, again)
    result = fresh(order)
    if failure is not None:  # and on a new instance the same run did not fail
        verdict.refuse(f"a run after a reset failed ({failure})")
    elif trial.pending is not None and _same(result, trial.pending[1]):
        trial.varied |= new
        trial.pending = None
        verdict.reused, verdict.note = True, REUSED
    elif trial.pending is not None:
        outputs = layouts[order.layout].outputs
        verdict.refuse(_difference(outputs, trial.pending[1], result))
    return result


def _repeat(
    verdict: Verdict,
    trial: Trial,
    layout: Layout,
    order: Order,
    again: Callable[[Order], FloatArray],
) -> CallFailed | None:
    """The new run and the first one, each after a reset; returned: the failure of either."""
    trial.pending = None
    try:
        result = again(order)
        repeated = again(trial.order)
    except CallFailed as error:
        return error
    if _same(repeated, trial.result):
        trial.pending = (order, result)
    else:
        verdict.refuse(_difference(layout.outputs, repeated, trial.result))
    return None


def _differing(a: Order, b: Order) -> set[Place]:
    if a.values == b.values and a.tones == b.tones and a.legs == b.legs:
        return set()
    places: set[Place] = {
        (group, position)
        for group, (left, right) in enumerate(zip(a.values, b.values, strict=True))
        if left != right
        for position, (x, y) in enumerate(zip(left, right, strict=True))
        if x != y
    }
    if a.tones != b.tones:
        places.add("tones")
    if a.legs != b.legs:
        places.add("legs")
    return places


def _same(a: FloatArray, b: FloatArray) -> bool:
    return a.tobytes() == b.tobytes()


def _difference(outputs: tuple[str, ...], reset: FloatArray, new: FloatArray) -> str:
    differs = reset.view(np.int64) != new.view(np.int64)
    j, column = np.argwhere(differs)[0]
    return (
        f"after a reset a repeated run gave {outputs[column]} = {float(reset[j, column])!r} "
        f"(sample {j}) instead of {float(new[j, column])!r}, and the FMU had called that reset OK"
    )
