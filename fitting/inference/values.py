"""Values as records: value, error, interval, and how far the data determine it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fitting.campaign.parameters import SLACK
from fitting.inference.error_bars import EVEN, ErrorBars
from fitting.inference.verdict import Verdict, in_boxes
from fitting.text.notation import span

Floats = tuple[float, ...]
#: Share of a period from which an interval is all of it: ends are counted in other units.
ALL_ROUND = 1.0 - 1e-9


class _Reported:
    """What any value can be asked: whose it is, and whether it lies in its interval."""

    value: float
    unit: str
    std: float
    most_likely: float
    ci95: tuple[float, float]
    period: float | None = None
    bars: ErrorBars = EVEN
    boxes: tuple[str, ...] = ()

    @property
    def condition(self) -> str:
        """What the verdict holds under: " in the box of d1"; mostly empty."""
        return in_boxes(self.boxes)

    @property
    def is_most_likely(self) -> bool:
        """Whether the reported value is the likelihood's, of which error and interval are."""
        return math.isnan(self.most_likely) or self.value == self.most_likely

    @property
    def likely(self) -> float:
        """The likelihood's value, of which error and interval are."""
        return self.value if self.is_most_likely else self.most_likely

    @property
    def likely_words(self) -> str:
        """The most likely value with what is true of its error."""
        return self.bars.words(self.likely, self.std, self.unit, self.ci95)

    @property
    def is_all_round(self) -> bool:
        """Whether the 95 % interval is a whole period, so that the value may be anything."""
        low, high = self.ci95
        return self.period is not None and high - low >= ALL_ROUND * self.period

    @property
    def is_outside(self) -> bool:
        """Whether the reported value lies outside the 95 % interval, which is the likelihood's."""
        low, high = self.ci95
        turns = (0.0,) if self.period is None else (-self.period, 0.0, self.period)
        return not self.is_most_likely and all(
            self.value + turn < low or self.value + turn > high for turn in turns
        )


@dataclass(frozen=True, kw_only=True)
class ParameterResult(_Reported):
    """One fitted parameter.

    `value` is what is reported (canonical: periodic ones in [0, period)): the `most_likely` one,
    unless the campaign asks for `algorithm2`, the paper's, the end of Algorithm 2. Error, interval
    and verdict are the likelihood's in any case: `std` is half the 68 % interval of the profile
    likelihood, `ci95` its 95 % interval, `identifiable` the verdict with its `reason` and
    `precision` (see `Profile`). Without profiles ("linearised only") `std`, `ci95` and `shrinkage`,
    the share of the variance that comes from the data, are those of the problem linearised at the
    end of Algorithm 2. `std` is NaN where the verdict leaves no value. `simulation` is how far what
    the plan of the simulation cannot exclude moves the value, at most: it is in `std` and `ci95`.
    `bars` are the sides of the 68 % interval, and whether `std` tells them and the 95 % interval.
    `asked`: it is one that the campaign names; else the measurement brings it, as a cable's delay.
    `boxes` names the parameters on whose boxes the verdict rests: beyond them the data may say
    otherwise.
    """

    value: float
    unit: str
    std: float
    ci95: tuple[float, float]
    reference: float
    start: float
    lower: float
    upper: float
    shrinkage: float
    identifiable: Verdict
    algorithm2: float
    most_likely: float = math.nan
    period: float | None = None
    simulation: float = 0.0
    precision: float = math.nan
    reason: str = ""
    asked: bool = True
    bars: ErrorBars = EVEN
    boxes: tuple[str, ...] = ()

    @property
    def box_end(self) -> float:
        """The end of the campaign's box beyond which the most likely value lies; NaN: in it."""
        slack = SLACK * (self.upper - self.lower)
        if self.period is not None or not self.asked or not math.isfinite(self.likely):
            return math.nan
        if self.likely > self.upper + slack:
            return self.upper
        return self.lower if self.likely < self.lower - slack else math.nan


@dataclass(frozen=True, kw_only=True)
class DerivedResult(_Reported):
    """One derived output: `values` per experiment, `mean` and `spread` (standard deviation).

    `value` is the mean; `reference` the mean at the reference parameters; `box` the range of the
    mean over the box of the parameters: what it could be without any data. `stds` are linearised
    standard deviations of each of the `values`, `halves95` half of their 95 % intervals, at the
    `places` they belong to; all are empty
    where there is but one, NaN where the data leave it open. The rest is as for a
    `ParameterResult`. Where the data leave it open, `value` is only where the search stopped.
    """

    value: float
    unit: str
    values: Floats
    mean: float
    spread: float
    std: float
    ci95: tuple[float, float]
    reference: float
    shrinkage: float
    identifiable: Verdict
    box: tuple[float, float]
    algorithm2: float
    most_likely: float = math.nan
    simulation: float = 0.0
    precision: float = math.nan
    reason: str = ""
    places: tuple[str, ...] = ()
    stds: Floats = ()
    halves95: Floats = ()
    bars: ErrorBars = EVEN
    boxes: tuple[str, ...] = ()

    def text(self) -> str:
        """Value for people; never a value with a small error where the data do not give one."""
        if not self.identifiable.has_value:
            low, high = self.box if math.isnan(self.ci95[0]) else self.ci95
            if math.isnan(low):
                return "has no value at any parameters tried"
            return f"{self.identifiable} by these data ({span(low, high)})"
        if not self.is_most_likely:
            return f"{self.value:.9g} (most likely {self.likely_words})"
        return self.likely_words


@dataclass(frozen=True, kw_only=True)
class OffsetResult(_Reported):
    """A fitted value of one state of the sample, such as its offset from the interpolated drift.

    It belongs to `experiments` (those of one time share it) and is added to `variables`; `prior` is
    the standard deviation it was given (NaN: none). `fitted` is the value of `parameter` itself:
    of a random walk it is the last step, while `value` is all steps together. Both are of the
    reported estimator; `std` and `ci95` are linearised, about the `most_likely` value.
    """

    parameter: str
    experiments: tuple[str, ...]
    variables: tuple[str, ...]
    value: float
    unit: str
    std: float
    ci95: tuple[float, float]
    prior: float
    shrinkage: float
    identifiable: Verdict
    fitted: float
    most_likely: float = math.nan
    simulation: float = 0.0
