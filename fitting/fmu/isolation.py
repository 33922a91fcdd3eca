"""What an FMU may take while it is isolated: an FMU is somebody else's program."""

from __future__ import annotations

import ctypes
import math
import platform
import sys
from dataclasses import dataclass
from typing import Literal

from fitting.text.arguments import checked
from fitting.text.errors import BadInput

MB = 10**6
#: Whether an FMU runs isolated; "strict": or not at all.
Isolate = bool | Literal["strict"]
#: Files that a worker itself has open while it loads an FMU.
LEAST_FILES = 24
#: Landlock's system call for a set of rules has one number on every processor; its flag for which
#: version there is.
CREATE_RULESET, VERSION = 444, 1
#: The versions of Landlock that keep from cutting files short, from devices and from signals.
TRUNCATES, CONTROLS, SIGNALS = 3, 5, 6
GET_SECCOMP = 21
#: Name of the processor, as a filter of system calls knows it, and the place of its numbers among
#: those of each call.
PROCESSORS = {"x86_64": (0xC000003E, 0), "aarch64": (0xC00000B7, 1)}


@checked
@dataclass(frozen=True, kw_only=True)
class Isolation:
    """Limits of each worker process of an isolated FMU.

    It also writes only into its own folder and has no network, as far as the system enforces that
    (Linux); else a warning.

    Args:
        memory_mb: Memory beyond the worker's own, MB.
        processor_s: Processor time of one run, s.
        files: Open files.
        written_mb: Size of its folder, MB.
        strict: Whether a system that cannot enforce all is an error.

    Raises:
        BadInput: a number that is not positive; ``strict``, and this system cannot hold all of it.
    """

    memory_mb: float = 2000.0
    processor_s: float = 60.0
    files: int = 64
    written_mb: float = 200.0
    strict: bool = False

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name != "strict" and not 0.0 < value < math.inf:
                raise BadInput(f"isolate: {name} is {value!r}, wanted a positive number")
        if self.files < LEAST_FILES:
            raise BadInput(
                f"isolate: files is {self.files!r}, wanted {LEAST_FILES} at least, for the worker"
            )
        if self.strict and (missing := lacks()):
            raise BadInput(f"isolate: this system cannot hold all of it: {'; '.join(missing)}")

    @property
    def words(self) -> str:
        """The limits in words."""
        return (
            f"{self.memory_mb:g} MB of memory, {self.processor_s:g} s of processor time a run, "
            f"{self.files} open files, {self.written_mb:g} MB written"
        )


def lacks(*, kept: bool = True, filtered: bool = True) -> tuple[str, ...]:
    """What this system cannot keep from an isolated FMU, a part of a sentence each.

    Args:
        kept: whether it was kept to a folder, where the system has that.
        filtered: whether its calls are refused, where the system has that.
    """
    version = landlock_version() if kept else 0
    missing = []
    if version < 1:
        missing.append("it may write files elsewhere, control devices and send signals")
    elif version < SIGNALS:
        may = "send signals to your other processes"
        may = may if version >= CONTROLS else f"control devices, and {may}"
        missing.append(f"it may {may if version >= TRUNCATES else f'empty files elsewhere, {may}'}")
    can_filter = sys.platform == "linux" and platform.machine() in PROCESSORS
    if not (filtered and can_filter and ctypes.CDLL(None).prctl(GET_SECCOMP, 0, 0, 0, 0) >= 0):
        missing.append(
            "it may use the network, and change what belongs to files and to the machine"
        )
    return tuple(missing)


def landlock_version() -> int:
    """Version of Landlock, which keeps a program to a folder; below 1: there is none."""
    if sys.platform != "linux":
        return 0
    return int(ctypes.CDLL(None).syscall(CREATE_RULESET, None, ctypes.c_size_t(0), VERSION))
