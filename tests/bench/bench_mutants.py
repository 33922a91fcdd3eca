"""Would the tests notice? A sample of single-line faults, and how many of them a test kills.

    python -m tests.bench.bench_mutants [--count 300] [--seed 1] [--workers 2]
        [--longest 150] [--most 0] [--journal mutants.jsonl] [--covered covered.json] [--only PATH]
        [--tests FILE ...]

Faults are put into `fmu_src` and the parts of `fitting` in `ROOMS`: an operator, a comparison,
a constant (doubled, or one more), a sign, `min` for `max`, `and` for `or`. Which
tests run a line is measured once (coverage, a context per test); of these the ones named like the
file run first, then those that run the fewest lines, until one fails, their time is up
(`--longest` seconds) or there are as many as `--most`. The
equations in `fmu_src` also run inside an FMU, which no coverage sees: tests that run a line of
them outside of one come first, then all others of `tests/models`.
Everything is done with copies of the checkout as it is at the beginning: it may change meanwhile.
Prints a Markdown table, and what survived: apart from these what is argued to change nothing that
a test could see, `tests/bench/argued_mutants.toml`.
A journal lets an interrupted sample go on, `--covered` keeps which tests run a line, for the same
checkout (`bench_statements` writes one for whole files of tests, in a tenth of the time);
faults of lines that no test runs count as survived.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import queue
import shutil
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import coverage

from tests.support.mutation import Argued, Mutant, argued_in, mutants_of, mutated

ROOT = Path(__file__).resolve().parents[2]
ARGUED = Path(__file__).with_name("argued_mutants.toml")
ROOMS = (
    "fmu_src",
    "fitting/signal",
    "fitting/simulate",
    "fitting/fit",
    "fitting/inference",
    "fitting/measurements",
    "fitting/campaign",
)
#: What the lines of a room are asked of when their tests are measured.
TESTS = {
    "fmu_src": ("tests/models",),
    "fitting/signal": ("tests/signal", "tests/measurements", "tests/campaign"),
    "fitting/simulate": ("tests/simulate", "tests/measurements"),
    "fitting/fit": ("tests/fit", "tests/inference"),
    "fitting/inference": ("tests/inference", "tests/api"),
    "fitting/measurements": ("tests/measurements", "tests/fit"),
    "fitting/campaign": ("tests/campaign", "tests/draft"),
}
#: A fault counts as noticed by a hang after so many seconds, and so many times its tests' own.
HANGS_S, HANGS_TIMES = 90.0, 10.0
#: Verdicts of the journal, and what stands for a fault that was never tried.
KILLED, SURVIVED, NO_TEST, NOT_TRIED = "killed", "survived", "no test", "not tried"


@dataclass(frozen=True)
class Limits:
    """What one fault is asked of: tests that take so long without a fault, and so many; 0: all."""

    longest_s: float = 150.0
    most: int = 0


@dataclass(frozen=True)
class Covered:
    """Which tests run a line: test names by (path, line), and the seconds each test takes."""

    tests: Mapping[tuple[str, int], tuple[str, ...]]
    seconds: Mapping[str, float]

    def of(self, mutant: Mutant, limits: Limits) -> list[str]:
        """Tests of a mutant, in the order asked; a line that runs on import belongs to its file."""
        found = set(self.tests.get((mutant.path, mutant.line), ()))
        if not found:
            mine = [names for (path, _), names in self.tests.items() if path == mutant.path]
            found = {name for names in mine for name in names}
        inside = set()
        if mutant.path.startswith("fmu_src/"):
            folder = TESTS["fmu_src"][0]
            inside = {name for name in self.seconds if name.startswith(folder)} - found
        asked: list[str] = []
        total = 0.0
        for name in [*self._in_turn(found, mutant), *self._in_turn(inside, mutant)]:
            total += self.seconds.get(name, 1e9)
            if asked and (total > limits.longest_s or len(asked) == limits.most):
                break
            asked.append(name)
        return asked

    @cached_property
    def breadth(self) -> Mapping[str, int]:
        """How many lines a test runs, by its name."""
        return Counter(name for names in self.tests.values() for name in names)

    def _in_turn(self, names: Iterable[str], mutant: Mutant) -> list[str]:
        """Those of the file's own name first, then those that run few lines besides this one.

        A test of a whole fit runs every line and asks little of each.
        """
        own = f"/test_{Path(mutant.path).stem}.py"

        def turn(name: str) -> tuple[bool, int, float, str]:
            away = not name.split("::")[0].endswith(own)
            return away, self.breadth.get(name, 0), self.seconds.get(name, 1e9), name

        return sorted(names, key=turn)


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw the sample, run it, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--journal", type=Path, default=Path("mutants.jsonl"))
    parser.add_argument("--covered", type=Path, help="which tests run a line: read, or kept there")
    parser.add_argument("--only", default="", help="faults of files whose path begins so")
    parser.add_argument("--tests", nargs="+", metavar="FILE", help="these tests alone")
    parser.add_argument("--longest", type=float, default=Limits.longest_s, help="s of tests each")
    parser.add_argument("--most", type=int, default=Limits.most, help="tests each; 0: all")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        base = _copy(ROOT, Path(folder) / "base")
        sample = _sample(base, options.count, options.seed)
        sample = [mutant for mutant in sample if mutant.path.startswith(options.only)]
        done = _journal(options.journal)
        rooms = {room for room in ROOMS for m in sample if m.path.startswith(room + "/")}
        todo = [mutant for mutant in sample if mutant.name not in done]
        if todo:
            files = options.tests or _files_of(base, rooms)
            covered = _kept(options.covered, base, files, options.workers)
            copies = [_copy(base, Path(folder) / f"copy{k}") for k in range(options.workers)]
            limits = Limits(options.longest, options.most)
            _run(todo, covered, limits, copies, options.journal)
        print(report(base, sample, _journal(options.journal), argued_in(ARGUED)))


def _sample(base: Path, count: int, seed: int) -> list[Mutant]:
    """A sample in which every file has a share by its number of possible faults.

    A fault is drawn or not by its own line, so that the sample stays when other lines change.
    """
    paths = sorted(
        str(path.relative_to(base)) for room in ROOMS for path in (base / room).rglob("*.py")
    )
    lots = [lot for path in paths for lot in _lots(base, path, seed)]
    return [mutant for _, mutant in sorted(lots, key=lambda lot: lot[0])[:count]]


def _lots(base: Path, path: str, seed: int) -> Iterator[tuple[bytes, Mutant]]:
    """The faults of a file, each with what it draws: from the text of its line and its place."""
    lines = (base / path).read_text().splitlines()
    seen: Counter[str] = Counter()
    for mutant in mutants_of(base, path):
        line = lines[mutant.line - 1]
        column = mutant.column - (len(line) - len(line.lstrip()))
        drawn = f"{seed} {path} {line.strip()} {column} {mutant.after}"
        seen[drawn] += 1  # the same line may stand there twice
        yield hashlib.sha256(f"{drawn} {seen[drawn]}".encode()).digest(), mutant


def _journal(path: Path) -> dict[str, str]:
    """What is known: verdict by the mutant's name."""
    if not path.exists():
        return {}
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    return {row["mutant"]: row["verdict"] for row in rows}


def _kept(path: Path | None, base: Path, files: Sequence[str], workers: int) -> Covered:
    """What a file holds, or what is measured now and written there."""
    if path is not None and path.exists():
        stored = json.loads(path.read_text())
        lines = {(file, line): tuple(names) for file, line, names in stored["tests"]}
        return Covered(lines, stored["seconds"])
    covered = _covered(base, files, workers)
    if path is not None:
        rows = [[file, line, names] for (file, line), names in covered.tests.items()]
        path.write_text(json.dumps({"tests": rows, "seconds": covered.seconds}))
    return covered


def _files_of(base: Path, rooms: Iterable[str]) -> list[str]:
    """Files of the tests of some rooms, relative to the checkout."""
    folders = sorted({folder for room in rooms for folder in TESTS[room]})
    return sorted(
        str(path.relative_to(base)) for each in folders for path in (base / each).rglob("test_*.py")
    )


def _covered(base: Path, files: Sequence[str], workers: int) -> Covered:
    """Run some files of tests once, line by line, some beside each other."""
    folders = sorted({Path(file).parent.as_posix() for file in files})
    print(f"measuring which tests run which line: {' '.join(folders)}", file=sys.stderr)
    parts = [files[k::workers] for k in range(workers) if files[k::workers]]
    with ThreadPoolExecutor(workers) as executor:
        runs = list(executor.map(lambda part: measured(base, part), parts))
    tests: dict[tuple[str, int], tuple[str, ...]] = {}
    seconds: dict[str, float] = {}
    for each in runs:
        for place, names in each.tests.items():
            tests[place] = tests.get(place, ()) + names
        seconds |= each.seconds
    return Covered(tests, seconds)


def measured(base: Path, files: Sequence[str]) -> Covered:
    """Run some files of tests once, line by line.

    Args:
        base: folder of the checkout.
        files: of tests, relative to it.

    Raises:
        SystemExit: pytest does not run them.
    """
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "coverage"
        command = [
            *(sys.executable, "-m", "coverage", "run", f"--data-file={data}"),
            *(f"--rcfile={_rcfile(Path(folder))}", "-m", "pytest", "-q", "--durations=0"),
            *("--durations-min=0", "-rfE", "-p", "no:cacheprovider"),
            *("-p", "tests.support.line_contexts", *files),
        ]
        run = subprocess.run(
            command, cwd=base, env=_environment(base), capture_output=True, text=True, check=False
        )
        if run.returncode not in (0, 1):
            raise SystemExit(f"the tests do not run:\n{run.stdout[-3000:]}")
        failed = _failed(run.stdout)
        if failed:
            print(f"fail without any fault, not asked: {' '.join(failed)}", file=sys.stderr)
        durations = _durations(run.stdout)
        seconds = {name: s for name, s in durations.items() if name not in failed}
        return Covered(_tests_by_line(base, data, seconds), seconds)


def _failed(report: str) -> list[str]:
    """Test functions that failed, of the short summary at the end."""
    rows = [line.split() for line in report.splitlines() if line.startswith(("FAILED ", "ERROR "))]
    return sorted({words[1].split("[")[0] for words in rows})


def _rcfile(folder: Path) -> Path:
    path = folder / "coveragerc"
    told = ("source = fitting,fmu_src", "core = ctrace", "concurrency = thread")
    path.write_text("\n".join(("[run]", *told, "")))
    return path


def _tests_by_line(
    base: Path, data: Path, known: Iterable[str]
) -> dict[tuple[str, int], tuple[str, ...]]:
    """Test functions by line, as "tests/fit/test_x.py::test_y"; a fixture's line is its file's."""
    stored = coverage.CoverageData(str(data))
    stored.read()
    by_context: dict[str, list[str]] = defaultdict(list)
    for name in known:
        by_context[name].append(name)
        by_context[name.split("::")[0]].append(name)
    found: dict[tuple[str, int], tuple[str, ...]] = {}
    for file in stored.measured_files():
        path = str(Path(file).relative_to(base.resolve()))
        for line, contexts in stored.contexts_by_lineno(file).items():
            names = {name for context in contexts for name in by_context.get(context, ())}
            found[path, line] = tuple(sorted(names))
    return found


def _durations(report: str) -> dict[str, float]:
    """Seconds by test function, all its cases together."""
    seconds: dict[str, float] = defaultdict(float)
    for line in report.splitlines():
        words = line.split(maxsplit=2)  # the names of cases have blanks
        if len(words) == 3 and words[1] in {"call", "setup"} and words[0].endswith("s"):
            seconds[words[2].split("[")[0]] += float(words[0][:-1])
    return seconds


def _run(
    todo: Sequence[Mutant],
    covered: Covered,
    limits: Limits,
    copies: Sequence[Path],
    journal: Path,
) -> None:
    free: queue.Queue[Path] = queue.Queue()
    for copy in copies:
        free.put(copy)

    def one(mutant: Mutant) -> tuple[Mutant, str]:
        copy = free.get()
        try:
            tests = covered.of(mutant, limits)
            sound_s = sum(covered.seconds.get(name, 0.0) for name in tests)
            return mutant, _verdict(mutant, copy, tests, HANGS_S + HANGS_TIMES * sound_s)
        finally:
            free.put(copy)

    with ThreadPoolExecutor(len(copies)) as executor, journal.open("a") as lines:
        for k, (mutant, verdict) in enumerate(executor.map(one, todo)):
            lines.write(json.dumps({"mutant": mutant.name, "verdict": verdict}) + "\n")
            lines.flush()
            print(f"{k + 1}/{len(todo)} {verdict}: {mutant.name}", file=sys.stderr)


def _copy(source: Path, folder: Path) -> Path:
    """What is under version control or is about to be; files that vanish meanwhile are left out."""
    leave = shutil.ignore_patterns(".git", ".venv*", "__pycache__", ".*_cache", "out", "build")
    try:
        shutil.copytree(source, folder, ignore=leave)
    except shutil.Error as error:
        print(f"not copied: {error}", file=sys.stderr)
    return folder


def _environment(folder: Path) -> dict[str, str]:
    own = {"PYTHONPATH": str(folder), "OPENBLAS_NUM_THREADS": "1", "CI": "true"}
    return {**os.environ, **own}


def _verdict(mutant: Mutant, copy: Path, tests: Sequence[str], hangs_s: float) -> str:
    """Killed, survived, or not run by any test."""
    if not tests:
        return NO_TEST
    file = copy / mutant.path
    sound = file.read_text()
    file.write_text(mutated(sound, mutant))
    quiet = ("-x", "-q", "-p", "no:cacheprovider", "--no-header", "--tb=no")
    try:
        ended = subprocess.run(
            [sys.executable, "-m", "pytest", *quiet, *tests],
            cwd=copy,
            env=_environment(copy),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=hangs_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return KILLED
    finally:
        file.write_text(sound)
    return SURVIVED if ended.returncode == 0 else KILLED


def report(
    base: Path, sample: Sequence[Mutant], verdicts: Mapping[str, str], argued: Sequence[Argued]
) -> str:
    """Markdown: a table by room, what survived, and what is argued of the rest.

    Args:
        base: folder of the sources that the faults were put into.
        sample: all faults.
        verdicts: by the name of a fault; one that is missing was not tried.
        argued: what changes nothing that a test could see.
    """
    found = {m.name: verdicts.get(m.name, NOT_TRIED) for m in sample}
    reasons = {
        m.name: next((each.reason for each in argued if each.says(base, m)), "")
        for m in sample
        if found[m.name] in (SURVIVED, NO_TEST)
    }
    lines = [
        "| part | faults | killed | survived | run by no test | argued | not tried |",
        "|---|---|---|---|---|---|---|",
    ]
    for room in ROOMS:
        lines.append(
            _row(room, [m for m in sample if m.path.startswith(room + "/")], found, reasons)
        )
    lines.append(_row("all", sample, found, reasons))
    lines += ["", *(m.name for m in sample if m.name in reasons and not reasons[m.name])]
    if any(reasons.values()):
        lines += ["", "argued:", *(f"{name}: {why}" for name, why in reasons.items() if why)]
    stale = [each for each in argued if not each.stands(base)]
    lines += [f"no such line any more: {each.path}: {each.line}" for each in stale]
    return "\n".join(lines)


def _row(
    name: str, faults: Sequence[Mutant], found: Mapping[str, str], reasons: Mapping[str, str]
) -> str:
    """Counts of a room; the share killed is of those that were tried."""
    argued = [m for m in faults if reasons.get(m.name)]
    rest = [found[m.name] for m in faults if not reasons.get(m.name)]
    killed, survived, no_test, left = (
        rest.count(word) for word in (KILLED, SURVIVED, NO_TEST, NOT_TRIED)
    )
    tried = len(faults) - left
    share = f" ({100.0 * killed / tried:.0f} %)" if tried else ""
    counts = f"{killed}{share} | {survived} | {no_test} | {len(argued)} | {left}"
    return f"| {name} | {len(faults)} | {counts} |"


if __name__ == "__main__":
    main()
