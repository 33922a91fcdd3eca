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
import math
import textwrap
import typing
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    GetPydanticSchema,
    PlainValidator,
    Strict,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    WrapValidator,
)
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from fitting.text.choices import MOST, MOST_SEED
from fitting.text.errors import BadInput, did_you_mean, shown
from fitting.text.once import made_once
from fitting.text.units import Written, as_written, positive_in

#: Of what takes a fit or a measurement each.
MOST_REPEATS = 1000


class Keys:
    """What every record of a table is: a key that is no field of it is refused."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")
    __dataclass_fields__: ClassVar[dict[str, dataclasses.Field[Any]]]
    #: Keys that people look for in this table, and what a complaint about one ends with.
    elsewhere: ClassVar[Mapping[str, str]] = {}

    def refuse(self, sentence: str, *keys: str) -> None:
        """Refuse keys that are written although they have no meaning.

        Args:
            sentence: what the error reports of them.
            *keys: that are no mappings.

        Raises:
            Refused: the first that has another value than its default.
        """
        for key in keys:
            if getattr(self, key) != self.__dataclass_fields__[key].default:
                raise Refused(sentence, key)


class Refused(ValueError):
    """A value is refused, or a ``key`` of a table (of a table in it: several keys)."""

    def __init__(self, sentence: str, *key: str) -> None:
        super().__init__(sentence)
        self.key = key


@contextmanager
def refusing(*key: str) -> Iterator[None]:
    """Turn the complaint of a function that was given an empty place into one of this key.

    Args:
        key: key of the table.
    """
    try:
        yield
    except BadInput as error:
        raise Refused(f"{error}".removeprefix(":").strip(), *key) from error


def Usually(value: Any) -> Any:  # noqa: N802 - an annotation like those below
    """The value that is meant where nothing is written, for a record that has None there.

    Args:
        value: for the schema alone.
    """
    return Field(json_schema_extra={"default": value})


@dataclass(frozen=True)
class Missing:
    """What is ``wanted``, for the complaint about a key that is not there."""

    wanted: str


def Quantity(unit: str) -> GetPydanticSchema:  # noqa: N802
    """A number with its unit as a text, "100 Hz": above zero, converted.

    Args:
        unit: of the number that is read.
    """

    def read(value: Any) -> float:
        with refusing():
            return positive_in(as_written(value, ""), unit)

    schema = {
        "type": "string",
        "pattern": r"^\s*[+]?(\d|\.\d)",
        "examples": [f"100 {unit}"],
        "x-unit": unit,
    }
    read_by = core_schema.no_info_plain_validator_function(read)
    return GetPydanticSchema(lambda kind, handler: read_by, lambda core, handler: schema)


def Rest(name: str) -> GetPydanticSchema:  # noqa: N802
    """Behind a record: tables in it, and keys that it does not have, are one mapping of it.

    Args:
        name: of the field that is the mapping.
    """

    def core(source: Any, handler: Callable[[Any], CoreSchema]) -> CoreSchema:
        names = {f.name for f in fields(source)} - {name}

        def apart(table: Any) -> Any:
            if not isinstance(table, Mapping):
                return table
            rest = {k: v for k, v in table.items() if isinstance(v, Mapping) or k not in names}
            return {k: v for k, v in table.items() if k not in rest} | {name: rest}

        return core_schema.no_info_before_validator_function(apart, handler(source))

    def described(inner: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        # the mapping's entries are further keys of the record
        made = handler.resolve_ref_schema(handler(inner))
        made["additionalProperties"] = made["properties"].pop(name)["additionalProperties"]
        return made

    return GetPydanticSchema(core, described)


def wanted(words: str) -> WrapValidator:
    """Whatever a value is refused for, the complaint is that these words are wanted.

    Args:
        words: what is allowed.
    """

    def check(value: Any, inner: Callable[[Any], Any]) -> Any:
        try:
            return inner(value)
        except ValidationError:
            raise Refused(f"found {shown(value)}, wanted {words}") from None

    return WrapValidator(check)


def checked_by(check: Callable[[Any], object]) -> AfterValidator:
    """What a function complains of in a value is the complaint about its key.

    Args:
        check: complains by `BadInput`, its place empty.
    """

    def look(value: Any) -> Any:
        with refusing():
            check(value)
        return value

    return AfterValidator(look)


def OneOf(words: Collection[str]) -> GetPydanticSchema:  # noqa: N802
    """One of a few words (of the keys, if it is a mapping), to be written behind ``Text``.

    Args:
        words: that are allowed.
    """

    def check(value: str) -> str:
        if value not in words:
            known = ", ".join(f'"{word}"' for word in words)
            raise Refused(f"found {shown(value)}, wanted one of {known}")
        return value

    return GetPydanticSchema(
        lambda kind, handler: core_schema.no_info_after_validator_function(check, handler(kind)),
        lambda core, handler: {"type": "string", "enum": list(words)},
    )


def _different(values: tuple[str, ...]) -> tuple[str, ...]:
    if len(set(values)) < len(values):
        raise Refused(f"{shown(list(values))} names something twice, wanted each once")
    return values


def _value(value: Any) -> Written:
    with refusing():
        return value if isinstance(value, Written) else as_written(value, "")


def _next_to_file(value: Any, info: ValidationInfo) -> Path:
    if not isinstance(value, str) or not value.strip():
        raise Refused(f"found {shown(value)}, wanted a text")
    if "\0" in value:
        raise Refused(f"found {shown(value)}, wanted the name of a file")
    return Path((info.context or {}).get("folder", "")) / value


def _share(value: Any) -> float:
    """A share as 0.01 or "1 %"."""
    number = value
    if isinstance(value, str) and value.strip().endswith("%"):
        try:
            number = 0.01 * float(value.strip()[:-1])
        except ValueError:
            number = math.nan
    if isinstance(number, bool) or not isinstance(number, int | float) or not 0.0 <= number < 1.0:
        raise Refused(f'found {shown(value)}, wanted a share as "1 %" or 0.01')
    return float(number)


def listed(words: str, least: int = 1) -> BeforeValidator:
    """A list of ``least`` entries or more; else the complaint is that these words are wanted.

    Args:
        words: what is wanted, for the complaint.
        least: entries at least.
    """

    def check(values: Any) -> Any:
        if isinstance(values, list | tuple) and len(values) >= least:
            return values
        raise Refused(f"found {shown(values)}, wanted {words}")

    return BeforeValidator(check)


Text = Annotated[str, Strict(), Field(pattern=r"\S"), wanted("a text")]
Texts = Annotated[
    tuple[Annotated[str, Strict(), Field(min_length=1)], ...],
    Field(json_schema_extra={"uniqueItems": True}),
    wanted("a list of texts"),
    AfterValidator(_different),
]
Switch = Annotated[bool, Strict(), wanted("true or false")]
Number = Annotated[float, Strict(), Field(allow_inf_nan=False), wanted("a finite number")]
Positive = Annotated[float, Strict(), Field(gt=0, allow_inf_nan=False), wanted("a positive number")]
Factor = Annotated[
    float,
    Strict(),
    Field(gt=0, lt=1, allow_inf_nan=False),
    wanted("a factor above 0 and below 1"),
]
Positives = Annotated[
    tuple[Annotated[float, Strict(), Field(gt=0, allow_inf_nan=False)], ...],
    Field(min_length=1),
    wanted("a list of positive numbers"),
]
Counts = Annotated[
    tuple[Annotated[int, Strict(), Field(ge=1, le=MOST)], ...],
    wanted(f"a list of whole numbers from 1 to {MOST}"),
]
WholeNumber = Annotated[
    int, Strict(), Field(ge=0, le=MOST_SEED), wanted("a whole number from 0 to 2^63 - 1")
]
Count = Annotated[int, Strict(), Field(ge=1, le=MOST), wanted(f"a whole number from 1 to {MOST}")]
Repeats = Annotated[
    int,
    Strict(),
    Field(ge=1, le=MOST_REPEATS),
    wanted(f"a whole number from 1 to {MOST_REPEATS}"),
]
#: Of a term in search variables, of which a change by one is a large one.
Weight = Annotated[float, Strict(), Field(ge=0, le=MOST), wanted(f"a number from 0 to {MOST}")]
#: A share as 0.01 or "1 %".
Share = Annotated[
    float,
    PlainValidator(_share),
    WithJsonSchema({"type": ["number", "string"], "minimum": 0, "examples": ["1 %", 0.01]}),
]
#: A number, Boolean or text as written; which unit or kind it must have, the FMU knows.
Value = Annotated[
    Written,
    PlainValidator(_value),
    WithJsonSchema({"type": ["number", "string", "boolean"]}),
]
Times = Annotated[
    tuple[Annotated[float, Quantity("s")], ...], Field(min_length=1), listed("a list of times")
]
Values = Annotated[tuple[Value, ...], Field(min_length=1), listed("a list of values to try")]
Frequencies = Annotated[tuple[Value, ...], Field(min_length=1), listed("frequencies")]
#: A file named relative to the one that names it.
FileName = Annotated[Path, PlainValidator(_next_to_file), WithJsonSchema({"type": "string"})]


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
    lines: list[str] = []
    meant: set[Place] = set()
    # a misspelt table explains what seems missing in it: first what is unknown
    errors = error.errors(include_url=False)
    for e in sorted(errors, key=lambda e: e["type"] != unknown_key):
        loc, value = e["loc"], e["input"]
        place, key = (*names, *loc), str(loc[-1]) if loc else ""
        match e["type"]:
            case "unexpected_keyword_argument":
                record = _record_at(kind, loc[:-1])
                known = sorted(f.name for f in fields(record)) if len(lines) < MOST_HINTS else []
                hint = getattr(record, "elsewhere", {}).get(key) or did_you_mean(key, known)
                meant |= {(*loc[:-1], name) for name in known if f"'{name}'" in hint}
                where = source.where(place[:-1], table=True)
                lines.append(f"{where}: unknown key '{key}'{hint}")
            case "missing":
                if loc in meant or loc[:-1] in meant:
                    continue
                hints = typing.get_type_hints(_record_at(kind, loc[:-1]), include_extras=True)
                notes = getattr(hints.get(key), "__metadata__", ())
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


def _record_at(kind: Any, loc: Place) -> Any:
    """The class of the record at a place inside another.

    Keys of free tables and indices of lists are passed over.
    """

    def types(hint: Any) -> Iterator[Any]:
        """A type and all the types inside it, but for a record's own."""
        yield typing.get_origin(hint) or hint
        inner = typing.get_args(hint)
        for each in inner[:1] if typing.get_origin(hint) is Annotated else inner:
            yield from types(each)

    for step in loc:
        hints = typing.get_type_hints(kind, include_extras=True)
        if step in hints:
            kind = next(filter(dataclasses.is_dataclass, types(hints[str(step)])), kind)
    return kind


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
