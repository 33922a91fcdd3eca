"""How a layout uses a library that reads its format: asked for where missing, and contained."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fitting.text.errors import BadInput


@contextmanager
def needed(path: Path, kind: str, extra: str) -> Iterator[None]:
    """Within, a library is imported that reads this file; without it the complaint says what to do.

    Args:
        path: of the file.
        kind: of the file, as "a Touchstone file".
        extra: of this package that brings the library.

    Raises:
        BadInput: the library is not there.
    """
    try:
        yield
    except ImportError as error:
        raise BadInput(
            f"{path}: is {kind}; to read it: pip install 'fmu-fit[{extra}]' ({error})"
        ) from error


@contextmanager
def understood(path: Path, kind: str) -> Iterator[None]:
    """Within, a library reads a file: whatever it raises is a complaint about the file.

    Libraries have no errors of their own for files that are broken; what comes out is whatever the
    first wrong byte leads to. Their warnings are about the format, not about the data.

    Args:
        path: of the file.
        kind: that it should be, as "a Touchstone file".

    Raises:
        BadInput: names the file and says what the library said.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except BadInput:
        raise
    except Exception as error:
        said = " ".join(str(error).split())[:200]
        name = type(error).__name__
        raise BadInput(
            f"{path}: cannot be read as {kind}: {name}{': ' if said else ''}{said}"
        ) from error
