"""What ``CoupledModes`` declares of a pumped motion bounds the errors of all its outputs.

`python -m tests.bench.bench_pumped_error` tries 1000 scenes.
"""

from __future__ import annotations

import math

import pytest

from fmu_src import coupled_modes
from tests.support import modes_reference as reference
from tests.support.pumped_scenes import NotComparable, compared
from tests.support.slaves import Slave

#: Of each kind two: cut early and late, in doubles and corrected, the envelope's among them.
SEEDS = (0, 1, 2, 3, 4, 5, 8, 11, 13, 21)


@pytest.mark.parametrize("seed", SEEDS)
def test_no_output_is_further_off_than_declared(seed: int) -> None:
    try:
        found = compared(seed)
    except NotComparable as error:
        pytest.skip(str(error))
    assert found.worst <= 1.0, found.ratios
    assert not found.exceeds(1e-12)


def string(depth: float, pump_hz: float) -> dict[str, float]:
    """The string of the pumped campaign under one tone on its lower line."""
    theta, plus, minus = 1.9498, 6.94026e6, 7.0276e6
    c, s = math.cos(theta), math.sin(theta)
    made = {"f1": math.hypot(c * plus, s * minus), "f2": math.hypot(s * plus, c * minus)}
    made |= {"lambda12": math.sqrt(-s * c * (minus**2 - plus**2)), "d1": 120.0, "d2": 90.0}
    made |= {"g1": c + s, "g2": c - s, "readout1": c, "readout2": -s}
    return made | {"depth_f1": depth, "pump_hz": pump_hz, "u1": plus + 15.0, "A2": 0.0}


@pytest.mark.parametrize(
    ("depth", "pump_hz", "most"),
    [(3e-3, 43670.0, 6), (3e-3, 43648.0, 6), (3e-4, 87340.0, 3), (3e-3, 87300.0, 5)],
)
def test_a_tolerance_costs_few_sidebands(depth: float, pump_hz: float, most: int) -> None:
    """The second and the fourth have a sideband at minus an eigenfrequency, 160 or 320 away."""
    p = string(depth, pump_hz)
    slave = Slave(coupled_modes.CoupledModes2, **p, tolerance=1e-6, periodic_start=True)
    told, declared = slave.get("pump_sidebands", "readout_error")
    truth = reference.long_sidebands(p, p["u1"], 25)[0]
    wanted = complex(p["readout1"] * truth[0] + p["readout2"] * truth[1])
    found = complex(*slave.get("readout_X_u1", "readout_Y_u1"))
    assert abs(found - wanted) <= declared * abs(wanted)
    assert declared <= 1e-6
    assert told <= most


def test_a_run_as_exact_as_doubles_has_few_sidebands_too() -> None:
    for pump_hz, most in ((43670.0, 11), (43648.0, 11), (87300.0, 8)):
        slave = Slave(coupled_modes.CoupledModes2, **string(3e-3, pump_hz), periodic_start=True)
        told, declared = slave.get("pump_sidebands", "readout_error")
        assert told <= most
        assert declared <= 1e-12


def test_without_a_pump_a_tolerance_changes_nothing() -> None:
    names = ("readout", "readout_X_u1", "q2_Y_u1", "readout_error", "pump_sidebands")
    p = string(0.0, 43670.0)
    rows = [
        Slave(coupled_modes.CoupledModes2, **p, **more).run([1e-7, 1e-5], *names)
        for more in ({}, {"tolerance": 1e-2})
    ]
    assert rows[0] == rows[1]
    assert rows[0][0][3:] == [0.0, 0.0]
