"""Demodulated decays through the FMU, against eigenvalues, and the Cramer-Rao bound."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.finding import Kind, of_kind
from tests.support.demodulated import demodulated
from tests.support.linear_traces import string

QUICK = ff.Tikhonov(nu=1e-6, levels=1, misfit="squares")
F_HZ = 1e6
STILL = {"A1": 0.0, "A2": 0.0}


@pytest.fixture(scope="module")
def fmu(swift: ff.Fmu) -> ff.Fmu:
    return swift


def near(name: str, value: float, width: float) -> ff.Parameter:
    if name.startswith("eta"):
        box = (value - width, value + width)
        return ff.Parameter(name, value + 0.1 * width, bounds=box, unit="Hz")
    return ff.Parameter(name, 1.2 * value, bounds=(0.1 * value, 6.0 * value), unit="Hz")


@pytest.mark.parametrize(
    ("quality", "amplitudes"),
    [
        pytest.param(1e8, False, id="XY-1e8"),
        pytest.param(1e3, True, id="R-1e3"),
        pytest.param(1e3, False, id="XY-1e3", marks=pytest.mark.nightly),
        pytest.param(1e8, True, id="R-1e8", marks=pytest.mark.nightly),
    ],
)
def test_two_beating_modes_of_any_quality(fmu: ff.Fmu, quality: float, amplitudes: bool) -> None:
    """Noise-free: X and Y tell all, amplitudes all but where the lines are."""
    width, theta = F_HZ / quality, 1.2
    known = {"eta_plus": F_HZ, "d1": width, "eta_minus": F_HZ + 3.0 * width, "d2": 1.3 * width}
    seen = (np.cos(theta), np.sin(theta))
    equations = string(theta, width, 1.3 * width, (F_HZ, known["eta_minus"]), seen)
    t = np.linspace(0.0, 2.0 / (np.pi * width), 90)
    start = (1.0, -0.7, 3e6, 1e6)
    z = demodulated(equations, start, F_HZ + 0.7 * width, t)
    names = ["d1", "d2", "eta_minus"] if amplitudes else list(known)
    still = {k: v for k, v in known.items() if k not in names}
    setup = ff.Setup(ff.Drive(), "q1", start_values={**STILL, "theta": theta, **still})
    trace = ff.DemodulatedTrace(
        t,
        np.abs(z) if amplitudes else z + 0.1j,
        setup=setup,
        frequency_hz=F_HZ + 0.7 * width,
        input="b",
        modes=2,
        offset=not amplitudes,
        floor=False,
    )
    assert trace.solved_inside == (3 if amplitudes else 6)
    problem = ff.Problem(fmu, [near(name, known[name], width) for name in names], trace)
    truth = np.array([known[name] for name in names])
    at_truth = problem.residuals(truth)
    # phases of 1e8 turns are known to 1e-8 of a turn
    assert float(np.max(np.abs(at_truth))) < (1e-6 if quality > 1e6 else 1e-9)
    fit = ff.fit(problem, method=QUICK, starts=1)
    assert np.max(np.abs(np.array(fit.x) - truth)) < 1e-4 * width


def exact(t: FloatArray, rate: complex, start: complex) -> np.ndarray:
    return np.asarray(start * np.exp(rate * t))


def single(t: FloatArray, values: np.ndarray, width: float, **more: object) -> ff.DemodulatedTrace:
    setup = ff.Setup(ff.Drive(), "q1_hybrid", start_values={**STILL, "theta": 0.0})
    arguments: dict[str, object] = {"setup": setup, "frequency_hz": F_HZ, "input": "b", **more}
    return ff.DemodulatedTrace(t, values, **arguments)  # type: ignore[arg-type]


def test_phasors_are_as_sure_as_can_be(fmu: ff.Fmu) -> None:
    """Frequency and width of one mode, its complex factor unknown: the bound by hand."""
    width, sigma = 2.0, 0.02
    t = np.linspace(0.0, 0.4, 120)
    rng = np.random.default_rng(3)
    # the free mode turns at sqrt(eta^2 - (d/2)^2): 5e-7 Hz below
    z = exact(t, 2j * np.pi * 0.3 - np.pi * width, 0.6 - 0.8j)
    noisy = z + sigma * (rng.standard_normal(t.size) + 1j * rng.standard_normal(t.size))
    slopes = [2j * np.pi * t * z, -np.pi * t * z, z, 1j * z]
    matrix = np.stack([np.concatenate([s.real, s.imag]) for s in slopes], axis=1) / sigma
    bound = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))[:2]
    parameters = [near("eta_plus", F_HZ + 0.3, width), near("d1", width, width)]
    problem = ff.Problem(fmu, parameters, single(t, noisy, width, sigma=sigma))
    fit = ff.fit(problem, method=QUICK, starts=1)
    for name, true, std in zip(("eta_plus", "d1"), (F_HZ + 0.3, width), bound, strict=True):
        assert fit[name].std == pytest.approx(std, rel=0.05)
        assert abs(fit[name].value - true) < 4.0 * std


def test_what_a_rate_of_samples_does_not_tell_apart(fmu: ff.Fmu) -> None:
    """exp(2 pi i (f - F) n/r) is the same at f + k r, and not at their mirror images about F."""
    width, rate, offset = 2.0, 250.0, 40.0
    t = np.arange(120) / rate
    z = exact(t, 2j * np.pi * offset - np.pi * width, 0.6 - 0.8j)
    trace = single(t, z, width)
    box = ff.Parameter("eta_plus", F_HZ, bounds=(F_HZ - 800.0, F_HZ + 800.0), unit="Hz")
    problem = ff.Problem(fmu, [box, near("d1", width, width)], trace)
    for turns in (-3, -1, 0, 1, 2):
        there = problem.residuals(np.array([F_HZ + offset + turns * rate, width]))
        assert float(np.max(np.abs(there))) < 1e-5  # the free mode turns 5e-7 Hz below
        mirrored = problem.residuals(np.array([F_HZ - offset + turns * rate, width]))
        assert float(np.sqrt(np.mean(mirrored**2))) > 0.2


def test_frequencies_that_the_samples_do_not_tell_apart_are_named(fmu: ff.Fmu) -> None:
    width, rate = 2.0, 250.0
    t = np.arange(120) / rate
    rng = np.random.default_rng(8)
    noise = 0.01 * (rng.standard_normal(120) + 1j * rng.standard_normal(120))
    trace = single(t, exact(t, 80j * np.pi - np.pi * width, 1.0) + noise, width, sigma=0.01)
    box = (F_HZ - 250.0, F_HZ + 100.0)
    parameter = ff.Parameter("eta_plus", F_HZ + 39.0, bounds=box, unit="Hz", scale=100.0)
    settings = {**STILL, "theta": 0.0, "d1": width}
    still = replace(trace, setup=replace(trace.setup, start_values=settings))
    problem = ff.Problem(fmu, [parameter], still)
    found = ff.profile(ff.fit(problem, method=QUICK, starts=1))
    values = [F_HZ + 40.0, F_HZ + 40.0 - rate]
    reason = found["eta_plus"].reason
    assert found.knowledge is not None
    said = [float(each) for each in re.findall(r"\d{6,}\.\d+", reason)]
    assert said[:2] == pytest.approx(values, abs=0.1, rel=0.0)
    assert said[2] < values[1] < values[0] < said[3]
    [ambiguous] = of_kind(found.findings, Kind.sampling_ambiguity)
    assert ambiguous.numbers["rate_hz"] == pytest.approx(rate)


def test_amplitudes_drown_in_noise_and_are_still_told(fmu: ff.Fmu) -> None:
    """Twelve decay times, the last eight within the noise; without a floor nothing fits."""
    width, sigma = 2.0, 0.02
    t = np.linspace(0.0, 12.0 / (np.pi * width), 240)
    rng = np.random.default_rng(5)
    noise = sigma * (rng.standard_normal(t.size) + 1j * rng.standard_normal(t.size))
    seen = np.abs(exact(t, -np.pi * width, 1.0) + noise)
    trace = single(t, seen, width)
    fit = ff.fit(ff.Problem(fmu, [near("d1", width, width)], trace), method=QUICK, starts=1)
    # of a phasor known in phase: sigma over the derivatives by d and by the amplitude
    slopes = np.stack([-np.pi * t * np.exp(-np.pi * width * t), np.exp(-np.pi * width * t)], axis=1)
    std = sigma * np.sqrt(np.linalg.inv(slopes.T @ slopes)[0, 0])
    assert 0.85 * std < fit["d1"].std < 1.4 * std
    assert abs(fit["d1"].value - width) < 4.0 * fit["d1"].std
    bare = single(t, seen, width, floor=False)
    pulled = ff.fit(ff.Problem(fmu, [near("d1", width, width)], bare), method=QUICK, starts=1)
    assert pulled["d1"].std > 5.0 * fit["d1"].std  # what it leaves hangs together


def test_a_decay_is_found_behind_its_drive() -> None:
    rng = np.random.default_rng(6)
    t = np.linspace(-0.2, 0.8, 500)
    z = np.where(t < 0.0, 0.5j, exact(np.maximum(t, 0.0), 2j * np.pi * 3.0 - 6.0, 0.5j))
    z = z + 0.002 * (rng.standard_normal(500) + 1j * rng.standard_normal(500))
    for values in (z, np.abs(z)):
        trace = single(t, values, 2.0, begin="found")
        assert -0.002 < trace.t[0] < 0.03
    with pytest.raises(BadInput, match="free decay"):
        single(t, np.exp(2j * np.pi * 3.0 * t), 2.0, begin="found")


# --- campaign files -------------------------------------------------------------------------

CAMPAIGN = """
title = "A mode lets go"

[fmu]
file = "{fmu}"

[fmu.start]
A1 = 0.0
A2 = 0.0
theta = 0.0
eta_plus = 1e6

[observe]
output = "q1_hybrid"

[[demodulated_trace]]
file = "phasors.csv"
frequency = "1 MHz"
input = "b"

[[demodulated_trace]]
file = "levels.csv"
columns = {{ amplitude = "level" }}
frequency = "1 MHz"
input = "b"

[[parameters]]
name = "d1"
lower = "0.2 Hz"
upper = "20 Hz"
start = "2.4 Hz"

[continuation]
nu_start = 1e-6
iterations = 1
starts = 1
misfit = "squares"
"""
T = np.linspace(0.0, 0.4, 100)


def written(folder: Path, fmu: Path, campaign: str = CAMPAIGN) -> Path:
    """X and Y in two units, and levels 40 dB above nobody knows what."""
    rng = np.random.default_rng(8)
    z, other = (
        exact(T, -2.0 * np.pi, 0.6 - 0.8j)
        + 0.01 * (rng.standard_normal(T.size) + 1j * rng.standard_normal(T.size))
        for _ in range(2)
    )
    files = {
        "phasors.csv": ("time (ms),X (mV),Y (uV)", (1e3 * T, z.real, 1e3 * z.imag)),
        "levels.csv": ("time (s),level (dBm)", (T, 40.0 + 20.0 * np.log10(np.abs(other)))),
    }
    for name, (head, columns) in files.items():
        rows = [",".join(map(repr, map(float, row))) for row in np.column_stack(columns)]
        (folder / name).write_text("\n".join([head, *rows]))
    path = folder / "campaign.toml"
    path.write_text(campaign.format(fmu=fmu.as_posix()))
    return path


def test_a_campaign_file_tells_of_phasors_and_levels(
    fmu: ff.Fmu, swift_fmu: Path, tmp_path: Path
) -> None:
    problem = ff.Problem.of(ff.read_campaign(written(tmp_path, swift_fmu)), fmu)
    fit = ff.fit(problem)
    assert fit.success
    assert abs(fit["d1"].value - 2.0) < 4.0 * fit["d1"].std
    [measurement] = problem.record.measurements
    values = np.concatenate([np.full(100, 1.0 + 0.0j), np.full(100, 1.0)])
    figures = measurement.figures(values, values)
    assert [f.name for f in figures] == ["demodulated_1", "demodulated_2"]
    assert [len(f.panels) for f in figures] == [4, 3]
    assert "at 1 MHz" in figures[0].caption


def changed(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert text.count(old) >= 1
    path.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        pytest.param("phasors.csv", "Y (uV)", "Z (uV)", "'Y'", id="no Y"),
        pytest.param("phasors.csv", "X (mV),Y", "A (mV),B", "nor 'amplitude', among", id="neither"),
        pytest.param("phasors.csv", "Y (uV)", "Y (s)", "'s', wanted 'mV'", id="units"),
        pytest.param("phasors.csv", "X (mV)", "X", "'X' has no unit", id="no unit"),
        pytest.param("levels.csv", "time (s)", "time (V)", "found unit 'V'", id="time"),
        pytest.param("levels.csv", "\n0.0,", "\n0.5,", "row 3: time", id="not rising"),
        pytest.param("campaign.toml", '"1 MHz"', '"0 Hz"', "a positive frequency", id="frequency"),
        pytest.param("campaign.toml", '"1 MHz"', '"1 mV"', "'mV', wanted 'Hz'", id="no frequency"),
        pytest.param("campaign.toml", 'frequency = "1 MHz"\n', "", 'as "1.2 MHz"', id="missing"),
        pytest.param("campaign.toml", '"b"', '"c"', "'c'", id="no input"),
        pytest.param("campaign.toml", '"b"', '"b"\nmodes = 0', "modes", id="no modes"),
        pytest.param("campaign.toml", '"b"', '"b"\nsigma = "0 V"', "more than zero", id="sigma"),
        pytest.param(
            "campaign.toml", '"level" }', '"level", X = "X" }', "together with X or Y", id="both"
        ),
    ],
)
def test_bad_files_and_keys_are_told_in_a_sentence(
    swift_fmu: Path, tmp_path: Path, file: str, old: str, new: str, said: str
) -> None:
    path = written(tmp_path, swift_fmu)
    changed(tmp_path / file, old, new)
    with pytest.raises(BadInput) as raised:
        ff.Problem.of(ff.read_campaign(path)).record  # noqa: B018  # bound to the FMU here
    assert said in " ".join(raised.value.args)
    assert "\n" not in raised.value.args[0]


@pytest.mark.parametrize(
    ("values", "more", "said"),
    [
        pytest.param(np.ones(99), {}, "(100,) times", id="shapes"),
        pytest.param(np.linspace(-1.0, 1.0, 100), {}, "sample 0: amplitude -1", id="negative"),
        pytest.param(np.zeros(100), {}, "every value is zero", id="nothing"),
        pytest.param(np.ones(100), {"frequency_hz": np.inf}, "a positive frequency", id="f"),
        pytest.param(np.ones(100), {"input": ""}, "the input", id="input"),
        pytest.param(np.ones(100), {"offset": True}, "phasors", id="offset"),
        pytest.param(np.ones(100), {"modes": 30}, "30 modes for 100 samples", id="modes"),
        pytest.param(np.ones(100), {"sigma": -1.0}, "sigma is wanted", id="sigma"),
        pytest.param(np.ones(100), {"begin": "late"}, "wanted 'first' or 'found'", id="begin"),
        pytest.param(np.ones(100), {"begin": "found", "modes": 2}, "of 2 modes", id="beats"),
        pytest.param(np.full(100, np.nan), {}, "finite numbers", id="nan"),
        pytest.param(
            np.clip(np.exp(-T) * np.cos(90.0 * T), -0.6, 0.6) + 0.1j * T, {}, "clipped", id="clip"
        ),
    ],
)
def test_bad_arrays_are_told_in_a_sentence(
    values: np.ndarray, more: dict[str, object], said: str
) -> None:
    with pytest.raises(BadInput) as raised:
        single(T, values, 2.0, **more)
    assert said in str(raised.value)
