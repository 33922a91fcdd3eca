"""Lines of many files: a row each, controls from names or heads, failures with reasons."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.cli.main import main
from tests.support.lines import mode, write_csv

F = np.linspace(9_800.0, 10_200.0, 161)


def sweep(folder: Path, name: str, eta: float, seed: int, head: str = "") -> Path:
    amplitude = 2.0 * np.abs(mode(F, eta, 20.0))
    amplitude += np.random.default_rng(seed).normal(0.0, 0.01, F.size)
    return write_csv(folder / name, f"{head}f (Hz),A (V)", F, np.abs(amplitude))


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    made = [
        sweep(tmp_path, f"sweep_Vg={v:+.1f}V.csv", 10_000.0 + 30.0 * v, k)
        for k, v in enumerate((-1.0, 0.5, 2.0))
    ]
    broken = tmp_path / "sweep_Vg=+3.0V.csv"
    broken.write_text("f (Hz),A (V)\n1,2\n2,x\n", "utf-8")
    return [*made, broken]


def test_each_file_is_a_row_with_its_control(files: list[Path]) -> None:
    found = ff.lines(files)
    assert (found.control, found.unit) == ("Vg", "V")
    assert [row.control for row in found.rows] == [-1.0, 0.5, 2.0, 3.0]
    for row, alone in zip(found.fitted, files, strict=False):
        assert row.line is not None
        assert row.line.frequency == ff.line(alone).frequency
        true = 10_000.0 + 30.0 * row.control
        assert abs(row.line.frequency.value - true) < 4.0 * row.line.frequency.std
    assert len(found.fitted) == 3
    last = found.rows[-1]
    assert last.line is None
    assert "row 3" in last.reason
    assert math.isnan(float(last.to_dict()["frequency"]))


def test_a_control_may_be_in_the_heads(tmp_path: Path) -> None:
    made = [
        sweep(tmp_path, f"run{k}.csv", 10_000.0, k, f"# T = {t} mK\n")
        for k, t in enumerate((20, 35))
    ]
    found = ff.lines(made)
    assert (found.control, found.unit, [r.control for r in found.rows]) == ("T", "mK", [20, 35])


def test_files_without_a_control_are_counted(tmp_path: Path) -> None:
    made = [sweep(tmp_path, name, 10_000.0, 1) for name in ("a.csv", "b.csv")]
    assert [row.control for row in ff.lines(made).rows] == [1.0, 2.0]


def test_the_command_writes_the_table_and_a_figure(
    files: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["line", *map(str, files), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "Vg (V)" in printed
    assert "row 3" in printed
    rows = list(csv.DictReader((out / "lines.csv").read_text("utf-8").splitlines()))
    assert [float(row["Vg (V)"]) for row in rows] == [-1.0, 0.5, 2.0, 3.0]
    assert float(rows[1]["frequency (Hz)"]) == pytest.approx(10_015.0, abs=0.5)
    assert rows[3]["frequency (Hz)"] == ""
    assert "row 3" in rows[3]["reason"]
    assert (out / "lines.png").stat().st_size > 10_000
    assert main(["line", *map(str, files), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [row["control"] for row in document] == [-1.0, 0.5, 2.0, 3.0]


def test_what_no_file_holds_is_an_error(
    files: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["line", str(files[-1]), str(files[-1].with_name("none.csv"))]) == 2
    assert "none.csv" in capsys.readouterr().err
    with pytest.raises(ff.BadInput, match="two or more"):
        ff.lines(files[:1])


def several(phases: bool) -> tuple[np.ndarray, list[tuple[float, float, float]]]:
    """A sweep of three lines, of which two overlap, and their frequency, width and height."""
    truth = [(9_850.0, 6.0, 1.0), (10_000.0, 12.0, 0.6), (10_014.0, 10.0, 0.4)]
    phase = (0.0, 1.0, 2.0)
    exact = sum(
        a * np.exp(1j * p) * mode(F, f, w) for (f, w, a), p in zip(truth, phase, strict=True)
    )
    x, y = 0.003 * np.random.default_rng(3).standard_normal((2, F.size))
    seen = exact + x + 1j * y
    return (seen if phases else np.abs(seen)), truth


@pytest.mark.parametrize("count", ["auto", 3])
@pytest.mark.parametrize("phases", [True, False])
def test_each_line_of_a_sweep_is_a_row(tmp_path: Path, phases: bool, count: int | str) -> None:
    values, truth = several(phases)
    columns = (values.real, values.imag) if phases else (values,)
    head = "f (Hz),X (V),Y (V)" if phases else "f (Hz),A (V)"
    found = ff.lines([write_csv(tmp_path / "three.csv", head, F, *columns)], count=count)
    assert len(found.rows) == 3
    for row, (f, w, a) in zip(found.rows, truth, strict=True):
        numbers = row.numbers
        assert abs(numbers["frequency"].value - f) < 4.0 * numbers["frequency"].std < 1.0
        assert abs(numbers["width"].value - w) < 4.0 * numbers["width"].std
        if phases:  # without them overlapping lines may have other heights
            assert abs(numbers["amplitude"].value - a) < 4.0 * numbers["amplitude"].std
        assert numbers["amplitude"].unit == "V"
        assert row.findings == ()


def test_one_line_is_one_row_however_many_are_looked_for(tmp_path: Path) -> None:
    path = sweep(tmp_path, "one.csv", 10_000.0, 4)
    [row] = ff.lines([path], count="auto").rows
    assert row.line is not None
    assert row.line.frequency == ff.line(path).frequency


def test_lines_that_are_not_there_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(sweep(tmp_path, "one.csv", 10_000.0, 4))
    assert main(["line", path, "--lines", "none"]) == 2
    assert "--lines none" in capsys.readouterr().err
    assert main(["line", path, "--lines", "auto", "--json"]) == 0
    [row] = json.loads(capsys.readouterr().out)
    assert row["frequency"] == pytest.approx(10_000.0, abs=0.5)


def test_each_sweep_of_a_file_is_a_row(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "sweeps.h5", "w") as file:
        for name, eta in (("cold", 10_000.0), ("warm", 9_950.0)):
            noise = np.random.default_rng(len(name)).normal(0.0, 0.01, F.size)
            file[f"{name}/frequency"] = F
            file[f"{name}/amplitude"] = np.abs(np.abs(mode(F, eta, 20.0)) + noise)
            file[f"{name}/frequency"].attrs["unit"] = "Hz"
            file[f"{name}/amplitude"].attrs["unit"] = "V"
    found = ff.lines([tmp_path / "sweeps.h5"])
    assert [row.sweep for row in found.rows] == ["cold/frequency", "warm/frequency"]
    assert [row.control for row in found.rows] == [1.0, 2.0]
    truth = (10_000.0, 9_950.0)
    for row, eta in zip(found.rows, truth, strict=True):
        assert row.numbers["frequency"].value == pytest.approx(eta, abs=0.5)
    assert main(["line", str(tmp_path / "sweeps.h5"), "--out", str(tmp_path / "out")]) == 0
    assert "warm/frequency" in capsys.readouterr().out
    rows = list(csv.DictReader((tmp_path / "out" / "lines.csv").read_text("utf-8").splitlines()))
    assert [row["file"].rpartition(": ")[2] for row in rows] == ["cold/frequency", "warm/frequency"]
