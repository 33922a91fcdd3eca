"""A value with its uncertainty: one record for parameters, outputs, lines and posteriors.

A status measures the data. It follows from where chi square closes the 95 % interval of a value,
not from the bounds within which the fit was made.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, fields, replace
from enum import EnumType, StrEnum
from typing import TYPE_CHECKING, Any, Literal, Self

from fitting.text.notation import joint_prefix, listed, quantity, span, uneven_quantity
from fitting.text.old_names import OldNames

Interval = tuple[float, float]
Floats = tuple[float, ...]
NOWHERE: Interval = (math.nan, math.nan)
#: Share of a period from which an interval is all of it: ends are counted in other units.
ALL_ROUND = 1.0 - 1e-9
#: What a value is of.
Role = Literal["parameter", "derived", "offset"]
#: What files hold of a plain value; the rest only where it is not the default.
PLAIN = ("name", "value", "unit", "std", "ci95", "status")
#: How errors and intervals were determined.
Method = Literal["covariance", "linearised, verified", "profile", "posterior", "bootstrap"]
#: What closes a side of an interval: chi square of the data, priors of what drifts, a bound of the
#: value or of another parameter, or its period; empty where the search ended before any of these.
Closed = Literal["data", "prior", "bound", "periodic", ""]
#: Fields of `FittedEstimate` that are in its unit, besides intervals and the period.
SCALED = ("value", "std", "most_likely", "algorithm2", "simulation", "reference", "lower", "upper")
#: The status that 0.2.0 had for `Verdict.UNCONSTRAINED`.
OLD_STATUS = "not determined"

#: Normal deviate within which 95 % lie.
ROOT_95 = 1.959964

#: Ratio of the sides from which each has a number of its own: either is 11 % off their mean.
UNEQUAL = 1.25
#: Ratio of a side at 95 % to 1.96 times that at 68 %, or its inverse, from which ± does not tell
#: the 95 % interval. Student's t reaches it at two degrees of freedom.
MISLEADING = 1.5


@dataclass(frozen=True, kw_only=True)
class ErrorBars:
    """How far the 68 % interval goes `below` and `above` the most likely value, and what ± means.

    `is_even`: half of the interval is taken for both sides; `covers95`: 1.96 times the sides is the
    95 % interval, near enough. Without a profile the sides are NaN, and both hold.
    """

    below: float = math.nan
    above: float = math.nan
    is_even: bool = True
    covers95: bool = True

    def words(self, value: float, std: float, unit: str, interval95: Interval) -> str:
        """A value with its error, "5.2 ± 0.3 Hz" or "235 +128 −89 Hz (146 to 363 Hz at 95 %)".

        Args:
            value: the most likely one.
            std: half of the 68 % interval, in the same unit.
            unit: of the values.
            interval95: the 95 % interval, which is printed where it does not follow from the error.
        """
        sides = (self.below, self.above)
        shown = quantity(value, std, unit) if self.is_even else uneven_quantity(value, sides, unit)
        if self.covers95:
            return shown
        factor, prefixed = joint_prefix(value, std if self.is_even else min(sides), unit)
        low, high = (end / factor for end in interval95)
        return f"{shown} ({span(low, high, prefixed)}\u00a0at\u00a095\u00a0%)"


#: Of a value without a profile: its error is linearised, and ± is all that it tells.
EVEN = ErrorBars()


def error_bars(value: float, ci68: Interval, ci95: Interval, simulation: float) -> ErrorBars:
    """The sides of a 68 % interval, and whether ± holds for them and the 95 % interval.

    How far the simulation's own error lengthens both intervals by as much is taken off before
    they are compared.

    Args:
        value: the most likely one.
        ci68: its 68 % interval; NaN where there is none.
        ci95: its 95 % interval.
        simulation: how far the simulation's own error moves it, at most.
    """
    below, above = _sides(value, ci68)
    if not (below > 0.0 and above > 0.0):
        return EVEN
    wide = _sides(value, ci95)
    moved = min(simulation, 0.99 * min(below, above))
    ratios = [
        (far - moved) / (ROOT_95 * (near - moved))
        for near, far in zip((below, above), wide, strict=True)
    ]
    return ErrorBars(
        below=below,
        above=above,
        is_even=max(below, above) < UNEQUAL * min(below, above),
        covers95=all(1.0 < MISLEADING * r < MISLEADING**2 for r in ratios),
    )


def _sides(best: float, interval: Interval) -> tuple[float, float]:
    return best - interval[0], interval[1] - best


def _warn_of_status(old: str) -> None:
    text = f"{old} is 'unconstrained' now; the old name goes with 0.4"
    warnings.warn(text, DeprecationWarning, stacklevel=3)


class _OldMember(EnumType):
    """The member's name of 0.2.0 works with a warning until 0.4."""

    if not TYPE_CHECKING:  # a type checker knows the names of now alone

        def __getattr__(cls, name: str) -> Any:
            if name != "OPEN":
                raise AttributeError(name)
            _warn_of_status("Verdict.OPEN")
            return cls.UNCONSTRAINED


class Verdict(StrEnum, metaclass=_OldMember):
    """How far data determine a value."""

    #: Both ends of the interval are cut by the data, and it is narrow for such a value.
    DETERMINED = "determined"
    #: Both ends are cut by the data, but they are far apart.
    BOUNDED = "bounded on both sides"
    #: The data cut the upper end alone.
    ABOVE = "bounded above"
    #: The data cut the lower end alone.
    BELOW = "bounded below"
    #: Separate values fit as well: an exchange, another minimum.
    SEVERAL = "one of several values"
    #: The data cut neither end.
    UNCONSTRAINED = "unconstrained"
    #: The search was cut or lost, or there is nothing to check the model by.
    UNKNOWN = "not known"
    #: The model does not describe the data.
    WITHDRAWN = "no verdict"
    #: No profile was scanned: the errors are those of the problem linearised at its solution.
    LINEARISED = "linearised only"

    @classmethod
    def _missing_(cls, value: object) -> Verdict | None:
        return (
            cls.UNCONSTRAINED if value == OLD_STATUS else None
        )  # of files that were written before

    def __eq__(self, other: object) -> bool:
        if type(other) is str and other == OLD_STATUS:
            _warn_of_status(repr(other))
            return self is Verdict.UNCONSTRAINED
        return str.__eq__(self, other) is True

    def __ne__(self, other: object) -> bool:
        return not self == other

    __hash__ = str.__hash__

    @property
    def has_value(self) -> bool:
        """Whether there is a value to report; else there is a range at most."""
        return self in (Verdict.DETERMINED, Verdict.BOUNDED, Verdict.SEVERAL, Verdict.LINEARISED)

    @property
    def is_open(self) -> bool:
        """Whether the data leave a value open on at least one side, or nothing is known of it."""
        return not self.has_value


@dataclass(frozen=True, kw_only=True)
class Estimate(OldNames):
    """One value with its uncertainty, in ``unit``.

    Args:
        name: of the value.
        value: the best one.
        std: standard deviation; of a profile half of the 68 % interval. NaN: no value by
            ``status``.
        ci68, ci95: intervals; NaN: none.
        status: how far the data determine it.
        method: of errors and intervals.
        closed_by: what closes each side of ``ci95``; empty without a profile.
        active_bounds: parameters on whose bounds ``status`` depends.
    """

    name: str
    value: float
    unit: str
    std: float = math.nan
    ci68: Interval = NOWHERE
    ci95: Interval = NOWHERE
    status: Verdict = Verdict.LINEARISED
    method: Method = "covariance"
    closed_by: tuple[Closed, Closed] = ("", "")
    active_bounds: tuple[str, ...] = ()

    @property
    def stored_fields(self) -> tuple[str, ...]:
        """Fields that files hold: of a plain value most are at their defaults."""
        return tuple(
            each.name
            for each in fields(self)
            if each.name in PLAIN or getattr(self, each.name) not in (each.default,)
        )

    @property
    def condition(self) -> str:
        """What the status holds under: " within the bounds of d1"; mostly empty."""
        return f" within the bounds of {listed(self.active_bounds)}" if self.active_bounds else ""


@dataclass(frozen=True, kw_only=True)
class FittedEstimate(Estimate):
    """A value of a fit.

    Args:
        role: "parameter" of the campaign, "derived" output, "offset" of single experiments.
        value: the most likely one, or the requested end of Algorithm 2; periodic ones in [0,
            period).
        reason: of the status.
        most_likely, algorithm2: by either estimator; errors belong to the former.
        shrinkage: share of the variance that comes from the data.
        simulation: largest shift by errors of the simulation, included in ``std`` and intervals.
        reference: of a parameter; of an output its mean there.
        lower, upper: bounds of a parameter, range of an output within them.
        period: by which equal values differ; None: none.
    """

    role: Role
    reason: str = ""
    most_likely: float = math.nan
    algorithm2: float = math.nan
    shrinkage: float = math.nan
    simulation: float = 0.0
    reference: float = math.nan
    lower: float = math.nan
    upper: float = math.nan
    period: float | None = None

    @property
    def stored_fields(self) -> tuple[str, ...]:
        """Fields that files hold: all of them."""
        return tuple(each.name for each in fields(self))

    @property
    def bounds(self) -> Interval:
        """Bounds of a parameter, range of an output over them: what it may be without any data."""
        return self.lower, self.upper

    @property
    def bars(self) -> ErrorBars:
        """What is printed next to the value: ± or both sides."""
        if not self.status.has_value:
            return EVEN
        return error_bars(self.likely, self.ci68, self.ci95, self.simulation)

    @property
    def precision(self) -> float:
        """Half of the 95 % interval over the value, or its period; NaN if not closed by data."""
        if self.closed_by != ("data", "data"):
            return math.nan
        half = 0.5 * (self.ci95[1] - self.ci95[0])
        if self.period is not None:
            return half / self.period
        return half / abs(self.likely) if self.likely else math.inf

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
        if self.closed_by[0] == "periodic":
            return True
        return self.period is not None and high - low >= ALL_ROUND * self.period

    @property
    def is_outside(self) -> bool:
        """Whether the reported value lies outside the 95 % interval, which is the likelihood's."""
        low, high = self.ci95
        turns = (0.0,) if self.period is None else (-self.period, 0.0, self.period)
        return not self.is_most_likely and all(
            self.value + turn < low or self.value + turn > high for turn in turns
        )

    def in_unit(self, unit: str, factor: float) -> Self:
        """The value in another unit.

        Args:
            unit: the other one.
            factor: that leads to it, positive.
        """
        scaled: dict[str, Any] = {name: factor * getattr(self, name) for name in SCALED}
        for name in ("ci68", "ci95"):
            low, high = getattr(self, name)
            scaled[name] = factor * low, factor * high
        period = None if self.period is None else factor * self.period
        return replace(self, unit=unit, period=period, **scaled)

    def withdrawn(self, why: str) -> Self:
        """The value of a model that does not describe the data: its intervals are of nothing.

        Args:
            why: there is no verdict.
        """
        return replace(
            self,
            std=math.nan,
            ci68=NOWHERE,
            ci95=NOWHERE,
            shrinkage=math.nan if self.method == "profile" else self.shrinkage,
            status=Verdict.WITHDRAWN,
            reason=why,
            active_bounds=(),
        )


@dataclass(frozen=True, kw_only=True)
class ParameterEstimate(FittedEstimate):
    """A parameter that was fitted.

    Args:
        start: of the search.
        asked: whether the campaign names it; else the measurement adds it, as a cable's delay.
    """

    role: Role = "parameter"
    start: float = math.nan
    asked: bool = True


@dataclass(frozen=True, kw_only=True)
class OutputEstimate(FittedEstimate):
    """A derived output: its ``value`` is the mean over the experiments.

    Args:
        values: per experiment, with standard deviation ``spread``.
        places: labels of ``values`` with linearised ``stds`` and half 95 % intervals ``halves95``;
            empty for a single one, NaN: undetermined.
    """

    role: Role = "derived"
    values: Floats = ()
    spread: float = 0.0
    places: tuple[str, ...] = ()
    stds: Floats = ()
    halves95: Floats = ()

    def withdrawn(self, why: str) -> Self:
        """The output of a model that does not describe the data, without errors at its places.

        Args:
            why: there is no verdict.
        """
        nothing = (math.nan,) * len(self.stds)
        return replace(super().withdrawn(why), stds=nothing, halves95=nothing)


@dataclass(frozen=True, kw_only=True)
class OffsetEstimate(FittedEstimate):
    """A value of single experiments: all steps of a random walk together.

    Args:
        prior: its standard deviation; NaN: none.
        fitted: value of its own parameter, the last step of a walk.
        experiments, variables: to which it applies.
    """

    role: Role = "offset"
    prior: float = math.nan
    fitted: float = math.nan
    experiments: tuple[str, ...] = ()
    variables: tuple[str, ...] = ()
