"""What a fit costs as it grows: processor time, runs of the FMU, memory, and the exponents.

    python -m tests.bench.bench_scaling [--quick] [--only TABLE [--size N ...] [--misfit WORD]]

Synthetic data of the virtual laboratories, which share no code with the FMU; every job is a process
of its own with one worker. Processor time is that of caller and worker, memory the most that each
of them held. The exponent is log(times as much processor time)/log(times as large) between
neighbouring sizes. TABLE is experiments, parameters, points, pairs, memory or laboratories. Prints
Markdown tables. Without --quick it takes hours.
"""

from __future__ import annotations

import argparse
import heapq
import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

import build_fmu
import fitting as ff
from fitting.campaign.parameters import starts, to_search
from fitting.fit.objective import evaluate_many
from fitting.lab.bench import Bench
from fitting.lab.laboratories import bench_of
from fitting.lab.synthesis import synthesize
from tests.support.extreme_scenes import Scene, write
from tests.support.processes import spent_s

#: Sizes of each table, and those of --quick.
SIZES = {
    "experiments": ((5, 50, 500, 5000, 10000), (5, 50, 500)),
    "parameters": ((3, 10, 30, 100, 300, 1000), (3, 10, 30)),
    "points": ((41, 401, 4001, 40001, 100001), (41, 401, 4001)),
    "pairs": ((50, 200, 1000), (20,)),
}
#: Processor time of an item in its worker and of the caller for each, s, as
#: `tests.bench.bench_thousand` measured them; items differ by half of it each way. What a worker
#: needs before its first one is assumed.
ITEM_S, START_S, CALLER_S = 0.33, 3.0, 0.0054
LABORATORIES, WORKERS = (1, 10, 100, 1000, 10_000, 100_000), (1, 2, 16, 256)
#: Evaluations after which memory is looked at, and those of --quick.
MEMORY = (tuple(range(10_000, 100_001, 10_000)), (500, 1000, 1500, 2000))
BATCH = 50
#: Half of the distance of the tones of a pair from the line, first and last pair, Hz.
FARTHEST_HZ, NEAREST_HZ = 100.0, 10.0
CENTRE_HZ = 6940260.0
SEED = 3


@dataclass(frozen=True)
class Job:
    """What one process has done: its cost, and a word on what came of it."""

    seconds: float
    runs: int
    caller_mb: float
    worker_mb: float
    word: str


def pairs_of(count: int) -> tuple[tuple[float, float], ...]:
    """Drive pairs about the line, their distance falling from pair to pair, in whole Hz.

    As the spectra of this laboratory have a line at every Hz, and a peak is read at one.
    """
    half = np.round(np.linspace(FARTHEST_HZ, NEAREST_HZ, count))
    return tuple((CENTRE_HZ - float(h), CENTRE_HZ + float(h)) for h in half)


def offsets_campaign(folder: Path, count: int) -> Path:
    """The string with that many drive pairs, each with an offset of the drift of its own."""
    bench = bench_of("q1")
    assert isinstance(bench, Bench)
    bench = replace(bench, pairs_hz=pairs_of(count))
    synthesize(bench, seed=SEED, out=folder)
    return folder / "campaign.toml"


def known_drift(count: int) -> Scene:
    """One parameter, that many experiments, the drift told by the campaign."""
    tones = tuple((-0.5 - 0.6 * k / count, 0.4 + 1.2 * k / count) for k in range(count))
    return Scene(tones=tones, drift=20.0, noise=1e-3)


def swept(count: int) -> Scene:
    """One parameter, one sweep of that many points."""
    return Scene(tones=(), use="fit", scale="fit", points=count, noise=1e-3)


def prepared(kind: str, size: int, fmu: Path, folder: Path) -> Path:
    """The campaign of a size."""
    if kind == "experiments":
        return write(known_drift(size), fmu, folder)
    if kind == "points":
        return write(swept(size), fmu, folder)
    # three values of the sample, and an offset for each pair
    return offsets_campaign(folder, size if kind == "pairs" else max(size - 3, 1))


def fitted(problem: ff.Problem, misfit: str | None = None) -> str:
    """A fit without profiles; what it says of the width."""
    method = ff.Tikhonov.of(problem.options)
    method = replace(method, misfit=misfit or method.misfit)
    fit = ff.fit(problem, method, starts=1)
    width = fit["width_plus"]
    return f"{fit.status}, width {width.value:.4g} ± {width.std:.2g} Hz"


def identified(problem: ff.Problem) -> str:
    """What the data determine; what is said of the width."""
    width = ff.identify(problem).profiled["width_plus"]
    low, high = width.ci95
    return f"width {width.status}, {low:.4g} to {high:.4g} Hz"


def memory_mb(pid: int | str, field: str) -> float:
    """What a process holds (VmRSS), or the most that it has held (VmHWM), MB."""
    text = Path(f"/proc/{pid}/status").read_text("ascii")
    [line] = [line for line in text.splitlines() if line.startswith(f"{field}:")]
    return 1024e-6 * int(line.split()[1])


def at_work(path: Path, fmu: Path, work: Callable[[ff.Problem], str]) -> Job:
    """A job in this process, which does nothing else."""
    with ff.Fmu(fmu, workers=1) as opened:
        word = work(ff.Problem.of([ff.read_campaign(path)], opened))
        runs = opened.workers.counts.runs
        worker_mb = max(memory_mb(pid, "VmHWM") for pid in opened.workers.pids)
    return Job(spent_s(), runs, memory_mb("self", "VmHWM"), worker_mb, word)


def measured(kind: str, path: Path, fmu: Path, further: Sequence[str]) -> Job:
    """The same in a process of its own."""
    words = [sys.executable, "-m", "tests.bench.bench_scaling", "--job", kind, str(path), str(fmu)]
    words += further
    done = subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True)
    return Job(**json.loads(done.stdout.splitlines()[-1]))


def table(
    kind: str, sizes: Sequence[int], fmu: Path, folder: Path, further: Sequence[str] = ()
) -> None:
    """Print a table; ``further`` words go with each job."""
    print(
        f"\n| {kind} | processor time, s | exponent | runs of the FMU | exponent | caller, MB | "
        "worker, MB | outcome |\n|---|---|---|---|---|---|---|---|",
        flush=True,
    )
    before: tuple[int, Job] | None = None
    for size in sizes:
        job = measured(kind, prepared(kind, size, fmu, folder / f"{kind}{size}"), fmu, further)
        time_word = runs_word = "-"
        if before is not None:
            larger = math.log(size / before[0])
            time_word = f"{math.log(job.seconds / before[1].seconds) / larger:.2f}"
            runs_word = f"{math.log(job.runs / before[1].runs) / larger:.2f}"
        print(
            f"| {size:,} | {job.seconds:.1f} | {time_word} | {job.runs:,} | {runs_word} | "
            f"{job.caller_mb:.0f} | {job.worker_mb:.0f} | {job.word} |",
            flush=True,
        )
        before = size, job


def memory(counts: Sequence[int], fmu: Path, folder: Path) -> None:
    """Print what caller and worker hold while a likelihood is evaluated, again and again."""
    path = offsets_campaign(folder / "memory", 5)
    print("\n| evaluations | caller, MB | worker, MB |\n|---|---|---|", flush=True)
    with ff.Fmu(fmu, workers=1) as opened:
        problem = ff.Problem.of([ff.read_campaign(path)], opened)
        parameters = problem.record.parameters
        x, rng, done = to_search(parameters, starts(parameters)), np.random.default_rng(SEED), 0
        for count in counts:
            while done < count:
                points = [x + 1e-3 * rng.standard_normal(x.size) for _ in range(BATCH)]
                evaluate_many(problem.objective, points)
                done += BATCH
            [worker] = opened.workers.pids
            caller_mb, worker_mb = (memory_mb(pid, "VmRSS") for pid in ("self", worker))
            print(f"| {done:,} | {caller_mb:.1f} | {worker_mb:.1f} |", flush=True)


def makespan_s(count: int, workers: int) -> float:
    """When the last of many items ends, s, by simulation of the schedule.

    The caller hands out one item after the other, each to the worker that is free first, and takes
    CALLER_S of its own for each; a worker takes START_S before its first one.
    """
    rng = np.random.default_rng(SEED)
    free = [START_S] * min(workers, count)
    heapq.heapify(free)
    handed = 0.0
    for item in ITEM_S * rng.uniform(0.5, 1.5, count):
        handed = max(handed, free[0]) + CALLER_S
        heapq.heapreplace(free, handed + float(item))
    return max(free)


def laboratories() -> None:
    """Print when an ensemble ends, computed."""
    print(f"\n| laboratories | {' | '.join(f'{w} workers, s' for w in WORKERS)} |")
    print("|---" * (len(WORKERS) + 1) + "|")
    for count in LABORATORIES:
        cells = " | ".join(f"{makespan_s(count, workers):,.1f}" for workers in WORKERS)
        print(f"| {count:,} | {cells} |", flush=True)


def main() -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--only", choices=[*SIZES, "memory", "laboratories"])
    parser.add_argument("--size", type=int, action="append", help="other sizes; with --only")
    parser.add_argument("--misfit", choices=["slack", "squares"], help="of fits, if not the usual")
    parser.add_argument("--job", nargs=3, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.job:
        kind, path, fmu = args.job
        work = identified if kind == "pairs" else partial(fitted, misfit=args.misfit)
        print(json.dumps(vars(at_work(Path(path), Path(fmu), work))))
        return 0
    further = ["--misfit", args.misfit] if args.misfit else []
    with tempfile.TemporaryDirectory() as name:
        fmu = build_fmu.build("CoupledOscillator", Path(name))
        for kind, (whole, quick) in SIZES.items():
            if args.only in (None, kind):
                table(kind, args.size or (quick if args.quick else whole), fmu, Path(name), further)
        if args.only in (None, "memory"):
            memory(args.size or MEMORY[args.quick], fmu, Path(name))
        if args.only in (None, "laboratories"):
            laboratories()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
