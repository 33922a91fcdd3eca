"""Records that were plain numbers in 0.2.0: they work as such, with a warning, until 0.4."""

from __future__ import annotations

import operator
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

#: What is done with a number, and its function.
OPERATORS: dict[str, Callable[..., Any]] = {
    "__float__": float,
    "__abs__": abs,
    "__neg__": operator.neg,
    "__round__": round,
    "__format__": format,
    "__radd__": lambda here, there: there + here,
    "__rsub__": lambda here, there: there - here,
    "__rmul__": lambda here, there: there * here,
    "__rtruediv__": lambda here, there: there / here,
    "__rpow__": lambda here, there: there**here,
    **{
        f"__{name}__": getattr(operator, name)
        for name in ("add", "sub", "mul", "truediv", "pow", "lt", "le", "gt", "ge")
    },
}


class AsNumber:
    """A record with a ``value`` for which it may stand; type checkers know the record alone."""

    value: float


def _of_value(do: Callable[..., Any]) -> Callable[..., Any]:
    def method(self: AsNumber, *others: Any) -> Any:
        text = "this number has an error now: its '.value' is the number; this goes with 0.4"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        return do(self.value, *others)

    return method


if not TYPE_CHECKING:
    for _name, _do in OPERATORS.items():
        setattr(AsNumber, _name, _of_value(_do))
