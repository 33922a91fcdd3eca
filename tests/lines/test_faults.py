"""Faults of a sweep are named by kind and size, sound sweeps are left alone: closed-form lines."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.lines import faults
from fitting.lines.faults import Fault, SweepFault, sweep_faults
from fitting.text.arrays import FloatArray

ETA_HZ, WIDTH_HZ, NOISE = 6.94e6, 94.0, 0.004
FREQUENCY_HZ = ETA_HZ + np.linspace(-300.0, 300.0, 121)


def line(frequency_hz: FloatArray = FREQUENCY_HZ, eta_hz: float = ETA_HZ) -> np.ndarray:
    """One damped driven mode, 1 at resonance, straight from its equation of motion."""
    return np.asarray(
        1j * WIDTH_HZ * eta_hz / (eta_hz**2 - frequency_hz**2 + 1j * WIDTH_HZ * frequency_hz)
    )


def noise(seed: int) -> FloatArray:
    return NOISE * np.random.default_rng(seed).standard_normal(FREQUENCY_HZ.size)


def only(found: tuple[SweepFault, ...], fault: Fault) -> SweepFault:
    assert [each.fault for each in found] == [fault]
    return found[0]


NIGHTLY = pytest.mark.nightly


@pytest.fixture
def one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether two lines fit as well is not asked: it costs most of the time where none is seen."""
    monkeypatch.setattr(faults, "two_lines_p", lambda *_: 1.0)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=NIGHTLY) for k in range(1, 6))])
def test_nothing_is_said_of_sound_sweeps(seed: int) -> None:
    assert sweep_faults(FREQUENCY_HZ, 3e-5 * (np.abs(line()) + noise(seed))) == ()


@pytest.mark.usefixtures("one_line")
@pytest.mark.parametrize("power", [2.0, pytest.param(0.5, marks=NIGHTLY)])
def test_decibels_of_the_wrong_kind_show_as_a_power(power: float) -> None:
    found = only(sweep_faults(FREQUENCY_HZ, np.abs(line()) ** power + noise(1)), Fault.POWER)
    assert abs(found.size - power) < 4.0 * found.std < 0.1
    assert found.width_hz[1] == pytest.approx(WIDTH_HZ, rel=0.03)
    assert abs(found.width_hz[0] / WIDTH_HZ - 1.0) > 0.2  # what is reported without a warning


@pytest.mark.usefixtures("one_line")
@pytest.mark.parametrize("seeds", [6, pytest.param(24, marks=NIGHTLY)])
def test_squares_of_noisy_amplitudes_are_named_though_their_noise_grows_with_them(
    seeds: int,
) -> None:
    """d(a^2) = 2 a da: large at the top, nothing in the tails, few points across the line."""
    f = ETA_HZ + WIDTH_HZ * np.sinh(np.linspace(-2.5, 2.5, 37))
    named = 0
    for seed in range(seeds):
        scatter = 0.005 * np.random.default_rng(seed).standard_normal(f.size)
        found = sweep_faults(f, np.abs(np.abs(line(f)) + scatter) ** 2)
        named += Fault.POWER in {each.fault for each in found}
    assert named >= seeds - max(1, seeds // 12)


@pytest.mark.usefixtures("one_line")
@pytest.mark.parametrize("missing", [0.4, pytest.param(0.25, marks=NIGHTLY)])
def test_a_detector_that_saturates_is_named(missing: float) -> None:
    """Soft or with a limit; its law, and so size and width, need not be told by the points."""
    bent = np.abs(line()) * (1.0 - missing * np.abs(line()) ** 2)
    for measured in (bent, np.tanh(8.0 * missing * np.abs(line()))):
        found = only(sweep_faults(FREQUENCY_HZ, measured + noise(2)), Fault.SATURATION)
        assert found.width_hz[1] < found.width_hz[0]
        assert found.width_hz[0] > 1.15 * WIDTH_HZ  # what is reported without a warning


def test_one_bad_point_is_named_with_its_place_and_is_no_second_line() -> None:
    measured = np.abs(line()) + noise(3)
    measured[70] += 0.1
    found = only(sweep_faults(FREQUENCY_HZ, measured), Fault.OUTLIER)
    assert not found.two_lines
    assert found.frequency_hz == FREQUENCY_HZ[70]
    assert found.size == pytest.approx(0.1, abs=4.0 * NOISE)
    assert found.std == pytest.approx(NOISE, rel=0.3)


@pytest.mark.usefixtures("one_line")
def test_a_background_is_named_with_its_size() -> None:
    found = only(sweep_faults(FREQUENCY_HZ, np.abs(line() + 0.06j) + noise(4)), Fault.BACKGROUND)
    assert found.width_hz[1] == pytest.approx(WIDTH_HZ, rel=0.05)


def test_a_clipped_top_is_named_with_what_is_missing() -> None:
    found = only(
        sweep_faults(FREQUENCY_HZ, np.minimum(np.abs(line()) + noise(5), 0.8)), Fault.CLIPPING
    )
    assert abs(found.size - 0.2) < 5.0 * found.std + 0.01 < 0.06
    assert found.width_hz[1] == pytest.approx(WIDTH_HZ, rel=0.05)


def test_of_two_lines_nothing_is_said() -> None:
    """No model of one line leaves noise: what is wrong is not known."""
    two = np.abs(line() + 0.7 * line(eta_hz=ETA_HZ + 150.0))
    assert sweep_faults(FREQUENCY_HZ, two + noise(6)) == ()


def test_points_that_hang_together_are_no_fault() -> None:
    white = np.random.default_rng(7).standard_normal(FREQUENCY_HZ.size + 4)
    wavy = NOISE * np.convolve(white, np.ones(5) / np.sqrt(5.0), "valid")
    assert sweep_faults(FREQUENCY_HZ, np.abs(line()) + wavy) == ()


@pytest.mark.parametrize("amplitude", [np.zeros(121), np.ones(121), np.abs(line())])
def test_flat_and_exact_sweeps_have_no_fault(amplitude: FloatArray) -> None:
    found = sweep_faults(FREQUENCY_HZ, amplitude)
    assert not [each for each in found if each.fault is not Fault.CLIPPING]


@pytest.mark.parametrize(
    ("height", "apart"),
    [
        (0.05j, 0.5),
        pytest.param(-0.1, 5.0, marks=NIGHTLY),
        pytest.param(-0.1j, 5.0, marks=NIGHTLY),
    ],
)
def test_two_lines_are_told_as_such_beside_what_they_look_like(
    height: complex, apart: float
) -> None:
    second = height * line(eta_hz=ETA_HZ + apart * WIDTH_HZ)
    found = sweep_faults(FREQUENCY_HZ, np.abs(line() + second) + noise(1))
    assert found
    assert all(each.two_lines for each in found)


@pytest.mark.parametrize(
    ("times", "apart", "height"),
    [
        (7.0, 1.0, 0.05j),
        pytest.param(5.0, 3.0, 0.05, marks=NIGHTLY),
        pytest.param(0.1, 0.0, -0.1j, marks=NIGHTLY),
    ],
)
def test_the_second_line_may_be_narrower_or_wider(
    times: float, apart: float, height: complex
) -> None:
    wide, beside, f = times * WIDTH_HZ, ETA_HZ + apart * WIDTH_HZ, FREQUENCY_HZ
    second = height * wide * beside / (beside**2 - f**2 + 1j * wide * f)
    found = sweep_faults(f, np.abs(line() + second) + noise(1))
    assert found
    assert all(each.two_lines for each in found)
