"""What a drive asks of an FMU: windows that see each line alone, and runs of whole held steps."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from fitting.fmu.runs import InputSignal, row_times
from fitting.simulate.drive import Approach, Drive
from fitting.text.errors import BadInput

TONES = (1000.0, 1010.0)
DRIVE = Drive(start_values={"a": 1.0}, tones_hz=TONES, outputs=("x", "y"))


def test_names_and_lines() -> None:
    assert DRIVE.names == ("f1", "f2")
    assert replace(DRIVE, tone_names=("u", "v")).names == ("u", "v")
    assert DRIVE.lines_hz == TONES
    read = replace(DRIVE, read_hz=(990.0, 1000.0))
    assert read.lines_hz == (990.0, 1000.0)
    assert (DRIVE.fastest_hz, read.fastest_hz) == (1010.0, 1000.0)


@pytest.mark.parametrize("order", [1, 3, 9])
@pytest.mark.parametrize("highest", [1, 5])
def test_no_combination_is_seen_where_a_line_is_read(order: int, highest: int) -> None:
    """All of them, sampled: a line's phasor is nothing but its own."""
    drive = replace(DRIVE, highest_order=highest, read_hz=(*TONES, 990.0))
    window = drive.window(0.5, order)
    assert window.coherent
    t = np.array(window.times_s())
    most = max(order, highest)
    for k in itertools.product(range(-most, most + 1), repeat=2):
        f = abs(k[0] * TONES[0] + k[1] * TONES[1])
        if 1 <= sum(map(abs, k)) <= most and f not in drive.lines_hz:
            wave = np.asarray(np.cos(2 * np.pi * np.mod(f * t, 1.0) + 0.3))
            assert np.max(drive.fit(window)(wave).amplitudes) < 1e-6


def test_tones_without_a_common_period_are_told_apart_by_their_samples() -> None:
    tones = (1000.0, 1000.0 + 10.0 * 2.0**0.5)
    drive = replace(DRIVE, tones_hz=tones)
    plain, more = drive.window(0.1), drive.window(0.1, 9)
    assert not plain.coherent
    assert plain.condition < 3.0
    assert more.samples > plain.samples
    assert set(plain.expected_hz) < set(more.expected_hz)
    near = [f for f in more.expected_hz if abs(f - 2.0 * tones[0] + tones[1]) < 1e-9]
    assert len(near) == 1
    coherent = drive.window(0.1, 1, 1e-9)
    assert not coherent.coherent
    assert replace(DRIVE, tones_hz=(1000.0 * 2.0**0.5,)).window(0.1, 1, 1e-9).coherent
    assert not DRIVE.window(0.1, 1, 0.09).coherent
    assert DRIVE.window(0.1, 1, 0.1).coherent


def test_combinations_that_no_samples_resolve_are_refused_and_those_of_low_order_left_out() -> None:
    """Of tones far apart they come close to each other, and a fit without them is no finer one."""
    drive = replace(DRIVE, tones_hz=(37.7784172427, 40.239450557982))
    for order in (1, 11, 21):
        assert drive.window(0.1, order).expected_hz
    with pytest.raises(BadInput, match="no sampling distinguishes"):
        drive.window(0.1, 41)
    far = replace(DRIVE, tones_hz=(1.0, 3.0 + 1e-7 * 2.0**0.5))
    assert far.window(0.1, 1, 1.0).expected_hz == ()
    many = replace(DRIVE, tones_hz=tuple(1000.0 + 10.0 * k**0.5 for k in (0, 1, 2, 3, 5)))
    assert many.window(0.1).expected_hz == ()
    assert many.window(0.1).condition < 3.0


def test_a_run_has_the_settings_over_the_start_values_and_each_output_once() -> None:
    window = DRIVE.window(0.25)
    run = DRIVE.run(window, {"b": 2.0, "a": 3.0}, ("y", "e"))
    assert run.start_values == {"a": 3.0, "b": 2.0}
    assert run.outputs == ("x", "y", "e")
    assert (run.settle_s, run.samples) == (window.settle_s, window.samples)
    assert run.sample_step_s == window.step_s
    assert run.input_signal is None
    assert run.segments == ()
    assert DRIVE.start_values == {"a": 1.0}


def test_a_generated_drive_is_held_over_whole_steps() -> None:
    drive = replace(DRIVE, input="b", amplitude=0.5, steps_per_period=20)
    run = drive.run_at({}, 0.1234567, 1e-3, 7)
    signal = run.input_signal
    assert isinstance(signal, InputSignal)
    assert signal.name == "b"
    assert signal.tones == ((1000.0, 0.5, 0.0), (1010.0, 0.5, 0.0))
    # 20 steps in a period of the fastest tone at least, and whole ones in a sample's step
    assert 1.0 / (signal.step_s * 1010.0) >= 20.0
    assert 1.0 / (signal.step_s * 1010.0) < 21.0
    assert 1e-3 / signal.step_s == pytest.approx(round(1e-3 / signal.step_s))
    assert 0.1234567 <= run.settle_s < 0.1234567 + signal.step_s
    assert run.settle_s / signal.step_s == pytest.approx(round(run.settle_s / signal.step_s))
    assert DRIVE.run_at({}, 0.1234567, 1e-3, 7).settle_s == 0.1234567
    window = drive.window(0.1234567)
    assert drive.run(window, {}).settle_s >= 0.1234567
    assert 1.0 / (window.input_step_s * 1010.0) >= 20.0


def test_a_tone_that_is_moved_is_read_where_it_has_come_to() -> None:
    drive = Drive(
        start_values={"u": 1.0, "a": 2.0},
        tones_hz=(1000.0,),
        outputs=("x",),
        approach=Approach("u", 900.0, 1000.0),
    )
    window = drive.window(0.2)
    run = drive.run(window, {})
    assert (run.moved, run.start_values["u"]) == ("u", 900.0)
    [segment] = run.segments
    assert (segment.value, segment.settle_s) == (1000.0, window.settle_s)
    assert (segment.samples, segment.sample_step_s) == (window.samples, window.step_s)
    times = np.array(row_times(run))[-window.samples :]
    wave = np.asarray(3.0 * np.cos(2 * np.pi * np.mod(1000.0 * times, 1.0) - 0.4))
    assert drive.fit(window)(wave).phasors == pytest.approx([3.0 * np.exp(-0.4j)])
