"""A detector that tells phases as a candidate: rows, information, the campaign it asks for."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest

import fitting as ff
from fitting.campaign import BoundCampaign, bind, read_campaign
from fitting.campaign.file import WrittenDesign
from fitting.campaign.parameters import to_search
from fitting.design.campaign import campaign_files
from fitting.design.candidates import ToneCandidates
from fitting.design.information import Place, WhitenedData
from fitting.design.limits import DesignTable, Limits, limits_of, refuse_wider
from fitting.fmu.pool import FmuWorkers
from fitting.lab.instruments import LockIns
from fitting.measurements.tones import ComplexTones
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.results_folder import write_all
from fitting.text.schema import read_record
from tests.design.test_campaign import designed
from tests.support.design_laboratories import so_far
from tests.support.modes_mpmath import log_responses

TRUTH = np.array([1.9498, 120.0, 90.0])


@pytest.fixture(scope="module")
def workers(swift_fmu: Path) -> Iterator[FmuWorkers]:
    with FmuWorkers(swift_fmu, workers=1) as made:
        yield made


@pytest.fixture(scope="module")
def bound(workers: FmuWorkers, tmp_path_factory: pytest.TempPathFactory) -> BoundCampaign:
    """The q1 series with phases, an offset of every pair from its drift."""
    folder = tmp_path_factory.mktemp("phases")
    made = ff.synthesize("q1", seed=2, instrument=LockIns(both=False, phases=True))
    write_all(folder, made.files)
    return bind(read_campaign(folder / "campaign.toml"), workers.description.variables)


def limits_from(bound: BoundCampaign, workers: FmuWorkers, **table: object) -> Limits:
    path = Path("x.toml")
    read = DesignTable(path, read_record(WrittenDesign, table, path, "design"), frozenset(table))
    return limits_of(bound, workers.description.variables, read)


def exact(
    tones: tuple[float, ...], eta: tuple[float, float], output: str, p: FloatArray
) -> ComplexArray:
    with mp.workdps(30):
        return np.array([complex(v) for v in log_responses(list(p), tones, eta, output)])


def test_a_detector_tells_phases_where_the_campaign_has_some_or_says_so(
    bound: BoundCampaign, workers: FmuWorkers
) -> None:
    assert limits_from(bound, workers).phases
    off = limits_from(bound, workers, phases=False)
    assert not off.phases
    amplitudes = tuple(replace(e, phases_rad=None) for e in bound.experiments)
    assert not limits_from(replace(bound, experiments=amplitudes), workers).phases
    assert limits_from(replace(bound, experiments=amplitudes), workers, phases=True).phases
    table = DesignTable(Path("x.toml"), WrittenDesign(phases=False), frozenset({"phases"}))
    with pytest.raises(BadInput, match=r"phases: found true, .*x\.toml"):
        refuse_wider(replace(off, phases=True), table, str, "V")


def test_rows_and_information_of_setups_with_phases(
    bound: BoundCampaign, workers: FmuWorkers
) -> None:
    """Derivatives by parameters and by what drifts, and their information with both nuisances."""
    limits = limits_from(bound, workers, frequency_step="40 Hz", levels=[1], phases=True)
    limits = replace(limits, setting_sigmas={"eta_plus": 5.0})
    count = len(bound.parameters)
    x = to_search(bound.parameters, np.append(TRUTH, np.zeros(count - 3)))
    place = Place({"reflection": False}, x)
    data = so_far(bound, workers)
    made = ToneCandidates(data, limits, place)
    [rows] = made.rows(place)
    setups, picked = made.choices[::7], slice(None, None, 7)
    eta = made.measured(setups).tones[0].experiments[0].settings

    assert bound.sweep is not None
    swept = (
        float(bound.sweep.settings["eta_plus"]),
        float(bound.sweep.settings["eta_minus"]),
    )

    def top(p: FloatArray) -> float:
        """ln of the sweep's maximum, which the scale is taken from."""
        return float(exact((swept[0],), swept, "q1_hybrid", p)[0].real)

    def at(p: FloatArray, shift: float = 0.0) -> ComplexArray:
        found = []
        for s in setups:
            plus, minus = (float(eta[f"eta_{n}"]) for n in ("plus", "minus"))
            found.append(exact(s.tones_hz, (plus + shift, minus), s.output, p))
        return np.concatenate(found) - top(p)

    by_x = np.zeros((2 * len(setups), count), dtype=complex)
    for i, h in enumerate((1e-6, 1e-4, 1e-4)):
        above, below = (at(TRUTH + sign * h * np.eye(3)[i]) for sign in (1.0, -1.0))
        by_x[:, i] = bound.parameters[i].scale * (above - below) / (2.0 * h)
    by_setting = (at(TRUTH, 0.01) - at(TRUTH, -0.01)) / 0.02
    values = rows.values[picked]
    assert (rows.by_x[picked] / values[..., None]).reshape(-1, count) == pytest.approx(
        by_x, rel=1e-3, abs=1e-6
    )
    moved_by = (rows.errors[picked][..., 0] / values).ravel() / 5.0
    assert moved_by.imag == pytest.approx(by_setting.imag, rel=1e-3, abs=1e-7)
    found = rows.information(0.01 * np.abs(rows.values))[7]
    mine = slice(2, 4)
    nuisances = np.array([[1.0, 0.0]] * 2 + [[0.0, 1.0]] * 2)
    parts = np.concatenate([by_x[mine].real, by_x[mine].imag])
    matrix = np.column_stack([parts, nuisances])
    moved = 5.0 * np.concatenate([by_setting[mine].real, by_setting[mine].imag])
    covariance = 1e-4 * np.eye(4) + np.outer(moved, moved)
    wanted = matrix.T @ np.linalg.solve(covariance, matrix)
    assert found == pytest.approx(wanted, rel=5e-3, abs=1e-3 * np.max(np.abs(wanted)))


def test_information_of_complex_data_is_that_of_their_rows(
    bound: BoundCampaign, workers: FmuWorkers
) -> None:
    """Two rows for each value; the reference phase, solved inside, is taken out of them."""
    count = len(bound.parameters)
    data = so_far(bound, workers)
    x = to_search(bound.parameters, np.append(TRUTH, np.zeros(count - 3)))
    place = Place({"reflection": False}, x)
    white = WhitenedData.weighed_at(data, place, np.ones(count))
    assert white.covariance.sigma == pytest.approx(0.01, rel=1e-6)
    [rows] = white.at([place])
    assert rows.matrix.shape == (20, count)
    turned = rows.matrix.T @ np.repeat([0.0, 1.0], 10)
    assert np.max(np.abs(turned)) < 0.05 * np.max(np.abs(rows.matrix))


def test_the_proposed_campaign_asks_for_both_quadratures(swift_fmu: Path, tmp_path: Path) -> None:
    """Its columns are filled in by a virtual laboratory, and read back."""
    made = ff.synthesize(
        "q1", seed=2, instrument=LockIns(both=False, phases=True), noise_scale=0.01
    )
    made.write(tmp_path / "old")
    design, limits = designed(2)
    bound = ff.Problem.of(tmp_path / "old" / "campaign.toml", ff.Fmu(swift_fmu)).record.together
    folder = tmp_path / "next"
    files = campaign_files(design, bound, {}, replace(limits, phases=True), folder)
    experiments = tomllib.loads(str(files["campaign.toml"]))["experiments"]
    assert experiments["x"] == ["X_1", "X_2"]
    assert experiments["unknown"] == "phase"
    write_all(folder, files)
    filled = ff.synthesize(
        tmp_path / "old" / "truth.toml", plan=folder / "campaign.toml", out=tmp_path / "new"
    )
    problem = ff.Problem.of(tmp_path / "new" / "campaign.toml", ff.Fmu(swift_fmu))
    [tones] = [m for m in problem.record.measurements if isinstance(m, ComplexTones)]
    waves = np.concatenate([a.lines_v for a in filled.measured.answers])
    turns = tones.y / waves
    assert np.abs(turns) == pytest.approx(1.0, rel=1e-3)
    assert turns == pytest.approx(turns[0], abs=1e-3)
    assert tones.sigma == pytest.approx(1e-4, rel=0.5)
