"""Do kinds of measurements tell a coupling in the order, and as well, as `design` promises?

    python -m tests.bench.bench_ways out/cmp [--laboratories 100] [--first 1]
    python -m tests.bench.bench_ways --candidates FOLDER

Each folder in OUT is what `fmu-fit design CAMPAIGN --candidates ... --time ...` wrote for one of
`synthesize --series crossing --reference`. Each laboratory measures its own map
and its own sweep for the scale, then each plan. Map and plan are fitted together by least squares
through the closed form of `tests.support.crossing_refit`, which shares no code with fit or FMU.
Prints a Markdown table: the error of lambda that was promised, and the one that was found.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

import numpy as np

from fitting.design.result import read_design
from tests.support.crossing_refit import LAMBDA, refitted

ROOT = Path(__file__).resolve().parents[2]


def write_candidates(folder: Path) -> None:
    """Write the tables of candidates that the page on the next measurement shows."""
    page = (ROOT / "docs" / "how-to" / "next-measurement.md").read_text("utf-8")
    folder.mkdir(parents=True, exist_ok=True)
    for block in re.findall(r"```toml\n(.*?)```", page, re.DOTALL):
        head = re.match(r"\[design\] +# (\w+\.toml):", block)
        if head:
            (folder / head[1]).write_text(block, "utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument(
        "--candidates",
        action="store_true",
        help="write tones.toml and sweeps.toml of how-to/next-measurement.md into OUT, and end",
    )
    parser.add_argument("--laboratories", type=int, default=100)
    parser.add_argument("--first", type=int, default=1)
    args = parser.parse_args()
    if args.candidates:
        write_candidates(args.out)
        return
    seeds = range(args.first, args.first + args.laboratories)
    found = {p.parent: read_design(p) for p in sorted(args.out.glob("*/design.json"))}
    first = next(iter(found.values()))
    rows: list[tuple[str, float, list[Path]]] = [("so far", first.before.at, [])]
    for folder, design in found.items():
        plans = [folder / "campaign" / "campaign.toml"]
        rows.append((folder.name, design.proposals[-1].expected.at, plans))
    print("| way | promised, mHz | found, mHz | mean error, mHz |\n|---|---|---|---|")
    for name, promised, plans in rows:
        errors = np.array([refitted(plans, seed) - LAMBDA for seed in seeds])
        rms, mean = 1e3 * np.sqrt(np.mean(errors**2)), 1e3 * np.mean(errors)
        print(f"| {name} | {1e3 * promised:.1f} | {rms:.1f} | {mean:.1f} |")


if __name__ == "__main__":
    main()
