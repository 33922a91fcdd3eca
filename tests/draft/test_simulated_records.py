"""Records as programs that run FMUs write them: names of variables, and no units."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy.io import savemat

import fitting as ff
from fitting.campaign.instruments import layout_of, read_recording
from fitting.campaign.instruments.recording import Selection
from fitting.draft.api import init
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from tests.support.cfmu_build import build_lag_fmu
from tests.support.in_process import told

T: FloatArray = np.array(0.01 * np.arange(150), dtype=float)
U: FloatArray = np.array(np.where(T >= 0.1, 1.0, 0.0))
Y: FloatArray = 2.0 * -np.expm1(-np.maximum(T - 0.1, 0.0) / 0.3)


def record(path: Path, head: str, *columns: FloatArray) -> Path:
    rows = [",".join(map(repr, row)) for row in np.array(columns).T.tolist()]
    path.write_text("\n".join([head, *rows]) + "\n", "utf-8")
    return path


def found(path: Path) -> dict[str, float]:
    """Time constant and gain that the drafted campaign gives of data without noise."""
    problem = ff.Problem.of(ff.read_campaign(path))
    fit = ff.fit(problem, method=ff.Tikhonov(nu=1e-6, levels=1, misfit="squares"), starts=1)
    return {name: fit[name].value for name in ("tau", "gain")}


HEADS: dict[str, tuple[str, list[str]]] = {
    "names of the FMU": ("time,u,y", []),
    "as fmpy writes": ('"time","u","y"', []),
    "as OMSimulator writes": ("time,model.root.lag.u,model.root.lag.y", []),
    "capitals": ("Time,U,Y", []),
    "other names, input first": ("time,force,seen", []),
    "columns told": (
        "clock,seen,force",
        ["--time", "clock", "--input", "force=u", "--output", "seen=y"],
    ),
    "output told": ("time,seen,u", ["--output", "seen=y"]),
}


@pytest.mark.parametrize("name", HEADS)
def test_a_record_without_units_is_in_those_of_the_fmu(name: str, tmp_path: Path) -> None:
    head, options = HEADS[name]
    fmu = build_lag_fmu(tmp_path)
    by_name = {"u": U, "force": U, "y": Y, "seen": Y}
    names = [each.strip('"').lower().rpartition(".")[2] for each in head.split(",")]
    columns = [by_name.get(each, T) for each in names]
    path = record(tmp_path / "r.csv", head, *columns)
    words: list[str | Path] = [
        "init",
        path,
        "--fmu",
        fmu,
        "--out",
        tmp_path / "o",
        "--yes",
        *options,
    ]
    ended = told(*words, "--fit", "tau", "gain")
    assert ended.code == 0, ended.err
    assert "unit" in ended.out  # what was assumed is printed
    values = found(tmp_path / "o" / "campaign.toml")
    assert values == {"tau": pytest.approx(0.3, rel=1e-3), "gain": pytest.approx(2.0, rel=1e-3)}


def test_an_output_is_no_input(tmp_path: Path) -> None:
    """Of all outputs that a program writes none is taken for the input that it did not write."""
    fmu = build_lag_fmu(tmp_path)
    path = record(tmp_path / "r.csv", "time,x_start,y", T, T, Y)
    made, _ = init(path, fmu, out=tmp_path / "o", told={"fit": ["tau"]})
    [trace] = tomllib.loads(made.read_text("utf-8"))["trace"]
    assert "input" not in trace


@pytest.mark.parametrize("head", ["time,a,b,c", "time,a,y,c"])
def test_columns_that_nothing_tells_apart_are_refused(head: str, tmp_path: Path) -> None:
    fmu = build_lag_fmu(tmp_path)
    path = record(tmp_path / "r.csv", head, T, U, Y, U)
    with pytest.raises(BadInput, match=r"--(input|output)"):
        init(path, fmu, out=tmp_path / "o")


def trajectories(path: Path, *, turned: bool) -> None:
    """Results as Dymola and OpenModelica write them, version 1.1 of their format."""
    names = ["Time", "lag.u", "lag.y", "lag.tau", "lag.minus_y"]
    about = ["Time in [s]", "input [V]", "output [V]", "time constant [s]", "negative [V]"]
    info = np.array([[0, 1, 0, -1], [2, 2, 0, -1], [2, 3, 0, -1], [1, 2, 0, 0], [2, -3, 0, -1]])
    data_1, data_2 = np.array([[0.0, 0.3], [1.49, 0.3]]), np.stack([T, U, Y], axis=1)

    def letters(texts: list[str]) -> npt.NDArray[np.str_]:
        whole = [text.ljust(max(map(len, texts))) for text in texts]
        return np.array(
            ["".join(column) for column in zip(*whole, strict=True)] if turned else whole
        )

    kind = "binTrans" if turned else "binNormal"
    tables = {"dataInfo": info, "data_1": data_1, "data_2": data_2}
    savemat(
        path,
        {
            "Aclass": np.array([x.ljust(11) for x in ("Atrajectory", "1.1", "", kind)]),
            "name": letters(names),
            "description": letters(about),
            **{key: table.T if turned else table for key, table in tables.items()},
        },
        format="4",
    )


@pytest.mark.parametrize("turned", [True, False])
def test_results_of_dymola_are_read(turned: bool, tmp_path: Path) -> None:
    path = tmp_path / "r.mat"
    trajectories(path, turned=turned)
    assert layout_of(path) == "matlab"
    recording = read_recording(path, None, Selection())
    read = {c.name: (c.unit, recording.numbers(c)) for c in recording.channels}
    assert read["lag.y"][0] == "V"
    np.testing.assert_array_equal(read["lag.y"][1], Y)
    np.testing.assert_array_equal(read["lag.minus_y"][1], -Y)
    np.testing.assert_array_equal(read["lag.tau"][1], np.full(T.size, 0.3))


def test_results_of_dymola_are_drafted(tmp_path: Path) -> None:
    trajectories(tmp_path / "r.mat", turned=True)
    fmu = build_lag_fmu(tmp_path)
    path, _ = init(tmp_path / "r.mat", fmu, out=tmp_path / "o", told={"fit": ["tau", "gain"]})
    assert found(path)["tau"] == pytest.approx(0.3, rel=1e-3)
