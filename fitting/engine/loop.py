"""The loop of a local process that works for others: a call in, what it returns or raises out."""

from __future__ import annotations

import contextlib
import pickle
import traceback
from multiprocessing import connection
from typing import Any

from fitting.engine.process import messages


def serve(pipe: connection.Connection) -> None:
    """Answer calls with (result, error, traceback) until the caller sends None, or is gone.

    Args:
        pipe: the process's end.
    """
    # calls as bytes: one that cannot be read here is answered, and does not end the reading
    arriving = messages(pipe)
    while (call := arriving.get()) is not None:
        answer: tuple[Any, BaseException | None, str]
        try:
            work, arguments, names = pickle.loads(call)  # noqa: S301 - from the caller's own pipe
            answer = work(*arguments, **names), None, ""
        except Exception as error:
            answer = None, error, traceback.format_exc()
        try:
            data = pickle.dumps(answer)
        except Exception as error:  # of whatever kind: the caller learns what no pickle can carry
            what = f"{type(answer[1] or answer[0]).__name__} cannot be handed over: {error}"
            data = pickle.dumps((None, RuntimeError(what), answer[2]))
        with contextlib.suppress(OSError):  # the caller is gone, which the other thread deals with
            pipe.send_bytes(data)
