"""The simulator of hidden laboratories by other means; their campaigns tell the truth."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm

import build_fmu
from tests.bench.bench_hidden import KINDS, read
from tests.support.hidden import joint
from tests.support.hidden.judge import _Answer, _false, _said, judged
from tests.support.hidden.laboratory import NOISE
from tests.support.hidden.motion import TWO_PI, chain, hybrid

VALUES = {"theta": 1.1, "eta_plus": 100.0, "eta_minus": 130.0, "d1": 2.0, "d2": 7.0}
PAIR = {"f1": 100.0, "f2": 101.0, "d1": 2.0, "d2": 7.0, "lambda12": 20.0}


def matrices(name: str) -> tuple[Any, Any, Any, Any]:
    """C, D, force and read-out of the equations of motion, written out, SI units."""
    if name == "chain":
        k = np.array([[100.0**2, -(20.0**2)], [-(20.0**2), 101.0**2]])
        return TWO_PI**2 * k, TWO_PI * np.diag([2.0, 7.0]), np.array([1.0, 0.0]), [1.0, 0.0]
    c, s = math.cos(1.1), math.sin(1.1)
    t = np.array([[c, -s], [s, c]])
    damping = TWO_PI * t @ np.diag([2.0, 7.0]) @ t.T
    return np.diag([(TWO_PI * 100.0) ** 2, (TWO_PI * 130.0) ** 2]), damping, np.ones(2), t[:, 0]


@pytest.mark.parametrize("name", ["chain", "hybrid"])
def test_motion_is_that_of_the_matrices(name: str) -> None:
    stiffness, damping, force, seen = matrices(name)
    motion = chain(PAIR) if name == "chain" else hybrid(VALUES, "q1")
    for u in (99.0, 101.7):
        w = TWO_PI * u
        whole = stiffness - w * w * np.eye(2) + 1j * w * damping
        expected = np.asarray(seen) @ np.linalg.solve(whole, force)
        assert motion.transfer(np.array([u]))[0] == pytest.approx(expected, rel=1e-10)
    system = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -damping]])
    state = np.array([1.0, 2.0, 3.0, -1.0])
    begun = state * np.append(np.ones(2), TWO_PI * motion.own_hz)
    t = np.linspace(0.0, 0.1, 7)
    free = [np.asarray(seen) @ (expm(system * x) @ begun)[:2] for x in t]
    assert motion.free(t, state) == pytest.approx(free, abs=1e-9)
    step, b = 0.003, np.array([0.3, -1.0, 2.0, 0.0, 0.5])
    column = np.concatenate([np.zeros(2), force])[:, None]
    turn = expm(step * np.block([[system, column], [np.zeros((1, 5))]]))
    z, held = np.zeros(4), []
    for level in b:
        held.append(np.asarray(seen) @ z[:2])
        z = turn[:4, :4] @ z + turn[:4, 4] * level
    assert motion.held(step, b) == pytest.approx(held, abs=1e-9 * float(np.max(np.abs(held))))


@pytest.mark.parametrize("kind", list(KINDS))
def test_a_third_is_wrong_and_the_others_leave_nothing(kind: str, tmp_path: Path) -> None:
    made = [KINDS[kind](seed) for seed in range(18)]
    assert sum(bool(one.mistake) for one in made) == 6
    for one in made:
        assert all(u.low < u.truth < u.high and u.low <= u.start <= u.high for u in one.unknowns)
        if not one.mistake or one.mistake == NOISE:
            assert float(np.sum(one.left_at(one.truth) ** 2)) < 1e-3
        paths = one.write(tmp_path / str(one.seed), tmp_path / "model.fmu")
        assert all("model.fmu" in path.read_text() for path in paths)


def test_amplitudes_without_their_sign_have_an_offset() -> None:
    """Mean of |a + g| by quadrature; of 1018, most points are noise, and only there it shows."""
    for a in (0.0, 0.3, 1.0, 2.5):
        mean, _ = quad(lambda x, a=a: abs(a + x) * math.exp(-0.5 * x * x), -12.0, 12.0, points=[-a])
        [found] = joint.noise_floor(np.array([a]), np.ones(1))
        assert found == pytest.approx(mean / math.sqrt(TWO_PI) - a, abs=1e-9)
    right = [joint.laboratory(seed) for seed in range(1000, 1050)]
    offset = [one.seed for one in right if "offset" in one.causes and not one.mistake]
    assert offset == [1018]


def answer(code: int, value: float, *findings: str) -> _Answer:
    """What a command may say of a line width of 0.5 Hz."""
    found = {
        "value": value,
        "std": 0.01,
        "ci68": [value - 0.01, value + 0.01],
        "ci95": [value - 0.02, value + 0.02],
        "status": "determined" if code == 0 else "no verdict",
    }
    return _Answer(
        code=code,
        result={
            "status": "converged" if code == 0 else "does not describe the data",
            "message": "",
            "parameters": {"d1": found},
            "derived": {},
            "quadratures": {"qualities": []},
            "findings": [
                {"kind": kind, "subject": "measurements", "numbers": {"factor": 3.0}}
                for kind in findings
            ],
            "knowledge": {"equivalents": []},
        },
    )


@pytest.mark.parametrize(
    ("mistake", "said", "seen", "sorts"),
    [
        ("", answer(0, 0.51), (0.0, 0.0), []),
        ("", answer(0, 0.55), (0.0, 0.0), ["determined beyond 4 errors"]),
        ("", answer(4, 0.51), (0.0, 0.0), ["right model refused"]),
        ("", answer(0, 0.51, "offset"), (0.0, 0.0), ["cause that is not the cause"]),
        ("", answer(3, 0.51), (0.0, 0.0), ["exit code"]),
        ("offset", answer(0, 0.51), (50.0, 0.2), ["wrong model described"]),
        ("offset", answer(4, 0.51, "gain"), (50.0, 0.2), ["cause that is not the cause"]),
        ("offset", answer(4, 0.51, "offset"), (50.0, 0.2), []),
        (NOISE, answer(0, 0.51, "noise_underestimated"), (0.0, 0.0), []),
    ],
)
def test_false_statements_are_told_by_their_sort(
    mistake: str, said: _Answer, seen: tuple[float, float], sorts: list[str]
) -> None:
    made = KINDS["traces"](0)
    width = replace(made.unknowns[1], truth=0.5)
    causes = {"offset": {"offset"}, NOISE: {"noise_underestimated"}}.get(mistake, set())
    one = replace(
        made,
        unknowns=(width,),
        mistake=mistake,
        causes=frozenset(causes),
        noise_factor=3.0 if mistake == NOISE else 1.0,
        equal=(),
    )
    statements = tuple(_said(one, said.result))
    assert [sort for sort, _ in _false(one, said, statements, seen)] == sorts


#: Laboratories of which something false was said once: a contradiction called outliers, a cause
#: that is none, an outlier that is one; an offset in every sweep called noise; a box that the model
#: refuses for the most part; two peaks of one experiment called noise; a wrong law and a drift
#: called noise, or outliers next to each other.
ONCE_FALSE = (
    *(("joint", seed) for seed in (1005, 1014, 1018, 1041, 1113, 1637)),
    *(("maps", seed) for seed in (1041, 1203, 1212, 1312, 1503, 1505, 1506)),
    *(("noise", seed) for seed in (1208, 1628)),
    *(("traces", seed) for seed in (1103, 1643)),
)


@pytest.mark.nightly
@pytest.mark.parametrize(("kind", "seed"), ONCE_FALSE)
def test_nothing_false_is_said_any_more(kind: str, seed: int, tmp_path: Path) -> None:
    made = KINDS[kind](seed)
    fmu = build_fmu.build(made.model, tmp_path, native=())
    assert judged(made, fmu).false == ()


def test_a_record_is_read_as_it_was_kept() -> None:
    plain = {
        "kind": "maps",
        "seed": 1,
        "variant": "complex",
        "mistake": "",
        "code": 0,
        "status": "converged",
        "said": [],
        "findings": ["offset: map"],
        "warnings": [],
        "false": [["blank", "d1"]],
        "notes": [],
        "seen": [0.0, 0.0],
        "runs": 3,
        "processor_s": 1.0,
        "error": "",
    }
    assert read(plain).false == (("blank", "d1"),)
