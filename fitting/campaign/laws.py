"""Laws: variables of the FMU that follow formulas of control quantities, with coefficients to fit.

    [laws]
    f1 = "a0 + a1*V + a2*V**2"        a0, a1, a2: [[parameters]];  V: a control quantity

A law names parameters (its coefficients, or variables of the FMU that are fitted), constants, and
control quantities: whatever else places of measurements set, be it a variable of the FMU or not.
What another law determines is that law, and d(f1, V) the derivative of the law of f1 by V.
It is worked out in SI base units, so that every number may be written in its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from fitting.text.arguments import checked
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, FmuFailure, did_you_mean, gathered
from fitting.text.finding import Finding, Kind, note
from fitting.text.formula import Formula, alike
from fitting.text.units import Written, as_written, dimension_of, parse_quantity, to_base

#: Answers of laws that are kept.
REMEMBERED = 4096
#: Label and settings of something that was measured.
Place = tuple[str, Mapping[str, Scalar]]


def in_base(unit: str, where: str) -> tuple[float, float]:
    """Factor and offset: a number x of the unit is factor x + offset in SI base units.

    Args:
        unit: that exists; empty: none is declared, numbers stay as they are.
        where: what opens errors.

    Raises:
        BadInput: there is no such unit, or it is a logarithmic one.
    """
    if not unit:
        return 1.0, 0.0
    offset = to_base(0.0, unit, where=where)
    return to_base(1.0, unit, where=where) - offset, offset


@dataclass(frozen=True)
class Law:
    """A formula that a variable of the FMU, ``target``, follows.

    ``units`` are those of all its names, ``constants`` the values of those that are constant;
    ``unit`` is that of the target, empty where the FMU declares none: then no dimension is wrong.
    ``text`` is the formula as it was written, other laws by their names.

    Raises:
        BadInput: it names nothing, or its dimension is not that of the target.
    """

    target: str
    formula: Formula
    _: KW_ONLY
    text: str
    units: Mapping[str, str]
    constants: Mapping[str, float] = field(default_factory=dict)
    unit: str = ""
    scales: Mapping[str, tuple[float, float]] = field(init=False, repr=False, compare=False)
    result: tuple[float, float] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        where = self.formula.where
        result = self.formula.dimension(self.units)
        if self.unit and not alike(result, dimension_of(self.unit, where=where)):
            raise BadInput(
                f"{where}: '{self.text}' is {_in(self.formula.unit_words(self.units))}, "
                f"wanted {self.unit}, the unit of '{self.target}'"
            )
        scales = {name: in_base(unit, where) for name, unit in self.units.items()}
        object.__setattr__(self, "scales", scales)
        object.__setattr__(self, "result", in_base(self.unit, where))

    @property
    def needed(self) -> tuple[str, ...]:
        """Names that have to be given a value."""
        return tuple(name for name in self.formula.names if name not in self.constants)

    def value(self, values: Mapping[str, Scalar]) -> float:
        """The target's value in its unit; NaN or infinite where the formula has none.

        Args:
            values: of all names that are not constant, in their units.
        """
        given, base = {**values, **self.constants}, {}
        for name in self.formula.names:
            factor, offset = self.scales[name]
            base[name] = float(given[name]) * factor + offset
        factor, offset = self.result
        return (float(self.formula.value(base)) - offset) / factor

    @property
    def note(self) -> Finding:
        """The law, its constants, and its unit where the dimension could not be checked."""
        constants = (
            f"{name} = {value:g} {'' if self.units[name] == '1' else self.units[name]}".rstrip()
            for name, value in self.constants.items()
        )
        checked = self.unit or not self.formula.dimension(self.units)
        names = {
            "formula": (self.text,),
            "constants": tuple(constants),
            "unchecked": () if checked else (self.formula.unit_words(self.units),),
        }
        return note(Kind.law_followed, self.target, names)


@checked
@dataclass(frozen=True)
class Laws:
    """Formulas that variables of the FMU follow, of parameters, constants and control quantities.

        ff.Laws({"f1": "a0 + a1*V", "f2": "b0"})

    Args:
        formulas: By variable: numbers, names, pi, + - * / ** and sqrt, exp, log, cos, sin, tan,
            acos, asin, atan; a variable that follows another law, and d(f1, V), the derivative
            of the law of f1 by V.
        constants: Numbers that formulas name: plain, or with a unit as "1 H".
        source: Their name in errors.
        bound: The same with all units, next to an FMU.
        controls: Units of the control quantities that are no variable of the FMU.

    Raises:
        BadInput: what is no formula, a formula that names nothing, laws that name each other, a
            constant that is no number or that no formula names.
    """

    formulas: Mapping[str, str] = field(default_factory=dict)
    constants: Mapping[str, float | str | Written] = field(default_factory=dict)
    _: KW_ONLY
    source: str = "laws:"
    bound: tuple[Law, ...] = ()
    controls: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        readers: list[Callable[[], object]] = []
        readers += [partial(self._check_formula, name) for name in self.formulas]
        readers += [partial(_number, n, value, self.source) for n, value in self.constants.items()]
        gathered(readers)
        _ = self.parsed  # laws that name each other
        for name in self.numbers:
            if name not in self.names:
                hint = did_you_mean(name, sorted(self.names))
                raise BadInput(f"{self.source} the constant '{name}' is named by no law{hint}")

    def _check_formula(self, name: str) -> None:
        formula = Formula(self.formulas[name], f"{self.source} {name}", derivatives=True)
        if not formula.names:
            raise BadInput(
                f"{formula.where}: '{formula.text}' names nothing; wanted a parameter or a "
                f"control quantity in it (fixed values of '{name}' are start values)"
            )

    @cached_property
    def parsed(self) -> dict[str, Formula]:
        """Formulas by the FMU's variables; what one names of another is written out."""
        written = {
            name: Formula(text, f"{self.source} {name}", derivatives=True)
            for name, text in self.formulas.items()
        }
        known: dict[str, Formula] = {}

        def resolved(name: str, above: tuple[str, ...]) -> Formula:
            formula = written[name]
            if name in above:
                chain = " -> ".join((*above[above.index(name) :], name))
                raise BadInput(f"{formula.where}: laws name each other ({chain}); wanted an end")
            if name not in known:
                others = [other for other in formula.names if other in written and other != name]
                laws = {other: resolved(other, (*above, name)) for other in others}
                known[name] = formula.written_out(laws)
            return known[name]

        return {name: resolved(name, ()) for name in written}

    @cached_property
    def _remembered(self) -> dict[tuple[Scalar | None, ...], dict[str, float]]:
        """Values of laws, by the values of all names: answers to equal questions, no state."""
        return {}

    @cached_property
    def names(self) -> frozenset[str]:
        """All names in them."""
        return frozenset(name for formula in self.parsed.values() for name in formula.names)

    @cached_property
    def numbers(self) -> dict[str, tuple[float, str]]:
        """Constants by name: a number and its unit, "1" for a plain number."""
        return {name: _number(name, value, self.source) for name, value in self.constants.items()}

    def with_units(
        self,
        targets: Mapping[str, str],
        *,
        parameters: Mapping[str, str],
        variables: Mapping[str, str],
        controls: Mapping[str, str],
    ) -> Laws:
        """The same, bound to an FMU.

        Args:
            targets: units of the FMU's variables that follow a law, empty where it declares none.
            parameters: units of coefficients and fitted variables, which names can represent.
            variables: units of variables of the FMU that measurements or start values set.
            controls: units of quantities that no variable holds.

        Raises:
            BadInput: a name that represents nothing, a dimension that is not the target's.
        """
        units = {**variables, **controls, **parameters}
        kinds = {"a parameter": parameters, "a control quantity": controls}
        for name in self.numbers:
            if name in units:
                what = (kind for kind, names in kinds.items() if name in names)
                raise BadInput(
                    f"{self.source} the constant '{name}' is also "
                    f"{next(what, 'a variable of the FMU')}; wanted another name for one of them"
                )
        units |= {name: unit for name, (_, unit) in self.numbers.items()}
        for formula in self.parsed.values():
            for name in formula.names:
                if name not in units:
                    raise BadInput(
                        f"{formula.where}: '{name}' is neither a parameter nor a constant, and no "
                        f"measurement sets it{did_you_mean(name, sorted(units))}"
                    )
        bound = tuple(
            Law(
                target,
                formula,
                text=self.formulas[target],
                units={name: units[name] for name in formula.names},
                constants={n: self.numbers[n][0] for n in formula.names if n in self.numbers},
                unit=targets[target],
            )
            for target, formula in self.parsed.items()
        )
        return replace(self, bound=bound, controls=controls)

    def applied(
        self, values: Mapping[str, Scalar], coefficients: Mapping[str, float]
    ) -> dict[str, Scalar]:
        """Start values with those that laws determine, without the control quantities.

        Args:
            values: of the FMU's variables and of control quantities, by name.
            coefficients: parameters that are no variables of the FMU, by name.

        Raises:
            BadInput: a control quantity has no value there.
            FmuFailure: a law has no finite value there: so the model has none.
        """
        if not self.bound:
            return dict(values)
        known = {**values, **coefficients}
        # every tone of a curve asks for the same again
        key = tuple(known.get(name) for name in sorted(self.names))
        result = self._remembered.get(key)
        if result is None:
            result = {law.target: _finite(law, known) for law in self.bound}
            if len(self._remembered) >= REMEMBERED:
                self._remembered.clear()
            self._remembered[key] = result
        kept = {name: value for name, value in values.items() if name not in self.controls}
        return {**kept, **result}

    def check(self, places: Iterable[Place], starts: Mapping[str, float]) -> None:
        """Every law has a finite value at every place, and every control quantity more than one.

        Args:
            places: what complaints name a measurement by, and its settings.
            starts: start values of the parameters by name.

        Raises:
            BadInput: a control quantity that is not set at a place, or the same at all; a law that
                has no finite value.
        """
        known = list(places)
        for place, settings in known:
            try:
                self.applied(settings, starts)
            except (BadInput, FmuFailure) as error:
                raise BadInput(f"{error} ({place})") from error
        for name, unit in self.controls.items():
            values = [float(settings[name]) for _, settings in known if name in settings]
            users = [law for law in self.bound if name in law.formula.names]
            if users and len(set(values)) == 1:
                raise BadInput(
                    f"{users[0].formula.where}: the control quantity '{name}' is {values[0]:g} "
                    f"{unit} everywhere; wanted two values or more, or a constant"
                )


def _number(name: str, value: float | str | Written, source: str) -> tuple[float, str]:
    written = value if isinstance(value, Written) else as_written(value, f"{source} {name}")
    result, unit = written.value, written.unit
    if isinstance(result, str):
        result, unit = parse_quantity(result, where=written.where)
    if isinstance(result, bool):
        raise BadInput(f"{written.where}: found {result!r}, wanted a number")
    return float(result), unit or "1"


def _finite(law: Law, known: Mapping[str, Scalar]) -> float:
    for name in law.needed:
        if name not in known:
            raise BadInput(
                f"{law.formula.where}: names '{name}', which has no value there; wanted a "
                "parameter, a constant or a control quantity that every measurement sets"
            )
    value = law.value(known)
    if not np.isfinite(value):
        given = {
            f"{name} ({law.units[name]})".removesuffix(" (1)"): float(known[name])
            for name in law.needed
        }
        text = f"'{law.text}' has no finite value"
        raise FmuFailure(text, given, Path(law.formula.where))
    return value


def _in(words: str) -> str:
    return words if words == "a plain number" else f"in {words}"
