"""The calculated outputs (coupling, uncoupled eigenfrequencies, damping matrix) and start times."""

from __future__ import annotations

import math
from types import SimpleNamespace

import mpmath as mp
import numpy as np
import pytest

from tests.support import reference
from tests.support.fmus import DISCARD, LIVELY, OK, Instance
from tests.support.scenes import STRING

ETA = {"eta_plus": 6.94026e6, "eta_minus": 7.02760e6}


@pytest.mark.parametrize(
    ("theta", "coupling_mhz", "low_mhz", "high_mhz"),
    [(1.9498, 0.6474, 6.9522, 7.0156), (2.0406, 0.7016, 6.9582, 7.009)],
)
def test_published_tables(
    instance: Instance, theta: float, coupling_mhz: float, low_mhz: float, high_mhz: float
) -> None:
    """Both series of the paper within its drift; its labels f1 and f2 are swapped (f1 > f2 here).

    The last f of the second series is printed with three decimals, so its rounding counts too.
    """
    instance.start(theta=theta, **ETA)
    coupling, f1, f2 = instance.get("lambda", "f1", "f2")
    assert coupling == pytest.approx(coupling_mhz * 1e6, abs=300.0)
    assert f2 == pytest.approx(low_mhz * 1e6, abs=300.0)
    rounding = 500.0 if high_mhz == 7.009 else 0.0
    assert f1 == pytest.approx(high_mhz * 1e6, abs=300.0 + rounding)


@pytest.mark.parametrize("reflection", [False, True])
@pytest.mark.parametrize("theta", [1.7, 2.9, -0.4, 3 * math.pi / 4])
def test_the_outputs_are_the_matrices(instance: Instance, theta: float, reflection: bool) -> None:
    """C = T^T C~ T and D~ = T D T^T, multiplied out by numpy."""
    instance.start(theta=theta, reflection=reflection, d1=130.0, d2=70.0, **ETA)
    c, s = math.cos(theta), math.sin(theta)
    t = np.array([[-c, s], [s, c]] if reflection else [[c, -s], [s, c]])
    stiffness = t.T @ np.diag([ETA["eta_plus"] ** 2, ETA["eta_minus"] ** 2]) @ t
    damping = 2 * math.pi * t @ np.diag([130.0, 70.0]) @ t.T
    coupling, f1, f2, d11, d22, d12 = instance.get("lambda", "f1", "f2", "D11", "D22", "D12")
    assert [f1**2, f2**2] == pytest.approx(np.diag(stiffness), rel=1e-13)
    # one number stands off the diagonal in either form, and the published sign has lambda real
    assert -(coupling**2) == pytest.approx(stiffness[0, 1], rel=1e-9)
    assert [d11, d22, d12] == pytest.approx([*np.diag(damping), damping[0, 1]], rel=1e-12)
    widths = np.diag(damping) / (2 * math.pi)
    assert instance.get("width_plus", "width_minus") == pytest.approx(widths, rel=1e-12)
    etas = np.array([ETA["eta_plus"], ETA["eta_minus"]])
    assert instance.get("Q_plus", "Q_minus") == pytest.approx(etas / widths, rel=1e-12)


def test_the_start_time_is_part_of_the_drive_phase(instance: Instance) -> None:
    """Starting at 1234.5 s is starting at 0 with the phases that the drive has reached by then."""
    begin, duration = 1234.5, 2.0**-9  # exact in binary: begin + duration is
    shifted = {}
    with mp.workdps(60):
        for tone, u in ((1, STRING.u1 + 0.37), (2, STRING.u2)):
            shifted[f"phase{tone}"] = 2 * mp.pi * mp.frac(mp.mpf(u) * mp.mpf(begin))
    values = STRING.parameters | {"u1": STRING.u1 + 0.37}
    instance.start(begin, **values)
    assert instance.step(begin, duration) == OK
    truth = reference.displacements(SimpleNamespace(**(values | shifted)), [duration])[0]
    found = instance.get("q1_hybrid", "q2_hybrid")
    assert found == pytest.approx([float(truth[0]), float(truth[1])], rel=1e-10)


@pytest.mark.parametrize("d2", [5e5, 4e3])
def test_an_overdamped_mode_is_left_to_rk4(instance: Instance, d2: float) -> None:
    """Its poles are real, which rounding must not hide."""
    values = dict(LIVELY) | {"d1": 5e5, "d2": d2}
    instance.start(**values)
    assert instance.step(0.0, 1e-5) == DISCARD
    assert "overdamped" in instance.status_message()
    instance.slave.reset()
    instance.start(solver=2, rk4_substep=1e-8, **values)
    assert instance.step(0.0, 1e-5) == OK
    truth = reference.displacements(SimpleNamespace(reflection=False, **values), [1e-5])[0]
    found = instance.get("q1_hybrid", "q2_hybrid")
    assert found == pytest.approx([float(truth[0]), float(truth[1])], rel=1e-6)
