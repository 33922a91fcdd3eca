"""The clock of a command: what is told of its parts adds up to the whole."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from fitting.cli.main import main
from fitting.cli.running.laps import Laps
from tests.support.string_part import string_part

pytestmark = pytest.mark.usefixtures("swift_models")


def test_each_part_is_told_from_the_end_of_the_one_before() -> None:
    times = iter([10.0, 12.25, 20.25, 20.5])
    laps = Laps(clock=lambda: next(times))
    for name in ("to begin", "to fit", "for the report"):
        laps.end(name)
    assert laps.words == "took 10.5 s: 2.2 to begin, 8.0 to fit, 0.2 for the report"


def test_a_reconstruction_ends_with_the_time_that_it_took(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = string_part(tmp_path / "q1")
    words = ["reconstruct", str(path), "--out", str(tmp_path / "out"), "--quick"]
    assert main([*words, "--no-profiles", "--no-report"]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    found = re.fullmatch(r"took ([\d.]+) s: ([\d.]+) to begin, ([\d.]+) to fit", last)
    assert found is not None, last
    whole, *parts = map(float, found.groups())
    assert abs(whole - sum(parts)) < 0.11
