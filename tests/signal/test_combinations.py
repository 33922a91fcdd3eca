"""Lines at combinations of the drive tones: how they are written, and how they are kept apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fitting.campaign import read_campaign
from fitting.campaign.file import read_campaign_file
from fitting.signal.combinations import (
    combination_name,
    lines_to_read,
    mixed_hz,
    mixed_lines,
    parse_combination,
)
from fitting.signal.window import plan_window, tone_misfit
from fitting.text.errors import BadInput

TONES = ("u1", "u2")


@pytest.mark.parametrize(
    ("text", "factors"),
    [
        ("u1", (1, 0)),
        ("2*u1 - u2", (2, -1)),
        ("2u2-u1", (-1, 2)),
        ("-u1 + 2 u2", (-1, 2)),
        ("u1 + u1", (2, 0)),
        ("3 * u1-2*u2", (3, -2)),
    ],
)
def test_a_combination_is_read_as_written(text: str, factors: tuple[int, int]) -> None:
    found = parse_combination(text, TONES, "here")
    assert found.factors == factors
    assert found.order == sum(map(abs, factors))


@pytest.mark.parametrize("text", ["", "2", "u1 u2", "u1*u2", "2.5*u1", "u1 - u1", "u3", "u1 +"])
def test_what_is_no_combination_is_refused(text: str) -> None:
    with pytest.raises(BadInput, match="here: "):
        parse_combination(text, TONES, "here")


def test_its_frequency_is_rounded_once() -> None:
    line = parse_combination("2*u1 - u2", TONES, "here")
    assert line.frequency_hz((6940.1, 6940.3)) == 6939.9  # in doubles 6939.900000000001
    assert 2 * 6940.1 - 6940.3 != 6939.9


def test_names_of_combinations() -> None:
    assert combination_name((2, -1), TONES) == "2 u1 - u2"
    assert combination_name((-1, 2), TONES) == "2 u2 - u1"
    assert combination_name((1, 0), TONES) == "u1"


def test_order_is_one_for_the_tones_and_covers_what_is_read() -> None:
    assert lines_to_read(TONES, None, TONES, "here")[1] == 1
    assert lines_to_read(["2*u1-u2"], None, TONES, "here")[1] == 9
    assert lines_to_read(["6*u1-5*u2"], None, TONES, "here")[1] == 11
    with pytest.raises(BadInput, match="order = 2"):
        lines_to_read(["2*u1-u2"], 2, TONES, "here")
    with pytest.raises(BadInput, match="different lines"):
        lines_to_read(["u1", "1*u1"], None, TONES, "here")


def test_there_are_as_many_mixed_lines_as_a_diamond_has_points() -> None:
    """Points of |k1| + |k2| <= n: 2 n (n + 1) + 1; without zero, and one of each pair."""
    for order in (1, 3, 9):
        assert len(mixed_lines(2, order)) == order * (order + 1)


def test_a_window_reads_tones_of_a_response_full_of_lines_exactly() -> None:
    """A cubic of two tones has harmonics and mixtures up to order 9 in its third power."""
    tones = (6940240.0, 6940280.0)
    read = (*tones, 6940200.0, 6940320.0)
    window = plan_window(read, 0.0, mixtures_hz=mixed_hz(tones, 9))
    assert window.samples < 400

    def response(t: np.ndarray) -> np.ndarray:
        x = sum(
            a * np.cos(2 * np.pi * np.mod(f * t, 1.0) + p)
            for a, f, p in ((1.0, tones[0], 0.3), (0.7, tones[1], -1.0))
        )
        return np.asarray(x + 0.1 * x**3 + 0.01 * x**9 + 0.02 * x**2)

    # the truth from a slow copy of the tones, sampled as finely as its highest line asks for
    count = 4096
    slow = np.arange(count) / count
    x = np.cos(2 * np.pi * 101 * slow + 0.3) + 0.7 * np.cos(2 * np.pi * 103 * slow - 1.0)
    lines = 2.0 / count * np.abs(np.fft.rfft(x + 0.1 * x**3 + 0.01 * x**9 + 0.02 * x**2))
    samples = response(window.times_s())
    assert window.read(samples).amplitudes == pytest.approx(lines[[101, 103, 99, 105]], rel=1e-6)
    assert tone_misfit(window, samples) < 1e-6
    naive = plan_window(read, 0.0)
    wrong = naive.read(response(naive.times_s())).amplitudes
    assert np.abs(wrong / lines[[101, 103, 99, 105]] - 1.0).max() > 0.01  # it does matter


def test_mixtures_need_a_common_period() -> None:
    tones = (1000.0, 1000.0 * 2**0.5)
    with pytest.raises(BadInput, match="common period"):
        plan_window(tones, 0.0, mixtures_hz=mixed_hz(tones, 9))


CAMPAIGN = """\
title = "mixtures"
[fmu]
model = "DuffingOscillator"
[observe]
output = "q1_hybrid"
steady_start = true
[drive]
kind = "tones"
frequencies = ["u1", "u2"]
amplitudes = ["A1", "A2"]
read = ["u1", "2*u1 - u2"]
[experiments]
file = "experiments.csv"
peaks = ["p", "q"]
amplitude = "m peak"
[[parameters]]
name = "alpha1"
lower = 0
upper = 2e32
start = 1e32
"""


def test_a_campaign_reads_its_lines(tmp_path: Path) -> None:
    path = tmp_path / "campaign.toml"
    path.write_text(CAMPAIGN)
    table = "experiment,u1 (Hz),u2 (Hz),p (pm),q (pm)\n"
    (tmp_path / "experiments.csv").write_text(table + "a,1000.1,1000.3,3,1\n")
    (experiment,) = read_campaign(path).experiments
    assert experiment.tones_hz == (1000.1, 1000.3)
    assert experiment.lines_hz == (1000.1, 999.9)
    assert read_campaign_file(path).driven.lines_and_order[1] == 9
    (tmp_path / "experiments.csv").write_text(table + "a,1000,2000,3,1\n")
    with pytest.raises(BadInput, match=r"row 2: 2\*u1 - u2"):
        read_campaign(path)
