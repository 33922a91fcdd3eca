"""Records of a study of accuracy against cost: what was set, what it cost, what came out."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from fitting.lab.names import QUANTITIES
from fitting.text.arrays import Scalar
from fitting.text.records import EndedRecord, to_plain

#: A reference that is none of these: amplitudes over the maximum of the sweep.
RATIOS = "amplitudes over the maximum"

#: How amplitudes are read: a window of whole periods (a fit of the tones where there is none), the
#: largest line of a flat-top window, the largest line without a window.
COHERENT, FLAT_TOP, NO_WINDOW = "coherent", "flat-top", "none"
READERS = (COHERENT, FLAT_TOP, NO_WINDOW)

#: What the resolution of a setting counts.
SUBSTEPS, HELD, TOLERANCE = "substeps per period", "held steps per period", "tolerance"


@dataclass(frozen=True, kw_only=True)
class Setting:
    """How a simulation is told to give one quantity.

    `values` start values of the FMU that belong to the solver; `resolution` of the kind
    `resolution_kind` ("" for none); `settle_s` time before the window, 0 with a periodic start;
    `window_s` its length, `samples` in it. `sweep_points`, `jacobian_step` (relative to the width)
    and `iterations` (Gauss-Newton steps) belong to the width, 0 where there is none.

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
    window_s: float
    samples: int
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


@dataclass(frozen=True, kw_only=True)
class Cost:
    """What something costs, `repeats` times timed (0: not run, extrapolated).

    `seconds` wall time, a median; `cpu_s` processor time of this process and the FMU's, NaN where
    the system does not tell or several processes share the work. `runs`, `steps` (doStep calls) and
    `reads` (getReal calls) of one repeat; `solver_steps` of the solver itself, None where it does
    not tell.
    """

    seconds: float = 0.0
    cpu_s: float = 0.0
    repeats: int = 0
    runs: int = 0
    steps: int = 0
    reads: int = 0
    solver_steps: int | None = None


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """What a setting gave.

    `error` relative, worst of all amplitudes, infinite where the setting failed and `note` says
    why; `bounded`: it is the reference's own error, the true one is at most that. `extrapolated`:
    not run, `note` says what the numbers come from. `planned_for`: the accuracy for which the plan
    chose it, None: the grid's.
    """

    setting: Setting
    error: float
    cost: Cost
    bounded: bool = False
    extrapolated: bool = False
    note: str = ""
    planned_for: float | None = None

    @property
    def failed(self) -> bool:
        """Whether nothing came out."""
        return math.isinf(self.error)

    @property
    def cost_s(self) -> float:
        """What settings are compared by: processor time, wall time where that is not known.

        A machine that does other work as well spoils the wall time only.
        """
        return self.cost.cpu_s if math.isfinite(self.cost.cpu_s) else self.cost.seconds


@dataclass(frozen=True, kw_only=True)
class Reference:
    """What errors are measured from: `values` of a quantity, their relative `error`, `source`."""

    quantity: str
    values: tuple[float, ...]
    error: float
    source: str


@dataclass(frozen=True, kw_only=True)
class Study(EndedRecord):
    """Everything that a run of the command found."""

    scene: str
    description: str
    references: tuple[Reference, ...]
    measurements: tuple[Measurement, ...]
    accuracies: tuple[float, ...]
    notes: tuple[str, ...] = ()

    @property
    def cost_kind(self) -> str:
        """What the costs are: "processor" or "wall" time."""
        counted = all(math.isfinite(m.cost.cpu_s) for m in self.measurements)
        return "processor" if counted else "wall"

    def of(self, quantity: str, *, planned: bool = False) -> list[Measurement]:
        """Measurements of a quantity, the grid's or the plan's.

        Args:
            quantity: what is measured of a response.
            planned: whether the plan's are wanted instead of the grid's.
        """
        return [
            m
            for m in self.measurements
            if m.setting.quantity == quantity and (m.planned_for is not None) == planned
        ]
