"""Amplitudes that do not stand still: sidebands of a pump and free oscillations are told apart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import fitting as ff
from fitting.report.screen import phrase
from fitting.simulate.budget import Basis, Budget, Decision, Kind
from fitting.simulate.drive import Drive
from fitting.simulate.planner import plan_drives
from fitting.simulate.probe import Knowledge
from fitting.simulate.response import (
    Remainder,
    RemainderKind,
    Sideband,
    sideband_of,
    strongest_other_line,
)
from tests.support.line_workers import LineWorkers, line, together

TONE_HZ, PUMP_HZ = 6.92e6, 87340.0
#: Two modes at 6.94 and 7.03 MHz; the drive is below both.
PUMPED = {
    "f1": 6.95e6,
    "f2": 7.0e6,
    "lambda12": 5e5,
    "u1": TONE_HZ,
    "A2": 0.0,
    "periodic_start": True,
    "pump_hz": PUMP_HZ,
    "depth_f1": 1e-4,
}


@pytest.fixture(scope="module")
def modes(swift_modes_fmu: Path) -> Iterator[ff.Fmu]:
    with ff.Fmu(swift_modes_fmu, workers=1) as fmu:
        yield fmu


def test_a_sideband_of_a_pump_is_named(modes: ff.Fmu) -> None:
    """A linear system under a pump answers at the tone and at the tone plus multiples of it."""
    response = modes.simulate(PUMPED, tones=("u1",), outputs="readout", accuracy=1e-5)
    assert not response.steady
    assert response.other_line is not None
    assert response.remainder.at_hz == response.other_line.at_hz
    assert abs(response.other_line.at_hz - TONE_HZ) == pytest.approx(PUMP_HZ, rel=2e-3)
    sideband = modes.sideband(response)
    assert sideband is not None
    assert (sideband.tone, sideband.parameter) == ("u1", "pump_hz")
    said = phrase("simulation", "unsteady", response, sideband, list(modes.variables), ())
    assert f"u1 {sideband.sign} pump_hz = " in said
    assert said.endswith("readout_at_u1")


def test_the_line_at_the_tone_alone_is_steady(modes: ff.Fmu) -> None:
    response = modes.simulate(PUMPED, tones=("u1",), outputs="readout_at_u1", accuracy=1e-5)
    assert response.steady
    assert response.other_line is None
    assert modes.sideband(response) is None


def test_a_mode_that_rings_for_hours_is_a_free_oscillation(swift_fmu: Path) -> None:
    eta_hz = 6.9e6
    start = {"theta": 0.0, "d1": 1e-7, "d2": 1e-7, "eta_plus": eta_hz, "u1": TONE_HZ, "A2": 0.0}
    with ff.Fmu(swift_fmu, workers=1) as fmu:
        accuracy = ff.Accuracy(1e-4, forbid=["periodic start"])
        response = fmu.simulate(start, tones=("u1",), outputs="q1_hybrid", accuracy=accuracy)
        assert not response.steady
        assert response.other_line is not None
        assert response.other_line.at_hz == pytest.approx(eta_hz, abs=200.0)
        # it began at rest: the free oscillation cancels the driven one at time zero
        assert response.other_line.share == pytest.approx(1.0, abs=0.2)
        assert fmu.sideband(response) is None
        said = phrase("simulation", "unsteady", response, None, list(fmu.variables), ())
    assert "no combination of u1" in said
    assert "pump" not in said


TONES = (1000.0, 1010.0)
CLEAN = together(line(1000.0, 3.0, 0.4), line(1010.0, 2.0))


@pytest.mark.parametrize("nearby_hz", [1003.1, 1006.3, 640.17, 1350.2])
@pytest.mark.parametrize("share", [0.3, 1e-3])
def test_the_strongest_line_beside_the_tones_is_found(nearby_hz: float, share: float) -> None:
    """As a part of the larger peak; a weaker one far away is another. A Hann window loses 15 %."""
    drive = Drive(start_values={}, tones_hz=TONES, outputs=("x", "y"))
    plan = plan_drives((drive,), 1e-4, LineWorkers({"x": CLEAN, "y": CLEAN}), Knowledge())
    size, weaker = 3.0 * share, line(811.3, 1.5 * share)
    noisy = LineWorkers({"x": CLEAN, "y": together(CLEAN, line(nearby_hz, size, 1.1), weaker)})
    found = strongest_other_line(noisy, plan)
    assert found is not None
    assert found.at_hz == pytest.approx(nearby_hz, abs=0.1 * found.bin_hz)
    assert 0.84 * share < found.share < 1.01 * share
    [look] = noisy.asked
    assert found.bin_hz == pytest.approx(1.0 / (look.samples * look.sample_step_s))


def test_a_line_that_does_not_explain_what_is_off_is_not_told() -> None:
    """A promise of 1e-4 is not broken by a line of a millionth."""
    drive = Drive(start_values={}, tones_hz=TONES, outputs=("x",))
    plan = plan_drives((drive,), 1e-4, LineWorkers({"x": CLEAN}), Knowledge())
    loose = replace(plan, budget=Budget(1e-4, (settling(1e-4),)))
    for share, told in ((1e-6, False), (1e-5, True)):
        noisy = LineWorkers({"x": together(CLEAN, line(640.17, 3.0 * share))})
        assert (strongest_other_line(noisy, loose) is not None) is told


def settling(bound: float) -> Decision:
    return Decision(kind=Kind.SETTLING, basis=Basis.UNSTEADY, bound=bound)


def variable(name: str, start: float, unit: str = "Hz", causality: str = "parameter") -> Any:
    return SimpleNamespace(name=name, start=start, unit=unit, causality=causality)


@pytest.mark.parametrize(
    ("at_hz", "variables", "found"),
    [
        (1040.1, [variable("pump", 40.0)], Sideband("u", "+", "pump")),
        (959.9, [variable("pump", 40.0)], Sideband("u", "−", "pump")),
        (1040.6, [variable("pump", 40.0)], None),
        (1040.0, [variable("pump", 0.04, "kHz")], Sideband("u", "+", "pump")),
        (1040.0, [variable("pump", 40.0), variable("other", 40.2)], None),
        (1040.0, [variable("pump", 40.0, causality="output")], None),
        (1040.0, [variable("pump", 40.0, unit="V")], None),
        (1040.0, [variable("pump", 7.0), variable("told", 3.0)], Sideband("u", "+", "told")),
        # what a look does not tell from the tone is no distance
        (1002.0, [variable("pump", 2.0)], None),
    ],
)
def test_a_distance_from_a_tone_is_that_of_one_parameter(
    at_hz: float, variables: list[Any], found: Sideband | None
) -> None:
    """Within half of a bin of 1 Hz."""
    other = Remainder(RemainderKind.UNEXPLAINED, at_hz=at_hz, share=0.1, bin_hz=1.0)
    known = {"u": variable("u", 1000.0), **{each.name: each for each in variables}}
    assert sideband_of(other, {"u": 1000.0}, {"told": 40.0}, known) == found


@pytest.mark.parametrize(("distance_hz", "sign"), [(0.4, "+"), (-0.4, "−")])
def test_a_pump_of_less_than_a_hertz_has_its_side(distance_hz: float, sign: str) -> None:
    other = Remainder(RemainderKind.UNEXPLAINED, at_hz=1000.0 + distance_hz, share=0.1, bin_hz=0.01)
    known = {"u": variable("u", 1000.0), "pump": variable("pump", 0.4)}
    assert sideband_of(other, {"u": 1000.0}, {}, known) == Sideband("u", sign, "pump")
