"""Traces of a heated room of two resistances and one capacity, against its closed form."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.text.arrays import ComplexArray, FloatArray
from tests.support.cfmu_build import build_room_fmu

QUICK = ff.Tikhonov(nu=1e-6, levels=1, misfit="squares")
#: K/W, K/W, J/K, and K at the first sample.
TRUTH = {"R1": 6e-3, "R2": 2e-3, "C": 6e6, "T_start": 291.0}
PARAMETERS = (
    ff.Parameter("R1", 5e-3, bounds=(1e-3, 2e-2), unit="K/W"),
    ff.Parameter("R2", 1e-3, bounds=(1e-4, 1e-2), unit="K/W"),
    ff.Parameter("C", 1e7, bounds=(1e6, 3e7), unit="J/K"),
    ff.Parameter("T_start", 293.0, bounds=(280.0, 300.0), unit="K"),
)
ROOM = ff.Setup(ff.Drive(), "Ti")
STEP_S, SIGMA = 600.0, 0.05
T: FloatArray = STEP_S * np.arange(300.0)
OUTSIDE: FloatArray = np.where(T >= 9e4, 277.0, 283.0)
HEAT: FloatArray = np.where(T >= 3e4, 1500.0, 0.0)


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ff.Fmu]:
    with ff.Fmu(build_room_fmu(tmp_path_factory.mktemp("room")), workers=1) as fmu:
        yield fmu


def inside(x: Sequence[complex], outside: FloatArray, heat: FloatArray) -> ComplexArray:
    """C T' = (To - T)/R1 + Q, Ti = T + R2 Q at the samples; To and Q are sums of steps at them.

    Every step of To or R1 Q adds its size times 1 - e^(-t/R1 C), t from its moment on.
    """
    r1, r2, c, start = x
    level = outside + r1 * heat
    node = level[0] + (start - level[0]) * np.exp(-T / (r1 * c))
    for k in map(int, np.flatnonzero(np.diff(outside) + np.diff(heat)) + 1):
        past = np.maximum(T - T[k], 0.0)
        node = node + (level[k] - level[k - 1]) * (1.0 - np.exp(-past / (r1 * c)))
    return np.asarray(node + r2 * heat)


def least_errors(*records: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Cramer-Rao bound of the parameters from records under (To, Q), by complex steps."""
    h, true = 1e-20, list(TRUTH.values())
    slopes = [
        np.concatenate(
            [
                inside([x + 1j * h * x * (k == n) for k, x in enumerate(true)], *record).imag
                for record in records
            ]
        )
        / (h * true[n])
        for n in range(len(true))
    ]
    matrix = np.stack(slopes, axis=1) * np.array(true) / SIGMA
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix))) * true)


def record(rng: np.random.Generator, outside: FloatArray, heat: FloatArray) -> ff.Trace:
    y = inside(list(TRUTH.values()), outside, heat).real + SIGMA * rng.standard_normal(T.size)
    return ff.Trace(
        T,
        y,
        setup=ROOM,
        input="To",
        driven=(T, outside),
        further={"Q": (T, heat)},
        interpolation="held",
        sigma=SIGMA,
        unit="K",
    )


def held_to_the_bound(fit: ff.Fit, bound: FloatArray) -> None:
    for (name, true), std in zip(TRUTH.items(), bound, strict=True):
        assert fit[name].std == pytest.approx(std, rel=0.05)
        assert abs(fit[name].value - true) < 4.0 * std


def test_two_resistances_and_a_capacity_are_as_sure_as_can_be(room: ff.Fmu) -> None:
    """Heat and outdoor temperature each make a step; the start is unknown, too."""
    trace = record(np.random.default_rng(1), OUTSIDE, HEAT)
    fit = ff.fit(ff.Problem(room, PARAMETERS, trace), method=QUICK, starts=1)
    held_to_the_bound(fit, least_errors((OUTSIDE, HEAT)))


def test_records_under_different_inputs_are_one_fit(room: ff.Fmu) -> None:
    """One under heat, one under a step of the weather: neither tells all four by itself."""
    rng = np.random.default_rng(2)
    cold: FloatArray = np.full(T.size, 283.0)
    drives = (OUTSIDE, 0.0 * HEAT), (cold, HEAT)
    traces = [replace(record(rng, *drive), label=f"{k}") for k, drive in enumerate(drives)]
    fit = ff.fit(ff.Problem(room, PARAMETERS, traces), method=QUICK, starts=1)
    held_to_the_bound(fit, least_errors(*drives))


@pytest.mark.parametrize("zero_k", [0.0, 273.15])
def test_kelvin_are_no_larger_an_error_than_degrees(room: ff.Fmu, zero_k: float) -> None:
    """By Euler's steps, at the truth: what is promised holds, however far the zero is away."""
    outside = OUTSIDE - zero_k
    truth = {**TRUTH, "T_start": TRUTH["T_start"] - zero_k}
    record = ff.Trace(
        T,
        inside(list(truth.values()), outside, HEAT).real,
        setup=replace(ROOM, start_values={"euler": 1.0}),
        input="To",
        driven=(T, outside),
        further={"Q": (T, HEAT)},
        interpolation="held",
        sigma=SIGMA,
        unit="K",
    )
    parameters = [
        replace(p, start=truth[p.name], bounds=(0.5 * truth[p.name], 2.0 * truth[p.name]))
        for p in PARAMETERS
    ]
    problem = ff.Problem(room, parameters, record)
    off = float(np.max(np.abs(problem.residuals(problem.start))))
    [plan] = problem.planned.plans.values()
    assert off < plan.promised
    assert off * float(np.max(np.abs(record.y - np.mean(record.y)))) < 0.2 * SIGMA


CAMPAIGN = """title = "Room"
[fmu]
file = "{fmu}"
[observe]
output = "Ti"
[[trace]]
file = "room.csv"
input = "To"
further_inputs = ["Q"]
interpolation = "held"
sigma = "0.05 K"
"""
KEYS = """[[parameters]]
name = "{name}"
start = "{start} {unit}"
lower = "{low} {unit}"
upper = "{high} {unit}"
"""


def test_a_file_in_the_units_of_a_logger_says_the_same(room: ff.Fmu, tmp_path: Path) -> None:
    """Degrees Celsius, kW and minutes: offsets and prefixes are the file's."""
    trace = record(np.random.default_rng(1), OUTSIDE, HEAT)
    table = np.stack([T / 60.0, OUTSIDE - 273.15, HEAT / 1e3, trace.y - 273.15], axis=1)
    rows = [",".join(f"{x!r}" for x in map(float, row)) for row in table]
    text = "\n".join(["time (min),To (degC),Q (kW),Ti (degC)", *rows])
    (tmp_path / "room.csv").write_text(text, encoding="utf-8")
    campaign = CAMPAIGN.format(fmu=room.description.path.as_posix()) + "".join(
        KEYS.format(name=p.name, start=p.start, unit=p.unit, low=p.bounds[0], high=p.bounds[1])
        for p in PARAMETERS
    )
    (tmp_path / "campaign.toml").write_text(campaign, encoding="utf-8")
    problem = ff.Problem.of(ff.read_campaign(tmp_path / "campaign.toml"))
    fit = ff.fit(problem, method=QUICK, starts=1)
    held_to_the_bound(fit, least_errors((OUTSIDE, HEAT)))


def test_two_outputs_in_one_file_share_their_runs(room: ff.Fmu, tmp_path: Path) -> None:
    """The air and the wall: what lies between them is R2 Q, exactly."""
    true = list(TRUTH.values())
    air, wall = (
        inside([r1, r2, c, t], OUTSIDE, HEAT).real for r1, r2, c, t in (true, walled(true))
    )
    rows = np.stack([T, OUTSIDE, HEAT, air, wall], axis=1)
    head = "time (s),To (K),Q (W),Ti (K),T (K)"
    np.savetxt(tmp_path / "room.csv", rows, delimiter=",", header=head, comments="", fmt="%.17g")
    first = CAMPAIGN.format(fmu=room.description.path.as_posix())
    second = first[first.index("[[trace]]") :].replace("[[trace]]", '[[trace]]\noutput = "T"')
    keys = "".join(
        KEYS.format(name=p.name, start=p.start, unit=p.unit, low=p.bounds[0], high=p.bounds[1])
        for p in PARAMETERS
    )
    (tmp_path / "campaign.toml").write_text(first + second + keys, encoding="utf-8")
    problem = ff.Problem.of(ff.read_campaign(tmp_path / "campaign.toml"), room)
    problem.residuals(np.array([p.start for p in PARAMETERS]))  # makes the plan
    before = room.workers.counts.runs
    rows_left = problem.residuals(np.array(true) * 1.01)
    assert rows_left.size == 2 * T.size
    assert room.workers.counts.runs == before + 1
    fit = ff.fit(problem, method=QUICK, starts=1)
    for name, value in TRUTH.items():
        assert fit[name].value == pytest.approx(value, rel=1e-5)


def walled(x: Sequence[float]) -> list[float]:
    """Parameters under which the room is seen at its wall."""
    return [x[0], 0.0, *x[2:]]
