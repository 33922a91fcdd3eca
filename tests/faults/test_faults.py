"""A sample of the table of faults: of every kind that needs no process of its own.

The whole table is `python -m tests.bench.bench_faults`.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.faults.all_of_them import KINDS, Kind, whole_table
from tests.faults.campaign_keys import COMMAND, schema_keys
from tests.faults.case import Case, Ending, judged, problems
from tests.faults.scene import Scene, built


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory, swift_fmu: Path) -> Scene:
    return built(tmp_path_factory.mktemp("faults"), swift_fmu)


def test_without_a_fault_the_campaign_is_fitted(scene: Scene, tmp_path: Path) -> None:
    whole = Case(kind="none", name="none", words=COMMAND, about=("",), codes=(0,))
    assert problems(whole, scene, tmp_path / "case") == []


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind.in_process], ids=str)
def test_faults_are_told_and_nothing_is_left(kind: Kind, scene: Scene, tmp_path: Path) -> None:
    found = {case.name: problems(case, scene, tmp_path / "case") for case in kind.sample()}
    assert {name: what for name, what in found.items() if what} == {}
    assert len(found) >= 4


@pytest.mark.nightly
@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_every_fault_of_the_table_is_told(kind: Kind, scene: Scene, tmp_path: Path) -> None:
    found = {case.name: problems(case, scene, tmp_path / "case") for case in kind.all_cases()}
    assert {name: what for name, what in found.items() if what} == {}


def test_the_whole_table_is_large_and_touches_every_key() -> None:
    whole = whole_table()
    assert len(whole) >= 4500
    assert sum(len(kind.sample()) for kind in KINDS if kind.in_process) >= 200
    assert len({(case.kind, case.name) for case in whole}) == len(whole)
    keys = {case.name.partition(":")[0] for case in whole if case.kind == str(KINDS[0])}
    assert keys == {".".join(map(str, key)) for key in schema_keys()}


@pytest.mark.parametrize(
    ("code", "complaint", "what"),
    [
        (70, "fmu-fit: a fault of this program: KeyError\n", "exit code 70"),
        (1, "", ""),
        (1, "Traceback\n", "but stderr"),
        (2, "", "0 lines"),
        (2, "fmu-fit: a.csv: bad\n" * 30, "30 lines"),
        (2, "warning\nfmu-fit: a.csv: bad\n", "unlike a complaint"),
        (2, "fmu-fit: something is wrong\n", "names nothing"),
        (2, "fmu-fit: a.csv: bad\n", ""),
    ],
)
def test_what_survival_takes(code: int, complaint: str, what: str) -> None:
    case = Case(kind="", name="", words=(), about=("a.csv",))
    found = judged(case, Ending(code, "", complaint))
    assert any(what in text for text in found) if what else found == []


@pytest.mark.parametrize("where", ["out", "temporary"])
def test_what_is_left_behind_is_seen(where: str, scene: Scene, tmp_path: Path) -> None:
    def leave(folder: Path) -> None:
        (folder / where).mkdir(exist_ok=True)
        (folder / where / ".half").touch()
        (folder / "campaign.toml").unlink()

    case = Case(kind="", name="", words=COMMAND, change=leave, about=("campaign.toml",))
    assert any("left in" in text for text in problems(case, scene, tmp_path / "case"))
