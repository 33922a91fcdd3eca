"""Campaigns with phases of the virtual laboratory: what is written is what was put in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.lab.instruments import LockIns
from fitting.measurements.tones import ComplexTones
from fitting.text.errors import BadInput
from tests.support.modes_mpmath import log_responses


def test_values_are_those_of_fifty_digits_behind_an_unknown_reference(
    oscillator_fmu: Path, tmp_path: Path
) -> None:
    """Both modes of five pairs, restarted before the third; without noise."""
    reader = LockIns(phases=True, restarts=(2,))
    made = ff.synthesize("q1", seed=2, instrument=reader, noise_scale=0.0, out=tmp_path)
    problem = ff.Problem.of(tmp_path / "campaign.toml", ff.Fmu(oscillator_fmu, workers=1))
    [tones] = [m for m in problem.record.measurements if isinstance(m, ComplexTones)]
    assert tones.solved_inside == 2
    turns = []
    for k, e in enumerate(tones.experiments):
        modes, output = made.measured.true_modes[k // 2], ("q1_hybrid", "q2_hybrid")[k % 2]
        assert (e.output or tones.setup.output) == output
        eta = (modes.eta_plus_hz, modes.eta_minus_hz)
        exact = log_responses([1.9498, 120.0, 90.0], e.tones_hz, eta, output)
        measured = tones.y[2 * k : 2 * k + 2] / made.measured.gain
        turns.append(measured / np.exp([complex(v) for v in exact]))
    assert np.abs(turns) == pytest.approx(1.0, rel=1e-9)
    first, second = np.array(turns[:4]).ravel(), np.array(turns[4:]).ravel()
    assert first == pytest.approx(first[0], abs=1e-9)
    assert second == pytest.approx(second[0], abs=1e-9)
    assert abs(first[0] - second[0]) > 0.1
    assert tones.sigma == pytest.approx(0.01)


def test_noise_is_alike_on_both_quadratures() -> None:
    made = ff.synthesize("q1", seed=4, instrument=LockIns(noise=0.02, phases=True))
    exact = ff.synthesize("q1", seed=4, instrument=LockIns(phases=True), noise_scale=0.0)
    ratio = [
        (m.measured.array("x_v") + 1j * m.measured.array("y_v")).ravel() for m in (made, exact)
    ]
    left = ratio[0] / ratio[1] - 1.0
    assert np.std(left.real) == pytest.approx(0.02, rel=0.5)
    assert np.std(left.imag) == pytest.approx(0.02, rel=0.5)


@pytest.mark.parametrize(
    ("series", "reader", "words"),
    [
        ("q1", LockIns(both=False, phases=True, restarts=(5,)), r"pair 6, .*2 to 5"),
        ("duffing", LockIns(both=False, phases=True), r"lock-in"),
    ],
)
def test_what_the_bench_cannot_do_is_refused(series: str, reader: LockIns, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        ff.synthesize(series, instrument=reader)
