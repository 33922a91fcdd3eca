"""CoupledModes through `import fitting as ff`, pumped or not, against the virtual laboratory."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

import fitting as ff
from fitting.lab.modes import CoupledModes, Pump

pytestmark = pytest.mark.usefixtures("swift_models")

VALUES: dict[str, float | str] = {
    "f1": 1000.0,
    "f2": 1300.0,
    "lambda12": 100.0,
    "d1": 10.0,
    "d2": 12.0,
    "g2": -0.5,
    "A2": 0.0,
}
SAMPLE = CoupledModes(
    f_hz=(1000.0, 1300.0), d_hz=(10.0, 12.0), coupling_hz={(0, 1): 100.0}, gains=(1.0, -0.5)
)
PUMP: dict[str, float | str] = {"pump_hz": 300.0, "depth_f1": 0.01, "depth_lambda12": 5.0}
PUMPED = CoupledModes(
    f_hz=SAMPLE.f_hz,
    d_hz=SAMPLE.d_hz,
    coupling_hz=SAMPLE.coupling_hz,
    gains=SAMPLE.gains,
    pump=Pump(frequency_hz=300.0, depth_f=(0.01, 0.0), depth_coupling={(0, 1): 5.0}),
)


@pytest.fixture(scope="module")
def fmu() -> Iterator[ff.Fmu]:
    with ff.Fmu("CoupledModes2", 1) as held:
        yield held


def test_a_drive_without_a_pump_keeps_its_promise(fmu: ff.Fmu) -> None:
    found = fmu.simulate(
        VALUES | {"u1": 1003.0}, tones=("u1",), outputs=("readout", "q2"), accuracy=1e-6
    )
    truth = np.abs(SAMPLE.response(np.array([1003.0])))
    assert found.plan.promised <= 1e-6
    assert np.abs(found.peaks / truth - 1.0).max() <= found.plan.promised


def test_a_drive_with_the_pump_among_its_tones_names_the_sidebands(fmu: ff.Fmu) -> None:
    found = fmu.simulate(VALUES | PUMP | {"u1": 1003.0}, tones=("u1", "pump_hz"))
    truth = abs(PUMPED.response(np.array([1003.0]))[0, 0])
    assert abs(found.peaks[0, 0] / truth - 1.0) <= max(found.plan.promised, 1e-6)
    seen = {line.factors: float(line.amplitudes[0]) for line in found.lines}
    for side in (1, -1):
        wanted = abs(PUMPED.response(np.array([1003.0]), side)[0, 0])
        assert seen[(1, side)] == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize(
    ("output", "more", "sample"),
    [("readout", {}, SAMPLE), ("readout_at_u1", PUMP, PUMPED)],
    ids=["unpumped", "pumped"],
)
def test_a_sweep_is_that_of_the_laboratory(
    fmu: ff.Fmu, output: str, more: dict[str, float | str], sample: CoupledModes
) -> None:
    at = np.linspace(980.0, 1020.0, 9)
    found = fmu.sweep(at, VALUES | more, output=output)
    truth = np.abs(sample.response(at)[:, 0])
    assert np.abs(found.curves[0].amplitudes - truth).max() <= 1e-4 * truth.max()
