"""What a worker process does first, while it has one thread: see `fitting.engine.process.start`.

Whoever is to be isolated gives up everything now: what a thread gives up, an earlier one keeps.
"""

from __future__ import annotations

from multiprocessing import connection
from typing import TYPE_CHECKING

from fitting.fmu.worker.pulse import taken_over

if TYPE_CHECKING:
    from fitting.fmu.worker.messages import Task


def serve(pipe: connection.Connection) -> None:
    """Leave the machine's namespaces where the FMU is to be isolated, then serve it.

    Args:
        pipe: the worker's end.
    """
    try:
        if pipe.recv():
            from fitting.fmu.worker.confinement import leave_namespaces

            leave_namespaces()
        pulse = taken_over(pipe)
        task: Task = pipe.recv()
    except EOFError:  # the caller has gone already
        return
    from fitting.fmu.worker import loop

    loop.serve(pipe, task, pulse)
