"""Tests of which `.ci/run` runs a sample only: those marked ``nightly``, run before a release.

    python -m tests.bench.bench_nightly [--workers 2] [--smoke] [PATH ...]

They check what other tests check, with more seeds, laboratories, kinds of fault and settings.
`--smoke` runs those of one file, enough to see that they can be run.
Prints pytest's report and ends with its exit code.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
#: A file whose nightly tests take seconds.
SMOKE = ("tests/signal/test_sweep_faults.py",)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("paths", nargs="*", metavar="PATH", help="tests; without any, all")
    parser.add_argument("--workers", type=int, default=2, help="test processes")
    parser.add_argument("--smoke", action="store_true", help="one file of them")
    options = parser.parse_args(arguments)
    paths = SMOKE if options.smoke else options.paths
    command = [sys.executable, "-m", "pytest", "-q", "-m", "nightly", "-n", str(options.workers)]
    return subprocess.run(
        [*command, "--dist", "worksteal", *paths], cwd=ROOT, check=False
    ).returncode


if __name__ == "__main__":
    sys.exit(main())
