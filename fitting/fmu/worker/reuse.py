"""Reuse of an instance after a reset: allowed by comparison, not on the FMU's word.

The first run of a layout has a new instance. When a run comes that differs from it in a value that
no comparison has varied yet, both are repeated: the new run after a reset, the first one after
another reset, and the new one once more on a new instance. Bit for bit the same, twice: from now on
this value may vary between resets. Else every run gets a new instance, for good.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field

import numpy as np

from fitting.fmu.run_requests import Layout, RunRequest
from fitting.fmu.worker.log import CallFailed
from fitting.text.arrays import FloatArray

Place = tuple[int, int] | str  # a value of a request: (group, position), or the input's tones

UNDECIDED = "no comparison of a reset instance with a new one was needed"
REUSED = "instances are reset and reused: runs repeated after a reset were the same bit for bit"


@dataclass
class Trial:
    """What has been compared for one layout."""

    request: RunRequest
    result: FloatArray
    _: KW_ONLY
    varied: set[Place] = field(default_factory=set)
    pending: tuple[RunRequest, FloatArray] | None = None


@dataclass
class ReuseDecision:
    """Whether instances are reused (None: undecided), and why; outlives the worker process."""

    reused: bool | None = None
    note: str = UNDECIDED
    trials: dict[int, Trial] = field(default_factory=dict)

    def refuse(self, reason: str) -> None:
        """From now on every run gets a new instance.

        Args:
            reason: as a sentence.
        """
        self.reused = False
        self.note = f"every run has a new instance: {reason}"
        self.trials.clear()


def run_with_reuse(
    verdict: ReuseDecision,
    layouts: list[Layout],
    request: RunRequest,
    fresh: Callable[[RunRequest], FloatArray],
    again: Callable[[RunRequest], FloatArray],
) -> FloatArray:
    """Result of a run, on a reset instance where that is proven to be as good as a new one.

    ``fresh`` runs an order on a new instance, ``again`` on the present one after a reset.

    Args:
        verdict: what is known about reuse.
        layouts: of runs, met so far.
        request: a run, in value references.
        fresh: simulates in a new instance.
        again: simulates in the same instance after a reset.
    """
    if verdict.reused is False:
        return fresh(request)
    trial = verdict.trials.get(request.layout)
    if trial is None:
        result = fresh(request)
        verdict.trials[request.layout] = Trial(request, result)
        return result
    new = _differing(trial.request, request) - trial.varied
    if not new:
        return again(request) if trial.varied else fresh(request)
    failure = None
    if trial.pending is None or trial.pending[0] != request:
        failure = _repeat(verdict, trial, layouts[request.layout], request, again)
    result = fresh(request)
    if failure is not None:  # and on a new instance the same run did not fail
        verdict.refuse(f"a run after a reset failed ({failure})")
    elif trial.pending is not None and _same(result, trial.pending[1]):
        trial.varied |= new
        trial.pending = None
        verdict.reused, verdict.note = True, REUSED
    elif trial.pending is not None:
        outputs = layouts[request.layout].outputs
        verdict.refuse(_difference(outputs, trial.pending[1], result))
    return result


def _repeat(
    verdict: ReuseDecision,
    trial: Trial,
    layout: Layout,
    request: RunRequest,
    again: Callable[[RunRequest], FloatArray],
) -> CallFailed | None:
    """The new run and the first one, each after a reset; returned: the failure of either."""
    trial.pending = None
    try:
        result = again(request)
        repeated = again(trial.request)
    except CallFailed as error:
        return error
    if _same(repeated, trial.result):
        trial.pending = (request, result)
    else:
        verdict.refuse(_difference(layout.outputs, repeated, trial.result))
    return None


def _differing(a: RunRequest, b: RunRequest) -> set[Place]:
    if a.values == b.values and a.tones == b.tones and a.segments == b.segments:
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
    if a.segments != b.segments:
        places.add("segments")
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
