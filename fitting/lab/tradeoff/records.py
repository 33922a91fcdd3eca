"""Records of a study of accuracy against cost: what was set, what it cost, what came out."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from fitting.text.arrays import Scalar
from fitting.text.records import to_plain

#: What is measured: the amplitudes of a two-tone drive; the line width, read off a sweep by a fit
#: of one mode; the line width, fitted through the simulator to the amplitudes.
AMPLITUDES, WIDTH_SWEEP, WIDTH_PEAKS = "amplitudes", "width by sweep", "width by amplitudes"
QUANTITIES = (AMPLITUDES, WIDTH_SWEEP, WIDTH_PEAKS)

#: How amplitudes are read: a window of whole periods (a fit of the tones where there is none), the
#: largest line of a flat-top window, the largest line without a window.
COHERENT, FLAT_TOP, NO_WINDOW = "coherent", "flat-top", "none"
READERS = (COHERENT, FLAT_TOP, NO_WINDOW)


@dataclass(frozen=True)
class Setting:
    """One way of getting a quantity.

    `values` start values of the FMU that belong to the solver; `resolution` of the kind
    `resolution_kind` ("substeps per period", "tolerance", "held steps per period", "" for none);
    `settle_s` time before the window, 0 with a periodic start; `window_s` its length, `samples` in
    it. `sweep_points`, `jacobian_step` (relative to the width) and `iterations` (Gauss-Newton
    steps) belong to the width, 0 where there is none.

    Raises:
        ValueError: an unknown quantity or reader, or times that are not finite.
    """

    quantity: str
    solver: str
    values: Mapping[str, Scalar] = field(default_factory=dict)
    resolution: float = 0.0
    resolution_kind: str = ""
    periodic: bool = False
    settle_s: float = 0.0
    reader: str = COHERENT
    window_s: float = 0.0
    samples: int = 0
    sweep_points: int = 0
    jacobian_step: float = 0.0
    iterations: int = 0

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES or self.reader not in READERS:
            raise ValueError(f"quantity {self.quantity!r}, reader {self.reader!r}")
        if not (math.isfinite(self.settle_s) and 0.0 < self.window_s < math.inf):
            raise ValueError(f"settling {self.settle_s!r} s, window {self.window_s!r} s")

    @property
    def key(self) -> str:
        """The setting as text: equal for equal settings, on any machine."""
        return json.dumps(to_plain(self), sort_keys=True)


@dataclass(frozen=True)
class Measurement:
    """What a setting gave.

    `error` relative, worst of all amplitudes; `bounded`: it is the reference's own error, the true
    one is at most that. `seconds` wall time, median of `repeats`; `cpu_s` processor time of the
    processes, NaN where the system does not tell; `runs`, `steps` (doStep calls), `reads` (getReal
    calls); `solver_steps` of the solver itself, None where it does not tell. `extrapolated`: not
    run, `note` says what the numbers come from. A setting that failed has an infinite error and the
    reason as its note. `planned_for`: the accuracy for which the plan chose it, None: the grid's.
    """

    setting: Setting
    error: float
    bounded: bool
    seconds: float
    cpu_s: float
    repeats: int
    runs: int
    steps: int
    reads: int
    solver_steps: int | None = None
    extrapolated: bool = False
    note: str = ""
    planned_for: float | None = None

    @property
    def cost_s(self) -> float:
        """What settings are compared by: processor time, wall time where that is not known.

        A machine that does other work as well spoils the wall time only.
        """
        return self.cpu_s if math.isfinite(self.cpu_s) else self.seconds


@dataclass(frozen=True)
class Reference:
    """What errors are measured from: `values` of a quantity, their relative `error`, `source`."""

    quantity: str
    values: tuple[float, ...]
    error: float
    source: str


@dataclass(frozen=True)
class Study:
    """Everything that a run of the command found; `status` "finished" or "interrupted"."""

    scene: str
    title: str
    synthetic: bool
    description: str
    references: tuple[Reference, ...]
    measurements: tuple[Measurement, ...]
    accuracies: tuple[float, ...]
    status: str
    message: str
    notes: tuple[str, ...] = ()
    provenance: Mapping[str, str] = field(default_factory=dict)

    def of(self, quantity: str, *, planned: bool = False) -> list[Measurement]:
        """Measurements of a quantity, the grid's or the plan's."""
        return [
            m
            for m in self.measurements
            if m.setting.quantity == quantity and (m.planned_for is not None) == planned
        ]
