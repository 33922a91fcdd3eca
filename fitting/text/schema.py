"""Plain tables, as read from TOML, to frozen dataclasses, by pydantic; and their JSON Schema.

A table of a file is described once, as a frozen dataclass whose fields are the table's keys:

    @dataclass(frozen=True, kw_only=True)
    class WrittenObserve(Keys):
        output: Text
        "The FMU output that is observed."
        line_width: Annotated[float | None, Quantity("Hz")] = None
        "Rough width, sets the settling time."

        def __post_init__(self) -> None:  # what no key can decide by itself
            if ...: raise Refused("wanted ...", "line_width")

`read_record` makes the record of plain tables, or complains of everything that is wrong with them,
one line each with file, table and key; `json_schema` describes the same for editors.
"""

from __future__ import annotations

import ast
import dataclasses
import functools
import inspect
import itertools
import textwrap
import typing
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import TypeAdapter, ValidationError
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from fitting.text.errors import BadInput, did_you_mean, shown
from fitting.text.keys import Missing, Refused
from fitting.text.once import made_once
from fitting.text.written import Written

Record = TypeVar("Record")
Place = tuple[str | int, ...]
#: Unknown keys for which a likely one is looked up, which takes a while.
MOST_HINTS = 50


@made_once
def _adapter(kind: Any) -> TypeAdapter[Any]:
    """The reader of a kind of record: to make it takes milliseconds."""
    return TypeAdapter(kind)


def read_record(kind: type[Record], data: Any, path: Path, table: str = "") -> Record:
    """The record of a ``table`` (of the whole file, where empty) from plain tables.

    ``path`` is the file, for complaints and for the names of other files, which are relative to it.
    Every value as written gets its place in the file.

    Args:
        kind: class of the record.
        data: plain numbers, words, lists and tables.
        path: of the file.
        table: name of the table in the file.

    Raises:
        BadInput: a key that is unknown or missing, a value that is not what is wanted; one line
            for each, with file, table and key.
    """
    names: Place = (table,) if table else ()
    source = _Source(path, {table: data} if table else data)
    try:
        record = _adapter(kind).validate_python(data, context={"folder": path.parent})
    except ValidationError as error:
        raise BadInput(*_complaints(kind, error, source, names)) from None
    placed: Record = _placed(record, source, names)
    return placed


@dataclass(frozen=True)
class _Source:
    """A file and its plain tables, for words about a place in it."""

    path: Path
    data: Any

    def at(self, place: Place) -> Any:
        """What is written there, None where nothing is."""
        return functools.reduce(_inside, place, self.data)

    def where(self, place: Place, *, table: bool = False) -> str:
        """``file: [table] key``, the opening of a complaint; ``table``: the last is one itself.

        A step that the file does not have is a field of the record only, unless it is the last.
        """
        names: list[str] = []
        data = self.data
        for step in place:
            inside = _inside(data, step)
            if isinstance(step, int):
                if isinstance(inside, Mapping) or table:  # else one of a list, which has the place
                    name = inside.get("name", step + 1) if isinstance(inside, Mapping) else step + 1
                    names[-1] += f" '{name}'"
            elif inside is not None or step == place[-1]:
                names.append(step)
            else:
                continue
            data = inside
        section, key = (names, []) if table else (names[:-1], names[-1:])
        words = [f"[{'.'.join(section)}]"] if section else []
        return f"{self.path}: " + (" ".join([*words, *key]) or "top level")


def _inside(data: Any, step: str | int) -> Any:
    """The value under a key or an index, None where there is none."""
    try:
        return data[step]
    except (KeyError, IndexError, TypeError):
        return None


def _complaints(
    kind: type[Any], error: ValidationError, source: _Source, names: Place
) -> Sequence[str]:
    """A line for every error; a key that is missing because it is misspelt is one, not two."""
    unknown_key = "unexpected_keyword_argument"
    errors = error.errors(include_url=False)
    unknown = list(
        itertools.islice((e["loc"] for e in errors if e["type"] == unknown_key), MOST_HINTS)
    )

    def is_misspelt(loc: Place) -> bool:
        return any(
            loc and u[:-1] == loc[:-1] and did_you_mean(str(u[-1]), [str(loc[-1])], listed=False)
            for u in unknown
        )

    lines: list[str] = []
    # a misspelt table explains what seems missing in it: first what is unknown
    for e in sorted(errors, key=lambda e: e["type"] != unknown_key):
        loc, value = e["loc"], e["input"]
        place, key = (*names, *loc), str(loc[-1]) if loc else ""
        match e["type"]:
            case "unexpected_keyword_argument":
                known = sorted(_fields(kind, loc[:-1])) if len(lines) < MOST_HINTS else []
                where = source.where(place[:-1], table=True)
                lines.append(f"{where}: unknown key '{key}'{did_you_mean(key, known)}")
            case "missing":
                if is_misspelt(loc) or is_misspelt(loc[:-1]):
                    continue
                notes = _fields(kind, loc[:-1]).get(key, ())
                wanted = next((f": {n.wanted}" for n in notes if isinstance(n, Missing)), None)
                hint = did_you_mean(key, sorted(value), listed=False) if wanted is None else wanted
                where = source.where(place[:-1], table=True)
                lines.append(f"{where}: key '{key}' is missing{hint}")
            case "value_error":
                reason = e["ctx"]["error"]
                if isinstance(reason, BadInput):  # its place is in it
                    lines += reason.args
                    continue
                further: tuple[str, ...] = ()
                table = False
                if isinstance(reason, Refused):  # of this table, or of a key in it
                    further = reason.key
                    table = not further and isinstance(source.at(place), Mapping)
                where = source.where((*place, *further), table=table)
                if table and not place:
                    where = str(source.path)
                lines.append(f"{where}: {reason}")
            case "dataclass_type" | "mapping_type" | "dict_type":
                where = source.where(place, table=True)
                lines.append(f"{where}: found {shown(value)}, wanted a table")
            case _:
                lines.append(f"{source.where(place)}: found {shown(value)}: {e['msg']}")
    return tuple(dict.fromkeys(lines))


def _fields(kind: Any, loc: Place) -> dict[str, tuple[Any, ...]]:
    """Keys of the record at a place inside another, with the annotations of each.

    Keys of free tables and indices of lists are passed over.
    """

    def types(hint: Any) -> Iterator[Any]:
        """A type and all the types inside it, but for a record's own."""
        yield typing.get_origin(hint) or hint
        inner = typing.get_args(hint)
        for each in inner[:1] if typing.get_origin(hint) is Annotated else inner:
            yield from types(each)

    hints = typing.get_type_hints(kind, include_extras=True)
    for step in loc:
        if step in hints:
            kind = next(filter(dataclasses.is_dataclass, types(hints[str(step)])), kind)
            hints = typing.get_type_hints(kind, include_extras=True)
    names = [f.name for f in dataclasses.fields(kind)]
    return {name: getattr(hints[name], "__metadata__", ()) for name in names}


def _placed(value: Any, source: _Source, place: Place) -> Any:
    """The record with the place in the file of every value as written."""
    if isinstance(value, Written):
        return dataclasses.replace(value, where=source.where(place))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = [f.name for f in dataclasses.fields(value) if f.init]
        old = {name: getattr(value, name) for name in fields}
        new = {name: _placed(item, source, (*place, name)) for name, item in old.items()}
        changed = {name: new[name] for name in fields if new[name] is not old[name]}
        return dataclasses.replace(value, **changed) if changed else value
    if isinstance(value, Mapping):
        return {key: _placed(item, source, (*place, key)) for key, item in value.items()}
    if isinstance(value, tuple) and value and not isinstance(value[0], str | float | int):
        return tuple(_placed(item, source, (*place, k)) for k, item in enumerate(value))
    return value


class _ForEditors(GenerateJsonSchema):
    """Without titles made of names, and without null, for which TOML has no word."""

    def dataclass_schema(self, schema: core_schema.DataclassSchema) -> JsonSchemaValue:
        made = super().dataclass_schema(schema)
        for key, words in words_below_fields(schema["cls"]).items():
            made["properties"][key]["description"] = words
        made.pop("title", None)
        return made

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        usual = schema.get("default")
        empty = usual is None or usual in ((), "") or dataclasses.is_dataclass(usual)
        if empty and not isinstance(usual, Written):
            return self.generate_inner(schema["schema"])
        return super().default_schema(schema)

    def encode_default(self, dft: Any) -> Any:
        return dft.value if isinstance(dft, Written) else super().encode_default(dft)


def json_schema(kind: type[Any], **head: str) -> dict[str, Any]:
    """The JSON Schema (draft 7, which editors know) of a record, without references.

    The docstrings below the fields are the keys' descriptions. ``head`` are keywords for its top,
    as ``title``.

    Args:
        kind: class of the record.
        **head: title and further keys of the schema itself.
    """
    made = _adapter(kind).json_schema(schema_generator=_ForEditors)
    plain: dict[str, Any] = _without_references(made, made.pop("$defs", {}))
    return {"$schema": "http://json-schema.org/draft-07/schema#", **plain, **head}


def words_below_fields(record: type[Any]) -> dict[str, str]:
    """The docstring below each field of a record and of those that it is derived from.

    Args:
        record: a dataclass.
    """
    words = {}
    for base in reversed(record.__mro__):
        if not dataclasses.is_dataclass(base):
            continue
        written = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0]
        for field, below in itertools.pairwise(ast.iter_child_nodes(written)):
            match field, below:
                case ast.AnnAssign(target=ast.Name(id=key)), ast.Expr(ast.Constant(str() as text)):
                    words[key] = " ".join(text.split())
    return words


def _without_references(schema: Any, definitions: Mapping[str, Any]) -> Any:
    if isinstance(schema, list):
        return [_without_references(item, definitions) for item in schema]
    if not isinstance(schema, dict):
        return schema
    named = definitions.get(str(schema.get("$ref", "")).rpartition("/")[2], {})
    own = {key: value for key, value in schema.items() if key != "$ref"}
    return {k: _without_references(v, definitions) for k, v in (named | own).items()}
