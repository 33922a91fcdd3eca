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

from fitting.text.errors import BadInput, shown
from fitting.text.numbers import is_real, is_whole

Called = TypeVar("Called")
UNIONS = (typing.Union, types.UnionType)
#: Values that are repeated in a complaint as they are; of others it names the class.
PLAIN = (str, bytes, int, float, list, tuple, dict, types.NoneType)
#: What a hint is called in a sentence.
WORDS: Mapping[Any, str] = {
    float: "a number",
    int: "a whole number",
    bool: "True or False",
    str: "text",
    Path: "a path",
    types.NoneType: "None",
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
            if key in hints and not _can_be(value, hints[key]):
                wanted = _words(hints[key])
                what = shown(value) if isinstance(value, PLAIN) else f"a {type(value).__name__}"
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


def _can_be(value: Any, hint: Any) -> bool:
    """Whether a value may be of a type; also where nothing is known of it."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin in UNIONS:
        return any(_can_be(value, one) for one in inner)
    if hint in (None, types.NoneType):
        return value is None
    if hint is int:
        return is_whole(value)
    if hint is float:
        try:
            return is_real(value) and isinstance(float(value), float)
        except OverflowError:
            return False
    if hint in (bool, str, Path):
        plain: dict[Any, Any] = {bool: bool | np.bool_, str: str, Path: str | PathLike}
        return isinstance(value, plain[hint])
    if origin is typing.Literal:
        return isinstance(value, str | int) and value in inner
    if origin is Callable:
        return callable(value)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return isinstance(value, Mapping)
    if isinstance(origin, type) and issubclass(origin, tuple | Sequence | Iterable):
        return _can_be_sequence(value, origin, inner)
    is_class = isinstance(hint, type) and not getattr(hint, "_is_protocol", False)
    return isinstance(value, hint) if is_class and origin is None else True


def _can_be_sequence(value: Any, origin: type, inner: tuple[Any, ...]) -> bool:
    """Lists, tuples and arrays pass for each other; text is none of them."""
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable):
        return False
    if isinstance(value, np.ndarray) and inner[:1] == (str,):
        return False
    if not isinstance(value, list | tuple):
        return True  # what is taken once, or an array, whose numbers are checked as such
    if issubclass(origin, tuple) and Ellipsis not in inner and inner:
        return len(value) == len(inner) and all(map(_can_be, value, inner))
    return all(_can_be(one, inner[0]) for one in value) if inner else True


def _words(hint: Any) -> str:
    """What is wanted, in words."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if hint in WORDS:
        return WORDS[hint]
    if origin in UNIONS:
        return " or ".join(dict.fromkeys(map(_words, inner)))
    if origin is typing.Literal:
        return " or ".join(map(repr, inner))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return "a mapping"
    if isinstance(origin, type) and issubclass(origin, tuple | Sequence | Iterable):
        return f"a sequence, of {_words(inner[0])} each" if inner else "a sequence"
    if isinstance(hint, type):
        return f"a {hint.__name__}"
    return "something else"
