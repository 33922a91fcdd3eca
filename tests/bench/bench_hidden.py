"""Which statements of a reconstruction are false? Hidden laboratories, a third of them wrong.

    python -m tests.bench.bench_hidden [--laboratories 50] [--kind noise] [--seed 0]
        [--only SEED] [--workers 2] [--record hidden.jsonl] [--show]

Four kinds, 50 of each: noise spectra, traces (ringdowns, recorded inputs, lock-in amplifiers),
joint fits (two series, two sweeps, a sweep beside a ringdown) and control maps. Numbers come from
the seed: 10 Hz to 100 MHz, Q of 30 to 1e6, couplings from half a line width to tens of them,
dampings up to 30 apart, noise of 0.01 % to 10 % of the peak, 20 to 600 points, starts up to a
factor of 3 off, boxes of 2 to 10 about them, priors on some. The data are made by the equations of
motion in `tests.support.hidden.motion`, which is no code of the FMUs; the fit is `fmu-fit
reconstruct` in this process, through the FMU's native twin. A third of each kind is wrong on
purpose: noise stated 3 times too small, an offset, a gain, a temperature, a line, a law, a drift or
a measurement of another sample that the campaign does not tell. Prints a table and every false
statement, each with its seed.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any

import build_fmu
from tests.bench.records import Records
from tests.support.hidden import joint, maps, noise, traces
from tests.support.hidden.judge import Judged, Said, judged
from tests.support.hidden.laboratory import Laboratory
from tests.support.hidden.table import listed, shown, table

KINDS: Mapping[str, Callable[[int], Laboratory]] = {
    "noise": noise.laboratory,
    "traces": traces.laboratory,
    "joint": joint.laboratory,
    "maps": maps.laboratory,
}
MODELS = ("CoupledOscillator", "CoupledModes2")
AGAIN = "python -m tests.bench.bench_hidden --kind KIND --only SEED --show"


def judge_one(kind: str, seed: int, folder: str) -> dict[str, Any]:
    """One laboratory, in a process of its own, as plain values."""
    made = KINDS[kind](seed)
    return asdict(judged(made, Path(folder) / f"{made.model}.fmu"))


def read(answer: Mapping[str, Any]) -> Judged:
    """A judged laboratory from plain values."""
    values = dict(answer)
    values["said"] = tuple(Said(**s) for s in values["said"])
    for name in ("findings", "warnings", "notes", "seen"):
        values[name] = tuple(values[name])
    values["false"] = tuple((sort, words) for sort, words in values["false"])
    return Judged(**values)


def run(
    wanted: Sequence[tuple[str, int]], workers: int, records: Records
) -> Iterator[tuple[int, Judged]]:
    """Laboratories as they are finished, those that a record holds at once."""
    open_ = [key for key in wanted if key not in records.known]
    for key in wanted:
        if key in records.known:
            yield wanted.index(key), read(records.known[key])
    if not open_:
        return
    with tempfile.TemporaryDirectory() as folder:
        for model in MODELS:
            build_fmu.build(model, Path(folder), native=())
        with ProcessPoolExecutor(workers) as pool:
            pending = {pool.submit(judge_one, *key, folder): key for key in open_}
            for future in as_completed(pending):
                key = pending[future]
                records.keep(key, future.result())
                yield wanted.index(key), read(records.known[key])


def main(words: Sequence[str] | None = None) -> None:
    """Print the table.

    Args:
        words: of the command line; None: those of this process.
    """
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kind", choices=list(KINDS), action="append")
    parser.add_argument("--laboratories", type=int, default=50, help="of each kind")
    parser.add_argument("--seed", type=int, default=1000, help="the first one")
    parser.add_argument("--only", type=int, help="one seed alone")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--record", type=Path, help="JSON lines, to resume from")
    parser.add_argument("--show", action="store_true", help="all statements beside the truth")
    args = parser.parse_args(words)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    seeds = range(args.seed, args.seed + args.laboratories)
    chosen = seeds if args.only is None else [args.only]
    wanted = [(kind, seed) for seed in chosen for kind in args.kind or KINDS]
    done: dict[int, Judged] = {}
    for place, one in run(wanted, args.workers, Records(args.record)):
        done[place] = one
        if args.show:
            print(*shown(one), sep="\n", flush=True)
        elif sys.stderr.isatty():
            print(f"\r{len(done)} of {len(wanted)}", end="", file=sys.stderr)
    ordered = sorted(done.values(), key=lambda one: (list(KINDS).index(one.kind), one.seed))
    print(*table(ordered), "", *listed(ordered, AGAIN), sep="\n")


if __name__ == "__main__":
    main()
