"""Mistakes of a laboratory are named by kind, and none where none was made.

The laboratories are those of `tests.support.virtual`: closed form, other numbers than the paper's,
their files written and read. What was done wrong is known.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import fitting as ff
from fitting.inference.warnings import Kind, Warned
from tests.support.virtual.answers import ModesResponse
from tests.support.virtual.kinds import KINDS

#: Kinds of warnings that name a mistake.
MISTAKES = {Kind.SWEEP, Kind.SCALE_FACTOR, Kind.SWAPPED, Kind.LINES}


def warned_of(kind: str, seed: int, folder: Path) -> list[Warned]:
    """What a fit of that laboratory warns of, mistakes only."""
    laboratory = KINDS[kind](seed)
    record = ff.Problem.of(laboratory.write(folder), ff.Fmu("CoupledOscillator")).record
    problem = ff.Problem.answered_by(lambda chosen: ModesResponse(record, chosen), record)
    found = ff.fit(problem, ff.Tikhonov(nu=1e-3, levels=3), starts=1)
    return [w for w in found.inferred.warnings if w.kind in MISTAKES]


@pytest.mark.parametrize(
    ("seed", "kind", "words"),
    [
        (0, Kind.SCALE_FACTOR, r"1\.4\d+.* one of them were rms"),
        (1, Kind.SCALE_FACTOR, r"2\.00\d+.* driven twice as hard"),
        (2, Kind.SWEEP, r"the power 1\.9\d+.* decibels"),
        (3, Kind.SWEEP, r"are equal: it is clipped.* scale of the peaks is taken from this sweep"),
        (4, Kind.SWEEP, r"stands on a background"),
        (5, Kind.SWEEP, r"One point of the sweep, at 1\.32761414 kHz"),
        (6, Kind.SWAPPED, r"pair3: its peaks .* changed places"),
        (7, Kind.LINES, r"hold a line at none of the declared tones"),
    ],
)
def test_a_mistake_is_named_by_its_kind(seed: int, kind: Kind, words: str, tmp_path: Path) -> None:
    said = warned_of("misuse", seed, tmp_path)
    assert any(w.kind is kind and re.search(words, w.sentence) for w in said), said


@pytest.mark.parametrize(("kind", "seed"), [("pairs", 4), ("readings", 5), ("joint", 3)])
def test_nothing_is_named_where_nothing_is_wrong(kind: str, seed: int, tmp_path: Path) -> None:
    assert KINDS[kind](seed).honest
    assert warned_of(kind, seed, tmp_path) == []
