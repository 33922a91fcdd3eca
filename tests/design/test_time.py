"""Next measurements within a time of the laboratory: choice and information against numpy."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.design.api import NextMeasurements
from fitting.design.weighing import DesignProblem, choose, losses
from fitting.text.arrays import FloatArray
from tests.design.test_sweeps import (
    BOX,
    LARGEST,
    NEW_HZ,
    OLD,
    OLD_HZ,
    SIGMA,
    STEPS,
    TRUTH,
    amplitude,
    columns,
    written,
)

NAMES = ["theta", "d1", "d2", "plus", "slope"]
SWEEP = """[sweep]
file = "sweep.csv"
amplitude = "V peak"
scale = "fit"
set = { V = "-1 V", T = "1 K" }
[laws]"""
TONES = """[design]
target = "{target}"
tones = 1
outputs = ["q1_hybrid"]
centres = ["1000200 Hz"]
frequency_step = "200 Hz"
farthest = "600 Hz"
levels = [1]
repeats = [1, 4]
noise_floor = "2 mV"
relative_noise = 0.0
largest = "5 V"
settings = {{ V = [0, "0.4 V"], T = ["3 K"] }}
spectrum_time = "{spectrum} s"
change_time = "1 s"
"""
SWEEPS = """[design]
target = "{target}"
sweeps = {{ span = "1600 Hz", points = 41, controls = {{ V = [0, "400 mV", 1.0], T = [3] }} }}
point_time = "{point} s"
change_time = "2 s"
"""


def campaign(folder: Path, target: str, spectrum: float, point: float) -> Path:
    """That of whole sweeps, with a sweep without noise for the scale of tones."""
    path = written(folder, "each", target=target)
    clean = amplitude(TRUTH, *OLD[0], OLD_HZ) / LARGEST
    rows = [f"{float(u)!r},{float(a)!r}" for u, a in zip(OLD_HZ, clean, strict=True)]
    (folder / "sweep.csv").write_text("\n".join(["frequency (Hz),amplitude (V)", *rows]) + "\n")
    path.write_text(path.read_text().replace("[laws]", SWEEP))
    (folder / "tones.toml").write_text(TONES.format(target=target, spectrum=spectrum))
    (folder / "sweeps.toml").write_text(SWEEPS.format(target=target, point=point))
    return path


def scaled(p: FloatArray, volts: float, u: float) -> float:
    """Amplitude of a tone, V, by the scale that the sweep gives at these parameters."""
    swept = amplitude(p, *OLD[0], OLD_HZ)
    chi = swept @ (amplitude(TRUTH, *OLD[0], OLD_HZ) / LARGEST) / (swept @ swept)
    return float(chi * amplitude(p, volts, 3.0, np.array([u]))[0])


def of_tone(p: FloatArray, volts: float, u: float, averaged: int) -> FloatArray:
    """Fisher information of one tone; the scale is that of the sweep, which has no noise."""
    slopes = [
        (scaled(p + h, volts, u) - scaled(p - h, volts, u)) / (2 * np.max(h))
        for h in np.diag(STEPS)
    ]
    return np.asarray(averaged * np.outer(slopes, slopes) / SIGMA**2)


def of_sweep(p: FloatArray, place: tuple[float, float], u: FloatArray) -> FloatArray:
    """Fisher information of one sweep, its scale taken out."""
    j = columns(p, place, u)
    f = j.T @ j
    return np.asarray(f[:5, :5] - np.outer(f[:5, 5], f[:5, 5]) / f[5, 5])


def sigma(p: FloatArray, found: list[FloatArray], target: str) -> float:
    """Standard deviation of the target with the data so far and the new information."""
    total = np.diag(12.0 / BOX**2) + sum(of_sweep(p, place, OLD_HZ) for place in OLD)
    scales = np.sqrt(np.diag(total))
    inverse = np.linalg.inv((total + sum(found)) / np.outer(scales, scales))
    k = NAMES.index(target)
    return float(np.sqrt(inverse[k, k]) / scales[k])


@pytest.fixture(scope="module")
def fmu(swift_fmu: Path) -> Iterator[ff.Fmu]:
    with ff.Fmu(swift_fmu, workers=1) as made:
        yield made


def problem(seed: int) -> DesignProblem:
    """Random candidates of a few seconds each."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((2, 7, 2, 4)) * rng.choice([0.3, 1.0, 3.0], size=(1, 7, 1, 1))
    return DesignProblem(
        base=np.stack([np.eye(4)] * 2),
        gains=np.einsum("kcri,kcrj->kcij", rows, rows),
        gradients=rng.standard_normal((2, 4)),
        shown=3,
        costs=rng.integers(1, 6, size=7).astype(float),
    )


@pytest.mark.parametrize(
    "criterion",
    [
        "target",
        pytest.param("D", marks=pytest.mark.nightly),
        pytest.param("A", marks=pytest.mark.nightly),
    ],
)
def test_what_a_time_allows_is_nearly_the_best_of_all(criterion: str) -> None:
    worse = []
    for seed in range(20):
        made = problem(seed)
        chosen = choose(made, 50, criterion, 9.0)
        assert made.costs[chosen].sum() <= 9.0
        every = [
            s
            for n in range(1, 10)
            for s in itertools.combinations_with_replacement(range(7), n)
            if made.costs[list(s)].sum() <= 9.0
        ]
        sums = made.base + np.stack([made.gains[:, list(s)].sum(axis=1) for s in every])
        best = float(np.min(losses(made, sums, criterion)))
        worse.append(float(losses(made, made.information(chosen), criterion)) - best)
    assert min(worse) >= -1e-9
    assert np.max(worse) < 0.1
    assert np.mean(worse) < 0.01


def designed(fmu: ff.Fmu, path: Path, kind: str, time_s: float | None) -> NextMeasurements:
    made = ff.Problem.of([ff.read_campaign(path)], fmu)
    return ff.design(made, ff.Goal(time_s=time_s), limits=path.parent / f"{kind}.toml")


@pytest.mark.parametrize(
    ("target", "spectrum", "point", "time_s"),
    [("theta", 2.0, 1.0, 90.0), ("slope", 0.3, 0.2, 50.0), ("d1", 0.2, 0.2, 50.0)],
)
def test_tones_sweeps_and_both_are_judged_as_numpy_does(
    fmu: ff.Fmu, tmp_path: Path, target: str, spectrum: float, point: float, time_s: float
) -> None:
    path, after = campaign(tmp_path / "x", target, spectrum, point), {}
    for kind in ("tones", "sweeps"):
        made = designed(fmu, path, kind, time_s)
        design = made.design
        here = np.array(list(design.places[0].parameters.values()))
        assert design.before.at == pytest.approx(sigma(here, [], target), rel=0.02)
        said, seconds = [], 0.0
        for p in made.proposals:
            volts = float(p.settings["V"])
            if p.points:
                said.append(of_sweep(here, (volts, 3.0), NEW_HZ))
                seconds += 2.0 + 41 * point
            else:
                said.append(of_tone(here, volts, p.tones_hz[0], p.repeats))
                seconds += 1.0 + p.repeats * spectrum
        assert seconds <= time_s
        assert made.proposals[-1].expected.at == pytest.approx(sigma(here, said, target), rel=0.02)
        after[kind] = made.proposals[-1].expected.mean
    assert after["sweeps"] < after["tones"]


def test_new_sweeps_of_one_scale_share_it_and_not_with_those_so_far(
    fmu: ff.Fmu, tmp_path: Path
) -> None:
    path = written(tmp_path / "x", "shared", target="d1")
    narrow = SWEEPS.format(target="d1", point=1.0)
    files = {"wide": path.parent / "wide.toml", "narrow": path.parent / "narrow.toml"}
    files["wide"].write_text(narrow)
    files["narrow"].write_text(narrow.replace('"1600 Hz", points = 41', '"800 Hz", points = 21'))
    made = ff.Problem.of([ff.read_campaign(path)], fmu)
    grids = {"wide": NEW_HZ, "narrow": np.linspace(999_850.0, 1_000_650.0, 21)}
    for name, file in files.items():
        found = ff.design(made, ff.Goal(time_s=140.0), limits=file)
        here = np.array(list(found.design.places[0].parameters.values()))
        so_far = of_one_scale(here, [(place, OLD_HZ) for place in OLD])
        volts = [float(p.settings["V"]) for p in found.proposals]
        total = np.diag(12.0 / BOX**2) + so_far
        total += of_one_scale(here, [((v, 3.0), grids[name]) for v in volts])
        scales = np.sqrt(np.diag(total))
        inverse = np.linalg.inv(total / np.outer(scales, scales))
        wanted = float(np.sqrt(inverse[1, 1]) / scales[1])
        assert found.proposals[-1].expected.at == pytest.approx(wanted, rel=0.004)


def of_one_scale(p: FloatArray, sweeps: list[tuple[tuple[float, float], FloatArray]]) -> FloatArray:
    """Fisher information of sweeps that share a scale, which is taken out."""
    slopes = [columns(p, place, u) for place, u in sweeps]
    f = np.asarray(sum(j.T @ j for j in slopes))
    return np.asarray(f[:5, :5] - np.outer(f[:5, 5], f[:5, 5]) / f[5, 5])


def test_of_few_tones_the_pair_that_numpy_finds_best_is_chosen(fmu: ff.Fmu, tmp_path: Path) -> None:
    """Two tones are all that the time allows: 5 s each, the change to them with it."""
    path = campaign(tmp_path / "x", "d1", 1.0, 0.05)
    made = designed(fmu, path, "tones", 10.5)
    here = np.array(list(made.design.places[0].parameters.values()))
    places = itertools.product((0.0, 0.4), 1_000_200.0 + 200.0 * np.arange(-3, 4))
    pairs = itertools.combinations_with_replacement(list(places), 2)
    best = min(sigma(here, [of_tone(here, v, u, 4) for v, u in pair], "d1") for pair in pairs)
    assert sum(1.0 + p.repeats for p in made.proposals) == 10.0
    assert made.proposals[-1].expected.at == pytest.approx(best, rel=0.02)
    made.write(tmp_path / "out", report=False)
    rows = (tmp_path / "out/campaign/experiments.csv").read_text().splitlines()
    assert rows[2].split(",")[:6] == ["experiment", "u1 (Hz)", "output", "V (V)", "T (K)", "A1"]
    assert len(rows) == 3 + 2 * len(made.proposals)


def test_a_time_that_is_too_short_is_refused(fmu: ff.Fmu, tmp_path: Path) -> None:
    path = campaign(tmp_path / "x", "theta", 2.0, 1.0)
    with pytest.raises(ff.BadInput, match=r"80 s .* 86 s .* two sweeps"):
        designed(fmu, path, "sweeps", 80.0)
