"""Large files: refused at once, or a line of progress soon after the start."""

from __future__ import annotations

import os
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from fitting.campaign.recognised import recognised
from fitting.cli.running import progress
from fitting.text.errors import BadInput
from fitting.text.frequency import hertz_of
from fitting.text.loose_tables import find_table


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
    assert len({column.name for column in found.table.columns}) == count


class Said:
    """A stream in a pipe that tells when something was written."""

    def __init__(self) -> None:
        self.text, self.written = "", threading.Event()

    def write(self, text: str) -> int:
        self.text += text
        self.written.set()
        return len(text)

    def flush(self) -> None:
        pass

    def isatty(self) -> bool:
        return False


@pytest.mark.parametrize("size", [20_000_000, 1000])
def test_progress_of_a_large_file_is_shown_soon(
    size: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "large.csv"
    path.touch()
    os.truncate(path, size)
    monkeypatch.setattr(progress, "SOON_S", 0.01)
    monkeypatch.setattr(sys, "stderr", said := Said())
    with progress.reading("line", [path]):
        shown = said.written.wait(30.0 if size > 1e6 else 0.2)
    assert shown is (size > 1e6)
    assert ("large.csv" in said.text) is shown


def test_hertz_of_many_points_are_the_same_numbers() -> None:
    values = np.array([0.1, 6940160.0, 1e10])
    np.testing.assert_array_equal(hertz_of(values, "Hz", where=""), values)
