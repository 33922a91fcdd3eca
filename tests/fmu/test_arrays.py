"""Arrays of FMI 3.0: every element is a variable, the array is set and read as a whole."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

import fitting as ff
from fitting.cli.main import main
from fitting.fmu.description import read_description
from fitting.fmu.runs import Run
from fitting.text.arrays import FloatArray
from tests.support.cfmu_build import build_matrix_fmu, reworded

A = np.array([[-1.0, 2.0], [-2.0, -1.0]])
RUN = Run(start_values={}, settle_s=0.0, sample_step_s=0.1, samples=30, outputs=("y[1]",))


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_matrix_fmu(tmp_path_factory.mktemp("fmu"))


@pytest.fixture(scope="module")
def fmu(path: Path) -> Iterator[ff.Fmu]:
    with ff.Fmu(path, workers=1) as held:
        yield held


def step_response(a: FloatArray, b: FloatArray, times_s: Sequence[float]) -> FloatArray:
    """x of x' = A x + B under a step at t = 0, from rest: A^-1 (e^(A t) - 1) B, (n, 2)."""
    found = [np.linalg.solve(a, (expm(a * at) - np.eye(2)) @ b) for at in times_s]
    return np.array(found)


def test_elements_are_variables(fmu: ff.Fmu) -> None:
    known = fmu.workers.description.variables
    assert "A" not in known
    assert [known[f"A[{i},{j}]"].start for i in (1, 2) for j in (1, 2)] == [-1.0, 2.0, -2.0, -1.0]
    assert known["x0[2]"].start == 0.0  # one start value is that of all
    assert known["A[2,1]"].unit == "1/s"


@pytest.mark.parametrize("outputs", [("y[1]", "y[2]"), ("y[2]",), ("y[2]", "y[1]")])
def test_a_free_decay_is_the_matrix_exponential(fmu: ff.Fmu, outputs: tuple[str, ...]) -> None:
    """One element of A and one of x0 are set, all others keep their start values."""
    start = {"A[1,2]": 3.0, "x0[1]": 1.5}
    a = A.copy()
    a[0, 1] = 3.0
    run = replace(RUN, start_values=start, outputs=outputs)
    [seen] = fmu.workers.run([run])
    exact = np.array([expm(a * 0.1 * k) @ [1.5, 0.0] for k in range(30)])
    columns = [int(name[2]) - 1 for name in outputs]
    assert np.asarray(seen) == pytest.approx(exact[:, columns], abs=1e-13)
    # what an earlier run set is back at its start
    [again] = fmu.workers.run([replace(run, start_values={"x0[1]": 1.5})])
    exact = np.array([expm(A * 0.1 * k) @ [1.5, 0.0] for k in range(30)])
    assert np.asarray(again) == pytest.approx(exact[:, columns], abs=1e-13)


def test_elements_are_fitted_to_a_step(path: Path) -> None:
    t = np.arange(120) * 0.05
    a, b = np.array([[-0.8, 2.0], [-2.5, -1.0]]), np.array([0.0, 1.0])
    y = step_response(a, b, t.tolist())[:, 0] + 2e-3 * np.random.default_rng(5).standard_normal(
        t.size
    )
    setup = ff.Setup(ff.Drive(), "y[1]")
    trace = ff.Trace(t, y, setup=setup, input="u[1]", driven=ff.Pulse(), unit="1")
    names = ("A[1,1]", "A[2,1]")
    wanted = [
        ff.Parameter("A[1,1]", -1.0, bounds=(-4.0, -0.1), unit="1/s"),
        ff.Parameter("A[2,1]", -2.0, bounds=(-6.0, -0.5), unit="1/s"),
    ]
    quick = ff.Tikhonov(nu=1e-6, levels=1, misfit="squares")
    fit = ff.fit(ff.Problem(path, wanted, trace), method=quick, starts=1)
    for name, true in zip(names, (-0.8, -2.5), strict=True):
        assert abs(fit[name].value - true) < 4.0 * fit[name].std < 0.1


def test_start_values_of_another_number_are_refused(path: Path) -> None:
    fewer = reworded(path, {'start="-1 2 -2 -1"': 'start="-1 2 -2"'})
    with pytest.raises(ff.BadInput, match=r"'A': 3 .*wanted 4,"):
        read_description(fewer)
    none = reworded(path, {' start="-1 2 -2 -1"': ""})
    with (
        ff.Fmu(none, workers=1) as fmu,
        pytest.raises(ff.BadInput, match=r"'A\[1,2\]'"),
    ):
        fmu.workers.run([replace(RUN, start_values={"A[1,1]": 1.0})])


def test_check_and_simulate_take_elements(
    path: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["check", str(path), "--verbose"]) == 0
    assert "A[1,1]" in capsys.readouterr().out
    words = ["--input", "u[1]", "--drive", "0.5 Hz", "--output", "y[1]", "--accuracy", "1e-4"]
    assert main(["simulate", str(path), *words, "--out", str(tmp_path / "o")]) == 0


def test_structural_parameters_are_set_in_their_mode(fmu: ff.Fmu) -> None:
    """One term of the series makes its steps those of Euler's method, (1 + h A) x; then all."""
    euler = replace(RUN, start_values={"terms": 1, "x0[1]": 1.0}, outputs=("y[1]", "y[2]"))
    exact = replace(euler, start_values={"x0[1]": 1.0})
    slow, quick = fmu.workers.run([euler, exact])
    stepped = [np.linalg.matrix_power(np.eye(2) + 0.1 * A, k) @ [1.0, 0.0] for k in range(30)]
    truth = [expm(A * 0.1 * k) @ [1.0, 0.0] for k in range(30)]
    assert np.asarray(slow) == pytest.approx(np.array(stepped), abs=1e-13)
    assert np.asarray(quick) == pytest.approx(np.array(truth), abs=1e-13)


def test_the_size_of_an_array_stays(fmu: ff.Fmu) -> None:
    with pytest.raises(ff.BadInput, match=r"'states'.* structuralParameter"):
        fmu.workers.run([replace(RUN, start_values={"states": 3})])
