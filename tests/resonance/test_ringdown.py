"""One resonance of a ringdown: against closed forms, known noise, and an integrated oscillator."""

from __future__ import annotations

import csv
import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fitting as ff
from fitting.cli.main import main
from fitting.text.arrays import ComplexArray, FloatArray
from tests.support.samples import sampled

RINGS, WIDTH = 812.3, 6.0
T = np.arange(1500) / 4000.0


def decay(
    f_hz: float, width_hz: float = WIDTH, size: float = 1.0, turn: float = 0.7
) -> ComplexArray:
    """An analytic signal that falls to 1/e in 1/(pi width), on ``T``."""
    return np.asarray(size * np.exp(-np.pi * width_hz * T + 2j * np.pi * f_hz * T + 1j * turn))


def noise(sigma: float, seed: int, slow: float = 0.0) -> FloatArray:
    """White noise, or noise that follows itself by a share from sample to sample."""
    white = np.random.default_rng(seed).normal(0.0, sigma, T.size + 300)
    made = white.copy()
    for k in range(1, made.size if slow else 0):
        made[k] = slow * made[k - 1] + math.sqrt(1.0 - slow**2) * white[k]
    return np.asarray(made[300:])


def both(sigma: float, seed: int, slow: float = 0.0) -> ComplexArray:
    return np.asarray(noise(sigma, seed, slow) + 1j * noise(sigma, seed + 1000, slow))


def write(path: Path, **columns: FloatArray) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([name.replace("__", " (").replace("_in_", "/") + ")" for name in columns])
        writer.writerows(zip(*columns.values(), strict=True))
    return path


@sampled(5, 12)
@pytest.mark.parametrize("kind", ["samples", "phasors", "amplitudes"])
def test_errors_are_those_of_the_scatter(kind: str, count: int) -> None:
    """Pulls of 12 laboratories with known truth: a standard normal's mean square is 1 +- 0.41.

    Every second one has noise that hangs together; 200 and more of each kind, of all lengths and
    noises, had 60 to 76 % and 91 to 97 % of the truths inside.
    """
    pulls = []
    for seed in range(count):
        slow, sigma = 0.7 * (seed % 2), (0.02, 0.1)[seed % 4 // 2]
        if kind == "samples":
            found = ff.ringdown(T, decay(RINGS).real + 0.3 + noise(sigma, seed, slow))
            pulls.append((found.frequency.value - RINGS) / found.frequency.std)
        else:
            z = decay(-2.5) + both(sigma, seed, slow)
            values = z + (0.1 - 0.2j) if kind == "phasors" else np.abs(z)
            found = ff.ringdown(T, values)
            assert math.isnan(found.frequency.value)
            if kind == "phasors":
                assert found.offset is not None
                pulls.append((found.offset.value + 2.5) / found.offset.std)
        assert found.kind == kind
        pulls.append((found.width.value - WIDTH) / found.width.std)
        low, high = found.decay_time.ci95
        assert low < found.decay_time.value < high
        assert found.decay_time.value == pytest.approx(1.0 / (math.pi * found.width.value))
    assert 0.2 < float(np.mean(np.array(pulls) ** 2)) < 2.6


def test_noise_that_hangs_together_widens_the_errors() -> None:
    errors = [ff.ringdown(T, decay(-2.5) + both(0.05, 3, slow)).width.std for slow in (0.0, 0.9)]
    # by the factor that its spectrum has at rest: (1 + 0.9)/(1 - 0.9), squared
    assert errors[1] / errors[0] == pytest.approx(math.sqrt(19.0), rel=0.35)
    assert not ff.ringdown(T, decay(-2.5) + both(0.05, 3, 0.9)).is_noise


def test_a_low_quality_rings_below_its_eigenfrequency() -> None:
    """Damped by a third of its frequency: f^2 = f0^2 - (w/2)^2, and both are printed."""
    f, width = 30.0, 10.0
    ringing = math.sqrt(f**2 - 0.25 * width**2)
    found = ff.ringdown(T, decay(ringing, width).real + noise(1e-3, 1))
    assert found.frequency.value == pytest.approx(ringing, abs=4.0 * found.frequency.std)
    assert found.eigenfrequency.value == pytest.approx(f, abs=4.0 * found.eigenfrequency.std)
    assert abs(ringing - f) > 20.0 * found.frequency.std
    assert re.search(r"^f0 +29\.99|^f0 +30\.0", repr(found), re.MULTILINE)
    assert found.q.value == pytest.approx(3.0, rel=1e-2)


def test_the_frequency_of_small_amplitudes_is_told_of_a_duffing_oscillator() -> None:
    """x'' + 2 pi w x' + (2 pi f)^2 x + a x^3 = 0, integrated; a moves f by 3 a x^2/(32 pi^2 f)."""
    f, width, moved = 100.0, 0.8, 2.0
    t = np.arange(4000) / 2000.0
    stiffer = moved * 32.0 * np.pi**2 * f / 3.0
    spring = (2.0 * np.pi * f) ** 2
    moving = solve_ivp(
        lambda _, y: [y[1], -2.0 * np.pi * width * y[1] - spring * y[0] - stiffer * y[0] ** 3],
        (0.0, float(t[-1])),
        [1.0, 0.0],
        t_eval=t,
        rtol=1e-9,
        atol=1e-11,
    )
    found = ff.ringdown(t, moving.y[0] + np.random.default_rng(5).normal(0.0, 0.02, t.size))
    assert found.form == "moving"
    assert found.frequency.value == pytest.approx(f, abs=0.01)
    assert found.width.value == pytest.approx(width, abs=4.0 * found.width.std)
    left = math.exp(-2.0 * np.pi * width * found.begin_s)
    assert found.shift.value == pytest.approx(moved * left, rel=0.05)
    assert f"{found.shift.value:.3f}" in repr(found)


def test_two_lines_that_beat_are_both_told() -> None:
    y = decay(RINGS).real + decay(RINGS + 9.0, 4.0, 0.5).real + noise(0.02, 7)
    found = ff.ringdown(T, y)
    assert found.form == "second"
    assert found.second is not None
    assert found.left_out < 10
    assert found.frequency.value == pytest.approx(RINGS, abs=5.0 * found.frequency.std)
    assert found.second.frequency.value == pytest.approx(
        RINGS + 9.0, abs=5.0 * found.second.frequency.std
    )
    assert found.second.width.value == pytest.approx(4.0, abs=5.0 * found.second.width.std)
    assert f"{found.second.frequency.value:.1f}" in repr(found)


def test_hum_is_a_tone_that_does_not_decay() -> None:
    y = 0.6 * decay(RINGS).real + np.cos(2.0 * np.pi * 50.0 * T) + noise(0.02, 8)
    found = ff.ringdown(T, y)
    assert found.frequency.value == pytest.approx(RINGS, abs=0.1)
    assert found.second is not None
    assert not found.second.decays
    assert found.second.frequency.value == pytest.approx(50.0, abs=0.05)
    assert "not decay" in repr(found)


def test_what_a_drive_holds_is_left_out() -> None:
    held = 300
    z = np.concatenate([np.full(held, decay(0.0)[0]), decay(3.0)[: T.size - held]])
    for values in (z + both(0.02, 9), np.abs(z + both(0.1, 9))):
        found = ff.ringdown(T, values)
        assert held - 2 <= found.left_out < held + 60
        assert found.width.value == pytest.approx(WIDTH, abs=4.0 * found.width.std)


def test_amplitudes_do_not_fall_below_their_noise_nor_a_detector_below_its_zero() -> None:
    """In the noise |z| is 1.25 of it: an exponential alone would be too wide by many errors."""
    noisy = ff.ringdown(T, np.abs(decay(0.0, 15.0) + both(0.1, 11)))
    assert noisy.form in ("noise", "constant")
    assert noisy.width.value == pytest.approx(15.0, abs=4.0 * noisy.width.std)
    zero = ff.ringdown(T, 0.4 + np.abs(decay(0.0)) + noise(0.02, 12))
    assert (zero.kind, zero.form) == ("amplitudes", "constant")
    assert zero.background == pytest.approx(0.4, abs=4.0 * zero.background_std)
    assert zero.width.value == pytest.approx(WIDTH, abs=4.0 * zero.width.std)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (noise(1.0, 1), "free decay"),
        (both(1.0, 2), "free decay"),
        (np.zeros(T.size), "zeros"),
        (np.cos(5000.0 * T) + noise(0.1, 3), r"\bfalls?\b"),
    ],
    ids=["noise", "noise of a lock-in", "zeros", "a tone"],
)
def test_what_does_not_decay_is_refused(values: FloatArray, words: str) -> None:
    with pytest.raises(ff.BadInput, match=words):
        ff.ringdown(T, values)


def test_the_command_tells_what_the_file_tells(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Samples have a frequency, X and Y an offset, and a frequency where the reference is told."""
    z = 1e-3 * decay(-2.5) + both(2e-5, 4)
    raw = write(tmp_path / "raw.csv", t__ms=1e3 * T, u__V=decay(RINGS).real + noise(0.05, 4))
    locked = write(tmp_path / "xy.csv", time__s=T, X__mV=1e3 * z.real, Y__mV=1e3 * z.imag)
    told = write(
        tmp_path / "told.csv",
        time__s=T,
        R__V=np.abs(z),
        theta__deg=np.rad2deg(np.angle(z)),
        frequency__MHz=np.full(T.size, 1.2),
    )
    assert main(["line", str(raw), "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert re.search(r"^f      812\.[23]\d+ ± 0\.\d+ Hz$", said, re.MULTILINE)
    assert "samples" in said
    assert "1/e" in said
    record: dict[str, Any] = json.loads((tmp_path / "out" / "line.json").read_text())
    assert record["decay_time"]["value"] == pytest.approx(1.0 / (math.pi * WIDTH), rel=0.1)
    rows = list(csv.reader((tmp_path / "out" / "line.csv").read_text().splitlines()))
    assert rows[0] == ["time (s)", "measured (V)", "fitted (V)"]
    assert len(rows) == 1 + len(record["points"]["time_s"])
    assert (tmp_path / "out" / "line.png").stat().st_size > 10_000

    assert main(["line", str(locked)]) == 0
    said = capsys.readouterr().out
    assert "offset -2.5" in said.replace("−", "-")
    assert "\nQ " not in said
    assert "--demodulated-at" in said
    assert main(["line", str(locked), "--demodulated-at", "1.2 MHz"]) == 0
    with_option = capsys.readouterr().out
    assert main(["line", str(told)]) == 0
    by_column = capsys.readouterr().out
    for said in (with_option, by_column):
        assert re.search(r"^f      1199997\.[45]\d+ ± 0\.\d+ Hz$", said, re.MULTILINE)
        assert "\nQ      " in said
    assert re.search(r"1\.2 MHz, .*'frequency'", by_column)


def test_levels_and_amplitudes_are_one_decay(tmp_path: Path) -> None:
    size = np.abs(decay(0.0) + both(0.02, 5))
    files = [
        write(tmp_path / "r.csv", time__s=T, R__V=size),
        write(tmp_path / "db.csv", time__s=T, level__dBm=20.0 * np.log10(size)),
        write(tmp_path / "power.csv", time__s=T, trace__W=size**2),
    ]
    found = [ff.ringdown(path) for path in files]
    assert {each.kind for each in found} == {"amplitudes"}
    widths = [each.width.value for each in found]
    assert widths == pytest.approx(widths[:1] * 3, rel=1e-6)


def test_one_sample_before_the_decay_is_told_as_one() -> None:
    """It was "those before may belong to a drive"."""
    found = ff.ringdown(T, decay(RINGS).real + noise(0.05, 6))
    one, two = (" ".join(repr(replace(found, left_out=n)).split()) for n in (1, 2))
    assert "sample 2 on" in one
    assert "first" in one
    assert "sample 3 on" in two
    assert "first" not in two


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["raw.csv", "--wiring", "fano"], "--wiring: "),
        (["sweep.csv", "--demodulated-at", "1 MHz"], "--demodulated-at: "),
        (["raw.csv", "--demodulated-at", "1 MHz"], "X and Y"),
        (["bare.txt"], '--time "column 1" --unit-time s'),
        (["bare.txt", "--time", "column 1"], "--unit-time"),
        (["raw.csv", "--from", "300 s"], "0 samples"),
        (["raw.csv", "--to", "1e-9 s"], "1 sample "),
        (["gap.csv"], "row 12: "),
    ],
)
def test_bad_input_is_told_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], words: str
) -> None:
    y = decay(RINGS).real + noise(0.05, 6)
    write(tmp_path / "raw.csv", time__s=T, u__V=y)
    write(tmp_path / "gap.csv", time__s=np.delete(T, 10), u__V=np.delete(y, 10))
    write(tmp_path / "sweep.csv", frequency__Hz=1.0 + T, amplitude__V=np.abs(y))
    np.savetxt(tmp_path / "bare.txt", np.column_stack([T, y]))
    assert main(["line", str(tmp_path / options[0]), *options[1:]]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert words in said


def test_a_file_without_names_is_read_as_it_is_told(tmp_path: Path) -> None:
    y = decay(RINGS).real + noise(0.05, 6)
    np.savetxt(tmp_path / "bare.txt", np.column_stack([1e3 * T, y]))
    columns = ff.Columns(time="column 1", unit_time="ms", unit_amplitude="V")
    found = ff.ringdown(tmp_path / "bare.txt", columns=columns, within_s=(0.01, None))
    assert found.frequency.value == pytest.approx(RINGS, abs=5.0 * found.frequency.std)
    assert found.unit == "V"
    assert found.begin_s >= 0.01


def test_a_channel_that_was_open_is_not_the_recording(tmp_path: Path) -> None:
    values = decay(RINGS).real + noise(0.05, 6)
    path = write(tmp_path / "two.csv", time__s=T, Voltage__V=0.0 * T, Acceleration__g=values)
    found = ff.ringdown(path)
    assert found.unit == "g"
    assert found.frequency.value == pytest.approx(RINGS, abs=5.0 * found.frequency.std)
