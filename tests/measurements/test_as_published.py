"""`[accuracy] as_published`: the paper's own steps, by NumPy alone, and what they leave.

The peer has the equations of motion, Algorithm 1 on the sweep's points and the Fourier transform of
samples from rest; nothing of `fitting` but the amplitudes that were measured.
"""

from __future__ import annotations

import csv
import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fitting as ff
from fitting.fit.objective import Evaluator, j_reg
from fitting.fit.path import PATH, follow_path
from fitting.inference.checks.solutions import window_findings
from fitting.signal.prescribed import PrescribedWindow
from fitting.text.errors import BadInput
from fitting.text.finding import Kind

SHIPPED = Path(__file__).resolve().parents[2] / "data" / "string_q1_published"
SETTLE, STEP, SAMPLES = 2e-3, 1e-6, 30_000
Array = np.ndarray[Any, np.dtype[Any]]


class Paper:
    """The misfit of the paper by closed forms: what a MATLAB of its authors computes."""

    def __init__(self, peaks_v: Array) -> None:
        campaign = tomllib.loads((SHIPPED / "campaign.toml").read_text())
        self.peaks_v = peaks_v
        self.pairs = 1e6 * numbers("experiments.csv")
        self.sweep_hz, amplitude = numbers("sweep.csv", first=0).T * [[1e6], [1e-6]]
        self.largest_v = float(np.max(amplitude))
        ends = [campaign["drift"][name] for name in ("eta_plus", "eta_minus")]
        mhz = [[float(end[when].split()[0]) for when in ("before", "after")] for end in ends]
        before, after = 1e6 * np.array(mhz).T
        self.eta = np.linspace(before, after, len(self.pairs))
        self.reference = np.array([p["reference"] for p in campaign["parameters"]])
        self.scale = np.array([p["scale"] for p in campaign["parameters"]])

    def motion(self, p: Array, eta: Array, tones: Array) -> tuple[Array, Array, Array]:
        """Phasors of the first mode at the tones; exponents and amplitudes of what decays."""
        theta, *d = p
        turn = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
        damping = 2.0 * np.pi * turn @ np.diag(d) @ turn.T
        matrix = np.zeros((4, 4))
        matrix[:2, 2:], matrix[2:, :2] = np.eye(2), -np.diag((2.0 * np.pi * eta) ** 2)
        matrix[2:, 2:] = -damping
        exponents, shapes = np.linalg.eig(matrix)
        start, phasors = np.zeros(4), []
        for u in tones:
            w = 2.0 * np.pi * u
            stiffness = np.diag((2.0 * np.pi) ** 2 * (eta - u) * (eta + u)) + 1j * w * damping
            x = np.linalg.solve(stiffness, np.ones(2))
            phasors.append(x[0])
            start -= np.concatenate([x.real, (1j * w * x).real])
        return np.array(phasors), exponents, np.linalg.solve(shapes, start + 0j) * shapes[0]

    def amplitudes(self, p: Array, m: int) -> Array:
        """2/N |sum q(t_j) exp(-i 2 pi u t_j)| of pair m, every term a geometric series."""
        tones = self.pairs[m]
        phasors, exponents, decays = self.motion(p, self.eta[m], tones)
        waves = 2j * np.pi * tones
        rates = np.concatenate([waves, -waves, exponents])
        sizes = np.concatenate([0.5 * phasors, 0.5 * phasors.conj(), decays])
        result = []
        for wave in waves:
            step = STEP * (rates - wave)
            step = step.real + 1j * (np.remainder(step.imag + np.pi, 2.0 * np.pi) - np.pi)
            same = np.abs(step) < 1e-14
            series = np.expm1(SAMPLES * step) / np.where(same, 1.0, np.expm1(step))
            series = np.where(same, SAMPLES, series) * np.exp(SETTLE * (rates - wave))
            result.append(2.0 / SAMPLES * abs(np.sum(sizes * series)))
        return np.array(result)

    def j_fit(self, p: Array) -> float:
        """Sum of |chi z - z*|/z*, chi the ratio of the largest points of both sweeps."""
        steady = [abs(self.motion(p, self.eta[0], np.array([u]))[0][0]) for u in self.sweep_hz]
        z = np.concatenate([self.amplitudes(p, m) for m in range(len(self.pairs))])
        return float(np.sum(np.abs(self.largest_v / max(steady) * z / self.peaks_v - 1.0)))

    def j_reg(self, p: Array, nu: float) -> float:
        """Tikhonov's term with the campaign's scales."""
        return 0.5 * nu * float(np.sum(((p - self.reference) / self.scale) ** 2))


def numbers(name: str, first: int = 1) -> Array:
    """Columns of a file from the first on."""
    lines = (SHIPPED / name).read_text().splitlines()
    _, *rows = csv.reader(line for line in lines if not line.startswith("#"))
    return np.array([[float(cell) for cell in row[first:]] for row in rows])


@pytest.fixture(scope="module")
def problem(swift: ff.Fmu) -> ff.Problem:
    return ff.Problem.of(SHIPPED / "campaign.toml", swift)


@pytest.fixture(scope="module")
def paper(problem: ff.Problem) -> Paper:
    return Paper(np.concatenate([e.peaks_v for e in problem.record.experiments]))


def test_the_misfit_is_that_of_the_papers_steps(problem: ff.Problem, paper: Paper) -> None:
    """At 50 random points of the box, the start and the published values, to 1e-6."""
    rng = np.random.default_rng(56)
    low, high = (-2.0 * np.pi, 0.0, 0.0), (2.0 * np.pi, 3.0, 3.0)
    random = rng.uniform(low, high, (50, 3))
    random[:, 1:] = 10.0 ** random[:, 1:]
    points = np.array([*random, (0.0, 15.004, 15.004), (1.9498, 120.0, 90.0)])
    objective = problem.objective
    scale = np.array([q.scale for q in objective.parameters])
    reference = np.array([q.reference for q in objective.parameters])
    xs = list((points - reference) / scale)
    for point, p in zip(Evaluator(objective).trials(xs), points, strict=True):
        assert point.j_fit == pytest.approx(paper.j_fit(p), rel=1e-6), p
        assert j_reg(point.x, 0.01) == pytest.approx(paper.j_reg(p, 0.01), rel=1e-9)


@pytest.mark.nightly
def test_the_nine_levels_end_where_the_paper_has_these_misfits(
    problem: ff.Problem, paper: Paper
) -> None:
    levels = list(follow_path(problem.objective, problem.options, kind=PATH))
    assert len(levels) == 9
    for level in levels:
        p = np.array(level.parameters)
        assert level.j_fit == pytest.approx(paper.j_fit(p), rel=1e-6)
        assert level.j_reg == pytest.approx(paper.j_reg(p, level.nu), rel=1e-6)
    published = tomllib.loads((SHIPPED.parent / "paper.toml").read_text())["series"]["q1"]
    assert paper.j_fit(np.array([0.0, 15.004, 15.004])) / 10.0 == pytest.approx(
        published["mean_deviation_before"], abs=0.05
    )
    assert levels[-1].j_fit / 10.0 == pytest.approx(published["mean_deviation_after"], abs=0.01)


def test_what_is_left_of_the_transient_and_what_tones_leak_is_found(problem: ff.Problem) -> None:
    """exp(-pi 94.28 Hz 2 ms), and |sinc| of tones 20 Hz apart in 30 ms."""
    [bound] = problem.record.campaigns.values()
    found = {finding.kind: finding.numbers for finding in window_findings(bound, 94.28)}
    left, leaks = found[Kind.transient_left], found[Kind.tones_unresolved]
    assert left["left"] == pytest.approx(math.exp(-math.pi * 94.28 * 2e-3), rel=1e-3)
    assert leaks["distance_hz"] == pytest.approx(20.0)
    assert leaks["leakage"] == pytest.approx(math.sin(0.6 * math.pi) / (0.6 * math.pi))
    assert leaks["bin_hz"] == pytest.approx(1.0 / 0.03)


def test_a_response_that_is_not_linear_is_simulated_whole() -> None:
    """A step inside the window: the few samples disagree, and nothing is made up between them."""
    window = PrescribedWindow(settle=0.0, length=0.01, step=1e-6)
    assert window.few is not None
    t = np.arange(window.samples) * window.step
    smooth = np.cos(2.0 * np.pi * 1e5 * t) * np.exp(-50.0 * t)
    rebuilt = window.whole(smooth[window.few.indices])
    assert rebuilt == pytest.approx(smooth, abs=1e-6)
    broken = np.where(t > 0.004, 1.5, 1.0) * smooth
    assert window.whole(broken[window.few.indices]) is None


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('output = "q1_hybrid"', 'output = "q1_hybrid"\nsteady_start = true', "begins at rest"),
        (
            "as_published = true",
            'as_published = true\nwindow = { settle = "1 ms", length = "1 s", step = "1 us" }',
            "window",
        ),
        (
            "as_published = true",
            'window = { settle = "1 ms", length = "1 us", step = "1 us" }',
            "three samples",
        ),
    ],
)
def test_contradictions_are_refused(old: str, new: str, complaint: str, tmp_path: Path) -> None:
    path = ff.example("string_q1_published", tmp_path / "campaign")
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(BadInput, match=complaint):
        ff.read_campaign(path)
