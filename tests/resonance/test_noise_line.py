"""A line in a noise spectrum against closed forms: density, power of the line, scatter."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.cli.main import main
from fitting.lines.noise_spectrum import averages_of
from fitting.text.arrays import FloatArray
from tests.support.lines import write_csv
from tests.support.samples import sampled

F0, WIDTH, HEIGHT, FLOOR = 10_000.0, 40.0, 1e-12, 2e-14
F = np.arange(9_700.0, 10_300.0, 3.0)


def density(f: FloatArray = F, f0: float = F0, width: float = WIDTH) -> FloatArray:
    """Of a mode in heat: HEIGHT (f0 w)^2/((f0^2 - f^2)^2 + (f w)^2)."""
    return HEIGHT * (f0 * width) ** 2 / ((f0**2 - f**2) ** 2 + (f * width) ** 2)


def averaged(s: FloatArray, averages: float, seed: int) -> FloatArray:
    """Means of so many periodograms: gamma deviates."""
    return s * np.random.default_rng(seed).gamma(averages, 1.0 / averages, s.size)


@sampled(5, 12)
@pytest.mark.parametrize("averages", [1, pytest.param(30, marks=pytest.mark.nightly)])
def test_frequency_width_quality_and_power_are_found_with_their_errors(
    averages: int, count: int
) -> None:
    """Pulls of about one; the power is the integral, pi/2 height width."""
    rms = math.sqrt(0.5 * math.pi * HEIGHT * WIDTH)
    pulls = []
    for seed in range(count):
        found = ff.noise_line(F, averaged(density() + FLOOR, averages, seed), unit="V")
        pulls.append(
            [
                (found.frequency.value - F0) / found.frequency.std,
                (found.width.value - WIDTH) / found.width.std,
                (found.q.value - F0 / WIDTH) / found.q.std,
                (found.rms.value - rms) / found.rms.std,
            ]
        )
        assert found.averages == pytest.approx(averages, rel=0.5)
        assert found.second is None
    assert np.max(np.abs(pulls)) < 4.0
    assert np.all(np.sqrt(np.mean(np.square(pulls), axis=0)) < 1.8)
    assert np.all(np.sqrt(np.mean(np.square(pulls), axis=0)) > 0.4)


def test_errors_are_those_that_the_information_allows() -> None:
    """Of M averages, M (dS/dx)(dS/dx)^T/S^2 summed over the points."""
    averages, h = 200, 1e-6
    s = density() + FLOOR
    found = ff.noise_line(F, averaged(s, averages, 3), unit="V")
    slopes = [
        (density(f0=F0 + h) - density(f0=F0 - h)) / (2.0 * h),
        (density(width=WIDTH + h) - density(width=WIDTH - h)) / (2.0 * h),
        density() / HEIGHT,
        np.ones(F.size),
    ]
    rows = np.stack(
        [slope * scale for slope, scale in zip(slopes, (1, 1, 1e-12, 1e-14), strict=True)]
    )
    information = averages * (rows / s) @ (rows / s).T
    bound = np.sqrt(np.diag(np.linalg.inv(information)))
    assert found.frequency.std == pytest.approx(bound[0], rel=0.15)
    assert found.width.std == pytest.approx(bound[1], rel=0.15)


@pytest.mark.parametrize("averages", [1, 2, 40])
def test_the_scatter_tells_how_many_were_averaged(averages: int) -> None:
    """Gamma deviates of known shape: 2 (x - 1 - ln x) has the mean 2 (ln M - psi(M))."""
    x = np.random.default_rng(8).gamma(averages, 1.0 / averages, 200_000)
    told = averages_of(float(np.sum(2.0 * (x - 1.0 - np.log(x)))), x.size)
    assert told == pytest.approx(averages, rel=0.02)


@pytest.mark.parametrize(
    ("head", "power"), [("f (Hz),PSD (V^2/Hz)", 1.0), ("f (Hz),ASD (V/rtHz)", 0.5)]
)
def test_a_file_whose_unit_is_a_density_is_one(
    head: str, power: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seen = averaged(density() + FLOOR, 50, 5)
    path = write_csv(tmp_path / "noise.csv", head, F, seen**power)
    assert main(["line", str(path), "--out", str(tmp_path / "o")]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert re.search(r"\b1[45] %", told)
    assert "rms " in told
    written = json.loads((tmp_path / "o" / "line.json").read_text("utf-8"))
    assert abs(written["frequency"]["value"] - F0) < 4.0 * written["frequency"]["std"]
    assert (tmp_path / "o" / "line.png").stat().st_size > 10_000
    # as a sweep of amplitudes, whose noise is found to grow with them, it has errors as large
    assert main(["line", str(path), "--kind", "sweep", "--out", str(tmp_path / "s")]) == 0
    sweep = json.loads((tmp_path / "s" / "line.json").read_text("utf-8"))
    assert 0.7 < sweep["width"]["std"] / written["width"]["std"] < 3.0


def test_two_lines_are_told() -> None:
    s = density() + 0.5 * density(f0=10_150.0, width=20.0) + FLOOR
    found = ff.noise_line(F, averaged(s, 50, 2), unit="V")
    assert found.second is not None
    assert abs(found.second.frequency.value - 10_150.0) < 4.0 * found.second.frequency.std
    assert abs(found.second.width.value - 20.0) < 4.0 * found.second.width.std
    assert re.search(r"second .* 101\d\d", " ".join(repr(found).split()))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        pytest.param(averaged(FLOOR + 0.0 * F, 20, 1), "no line", id="level"),
        pytest.param(density() * np.sign(F - F0 - 0.5), "above zero", id="signs"),
    ],
)
def test_what_is_no_line_is_refused(values: FloatArray, words: str) -> None:
    with pytest.raises(ff.BadInput, match=words):
        ff.noise_line(F, values)


def test_a_kind_is_asked_of_files_over_frequency_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_csv(tmp_path / "sweep.csv", "f (Hz),A (V)", F, np.sqrt(density()))
    assert main(["line", str(path), "--kind", "noise"]) != 0
    assert "noise spectrum" in capsys.readouterr().err
    t = np.linspace(0.0, 1.0, 100)
    path = write_csv(tmp_path / "ring.csv", "t (s),A (V)", t, np.exp(-t))
    assert main(["line", str(path), "--kind", "noise"]) != 0
    assert "--kind: " in capsys.readouterr().err
