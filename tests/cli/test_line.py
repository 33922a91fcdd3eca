"""The range of `fmu-fit line`: numbers without a unit are hertz, or seconds, where that may be."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from fitting.cli.main import main


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A line of 100 kHz of Q 20 in kHz, and one that rings down over 10 ms in ms."""
    monkeypatch.chdir(tmp_path)
    f = np.linspace(60.0, 140.0, 161)
    r = 1.0 / np.abs(1.0 - (f / 100.0) ** 2 + 1j * f / 100.0 / 20.0)
    r += 1e-3 * np.random.default_rng(1).standard_normal(f.size)
    pairs = "".join(f"{a:.9g},{b:.9g}\n" for a, b in zip(f, r, strict=True))
    (tmp_path / "sweep.csv").write_text("f (kHz),R (mV)\n" + pairs)
    t = np.arange(1000) * 0.01
    y = np.exp(-0.3 * t) * np.cos(2.0 * np.pi * 5.0 * t)
    y += 1e-3 * np.random.default_rng(2).standard_normal(t.size)
    pairs = "".join(f"{a:.9g},{b:.9g}\n" for a, b in zip(t, y, strict=True))
    (tmp_path / "ring.csv").write_text("t (ms),u (V)\n" + pairs)
    return tmp_path


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (
            ["sweep.csv", "--from", "80", "--to", "120"],
            [
                "--from 80: 80 Hz lies below sweep.csv, 60 to 140 kHz; wanted a unit, as 80kHz",
                "--to 120: 120 Hz lies below sweep.csv, 60 to 140 kHz; wanted a unit, as 120kHz",
            ],
        ),
        (
            ["sweep.csv", "--from", "80kHz", "--to", "0.12"],
            ["--to 0.12: 0.12 Hz lies below sweep.csv, 60 to 140 kHz; wanted a unit, as 0.12MHz"],
        ),
        (
            ["ring.csv", "--to", "5"],
            ["--to 5: 5 s lies behind ring.csv, 0 to 9.99 ms; wanted a unit, as 5ms"],
        ),
    ],
    ids=["both", "one", "time"],
)
def test_a_number_without_a_unit_that_lies_outside_is_asked_about(
    words: list[str], told: list[str], here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["line", *words]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition("fmu-fit: ")[2] for line in lines] == told


@pytest.mark.parametrize(
    ("words", "points"),
    [
        (["sweep.csv", "--from", "80000", "--to", "120000"], 81),
        (["sweep.csv", "--from", "80kHz", "--to", "0.12 MHz"], 81),
        (["sweep.csv", "--from", "80 Hz"], 161),  # said, so meant
        (["sweep.csv", "--from", "1"], 161),  # in the file with no prefix
        (["ring.csv", "--to", "0.005"], 501),
    ],
    ids=["hertz", "units", "said", "low", "seconds"],
)
def test_a_range_that_is_understood_is_taken(
    words: list[str], points: int, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["line", *words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    axis = "frequency_hz" if "sweep.csv" in words else "time_s"
    assert len(found["points"][axis]) == points
