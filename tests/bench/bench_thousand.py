"""Does an ensemble of a thousand laboratories come out the same, whatever happens on the way?

    python -m tests.bench.bench_thousand [--laboratories 1000] [--workers 2] [--fmu FMU]

The command runs three times: by itself; ended by Ctrl-C in the middle and gone on with by --resume;
and with one of its workers killed (SIGKILL) in the middle. Told are its processor time with that of
its workers, the share of the calling process per item, and whether ensemble.csv is the same bit for
bit. The share of the caller holds its start, the laboratories' list and the table.
"""

from __future__ import annotations

import argparse
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

#: Share of the items after which the run is disturbed.
MIDDLE = 0.4
LOOKED_S = 0.1


@dataclass(frozen=True)
class Run:
    """How a command ended, its wall time, processor time of caller and workers, s."""

    code: int
    wall_s: float
    caller_s: float
    workers_s: float


def command(args: argparse.Namespace, out: Path, *more: str) -> list[str]:
    """Words of the command."""
    words = [sys.executable, "-m", "fitting", "ensemble", "--series", "transmission", "--quick"]
    words += ["--no-profiles", "--laboratories", str(args.laboratories)]
    words += ["--fmu", args.fmu] if args.fmu else []
    return [*words, "--workers", str(args.workers), "--out", str(out), *more]


def own_s(pid: int) -> float:
    """Processor time of one process so far, without its children, s."""
    fields = Path(f"/proc/{pid}/stat").read_text("ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def items(out: Path) -> int:
    """Finished items, less the line that the file begins with."""
    path = out / "items.jsonl"
    return max(path.read_bytes().count(b"\n") - 1, 0) if path.exists() else 0


def run(words: list[str], out: Path, at: int, disturb: Callable[[int], None]) -> Run:
    """Run a command, and disturb it once when so many items have ended."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begun, caller_s, disturbed = time.perf_counter(), 0.0, False
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, start_new_session=True)
    while process.poll() is None:
        try:
            caller_s = own_s(process.pid)
        except (OSError, ValueError):
            break
        if not disturbed and items(out) >= at:
            disturbed = True
            disturb(process.pid)
        time.sleep(LOOKED_S)
    code = process.wait()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    total = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Run(code, time.perf_counter() - begun, caller_s, total - caller_s)


def children(pid: int) -> list[int]:
    """Processes that a process has started."""
    found: list[int] = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        found += [int(word) for word in (task / "children").read_text("ascii").split()]
    return found


def interrupt(pid: int) -> None:
    """What Ctrl-C does."""
    os.kill(pid, signal.SIGINT)


def kill_a_worker(pid: int) -> None:
    """What runs out of memory."""
    os.kill(children(pid)[0], signal.SIGKILL)


def row(what: str, out: Path, ran: list[Run], same: str) -> str:
    """A row of the table."""
    count = items(out)
    caller, workers = sum(r.caller_s for r in ran), sum(r.workers_s for r in ran)
    item = workers / count
    return (
        f"| {what} | {', '.join(str(r.code) for r in ran)} | {count} | "
        f"{sum(r.wall_s for r in ran):.0f} | {caller:.1f} | {workers:.0f} | {1e3 * item:.0f} | "
        f"{1e3 * caller / count:.1f} | {100.0 * caller / count / item:.1f} % | {same} |"
    )


def main() -> int:
    """Print the table; 0 if all tables are the same."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--laboratories", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--fmu", help="another one than the campaigns name, as a native one")
    args = parser.parse_args()
    at, never = int(MIDDLE * args.laboratories), 10**9
    print(
        "| run | exit codes | items | wall, s | caller, s of processor | workers, s of processor | "
        "an item, ms | caller per item, ms | share | ensemble.csv |\n" + "|---" * 10 + "|",
        flush=True,
    )
    with tempfile.TemporaryDirectory() as name:
        outs = {what: Path(name) / what for what in ("whole", "resumed", "killed")}
        whole = run(command(args, outs["whole"]), outs["whole"], never, interrupt)
        expected = (outs["whole"] / "ensemble.csv").read_bytes()
        print(row("by itself", outs["whole"], [whole], "-"), flush=True)
        first = run(command(args, outs["resumed"]), outs["resumed"], at, interrupt)
        rest = command(args, outs["resumed"], "--resume")
        again = run(rest, outs["resumed"], never, interrupt)
        killed = run(command(args, outs["killed"]), outs["killed"], at, kill_a_worker)
        alike = []
        for what, key, ran in (
            ("Ctrl-C, then --resume", "resumed", [first, again]),
            ("a worker killed", "killed", [killed]),
        ):
            alike.append((outs[key] / "ensemble.csv").read_bytes() == expected)
            said = "the same bit for bit" if alike[-1] else "another"
            print(row(what, outs[key], ran, said), flush=True)
    return 0 if all(alike) else 1


if __name__ == "__main__":
    raise SystemExit(main())
