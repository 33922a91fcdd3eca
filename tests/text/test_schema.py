"""Tables to records: every complaint with its place, all of them at once, and never a crash."""

from __future__ import annotations

import datetime
import json
import math
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fitting.campaign.file import WrittenCampaign
from fitting.text.errors import BadInput, gathered
from fitting.text.schema import (
    Count,
    FileName,
    Keys,
    Missing,
    OneOf,
    Quantity,
    Refused,
    Share,
    Text,
    Texts,
    Usually,
    Value,
    json_schema,
    listed,
    read_record,
)
from fitting.text.toml import read_toml
from fitting.text.units import Written

PATH = Path("folder/file.toml")
#: Words of the records below, which complaints hand on.
MISSING, GOOD = "wanted a or b", "wanted a good name"


@dataclass(frozen=True, kw_only=True)
class Inner(Keys):
    """A table in a table."""

    name: Text
    """How it is
    called."""
    share: Share = 0.0
    """A share."""

    def __post_init__(self) -> None:
        if self.name == "evil":
            raise Refused(f"found 'evil', {GOOD}", "name")


@dataclass(frozen=True, kw_only=True)
class Outer(Keys):
    """All kinds of keys."""

    word: Annotated[Text, OneOf(("a", "b")), Missing(MISSING)]
    """One of two."""
    names: Texts = ()
    """Texts."""
    count: Annotated[Count | None, Usually(7)] = None
    """A number."""
    width: Annotated[float | None, Quantity("Hz")] = None
    """A width."""
    file: FileName | None = None
    """A file."""
    level: Value = field(default_factory=lambda: Written(1.0, None, ""))
    """A level."""
    inner: Annotated[tuple[Inner, ...], listed("[[inner]] tables", least=0)] = ()
    """Tables."""


def complaints(data: object) -> list[str]:
    with pytest.raises(BadInput) as caught:
        read_record(Outer, data, PATH)
    return str(caught.value).split("\n")


def test_a_record_with_the_places_of_its_values() -> None:
    data = {
        "word": "b",
        "width": "2 kHz",
        "file": "a/b.csv",
        "level": "3 mV",
        "names": ["x"],
        "inner": [{"name": "n", "share": "5 %"}],
    }
    assert read_record(Outer, data, PATH) == Outer(
        word="b",
        names=("x",),
        width=2000.0,
        file=Path("folder/a/b.csv"),
        level=Written("3 mV", None, "folder/file.toml: level"),
        inner=(Inner(name="n", share=0.05),),
    )
    in_table = read_record(Outer, {"word": "a", "level": 2}, PATH, "table")
    assert in_table.level.where == "folder/file.toml: [table] level"


def test_all_complaints_at_once() -> None:
    data = {
        "names": ["x", "x"],
        "count": True,
        "width": 3.0,
        "file": 4,
        "level": math.nan,
        "levle": 1,
        "inner": [{"name": "ok"}, {"name": "evil"}, {"name": "n", "share": 1}, {"sharp": 1}, 5],
    }
    wanted = (
        ("top level: ", "'word'", MISSING),
        ("names: ", "['x', 'x']"),
        ("count: ", "True", "1000000"),
        ("width: ", "3.0", '"3.0 Hz"'),
        ("file: ", "4"),
        ("level: ", "nan"),
        ("top level: ", "'levle'", "'level'"),
        ("[inner 'evil'] name: ", "'evil'", GOOD),
        ("[inner 'n'] share: ", "1", '"1 %"'),
        ("[inner '4']: ", "'name'"),
        ("[inner '4']: ", "'sharp'", "'share'"),
        ("[inner '5']: ", "5"),
    )
    said = complaints(data)
    assert len(set(said)) == len(wanted)
    for place, *tokens in wanted:
        lines = [line for line in said if line.startswith(f"{PATH}: {place}")]
        assert any(all(token in line for token in tokens) for line in lines), (place, tokens)


def test_a_misspelt_key_is_not_missing_as_well() -> None:
    for data, tokens in (
        ({"wrod": "a"}, ("top level: ", "'wrod'", "'word'")),
        ([], ("top level: ", "[]")),
        ({"word": "c"}, ("word: ", "'c'", '"a", "b"')),
    ):
        [said] = complaints(data)
        assert said.startswith(f"{PATH}: ")
        assert all(token in said for token in tokens)


def test_the_schema_has_words_choices_units_and_defaults() -> None:
    schema = json_schema(Outer, title="Of a test")
    assert schema["title"] == "Of a test"
    keys = schema["properties"]
    assert keys["word"] == {"type": "string", "enum": ["a", "b"], "description": "One of two."}
    assert keys["count"]["default"] == 7
    assert keys["width"]["x-unit"] == "Hz"
    assert "default" not in keys["width"]
    assert keys["inner"]["items"]["properties"]["name"]["description"] == "How it is called."
    assert keys["inner"]["items"]["required"] == ["name"]
    assert schema["additionalProperties"] is False
    json.dumps(schema)


def test_readers_are_all_asked() -> None:
    def fails(*lines: str) -> int:
        raise BadInput(*lines)

    assert gathered([lambda: 1, lambda: 2]) == [1, 2]
    with pytest.raises(BadInput) as caught:
        gathered([lambda: fails("a", "b"), lambda: 1, lambda: fails("c"), lambda: fails("a")])
    assert caught.value.args == ("a", "b", "c")


CAMPAIGN = read_toml(Path(__file__).parents[2] / "data" / "string_q1" / "campaign.toml")
LEAVES = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=6)
    | st.sampled_from(["1 %", "3 Hz", "tones", "csv", "{experiment}", "1e999 Hz", "2*u1 - u2"])
    | st.just(datetime.date(2020, 1, 1))
)
ANYTHING = st.recursive(
    LEAVES,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["name", "set", "before", "x"]), inner, max_size=3)
    ),
    max_leaves=6,
)


@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_whatever_a_campaign_holds_it_is_read_or_complained_of(data: st.DataObject) -> None:
    """A value of it, or a new key, is anything that TOML can hold."""
    tables: Any = deepcopy(CAMPAIGN)
    inside: Any = tables
    for _ in range(data.draw(st.integers(1, 3))):
        places = list(inside) if isinstance(inside, dict) else list(range(len(inside)))
        further = [k for k in places if isinstance(inside[k], dict | list) and inside[k]]
        if not further:
            break
        inside = inside[data.draw(st.sampled_from(further))]
    keys = list(inside) if isinstance(inside, dict) else list(range(len(inside)))
    new = ["", "x", "model", "ends", "order"] if isinstance(inside, dict) else []
    inside[data.draw(st.sampled_from([*keys, *new]))] = data.draw(ANYTHING)
    try:
        said = [repr(read_record(WrittenCampaign, tables, PATH))]
        wanted = "WrittenCampaign("
    except BadInput as error:
        said, wanted = list(map(str, error.args)), f"{PATH}: "
    assert said
    assert all(line.startswith(wanted) for line in said)
