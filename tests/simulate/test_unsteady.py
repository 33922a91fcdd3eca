"""Amplitudes that do not stand still: sidebands of a pump and free oscillations are told apart."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import build_fmu
import fitting as ff
from fitting.report.words.simulation import unsteady_line

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
def modes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ff.Fmu]:
    folder: Path = tmp_path_factory.mktemp("modes")
    with ff.Fmu(build_fmu.build("CoupledModes2", folder), workers=1) as fmu:
        yield fmu


def test_a_sideband_of_a_pump_is_named(modes: ff.Fmu) -> None:
    """A linear system under a pump answers at the tone and at the tone plus multiples of it."""
    response = modes.simulate(PUMPED, tones=("u1",), outputs="readout", accuracy=1e-5)
    assert not response.steady
    assert response.beside is not None
    assert response.remainder.at_hz == response.beside.at_hz
    assert abs(response.beside.at_hz - TONE_HZ) == pytest.approx(PUMP_HZ, rel=2e-3)
    sideband = modes.sideband(response)
    assert sideband is not None
    assert (sideband.tone, sideband.parameter) == ("u1", "pump_hz")
    said = unsteady_line(response, sideband, list(modes.variables))
    assert said.startswith(f"not steady: there is a line at u1 {sideband.sign} pump_hz = ")
    assert said.endswith("wanted outputs that hold u1 alone, as readout_at_u1")


def test_the_line_at_the_tone_alone_is_steady(modes: ff.Fmu) -> None:
    response = modes.simulate(PUMPED, tones=("u1",), outputs="readout_at_u1", accuracy=1e-5)
    assert response.steady
    assert response.beside is None
    assert modes.sideband(response) is None


def test_a_mode_that_rings_for_hours_is_a_free_oscillation(oscillator_fmu: Path) -> None:
    eta_hz = 6.9e6
    start = {"theta": 0.0, "d1": 1e-7, "d2": 1e-7, "eta_plus": eta_hz, "u1": TONE_HZ, "A2": 0.0}
    with ff.Fmu(oscillator_fmu, workers=1) as fmu:
        accuracy = ff.Accuracy(1e-4, forbid=["periodic start"])
        response = fmu.simulate(start, tones=("u1",), outputs="q1_hybrid", accuracy=accuracy)
        assert not response.steady
        assert response.beside is not None
        assert response.beside.at_hz == pytest.approx(eta_hz, abs=200.0)
        # it began at rest: the free oscillation cancels the driven one at time zero
        assert response.beside.share == pytest.approx(1.0, abs=0.2)
        assert fmu.sideband(response) is None
        said = unsteady_line(response, None, list(fmu.variables))
    assert "which is no combination of u1; wanted more damping, or a longer time" in said
