"""The string driven hard: shipped campaign and new ones come back by campaign file alone."""

from __future__ import annotations

import csv
import json
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting.campaign import BoundCampaign, read_campaign
from fitting.campaign.binding import bind
from fitting.cli.main import main
from fitting.fit.options import options_of
from fitting.fit.problem import problem_of
from fitting.fmu.pool import FmuWorkers
from fitting.lab.bench import measure
from fitting.lab.benches import DUFFING_STRING, duffing_bench
from fitting.lab.duffing import steady_lines
from fitting.lab.string import Drive
from fitting.lab.writer import campaign_files
from fitting.measurements.plan import Plan
from fitting.result.result import Result
from fitting.text.results_folder import write_all
from tests.support.datasets import drafted, planned_with, through
from tests.support.reconstruction import ReconstructionOptions, reconstruct
from tests.support.twins import swift_model

pytestmark = pytest.mark.usefixtures("swift_models")

SHIPPED = Path(__file__).parents[2] / "data" / "duffing_string"


@pytest.fixture(scope="module")
def workers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FmuWorkers]:
    path = swift_model("DuffingOscillator", tmp_path_factory)
    with FmuWorkers(path, timeout_s=60.0) as made:
        yield made


def bound_at(folder: Path, workers: FmuWorkers) -> BoundCampaign:
    return bind(read_campaign(folder / "campaign.toml"), workers.description.variables)


def test_peaks_through_the_fmu_are_those_of_the_laboratory(workers: FmuWorkers) -> None:
    """Averaging and harmonic balance share no code: tones to 2e-5, intermodulation to 2e-4."""
    bound = bound_at(SHIPPED, workers)
    lab = duffing_bench()
    width = lab.modes.widths_hz()[0]
    plan = planned_with(bound, workers, workers.description.variables)
    assert plan.promised < 1e-3
    truth = np.array([width, lab.modes.eta_plus_hz, DUFFING_STRING.alpha1])
    [answer] = through(workers, bound, plan, {}).evaluate_many([truth])
    found = np.asarray(answer.predictions[0].values, dtype=float)
    wanted = []
    for pair, level in zip(lab.pairs_hz, lab.levels, strict=True):
        lines = steady_lines(DUFFING_STRING, Drive.equal(pair, level))
        wanted += [abs(lines[k][0]) for k in ((1, 0), (0, 1), (2, -1), (-1, 2))]
    deviation = np.abs(found.reshape(-1, 4) / np.reshape(wanted, (-1, 4)) - 1.0).max(axis=0)
    assert deviation[:2].max() < 2e-5
    assert deviation[2:].max() < 2e-4
    assert np.reshape(wanted, (-1, 4))[:, 2:].min() > 0.04 * max(wanted)


def test_the_shipped_campaign_fits_by_its_file_alone(tmp_path: Path) -> None:
    words = ["--out", str(tmp_path), "--no-report", "--no-profiles"]
    assert main(["reconstruct", str(SHIPPED / "campaign.toml"), *words]) == 0
    result = json.loads((tmp_path / "result.json").read_text())
    truth = tomllib.loads((SHIPPED / "truth.toml").read_text())
    wanted = {
        "alpha1": truth["cubic"]["alpha1"],
        "eta_plus": truth["modes"]["eta_plus_hz"],
        "d1": truth["outcome"]["width_plus_hz"],
    }
    for name, value in wanted.items():
        found = result["parameters"][name]
        assert abs(found["value"] - value) < 3.0 * found["std"], name
        assert found["status"] == "linearised only"
    assert result["parameters"]["alpha1"]["std"] < 0.01 * wanted["alpha1"]
    assert result["deviations"]["initial"]["mean"] > 0.3  # the linear start does not explain it
    assert result["deviations"]["final"]["mean"] < 0.006  # as much as a line is repeatable
    lines = [p["frequency_hz"] for p in result["peaks"] if p["experiment"] == "drive1"]
    assert lines == [6940250.0, 6940290.0, 6940210.0, 6940330.0]


def fit(seed: int, folder: Path, workers: FmuWorkers, plan: Plan) -> Result:
    """A new series of that seed, fitted with the plan of another: its windows are the same."""
    measured = measure(duffing_bench(), seed)
    write_all(folder, campaign_files(measured, f"seed {seed}"))
    bound = bound_at(folder, workers)
    return reconstruct(
        problem_of([bound]),
        lambda alternative: through(workers, bound, plan, alternative),
        ReconstructionOptions(replace(options_of(bound.continuation), path=False), profiles=False),
    )


@pytest.mark.nightly
def test_the_cubic_coefficient_comes_back_within_its_noise(
    tmp_path: Path, workers: FmuWorkers
) -> None:
    """A new series: within two standard deviations and a half of the laboratory's."""
    shipped = bound_at(SHIPPED, workers)
    plan = replace(drafted(shipped), settings={"tolerance": 2e-4})
    result = fit(11, tmp_path, workers, plan)
    found = result.parameters["alpha1"]
    assert found.std is not None
    assert abs(found.value - DUFFING_STRING.alpha1) < 2.5 * found.std
    assert found.std < 0.01 * DUFFING_STRING.alpha1


def test_simulate_lists_the_intermodulation_lines(
    workers: FmuWorkers, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By name, in lines.csv and in words, with the amplitudes of harmonic balance."""
    lab = duffing_bench()
    pair, level = lab.pairs_hz[1], lab.levels[1]
    width = lab.modes.widths_hz()[0]
    values = {
        "theta": 0.0,
        "d1": width,
        "alpha1": DUFFING_STRING.alpha1,
        "A1": level,
        "A2": level,
        "u1": pair[0],
        "u2": pair[1],
        "kappa": 0.0,
        "alpha2": 0.0,
        "eta_plus": 6940260.0,
    }
    words = [word for name, v in values.items() for word in ("--set", f"{name}={v!r}")]
    words += ["--set", "periodic_start=true", "--settle", "0", "--out", str(tmp_path)]
    assert main(["simulate", str(workers.description.path), *words]) == 0
    with (tmp_path / "lines.csv").open() as stream:
        rows = {row["combination"]: row for row in csv.DictReader(stream)}
    lines = steady_lines(DUFFING_STRING, Drive.equal(pair, level))
    for name, factors in (("2 u1 - u2", (2, -1)), ("2 u2 - u1", (-1, 2)), ("3 u2 - 2 u1", (-2, 3))):
        assert float(rows[name]["frequency (Hz)"]) == np.dot(factors, pair)
        wanted = abs(lines[factors][0])
        assert float(rows[name]["q1_hybrid (m)"]) == pytest.approx(wanted, rel=1e-4)
    assert "m at 2 u1 - u2 = 6.94021 MHz" in capsys.readouterr().out
