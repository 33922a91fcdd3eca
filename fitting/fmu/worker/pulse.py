"""The pulse of a worker process: numbers in memory that it shares with its caller.

They can be read while the worker is inside the FMU and answers nothing. The memory is a mapped file
beside the unpacked FMU, so that it goes when that folder goes, on every system.
"""

from __future__ import annotations

import mmap
from pathlib import Path
from typing import NamedTuple

#: Places: the run of the batch that is under way, a count of everything that was begun, whether a
#: reset instance is only being tried, whether an instance is being freed, the memory of the
#: process in bytes before there is an FMU in it, and the most that the system counts for it till
#: then.
AT_RUN, BEGUN, IN_TRIAL, FREEING, OWN_MEMORY, COUNTED_MEMORY = 0, 1, 2, 3, 4, 5
PLACES = 6
SIZE = 8  # bytes of each


class Pulse(NamedTuple):
    """The mapped file and the numbers in it, integers of 64 bits."""

    file: mmap.mmap
    numbers: memoryview

    def close(self) -> None:
        """Unmap the file, which cannot be removed before on Windows."""
        self.numbers.release()
        self.file.close()


def new_pulse(path: Path) -> Pulse:
    """A pulse at zero, in a new file.

    Args:
        path: of the file.
    """
    path.write_bytes(bytes(PLACES * SIZE))
    return open_pulse(path)


def open_pulse(path: Path) -> Pulse:
    """The pulse that the other process has made.

    Args:
        path: of the file.
    """
    with path.open("r+b") as file:
        mapped = mmap.mmap(file.fileno(), PLACES * SIZE)
    return Pulse(mapped, memoryview(mapped).cast("q"))
