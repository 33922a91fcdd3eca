"""Curves of the virtual laboratory: complex sweeps, spectra over a voltage, by closed forms."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fitting as ff
from fitting.lab.curves import AvoidedCrossing, WiredResonance
from fitting.lab.names import WIRED
from fitting.lab.true_values import true_values
from fitting.measurements.complex_sweep import read_complex
from fitting.measurements.control_sweep import ControlSweep
from fitting.text.errors import BadInput
from tests.support import crossing_spectra
from tests.support.complex_data import mode, notch


@pytest.mark.parametrize("kind", WIRED)
def test_a_wired_resonance_is_that_of_the_closed_form(kind: str, tmp_path: Path) -> None:
    """The dip, its complex coupling, slope, gain and delay, as a file tells them."""
    made = ff.synthesize_curves(kind, noise=0.0, out=tmp_path)
    told = made.truth["curve"]
    read = read_complex(tmp_path / "sweep.csv")
    u, eta, width = read.u_hz, told["eta_hz"], told["width_hz"]
    q = eta / width
    line = 0.3 * np.exp(1.1j) * np.exp(-2j * np.pi * (u - eta) * told["delay_s"])
    if kind == "transmission":
        [top] = np.abs(mode(np.array([eta]), eta, width))
        exact = line * mode(u, eta, width) / top
    else:
        coupling = told["coupling"] * q * np.exp(-1j * told["phase_rad"])
        twice = 2.0 if kind == "reflection" else 1.0
        slope = told["slope"] * (u - eta) / (0.5 * np.ptp(u))
        exact = line * (notch(u, eta, q, coupling / twice) + slope)
        quality = 1.0 / np.real(1.0 / coupling)
        assert made.truth["outcome"]["Q_coupling"] == pytest.approx(quality, rel=1e-12)
    assert read.y == pytest.approx(exact, abs=1e-9 * float(np.max(np.abs(exact))))


def test_the_fit_finds_what_was_put_in(oscillator_fmu: Path, tmp_path: Path) -> None:
    made = ff.synthesize_curves("notch", seed=5, points=101, out=tmp_path)
    problem = ff.Problem.of(tmp_path / "campaign.toml", ff.Fmu(oscillator_fmu, workers=1))
    result = ff.fit(problem, starts=1).result
    for name, truth in (("eta_plus", 5e9), ("d1", 420e3), ("delay", 41e-9)):
        found = result.parameters[name]
        assert abs(found.value - truth) < 4.0 * found.std
    [coupling] = [q for q in result.quadratures.qualities if q.name == "Q_coupling"]
    assert abs(coupling.value - made.truth["outcome"]["Q_coupling"]) < 4.0 * coupling.std


def test_spectra_over_a_voltage_are_those_of_the_closed_form(tmp_path: Path) -> None:
    made = ff.synthesize_curves("crossing", noise=0.0, out=tmp_path)
    told = made.truth["curve"]
    assert told == {
        **told,
        "f1_hz": crossing_spectra.A0,
        "tuning_hz_v": crossing_spectra.A1,
        "f2_hz": crossing_spectra.B0,
        "lambda_hz": crossing_spectra.LAMBDA,
        "d1_hz": crossing_spectra.WIDTH,
    }
    campaign = ff.read_campaign(tmp_path / "campaign.toml")
    [sweep] = ff.Problem.of(campaign).record.measurements
    assert isinstance(sweep, ControlSweep)
    assert len(sweep.spectra) == told["volts"]
    for spectrum in sweep.spectra:
        exact = crossing_spectra.response(spectrum.u_hz, float(spectrum.settings["V"]))
        assert spectrum.y == pytest.approx(1e6 * exact, rel=1e-9)


def test_three_modes_over_a_voltage_are_those_of_the_equations_of_motion(tmp_path: Path) -> None:
    """q1 = [(C - w^2 + i w D)^-1]_11, beyond the third mode as far as beyond the second."""
    made = ff.synthesize_curves("crossing", modes=3, noise=0.0, out=tmp_path, f3_hz=1012.0)
    told = made.truth["curve"]
    table = np.genfromtxt(tmp_path / "map.csv", delimiter=",", skip_header=3)
    volt, u, seen = table.T
    assert np.unique(volt) == pytest.approx(np.linspace(-3.0, 6.0, 13))
    assert (u.min(), u.max()) == pytest.approx((980.0, 1032.0))
    square = np.zeros((u.size, 3, 3))
    square[:, 0, 0] = (told["f1_hz"] + told["tuning_hz_v"] * volt) ** 2
    square[:, 1, 1], square[:, 2, 2] = told["f2_hz"] ** 2, told["f3_hz"] ** 2
    square[:, 0, 1] = square[:, 1, 0] = -(told["lambda_hz"] ** 2)
    square[:, 1, 2] = square[:, 2, 1] = -(told["lambda23_hz"] ** 2)
    w = 2 * np.pi * u[:, None, None]
    widths = np.diag([told["d1_hz"], told["d2_hz"], told["d3_hz"]])
    system = (2 * np.pi) ** 2 * square - w**2 * np.eye(3) + 2j * np.pi * w * widths
    exact = np.abs(np.linalg.inv(system)[:, 0, 0])
    assert seen == pytest.approx(told["gain"] * exact, rel=1e-9)


def test_a_fit_of_three_modes_is_told_both_couplings(tmp_path: Path) -> None:
    """At the truth the rows are the noise, 1 % of each spectrum's largest."""
    made = ff.synthesize_curves("crossing", modes=3, seed=6, volts=4, out=tmp_path)
    truth = true_values(made.truth)
    assert {"lambda12", "lambda23", "f3", "d3"} <= set(truth)
    with ff.Fmu("CoupledModes3", workers=1) as fmu:
        problem = ff.Problem.of(tmp_path / "campaign.toml", fmu)
        rows = problem.residuals([truth[name] for name in problem.names])
    free = rows.size - 4  # a scale for each spectrum, solved inside
    assert np.sum((rows / 0.01) ** 2) == pytest.approx(free, rel=0.25)
    assert set(problem.names) == set(truth)


def test_noise_comes_from_the_seed() -> None:
    one, same, other = (ff.synthesize_curves("notch", seed=s).files["sweep.csv"] for s in (1, 1, 2))
    assert one == same != other
    exact = WiredResonance().values()
    table = [row.split(",") for row in str(one).splitlines() if row[0].isdigit()]
    seen = np.array([complex(float(x), float(y)) for _, x, y in table])
    left = (seen - exact) / np.max(np.abs(exact))
    assert np.std(left.real) == pytest.approx(0.005, rel=0.2)
    assert np.std(left.imag) == pytest.approx(0.005, rel=0.2)


def test_both_frequencies_drift() -> None:
    still, moved = AvoidedCrossing(lambda_hz=1e-3), AvoidedCrossing(lambda_hz=1e-3, drift_hz=10.0)
    tops = [x.frequencies_hz()[np.argmax(np.abs(x.values()), axis=1)] for x in (still, moved)]
    steps = np.linspace(-5.0, 5.0, 7)
    assert tops[1] - tops[0] == pytest.approx(steps, abs=0.7)


def test_a_crossing_with_phases_is_turned_by_its_cable_and_by_each_restart() -> None:
    """Without noise: the moduli of the plain one; of the phases a straight line is left."""
    made = ff.synthesize_curves("crossing", seed=4, noise=0.0, phases=True)
    rows = [
        [float(cell) for cell in row.split(",")]
        for row in str(made.files["map.csv"]).splitlines()
        if row[0] in "-0123456789"
    ]
    volt, u, x, y = np.array(rows).T
    plain = AvoidedCrossing(noise=0.0)
    exact = plain.values()
    seen = (x + 1j * y).reshape(exact.shape)
    assert np.abs(seen) == pytest.approx(np.abs(exact), rel=1e-9)
    assert np.unique(volt) == pytest.approx(plain.voltages())
    turns = np.unwrap(np.angle(seen / exact), axis=1) / (2.0 * np.pi)
    slopes, offsets = np.polyfit(u.reshape(exact.shape)[0] - 1000.0, turns.T, 1)
    assert slopes == pytest.approx(np.full(7, -0.03), rel=1e-6)
    assert np.std(np.exp(2j * np.pi * offsets)) > 0.5


@pytest.mark.parametrize(
    ("kind", "changes", "words"),
    [
        ("hanger", {}, r"'hanger': .*transmission"),
        ("notch", {"lambda_hz": 1.0}, r"lambda_hz: .*'notch'"),
        ("notch", {"width_hz": 0.0}, r"width_hz: found 0\.0"),
        ("notch", {"points": 3}, r"points: found 3, .* 8 "),
        ("notch", {"noise": -1.0}, r"noise: found -1\.0"),
        ("notch", {"span_widths": 1e9}, r"span"),
        ("crossing", {"modes": 4}, r"modes: found 4"),
        ("notch", {"modes": 3}, r"modes: .*'notch'"),
        ("crossing", {"volts": 1}, r"volts: found 1, .* 2 "),
        ("notch", {"seed": -1}, r"seed: found -1"),
    ],
)
def test_what_no_laboratory_has_is_refused(kind: str, changes: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        ff.synthesize_curves(kind, **changes)


def test_the_campaign_names_its_model(tmp_path: Path) -> None:
    files = ff.synthesize_curves("crossing").files
    assert tomllib.loads(str(files["campaign.toml"]))["fmu"]["model"] == "CoupledModes2"
