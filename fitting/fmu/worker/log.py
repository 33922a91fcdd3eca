"""The sentences that an FMU logs, kept until they are wanted, and the failure that quotes them."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable

from fitting.text.errors import spelled_out

KEPT = 50  # sentences of one run; the last ones explain why it failed
WRITTEN = 200  # sentences of one run that go to the file
SEVERE = 1  # fmi2Warning, fmi3Warning; below it is only chatter
LABELS = ("ok", "warning", "discard", "error", "fatal", "pending")


class CallFailed(Exception):
    """An FMI call did not succeed; the text names the call, the time, and what the FMU logged.

    ``is_fatal``: by its status no instance in the process can be used any more.
    """

    def __init__(self, text: str, status: int = 0) -> None:
        super().__init__(text)
        self.is_fatal = status == LABELS.index("fatal")


class Log:
    """Receives what the FMU logs; warnings and worse also go to file descriptor ``file`` at once.

    The file survives a crash of the process, the memory does not.
    """

    def __init__(self, file: int) -> None:
        self._file = file
        self._kept: deque[tuple[int, str]] = deque(maxlen=KEPT)
        self._written = 0
        self._warned: dict[str, None] = {}

    def receive(self, status: int, message: bytes | None) -> None:
        """One call of the FMU's logger.

        Args:
            status: FMI status of a call.
            message: bytes that the FMU logged, None for none.
        """
        text = spelled_out(" ".join((message or b"").decode("utf-8", "replace").split()))
        if not text:
            return
        self._kept.append((status, text))
        if status >= SEVERE and self._written < WRITTEN:
            self._written += 1
            os.write(self._file, f"[{label(status)}] {text}\n".encode())
        if status == SEVERE and len(self._warned) <= KEPT:  # one more: there are more
            self._warned[text] = None

    def warn(self, sentences: Iterable[str]) -> None:
        """Count sentences of ours among the FMU's warnings.

        Args:
            sentences: on what it runs with.
        """
        self._warned.update(dict.fromkeys(sentences))

    def new_run(self) -> None:
        """Forget what was logged before."""
        if self._kept:
            self._kept.clear()
            self._written = 0

    def sentences(self) -> str:
        """What was logged during this run: warnings and worse, or else its last words."""
        severe = [text for status, text in self._kept if status >= SEVERE]
        chosen = list(dict.fromkeys(severe)) or [text for _, text in list(self._kept)[-3:]]
        # the first ones tell the cause, the last ones what came of it
        shown = chosen if len(chosen) <= 5 else [*chosen[:3], "…", *chosen[-2:]]
        return "; ".join(text.rstrip(".;") or text for text in shown)

    def take_warnings(self) -> tuple[str, ...]:
        """Different warnings since the last call."""
        warned, self._warned = tuple(self._warned), {}
        return warned


def label(status: int) -> str:
    """The name of a status.

    Args:
        status: FMI status of a call.
    """
    return LABELS[status] if 0 <= status < len(LABELS) else f"status {status}"
