"""Functions that workers call in tests: found by their names, in whatever process."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import NamedTuple

#: Longest wait for something that never comes, s.
MOST_S = 300.0


class Piece(NamedTuple):
    """A number, and a folder in which a process leaves word of what it does."""

    number: int
    folder: str = ""


def squared(piece: Piece) -> tuple[int, int]:
    """The number and its square."""
    return piece.number, piece.number**2


def squared_after_a_loss(piece: Piece) -> tuple[int, int]:
    """The same; number 3 loses its worker the first time."""
    if piece.number == 3:
        _lose(Path(piece.folder) / "lost")
    return squared(piece)


def always_lost(piece: Piece) -> tuple[int, int]:
    """The same; number 3 loses its worker every time, and counts how often."""
    if piece.number == 3:
        folder = Path(piece.folder)
        _lose(folder / f"lost{len(list(folder.glob('lost*')))}")
    return squared(piece)


def _lose(mark: Path) -> None:
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)


def refusing(piece: Piece) -> tuple[int, int]:
    """Raises what no pickle can carry, for number 1."""

    class Local(Exception):
        """Known in this process alone."""

    if piece.number == 1:
        raise Local("one is refused")
    return squared(piece)


def endless(piece: Piece) -> None:
    """Leaves its process's number, and goes on until it is ended."""
    (Path(piece.folder) / f"pid{os.getpid()}").touch()
    until = time.monotonic() + MOST_S
    while time.monotonic() < until:
        time.sleep(0.05)


def environment(name: str) -> str:
    """A variable of the process's environment."""
    return os.environ.get(name, "")


def main_file(_: int) -> str:
    """The program of the process."""
    import __main__

    return Path(str(__main__.__file__)).name
