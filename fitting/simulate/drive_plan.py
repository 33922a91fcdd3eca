"""The plan of one drive through an FMU: what to simulate for a wanted accuracy, and why so."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fitting.fmu import FmuDescription, Run, read_hints
from fitting.fmu.accuracy import Hints
from fitting.signal.tones import tones_in_words
from fitting.signal.window import Window
from fitting.simulate.budget import Budget, Decision, PlanRecord, record_of, sentences_of
from fitting.simulate.drive import Drive
from fitting.simulate.probe import Probe, Shot, Workers, read
from fitting.simulate.search import Found, Search
from fitting.simulate.words import window_in_words
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.units import checked_accuracy

#: A run that would take longer than this is not planned, s.
LIMIT_S = 20.0


@dataclass(frozen=True)
class DrivePlan:
    """What to simulate for one drive.

    `settings` are the start values that the plan chose; `run` is the run itself, sampled as
    `window` says; `amplitudes` (tones, outputs) are what the plan read with it (NaN where nothing
    oscillates), `run_s` the seconds that it took; `budget` holds the decisions.
    """

    drive: Drive
    settings: Mapping[str, Scalar]
    window: Window
    run: Run
    amplitudes: FloatArray
    run_s: float
    budget: Budget

    @property
    def settle_s(self) -> float:
        """Time before sampling, s."""
        return self.window.settle_s

    @property
    def as_drive(self) -> Drive:
        """The drive with the plan's settings and time to settle."""
        values = {**self.drive.start_values, **self.settings}
        return replace(self.drive, start_values=values, settle_s=self.settle_s)

    @property
    def decisions(self) -> tuple[Decision, ...]:
        """Every choice with its bound."""
        return self.budget.decisions

    @property
    def promised(self) -> float:
        """Sum of the bounds."""
        return self.budget.promised

    @property
    def sentences(self) -> tuple[str, ...]:
        """The plan in words, a line per decision and the sum."""
        return sentences_of(self.budget)

    @property
    def record(self) -> PlanRecord:
        """The plan for a result."""
        return record_of(self.budget, self.settings)

    def read(self, values: FloatArray) -> FloatArray:
        """Amplitudes (tones, outputs) in the samples (samples, outputs) of `run`."""
        return np.abs(read(self.window, values).tones)


def plan_drive(
    drive: Drive,
    accuracy: float,
    workers: Workers,
    description: FmuDescription,
    hints: Hints | None = None,
    *,
    limit_s: float = LIMIT_S,
) -> DrivePlan:
    """Plan a drive through an FMU for amplitudes with a wanted relative accuracy, by measuring.

    `hints` say what is known of the FMU (else what it says itself); times, window and samples that
    the drive prescribes are not asked for here. No run of more than `limit_s` seconds is planned:
    where the accuracy would need one, the budget promises less than was wanted.

    Raises:
        BadInput: an accuracy out of range, tones that cannot be told apart, outputs that do not
            oscillate, names that the FMU does not have.
        FmuFailure: the FMU failed.
    """
    checked_accuracy(accuracy, "accuracy")
    known = (hints or Hints()).over(read_hints(description))
    _check_names(known, description)
    shot = Shot(
        drive.start_values,
        drive.tones_hz,
        drive.outputs,
        drive.input,
        drive.level,
        drive.steps_per_period,
    )
    probe = Probe((shot,), workers)
    search = Search(probe, accuracy, known, description.variables, limit_s, one_drive=True)
    found = search.found()
    shot = probe.shots[0]
    amplitudes = found.readings[0].amplitudes
    if np.isnan(amplitudes).all():
        raise BadInput(
            f"outputs: {', '.join(drive.outputs)} do not oscillate at "
            f"{tones_in_words(drive.tones_hz)}; wanted one that does"
        )
    window = shot.window(found.settle_s, found.order, found.longest_s)
    return DrivePlan(
        drive,
        found.settings,
        window,
        shot.run(window, found.settings),
        amplitudes,
        found.run_s,
        _with_window(found, window),
    )


def _with_window(found: Found, window: Window) -> Budget:
    """The decisions with that on the window, which costs nothing that was not measured."""
    kind = "coherent" if window.coherent else "tone fit"
    told_window = Decision(
        "window", f"{window.step_s * window.samples:.4g} s, {kind}", 0.0, window_in_words(window)
    )
    first = [d for d in found.budget.decisions if d.subject == "settling"]
    place = found.budget.decisions.index(first[0]) + 1
    decisions = found.budget.decisions
    return Budget(found.budget.wanted, (*decisions[:place], told_window, *decisions[place:]))


def _check_names(hints: Hints, description: FmuDescription) -> None:
    names = [name for name in (hints.tolerance, hints.substep) if name is not None]
    names += [*hints.full, *(name for r in hints.reductions for name in r.set)]
    for name in names:
        description.variable(name)
