"""Benches of the string, read back from their truth."""

from __future__ import annotations

from pathlib import Path

from fitting.lab.bench import Bench
from fitting.lab.laboratories import bench_of


def read_bench(truth: Path) -> Bench:
    bench = bench_of(truth)
    assert isinstance(bench, Bench)
    return bench
