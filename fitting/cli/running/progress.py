"""Progress: a line that lives on a terminal, or one now and then in a file; times taken."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from pathlib import Path

TICK_S = 1.0  # on a terminal, where the seconds are seen to run
#: In a pipe: silence before the first line, part of the time so far between lines, and most of it.
FIRST_S, PART, MOST_S = 10.0, 0.1, 60.0
#: Files that are large together, and the silence before the first line about them.
LARGE_BYTES, LARGE_S = 1_000_000, 2.0
_HIDDEN: ContextVar[bool] = ContextVar("hidden", default=False)


@contextmanager
def hidden() -> Iterator[None]:
    """No progress is shown."""
    before = _HIDDEN.set(True)
    try:
        yield
    finally:
        _HIDDEN.reset(before)


def above_status(line: str) -> None:
    """Write a line to stderr; a progress that lives there stays below it.

    Args:
        line: without its end.
    """
    from tqdm import tqdm  # only a long command shows anything

    tqdm.write(line, file=sys.stderr)


@contextmanager
def status_line(
    label: str, counted: Callable[[], str] = lambda: "", *, first_s: float | None = None
) -> Iterator[Callable[[str], None]]:
    """What is under way and for how long, on stderr.

    On a terminal a line that is gone at the end; else lines that become rarer.

    Yields the function that changes the text.

    Args:
        label: that goes before the text.
        counted: what is going on inside, as "120 runs"; asked whenever the line is shown.
        first_s: silence before the first line in a pipe, s; None: the usual one.
    """
    stated = [""]
    if _HIDDEN.get():
        yield lambda text: stated.__setitem__(0, text)
        return
    show = _terminal if sys.stderr.isatty() else partial(_pipe, first_s=first_s)
    ended = threading.Event()
    shower = threading.Thread(
        target=show, args=(label, lambda: listed_words(stated[0], counted()), ended), daemon=True
    )
    shower.start()
    try:
        yield lambda text: stated.__setitem__(0, text)
    finally:
        ended.set()
        shower.join()


@contextmanager
def reading(label: str, files: Sequence[Path]) -> Iterator[None]:
    """Files are read and looked at; of large ones that is shown soon in a pipe, too.

    Args:
        label: that goes before the text.
        files: that are read, which need not be there.
    """
    sizes = [file.stat().st_size for file in files if file.is_file()]
    large = sum(sizes) > LARGE_BYTES
    name = files[0].name if len(files) == 1 else f"{len(files)} files"
    with status_line(label, first_s=LARGE_S if large else None) as tell:
        tell(f"reads {name}" + (f", {sum(sizes) / 1e6:.0f} MB" if large else ""))
        yield


def listed_words(*texts: str) -> str:
    """Words side by side, those that there are.

    Args:
        *texts: empty where there is nothing to print.
    """
    return ", ".join(text for text in texts if text)


def _terminal(label: str, text: Callable[[], str], ended: threading.Event) -> None:
    from tqdm import tqdm

    with tqdm(desc=label, bar_format="{desc} [{elapsed}]{postfix}", leave=False) as bar:
        while not ended.wait(TICK_S):
            bar.set_postfix_str(text())


def _pipe(
    label: str, text: Callable[[], str], ended: threading.Event, *, first_s: float | None = None
) -> None:
    started, wait_s = time.monotonic(), FIRST_S if first_s is None else first_s
    while True:
        if ended.wait(wait_s):
            return
        wait_s = min(max(FIRST_S, PART * (time.monotonic() - started)), MOST_S)
        after = f"{time.monotonic() - started:.0f} s"
        print(f"{label}: {listed_words(text(), after)}", file=sys.stderr, flush=True)


class Laps:
    """A clock that runs from its making on; each lap is the time since the one before it.

    Args:
        clock: measures seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self.clock = clock
        self._times = [clock()]
        self._names: list[str] = []

    def end(self, name: str) -> None:
        """A part has ended.

        Args:
            name: of the part, in words that stand behind its seconds.
        """
        self._names.append(name)
        self._times.append(self.clock())

    @property
    def words(self) -> str:
        """One line: seconds in all, and of each part."""
        pairs = zip(self._times, self._times[1:], strict=False)
        parts = [f"{b - a:.1f} {n}" for (a, b), n in zip(pairs, self._names, strict=True)]
        return f"took {self._times[-1] - self._times[0]:.1f} s: {', '.join(parts)}"
