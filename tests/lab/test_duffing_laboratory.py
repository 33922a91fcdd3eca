"""The laboratory's harmonic balance: against DOP853, closed forms, and its own linear bench."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fitting.lab.bench import measure
from fitting.lab.benches import duffing_bench, with_level
from fitting.lab.duffing import CubicModes, NoSteadyState, lines_to_order, steady_lines
from fitting.lab.instruments import READ
from fitting.lab.string import Drive, TwoModes, steady_state
from tests.support import duffing_reference

ETA, QUALITY = 1000.0, 25.0
WIDTH = ETA / QUALITY
FORCE = (2 * math.pi) ** 2 * ETA * WIDTH  # moves an oscillator on resonance by 1 m


def alpha_of(strength: float) -> float:
    """The cubic coefficient that shifts an amplitude of 1 m by ``strength`` line widths."""
    return strength * WIDTH / ETA * (2 * math.pi * ETA) ** 2 * 8.0 / 3.0


def alone(width: float = WIDTH) -> TwoModes:
    """One mode of some width; the other one is far and its damping does not couple."""
    return TwoModes(
        theta_rad=0.0, d1_hz=width, d2_hz=width, eta_plus_hz=ETA, eta_minus_hz=300.0 * ETA
    )


def roots(alpha: float, u: float, force: float, width: float = WIDTH) -> list[float]:
    """Amplitudes of one tone, |(delta + 3/4 alpha a^2) + i loss| a = force, ascending."""
    delta = (2 * math.pi) ** 2 * (ETA - u) * (ETA + u)
    loss, lift = (2 * math.pi) ** 2 * u * width, 0.75 * alpha
    squares = np.roots([lift**2, 2 * lift * delta, delta**2 + loss**2, -(force**2)])
    return sorted(math.sqrt(r.real) for r in squares if abs(r.imag) < 1e-9 * abs(r.real))


def test_lines_are_those_of_the_full_equations() -> None:
    """Two modes, all cubic terms, two tones: settled motion by DOP853, line by line."""
    modes = TwoModes(
        theta_rad=1.9498,
        d1_hz=WIDTH,
        d2_hz=0.8 * WIDTH,
        eta_plus_hz=ETA,
        eta_minus_hz=ETA + 2.6 * WIDTH,
    )
    sample = CubicModes(modes, alpha_of(0.6), -0.5 * alpha_of(0.6), 0.4 * alpha_of(0.6))
    u, level = (990.0, 1010.0), 0.7 * FORCE
    lines = steady_lines(sample, Drive.equal(u, level))
    settle, window, count = 0.25, 0.1, 1024
    times = settle + window * np.arange(count) / count
    scene = SimpleNamespace(
        theta=1.9498,
        d1=WIDTH,
        d2=0.8 * WIDTH,
        eta_plus=ETA,
        eta_minus=ETA + 2.6 * WIDTH,
        reflection=False,
        u1=u[0],
        u2=u[1],
        A1=level,
        A2=level,
        phase1=0.0,
        phase2=0.0,
        g1=1.0,
        g2=1.0,
        alpha1=sample.alpha1,
        alpha2=sample.alpha2,
        kappa=sample.kappa,
    )
    truth = duffing_reference.motion(scene, times, rtol=1e-11)
    spectrum = np.fft.fft(truth.q, axis=0) * (2.0 / count)
    top = np.abs(spectrum).max()
    for factors in (*READ, (3, -2), (-2, 3), (3, 0), (2, 1), (0, 3)):
        f = factors[0] * u[0] + factors[1] * u[1]
        found = lines[factors] * np.exp(2j * np.pi * f * settle)
        assert np.abs(found - spectrum[round(f * window)]).max() < 2e-8 * top
    assert abs(lines[2, -1][0]) > 0.05 * top  # the scene is nonlinear
    assert abs(lines[3, 0][0]) > 1e-4 * top


def test_one_line_alone_is_the_averaged_closed_form() -> None:
    """Harmonic balance with a single line is the first-order averaged equation itself."""
    for strength, u in ((0.5, 1.0), (-0.4, 0.99), (3.0, 1.0)):
        sample = CubicModes(alone(), alpha_of(strength))
        lines = lines_to_order(sample, Drive.equal((u * ETA,), FORCE), 1)
        wanted = roots(alpha_of(strength), u * ETA, FORCE)
        assert len(wanted) == 1
        assert abs(lines[1,][0]) == pytest.approx(wanted[0], rel=1e-9)


def test_what_averaging_leaves_out_falls_with_the_shift() -> None:
    """Everything in line widths alike, eps ~ 1/Q: the difference falls as its order, or faster."""
    qualities, difference = np.array([25.0, 50.0, 100.0]), []
    for quality in qualities:
        part = QUALITY / quality
        alpha, force, width = part * alpha_of(2.0), part * FORCE, part * WIDTH
        u = ETA + 0.5 * width
        sample = CubicModes(alone(width), alpha)
        found = abs(steady_lines(sample, Drive.equal((u,), force))[1,][0])
        difference.append(abs(found / roots(alpha, u, force, width)[0] - 1.0))
    assert 1e-6 < difference[0] < 2.0 / QUALITY
    slope = np.polyfit(np.log(qualities), np.log(difference), 1)[0]
    assert -2.2 < slope < -0.9


def test_both_branches_are_reached_by_continuation_in_the_frequency() -> None:
    sample = CubicModes(alone(), alpha_of(3.0))
    inside = ETA + 2.2 * WIDTH
    wanted = roots(sample.alpha1, inside, FORCE)
    assert len(wanted) == 3
    ends = []
    for begin in (ETA, ETA + 5.0 * WIDTH):
        lines = steady_lines(sample, Drive.equal((begin,), FORCE))
        for u in np.linspace(begin, inside, 40)[1:]:
            lines = steady_lines(sample, Drive.equal((float(u),), FORCE), start=lines)
        ends.append(abs(lines[1,][0]))
    assert ends == pytest.approx([wanted[2], wanted[0]], rel=0.1)


def follow(sample: CubicModes, begin: float, end: float) -> None:
    """Step the tone from one frequency to another, until the branch ends or is left."""
    lines = steady_lines(sample, Drive.equal((begin,), FORCE))
    for u in np.linspace(begin, end, 60):
        before = abs(lines[1,][0])
        lines = steady_lines(sample, Drive.equal((float(u),), FORCE), start=lines)
        if abs(lines[1,][0]) > 1.5 * before:  # Newton's method leapt to the other branch
            raise NoSteadyState


def test_a_branch_that_ends_is_no_number() -> None:
    with pytest.raises(NoSteadyState):
        follow(CubicModes(alone(), alpha_of(3.0)), ETA + 5.0 * WIDTH, ETA + 0.5 * WIDTH)
    follow(CubicModes(alone(), alpha_of(0.1)), ETA + 5.0 * WIDTH, ETA + 2.0 * WIDTH)


def test_linear_limit_is_the_linear_laboratory() -> None:
    modes = duffing_bench().modes
    lines = steady_lines(CubicModes(modes, 0.0), Drive.equal((6940250.0, 6940290.0), 0.3))
    wanted = 0.3 * steady_state(modes, np.array([6940250.0, 6940290.0]))
    assert np.abs(lines[1, 0] / wanted[0] - 1.0).max() < 1e-12
    assert np.abs(lines[0, 1] / wanted[1] - 1.0).max() < 1e-12
    assert np.abs(lines[2, -1]).max() == 0.0


def test_only_alpha_times_the_squared_drive_shows() -> None:
    """Twice the drive and a quarter of the coefficients: the same shape, twice as large."""
    modes = duffing_bench().modes
    u = (6940250.0, 6940290.0)
    one = steady_lines(CubicModes(modes, 1e32, 2e31, 3e31), Drive.equal(u, 0.2))
    two = steady_lines(CubicModes(modes, 0.25e32, 0.5e31, 0.75e31), Drive.equal(u, 0.4))
    assert two.keys() == one.keys()
    largest = max(np.abs(line).max() for line in one.values())
    assert max(np.abs(two[k] - 2.0 * line).max() for k, line in one.items()) < 1e-9 * largest


def test_conjugate_lines_and_lines_that_are_not_there() -> None:
    sample, drive = CubicModes(alone(), alpha_of(0.3)), Drive.equal((990.0, 1010.0), 0.3 * FORCE)
    lines = steady_lines(sample, drive)
    assert lines[-2, 1] == pytest.approx(lines[2, -1].conj())
    with pytest.raises(ValueError, match="no line"):
        sample.amplitudes(replace(drive, lines=((1, 1),)))


def test_the_same_seed_gives_the_same_series_and_its_errors_are_as_stated() -> None:
    lab = duffing_bench()
    one, same, other = measure(lab, 5), measure(lab, 5), measure(lab, 6)
    assert one.array("peaks_v").tolist() == same.array("peaks_v").tolist()
    assert one.sweep.amplitude_v.tolist() == same.sweep.amplitude_v.tolist()
    assert one.array("peaks_v").tolist() != other.array("peaks_v").tolist()
    pulls = [(m.array("peaks_v") - m.true_peaks_v) / m.array("sigmas_v") for m in (one, other)]
    assert 0.5 < np.std(pulls) < 1.5  # 32 numbers


def test_what_is_no_laboratory_is_refused() -> None:
    lab = duffing_bench()
    assert max(with_level(lab, 0.1).levels) == 0.1
    with pytest.raises(ValueError, match="1 levels"):
        replace(lab, levels=(0.1,))
    with pytest.raises(ValueError, match=r"levels.*-1\.0"):
        with_level(lab, -1.0)
    with pytest.raises(ValueError, match=r"inf"):
        CubicModes(alone(), math.inf)
    with pytest.raises(ValueError, match=r"tones \(1\.0, 1\.0\)"):
        Drive.equal((1.0, 1.0), 1.0)
    strong = with_level(lab, 3.0)  # the first pair, at 5/7 of it, is too strong already
    with pytest.raises(ValueError, match=re.escape(f"at {strong.levels[0]!r} m/s^2")):
        measure(strong, 1)
