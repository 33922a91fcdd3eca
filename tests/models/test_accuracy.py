"""The FMU's numbers against the equations at 50 digits, through fmpy.

The bound on ``exact`` is relative to the largest amplitude of the run, mode by mode. It holds where
the given doubles determine the motion: a mode that is driven only through rounding (below 1e-13 of
its neighbour) is compared with its neighbour's amplitude.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.support import reference
from tests.support.fmus import OK, Instance, Unpacked
from tests.support.oscillator_runs import (
    GRID,
    MODES,
    communication_points,
    relative_errors,
    simulate,
)
from tests.support.scenes import STRING, Scene

RK4, ENVELOPE = 2, 1


@pytest.fixture(scope="module")
def shared(oscillator: Unpacked) -> Iterator[Instance]:
    with Instance(oscillator) as made:
        yield made


def test_the_grid_is_as_large_as_promised() -> None:
    assert len(GRID) >= 300


@pytest.mark.parametrize(
    "part", [0, *(pytest.param(k, marks=pytest.mark.nightly) for k in range(1, 8))]
)
def test_exact_solver_on_the_whole_grid(shared: Instance, part: int) -> None:
    """1e-9 everywhere, 1e-11 at the string's own frequencies and line widths."""
    worst = 0.0
    for scene in GRID[part::8]:
        times = communication_points(scene)
        errors = relative_errors(scene, simulate(shared, scene, times), times)
        assert max(errors) <= 1e-9, (scene, errors)
        worst = max(worst, *errors)
    assert worst > 0.0  # something was compared


@pytest.mark.parametrize("theta", [0.3, math.pi / 2, 1.9498, 2.0406])
@pytest.mark.parametrize("reflection", [False, True])
def test_string_to_eleven_digits(shared: Instance, theta: float, reflection: bool) -> None:
    for periodic in (False, True):
        scene = replace(STRING, theta=theta, reflection=reflection, periodic_start=periodic)
        times = [1e-6, 0.01 + 1e-7 / 3, 0.1]
        errors = relative_errors(scene, simulate(shared, scene, times), times)
        assert max(errors) <= 1e-11


@pytest.mark.parametrize("steps", [5_000, pytest.param(100_000, marks=pytest.mark.nightly)])
def test_many_small_steps_give_the_bits_of_one_giant_step(shared: Instance, steps: int) -> None:
    """Nothing accumulates: the value at a time is a function of the time."""
    end = 0.05
    giant = simulate(shared, STRING, [end])[0]
    small = simulate(shared, STRING, list(np.linspace(0.0, end, steps + 1)[1:]))[-1]
    assert small == giant


@pytest.mark.parametrize("steps", [10_000, pytest.param(100_000, marks=pytest.mark.nightly)])
def test_thousands_of_steps_of_held_input(shared: Instance, steps: int) -> None:
    """An input that changes at every step: rounding of 1e5 anchors stays below 1e-11."""
    step, every = 2.0**-27, 1000  # 7.5 ns, exact in binary: some 20 a period
    inputs = [math.cos(2 * math.pi * 6.94e6 * (k + 0.5) * step) for k in range(steps)]
    shared.slave.reset()
    shared.start(**replace(STRING, A1=0.0, A2=0.0).parameters)
    found = []
    for k, b in enumerate(inputs):
        shared.set(b=b)
        assert shared.step(k * step, step) == OK
        if (k + 1) % every == 0:
            found.append(shared.get(*MODES))
    truth = reference.held(replace(STRING, A1=0.0, A2=0.0), step, inputs, every)
    for i in (0, 1):
        largest = max(abs(row[i]) for row in truth)
        error = max(abs(f[i] - row[i]) for f, row in zip(found, truth, strict=True))
        assert error <= 1e-11 * largest


@pytest.mark.parametrize(
    "changes",
    [{"u1": 6.94033e6}, {"d1": 250.0, "theta": 0.7}, {"eta_plus": 6.94021e6}, {"A1": 0.0}],
    ids=str,
)
def test_a_parameter_changed_between_steps_keeps_state_and_phase(
    shared: Instance, changes: dict[str, Any]
) -> None:
    change, times = 0.0031, [0.0031 + 1e-8, 0.0077, 0.0321]
    shared.slave.reset()
    shared.start(**STRING.parameters)
    assert shared.step(0.0, change) == OK
    shared.set(**changes)
    now, found = change, []
    for time in times:
        assert shared.step(now, time - now) == OK
        now += time - now
        found.append(shared.get(*MODES))
    after = replace(STRING, **changes)
    truth = reference.retuned(STRING, after, change, times)
    for i in (0, 1):
        largest = max(abs(float(row[i])) for row in truth)
        assert max(abs(float(f[i] - r[i])) for f, r in zip(found, truth, strict=True)) <= (
            1e-11 * largest
        )


def test_rk4_has_order_four(shared: Instance) -> None:
    """Halving the substep divides the error by sixteen: the slope of log error is 4."""
    scene = Scene(
        "slow", eta_plus=10.0, eta_minus=13.0, d1=0.5, d2=0.7, u1=9.8, u2=12.9, step_s=0.31
    )
    times = [scene.step_s]
    substeps = [scene.step_s / n for n in (64, 128, 256, 512)]
    errors = [
        max(
            relative_errors(scene, simulate(shared, scene, times, solver=RK4, rk4_substep=h), times)
        )
        for h in substeps
    ]
    slope = np.polyfit(np.log(substeps), np.log(errors), 1)[0]
    assert slope == pytest.approx(4.0, abs=0.1)


def test_envelope_error_falls_as_one_over_q(shared: Instance) -> None:
    """Everything in line widths alike, only the quality factor grows."""
    qualities = np.array([1e2, 1e3, 1e5])
    errors = []
    for quality in qualities:
        eta = 1e6
        width = eta / quality
        scene = Scene(
            f"Q = {quality:g}",
            d1=width,
            d2=1.3 * width,
            eta_plus=eta,
            eta_minus=eta + 3.0 * width,
            u1=eta - 0.4 * width,
            u2=eta + 0.7 * width,
        )
        # a settled run and one that is still ringing up, over a quarter period for the phase
        times = [t + k / (4.3 * eta) for t in (0.3 / width, 8.0 / width) for k in range(4)]
        found = simulate(shared, scene, times, solver=ENVELOPE)
        errors.append(max(relative_errors(scene, found, times)))
    slope = np.polyfit(np.log(qualities), np.log(errors), 1)[0]
    assert slope == pytest.approx(-1.0, abs=0.1)
    assert errors[-1] < 1e-4


def test_published_pair_seen_through_a_coherent_window(shared: Instance) -> None:
    """The FFT of 50 ms (20 Hz bins) gives the closed-form amplitudes of both tones to 1e-9."""
    scene = replace(STRING, eta_plus=6.94026e6, eta_minus=7.02760e6, periodic_start=True)
    window, count = 0.05, 1024
    times = [window * (k + 1) / count for k in range(count)]
    q1 = np.array([row[0] for row in simulate(shared, scene, times)])
    spectrum = 2.0 / count * np.abs(np.fft.rfft(q1))
    for u in (scene.u1, scene.u2):
        turns = round(u * window) % count
        folded = min(turns, count - turns)
        assert spectrum[folded] == pytest.approx(
            abs(float(abs(reference.phasors(scene, u)[0]))), rel=1e-9
        )


def test_quadratures_are_the_phasors(shared: Instance) -> None:
    scene = replace(STRING, A1=0.3, A2=2.0, phase1=0.4, phase2=-2.0)
    simulate(shared, scene, [1e-3])
    for tone, (u, size, phase) in enumerate(
        ((scene.u1, scene.A1, scene.phase1), (scene.u2, scene.A2, scene.phase2)), start=1
    ):
        for mode, x in enumerate(reference.phasors(scene, u), start=1):
            wanted = complex(x) * size * np.exp(1j * phase)
            found = complex(*shared.get(f"q{mode}_hybrid_X_u{tone}", f"q{mode}_hybrid_Y_u{tone}"))
            assert abs(found - wanted) <= 1e-13 * abs(wanted)
