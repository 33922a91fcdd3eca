"""Reuse of an instance after a reset: allowed by comparison, not on the FMU's word.

The first run of a layout has a new instance. When a run comes that differs from it in a value that
no comparison has varied yet, it has a new instance as well, and then both are repeated: the first
run after a reset, the new one after another reset. Bit for bit the same, twice: from now on this
value may vary between resets. Else every run gets a new instance, for good. What goes wrong with
the values of a run goes wrong before any reset, and is not laid to one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field
from typing import NamedTuple

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


class Instances(NamedTuple):
    """Ways to make a run.

    ``fresh``: on a new instance; ``again``: on the present one after a reset; ``tried``: the same
    in a trial, in which the reset may turn out to be the end of the process.
    """

    fresh: Callable[[RunRequest], FloatArray]
    again: Callable[[RunRequest], FloatArray]
    tried: Callable[[RunRequest], FloatArray]


@dataclass
class ReuseDecision:
    """Whether instances are reused (None: undecided), and why; outlives the worker process.

    ``ended``: a reset ended the process; ``lied``: it was called OK and left something behind.
    """

    reused: bool | None = None
    note: str = UNDECIDED
    ended: bool = False
    lied: bool = False
    trials: dict[int, Trial] = field(default_factory=dict)

    def refuse(self, reason: str, *, ended: bool = False, lied: bool = False) -> None:
        """From now on every run gets a new instance.

        Args:
            reason: as a sentence.
            ended: whether a reset ended the process.
            lied: whether a reset that was called OK left something behind.
        """
        self.reused = False
        self.ended, self.lied = ended, lied
        self.note = f"every run has a new instance: {reason}"
        self.trials.clear()


def run_with_reuse(
    verdict: ReuseDecision, layouts: list[Layout], request: RunRequest, instances: Instances
) -> FloatArray:
    """Result of a run, on a reset instance where that is proven to be as good as a new one.

    Args:
        verdict: what is known about reuse.
        layouts: of runs, met so far.
        request: a run, in value references.
        instances: ways to make it.
    """
    trial = verdict.trials.get(request.layout)
    if verdict.reused is False or trial is None:
        result = instances.fresh(request)
        if verdict.reused is not False:
            verdict.trials[request.layout] = Trial(request, result)
        return result
    new = _differing(trial.request, request) - trial.varied
    if not new:
        return (instances.again if trial.varied else instances.fresh)(request)
    result = instances.fresh(request)
    try:
        reason = _difference_after_reset(trial, layouts[request.layout], request, result, instances)
    except CallFailed as error:  # and on a new instance the same run did not fail
        verdict.refuse(f"a run after a reset failed ({error})")
        return result
    if reason:
        verdict.refuse(reason, lied=True)
    else:
        trial.varied |= new
        verdict.reused, verdict.note = True, REUSED
    return result


def _difference_after_reset(
    trial: Trial, layout: Layout, request: RunRequest, result: FloatArray, instances: Instances
) -> str:
    """What comes out otherwise of both runs, each repeated after a reset; empty if nothing.

    Raises CallFailed where such a run fails.
    """
    for repeated, new in ((trial.request, trial.result), (request, result)):
        reset = instances.tried(repeated)
        if not _same(reset, new):
            return _difference(layout.outputs, reset, new)
    return ""


def _differing(a: RunRequest, b: RunRequest) -> set[Place]:
    if (a.values, a.tones, a.segments, a.held) == (b.values, b.tones, b.segments, b.held):
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
    if a.held != b.held:
        places.add("held")
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
