"""Small faults of several commands: what is counted, joined, named, dropped."""

from __future__ import annotations

import shlex
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import fitting as ff
from fitting.api.problem import one_fmu
from fitting.cli.running.campaigns import command_again
from fitting.cli.words.parser import parsed
from fitting.ensembles.api import Ensemble
from fitting.ensembles.result import FAILED
from fitting.text.errors import BadInput
from fitting.text.notation import with_unit
from tests.support.in_process import told

CAMPAIGN = """\
title = "one mode"
[fmu]
file = "{fmu}"
[observe]
output = "q1"
"""


def campaign(folder: Path, fmu: str) -> Path:
    """Two keys of it are wrong."""
    folder.mkdir(parents=True)
    path = folder / "campaign.toml"
    path.write_text(CAMPAIGN.format(fmu=fmu) + "wrong = 1\nalso_wrong = 2\n", "utf-8")
    return path


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Ensemble:
    """An ensemble of two campaigns that cannot be read, each with a copy of one FMU."""
    folder = tmp_path_factory.mktemp("many")
    paths = [campaign(folder / name, "own.fmu") for name in ("a", "b")]
    for path in paths:
        (path.parent / "own.fmu").write_bytes(b"an FMU")
    with ThreadPoolExecutor(1) as pool:
        return ff.ensemble(paths, executor=pool)


def test_two_paths_of_one_content_are_one_fmu(many: Ensemble) -> None:
    assert many.provenance["FMU"].count("SHA-256") == 1


def test_several_errors_of_one_campaign_are_told_apart(many: Ensemble) -> None:
    """Each names its key; a reader sees where one ends."""
    for row in many.rows:
        assert row.status == FAILED
        assert row.message.count(row.label) == 3
        assert row.message.count(f"; {row.label}") == 2


def test_an_error_within_an_error_is_one_line_of_several_sentences() -> None:
    two = BadInput("a: is missing", "b: is missing")
    assert f"file.toml: {two}" == "file.toml: a: is missing; b: is missing"
    assert str(two).splitlines() == ["a: is missing", "b: is missing"]


def test_campaigns_fitted_together_may_write_one_fmu_in_two_ways(tmp_path: Path) -> None:
    for name in ("one", "other"):
        ff.synthesize_curves("notch", out=tmp_path / name)
        text = (tmp_path / name / "campaign.toml").read_text("utf-8")
        own = text.replace('model = "CoupledOscillator"', 'file = "own.fmu"')
        assert own != text
        (tmp_path / name / "campaign.toml").write_text(own, "utf-8")
        (tmp_path / name / "own.fmu").write_bytes(b"an FMU")
    both = [ff.read_campaign(tmp_path / n / "campaign.toml") for n in ("one", "other")]
    assert one_fmu(both).file == both[0].file.fmu.file
    (tmp_path / "other" / "own.fmu").write_bytes(b"another one")
    with pytest.raises(BadInput, match="wanted the same in campaigns"):
        one_fmu(both)


def test_a_value_without_a_unit_has_no_brackets() -> None:
    assert (with_unit("r", ""), with_unit("r", "1"), with_unit("f", "Hz")) == ("r", "r", "f (Hz)")


def test_an_ensemble_without_a_report_writes_its_tables_alone(
    many: Ensemble, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ff, "ensemble", lambda *given, **asked: many)
    out = tmp_path / "out"
    ended = told("ensemble", tmp_path / "campaign.toml", "--no-report", "--out", out)
    assert ended.code == 1, ended.err  # neither has a fit
    written = {path.name for path in out.rglob("*") if path.is_file()}
    assert {"ensemble.json", "ensemble.csv", "ensemble.md"} <= written
    assert not {name for name in written if name.endswith((".html", ".svg", ".png"))}


@pytest.mark.parametrize(
    "words",
    [
        "posterior c.toml --at r.json --workers 2 --no-report --isolate --json --log l --seed 3",
        "reconstruct c.toml --start s.ssv --isolate --no-report --quiet --external lambda=1kHz",
        "ensemble c.toml --out o --no-report --scheduler tcp://10.0.0.1:8786 --json --value d1",
    ],
)
def test_a_command_goes_on_with_every_option_that_it_was_given(words: str) -> None:
    given = parsed(words.split())
    again = shlex.split(command_again(given))
    assert {**vars(parsed(again[1:])), "parser": None} == {
        **vars(given),
        "parser": None,
        "resume": True,
    }
    assert shlex.split(command_again(parsed(again[1:]))) == again


@pytest.mark.parametrize("steps", ["--steps 300", "--steps=300", "--st 300", ""])
def test_the_steps_are_those_that_are_wanted_next(steps: str) -> None:
    given = f"posterior c.toml --at r.json {steps} --seed 3".split()
    found = parsed(shlex.split(command_again(parsed(given), steps=1200))[1:])
    assert (found.steps, found.seed, found.resume) == (1200, 3, True)
