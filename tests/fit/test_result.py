"""Records to JSON and back, checkpoints, covariance: against numpy and known answers."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fitting.fit import checkpoint
from fitting.fit.continuation import ContinuationStep
from fitting.fit.result import DerivedResult
from fitting.inference.uncertainty import covariance, in_words, row_sigmas
from fitting.text.errors import BadInput
from fitting.text.records import from_plain, read_json, to_plain, write_json


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
        ({"pair": [1.0]}, r"pair: found .* wanted 2 values"),
        ({"inner": {"x": "text"}}, "inner.x: found 'text', wanted a number"),
        ({"inner": {}}, "inner: found 'nothing', wanted the key 'x'"),
        ({"more": 1}, "found 'more'"),
        ({"maybe": "three"}, "maybe"),
        ({"table": {"a": True}}, "table.a: found 'True', wanted a number"),
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
    with pytest.raises(BadInput, match="no such file"):
        read_json(tmp_path / "none.json", Outer)
    cut = tmp_path / "cut.json"
    cut.write_text('{"inner": {"x": 1.')
    with pytest.raises(BadInput, match="cannot be read as JSON"):
        read_json(cut, Outer)


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "record.json"
    write_json(path, Inner(1.0))
    with pytest.raises(TypeError, match="no place in a JSON file"):
        write_json(path, {"x": object()})
    assert read_json(path, Inner) == Inner(1.0)
    assert [p.name for p in tmp_path.iterdir()] == ["record.json"]


STEP = ContinuationStep(
    0,
    1,
    2,
    1e-3,
    (0.1, 0.2),
    (1.0, 2.0),
    0.5,
    1e-4,
    0.3,
    1e-9,
    "optimal",
    "done",
    7,
    80,
    9,
    800,
    1.5,
)


def test_checkpoints(tmp_path: Path) -> None:
    first = checkpoint.begin(tmp_path, "job one")
    first.record(STEP)
    first.record(replace(STEP, level=3, x=(1 / 3, 1e-300)))
    again = checkpoint.resume(tmp_path, "job one")
    assert len(again) == 2
    assert again.recall(0, 1, 2) == STEP
    found = again.recall(0, 1, 3)
    assert found is not None
    assert found.x == (1 / 3, 1e-300)
    assert again.recall(0, 0, 2) is None
    with pytest.raises(BadInput, match="other data, another FMU or other settings"):
        checkpoint.resume(tmp_path, "job two")
    again.remove()
    assert len(checkpoint.resume(tmp_path, "job two")) == 0


def test_a_checkpoint_is_whole_at_any_moment(tmp_path: Path) -> None:
    """Whoever reads between two writes reads one of them, never a part."""
    kept = checkpoint.begin(tmp_path, "job")
    for level in range(30):
        kept.record(replace(STEP, level=level))
        assert len(checkpoint.resume(tmp_path, "job")) == level + 1


# --- covariance -----------------------------------------------------------------------------------


def test_well_determined_values_have_the_textbook_covariance() -> None:
    generator = np.random.default_rng(5)
    matrix, sigma = generator.standard_normal((40, 3)), generator.uniform(0.01, 0.02, 40)
    errors = covariance(matrix, 0.5 * sigma, sigma, np.full(3, 1e6), 0.0)
    expected = np.linalg.inv(matrix.T @ np.diag(sigma**-2) @ matrix)
    assert errors.total == pytest.approx(expected, rel=1e-6)
    assert errors.inflation == 1.0
    for i in range(3):
        std, shrinkage = errors.of(np.eye(3)[i])
        assert std == pytest.approx(math.sqrt(expected[i, i]), rel=1e-6)
        assert shrinkage > 0.999999
        assert in_words(shrinkage) == "determined"


def test_linear_least_squares_scatter_as_the_covariance_says() -> None:
    generator = np.random.default_rng(6)
    matrix, sigma = generator.standard_normal((12, 2)), np.full(12, 0.03)
    draws = [
        np.linalg.lstsq(matrix, 0.03 * generator.standard_normal(12), rcond=None)[0]
        for _ in range(4000)
    ]
    errors = covariance(matrix, np.zeros(12), sigma, np.full(2, 1e3), 0.0)
    assert np.sqrt(np.diag(errors.total)) == pytest.approx(np.std(draws, axis=0), rel=0.05)


def test_what_the_data_do_not_see_keeps_the_width_of_its_box() -> None:
    matrix = np.column_stack([np.ones(10), np.zeros(10)])
    errors = covariance(matrix, np.zeros(10), np.full(10, 0.01), np.array([2.0, 6.0]), 1e-9)
    std, shrinkage = errors.of(np.array([0.0, 1.0]))
    assert std == pytest.approx(6.0 / math.sqrt(12.0), rel=1e-6)  # of a uniform distribution
    assert shrinkage == pytest.approx(0.0, abs=1e-12)
    assert in_words(shrinkage) == "not determined"
    std, shrinkage = errors.of(np.array([1.0, 0.0]))
    assert std == pytest.approx(0.01 / math.sqrt(10.0), rel=1e-3)
    assert in_words(shrinkage) == "determined"


def test_a_known_sum_does_not_make_its_terms_determined() -> None:
    matrix = np.ones((10, 2))
    errors = covariance(matrix, np.zeros(10), np.full(10, 1e-6), np.array([2.0, 2.0]), 1e-9)
    assert in_words(errors.of(np.array([1.0, 1.0]))[1]) == "determined"
    assert in_words(errors.of(np.array([1.0, 0.0]))[1]) == "not determined"


def test_the_error_of_the_scale_is_common_to_all_rows() -> None:
    matrix = np.ones((10, 1))
    errors = covariance(
        matrix, np.zeros(10), np.full(10, 0.01), np.array([1e3]), 0.0, scale_sigma=0.02
    )
    assert errors.of(np.ones(1))[0] == pytest.approx(math.hypot(0.01 / math.sqrt(10), 0.02))


def test_residuals_above_the_noise_widen_the_errors() -> None:
    matrix = np.ones((11, 1))
    residuals = np.array([0.05, -0.05] * 5 + [0.0])
    errors = covariance(matrix, residuals, np.full(11, 0.01), np.array([1e3]), 0.0)
    assert errors.inflation == pytest.approx(5.0, rel=1e-6)


def test_rows_of_a_structured_sweep_weigh_as_their_independent_points() -> None:
    """Weighted mean of four rows of sigma 0.01 and nine that are worth one."""
    matrix, sigma = np.ones((13, 1)), np.full(13, 0.01)
    errors = covariance(
        matrix, np.zeros(13), sigma, np.array([1e3]), 0.0, swept=slice(4, None), widening=3.0
    )
    assert errors.of(np.ones(1))[0] == pytest.approx(0.01 / math.sqrt(4 + 1))
    assert (errors.inflation, errors.widening) == (1.0, 3.0)


def test_unknown_sigmas_are_the_scatter_of_their_rows() -> None:
    residuals = np.array([0.1, 0.03, -0.04])
    found = row_sigmas(np.array([0.02, 0.0, 0.0]), residuals)
    assert found == pytest.approx([0.02, math.sqrt((0.0009 + 0.0016) / 2), math.sqrt(0.00125)])


def test_a_derived_value_without_data_is_not_printed_as_one() -> None:
    held = DerivedResult(
        647400.0,
        "Hz",
        (647399.0, 647401.0),
        647400.0,
        1.4,
        2e2,
        (647000.0, 647800.0),
        6.5e5,
        0.99,
        "determined",
        (6e4, 7.8e5),
    )
    assert held.text() == "647400 ± 2e+02"
    free = replace(held, shrinkage=1e-4, identifiable="not determined")
    assert "±" not in free.text()
    assert "60000 to 780000" in free.text()


def read_rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))
