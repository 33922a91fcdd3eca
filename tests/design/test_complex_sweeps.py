"""Whole complex sweeps as next measurements: information and choice against numpy, their files."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.design.information import Rows
from fitting.text.arrays import ComplexArray, FloatArray
from tests.design.test_sweeps import (
    BOX,
    CAMPAIGN,
    LARGEST,
    NEW_HZ,
    OLD,
    OLD_HZ,
    SIGMA,
    STEPS,
    TABLE,
    TRUTH,
    phasor,
    proposed,
)

AMPLITUDES = CAMPAIGN[CAMPAIGN.index("[control_sweep]") : CAMPAIGN.index("[laws]")]
QUADRATURES = """[complex_control_sweep]
file = "spectra.csv"
controls = ["V", "T"]
{keys}
"""
NAMES = ["theta", "d1", "d2", "plus", "slope", "delay"]
DELAY_S = 4e-4
GAIN, GROUND = np.exp(0.7j) / LARGEST, np.array([0.15 - 0.1j, 0.05j])


@dataclass(frozen=True)
class Wire:
    """How sweeps stand in what is seen: keys of the table, background terms, and what is shared."""

    keys: str
    beside: int = 0
    scale: str = "own"
    fitted: bool = True

    @property
    def delay_s(self) -> float:
        return DELAY_S if self.fitted else 0.0


PLAIN = Wire('scale = "own"', fitted=False)
CABLE = Wire('delay = "fit"\nbackground = "slope"', beside=2)
SHARED = Wire('scale = "shared"\ndelay = "fit"\nbackground = "constant"', 1, "shared")
RESTARTED = Wire('scale = "shared"\nrestarted = true', scale="restarted", fitted=False)


def beside(p: FloatArray, place: tuple[float, float], u: FloatArray) -> ComplexArray:
    """Response, constant and slope behind the cable, (n, 3); the delay is the last of p.

    The slope is one over half of the sweeps so far.
    """
    away = u - 0.5 * (u[0] + u[-1])
    terms = [phasor(p[:5], *place, u), np.ones(u.size), away / (0.5 * np.ptp(OLD_HZ))]
    return np.asarray(np.stack(terms, axis=1) * np.exp(-2j * np.pi * away * p[5])[:, None])


def seen(wire: Wire, place: tuple[float, float], u: FloatArray) -> ComplexArray:
    """What a lock-in without noise reads."""
    c = np.array([GAIN, *GROUND[: wire.beside]])
    return np.asarray(beside(np.append(TRUTH, wire.delay_s), place, u)[:, : c.size] @ c)


def rows(values: ComplexArray) -> FloatArray:
    return np.concatenate([values.real, values.imag]) / SIGMA


def columns(p: FloatArray, wire: Wire, place: tuple[float, float], u: FloatArray) -> FloatArray:
    """Derivatives of a sweep's rows by parameters and delay, by gain and background, and turned.

    Gain and background are those that p needs to follow the truth.
    """
    count = 1 + wire.beside
    here = beside(p, place, u)[:, :count]
    sizes = np.linalg.norm(here, axis=0)
    c = np.linalg.lstsq(here / sizes, seen(wire, place, u), rcond=None)[0] / sizes
    steps = np.append(STEPS, 1e-8)
    by_p = [
        (beside(p + h, place, u) - beside(p - h, place, u))[:, :count] @ c / (2 * np.max(h))
        for h in np.diag(steps)
    ]
    pairs = [turn * c[k] * here[:, k] for k in range(count) for turn in (1, 1j)]
    return np.column_stack([rows(each) for each in (*by_p, *pairs)])


def sigmas(p: FloatArray, chosen: tuple[float, ...], wire: Wire) -> FloatArray:
    """Standard deviations of the parameters with new sweeps at some voltages, every gain free."""
    sweeps = [(place, OLD_HZ, 0) for place in OLD] + [((v, 3.0), NEW_HZ, 1) for v in chosen]
    of_each = 2 * (1 + wire.beside)
    total = np.zeros((6 + of_each * len(sweeps),) * 2)
    for k, (place, u, group) in enumerate(sweeps):
        first = len(OLD) * group
        at = np.arange(of_each) + 6 + of_each * k
        if wire.scale != "own":
            at[0] = 6 + of_each * first
        if wire.scale == "shared":
            at[1] = 7 + of_each * first
        wide = np.zeros((2 * u.size, total.shape[0]))
        wide[:, [*range(6), *at]] = columns(p, wire, place, u)
        total += wide.T @ wide
    box = np.append(BOX, 4.0 / np.ptp(OLD_HZ))
    total[:6, :6] += np.diag(12.0 / box**2)
    used = np.flatnonzero(np.diag(total) > 0.0)
    if not wire.fitted:
        used = used[used != 5]
    scales = np.sqrt(np.diag(total)[used])
    inverse = np.linalg.inv(total[np.ix_(used, used)] / np.outer(scales, scales))
    return np.asarray(np.sqrt(np.diag(inverse)) / scales)


def written(
    folder: Path, wire: Wire, *, noise: str = f'sigma = "{SIGMA} V"', target: str = "theta"
) -> Path:
    """A campaign of three complex sweeps, and its limits beside it."""
    rng = np.random.default_rng(4)
    lines = ["V (V),T (K),frequency (Hz),X (V),Y (V)"]
    for place in OLD:
        scatter = rng.standard_normal((2, OLD_HZ.size))
        values = seen(wire, place, OLD_HZ) + SIGMA * (scatter[0] + 1j * scatter[1])
        for u, y in zip(map(float, OLD_HZ), map(complex, values), strict=True):
            lines.append(f"{place[0]},{place[1]},{u!r},{y.real!r},{y.imag!r}")
    folder.mkdir(exist_ok=True)
    (folder / "spectra.csv").write_text("\n".join(lines) + "\n")
    (folder / "design.toml").write_text(TABLE.format(target=target))
    path = folder / "campaign.toml"
    table = QUADRATURES.format(keys=f"{wire.keys}\n{noise}")
    path.write_text(CAMPAIGN.replace(AMPLITUDES, table))
    return path


@pytest.fixture(scope="module")
def fmu(swift_fmu: Path) -> Iterator[ff.Fmu]:
    with ff.Fmu(swift_fmu, workers=1) as made:
        yield made


def test_a_lorentzian_with_its_phase_says_what_its_fisher_information_says() -> None:
    """S = 1/(1 + iy), y = 2 (f - f0)/w; a complex gain of its own takes half of each."""
    y = np.linspace(-400.0, 400.0, 80_001)
    line = np.asarray(1.0 / (1.0 + 1j * y), dtype=complex)
    by_x = np.column_stack([2j * line**2, 1j * y * line**2])  # f0 and w, in widths
    made = Rows(
        values=line[None],
        by_x=by_x[None],
        inside=np.column_stack([line, 1j * line])[None],
        shared=np.zeros((1, y.size, 1)),
        errors=np.zeros((1, y.size, 0)),
    )
    [found] = made.information(np.full((1, y.size), 1e-3))
    # integrals over y of |dS|^2, 2 pi and pi/2, less |<S, dS>|^2/<S, S>, pi and pi/4
    density = 1e6 / 0.01
    assert found == pytest.approx(density * np.diag([np.pi, np.pi / 4, 0.0]), rel=5e-3, abs=1e3)


@pytest.mark.parametrize(
    ("wire", "target"),
    [
        (PLAIN, "theta"),
        (CABLE, "d2"),
        (CABLE, "delay"),
        (SHARED, "theta"),
        (RESTARTED, "d1"),
    ],
)
def test_sweeps_with_phases_are_chosen_and_judged_as_numpy_does(
    fmu: ff.Fmu, tmp_path: Path, wire: Wire, target: str
) -> None:
    found = proposed(fmu, written(tmp_path / "x", wire, target=target)).design
    index = NAMES.index(target)
    here = np.append(list(found.places[0].parameters.values()), [0.0] * (not wire.fitted))

    def sigma(chosen: tuple[float, ...]) -> float:
        """No more than the spread of the target over points that fit as well."""
        value = float(sigmas(here, chosen, wire)[index])
        return float(value / np.hypot(1.0, value / found.spread))

    volts = tuple(float(p.settings["V"]) for p in found.proposals)
    assert found.amplitude_unit == "V"
    assert all(p.settings["T"] == 3.0 and p.points == 41 for p in found.proposals)
    assert found.before.at == pytest.approx(sigma(()), rel=0.02)
    assert found.proposals[0].expected.at == pytest.approx(sigma(volts[:1]), rel=0.02)
    assert found.proposals[-1].expected.at == pytest.approx(sigma(volts), rel=0.02)
    pairs = itertools.combinations((0.0, 0.4, 1.0, 1.6), 2)
    assert sigma(volts) < 1.001 * min(map(sigma, pairs))
    for p in found.proposals:
        top = np.max(np.abs(seen(wire, (float(p.settings["V"]), 3.0), NEW_HZ)))
        assert p.peaks_v[0] == pytest.approx(top, rel=0.02)
        assert p.sigmas_v[0] == pytest.approx(SIGMA, rel=1e-6)


def test_the_campaign_asks_for_both_quadratures_and_is_read_when_they_are_filled_in(
    fmu: ff.Fmu, tmp_path: Path
) -> None:
    made = proposed(fmu, written(tmp_path / "old", CABLE))
    made.write(tmp_path / "next", report=False)
    path = tmp_path / "next/campaign/campaign.toml"
    with pytest.raises(ff.BadInput, match=r"sweeps\.csv: row 5, column 'X'"):
        ff.read_campaign(path)
    sweeps = path.with_name("sweeps.csv")
    lines = sweeps.read_text().splitlines()
    assert lines[0].startswith("# ")
    assert "X and Y" in lines[0]
    head = next(csv.reader([lines[2]]))
    assert head == ["V (V)", "frequency (Hz)", "X (V)", "Y (V)"]
    filled = []
    for first in range(4, len(lines), 42):
        mine = lines[first : first + 41]
        u = np.array([float(line.split(",")[1]) for line in mine])
        assert u == pytest.approx(NEW_HZ)
        volts = float(mine[0].split(",")[0])
        for line, y in zip(mine, map(complex, seen(CABLE, (volts, 3.0), u)), strict=True):
            assert line.endswith(",,")
            filled.append(f"{line[:-2]},{y.real!r},{y.imag!r}")
    assert len(filled) == 2 * 41
    sweeps.write_text("\n".join([lines[2], *filled]) + "\n")
    again = ff.Problem.of([ff.read_campaign(path)], fmu)
    assert again.residuals(again.start).size == 2 * 82
    assert again.names[-1] == "delay"
    values = np.append(TRUTH, DELAY_S)
    assert np.max(np.abs(again.residuals(values))) < 1e-4
    wanted = ff.limits(again).sweeps
    assert wanted is not None
    assert dict(wanted.controls) == {"V": (0.0, 0.4, 1.0, 1.6)}


def test_noise_is_what_the_sweeps_leave_about_a_smooth_curve_or_asked_for(
    fmu: ff.Fmu, tmp_path: Path
) -> None:
    path = written(tmp_path / "x", CABLE, noise="")
    problem = ff.Problem.of([ff.read_campaign(path)], fmu)
    found = ff.limits(problem, path.parent / "design.toml")
    assert found.noise_floor_v == pytest.approx(SIGMA, rel=0.3)
    assert found.relative_noise == 0.0
    short = written(tmp_path / "y", PLAIN, noise='range = ["999.7 kHz", "1000.6 kHz"]')
    problem = ff.Problem.of([ff.read_campaign(short)], fmu)
    with pytest.raises(ff.BadInput, match=r"noise_floor: .*\[complex_control_sweep\]"):
        ff.limits(problem, short.parent / "design.toml")
