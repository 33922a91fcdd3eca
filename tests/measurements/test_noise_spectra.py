"""Noise spectra against Langevin's equation, the Gamma distribution and equipartition."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import mpmath
import numpy as np
import pytest
from scipy.constants import Boltzmann
from scipy.optimize import minimize
from scipy.signal import get_window
from scipy.stats import chi2, gamma

import fitting as ff
from fitting.measurements.noise import NoiseSpectrum, best_levels
from fitting.report.screen import phrase, phrases
from fitting.report.shown import figures_of
from fitting.report.summary import summary_of
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.finding import Kind, of_kind
from tests.bench.bench_noise import LABORATORY, PARAMETERS, QUICK, SETUP, one

U = np.arange(60.0, 140.25, 0.5)
EXACT = LABORATORY.density(U) + 2.0 * LABORATORY.noise_m**2 / LABORATORY.rate_hz


@pytest.fixture(scope="module")
def fmu(swift: ff.Fmu) -> ff.Fmu:
    return swift


def spectrum(density: FloatArray = EXACT, **more: object) -> ff.NoiseSpectrum:
    told: dict[str, object] = {"averages": 100, "unit": "m", "setup": SETUP, **more}
    return ff.NoiseSpectrum(U, density, **told)  # type: ignore[arg-type]


def fitted(fmu: ff.Fmu, measured: ff.NoiseSpectrum) -> ff.Fit:
    return ff.fit(ff.Problem(fmu, PARAMETERS, measured), method=QUICK, starts=1)


def drawn(averages: float, seed: int) -> FloatArray:
    """Densities as the average of periodograms scatters."""
    rng = np.random.default_rng(seed)
    return np.asarray(EXACT * rng.gamma(averages, 1.0 / averages, U.size))


# --- likelihood -----------------------------------------------------------------------------


@pytest.mark.parametrize("averages", [1.0, 7.5, 400.0])
def test_the_squares_of_the_rows_are_the_deviance(averages: float) -> None:
    measured = spectrum(drawn(averages, 1), averages=averages)
    scale = 1.3 * EXACT
    log = gamma.logpdf(measured.y, averages, scale=scale / averages)
    best = gamma.logpdf(measured.y, averages, scale=measured.y / averages)
    rows = measured.residuals(scale)
    assert rows**2 == pytest.approx(2.0 * (best - log), rel=1e-6, abs=1e-9)
    assert np.all(np.sign(rows) == np.sign(scale - measured.y))


@pytest.mark.parametrize("averages", [1, 4, 100])
def test_a_row_scatters_as_it_says(averages: int) -> None:
    draws = np.random.default_rng(2).gamma(averages, 1.0 / averages, 200_000)
    measured = NoiseSpectrum(np.arange(1.0, 200_001.0), draws, averages=averages)
    rows = measured.residuals(np.ones(draws.size))
    assert np.mean(rows**2) == pytest.approx(measured.sigma**2, rel=0.02)


@pytest.mark.parametrize("floor", [0.0, 0.3])
def test_level_and_floor_are_the_most_likely_ones(floor: float) -> None:
    shape = LABORATORY.density(U)
    rng = np.random.default_rng(3)
    seen = (2.0 * shape + floor * shape[0]) * rng.gamma(3.0, 1.0 / 3.0, U.size)

    def loss(x: FloatArray) -> float:
        s = x[0] * shape + x[1] * shape[0]
        return float(np.sum(np.log(s) + seen / s))

    bounds = [(1e-3, 10.0), (0.0, 10.0)]
    told = minimize(loss, [1.0, 1.0], bounds=bounds, method="L-BFGS-B", options={"ftol": 1e-15})
    a, b = best_levels(shape, seen, None)
    assert loss(np.array([a, b / shape[0]])) <= told.fun + 1e-9 * abs(told.fun)
    assert a == pytest.approx(told.x[0], rel=1e-3)
    assert b / shape[0] == pytest.approx(told.x[1], rel=1e-3, abs=1e-4)
    known = best_levels(shape, seen, 1.7)
    assert known[0] == pytest.approx(1.7)
    assert best_levels(shape, seen, None, floor=False)[1] == 0.0


@pytest.mark.parametrize("window", ["hann", "hamming", "blackman"])
def test_a_window_widens_a_line_as_the_expected_periodogram_has_it(window: str) -> None:
    """E P(u) = integral of S times the window's own power spectrum, on a grid 32 times as fine."""
    taper, fine = get_window(window, 64), 32
    power = np.abs(np.fft.fft(taper, 64 * fine)) ** 2
    offsets = np.fft.fftfreq(64 * fine, 1.0 / 64.0)  # in spacings of the periodogram
    kernel = power / np.sum(power)
    near = np.abs(offsets) < 20.0
    measured = spectrum(window=window)
    expected = [
        np.sum(kernel[near] * LABORATORY.density(u + 0.5 * offsets[near])) for u in U[40:121:2]
    ]
    found = measured.widened(LABORATORY.density(U))[20:61]
    assert found == pytest.approx(np.array(expected), rel=2e-3)
    assert np.max(np.abs(LABORATORY.density(U[40:121:2]) / found - 1.0)) > 3e-3


# --- fits -----------------------------------------------------------------------------------


def test_a_thermal_spectrum_without_noise_gives_back_what_made_it(fmu: ff.Fmu) -> None:
    fit = fitted(fmu, spectrum(force="thermal", mass_kg=LABORATORY.mass_kg))
    assert fit.x == pytest.approx([LABORATORY.f_hz, LABORATORY.width_hz], rel=1e-6)
    [heat] = fit.result.quadratures.qualities
    assert heat.name == "temperature in K"
    assert heat.value == pytest.approx(300.0, rel=1e-6)


#: A force that falls with the square of the frequency: it moves a wide line.
BROWNIAN = 7.0 * (U / 90.0) ** -2


@pytest.mark.parametrize("window", ["none", "hann"])
def test_a_coloured_force_is_taken_off_the_answer(fmu: ff.Fmu, window: str) -> None:
    """Noise without scatter; under a window it is the expected periodogram, of long segments."""
    clean = LABORATORY.density(U) * (U / 90.0) ** -2
    if window == "hann":  # as a shared sixth on either side
        clean = np.convolve(np.pad(clean, 1, mode="edge"), [1 / 6, 2 / 3, 1 / 6], "valid")
    seen = clean + 1e-3 * np.max(clean)
    kept = slice(1, -1)  # a neighbour is missing at either end
    coloured, white = (
        ff.NoiseSpectrum(
            U[kept], seen[kept], averages=100, window=window, unit="m", setup=SETUP, **more
        )
        for more in ({"force": "coloured", "force_density": BROWNIAN[kept]}, {"force": "white"})
    )
    true = [LABORATORY.f_hz, LABORATORY.width_hz]
    close = 1e-6 if window == "none" else 1e-4
    assert fitted(fmu, coloured).x == pytest.approx(true, rel=close)
    assert fitted(fmu, white).x != pytest.approx(true, rel=1e-3)


def test_volts_are_told_in_metres_by_temperature_and_spring_constant(fmu: ff.Fmu) -> None:
    """<x^2> = k_B T/k; 2 MV per m."""
    k = LABORATORY.mass_kg * (2.0 * np.pi * LABORATORY.f_hz) ** 2
    more = {"force": "thermal", "temperature_k": 300.0, "spring_constant": k, "unit": "V"}
    fit = fitted(fmu, spectrum(4e12 * EXACT, **more))
    [gain] = fit.result.quadratures.qualities
    assert gain.name.endswith(" in V/m")
    assert gain.value == pytest.approx(2e6, rel=1e-6)
    wide = np.arange(1.0, 8000.0, 0.05)
    power = np.sum(LABORATORY.density(wide)) * 0.05
    assert power == pytest.approx(Boltzmann * 300.0 / k, rel=1e-3)


@pytest.mark.parametrize("softer", [1e-12, 1.0, 1e12])
def test_the_error_of_the_read_out_is_that_of_the_likelihood_of_any_spring(
    fmu: ff.Fmu, softer: float
) -> None:
    """Half that of the level, Fisher's: level and floor differ by powers of ten."""
    k = LABORATORY.mass_kg * (2.0 * np.pi * LABORATORY.f_hz) ** 2 / softer
    more = {"force": "thermal", "temperature_k": 300.0, "spring_constant": k, "unit": "V"}
    fit = fitted(fmu, spectrum(4e12 * drawn(100, 4), **more))
    [gain] = fit.result.quadratures.qualities
    bare = LABORATORY.density(U) / EXACT
    matrix = 10.0 * np.stack([_slope(0), _slope(1), bare, 1.0 - bare], axis=1)
    level = np.sqrt(np.linalg.inv(matrix.T @ matrix)[2, 2])
    assert gain.std / gain.value == pytest.approx(0.5 * level, rel=0.15)


def test_errors_are_those_of_the_likelihood(fmu: ff.Fmu) -> None:
    """Fisher's matrix of frequency, width, level and floor: M sum d ln S d ln S."""
    fit = fitted(fmu, spectrum(drawn(100, 4)))
    bare = LABORATORY.density(U) / EXACT
    matrix = 10.0 * np.stack([_slope(0), _slope(1), bare, 1.0 - bare], axis=1)
    stds = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
    for name, std in zip(("eta_plus", "d1"), stds[:2], strict=True):
        assert fit[name].std == pytest.approx(std, rel=0.15)


def _slope(which: int) -> FloatArray:
    """Derivative of ln S by frequency or width."""
    found = []
    for sign in (1.0, -1.0):
        moved = [LABORATORY.f_hz, LABORATORY.width_hz]
        moved[which] += 1e-3 * sign
        lab = replace(LABORATORY, f_hz=moved[0], width_hz=moved[1])
        found.append(lab.density(U) / EXACT)
    return np.asarray((found[0] - found[1]) / 2e-3)


@pytest.mark.parametrize("averages", [1, 10, 1000, 100_000])
def test_the_scatter_tells_how_many_were_averaged(averages: int) -> None:
    """Of a Lorentzian of 30 points in its width: within a quarter, of one within a half."""
    u = np.arange(1.0, 1201.0)
    exact = 1.0 / (1.0 + ((u - 600.0) / 15.0) ** 2) + 0.01
    draws = exact * np.random.default_rng(7).gamma(averages, 1.0 / averages, u.size)
    record = NoiseSpectrum(u, draws)
    assert record.count == pytest.approx(averages, rel=0.5 if averages == 1 else 0.25)
    assert record.sigma == 0.0


def test_averages_that_nobody_told_give_the_same_errors(fmu: ff.Fmu) -> None:
    y = drawn(100.0, 3)
    told, seen = (
        ff.fit(ff.Problem(fmu, PARAMETERS, spectrum(y, averages=averages)), method=QUICK, starts=1)
        for averages in (100.0, None)
    )
    for name in ("eta_plus", "d1"):
        assert seen[name].value == pytest.approx(told[name].value, abs=0.2 * told[name].std)
        assert seen[name].std == pytest.approx(told[name].std, rel=0.2)


def test_a_bound_that_holds_a_width_is_named_and_no_model_is_blamed_alone(fmu: ff.Fmu) -> None:
    """The width is twice its upper bound: no value is given, and wider bounds are advised first."""
    y, width = drawn(100.0, 3), LABORATORY.width_hz
    held = (PARAMETERS[0], ff.Parameter("d1", 0.3 * width, bounds=(1.0, 0.5 * width), unit="Hz"))
    free = ff.fit(ff.Problem(fmu, PARAMETERS, spectrum(y)), method=QUICK, starts=1)
    assert free["d1"].value == pytest.approx(width, rel=0.1)
    assert not of_kind(free.findings, Kind.at_bound)
    found = ff.fit(ff.Problem(fmu, held, spectrum(y)), method=QUICK, starts=1)
    assert found.status == "does not describe the data"
    assert math.isnan(found["d1"].std)
    [bound] = of_kind(found.findings, Kind.at_bound)
    assert (bound.subject, bound.numbers["bound"]) == ("d1", 0.5 * width)
    assert bound.severity == "warning"
    assert summary_of(found.result).advice == phrase("next", "wider_bounds", ["d₁"], False)


@pytest.mark.parametrize("averages", [100, pytest.param(1, marks=pytest.mark.nightly)])
def test_langevin_s_intervals_hold_the_truth(fmu: ff.Fmu, averages: int) -> None:
    """Exact discretisation, Welch, fit: squares of deviations over errors are chi square."""
    found = [one(fmu, averages, seed) for seed in range(4)]
    squares = [each[name][0] ** 2 for each in found for name in each]
    assert len(squares) == 12
    # a dozen, of which width and temperature are correlated: the wide bounds of eight
    assert chi2.ppf(1e-4, 8) * 12 / 8 < sum(squares) < chi2.ppf(1.0 - 1e-4, 8) * 12 / 8


# --- campaign files -------------------------------------------------------------------------

CAMPAIGN = """
title = "Thermal motion"

[fmu]
file = "{fmu}"

[fmu.start]
periodic_start = true
theta = 0.0
g2 = 0.0
eta_minus = "200 Hz"
u2 = "150 Hz"

[observe]
output = "q1_hybrid"
steady_start = true

[drive]
kind = "tones"
frequencies = ["u1", "u2"]
amplitudes = ["A1", "A2"]

[[noise_spectrum]]
file = "spectrum.csv"
averages = 100
force = "thermal"
temperature = "300 K"
mass = "1 ng"

[[parameters]]
name = "eta_plus"
unit = "Hz"
lower = 90.0
upper = 110.0
start = 101.0

[[parameters]]
name = "d1"
unit = "Hz"
lower = 1.0
upper = 60.0
start = 10.0

[continuation]
nu_start = 1e-6
iterations = 1
starts = 1
misfit = "squares"
"""


def written(folder: Path, fmu: Path, old: str = "", new: str = "", rows: str = "") -> Path:
    """Volts, 2 MV per m, and a campaign with a change."""
    assert not old or CAMPAIGN.count(old) == 1
    columns = zip(U / 1e3, 4e18 * drawn(100, 5), strict=True)
    table = [f"{float(u)!r},{float(y)!r}" for u, y in columns]
    text = "\n".join(["frequency (kHz),density (mV2/Hz)", *table])
    (folder / "spectrum.csv").write_text(rows or text)
    path = folder / "campaign.toml"
    path.write_text(CAMPAIGN.replace(old, new).format(fmu=fmu.as_posix()))
    return path


def test_a_campaign_file_tells_of_noise(fmu: ff.Fmu, swift_fmu: Path, tmp_path: Path) -> None:
    fit = ff.fit(ff.Problem.of(ff.read_campaign(written(tmp_path, swift_fmu)), fmu))
    assert fit.success
    for name, true in (("eta_plus", LABORATORY.f_hz), ("d1", LABORATORY.width_hz)):
        assert abs(fit[name].value - true) < 4.0 * fit[name].std
    [gain] = fit.result.quadratures.qualities
    assert abs(gain.value - 2e6) < 4.0 * gain.std < 4e5
    [figure] = figures_of(fit.record)
    assert figure.name == "noise"
    assert f"{U.size} points" in figure.caption
    assert "100 averages" in figure.caption
    said = phrases("result", "quadratures", fit.result.quadratures)
    assert any(sentence.startswith(f"{gain.name} = ") for sentence in said)
    assert not any("loaded" in sentence for sentence in said)  # as quality factors are


def test_a_campaign_file_tells_of_a_coloured_force(
    fmu: ff.Fmu, swift_fmu: Path, tmp_path: Path
) -> None:
    """The density of the force stands in a column of its own, in any unit."""
    seen = LABORATORY.density(U) * BROWNIAN * np.random.default_rng(6).gamma(100.0, 0.01, U.size)
    columns = zip(U, 1e20 * seen, BROWNIAN, strict=True)
    table = [",".join(repr(float(v)) for v in row) for row in columns]
    rows = "\n".join(["frequency (Hz),density (mV2/Hz),shaker (V2/Hz)", *table])
    new = 'columns.force = "shaker"\nforce = "coloured"'
    old = 'force = "thermal"\ntemperature = "300 K"\nmass = "1 ng"'
    path = written(tmp_path, swift_fmu, old, new, rows)
    fit = ff.fit(ff.Problem.of(ff.read_campaign(path), fmu))
    for name, true in (("eta_plus", LABORATORY.f_hz), ("d1", LABORATORY.width_hz)):
        assert abs(fit[name].value - true) < 4.0 * fit[name].std < 0.1 * true
    for wrong, said in (
        ('force = "coloured"', "'force'"),
        ('columns.force = "shaker"', r"columns\.force "),
    ):
        path = written(tmp_path, swift_fmu, old, wrong, rows)
        with pytest.raises(BadInput, match=said):
            ff.Problem.of(ff.read_campaign(path), fmu).record  # noqa: B018


def test_kinds_of_noise_that_are_no_noise_of_the_model_are_told(fmu: ff.Fmu) -> None:
    """A flat spectrum with another line does not follow."""
    other = replace(LABORATORY, f_hz=72.0, width_hz=1.0).density(U) + EXACT[0]
    fit = fitted(fmu, spectrum(other))
    assert fit.result.status != "converged"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        pytest.param("averages = 100", "averages = 0.5", "1 or more", id="averages"),
        pytest.param('"300 K"', '"0 K"', "more than zero", id="temperature"),
        pytest.param('force = "thermal"\n', "", 'force = "thermal"', id="white"),
        pytest.param(
            'mass = "1 ng"',
            'mass = "1 ng"\nspring_constant = "1 N/m"',
            "one of",
            id="both",
        ),
        pytest.param('"1 ng"', '"1 nm"', "wanted 'kg'", id="unit"),
        pytest.param('mass = "1 ng"\n', "", "mass or spring_constant", id="no mass"),
        pytest.param('"thermal"', '"pink"', '"white", "thermal"', id="force"),
    ],
)
def test_bad_keys_are_told_in_a_sentence(
    swift_fmu: Path, tmp_path: Path, old: str, new: str, said: str
) -> None:
    with pytest.raises(BadInput) as raised:
        ff.Problem.of(ff.read_campaign(written(tmp_path, swift_fmu, old, new))).record  # noqa: B018
    assert said in " ".join(raised.value.args)


@pytest.mark.parametrize(
    ("head", "said"),
    [
        pytest.param("frequency (Hz),density (dB)", "spectral density", id="dB"),
        pytest.param("frequency (Hz),density", "has no unit", id="no unit"),
        pytest.param(
            "frequency (Hz),power (V2/Hz)",
            "no column 'density'; there is: frequency, power",
            id="no column",
        ),
    ],
)
def test_bad_files_are_told_in_a_sentence(
    swift_fmu: Path, tmp_path: Path, head: str, said: str
) -> None:
    rows = "\n".join([head, *(f"{u},1.0" for u in range(1, 40))])
    with pytest.raises(BadInput) as raised:
        ff.Problem.of(ff.read_campaign(written(tmp_path, swift_fmu, rows=rows))).record  # noqa: B018
    assert said in " ".join(raised.value.args)


SOME = np.linspace(1.0, 2.0, 20)


@pytest.mark.parametrize(
    ("u", "y", "more", "said"),
    [
        pytest.param(SOME[::-1], SOME, {}, "that rise", id="falling"),
        pytest.param(SOME, -SOME, {}, "density -1 at 1 Hz", id="dB"),
        pytest.param(SOME, SOME[1:], {}, "(20,) frequencies", id="shapes"),
        pytest.param(SOME, SOME, {"averages": 0}, "averages: found 0", id="averages"),
        pytest.param(SOME - 1.5, SOME, {}, "below zero", id="negative"),
        pytest.param(SOME**2, SOME, {"window": "hann"}, "wanted even ones", id="uneven"),
        pytest.param(SOME, SOME, {"window": "kaiser"}, "'none' or 'hann'", id="window"),
        pytest.param(
            SOME,
            SOME,
            {"force": "thermal", "temperature_k": -1.0},
            "temperature_k: found -1",
            id="temperature",
        ),
        pytest.param(SOME, SOME, {"force": "coloured"}, "both, or neither", id="no force"),
        pytest.param(SOME, SOME, {"force_density": SOME}, "both, or neither", id="white"),
        pytest.param(
            SOME,
            SOME,
            {"force": "coloured", "force_density": SOME[1:]},
            "(19,) densities",
            id="force's shape",
        ),
        pytest.param(
            SOME,
            SOME,
            {"force": "coloured", "force_density": 1.5 - SOME},
            "force at 1.52631579 Hz",
            id="force in dB",
        ),
    ],
)
def test_bad_arrays_are_told_in_a_sentence(
    u: FloatArray, y: FloatArray, more: dict[str, object], said: str
) -> None:
    with pytest.raises(BadInput) as raised:
        NoiseSpectrum(u, y, **{"averages": 10, **more})  # type: ignore[arg-type]
    assert said in str(raised.value)


def test_a_drive_that_gets_energy_back_is_refused(fmu: ff.Fmu) -> None:
    """With its sign turned round the output is not what the drive pushes."""
    turned = replace(SETUP, start_values={**SETUP.start_values, "g1": -1.0})
    measured = spectrum(force="thermal", setup=turned)
    with pytest.raises(BadInput, match="lag"):
        fitted(fmu, measured)


def test_residuals_are_signed_roots_of_deviances_however_close_to_what_is_simulated() -> None:
    """Of 50 digits: the difference x - 1 - ln x cancels in doubles, and its series does not."""
    x = np.array(
        [0.3, 0.9, 1.1, 1.0 - 5e-3, 1.0 - 9e-5, 1.0 - 2e-8, 1.0 + 2e-8, 1.0 + 9e-5, 1.0 + 5e-3, 4.0]
    )
    simulated = np.full(x.size, 2.5)
    record = NoiseSpectrum(1e3 + np.arange(x.size), x * simulated, averages=100)
    with mpmath.workdps(50):
        exact = [mpmath.mpf(float(v)) / mpmath.mpf(2.5) for v in x * simulated]
        roots = [mpmath.sqrt(200 * (v - 1 - mpmath.log(v))) for v in exact]
    wanted = [float(-mpmath.sign(v - 1) * root) for v, root in zip(exact, roots, strict=True)]
    assert record.residuals(simulated) == pytest.approx(wanted, rel=1e-7, abs=1e-14)
