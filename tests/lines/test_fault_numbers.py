"""Numbers of a sweep's fault against scipy's fits and F distribution, and where they end."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import curve_fit
from scipy.stats import f as f_distribution

from fitting.lines import faults
from fitting.lines.faults import Fault, SweepFault, sweep_faults
from fitting.text.arrays import FloatArray

ETA_HZ, WIDTH_HZ = 5000.0, 20.0
Law = Callable[..., FloatArray]


@pytest.fixture(autouse=True)
def _one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether two lines fit as well is asked in `test_sweep_faults`: it costs most of the time."""
    monkeypatch.setattr(faults, "two_lines_p", lambda *_: 1.0)


def detuned(count: int, widths: float = 3.0) -> FloatArray:
    """Frequencies about the line, their number, and the line widths to both sides of it."""
    return np.asarray(ETA_HZ + WIDTH_HZ * np.linspace(-widths, widths, count))


def line(f: FloatArray, eta: float, width: float, height: float) -> FloatArray:
    return np.asarray(height * np.abs(wave(f, eta, width)))


def wave(f: FloatArray, eta: float, width: float) -> np.ndarray:
    return np.asarray(width * eta / (eta**2 - f**2 + 1j * f * width))


def noisy(values: FloatArray, noise: float, seed: int) -> FloatArray:
    return values + noise * np.random.default_rng(seed).standard_normal(values.size)


def refit(
    law: Law, f: FloatArray, a: FloatArray, more: tuple[float, ...]
) -> tuple[FloatArray, ...]:
    """Values, their standard deviations, and the sum of squares that scipy's own fit leaves."""
    begin = (ETA_HZ, WIDTH_HZ, float(np.max(a)), *more)
    scale = (1.0, 1.0, float(np.max(a)), *(1.0 for _ in more))
    with np.errstate(all="ignore"):
        x, spread = curve_fit(law, f, a, p0=begin, x_scale=scale, method="trf", xtol=1e-14)
    left = law(f, *x) - a
    return x, np.sqrt(np.diag(spread)), np.asarray(left @ left)


def only(found: tuple[SweepFault, ...], fault: Fault) -> SweepFault:
    assert [each.fault for each in found if each.fault is fault] == [fault]
    return next(each for each in found if each.fault is fault)


@pytest.mark.parametrize("power", [1.15, 0.9])
def test_a_power_comes_with_the_numbers_of_an_ordinary_fit(power: float) -> None:
    """k, its standard deviation, both widths and the F-test are those of scipy's curve_fit."""
    f = detuned(61)
    a = noisy(line(f, ETA_HZ, WIDTH_HZ, 1.0) ** power, 0.004, 1)
    found = only(sweep_faults(f, 7.0 * a), Fault.POWER)
    plain, _, before = refit(line, f, a, ())
    x, std, after = refit(
        lambda f, eta, width, height, k: height * np.abs(wave(f, eta, width)) ** k, f, a, (power,)
    )
    assert found.size == pytest.approx(x[3], rel=1e-5)
    assert found.std == pytest.approx(std[3], rel=1e-3)
    assert found.width_hz == pytest.approx((plain[1], x[1]), rel=1e-5)
    gain = (before - after) * (61 - 4) / after
    assert np.log(found.p_value) == pytest.approx(f_distribution.logsf(gain, 1, 61 - 4), rel=1e-3)
    assert np.isnan(found.frequency_hz)


def test_a_background_counts_as_two_numbers() -> None:
    f = detuned(61)
    a = noisy(np.abs(wave(f, ETA_HZ, WIDTH_HZ) + 0.03 - 0.04j), 0.003, 2)
    found = only(sweep_faults(f, a), Fault.BACKGROUND)
    _, _, before = refit(line, f, a, ())

    def law(f: FloatArray, *x: float) -> FloatArray:
        return np.asarray(x[2] * np.abs(wave(f, x[0], x[1]) + x[3] + 1j * x[4]))

    x, _, after = refit(law, f, a, (0.03, -0.04))
    # magnitudes know the line up to its mirror image, whose height is |1 + 2 i b| times as large
    size = np.hypot(x[3], x[4])
    assert any(
        found.size == pytest.approx(each, rel=1e-3)
        for each in (size, size / abs(1.0 + 2j * complex(x[3], x[4])))
    )
    assert found.width_hz[1] == pytest.approx(x[1], rel=1e-5)
    gain = (before - after) / 2.0 * (61 - 5) / after
    assert np.log(found.p_value) == pytest.approx(f_distribution.logsf(gain, 2, 61 - 5), rel=1e-3)


def test_an_outlier_comes_with_the_numbers_of_the_line_of_the_others() -> None:
    """Its point is the largest of the sweep: the top of the line is not the top of the points."""
    f = detuned(41)
    a = noisy(line(f, ETA_HZ, WIDTH_HZ, 1.0), 0.01, 3)
    a[18] += 0.25
    assert np.argmax(a) == 18
    found = only(sweep_faults(f, a), Fault.OUTLIER)
    rest, others = np.delete(f, 18), np.delete(a, 18)
    _, _, before = refit(line, f, a, ())
    x, _, after = refit(line, rest, others, ())
    assert found.frequency_hz == f[18]
    there = line(f[18:19], *x[:3])[0]
    assert found.size == pytest.approx((a[18] - there) / x[2], rel=1e-5)
    assert found.std == pytest.approx(np.sqrt(after / (41 - 4)) / x[2], rel=1e-5)
    assert found.width_hz[1] == pytest.approx(x[1], rel=1e-5)
    p = np.log(41.0) + f_distribution.logsf((before - after) * (41 - 4) / after, 1, 41 - 4)
    assert np.log(found.p_value) == pytest.approx(p, rel=1e-3)


def test_an_outlier_of_little_chance_is_not_told() -> None:
    """The largest of 41 normal numbers is beyond 3.2 in one sweep of 15 and beyond 5 in none."""
    f = detuned(41)
    for off, told in ((3.2, False), (7.0, True)):
        a = noisy(line(f, ETA_HZ, WIDTH_HZ, 1.0), 0.01, 0)
        a[30] = line(f, ETA_HZ, WIDTH_HZ, 1.0)[30] + 0.01 * off
        assert [each.fault for each in sweep_faults(f, a)] == [Fault.OUTLIER] * told


def test_a_clipped_line_is_that_of_the_other_points() -> None:
    f = detuned(81)
    a = np.minimum(noisy(line(f, ETA_HZ, WIDTH_HZ, 2.0), 0.004, 5), 1.7)
    flat = a == 1.7
    found = only(sweep_faults(f, a), Fault.CLIPPING)
    x, std, _ = refit(line, f[~flat], a[~flat], ())
    assert found.size == pytest.approx(1.0 - 1.7 / x[2], rel=1e-4)
    assert found.std == pytest.approx(std[2] * 1.7 / x[2] ** 2, rel=1e-3)
    assert found.frequency_hz == pytest.approx(np.mean(f[flat]))
    assert found.width_hz[1] == pytest.approx(x[1], rel=1e-5)
    assert found.p_value == 0.0


@pytest.mark.parametrize(("equal", "told"), [(2, False), (3, True)])
def test_two_equal_points_are_chance_and_three_a_limit(equal: int, told: bool) -> None:
    f = detuned(31)
    a = noisy(line(f, ETA_HZ, WIDTH_HZ, 1.0), 0.001, 6)
    a = np.minimum(a, np.sort(a)[-equal])
    faults = [each.fault for each in sweep_faults(f, a)]
    assert (Fault.CLIPPING in faults) == told


@pytest.mark.parametrize(("limit", "told"), [(0.9, False), (0.8, True)])
def test_a_limit_that_two_points_reach_may_be_chance(limit: float, told: bool) -> None:
    """Thirty points, two of them above 0.85 of the line and four above 0.7."""
    f = detuned(30)
    a = np.minimum(noisy(line(f, ETA_HZ, WIDTH_HZ, 1.0), 0.001, 6), limit)
    assert int(np.sum(a == limit)) == (4 if told else 2)
    assert (Fault.CLIPPING in [each.fault for each in sweep_faults(f, a)]) == told


@pytest.mark.parametrize(("points", "told"), [(10, False), (11, True)])
def test_eight_points_of_a_line_and_three_more_are_wanted(points: int, told: bool) -> None:
    f = detuned(points)
    a = noisy(line(f, ETA_HZ, WIDTH_HZ, 1.0) ** 2, 1e-4, 7)
    assert bool(sweep_faults(f, a)) == told


def test_differences_at_rounding_are_no_fault() -> None:
    f = detuned(61)
    for more, told in ((6e-6, False), (18e-6, True)):
        a = noisy(line(f, ETA_HZ, WIDTH_HZ, 1.0) ** (1.0 + more), 2e-3 * more, 8)
        _, _, squares = refit(line, f, a, ())
        assert (np.sqrt(squares / 61) > 1e-6) == told  # of the top, root mean square
        assert bool(sweep_faults(f, a)) == told


@pytest.mark.parametrize(
    ("eta", "widths", "told"), [(0.0, 0.5, True), (0.0, 0.1, False), (4.5, 3.0, False)]
)
def test_a_line_must_lie_within_its_sweep(eta: float, widths: float, told: bool) -> None:
    """Nothing is told of a flank without its top, nor of a top without flanks."""
    f = detuned(61, widths)
    shape = line(f, ETA_HZ + eta * WIDTH_HZ, WIDTH_HZ, 1.0)
    a = noisy(shape**2, 1e-4 * float(np.ptp(shape)), 9)
    assert bool(sweep_faults(f, a)) == told


@pytest.mark.parametrize("eta", [-40.0, 37.0])
def test_a_narrow_line_is_found_anywhere_in_its_sweep(eta: float) -> None:
    """A hundred widths are swept, four points of 401 are the line's top."""
    f = detuned(401, 50.0)
    a = noisy(line(f, ETA_HZ + eta * WIDTH_HZ, WIDTH_HZ, 1.0), 0.003, 12)
    a[200] += 0.2
    found = only(sweep_faults(f, a), Fault.OUTLIER)
    assert found.frequency_hz == f[200]
    assert found.width_hz[1] == pytest.approx(WIDTH_HZ, rel=0.03)


def test_saturation_up_to_a_limit_has_the_size_that_is_missing_at_the_top() -> None:
    """a = tanh(t |g|)/t: at the top 1 - tanh(t)/t of the line is missing."""
    f = detuned(121, 6.0)
    for t in (0.6,):
        a = noisy(np.tanh(t * line(f, ETA_HZ, WIDTH_HZ, 1.0)) / t, 1e-5, 10)
        found = only(sweep_faults(f, a), Fault.SATURATION)
        assert found.size == pytest.approx(1.0 - np.tanh(t) / t, abs=4.0 * found.std)
        assert found.std < 1e-3
        assert found.width_hz[1] == pytest.approx(WIDTH_HZ, rel=1e-3)


def test_soft_saturation_has_its_size() -> None:
    f = detuned(121, 6.0)
    for s in (0.25,):
        shape = line(f, ETA_HZ, WIDTH_HZ, 1.0)
        found = only(sweep_faults(f, noisy(shape * (1 - s * shape**2), 1e-5, 11)), Fault.SATURATION)
        assert found.size == pytest.approx(s, abs=4.0 * found.std)
        assert found.std < 1e-3
