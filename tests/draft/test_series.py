"""Sweeps in files of their own, one for each value of a control, are one map, or are refused."""

from __future__ import annotations

import csv
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import cast

import numpy as np
import pytest

import fitting as ff
from fitting.draft.api import init
from fitting.draft.document import Answers
from fitting.draft.maps import map_of_files
from fitting.measurements.control_sweep import ReadSpectra
from fitting.resonance.reading import Columns
from fitting.text.arrays import ComplexArray
from fitting.text.errors import BadInput
from tests.support.in_process import told
from tests.support.lines import mode, noise, write_csv
from tests.support.samples import cases

pytestmark = pytest.mark.usefixtures("swift_models")

F = np.linspace(99_400.0, 100_600.0, 61)
VOLTS = (-2.0, -1.0, 0.0, 1.0, 2.0)
COUPLED_HZ, WIDTH = 120.0, 40.0


def response(volts: float, share: float = 0.0) -> ComplexArray:
    """Two modes that meet at 0 V; ``share`` of the drive and of the detector is at the second."""
    matrix = np.array([[100_000.0 + 150.0 * volts, COUPLED_HZ / 2], [COUPLED_HZ / 2, 100_000.0]])
    g = np.array([1.0, share])
    eye = np.eye(2)
    made = [g @ np.linalg.solve(matrix - (f + 0.5j * WIDTH) * eye, g) for f in F]
    return np.array(20.0 * np.array(made), dtype=complex)


def written(
    folder: Path,
    name: Callable[[float], str],
    head: str = "",
    *,
    share: float = 0.0,
    phases: bool = False,
) -> list[Path]:
    rng = np.random.default_rng(4)
    paths = []
    for volts in VOLTS:
        z = 1e-4 * response(volts, share)
        z = z + 2e-7 * (rng.standard_normal(F.size) + 1j * rng.standard_normal(F.size))
        above = head.format(volts)
        names, columns = (
            ("f (Hz),X (V),Y (V)", (z.real, z.imag)) if phases else ("f (Hz),R (V)", (np.abs(z),))
        )
        paths.append(write_csv(folder / name(volts), above + names, F, *columns))
    return paths


def listed(folder: Path) -> dict[float, str]:
    """Values of the control and the file of each, as the campaign's table has them."""
    campaign = tomllib.loads((folder / "campaign.toml").read_text("utf-8"))
    table = campaign.get("control_sweep") or campaign["complex_control_sweep"]
    with (folder / table["file"]).open(encoding="utf-8") as file:
        rows = list(csv.reader(file))[1:]
    return {float(value): Path(name).name for value, name in rows}


WAYS: dict[str, tuple[Callable[[float], str], str, list[str]]] = {
    "file names": (lambda v: f"sweep_Vg={v:+.1f}V.csv", "", []),
    "file names, a unit alone": (lambda v: f"sweep_{v + 3:.0f}V.csv", "", []),
    "heads": (lambda v: f"run{3 + v:.0f}.csv", "# Vg = {} V\n", []),
    "heads, as settings": (lambda v: f"run{3 + v:.0f}.csv", "# gain: 10\n# Vg (V): {}\n", []),
    "option": (lambda v: f"run{3 + v:.0f}.csv", "", ["--control", "Vg=-2:2:1 V"]),
    "option, a list": (lambda v: f"run{3 + v:.0f}.csv", "", ["--control", "Vg=-2,-1,0,1,2 V"]),
}


@pytest.mark.parametrize(
    "way", cases(WAYS, "file names", "file names, a unit alone", "heads", "option")
)
def test_five_sweeps_are_one_map_over_their_control(way: str, tmp_path: Path) -> None:
    name, head, options = WAYS[way]
    paths = written(tmp_path, name, head)
    given = [(path, Columns()) for path in paths]
    answers = Answers({"control": (options[1],)} if options else {})
    found = map_of_files(given, answers, tmp_path, joint=False)
    assert found is not None
    shift = 3.0 if way == "file names, a unit alone" else 0.0
    assert found.control_map.settings[:, 0].tolist() == [v + shift for v in VOLTS]
    assert found.control_map.controls[0].unit == "V"
    assert len(found.control_map.rows) == len(VOLTS)


def test_the_map_is_drafted_and_read(tmp_path: Path) -> None:
    paths = written(tmp_path, WAYS["file names"][0])
    rng = np.random.default_rng(1)
    shuffled = [paths[k] for k in rng.permutation(len(paths))]
    ended = told("init", *shuffled, "--out", tmp_path / "o", "--yes")
    assert ended.code == 0, ended.err
    assert listed(tmp_path / "o") == {v: f"sweep_Vg={v:+.1f}V.csv" for v in VOLTS}
    campaign = ff.read_campaign(tmp_path / "o" / "campaign.toml")
    places = cast(ReadSpectra, campaign.measurements["control_sweep"]).places
    assert [p.controls["Vg"].value for p in places] == list(VOLTS)


def test_a_map_with_phases(tmp_path: Path) -> None:
    paths = written(tmp_path, WAYS["file names"][0], phases=True)
    init(paths, out=tmp_path / "o")
    assert set(listed(tmp_path / "o")) == set(VOLTS)


def test_both_modes_may_be_driven_and_read_where_one_is_not_enough(tmp_path: Path) -> None:
    for share, free in ((0.0, False), (0.6, True)):
        folder = tmp_path / str(share)
        folder.mkdir()
        path, _ = init(written(folder, WAYS["file names"][0], share=share), out=folder / "o")
        made = tomllib.loads(path.read_text("utf-8"))
        names = {p["name"] for p in made["parameters"]}
        assert ({"g2", "readout2"} <= names) is free
        assert ("g2" in made["fmu"]["start"]) is not free


@pytest.mark.parametrize(
    ("name", "head"),
    [
        (lambda v: f"run{3 + v:.0f}.csv", ""),
        (lambda v: f"run{3 + v:.0f}.csv", "# gain = 10\n"),
        (lambda v: f"run{3 + v:.0f}.csv", "# T = {0}1 K\n# Vg = {0} V\n"),
    ],
    ids=["nothing", "the same", "two that differ"],
)
def test_sweeps_without_a_control_are_refused_in_one_sentence(
    name: Callable[[float], str], head: str, tmp_path: Path
) -> None:
    """File 1 alone was written, with the start value of another one's line."""
    ended = told("init", *written(tmp_path, name, head), "--out", tmp_path / "o", "--yes")
    assert ended.code == 2
    assert "--control" in ended.err
    assert len(ended.err.splitlines()) == 1
    assert not list((tmp_path / "o").glob("*.toml"))


@pytest.mark.parametrize(
    "control", ["Vg=-2:2:0.5 V", "Vg=1,2 V", "Vg=-2:2:0.3", "Vg=2:-2:-1 V", "U"]
)
def test_values_that_do_not_suit_the_files_are_refused(control: str, tmp_path: Path) -> None:
    paths = written(tmp_path, WAYS["file names"][0])
    given = [(path, Columns()) for path in paths]
    with pytest.raises(BadInput, match="--control"):
        map_of_files(given, Answers({"control": (control,)}), tmp_path, joint=False)


def without_a_crossing(folder: Path) -> list[Path]:
    """One line that follows the control."""
    paths = []
    for volts in VOLTS:
        r = np.abs(mode(F, 100_000.0 + 20.0 * volts, WIDTH) + noise(F.size, 1e-3, 1))
        paths.append(write_csv(folder / f"s_Vg={volts}V.csv", "f (Hz),R (V)", F, r))
    return paths


def test_a_map_that_cannot_be_drafted_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(BadInput):
        init(without_a_crossing(tmp_path), out=tmp_path / "o")
    assert not [p for p in (tmp_path / "o").glob("*") if p.suffix in (".toml", ".csv")]


def test_a_list_that_is_put_back_is_still_that_of_the_command(tmp_path: Path) -> None:
    """A draft that fails leaves an earlier one as it was, which may be drafted again."""
    out, paths = tmp_path / "o", written(tmp_path, WAYS["file names"][0])
    init(paths, out=out)
    before = {path.name: path.read_bytes() for path in out.glob("[a-z]*.*")}
    assert "spectra.csv" in before
    with pytest.raises(BadInput):
        init(without_a_crossing(tmp_path), out=out)
    assert {path.name: path.read_bytes() for path in out.glob("[a-z]*.*")} == before
    init(paths, out=out)


def test_two_complex_sweeps_of_lines_apart_are_not_one_mode(tmp_path: Path) -> None:
    paths = []
    for k, f0 in enumerate((100_000.0, 130_000.0, 130_000.0)):
        f = f0 + np.linspace(-300.0, 300.0, 31)
        z = mode(f, f0, WIDTH) + noise(f.size, 1e-3, k)
        paths.append(write_csv(tmp_path / f"{k}.csv", "f (Hz),X (V),Y (V)", f, z.real, z.imag))
    with pytest.raises(BadInput, match="line at"):
        init(paths[:2], out=tmp_path / "o")
    path, _ = init(paths[1:], out=tmp_path / "p")
    assert len(tomllib.loads(path.read_text("utf-8"))["complex_sweep"]) == 2
