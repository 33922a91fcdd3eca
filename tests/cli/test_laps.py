"""The clock of a command: what is told of its parts adds up to the whole."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from fitting.cli.main import main
from fitting.cli.running.progress import Laps
from tests.support.small_campaign import small_campaign


def test_each_part_is_told_from_the_end_of_the_one_before() -> None:
    times = iter([10.0, 12.25, 20.25, 20.5])
    laps = Laps(clock=lambda: next(times))
    names = ("to begin", "to fit", "for the report")
    for name in names:
        laps.end(name)
    assert re.findall(r"[\d.]+", laps.words) == ["10.5", "2.2", "8.0", "0.2"]
    assert all(name in laps.words for name in names)


def test_a_reconstruction_ends_with_the_time_that_it_took(
    swift_fmu: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = small_campaign(tmp_path / "q1", swift_fmu)
    words = ["reconstruct", str(path), "--out", str(tmp_path / "out"), "--workers", "1"]
    assert main([*words, "--no-profiles", "--no-report", "--verbose"]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    found = re.fullmatch(r"took ([\d.]+) s: ([\d.]+) to begin, ([\d.]+) to fit", last)
    assert found is not None, last
    whole, *parts = map(float, found.groups())
    assert abs(whole - sum(parts)) < 0.11
