"""What a plan looks at: lines, changes, windows and the count of work, all by hand."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.simulate.drive import Approach, Drive
from fitting.simulate.probe import Knowledge, Probe, Reading
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import FmuFailure
from tests.support.line_workers import LineWorkers, Output, line, together


def drive_of(*tones: float, outputs: tuple[str, ...] = ("x",)) -> Drive:
    return Drive(start_values={}, tones_hz=tones, outputs=outputs)


def by(**names: str) -> Knowledge:
    """An FMU that names its substep or its tolerance."""
    return Knowledge(AccuracyAnnotation(**names))  # type: ignore[arg-type]


def probe_of(*drives: Drive, **outputs: Output) -> Probe:
    return Probe(drives, LineWorkers(outputs))


def reading(*amplitudes: float, rest: float = 0.0, largest: float = 1.0) -> Reading:
    """One output with these complex amplitudes."""
    return Reading(
        tones=np.array(amplitudes, dtype=complex)[:, np.newaxis],
        mean=np.zeros(1),
        rest=np.array([rest]),
        largest=np.array([largest]),
        condition=2.0,
    )


def test_what_is_read_is_what_the_lines_are() -> None:
    output = together(line(100.0, 3.0, 0.4), line(130.0, 0.5, -1.0), lambda t, _: 0.0 * t + 2.0)
    probe = probe_of(drive_of(100.0, 130.0), x=output)
    [found] = probe.read({}, 0.25)
    wanted = np.array([[3.0 * np.exp(0.4j)], [0.5 * np.exp(-1.0j)]])
    assert found.tones == pytest.approx(wanted, rel=1e-9)
    assert found.mean == pytest.approx([2.0])
    assert found.rest == pytest.approx([0.0], abs=1e-12)
    assert found.constant == (False,)
    assert found.spread == pytest.approx(6.0)
    assert probe.fastest_hz == 130.0
    [again] = probe.read({}, 0.25)
    assert again is found  # answers are kept
    assert len(probe.workers.asked) == 1  # type: ignore[attr-defined]


def test_what_tones_leave_is_its_root_mean_square() -> None:
    """A harmonic that folds onto no tone: two lines of 0.1 and 0.2 leave sqrt(0.05/2)."""
    output = together(line(100.0, 3.0), line(300.0, 0.1), line(700.0, 0.2, 0.3))
    drive = replace(drive_of(100.0), highest_order=7)
    [found] = probe_of(drive, x=output).read({}, 0.0)
    samples = drive.window(0.0).samples
    times = np.asarray(np.arange(samples) * drive.window(0.0).step_s, dtype=np.float64)
    left = output(times, {}) - 3.0 * np.cos(2 * np.pi * 100.0 * times)
    left -= np.mean(left)
    assert abs(found.tones[0, 0]) == pytest.approx(3.0, rel=1e-9)
    assert found.rest[0] == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-6)
    assert found.largest[0] == pytest.approx(np.max(np.abs(output(times, {}))), rel=1e-12)


@pytest.mark.parametrize(("share", "constant"), [(1.2e-12, False), (0.8e-12, True)])
def test_an_oscillation_below_rounding_is_none(share: float, constant: bool) -> None:
    found = reading(share, 0.5 * share)
    assert found.constant == (constant,)
    assert bool(np.isnan(found.amplitudes[0, 0])) is constant
    assert np.isnan(found.amplitudes[1, 0])
    assert found.spread == 1.0


def test_rounding_of_a_weak_tone_beside_a_strong_value() -> None:
    eps = float(np.finfo(float).eps)
    assert reading(1.0, 1e-3).rounding == pytest.approx(32.0 * eps * 2.0 * 1.0 / 1e-3)
    assert reading(1.0, 1e-3).spread == pytest.approx(1000.0)
    assert reading(0.0).rounding == 0.0


def test_changes_are_relative_to_each_amplitude_or_to_the_largest() -> None:
    """A change counts its phase and what is left beside it; an error the amplitude alone."""
    before, after = reading(2.0, 0.1), reading(2.02, 0.105, rest=0.001)
    drive = drive_of(1.0, 2.0)
    each = Probe((drive,), LineWorkers({}))
    assert each.changes([after], [before]) == pytest.approx(0.006 / 0.105)
    assert each.errors([after], [before]) == pytest.approx(0.005 / 0.1)
    whole = Probe((drive,), LineWorkers({}), of_largest=True)
    assert whole.changes([after], [before]) == pytest.approx(0.021 / 2.02)
    assert whole.errors([after], [before]) == pytest.approx(0.02 / 2.0)
    turned = replace(before, tones=before.tones * 1j)
    assert each.errors([turned], [before]) == pytest.approx(0.0, abs=1e-12)
    assert each.changes([turned], [before]) == pytest.approx(math.sqrt(2.0))
    phased = Probe((replace(drive, phases=True),), LineWorkers({}))
    assert phased.errors([turned], [before]) == pytest.approx(math.sqrt(2.0))
    two = Probe((drive, drive), LineWorkers({}), of_largest=True)
    assert two.errors([before, after], [before, before]) == pytest.approx(0.01)
    silent = reading(0.0)
    assert each.changes([silent], [silent]) == 0.0


def test_the_largest_value_of_a_further_output() -> None:
    probe = probe_of(drive_of(100.0), drive_of(50.0), x=line(1.0, 1.0), e=line(0.0, -4.0))
    assert probe.largest({}, 0.0, "e") == pytest.approx(4.0)
    own = probe_of(drive_of(100.0, outputs=("y", "x")), x=line(0.0, 3.0), y=line(0.0, 9.0))
    assert own.largest({}, 0.0, "x") == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("tones", "common"),
    [
        (((100.0,), (50.0,)), 0.02),
        (((100.0,), (50.0,), (25.0,)), 0.04),
        (((100.0,), (30.0,)), None),
        (((100.0,),), 0.01),
        (((100.0, 110.0), (50.0,)), 0.1),
        (((100.0, 100.0 + 2.0**0.5),), None),
    ],
)
def test_a_common_length_is_whole_windows_of_every_drive(
    tones: tuple[tuple[float, ...], ...], common: float | None
) -> None:
    found = probe_of(*(drive_of(*each) for each in tones), x=line(1.0, 1.0)).common_length_s()
    assert found == (None if common is None else pytest.approx(common, rel=1e-9))


def test_what_is_no_whole_period_has_no_common_length() -> None:
    """A tone whose period is just the window of a pair that has none in common."""
    pair = drive_of(100.0, 100.0 + 2.0**0.5)
    length_s = probe_of(pair, x=line(1.0, 1.0)).windows(0.0)[0].length_s
    single = drive_of(1.0 / length_s)
    for drives in ((pair, single), (single, pair)):
        probe = probe_of(*drives, x=line(1.0, 1.0))
        lengths = [window.length_s for window in probe.windows(0.0)]
        assert lengths == pytest.approx([length_s] * 2, rel=1e-10)
        assert probe.common_length_s() is None


def test_windows_shorten_where_time_costs() -> None:
    """100 and 101.01 Hz: beats of 0.99 s, six of them 5.94 s, a common period of 100 s."""
    drive, single = drive_of(100.0, 101.01), drive_of(77.0)
    for rate, longest in ((1e-3, 6.0 / 1.01), (0.5, math.inf)):

        def signal(t: FloatArray, values: Mapping[str, Scalar]) -> FloatArray:
            return np.asarray(np.cos(t) + float(values.get("step", 0.0)))

        probe = Probe((single, drive), LineWorkers({"x": signal}), by(substep="step"))
        assert probe.windows(0.0)[1].length_s == pytest.approx(100.0)
        probe.shorten_windows({"step": rate})  # 1/step substeps a second, over a hundred of them
        assert probe.longest_s == pytest.approx(longest)
    assert probe.windows(0.0)[0].length_s == pytest.approx(1.0 / 77.0)


def test_of_three_tones_the_closest_pair_beats_slowest() -> None:
    """100, 101.01 and 150 Hz: six beats of 1.01 Hz, which is far below 50 and 48.99 Hz."""
    drive = drive_of(100.0, 101.01, 150.0)
    probe = Probe((drive,), LineWorkers({"x": stepped("h", True)}), by(substep="h"))
    probe.shorten_windows({"h": 1e-3})
    assert probe.longest_s == pytest.approx(6.0 / 1.01)
    assert probe.windows(0.0)[0].length_s <= 6.0 / 1.01


def stepped(name: str, acts: bool) -> Output:
    """An output that a parameter changes, or not."""
    return lambda t, values: np.asarray(
        np.cos(300.0 * t) + (1e-9 * float(values.get(name, 0.0)) if acts else 0.0)
    )


def test_substeps_are_counted_by_what_acts() -> None:
    drives = drive_of(100.0, 104.0), drive_of(50.0)

    def rate(acts: bool, **told: str) -> float:
        name = next(iter(told.values()), "")
        probe = Probe(drives, LineWorkers({"x": stepped(name, acts)}), by(**told))
        return probe.substeps_per_s({name: 2e-4} if name else {})

    assert rate(True, substep="h") == pytest.approx(5000.0)
    assert rate(False, substep="h") == 0.0
    assert rate(False, tolerance="tol") == 0.0
    # a tenth in a period of the fastest tone, 400 in a beat of the tones
    assert rate(True, tolerance="tol") == pytest.approx(0.1 * 104.0 + 400.0 * 4.0)
    assert rate(True) == pytest.approx(0.1 * 104.0)


def test_whether_a_substep_acts_is_asked_once_for_all_tolerances() -> None:
    workers = LineWorkers({"x": stepped("h", True)})
    probe = Probe((drive_of(100.0),), workers, by(substep="h", tolerance="tol"))
    for tolerance in (1e-3, 1e-5, 1e-7):
        assert probe.acts_as_substep({"h": 1e-3, "tol": tolerance})
    assert len(workers.asked) == 2
    assert probe.acts_as_substep({"h": 1e-3, "other": 1.0})
    assert len(workers.asked) == 4


def test_a_substep_of_nothing_is_forty_in_a_period_and_beats_count_no_more_than_twice_that() -> (
    None
):
    drives = (drive_of(100.0, 190.0),)
    probe = Probe(drives, LineWorkers({"x": stepped("h", True)}), by(substep="h"))
    assert probe.substeps_per_s({"h": 0.0}) == pytest.approx(40.0 * 190.0)
    own = (replace(drives[0], start_values={"h": 1e-3}),)
    assert Probe(own, LineWorkers({"x": stepped("h", True)}), by(substep="h")).substeps_per_s(
        {}
    ) == pytest.approx(1000.0)
    adaptive = Probe(drives, LineWorkers({"x": stepped("tol", True)}), by(tolerance="tol"))
    assert adaptive.substeps_per_s({}) == pytest.approx(0.1 * 190.0 + 2.0 * 40.0 * 190.0)


def test_a_parameter_at_which_the_model_fails_acts() -> None:
    def fails(t: FloatArray, values: Mapping[str, Scalar]) -> FloatArray:
        if "h" in values:
            raise FmuFailure("too long a substep", {}, Path("test.fmu"))
        return np.cos(t)

    probe = Probe((drive_of(100.0),), LineWorkers({"x": fails}), by(substep="h"))
    assert probe.substeps_per_s({"h": 1e-3}) == pytest.approx(1000.0)


def test_work_is_communication_steps_and_substeps() -> None:
    """One step to the first sample and to each further one, and substeps over the time of all."""
    drive = drive_of(100.0)
    window = drive.window(0.5)
    last_s = 0.5 + (window.samples - 1) * window.step_s
    probe = Probe((drive,), LineWorkers({"x": stepped("h", True)}), by(substep="h"))
    assert probe.work({"h": 1e-3}, 0.5) == pytest.approx(window.samples + 1 + 1e3 * last_s)
    # a tone that is moved is settled at twice, and sampled at both
    moved = replace(drive, start_values={"u": 90.0}, approach=Approach("u", 90.0, 100.0))
    there = Probe((moved,), LineWorkers({"x": stepped("h", False)}), by(substep="h"))
    assert there.work({}, 0.5) == 2 * window.samples + 2
    # a generated input is held over steps
    held = replace(drive, input="b", steps_per_period=20)
    of_steps = Probe((held,), LineWorkers({"x": stepped("h", False)}), by(substep="h"))
    end_s = held.window(0.5).times_s()[-1]
    assert of_steps.work({}, 0.5) == round(end_s / held.window(0.5).input_step_s)


def test_a_tone_that_is_moved_has_no_phase() -> None:
    moved = replace(drive_of(100.0), start_values={"u": 90.0}, approach=Approach("u", 90.0, 100.0))
    [found] = Probe((moved,), LineWorkers({"x": line(100.0, 3.0, 0.9)})).read({}, 0.1)
    assert found.tones[0, 0] == pytest.approx(3.0 + 0j, rel=1e-9)


def test_a_substep_acts_where_only_short_ones_do() -> None:
    """A solver that takes no step longer than a fortieth of a period, whatever it is told."""
    longest_s = 1.0 / (40.0 * 100.0)

    def output(t: FloatArray, values: Mapping[str, Scalar]) -> FloatArray:
        taken = min(float(values.get("h", longest_s)), longest_s)
        return np.asarray(np.cos(2.0 * np.pi * 100.0 * t) * (1.0 + (1e3 * taken) ** 4))

    probe = Probe((drive_of(100.0),), LineWorkers({"x": output}), by(substep="h"))
    assert probe.substeps_per_s({"h": 1e-4}) == pytest.approx(1e4)
