"""Which statements of `fitting` and `fmu_src` the tests run, in all processes that they start.

    python -m tests.bench.bench_statements [--workers 2] [--covered covered.json] [PATH ...]

Prints a Markdown table by package. With Python 3.12 or later it takes a tenth more time than the
tests alone, else twice their time. `--covered` keeps which files of tests run a line, and for how
many seconds, as `bench_mutants` wants it. Ends with pytest's exit code.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path

import coverage

ROOT = Path(__file__).resolve().parents[2]
SETTINGS = """\
[run]
source = fitting,fmu_src
core = {core}
parallel = true
patch = subprocess,_exit
data_file = {folder}/coverage
disable_warnings = no-sysmon-context,no-data-collected,module-not-imported,module-not-measured
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the tests, print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("paths", nargs="*", metavar="PATH", help="tests; without any, all")
    parser.add_argument("--workers", type=int, default=2, help="test processes")
    parser.add_argument("--covered", type=Path, help="JSON file of what `bench_mutants` wants")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        core = "sysmon" if sys.version_info >= (3, 12) else "ctrace"
        settings = Path(folder) / "coveragerc"
        settings.write_text(SETTINGS.format(core=core, folder=folder), encoding="utf-8")
        command = [sys.executable, "-m", "coverage", "run", f"--rcfile={settings}", "-m", "pytest"]
        command += ["-q", "-n", str(options.workers), "--dist", "loadfile", f"--costs={folder}"]
        # named, as pytest looks for its settings above every folder that it is given
        command += ["-c", str(ROOT / "pyproject.toml")]
        command += ["-p", "tests.support.costs", "-p", "tests.support.file_contexts"]
        code = subprocess.run(
            [*command, *options.paths],
            cwd=ROOT,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "CI": "true"},
            check=False,
        ).returncode
        measured = coverage.Coverage(data_file=f"{folder}/coverage", config_file=str(settings))
        measured.combine([folder])
        print(table(measured))
        if options.covered is not None:
            options.covered.write_text(json.dumps(_covered(measured, Path(folder))), "utf-8")
    return code


def table(measured: coverage.Coverage) -> str:
    """Markdown: statements of each package, and how many of them were run.

    Args:
        measured: whose data are combined.
    """
    statements: Counter[str] = Counter()
    missing: Counter[str] = Counter()
    paths = sorted(path for room in ("fitting", "fmu_src") for path in (ROOT / room).rglob("*.py"))
    for path in paths:
        _, lines, _, missed, _ = measured.analysis2(str(path))
        package = "/".join(path.relative_to(ROOT).parts[:-1][:2])
        for name in (package, "all"):
            statements[name] += len(lines)
            missing[name] += len(missed)
    rows = ["| package | statements | run | not run | share |", "|---|---|---|---|---|"]
    for name in sorted(statements):
        n, m = statements[name], missing[name]
        rows.append(f"| {name} | {n} | {n - m} | {m} | {100.0 * (n - m) / max(n, 1):.2f} % |")
    return "\n".join(rows)


def _covered(measured: coverage.Coverage, folder: Path) -> dict[str, object]:
    """Files of tests by line, and their seconds of processor time."""
    data = measured.get_data()
    tests = [
        [str(Path(file).relative_to(ROOT)), line, sorted(c for c in contexts if c)]
        for file in data.measured_files()
        for line, contexts in data.contexts_by_lineno(file).items()
    ]
    seconds: dict[str, float] = defaultdict(float)
    for path in folder.glob("*.jsonl"):
        for row in map(json.loads, path.read_text(encoding="utf-8").splitlines()):
            if row["kind"] == "test":
                seconds[row["name"].split("::")[0]] += row["s"]
    return {"tests": tests, "seconds": seconds}


if __name__ == "__main__":
    sys.exit(main())
