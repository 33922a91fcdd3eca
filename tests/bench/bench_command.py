"""How long does a whole `fmu-fit reconstruct` take, from its word to the last file?

    python -m tests.bench.bench_command [--campaign data/string_q1/campaign.toml] [--rounds 3]
        [--than DIR]

Wall time and processor time of the command with all its processes, with two workers and with one,
with a report and without. In every round each runs once, in turn, so that a machine that is busy is
so for all; times are medians, ratios the median of those of each round. With ``--than`` the same
command of another checkout goes along. Prints a Markdown table.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Variant:
    """A way to give the command: in words, the checkout it is of, its options."""

    name: str
    checkout: Path
    options: tuple[str, ...] = ()


@dataclass(frozen=True)
class Cost:
    """What one run took, s, and what the command says of its parts."""

    wall_s: float
    processor_s: float
    parts: str


def run_once(variant: Variant, campaign: Path, folder: Path) -> Cost:
    """The whole command in processes of its own."""
    words = [sys.executable, "-m", "fitting", "reconstruct", str(campaign.resolve())]
    words += ["--out", str(folder / "out"), *variant.options]
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    ended = subprocess.run(
        words,
        cwd=variant.checkout,
        env={**os.environ, "PYTHONPATH": str(variant.checkout)},
        capture_output=True,
        text=True,
        check=True,
    )
    wall_s = time.perf_counter() - begun
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    told = [line for line in ended.stdout.splitlines() if line.startswith("took ")]
    return Cost(wall_s, processor_s, told[-1].partition(": ")[2] if told else "")


def variants(than: Path | None) -> list[Variant]:
    """The command as it is first: others are measured by it."""
    found = [
        Variant("two workers, report", ROOT, ("--workers", "2")),
        Variant("one worker, report", ROOT, ("--workers", "1")),
        Variant("two workers, no report", ROOT, ("--workers", "2", "--no-report")),
        Variant("one worker, no report", ROOT, ("--workers", "1", "--no-report")),
    ]
    if than is not None:
        found.append(Variant("the other checkout, report", than.resolve(), ("--workers", "2")))
    return found


def main() -> None:
    """Read the arguments, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaign", type=Path, default=ROOT / "data/string_q1/campaign.toml")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--than", type=Path, help="another checkout, measured in turn")
    args = parser.parse_args()
    costs: dict[Variant, list[Cost]] = {variant: [] for variant in variants(args.than)}
    for _ in range(args.rounds):
        for variant, found in costs.items():
            with tempfile.TemporaryDirectory() as folder:
                found.append(run_once(variant, args.campaign, Path(folder)))
    print(
        "| command | wall, s | processor, s | wall by the first | processor by the first | parts |"
    )
    print("|---|---|---|---|---|---|")
    first = next(iter(costs.values()))
    for variant, found in costs.items():
        pairs = list(zip(found, first, strict=True))
        cells = (
            variant.name,
            f"{median(c.wall_s for c in found):.1f}",
            f"{median(c.processor_s for c in found):.1f}",
            f"{median(c.wall_s / f.wall_s for c, f in pairs):.2f}",
            f"{median(c.processor_s / f.processor_s for c, f in pairs):.2f}",
            sorted(found, key=lambda c: c.wall_s)[len(found) // 2].parts,
        )
        print(f"| {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
