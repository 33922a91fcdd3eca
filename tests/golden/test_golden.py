"""Whole outputs of every command against the texts that are kept (`tests.golden.texts`)."""

from __future__ import annotations

from pathlib import Path

import pytest

from fitting.api import progress
from fitting.cli.words.parser import COMMANDS
from tests.golden.texts import HERE, SCENES, LaidOut, golden_text, laid_out, masked

#: Their output is a shell's program, a page, draws of a sampler, or times of another machine.
ELSEWHERE = {"completion", "help", "posterior", "tradeoff"}
#: Characters in a line of the texts that are kept.
WIDTH = "100"


@pytest.fixture(scope="module")
def scene(swift_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> LaidOut:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", WIDTH)
        for name in ("FIRST_S", "MOST_S"):  # as of every test: its lines come on a busy machine
            patch.setattr(progress, name, 1e6)
        return laid_out(tmp_path_factory.mktemp("golden"), swift_fmu)


@pytest.mark.parametrize("command", SCENES)
def test_a_command_prints_what_is_kept(
    command: str, scene: LaidOut, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", WIDTH)
    kept = (HERE / f"{command}.txt").read_text("utf-8")
    assert golden_text(command, scene, tmp_path / "scene") == kept


def test_every_command_has_its_text() -> None:
    assert set(SCENES) | ELSEWHERE == set(COMMANDS)
    assert {path.stem for path in HERE.glob("*.txt")} == set(SCENES)


def test_numbers_and_times_are_left_open() -> None:
    text = "d1 = 94.2 ± 1e-3 Hz   in 2 runs, 3 min\ntook 13 s: 1 to fit\nq1 fits\nexit code 4\n"
    assert masked(text) == "d1 = # ± # Hz in # runs, # s\nq1 fits\nexit code 4\n"
