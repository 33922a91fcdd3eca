"""Many fits as one record: a row each, and whether the intervals hold what is true.

    pull = (value - truth)/std          share = k/n in [B(a/2; k, n-k+1), B(1-a/2; k+1, n-k)]

B are quantiles of the beta distribution (Clopper and Pearson, Biometrika 26 (1934) 404), a = 5 %.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from scipy.special import betaincinv

from fitting.text.estimate import Estimate, Verdict
from fitting.text.records import EndedRecord

#: Part of the binomial intervals that is left out.
ALPHA = 0.05
FINISHED, INTERRUPTED, FAILED = "finished", "interrupted", "failed"


@dataclass(frozen=True, kw_only=True)
class EnsembleValue(Estimate):
    """One value of one fit; ``truth`` is nan where it is not known.

    ``value`` and ``std`` are nan where the data leave it open; ends of an interval that the data do
    not cut are those of the box.
    """

    truth: float

    @property
    def pull(self) -> float:
        """(value - truth)/std, nan where one of them is not known."""
        return (self.value - self.truth) / self.std if self.std > 0.0 else math.nan

    @property
    def is_assessed(self) -> bool:
        """Whether an interval was promised, and the truth is known."""
        without_interval = (Verdict.WITHDRAWN, Verdict.UNKNOWN)
        known = math.isfinite(self.truth) and not math.isnan(self.ci95[0] + self.ci95[1])
        return known and self.status not in without_interval

    def holds(self, level: float) -> bool:
        """Whether the interval of that level holds the truth.

        Args:
            level: 0.68 or 0.95.
        """
        low, high = self.ci95 if level == 0.95 else self.ci68
        return low <= self.truth <= high


@dataclass(frozen=True, kw_only=True)
class EnsembleRow:
    """One item: its number from 0, what it is, how its fit ended, and the values found.

    ``status`` is that of the fit, "failed" where there is none; ``message`` states why then.
    """

    index: int
    label: str
    status: str
    message: str
    values: tuple[EnsembleValue, ...] = ()

    @property
    def failed(self) -> bool:
        """Whether there is no fit."""
        return self.status == FAILED


@dataclass(frozen=True)
class Share:
    """So many of so many, with what follows for the share behind it."""

    count: int
    total: int

    @property
    def part(self) -> float:
        """count/total, nan of none."""
        return self.count / self.total if self.total else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the 95 % interval of Clopper and Pearson."""
        k, n = self.count, self.total
        low = float(betaincinv(k, n - k + 1, 0.5 * ALPHA)) if k else 0.0
        high = float(betaincinv(k + 1, n - k, 1.0 - 0.5 * ALPHA)) if k < n else 1.0
        return low, high

    def __str__(self) -> str:
        if not self.total:
            return "–"
        low, high = (f"{100.0 * end:.1f}" for end in self.interval)
        return f"{self.count}/{self.total} = {100.0 * self.part:.1f} % ({low} to {high})"


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """How often intervals of one value hold the truth, and how far estimates are from it.

    ``pulls`` are those of all fits that report a value; ``judged`` fits promise an interval,
    ``determined`` of them call the value determined, ``withheld`` promise none.
    """

    name: str
    unit: str
    judged: int
    determined: int
    withheld: int
    held68: Share
    held95: Share
    pulls: tuple[float, ...]

    @property
    def pull_mean(self) -> float:
        """Mean of the pulls: 0 for an estimate without bias."""
        return math.fsum(self.pulls) / len(self.pulls) if self.pulls else math.nan

    @property
    def pull_std(self) -> float:
        """Standard deviation of the pulls: 1 where errors are as large as is stated."""
        if len(self.pulls) < 2:
            return math.nan
        mean = self.pull_mean
        square = math.fsum((pull - mean) ** 2 for pull in self.pulls)
        return math.sqrt(square / (len(self.pulls) - 1))


@dataclass(frozen=True, kw_only=True)
class Ensemble(EndedRecord):
    """Many fits: a row for each finished item, in order.

    ``total`` is the number of items, ``synthetic`` whether they are virtual laboratories.
    """

    total: int
    rows: tuple[EnsembleRow, ...]

    @property
    def failures(self) -> tuple[EnsembleRow, ...]:
        """Items that have no fit."""
        return tuple(row for row in self.rows if row.failed)

    @property
    def statuses(self) -> dict[str, int]:
        """How many items ended how, the most frequent first."""
        counts: dict[str, int] = {}
        for row in self.rows:
            counts[row.status] = counts.get(row.status, 0) + 1
        return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))

    @property
    def coverage(self) -> tuple[Coverage, ...]:
        """Of every value of which something true is known."""
        names: dict[str, list[EnsembleValue]] = {}
        for value in (v for row in self.rows for v in row.values if math.isfinite(v.truth)):
            names.setdefault(value.name, []).append(value)
        return tuple(_coverage(values) for values in names.values())

    def to_dict(self) -> list[dict[str, str | float]]:
        """A flat row per item and value, as ``pandas.DataFrame`` takes them."""
        return [
            {
                "item": row.index,
                "label": row.label,
                "status": row.status,
                "name": v.name,
                "unit": v.unit,
                "verdict": str(v.status),
                "value": v.value,
                "std": v.std,
                "low68": v.ci68[0],
                "high68": v.ci68[1],
                "low95": v.ci95[0],
                "high95": v.ci95[1],
                "truth": v.truth,
            }
            for row in self.rows
            for v in row.values
        ]

    @property
    def ranges(self) -> list[tuple[str, str, int, int, float, float, float]]:
        """Name, unit, fits, those that report a value, least, median and largest value."""
        names: dict[str, list[EnsembleValue]] = {}
        for value in (v for row in self.rows for v in row.values):
            names.setdefault(value.name, []).append(value)
        rows = []
        for name, every in names.items():
            reported = [v.value for v in every if math.isfinite(v.value)]
            known = reported or [math.nan]
            ends = (min(known), statistics.median(known), max(known))
            rows.append((name, every[0].unit, len(every), len(reported), *ends))
        return rows


def _coverage(values: Sequence[EnsembleValue]) -> Coverage:
    assessed = [value for value in values if value.is_assessed]
    pulls = [value.pull for value in assessed]
    return Coverage(
        name=values[0].name,
        unit=values[0].unit,
        judged=len(assessed),
        determined=sum(value.status == Verdict.DETERMINED for value in assessed),
        withheld=len(values) - len(assessed),
        held68=Share(sum(value.holds(0.68) for value in assessed), len(assessed)),
        held95=Share(sum(value.holds(0.95) for value in assessed), len(assessed)),
        pulls=tuple(pull for pull in pulls if math.isfinite(pull)),
    )
