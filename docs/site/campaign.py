"""The keys of campaign.toml, from the schema that also checks them."""

from __future__ import annotations

import json
import re
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from docs.site.markdown import code, escaped
from fitting.measurements.schema import campaign_schema

DATA = Path(__file__).resolve().parents[2] / "data"
INTRODUCTION = """\
# campaign.toml

Every key of the campaign file; [Write a campaign](../how-to/campaign.md) describes its use. All
errors are printed at once. “Value” is a number in the FMU's unit, or a text with a unit as
`"6.94016 MHz"`; paths are relative to the file. A default follows `=`.

For editors: `python -m fitting.measurements.schema > campaign.schema.json` writes a JSON Schema, to
be named by a first line `#:schema ./campaign.schema.json`."""
SHARED = "## Keys of several tables"
PLURAL = {"text": "texts", "value": "values", "number above 0": "numbers above 0"}
#: Kinds of keys whose examples add to the description.
FREE_TEXT = ("text", "value", "list", "table")


def page() -> str:
    """The page: the keys that several tables have, then each table of the file with its own."""
    schema = json.loads(campaign_schema())
    shipped = [tomllib.loads(path.read_text("utf-8")) for path in sorted(DATA.glob("*/*.toml"))]
    tables = dict(_tables(schema))
    keys = {place: dict(_keys(place, table, shipped)) for place, table in tables.items()}
    count = Counter(entry for of_table in keys.values() for entry in of_table.items())
    shared = {key: text for (key, text), number in reversed(count.most_common()) if number > 1}
    listed = {key: text for key, text in count if shared.get(key) == text}
    parts = [INTRODUCTION, _listed(keys.pop(())), SHARED, _listed(listed)]
    first = dict[tuple[str, str], str]()
    for place, entries in keys.items():
        table, name = tables[place], ".".join(place)
        for entry in entries.items():
            first.setdefault(entry, name)
        parts.append(f"## `[[{name}]]`" if table["is_repeated"] else f"## `[{name}]`")
        parts.append(escaped(_line(table.get("description", "").partition("\n\n")[0])))
        if isinstance(free := table.get("additionalProperties"), dict):
            example = _example(place, shipped, None)
            shown = f", as `{example}`" if example else ""
            parts.append(
                f"{'Other keys' if entries else 'Keys'} are names: {_wanted(free)}{shown}."
            )
        own = {k: text for k, text in entries.items() if shared.get(k) != text}
        before = {k: first[k, text] for k, text in own.items() if first[k, text] != name}
        parts.append(
            _listed({k: f": as of `[{before[k]}]`." if k in before else own[k] for k in own})
        )
        more = [code(key) for key, text in entries.items() if shared.get(key) == text]
        parts.append(f"Also {', '.join(more)}." if more else "")
    return "\n\n".join(part for part in parts if part)


def _line(text: str) -> str:
    return " ".join(text.replace("``", "`").split())


def _listed(entries: Mapping[str, str]) -> str:
    return "\n".join(f"- `{key}`{text}" for key, text in entries.items())


def _tables(
    table: Mapping[str, Any], place: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    """The tables with a heading of their own, the whole file first."""
    yield place, table
    for key, value in table.get("properties", {}).items():
        inner = value.get("items", value)
        if _is_table(inner) and not (place and _is_listed(key, inner)):
            yield from _tables({**inner, "is_repeated": inner is not value}, (*place, key))


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) and ("properties" in value or value.get("type") == "object")


def _is_listed(key: str, table: Mapping[str, Any]) -> bool:
    """Whether a table is described in a line of the one that it is in."""
    return key == "columns" or not table.get("properties")


def _keys(
    place: tuple[str, ...], table: Mapping[str, Any], shipped: list[Any]
) -> Iterator[tuple[str, str]]:
    """The keys of a table, required ones first, each with what is said of it."""
    required = table.get("required", ())
    keys = table.get("properties", {}).items()
    for key, value in sorted(keys, key=lambda each: each[0] not in required):
        text = _line(value.get("description", ""))
        usual = value.get("default")
        if not _is_table(value.get("items", value)):
            kind = _wanted(value)
            if key in required:
                kind += ", required"
            elif usual is not None:
                kind = f"{'' if kind == 'Boolean' else kind} = {code(_toml(usual))}".strip()
        elif not place or not _is_listed(key, value.get("items", value)):
            continue
        elif inner := value.get("properties"):
            kind = "table"
            columns = (
                f"`{k}`: {_line(v['description']).removeprefix('Column of ')}"
                for k, v in inner.items()
            )
            text += " " + "; ".join(columns).replace(".; ", "; ")
        else:
            word = _wanted(value["additionalProperties"])
            kind = f"table of {PLURAL.get(word, word)} by name"
        example = _example((*place, key), shipped, usual) or _stated(value)
        has_example = example and kind.startswith(FREE_TEXT) and not re.search(r"\bas ", text)
        yield key, escaped(f" ({kind}): {text}") + (f" As `{example}`." if has_example else "")


def _wanted(value: Mapping[str, Any]) -> str:
    """What may be written, in words."""
    if "enum" in value:
        return ", ".join(code(_toml(word)) for word in value["enum"])
    if "x-unit" in value:
        return f"text, {value['x-unit']}"
    kind = value.get("type")
    if kind == "array":
        word = _wanted(value["items"])
        return f"list of {PLURAL.get(word, word)}"
    if kind == "object":
        inner = value.get("properties", {})
        return "table" + f" of {' and '.join(map(code, inner))}" * bool(inner)
    if isinstance(kind, list):
        return "share" if value.get("examples") else "value"
    words = {"string": "text", "boolean": "Boolean", "integer": "integer"}
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
    found.sort(key=lambda value: value == usual)  # another than the default
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
