"""Names and kinds of values of 0.2.0: they work, with a warning, until 0.4, when this file goes."""

from __future__ import annotations

import operator
import warnings
from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar, cast

Called = TypeVar("Called", bound=Callable[..., Any])

#: Ends of an interval.
SIDES = ("low", "high")
#: Attributes of values, and those of now.
RENAMED = {
    "identifiable": "status",
    "boxes": "active_bounds",
    "box": "bounds",
    "mean": "value",
    "median": "value",
    "parameter": "name",
    "kind": "role",
    "verdict": "status",
    "best": "likely",
    "interval68": "ci68",
    "interval95": "ci95",
    "ends": "closed_by",
    "range": "bounds",
    "stopped_at": "likely",
    "profile": "scan",
    "delta": "delta_chi2",
    **{f"{side}{level}": f"ci{level} {side}" for level in (68, 95) for side in SIDES},
}


class OldNames:
    """A record whose attributes of 0.2.0 work with a warning."""

    if not TYPE_CHECKING:  # a type checker knows the names of now alone

        def __getattr__(self, name: str) -> Any:
            now, _, side = RENAMED.get(name, "").partition(" ")
            if not hasattr(type(self), now) and now not in vars(self):
                raise AttributeError(f"'{type(self).__name__}' has no '{name}'")
            text = f"'{name}' of a value is '{now}' now; the old name goes with 0.4"
            warnings.warn(text, DeprecationWarning, stacklevel=2)
            result = getattr(self, now)
            return result[SIDES.index(side)] if side else result


class AsNumber:
    """A record with a ``value`` that was a plain number; type checkers know the record alone."""

    value: float


def _of_value(do: Callable[..., Any]) -> Callable[..., Any]:
    def method(self: AsNumber, *others: Any) -> Any:
        text = "this number has an error now: its '.value' is the number; this goes with 0.4"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        return do(self.value, *others)

    return method


def _reflected(do: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    return lambda here, there: do(there, here)


if not TYPE_CHECKING:
    for _do in (float, abs, round, format):
        setattr(AsNumber, f"__{_do.__name__}__", _of_value(_do))
    for _name in ("neg", "lt", "le", "gt", "ge"):
        setattr(AsNumber, f"__{_name}__", _of_value(getattr(operator, _name)))
    for _name in ("add", "sub", "mul", "truediv", "pow"):
        _do = getattr(operator, _name)
        setattr(AsNumber, f"__{_name}__", _of_value(_do))
        setattr(AsNumber, f"__r{_name}__", _of_value(_reflected(_do)))


def renamed(called: Called) -> Called:
    """A public function whose first argument was ``found``: the name works.

    Args:
        called: with ``result`` in its place.
    """

    @wraps(called)
    def call(*args: Any, **kwargs: Any) -> Any:
        if "found" in kwargs:
            text = f"{called.__name__}: 'found' is 'result' now; the old name goes with 0.4"
            warnings.warn(text, DeprecationWarning, stacklevel=2)
            kwargs["result"] = kwargs.pop("found")
        return called(*args, **kwargs)

    return cast("Called", call)
