"""One worker process, seen from the caller: start, hand over, notice its end, kill."""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import time
from pathlib import Path

from fitting.fmu.interface import Setup
from fitting.fmu.reuse import Verdict
from fitting.fmu.worker import AT_RUN, BEGUN, IN_TRIAL, PULSE_SIZE, Batch, Reply, serve

START_S = 120.0  # longest start of a process, before it touches the FMU
LAST_WORDS = 500  # characters of what the FMU printed before it crashed


class Worker:
    """A process that serves one FMU; what it has found out about reuse is kept in ``verdict``."""

    def __init__(self, setup: Setup, verdict: Verdict, log_path: Path) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self._pulse = context.RawArray("q", PULSE_SIZE)
        self._log_path = log_path
        self._process = context.Process(
            target=serve,
            args=(theirs, self._pulse, setup, verdict, str(log_path)),
            daemon=True,
            name=f"fmu {setup.model_identifier}",
        )
        self._process.start()
        theirs.close()
        self._begun = -1
        self._since = 0.0

    def send(self, batch: Batch) -> None:
        """Hand over a batch; that the process has ended is found out by `receive`."""
        self._begun, self._since = -1, time.monotonic()
        self._pulse[AT_RUN] = 0
        with contextlib.suppress(OSError):
            self.pipe.send(batch)

    def receive(self) -> Reply | None:
        """The answer to the batch; None if the process has ended without one."""
        try:
            reply: Reply = self.pipe.recv()
        except (EOFError, OSError):
            self._process.join()
            return None
        return reply

    @property
    def at_run(self) -> int:
        """Which run of the batch is under way."""
        return int(self._pulse[AT_RUN])

    @property
    def in_trial(self) -> bool:
        """Whether the FMU is only being tried after a reset."""
        return bool(self._pulse[IN_TRIAL])

    def is_late(self, timeout_s: float) -> bool:
        """Whether the process began something longer than that ago; its own start is not counted.

        A start has a limit of its own: on a busy machine, Python alone may take seconds.
        """
        begun = int(self._pulse[BEGUN])
        if begun != self._begun:
            self._begun, self._since = begun, time.monotonic()
        return time.monotonic() - self._since > (timeout_s if begun else max(timeout_s, START_S))

    def cause_of_death(self) -> str:
        """A sentence on how the process ended and what the FMU printed last."""
        code = self._process.exitcode or 0
        if code < 0:
            try:
                how = f"crashed its process ({signal.Signals(-code).name})"
            except ValueError:
                how = f"crashed its process (signal {-code})"
        else:
            how = f"ended its process (exit code {code})"
        try:
            words = self._log_path.read_text("utf-8", "replace").strip()[-LAST_WORDS:]
        except OSError:
            words = ""
        return f"{how}; its last words: {words}" if words else f"{how} without a word"

    def ask_to_end(self) -> None:
        """Let the process free its FMU and end."""
        with contextlib.suppress(OSError):
            self.pipe.send(None)

    def end(self, within_s: float = 0.0) -> None:
        """Wait for the process to end by itself, then kill it."""
        self._process.join(within_s)
        self._process.kill()
        self._process.join()
        self.pipe.close()
