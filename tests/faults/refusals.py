"""Faults of the machine while a command runs: calls that it refuses, and requests to end.

In this process: system calls are replaced by such that refuse from the n-th time on, and signals
are real ones, sent when the n-th of some calls is made.
"""

from __future__ import annotations

import contextlib
import errno
import itertools
import os
import signal
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from fitting.fmu.pool import FmuWorkers
from fitting.text import files
from tests.faults.campaign_keys import COMMAND
from tests.faults.case import HERE, INTERRUPTED, OUT, Case, drawn
from tests.faults.scene import FMU
from tests.support.asked import harmless

MOUNTS, DISKS, ENDINGS = "mounts that refuse", "disks: full, read-only, broken", "requests to end"

OUTPUT = ("--out", f"{HERE}/{OUT}")
#: Commands that write, from cheap to dear.
COMMANDS: dict[str, tuple[str, ...]] = {
    "example": ("example", "string_q1", *OUTPUT),
    "line": ("line", f"{HERE}/sweep.csv", *OUTPUT),
    "simulate": ("simulate", f"{HERE}/{FMU}", "--set", "A2=0", "--set", "u1=320", *OUTPUT),
    "fit": COMMAND,
}
#: What mounts refuse that are written all the same.
REFUSED = tuple(("fsync", n) for n in ("EINVAL", "EIO", "EROFS", "ENOSYS", "ENOTSUP", "EPERM"))
#: What a disk refuses: of a file that is begun, that is written, and that gets its name.
LOST = {
    "token_hex": (files, ("ENOSPC", "EDQUOT", "EROFS", "EACCES", "EIO", "ENAMETOOLONG")),
    "fsync": (os, ("ENOSPC", "EDQUOT")),
    "replace": (os, ("ENOSPC", "EROFS", "EACCES", "EPERM", "EIO")),
}
#: At which of these calls a signal comes.
MOMENTS: dict[str, tuple[Any, str]] = {
    "a file is begun": (files, "token_hex"),
    "a file gets its name": (os, "replace"),
    "a file is on the disk": (files, "_sync"),
    "runs are asked for": (FmuWorkers, "run"),
}
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")


@contextlib.contextmanager
def _replaced(owner: Any, name: str, made: Callable[[Any], Any]) -> Iterator[None]:
    before = getattr(owner, name)
    setattr(owner, name, made(before))
    try:
        yield
    finally:
        setattr(owner, name, before)


@contextlib.contextmanager
def _refusing(owner: Any, name: str, number: int, first: int) -> Iterator[None]:
    """A call is refused from the first time on that is told, counted from 0."""
    times = itertools.count()

    def made(plain: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:
            if next(times) >= first:
                raise OSError(number, os.strerror(number))
            return plain(*args, **kwargs)

        return call

    with _replaced(owner, name, made):
        yield


@contextlib.contextmanager
def _asked(owner: Any, name: str, signals: tuple[str, ...], at: int) -> Iterator[None]:
    """Signals are sent when a call is made, the at-th time."""
    times = itertools.count()

    def made(plain: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:
            if next(times) == at:
                for each in signals:
                    os.kill(os.getpid(), getattr(signal, each))
            return plain(*args, **kwargs)

        return call

    with contextlib.ExitStack() as stack:
        for each in SIGNALS:
            stack.enter_context(harmless(getattr(signal, each)))
        stack.enter_context(_replaced(owner, name, made))
        yield


def mount_cases(count: int, seed: int) -> Iterator[Case]:
    """Calls that are refused, and no reason to end."""
    every = itertools.product(COMMANDS, REFUSED)
    for command, (name, number) in drawn(every, count, seed):
        yield Case(
            kind=MOUNTS,
            name=f"{command}: {name} is refused, {number}",
            words=COMMANDS[command],
            about=("",),
            codes=(0,),
            during=partial(_refusing, os, name, getattr(errno, number), 0),
        )


def disk_cases(count: int, seed: int) -> Iterator[Case]:
    """Disks that take no more, from some file on: bad input, in the words of the system."""
    calls = [(n, owner, e) for n, (owner, errors) in LOST.items() for e in errors]
    every = itertools.product(range(4), ("example", "line", "simulate"), calls)
    for first, command, (name, owner, number) in drawn(every, count, seed):
        yield Case(
            kind=DISKS,
            name=f"{command}: {name} number {first + 1} and later, {number}",
            words=COMMANDS[command],
            about=(os.strerror(getattr(errno, number)),),
            codes=(2,),
            during=partial(_refusing, owner, name, getattr(errno, number), first),
            writes=True,
        )


def ending_cases(count: int, seed: int) -> Iterator[Case]:
    """Requests to end at some moment, one, and two at once."""
    asked = [(s,) for s in SIGNALS] + [("SIGINT", "SIGINT"), ("SIGTERM", "SIGHUP")]
    every = itertools.product(range(4), asked, COMMANDS, MOMENTS)
    for at, signals, command, moment in drawn(every, count, seed):
        yield Case(
            kind=ENDINGS,
            name=f"{command}: {' and '.join(signals)} when {moment}, number {at + 1}",
            words=COMMANDS[command],
            about=("",),
            codes=(0, 1, INTERRUPTED),
            during=partial(_asked, *MOMENTS[moment], signals, at),
            writes=True,
        )
