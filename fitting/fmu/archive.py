"""An FMU file as the archive that it is: what cannot be unpacked is refused before anything is."""

from __future__ import annotations

import lzma
import shutil
import zipfile
import zlib
from collections import Counter
from pathlib import Path, PurePosixPath, PureWindowsPath

from fitting.text.errors import BadInput

#: An FMU that unpacks to more is taken for a bomb: models of this kind have some megabytes.
MOST_UNPACKED = 4 * 2**30
MOST_MEMBERS = 100_000
_ENCRYPTED = 0x1  # bit of a member's flags
_KNOWN = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
#: What `zipfile` raises while it unpacks a damaged member.
_DAMAGED = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    EOFError,
    NotImplementedError,
    RuntimeError,
    ValueError,
)


def member_names(path: Path) -> list[str]:
    """Names of the files in an FMU that this machine can unpack.

    Args:
        path: of the file.

    Raises:
        BadInput: no archive; a member that is encrypted, packed in an unknown way, named twice or
            to be written outside the folder; or more than anybody wants to unpack.
    """
    with _opened(path) as archive:
        return archive.namelist()


def unpack(path: Path, folder: Path) -> None:
    """Unpack an FMU into a folder.

    Args:
        path: of the file.
        folder: that is made, in one that is there.

    Raises:
        BadInput: as `member_names`; a member is damaged, or the disk has no room for it.
    """
    with _opened(path) as archive:
        size = sum(member.file_size for member in archive.infolist())
        try:
            room = shutil.disk_usage(folder.parent).free
            if size > room:
                raise BadInput(
                    f"{path}: unpacks to {_megabytes(size)} MB, but {folder.parent} has room for "
                    f"{_megabytes(room)} MB (set TMPDIR)"
                )
            for member in archive.infolist():
                _extract(archive, member, folder, path)
        except OSError as error:
            raise BadInput(
                f"{path}: cannot be unpacked to {folder.parent}: {error.strerror} (set TMPDIR)"
            ) from error


def _extract(archive: zipfile.ZipFile, member: zipfile.ZipInfo, folder: Path, path: Path) -> None:
    try:
        archive.extract(member, folder)
    except OSError:
        raise
    except _DAMAGED as error:
        raise BadInput(f"{path}: {member.filename} in it is damaged ({error})") from error


def _opened(path: Path) -> zipfile.ZipFile:
    """The archive, its list of members checked."""
    try:
        archive = zipfile.ZipFile(path)
    except OSError as error:
        raise BadInput(f"{path}: cannot be read: {error.strerror}") from error
    except Exception as error:  # half a dozen kinds for a damaged list of members
        raise BadInput(f"{path}: is not an FMU ({error})") from error
    try:
        _check(archive.infolist(), path)
    except BaseException:
        archive.close()
        raise
    return archive


def _check(members: list[zipfile.ZipInfo], path: Path) -> None:
    if len(members) > MOST_MEMBERS:
        raise BadInput(f"{path}: holds {len(members)} files, wanted {MOST_MEMBERS} at most")
    size = sum(member.file_size for member in members)
    if size > MOST_UNPACKED:
        raise BadInput(
            f"{path}: unpacks to {_megabytes(size)} MB, wanted {_megabytes(MOST_UNPACKED)} MB at "
            "most"
        )
    for member in members:
        if member.flag_bits & _ENCRYPTED:
            raise BadInput(f"{path}: {member.filename} in it is encrypted, wanted a plain one")
        if member.compress_type not in _KNOWN:
            raise BadInput(
                f"{path}: {member.filename} in it is packed by method {member.compress_type}, "
                "which is unknown here; wanted deflate"
            )
        if _leaves(member.filename):
            raise BadInput(f"{path}: {member.filename} in it would be written outside its folder")
    names = [PurePosixPath(member.filename) for member in members]
    often, count = Counter(names).most_common(1)[0] if names else (PurePosixPath(), 0)
    if count > 1:
        raise BadInput(f"{path}: holds {often} {count} times, wanted once")
    files = {n for n, member in zip(names, members, strict=True) if not member.is_dir()}
    for name in names:
        inside = next((folder for folder in name.parents if folder in files), None)
        if inside is not None:
            raise BadInput(f"{path}: {inside} in it is a file and the folder of {name}")


def _leaves(name: str) -> bool:
    """Whether the name of a member points out of the folder, on any system."""
    windows = PureWindowsPath(name)
    return bool(windows.drive or windows.root) or ".." in windows.parts


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.6g}"
