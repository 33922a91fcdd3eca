"""Residuals that are correlated, and lines on a background: against noise of known making."""

from __future__ import annotations

import math
import re
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import chi2, kstest

from fitting.campaign import SweepData
from fitting.inference.sweeps import SweepLine, line_findings, line_of_sweep
from fitting.lines.form import LineFit, fit_resonance
from fitting.lines.record import TriedForm, no_line
from fitting.report.screen import phrases
from fitting.signal.residual_tests import (
    autocorrelation,
    autoregression,
    one_size_p,
    residual_structure,
    white_noise_p,
)
from fitting.text.arrays import FloatArray
from fitting.text.finding import Kind
from fitting.text.rendering import sentence
from tests.support.coloured import coloured

ETA, WIDTH, NOISE = 30281.3, 25.0, 0.004
F = ETA + np.linspace(-38.0, 38.0, 256)


def trace(background: complex = 0.0) -> FloatArray:
    """|mode + background| at F, the mode 1 high at its eigenfrequency."""
    mode = WIDTH * ETA / (ETA**2 - F**2 + 1j * F * WIDTH)
    return np.asarray(np.abs(mode + background))


def fits(rho: float, seeds: range) -> list[LineFit]:
    return [
        fit_resonance(F, trace() + NOISE * coloured(rho, F.size, np.random.default_rng(seed)))
        for seed in seeds
    ]


def distances(found: list[LineFit]) -> FloatArray:
    """d^T C^-1 d of (eta, width) from the truth: chi-square with 2 degrees of freedom if C is."""
    values = []
    for fit in found:
        a = (fit.frequency.value - ETA) / fit.frequency.std
        b = (fit.width.value - WIDTH) / fit.width.std
        r = fit.correl[0][1]
        values.append((a * a + b * b - 2.0 * r * a * b) / (1.0 - r * r))
    return np.array(values)


def test_white_noise_leaves_the_errors_as_they_are() -> None:
    found = fits(0.0, range(200))
    assert sum(fit.structure.widening > 1.0 for fit in found) <= 7  # tested at 1 %
    assert all(1.0 <= fit.structure.widening < 1.6 for fit in found)
    assert kstest(distances(found), chi2(2).cdf).pvalue > 0.01


NIGHTLY = pytest.mark.nightly


@pytest.mark.parametrize("rho", [0.7, *(pytest.param(x, marks=NIGHTLY) for x in (0.4, 0.85))])
def test_neighbours_that_correlate_widen_by_the_known_factor(rho: float) -> None:
    """Error of the mean, and of all that is smooth: sqrt((1 + rho)/(1 - rho)) times as large."""
    known = math.sqrt((1.0 + rho) / (1.0 - rho))
    found = fits(rho, range(1000, 1150))
    widenings = np.array([fit.structure.widening for fit in found])
    assert np.median(widenings) == pytest.approx(known, rel=0.1)
    # what they are for: the scatter of the values, not only its formula
    pulls = np.array([(fit.frequency.value - ETA) / fit.frequency.std for fit in found])
    assert float(np.std(pulls)) == pytest.approx(1.0, abs=0.2)
    assert float(np.std(pulls * widenings)) == pytest.approx(known, rel=0.2)
    inside = np.mean(distances(found) < chi2(2).ppf(0.95))
    assert 0.85 < inside <= 1.0


@pytest.mark.parametrize("draws", [60, pytest.param(300, marks=NIGHTLY)])
@pytest.mark.parametrize("rho", [0.0, 0.7])
def test_noise_that_grows_with_the_amplitude_widens_the_errors(rho: float, draws: int) -> None:
    """1 % of every point: of 68 % and 95 % intervals as many as they say hold the truth."""
    f, rng = ETA + np.linspace(-6.0 * WIDTH, 6.0 * WIDTH, 256), np.random.default_rng(40)
    clean = np.abs(WIDTH * ETA / (ETA**2 - f**2 + 1j * f * WIDTH))
    found = [
        fit_resonance(f, clean * (1.0 + 0.01 * coloured(rho, f.size, rng))) for _ in range(draws)
    ]
    assert sum(fit.structure.is_unequal for fit in found) >= draws * 295 // 300
    together = sum(fit.structure.order > 0 for fit in found)
    assert together >= 0.9 * draws if rho else together <= 0.04 * draws
    widenings = np.array([fit.structure.widening for fit in found])
    for pull in (
        np.array([(fit.frequency.value - ETA) / fit.frequency.std for fit in found]),
        np.array([(fit.width.value - WIDTH) / fit.width.std for fit in found]),
    ):
        inside = [np.mean(np.abs(pull) < k) for k in (1.0, 1.96)]
        assert 0.62 < inside[0] < 0.95
        assert inside[1] > 0.9
        assert np.std(pull * widenings) > 1.7  # without the widening they would not


@pytest.mark.parametrize(
    ("points", "columns"), [(20, 2), (60, 3), pytest.param(400, 6, marks=NIGHTLY)]
)
def test_the_p_value_of_one_size_is_one(points: int, columns: int) -> None:
    """Noise of one size falls below a probability as often as it says; growing noise is seen."""
    rng = np.random.default_rng(41)
    x = np.linspace(-3.0, 3.0, points)
    basis, _ = np.linalg.qr(np.stack([np.exp(-(x**2)) * x**k for k in range(columns)], axis=1))
    away = np.eye(points) - basis @ basis.T
    noise = rng.standard_normal((1500, points))
    p = np.array([one_size_p(away @ e, basis) for e in noise])
    for level in (0.01, 0.05, 0.2):
        assert 0.3 * level < np.mean(p < level) < 2.0 * level
    growing = [one_size_p(away @ (e * np.exp(-(x**2))), basis) for e in noise[:100]]
    assert np.mean(np.array(growing) < 0.01) > (0.5 if points == 20 else 0.99)


def test_many_records_are_looked_at_within_their_own_memory() -> None:
    """Thirty records of 1000 samples, two slopes each: all products would be 440 MB."""
    records, samples = 30, 1000
    rng = np.random.default_rng(43)
    one, _ = np.linalg.qr(rng.standard_normal((samples, 2)))
    basis = block_diag(*[one] * records)
    noise = rng.standard_normal(records * samples)
    tracemalloc.start()
    even = one_size_p(noise, basis)
    [_, peak] = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 6 * basis.nbytes  # of numpy 2.5 it is 5.06
    assert even > 0.01
    grown = noise * (1.0 + 300.0 * np.sum(basis**2, axis=1))
    assert one_size_p(grown, basis) < 0.01


def test_records_with_unknowns_of_their_own_widen_what_they_share_as_its_own_frequency_says() -> (
    None
):
    """S(w) of AR(1) over white: (1 - rho^2)/(1 - 2 rho cos w + rho^2), 1.38 at 8 samples a turn.

    The offset of each record is nobody's question; its noise is three times the white one's.
    """
    records, samples, rho = 20, 160, 0.5
    rng = np.random.default_rng(44)
    turn = 0.25 * np.pi
    asked = np.tile(np.sin(turn * np.arange(samples)), records)[:, None]
    offsets = [np.ones((samples, 1))] * records
    found = []
    for _ in range(40):
        noise = coloured(rho, records * samples, rng)
        columns = np.column_stack([block_diag(*offsets), asked])
        left = noise - columns @ np.linalg.lstsq(columns, noise, rcond=None)[0]
        found.append(residual_structure(left, asked, stretches=offsets))
    expected = math.sqrt((1.0 - rho**2) / (1.0 - 2.0 * rho * math.cos(turn) + rho**2))
    assert np.mean([s.together for s in found]) == pytest.approx(expected, rel=0.02)
    assert np.mean([s.is_unequal for s in found]) < 0.1


def test_many_records_are_never_an_array_of_all_samples_and_all_unknowns() -> None:
    """50 records of 600 samples, four unknowns each: that array would have 48 MB."""
    records, samples = 50, 600
    rng = np.random.default_rng(45)
    stretches = [rng.standard_normal((samples, 4)) for _ in range(records)]
    asked = rng.standard_normal((records * samples, 2))
    noise = rng.standard_normal(records * samples)
    noise[1:] += 0.5 * noise[:-1]  # hangs together
    tracemalloc.start()
    found = residual_structure(noise, asked, stretches=stretches)
    [_, peak] = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found.order > 0
    assert peak < 18e6


def test_unequal_sizes_that_do_not_touch_the_slopes_change_nothing() -> None:
    """The last third of the points is ten times as noisy, and nothing is read from it: HC3 says so.

    The mean of the first points: its variance is that of their noise, s^2/m.
    """
    m, rng = 300, np.random.default_rng(42)
    column = np.where(np.arange(m) < 200, 1.0, 0.0)[:, None]
    sizes = np.where(np.arange(m) < 200, 1.0, 10.0)
    e = sizes * rng.standard_normal(m)
    e[:200] -= np.mean(e[:200])
    found = residual_structure(e, column)
    assert found.is_unequal
    assert (found.widening, found.points) == (1.0, m)  # it would be too wide as it is
    swapped = residual_structure(e[::-1], np.ascontiguousarray(1.0 - column[::-1]))
    # the noisy hundred is read: 10^2 against the mean square (200 + 100 10^2)/300
    assert swapped.widening == pytest.approx(math.sqrt(100.0 / (10200.0 / 300.0)), rel=0.2)


# --- a map: many curves, a scale solved for each ------------------------------------------------

VOLTAGES, MAP_F = np.linspace(-5.0, 5.0, 21), np.linspace(99e3, 101e3, 201)
#: Two modes that meet at 0.67 V, 100 Hz apart: a0, a1, a2, f2, coupling, d1, d2, and steps of them.
MODES = np.array([1e5, 120.0, 1.5, 100080.0, 100.0 * 100050.0, 18.0, 11.0])
STEPS = np.array([1e-3, 1e-4, 1e-4, 1e-3, 10.0, 1e-3, 1e-3])


def map_of(p: FloatArray) -> FloatArray:
    """Amplitudes of the first mode, (21 curves, 201 points)."""
    a0, a1, a2, f2, square, d1, d2 = p
    one = (a0 + a1 * VOLTAGES + a2 * VOLTAGES**2)[:, None] ** 2 - MAP_F**2 + 1j * MAP_F * d1
    two = f2**2 - MAP_F**2 + 1j * MAP_F * d2
    return np.asarray(np.abs(two / (one * two - square**2)) * 1e6)


def map_slopes() -> tuple[FloatArray, FloatArray]:
    """Derivatives of all points by the parameters, (4221, 7), and by the scales, (4221, 21)."""
    each = [
        (map_of(MODES + step) - map_of(MODES - step)).ravel() / step.sum()
        for step in np.diag(STEPS)
    ]
    return np.stack(each, axis=1), np.asarray(block_diag(*map_of(MODES)[:, :, None]))


def without(slopes: FloatArray) -> FloatArray:
    """An orthonormal basis of what a fit takes away."""
    return np.asarray(np.linalg.qr(slopes / np.linalg.norm(slopes, axis=0))[0])


@pytest.mark.parametrize(("maps", "most"), [(40, 2), pytest.param(200, 6, marks=NIGHTLY)])
def test_white_maps_are_told_to_be_unequal_no_more_often_than_said(maps: int, most: int) -> None:
    """One in a hundred, and then by what chance does: not by the error of one curve's scale."""
    slopes, scales = map_slopes()
    taken, rng = without(np.column_stack([scales, slopes])), np.random.default_rng(3)
    noise = rng.standard_normal((maps, taken.shape[0]))
    found = [residual_structure(e - taken @ (taken.T @ e), slopes, scales) for e in noise]
    widened = [each.widening for each in found if each.widening > 1.0 and not each.order]
    assert len(widened) <= most  # of 200 more than six, of 40 more than two: one in 250, in 130
    assert max(widened, default=1.0) < 2.0


def test_noise_that_grows_in_a_map_widens_as_its_parameters_scatter() -> None:
    """2 % of each point beside 1 % of the mean: the sandwich with the sizes that are true."""
    slopes, scales = map_slopes()
    whole, rng = without(np.column_stack([scales, slopes])), np.random.default_rng(5)
    asked, curve = whole[:, 21:], map_of(MODES).ravel()
    sizes = 0.01 * np.mean(curve) + 0.02 * curve
    truth = np.linalg.norm(sizes[:, None] * asked, 2) / math.sqrt(np.mean(sizes**2))
    widenings = []
    for _ in range(4):
        e = sizes * rng.standard_normal(sizes.size)
        found = residual_structure(e - whole @ (whole.T @ e), slopes, scales)
        assert found.is_unequal
        widenings.append(found.widening)
    assert np.median(widenings) == pytest.approx(truth, rel=0.25)


def test_points_are_counted_as_their_mean_scatters() -> None:
    """The mean of m correlated points scatters as that of `points` independent ones."""
    m, rho = 400, 0.8
    rng = np.random.default_rng(8)
    series = [coloured(rho, m, rng) for _ in range(400)]
    scatter = float(np.std([np.mean(e) for e in series]))
    counted = [residual_structure(e - np.mean(e), np.ones((m, 1))).points for e in series]
    assert np.median(counted) == pytest.approx(1.0 / scatter**2, rel=0.25)
    assert np.median(counted) == pytest.approx(m * (1 - rho) / (1 + rho), rel=0.15)


def test_the_p_value_is_one() -> None:
    """Noise falls below a probability as often as it says, at most (two tests in one)."""
    rng = np.random.default_rng(3)
    p = np.array([white_noise_p(rng.standard_normal(300)) for _ in range(2000)])
    for level in (0.01, 0.05, 0.2):
        assert 0.4 * level < np.mean(p < level) < 1.4 * level


def test_a_pattern_of_four_points_is_seen_though_neighbours_do_not_correlate() -> None:
    rng = np.random.default_rng(4)
    e = np.tile([1.0, 1.0, -1.0, -1.0], 30) + rng.standard_normal(120)
    assert abs(e[1:] @ e[:-1] / (e @ e)) < 0.15
    assert white_noise_p(e) < 1e-6
    # a smooth line does not feel it
    assert residual_structure(e, np.ones((120, 1))).widening < 1.2


@pytest.mark.parametrize(("points", "lags"), [(49, 9), (50, 10), (200, 10)])
def test_a_pattern_is_looked_for_over_a_fifth_of_the_points_and_ten_at_most(
    points: int, lags: int
) -> None:
    """Waves of four points or so in noise, of which all lags together tell more than the first."""
    wave = np.cos(np.pi / 2.1 * np.arange(points))
    e = wave + np.random.default_rng(6).standard_normal(points)
    r = np.array([e[k:] @ e[:-k] for k in range(1, lags + 1)]) / (e @ e)
    q = points * (points + 2) * np.sum(r**2 / (points - np.arange(1, lags + 1)))
    assert chi2.sf(q, lags) < chi2.sf(points * (points + 2) * r[0] ** 2 / (points - 1), 1)
    assert white_noise_p(e) == pytest.approx(2.0 * chi2.sf(q, lags), rel=1e-9, abs=0.0)


def test_ten_points_are_judged_and_nine_are_not() -> None:
    """Ljung and Box of two lags: Q_h = m (m + 2) sum r_k^2/(m - k), here (-1)^k (10 - k)/10."""
    e = np.tile([1.0, -1.0], 5)
    first = 10 * 12 * 0.9**2 / 9
    both = first + 10 * 12 * 0.8**2 / 8
    wanted = 2.0 * min(chi2.sf(first, 1), chi2.sf(both, 2))
    assert white_noise_p(e) == pytest.approx(wanted, rel=1e-9)
    assert white_noise_p(e[:9]) == 1.0


def test_an_autoregressive_process_is_recognised() -> None:
    a, rng = np.array([1.2, -0.6]), np.random.default_rng(5)
    e = np.zeros(20000)
    noise = rng.standard_normal(e.size)
    for t in range(2, e.size):
        e[t] = a @ e[t - 2 : t][::-1] + noise[t]
    assert autoregression(e, 2) == pytest.approx(a, abs=0.02)
    r = autocorrelation(a, 60)
    assert r[1] == pytest.approx(1.2 / 1.6)  # a1/(1 - a2), Yule and Walker
    assert r[:20] == pytest.approx([e[k:] @ e[: e.size - k] / (e @ e) for k in range(20)], abs=0.05)
    assert autocorrelation(np.array([0.9]), 50) == pytest.approx(0.9 ** np.arange(50))
    assert autocorrelation(np.zeros(0), 3) == pytest.approx([1.0, 0.0, 0.0])


@pytest.mark.parametrize("e", [np.zeros(50), 1e-9 * np.sin(np.arange(50.0)), np.ones(8)])
def test_rounding_and_too_few_points_are_not_judged(e: FloatArray) -> None:
    found = residual_structure(e, np.ones((e.size, 1)))
    assert (found.p_value, found.widening, found.points) == (1.0, 1.0, e.size)


@pytest.mark.parametrize("e", [np.tile([1.0, -1.0], 40), np.ones(80), np.linspace(-1, 1, 80)])
def test_series_without_any_noise_end_finitely(e: FloatArray) -> None:
    found = residual_structure(e, np.stack([np.ones(80), np.arange(80.0)], axis=1))
    assert found.p_value < 1e-6
    assert 1.0 <= found.widening < 10.0
    assert 3.0 <= found.points <= 80.0


def sweep(
    background: complex, seed: int, *, chosen: str = "none", noise: float = NOISE
) -> SweepData:
    rng = np.random.default_rng(seed)
    a = trace(background) + noise * rng.standard_normal(F.size)
    return SweepData(
        frequency_hz=F,
        amplitude_v=a,
        phase_rad=None,
        settings={},
        use="scale",
        scale="fit",
        source=Path("sweep.csv"),
        background=chosen,
    )


@pytest.mark.parametrize("chosen", ["none", "complex"])
def test_a_background_is_told_with_both_values(chosen: str) -> None:
    for seed in range(5):
        line = line_of_sweep(sweep(0.03 - 0.04j, seed, chosen=chosen))
        plain, full = line.forms
        assert (plain.name, full.name) == ("none", "complex")
        assert line.frequency.value == (plain if chosen == "none" else full).frequency.value
        assert full.frequency.value == pytest.approx(ETA, abs=4.0 * full.frequency.std)
        assert abs(plain.frequency.value - ETA) > 0.2
        found = [*line_findings(line, fitted=True)][-1]
        assert found.kind is Kind.line_background
        assert found.numbers["plain_frequency_hz"] == plain.frequency.value
        assert found.numbers["full_frequency_hz"] == full.frequency.value
        # each shift with its own standard errors: that of the frequency stood behind the FWHM's
        for name, key in (("frequency", "sigmas"), ("width", "width_sigmas")):
            one, other = getattr(plain, name), getattr(full, name)
            apart = abs(other.value - one.value) / math.hypot(one.std, other.std)
            assert found.numbers[key] == pytest.approx(apart)
        words = sentence(found)
        shifts = re.findall(r"by [+−][\d.]+ \w+ \(([\d.]+) standard errors\)", words)
        assert [float(each) for each in shifts] == pytest.approx(
            [found.numbers["sigmas"], found.numbers["width_sigmas"]], rel=0.05
        )


@pytest.mark.parametrize("seeds", [20, pytest.param(60, marks=NIGHTLY)])
def test_without_a_background_none_is_told(seeds: int) -> None:
    lines = [line_of_sweep(sweep(0.0, seed)) for seed in range(seeds)]
    assert sum(bool([*line_findings(line, fitted=False)]) for line in lines) <= 1
    seen = [line.background_p < 0.05 for line in lines if not math.isnan(line.background_p)]
    assert len(seen) >= seeds * 55 // 60
    assert np.mean(seen) < 0.12


@pytest.mark.parametrize("seeds", [10, pytest.param(40, marks=NIGHTLY)])
def test_correlated_noise_is_no_background(seeds: int) -> None:
    told = 0
    for seed in range(seeds):
        clean = sweep(0.0, seed)
        rough = NOISE * coloured(0.7, F.size, np.random.default_rng(seed))
        line = line_of_sweep(replace(clean, amplitude_v=trace() + rough))
        assert line.forms[0].structure.widening > 1.5
        told += len([*line_findings(line, fitted=False)]) - 1  # the first is of their correlation
    assert told <= max(1, seeds // 20)


def test_exact_data_raise_no_doubt() -> None:
    line = line_of_sweep(sweep(0.0, 0, noise=0.0))
    assert line.frequency.value == pytest.approx(ETA, abs=1e-9)
    assert not [*line_findings(line, fitted=False)]
    assert all(form.structure.widening == 1.0 for form in line.forms)
    assert len(phrases("result", "line", line)) == len(line.forms)


def test_a_fit_that_fails_is_told_beside_the_other() -> None:
    line: SweepLine = line_of_sweep(sweep(0.0, 1))
    failed = TriedForm(**no_line(), name="complex", message="it ended nowhere")
    broken = replace(line, forms=(line.forms[0], failed), background_p=math.nan)
    assert not [*line_findings(broken, fitted=True)]
    assert "(it ended nowhere)" in phrases("result", "line", broken)[-1]
