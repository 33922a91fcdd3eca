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
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, did_you_mean, shown
from fitting.text.units import Dimension, dimension_of, product_words

#: Characters of a formula.
LONGEST = 10_000
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
#: Their derivatives at x.
SLOPES: Mapping[str, str] = {
    "sqrt": "0.5/sqrt({x})",
    "exp": "exp({x})",
    "log": "1/({x})",
    "cos": "-sin({x})",
    "sin": "cos({x})",
    "tan": "1/cos({x})**2",
    "acos": "-1/sqrt(1 - ({x})**2)",
    "asin": "1/sqrt(1 - ({x})**2)",
    "atan": "1/(1 + ({x})**2)",
}
#: The function of a law and a name in it: the law's derivative, as d(f1, V).
DERIVATIVE = "d"
CONSTANTS: Mapping[str, float] = {"pi": float(np.pi)}
#: A part of a formula, as a function of the values of its names.
Worked = Callable[[Mapping[str, Any]], Any]
GRAMMAR = f"numbers, names, pi, + - * / ** and {', '.join(FUNCTIONS)}"


@dataclass(frozen=True)
class Formula:
    """A formula as it was written, ``where`` opens complaints about it.

    `derivatives`: it may hold d(NAME, NAME), which is written out before it has a value.

    Raises:
        BadInput: no formula, or one that holds more than the grammar allows.
    """

    text: str
    where: str
    derivatives: bool = False

    def __post_init__(self) -> None:
        self._check(self._tree)

    def __reduce__(self) -> tuple[type[Formula], tuple[str, str, bool]]:
        # what is worked out is no more than a memory
        return Formula, (self.text, self.where, self.derivatives)

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
            case ast.Call(func=ast.Name(id=name), args=[one, two], keywords=[]) if (
                name == DERIVATIVE and self.derivatives
            ):
                if not all(isinstance(part, ast.Name | ast.Attribute) for part in (one, two)):
                    part = shown(ast.unparse(node))
                    raise BadInput(f"{self.where}: found {part}, wanted two names in d(...)")
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
        """Names in it, in the order in which they first occur."""
        return tuple(name for name in dict.fromkeys(_names(self._tree)) if name not in CONSTANTS)

    def value(self, values: Mapping[str, float | FloatArray]) -> FloatArray:
        """Its value, NaN or infinite where it has none.

        Args:
            values: of all its names, numbers or arrays of one shape.
        """
        with np.errstate(all="ignore"):
            return np.asarray(self._function(values), dtype=float)

    @cached_property
    def _function(self) -> Worked:
        return _worked(self._tree)

    def written_out(self, formulas: Mapping[str, Formula]) -> Formula:
        """The formula in which formulas replace some names, each in brackets, and d(...).

        Args:
            formulas: by the names that they replace; names in these are kept.

        Raises:
            BadInput: a derivative of what is none of the formulas, or by what that does not hold.
        """
        where = self.where

        class Inserted(ast.NodeTransformer):
            def visit(self, node: ast.AST) -> Any:
                match node:
                    case ast.Name() | ast.Attribute():
                        formula = formulas.get(ast.unparse(node))
                        return node if formula is None else formula._tree
                    case ast.Call(args=[one, two]):
                        of, by = ast.unparse(one), ast.unparse(two)
                        slope = _slope(formulas[of]._tree, by) if of in formulas else ""
                        if not slope:
                            why = f"its law does not hold '{by}'" if of in formulas else "no law"
                            raise BadInput(
                                f"{where}: found d({of}, {by}), where '{of}' follows {why}; "
                                "wanted a law and a name in it"
                            )
                        return ast.parse(slope, mode="eval").body
                    case ast.Call():  # the function's own name is none of the formula's
                        node.args = [self.visit(inner) for inner in node.args]
                        return node
                return self.generic_visit(node)

        return Formula(ast.unparse(Inserted().visit(deepcopy(self._tree))), self.where)

    def dimension(self, units: Mapping[str, str]) -> Dimension:
        """Powers of the base dimensions that its value has; an angle counts as a plain number.

        Args:
            units: of all its names.

        Raises:
            BadInput: a sum of unlike things, a function or a power of what has a unit.
        """
        return self._dimension(self._units(self._tree, units))

    def unit_words(self, units: Mapping[str, str]) -> str:
        """The unit that its value has, in those of its names: "Hz²/V".

        Args:
            units: of all its names.

        Raises:
            BadInput: as `dimension`.
        """
        return product_words(self._units(self._tree, units))

    def _dimension(self, powers: Mapping[str, float]) -> Dimension:
        """Of a product of powers of units."""
        total: dict[str, float] = {}
        for unit, power in powers.items():
            for name, one in dimension_of(unit, where=self.where).items():
                total[name] = total.get(name, 0.0) + power * one
        return {name: power for name, power in total.items() if abs(power) > 1e-9}

    def _units(self, node: ast.expr, units: Mapping[str, str]) -> dict[str, float]:
        """Powers of the units of names whose product a part's value has."""

        def plain(part: ast.expr, place: str) -> None:
            powers = self._units(part, units)
            if self._dimension(powers):
                raise BadInput(
                    f"{self.where}: '{ast.unparse(part)}' {place} is in {product_words(powers)}; "
                    "wanted a plain number there"
                )

        match node:
            case ast.Name() | ast.Attribute():
                name = ast.unparse(node)
                return {units[name]: 1.0} if name in units else {}
            case ast.UnaryOp(operand=inner):
                return self._units(inner, units)
            case ast.Call(func=ast.Name(id="sqrt"), args=[inner]):
                return {unit: 0.5 * power for unit, power in self._units(inner, units).items()}
            case ast.Call(func=ast.Name(id=name), args=[inner]):
                plain(inner, f"in {name}(...)")
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                one = self._units(left, units)
                plain(right, "as a power")
                exponent = None
                if not _names(right):  # a number, which may have no value
                    with np.errstate(all="ignore"):
                        value = float(_worked(right)({}))
                    exponent = value if np.isfinite(value) else None
                if exponent is None and self._dimension(one):
                    raise BadInput(
                        f"{self.where}: '{ast.unparse(node)}' is a power of {product_words(one)}; "
                        "wanted a number as its exponent"
                    )
                return {unit: (exponent or 0.0) * power for unit, power in one.items()}
            case ast.BinOp(left=left, op=op, right=right):
                one, two = self._units(left, units), self._units(right, units)
                if isinstance(op, ast.Mult | ast.Div):
                    sign = 1.0 if isinstance(op, ast.Mult) else -1.0
                    return {k: one.get(k, 0.0) + sign * two.get(k, 0.0) for k in (*one, *two)}
                if not alike(self._dimension(one), self._dimension(two)):
                    raise BadInput(
                        f"{self.where}: '{ast.unparse(node)}' adds {product_words(one)} and "
                        f"{product_words(two)}; wanted one dimension"
                    )
                return one
        return {}


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


def _names(node: ast.AST) -> list[str]:
    """Names in a part, those of functions apart."""
    if isinstance(node, ast.Name | ast.Attribute):
        return [ast.unparse(node)]
    inner = node.args if isinstance(node, ast.Call) else ast.iter_child_nodes(node)
    return [name for part in inner for name in _names(part)]


def _slope(node: ast.expr, name: str) -> str:
    """The derivative of a part by a name, written out; empty where it is zero everywhere."""
    if name not in _names(node):
        return ""
    match node:
        case ast.UnaryOp(op=op, operand=inner):
            sign = "-" if isinstance(op, ast.USub) else ""
            return f"{sign}({_slope(inner, name)})"
        case ast.Call(func=ast.Name(id=function), args=[inner]):
            outer = SLOPES[function].format(x=ast.unparse(inner))
            return f"({outer})*({_slope(inner, name)})"
        case ast.BinOp(left=left, op=op, right=right):
            one, two = f"({ast.unparse(left)})", f"({ast.unparse(right)})"
            first, second = _slope(left, name), _slope(right, name)
            # of left and of right, with what is beside each
            match op:
                case ast.Mult():
                    parts = f"({first})*{two}", f"({second})*{one}"
                case ast.Div():
                    parts = f"({first})/{two}", f"-({second})*{one}/{two}**2"
                case ast.Pow():
                    parts = (
                        f"({first})*{two}*{one}**({two} - 1)",
                        f"({second})*log({one})*{one}**{two}",
                    )
                case _:
                    parts = f"({first})", f"{'-' if isinstance(op, ast.Sub) else ''}({second})"
            kept = zip(parts, (first, second), strict=True)
            return " + ".join(part for part, slope in kept if slope)
    return "1"


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
