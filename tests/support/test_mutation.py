"""Faults that are put into the code are faults: one place changes, and the text still compiles."""

from __future__ import annotations

import ast
from pathlib import Path

from tests.support.mutation import mutants_of, mutated

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


def test_a_fault_changes_one_place_of_a_text_that_still_compiles(tmp_path: Path) -> None:
    (tmp_path / "f.py").write_text(SOURCE)
    for mutant in mutants_of(tmp_path, "f.py"):
        changed = mutated(SOURCE, mutant)
        ast.parse(changed)
        differing = [a != b for a, b in zip(SOURCE.split("\n"), changed.split("\n"), strict=True)]
        assert differing.count(True) == 1
        assert differing.index(True) == mutant.line - 1
