"""The JSON Schema for editors: what is shipped is what the reader checks, and campaigns suit it."""

from __future__ import annotations

import json
import runpy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from fitting.campaign.file import WrittenCampaign
from fitting.measurements import schema as schema_of_campaigns
from fitting.measurements.schema import SCHEMA_FILE, campaign_schema
from fitting.text.errors import BadInput
from fitting.text.schema import read_record
from fitting.text.toml import read_toml

CAMPAIGNS = sorted((Path(__file__).parents[2] / "data").glob("*/campaign.toml"))


@pytest.fixture(scope="module")
def schema() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(SCHEMA_FILE.read_text(encoding="utf-8"))
    return found


def test_what_is_shipped_is_what_is_checked(capsys: pytest.CaptureFixture[str]) -> None:
    """After a change of a key: python -m fitting.measurements.schema > its file."""
    assert SCHEMA_FILE.read_text(encoding="utf-8") == campaign_schema()
    runpy.run_path(schema_of_campaigns.__file__, run_name="__main__")
    assert capsys.readouterr() == (campaign_schema(), "")


@pytest.mark.parametrize("path", CAMPAIGNS, ids=lambda path: path.parent.name)
def test_shipped_campaigns_suit_it(path: Path, schema: dict[str, Any]) -> None:
    jsonschema.Draft7Validator.check_schema(schema)
    jsonschema.validate(read_toml(path), schema, jsonschema.Draft7Validator)


def entries(schema: dict[str, Any], place: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    for key, entry in schema.get("properties", {}).items():
        yield f"{place}{key}", entry
        yield from entries(entry, f"{place}{key}.")
        yield from entries(entry.get("items", {}), f"{place}{key}.")


def test_every_key_says_what_it_means(schema: dict[str, Any]) -> None:
    found = dict(entries(schema))
    assert {"title", "fmu.start", "sweep.set", "parameters.prior", "drift.model"} <= set(found)
    assert [place for place, entry in found.items() if len(entry["description"]) < 10] == []
    assert "$ref" not in SCHEMA_FILE.read_text(encoding="utf-8")
    assert found["observe.line_width"]["x-unit"] == "Hz"
    assert found["drive.samples_per_period"]["default"] == 200
    assert found["drive.level"]["default"] == 1.0
    assert found["sweep.layout"]["enum"][:2] == ["csv", "afm"]
    assert found["sweep.layout"].get("default") is None  # the file's content tells
    assert found["continuation.beta"]["default"] == 0.1
    assert set(schema["required"]) == {"title", "fmu", "observe", "parameters"}


@pytest.mark.parametrize(
    ("table", "key", "value"),
    [
        ("observe", "steady", True),
        ("fmu", "timeout_s", 0),
        ("fmu", "timeout_s", "60 s"),
        ("observe", "line_width", 100.0),
        ("drive", "kind", "tone"),
        ("drive", "frequencies", ["u1", "u1"]),
        ("drift", "eta", {"before": 1.0}),
        ("drift", "modell", "walk"),
        ("continuation", "starts", 0),
        ("alternatives", "reflection", []),
        ("noise", "outliers", "none"),
        ("accuracy", "reductions", [{"name": "a"}]),
    ],
)
def test_editor_and_reader_refuse_the_same(
    table: str, key: str, value: object, schema: dict[str, Any]
) -> None:
    """Both refuse it, and neither the campaign without it."""
    tables = read_toml(CAMPAIGNS[0].parent.parent / "string_q1" / "campaign.toml")
    jsonschema.validate(tables, schema)
    tables.setdefault(table, {})[key] = value
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(tables, schema)
    with pytest.raises(BadInput, match=rf"c\.toml: \[{table}"):
        read_record(WrittenCampaign, tables, Path("c.toml"))
