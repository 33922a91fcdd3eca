"""A journal: parts come back as they were, whatever moment it was cut at."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import pytest

from fitting.text.errors import BadInput
from fitting.text.journal import Journal
from fitting.text.results_folder import results_folder

NAMES = ("items.jsonl",)


@dataclass(frozen=True)
class Part:
    label: str
    value: float


PARTS = [Part("a", 0.1 + 0.2), Part("b", math.inf), Part("ü\n", -5e-324)]


def journal(folder: Path, job: str = "one") -> Journal[Part]:
    return Journal(folder / "items.jsonl", job, Part)


def written(folder: Path) -> Path:
    with results_folder(folder, "ensemble", NAMES):
        kept = journal(folder)
        for part in PARTS:
            kept.record(part)
    return folder / "items.jsonl"


def test_parts_come_back_exactly_and_more_are_added(tmp_path: Path) -> None:
    written(tmp_path)
    with results_folder(tmp_path, "ensemble", NAMES):
        kept = journal(tmp_path)
        assert list(kept.resume()) == PARTS
        kept.record(Part("c", 1.0))
    assert list(journal(tmp_path).resume()) == [*PARTS, Part("c", 1.0)]


def test_a_file_that_is_there_holds_a_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who waits for the file and then ends the job has something to go on from."""

    def killed(path: Path, data: bytes) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("fitting.text.journal.add_to_file", killed)
    journal(tmp_path).record(PARTS[0])
    assert list(journal(tmp_path).resume()) == PARTS[:1]


@pytest.mark.parametrize("cut", range(1, 40, 3))
def test_a_line_that_was_cut_is_left_out(tmp_path: Path, cut: int) -> None:
    path = written(tmp_path)
    whole = path.read_bytes()
    size = len(whole) - len(whole.splitlines(keepends=True)[-1])
    path.write_bytes(whole[: min(size + cut, len(whole) - 1)])
    with results_folder(tmp_path, "ensemble", NAMES):
        kept = journal(tmp_path)
        assert list(kept.resume()) == PARTS[:-1]
        kept.record(PARTS[-1])
    assert path.read_bytes() == whole


def test_without_resume_it_begins_anew(tmp_path: Path) -> None:
    path = written(tmp_path)
    with results_folder(tmp_path, "ensemble", NAMES):
        kept = journal(tmp_path, "two")
        assert len(path.read_text().splitlines()) == 4  # until the first part
        kept.record(PARTS[0])
    assert list(journal(tmp_path, "two").resume()) == PARTS[:1]


def test_one_of_another_job_is_refused(tmp_path: Path) -> None:
    written(tmp_path)
    with pytest.raises(BadInput, match=r"items\.jsonl: "):
        list(journal(tmp_path, "two").resume())


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("[1]\n", "items.jsonl: "),
        ("what\n", "row 1: .*JSON"),
        ('{"job": "one"}\n{"label": 3, "value": 1.0}\n', "row 2.label: .*'3'"),
    ],
)
def test_what_is_no_journal_is_refused(tmp_path: Path, content: str, words: str) -> None:
    (tmp_path / "items.jsonl").write_text(content)
    with pytest.raises(BadInput, match=words):
        list(journal(tmp_path).resume())


def test_a_file_of_others_stays(tmp_path: Path) -> None:
    (tmp_path / "items.jsonl").write_text("mine\n")
    with (
        pytest.raises(BadInput, match=r"items\.jsonl: "),
        results_folder(tmp_path, "ensemble", NAMES),
    ):
        pass


def test_one_whose_head_was_changed_stays(tmp_path: Path) -> None:
    path = written(tmp_path)
    path.write_text("another first line\n" + path.read_text())
    with pytest.raises(BadInput, match="was changed"), results_folder(tmp_path, "ensemble", NAMES):
        pass
