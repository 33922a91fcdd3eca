"""Files on mounts that refuse a part of what makes writing safe, and on disks that are full."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from fitting.text.errors import BadInput
from fitting.text.files import add_to_file, replace_file
from fitting.text.results_folder import results_folder, write_whole

Refusal = Callable[..., None]


def refused(number: int, *, where: Callable[..., bool] = lambda *_: True) -> Refusal:
    """A system call that is refused."""

    def call(*arguments: object, **_: object) -> None:
        if where(*arguments):
            raise OSError(number, os.strerror(number))

    return call


def holds_data(handle: int) -> bool:
    return os.fstat(handle).st_size > 0


@pytest.mark.parametrize("number", [errno.EINVAL, errno.EIO, errno.EROFS, errno.ENOSYS])
def test_a_mount_that_refuses_to_sync_is_written(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "fsync", refused(number))
    with results_folder(tmp_path / "out", "sweep", ("table",)):
        write_whole(tmp_path / "out" / "table", "one\n")
    path = tmp_path / "plain"
    replace_file(path, b"one\n")
    add_to_file(path, b"two\n")
    assert path.read_bytes() == b"one\ntwo\n"
    assert sorted(os.listdir(tmp_path)) == ["out", "plain"]
    assert sorted(os.listdir(tmp_path / "out")) == [".fmu-fit-files.json", "table"]


@pytest.mark.parametrize("number", [errno.EIO, errno.ENOSPC, errno.EDQUOT])
def test_a_disk_that_is_full_or_loses_data_is_told_in_the_words_of_the_system(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mount that refuses to sync a file without data as well loses none."""
    monkeypatch.setattr(os, "fsync", refused(number, where=holds_data))
    with pytest.raises(BadInput, match=os.strerror(number)), results_folder(tmp_path / "o", "line"):
        write_whole(tmp_path / "o" / "table", "one\n")
    assert not (tmp_path / "o").exists()
    replace_file(tmp_path / "plain", b"")
    with pytest.raises(BadInput, match=os.strerror(number)):
        add_to_file(tmp_path / "plain", b"two\n")


@pytest.mark.skipif(os.name == "nt", reason="modes of POSIX")
def test_a_file_has_the_mode_that_any_new_file_has(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        replace_file(tmp_path / "a", b"one")
    finally:
        os.umask(before)
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o640
