"""Demodulated ringdowns become campaigns that find what was put into them."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.cli.main import main
from fitting.draft.api import Question, init
from fitting.result.result import Result, read_result
from fitting.text.arrays import ComplexArray
from tests.support.cfmu_build import build_lag_fmu
from tests.support.lines import write_csv

pytestmark = pytest.mark.usefixtures("swift_models")

REFERENCE = 1.2e6
T = np.arange(600) / 2000.0
ONE = ((REFERENCE + 31.0, 4.0, 1.0),)
TWO = ((REFERENCE - 55.0, 7.0, 0.6), *ONE)


def phasors(lines: tuple[tuple[float, float, float], ...], constant: float = 0.0) -> ComplexArray:
    """Sum of a exp(-pi w t) exp(2 pi i (f_r - reference) t), f_r^2 = f^2 - w^2/4, in noise."""
    rng = np.random.default_rng(3)
    z = constant + 0.005 * (rng.standard_normal(T.size) + 1j * rng.standard_normal(T.size))
    for f, width, size in lines:
        rings = np.sqrt(f**2 - 0.25 * width**2) - REFERENCE
        z = z + size * np.exp((-np.pi * width + 2j * np.pi * rings) * T + 0.4j)
    return np.asarray(z)


def fitted(campaign: Path) -> Result:
    out = campaign.parent / "results"
    words = [
        "reconstruct",
        str(campaign),
        "--out",
        str(out),
        "--no-profiles",
        "--workers",
        "1",
        "--quick",
    ]
    assert main([*words, "--no-report"]) == 0
    return read_result(out / "result.json")


@pytest.mark.parametrize(
    "lines", [ONE, pytest.param(TWO, marks=pytest.mark.nightly)], ids=["one line", "two lines"]
)
def test_x_and_y_over_time_find_frequency_and_width(
    lines: tuple[tuple[float, float, float], ...], tmp_path: Path
) -> None:
    z = phasors(lines, constant=0.1)
    path = write_csv(tmp_path / "ring.csv", "time (ms),X (mV),Y (mV)", 1e3 * T, z.real, z.imag)
    words = [str(path), "--demodulated-at", "1.2 MHz", "--out", str(tmp_path), "--yes"]
    assert main(["init", *words]) == 0
    written = tomllib.loads((tmp_path / "campaign.toml").read_text("utf-8"))
    assert written["fmu"]["model"] == f"CoupledModes{len(lines)}"
    [trace] = written["demodulated_trace"]
    assert trace["offset"] is True
    assert trace.get("modes", 1) == len(lines)
    found = fitted(tmp_path / "campaign.toml")
    for k, (f, width, _) in enumerate(lines, start=1):
        place, wide = found.parameters[f"f{k}"], found.parameters[f"d{k}"]
        assert abs(place.value - f) < 4.0 * place.std < 0.2
        assert abs(wide.value - width) < 4.0 * wide.std < 0.3
        q = found.derived[f"Q{k}"]
        assert abs(q.value - f / width) < 4.0 * q.std


def test_amplitudes_over_time_find_the_width(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "ring.csv", "time (s),R (mV)", T, np.abs(phasors(ONE)))
    made, said = init(path, out=tmp_path, told={"demodulated-at": "1.2e6"})
    assert any("1.2 MHz" in each for each in said)
    written = tomllib.loads(made.read_text("utf-8"))
    assert written["fmu"]["start"]["f1"] == REFERENCE
    assert [p["name"] for p in written["parameters"]] == ["d1"]
    width = fitted(made).parameters["d1"]
    assert abs(width.value - 4.0) < 4.0 * width.std < 0.2


def test_a_column_that_does_not_move_tells_what_was_demodulated_at(tmp_path: Path) -> None:
    z = phasors(ONE)
    head = "time (s),X (V),Y (V),demodulated at (kHz)"
    path = write_csv(tmp_path / "ring.csv", head, T, z.real, z.imag, 1200.0 + 0.0 * T)
    made, _ = init(path, out=tmp_path)
    [trace] = tomllib.loads(made.read_text("utf-8"))["demodulated_trace"]
    assert trace["frequency"] == "1200000.0 Hz"


def test_what_it_was_demodulated_at_is_asked_or_wanted(tmp_path: Path) -> None:
    z = phasors(ONE)
    path = write_csv(tmp_path / "ring.csv", "time (s),X (V),Y (V)", T, z.real, z.imag)
    with pytest.raises(ff.BadInput, match=r"ring\.csv"):
        init(path, out=tmp_path / "a")
    with pytest.raises(ff.BadInput, match=r"^--demodulated-at: .*V"):
        init(path, out=tmp_path / "b", told={"demodulated-at": "2 V"})
    asked = []

    def ask(question: Question) -> list[str] | None:
        asked.append(question.key)
        return ["1.2", "MHz"] if question.key == "demodulated-at" else None

    made, _ = init(path, out=tmp_path / "c", ask=ask)
    [trace] = tomllib.loads(made.read_text("utf-8"))["demodulated_trace"]
    assert trace["frequency"] == "1200000.0 Hz"
    assert "demodulated-at" in asked


def test_an_fmu_without_a_line_does_not_take_it(tmp_path: Path) -> None:
    z = phasors(ONE)
    path = write_csv(tmp_path / "ring.csv", "time (s),X (V),Y (V)", T, z.real, z.imag)
    lag = build_lag_fmu(tmp_path)
    with pytest.raises(ff.BadInput, match="1 line"):
        init(path, lag, out=tmp_path / "o", told={"demodulated-at": "1.2 MHz"})


def test_swings_that_are_called_amplitude_are_samples(tmp_path: Path) -> None:
    t = np.arange(2000) / 8000.0
    y = np.exp(-20.0 * t) * np.cos(2.0 * np.pi * 1234.5 * t)
    path = write_csv(tmp_path / "ring.csv", "t (s),amplitude (nm)", t, y)
    made, _ = init(path, out=tmp_path)
    assert "trace" in tomllib.loads(made.read_text("utf-8"))
