"""Laboratories like a synthetic curve: its record read back from its truth, drawn with any seed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import fitting as ff
from fitting.lab.instruments import LockIns
from fitting.lab.names import CURVES
from fitting.text.errors import BadInput


@pytest.mark.parametrize("kind", CURVES)
def test_the_same_seed_gives_the_same_data_again(kind: str, tmp_path: Path) -> None:
    """Numbers that are not those of the built-in curve, and another seed."""
    made = ff.synthesize_curves(kind, seed=3, out=tmp_path / "one", noise=0.02)
    again = ff.synthesize(tmp_path / "one" / "campaign.toml", seed=3)
    assert again.truth == made.truth
    for name, text in made.files.items():
        body, same = (_rows(str(each)) for each in (text, again.files[name]))
        assert same == body, name
    other = ff.synthesize(tmp_path / "one" / "truth.toml", seed=4)
    assert other.files.keys() == made.files.keys()
    assert other.truth["outcome"]["seed"] == 4


def _rows(text: str) -> list[str]:
    """Without remarks: these name the command."""
    return [line for line in text.splitlines() if not line.startswith("#")]


def test_other_numbers_are_taken_and_unknown_ones_refused(tmp_path: Path) -> None:
    ff.synthesize_curves("crossing", out=tmp_path)
    quiet = ff.synthesize(tmp_path / "campaign.toml", noise=0.0)
    assert quiet.truth["curve"]["noise"] == 0.0
    with pytest.raises(BadInput, match="crest_v"):
        ff.synthesize(tmp_path / "campaign.toml", crest_v=1.0)
    with pytest.raises(BadInput, match="instrument"):
        ff.synthesize(tmp_path / "campaign.toml", instrument=LockIns(0.01))


def test_a_truth_of_no_curve_is_refused_with_its_file(tmp_path: Path) -> None:
    path = tmp_path / "truth.toml"
    for text in ('[curve]\nkind = "spiral"\n', '[curve]\nkind = ["notch"]\n', "[curve]\n"):
        path.write_text(text, "utf-8")
        with pytest.raises(BadInput, match=r"truth\.toml: \[curve\]"):
            ff.synthesize(path)


def test_an_ensemble_like_a_crossing_has_a_seed_for_each_laboratory(tmp_path: Path) -> None:
    made = ff.synthesize_curves("crossing", seed=5, out=tmp_path, noise=0.02)
    many = ff.Laboratories(tmp_path / "campaign.toml", 2, seed=5).portable
    files = [replace(many, seed=seed).first().files["map.csv"] for seed in (5, 6)]
    assert _rows(str(files[0])) == _rows(str(made.files["map.csv"]))
    assert _rows(str(files[1])) != _rows(str(files[0]))
