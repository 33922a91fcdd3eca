"""Folders of temporary files under a machine that refuses nearly everything; real limits."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

from fitting.text.scratch import Scratch

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="limits of POSIX")

#: Takes every file that may be open but one, then ends: what it made has to go all the same.
FULL = """
import os, resource
from fitting.text.scratch import Scratch
folder = Scratch()
deep = folder.path / "a" / "b" / "c"
deep.mkdir(parents=True)
(deep / "file").write_text("x")
(folder.path / "link").symlink_to("/")
resource.setrlimit(resource.RLIMIT_NOFILE, (40, 40))
held = []
try:
    while True:
        held.append(os.dup(0))
except OSError:
    os.close(held.pop())
folder.remove()
print(folder.path.exists())
"""
#: No file may be written anywhere: there is no folder for temporary files.
NOWHERE = """
import resource, signal
from fitting.text.errors import BadInput
from fitting.text.scratch import Scratch
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
try:
    Scratch()
except BadInput as error:
    print(error)
"""


def told(script: str, temporary: Path) -> str:
    return subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "TMPDIR": str(temporary)},
        capture_output=True,
        text=True,
        check=True,
    ).stdout


def test_a_folder_is_removed_with_one_file_left_to_be_opened(tmp_path: Path) -> None:
    assert told(FULL, tmp_path) == "False\n"
    assert list(tmp_path.iterdir()) == []


def test_no_place_for_temporary_files_is_a_sentence(tmp_path: Path) -> None:
    said = told(NOWHERE, tmp_path).splitlines()
    assert len(said) == 1
    assert "TMPDIR" in said[0]


def test_a_folder_that_is_named_as_seen_from_here_is_found_from_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As with TMPDIR=. for workers, which run in folders of their own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tempfile, "tempdir", ".")
    with Scratch() as folder:
        assert folder.parent == tmp_path
    with Scratch(Path()) as folder:
        assert folder.parent == tmp_path


def test_what_another_process_removes_at_the_same_time_is_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a worker that ends removes the FMU that it had unpacked."""
    made = Scratch(tmp_path)
    (made.path / "fmu" / "documentation").mkdir(parents=True)
    listed = os.scandir

    def gone(path: str | os.PathLike[str]) -> Any:
        if Path(path).name == "documentation":
            Path(path).rmdir()
        return listed(path)

    monkeypatch.setattr(os, "scandir", gone)
    made.remove()
    assert not made.path.exists()
