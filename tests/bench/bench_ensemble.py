"""What does the engine of ensembles cost beside its items?

    python -m tests.bench.bench_ensemble [--laboratories 40] [--series transmission]
        [--change points=31] [--workers 1 --workers 2] [--fmu FMU] [--calls 2000]
        [--scheduler tcp://...]

First calls that do nothing: what one round trip takes, journal included. Then virtual laboratories
through the FMU (without --fmu: the Python one): the time of an item in its worker, and what the
engine takes of this process per item (processor time, which a busy machine does not stretch); the
start of the workers stands apart. The last column is what workers waited for: 1 - sum of the items'
times/(workers x time from the first item's end to the last one's); it is as fair as the machine is
idle, and of few items off by what was under way at the first one's end. Prints Markdown tables.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import fitting as ff
from fitting.engine.local import LocalProcesses
from fitting.engine.run import opened, run
from fitting.ensembles.api import Progress
from fitting.text.journal import Journal
from tests.support import work
from tests.support.work import Piece


@dataclass(frozen=True)
class Line:
    """One line of the journal of calls that do nothing."""

    number: int
    square: int


def round_trips(where: Executor | str | int, calls: int) -> tuple[float, float]:
    """Time and processor time of this process per call, s, once the workers are there."""
    with tempfile.TemporaryDirectory() as folder, opened(where, ()) as place:
        journal = Journal(Path(folder) / "items.jsonl", "bench", Line)
        list(run(work.squared, [Piece(k) for k in range(8)], place))
        begun, cpu = time.perf_counter(), time.process_time()
        for _, result, _ in run(work.squared, (Piece(k) for k in range(calls)), place):
            assert result is not None
            journal.record(Line(*result))
        return (time.perf_counter() - begun) / calls, (time.process_time() - cpu) / calls


@dataclass
class Times:
    """When items ended, and what they and this process took, s."""

    begun: float
    first: float = 0.0
    last: float = 0.0
    first_item: float = 0.0
    items: float = 0.0
    cpu_first: float = 0.0
    cpu: float = 0.0
    count: int = 0

    def __call__(self, state: Progress) -> None:
        """Note an end."""
        if state.done == 0:
            return
        self.last, self.items, self.cpu = time.perf_counter(), state.item_seconds, _cpu()
        self.count = state.done
        if state.done == 1:
            self.first, self.first_item, self.cpu_first = self.last, self.items, self.cpu


def _cpu() -> float:
    return time.process_time()


@contextmanager
def executor_of(where: str | int) -> Iterator[Executor | str]:
    """Processes that stay, or a scheduler."""
    if isinstance(where, str):
        yield where
        return
    pool = LocalProcesses(where)
    try:
        yield pool
    finally:
        pool.shutdown()


def laboratories(where: str | int, args: argparse.Namespace) -> str:
    """A row of the table."""
    changes = {}
    for word in args.change:
        name, _, value = word.partition("=")
        changes[name] = int(value) if value.isdigit() else float(value)
    of = ff.Laboratories(args.series, args.laboratories, changes=changes)
    options = ff.EnsembleOptions(values=args.value, profiles=not args.no_profiles)
    with tempfile.TemporaryDirectory() as folder, executor_of(where) as executor:
        times = Times(time.perf_counter())
        found = ff.ensemble(of, args.fmu, options, executor=executor, out=folder, progress=times)
    assert not found.failures, found.failures[:3]
    later = times.count - 1
    item = (times.items - times.first_item) / later
    engine = (times.cpu - times.cpu_first) / later
    workers = where if isinstance(where, int) else 0
    span = workers * (times.last - times.first)
    waited = f"{100.0 * (1.0 - (times.items - times.first_item) / span):.1f} %" if span else "-"
    return (
        f"| {where} | {times.count} | {times.first - times.begun:.2f} | {item:.3f} | "
        f"{1e3 * engine:.2f} | {100.0 * engine / item:.2f} % | {waited} |"
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--laboratories", type=int, default=40)
    parser.add_argument("--series", default="transmission")
    parser.add_argument("--change", action="append", default=[], metavar="NAME=NUMBER")
    parser.add_argument("--value", action="append", default=[], help="profiled alone")
    parser.add_argument("--no-profiles", action="store_true")
    parser.add_argument("--workers", type=int, action="append")
    parser.add_argument("--scheduler")
    parser.add_argument("--fmu", default="CoupledOscillator")
    parser.add_argument("--calls", type=int, default=2000)
    args = parser.parse_args()
    places: list[str | int] = [*(args.workers or [1, 2])]
    places += [args.scheduler] if args.scheduler else []
    print(
        "| workers | calls | round trip, ms | of this process, ms |\n|---|---|---|---|", flush=True
    )
    for where in places:
        wall, cpu = round_trips(where, args.calls)
        print(f"| {where} | {args.calls} | {1e3 * wall:.3f} | {1e3 * cpu:.3f} |", flush=True)
    print(
        "\n| workers | items | first item after, s | an item, s | engine per item, ms | share | "
        "workers waited |\n|---|---|---|---|---|---|---|",
        flush=True,
    )
    for where in places:
        print(laboratories(where, args), flush=True)


if __name__ == "__main__":
    main()
