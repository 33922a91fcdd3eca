"""Records to JSON and back, checkpoints: against known answers."""

from __future__ import annotations

import csv
import io
import json
import pickle
from dataclasses import dataclass, fields, replace
from pathlib import Path

import jsonschema
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fitting.api.fitted import Value
from fitting.fit import checkpoint
from fitting.fit.path import GLOBAL, PATH, PathLevel
from fitting.result.result import Result, read_result, write_result
from fitting.text.errors import BadInput
from fitting.text.estimate import FittedEstimate, OutputEstimate, Verdict
from fitting.text.old_names import RENAMED
from fitting.text.records import from_plain, read_json, to_plain, write_json

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Inner:
    x: float
    label: str = "none"


@dataclass(frozen=True)
class Outer:
    inner: Inner
    pair: tuple[float, float]
    many: tuple[Inner, ...]
    table: dict[str, float]
    flag: bool | float | str
    maybe: int | None


numbers = st.floats(allow_nan=True, allow_infinity=True)


@given(
    values=st.lists(numbers, min_size=2, max_size=2),
    table=st.dictionaries(st.text(max_size=5), numbers, max_size=4),
    flag=st.booleans() | st.text(max_size=5) | st.floats(allow_nan=False, allow_infinity=False),
    maybe=st.none() | st.integers(),
)
@settings(max_examples=200, deadline=None)
def test_records_come_back_as_they_went(values, table, flag, maybe) -> None:  # type: ignore[no-untyped-def]
    first, second = values
    many = (Inner(1.0, "a"), Inner(second))
    record = Outer(Inner(first), (first, second), many, table, flag, maybe)
    text = json.dumps(to_plain(record), allow_nan=False)
    back = from_plain(Outer, json.loads(text))
    assert repr(back) == repr(record)  # repr tells NaN from NaN and -0.0 from 0.0
    assert type(back.flag) is type(flag)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"pair": [1.0]}, r"pair: .*\b2\b"),
        ({"inner": {"x": "text"}}, r"inner\.x: .*'text'"),
        ({"inner": {}}, "inner: .*'x'"),
        ({"more": 1}, "'more'"),
        ({"maybe": "three"}, "maybe"),
        ({"table": {"a": True}}, r"table\.a: .*'True'"),
    ],
)
def test_what_is_no_record_is_refused_by_key(
    change: dict[str, object], words: str, tmp_path: Path
) -> None:
    record = Outer(Inner(1.0), (1.0, 2.0), (), {}, False, None)
    path = tmp_path / "record.json"
    path.write_text(json.dumps(to_plain(record) | change))
    with pytest.raises(BadInput, match=words) as caught:
        read_json(path, Outer)
    assert str(path) in str(caught.value)


def test_files_that_are_missing_or_cut_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"none\.json"):
        read_json(tmp_path / "none.json", Outer)
    cut = tmp_path / "cut.json"
    cut.write_text('{"inner": {"x": 1.')
    with pytest.raises(BadInput, match=r"cut\.json"):
        read_json(cut, Outer)


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "record.json"
    write_json(path, Inner(1.0))
    with pytest.raises(TypeError, match="object"):
        write_json(path, {"x": object()})
    assert read_json(path, Inner) == Inner(1.0)
    assert [p.name for p in tmp_path.iterdir()] == ["record.json"]


STEP = PathLevel(
    kind=PATH,
    alternative=0,
    level=2,
    nu=1e-3,
    x=(0.1, 0.2),
    parameters=(1.0, 2.0),
    j_fit=0.5,
    j_reg=1e-4,
    change=0.3,
    optimality=1e-9,
    second_j=0.5,
    status="converged",
    message="done",
    iterations=7,
    evaluations=80,
    jacobians=9,
    runs=800,
    seconds=1.5,
)


def test_checkpoints(tmp_path: Path) -> None:
    first = checkpoint.Checkpoint(tmp_path, "job one")
    first.record(STEP)
    first.record(replace(STEP, level=3, x=(1 / 3, 1e-300)))
    again = checkpoint.Checkpoint(tmp_path, "job one", resume=True)
    assert len(again) == 2
    assert again.recall(PATH, 0, 2) == STEP
    found = again.recall(PATH, 0, 3)
    assert found is not None
    assert found.x == (1 / 3, 1e-300)
    assert again.recall(GLOBAL, 0, 2) is None
    with pytest.raises(BadInput, match=checkpoint.NAME.replace(".", r"\.")):
        checkpoint.Checkpoint(tmp_path, "job two", resume=True)
    again.record(replace(STEP, runs=1))  # a later one of a place counts
    assert checkpoint.Checkpoint(tmp_path, "job one", resume=True).recall(PATH, 0, 2) == replace(
        STEP, runs=1
    )
    path = tmp_path / checkpoint.NAME
    assert again.resumed().startswith("2 ")
    assert again.resumed().endswith(f" {path}")
    again.remove()
    assert len(checkpoint.Checkpoint(tmp_path, "job two", resume=True)) == 0
    assert str(path) in checkpoint.Checkpoint(tmp_path, "job two", resume=True).resumed()
    path.write_text('{"job": "one"}\n{"kind": "a"}\n')
    with pytest.raises(BadInput, match=r"row 2: .*'level'"):
        checkpoint.Checkpoint(tmp_path, "one", resume=True)


def test_a_checkpoint_is_whole_at_any_moment(tmp_path: Path) -> None:
    """Whoever reads between two writes reads one of them, never a part."""
    kept = checkpoint.Checkpoint(tmp_path, "job")
    for level in range(30):
        kept.record(replace(STEP, level=level))
        assert len(checkpoint.Checkpoint(tmp_path, "job", resume=True)) == level + 1


def test_a_derived_value_is_printed_with_its_error() -> None:
    held = OutputEstimate(
        name="lambda",
        value=647400.0,
        unit="Hz",
        values=(647399.0, 647401.0),
        spread=1.4,
        std=2e2,
        ci95=(647000.0, 647800.0),
        reference=6.5e5,
        shrinkage=0.99,
        status=Verdict.DETERMINED,
        lower=6e4,
        upper=7.8e5,
        algorithm2=647300.0,
    )
    assert held.likely_words.replace("\u00a0", " ") == "647.40 ± 0.20 kHz"


def read_rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_a_result_of_schema_1_is_read_with_every_number(tmp_path: Path) -> None:
    """The file was written by the version before schema 2: three curves are cut to three points."""
    path = Path(__file__).with_name("result_schema1.json")
    old, new = json.loads(path.read_text("utf-8")), read_result(path)
    assert new.schema == 2
    for key in ("parameters", "derived"):
        for name, before in old[key].items():
            after = getattr(new, key)[name]
            assert (after.name, after.status) == (name, before["identifiable"])
            assert (after.value, after.std, list(after.ci95)) == (
                before["value"],
                before["std"],
                before["ci95"],
            )
            assert after.bars.below == pytest.approx(before["bars"]["below"], rel=1e-9)
            assert after.bars.is_even == before["bars"]["is_even"]
            assert after.precision == pytest.approx(before["precision"], rel=1e-9)
    width = new.derived["width_plus"]
    assert list(width.bounds) == old["derived"]["width_plus"]["box"]
    assert read_result(write_result(new, tmp_path)[0]) == new


def test_a_result_obeys_the_published_schema() -> None:
    published = json.loads((ROOT / "docs/reference/result.schema.json").read_text("utf-8"))
    assert set(published["properties"]) == {each.name for each in fields(Result)}
    new = to_plain(read_result(Path(__file__).with_name("result_schema1.json")))
    jsonschema.validate(new, published)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**new, "title": 3}, published)


def test_names_of_0_2_work_with_a_warning_until_they_go() -> None:
    result = read_result(Path(__file__).with_name("result_schema1.json"))
    d1 = result.parameters["d1"]
    shared = {each.name: getattr(d1, each.name) for each in fields(FittedEstimate)}
    value = Value(**shared, scan=result.scans["d1"])
    for old, new in RENAMED.items():
        now, _, side = new.partition(" ")
        record = value if hasattr(value, now) else value.scan
        with pytest.warns(DeprecationWarning, match=f"'{now}'"):
            found = getattr(record, old)
        wanted = getattr(record, now)
        assert repr(found) == repr(wanted[["low", "high"].index(side)] if side else wanted)
    with pytest.raises(AttributeError, match="colour"):
        d1.colour  # type: ignore[attr-defined]  # noqa: B018
    assert repr(pickle.loads(pickle.dumps(d1))) == repr(d1)
