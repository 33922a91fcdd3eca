"""What the tests cost: processor time of each file, of the dearest tests and of each fixture.

    python -m tests.bench.bench_tests [--workers 2] [--most 30] [--rows costs.json] [PATH ...]

Runs the tests as `.ci/run` does and prints Markdown tables in seconds of processor time, of the
test processes and all that they start, and the peak memory of all of them together (each shared
page counted once; Linux alone). A fixture's time is in that of the test that asks for it first.
Ends with pytest's exit code. `--rows` keeps every test's time, to compare commits.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import psutil

ROOT = Path(__file__).resolve().parents[2]
#: Time between two looks at the memory of all processes, s.
LOOK_S = 1.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the tests, print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("paths", nargs="*", metavar="PATH", help="tests; without any, all")
    parser.add_argument("--workers", type=int, default=2, help="test processes")
    parser.add_argument("--most", type=int, default=30, help="rows of a table")
    parser.add_argument("--rows", type=Path, help="JSON file for the time of every test")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pytest", "-q", "-n", str(options.workers)]
        # named, as pytest looks for its settings above every folder that it is given
        command += ["--dist", "worksteal", "-c", str(ROOT / "pyproject.toml")]
        command += ["-p", "tests.support.costs", f"--costs={folder}"]
        before = _waited_for_s()
        process = subprocess.Popen(
            [*command, *options.paths],
            cwd=ROOT,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "CI": "true"},
        )
        peak_mb = _peak_mb(process)
        whole_s = _waited_for_s() - before
        rows = [
            json.loads(line)
            for path in Path(folder).glob("*.jsonl")
            for line in path.read_text(encoding="utf-8").splitlines()
        ]
    tests = _sums(rows, "test")
    if options.rows is not None:
        options.rows.write_text(json.dumps(tests, indent=1), encoding="utf-8")
    print(report(tests, _sums(rows, "fixture"), whole_s, peak_mb, options.most))
    return process.returncode


def report(
    tests: Mapping[str, float],
    fixtures: Mapping[str, float],
    whole_s: float,
    peak_mb: float,
    most: int,
) -> str:
    """Markdown: totals, then the dearest files, tests and fixtures.

    Args:
        tests: processor time by test, s.
        fixtures: processor time by fixture, s.
        whole_s: of the whole run with collection and processes, s.
        peak_mb: largest memory of all processes together, MB; 0 where it is not known.
        most: rows of a table.
    """
    files: dict[str, float] = defaultdict(float)
    counts: Counter[str] = Counter()
    for name, seconds in tests.items():
        files[name.split("::")[0]] += seconds
        counts[name.split("::")[0]] += 1
    lines = [
        f"{len(tests)} tests, {whole_s:.0f} s of processor time, peak memory {peak_mb:.0f} MB",
        *("", "| file | tests | s |", "|---|---|---|"),
        *(f"| {name} | {counts[name]} | {s:.1f} |" for name, s in _largest(files, most)),
        *("", "| test | s |", "|---|---|"),
        *(f"| {name} | {s:.1f} |" for name, s in _largest(tests, most)),
        *("", "| fixture | s |", "|---|---|"),
        *(f"| {name} | {s:.1f} |" for name, s in _largest(fixtures, most)),
    ]
    return "\n".join(lines)


def _largest(sums: Mapping[str, float], most: int) -> list[tuple[str, float]]:
    """The dearest, with their seconds."""
    return sorted(sums.items(), key=lambda row: -row[1])[:most]


def _sums(rows: Sequence[Mapping[str, Any]], kind: str) -> dict[str, float]:
    """Processor time by name of all rows of a kind, s."""
    sums: dict[str, float] = defaultdict(float)
    for row in rows:
        if row["kind"] == kind:
            sums[row["name"]] += row["s"]
    return dict(sums)


def _waited_for_s() -> float:
    """Processor time of all children that have ended, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _peak_mb(process: subprocess.Popen[bytes]) -> float:
    """Wait for a process, looking how much memory it and all its descendants take, in MB."""
    peak_kb = 0
    root = psutil.Process(process.pid)
    while process.poll() is None:
        try:
            family = [root, *root.children(recursive=True)]
        except psutil.Error:  # ended between the two looks
            break
        peak_kb = max(peak_kb, sum(_proportional_kb(each.pid) for each in family))
        time.sleep(LOOK_S)
    process.wait()
    return peak_kb / 1024


def _proportional_kb(pid: int) -> int:
    """Memory of a process in kB, a page that n processes share counted as 1/n; 0 if not known."""
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii")
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in text.splitlines() if line.startswith("Pss:")), 0)


if __name__ == "__main__":
    sys.exit(main())
