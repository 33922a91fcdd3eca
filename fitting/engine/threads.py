"""One thread of linear algebra for as long as something is solved; the caller's own number after.

The matrices here are small, processes are the parallelism, and sums depend on how threads share
them: with more of them fits take more time for other last digits.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits

_lock = threading.Lock()
#: How many are solving, and what gives back the number of threads that there was before the first.
_solving: list[threadpool_limits] = []
_count = 0


@contextmanager
def one_thread() -> Iterator[None]:
    """Linear algebra of this process on one thread, until the last that asked for it has ended."""
    global _count
    with _lock:
        _count += 1
        if _count == 1:
            _solving.append(threadpool_limits(limits=1, user_api="blas"))
    try:
        yield
    finally:
        with _lock:
            _count -= 1
            if _count == 0:
                _solving.pop().restore_original_limits()
