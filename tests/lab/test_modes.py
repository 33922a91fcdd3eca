"""N coupled modes of the virtual laboratory: against 50 digits, and two modes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fitting.lab.modes import CoupledModes, Pump
from fitting.lab.string import TwoModes, steady_state
from fitting.text.arrays import FloatArray
from tests.support import modes_reference as reference

THREE = CoupledModes(
    f_hz=(6.95e6, 7.01e6, 7.08e6),
    d_hz=(100.0, 90.0, 140.0),
    coupling_hz={(0, 1): 0.4e6, (1, 2): 0.3e6},
    gains=(1.0, -0.5, 0.3),
)
SPLITTING = float(np.diff(THREE.eigenfrequencies_hz())[0])
PUMPED = replace(
    THREE,
    pump=Pump(
        frequency_hz=SPLITTING,
        phase_rad=0.7,
        depth_f=(1e-4, 0.0, -2e-4),
        depth_coupling={(0, 1): 3e-2},
    ),
)


def as_variables(modes: CoupledModes) -> dict[str, float]:
    """The names that the equations have in tests.support.modes_reference."""
    found: dict[str, float] = {}
    for i, (f, d, g) in enumerate(zip(modes.f_hz, modes.d_hz, modes.gains, strict=True), start=1):
        found |= {f"f{i}": f, f"d{i}": d, f"g{i}": g}
    for i in (1, 2, 3):
        for j in range(i + 1, 4):
            found[f"lambda{i}{j}"] = modes.coupling_hz.get((i - 1, j - 1), 0.0)
            if modes.pump:
                depth = modes.pump.depth_coupling.get((i - 1, j - 1), 0.0)
                found[f"depth_lambda{i}{j}"] = depth
        if modes.pump:
            found[f"depth_f{i}"] = modes.pump.depth_f[i - 1]
            found["pump_hz"] = modes.pump.frequency_hz
    return found


@pytest.mark.parametrize("modes", [THREE, PUMPED], ids=["unpumped", "pumped"])
def test_the_response_is_that_of_the_equations(modes: CoupledModes) -> None:
    u = THREE.eigenfrequencies_hz()[0] + np.array([-150.0, 20.0])
    variables = as_variables(modes)
    sides = (0, 1, -1) if modes.pump else (0,)
    for row, frequency in enumerate(u):
        if modes.pump:
            truth = reference.sidebands(variables, float(frequency), 6, 0.7)
        else:
            truth = {0: reference.phasors(variables, float(frequency))}
        size = max(float(abs(x)) for x in truth[0])
        for side in sides:
            found = modes.response(u, side)[row]
            for x, y in zip(found, truth[side], strict=True):
                assert abs(x - complex(y)) <= 1e-9 * size


def test_two_modes_are_the_string() -> None:
    theta, plus, minus = 1.9498, 6.94026e6, 7.02760e6
    c, s = math.cos(theta), math.sin(theta)
    string = TwoModes(
        theta_rad=theta, d1_hz=120.0, d2_hz=90.0, eta_plus_hz=plus, eta_minus_hz=minus
    )
    t = string.transform()
    modes = CoupledModes(
        f_hz=(math.hypot(c * plus, s * minus), math.hypot(s * plus, c * minus)),
        d_hz=(120.0, 90.0),
        coupling_hz={(0, 1): math.sqrt(-s * c * (minus - plus) * (minus + plus))},
        gains=tuple(map(float, t.T @ np.ones(2))),
    )
    u = plus + np.linspace(-300.0, 300.0, 11)
    seen = modes.response(u) @ t.T
    wanted = steady_state(string, u)
    # rounding f and lambda moves the line by some 1e-9 of its width of 94 Hz, at Q = 7e4
    assert np.abs(seen - wanted).max() <= 1e-9 * np.abs(wanted).max()


def test_without_a_pump_there_are_no_sidebands() -> None:
    assert not THREE.response(np.array([6.95e6]), 1).any()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"d_hz": (1.0, 2.0)}, "d_hz.* 2 .* 3"),
        ({"gains": (1.0,)}, "gains.* 1 .* 3"),
        ({"f_hz": (1.0, -2.0, 3.0)}, r"f = .*-2\.0"),
        ({"coupling_hz": {(1, 0): 1.0}}, r"pair \(1, 0\)"),
        ({"coupling_hz": {(0, 1): -1.0}}, r"-1\.0"),
        ({"coupling_hz": {(0, 1): 8e6}}, "no restoring force"),
    ],
)
def test_nonsense_is_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        replace(THREE, **changes)  # type: ignore[arg-type]


def test_a_pump_needs_a_frequency() -> None:
    with pytest.raises(ValueError, match=r"pump.* 0\.0 Hz"):
        Pump(frequency_hz=0.0)


@pytest.mark.parametrize(("share", "grows"), [(0.0, False), (0.998, False), (1.002, True)])
def test_a_pump_at_twice_the_frequency_lets_motion_grow_from_its_threshold(
    share: float, grows: bool
) -> None:
    """A degenerate parametric amplifier oscillates from the depth 2/Q on (A. Nayfeh, D. Mook)."""
    quality = 1e4
    pump = Pump(frequency_hz=2e6, depth_f=(share * 2.0 / quality,))
    growth = CoupledModes(f_hz=(1e6,), d_hz=(1e6 / quality,), pump=pump).growth()
    assert (growth > 1.0) is grows
    # below it the slower quadrature decays as exp(-pi d (1 - share) t)
    assert np.log(growth) == pytest.approx(-np.pi * 100.0 * (1.0 - share) / 2e6, abs=5e-9)


@pytest.mark.parametrize("pump_hz", [300.0, 997.0, 2090.0])
def test_the_growth_in_a_pump_period_is_that_of_the_integrated_equations(pump_hz: float) -> None:
    f, d, coupling, depth = np.array([1000.0, 1100.0]), np.array([9.0, 4.0]), 300.0, (0.1, -0.05)
    modes = CoupledModes(
        f_hz=(1000.0, 1100.0),
        d_hz=(9.0, 4.0),
        coupling_hz={(0, 1): coupling},
        pump=Pump(frequency_hz=pump_hz, phase_rad=0.4, depth_f=depth, depth_coupling={(0, 1): 0.2}),
    )

    def moved(t: float, flat: FloatArray) -> FloatArray:
        x, v = flat.reshape(2, 2, 4)
        wave = np.cos(2.0 * np.pi * pump_hz * t + 0.4)
        stiff = np.diag(f**2 * (1.0 + np.array(depth) * wave))
        stiff[0, 1] = stiff[1, 0] = -(coupling**2) * (1.0 + 0.2 * wave)
        pull = stiff @ x + d[:, np.newaxis] * v  # v = x'/(2 pi)
        return np.asarray(2.0 * np.pi * np.stack([v, -pull]).ravel())

    begun = np.stack(np.split(np.eye(4), 2)).ravel()
    end = solve_ivp(moved, (0.0, 1.0 / pump_hz), begun, method="DOP853", rtol=1e-11, atol=1e-9)
    wanted = np.abs(np.linalg.eigvals(end.y[:, -1].reshape(4, 4))).max()
    assert modes.growth() == pytest.approx(wanted, rel=2e-3)
