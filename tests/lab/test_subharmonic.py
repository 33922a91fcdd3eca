"""Pumped sweeps at two subharmonics of the laboratory: openings, files, and what is refused."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import jv

import fitting as ff
from fitting.lab.pumped import PumpedBench, measure_pumped
from fitting.lab.subharmonic import PumpedSweep, SubharmonicBench
from fitting.lab.synthesis import synthesize
from fitting.measurements.control_sweep import ReadSpectra
from fitting.text.errors import BadInput
from tests.support.closest_peaks import closest_peaks_hz

BENCH = SubharmonicBench()
#: Lines narrower than their openings: peaks are where the eigenfrequencies are.
SHARP = replace(BENCH, string=replace(BENCH.string, d1_hz=24.0, d2_hz=20.0))
TONES = Path(__file__).parents[2] / "data" / "string_q1" / "campaign.toml"
SHIPPED = Path(__file__).parents[2] / "data" / "string_pumped"


def opening_hz(bench: SubharmonicBench, volts: float, order: int) -> float:
    """|P~12|/(2 sqrt(eta+ eta-)) 2 n |J_n(beta)/beta|, of a pump on f1^2 alone."""
    string, depth = bench.string, bench.depth_per_volt * volts
    c, s = np.cos(string.theta_rad), np.sin(string.theta_rad)
    plus, minus = string.eta_plus_hz, string.eta_minus_hz
    p11 = depth * ((c * plus) ** 2 + (s * minus) ** 2)
    beta = p11 * (s**2 / (2.0 * minus) - c**2 / (2.0 * plus)) / ((minus - plus) / order)
    of_order = 2.0 * order * abs(float(jv(order, beta)) / beta)
    return float(p11 * abs(c * s) / (2.0 * np.sqrt(plus * minus)) * of_order)


def eigenfrequencies_hz(bench: SubharmonicBench, volts: float, pump_hz: float) -> np.ndarray:
    """The two next to eta_plus, without damping: roots u of det(C - (u + k u_p)^2 + P/2 beside)."""
    string, reach = bench.string, 5
    turn, size = string.transform(), 2 * (2 * reach + 1)
    c, s = turn[1, 1], turn[1, 0]
    f1 = np.hypot(c * string.eta_plus_hz, s * string.eta_minus_hz)
    pump = turn @ np.diag([bench.depth_per_volt * volts * f1**2, 0.0]) @ turn.T
    line = np.diag([string.eta_plus_hz, string.eta_minus_hz]) ** 2
    beside = np.eye(2 * reach + 1, k=1) + np.eye(2 * reach + 1, k=-1)
    stiffness = np.kron(np.eye(2 * reach + 1), line) + 0.5 * np.kron(beside, pump)
    shift = pump_hz * np.kron(np.diag(np.arange(-reach, reach + 1.0)), np.eye(2))
    unit = 7e6  # rows of one size
    matrix = np.block([[-shift, unit * np.eye(size)], [stiffness / unit, -shift]])
    roots = np.linalg.eigvals(matrix).real
    return np.sort(roots[np.abs(roots - string.eta_plus_hz) < 3000.0])


@pytest.mark.parametrize(("volts", "order"), [(1.0, 1), (10.0, 2)])
def test_the_line_opens_as_the_subharmonic_says(volts: float, order: int) -> None:
    """The opening by the Bessel formula, and where it is closest by eigenfrequencies."""
    at_hz, apart_hz = closest_peaks_hz(SHARP, volts, order)
    assert apart_hz == pytest.approx(opening_hz(SHARP, volts, order), rel=0.02)
    pumps = at_hz + np.linspace(-20.0, 20.0, 9)
    apart = [float(np.ptp(eigenfrequencies_hz(SHARP, volts, pump))) for pump in pumps]
    bend, slope, _ = np.polyfit(pumps - at_hz, np.square(apart), 2)
    assert -0.5 * slope / bend == pytest.approx(0.0, abs=1.0)
    assert min(apart) == pytest.approx(apart_hz, rel=0.02)


def test_the_third_sweep_is_where_the_peaks_are_closest() -> None:
    third = BENCH.sweeps[2]
    at_hz, apart_hz = closest_peaks_hz(BENCH, third.volts, 2)
    assert at_hz == pytest.approx(third.pump_hz, abs=0.5)
    assert 2.0 < apart_hz / BENCH.string.widths_hz()[0] < 5.0
    with pytest.raises(ValueError, match="does not open"):
        closest_peaks_hz(BENCH, 0.1, 2)


def test_the_pump_at_the_distance_is_that_of_the_other_bench() -> None:
    """The same string and depth as `PumpedBench` sweeps it, with a pump on lambda^2 it is not."""
    other = PumpedBench(settings=((0.0, 0.0), (3e-4, 0.0)), drift_hz=0.0)
    there, u_hz = other.places()[1]
    at = {"volts": 1.0, "pump": 87340.0}
    found = np.abs(BENCH.phasors(at, u_hz))
    assert found == pytest.approx(np.abs(other.phasors(there, u_hz)), rel=1e-10)
    for changes in ({"coupling_share": 0.05}, {"second_share": 0.5}):
        other_pump = replace(BENCH, **changes)  # type: ignore[arg-type]
        moved = np.abs(other_pump.phasors(at, u_hz))
        assert np.max(np.abs(moved - found)) > 0.05 * np.max(found)


def test_seeds_files_and_truth(tmp_path: Path) -> None:
    made = synthesize("string_pumped", seed=3, noise_scale=0.5, theta_rad=2.0, out=tmp_path)
    again = synthesize(tmp_path / "campaign.toml", seed=3)
    assert again.measured.bench == made.measured.bench
    assert np.array_equal(again.measured.amplitude_v, made.measured.amplitude_v)
    assert tomllib.loads((tmp_path / "truth.toml").read_text("utf-8")) == made.truth
    swept = ff.read_campaign(tmp_path / "campaign.toml").measurements["control_sweep"]
    assert isinstance(swept, ReadSpectra)
    read = np.array([s.amplitude for s in swept.spectra])
    assert read == pytest.approx(made.measured.amplitude_v, rel=1e-14)
    assert [p.controls["volts"].value for p in swept.places] == [0.0, 1.0, 10.0]
    noisy = measure_pumped(BENCH, 5)
    assert np.max(noisy.true_v) == pytest.approx(BENCH.crest_v, rel=1e-3)
    assert np.std(noisy.amplitude_v - noisy.true_v) == pytest.approx(BENCH.noise_v, rel=0.15)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"alpha1": 1.0}, "alpha1: .*'string_pumped'"),
        ({"theta_rad": 1.0}, "lambda"),
        ({"points": 3}, "8 points"),
        ({"sweeps": BENCH.sweeps[:1]}, "1 sweeps"),
        (
            {"sweeps": (BENCH.sweeps[0], PumpedSweep(volts=1.0, pump_hz=13880520.0, span_hz=1e3))},
            r"1 V at .* 1\.00",
        ),
        ({"plan": TONES}, "plan: .*'string_pumped'"),
    ],
)
def test_nonsense_is_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        synthesize("string_pumped", **changes)  # type: ignore[arg-type]


def test_the_shipped_truth_is_that_of_the_bench() -> None:
    truth = synthesize(SHIPPED / "campaign.toml", seed=1).measured.bench
    assert truth == BENCH


def test_a_planned_sweep_is_taken_at_its_voltage(tmp_path: Path) -> None:
    synthesize("string_pumped", out=tmp_path / "old")
    text = (tmp_path / "old/campaign.toml").read_text("utf-8")
    text = text.replace("[design.sweeps]", '[design]\nnoise_floor = "1e-9 uV"\n[design.sweeps]')
    (tmp_path / "plan.toml").write_text(text)
    u_hz = BENCH.about_plus_hz(BENCH.sweeps[2].span_hz)
    lines = ["volts (mV),pump (kHz),frequency (MHz),amplitude (uV)"]
    lines += [f"{v},{p},{float(u) / 1e6!r}," for v, p in ((1e4, 43.769), (0, 0)) for u in u_hz]
    (tmp_path / "sweeps.csv").write_text("\n".join(lines) + "\n")
    new = synthesize(tmp_path / "old/truth.toml", plan=tmp_path / "plan.toml")
    pumped, _ = new.measured
    exact = np.abs(BENCH.swept_at({"volts": 10.0, "pump": 43769.0}, u_hz))
    assert pumped.columns[0] == pytest.approx(exact, rel=1e-8)
    assert new.truth["string_pumped"]["depth_per_volt"] == BENCH.depth_per_volt
