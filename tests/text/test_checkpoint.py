"""Finished parts of a job on disk: what comes back, what is refused, what is said."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from fitting.text.checkpoint import Checkpoint
from fitting.text.errors import BadInput


@dataclass(frozen=True)
class Part:
    """A finished part."""

    name: str
    value: float


def kept(path: Path, job: str = "one", every_s: float = 0.0) -> Checkpoint[Part]:
    return Checkpoint(path, job, Part, lambda part: part.name, every_s)


def test_parts_come_back_and_a_later_one_of_a_key_counts(tmp_path: Path) -> None:
    first = kept(tmp_path / "c.json")
    for part in (Part("a", 1 / 3), Part("b", float("inf")), Part("a", 1e-300)):
        first.record(part)
    again = kept(tmp_path / "c.json")
    assert again.resume()
    assert (again.find("a"), again.find("b"), again.find("c")) == (
        Part("a", 1e-300),
        Part("b", float("inf")),
        None,
    )
    said = again.resumed("levels")
    assert said.startswith("2 ")
    assert said.endswith(f" {tmp_path / 'c.json'}")


def test_no_file_is_said_in_a_sentence(tmp_path: Path) -> None:
    empty = kept(tmp_path / "c.json")
    assert not empty.resume()
    assert str(tmp_path / "c.json") in empty.resumed("levels")


def test_another_job_and_a_file_that_is_none_are_refused(tmp_path: Path) -> None:
    kept(tmp_path / "c.json").record(Part("a", 1.0))
    with pytest.raises(BadInput, match=r"c\.json: "):
        kept(tmp_path / "c.json", "two").resume()
    (tmp_path / "c.json").write_text('{"job": "one", "finished": [{"name": "a"}]}')
    with pytest.raises(BadInput, match=r"finished\[0\]: .*'value'"):
        kept(tmp_path / "c.json").resume()


def test_a_patient_checkpoint_writes_when_asked(tmp_path: Path) -> None:
    slow = kept(tmp_path / "c.json", every_s=1e9)
    slow.record(Part("a", 1.0))
    assert not (tmp_path / "c.json").exists()
    slow.write()
    read = kept(tmp_path / "c.json")
    assert read.resume()
    assert len(read) == 1
    slow.remove()
    assert not (tmp_path / "c.json").exists()
