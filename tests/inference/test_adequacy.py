"""When a model is given up, and what is left of its values: against scipy's chi square."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2, t

from fitting.cli.main import main
from fitting.fit.alternative import Outcome
from fitting.fit.covariance import RowCovariance
from fitting.fit.fit import Fit, Status, solve_problem
from fitting.fit.objective import Objective
from fitting.fit.options import Options, Schedule
from fitting.fit.problem import Problem
from fitting.fit.search import Minimum, SearchResult
from fitting.inference.adequacy import chi_square_test
from fitting.inference.checks.solutions import search_findings
from fitting.inference.infer import Inference, infer
from fitting.text.arrays import FloatArray
from fitting.text.estimate import FittedEstimate, Verdict
from fitting.text.finding import Kind, of_kind
from tests.faults import scene
from tests.support.whitened import learnt, parameter, whitened


@pytest.mark.parametrize(
    ("rows", "ratio", "describes"),
    [
        # few rows: four times the freedom is reached by chance, until that is improbable
        (2, 4.5, True),
        (2, float(chi2.isf(1.1e-4, 2)) / 2, True),
        (2, float(chi2.isf(0.9e-4, 2)) / 2, False),
        # many rows: twice the freedom is impossible by chance, but noise is stated wrong as easily
        (100, 2.0, True),
        (100, 3.99, True),
        (100, 4.01, False),
    ],
)
def test_a_model_is_given_up_where_chi_square_is_both_large_and_improbable(
    rows: int, ratio: float, describes: bool
) -> None:
    """Rows with correlated noise V, r^T V^-1 r set by hand, and no unknown at all."""
    noise = RowCovariance(
        np.linspace(0.5, 2.0, rows), np.random.default_rng(rows).normal(size=(rows, 2))
    )
    root = np.linalg.cholesky(np.diag(noise.sigma**2) + noise.common @ noise.common.T)
    drawn = np.random.default_rng(1).normal(size=rows)
    white: FloatArray = drawn * (math.sqrt(ratio * rows) / float(np.linalg.norm(drawn)))
    found = chi_square_test(
        noise.whitened(np.asarray(root @ white)), np.zeros((rows, 1)), np.eye(1)
    )
    assert found.chi_square == pytest.approx(ratio * rows)
    assert found.freedom == pytest.approx(rows)
    assert found.p_value == pytest.approx(float(chi2.sf(ratio * rows, rows)), rel=1e-6)
    assert found.describes is describes


def test_unknowns_take_their_degrees_of_freedom() -> None:
    """Ten rows, two unknowns that the data hold: eight; ten that hold all: nothing to judge by."""
    matrix = np.random.default_rng(2).normal(size=(10, 2))
    covariance = np.asarray(np.linalg.inv(matrix.T @ matrix), dtype=float)
    rows = np.full(10, 10.0)
    assert chi_square_test(rows, matrix, covariance).freedom == pytest.approx(8.0)
    nothing = chi_square_test(rows, np.eye(10), np.eye(10))
    assert (nothing.freedom, nothing.describes) == (0.0, True)
    assert math.isnan(nothing.p_value)


M = 12


def scattered(size: float, *, known: bool = True) -> Objective:
    """p = 5 measured M times with unit noise, while the data lie `size` above and below in turn."""
    off = size * (-1.0) ** np.arange(M)
    return whitened(lambda x: x[0] - 5.0 + off, parameter("p", 0.0, 20.0, start=6.0), known=known)


@pytest.mark.parametrize(("size", "least", "most"), [(0.5, 100, 250), (20.0, 5, 40)])
def test_of_a_model_that_does_not_describe_the_data_nothing_is_scanned(
    size: float, least: int, most: int
) -> None:
    """Its bounds were searched before; of one that does describe them scans may take all of 250."""
    off = size * (-1.0) ** np.arange(M)

    def rows(x: FloatArray) -> FloatArray:
        return np.asarray(np.tanh(x[0] - 5.0) + 0.3 * np.sin(3.0 * x[1]) + off)

    three = (parameter(name, 0.0, 20.0, start=6.0) for name in "pqr")
    found = learnt(whitened(rows, *three), budget=250, minima=[np.zeros(3)], twins=())
    assert found.knowledge.adequacy.describes is (size < 1.0)
    assert bool(found.profiled) is (size < 1.0)
    assert least < found.knowledge.effort.evaluations <= most


def test_noise_that_was_stated_two_times_too_small_only_widens() -> None:
    """chi^2 = M (2 s)^2: errors are twice 1/sqrt(M), by M/(M - 1) more; the verdict stands."""
    size = 1.9  # a little less than the factor at which the model is given up
    found = learnt(scattered(size))
    factor = size * math.sqrt(M / (M - 1.0))
    half = float(t.ppf(0.975, M - 1)) * factor / math.sqrt(M)
    assert found.knowledge.inflation == pytest.approx(factor, rel=1e-3)
    assert found.knowledge.adequacy.chi_square == pytest.approx(M * size**2, rel=1e-4)
    assert found.knowledge.adequacy.freedom == pytest.approx(M - 1.0, abs=0.01)
    assert found.knowledge.adequacy.describes
    p = found.parameters["p"]
    assert p.ci95 == pytest.approx((5.0 - half, 5.0 + half), rel=0.002)
    assert p.status is Verdict.DETERMINED
    assert found.knowledge.adequacy.noise_factor == pytest.approx(factor, rel=1e-3)


def test_noise_that_nobody_stated_tests_no_model() -> None:
    """The scatter of the residuals explains them by its very making, however large it is."""
    found = learnt(scattered(100.0, known=False))
    assert found.knowledge.adequacy.describes
    assert math.isnan(found.knowledge.adequacy.chi_square)
    assert found.parameters["p"].status is not Verdict.WITHDRAWN


def fitted(objective: Objective) -> Fit:
    problem = Problem(objective.parameters, objective.data, derived={"": ("sum", "fixed")})
    options = Options(schedule=Schedule(starts=1, nu_start=1e-3, iterations=2))
    return solve_problem(problem, lambda chosen: objective.response, options)


@pytest.mark.parametrize("profiles", [True, False])
def test_of_a_model_that_does_not_describe_the_data_no_value_is_left(profiles: bool) -> None:
    """chi^2 a thousand times its freedom: no word, no error, no interval, and a status of its own.

    q is seen by the very same data, r by none, and one output depends on nothing.
    """
    off = math.sqrt(1000.0) * (-1.0) ** np.arange(M)
    along = np.linspace(-1.0, 1.0, M)
    objective = whitened(
        lambda x: (x[0] - 5.0) + (x[1] - 3.0) * along + off,
        parameter("p", 0.0, 20.0, start=6.0),
        parameter("q", 0.0, 20.0, start=4.0),
        parameter("r", 0.0, 20.0),
        sum=lambda x: x[0] + x[1],
        fixed=lambda x: 7.0,
    )
    fit = fitted(objective)
    assert fit.status is Status.CONVERGED
    found: Inference = infer(fit, profiles=profiles)
    assert found.status is Status.MISFIT
    assert found.ending.kind == "not_described"
    values: dict[str, FittedEstimate] = {**found.parameters, **found.derived}
    assert set(values) == {"p", "q", "r", "sum", "fixed"}
    for value in values.values():
        assert value.status is Verdict.WITHDRAWN
        assert math.isnan(value.std)
        assert all(map(math.isnan, value.ci95))
    if found.knowledge is not None:
        for profile in found.profiled.values():
            assert profile.status is Verdict.WITHDRAWN
            assert all(map(math.isnan, (*profile.ci68, *profile.ci95)))
            assert math.isnan(profile.precision)


def test_the_command_ends_with_four_where_the_model_does_not_describe_the_data(
    swift_fmu: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Four lines at a noise of one per cent, of which one is three times too high."""
    texts = scene.texts()
    tones = {"one": 310.0, "two": 330.0, "three": 318.0, "four": 338.0}
    texts[scene.EXPERIMENTS] = "experiment,u1 (Hz)\n" + "".join(
        f"{name},{tone:g}\n" for name, tone in tones.items()
    )
    for name, tone in tones.items():
        texts[f"{name}.csv"] = scene.spectrum(tone)
    head, row, *rest = texts["three.csv"].split("\n")
    lines = [head, row, *rest]
    at = next(k for k, line in enumerate(lines) if line.startswith("318,"))
    frequency, amplitude = lines[at].split(",")
    lines[at] = f"{frequency},{3.0 * float(amplitude):.10g}"
    texts["three.csv"] = "\n".join(lines)
    for name, text in texts.items():
        (tmp_path / name).write_text(text, "utf-8")
    shutil.copy(swift_fmu, tmp_path / scene.FMU)
    out = tmp_path / "out"
    words = ["reconstruct", str(tmp_path / scene.CAMPAIGN), "--out", str(out), "--no-report"]
    assert main([*words, "--workers", "1", "--quick", "--no-profiles"]) == 4
    written = json.loads((out / "result.json").read_text("utf-8"))
    assert written["status"] == Status.MISFIT.value
    for value in (*written["parameters"].values(), *written["derived"].values()):
        assert value["status"] == "no verdict"
        assert value["std"] is None
        assert value["ci95"] == [None, None]
    assert Status.MISFIT.value in "".join(capsys.readouterr())


def test_the_chi_square_of_the_box_is_told_as_that_of_the_box() -> None:
    """It is not the one by which the model is judged: that may lie beyond the box, and lower."""
    minima = tuple(
        Minimum(x=np.zeros(1), start=np.zeros(1), chi_square=height) for height in (4900.0, 7000.0)
    )
    search = SearchResult(
        screened=64,
        screens=1,
        descents=2,
        explained=False,
        evaluations=0,
        fmu_runs=0,
    )
    objective = whitened(lambda p: p, parameter("a", -1.0, 1.0))
    outcome = Outcome(objective=objective, x=np.zeros(1), search=search, minima=minima)
    [found] = search_findings(outcome)
    assert found.numbers == {
        "points": 64.0,
        "lowest": 1.0,
        "descents": 2.0,
        "chi_square": 4900.0,
        "next_chi_square": 7000.0,
    }
    explained = replace(search, explained=True)
    assert not [*search_findings(replace(outcome, search=explained))]


def test_of_intervals_that_nobody_gives_no_sentence_is_printed() -> None:
    """a is 0 and 40 sigma at once, and the bound of b is active."""
    own = (parameter("a", -50.0, 50.0), parameter("b", -50.0, 50.0))
    rows = whitened(lambda p: np.array([p[0], p[0] - 40.0, p[1] - 60.0]), *own)
    cut = learnt(rows, budget=300)
    assert not cut.knowledge.adequacy.describes
    assert cut.profiled == {}
    assert cut.knowledge.scans == {}
    assert not of_kind(cut.findings, Kind.profiles_incomplete)
    assert not of_kind(cut.findings, Kind.interval_at_bound)
