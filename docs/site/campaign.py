"""The keys of campaign.toml, from the schema that also checks them."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from docs.site.markdown import code, table
from fitting.measurements.schema import campaign_schema

DATA = Path(__file__).resolve().parents[2] / "data"
INTRODUCTION = """\
# campaign.toml

Every key of the campaign file. [Write a campaign](../how-to/campaign.md) tells how they go
together. Unknown keys are refused with the nearest known one, and all complaints come at once, a
line each. “Value” stands for a number in the FMU's own unit, or a text with a unit as `"6.94016
MHz"`; paths are relative to the file. Examples are those of the shipped campaigns.

The same as a JSON Schema for editors: `python -m fitting.measurements.schema >
campaign.schema.json` writes it, and a first line `#:schema ./campaign.schema.json` in the
campaign names it."""
#: What a table's entries are called where their names are free.
FREE = {"drift": "variable", "alternatives": "variable", "laws": "variable", "constants": "name"}


def page() -> str:
    """The page, a table for each table of the file."""
    schema = json.loads(campaign_schema())
    shipped = [tomllib.loads(path.read_text("utf-8")) for path in sorted(DATA.glob("*/*.toml"))]
    parts = [INTRODUCTION, "## Top level", _keys((), schema, shipped)]
    for place, described, repeated in _tables(schema):
        name = ".".join(place)
        parts.append(f"## `[[{name}]]`" if repeated else f"## `[{name}]`")
        parts.append(" ".join(described.get("description", "").replace("``", "`").split()))
        parts.append(_keys(place, described, shipped))
    return "\n\n".join(part for part in parts if part)


def _tables(
    schema: Mapping[str, Any], place: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any], bool]]:
    for key, described in schema.get("properties", {}).items():
        inner = described.get("items", described)
        if _is_table(inner):
            yield (*place, key), inner, inner is not described
            yield from _tables(inner, (*place, key))


def _is_table(described: Any) -> bool:
    return isinstance(described, dict) and (
        "properties" in described or described.get("type") == "object"
    )


def _keys(place: tuple[str, ...], described: Mapping[str, Any], shipped: list[Any]) -> str:
    rows = []
    needed = described.get("required", ())
    keys = described.get("properties", {}).items()
    for key, value in sorted(keys, key=lambda each: each[0] not in needed):
        if _is_table(value.get("items", value)):
            continue
        usual = "required" if key in needed else code(_toml(value.get("default")))
        example = code(_example((*place, key), shipped, value.get("default")) or _stated(value))
        rows.append((code(key), value.get("description", ""), _wanted(value), usual, example))
    free = described.get("additionalProperties")
    if isinstance(free, dict):
        name = FREE.get(place[-1], "variable")
        inner = free.get("properties", {})
        told = free.get("description", "") + "".join(
            f" `{key}`: {value['description']}" for key, value in inner.items()
        )
        if not rows:
            example = _example(place, shipped, None)
            return f"Wanted for each {name}: {_wanted(free)}" + (
                f", as `{example}`." if example else "."
            )
        rows.append((f"a {name}", told or "Its value.", _wanted(free), "", ""))
    return table(("key", "meaning", "wanted", "default", "example"), rows)


def _wanted(value: Mapping[str, Any]) -> str:
    """What may be written, in words."""
    if "enum" in value:
        return ", ".join(code(_toml(word)) for word in value["enum"])
    if "x-unit" in value:
        return f"text with a unit ({value['x-unit']})"
    kind = value.get("type")
    if kind == "array":
        return "list of " + {"text": "texts", "value": "values"}.get(
            word := _wanted(value["items"]), word.replace("number", "numbers")
        )
    if kind == "object":
        return "table"
    if isinstance(kind, list):
        return "share" if value.get("examples") else "value"
    words = {"string": "text", "boolean": "true or false", "integer": "whole number"}
    word = words.get(str(kind), "number")
    least, above = value.get("minimum"), value.get("exclusiveMinimum")
    if least is not None:
        return f"{word} from {least:g}"
    return f"{word} above {above:g}" if above is not None else word


def _stated(value: Mapping[str, Any]) -> str:
    return _toml(value["examples"][0]) if value.get("examples") else ""


def _example(place: tuple[str, ...], shipped: list[Any], usual: Any) -> str:
    """The first value that a shipped campaign has there, as it is written in TOML."""
    found = [value for campaign in shipped for value in _values(campaign, place)]
    found.sort(key=lambda value: value == usual)  # what is not said anyway tells more
    return next((text for text in map(_toml, found) if text and len(text) <= 40), "")


def _values(data: Any, place: tuple[str, ...]) -> Iterator[Any]:
    if isinstance(data, list) and place:
        for item in data:
            yield from _values(item, place)
    elif not place:
        yield data
    elif isinstance(data, dict) and place[0] in data:
        yield from _values(data[place[0]], place[1:])


def _toml(value: Any) -> str:
    """A value as TOML writes it; nothing where there is none."""
    match value:
        case None:
            return ""
        case bool():
            return str(value).lower()
        case float():
            return f"{value:g}" if value != int(value) or abs(value) >= 1e6 else f"{value}"
        case list():
            return f"[{', '.join(map(_toml, value))}]"
        case dict():
            return "{ " + ", ".join(f"{key} = {_toml(item)}" for key, item in value.items()) + " }"
        case str():
            return json.dumps(value, ensure_ascii=False)
        case _:
            return str(value)
