"""Drive plan: what to simulate for some drives, and the decisions with their bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fitting.fmu import Run
from fitting.signal.window import Window
from fitting.simulate.budget import Basis, Budget, Decision, Kind, PlanRecord, record_of
from fitting.simulate.drive import Drive
from fitting.simulate.probe import Reading
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.notation import hertz


@dataclass(frozen=True, kw_only=True)
class DrivePlan:
    """What to simulate for some drives.

    `settings` are the start values that the plan chose, `windows` when each drive is sampled;
    `readings` what the plan saw with them, one per drive; `budget` holds the decisions. Samples
    keep combinations of tones up to `order` off the tones, and common periods beyond `longest_s`
    are given up for a tone fit.
    """

    drives: tuple[Drive, ...]
    settings: Mapping[str, Scalar]
    windows: tuple[Window, ...]
    readings: tuple[Reading, ...]
    budget: Budget
    settle_s: float
    order: int
    longest_s: float

    @property
    def runs(self) -> tuple[Run, ...]:
        """The runs that were planned, one per drive."""
        pairs = zip(self.drives, self.windows, strict=True)
        return tuple(drive.run(window, self.settings) for drive, window in pairs)

    @property
    def amplitudes(self) -> tuple[FloatArray, ...]:
        """What the plan read, (lines, outputs) per drive; NaN where nothing oscillates."""
        return tuple(reading.amplitudes for reading in self.readings)

    @property
    def decisions(self) -> tuple[Decision, ...]:
        """Every choice with its bound."""
        return self.budget.decisions

    @property
    def promised(self) -> float:
        """Sum of the bounds."""
        return self.budget.promised

    @property
    def settles(self) -> bool:
        """Whether what is left of the transient alone keeps to what was wanted."""
        return self.budget.of(Kind.SETTLING)[0].bound <= self.budget.wanted

    @property
    def record(self) -> PlanRecord:
        """The plan for a result."""
        return record_of(self.budget, self.settings)

    def read(self, values: FloatArray, drive: int = 0) -> FloatArray:
        """Amplitudes (lines, outputs) in the samples (rows, outputs) of a drive's run.

        Args:
            values: samples (samples, outputs).
            drive: which of the drives.
        """
        window = self.windows[drive]
        return self.drives[drive].fit(window)(values[-window.samples :]).amplitudes


def window_decision(windows: Sequence[Window]) -> Decision:
    """The decision on windows, which cost nothing that was not measured.

    Args:
        windows: of the drives.
    """
    lengths = [float(f"{window.length_s:.6g}") for window in windows]
    counts = [window.samples for window in windows]
    tones = {window.tones_hz for window in windows}
    coherent = all(window.coherent for window in windows)
    return Decision(
        kind=Kind.WINDOW,
        basis=Basis.COHERENT if coherent else Basis.FITTED,
        bound=0.0,
        subject=hertz(*windows[0].tones_hz) if len(tones) == 1 else "",
        numbers={
            "shortest_s": min(lengths),
            "longest_s": max(lengths),
            "least": min(counts),
            "most": max(counts),
            "mixtures": max(window.mixtures for window in windows),
        },
    )


def constants_of(drive: Drive, reading: Reading) -> dict[str, float]:
    """Values of the outputs that do not oscillate, by name.

    Args:
        drive: tones and amplitudes that drive.
        reading: what the instrument read.
    """
    rows = zip(drive.outputs, reading.constant, np.asarray(reading.mean).tolist(), strict=True)
    return {name: value for name, constant, value in rows if constant}
