"""An FMU file as the archive that it is: what cannot be unpacked is refused before anything is."""

from __future__ import annotations

import io
import lzma
import shutil
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path, PurePosixPath, PureWindowsPath

from fitting.text.errors import BadInput
from fitting.text.results_folder import write_whole
from fitting.text.scratch import Scratch

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
                try:
                    archive.extract(member, folder)
                except OSError:
                    raise
                except _DAMAGED as error:
                    raise BadInput(
                        f"{path}: {member.filename} in it is damaged ({error})"
                    ) from error
        except OSError as error:
            raise BadInput(
                f"{path}: cannot be unpacked to {folder.parent}: {error.strerror} (set TMPDIR)"
            ) from error


def compiled(path: Path, out: Path) -> Path:
    """Compile the sources of an FMU for this machine; the FMU with the binary, in a folder.

    Args:
        path: of the FMU.
        out: folder for the new one, named by this platform.

    Raises:
        BadInput: it has no sources, or they cannot be compiled here.
    """
    import fmpy

    with Scratch() as scratch:
        folder = scratch / "fmu"
        unpack(path, folder)
        if not (folder / "sources").is_dir():
            raise BadInput(f"{path}: has no sources, wanted the folder sources in it")
        # what it prints is kept; it goes by cmake, and knows what the description lists
        words = "import sys; from fmpy.build import build_platform_binary as b; b(sys.argv[1])"
        command = [sys.executable, "-c", words, str(folder)]
        made = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
        if made.returncode:
            lines = f"{made.stdout}\n{made.stderr}".splitlines()
            why = [line.strip() for line in lines if "rror" in line] or ["no message"]
            raise BadInput(f"{path}: its sources cannot be compiled: {why[0]}")
        new = out / f"{path.stem}_{fmpy.platform}.fmu"
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            for file in sorted(p for p in folder.rglob("*") if p.is_file()):
                archive.write(file, file.relative_to(folder))
        write_whole(new, packed.getvalue())
    return new


def _opened(path: Path) -> zipfile.ZipFile:
    """The archive, its list of members checked."""
    try:
        archive = zipfile.ZipFile(path)
    except OSError as error:
        raise BadInput(f"{path}: cannot be read: {error.strerror}") from error
    except Exception as error:  # half a dozen kinds for a damaged list of members
        raise BadInput(f"{path}: is not an FMU ({error})") from error
    why = _refusal(archive.infolist())
    if why:
        archive.close()
        raise BadInput(f"{path}: {why}")
    return archive


def _refusal(members: list[zipfile.ZipInfo]) -> str:
    """Why an archive is not unpacked; empty: it is."""
    if len(members) > MOST_MEMBERS:
        return f"holds {len(members)} files, wanted {MOST_MEMBERS} at most"
    size = sum(member.file_size for member in members)
    if size > MOST_UNPACKED:
        return f"unpacks to {_megabytes(size)} MB, wanted {_megabytes(MOST_UNPACKED)} MB at most"
    for member in members:
        name, method = member.filename, member.compress_type
        if member.flag_bits & _ENCRYPTED:
            return f"{name} in it is encrypted, wanted a plain one"
        if method not in _KNOWN:
            return (
                f"{name} in it is packed by method {method}, which is unknown here; wanted deflate"
            )
        windows = PureWindowsPath(name)  # on any system
        if windows.drive or windows.root or ".." in windows.parts:
            return f"{name} in it would be written outside its folder"
    names = [PurePosixPath(member.filename) for member in members]
    files: dict[PurePosixPath, int] = {}
    for path, member in zip(names, members, strict=True):
        # some tools pack a file twice
        if not member.is_dir() and files.setdefault(path, member.CRC) != member.CRC:
            return f"holds {path} twice, with different content, wanted once"
    for path in names:
        inside = next((folder for folder in path.parents if folder in files), None)
        if inside is not None:
            return f"{inside} in it is a file and the folder of {path}"
    return ""


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.6g}"
