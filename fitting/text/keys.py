"""What a key of a table can be: a text, a quantity, one of a few words, a value as written.

Each is an annotated type of a record's field (see `fitting.text.schema`) that defines at once what
is accepted, the words of the complaint about anything else, and the JSON Schema for editors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    PlainValidator,
    Strict,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    WrapValidator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from fitting.text.errors import BadInput, shown
from fitting.text.written import Written, as_written, positive_in

#: No key has a reason to hold more: what it counts would take years.
MOST, MOST_REPEATS, MOST_SEED = 10**6, 1000, 2**63 - 1


class Keys:
    """What every record of a table is: a key that is no field of it is refused."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")


class Refused(ValueError):
    """A value is refused, or a ``key`` of a table (of a table in it: several keys)."""

    def __init__(self, sentence: str, *key: str) -> None:
        super().__init__(sentence)
        self.sentence = sentence
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


@dataclass(frozen=True)
class Quantity:
    """A number with its unit as a text, "100 Hz": above zero, converted to ``unit``."""

    unit: str

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> CoreSchema:
        """How pydantic reads it."""
        return core_schema.no_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, core: object, handler: object) -> JsonSchemaValue:
        """A text that begins with a number."""
        return {
            "type": "string",
            "pattern": r"^\s*[+]?(\d|\.\d)",
            "examples": [f"100 {self.unit}"],
            "x-unit": self.unit,
        }

    def read(self, value: Any) -> float:
        """The number in the unit.

        Args:
            value: the value.
        """
        with refusing():
            return positive_in(as_written(value, ""), self.unit)


@dataclass(frozen=True)
class Rest:
    """Behind a record: tables in it, and keys that it does not have, are its mapping ``field``."""

    field: str

    def __get_pydantic_core_schema__(
        self, source: type[Any], handler: Callable[[Any], CoreSchema]
    ) -> CoreSchema:
        """How pydantic reads it."""
        names = {f.name for f in fields(source)} - {self.field}

        def apart(table: Any) -> Any:
            if not isinstance(table, Mapping):
                return table
            rest = {k: v for k, v in table.items() if isinstance(v, Mapping) or k not in names}
            return {k: v for k, v in table.items() if k not in rest} | {self.field: rest}

        return core_schema.no_info_before_validator_function(apart, handler(source))

    def __get_pydantic_json_schema__(
        self, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """The record, its mapping's entries as further keys."""
        made = handler.resolve_ref_schema(handler(core))
        made["additionalProperties"] = made["properties"].pop(self.field)["additionalProperties"]
        return made


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


@dataclass(frozen=True)
class OneOf:
    """One of a few words (of the keys, if it is a mapping), to be written behind ``Text``."""

    words: Collection[str]

    def __get_pydantic_core_schema__(
        self, source: Any, handler: Callable[[Any], CoreSchema]
    ) -> CoreSchema:
        """How pydantic reads it."""
        return core_schema.no_info_after_validator_function(self.read, handler(source))

    def __get_pydantic_json_schema__(self, core: object, handler: object) -> JsonSchemaValue:
        """The words."""
        return {"type": "string", "enum": list(self.words)}

    def read(self, value: str) -> str:
        """The word, if it is one of them.

        Args:
            value: the value.
        """
        if value not in self.words:
            words = ", ".join(f'"{word}"' for word in self.words)
            raise Refused(f"found {shown(value)}, wanted one of {words}")
        return value


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
#: Of what takes a fit or a measurement each.
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
