"""Planned sweeps measured by the virtual laboratory, against closed forms, and fitted."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.lab.curves import AvoidedCrossing
from fitting.lab.pumped import PumpedBench
from fitting.lab.true_values import true_values
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from tests.lab.test_pumped import rotating_waves
from tests.support import crossing_spectra

FREQUENCIES_HZ = np.linspace(985.0, 1015.0, 16)
DESIGN = """
[design]
target = "lambda12"
number = 2
noise_floor = "{floor}"
relative_noise = {relative}
sweeps = {{ controls = {{ V = [-1.5, -0.5, 0.5] }} }}
"""


def planned(
    folder: Path,
    *,
    phases: bool = False,
    table: str = "",
    floor: str = "1e-12 V",
    relative: float = 0.0,
) -> Path:
    """A plan of two sweeps, at 0.5 V and -2 V, as a design writes it."""
    made = ff.synthesize_curves("crossing", phases=phases)
    folder.mkdir(exist_ok=True)
    text = str(made.files["campaign.toml"]).replace('file = "map.csv"', f'file = "x.csv"\n{table}')
    (folder / "campaign.toml").write_text(text + DESIGN.format(floor=floor, relative=relative))
    open_cells = ["X (mV)", "Y (mV)"] if phases else ["amplitude (mV)"]
    lines = ["# fill in", ",".join(["V (mV)", "frequency (kHz)", *open_cells])]
    for millivolt in (500.0, -2000.0):
        lines += [
            f"{millivolt},{u / 1e3!r}{',' * len(open_cells)}" for u in map(float, FREQUENCIES_HZ)
        ]
    (folder / "x.csv").write_text("\n".join(lines) + "\n")
    return folder / "campaign.toml"


def filled(folder: Path) -> FloatArray:
    return np.genfromtxt(folder / "x.csv", delimiter=",", skip_header=3)


def test_amplitudes_at_the_planned_places_are_those_of_the_closed_form(tmp_path: Path) -> None:
    made = ff.synthesize("crossing", plan=planned(tmp_path / "plan"), out=tmp_path / "lab")
    rows = filled(tmp_path / "lab")
    assert rows[:, 0] == pytest.approx(np.repeat([500.0, -2000.0], 16))
    exact = [crossing_spectra.response(FREQUENCIES_HZ, volt) for volt in (0.5, -2.0)]
    assert rows[:, 2] == pytest.approx(1e3 * 1e6 * np.concatenate(exact), rel=1e-9)
    text = (tmp_path / "lab/campaign.toml").read_text()
    assert tomllib.loads(text)["synthetic"]
    assert tomllib.loads((tmp_path / "lab/truth.toml").read_text()) == made.truth
    assert true_values(made.truth)["lambda12"] == crossing_spectra.LAMBDA
    assert len(ff.read_campaign(tmp_path / "lab/campaign.toml").measurements) == 1


def test_effective_amplitudes_are_smaller_by_the_root_of_two(tmp_path: Path) -> None:
    plan = planned(tmp_path / "plan")
    plan.write_text(plan.read_text().replace('"V peak"', '"V rms"'))
    ff.synthesize("crossing", plan=plan, out=tmp_path / "lab")
    exact = crossing_spectra.response(FREQUENCIES_HZ, 0.5)
    assert filled(tmp_path / "lab")[:16, 2] == pytest.approx(1e9 * exact / np.sqrt(2.0), rel=1e-9)


def test_the_sample_is_where_its_own_series_left_it(tmp_path: Path) -> None:
    """Both frequencies 5 Hz up: what is seen at u was at u - 5 Hz, but for 1 % of the widths."""
    bench = AvoidedCrossing(drift_hz=10.0)
    ff.synthesize_curves("crossing", drift_hz=10.0, out=tmp_path / "old")
    assert bench.voltages()[-1] == 3.0
    plan = planned(tmp_path / "plan")
    ff.synthesize(tmp_path / "old/campaign.toml", plan=plan, out=tmp_path / "lab")
    exact = crossing_spectra.response(FREQUENCIES_HZ - 5.0, 0.5)
    assert filled(tmp_path / "lab")[:16, 2] == pytest.approx(1e9 * exact, rel=0.02)


def test_quadratures_stand_behind_the_cable_each_sweep_with_a_phase_of_its_own(
    tmp_path: Path,
) -> None:
    plan = planned(tmp_path / "plan", phases=True)
    made = ff.synthesize("crossing", plan=plan, seed=4, out=tmp_path / "lab")
    assert true_values(made.truth)["delay"] == 0.03
    rows = filled(tmp_path / "lab")
    phases = []
    for first, volt in ((0, 0.5), (16, -2.0)):
        seen = rows[first : first + 16, 2] + 1j * rows[first : first + 16, 3]
        exact = 1e9 * crossing_spectra.phasor(FREQUENCIES_HZ, volt)
        turn = seen / exact * np.exp(2j * np.pi * (FREQUENCIES_HZ - 1000.0) * 0.03)
        assert turn == pytest.approx(np.full(16, turn[0]), abs=1e-8)
        assert abs(turn[0]) == pytest.approx(1.0, abs=1e-9)
        phases.append(turn[0])
    assert abs(phases[0] - phases[1]) > 1e-3


@pytest.mark.parametrize(("floor", "relative"), [("0.05 V", 0.0), ("1e-12 V", 0.03)])
def test_noise_is_that_of_the_plan(tmp_path: Path, floor: str, relative: float) -> None:
    """Both quadratures over many seeds: sigma^2 = floor^2 + (relative |S|)^2, none twice alike."""
    plan = planned(tmp_path / "plan", phases=True, floor=floor, relative=relative)
    exact = np.abs(
        1e6
        * np.concatenate([crossing_spectra.response(FREQUENCIES_HZ, volt) for volt in (0.5, -2.0)])
    )
    left = []
    for seed in range(30):
        made = ff.synthesize("crossing", plan=plan, seed=seed)
        x, y = np.concatenate([np.stack(sweep.columns) for sweep in made.measured], axis=1)
        left.append((np.hypot(x, y) - exact) / np.hypot(float(floor[:-2]), relative * exact))
    assert np.std(left) == pytest.approx(1.0, rel=0.1)  # of the radial one, 960 numbers
    assert np.corrcoef(left[0], left[1])[0, 1] < 0.6
    again = ff.synthesize("crossing", plan=plan, seed=29).files
    assert again == made.files


def test_a_pump_is_set_as_planned_and_time_may_be_a_constant(tmp_path: Path) -> None:
    """At a sweep of the bench's own the laboratory answers as it did there."""
    bench = PumpedBench(points=11, settings=((0.0, 0.0), (3e-4, 80.0), (0.0, 0.0)))
    made = ff.synthesize(bench, out=tmp_path / "old")
    text = (tmp_path / "old/campaign.toml").read_text().replace(', "time"]', "]")
    time_min = 60.0 * bench.places()[1][0]["time"]
    text = text.replace("[constants]", f'[constants]\ntime = "{time_min!r} min"')
    design = 'noise_floor = "1e-9 uV"\nsweeps = { controls = { depth = [0.0, 3e-4] } }'
    (tmp_path / "plan.toml").write_text(f"{text}\n[design]\n{design}\n")
    lines = ["detuning (kHz),depth (1),frequency (MHz),amplitude (uV)"]
    lines += [f"0.08,3e-4,{float(u) / 1e6!r}," for u in bench.places()[0][1]]
    lines += [f"0.0,0.0,{float(u) / 1e6!r}," for u in bench.places()[0][1]]
    (tmp_path / "sweeps.csv").write_text("\n".join(lines) + "\n")
    truth = tmp_path / "old/truth.toml"
    new = ff.synthesize(truth, plan=tmp_path / "plan.toml", out=tmp_path / "lab")
    pumped, still = new.measured
    assert pumped.columns[0] == pytest.approx(made.measured.true_v[1], rel=1e-9)
    # in the middle of the series nothing has drifted: the rotating waves of the string itself
    split = rotating_waves(bench, 3e-4, 80.0) / rotating_waves(bench, 0.0, 0.0)
    assert pumped.columns[0] / still.columns[0] == pytest.approx(split, rel=0.01)
    written = tomllib.loads((tmp_path / "lab/campaign.toml").read_text())
    assert written["control_sweep"]["sigma"] == "1e-15 V"
    assert new.truth["pumped"] == made.truth["pumped"]


@pytest.mark.parametrize("phases", [False, pytest.param(True, marks=pytest.mark.nightly)])
def test_what_a_design_proposes_is_measured_and_fitted(
    tmp_path: Path, phases: bool, swift_modes_fmu: Path
) -> None:
    """The fit of both holds the truth, as narrow as the design has said."""
    old, plan = tmp_path / "old", tmp_path / "next/campaign/campaign.toml"
    ff.synthesize_curves("crossing", seed=5, volts=2, points=21, phases=phases, out=old)
    (tmp_path / "design.toml").write_text(DESIGN.format(floor="0.04 V", relative=0.0))
    with ff.Fmu(swift_modes_fmu, workers=1) as fmu:
        problem = ff.Problem.of(old / "campaign.toml", fmu)
        proposed = ff.design(problem, limits=tmp_path / "design.toml")
        proposed.write(tmp_path / "next", report=False)
        made = ff.synthesize(old / "campaign.toml", plan=plan, seed=6, out=tmp_path / "lab")
        both = [old / "campaign.toml", tmp_path / "lab/campaign.toml"]
        found = ff.fit(ff.Problem.of(both, fmu), starts=1).result.parameters
    truth = true_values(made.truth)
    for name in ("a0", "a1", "f2", "lambda12", "d1", "d2"):
        assert abs(found[name].value - truth[name]) < 4.0 * found[name].std
    expected = proposed.proposals[-1].expected.at
    assert found["lambda12"].std == pytest.approx(expected, rel=0.3)


@pytest.mark.parametrize(
    ("truth", "keys", "words"),
    [
        ("q1", {}, "q1: .*'crossing'"),
        ("pumped", {}, "controls: .*'V'.*detuning, depth"),
        ("crossing", {"table": 'output = "q2"'}, "'q2'.*'q1'"),
        ("crossing", {"table": 'drive = "1/f"'}, "one tone"),
        ("crossing", {"phases": True, "table": 'scale = "shared"'}, "restarted"),
    ],
)
def test_plans_that_the_laboratory_cannot_follow(
    tmp_path: Path, truth: str, keys: dict[str, object], words: str
) -> None:
    plan = planned(tmp_path / "plan", **keys)  # type: ignore[arg-type]
    with pytest.raises(BadInput, match=words) as caught:
        ff.synthesize(truth, plan=plan)
    assert "\n" not in str(caught.value)


def test_numbers_of_the_laboratory_may_be_others(tmp_path: Path) -> None:
    plan = planned(tmp_path / "plan")
    made = ff.synthesize("crossing", plan=plan, d1_hz=5.0)
    assert true_values(made.truth)["d1"] == 5.0
    with pytest.raises(BadInput, match=r"theta_rad: .*'crossing'"):
        ff.synthesize("crossing", plan=plan, theta_rad=1.0)
