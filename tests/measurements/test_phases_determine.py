"""What phases of the paper's series determine that amplitudes do not, against mpmath at 50 digits.

The paper's two series, q1 and q2, with its angle and damping: singular values of d ln X/d(theta,
ln d1, ln d2), two rows for each complex value, what is solved inside taken out.
"""

from __future__ import annotations

from collections.abc import Sequence

import mpmath as mp
import numpy as np
import pytest

import fitting as ff
from fitting.campaign import Setup
from fitting.text.arrays import ComplexArray, FloatArray
from tests.support.modes_mpmath import log_responses

PAIRS = {
    "q1_hybrid": 6940260.0 + np.outer([100.0, 80.0, 60.0, 20.0, 10.0], [-1.0, 1.0]),
    "q2_hybrid": 7027600.0 + np.outer([100.0, 80.0, 60.0, 20.0, 10.0], [-1.0, 1.0]),
}
ETA = (6940210.0 + 25.0 * np.arange(5), 7027550.0 + 25.0 * np.arange(5))
TRUTH = np.array([1.9498, 120.0, 90.0])
SETUP = Setup(
    ff.Drive(frequency_names=("u1", "u2"), amplitude_names=("A1", "A2")),
    "q1_hybrid",
    start_values={"periodic_start": True},
    steady_start=True,
    accuracy=1e-9,
)
PARAMETERS = (
    ff.Parameter("theta", 1.9498, bounds=(1.6, 3.1), scale=0.01),
    ff.Parameter("d1", 120.0, bounds=(60.0, 240.0), scale=1.0),
    ff.Parameter("d2", 90.0, bounds=(45.0, 180.0), scale=1.0),
)


def exact(p: Sequence[object], outputs: Sequence[str], *, reflection: bool = False) -> list[mp.mpc]:
    """ln X of all values at 50 digits."""
    return [
        value
        for output in outputs
        for pair, plus, minus in zip(PAIRS[output], *ETA, strict=True)
        for value in log_responses(p, pair, (plus, minus), output, reflection=reflection)
    ]


def slopes(outputs: Sequence[str]) -> ComplexArray:
    """d ln X/d(theta, ln d1, ln d2) at 50 digits, rounded, (values, 3)."""
    with mp.workdps(50):
        at, step, columns = [mp.mpf(float(v)) for v in TRUTH], mp.mpf(10) ** -18, []
        for k, size in enumerate((mp.mpf(1), at[1], at[2])):
            ends = []
            for sign in (1, -1):
                moved = list(at)
                moved[k] += sign * step * size
                ends.append(exact(moved, outputs))
            columns.append([complex((a - b) / (2 * step)) for a, b in zip(*ends, strict=True)])
    return np.array(columns).T


def truth_of(outputs: Sequence[str], unknown: str) -> FloatArray:
    """Singular values (3,) of the rows; "amplitudes": of those alone."""
    matrix = slopes(outputs)
    if unknown == "amplitudes":
        return np.asarray(np.linalg.svd(matrix.real, compute_uv=False))
    if unknown != "none":
        matrix = matrix - 1j * np.mean(matrix.imag, axis=0)
    if unknown == "gain":
        matrix = matrix - np.mean(matrix.real, axis=0)
    rows = np.concatenate([matrix.real, matrix.imag])
    return np.asarray(np.linalg.svd(rows, compute_uv=False))


def tones_of(outputs: Sequence[str], unknown: str) -> list[ff.Tones]:
    """The campaign with exact values, a record for each output."""
    with mp.workdps(50):
        point = [mp.mpf(float(v)) for v in TRUTH]
        every = {
            output: np.array([complex(mp.exp(v)) for v in exact(point, [output])]).reshape(5, 2)
            for output in outputs
        }
    return [
        ff.Tones(
            SETUP,
            PAIRS[output],
            np.abs(values) if unknown == "amplitudes" else values,
            settings={"eta_plus": ETA[0].tolist(), "eta_minus": ETA[1].tolist()},
            labels=[f"{output}{m}" for m in range(5)],
            output=output,
            amplitude_unit="m",
            unknown="phase" if unknown == "amplitudes" else unknown,
        )
        for output, values in every.items()
    ]


@pytest.mark.parametrize(
    ("unknown", "smallest"),
    [("amplitudes", 7.3e-5), ("none", 1.05e-3), ("phase", 1.05e-3), ("gain", 1.05e-3)],
)
def test_singular_values_are_those_at_fifty_digits(
    unknown: str, smallest: float, swift: ff.Fmu
) -> None:
    """Both series with one reference phase: the angle is seen 14 times better than by amplitudes.

    To first order it turns the response by D12 over the distance of the modes; the amplitude
    changes by the square of that.
    """
    outputs = tuple(PAIRS)
    problem = ff.Problem(swift, PARAMETERS, tones_of(outputs, unknown))
    scaled = problem.jac(TRUTH) * np.array([1.0, TRUTH[1], TRUTH[2]])
    wanted = truth_of(outputs, unknown)
    assert np.linalg.svd(scaled, compute_uv=False) == pytest.approx(wanted, rel=1e-3)
    assert wanted[2] == pytest.approx(smallest, rel=0.01)


def test_no_phase_tells_modes_apart_that_were_exchanged() -> None:
    """theta -> 3 pi/2 - theta, d1 <-> d2 in the other form of T is the same D and C: X is equal."""
    with mp.workdps(50):
        theta, d1, d2 = (mp.mpf(float(v)) for v in TRUTH)
        here = exact([theta, d1, d2], tuple(PAIRS))
        there = exact([3 * mp.pi / 2 - theta, d2, d1], tuple(PAIRS), reflection=True)
        assert max(abs(a - b) for a, b in zip(here, there, strict=True)) < mp.mpf(10) ** -45


def test_phases_tell_the_sign_of_the_coupling_by_damping() -> None:
    """D12 -> -D12, form and widths as they are: phases change to first order, amplitudes do not."""
    with mp.workdps(50):
        point = [mp.mpf(float(v)) for v in TRUTH]
        here, there = (exact(point, tuple(PAIRS), reflection=r) for r in (False, True))
        apart = np.array([complex(a - b) for a, b in zip(here, there, strict=True)])
    assert np.max(np.abs(apart.real)) < 2e-6
    across = np.cos(TRUTH[0]) * np.sin(TRUTH[0]) * (TRUTH[1] - TRUTH[2])
    turned = 2.0 * abs(across) / float(np.mean(ETA[1] - ETA[0]))
    assert np.ptp(apart.imag) == pytest.approx(turned, rel=0.01)


def test_one_pair_of_complex_values_tells_width_and_drift_apart(swift: ff.Fmu) -> None:
    """Two amplitudes of unknown gain are one number for two unknowns; with phases there are two.

    Derivatives of ln X by ln w and by the offset over 30 Hz, against those at 50 digits.
    """
    with mp.workdps(50):
        pair, step = PAIRS["q1_hybrid"][2], mp.mpf(10) ** -18

        def at(log_width: object, offset: object) -> list[mp.mpc]:
            p = [
                mp.mpf(float(TRUTH[0])),
                *(mp.mpf(float(d)) * mp.exp(log_width) for d in TRUTH[1:]),
            ]
            eta = (mp.mpf(6940270) + 30 * mp.mpf(offset), mp.mpf(7027600))
            return log_responses(p, pair, eta, "q1_hybrid")

        columns = [
            [complex((a - b) / (2 * step)) for a, b in zip(up, down, strict=True)]
            for up, down in ((at(step, 0), at(-step, 0)), (at(0, step), at(0, -step)))
        ]
        values = np.array([[complex(mp.exp(v)) for v in at(0, 0)]])
    matrix = np.array(columns).T
    matrix = matrix - np.mean(matrix, axis=0)
    wanted = np.linalg.svd(np.concatenate([matrix.real, matrix.imag]), compute_uv=False)
    settings = {"theta": TRUTH[0], "d2": TRUTH[2], "eta_minus": 7027600.0}
    tones = ff.Tones(SETUP, [pair], values, settings=settings, unknown="gain", amplitude_unit="m")
    parameters = [
        ff.Parameter("d1", 120.0, bounds=(60.0, 240.0)),
        ff.Parameter("eta_plus", 6940270.0, bounds=(6940170.0, 6940370.0)),
    ]
    share = float(np.cos(TRUTH[0]) ** 2 * TRUTH[1])
    share /= share + float(np.sin(TRUTH[0]) ** 2 * TRUTH[2])
    jacobian = ff.Problem(swift, parameters, tones).jac([120.0, 6940270.0])
    scaled = jacobian * np.array([120.0 / share, 30.0])
    assert np.linalg.svd(scaled, compute_uv=False) == pytest.approx(wanted, rel=2e-3)
    assert wanted[1] > 0.1
    assert np.linalg.matrix_rank(matrix.real) == 1
