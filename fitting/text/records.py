"""Frozen records to JSON and back, exactly.

Numbers keep all their digits (17 where needed), NaN and the infinities become null and "inf":
plain JSON, readable by any program. Where text and number share a place, numbers are finite.
"""

from __future__ import annotations

import dataclasses
import enum
import functools
import json
import math
import types
import typing
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from fitting.text.errors import BadInput, shown
from fitting.text.files import read_whole
from fitting.text.results_folder import write_whole

Record = TypeVar("Record")
_hints = functools.cache(typing.get_type_hints)  # many records of a kind are read


@dataclasses.dataclass(frozen=True, kw_only=True)
class EndedRecord:
    """What a command that may be interrupted writes: ``status`` is how it ended."""

    title: str
    synthetic: bool
    status: str
    message: str
    provenance: Mapping[str, str] = dataclasses.field(default_factory=dict)


def to_plain(value: Any) -> Any:
    """A record, or any nest of records, tuples and mappings, as what JSON can hold.

    Args:
        value: a record, or any nest of records, tuples and mappings.

    Raises:
        TypeError: a value of a kind that JSON has no word for.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        names = getattr(value, "stored_fields", None) or [f.name for f in dataclasses.fields(value)]
        return {name: to_plain(getattr(value, name)) for name in names}
    if isinstance(value, Mapping):
        return {str(key): to_plain(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [to_plain(item) for item in value]
    if isinstance(value, enum.Enum):
        return to_plain(value.value)
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        if math.isnan(value):
            return None
        return value if math.isfinite(value) else ("inf" if value > 0 else "-inf")
    raise TypeError(f"{type(value).__name__} {value!r} has no place in a JSON file")


def from_plain(kind: type[Record], data: Any, where: str = "record") -> Record:
    """The record of a class from what `to_plain` made of it.

    Args:
        kind: class of the record.
        data: plain numbers, words, lists and tables.
        where: file, row or key, for complaints.

    Raises:
        BadInput: a key that is missing or unknown, or a value of another kind; names the key.
    """
    record: Record = _decode(kind, data, where)
    return record


def _decode(kind: Any, data: Any, where: str) -> Any:
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if kind is Any:
        return data
    if origin in (typing.Union, types.UnionType):
        if data is None and type(None) in arguments:
            return None
        if type(data) in (bool, int, str) and type(data) in arguments:
            return data
        others = [k for k in arguments if k not in (bool, int, str, type(None))]
        _check(bool(others), data, " or ".join(map(str, arguments)), where)
        return _decode(others[0], data, where)
    if kind is float:
        if data is None:
            return math.nan
        number = data in ("inf", "-inf") or type(data) in (int, float)
        _check(number, data, "a number", where)
        try:
            return float(data)
        except OverflowError:
            raise BadInput(f"{where}: found {shown(data)}, wanted a number below 1e308") from None
    is_enum = isinstance(kind, type) and issubclass(kind, enum.Enum)
    if is_enum or origin is typing.Literal:
        values = [member.value for member in kind] if is_enum else arguments
        _check(data in values, data, f"one of {', '.join(map(str, values))}", where)
        return kind(data) if is_enum else data
    if dataclasses.is_dataclass(kind):
        return _decode_record(kind, data, where)
    if origin is tuple:
        _check(isinstance(data, list), data, "a list", where)
        kinds = [arguments[0]] * len(data) if arguments[-1] is Ellipsis else arguments
        _check(len(kinds) == len(data), data, f"{len(kinds)} values", where)
        return tuple(_decode(k, v, f"{where}[{i}]") for i, (k, v) in enumerate(zip(kinds, data)))  # noqa: B905
    if isinstance(origin, type) and issubclass(origin, Mapping):
        _check(isinstance(data, dict), data, "an object", where)
        return {key: _decode(arguments[1], item, f"{where}.{key}") for key, item in data.items()}
    exact = isinstance(data, kind) and (kind is bool or not isinstance(data, bool))
    _check(exact, data, kind.__name__, where)
    return data


def _decode_record(kind: Any, data: Any, where: str) -> Any:
    _check(isinstance(data, dict), data, "an object", where)
    hints = _hints(kind)
    fields = {f.name: f for f in dataclasses.fields(kind)}
    for name in data:
        _check(name in fields, name, f"one of {', '.join(fields)}", where)
    for name, field in fields.items():
        missing = dataclasses.MISSING
        optional = field.default is not missing or field.default_factory is not missing
        _check(name in data or optional, "nothing", f"the key '{name}'", where)
    return kind(**{k: _decode(hints[k], data[k], f"{where}.{k}") for k in fields if k in data})


def _check(good: bool, result: Any, wanted: str, where: str) -> None:
    if not good:
        raise BadInput(f"{where}: found {str(result)[:60]!r}, wanted {wanted}")


def write_json(path: Path, value: Any) -> None:
    """Write a record as JSON, whole or not at all.

    Args:
        path: of the file.
        value: the record.
    """
    write_whole(path, json_text(value))


def json_text(value: Any) -> str:
    """A record as the text of a JSON file.

    Args:
        value: the record.
    """
    return json.dumps(to_plain(value), indent=1, allow_nan=False) + "\n"


def read_json(
    path: Path, kind: type[Record], upgraded: Callable[[dict[str, Any]], Any] = lambda data: data
) -> Record:
    """Read a record written by `write_json`.

    Args:
        path: of the file.
        kind: class of the record.
        upgraded: makes the present keys of those of an earlier version.

    Raises:
        BadInput: no such file, no JSON, or not such a record; names the file and the key.
    """
    content = read_whole(path)
    try:
        data = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{path}: cannot be read as JSON: {error}") from error
    try:
        data = upgraded(data) if isinstance(data, dict) else data
    except (KeyError, TypeError, AttributeError, ValueError):
        raise BadInput(f"{path}: found another file than a {kind.__name__.lower()}") from None
    return from_plain(kind, data, str(path))
