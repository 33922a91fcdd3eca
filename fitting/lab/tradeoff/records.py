"""Records of a study: a setting, what it costs and how far off it is, all rows together."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from fitting.text.arrays import Scalar

#: Largest shift of a value, or error of a datum, that is sufficient, in standard deviations.
SUFFICIENT = 0.1
#: Costs that are apart by no more than this factor are the same.
SAME = 1.1
PLAN = "plan"


@dataclass(frozen=True, kw_only=True)
class Setting:
    """One way to simulate a campaign.

    `accuracy` is what its plan aims at (0: what it aims at anyway), `force` and `forbid` name
    reductions, `start` are start values of the FMU.
    """

    name: str
    accuracy: float = 0.0
    force: tuple[str, ...] = ()
    forbid: tuple[str, ...] = ()
    start: Mapping[str, Scalar] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Row:
    """What a setting costs, and how far off it is; `failed`: why there is nothing, else empty.

    `evaluation_s` is the processor time of one evaluation of the whole campaign, of the FMU and of
    the thread that asks, a median; `runs` and `steps` of the FMU in it. `promised` is the relative
    error that its plan admits. Errors are those of the simulated data at the start values against
    the reference: the largest over the largest datum of its row (`error`), and in standard
    deviations of the noise (`error_sigma`, NaN where none is known). With a fit: its processor
    time, and by parameter the value and its shift against the reference's fit in standard errors.
    """

    setting: Setting
    failed: str = ""
    evaluation_s: float = math.nan
    runs: int = 0
    steps: int = 0
    promised: float = math.nan
    error: float = math.nan
    error_sigma: float = math.nan
    fit_s: float = math.nan
    values: Mapping[str, float] = field(default_factory=dict)
    errors: Mapping[str, float] = field(default_factory=dict)
    shifts: Mapping[str, float] = field(default_factory=dict)

    @property
    def off(self) -> float:
        """Its largest shift, else its largest error, in standard deviations: it decides."""
        if self.shifts:
            return max(map(abs, self.shifts.values()))
        return self.error_sigma

    @property
    def cost_s(self) -> float:
        """Processor time of the fit where there is one, else of an evaluation, s."""
        return self.fit_s if self.shifts else self.evaluation_s


@dataclass(frozen=True, kw_only=True)
class Study:
    """All rows of a campaign.

    `reference` is the row that the others are compared with, with the error that its own plan
    admits; `status` "finished" or "interrupted" with a `message`.
    """

    title: str
    synthetic: bool
    reference: Row
    rows: tuple[Row, ...]
    status: str = "finished"
    message: str = ""
    provenance: Mapping[str, str] = field(default_factory=dict)

    @property
    def cheapest(self) -> Row | None:
        """The cheapest of the rows that are sufficient; None: there is none.

        Of those that cost about the same the first: the plan's own, where it is one of them.
        """
        result = [row for row in self.rows if not row.failed and row.off <= SUFFICIENT]
        least = min((row.cost_s for row in result), default=0.0)
        return next((row for row in result if row.cost_s <= SAME * least), None)

    @property
    def planned(self) -> Row | None:
        """The plan's own choice; None: it was not measured."""
        return next((row for row in self.rows if row.setting.name == PLAN), None)

    def mark(self, row: Row) -> str:
        """The mark of a row: "cheapest" or "as cheap as any", "plan", both, or nothing.

        Args:
            row: of the study.
        """
        marks = []
        if row is self.cheapest:
            least = min(r.cost_s for r in self.rows if not r.failed and r.off <= SUFFICIENT)
            marks = ["cheapest" if row.cost_s <= least else "as cheap as any"]
        marks += ["plan"] if row is self.planned else []
        return ", ".join(marks)
