"""``fmu-fit simulate`` against closed forms: X(u) = A(u)⁻¹ (1, 1)ᵀ of the coupled oscillator."""

from __future__ import annotations

import csv
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import mpmath
import numpy as np
import pytest

from fitting.cli.main import main
from fitting.fmu.runs import Run
from fitting.simulate.drive import Drive
from fitting.simulate.frf import USUAL_SWEEP_ACCURACY
from fitting.simulate.planner import plan_drives
from fitting.simulate.probe import Knowledge
from fitting.simulate.response import USUAL_ACCURACY, RemainderKind, Shown, respond
from fitting.simulate.words import remainder_in_words
from tests.support.cfmu_build import build_c_fmu, build_lag_fmu
from tests.support.undrawn import without_figures


@pytest.fixture
def drawn() -> None:
    """Of tests that look at figures."""


@pytest.fixture(autouse=True)
def _undrawn(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if "drawn" not in request.fixturenames:
        without_figures(monkeypatch)


PAIR = (6.94016e6, 6.94036e6)
AT_REST = ["--forbid", "periodic start"]


def read(path: Path) -> tuple[list[str], np.ndarray]:
    with path.open(encoding="utf-8") as stream:
        rows = list(csv.reader(stream))
    return rows[0], np.array(rows[1:], dtype=float)


def closed_form(
    tone_hz: float, theta: float, d1: float, d2: float, eta: tuple[float, float]
) -> list[float]:
    """|X| of both hybridised modes, rotation form, unit drive on both; 40 digits."""
    with mpmath.workdps(40):
        c, s, u = mpmath.cos(theta), mpmath.sin(theta), mpmath.mpf(tone_hz)
        d = (
            2
            * mpmath.pi
            * mpmath.matrix(
                [
                    [c * c * d1 + s * s * d2, c * s * (d1 - d2)],
                    [c * s * (d1 - d2), s * s * d1 + c * c * d2],
                ]
            )
        )
        stiffness = mpmath.diag([(2 * mpmath.pi * e) ** 2 for e in eta])
        a = stiffness - (2 * mpmath.pi * u) ** 2 * mpmath.eye(2) + 2j * mpmath.pi * u * d
        x = mpmath.lu_solve(a, mpmath.matrix([1, 1]))
        return [float(abs(x[0])), float(abs(x[1]))]


def test_published_pair_has_the_closed_amplitudes(
    oscillator_fmu: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], drawn: None
) -> None:
    out = tmp_path / "two-tone"
    arguments = [
        "--set",
        "u1=6.94016 MHz",
        "--set",
        "u2=6940.36 kHz",
        "--set",
        "d1=120",
        "--set",
        "theta=1.9498",
        "--set",
        "eta_plus=6.94026 MHz",
    ]
    outputs = ["--outputs", "q1_hybrid,q2_hybrid"]
    assert main(["simulate", str(oscillator_fmu), *arguments, *outputs, "--out", str(out)]) == 0
    header, peaks = read(out / "peaks.csv")
    assert header == ["frequency (Hz)", "q1_hybrid (m)", "q2_hybrid (m)"]
    truth = [closed_form(tone, 1.9498, 120.0, 90.0, (6.94026e6, 7.0276e6)) for tone in PAIR]
    np.testing.assert_array_equal(peaks[:, 0], PAIR)
    np.testing.assert_allclose(peaks[:, 1:], truth, rtol=1e-9)

    _, spectrum = read(out / "spectrum.csv")
    assert (np.diff(spectrum[:, 0]) > 0).all()
    at_tones = [int(np.argmin(np.abs(spectrum[:, 0] - tone))) for tone in PAIR]
    np.testing.assert_allclose(spectrum[at_tones, 1:], truth, rtol=1e-9)
    rest = np.delete(spectrum[:, 1:], at_tones, axis=0)
    assert (rest.max(axis=0) < 1e-8 * np.max(truth, axis=0)).all()

    _, beating = read(out / "beating.csv")
    assert beating[-1, 0] - beating[0, 0] == pytest.approx(2 / 200, rel=1e-3)  # two beats
    assert np.abs(beating[:, 1]).max() == pytest.approx(sum(t[0] for t in truth), rel=1e-2)
    _, carrier = read(out / "carrier.csv")
    assert np.abs(carrier[:, 1]).max() == pytest.approx(sum(t[0] for t in truth), rel=1e-2)
    for name in ("trace", "spectrum"):
        assert (out / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        svg = "".join(ET.parse(out / f"{name}.svg").getroot().itertext())
        for token in ("CoupledOscillator", "6.94016 MHz", "6.94036 MHz"):
            assert token in svg
    texts = set(ET.parse(out / "spectrum.svg").getroot().itertext())
    assert len([text for text in texts if re.fullmatch("10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", text)]) > 4
    assert not {"0.1", "10", "100"} & texts  # powers and nothing else
    assert "time − 0 s (ms)" in "".join(ET.parse(out / "trace.svg").getroot().itertext())


def test_a_model_goes_by_its_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "CoupledOscillator", "--accuracy", "1e-3", "--plan"]) == 0
    assert "goal 1.0e-03" in capsys.readouterr().out


def test_what_help_says_is_wanted_is_what_is_planned_for(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for command, usual in (("simulate", USUAL_ACCURACY), ("sweep", USUAL_SWEEP_ACCURACY)):
        with pytest.raises(SystemExit):
            main([command, "--help"])
        text = " ".join(capsys.readouterr().out.split())
        said = re.search(r"--accuracy ACCURACY [^(]*\((1e-\d+)\)", text)
        assert said is not None
        assert float(said[1]) == usual


def test_figures_and_tables_are_reproducible(swift_fmu: Path, tmp_path: Path, drawn: None) -> None:
    for name in ("a", "b"):
        arguments = ["simulate", str(swift_fmu), "--set", "periodic_start=true"]
        assert main([*arguments, "--out", str(tmp_path / name)]) == 0
    files = sorted(p.name for p in (tmp_path / "a").iterdir())
    assert len(files) == 9  # the list of them is one
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_tones_without_a_common_period_are_fitted(swift_fmu: Path, tmp_path: Path) -> None:
    pair = (6940160.1234567, 6940360.7654321)
    tones = [f"--set=u{k + 1}={tone!r}" for k, tone in enumerate(pair)]
    assert main(["simulate", str(swift_fmu), *tones, "--out", str(tmp_path)]) == 0
    _, peaks = read(tmp_path / "peaks.csv")
    truth = [closed_form(tone, 1.9498, 120.0, 90.0, (6.94026e6, 7.0276e6))[0] for tone in pair]
    np.testing.assert_allclose(peaks[:, 1], truth, rtol=1e-7)


def test_an_input_is_driven_where_no_parameter_holds_tones(tmp_path: Path) -> None:
    fmu = build_c_fmu(tmp_path)
    arguments = ["--input", "force", "--drive", "300 Hz, 0.31 kHz", "--level", "500 mN"]
    assert main(["simulate", str(fmu), *arguments, "--out", str(tmp_path / "out")]) == 0
    _, peaks = read(tmp_path / "out" / "peaks.csv")
    omega = 2 * math.pi * np.array([300.0, 310.0])
    truth = 0.5 / np.abs(4e3 - 1e-3 * omega**2 + 2e-2j * omega)
    np.testing.assert_allclose(peaks[:, 1], truth, rtol=1e-5)


def test_a_single_slow_tone_is_simulated(tmp_path: Path) -> None:
    """A lag of 0.7 s follows 0.2 Hz by 1/|1 + i w tau|, to what the held input allows."""
    words = ["--input", "u", "--drive", "0.2 Hz", "--set", "tau=0.7", "--accuracy", "1e-3"]
    fmu = str(build_lag_fmu(tmp_path))
    assert main(["simulate", fmu, *words, "--out", str(tmp_path / "out")]) == 0
    _, peaks = read(tmp_path / "out" / "peaks.csv")
    truth = 1.0 / math.hypot(1.0, 0.7 * 2.0 * math.pi * 0.2)
    np.testing.assert_allclose(peaks[:, 1], truth, rtol=1e-4)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--set", "u1"], ["--set u1: ", "NAME=VALUE"]),
        (["--set", "=3"], ["--set =3: ", "NAME=VALUE"]),
        (["--set", "U1=3 MHz"], ["'U1'", "did you mean 'u1'"]),
        (["--set", "thet=1"], ["'thet'", "did you mean 'theta'"]),
        (["--set", "d1=nan"], ["--set d1: found 'nan'"]),
        (["--set", "solver=envelope"], ["solver: found 'envelope'"]),
        (["--set", "solver=nan"], ["solver: found 'nan'"]),
        (["--set", "u1=6.94018"], ["6.94018 Hz", "6940360 Hz", "no common period", " 1000000: "]),
        (["--set", "u1=6.94"], ["6.94 Hz", "6940360 Hz", "50.0 s"]),
        (["--set", "u3=1"], ["'u3'"]),
        (["--set", "u1=6.94 V"], ["--set u1: ", "'V'", "'Hz'"]),
        (["--set", "u1=fast"], ["--set u1: found 'fast'"]),
        (["--set", "solver=0.5"], ["solver: found '0.5'"]),
        (["--set", "reflection=maybe"], ["reflection: found 'maybe'"]),
        (["--set", "lambda=1"], ["lambda"]),
        (["--set", "u1=6940360"], ["6940360"]),
        (["--tones", "theta,u2"], ["--tones theta: ", "'rad'"]),
        (["--outputs", "q3"], ["'q3'"]),
        (["--window", "30 ms"], ["1.2 common periods"]),
        (["--settle", "1 Hz"], ["--settle"]),
        (["--input", "b"], ["--input", "--drive"]),
        (["--settle", "nan"], ["--settle: found 'nan'"]),
        (["--settle=-1 s"], ["--settle: found -1.0"]),
        (["--window", "0"], ["--window: found '0'"]),
        (["--timeout=-1"], ["--timeout: found '-1'"]),
        (["--samples", "0"], ["--samples: found '0'"]),
        (["--samples", "3"], ["no sampling"]),
        (["--level", "2"], ["--level: ", "--input"]),
        (["--input", "b", "--drive", "1 kHz", "--level", "2 V"], ["--level: ", "'V'"]),
        (["--outputs", "lambda"], ["lambda is constant at 647567.76"]),
        (["--set", "A1=0", "--set", "A2=0"], ["q1_hybrid is constant at 0"]),
    ],
)
def test_bad_input(
    swift_fmu: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    words: list[str],
) -> None:
    out = tmp_path / "out"
    assert main(["simulate", str(swift_fmu), *arguments, "--out", str(out)]) == 2
    told = capsys.readouterr()
    for word in words:
        assert word in told.err
    assert told.err.count("\n") == 1
    assert not out.exists()


def test_free_oscillation_without_damping_is_told(
    swift_fmu: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its amplitude is as steady as the response itself, but it is not the response."""
    arguments = ["--set", "d1=0", "--set", "d2=0", "--set", "u2=6.9403 MHz", *AT_REST]
    assert main(["simulate", str(swift_fmu), *arguments, "--out", str(tmp_path)]) == 1
    text = " ".join(capsys.readouterr().out.split())
    found = re.search(r"warning apart from the tones there is (\S+) of the [a-z ]+: (.*)", text)
    assert found is not None
    # from rest, q(0) = q'(0) = 0: the response 1/((2 pi eta)² - (2 pi u)²), g = 1, phases 0, is
    # cancelled by as much of the free oscillation, which the modes of other lines add little to
    eta = 6.94026e6
    lines = [1 / (eta**2 - u**2) for u in (6.94016e6, 6.9403e6)]
    assert float(found[1]) == pytest.approx(abs(sum(lines)) / max(map(abs, lines)), rel=0.05)
    assert "6.94026 MHz" in found[2]
    assert "--settle" in text
    assert "u1" not in text.partition("warning apart")[2]


def test_what_does_not_settle_is_written_and_told(
    swift_fmu: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--set", "d1=1e-6", "--set", "d2=1e-6", *AT_REST]
    assert main(["simulate", str(swift_fmu), *arguments, "--out", str(tmp_path)]) == 1
    text = capsys.readouterr().out
    assert "not steady" in text
    assert "--settle" in text
    assert (tmp_path / "peaks.csv").exists()


def test_a_single_tone_settles_after_many_of_its_short_windows(
    swift_fmu: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """64 periods are 9 microseconds, the modes ring for milliseconds."""
    arguments = ["--tones", "u1", "--set", "A2=0", "--out", str(tmp_path)]
    assert main(["simulate", str(swift_fmu), *arguments]) == 0
    _, peaks = read(tmp_path / "peaks.csv")
    truth = closed_form(PAIR[0], 1.9498, 120.0, 90.0, (6.94026e6, 7.0276e6))[0]
    assert peaks[0, 1] == pytest.approx(truth, rel=1e-8)
    assert " steady" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("settle", "accuracy"),
    [
        ([], "1e-2"),
        pytest.param([], "1e-4", marks=pytest.mark.nightly),
        ([], "1e-9"),
        pytest.param(["--settle", "0.08 s"], "1e-2", marks=pytest.mark.nightly),
        (["--settle", "0.08 s"], "1e-4"),
        pytest.param(["--settle", "0.08 s"], "1e-9", marks=pytest.mark.nightly),
    ],
)
def test_a_start_at_rest_keeps_what_is_promised(
    settle: list[str],
    accuracy: str,
    swift_fmu: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Settling by watching or as asked for, at any accuracy: one plan, and the command keeps it."""
    arguments = ["--accuracy", accuracy, *AT_REST, *settle, "--out", str(tmp_path), "--verbose"]
    assert main(["simulate", str(swift_fmu), *arguments]) == 0
    said = capsys.readouterr().out
    promised = float(re.findall(r"accuracy (\S+) \(goal", said)[0])
    _, peaks = read(tmp_path / "peaks.csv")
    truth = [closed_form(tone, 1.9498, 120.0, 90.0, (6.94026e6, 7.0276e6))[0] for tone in PAIR]
    assert np.max(np.abs(peaks[:, 1] / truth - 1.0)) <= promised <= float(accuracy)
    assert ("settling: 80 ms" in said) == bool(settle)


def test_a_time_to_settle_that_is_too_short_is_told(
    swift_fmu: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--accuracy", "1e-4", *AT_REST, "--settle", "5 ms", "--out", str(tmp_path)]
    assert main(["simulate", str(swift_fmu), *arguments]) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert re.search(r"1\.0e-04; .*settling \(5 ms\)", said)
    assert "--settle TIME" in said


@pytest.mark.parametrize("window", [[], ["--window", "25 ms", "--settle", "200 ms"]])
def test_a_tone_that_is_not_named_is_suspected(
    window: list[str], swift_fmu: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["simulate", str(swift_fmu), "--tones", "u1", *window]
    assert main([*arguments, "--out", str(tmp_path)]) == 1
    text = " ".join(capsys.readouterr().out.split())
    assert "if the FMU also drives with u2" in text
    assert "--set A2=0" in text


def test_constant_outputs_are_told_as_such(
    swift_fmu: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], drawn: None
) -> None:
    outputs = ["--outputs", "lambda,q1_hybrid", "--set", "periodic_start=true"]
    assert main(["simulate", str(swift_fmu), *outputs, "--out", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert re.search(r"^ +lambda +constant, 647567\.76\d* Hz$", text, re.MULTILINE)
    assert re.search(r"q1_hybrid +1\.65", text)
    assert "lambda" not in "".join(ET.parse(tmp_path / "trace.svg").getroot().itertext())


def test_the_trace_fills_the_envelope_evenly(swift_fmu: Path, tmp_path: Path) -> None:
    """No 41 samples in a row miss the envelope by more than 1 - cos(pi/41), 0.3 %."""
    arguments = ["--set", "periodic_start=true", "--out", str(tmp_path)]
    assert main(["simulate", str(swift_fmu), *arguments]) == 0
    _, trace = read(tmp_path / "beating.csv")
    times, values = trace.T
    phases = [2 * np.pi * np.mod(tone * times, 1.0) for tone in PAIR]
    design = np.stack([f(phase) for phase in phases for f in (np.cos, np.sin)], axis=1)
    a, b, c, d = np.linalg.lstsq(design, values, rcond=None)[0]
    beat = np.exp(2j * np.pi * (PAIR[1] - PAIR[0]) * times)
    envelope = np.abs((a - 1j * b) + (c - 1j * d) * beat)
    n = len(times) // 41 * 41
    drawn = values[:n].reshape(-1, 41)
    inside = envelope[:n].reshape(-1, 41)
    assert n // 41 >= 390
    slack = np.ptp(inside, axis=1) + 0.003 * envelope.max()
    assert (drawn.max(axis=1) >= inside.max(axis=1) - slack).all()
    assert (drawn.min(axis=1) <= slack - inside.max(axis=1)).all()


class Cubic:
    """Response y = x + x³/8 to x = cos 2 pi f1 t + cos 2 pi f2 t, and a line that is its own."""

    def __init__(self, own: float) -> None:
        self.own = own

    def run(self, runs: Sequence[Run]) -> list[np.ndarray]:
        """Outputs of each run."""
        results = []
        for run in runs:
            t = run.settle_s + np.arange(run.samples) * run.sample_step_s
            x = np.cos(2 * np.pi * 310.0 * t) + np.cos(2 * np.pi * 320.0 * t)
            own = self.own * np.cos(2 * np.pi * 317.0 * t)
            results.append((x + x**3 / 8 + own)[:, np.newaxis])
        return results


def test_mixtures_of_the_tones_belong_to_the_response() -> None:
    drive = Drive(start_values={}, tones_hz=(310.0, 320.0), outputs=("y",))
    plan = plan_drives((drive,), 1e-6, Cubic(own=0.0), Knowledge())
    assert plan.budget.kept
    response = respond(Cubic(own=0.0), plan, Shown(window_s=2.0))
    # cos a + cos b, cubed: 9/4 at either tone, 3/4 at 2a - b
    np.testing.assert_allclose(response.peaks[:, 0], 1 + 9 / 32, rtol=1e-9)
    assert response.steady
    beside = response.remainder
    assert beside.kind == RemainderKind.COMBINATION
    assert beside.share == pytest.approx((3 / 32) / (41 / 32), rel=0.05)
    assert f" {beside.at_hz:g} Hz" in remainder_in_words(beside)
    assert {(2, -1), (-1, 2)} <= {line.factors for line in response.lines}

    response = respond(Cubic(own=1e-4), plan, Shown(window_s=2.0))
    assert not response.steady
    assert response.remainder.kind == RemainderKind.UNEXPLAINED
    assert "317 Hz" in remainder_in_words(response.remainder)
