"""Progress: a line that lives on a terminal, or one now and then in a file."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

TICK_S = 1.0  # on a terminal, where the seconds are seen to run
#: In a pipe: silence before the first line, part of the time so far between lines, and most of it.
FIRST_S, PART, MOST_S = 10.0, 0.1, 60.0
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
    label: str, counted: Callable[[], str] = lambda: ""
) -> Iterator[Callable[[str], None]]:
    """What is under way and for how long, on stderr.

    On a terminal a line that is gone at the end; else lines that become rarer.

    Yields the function that changes the text.

    Args:
        label: that goes before the text.
        counted: what is going on inside, as "120 runs"; asked whenever the line is shown.
    """
    stated = [""]
    if _HIDDEN.get():
        yield lambda text: stated.__setitem__(0, text)
        return
    show = _terminal if sys.stderr.isatty() else _pipe
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
    """Files are read and looked at.

    Args:
        label: that goes before the text.
        files: that are read, which need not be there.
    """
    with status_line(label) as show:
        show(f"reads {files[0].name if len(files) == 1 else f'{len(files)} files'}")
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


def _pipe(label: str, text: Callable[[], str], ended: threading.Event) -> None:
    started, wait_s = time.monotonic(), FIRST_S
    while not ended.wait(wait_s):
        wait_s = min(max(FIRST_S, PART * (time.monotonic() - started)), MOST_S)
        after = f"{time.monotonic() - started:.0f} s"
        line = f"{label}: {listed_words(text(), after)}"
        print(line, file=sys.stderr, flush=True)  # noqa: T201 - what is under way, not a result
