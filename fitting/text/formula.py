"""Formulas that people write: arithmetic of numbers and names, read without being run as code.

The grammar is Python's, parsed by its own `ast` and cut down to what a formula needs; a library of
expressions would bring an evaluator of a whole language, and none of them knows units.
"""

from __future__ import annotations

import ast
import keyword
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, did_you_mean, shown
from fitting.text.units import Dimension, dimension_of, product_words

#: Characters of a formula.
LONGEST = 1000
OPERATORS: Mapping[type[ast.operator], Callable[[FloatArray, FloatArray], FloatArray]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
FUNCTIONS: Mapping[str, Callable[[FloatArray], FloatArray]] = {
    "sqrt": np.sqrt,
    "exp": np.exp,
    "log": np.log,
    "cos": np.cos,
    "sin": np.sin,
    "tan": np.tan,
    "acos": np.arccos,
    "asin": np.arcsin,
    "atan": np.arctan,
}
CONSTANTS: Mapping[str, float] = {"pi": float(np.pi)}
#: A part of a formula, as a function of the values of its names.
Worked = Callable[[Mapping[str, Any]], Any]
GRAMMAR = f"numbers, names, pi, + - * / ** and {', '.join(FUNCTIONS)}"


@dataclass(frozen=True)
class Formula:
    """A formula as it was written, ``where`` opens complaints about it.

    Raises:
        BadInput: no formula, or one that holds more than the grammar allows.
    """

    text: str
    where: str

    def __post_init__(self) -> None:
        self._check(self._tree)

    def __reduce__(self) -> tuple[type[Formula], tuple[str, str]]:
        return Formula, (self.text, self.where)  # what is worked out is no more than a memory

    @cached_property
    def _tree(self) -> ast.expr:
        text = self.text.strip()
        if len(text) > LONGEST:
            raise BadInput(f"{self.where}: {len(text)} characters, wanted {LONGEST} at most")
        try:
            return ast.parse(text, mode="eval").body
        except (SyntaxError, ValueError, MemoryError, RecursionError):
            words = (w for w in re.findall(r"[A-Za-z_]\w*", text) if keyword.iskeyword(w))
            if taken := next(words, ""):
                raise BadInput(
                    f"{self.where}: found {shown(text)}, where no name can be '{taken}'; wanted "
                    "another name for it"
                ) from None
            raise BadInput(
                f"{self.where}: found {shown(text)}, wanted a formula of {GRAMMAR}"
            ) from None

    def _check(self, node: ast.expr) -> None:
        match node:
            case ast.Constant(value=int() | float() as value) if type(value) is not bool:
                if not _is_double(value):
                    raise BadInput(
                        f"{self.where}: found {shown(value)}, wanted a number below 1e308"
                    )
            case ast.Name() | ast.Attribute(value=ast.Name() | ast.Attribute()):
                return
            case ast.UnaryOp(op=ast.UAdd() | ast.USub(), operand=inner):
                self._check(inner)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
                self._check(left)
                self._check(right)
            case ast.Call(func=ast.Name(id=name), args=[inner], keywords=[]):
                if name not in FUNCTIONS:
                    hint = did_you_mean(name, list(FUNCTIONS))
                    raise BadInput(f"{self.where}: there is no function '{name}'{hint}")
                self._check(inner)
            case _:
                part = shown(ast.unparse(node))
                raise BadInput(f"{self.where}: found {part}, wanted a formula of {GRAMMAR}")

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names in it, in the order in which they first stand there."""
        found: list[str] = []
        _collect(self._tree, found)
        return tuple(name for name in dict.fromkeys(found) if name not in CONSTANTS)

    def value(self, values: Mapping[str, float | FloatArray]) -> FloatArray:
        """Its value, NaN or infinite where it has none.

        Args:
            values: of all its names, numbers or arrays of one shape.
        """
        with np.errstate(all="ignore"):
            return np.asarray(self._worked_out(values), dtype=float)

    @cached_property
    def _worked_out(self) -> Worked:
        return _worked(self._tree)

    def written_out(self, formulas: Mapping[str, Formula]) -> Formula:
        """The formula in which some names stand for formulas, each in brackets.

        Args:
            formulas: by the names that stand for them; names in these are kept.
        """
        return Formula(ast.unparse(_written_out(self._tree, formulas)), self.where)

    def dimension(self, units: Mapping[str, str]) -> Dimension:
        """Powers of the base dimensions that its value has; an angle counts as a plain number.

        Args:
            units: of all its names.

        Raises:
            BadInput: a sum of unlike things, a function or a power of what has a unit.
        """
        return self._dimension(self._tree, units)

    def unit_words(self, units: Mapping[str, str]) -> str:
        """The unit that its value has, told in those of its names: "Hz²/V".

        Args:
            units: of all its names.
        """
        return _unit_words(self._tree, units)

    def _dimension(self, node: ast.expr, units: Mapping[str, str]) -> Dimension:
        match node:
            case ast.Constant():
                return {}
            case ast.Name() | ast.Attribute():
                name = ast.unparse(node)
                return dimension_of(units[name], where=self.where) if name in units else {}
            case ast.UnaryOp(operand=inner):
                return self._dimension(inner, units)
            case ast.Call(func=ast.Name(id=name), args=[inner]):
                found = self._dimension(inner, units)
                if name == "sqrt":
                    return {key: 0.5 * power for key, power in found.items()}
                self._plain(found, inner, units, f"in {name}(...)")
                return {}
            case ast.BinOp():
                return self._combined(node, units)
        raise TypeError(ast.unparse(node))  # the check lets nothing else pass

    def _combined(self, node: ast.BinOp, units: Mapping[str, str]) -> Dimension:
        one, two = self._dimension(node.left, units), self._dimension(node.right, units)
        if isinstance(node.op, ast.Mult | ast.Div):
            sign = 1.0 if isinstance(node.op, ast.Mult) else -1.0
            powers = {k: one.get(k, 0.0) + sign * two.get(k, 0.0) for k in (*one, *two)}
            return {key: power for key, power in powers.items() if abs(power) > 1e-9}
        if isinstance(node.op, ast.Pow):
            self._plain(two, node.right, units, "as a power")
            return self._power(node, one, units)
        if not alike(one, two):
            raise BadInput(
                f"{self.where}: '{ast.unparse(node)}' adds {_unit_words(node.left, units)} and "
                f"{_unit_words(node.right, units)}; wanted one dimension"
            )
        return one

    def _power(self, node: ast.BinOp, one: Dimension, units: Mapping[str, str]) -> Dimension:
        if not one:
            return {}
        exponent = _exponent(node.right)
        if exponent is None:
            raise BadInput(
                f"{self.where}: '{ast.unparse(node)}' is a power of "
                f"{_unit_words(node.left, units)}; wanted a number as its exponent"
            )
        return {key: exponent * power for key, power in one.items() if exponent != 0.0}

    def _plain(
        self, found: Dimension, node: ast.expr, units: Mapping[str, str], place: str
    ) -> None:
        if found:
            raise BadInput(
                f"{self.where}: '{ast.unparse(node)}' {place} is in {_unit_words(node, units)}; "
                "wanted a plain number there"
            )


def _written_out(node: ast.expr, formulas: Mapping[str, Formula]) -> ast.expr:
    """A part in which names are replaced by the trees of their formulas."""
    match node:
        case ast.Name() | ast.Attribute():
            found = formulas.get(ast.unparse(node))
            return node if found is None else found._tree
        case ast.UnaryOp(op=op, operand=inner):
            return ast.UnaryOp(op=op, operand=_written_out(inner, formulas))
        case ast.Call(func=function, args=[inner]):
            return ast.Call(func=function, args=[_written_out(inner, formulas)], keywords=[])
        case ast.BinOp(left=left, op=op, right=right):
            one, two = _written_out(left, formulas), _written_out(right, formulas)
            return ast.BinOp(left=one, op=op, right=two)
    return node


def _is_double(number: float) -> bool:
    """Whether a number, which may be a whole one of any length, is a finite double."""
    try:
        return bool(np.isfinite(float(number)))
    except OverflowError:
        return False


def alike(one: Dimension, two: Dimension) -> bool:
    """Whether two dimensions are the same.

    Args:
        one: powers of base dimensions.
        two: likewise.
    """
    return all(abs(one.get(k, 0.0) - two.get(k, 0.0)) < 1e-9 for k in (*one, *two))


def _exponent(node: ast.expr) -> float | None:
    """The finite number that an exponent without names is."""
    names: list[str] = []
    _collect(node, names)
    with np.errstate(all="ignore"):
        found = float("nan") if names else float(_worked(node)({}))
    return found if np.isfinite(found) else None


def _unit_words(node: ast.expr, units: Mapping[str, str]) -> str:
    return product_words(_unit_powers(node, units))


def _unit_powers(node: ast.expr, units: Mapping[str, str]) -> dict[str, float]:
    """Powers of the units of names whose product a part's value has, whose dimensions fit."""
    match node:
        case ast.Name() | ast.Attribute():
            name = ast.unparse(node)
            return {units[name]: 1.0} if name in units else {}
        case ast.UnaryOp(operand=inner):
            return _unit_powers(inner, units)
        case ast.Call(func=ast.Name(id="sqrt"), args=[inner]):
            return {unit: 0.5 * power for unit, power in _unit_powers(inner, units).items()}
        case ast.BinOp(left=left, op=ast.Mult() | ast.Div() as op, right=right):
            sign = 1.0 if isinstance(op, ast.Mult) else -1.0
            one, two = _unit_powers(left, units), _unit_powers(right, units)
            return {k: one.get(k, 0.0) + sign * two.get(k, 0.0) for k in (*one, *two)}
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            exponent = _exponent(right) or 0.0
            return {unit: exponent * power for unit, power in _unit_powers(left, units).items()}
        case ast.BinOp(left=left):  # a sum: both have the unit of the first
            return _unit_powers(left, units)
    return {}


def _collect(node: ast.expr, found: list[str]) -> None:
    """Names in a part, the function's own apart."""
    match node:
        case ast.Name() | ast.Attribute():
            found.append(ast.unparse(node))
        case ast.UnaryOp(operand=inner):
            _collect(inner, found)
        case ast.Call(args=[inner]):
            _collect(inner, found)
        case ast.BinOp(left=left, right=right):
            _collect(left, found)
            _collect(right, found)


def _worked(node: ast.expr) -> Worked:
    """A part as a function of the values: made once, because laws are worked out often."""
    match node:
        case ast.Constant(value=int() | float() as number):
            constant = np.float64(number)
            return lambda values: constant
        case ast.Name() | ast.Attribute():
            name = ast.unparse(node)
            if name in CONSTANTS:
                known = np.float64(CONSTANTS[name])
                return lambda values: values.get(name, known)
            return lambda values: np.asarray(values[name], dtype=float)[()]
        case ast.UnaryOp(op=ast.USub(), operand=inner):
            positive = _worked(inner)
            return lambda values: -positive(values)
        case ast.UnaryOp(operand=inner):
            return _worked(inner)
        case ast.Call(func=ast.Name(id=name), args=[inner]):
            function, argument = FUNCTIONS[name], _worked(inner)
            return lambda values: function(argument(values))
        case ast.BinOp(left=left, op=op, right=right):
            combine, one, two = OPERATORS[type(op)], _worked(left), _worked(right)
            return lambda values: combine(one(values), two(values))
    raise TypeError(ast.unparse(node))  # the check lets nothing else pass
