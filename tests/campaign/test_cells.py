"""Cells that are no numbers are told all at once, wherever a file is read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.campaign.complex_trace import read_complex
from fitting.campaign.instruments import read_recording, read_trace
from fitting.text.errors import BadInput

LEAVE = "; where nothing was measured leave the row out, or end a sampled record before it"


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
    assert refused.value.args == (
        f"{path}: row 7, column '{first}': found 'nan', wanted a finite number{LEAVE}",
        f"{path}: row 9, column '{column}': found 'x', wanted a finite number; also row 12 ('')",
    )


@pytest.mark.parametrize(
    ("rows", "also"),
    [
        (range(4, 6), "; also row 5 ('nan')"),
        (range(4, 8), "; also row 5 ('nan'), row 6 ('nan') and row 7 ('nan')"),
        (range(4, 9), "; also row 5 ('nan'), row 6 ('nan'), row 7 ('nan') and 1 other"),
        (range(4, 90), "; also row 5 ('nan'), row 6 ('nan'), row 7 ('nan') and 82 others"),
    ],
    ids=["two", "four", "five", "many"],
)
def test_a_few_are_named_and_the_others_counted(rows: range, also: str, tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "f (Hz),R (V)", 2, {(row, 2): "nan" for row in rows})
    with pytest.raises(BadInput) as refused:
        ff.line(path)
    where = f"{path}: row 4, column 'R': found 'nan', wanted a finite number"
    assert str(refused.value) == where + also + LEAVE


def test_of_binary_files_and_instruments_as_well(tmp_path: Path) -> None:
    mat = pytest.importorskip("scipy.io")
    values = np.ones(20)
    values[[3, 8]] = np.nan
    mat.savemat(tmp_path / "a.mat", {"f_Hz": np.arange(20.0), "R_V": values})
    recording = read_recording(tmp_path / "a.mat")
    [channel] = [c for c in recording.channels if c.name.startswith("R")]
    with pytest.raises(BadInput, match=r"found nan, wanted a finite number; also .*\(nan\)$"):
        recording.numbers(channel)
    rs = tmp_path / "rs.dat"
    rs.write_text("Type;FSV;\nx-Unit;Hz;\ny-Unit;V;\nValues;3;\n1;nan;\nx;2;\n3;nan;\n")
    with pytest.raises(BadInput) as refused:
        read_recording(rs)
    assert [line.partition(": ")[2] for line in refused.value.args] == [
        "row 6, frequency: found 'x', wanted a finite number",
        f"row 5, level: found 'nan', wanted a finite number; also row 7 ('nan'){LEAVE}",
    ]
