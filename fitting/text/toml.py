"""TOML, read, written and edited: the one place that knows how the text of a file is made.

A file is read as plain tables (`read_toml`) and written from plain tables (`toml_text`). A file
that somebody wrote, or a template with placeholders for values, is edited in its tables; comments,
layout and order of what is not touched stay (`rewritten`):

    def edit(tables: Tables) -> None:
        tables["title"] = "Another"                    # the remark behind the old value stays
        put(tables["sweep"], "use", "fit", "again")    # with a remark of its own
        put(tables, "noise", {"relative": "1 %"})      # a new table, in place of an old one
        tables.pop("design", None)

    text = rewritten(text, edit)

The edit may meet a file in any spelling: headers, dotted keys, inline tables, arrays over several
lines are all the same tables to it.
"""

from __future__ import annotations

import itertools
import json
import re
import tomllib
from collections.abc import Callable, Mapping, MutableMapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Item, Table, Whitespace

from fitting.text.errors import BadInput
from fitting.text.tables import read_text

#: Lists and tables in each other: no file that is read here has more than five.
DEEPEST = 30
TOO_DEEP = f"lists or tables stand in each other more than {DEEPEST} deep, wanted fewer"

#: A number with a decimal comma as the value of a key.
_DECIMAL_COMMA = re.compile(r"^[^#\n\[]*=[ \t]*([+-]?\d+),(\d+)[ \t]*(?:#.*)?$", re.MULTILINE)

Tables = MutableMapping[str, Any]


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Args:
        path: of the file.

    Raises:
        BadInput: no such file, or not TOML; names the line.
    """
    text = read_text(path)
    try:
        tables = tomllib.loads(text)
    except ValueError as error:  # of TOML, or of a number with thousands of digits
        comma = _DECIMAL_COMMA.search(text) if "at line" in str(error) else None
        hint = (
            "" if comma is None else f"; a number has a point, not a comma: {comma[1]}.{comma[2]}"
        )
        raise BadInput(f"{path}: not valid TOML: {error}{hint}") from error
    except RecursionError:
        raise BadInput(f"{path}: {TOO_DEEP}") from None
    if is_deeper(tables, DEEPEST):
        raise BadInput(f"{path}: {TOO_DEEP}")
    return tables


def is_deeper(value: Any, most: int) -> bool:
    """Whether lists and tables stand in each other more than ``most`` deep.

    Args:
        value: plain tables and lists.
        most: so deep is allowed.
    """
    layer = [value]
    for _ in range(most + 1):
        inner = (v.values() if isinstance(v, Mapping) else v for v in layer)
        layer = [v for items in inner for v in items if isinstance(v, Mapping | list)]
        if not layer:
            return False
    return True


def toml_text(tables: Mapping[str, Any], head: Sequence[str] = ()) -> str:
    """TOML of plain tables, lists and scalars; ``head`` are lines of remarks in front of it.

    Floats are written with as many digits as it takes to read the same number back.

    Args:
        tables: of the TOML file.
        head: lines that go before, without comment signs.
    """
    return _headed(tomlkit.dumps(tables), head)


def rewritten(text: str, edit: Callable[[Tables], None], head: Sequence[str] = ()) -> str:
    """The TOML ``text`` after ``edit`` of its tables, comments and layout kept.

    ``edit`` changes the tables in place; it is called twice, on the document and on its plain
    values: where the document does not hold the same afterwards, as some spellings defeat the
    library, the plain values are written, at the cost of layout and remarks. ``head`` are lines of
    remarks that take the place of those at the top of the text.

    Raises:
        ValueError: the text is not TOML.
    """
    # the remarks and empty lines at the top of the text
    lines = text.splitlines(keepends=True) if head else []
    old = itertools.takewhile(lambda line: not line.strip() or line.startswith("#"), lines)
    kept = text[sum(map(len, old)) :]
    plain: dict[str, Any] = tomllib.loads(kept)
    edit(plain)
    try:
        document = tomlkit.parse(kept)
        edit(document)
        made = tomlkit.dumps(document)
        same = _shown(tomllib.loads(made)) == _shown(_unwrapped(plain))
    except (TOMLKitError, tomllib.TOMLDecodeError, LookupError, TypeError, AttributeError):
        same = False
    return _headed(made if same else tomlkit.dumps(_unwrapped(plain)), head)


def put(tables: Tables, key: str, value: Any, remark: str = "") -> None:
    """Set a value or a whole table, with a ``remark`` behind the value or the table's header.

    Remarks between a table that is replaced and the next one stay: they belong to the next.

    Args:
        tables: of the TOML file.
        key: key of the table.
        value: the value.
        remark: comment behind the value.
    """
    item = tomlkit.item(value)
    if remark:
        item.comment(remark)
    if isinstance(item, Table):
        remarks = _behind(tables.get(key))
        for trailing in [*remarks, Whitespace("")] if remarks else ():
            item.value.append(None, trailing)  # ends in a space: else the library adds a line
    tables[key] = item


def inline(values: Mapping[str, Any]) -> Any:
    """A table that is written on one line, as ``{ before = 1, after = 2 }``.

    Args:
        values: keys and values of the table.
    """
    table = tomlkit.inline_table()
    table.update(values)
    return table


def _behind(item: Any) -> list[Item]:
    """Empty lines and remarks behind the last value of a table, which the library counts to it."""
    if isinstance(item, AoT):
        return _behind(item.body[-1])
    if not isinstance(item, Table):
        return []
    body = item.value.body
    last = next((i for i in reversed(range(len(body))) if body[i][0] is not None), -1)
    trailing = [element for _, element in body[last + 1 :]]
    return trailing or (_behind(body[last][1]) if body else [])


def _shown(value: Any) -> str:
    """Plain tables as a text that is the same for the same values, NaN included."""
    return json.dumps(value, sort_keys=True, default=repr)


def _unwrapped(value: Any) -> Any:
    """Plain dicts, lists and scalars."""
    if hasattr(value, "unwrap"):
        return value.unwrap()
    if isinstance(value, Mapping):
        return {key: _unwrapped(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_unwrapped(item) for item in value]
    return deepcopy(value)


def _headed(text: str, head: Sequence[str]) -> str:
    return "".join(f"# {line}".rstrip() + "\n" for line in head) + text
