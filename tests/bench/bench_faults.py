"""Every kind of fault, tried and survived: the table of kinds.

    python -m tests.bench.bench_faults                     # all kinds, half an hour or more
    python -m tests.bench.bench_faults --only archive      # kinds with that word in their name

A fault is survived if the command ends with a documented exit code and one line on stderr (the
documented few) that names file, key or option, without a traceback, with nothing half-written in
--out and no temporary folder left.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

from fitting.api import progress
from tests.faults.all_of_them import Count, markdown, whole_table
from tests.faults.case import problems
from tests.faults.scene import built


def main() -> int:
    """Try them and print the table; returns 1 if a fault was not survived."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", default="", help="word in the names of kinds")
    parser.add_argument("--each", type=int, default=1, help="every n-th case only")
    given = parser.parse_args()
    progress.FIRST_S = progress.MOST_S = 1e6  # a slow machine's line of progress is no complaint
    counts: dict[str, Count] = {}
    with tempfile.TemporaryDirectory(prefix="faults-") as name:
        home = Path(name)
        scene = built(home)
        cases = [case for case in whole_table() if given.only in case.kind][:: given.each]
        for k, case in enumerate(cases):
            began = time.monotonic()
            found = problems(case, scene, home / f"case{k}")
            took = time.monotonic() - began
            count = counts.setdefault(case.kind, Count())
            count.tried += 1
            count.survived += not found
            for text in found[:2]:
                print(f"{case.kind}: {case.name}: {text} [{took:.1f} s]", flush=True)
    print(markdown(counts))
    return 1 if any(c.tried != c.survived for c in counts.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
