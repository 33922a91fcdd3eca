"""Cells that are no numbers are told all at once, wherever a file is read."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.campaign.instruments import read_recording, read_trace
from fitting.measurements.complex_sweep import read_complex
from fitting.text.errors import BadInput


def told_rows(said: str) -> list[int]:
    """Numbers of the rows that a complaint names."""
    return [int(number) for number in re.findall(r"row (\d+)", said)]


def written(path: Path, head: str, columns: int, cells: dict[tuple[int, int], str]) -> Path:
    """Rows 2 to 101 under a head; ``cells`` by row and column, both from 1."""
    rows = [[str(100.0 + n)] + ["1.5"] * (columns - 1) for n in range(2, 102)]
    for (row, column), text in cells.items():
        rows[row - 2][column - 1] = text
    path.write_text("\n".join([head, *map(",".join, rows)]) + "\n")
    return path


READERS: dict[str, tuple[str, int, str, Callable[[Path], object]]] = {
    "line": ("frequency (Hz),R (V)", 2, "R", ff.line),
    "a campaign's sweep": (
        "frequency (Hz),amplitude (V)",
        2,
        "amplitude",
        lambda path: read_trace(path, None),
    ),
    "complex values": ("frequency (Hz),X (V),Y (V)", 3, "X", read_complex),
    "a ringdown": ("time (s),u (V)", 2, "u", ff.ringdown),
}


@pytest.mark.parametrize("name", READERS)
def test_all_cells_of_all_columns_are_told_at_once(name: str, tmp_path: Path) -> None:
    head, count, column, read = READERS[name]
    cells = {(7, 1): "nan", (9, 2): "x", (12, 2): ""}
    path = written(tmp_path / "a.csv", head, count, cells)
    with pytest.raises(BadInput) as refused:
        read(path)
    first = head.partition(" ")[0]
    one, other = map(str, refused.value.args)
    assert one.startswith(f"{path}: row 7, column '{first}': found 'nan', ")
    assert told_rows(one) == [7]
    assert other.startswith(f"{path}: row 9, column '{column}': found 'x', ")
    assert other.endswith("row 12 ('')")
    assert told_rows(other) == [9, 12]


@pytest.mark.parametrize(
    ("rows", "named", "others"),
    [
        (range(4, 6), [4, 5], []),
        (range(4, 8), [4, 5, 6, 7], []),
        (range(4, 9), [4, 5, 6, 7], ["1"]),
        (range(4, 90), [4, 5, 6, 7], ["82"]),
    ],
    ids=["two", "four", "five", "many"],
)
def test_a_few_are_named_and_the_others_counted(
    rows: range, named: list[int], others: list[str], tmp_path: Path
) -> None:
    path = written(tmp_path / "a.csv", "f (Hz),R (V)", 2, {(row, 2): "nan" for row in rows})
    with pytest.raises(BadInput) as refused:
        ff.line(path)
    said = str(refused.value)
    assert said.startswith(f"{path}: row 4, column 'R': found 'nan', ")
    assert told_rows(said) == named
    assert re.findall(r" (\d+) others?\b", said) == others


def test_of_binary_files_and_instruments_as_well(tmp_path: Path) -> None:
    mat = pytest.importorskip("scipy.io")
    values = np.ones(20)
    values[[3, 8]] = np.nan
    mat.savemat(tmp_path / "a.mat", {"f_Hz": np.arange(20.0), "R_V": values})
    recording = read_recording(tmp_path / "a.mat")
    [channel] = [c for c in recording.channels if c.name.startswith("R")]
    with pytest.raises(BadInput, match=r"found nan.*\(nan\)$"):
        recording.numbers(channel)
    rs = tmp_path / "rs.dat"
    rs.write_text("Type;FSV;\nx-Unit;Hz;\ny-Unit;V;\nValues;3;\n1;nan;\nx;2;\n3;nan;\n")
    recording = read_recording(rs)
    with pytest.raises(BadInput) as refused:
        recording.check(recording.channels)
    one, other = (line.partition(": ")[2] for line in map(str, refused.value.args))
    assert one.startswith("row 6, column 'Frequency': found 'x'")
    assert other.startswith("row 5, column 'Level': found 'nan'")
    assert told_rows(other) == [5, 7]
