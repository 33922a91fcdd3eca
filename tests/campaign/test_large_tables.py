"""Large files: refused at once, or read in one pass."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fitting.campaign.instruments.loose_tables import find_table
from fitting.campaign.recognised import recognised
from fitting.text.errors import BadInput
from fitting.text.tables import hertz_of
from tests.support.in_process import told
from tests.support.lines import write_csv

pytestmark = pytest.mark.usefixtures("swift_models")


def test_a_table_of_a_hundred_thousand_columns_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "wide.csv"
    head = ",".join(f"c{k}" for k in range(100_000))
    row = ",".join(["0.5"] * 100_000)
    path.write_text("\n".join([head, *[row] * 3]) + "\n", "utf-8")
    with pytest.raises(BadInput, match="100000 columns"):
        recognised(path)


def test_names_of_many_columns_are_told_apart_in_one_pass(tmp_path: Path) -> None:
    """Each name was compared with all before it: 100,000 of them took minutes."""
    count = 20_000
    text = "\n".join([" ".join(["x"] * count), *[" ".join(["1"] * count)] * 3])
    found = find_table(tmp_path / "t.txt", text)
    assert found is not None
    assert len({column.name for column in found[0].columns}) == count


def test_hertz_of_many_points_are_the_same_numbers() -> None:
    values = np.array([0.1, 6940160.0, 1e10])
    np.testing.assert_array_equal(hertz_of(values, "Hz", where=""), values)


@pytest.mark.parametrize("command", ["line", pytest.param("init", marks=pytest.mark.nightly)])
def test_a_wide_table_is_refused_in_one_line(command: str, tmp_path: Path) -> None:
    path = tmp_path / "wide.csv"
    head = "frequency (Hz)," + ",".join(f"c{k} (V)" for k in range(99_999))
    row = ",".join(["0.5"] * 99_999)
    rows = [f"{1000 + k},{row}" for k in range(12)]
    path.write_text("\n".join([head, *rows]) + "\n", "utf-8")
    ended = told(command, path, "--out", tmp_path / "out")
    assert (ended.code, ended.out) == (2, "")
    said = [line for line in ended.err.splitlines() if line.startswith("fmu-fit: ")]
    assert len(said) == 1  # beside its progress, on a slow machine
    assert "100000 columns" in said[0]


@pytest.mark.parametrize("command", ["line", pytest.param("init", marks=pytest.mark.nightly)])
def test_a_long_table_is_read_a_few_times(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is opened as often whatever its length."""
    opened: dict[str, int] = {}
    real = io.open

    def counted_open(file: Any, *words: Any, **more: Any) -> Any:
        name = Path(file).name if isinstance(file, (str, Path)) else ""
        opened[name] = opened.get(name, 0) + 1
        return real(file, *words, **more)

    monkeypatch.setattr(io, "open", counted_open)
    monkeypatch.setattr("builtins.open", counted_open)
    for count in (100, 1_500):
        f = 1e5 + np.linspace(-3e3, 3e3, count)
        a = 1.0 / np.sqrt(1.0 + (2.0 * (f - 1e5) / 120.0) ** 2)
        a = np.abs(a + 0.01 * np.random.default_rng(1).standard_normal(count))
        write_csv(tmp_path / f"{count}.csv", "frequency (Hz),amplitude (V)", f, a)
        opened.pop(f"{count}.csv", None)
        ended = told(command, tmp_path / f"{count}.csv", "--out", tmp_path / f"out{count}")
        assert ended.code == 0, ended.err
    assert opened["1500.csv"] == opened["100.csv"]
