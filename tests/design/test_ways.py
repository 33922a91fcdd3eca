"""Kinds of next measurements compared by one time: choice, information and files against numpy."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.campaign import bind
from fitting.design.choice import DesignProblem, choose, losses
from fitting.design.proposal import ways_lines
from fitting.design.result import read_ways
from fitting.design.ways import TOGETHER
from fitting.design.weighing import Goal, weigh
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
    """Random candidates of a few seconds each, the last three of which are measured once."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((2, 7, 2, 4)) * rng.choice([0.3, 1.0, 3.0], size=(1, 7, 1, 1))
    return DesignProblem(
        base=np.stack([np.eye(4)] * 2),
        gains=np.einsum("kcri,kcrj->kcij", rows, rows),
        gradients=rng.standard_normal((2, 4)),
        shown=3,
        costs=rng.integers(1, 6, size=7).astype(float),
        once=np.arange(7) >= 4,
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
        assert all(chosen.count(i) == 1 for i in chosen if i >= 4)
        every = [
            s
            for n in range(1, 10)
            for s in itertools.combinations_with_replacement(range(7), n)
            if made.costs[list(s)].sum() <= 9.0 and all(s.count(i) < 2 for i in s if i >= 4)
        ]
        sums = made.base + np.stack([made.gains[:, list(s)].sum(axis=1) for s in every])
        best = float(np.min(losses(made, sums, criterion)))
        worse.append(float(losses(made, made.information(chosen), criterion)) - best)
    assert min(worse) >= -1e-9
    assert np.max(worse) < 0.1
    assert np.mean(worse) < 0.01


def compared(fmu: ff.Fmu, path: Path, time_s: float) -> ff.WaysToMeasure:
    made = ff.Problem.of([ff.read_campaign(path)], fmu)
    files = {name: path.parent / f"{name}.toml" for name in ("tones", "sweeps")}
    return ff.ways(made, ff.Goal(time_s=time_s), limits=files)


@pytest.mark.parametrize(
    ("target", "spectrum", "point", "time_s"),
    [("theta", 2.0, 1.0, 90.0), ("slope", 0.3, 0.2, 50.0), ("d1", 0.2, 0.2, 50.0)],
)
def test_tones_sweeps_and_both_are_judged_as_numpy_does(
    fmu: ff.Fmu, tmp_path: Path, target: str, spectrum: float, point: float, time_s: float
) -> None:
    found = compared(fmu, campaign(tmp_path / "x", target, spectrum, point), time_s)
    design = found.by_name["tones"]["tones"].design
    here = np.array(list(design.places[0].parameters.values()))
    assert found.ways.before.at == pytest.approx(sigma(here, [], target), rel=0.02)
    for way in found.ways.ways:
        said, seconds = [], 0.0
        for kind, made in found.by_name[way.name].items():
            assert len(made.proposals) == way.counts[kind]
            for p in made.proposals:
                volts = float(p.settings["V"])
                if p.points:
                    said.append(of_sweep(here, (volts, 3.0), NEW_HZ))
                    seconds += 2.0 + 41 * point
                else:
                    said.append(of_tone(here, volts, p.tones_hz[0], p.repeats))
                    seconds += 1.0 + p.repeats * spectrum
            assert made.proposals[-1].expected.at == pytest.approx(way.expected.at, rel=1e-9)
        assert way.takes_s == pytest.approx(seconds)
        assert way.takes_s <= time_s
        assert way.expected.at == pytest.approx(sigma(here, said, target), rel=0.02)
    assert [way.name for way in found.ways.ways] == [TOGETHER, "sweeps", "tones"]
    means = [way.expected.mean for way in found.ways.ways]
    assert means == sorted(means)
    assert set(found.ways.best.counts) == {"tones", "sweeps"}


def test_what_sweeps_of_one_kind_share_is_theirs_alone(fmu: ff.Fmu, tmp_path: Path) -> None:
    """Sweeps of a kind have one scale, those of the other kind and those so far another each."""
    path = written(tmp_path / "x", "shared", target="d1")
    narrow = SWEEPS.format(target="d1", point=1.0)
    files = {"wide": path.parent / "wide.toml", "narrow": path.parent / "narrow.toml"}
    files["wide"].write_text(narrow)
    files["narrow"].write_text(narrow.replace('"1600 Hz", points = 41', '"800 Hz", points = 21'))
    made = ff.Problem.of([ff.read_campaign(path)], fmu)
    found = ff.ways(made, ff.Goal(time_s=140.0), limits=files)
    design = found.by_name["wide"]["wide"].design
    here = np.array(list(design.places[0].parameters.values()))
    grids = {"wide": NEW_HZ, "narrow": np.linspace(999_850.0, 1_000_650.0, 21)}
    limits = [ff.limits(made, file) for file in files.values()]
    bound = bind(made.campaigns[0], fmu.variables)
    weighed = weigh([bound], fmu.workers, limits, Goal("d1", "target"))
    # behind five parameters and the scale so far stand that of one kind and that of the other
    for k, each in enumerate(weighed):
        diagonals = np.diagonal(each.problem.gains, axis1=2, axis2=3)
        assert np.all(diagonals[..., 6 + k] > 0.0)
        assert np.all(diagonals[..., 7 - k] == 0.0)
    so_far = of_one_scale(here, [(place, OLD_HZ) for place in OLD])
    assert TOGETHER in found.by_name
    for way in found.ways.ways:
        total = np.diag(12.0 / BOX**2) + so_far
        for kind, chosen in found.by_name[way.name].items():
            volts = [float(p.settings["V"]) for p in chosen.proposals]
            total += of_one_scale(here, [((v, 3.0), grids[kind]) for v in volts])
        scales = np.sqrt(np.diag(total))
        inverse = np.linalg.inv(total / np.outer(scales, scales))
        wanted = float(np.sqrt(inverse[1, 1]) / scales[1])
        assert way.expected.at == pytest.approx(wanted, rel=0.004)


def of_one_scale(p: FloatArray, sweeps: list[tuple[tuple[float, float], FloatArray]]) -> FloatArray:
    """Fisher information of sweeps that share a scale, which is taken out."""
    slopes = [columns(p, place, u) for place, u in sweeps]
    f = np.asarray(sum(j.T @ j for j in slopes))
    return np.asarray(f[:5, :5] - np.outer(f[:5, 5], f[:5, 5]) / f[5, 5])


def test_of_few_tones_the_pair_that_numpy_finds_best_is_chosen(fmu: ff.Fmu, tmp_path: Path) -> None:
    """Two tones are all that the time allows: 5 s each, the change to them with it."""
    path = campaign(tmp_path / "x", "d1", 1.0, 0.05)
    found = compared(fmu, path, 10.5)
    [design] = [made.design for made in found.by_name["tones"].values()]
    here = np.array(list(design.places[0].parameters.values()))
    places = itertools.product((0.0, 0.4), 1_000_200.0 + 200.0 * np.arange(-3, 4))
    pairs = itertools.combinations_with_replacement(list(places), 2)
    best = min(sigma(here, [of_tone(here, v, u, 4) for v, u in pair], "d1") for pair in pairs)
    [way] = [way for way in found.ways.ways if way.name == "tones"]
    assert way.takes_s == 10.0
    assert way.expected.at == pytest.approx(best, rel=0.02)


def test_each_way_is_a_plan_and_the_table_tells_them_apart(fmu: ff.Fmu, tmp_path: Path) -> None:
    found = compared(fmu, campaign(tmp_path / "x", "slope", 0.3, 0.2), 50.0)
    table, *campaigns = found.write(tmp_path / "out", report=False)
    assert read_ways(table) == found.ways
    names = ["tones/campaign/campaign.toml", "sweeps/campaign/campaign.toml"]
    assert campaigns == [tmp_path / "out" / TOGETHER / name for name in names]
    tones, sweeps = (path.parent for path in campaigns)
    rows = (tones / "experiments.csv").read_text().splitlines()
    heads = ["experiment", "u1 (MHz)", "output", "V (V)", "T (K)", "A1"]
    assert rows[2].split(",")[:6] == heads
    assert len(rows) == 3 + 2 * found.ways.best.counts["tones"]
    assert len((sweeps / "sweeps.csv").read_text().splitlines()) == 3 + 42 * 2
    for name in ("tones", "sweeps"):
        assert (tmp_path / "out" / name / "campaign/campaign.toml").is_file()
    said = " ".join(" ".join(ways_lines(found.ways, verbose=True)).split())
    assert " 50 s " in said
    assert re.search(r"tones: .*\b0\.3 s.*\b1 s\b", said)
    assert re.search(r'"together" .*\bslope\b', said)


@pytest.mark.parametrize(
    ("edit", "time_s", "complaint"),
    [
        ("", None, "time"),
        ("", 80.0, "sweeps: 80 s .* 86 s "),
        ('criterion = "D"', 90.0, "theta by D, .*theta by target"),
    ],
)
def test_what_cannot_be_compared_is_said(
    fmu: ff.Fmu, tmp_path: Path, edit: str, time_s: float | None, complaint: str
) -> None:
    path = campaign(tmp_path / "x", "theta", 2.0, 1.0)
    sweeps = path.parent / "sweeps.toml"
    sweeps.write_text(sweeps.read_text() + edit)
    made = ff.Problem.of([ff.read_campaign(path)], fmu)
    files = {name: path.parent / f"{name}.toml" for name in ("tones", "sweeps")}
    with pytest.raises(ff.BadInput, match=complaint):
        ff.ways(made, ff.Goal(time_s=time_s), limits=files)
    with pytest.raises(ff.BadInput, match="found tones"):
        ff.ways(made, limits={"tones": files["tones"]})
