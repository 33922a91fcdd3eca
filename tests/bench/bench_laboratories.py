"""Which statements of a fit are false? Virtual laboratories with known truth, judged one by one.

    python -m tests.bench.bench_laboratories [--kind pairs] [--laboratories 100] [--first 0]
        [--workers 2] [--record laboratories.jsonl] [--fmu] [--show] [--write FOLDER]

Samples from kHz to GHz, Q from 50 to 1e6, lambda from zero to far beyond the line width; boxes of
0.3 to 3, 0.01 to 100 and 0.001 to 1000 times a guess. Every laboratory is written as campaign files
and goes through ``ff.fit`` and ``ff.profile``; the model is the closed form of
`tests.support.virtual.modes` in place of the FMU (with --fmu the FMU itself, some fifty times as
slow). Every third (--widen) is fitted again with all boxes ten times as wide. With --record
finished laboratories are kept and not done again. Prints Markdown tables.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from functools import cache
from pathlib import Path

import fitting as ff
from tests.support.virtual.findings import counted, faults_table, findings, table
from tests.support.virtual.judge import Judged, by_closed_form, by_fmu, judged
from tests.support.virtual.kinds import KINDS

AGAIN = "python -m tests.bench.bench_laboratories --kind KIND --first SEED --laboratories 1 --show"


@cache
def _fmu() -> ff.Fmu:
    """One per process; without --fmu it is described, never run."""
    return ff.Fmu("CoupledOscillator", workers=1)


def judge_one(kind: str, seed: int, through_fmu: bool, widen: int) -> Judged:
    """One laboratory, in a process of its own."""
    solve = (by_fmu if through_fmu else by_closed_form)(_fmu())
    return judged(KINDS[kind](seed), solve, widened=widen > 0 and seed % widen == 0)


def recorded(path: Path | None) -> dict[tuple[str, int], Judged]:
    """Finished laboratories by kind and seed."""
    if path is None or not path.exists():
        return {}
    lines = path.read_text(encoding="utf-8").splitlines()
    found = [Judged(**json.loads(line)) for line in lines if line.strip()]
    return {(j.kind, j.seed): j for j in found}


def run(wanted: Sequence[tuple[str, int]], args: argparse.Namespace) -> Iterator[Judged]:
    """Laboratories as they are finished."""
    with ProcessPoolExecutor(args.workers) as pool:
        pending = [
            pool.submit(judge_one, kind, seed, args.fmu, args.widen) for kind, seed in wanted
        ]
        for future in as_completed(pending):
            yield future.result()


def shown(one: Judged) -> str:
    """Everything that was said of a laboratory, beside the truth."""
    lines = [
        f"{one.kind} {one.seed}: {one.status}, {one.fault or dict(one.notes)} {one.error}",
        f"chi square of the truth {one.chi2_truth:.5g}, fit {one.chi2_end:.5g} (minimum beside it "
        f"{one.chi2_fit:.5g}), profiles {one.chi2_best:.5g} ({one.chi2_profile:.5g}), "
        f"{one.chi2_rows} rows; {one.seconds:.1f} s",
    ]
    for s in one.said:
        lines.append(
            f"  {s.name:12} {s.verdict:20} {s.value:.8g} ± {s.std:.2g} in [{s.low:.8g}, "
            f"{s.high:.8g}], truth {s.truth:.8g} {'' if s.holds else 'OUTSIDE'} (bound "
            f"{s.bound:.2g}); wider boxes: {one.wide.get(s.name, '-')}"
        )
    lines += [f"  ! {sentence}" for sentence in one.warnings]
    lines += [f"  FALSE {f.about}: {f.sentence}" for f in findings(one)]
    return "\n".join(lines)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kind", choices=list(KINDS), action="append")
    parser.add_argument("--laboratories", type=int, default=100, help="of each kind")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--record", type=Path, help="JSON lines, to resume from")
    parser.add_argument("--widen", type=int, default=3, help="widen the boxes of one in so many")
    parser.add_argument("--fmu", action="store_true", help="fit through the FMU")
    parser.add_argument("--show", action="store_true", help="all statements beside the truth")
    parser.add_argument("--write", type=Path, help="write the campaigns below this folder, and end")
    args = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    seeds = range(args.first, args.first + args.laboratories)
    wanted = [(kind, seed) for seed in seeds for kind in args.kind or KINDS]
    if args.write is not None:
        for kind, seed in wanted:
            print(*KINDS[kind](seed).write(args.write / f"{kind}{seed}"), sep="\n")
        return
    known = recorded(args.record)
    done = [known[key] for key in wanted if key in known]
    for one in run([key for key in wanted if key not in known], args):
        done.append(one)
        if args.record is not None:
            with args.record.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(one)) + "\n")
        if args.show:
            print(shown(one), flush=True)
    report(sorted(done, key=lambda j: (list(KINDS).index(j.kind), j.seed)))


def report(done: Sequence[Judged]) -> None:
    """Tables, and every false statement with the command that repeats it."""
    print("\n".join(table(done)))
    if any(j.fault for j in done):
        print("", *faults_table(done), sep="\n")
    found = [f for j in done for f in findings(j)]
    for about, count in counted(found).items():
        print(f"\n### {about}: {count}\n")
        for f in found:
            if f.about == about:
                print(f"- {f.kind} {f.seed}: {f.sentence}")
    if found:
        print(f"\nAgain, one by one: `{AGAIN}`")


if __name__ == "__main__":
    main()
