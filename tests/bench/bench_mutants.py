"""Would the tests notice? A sample of single-line faults, and how many of them a test kills.

    python -m tests.bench.bench_mutants [--count 300] [--seed 1] [--workers 2]
        [--journal mutants.jsonl] [--only PATH]

Faults are put into `fmu_src`, `fitting/signal`, `fitting/simulate` and `fitting/fit`: an operator,
a comparison, a constant (doubled, or one more), a sign, `min` for `max`, `and` for `or`. Which
tests run a line is measured once (coverage, a context per test); of these the quickest run first,
until one fails or their time is up. The equations in `fmu_src` run inside an FMU: they are asked of
all tests of `tests/models`.
Every fault lives in a copy of the checkout. Prints a Markdown table, and what survived.
A journal lets an interrupted sample go on; faults of lines that no test runs count as survived.
"""

from __future__ import annotations

import argparse
import json
import os
import queue
import random
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import coverage

from tests.support.mutation import Mutant, mutants_of, mutated

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("fmu_src", "fitting/signal", "fitting/simulate", "fitting/fit")
#: What the lines of a room are asked of when their tests are measured.
TESTS = {
    "fmu_src": ("tests/models",),
    "fitting/signal": ("tests/signal", "tests/measurements"),
    "fitting/simulate": ("tests/simulate", "tests/measurements"),
    "fitting/fit": ("tests/fit", "tests/inference"),
}
#: Seconds after which a fault counts as noticed: it hangs.
HANGS_S = 900.0
#: Seconds of tests that one fault is asked of, at most, by what they take without a fault.
MOST_S = 150.0


@dataclass(frozen=True)
class Covered:
    """Which tests run a line: test names by (path, line), and the seconds each test takes."""

    tests: Mapping[tuple[str, int], tuple[str, ...]]
    seconds: Mapping[str, float]

    def of(self, mutant: Mutant) -> list[str]:
        """Tests of a mutant, the quickest first; a line that runs on import belongs to its file."""
        found = set(self.tests.get((mutant.path, mutant.line), ()))
        if not found:
            mine = [names for (path, _), names in self.tests.items() if path == mutant.path]
            found = {name for names in mine for name in names}
        asked: list[str] = []
        total = 0.0
        for name in sorted(found, key=lambda name: (self.seconds.get(name, 1e9), name)):
            total += self.seconds.get(name, 1e9)
            if asked and total > MOST_S:
                break
            asked.append(name)
        return asked


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw the sample, run it, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--journal", type=Path, default=Path("mutants.jsonl"))
    parser.add_argument("--only", default="", help="faults of files whose path begins so")
    options = parser.parse_args(arguments)
    sample = [m for m in _sample(options.count, options.seed) if m.path.startswith(options.only)]
    done = _journal(options.journal)
    rooms = {room for room in ROOMS for m in sample if m.path.startswith(room + "/")}
    todo = [m for m in sample if m.name not in done]
    if todo:
        covered = _covered(rooms - {"fmu_src"})
        _run(todo, covered, options.workers, options.journal)
        done = _journal(options.journal)
    _report(sample, done)


def _sample(count: int, seed: int) -> list[Mutant]:
    """A sample in which every file has a share by its number of possible faults."""
    paths = sorted(
        str(path.relative_to(ROOT)) for room in ROOMS for path in (ROOT / room).rglob("*.py")
    )
    everything = [mutant for path in paths for mutant in mutants_of(ROOT, path)]
    return random.Random(seed).sample(everything, min(count, len(everything)))


def _journal(path: Path) -> dict[str, str]:
    """What is known: verdict by the mutant's name."""
    if not path.exists():
        return {}
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    return {row["mutant"]: row["verdict"] for row in rows}


def _covered(rooms: Iterable[str]) -> Covered:
    """Run the tests of some rooms once, line by line."""
    folders = sorted({folder for room in rooms for folder in TESTS[room]})
    if not folders:
        return Covered({}, {})
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "coverage"
        print(f"measuring which tests run which line: {' '.join(folders)}", file=sys.stderr)
        # the tests' own durations come from the report, contexts from coverage's plugin-free hook
        command = [
            *(sys.executable, "-m", "coverage", "run", f"--data-file={data}"),
            *(f"--rcfile={_rcfile(Path(folder))}", "-m", "pytest", "-q", "--durations=0"),
            *("--durations-min=0", "-p", "no:cacheprovider", *folders),
        ]
        run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        if run.returncode:
            raise SystemExit(f"the tests fail without any fault:\n{run.stdout[-3000:]}")
        return Covered(_contexts(data), _durations(run.stdout))


def _rcfile(folder: Path) -> Path:
    path = folder / "coveragerc"
    path.write_text("[run]\ndynamic_context = test_function\nsource = fitting\ncore = ctrace\n")
    return path


def _contexts(data: Path) -> dict[tuple[str, int], tuple[str, ...]]:
    """Test functions by line: "tests/fit/test_x.py::test_y" from "tests.fit.test_x.test_y"."""
    stored = coverage.CoverageData(str(data))
    stored.read()
    found: dict[tuple[str, int], tuple[str, ...]] = {}
    for file in stored.measured_files():
        path = str(Path(file).relative_to(ROOT))
        for line, contexts in stored.contexts_by_lineno(file).items():
            found[path, line] = tuple(filter(None, map(_node, contexts)))
    return found


def _node(context: str) -> str:
    parts = context.split(".")
    for k in range(len(parts), 0, -1):
        path = "/".join(parts[:k]) + ".py"
        if (ROOT / path).is_file():
            return "::".join([path, *parts[k:]]) if k < len(parts) else ""
    return ""


def _durations(report: str) -> dict[str, float]:
    """Seconds by test function, all its cases together."""
    seconds: dict[str, float] = defaultdict(float)
    for line in report.splitlines():
        words = line.split()
        if len(words) == 3 and words[1] in {"call", "setup"} and words[0].endswith("s"):
            seconds[words[2].split("[")[0]] += float(words[0][:-1])
    return seconds


def _run(todo: Sequence[Mutant], covered: Covered, workers: int, journal: Path) -> None:
    copies: queue.Queue[Path] = queue.Queue()
    with tempfile.TemporaryDirectory() as folder:
        for k in range(workers):
            copies.put(_copy(Path(folder) / f"copy{k}"))

        def one(mutant: Mutant) -> tuple[Mutant, str]:
            copy = copies.get()
            try:
                return mutant, _verdict(mutant, copy, covered)
            finally:
                copies.put(copy)

        with ThreadPoolExecutor(workers) as executor, journal.open("a") as lines:
            for k, (mutant, verdict) in enumerate(executor.map(one, todo)):
                lines.write(json.dumps({"mutant": mutant.name, "verdict": verdict}) + "\n")
                lines.flush()
                print(f"{k + 1}/{len(todo)} {verdict}: {mutant.name}", file=sys.stderr)


def _copy(folder: Path) -> Path:
    leave = shutil.ignore_patterns(".git", ".venv*", "__pycache__", ".*_cache", "out", "build")
    return Path(shutil.copytree(ROOT, folder, ignore=leave))


def _verdict(mutant: Mutant, copy: Path, covered: Covered) -> str:
    """Killed, survived, or not run by any test."""
    tests = ["tests/models"] if mutant.path.startswith("fmu_src") else covered.of(mutant)
    if not tests:
        return "no test"
    file = copy / mutant.path
    sound = file.read_text()
    file.write_text(mutated(sound, mutant))
    quiet = ("-x", "-q", "-p", "no:cacheprovider", "--no-header", "--tb=no")
    try:
        ended = subprocess.run(
            [sys.executable, "-m", "pytest", *quiet, *tests],
            cwd=copy,
            env={**os.environ, "PYTHONPATH": str(copy), "OPENBLAS_NUM_THREADS": "1", "CI": "true"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=HANGS_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return "killed"
    finally:
        file.write_text(sound)
    return "survived" if ended.returncode == 0 else "killed"


def _report(sample: Sequence[Mutant], verdicts: Mapping[str, str]) -> None:
    print("| part | faults | killed | survived | run by no test |")
    print("|---|---|---|---|---|")
    for room in ROOMS:
        mine = [verdicts[m.name] for m in sample if m.path.startswith(room + "/")]
        print(_row(room, mine))
    print(_row("all", [verdicts[m.name] for m in sample]))
    left = [m.name for m in sample if verdicts[m.name] != "killed"]
    print("\n".join(["", *left]))


def _row(name: str, verdicts: Sequence[str]) -> str:
    counts = [verdicts.count(word) for word in ("killed", "survived", "no test")]
    share = f" ({100.0 * counts[0] / len(verdicts):.0f} %)" if verdicts else ""
    return f"| {name} | {len(verdicts)} | {counts[0]}{share} | {counts[1]} | {counts[2]} |"


if __name__ == "__main__":
    main()
