"""Drives, sweeps and checks of an FMU from a program: all that the commands can."""

from __future__ import annotations

import csv
import math
import re
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.lab.string import TwoModes, steady_state
from tests.support.cfmu_build import build_c_fmu

ROOT = Path(__file__).resolve().parents[2]
MODES = TwoModes(
    theta_rad=1.9498, d1_hz=120.0, d2_hz=90.0, eta_plus_hz=6940260.0, eta_minus_hz=7027600.0
)
#: The same in the FMU's words, on its periodic orbit from the beginning.
VALUES: dict[str, float | str | bool] = {
    "theta": 1.9498,
    "d1": 120.0,
    "d2": "90 Hz",
    "eta_plus": "6.94026 MHz",
    "eta_minus": "7.0276 MHz",
    "periodic_start": True,
}
PAIR_HZ = np.array([6.94016e6, 6.94036e6])


@pytest.fixture(scope="module")
def fmu(swift_fmu: Path) -> ff.Fmu:
    return ff.Fmu(swift_fmu, workers=1)


@pytest.fixture(scope="module")
def mass(tmp_path_factory: pytest.TempPathFactory) -> ff.Fmu:
    """A mass of 1 g on a spring of 4 kN/m, damped by 20 mN s/m, with an input "force"."""
    return ff.Fmu(build_c_fmu(tmp_path_factory.mktemp("mass")), workers=1)


def test_an_input_is_driven_by_tones_of_given_frequencies(mass: ff.Fmu) -> None:
    drive = ff.Drive(input="force", amplitude=0.5)
    found = mass.simulate(tones=["0.31 kHz"], drive=drive, accuracy=1e-3)
    omega = 2 * math.pi * 310.0
    truth = 0.5 / abs(4e3 - 1e-3 * omega**2 + 2e-2j * omega)
    assert found.peaks[0, 0] == pytest.approx(truth, rel=1e-3)
    assert found.drive.names == ("f1",)


def test_tones_are_made_by_parameters_that_are_set(fmu: ff.Fmu) -> None:
    drive = ff.Drive(frequency_names=("u1", "u2"), amplitude_names=("A1", "A2"), amplitude=3.0)
    found = fmu.simulate(VALUES, tones=PAIR_HZ, drive=drive, outputs=["q1_hybrid", "q2_hybrid"])
    np.testing.assert_allclose(found.peaks, 3.0 * np.abs(steady_state(MODES, PAIR_HZ)), rtol=1e-6)
    assert found.drive.names == ("u1", "u2")


def test_a_plan_keeps_to_what_is_asked_and_drives_nothing(fmu: ff.Fmu) -> None:
    at_rest = {name: value for name, value in VALUES.items() if name != "periodic_start"}
    asked = ff.Accuracy(1e-4, settle_s=0.08, window_s=0.025, forbid="periodic start")
    plan = fmu.plan(at_rest, accuracy=asked)
    assert plan.settle_s == 0.08
    assert plan.promised <= 1e-4
    [forbidden] = [d for d in plan.decisions if d.subject == "periodic start"]
    assert forbidden.forced
    assert not forbidden.taken
    found = fmu.simulate(at_rest, accuracy=asked)
    assert found.spectrum.window_s == pytest.approx(0.025)
    truth = np.abs(steady_state(MODES, PAIR_HZ))[:, :1]
    np.testing.assert_allclose(found.peaks, truth, rtol=found.accuracy)
    assert not fmu.simulate(
        at_rest, accuracy=ff.Accuracy(1e-4, settle_s=5e-3, forbid=asked.forbid)
    ).steady


def test_a_sweep_settles_as_asked_and_other_tones_do_not_drive(fmu: ff.Fmu, tmp_path: Path) -> None:
    f_hz = np.linspace(6.9401e6, 6.9404e6, 5)
    asked = ff.Accuracy(1e-3, settle_s=0.1)
    found = fmu.sweep(f_hz, VALUES, directions=("up", "down"), accuracy=asked)
    truth = np.abs(steady_state(MODES, f_hz)[:, 0])
    for curve in found.curves:
        assert np.abs(curve.amplitudes - truth).max() <= 1e-3 * truth.max()
    assert found.plan.settle_s == 0.1
    assert found.plan.budget.wanted == 1e-3
    assert [tone.amplitude for tone in fmu.other_tones(["u1"], VALUES)] == ["A2"]
    assert found.sweep.start_values["A2"] == 0.0
    files = fmu.write(found, tmp_path)
    assert sorted(path.name for path in files) == ["sweep.csv", "sweep.png", "sweep.svg"]
    with (tmp_path / "sweep.csv").open(encoding="utf-8") as stream:
        head, *rows = csv.reader(stream)
    assert head == ["frequency (Hz)", "q1_hybrid up (m)", "q1_hybrid down (m)"]
    assert np.array(rows, dtype=float)[:, 0].tolist() == f_hz.tolist()


def test_a_model_is_driven_by_its_name(tmp_path: Path) -> None:
    found = ff.simulate("CoupledOscillator", VALUES, outputs="q2_hybrid", accuracy=1e-3)
    truth = np.abs(steady_state(MODES, PAIR_HZ))[:, 1:]
    np.testing.assert_allclose(found.peaks, truth, rtol=1e-3)


def test_a_sound_fmu_that_suits(fmu: ff.Fmu) -> None:
    found = ff.check(fmu, ff.example("string_q1"))
    assert found.sound
    assert found.findings == ()
    tried = found.examination
    assert tried.repeats is not None
    assert tried.trial is not None
    assert found.suits is not None
    assert (found.suits.parameters, found.suits.experiments) == (3 + 5, 5)  # offsets
    assert {"q1_hybrid", "lambda"} <= set(tried.trial.numbers)
    assert tried.resets is not None
    assert tried.resets.true
    assert tried.resets.kept == ()


def test_what_is_wrong_with_an_fmu_is_told_and_not_raised(tmp_path: Path) -> None:
    path = build_c_fmu(tmp_path, reset="RESET_DOES_NOTHING")
    found = ff.check(path, ff.example("string_q1"))
    assert not found.sound
    assert found.suits is None
    assert any("q1_hybrid" in complaint for complaint in found.unsuited)
    assert found.examination.resets is not None
    assert not found.examination.resets.true
    assert found.examination.resets.kept


def test_a_copy_of_an_example_is_ones_own(tmp_path: Path) -> None:
    path = ff.example("afm_sensor", tmp_path / "mine")
    assert path.parent == tmp_path / "mine"
    assert path.read_bytes() == (ROOT / "data" / "afm_sensor" / "campaign.toml").read_bytes()
    assert ff.read_campaign(path).sweep is not None
    with pytest.raises(ff.BadInput, match="mine"):
        ff.example("afm_sensor", path.parent)


def test_what_cannot_be_driven_is_refused(fmu: ff.Fmu, mass: ff.Fmu) -> None:
    pair = ff.Drive(frequency_names=("u1", "u2"), amplitude_names=("A1", "A2"))
    f_hz = [6.94e6, 6.941e6]
    for make, words in (
        (lambda: fmu.simulate(tones=("u1", "u2"), drive=pair), "tones: found 'u1'"),
        (lambda: fmu.simulate(tones=[6.94e6], drive=pair), "found 1 frequencies, wanted 2"),
        (lambda: fmu.simulate({"A1": 2.0}, tones=f_hz, drive=pair), "'A1': "),
        (lambda: fmu.simulate(tones=[1e3], drive=ff.Drive(input="d1")), "'d1'"),
        (lambda: fmu.simulate(tones="theta"), "tones 'theta': its unit is 'rad'"),
        (lambda: fmu.simulate(outputs="q3"), "outputs 'q3': "),
        (lambda: fmu.simulate({"d1": "3 Hzz"}), "start_values 'd1': found '3 Hzz'"),
        (lambda: mass.simulate(), "u1 and u2"),
        (lambda: fmu.sweep(f_hz, {"A2": 1.0}), "u2 would drive together with u1"),
        (lambda: fmu.sweep(f_hz, {"u1": 1.0}), "'u1': "),
        (lambda: fmu.sweep(f_hz, accuracy=ff.Accuracy(window_s=1.0)), "window_s: "),
        (lambda: fmu.sweep(f_hz, directions="both"), "up, down"),
        (lambda: fmu.sweep([1.0]), "(n,)"),
        (lambda: ff.Accuracy(2.0), "accuracy: found 2.0"),
        (lambda: ff.Accuracy(settle_s=-1.0), "settle_s: found -1.0"),
        (lambda: ff.Accuracy(window_s=0.0), "window_s: found 0.0"),
        (lambda: ff.Accuracy(samples=0), "samples: found 0"),
        (lambda: ff.simulate(3), "Fmu: source is 3"),  # type: ignore[arg-type]
        (lambda: ff.check(fmu, step_s=0.0), "step_s: found 0.0"),
    ):
        with pytest.raises(ff.BadInput, match=re.escape(words)):
            make()
