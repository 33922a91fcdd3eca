"""Every benchmark, each in a process of its own.

    python -m tests.bench                # all of them: hours; results go to tests/bench/results
    python -m tests.bench --smoke        # each with its smallest settings: a quarter of an hour
    python -m tests.bench --quick        # those that take less than 10 s
    python -m tests.bench --list
    python -m tests.bench --only WORD    # those with that word in their name

A result is a Markdown file with commit, date and processor time; `results/README.md` has a row for
each. Exit code 1 if a command ends otherwise than with 0.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from tests.bench.commands import COMMANDS, PYTHON, ROOT, Command

RESULTS = ROOT / "tests" / "bench" / "results"
#: Wall time in s after which a command of a short run counts as failed.
LONGEST_S = 300.0
HEAD = "| command | exit code | processor time | commit | date |\n|---|---|---|---|---|"


@dataclass(frozen=True)
class Run:
    """A command with its settings."""

    command: Command
    settings: str = ""

    @property
    def words(self) -> list[str]:
        """Program and arguments."""
        return [PYTHON, "-m", self.command.module, *shlex.split(self.settings)]

    @property
    def text(self) -> str:
        """As people type it."""
        return f"python -m {self.command.module} {self.settings}".strip()

    @property
    def file_name(self) -> str:
        """Of its result."""
        name = f"{self.command.name} {self.settings}"
        return re.sub(r"[^A-Za-z0-9_]+", "-", name).strip("-") + ".md"


@dataclass(frozen=True)
class Ended:
    """How a command ended: exit code, what it printed, its times in s with its children."""

    code: int
    out: str
    err: str
    processor_s: float
    wall_s: float


def run(words: Sequence[str], folder: Path, longest_s: float | None = None) -> Ended:
    """Run a command to its end.

    Args:
        words: program and arguments.
        folder: where it is run.
        longest_s: after which it is ended, with exit code 124; None: never.
    """
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {"OPENBLAS_NUM_THREADS": "1", **os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    begun = time.monotonic()
    with (
        tempfile.TemporaryFile("w+") as out,
        tempfile.TemporaryFile("w+") as err,
        subprocess.Popen(words, cwd=folder, env=environment, stdout=out, stderr=err) as process,
    ):
        late = threading.Event()
        timer = threading.Timer(longest_s or threading.TIMEOUT_MAX, _end, (process, late))
        timer.daemon = True
        timer.start()
        _, status, used = os.wait4(process.pid, 0)
        timer.cancel()
        process.returncode = 124 if late.is_set() else os.waitstatus_to_exitcode(status)
        for stream in (out, err):
            stream.seek(0)
        spent = used.ru_utime + used.ru_stime
        return Ended(process.returncode, out.read(), err.read(), spent, time.monotonic() - begun)


def _end(process: subprocess.Popen[bytes], late: threading.Event) -> None:
    late.set()
    process.terminate()


def ended(one: Run, longest_s: float | None = None) -> Ended:
    """Run a benchmark in a folder of its own, what it needs first.

    Args:
        one: benchmark and settings.
        longest_s: for each of its commands; None: as long as they take.
    """
    spent_s = 0.0
    with tempfile.TemporaryDirectory(prefix="bench-") as name:
        for words in [*one.command.preparation, one.words]:
            found = run(words, Path(name), longest_s)
            spent_s += found.processor_s
            if found.code:
                break
    return replace(found, processor_s=spent_s)


def chosen(args: argparse.Namespace) -> Iterator[Run]:
    """Which commands are run, with which settings.

    Args:
        args: of the command line.
    """
    for command in COMMANDS:
        if args.only not in command.name:
            continue
        if args.smoke or args.quick:
            if args.smoke or command.quick:
                yield Run(command, command.smoke)
        else:
            yield from (Run(command, settings) for settings in command.full)


def result_text(one: Run, found: Ended, stamp: str) -> str:
    """A result as Markdown.

    Args:
        one: what was run.
        found: how it ended.
        stamp: cells of commit and date.
    """
    out = found.out.strip()
    body = out if out.startswith("|") else f"```text\n{out}\n```"
    return f"{HEAD}\n{row(one, found, stamp)}\n\n{body}\n"


def row(one: Run, found: Ended, stamp: str) -> str:
    """A row of the table of results.

    Args:
        one: what was run.
        found: how it ended.
        stamp: cells of commit and date.
    """
    return f"| `{one.text}` | {found.code} | {found.processor_s:.0f} s | {stamp} |"


def stamp_now() -> str:
    """Commit, with a mark where the checkout is changed, and date, as cells of a table."""
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty", "--exclude=*"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    ).stdout.strip()
    return f"{commit or 'unknown'} | {datetime.now(UTC):%Y-%m-%d}"


def write_result(folder: Path, one: Run, found: Ended, stamp: str) -> None:
    """Write a result, and its row into the table beside it; rows of other commands stay.

    Args:
        folder: of the results.
        one: what was run.
        found: how it ended.
        stamp: cells of commit and date.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / one.file_name).write_text(result_text(one, found, stamp), "utf-8")
    table = folder / "README.md"
    rows = table.read_text("utf-8").splitlines()[2:] if table.exists() else []
    kept = [each for each in rows if not each.startswith(f"| `{one.text}` |")]
    lines = [HEAD, *sorted([*kept, row(one, found, stamp)])]
    table.write_text("\n".join(lines) + "\n", "utf-8")


def arguments() -> argparse.ArgumentParser:
    """The options."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench", description=(__doc__ or "").splitlines()[0]
    )
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--smoke", action="store_true", help="each with its smallest settings")
    how.add_argument("--quick", action="store_true", help="those that take less than 10 s")
    how.add_argument("--list", action="store_true", help="print all commands, and end")
    parser.add_argument("--only", default="", metavar="WORD", help="in the names of commands")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of the results")
    parser.add_argument("--jobs", type=int, help="commands at a time (2 with --smoke, else 1)")
    return parser


def main(words: Sequence[str] | None = None) -> int:
    """Run them; returns 1 if one failed.

    Args:
        words: of the command line, None: those of the process.
    """
    args = arguments().parse_args(words)
    runs = list(chosen(args))
    if args.list:
        print("| command | what it measures |\n|---|---|")
        print(*(f"| `{one.text}` | {one.command.what} |" for one in runs), sep="\n")
        return 0
    short = args.smoke or args.quick
    stamp, failed = stamp_now(), []
    print(HEAD, flush=True)
    with ThreadPoolExecutor(args.jobs or (2 if args.smoke else 1)) as pool:
        waiting = [pool.submit(ended, one, LONGEST_S if short else None) for one in runs]
        for one, each in zip(runs, waiting, strict=True):
            found = each.result()
            print(row(one, found, stamp), flush=True)
            if found.code:
                failed.append(one.text)
                print(found.out[-1000:], found.err[-3000:], sep="\n", file=sys.stderr, flush=True)
            if not short:
                write_result(args.results, one, found, stamp)
    print(*(f"failed: {text}" for text in failed), sep="\n", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
