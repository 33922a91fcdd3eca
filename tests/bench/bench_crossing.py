"""Avoided crossings at laboratory size: is the coupling found, and does its interval hold it?

    python -m tests.bench.bench_crossing [--laboratories 200] [--three 50] [--rising 20] [--fmu 2]
        [--workers 2] [--record crossing.jsonl]

Virtual laboratories of `tests.support.virtual.crossing`, each with numbers, boxes and starts of its
own: 41 voltages in random order, 401 points each, drift of all frequencies, a wandering gain, noise
on both quadratures of which the magnitude is measured. Whole spectra are fitted by ``ff.fit`` and
profiled by ``ff.profile``. The closed form stands in place of the FMU, with --fmu so many
laboratories go through the FMU itself, one after the other, and tell the processor time of caller
and worker together. With --record finished laboratories are kept and not done again. Prints
Markdown tables.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

import numpy as np

import fitting as ff
from tests.support.virtual.crossing import CrossingLaboratory, laboratory

METHOD = ff.Tikhonov(nu=1e-6, beta=0.01, levels=2, misfit="squares")
#: Seed, number of modes, and noise (None: the laboratory's own).
Wanted = tuple[int, int, float | None]
#: Noise of the second table, as a share of the largest amplitude of each spectrum.
RISING = (0.03, 0.1, 0.3, 1.0, 3.0)


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
                verdict=str(value.verdict),
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
    seed, modes, noise = wanted
    lab = laboratory(seed, modes=modes, noise=noise)
    begun = time.process_time()
    couplings = told(lab, lab.by_closed_form(_fmu(modes)))
    return Told(couplings=couplings, seconds=time.process_time() - begun)


class Records:
    """Laboratories that are finished, in a file of JSON lines where one is named."""

    def __init__(self, path: Path | None, workers: int) -> None:
        self.path, self.workers = path, workers
        self.known: dict[Wanted, Told] = {}
        if path is not None and path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                entry = json.loads(line)
                couplings = tuple(Coupling(**c) for c in entry["couplings"])
                seed, modes, noise = entry["wanted"]
                self.known[seed, modes, noise] = Told(couplings=couplings, seconds=entry["seconds"])

    def of(self, wanted: Sequence[Wanted]) -> list[Told]:
        """What was said of some laboratories; those that are not known yet are fitted."""
        with ProcessPoolExecutor(self.workers) as pool:
            missing = [key for key in wanted if key not in self.known]
            pending = {pool.submit(by_closed_form, key): key for key in missing}
            for future in as_completed(pending):
                key, found = pending[future], future.result()
                self.known[key] = found
                if self.path is not None:
                    with self.path.open("a", encoding="utf-8") as file:
                        file.write(json.dumps({"wanted": key, **asdict(found)}) + "\n")
        return [self.known[key] for key in wanted]


def spent_s() -> float:
    """Processor time of this process and of those that have ended, s."""
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(used.ru_utime + used.ru_stime for used in both)


def by_fmu(seed: int, modes: int) -> Told:
    """One laboratory through the FMU, whose worker ends with it and is counted."""
    lab, begun = laboratory(seed, modes=modes), spent_s()
    with ff.Fmu(f"CoupledModes{modes}", workers=1) as fmu:
        couplings = told(lab, lab.through(fmu))
    return Told(couplings=couplings, seconds=spent_s() - begun)


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
        f"{np.mean(apart):+.2f}, {np.std(apart):.2f}",
        f"{np.median([c.std / c.truth for c in values]):.2g}",
        f"{np.median(seconds):.1f}, {max(seconds):.1f}",
    )
    return f"| {' | '.join(map(str, cells))} |"


def rising_row(noise: float, found: Sequence[Told]) -> str:
    """A line of the second table: verdicts at one noise, and what of them is false."""
    all_ = [c for t in found for c in t.couplings]
    values = [c for c in all_ if c.verdict == "determined"]
    bounds = [c for c in all_ if c.verdict.startswith("bounded")]
    std = f"{np.median([c.std / c.truth for c in values]):.2g}" if values else "–"
    cells = (
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
    "noise over largest amplitude",
    "couplings",
    "determined",
    "bounded on one side",
    "not determined",
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
    parser.add_argument("--laboratories", type=int, default=200, help="of two modes")
    parser.add_argument("--three", type=int, default=50, help="laboratories of three modes")
    parser.add_argument("--rising", type=int, default=20, help="laboratories at each noise")
    parser.add_argument("--fmu", type=int, default=2, help="laboratories through the FMU")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--record", type=Path, help="JSON lines, to resume from")
    args = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    records = Records(args.record, args.workers)
    print(_head(HEAD), flush=True)
    for modes, count in ((2, args.laboratories), (3, args.three)):
        found = records.of([(seed, modes, None) for seed in range(count)])
        for k in range(1, modes if found else 1):
            print(row(f"{modes} modes", f"lambda{k}{k + 1}", found), flush=True)
    if args.fmu:
        through = [by_fmu(seed, 2) for seed in range(args.fmu)]
        print(row("2 modes, through the FMU", "lambda12", through), flush=True)
    if args.rising:
        print("", _head(RISING_HEAD), sep="\n", flush=True)
    for noise in RISING if args.rising else ():
        found = records.of([(seed, 2, noise) for seed in range(args.rising)])
        print(rising_row(noise, found), flush=True)


if __name__ == "__main__":
    main()
