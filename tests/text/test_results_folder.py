"""Folders of results: nothing is replaced that the same command did not write, one at a time."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from threading import Thread

import pytest

from fitting.text.errors import BadInput
from fitting.text.results_folder import (
    LOCK_NAME,
    RECORD_NAME,
    remove_earlier,
    results_folder,
    write_whole,
)

HOLD = """
import sys
from pathlib import Path
from fitting.text.results_folder import write_whole
from fitting.text.results_folder import results_folder
with results_folder(Path(sys.argv[1]), "sweep"):
    write_whole(Path(sys.argv[1]) / "sweep.csv", "theirs")
    print("open", flush=True)
    sys.stdin.readline()
"""


def put(folder: Path, command: str, **files: str) -> None:
    with results_folder(folder, command, files):
        for name, text in files.items():
            write_whole(folder / name, text)


def names(folder: Path) -> list[str]:
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def test_what_the_command_wrote_it_may_write_again(tmp_path: Path) -> None:
    for text in ("one", "two", "three"):
        put(tmp_path, "sweep", result=text)
    assert (tmp_path / "result").read_text() == "three"
    assert names(tmp_path) == [RECORD_NAME, "result"]


@pytest.mark.parametrize(
    ("command", "content", "words"),
    [
        (None, "measured", "is there already, and fmu-fit sweep did not write it"),
        ("synthesize", None, "was written by fmu-fit synthesize, not by sweep"),
        ("sweep", "edited", "was changed since fmu-fit sweep wrote it"),
    ],
)
def test_what_others_wrote_is_kept_and_nothing_else_written(
    tmp_path: Path, command: str | None, content: str | None, words: str
) -> None:
    if command is not None:
        put(tmp_path, command, data="written")
    if content is not None:
        (tmp_path / "data").write_text(content)
    before = {name: (tmp_path / name).read_bytes() for name in names(tmp_path)}
    with pytest.raises(BadInput, match=words) as refused:
        put(tmp_path, "sweep", first="new", data="new")
    assert str(tmp_path / "data") in str(refused.value)
    assert "(--out)" in str(refused.value)
    assert {name: (tmp_path / name).read_bytes() for name in names(tmp_path)} == before


def test_a_file_that_no_pattern_foretold_is_kept_too(tmp_path: Path) -> None:
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "mine.png").write_text("mine")
    with results_folder(tmp_path, "sweep", ["figures/[0-9]*.png"]):
        write_whole(tmp_path / "figures" / "1_a.png", "ours")
        with pytest.raises(BadInput, match=r"mine\.png: "):
            write_whole(tmp_path / "figures" / "mine.png", "ours")
        write_whole(tmp_path / "figures" / "mine.png", "mine")  # the very same: nothing is lost
    with (
        pytest.raises(BadInput, match=r"mine\.png: "),
        results_folder(tmp_path, "sweep", ["figures/*.png"]),
    ):
        pass
    assert (tmp_path / "figures" / "mine.png").read_text() == "mine"


def test_a_folder_in_which_nothing_was_written_is_gone_again(tmp_path: Path) -> None:
    with results_folder(tmp_path / "a" / "b", "sweep"):
        assert (tmp_path / "a" / "b" / LOCK_NAME).exists()
    assert not list(tmp_path.iterdir())


def test_the_innermost_open_folder_knows_the_file(tmp_path: Path) -> None:
    with results_folder(tmp_path, "design"), results_folder(tmp_path / "next", "synthesize"):
        write_whole(tmp_path / "next" / "sub" / "a", "a")
        write_whole(tmp_path / "b", "b")
    put(tmp_path / "next", "synthesize", **{"sub/a": "new"})
    with pytest.raises(BadInput, match="fmu-fit design"):
        put(tmp_path, "synthesize", b="new")


def test_opened_again_within_itself_it_is_the_same(tmp_path: Path) -> None:
    with results_folder(tmp_path, "sweep"):
        put(tmp_path, "sweep", a="a")
        assert (tmp_path / LOCK_NAME).exists()
    assert names(tmp_path) == [RECORD_NAME, "a"]


def test_a_checkpoint_that_is_done_leaves_no_trace(tmp_path: Path) -> None:
    with results_folder(tmp_path / "out", "sweep"):
        write_whole(tmp_path / "out" / "checkpoint", "1")
        (tmp_path / "out" / "checkpoint").unlink()
    assert not list(tmp_path.iterdir())


def test_a_second_thread_is_refused(tmp_path: Path) -> None:
    said: list[str] = []

    def other() -> None:
        try:
            put(tmp_path, "sweep", a="other")
        except BadInput as error:
            said.append(str(error))

    with results_folder(tmp_path, "sweep"):
        thread = Thread(target=other)
        thread.start()
        thread.join()
    assert len(said) == 1
    assert said[0].startswith(f"{tmp_path}: ")
    assert not names(tmp_path)


def test_a_second_process_is_refused_and_takes_over_when_the_first_is_killed(
    tmp_path: Path,
) -> None:
    """No lock outlives its process, and what a killed one wrote is still known as its own."""
    words = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as held:
        assert held.stdout is not None
        assert held.stdout.readline() == "open\n"
        with pytest.raises(BadInput, match=re.escape(f"{tmp_path}: ")):
            put(tmp_path, "sweep", **{"sweep.csv": "ours"})
        assert (tmp_path / "sweep.csv").read_text() == "theirs"
        os.kill(held.pid, getattr(signal, "SIGKILL", signal.SIGTERM))
        held.wait()
    assert (tmp_path / LOCK_NAME).exists()
    put(tmp_path, "sweep", **{"sweep.csv": "ours"})
    assert names(tmp_path) == [RECORD_NAME, "sweep.csv"]
    assert (tmp_path / "sweep.csv").read_text() == "ours"


def test_killed_while_a_file_is_replaced_both_contents_are_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The record is ahead of the file: whichever of the two is there, the command may go on."""
    put(tmp_path, "sweep", a="old")
    replace = os.replace

    def killed(source: str, target: Path) -> None:
        if Path(target).name == "a":
            raise KeyboardInterrupt
        replace(source, target)

    monkeypatch.setattr(os, "replace", killed)
    with pytest.raises(KeyboardInterrupt):
        put(tmp_path, "sweep", a="new")
    monkeypatch.undo()
    assert (tmp_path / "a").read_text() == "old"
    put(tmp_path, "sweep", a="newer")
    assert (tmp_path / "a").read_text() == "newer"


KILLED_IN_WRITING = """
import os, signal, sys
from pathlib import Path
from fitting.text.results_folder import write_whole
from fitting.text.results_folder import results_folder

os.fsync = lambda handle: os.kill(os.getpid(), signal.SIGKILL) if armed else None
folder, armed = Path(sys.argv[1]), False
with results_folder(folder, "sweep", ["sweep.csv"]):
    write_whole(folder / "sweep.csv", "old")
    armed = True
    write_whole(folder / "sweep.csv", "new")
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_what_a_killed_process_left_half_written_is_removed(tmp_path: Path) -> None:
    (tmp_path / ".mine.csv.part").write_text("somebody's own")
    script = [sys.executable, "-c", KILLED_IN_WRITING, str(tmp_path)]
    killed = subprocess.run(script, check=False)
    assert killed.returncode == -signal.SIGKILL
    assert len(list(tmp_path.glob(".*.part"))) == 2
    put(tmp_path, "sweep", **{"sweep.csv": "newer"})
    assert names(tmp_path) == [RECORD_NAME, ".mine.csv.part", "sweep.csv"]


def again(folder: Path, *patterns: str, **files: str) -> None:
    """What a command does that leaves nothing of an earlier job."""
    with results_folder(folder, "sweep"):
        for name, text in files.items():
            write_whole(folder / name, text)
        remove_earlier(folder, patterns or ("*", "figures/*"))


def test_what_the_command_wrote_before_and_not_now_goes(tmp_path: Path) -> None:
    put(tmp_path, "sweep", **{"a": "old", "b": "old", "same": "same", "figures/1.png": "old"})
    again(tmp_path, a="new", same="same")
    assert names(tmp_path) == [RECORD_NAME, "a", "same"]
    assert not (tmp_path / "figures").exists()
    put(tmp_path, "synthesize", b="theirs")  # nothing that is gone is claimed any more
    assert (tmp_path / "b").read_text() == "theirs"


def test_nothing_goes_that_the_command_did_not_write(tmp_path: Path) -> None:
    put(tmp_path, "sweep", **{"edited": "old", "swept": "old", "figures/1.png": "old"})
    put(tmp_path, "synthesize", theirs="theirs")
    (tmp_path / "edited").write_text("by hand")
    for name in ("mine", "figures/mine.png"):
        (tmp_path / name).write_text("mine")
    again(tmp_path, a="new")
    kept = [RECORD_NAME, "a", "edited", "figures/mine.png", "mine", "theirs"]
    assert names(tmp_path) == kept


def test_only_what_was_foretold_goes_and_only_when_the_work_is_done(tmp_path: Path) -> None:
    put(tmp_path, "sweep", **{"checkpoint": "old", "figures/1.png": "old", "figures/2.svg": "old"})
    before = names(tmp_path)
    with pytest.raises(RuntimeError), results_folder(tmp_path, "sweep"):
        raise RuntimeError
    assert names(tmp_path) == before
    again(tmp_path, "figures/[0-9]*.png", "*.png", a="new")
    assert names(tmp_path) == [RECORD_NAME, "a", "checkpoint", "figures/2.svg"]


def test_what_is_no_folder_or_no_record_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match=r"file: "):
        put(tmp_path / "file", "sweep", a="a")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / RECORD_NAME).write_text("[]")
    with pytest.raises(BadInput, match=re.escape(f"{RECORD_NAME}: ")):
        put(tmp_path / "out", "sweep", a="a")
    assert names(tmp_path / "out") == [RECORD_NAME]
    (tmp_path / "out" / RECORD_NAME).unlink()
    (tmp_path / "out" / "a").mkdir()
    with pytest.raises(BadInput, match=r"out/a: "):
        put(tmp_path / "out", "sweep", a="a")
