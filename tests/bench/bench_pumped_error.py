"""Is what `CoupledModes` declares of a pumped motion a bound? Against 50 digits.

    python -m tests.bench.bench_pumped_error [--scenes 1000] [--first 0] [--smoke]

Random scenes of `tests.support.pumped_scenes`: two modes like those of the string under pumps at
parts of their distance, with a sideband at minus an eigenfrequency, and near sums, where a pump
amplifies; 1 to 4 modes from kHz to GHz with Q from 10 to 1e8; soft modes under deep pumps.
Tolerances from 1e-14 to 0.1, a seventh with solver 1. Every output is compared with a longer chain
in mpmath, as are all sidebands together; the table has errors over declared ones. "above
tolerance": scenes of solver 0 that declare more than a tolerance of 1e-12 or more, as the read-out
nearly cancels. Prints a Markdown table; exit code 1 if a bound is broken.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from tests.support.pumped_scenes import KINDS, Compared, NotComparable, compared

SMOKE, LEAST_ASKED = 15, 1e-12


def row(name: str, found: list[Compared], left: int) -> str:
    """A row of the table."""
    if not found:
        return f"| {name} | 0 | {left} | | | | | |"
    ratios = np.array([each.worst for each in found])
    cells = (f"{np.median(ratios):.2g}", f"{np.quantile(ratios, 0.99):.2g}", f"{ratios.max():.3g}")
    broken = int(np.sum(ratios > 1.0))
    above = sum(each.exceeds(LEAST_ASKED) for each in found)
    return f"| {name} | {len(found)} | {left} | {broken} | {' | '.join(cells)} | {above} |"


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--smoke", action="store_true", help=f"{SMOKE} scenes")
    args = parser.parse_args()
    names = [f"{kind}, solver {solver}" for solver in (0, 1) for kind in KINDS]
    found: dict[str, list[Compared]] = {name: [] for name in names}
    left = dict.fromkeys(KINDS, 0)
    for seed in range(args.first, args.first + (SMOKE if args.smoke else args.scenes)):
        try:
            one = compared(seed)
        except NotComparable as error:
            left[KINDS[seed % len(KINDS)]] += 1
            print(f"seed {seed}: {error}", file=sys.stderr)
            continue
        found[f"{one.kind}, solver {one.solver}"].append(one)
        if one.worst > 1.0:
            print(f"seed {seed}: {one}", file=sys.stderr)
    heads = "scenes", "compared", "left out", "broken", "error over bound: median", "99 %", "most"
    print(f"| {' | '.join(heads)} | above tolerance |\n|---|---|---|---|---|---|---|---|")
    for name, rows in found.items():
        others = left[name.split(",")[0]] if name.endswith("0") else 0
        print(row(name, rows, others))
    return int(any(each.worst > 1.0 for rows in found.values() for each in rows))


if __name__ == "__main__":
    sys.exit(main())
