"""Is `envelope_error` a bound? Steady motions of two modes with cubic terms, by harmonic balance.

    python -m tests.bench.bench_envelope_error [--scenes 500] [--first 0]

Random scenes of `tests.support.envelope_scenes`: modes 1 to 10 apart in frequency, Q 30 to 1e4, one
tone or two, the other mode driven or following, hardening or softening. The FMU's displacements
over a common period are compared with a balance that is none of the FMU's; the largest line of each
of the four counts. A scene that the model refuses, or that has no steady motion near, is counted
apart. Prints a Markdown table; exit code 1 if a bound is broken.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from tests.support.envelope_scenes import Compared, NotComparable, compared, scene

KINDS = ("one tone", "two tones")


def row(name: str, found: list[Compared], left: int) -> str:
    """A row of the table."""
    ratios = np.array([each.worst for each in found])
    if not found:
        return f"| {name} | 0 | {left} | | | |"
    cells = (f"{np.median(ratios):.2g}", f"{np.quantile(ratios, 0.99):.2g}", f"{ratios.max():.2g}")
    broken = int(np.sum(ratios > 1.0))
    return f"| {name} | {len(found)} | {left} | {broken} | {' | '.join(cells)} |"


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", type=int, default=500)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    args = parser.parse_args()
    found: tuple[list[Compared], list[Compared]] = ([], [])
    left = [0, 0]
    for seed in range(args.first, args.first + args.scenes):
        one = scene(seed)
        kind = int(one.beat > 0)
        try:
            found[kind].append(compared(one))
        except NotComparable as error:
            left[kind] += 1
            print(f"seed {seed}: {error}", file=sys.stderr)
            continue
        if found[kind][-1].worst > 1.0:
            print(f"seed {seed}: {found[kind][-1]}", file=sys.stderr)
    print("| drive | compared | left out | bound broken | error over bound: median | 99 % | most |")
    print("|---|---|---|---|---|---|---|")
    for name, rows, others in zip(KINDS, found, left, strict=True):
        print(row(name, rows, others))
    return int(any(each.worst > 1.0 for rows in found for each in rows))


if __name__ == "__main__":
    sys.exit(main())
