"""What a worker process does first, while it has one thread: see `fitting.engine.process.start`."""

from __future__ import annotations

from multiprocessing import connection


def serve(pipe: connection.Connection) -> None:
    """Leave the network where the FMU is to be isolated, then serve it.

    Args:
        pipe: the worker's end.
    """
    has_network = True
    try:
        if pipe.recv():
            from fitting.fmu.worker.confinement import leave_network

            has_network = not leave_network()
    except EOFError:  # the caller has gone already
        return
    # it starts threads
    from fitting.fmu.worker import loop

    loop.serve(pipe, has_network=has_network)
