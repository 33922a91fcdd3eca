"""How often does a run survive that is killed? ``python -m tests.bench.bench_kills``.

`reconstruct`, `ensemble`, `posterior` and `design` of a small campaign are ended at random times by
``kill -9`` or SIGTERM, then asked for once more, in turns with ``--resume`` where they have it; or
a worker of theirs is killed. Survived is a try whose exit code and results equal those of an
undisturbed run number for number, and that leaves nothing: no process, no temporary folder, no
checkpoint, no file of half a writing. The model runs by its native twin.
"""

from __future__ import annotations

import argparse
import csv
import json
import random
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Collection
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import build_fmu
from tests.support.processes import Job, ignored_ends
from tests.support.small_campaign import of_pairs, small_campaign

#: What differs from run to run: times, and the words of the command line.
PASSING = {"seconds", "finished", "command", "processor_s", "evaluation_s", "resumed", "out"}
#: Of draws: what was evaluated, a part that a kill took away and that was drawn again included.
WORK = {"chain.npz": {"counts"}, "posterior.json": {"evaluations", "failed"}}


@dataclass(frozen=True)
class Bench:
    """A command, and what an undisturbed run of it wrote and took."""

    command: str
    words: tuple[str, ...]
    goes_on: bool
    folder: Path
    undisturbed: str
    code: int
    seconds: float

    def job(self, folder: Path, *more: str) -> Job:
        """The command, with results and temporary files in a folder."""
        out = ["--out", str(folder / "out"), "--no-report", "--workers", "1"]
        return Job([self.command, *self.words, *out, *more], folder / "tmp")


def written(out: Path) -> str:
    """What stands in the files of a folder, but for what differs from run to run."""
    found: dict[str, Any] = {}
    for path in sorted(path for path in out.rglob("*") if path.is_file()):
        name = path.relative_to(out).as_posix()
        if path.suffix == ".json" and not path.name.startswith("."):
            found[name] = _lasting(json.loads(path.read_text("utf-8")), WORK.get(name, set()))
        elif path.suffix == ".csv":
            with path.open(encoding="utf-8", newline="") as file:
                rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
            found[name] = _lasting(rows)
        elif path.suffix == ".npz":
            with np.load(path) as arrays:
                kept = sorted(set(arrays) - WORK.get(name, set()))
                found[name] = {key: np.asarray(arrays[key]).tobytes().hex() for key in kept}
        else:
            found[name] = "there"
    return json.dumps(found, sort_keys=True, default=str)


def _lasting(value: Any, work: Collection[str] = ()) -> Any:
    if isinstance(value, dict):
        kept = {k: v for k, v in value.items() if k not in PASSING and k not in work}
        return {k: _lasting(v, work) for k, v in kept.items()}
    return [_lasting(v, work) for v in value] if isinstance(value, list) else value


def verdict(bench: Bench, folder: Path, jobs: list[Job], ended: tuple[int, str, str]) -> str:
    """What is wrong after a try, as a text; empty if it survived."""
    code, _, err = ended
    if code != bench.code:
        return f"exit code {code}, undisturbed {bench.code}: {err.strip()}"
    if left := [name for each in jobs for name in each.left_behind()]:
        return f"left: {', '.join(left)}"
    found = written(folder / "out")
    if found != bench.undisturbed:
        return f"other results: {_difference(json.loads(bench.undisturbed), json.loads(found))}"
    return ""


def _difference(expected: Any, found: Any, where: str = "") -> str:
    """The first place at which two documents differ."""
    if isinstance(expected, dict) and isinstance(found, dict):
        for key in sorted(expected.keys() | found.keys()):
            if expected.get(key) != found.get(key):
                return _difference(expected.get(key), found.get(key), f"{where}/{key}")
    if isinstance(expected, list) and isinstance(found, list) and len(expected) == len(found):
        for k, (a, b) in enumerate(zip(expected, found, strict=True)):
            if a != b:
                return _difference(a, b, f"{where}/{k}")
    return f"{where}: {str(expected)[:80]} became {str(found)[:80]}"


def ended_by(number: signal.Signals) -> Callable[[Bench, Path, float, bool], str]:
    """A try in which the command is ended by a signal, and asked for once more."""

    def one(bench: Bench, folder: Path, after_s: float, resumed: bool) -> str:
        with bench.job(folder) as first:
            time.sleep(after_s)
            first.send(number)
            code, _, err = first.ended()
        if number == signal.SIGTERM and code not in (0, 1, 130, -signal.SIGTERM):
            return f"ended with exit code {code}: {err.strip()}"
        if number == signal.SIGTERM and (left := first.left_behind()):
            return f"left: {', '.join(left)}"
        with bench.job(folder, *(("--resume",) if resumed and bench.goes_on else ())) as second:
            ended = second.ended()
        return verdict(bench, folder, [first, second], ended)

    return one


def without_worker(bench: Bench, folder: Path, after_s: float, resumed: bool) -> str:
    """A try in which the workers are killed, if there are any by then."""
    with bench.job(folder) as only:
        time.sleep(after_s)
        only.kill_workers()
        return verdict(bench, folder, [only], only.ended())


KINDS = {
    "kill -9 of the command": ended_by(signal.SIGKILL),
    "SIGTERM": ended_by(signal.SIGTERM),
    "kill -9 of its workers": without_worker,
}


def prepared(folder: Path) -> list[Bench]:
    """The commands, each run once without a disturbance."""
    fmu = build_fmu.build("CoupledOscillator", folder / "fmu", native=())
    campaign, other = (small_campaign(folder / name, fmu) for name in ("campaign", "other"))
    for path in (campaign, other):
        of_pairs(path, 1, 2, 3)
    at = ("--at", str(folder / "reconstruct" / "out" / "result.json"))
    asked = {
        "reconstruct": ((str(campaign), "--quick"), True),
        "ensemble": ((str(campaign), str(other), "--quick", "--no-profiles"), True),
        "posterior": ((str(campaign), *at, "--walkers", "8", "--steps", "200"), True),
        "design": ((str(campaign), *at, "--number", "1", "--time", "60 s"), False),
    }
    benches = []
    for command, (words, goes_on) in asked.items():
        bench = Bench(command, words, goes_on, folder / command, "", 0, 0.0)
        begun = time.monotonic()
        with bench.job(bench.folder) as only:
            code, _, err = only.ended()
        assert code in (0, 1), err
        seconds = time.monotonic() - begun
        text = written(bench.folder / "out")
        benches.append(Bench(command, words, goes_on, bench.folder, text, code, seconds))
    return benches


def main() -> None:
    """Print command | kind | tried | survived, and what went wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tries", type=int, default=17, help="of each kind and command (17)")
    parser.add_argument("--jobs", type=int, default=1, help="tries at a time (1)")
    parser.add_argument("--only", nargs="+", metavar="COMMAND", help="these commands alone")
    parser.add_argument("--kind", default="", help="word in the name of the kind of ending")
    parser.add_argument("--seed", type=int, default=1, help="of the times (1)")
    args = parser.parse_args()
    for number, how in ignored_ends().items():  # jobs hand it on; threads may not change it
        signal.signal(number, how)
    rng = random.Random(args.seed)
    with tempfile.TemporaryDirectory(prefix="bench-kills-") as name:
        print("| command | kind | tried | survived |\n|---|---|---|---|")
        for bench in prepared(Path(name)):
            if args.only and bench.command not in args.only:
                continue
            print(f"{bench.command}: {bench.seconds:.1f} s undisturbed", file=sys.stderr)
            for k, (kind, attempt) in enumerate(KINDS.items()):
                if args.kind not in kind:
                    continue
                times = [rng.uniform(0.0, bench.seconds) for _ in range(args.tries)]
                folders = [bench.folder / f"{k}-{i}" for i in range(args.tries)]
                resumed = [bool(i % 2) for i in range(args.tries)]
                with ThreadPoolExecutor(args.jobs) as pool:
                    found = list(pool.map(attempt, [bench] * args.tries, folders, times, resumed))
                row = f"| {bench.command} | {kind} | {len(found)} | {found.count('')} |"
                print(row, flush=True)
                for after_s, wrong in zip(times, found, strict=True):
                    if wrong:
                        print(f"  after {after_s:.2f} s: {wrong}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
