"""Recordings over time as next measurements, against closed forms; their files; statistics."""

from __future__ import annotations

import csv
import itertools
import json
import math
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.cli.main import main
from fitting.design.api import NextMeasurements, screen_lines
from fitting.design.candidates import RecordingCandidates
from fitting.design.information import DataSoFar, Place
from fitting.design.limits import Limits, TraceLimits
from fitting.text.arrays import ComplexArray, FloatArray
from tests.support.cfmu_build import build_c_fmu, build_lag_fmu
from tests.support.demodulated import demodulated
from tests.support.linear_traces import held_response, string

MASS, C, K = 1e-3, 5e-2, 4e3
TRUTH = np.array([C, K])
RATE = C / (2.0 * MASS)
SIGMA, SIZE, PHASE = 1e-5, 1e-3, 0.7
OLD_S, STEP_S = 0.04, 1e-4
LENGTHS, STEPS = (0.01, 0.04, 0.32), (1e-4, 2e-4, 2.5e-4)
#: Box of damping and stiffness, as if uniform.
BOX = np.array([0.19, 1000.0])
CAMPAIGN = """
title = "A beam that rings"
[fmu]
file = "{fmu}"
[observe]
output = "displacement"
[[trace]]
file = "ring.csv"
input = "force"
start = "unknown"
{noise}
[[parameters]]
name = "damping"
lower = 0.01
upper = 0.2
start = 0.04
[[parameters]]
name = "stiffness"
lower = 3.5e3
upper = 4.5e3
start = 3.95e3
{design}
"""
DESIGN = """[design]
target = "{target}"
number = {number}
{more}
[design.traces]
lengths = ["10 ms", "40 ms", "0.32 s"]
spacings = ["0.1 ms", "0.2 ms", "0.25 ms"]
samples = {samples}
"""


def designed(*, target: str, number: int, samples: int, more: str = "") -> str:
    return DESIGN.format(target=target, number=number, samples=samples, more=more)


STATED = f'sigma = "{SIGMA} m"'


@pytest.fixture(scope="module")
def beam(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ff.Fmu]:
    with ff.Fmu(build_c_fmu(tmp_path_factory.mktemp("beam")), workers=1) as fmu:
        yield fmu


def decays(p: FloatArray, t: FloatArray) -> FloatArray:
    """The two free decays of m x'' + c x' + k x = 0, (n, 2)."""
    c, k = p
    rate = c / (2.0 * MASS)
    turned = np.exp((-rate + 1j * np.sqrt(k / MASS - rate**2)) * t)
    return np.stack([turned.real, turned.imag], axis=1)


def ring(t: FloatArray) -> FloatArray:
    """What the recorder would see without noise."""
    return np.asarray(SIZE * decays(TRUTH, t) @ [np.cos(PHASE), -np.sin(PHASE)])


def informed(times: FloatArray) -> FloatArray:
    """Fisher information (2, 2) of damping and stiffness, the start of the decay unknown."""
    seen = decays(TRUTH, times)
    c = np.linalg.lstsq(seen, ring(times), rcond=None)[0]
    shifts = np.diag([1e-6, 1e-3])
    by_p = [
        (decays(TRUTH + h, times) - decays(TRUTH - h, times)) @ c / (2.0 * np.max(h))
        for h in shifts
    ]
    columns = np.stack(by_p, axis=1)
    left = columns - seen @ np.linalg.lstsq(seen, columns, rcond=None)[0]
    return np.asarray(left.T @ left) / SIGMA**2


def expected(*records: FloatArray) -> FloatArray:
    """Standard deviations of damping and stiffness from records at these times, within the box."""
    total = sum((informed(t) for t in records), np.diag(12.0 / BOX**2))
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(total))))


def times(length_s: float, step_s: float) -> FloatArray:
    return np.asarray(np.arange(round(length_s / step_s) + 1) * step_s, dtype=float)


OLD_T = times(OLD_S, STEP_S)


def written(
    folder: Path,
    fmu: ff.Fmu,
    y: FloatArray,
    *,
    noise: str = STATED,
    design: str = "",
) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    text = CAMPAIGN.format(fmu=fmu.description.path, noise=noise, design=design)
    (folder / "campaign.toml").write_text(text)
    record(folder / "ring.csv", OLD_T, y)
    return folder / "campaign.toml"


def record(path: Path, t: FloatArray, y: FloatArray) -> None:
    rows = [f"{a!r},{b!r}" for a, b in zip(t.tolist(), y.tolist(), strict=True)]
    path.write_text("\n".join(["time (s),displacement (m)", *rows]) + "\n")


def noisy(t: FloatArray, seed: int) -> FloatArray:
    return ring(t) + SIGMA * np.random.default_rng(seed).standard_normal(t.size)


def proposed(fmu: ff.Fmu, path: Path) -> NextMeasurements:
    return ff.design(ff.Problem.of(ff.read_campaign(path), fmu))


# --- information ----------------------------------------------------------------------------


def rows_at(
    fmu: ff.Fmu, path: Path, wanted: TraceLimits, x: FloatArray | None = None
) -> list[FloatArray]:
    """Information in the search vector of every candidate at a place, noise SIGMA."""
    problem = ff.Problem.of(ff.read_campaign(path), fmu)
    bound = problem.record.together
    limits: Limits = replace(ff.limits(problem), traces=wanted)
    data = DataSoFar(problem.record, problem.planned, problem.objective.steps)
    scales = np.array([q.scale for q in bound.parameters])
    references = np.array([q.reference for q in bound.parameters])
    at = np.zeros(2) if x is None else (x - references) / scales
    place = Place(bound.alternatives[0], at)
    made = RecordingCandidates(data, limits, place)
    sigma = np.full((1, 1), SIGMA)
    found = np.concatenate([rows.information(sigma) for rows in made.rows(place)])
    assert np.all(found[:, -1] == 0.0)
    return list(found[:, :-1, :-1] / np.outer(scales, scales))


def test_a_long_ringdown_says_what_its_cramer_rao_bound_says(beam: ff.Fmu, tmp_path: Path) -> None:
    """sigma(rate) = sigma(2 pi f) = 4 sigma/A sqrt(rate^3 h), long and finely sampled.

    With x = A exp(-r t) cos(w t + phi), amplitude and phase unknown, its rows say
    A^2/(2 h sigma^2) (1/(8 r^3)) of either.
    """
    path = written(tmp_path / "x", beam, ring(OLD_T))
    wanted = TraceLimits(of=("",), lengths_s=(0.32,), spacings_s={"": (STEP_S,)}, samples=4000)
    [found] = rows_at(beam, path, wanted, TRUTH)
    bound = 4.0 * SIGMA / SIZE * np.sqrt(RATE**3 * STEP_S)
    rates = np.array([2.0 * MASS, 2.0 * MASS * np.sqrt(K / MASS)])  # d(c, k)/d(rate, 2 pi f)
    assert np.sqrt(np.diag(np.linalg.inv(found))) == pytest.approx(bound * rates, rel=0.01)


@pytest.mark.parametrize(
    ("length_s", "step_s"), [(0.006, 1e-4), (0.02, 2.5e-4), (0.1, 5e-5), (0.08, 4e-4)]
)
def test_any_length_and_spacing_says_what_numpy_says(
    beam: ff.Fmu, tmp_path: Path, length_s: float, step_s: float
) -> None:
    path = written(tmp_path / "x", beam, ring(OLD_T))
    wanted = TraceLimits(
        of=("",), lengths_s=(0.5 * length_s, length_s), spacings_s={"": (step_s,)}, samples=4000
    )
    found = rows_at(beam, path, wanted, TRUTH)
    assert len(found) == 2
    for each, seconds in zip(found, wanted.lengths_s, strict=True):
        exact = informed(times(seconds, step_s))
        assert np.diag(each) == pytest.approx(np.diag(exact), rel=2e-3)
        scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
        assert each / scale == pytest.approx(exact / scale, abs=2e-3)


# --- the choice -----------------------------------------------------------------------------


@pytest.mark.parametrize(("target", "samples"), [("damping", 5000), ("stiffness", 200)])
def test_recordings_are_chosen_and_judged_as_numpy_does(
    beam: ff.Fmu, tmp_path: Path, target: str, samples: int
) -> None:
    """The best of all within the recorder's memory; length is worth more than fine samples."""
    design = designed(target=target, number=2, samples=samples)
    found = proposed(beam, written(tmp_path / "x", beam, ring(OLD_T), design=design)).design
    index = ["damping", "stiffness"].index(target)
    every = [times(*each) for each in itertools.product(LENGTHS, STEPS)]
    every = [t for t in every if t.size <= samples]
    best = min(every, key=lambda t: expected(OLD_T, t)[index])
    first, second = found.proposals
    assert first.recording is not None
    mine = times(first.recording.length_s, first.recording.spacing_s)
    assert mine.size == first.recording.samples <= samples
    assert expected(OLD_T, mine)[index] < 1.02 * expected(OLD_T, best)[index]
    assert found.before.at == pytest.approx(expected(OLD_T)[index], rel=0.01)
    assert first.expected.at == pytest.approx(expected(OLD_T, mine)[index], rel=0.01)
    assert second.recording is not None
    more = times(second.recording.length_s, second.recording.spacing_s)
    assert second.expected.at == pytest.approx(expected(OLD_T, mine, more)[index], rel=0.01)
    assert first.peaks_v[0] == pytest.approx(np.max(np.abs(ring(mine))), rel=1e-3)
    assert first.sigmas_v == (SIGMA,)
    assert any(f"{mine.size} samples" in line for line in screen_lines(found))


def test_a_time_is_spent_on_the_recordings_that_it_allows(beam: ff.Fmu, tmp_path: Path) -> None:
    """0.2 s, each with 10 ms of waiting: no long one, as often as there is time."""
    design = designed(
        target="damping", number=50, samples=5000, more='time = "0.2 s"\nchange_time = "10 ms"'
    )
    found = proposed(beam, written(tmp_path / "x", beam, ring(OLD_T), design=design)).design
    lengths = [p.recording.length_s for p in found.proposals if p.recording is not None]
    assert sum(lengths) + 0.01 * len(lengths) <= 0.2 * (1 + 1e-9)
    assert max(lengths) == pytest.approx(0.04)
    proposed(beam, tmp_path / "x/campaign.toml").write(tmp_path / "out", report=False)
    kept = tomllib.loads((tmp_path / "out/campaign/campaign.toml").read_text())["design"]
    assert (kept["time"], kept["change_time"]) == ("0.2 s", "0.01 s")
    fours = expected(OLD_T, *[times(0.04, 1e-4)] * 4)[0]
    assert found.proposals[-1].expected.at <= 1.03 * fours


def test_noise_that_nobody_stated_is_what_a_fit_leaves(beam: ff.Fmu, tmp_path: Path) -> None:
    design = designed(target="damping", number=1, samples=5000)
    path = written(tmp_path / "x", beam, noisy(OLD_T, 3), noise="", design=design)
    [one] = proposed(beam, path).design.proposals
    assert one.sigmas_v[0] == pytest.approx(SIGMA, rel=0.12)  # 397 degrees of freedom: 3.5 %
    exact = expected(OLD_T, times(0.32, 1e-4))[0]
    assert one.expected.at == pytest.approx(exact * one.sigmas_v[0] / SIGMA, rel=0.03)


def test_a_campaign_of_traces_alone_needs_no_table(beam: ff.Fmu, tmp_path: Path) -> None:
    problem = ff.Problem.of(ff.read_campaign(written(tmp_path, beam, ring(OLD_T))), beam)
    wanted = ff.limits(problem).traces
    assert wanted is not None
    assert wanted.lengths_s == pytest.approx([0.01, 0.02, 0.04, 0.08])
    assert wanted.spacings_s[""] == pytest.approx([1e-4])
    assert wanted.samples == 2 * OLD_T.size


# --- from the proposal to its fit -----------------------------------------------------------


def test_a_proposed_ringdown_is_as_sure_as_was_promised(beam: ff.Fmu, tmp_path: Path) -> None:
    """16 laboratories record the old and the proposed ringdown; each fits both through the FMU."""
    design = designed(target="damping", number=1, samples=1000)
    made = proposed(beam, written(tmp_path / "old", beam, noisy(OLD_T, 1), design=design))
    made.write(tmp_path / "out", report=False)
    next_path = tmp_path / "out/campaign/campaign.toml"
    with pytest.raises(ff.BadInput, match=r"next1\.csv"):
        ff.Problem.of(ff.read_campaign(next_path), beam)
    [one] = made.proposals
    assert one.recording is not None
    t = times(one.recording.length_s, one.recording.spacing_s)
    off = []
    for seed in range(16):
        path = written(tmp_path / "old", beam, noisy(OLD_T, 100 + seed), design=design)
        record(next_path.with_name("next1.csv"), t, noisy(t, 200 + seed))
        problem = ff.Problem.of([ff.read_campaign(path), ff.read_campaign(next_path)], beam)
        p = TRUTH.copy()
        for _ in range(3):  # Gauss-Newton: the truth is near
            rows, slopes = problem.white_rows(p)
            p -= np.linalg.lstsq(slopes, rows, rcond=None)[0]
        off.append(p[0] - C)
    fit = ff.fit(problem, method=ff.Tikhonov(nu=1e-6, levels=1), starts=1)
    assert fit["damping"].value - C == pytest.approx(off[-1], abs=0.02 * one.expected.at)
    assert fit["damping"].std == pytest.approx(one.expected.at, rel=0.1)
    scatter = float(np.sqrt(np.mean(np.square(off))))
    # the root mean square of 16 errors is known to 18 %
    assert scatter == pytest.approx(one.expected.at, rel=0.3)
    assert abs(float(np.mean(off))) < 3.0 * one.expected.at / np.sqrt(len(off))


def test_the_command_writes_what_the_recorder_is_to_do(beam: ff.Fmu, tmp_path: Path) -> None:
    design = designed(target="damping", number=2, samples=5000)
    path = written(tmp_path / "old", beam, ring(OLD_T), design=design)
    assert main(["design", str(path), "--out", str(tmp_path / "out"), "--workers", "1"]) == 0
    document = json.loads((tmp_path / "out/design.json").read_text())
    asked = [p["recording"] for p in document["proposals"]]
    table = (tmp_path / "out/design.csv").read_text().splitlines()
    heads = ["trace", "output", "length (s)", "spacing (s)", "samples", "largest (m)"]
    assert table[0].split(",")[1:7] == heads
    assert all(len(line.split(",")) == 11 for line in table)
    for k, each in enumerate(asked, start=1):
        lines = (tmp_path / f"out/campaign/next{k}.csv").read_text().splitlines()
        assert f"{each['samples']} samples" in lines[0]
        assert lines[-1] == "time (s),displacement (m)"
        t = times(each["length_s"], each["spacing_s"])
        record(tmp_path / f"out/campaign/next{k}.csv", t, ring(t))
    again = ff.Problem.of(ff.read_campaign(tmp_path / "out/campaign/campaign.toml"), beam)
    assert np.max(np.abs(again.residuals(TRUTH))) < 1e-6
    assert ff.limits(again).traces is not None
    assert "its file" in (tmp_path / "out/report.html").read_text()


# --- other traces ---------------------------------------------------------------------------


def test_two_beating_modes_with_another_spacing(swift_fmu: Path, tmp_path: Path) -> None:
    """Every fifth sample of one is every second of the other; four states are unknown."""
    p0 = np.array([100.0, 106.0, 3.0, 1.2])
    start, theta = np.array([1.0, -0.7, 300.0, 100.0]), 1.9
    old_h, new_h, sigma = 2.0e-3, 0.8e-3, 0.01

    def free(p: FloatArray, h: float, n: int) -> FloatArray:
        made = string(theta, p[2], p[3], (p[0], p[1]), (np.cos(theta), np.sin(theta)))
        still = np.zeros(n)
        return np.stack([held_response(made, still, h, start=tuple(e)) for e in np.eye(4)], axis=1)

    old = free(p0, old_h, 400) @ start
    folder = tmp_path / "x"
    folder.mkdir()
    rows = [f"{old_h * k!r},{y!r}" for k, y in enumerate(old.tolist())]
    (folder / "ring.csv").write_text("\n".join(["time (s),q1 (m)", *rows]) + "\n")
    names = ("eta_plus", "eta_minus", "d1", "d2")
    boxes = [(98.0, 102.0), (104.0, 108.0), (0.5, 10.0), (0.5, 10.0)]
    parameters = "".join(
        f'[[parameters]]\nname = "{n}"\nlower = "{low} Hz"\nupper = "{high} Hz"\n'
        f'start = "{value} Hz"\n'
        for n, (low, high), value in zip(names, boxes, p0.tolist(), strict=True)
    )
    (folder / "campaign.toml").write_text(
        f'title = "Two"\n[fmu]\nfile = "{swift_fmu}"\n[fmu.start]\nA1 = 0.0\nA2 = 0.0\n'
        f'theta = {theta}\n[observe]\noutput = "q1"\n[[trace]]\nfile = "ring.csv"\ninput = "b"\n'
        f'start = "unknown"\nstates = 4\nsigma = "{sigma} m"\n{parameters}'
        '[design]\ntarget = "d1"\nnumber = 1\n'
        f'traces = {{ lengths = ["0.8 s"], spacings = ["{new_h} s"], samples = 2000 }}\n'
    )
    with ff.Fmu(swift_fmu, workers=1) as fmu:
        found = ff.design(ff.Problem.of(ff.read_campaign(folder / "campaign.toml"), fmu)).design
    total = np.diag([12.0 / (high - low) ** 2 for low, high in boxes])
    for h, n in ((old_h, 400), (new_h, 1001)):
        seen = free(p0, h, n)
        by_p = [(free(p0 + d, h, n) - free(p0 - d, h, n)) @ start / 2e-4 for d in 1e-4 * np.eye(4)]
        columns = np.stack(by_p, axis=1) / sigma
        seen = seen / np.linalg.norm(seen, axis=0)
        left = columns - seen @ np.linalg.lstsq(seen, columns, rcond=None)[0]
        total = total + left.T @ left
        exact = float(np.sqrt(np.linalg.inv(total)[2, 2]))
        value = found.before.at if h == old_h else found.proposals[0].expected.at
        assert value == pytest.approx(exact, rel=0.01)


def test_a_demodulated_ringdown_of_high_quality(swift_fmu: Path, tmp_path: Path) -> None:
    """z = A exp(-r t + i d t): sigma(r) = sigma(d) = sigma/A sqrt(8 r^3 h); r = pi d1, Q 1e6."""
    f, width, sigma, h = 1e6, 1.0, 0.01, 0.02
    rate = np.pi * width
    equations = string(0.0, width, 1.0, (f, 2e6), (1.0, 0.0))
    t = times(59 * h, h)
    z = demodulated(equations, (1.0, 0.0, 0.0, 0.0), f + 0.3, t)
    size = float(np.abs(z[0]))
    folder = tmp_path / "x"
    folder.mkdir()
    lines = ["time (s),X (m),Y (m)"]
    rows = zip(t.tolist(), z.real.tolist(), z.imag.tolist(), strict=True)
    lines += [f"{a!r},{x!r},{y!r}" for a, x, y in rows]
    (folder / "ring.csv").write_text("\n".join(lines) + "\n")
    (folder / "campaign.toml").write_text(
        f'title = "One"\n[fmu]\nfile = "{swift_fmu}"\n[fmu.start]\nA1 = 0.0\nA2 = 0.0\n'
        f'theta = 0.0\neta_minus = "2 MHz"\n[observe]\noutput = "q1"\n[[demodulated_trace]]\n'
        f'file = "ring.csv"\nfrequency = "{f + 0.3} Hz"\ninput = "b"\nsigma = "{sigma} m"\n'
        '[[parameters]]\nname = "eta_plus"\nlower = "999998 Hz"\nupper = "1000002 Hz"\n'
        'start = "1000000 Hz"\n[[parameters]]\nname = "d1"\nlower = "0.1 Hz"\nupper = "10 Hz"\n'
        'start = "1 Hz"\n[design]\ntarget = "d1"\nnumber = 1\n'
        f'traces = {{ lengths = ["3 s"], spacings = ["{h / 2} s"], samples = 1000 }}\n'
    )
    with ff.Fmu(swift_fmu, workers=1) as fmu:
        made = ff.design(ff.Problem.of(ff.read_campaign(folder / "campaign.toml"), fmu))
        made.write(tmp_path / "out", report=False)
    found = made.design

    def told(values: ComplexArray, s: FloatArray) -> float:
        """Of the rate, the complex amplitude unknown, in closed form's derivatives."""
        size2 = np.abs(values) ** 2
        mean = np.sum(s * size2) / np.sum(size2)
        return float(np.sum((s - mean) ** 2 * size2)) / sigma**2

    new_t = times(3.0, h / 2)
    new_z = demodulated(equations, (1.0, 0.0, 0.0, 0.0), f + 0.3, new_t)
    assert told(new_z, new_t) == pytest.approx(size**2 / (8 * rate**3 * h / 2) / sigma**2, rel=0.05)
    both = told(z, t) + told(new_z, new_t) + 12.0 / (np.pi * 9.9) ** 2
    [one] = found.proposals
    assert one.expected.at == pytest.approx(1.0 / np.sqrt(both) / np.pi, rel=0.01)
    heads = (tmp_path / "out/campaign/next1.csv").read_text().splitlines()[-1]
    assert heads == "time (s),X (m),Y (m)"


LAG = """
title = "A lag"
[fmu]
file = "{fmu}"
[observe]
output = "y"
[[trace]]
file = "step.csv"
input = "u"
gain = "fit"
sigma = "0.02 V"
{input}
[[parameters]]
name = "tau"
lower = 0.05
upper = 2.0
start = 0.3
[design]
number = 1
traces = {{ lengths = {lengths}, spacings = ["10 ms"] }}
"""


def lag_campaign(folder: Path, how: str, lengths: str) -> Path:
    t = np.arange(100) * 0.01
    y = 2.0 * -np.expm1(-t / 0.3)
    rows = [f"{a!r},1.0,{b!r}" for a, b in zip(t.tolist(), y.tolist(), strict=True)]
    (folder / "step.csv").write_text("\n".join(["time (s),u (V),y (V)", *rows]) + "\n")
    path = folder / "campaign.toml"
    path.write_text(LAG.format(fmu=build_lag_fmu(folder), input=how, lengths=lengths))
    return path


def test_a_declared_step_goes_on_as_long_as_is_asked(tmp_path: Path) -> None:
    """y = g (1 - exp(-t/tau)), the gain unknown."""
    path = lag_campaign(tmp_path, 'signal = { kind = "step", level = "1 V" }', '["1.5 s"]')
    with ff.Fmu(next(tmp_path.glob("*.fmu")), workers=1) as fmu:
        [one] = ff.design(ff.Problem.of(ff.read_campaign(path), fmu)).proposals
    total = 12.0 / 1.95**2
    for n in (100, 151):
        t = np.arange(n) * 0.01
        shape, slope = -np.expm1(-t / 0.3), -2.0 * t / 0.3**2 * np.exp(-t / 0.3) / 0.02
        left = slope - shape * (shape @ slope) / (shape @ shape)
        total += float(left @ left)
    assert one.expected.at == pytest.approx(total**-0.5, rel=0.01)


def test_a_recorded_input_is_repeated_no_longer_than_it_was(tmp_path: Path) -> None:
    path = lag_campaign(tmp_path, 'interpolation = "held"', '["1.5 s"]')
    with ff.Fmu(next(tmp_path.glob("*.fmu")), workers=1) as fmu:
        problem = ff.Problem.of(ff.read_campaign(path), fmu)
        with pytest.raises(ff.BadInput, match="recorded inputs"):
            ff.design(problem)
        path.write_text(path.read_text().replace("1.5 s", "0.5 s"))
        made = ff.design(ff.Problem.of(ff.read_campaign(path), fmu))
        made.write(tmp_path / "out", report=False)
        file = tmp_path / "out/campaign/next1.csv"
        assert file.read_text().endswith("time (s),y (V),u (V)\n")
        rows = [f"{a!r},{-2.0 * math.expm1(-a / 0.3)!r},1.0" for a in times(0.5, 0.01).tolist()]
        file.write_text("\n".join([file.read_text().strip(), *rows]))
        again = ff.Problem.of(ff.read_campaign(file.with_name("campaign.toml")), fmu)
        assert np.max(np.abs(again.residuals(np.array([0.3])))) < 1e-6


def two_traces(folder: Path, fmu: ff.Fmu, second: str, design: str = "") -> Path:
    """The ringdown, and another one with further keys."""
    path = written(folder, fmu, ring(OLD_T), design=design)
    one, two = '[[trace]]\nlabel = "a, b"', f'[[trace]]\nlabel = "b"\n{second}'
    text = path.read_text()
    begin, end = text.index("[[trace]]"), text.index("[[parameters]]")
    table = text[begin:end]
    both = table.replace("[[trace]]", one) + table.replace("[[trace]]", two)
    path.write_text(text[:begin] + both + text[end:])
    return path


def test_a_name_with_a_comma_is_one_cell_of_the_table(beam: ff.Fmu, tmp_path: Path) -> None:
    design = '[design]\nnumber = 2\ntarget = "damping"\ntraces = { of = ["a, b"] }\n'
    path = two_traces(tmp_path / "x", beam, "", design)
    proposed(beam, path).write(tmp_path / "out", report=False)
    with (tmp_path / "out/design.csv").open(newline="") as file:
        head, _, first, _ = csv.reader(file)
    assert len(head) == len(first) == 11
    assert first[1] == "a, b"


def test_lengths_of_as_many_samples_are_one_recording(beam: ff.Fmu, tmp_path: Path) -> None:
    path = written(tmp_path / "x", beam, ring(OLD_T))
    bound = ff.Problem.of(ff.read_campaign(path), beam).record.together
    problem = ff.Problem.of(ff.read_campaign(path), beam)
    wanted = TraceLimits(
        of=("",), lengths_s=(0.02, 0.02004, 0.03), spacings_s={"": (STEP_S,)}, samples=4000
    )
    found = RecordingCandidates.choices_of(bound, replace(ff.limits(problem), traces=wanted))
    assert [c.recording.samples for c in found if c.recording is not None] == [201, 301]
    unknown = replace(wanted, of=("x",), spacings_s={"x": (STEP_S,)})
    with pytest.raises(ff.BadInput, match=r"traces: 'x'"):
        ff.design(problem, limits=replace(ff.limits(problem), traces=unknown))


# --- complaints -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("design", "complaint"),
    [
        ('traces = { of = ["x"] }', "traces.* of: .*'x'|'x' is"),
        ('traces = { lengths = ["0.4 ms"] }', "no recording"),
        ('traces = { lengths = ["1 ms"] }', "none of 1 setups"),
        ("traces = { samples = 500000 }", "500000 samples.* 200000"),
        ("traces = {}\nlevels = [1, 2]", "levels: "),
        (
            'traces = { lengths = ["4 ms"], spacings = ["0.031415926 ms"] }',
            "spacings",
        ),
        ("traces = { lengths = [] }", "lengths"),
        ("traces = {}\nsweeps = { controls = { V = [1] } }", "'sweeps'"),
        ('traces = {}\nnoise_floor = "1 V"', "noise_floor"),
        ('centres = ["300 Hz"]', r"\[drive\]"),
    ],
)
def test_what_cannot_be_proposed_is_told_in_a_sentence(
    beam: ff.Fmu, tmp_path: Path, design: str, complaint: str
) -> None:
    path = written(tmp_path / "x", beam, ring(OLD_T), design=f"[design]\n{design}\n")
    with pytest.raises(ff.BadInput, match=complaint):
        proposed(beam, path)


def test_traces_that_nothing_repeats_are_told_and_the_others_are_named(
    beam: ff.Fmu, tmp_path: Path
) -> None:
    """Values of two units, or a drive from an unknown start: `of` names the others."""
    driven = 'signal = { kind = "step", level = "1 mN", at = "5 ms" }\n'
    cases = {
        'gain = "fit"\n' + driven: "'b' is driven",
        'columns = { output = "seen" }': "in m and V",
    }
    for k, (more, complaint) in enumerate(cases.items()):
        path = two_traces(tmp_path / str(k), beam, more)
        text = path.read_text()
        path.write_text(text.replace(STATED, "", 1) if "seen" not in more else text)
        if "seen" in more:
            other = path.read_text().replace("ring.csv", "seen.csv").replace(STATED, "")
            path.write_text(other)
            lines = (path.parent / "ring.csv").read_text().splitlines()
            values = [f"{line},{line.split(',')[1]}" for line in lines[1:]]
            head = "time (s),displacement (m),seen (V)"
            (path.parent / "seen.csv").write_text("\n".join([head, *values]))
        with pytest.raises(ff.BadInput, match=complaint):
            proposed(beam, path)
        path.write_text(path.read_text() + '\n[design]\ntraces = { of = ["a, b"] }\n')
        assert ff.limits(ff.Problem.of(ff.read_campaign(path), beam)).outputs == ("displacement",)


def test_amplitudes_alone_are_told_without_a_table(swift_fmu: Path, tmp_path: Path) -> None:
    rows = [f"{0.02 * k!r},{math.exp(-0.05 * k)!r}" for k in range(60)]
    (tmp_path / "ring.csv").write_text("\n".join(["time (s),amplitude (m)", *rows]))
    path = tmp_path / "campaign.toml"
    path.write_text(
        f'title = "One"\n[fmu]\nfile = "{swift_fmu}"\n[fmu.start]\nA1 = 0.0\nA2 = 0.0\n'
        '[observe]\noutput = "q1"\n[[demodulated_trace]]\nfile = "ring.csv"\n'
        'frequency = "1 MHz"\ninput = "b"\n'
        '[[parameters]]\nname = "d1"\nlower = "0.1 Hz"\nupper = "10 Hz"\nstart = "1 Hz"\n'
    )
    with ff.Fmu(swift_fmu, workers=1) as fmu:
        problem = ff.Problem.of(ff.read_campaign(path), fmu)
        with pytest.raises(ff.BadInput, match="without phases"):
            ff.limits(problem)
