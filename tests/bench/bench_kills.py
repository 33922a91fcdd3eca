"""How often does a run survive that is killed? ``python -m tests.bench.bench_kills``.

A small reconstruction is disturbed at random times: ``kill -9`` of the command, SIGTERM, ``kill
-9`` of a worker. The first two are gone on from with ``--resume``. Survived is a try whose result
equals that of an undisturbed run number for number, and that leaves nothing: no process, no
temporary folder, no checkpoint, no file of half a writing.
"""

from __future__ import annotations

import argparse
import random
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import build_fmu
from fitting.result.result import Result, read_result
from tests.support.processes import Job, ignored_ends
from tests.support.small_campaign import small_campaign

LEFT = {"result.json", "history.csv", ".fmu-fit-files.json"}


@dataclass(frozen=True)
class Bench:
    """The campaign, the undisturbed result and how long it takes."""

    campaign: Path
    folder: Path
    undisturbed: str
    seconds: float


def job(campaign: Path, folder: Path, *words: str) -> Job:
    """``fmu-fit reconstruct`` of the campaign, with results and temporary files in a folder."""
    command = ["reconstruct", str(campaign), "--out", str(folder / "out"), "--quick"]
    return Job([*command, "--no-report", "--workers", "1", *words], folder / "tmp")


def numbers(result: Result) -> str:
    """All of a result but its times and the words of its command line."""
    history = tuple(replace(row, seconds=0.0) for row in result.history)
    provenance = replace(result.provenance, finished="", command="")
    return repr(replace(result, seconds=0.0, history=history, provenance=provenance))


def verdict(bench: Bench, folder: Path, jobs: list[Job], ended: tuple[int, str, str]) -> str:
    """What is wrong after a try, as a text; empty if it survived."""
    code, _, err = ended
    if code != 0:
        return f"exit code {code}: {err.strip()}"
    if numbers(read_result(folder / "out" / "result.json")) != bench.undisturbed:
        return "another result"
    if left := [name for each in jobs for name in each.left_behind()]:
        return f"left: {', '.join(left)}"
    files = {path.name for path in (folder / "out").rglob("*") if path.is_file()}
    return "" if files == LEFT else f"files: {', '.join(sorted(files ^ LEFT))}"


def ended_by(number: signal.Signals) -> Callable[[Bench, Path, float], str]:
    """A try in which the command is ended by a signal, and resumed."""

    def one(bench: Bench, folder: Path, after_s: float) -> str:
        with job(bench.campaign, folder) as first:
            time.sleep(after_s)
            first.send(number)
            code, _, err = first.ended()
        if number == signal.SIGTERM and code not in (0, 1, 130, -signal.SIGTERM):
            return f"ended with exit code {code}: {err.strip()}"
        if number == signal.SIGTERM and (left := first.left_behind()):
            return f"left: {', '.join(left)}"
        with job(bench.campaign, folder, "--resume") as second:
            ended = second.ended()
        return verdict(bench, folder, [first, second], ended)

    return one


def without_worker(bench: Bench, folder: Path, after_s: float) -> str:
    """A try in which the worker is killed, if there is one by then."""
    with job(bench.campaign, folder) as only:
        time.sleep(after_s)
        only.kill_workers()
        return verdict(bench, folder, [only], only.ended())


KINDS = {
    "kill -9 of the command, then --resume": ended_by(signal.SIGKILL),
    "SIGTERM, then --resume": ended_by(signal.SIGTERM),
    "kill -9 of the worker": without_worker,
}


def prepared(folder: Path) -> Bench:
    """The campaign, run once without a disturbance."""
    fmu = build_fmu.build("CoupledOscillator", folder / "fmu")
    campaign = small_campaign(folder / "campaign", fmu)
    begun = time.monotonic()
    with job(campaign, folder / "undisturbed") as only:
        code, _, err = only.ended()
    assert code == 0, err
    seconds = time.monotonic() - begun
    result = read_result(folder / "undisturbed" / "out" / "result.json")
    return Bench(campaign, folder, numbers(result), seconds)


def main() -> None:
    """Print kind | tried | survived, and what went wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tries", type=int, default=30, help="of each kind (30)")
    parser.add_argument("--jobs", type=int, default=1, help="tries at a time (1)")
    parser.add_argument("--seed", type=int, default=1, help="of the times (1)")
    args = parser.parse_args()
    for number, how in ignored_ends().items():  # jobs hand it on; threads may not change it
        signal.signal(number, how)
    rng = random.Random(args.seed)
    with tempfile.TemporaryDirectory(prefix="bench-kills-") as name:
        bench = prepared(Path(name))
        print(f"undisturbed: {bench.seconds:.1f} s", file=sys.stderr)
        print("| kind | tried | survived |\n|---|---|---|")
        for k, (kind, attempt) in enumerate(KINDS.items()):
            times = [rng.uniform(0.0, bench.seconds) for _ in range(args.tries)]
            folders = [Path(name) / f"{k}-{i}" for i in range(args.tries)]
            with ThreadPoolExecutor(args.jobs) as pool:
                found = list(pool.map(attempt, [bench] * args.tries, folders, times))
            print(f"| {kind} | {len(found)} | {found.count('')} |", flush=True)
            for after_s, wrong in zip(times, found, strict=True):
                if wrong:
                    print(f"  after {after_s:.2f} s: {wrong}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
