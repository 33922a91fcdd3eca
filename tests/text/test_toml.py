"""TOML edited in any spelling: values changed, remarks and layout kept, all of it readable."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fitting.text.errors import BadInput
from fitting.text.toml import Tables, inline, put, read_toml, rewritten, toml_text

WRITTEN = """\
# who wrote it

title = "A"  # of the series
drive.kind = "tones"
drive.frequencies = [
  "u1",  # the low one
  "u2",
]
fmu = { file = "a.fmu", start = { d1 = 1.0 } }

# remark in front of the sweep
[sweep]   # weak
file   = "a.csv"      # aligned
use = "fit"

[design]
number = 3
[[parameters]]
name = "d1"  # first
[[parameters]]
name = "d2"
"""


def test_an_edit_changes_its_values_and_nothing_else() -> None:
    def edit(tables: Tables) -> None:
        tables["title"] = "B"
        tables["drive"]["frequencies"] = ["u1"]
        tables["fmu"]["file"] = "../a.fmu"
        tables["sweep"]["file"] = "sweep.csv"
        put(tables["sweep"], "use", "scale", "fitted once")
        put(tables, "noise", {"relative": "1 %"}, "declared")
        tables.pop("design", None)

    assert rewritten(WRITTEN, edit, ["made by B"]) == (
        "# made by B\n"
        'title = "B"  # of the series\n'
        'drive.kind = "tones"\n'
        'drive.frequencies = ["u1"]\n'
        'fmu = { file = "../a.fmu", start = { d1 = 1.0 } }\n'
        "\n"
        "# remark in front of the sweep\n"
        "[sweep]   # weak\n"
        'file   = "sweep.csv"      # aligned\n'
        'use = "scale" # fitted once\n'
        "\n"
        "[[parameters]]\n"
        'name = "d1"  # first\n'
        "[[parameters]]\n"
        'name = "d2"\n'
        "\n"
        "[noise] # declared\n"
        'relative = "1 %"\n'
    )


def test_a_table_is_put_where_the_old_one_stood() -> None:
    def edit(tables: Tables) -> None:
        put(tables, "a", {"eta": inline({"before": "1 Hz", "after": "2 Hz"})})

    text = "[a]\nold = 1\n\n# of b\n[b]\nx = 1\n"
    assert rewritten(text, edit) == (
        '[a]\neta = {before = "1 Hz", after = "2 Hz"}\n\n# of b\n[b]\nx = 1\n'
    )


def test_numbers_are_read_back_as_they_were() -> None:
    values = {"a": 0.1 + 0.2, "b": 1e-300, "c": -math.inf, "d": 7, "e": True, "f": [1.0, [2]]}
    assert tomllib.loads(toml_text(values, ["head"])) == values
    assert math.isnan(tomllib.loads(toml_text({"x": math.nan}))["x"])
    assert toml_text({}, ["one", ""]) == "# one\n#\n"


def test_what_is_not_toml_is_named_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("a = 1\nb = = 2\n")
    with pytest.raises(BadInput, match=r"a\.toml: .*TOML: .*line 2"):
        read_toml(tmp_path / "a.toml")
    with pytest.raises(BadInput, match=r"b\.toml: "):
        read_toml(tmp_path / "b.toml")


KEYS = st.text("abc. -\"'é", min_size=1, max_size=4)
SCALARS = (
    st.booleans()
    | st.integers(-(2**60), 2**60)
    | st.floats(allow_nan=False)
    | st.text(st.characters(codec="utf-8", exclude_categories=["Cs"]), max_size=5)
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=8,
)


@settings(max_examples=150, deadline=None)
@given(before=st.dictionaries(KEYS, VALUES, max_size=4), key=KEYS, value=VALUES)
def test_whatever_is_edited_says_what_the_edit_says(
    before: dict[str, object], key: str, value: object
) -> None:
    def edit(tables: Tables) -> None:
        tables.pop("a", None)
        put(tables, key, value)

    text = toml_text(before)
    assert tomllib.loads(text) == before
    expected = {name: item for name, item in before.items() if name != "a"} | {key: value}
    assert tomllib.loads(rewritten(text, edit)) == expected
