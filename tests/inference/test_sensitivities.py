"""What a peak amplitude says about theta, d1 and d2: the singular values of its sensitivities.

Rows are ln(amplitude / maximum of an FRF), columns d/d(theta, ln d1, ln d2). A closed-form
model, worked out before this project and rounded, has

    q1                        1.7   9e-5   5e-11
    q1 and q2                 1.8   1.4    8e-5
    q1, q2 and |q2| at q1's   3.2   1.4    0.42

Here they come through the FMU, by central differences of order eight
(a complex step does not pass through an FMU), and beside it from a matrix solve in mpmath.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import mpmath as mp
import numpy as np
import pytest

from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import Run
from fitting.signal.scale import refine_maximum
from fitting.text.arrays import FloatArray
from tests.support import reference

PAIRS: Mapping[str, tuple[tuple[float, float], ...]] = {
    "q1": (
        (6940160, 6940360),
        (6940180, 6940340),
        (6940200, 6940320),
        (6940240, 6940280),
        (6940250, 6940270),
    ),
    "q2": (
        (7027500, 7027700),
        (7027520, 7027680),
        (7027540, 7027660),
        (7027580, 7027620),
        (7027590, 7027610),
    ),
}
ETAS = [(6940210.0 + 25.0 * m, 7027550.0 + 25.0 * m) for m in range(5)]
MODE = {"q1": 0, "q2": 1}
#: theta, ln d1, ln d2.
CENTRE = np.array([1.9498, np.log(120.0), np.log(90.0)])

#: Blocks of rows (series driven, mode observed, mode whose maximum they are divided by).
Block = tuple[str, int, str]
OWN_1, OWN_2, CROSS = ("q1", 0, "q1"), ("q2", 1, "q2"), ("q1", 1, "q1")

ROUNDED: Mapping[tuple[Block, ...], tuple[str, ...]] = {
    (OWN_1,): ("1.7", "9e-5", "5e-11"),
    (OWN_1, OWN_2): ("1.8", "1.4", "8e-5"),
    (OWN_1, OWN_2, CROSS): ("3.2", "1.4", "0.42"),
}

#: Coefficients of f(x + k h) - f(x - k h), k = 1..4, in h f'(x): exact for polynomials of degree 8.
EIGHTH = np.array([4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0])
STEP = 0.02


def runs_at(x: FloatArray) -> list[Run]:
    """Both series' pairs, then the points about the maxima of both modes at the first eta."""
    theta, d1, d2 = float(x[0]), float(np.exp(x[1])), float(np.exp(x[2]))
    fitted = {"theta": theta, "d1": d1, "d2": d2}
    tones = [(pair, eta) for s in PAIRS for pair, eta in zip(PAIRS[s], ETAS, strict=True)]
    tones += [((u, u + 1.0), ETAS[0]) for eta in ETAS[0] for u in nodes(eta)]
    outputs = tuple(f"q{m}_hybrid_{part}_u{t}" for m in (1, 2) for t in (1, 2) for part in "XY")
    return [
        Run(
            start_values={
                **fitted,
                "eta_plus": e[0],
                "eta_minus": e[1],
                "u1": float(u[0]),
                "u2": float(u[1]),
                "A1": 1.0,
                "A2": 1.0,
                "periodic_start": True,
            },
            settle_s=0.0,
            sample_step_s=1.0,
            samples=1,
            outputs=outputs,
        )
        for u, e in tones
    ]


def nodes(eta_hz: float) -> list[float]:
    return [eta_hz + 20.0 * k for k in range(-2, 3)]


def amplitudes(answers: Sequence[FloatArray]) -> dict[Block, FloatArray]:
    """ln(amplitude / maximum) of every block from the answers to `runs_at`."""
    values = np.array([answer[0] for answer in answers]).reshape(-1, 2, 2, 2)
    size = np.hypot(values[..., 0], values[..., 1])  # (runs, mode, tone)
    top = {
        s: refine_maximum(np.array(nodes(ETAS[0][m])), size[10 + 5 * m : 15 + 5 * m, m, 0]).value
        for s, m in MODE.items()
    }
    driven = {"q1": size[:5], "q2": size[5:10]}
    blocks = (OWN_1, OWN_2, CROSS)
    return {b: np.log(driven[b[0]][:, b[1], :].ravel() / top[b[2]]) for b in blocks}


@pytest.fixture(scope="module")
def through_fmu(oscillator_fmu: Path) -> Callable[[float], dict[Block, FloatArray]]:
    """A function of the step: the rows of every block at centre +- k h, [k, sign, column, row]."""
    found: dict[float, dict[Block, FloatArray]] = {}

    def tabulate(step: float) -> dict[Block, FloatArray]:
        if step in found:
            return found[step]
        places = [
            CENTRE + sign * k * step * np.eye(3)[i]
            for k, sign, i in itertools.product(range(1, 5), (1.0, -1.0), range(3))
        ]
        with FmuWorkers(oscillator_fmu, workers=1) as workers:
            answers = workers.run([run for x in places for run in runs_at(x)])
        per = len(answers) // len(places)
        rows = [amplitudes(answers[n * per : (n + 1) * per]) for n in range(len(places))]
        found[step] = {b: np.array([r[b] for r in rows]).reshape(4, 2, 3, -1) for b in rows[0]}
        return found[step]

    return tabulate


def sensitivities(
    table: Mapping[Block, FloatArray], blocks: Sequence[Block], step: float
) -> FloatArray:
    """d rows/d(theta, ln d1, ln d2), shape (rows, 3)."""
    stacked = np.concatenate([table[b] for b in blocks], axis=3)
    return np.asarray(np.einsum("k,kir->ri", EIGHTH, stacked[:, 0] - stacked[:, 1]) / step)


def exact_singular_values(blocks: Sequence[Block]) -> list[float]:
    """The same from matrix solves at 60 digits and a small step: no rounding to speak of."""
    with mp.workdps(60):
        step = mp.mpf(10) ** -15
        centre = [mp.mpf(str(CENTRE[0])), mp.log(120), mp.log(90)]
        columns = []
        for i in range(3):
            ends = [
                exact_rows([c + sign * step * (j == i) for j, c in enumerate(centre)], blocks)
                for sign in (1, -1)
            ]
            columns.append([(a - b) / (2 * step) for a, b in zip(*ends, strict=True)])
        matrix = mp.matrix(columns).T
        return [float(s) for s in mp.svd_r(matrix, compute_uv=False)]


def exact_rows(x: Sequence[mp.mpf], blocks: Sequence[Block]) -> list[mp.mpf]:
    def size(u: mp.mpf, eta: tuple[float, float], mode: int) -> mp.mpf:
        p = SimpleNamespace(
            theta=x[0],
            d1=mp.exp(x[1]),
            d2=mp.exp(x[2]),
            reflection=False,
            g1=1,
            g2=1,
            eta_plus=eta[0],
            eta_minus=eta[1],
        )
        return abs(reference.phasors(p, u)[mode])

    rows = []
    for series, mode, divided in blocks:
        m = MODE[divided]
        top = max_of(partial(size, eta=ETAS[0], mode=m), ETAS[0][m])
        pairs = zip(PAIRS[series], ETAS, strict=True)
        rows += [mp.log(size(mp.mpf(u), eta, mode) / top) for pair, eta in pairs for u in pair]
    return rows


def max_of(amplitude: Callable[[mp.mpf], mp.mpf], eta_hz: float) -> mp.mpf:
    """Maximum near eta: 1/A^2 is a parabola there but for parts in 1e-10, twice is enough."""
    centre, reach = mp.mpf(eta_hz), mp.mpf(10)
    for _ in range(3):
        low, mid, high = (amplitude(centre + k * reach) ** -2 for k in (-1, 0, 1))
        centre += reach * (low - high) / (2 * (low - 2 * mid + high))
        reach /= mp.mpf(10) ** 6
    return amplitude(centre)


@pytest.mark.parametrize("blocks", list(ROUNDED), ids=["q1", "q1+q2", "q1+q2+cross"])
def test_singular_values(
    through_fmu: Callable[[float], dict[Block, FloatArray]], blocks: tuple[Block, ...]
) -> None:
    """Within 5 % of the exact ones, the smallest too; and the rounded figures, as rounded.

    Two rounded figures have one digit and are more than 5 % off for that alone: 5e-11 (4.6e-11) and
    8e-5 (8.4e-5).
    """
    table = through_fmu(STEP)
    found = np.linalg.svd(sensitivities(table, blocks, STEP), compute_uv=False)
    assert found == pytest.approx(exact_singular_values(blocks), rel=0.05)
    for value, text in zip(found, ROUNDED[blocks], strict=True):
        digits = len(text.split("e")[0].replace("0.", "").replace(".", ""))
        assert float(f"{value:.{digits - 1}e}") == pytest.approx(float(text), rel=1e-12)


@pytest.mark.parametrize(
    ("blocks", "smallest"), [((OWN_1,), 4.6e-11), ((OWN_1, OWN_2, CROSS), 0.42)], ids=["q1", "all"]
)
def test_the_differences_resolve_the_smallest(
    through_fmu: Callable[[float], dict[Block, FloatArray]],
    blocks: tuple[Block, ...],
    smallest: float,
) -> None:
    """Half the step moves no singular value by 2 % of the smallest: truncation and rounding.

    A change of the matrix by e changes none of them by more than e in the spectral norm.
    """
    whole = sensitivities(through_fmu(STEP), blocks, STEP)
    half = sensitivities(through_fmu(STEP / 2), blocks, STEP / 2)
    assert np.linalg.norm(whole - half, 2) < 0.02 * smallest


def test_without_the_line_of_q2_one_combination_is_missing(
    through_fmu: Callable[[float], dict[Block, FloatArray]],
) -> None:
    """|q2| at q1's drives alone fixes D11 and D12, not D22: two singular values of order one."""
    table = through_fmu(STEP)
    found = np.linalg.svd(sensitivities(table, (OWN_1, CROSS), STEP), compute_uv=False)
    assert found == pytest.approx(exact_singular_values((OWN_1, CROSS)), rel=0.05)
    assert found[1] > 0.5
    assert found[2] < 1e-6
