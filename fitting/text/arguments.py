"""Arguments of what people call: what a type hint does not allow is an error of one line.

Only what a hint surely excludes is refused, as text for a number. Whether arrays hold numbers, and
what lies between them, is for whoever takes them.
"""

from __future__ import annotations

import inspect
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, wraps
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fitting.text.arrays import is_real, is_whole
from fitting.text.errors import BadInput, shown

Called = TypeVar("Called")
#: Whether a value fits a hint, and what the hint is called in a sentence.
Rule = tuple[Callable[[Any], bool], str]
UNIONS = (typing.Union, types.UnionType)
#: Values that are repeated in a complaint as they are; of others it names the class.
SHOWN = (str, bytes, int, float, list, tuple, dict, types.NoneType)


def _is_number(value: Any) -> bool:
    try:
        return is_real(value) and isinstance(float(value), float)
    except OverflowError:
        return False


PLAIN: Mapping[Any, Rule] = {
    float: (_is_number, "a number"),
    int: (is_whole, "a whole number"),
    bool: (lambda value: isinstance(value, bool | np.bool_), "True or False"),
    str: (lambda value: isinstance(value, str), "text"),
    Path: (lambda value: isinstance(value, str | PathLike), "a path"),
    types.NoneType: (lambda value: value is None, "None"),
}


def checked(called: Called) -> Called:
    """A function, or a class by its ``__init__``, whose arguments are held against its hints.

    Args:
        called: function or class; a class stays the same object.
    """
    if isinstance(called, type):
        called.__init__ = _checking(called.__init__, called)  # type: ignore[misc]
        return called
    function = typing.cast("Callable[..., Any]", called)
    return typing.cast("Called", _checking(function, function))


def _checking(function: Callable[..., Any], hinted: Callable[..., Any]) -> Callable[..., Any]:
    signature = inspect.signature(function)

    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        given = signature.bind(*args, **kwargs).arguments  # TypeError: missing, unknown, too many
        hints = _hints(hinted)
        for key, value in given.items():
            fits, wanted = _rule(hints[key]) if key in hints else (None, "")
            if fits is not None and not fits(value):
                what = shown(value) if isinstance(value, SHOWN) else f"a {type(value).__name__}"
                raise BadInput(f"{hinted.__name__}: {key} is {what}, wanted {wanted}")
        return function(*args, **kwargs)

    return call


@cache  # of two threads each finds the same
def _hints(called: Callable[..., Any]) -> dict[str, Any]:
    """Hints of parameters that are one value each; of a record those of its fields."""
    parameters = inspect.signature(called).parameters.values()
    many = {p.name for p in parameters if p.kind in (p.VAR_POSITIONAL, p.VAR_KEYWORD)}
    # the __init__ of a record is made of its fields, unless it has one of its own
    made = vars(called).get("__dataclass_params__")
    is_plain = isinstance(called, type) and not (made and made.init)
    try:  # names of fields are looked up in the module of the class that has them
        every = typing.get_type_hints(called.__init__ if is_plain else called)
    except NameError:  # a name that is there for type checkers alone
        return {}
    return {key: hint for key, hint in every.items() if key not in (*many, "return", "self")}


@cache
def _rule(hint: Any) -> Rule:
    """What fits a type hint; whatever nothing is known of fits."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    kind = origin if isinstance(origin, type) else object
    if hint in PLAIN:
        return PLAIN[hint]
    if origin in UNIONS:
        rules = [_rule(one) for one in inner]
        names = dict.fromkeys(name for _, name in rules)
        return lambda value: any(fits(value) for fits, _ in rules), " or ".join(names)
    if origin is typing.Literal:
        words = " or ".join(map(repr, inner))
        return lambda value: isinstance(value, str | int) and value in inner, words
    if origin is Callable:
        return callable, "something else"
    if issubclass(kind, Mapping):
        return lambda value: isinstance(value, Mapping), "a mapping"
    if issubclass(kind, tuple | Sequence | Iterable):
        return _sequence_rule(kind, inner)
    if isinstance(hint, type) and origin is None and hint is not Any:
        known = object if getattr(hint, "_is_protocol", False) else hint
        return lambda value: isinstance(value, known), f"a {hint.__name__}"
    return lambda value: True, "something else"


def _sequence_rule(kind: type, inner: tuple[Any, ...]) -> Rule:
    """Lists, tuples and arrays pass for each other; text is none of them."""
    rules = [_rule(one) for one in inner if one is not Ellipsis]
    is_record = issubclass(kind, tuple) and bool(inner) and Ellipsis not in inner

    def fits(value: Any) -> bool:
        if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable):
            return False
        if isinstance(value, np.ndarray) and inner[:1] == (str,):
            return False
        if not isinstance(value, list | tuple):
            return True  # what is taken once, or an array, whose numbers are checked as such
        if is_record:
            each = zip(value, rules, strict=False)
            return len(value) == len(rules) and all(rule(one) for one, (rule, _) in each)
        return all(rules[0][0](one) for one in value) if rules else True

    return fits, f"a sequence, of {rules[0][1]} each" if rules else "a sequence"
