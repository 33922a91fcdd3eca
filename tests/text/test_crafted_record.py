"""A record of files that somebody made up: nothing is removed or replaced on its word alone."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from threading import Thread

import pytest

from fitting.ensembles import ITEMS_FILE
from fitting.lab.synthesis import Synthetic
from fitting.text.errors import BadInput
from fitting.text.journal import Journal
from fitting.text.results_folder import (
    LOCK_NAME,
    RECORD_NAME,
    remove_earlier,
    results_folder,
    write_whole,
)
from tests.support.in_process import told

TEXT = "first line\nsecond line\n"
WHOLE = hashlib.sha256(TEXT.encode()).hexdigest()
FIRST = "first line " + hashlib.sha256(b"first line\n").hexdigest()
posix = pytest.mark.skipif(sys.platform == "win32", reason="links and pipes of POSIX")


def crafted(folder: Path, names: dict[str, str], command: str = "synthesize") -> Path:
    folder.mkdir(exist_ok=True)
    files = {name: {"command": command, "sha256": [digest]} for name, digest in names.items()}
    (folder / RECORD_NAME).write_text(json.dumps({"files": files}))
    return folder


def synthesized(folder: Path) -> bool:
    """Whether a synthetic campaign was written there."""
    try:
        Synthetic(truth={}, files={"campaign.toml": "new"}).write(folder)
    except BadInput:
        return False
    return True


@pytest.mark.parametrize("digest", [WHOLE, FIRST], ids=["whole", "first line"])
@pytest.mark.parametrize("name", ["../victim", "a/../../victim", "absolute"])
def test_nothing_outside_the_folder_goes(tmp_path: Path, name: str, digest: str) -> None:
    """Nor the folder that held it: an empty one beside would go with its last file."""
    victim = tmp_path / "beside" / "sweep.csv"
    victim.parent.mkdir()
    victim.write_text(TEXT)
    shown = str(victim) if name == "absolute" else name.replace("victim", "beside/sweep.csv")
    out = crafted(tmp_path / "out", {shown: digest})
    (out / "a").mkdir()
    synthesized(out)
    assert victim.read_text() == TEXT


def test_the_command_itself_keeps_what_lies_outside(tmp_path: Path) -> None:
    (tmp_path / "sweep.csv").write_text(TEXT)
    out = crafted(tmp_path / "out", {"../sweep.csv": FIRST, str(tmp_path / "sweep.csv"): WHOLE})
    told("synthesize", "--series", "ringdown", "--out", out)
    assert (tmp_path / "sweep.csv").read_text() == TEXT


@posix
def test_nothing_behind_a_link_goes(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    victim = tmp_path / "mine" / "pair1.csv"
    victim.write_text(TEXT)
    out = crafted(tmp_path / "out", {"spectra/pair1.csv": WHOLE, "sweep.csv": WHOLE})
    (out / "spectra").symlink_to(tmp_path / "mine")
    (out / "sweep.csv").symlink_to(victim)
    synthesized(out)
    assert victim.read_text() == TEXT
    assert (out / "sweep.csv").is_symlink()


@pytest.mark.parametrize(
    ("name", "digest"),
    [("notes.txt", WHOLE), ("spectra/deep/a.csv", WHOLE), ("sweep.csv", FIRST), ("map.csv", "")],
)
def test_inside_the_folder_only_whole_files_of_the_commands_own_names_go(
    tmp_path: Path, name: str, digest: str
) -> None:
    out = crafted(tmp_path / "out", {name: digest, "trace.csv": WHOLE})
    (out / name).parent.mkdir(parents=True, exist_ok=True)
    for each in (name, "trace.csv"):
        (out / each).write_text(TEXT)
    assert synthesized(out)
    assert (out / name).read_text() == TEXT
    assert not (out / "trace.csv").exists()  # which an earlier campaign of these names left


@pytest.mark.parametrize(
    "name", ["../.victim.abcdefgh.part", ".notes.txt.abcdefgh.part", ".sweep.csv.mine.part"]
)
def test_only_parts_of_the_commands_own_files_go(tmp_path: Path, name: str) -> None:
    out = crafted(tmp_path / "out", {"notes.txt": WHOLE, "sweep.csv": WHOLE})
    if name.startswith(".."):
        crafted(out, {"../victim": WHOLE})
    (out / name).write_text(TEXT)
    try:
        with results_folder(out, "synthesize", ["sweep.csv"]):
            pass
    except BadInput:
        pass
    assert (out / name).read_text() == TEXT


def pipe(path: Path) -> None:
    os.mkfifo(path)


def link(path: Path) -> None:
    (path.parent / "record").write_text('{"files": {}}')
    path.symlink_to("record")


def link_to_nothing(path: Path) -> None:
    path.symlink_to("nothing")


def large(path: Path) -> None:
    path.write_text('{"files": {}}' + " " * 17 * 2**20)


def nested(path: Path) -> None:
    path.write_text('{"files": ' + "[" * 200_000)


MADE = [pipe, Path.mkdir, link, link_to_nothing, large, nested]


@posix
@pytest.mark.parametrize("make", MADE)
def test_a_record_that_is_none_is_refused_at_once(
    tmp_path: Path, make: Callable[[Path], None]
) -> None:
    make(tmp_path / RECORD_NAME)
    refused: list[str] = []

    def opened() -> None:
        try:
            with results_folder(tmp_path, "synthesize"):
                write_whole(tmp_path / "sweep.csv", "new")
        except BadInput as error:
            refused.append(str(error))

    thread = Thread(target=opened, daemon=True)  # one that waits for a pipe waits for ever
    thread.start()
    thread.join(20)
    assert len(refused) == 1
    assert RECORD_NAME in refused[0]
    assert not (tmp_path / "sweep.csv").exists()


@posix
def test_nothing_is_written_behind_a_link(tmp_path: Path) -> None:
    """A folder of figures that leads elsewhere, to files that the command did not write."""
    mine = tmp_path / "mine" / "1_a.png"
    mine.parent.mkdir()
    mine.write_text("mine")
    out = tmp_path / "out"
    out.mkdir()
    (out / "figures").symlink_to(mine.parent)
    with pytest.raises(BadInput), results_folder(out, "reconstruct", ["figures/[0-9]*_*.*"]):
        pass
    with results_folder(out, "reconstruct"), pytest.raises(BadInput):
        write_whole(out / "figures" / "1_a.png", "drawn")
    assert mine.read_text() == "mine"


@posix
@pytest.mark.parametrize("target", ["mine", "nothing"])
def test_a_link_in_the_place_of_a_result_is_kept(tmp_path: Path, target: str) -> None:
    (tmp_path / "mine").write_text(TEXT)
    out = crafted(tmp_path / "out", {"result.json": WHOLE}, "reconstruct")
    (out / "result.json").symlink_to(tmp_path / target)
    with pytest.raises(BadInput), results_folder(out, "reconstruct", ["result.json"]):
        pass
    with results_folder(out, "reconstruct"), pytest.raises(BadInput):
        write_whole(out / "result.json", "{}")
    assert (out / "result.json").is_symlink()


@posix
@pytest.mark.parametrize("make", [pipe, link])
def test_a_lock_that_is_no_file_is_kept(tmp_path: Path, make: Callable[[Path], None]) -> None:
    make(tmp_path / LOCK_NAME)
    with pytest.raises(BadInput), results_folder(tmp_path, "sweep"):
        pass
    assert os.path.lexists(tmp_path / LOCK_NAME)


def test_the_folders_of_two_names_of_one_file_are_refused(tmp_path: Path) -> None:
    """Else a file just written could go as one of an earlier job."""
    digest = hashlib.sha256(b"new").hexdigest()
    out = crafted(tmp_path / "out", {"./campaign.toml": digest, "campaign.toml": WHOLE})
    (out / "campaign.toml").write_text(TEXT)
    synthesized(out)
    assert (out / "campaign.toml").exists()


@pytest.mark.parametrize("at", [0, 1, 2])
def test_a_journal_of_which_any_line_was_changed_is_kept(tmp_path: Path, at: int) -> None:
    path = tmp_path / ITEMS_FILE
    with results_folder(tmp_path, "ensemble", [ITEMS_FILE]):
        kept = Journal(path, "job", int)
        kept.record(1)
        kept.record(2)
    lines = path.read_text().splitlines(keepends=True)
    lines[at] = lines[at].rstrip("\n") + " \n"
    path.write_text("".join(lines))
    with pytest.raises(BadInput), results_folder(tmp_path, "ensemble", [ITEMS_FILE]):
        pass
    with results_folder(tmp_path, "ensemble"):
        remove_earlier(tmp_path, [ITEMS_FILE])
    assert path.read_text() == "".join(lines)
