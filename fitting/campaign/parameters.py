"""Fitted quantities: what the optimiser may move, and the change of variables it works in."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Generic, TypeVar

import numpy as np

from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.schema import Keys, OneOf, Text

#: A number as it is written, or in the unit of its parameter.
Number = TypeVar("Number")
#: One value for all data, or every experiment has its own.
SCOPES = ("campaign", "experiment")
#: Keys of a parameter that are numbers.
NUMBERS = ("lower", "upper", "start", "reference", "scale", "period", "prior")

#: Width of a uniform distribution in its standard deviations: its variance is (u - l)^2/12.
UNIFORM_WIDTH = math.sqrt(12.0)
#: Ratio of the bounds of a positive parameter from which its box spans decades.
DECADE = 10.0
#: Ratio of a box to the scale of its parameter, or the inverse, beyond which sums lose all digits.
WIDEST = 1e12


@dataclass(frozen=True, kw_only=True)
class ParameterTable(Keys, Generic[Number]):
    """A fitted FMU parameter; ``unit`` belongs to every bare number of the entry.

    Its numbers are as written in a campaign file or given by a program, or, where the campaign
    is bound to an FMU (`Parameter`), numbers in the FMU's unit.
    """

    name: Text
    """A Real parameter of the FMU, the start value of a state, or a coefficient of a law."""
    unit: Text | None = None
    """Of plain numbers in this table; without it the FMU's; of a coefficient none."""
    scope: Annotated[Text, OneOf(SCOPES)] = SCOPES[0]
    """"campaign": one value; "experiment": one for each experiment."""
    lower: Number
    """Lower bound."""
    upper: Number
    """Upper bound."""
    start: Number
    """First start, within the bounds."""
    reference: Number | None = None
    """Centre of Tikhonov term and prior; without it start."""
    scale: Number | None = None
    """Change by 1 of the search vector; without it half the distance of the bounds."""
    period: Number | None = None
    """Values that far apart are equal; reported in [0, period)."""
    prior: Number | None = None
    """Standard deviation of a Gaussian prior about reference."""


def numbers_of(parameter: Any) -> dict[str, Any]:
    """The numbers of a parameter by their keys, as far as there are any.

    Args:
        parameter: bound to the FMU, or as a file or a program has it.
    """
    numbers = {key: getattr(parameter, key) for key in NUMBERS}
    return {key: number for key, number in numbers.items() if number is not None}


@dataclass(frozen=True, kw_only=True)
class Parameter(ParameterTable[float]):
    """One fitted FMU parameter, all numbers in ``unit`` (the FMU's own).

    ``lower <= start <= upper``; ``reference`` is where the Tikhonov term pulls to; ``scale`` is the
    change that counts as one in the search vector; ``period`` makes values that differ by it
    the same system, reported in ``[0, period)``.

    One value holds for the whole campaign, its sweep included, unless ``experiment`` names the one
    experiment that it belongs to (``further``: and others that share it). It is the value of the
    FMU's ``variable`` (the name, where empty), or, with ``adds_to``, is added to those variables.
    ``prior`` is the standard deviation of a Gaussian prior about ``reference``; without it
    only box and Tikhonov term hold the value. ``role`` "coefficient" is no variable of the FMU but
    one of the laws that variables follow, "scale" the logarithm of a factor on the scale. ``least``
    and ``most`` are what the model itself allows, as it declares it: the box states where to look,
    these what there is.

    Raises:
        BadInput: bounds reversed, start outside, a number not finite, scale, period or prior
            not positive.
    """

    unit: str
    reference: float
    scale: float
    experiment: str | None = None
    adds_to: tuple[str, ...] = ()
    variable: str = ""
    further: tuple[str, ...] = ()
    role: str = "model"
    least: float = -math.inf
    most: float = math.inf

    def __post_init__(self) -> None:
        who = f"parameter '{self.name}'"
        for key, value in numbers_of(self).items():
            if not math.isfinite(value):
                raise BadInput(f"{who}: {key} is {value!r}; wanted a finite number")
        if not self.lower < self.upper:
            raise BadInput(
                f"{who}: lower = {self.lower!r} is not below upper = "
                f"{f'{self.upper!r} {self.unit}'.rstrip()}; "
                "wanted lower < upper (are the bounds reversed?)"
            )
        if not self.lower <= self.start <= self.upper:
            raise BadInput(
                f"{who}: start = {self.start!r} lies outside its bounds "
                f"[{self.lower!r}, {self.upper!r}] {self.unit}".rstrip()
            )
        for key in ("scale", "period", "prior"):
            value = getattr(self, key)
            if value is not None and value <= 0.0:
                raise BadInput(f"{who}: {key} = {value!r}; wanted a positive number")
        if not 1.0 / WIDEST <= (self.upper - self.lower) / self.scale <= WIDEST:
            raise BadInput(
                f"{who}: scale = {self.scale!r} for bounds {self.upper - self.lower!r} apart; "
                f"wanted a scale within a factor of {WIDEST:g} of that"
            )
        if self.prior is not None and not 1.0 / WIDEST <= self.prior / self.scale <= WIDEST:
            raise BadInput(
                f"{who}: prior = {self.prior!r} for a scale of {self.scale!r}; "
                f"wanted a prior within a factor of {WIDEST:g} of that"
            )

    @property
    def prior_sigma(self) -> float | None:
        """Standard deviation of its Gaussian prior, in its unit; None: it has none."""
        return self.prior

    @property
    def target(self) -> str:
        """The FMU variable that holds the value (without ``adds_to``)."""
        return self.variable or self.name

    @property
    def is_angle(self) -> bool:
        """Whether it is an angle, with a period stated or not."""
        return self.unit == "rad"

    @property
    def spans_decades(self) -> bool:
        """Whether its box is one of ratios: a positive value that may be ten times larger.

        Never that of an angle: a small one is no ratio of another.
        """
        is_ratio = self.period is None and not self.is_angle
        return is_ratio and spans_decades(self.lower, self.upper)

    def near(self, end: float, share: float) -> float:
        """How far from an end of a range a value is next to it, in its unit.

        A share of the end where the range spans decades: of its width, all but the last decade were
        next to the lower end. Else that share of the width.

        Args:
            end: of a range, in its unit.
            share: that counts as nothing.
        """
        in_decades = self.period is None and spans_decades(self.lower, self.upper)
        return share * (abs(end) if in_decades else self.upper - self.lower)

    @property
    def moves_model(self) -> bool:
        """Whether the model depends on it: a variable of the FMU, or a coefficient of laws."""
        return self.role in ("model", "coefficient")

    @property
    def is_searched(self) -> bool:
        """Whether it is searched for other minima: no nuisance that a prior alone holds.

        A prior of a value that the model depends on may be far wider than the data leave it: two
        of its values may fit alike. Offsets of single experiments and factors on a scale are
        made with a prior as narrow as what they represent.
        """
        return self.prior is None or (self.moves_model and not self.experiments)

    @property
    def experiments(self) -> tuple[str, ...]:
        """Labels of the experiments that it acts in; empty: everywhere, in the sweep too."""
        return () if self.experiment is None else (self.experiment, *self.further)


def spans_decades(low: float, high: float) -> bool:
    """Whether a range is one of ratios: positive, its upper end ten times the lower or more.

    Args:
        low: its lower end.
        high: its upper end.
    """
    return low > 0.0 and high >= DECADE * low


def names(parameters: Sequence[Parameter]) -> tuple[str, ...]:
    """Names in the order of the search vector.

    Args:
        parameters: the fitted parameters.
    """
    return tuple(p.name for p in parameters)


def starts(parameters: Sequence[Parameter]) -> FloatArray:
    """Start values (n,), each in its parameter's unit.

    Args:
        parameters: the fitted parameters.
    """
    return _column(parameters, "start")


def references(parameters: Sequence[Parameter]) -> FloatArray:
    """Reference values (n,), each in its parameter's unit.

    Args:
        parameters: the fitted parameters.
    """
    return _column(parameters, "reference")


def planning_points(parameters: Sequence[Parameter]) -> list[FloatArray]:
    """Values (n,) at which runs are planned: the starts, and the references within the bounds.

    Args:
        parameters: the fitted parameters.
    """
    return [starts(parameters), np.clip(references(parameters), *bounds(parameters))]


def axis_ends(parameters: Sequence[Parameter]) -> list[FloatArray]:
    """The starts with one parameter of the model at an end of its box, (n,) each.

    Args:
        parameters: the fitted parameters.
    """
    result = []
    for i, parameter in enumerate(parameters):
        everywhere = parameter.moves_model and not parameter.experiments
        for end in (parameter.lower, parameter.upper) if everywhere else ():
            point = starts(parameters)
            point[i] = end
            result.append(point)
    return result


def scales(parameters: Sequence[Parameter]) -> FloatArray:
    """Scales (n,), each in its parameter's unit.

    Args:
        parameters: the fitted parameters.
    """
    return _column(parameters, "scale")


def bounds(parameters: Sequence[Parameter]) -> tuple[FloatArray, FloatArray]:
    """Lower and upper bounds, (n,) each, in the parameters' units.

    Args:
        parameters: the fitted parameters.
    """
    return _column(parameters, "lower"), _column(parameters, "upper")


def to_search(parameters: Sequence[Parameter], values: FloatArray) -> FloatArray:
    """Search vector x = (p - reference) / scale; ``values`` (..., n) in the parameters' units.

    Args:
        parameters: the fitted parameters.
        values: values (n,), each in its parameter's unit.
    """
    return np.asarray((values - references(parameters)) / scales(parameters), dtype=float)


def to_model(parameters: Sequence[Parameter], search: FloatArray) -> FloatArray:
    """Values p = reference + scale x, the inverse of :func:`to_search`; ``search`` (..., n).

    Args:
        parameters: the fitted parameters.
        search: search vector (n,).
    """
    return np.asarray(references(parameters) + scales(parameters) * search, dtype=float)


def search_bounds(parameters: Sequence[Parameter]) -> tuple[FloatArray, FloatArray]:
    """The box of :func:`bounds` in search variables, (n,) each.

    Args:
        parameters: the fitted parameters.
    """

    def end(side: str) -> FloatArray:
        return _kept(parameters, f"search {side}", lambda ps: to_search(ps, _column(ps, side)))

    return end("lower"), end("upper")


def in_box(parameters: Sequence[Parameter], search: FloatArray) -> bool:
    """Whether a search vector lies in the box of the campaign: outside it a model may fail.

    Args:
        parameters: the fitted parameters.
        search: search vector (n,).
    """
    lower, upper = search_bounds(parameters)
    return bool(np.all((search >= lower) & (search <= upper)))


def inverse_priors(parameters: Sequence[Parameter], *, drift: bool = False) -> FloatArray:
    """1/sigma in x of the Gaussian priors, (n,); zero where there is none.

    Args:
        parameters: the fitted parameters.
        drift: whether only those count that belong to single experiments.
    """
    return np.array(
        [p.scale / p.prior if p.prior and (p.experiments or not drift) else 0.0 for p in parameters]
    )


def drift_square(parameters: Sequence[Parameter], x: FloatArray) -> float:
    """Chi square by the priors of what differs between experiments.

    Args:
        parameters: the fitted parameters.
        x: search vector (n,).
    """
    return float(np.sum((inverse_priors(parameters, drift=True) * x) ** 2))


def prior_sigmas(parameters: Sequence[Parameter], nu: float = 0.0) -> FloatArray:
    """Standard deviations in x of what is known without data, (n,).

    The box counts as a uniform distribution, so that what the data do not see is left as wide as it
    may be; a Gaussian prior stands in its place; Tikhonov's term is one more of precision nu.

    Args:
        parameters: n of them.
        nu: weight of the Tikhonov term, at least zero.
    """
    lower, upper = search_bounds(parameters)
    widths = upper - lower
    for i, p in enumerate(parameters):
        if p.prior is not None:
            widths[i] = UNIFORM_WIDTH * p.prior / p.scale
    return np.asarray(1.0 / np.sqrt((UNIFORM_WIDTH / widths) ** 2 + nu))


def own_count(parameters: Sequence[Parameter]) -> int:
    """How many parameters belong to single experiments.

    Args:
        parameters: the fitted parameters.
    """
    return sum(bool(p.experiments) for p in parameters)


def canonical(parameters: Sequence[Parameter], values: FloatArray) -> FloatArray:
    """Values (..., n) with every periodic parameter brought into ``[0, period)``.

    Meant for reports: the result may lie outside the box that the optimiser kept to.

    Args:
        parameters: the fitted parameters.
        values: values (n,), each in its parameter's unit.
    """
    reported = np.array(values, dtype=float)
    for i, parameter in enumerate(parameters):
        if parameter.period is not None:
            folded = np.mod(reported[..., i], parameter.period)
            # mod(-1e-17, pi) rounds to pi itself, which is outside the half-open range
            reported[..., i] = np.where(folded >= parameter.period, 0.0, folded)
    return reported


#: Columns of the latest sets of parameters, which are asked for at every evaluation; each by the
#: tuple itself, as hashing a thousand parameters takes longer than reading them.
_columns: dict[int, tuple[Sequence[Parameter], dict[str, FloatArray]]] = {}
_MOST_SETS = 32


def _column(parameters: Sequence[Parameter], field: str) -> FloatArray:
    """One field of all parameters, (n,), the caller's own."""
    return _kept(
        parameters, field, lambda ps: np.array([getattr(p, field) for p in ps], dtype=float)
    )


def _kept(
    parameters: Sequence[Parameter], name: str, make: Callable[[Sequence[Parameter]], FloatArray]
) -> FloatArray:
    """What is made of all parameters, (n,), once for each set of them; the caller's own."""
    if not isinstance(parameters, tuple):
        return make(parameters)
    kept = _columns.get(id(parameters))
    if kept is None or kept[0] is not parameters:
        if len(_columns) >= _MOST_SETS:
            _columns.clear()
        kept = _columns[id(parameters)] = (parameters, {})
    if name not in kept[1]:
        kept[1][name] = make(parameters)
    return kept[1][name].copy()
