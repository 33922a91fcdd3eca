"""Avoided crossings at laboratory size: is the coupling found, and does its interval hold it?

    python -m tests.bench.bench_crossing [--laboratories 200] [--modes 2 3] [--rising 20]
        [--noise 0.03 0.1 0.3 1 3] [--fmu 2] [--workers 2] [--record crossing.jsonl]

Virtual laboratories of `tests.support.virtual.crossing`, each with numbers, boxes and starts of its
own: 41 voltages in random order, 401 points each, drift of all frequencies, a wandering gain, noise
on both quadratures of which the magnitude is measured. Whole spectra are fitted by ``ff.fit`` and
profiled by ``ff.profile``. The closed form stands in place of the FMU, with --fmu so many
laboratories go through the FMU itself, one after the other, and tell the processor time of caller
and worker together; --fmu-file names another file of it, as a native one. --rising laboratories at
each --noise tell verdicts and what of them is false.
Of three modes both neighbouring couplings are told. With --record finished laboratories are kept
and not done again. Prints Markdown tables.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import fitting as ff
from tests.bench.records import Records
from tests.support.processes import spent_s
from tests.support.virtual.crossing import CrossingLaboratory, laboratory

METHOD = ff.Tikhonov(nu=1e-6, beta=0.01, levels=2, misfit="squares")
#: Seed, number of modes, noise (None: the laboratory's own), whether it goes through the FMU.
Wanted = tuple[int, int, float | None, bool]
#: Noise of the second table, as a share of the largest amplitude of each spectrum.
RISING = (0.03, 0.1, 0.3, 1.0, 3.0)


#: FMU files by their number of modes, in place of the models of this project.
FMU_FILES: dict[int, Path] = {}


@dataclass(frozen=True, kw_only=True)
class Coupling:
    """What was said of one coupling: verdict, value and error, 95 % interval, beside the truth."""

    name: str
    seed: int
    verdict: str
    value: float
    std: float
    low: float
    high: float
    truth: float

    @property
    def holds(self) -> bool:
        return self.low <= self.truth <= self.high


@dataclass(frozen=True, kw_only=True)
class Told:
    """What was said of one laboratory, and its processor time, s."""

    couplings: tuple[Coupling, ...]
    seconds: float


@cache
def _fmu(modes: int) -> ff.Fmu:
    """One per process; without --fmu it is described, never run."""
    return ff.Fmu(f"CoupledModes{modes}", workers=1)


def told(lab: CrossingLaboratory, problem: ff.Problem) -> tuple[Coupling, ...]:
    """Fit and profile a laboratory; of three modes the box is searched for the profiles alone."""
    starts = 3 if lab.modes == 2 else 1
    inference = ff.profile(ff.fit(problem, METHOD, starts=starts), list(lab.couplings))
    found = []
    for name in lab.couplings:
        value = inference[name]
        low, high = value.interval(0.95)
        found.append(
            Coupling(
                name=name,
                seed=lab.seed,
                verdict=str(value.status),
                value=value.value,
                std=value.std,
                low=low,
                high=high,
                truth=lab.truth[name],
            )
        )
    return tuple(found)


def by_closed_form(wanted: Wanted) -> Told:
    """One laboratory of a seed, a number of modes and a noise, in a process of its own."""
    seed, modes, noise, _ = wanted
    lab = laboratory(seed, modes=modes, noise=noise)
    begun = time.process_time()
    couplings = told(lab, lab.by_closed_form(_fmu(modes)))
    return Told(couplings=couplings, seconds=time.process_time() - begun)


def by_fmu(wanted: Wanted) -> Told:
    """One laboratory through the FMU, whose worker ends with it and is counted."""
    seed, modes, noise, _ = wanted
    lab, begun = laboratory(seed, modes=modes, noise=noise), spent_s()
    with ff.Fmu(FMU_FILES.get(modes, f"CoupledModes{modes}"), workers=1) as fmu:
        couplings = told(lab, lab.through(fmu))
    return Told(couplings=couplings, seconds=spent_s() - begun)


def all_told(wanted: Sequence[Wanted], records: Records, workers: int) -> list[Told]:
    """What was said of some laboratories; those that are not known yet are fitted."""
    missing = [key for key in wanted if key not in records.known]
    for key in (k for k in missing if k[-1]):  # one after the other: their workers are timed
        records.keep(key, asdict(by_fmu(key)))
    with ProcessPoolExecutor(workers) as pool:
        pending = {pool.submit(by_closed_form, key): key for key in missing if not key[-1]}
        for future in as_completed(pending):
            records.keep(pending[future], asdict(future.result()))
    return [_told_of(records.known[key]) for key in wanted]


def _told_of(answer: Mapping[str, Any]) -> Told:
    couplings = tuple(Coupling(**each) for each in answer["couplings"])
    return Told(couplings=couplings, seconds=answer["seconds"])


HEAD = (
    "laboratories",
    "coupling",
    "number",
    "determined",
    "95 % interval holds λ",
    "(value - λ)/std: mean, scatter",
    "std/λ, median",
    "processor s: median, most",
)


def row(title: str, name: str, found: Sequence[Told]) -> str:
    """A line of the first table."""
    all_ = [c for t in found for c in t.couplings if c.name == name]
    values = [c for c in all_ if c.verdict == "determined"]
    apart = np.array([(c.value - c.truth) / c.std for c in values])
    held = sum(c.holds for c in values)
    seconds = [t.seconds for t in found]
    cells = (
        title,
        name,
        len(all_),
        len(values),
        f"{held} of {len(values)} ({100.0 * held / max(1, len(values)):.1f} %)",
        f"{np.mean(apart):+.2f}, {np.std(apart):.2f}" if values else "–",
        f"{np.median([c.std / c.truth for c in values]):.2g}" if values else "–",
        f"{np.median(seconds):.1f}, {max(seconds):.1f}",
    )
    return f"| {' | '.join(map(str, cells))} |"


def rising_row(modes: int, noise: float, found: Sequence[Told]) -> str:
    """A line of the second table: verdicts at one noise, and what of them is false."""
    all_ = [c for t in found for c in t.couplings]
    values = [c for c in all_ if c.verdict == "determined"]
    bounds = [c for c in all_ if c.verdict.startswith("bounded")]
    std = f"{np.median([c.std / c.truth for c in values]):.2g}" if values else "–"
    cells = (
        modes,
        f"{noise:g}",
        len(all_),
        len(values),
        len(bounds),
        len(all_) - len(values) - len(bounds),
        f"{sum(not c.holds for c in values)} of {len(values)}",
        f"{sum(not c.holds for c in bounds)} of {len(bounds)}",
        std,
    )
    return f"| {' | '.join(map(str, cells))} |"


RISING_HEAD = (
    "modes",
    "noise over largest amplitude",
    "couplings",
    "determined",
    "bounded on one side",
    "unconstrained",
    "intervals without λ",
    "bounds that exclude λ",
    "std/λ, median",
)


def _head(cells: Iterable[str]) -> str:
    names = list(cells)
    return f"| {' | '.join(names)} |\n|{'---|' * len(names)}"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--laboratories", type=int, default=200, help="of each number of modes")
    parser.add_argument("--modes", type=int, nargs="+", default=[2, 3], choices=(2, 3))
    parser.add_argument("--rising", type=int, default=20, help="laboratories at each noise")
    parser.add_argument(
        "--noise", type=float, nargs="+", default=RISING, help="over the largest amplitude"
    )
    parser.add_argument("--fmu", type=int, default=2, help="laboratories through the FMU")
    parser.add_argument(
        "--fmu-file", type=Path, help="FMU of the first of --modes, as a native one"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--record", type=Path, help="JSON lines, to resume from")
    args = parser.parse_args()
    if args.fmu_file:
        FMU_FILES[args.modes[0]] = args.fmu_file
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    records = Records(args.record)
    print(_head(HEAD), flush=True)
    for modes in args.modes:
        for count, fmu, what in (
            (args.laboratories, False, ""),
            (args.fmu, True, ", through the FMU"),
        ):
            wanted = [(seed, modes, None, fmu) for seed in range(count)]
            found = all_told(wanted, records, args.workers)
            for k in range(1, modes if found else 1):
                print(row(f"{modes} modes{what}", f"lambda{k}{k + 1}", found), flush=True)
    if args.rising:
        print("", _head(RISING_HEAD), sep="\n", flush=True)
    for modes in args.modes if args.rising else ():
        for noise in args.noise:
            wanted = [(seed, modes, noise, False) for seed in range(args.rising)]
            found = all_told(wanted, records, args.workers)
            print(rising_row(modes, noise, found), flush=True)


if __name__ == "__main__":
    main()
