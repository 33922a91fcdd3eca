"""``python -m fitting`` is ``fmu-fit``."""

from __future__ import annotations

import os
import signal
import sys

#: Signals that end a command, as `fitting.cli.running.interrupts` knows them.
_ENDS = ("SIGINT", "SIGTERM", "SIGHUP")
_INTERRUPTED = 130


def main() -> int:
    """Run a command with the words of this process; returns the exit code."""
    for name in _ENDS:
        number = getattr(signal, name, None)  # Windows has no hangup
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _interrupted)
    from fitting.cli.main import main as run  # takes a tenth of a second, which may be interrupted

    code = run()
    # An interrupt in code that is made of text, as that of dataclasses is, counts as unhandled in
    # CPython, which then ends ``python -m`` by SIGINT whatever was caught since; to run any other
    # such code takes that back.
    exec("")  # noqa: S102
    return code


def _interrupted(*_: object) -> None:
    """Before there is a command there is nothing to put in order."""
    os.write(2, b"fmu-fit: interrupted\n")
    os._exit(_INTERRUPTED)


if __name__ == "__main__":
    sys.exit(main())
