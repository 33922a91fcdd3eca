"""A small cluster of this machine."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest


@contextmanager
def cluster_of_two() -> Iterator[Any]:
    """Two dask workers of one thread each."""
    distributed = pytest.importorskip("distributed", reason="fmu-fit[cluster] is not installed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50
    ) as cluster:
        yield cluster


@contextmanager
def cluster_in_this_process() -> Iterator[Any]:
    """The same as threads of this process, which start at once: for tests that lose no worker."""
    distributed = pytest.importorskip("distributed", reason="fmu-fit[cluster] is not installed")
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=False,
        dashboard_address=None,
        silence_logs=50,
    ) as cluster:
        yield cluster
