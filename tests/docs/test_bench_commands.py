"""The table of benchmarks: whole, and with the settings that the documentation names."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path

import pytest

from tests.bench import __main__ as bench
from tests.bench.commands import COMMANDS, ROOT, Command

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
#: `python -m tests.bench.bench_x ...`, or as a file.
NAMED = re.compile(r"python (?:-m tests\.bench\.bench_(\w+)|tests/bench/bench_(\w+)\.py)([^`#\n]*)")


def named() -> list[tuple[str, str]]:
    """Name and settings of every benchmark that a page names; environments of others left out."""
    found = set()
    for page in PAGES:
        for module, file, settings in NAMED.findall(page.read_text("utf-8")):
            words = re.sub(r"--\w+ PYTHON", "", settings).split()
            found.add((module or file, " ".join(words)))
    return sorted(found)


def test_every_benchmark_has_a_row() -> None:
    files = {path.stem.removeprefix("bench_") for path in Path(bench.__file__).parent.glob("b*.py")}
    names = [command.name for command in COMMANDS]
    assert files <= set(names)
    assert len(names) == len(set(names))


@pytest.mark.parametrize(("name", "settings"), named())
def test_what_the_documentation_names_is_run(name: str, settings: str) -> None:
    [command] = [command for command in COMMANDS if command.name == name]
    assert settings in command.full


def test_a_command_that_fails_is_told_and_its_result_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By a benchmark that prints a table, and one that is not there."""
    rows = (Command("argued", "prints", full=("3",)), Command("absent", "is not there"))
    monkeypatch.setattr(bench, "COMMANDS", rows)
    monkeypatch.setattr(
        bench.Run,
        "words",
        property(
            lambda self: [
                sys.executable,
                "-c",
                f"print('| a |'); raise SystemExit({self.command.name == 'absent':d})",
            ]
        ),
    )
    assert bench.main(["--results", str(tmp_path)]) == 1
    out, err = capsys.readouterr()
    assert "bench_absent" in err
    assert "bench_argued" not in err
    table = (tmp_path / "README.md").read_text()
    assert out.splitlines()[:2] == table.splitlines()[:2]
    ended = {line.split(" | ")[0]: line.split(" | ")[1] for line in table.splitlines()[2:]}
    assert sorted(ended.values()) == ["0", "1"]
    assert "| a |" in (tmp_path / "argued-3.md").read_text()
    assert bench.main(["--only", "argued", "--results", str(tmp_path)]) == 0
    assert len((tmp_path / "README.md").read_text().splitlines()) == 4  # rows of others stay


def test_a_short_run_ends_what_takes_too_long_and_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench, "COMMANDS", (Command("slow", "sleeps"),))
    words = [sys.executable, "-c", "import time; time.sleep(60)"]
    monkeypatch.setattr(bench.Run, "words", property(lambda self: words))
    monkeypatch.setattr(bench, "LONGEST_S", 0.5)
    assert bench.main(["--smoke", "--results", str(tmp_path)]) == 1
    assert not list(tmp_path.iterdir())


def test_settings_are_words_of_a_shell() -> None:
    texts = [text for c in COMMANDS for text in (*c.full, c.smoke, *c.before)]
    assert all(shlex.split(text) is not None for text in texts)
    assert any(command.quick for command in COMMANDS)
