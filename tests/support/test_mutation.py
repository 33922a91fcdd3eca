"""Faults that are put into the code are faults: one place changes, and the text still compiles."""

from __future__ import annotations

import ast
import shutil
from pathlib import Path

from tests.bench.bench_mutants import ARGUED, ROOT, Covered, Limits, measured, report
from tests.support.mutation import Argued, Mutant, argued_in, mutants_of, mutated

SOURCE = '''
def f(x: float = 2.0) -> float:
    """Not 3.0 here."""
    return -x * 2.5 if x >= 1 and not x == 4 else min(x, 7)
'''


def test_every_kind_of_fault_is_found(tmp_path: Path) -> None:
    (tmp_path / "f.py").write_text(SOURCE)
    found = {(m.before, m.after) for m in mutants_of(tmp_path, "f.py")}
    assert {("*", "/"), (">=", "<"), ("and", "or"), ("not ", ""), ("-", "")} <= found
    assert {("==", "!="), ("min", "max"), ("2.5", "5.0"), ("7", "8"), ("2.0", "4.0")} <= found
    assert not any("3.0" in before for before, _ in found)
    (tmp_path / "g.py").write_text("pairs = list(zip([1], [2], strict=True))\n")
    assert {m.before for m in mutants_of(tmp_path, "g.py")} == {"1", "2"}


def test_a_fault_changes_one_place_of_a_text_that_still_compiles(tmp_path: Path) -> None:
    (tmp_path / "f.py").write_text(SOURCE)
    for mutant in mutants_of(tmp_path, "f.py"):
        changed = mutated(SOURCE, mutant)
        ast.parse(changed)
        differing = [a != b for a, b in zip(SOURCE.split("\n"), changed.split("\n"), strict=True)]
        assert differing.count(True) == 1
        assert differing.index(True) == mutant.line - 1


# --- the sample


def mutant(path: str, line: int, before: str = "2.0", after: str = "4.0") -> Mutant:
    return Mutant(path=path, line=line, column=0, before=before, after=after)


def test_a_fault_is_asked_of_tests_that_run_its_line_within_its_limits() -> None:
    seconds = {"tests/fit/a": 5.0, "tests/fit/b": 1.0, "tests/models/c": 2.0, "tests/models/d": 9.0}
    covered = Covered(
        {
            ("fitting/fit/x.py", 3): ("tests/fit/a", "tests/fit/b"),
            ("fitting/fit/x.py", 9): ("tests/fit/a",),
            ("fmu_src/y.py", 1): ("tests/models/d",),
        },
        seconds,
    )
    everything = Limits(100.0)
    assert covered.of(mutant("fitting/fit/x.py", 3), everything) == ["tests/fit/b", "tests/fit/a"]
    assert covered.of(mutant("fitting/fit/x.py", 9), everything) == ["tests/fit/a"]
    # a line that no test runs by itself runs on import: all tests of its file
    assert len(covered.of(mutant("fitting/fit/x.py", 1), everything)) == 2
    assert covered.of(mutant("fitting/fit/z.py", 1), everything) == []
    assert covered.of(mutant("fitting/fit/x.py", 3), Limits(5.5)) == ["tests/fit/b"]
    assert covered.of(mutant("fitting/fit/x.py", 9), Limits(1.0)) == ["tests/fit/a"]  # one at least
    assert covered.of(mutant("fitting/fit/x.py", 3), Limits(100.0, 1)) == ["tests/fit/b"]
    # inside an FMU no line is seen: all tests of the models, those that are known to run it first
    assert covered.of(mutant("fmu_src/y.py", 1), everything) == ["tests/models/d", "tests/models/c"]


def test_tests_named_like_the_file_come_first_then_those_that_run_little_else() -> None:
    """A quick test that runs everything asks little of a line."""
    whole, few, own = "tests/fit/test_a.py::w", "tests/fit/test_b.py::f", "tests/fit/test_x.py::o"
    covered = Covered(
        {
            ("fitting/fit/x.py", 3): (whole, few, own),
            ("fitting/fit/x.py", 4): (whole, own),
            ("fitting/fit/y.py", 9): (whole, own),
        },
        {whole: 1.0, few: 2.0, own: 7.0},
    )
    assert covered.of(mutant("fitting/fit/x.py", 3), Limits(100.0)) == [own, few, whole]


CACHED = """from functools import cache


@cache
def twice(x: int) -> int:
    return 2 * x


def thrice(x: int) -> int:
    return 3 * x
"""
ASKING = """import pytest
from hypothesis import given, strategies
from fitting.signal.x import thrice, twice


@pytest.fixture(scope="module")
def six() -> int:
    return thrice(2)


def test_of_a_fixture(six: int) -> None:
    assert six == 6


def test_first() -> None:
    assert twice(3) == 6


@pytest.mark.parametrize("x", [3], ids=["three, a name with blanks"])
def test_second(x: int) -> None:
    assert twice(x) == 6


@given(strategies.integers())
def test_drawn(k: int) -> None:
    assert twice(k) == k + k
"""


def test_lines_are_seen_of_drawn_cases_and_behind_a_cache(tmp_path: Path) -> None:
    """Every test that needs a line is known to run it: one that remembers its answer, too.

    A line that a fixture runs is known of all tests of its file.
    """
    texts = {"fitting/signal/x.py": CACHED, "fmu_src/y.py": "", "tests/signal/test_x.py": ASKING}
    for name, text in texts.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True)
        file.write_text(text)
    for folder in {file.parent for file in tmp_path.rglob("*.py")} | {tmp_path / "fitting"}:
        (folder / "__init__.py").touch()
    shutil.copytree(ROOT / "tests/support", tmp_path / "tests/support")
    (tmp_path / "tests/__init__.py").touch()
    covered = measured(tmp_path, ["tests/signal/test_x.py"])
    wanted = {f"tests/signal/test_x.py::test_{name}" for name in ("first", "second", "drawn")}
    assert set(covered.tests["fitting/signal/x.py", 6]) == wanted
    everything = wanted | {"tests/signal/test_x.py::test_of_a_fixture"}
    assert set(covered.tests["fitting/signal/x.py", 10]) == everything
    assert set(covered.seconds) == everything


def test_the_report_tells_what_survived_and_what_is_argued(tmp_path: Path) -> None:
    """Also of files that are gone, and of faults that were not tried."""
    (tmp_path / "fmu_src").mkdir()
    (tmp_path / "fmu_src" / "y.py").write_text("a = 2.0\nb = 2.0\n")
    sample = [
        mutant("fmu_src/y.py", 1),
        mutant("fmu_src/y.py", 2),
        mutant("fitting/fit/gone.py", 7),
        mutant("fitting/fit/gone.py", 8),
    ]
    verdicts = dict(
        zip([m.name for m in sample[:3]], ["survived", "survived", "killed"], strict=True)
    )
    argued = [
        Argued(path="fmu_src/y.py", line="  a = 2.0", reason="any number does"),
        Argued(path="fmu_src/y.py", line="b = 2.0", reason="never", faults=("2.0 -> 3.0",)),
        Argued(path="fitting/fit/gone.py", line="c", reason="gone"),
    ]
    text = report(tmp_path, sample, verdicts, argued)
    assert "| fmu_src | 2 | 0 (0 %) | 1 | 0 | 1 | 0 |" in text
    assert "| fitting/fit | 2 | 1 (100 %) | 0 | 0 | 0 | 1 |" in text
    assert "| all | 4 | 1 (33 %) | 1 | 0 | 1 | 1 |" in text
    assert f"\n{sample[1].name}\n" in text
    assert f"{sample[0].name}: any number does" in text
    assert "no such line any more: fitting/fit/gone.py: c" in text


def test_everything_that_is_argued_stands_in_the_code_and_can_be_put_there() -> None:
    argued = argued_in(ARGUED)
    for path in {each.path for each in argued}:  # all faults of a file are found but once
        faults = list(mutants_of(ROOT, path))
        for each in (each for each in argued if each.path == path):
            assert each.stands(ROOT), each
            said = {f"{m.before} -> {m.after}" for m in faults if each.says(ROOT, m)}
            assert said, each
            assert set(each.faults) <= said, each
