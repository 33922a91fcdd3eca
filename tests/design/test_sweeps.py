"""Whole sweeps as next measurements: their information and choice against numpy, their files."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ive

import fitting as ff
from fitting.design.api import NextMeasurements, screen_lines
from fitting.design.information import Rows
from fitting.text.arrays import ComplexArray, FloatArray
from tests.support.modal_workers import phasors

CAMPAIGN = """
title = "A crossing"
[fmu]
model = "CoupledOscillator"
[fmu.start]
periodic_start = true
A2 = 0.0
eta_minus = "1000400 Hz"
[observe]
output = "q1_hybrid"
steady_start = true
[drive]
kind = "tones"
frequencies = ["u1"]
amplitudes = ["A1"]
[control_sweep]
file = "spectra.csv"
controls = ["V", "T"]
amplitude = "V peak"
sigma = "0.002 V"
scale = "{scale}"
[laws]
eta_plus = "plus + slope*V + warm*T"
[constants]
warm = "1 Hz/K"
[[parameters]]
name = "theta"
lower = 1.6
upper = 3.0
start = 2.2
[[parameters]]
name = "d1"
lower = "20 Hz"
upper = "400 Hz"
start = "100 Hz"
[[parameters]]
name = "d2"
lower = "20 Hz"
upper = "400 Hz"
start = "60 Hz"
[[parameters]]
name = "plus"
unit = "Hz"
lower = 999000
upper = 1001000
start = 1000000
[[parameters]]
name = "slope"
unit = "Hz/V"
lower = 0
upper = 1000
start = 400
[continuation]
misfit = "squares"
"""
TABLE = """
[design]
target = "{target}"
number = 2
sweeps = {{ span = "1600 Hz", points = 41, controls = {{ V = [0, "400 mV", 1.0, 1.6], T = [3] }} }}
"""
TRUTH = np.array([2.2, 100.0, 60.0, 1.0e6, 400.0])
STEPS = np.array([1e-4, 1e-2, 1e-2, 1e-2, 1e-2])
BOX = np.array([1.4, 380.0, 380.0, 2000.0, 1000.0])
NEW_HZ = np.linspace(999_450.0, 1_001_050.0, 41)
OLD_HZ = np.linspace(999_600.0, 1_000_900.0, 61)
OLD = ((-1.0, 1.0), (-0.4, 2.0), (0.2, 3.0))
SIGMA = 0.002


def amplitude(p: FloatArray, volts: float, kelvin: float, u_hz: FloatArray) -> FloatArray:
    """|q1| of the two modes in closed form."""
    return np.abs(phasor(p, volts, kelvin, u_hz))


def phasor(p: FloatArray, volts: float, kelvin: float, u_hz: FloatArray) -> ComplexArray:
    """q1 of the two modes in closed form."""
    theta, d1, d2, plus, slope = map(float, p)
    eta = {"eta_plus": plus + slope * volts + kelvin, "eta_minus": 1_000_400.0}
    return phasors({"theta": theta, "d1": d1, "d2": d2, **eta}, u_hz, 0)


LARGEST = max(np.max(amplitude(TRUTH, *place, OLD_HZ)) for place in OLD)


def seen(p: FloatArray, log_scale: float, place: tuple[float, float], u: FloatArray) -> FloatArray:
    """Mean magnitude under noise of amplitudes whose largest is 1 V (Rice), in units of it."""
    q = (np.exp(log_scale) * amplitude(p, *place, u) / LARGEST / SIGMA) ** 2 / 4.0
    return np.asarray(np.sqrt(np.pi / 2) * ((1 + 2 * q) * ive(0, q) + 2 * q * ive(1, q)))


def columns(p: FloatArray, place: tuple[float, float], u: FloatArray) -> FloatArray:
    """Derivatives of a sweep's rows by the parameters and by the logarithm of its scale, (m, 6)."""
    steps = np.diag(STEPS)
    by_p = [(seen(p + h, 0, place, u) - seen(p - h, 0, place, u)) / 2 for h in steps]
    by_scale = (seen(p, 1e-4, place, u) - seen(p, -1e-4, place, u)) / 2e-4
    return np.column_stack([*(c / s for c, s in zip(by_p, STEPS, strict=True)), by_scale])


def sigmas(p: FloatArray, chosen: tuple[float, ...], scale: str) -> FloatArray:
    """Standard deviations of the parameters with new sweeps at some voltages, every scale free."""
    sweeps = [(place, OLD_HZ, 0) for place in OLD] + [((v, 3.0), NEW_HZ, 1) for v in chosen]
    group = range(len(sweeps)) if scale == "each" else [g for _, _, g in sweeps]
    total = np.zeros((5 + len(sweeps),) * 2)
    for (place, u, _), g in zip(sweeps, group, strict=True):
        j = columns(p, place, u)
        wide = np.zeros((u.size, total.shape[0]))
        wide[:, :5], wide[:, 5 + g] = j[:, :5], j[:, 5]
        total += wide.T @ wide
    total[:5, :5] += np.diag(12.0 / BOX**2)
    used = np.flatnonzero(np.diag(total) > 0.0)
    return np.sqrt(np.diag(np.linalg.inv(total[np.ix_(used, used)]))[:5])


def written(folder: Path, scale: str = "shared", table: str = "", target: str = "theta") -> Path:
    """A campaign of three spectra, and its limits beside it."""
    rng = np.random.default_rng(3)
    rows = ["V (V),T (K),frequency (Hz),amplitude (V)"]
    for place in OLD:
        clean = amplitude(TRUTH, *place, OLD_HZ) / LARGEST
        noise = SIGMA * (rng.standard_normal(61) + 1j * rng.standard_normal(61))
        pairs = zip(OLD_HZ, np.abs(clean + noise), strict=True)
        rows += [f"{place[0]},{place[1]},{u!r},{a!r}" for u, a in map(tuple_of_floats, pairs)]
    folder.mkdir(exist_ok=True)
    (folder / "spectra.csv").write_text("\n".join(rows) + "\n")
    (folder / "design.toml").write_text(table or TABLE.format(target=target))
    path = folder / "campaign.toml"
    path.write_text(CAMPAIGN.format(scale=scale))
    return path


def tuple_of_floats(values: tuple[float, float]) -> tuple[float, float]:
    return float(values[0]), float(values[1])


@pytest.fixture(scope="module")
def fmu(swift_fmu: Path) -> Iterator[ff.Fmu]:
    with ff.Fmu(swift_fmu, workers=1) as made:
        yield made


def proposed(fmu: ff.Fmu, path: Path) -> NextMeasurements:
    problem = ff.Problem.of([ff.read_campaign(path)], fmu)
    return ff.design(problem, limits=path.parent / "design.toml")


@pytest.mark.parametrize("scale", ["each", "shared"])
def test_a_lorentzian_of_known_noise_says_what_its_fisher_information_says(scale: str) -> None:
    """L = a/sqrt(1 + y^2), y = 2 (f - f0)/w: with all noise alike the centre stands apart."""
    y = np.linspace(-40.0, 40.0, 4001)
    line = 1.0 / np.sqrt(1.0 + y**2)
    by_x = np.column_stack([2.0 * y * line**3, y**2 * line**3])  # f0 and w, in widths
    own, none = line[None, :, None], np.zeros((1, 4001, 0))
    rows = Rows(
        values=line[None],
        by_x=by_x[None],
        inside=own if scale == "each" else none,
        shared=np.concatenate([0.0 * own, own if scale == "shared" else none], axis=-1),
        errors=none,
    )
    [found] = rows.information(np.full((1, 4001), 1e-3))
    # integrals over y from -inf to inf of 4 y^2/(1+y^2)^3, y^4/(1+y^2)^3, y^2/(1+y^2)^2, 1/(1+y^2)
    centre, width, mixed, size = np.pi / 2, 3 * np.pi / 8, np.pi / 2, np.pi
    density = 1e6 / 0.02
    assert found[0, 0] == pytest.approx(density * centre, rel=1e-3)
    if scale == "each":
        assert found[1, 1] == pytest.approx(density * (width - mixed**2 / size), rel=0.05)
        return
    assert found[1, 1] == pytest.approx(density * width, rel=0.05)
    assert found[1, 3] == pytest.approx(density * mixed, rel=0.05)
    assert found[3, 3] == pytest.approx(density * size, rel=0.05)
    assert np.all(found[2] == 0.0)


@pytest.mark.parametrize(("scale", "target"), [("shared", "theta"), ("each", "d2")])
def test_spectra_of_a_crossing_are_chosen_and_judged_as_numpy_does(
    fmu: ff.Fmu, tmp_path: Path, scale: str, target: str
) -> None:
    found = proposed(fmu, written(tmp_path / scale, scale, target=target)).design
    index = ["theta", "d1", "d2", "plus", "slope"].index(target)
    here = np.array(list(found.places[0].parameters.values()))

    def sigma(chosen: tuple[float, ...]) -> float:
        return float(sigmas(here, chosen, scale)[index])

    volts = tuple(float(p.settings["V"]) for p in found.proposals)
    assert all(p.settings["T"] == 3.0 and p.points == 41 for p in found.proposals)
    assert found.before.at == pytest.approx(sigma(()), rel=0.02)
    assert found.proposals[-1].expected.at == pytest.approx(sigma(volts), rel=0.02)
    pairs = itertools.combinations((0.0, 0.4, 1.0, 1.6), 2)
    best = min(map(sigma, pairs))
    assert sigma(volts) < 1.001 * best
    assert found.improvement > 1.2
    last = {float(k.settings["V"]): k.beside for k in found.kinds}
    assert all(last[v] == found.proposals[-1].expected.mean for v in volts)


def test_the_campaign_asks_for_the_sweeps_and_is_read_when_they_are_filled_in(
    fmu: ff.Fmu, tmp_path: Path
) -> None:
    made = proposed(fmu, written(tmp_path / "old"))
    made.write(tmp_path / "next", report=False)
    path = tmp_path / "next/campaign/campaign.toml"
    with pytest.raises(ff.BadInput, match=r"sweeps\.csv: row 5, column 'amplitude'"):
        ff.read_campaign(path)
    sweeps = path.with_name("sweeps.csv")
    lines = sweeps.read_text().splitlines()
    head = next(csv.reader([lines[2]]))
    assert head == ["V (V)", "frequency (Hz)", "amplitude (V)"]
    filled = []
    for line in lines[3:]:
        if not line.startswith("#"):
            volts, u, _ = map(str, line.split(","))
            [top] = amplitude(TRUTH, float(volts), 3.0, np.array([float(u)])) / LARGEST
            filled.append(f"{volts},{u},{float(top)!r}")
    assert len(filled) == 2 * 41
    sweeps.write_text("\n".join([lines[2], *filled]) + "\n")
    both = ff.Problem.of([ff.read_campaign(tmp_path / "old/campaign.toml")], fmu)
    again = ff.Problem.of([ff.read_campaign(path)], fmu)
    rows = [p.residuals(p.start).size for p in (both, again)]
    assert rows == [183, 82]
    # the limits went along: a constant that no new sweep changes is no control any more
    wanted = ff.limits(again).sweeps
    assert wanted is not None
    assert dict(wanted.controls) == {"V": (0.0, 0.4, 1.0, 1.6)}
    assert wanted.points == 41
    said = " ".join(screen_lines(made.design, verbose=True)).replace("\u00a0", " ")
    assert "41 points" in said
    assert "1.6 kHz" in said
    assert len((tmp_path / "next/design.csv").read_text().splitlines()) == 4


def test_columns_of_the_old_file_do_not_go_along(fmu: ff.Fmu, tmp_path: Path) -> None:
    """The next file has heads of its own: it could not be read by those of the first."""
    path = written(tmp_path / "old")
    spectra, campaign = path.with_name("spectra.csv"), path.read_text()
    spectra.write_text(spectra.read_text().replace("amplitude (V)", "mag (V)", 1))
    named = '[control_sweep.columns]\namplitude = "mag"\n[[parameters]]'
    path.write_text(campaign.replace("[[parameters]]", named, 1))
    proposed(fmu, path).write(tmp_path / "next", report=False)
    made = tmp_path / "next/campaign/campaign.toml"
    assert "mag" not in made.read_text()
    with pytest.raises(ff.BadInput, match=r"row 5, column 'amplitude'"):
        ff.read_campaign(made)


def test_of_a_map_alone_sweeps_are_proposed_where_it_was_measured(
    fmu: ff.Fmu, tmp_path: Path
) -> None:
    problem = ff.Problem.of([ff.read_campaign(written(tmp_path / "x"))], fmu)
    found = ff.limits(problem).sweeps
    assert found is not None
    assert found.controls == {"V": (-1.0, -0.4, 0.2), "T": (1.0, 2.0, 3.0)}
    assert found.points == OLD_HZ.size
    assert found.span_hz == pytest.approx(np.ptp(OLD_HZ))


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        ("sweeps = { controls = { U = [0, 1] } }", "'U' .* V, T"),
        ("sweeps = { controls = { V = [1] } }", "one place"),
        ("sweeps = { points = 20 }", "key 'controls'"),
        ('sweeps = { controls = { V = [0, "1 K"] } }', "controls. V: .*'K'.*'V'"),
        ("levels = [1, 10]\nsweeps = { controls = { V = [0, 1] } }", "levels: "),
        ("sweeps = { points = 3, controls = { V = [0, 1] } }", "3 points.* 8 "),
        ("number = 1\nsweeps = { controls = { V = [0, 1] } }", "found 1, .*2 to 50"),
        (
            'centres = ["1 MHz"]\nfrequency_step = "200 Hz"\nleast_spacing = "200 Hz"\n'
            'farthest = "600 Hz"',
            "largest: wanted ",
        ),
    ],
)
def test_what_is_wrong_is_said_in_a_sentence(
    fmu: ff.Fmu, tmp_path: Path, table: str, complaint: str
) -> None:
    path = written(tmp_path / "x", table=f"[design]\n{table}\n")
    problem = ff.Problem.of([ff.read_campaign(path)], fmu)
    with pytest.raises(ff.BadInput, match=complaint) as caught:
        ff.limits(problem, path.parent / "design.toml")
    assert "\n" not in str(caught.value)


def test_noise_that_nobody_tells_is_asked_for(fmu: ff.Fmu, tmp_path: Path) -> None:
    path = written(tmp_path / "x")
    path.write_text(
        path.read_text().replace('sigma = "0.002 V"', 'range = ["999.7 kHz", "1000.3 kHz"]')
    )
    problem = ff.Problem.of([ff.read_campaign(path)], fmu)
    with pytest.raises(ff.BadInput, match=r"noise_floor: .*\[control_sweep\]"):
        ff.limits(problem, path.parent / "design.toml")
    limits = TABLE.format(target="theta") + 'noise_floor = "3 mV"\n'
    (path.parent / "design.toml").write_text(limits)
    assert ff.limits(problem, path.parent / "design.toml").noise_floor_v == pytest.approx(3e-3)
