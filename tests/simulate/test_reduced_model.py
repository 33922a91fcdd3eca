"""CoupledOscillator with one mode only: `other_mode`, and what the FMU says that it costs.

Without damping coupling (theta = 0) the near mode is decoupled, so the full 50-digit solution is
the truth of the reduced model, transient included; with coupling the phasors are compared with
mpmath's.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import mpmath as mp
import pytest

from tests.support import reference
from tests.support.fmus import DISCARD, Instance, Unpacked, worst

TIMES = [k * 1.7123e-3 for k in range(1, 12)]
QUASI_STATIC, LEFT_OUT = 1, 2


def full_and_reduced(p: SimpleNamespace, u: float, near: int) -> tuple[list[Any], list[Any]]:
    """|X| of both modes, full and with mode `near` alone and the other quasi-static, 30 digits."""
    with mp.workdps(30):
        x = reference.phasors(p, u)
        c, s, w = mp.cos(p.theta), mp.sin(p.theta), 2 * mp.pi * mp.mpf(u)
        d = (c * c * p.d1 + s * s * p.d2, s * s * p.d1 + c * c * p.d2)
        d12 = 2 * mp.pi * c * s * (p.d1 - p.d2) * (-1 if p.reflection else 1)
        own = [
            (2 * mp.pi * mp.mpf(eta)) ** 2 - w**2 + 1j * w * 2 * mp.pi * d[k]
            for k, eta in enumerate((p.eta_plus, p.eta_minus))
        ]
        y = [mp.mpc(0), mp.mpc(0)]
        y[near] = mp.mpf((p.g1, p.g2)[near]) / own[near]
        y[1 - near] = (mp.mpf((p.g1, p.g2)[1 - near]) - 1j * w * d12 * y[near]) / own[1 - near]
        return list(x), y


@pytest.mark.parametrize("other", [QUASI_STATIC, LEFT_OUT])
@pytest.mark.parametrize("periodic", [False, True])
def test_a_decoupled_mode_moves_as_in_the_full_model(
    other: int, periodic: bool, oscillator: Unpacked, instance: Instance
) -> None:
    p = oscillator.parameters(theta=0.0)
    instance.start(theta=0.0, other_mode=other, periodic_start=periodic)
    found = [[row[0]] for row in instance.run(TIMES, "q1_hybrid")]
    truth = [[row[0]] for row in reference.displacements(p, TIMES, periodic)]
    assert worst(found, truth) < 1e-11


def test_a_held_input_and_a_retuned_drive_go_on_from_the_state(
    oscillator: Unpacked, instance: Instance
) -> None:
    p = oscillator.parameters(theta=0.0, A1=0.5)
    inputs = [1.0, -2.0, 0.5, 3.0, 0.0, 1.0]
    truth = reference.displacements(p, TIMES[:6], False, inputs)
    instance.start(theta=0.0, A1=0.5, other_mode=QUASI_STATIC)
    found, now = [], 0.0
    for time, b in zip(TIMES, inputs, strict=False):
        instance.set(b=b)
        assert instance.step(now, time - now) == 0
        found.append(instance.get("q1_hybrid"))
        now = time
    assert worst(found, [[row[0]] for row in truth]) < 1e-10


@pytest.mark.parametrize("near", [0, 1])
def test_errors_are_those_of_the_phasors(
    near: int, oscillator: Unpacked, instance: Instance
) -> None:
    u = (6.94016e6, 7.0275e6)[near]
    p = oscillator.parameters(u1=u, A2=0.0, d1=300.0)
    instance.start(u1=u, A2=0.0, d1=300.0, other_mode=QUASI_STATIC)
    full, reduced = full_and_reduced(p, u, near)
    for mode in (0, 1):
        x, y, bound = instance.get(
            f"q{mode + 1}_hybrid_X_u1", f"q{mode + 1}_hybrid_Y_u1", f"q{mode + 1}_hybrid_error"
        )
        assert abs(complex(x, y) - complex(reduced[mode])) < 1e-13 * abs(complex(reduced[mode]))
        error = float(abs(reduced[mode] - full[mode]) / abs(full[mode]))
        assert bound == pytest.approx(error, rel=1e-6, abs=1e-13)
        assert abs(float(abs(reduced[mode]) / abs(full[mode])) - 1.0) <= bound * (1.0 + 1e-9)
    assert instance.get(f"q{near + 1}_hybrid_error")[0] > 1e-9  # there is something to leave out


def test_what_is_left_out_and_nothing_left_out(oscillator: Unpacked) -> None:
    with Instance(oscillator, "out") as instance:
        instance.start(other_mode=LEFT_OUT)
        assert instance.run(TIMES[:2], "q2_hybrid") == [[0.0], [0.0]]
        assert instance.get("q2_hybrid_error") == [1.0]
    with Instance(oscillator, "full") as instance:
        instance.start()
        assert instance.get("q1_hybrid_error", "q2_hybrid_error") == [0.0, 0.0]


def test_the_envelope_says_what_it_costs(oscillator: Unpacked, instance: Instance) -> None:
    p = oscillator.parameters()
    instance.start(solver=1)
    with mp.workdps(30):
        bound = instance.get("q1_hybrid_error")[0]
        for tone, u in ((1, p.u1), (2, p.u2)):
            x, y = instance.get(f"q1_hybrid_X_u{tone}", f"q1_hybrid_Y_u{tone}")
            full = reference.phasors(p, u)[0]
            assert float(abs(mp.mpc(x, y) - full) / abs(full)) <= bound * (1.0 + 1e-9)
    assert bound < 1e-4


def test_other_solvers_keep_both_modes(oscillator: Unpacked) -> None:
    rows = []
    for other in (0, LEFT_OUT):
        with Instance(oscillator, f"envelope {other}") as instance:
            rows.append(instance.start(solver=1, other_mode=other).run(TIMES[:2], "q1_hybrid"))
    assert rows[0] == rows[1]


def test_a_mode_that_does_not_exist_is_refused(instance: Instance) -> None:
    instance.start(other_mode=3)
    assert instance.step(0.0, 1e-6) == DISCARD
    assert "other_mode" in instance.status_message()
