"""The loop of a local process that works for others: a call in, what it returns or raises out."""

from __future__ import annotations

import contextlib
import pickle
import traceback
from multiprocessing import connection
from typing import NamedTuple

from fitting.engine.process import messages


class Answer(NamedTuple):
    """What a call returned, or what it raised; ``where`` is its traceback."""

    result: object = None
    error: BaseException | None = None
    where: str = ""


def serve(pipe: connection.Connection) -> None:
    """Do what is asked until the caller sends None; leave when the caller is gone.

    Args:
        pipe: the process's end.
    """
    # calls as bytes: one that cannot be read here is answered for, and does not end the reading
    arriving = messages(pipe)
    while (call := arriving.get()) is not None:
        answer = _answer(call)
        with contextlib.suppress(OSError):  # the caller is gone, which the other thread deals with
            pipe.send_bytes(_packed(answer))


def _answer(call: bytes) -> Answer:
    try:
        work, arguments, names = pickle.loads(call)  # noqa: S301 - from the caller's own pipe
        return Answer(work(*arguments, **names))
    except Exception as error:
        return Answer(error=error, where=traceback.format_exc())


def _packed(answer: Answer) -> bytes:
    try:
        return pickle.dumps(answer)
    except Exception as error:  # of whatever kind: what cannot be told is told so
        what = f"{type(answer.error or answer.result).__name__} cannot be handed over: {error}"
        return pickle.dumps(Answer(error=RuntimeError(what), where=answer.where))
