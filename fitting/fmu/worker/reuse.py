"""Reuse of an instance after a reset: allowed by comparison, not on the FMU's word.

The first run of a layout has a new instance. When a run comes that differs from it in a value that
no comparison has varied yet, it has a new instance as well, and so has the same run with that value
as it was in the first one. Then both are repeated, each after a reset that follows the other. Bit
for bit the same, twice: from now on this value may vary between resets. Else every run gets a new
instance, for good. The first run alone is no measure: with its input at rest it shows no value at
all. A value that changes nothing in its run is compared in further runs, too, before it counts as
tried. What goes wrong with the values of a run goes wrong before any reset, and is not laid to one.

Where a process bears one instance alone, or a signal in time varies, the first run is taken for the
second one; one that stood still gives way to the next.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import KW_ONLY, dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from fitting.fmu.runs import RunRequest
from fitting.fmu.worker.log import CallFailed
from fitting.text.arrays import FloatArray

if TYPE_CHECKING:
    from fitting.fmu.worker.loop import Instances

Place = tuple[int, int] | str  # a value of a request: (group, position), or the input's tones

ANEW = "every run has a new instance: "
UNDECIDED = "no comparison of a reset instance with a new one was needed"
#: Places that only fit the run that they are of.
WHOLE = frozenset({"segments", "sampled"})
#: Comparisons in which a value may change nothing before it counts as tried.
BLIND = 3
REUSED = "instances are reset and reused: runs repeated after a reset were the same bit for bit"


@dataclass
class Trial:
    """What has been compared for one layout; `blind`: how often a value changed nothing there."""

    request: RunRequest
    result: FloatArray
    _: KW_ONLY
    varied: set[Place] = field(default_factory=set)
    blind: Counter[Place] = field(default_factory=Counter)


@dataclass(frozen=True)
class Verdict:
    """Whether instances are reused (None: undecided), and why; outlives the worker process.

    ``ended``: a reset ended the process; ``lied``: it was called OK and left something behind;
    ``failed``: it, or a run after it, failed.
    """

    reused: bool | None = None
    note: str = UNDECIDED
    ended: bool = False
    lied: bool = False
    failed: bool = False

    @property
    def failure(self) -> str:
        """How a reset failed, or ended the process; empty: none did."""
        return self.note.removeprefix(ANEW) if self.ended or self.failed else ""


def refused(
    reason: str, *, ended: bool = False, lied: bool = False, failed: bool = False
) -> Verdict:
    """The verdict that every run gets a new instance.

    Args:
        reason: as a sentence.
        ended: whether a reset ended the process.
        lied: whether a reset that was called OK left something behind.
        failed: whether it, or a run after it, failed.
    """
    return Verdict(reused=False, note=f"{ANEW}{reason}", ended=ended, lied=lied, failed=failed)


class Reuse:
    """A verdict, and what has been compared for it, by layout."""

    def __init__(self, verdict: Verdict) -> None:
        self.verdict = verdict
        self.trials: dict[int, Trial] = {}

    def run(
        self, outputs: tuple[str, ...], request: RunRequest, instances: Instances
    ) -> FloatArray:
        """Result of a run, on a reset instance where that is proven to be as good as a new one.

        Args:
            outputs: names of what is read.
            request: a run, in value references.
            instances: ways to make it.
        """
        trial = self.trials.get(request.layout)
        if self.verdict.reused is False or trial is None:
            result = instances.fresh(request)
            if self.verdict.reused is not False:
                self.trials[request.layout] = Trial(request, result)
            return result
        new = _differing(trial.request, request) - trial.varied
        if not new:
            return (instances.again if trial.varied else instances.fresh)(request)

        # values that no comparison has varied yet: both runs on new instances, then each again
        result = instances.fresh(request)
        before, pairs = trial.result, [(trial.request, trial.result), (request, result)]
        first = None if new & WHOLE else _with_values(request, trial.request, new)
        try:
            with instances.trying():
                if not instances.single and first is not None and first != trial.request:
                    before = instances.fresh(first)
                    pairs = [(request, result), (first, before)]
                for repeated, expected in pairs:
                    after = instances.again(repeated)
                    if after.tobytes() != expected.tobytes():
                        self._refuse(_difference(outputs, after, expected), lied=True)
                        return result
        except CallFailed as error:  # and on a new instance the same run did not fail
            self._refuse(f"a run after a reset failed ({error})", failed=True)
            return result

        acts = before.tobytes() != result.tobytes()
        trial.blind.update(new)
        trial.varied |= {place for place in new if acts or trial.blind[place] >= BLIND}
        self.verdict = Verdict(reused=True, note=REUSED)
        if not np.ptp(trial.result, axis=0).any():  # it stood still
            trial.request, trial.result = request, result
        return result

    def _refuse(self, reason: str, *, lied: bool = False, failed: bool = False) -> None:
        self.verdict = refused(reason, lied=lied, failed=failed)
        self.trials.clear()


def _with_values(request: RunRequest, of: RunRequest, places: set[Place]) -> RunRequest:
    """A run with what another one has at some places."""
    values = tuple(
        tuple(
            there if (group, position) in places else here
            for position, (here, there) in enumerate(zip(left, right, strict=True))
        )
        for group, (left, right) in enumerate(zip(request.values, of.values, strict=True))
    )
    return request._replace(values=values, tones=of.tones if "tones" in places else request.tones)


def _differing(a: RunRequest, b: RunRequest) -> set[Place]:
    if (a.values, a.tones, a.segments, a.sampled) == (b.values, b.tones, b.segments, b.sampled):
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
    if a.sampled != b.sampled:
        places.add("sampled")
    return places


def _difference(outputs: tuple[str, ...], reset: FloatArray, new: FloatArray) -> str:
    differs = reset.view(np.int64) != new.view(np.int64)
    j, column = np.argwhere(differs)[0]
    return (
        f"after a reset a repeated run gave {outputs[column]} = {float(reset[j, column])!r} "
        f"(sample {j}) instead of {float(new[j, column])!r}, and the FMU had called that reset OK"
    )
