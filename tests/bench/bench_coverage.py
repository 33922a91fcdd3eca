"""Do the intervals keep their promise? 95 % intervals over virtual laboratories with known truth.

    python tests/bench/bench_coverage.py [--laboratories 200] [--setting NAME]
        [--workers 2] [--seed 1] [--fmu]

Every laboratory has its own noise (and, where offsets are fitted, its own drift). It is measured
without the FMU (`fitting.lab.string`), fitted by phasors (`tests.phasors`; with --fmu through the
FMU, which answers alike and takes ten times as long), and asked whether the truth lies in the 95 %
interval of the profile likelihood. Prints a Markdown table.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import build_fmu
from fitting.campaign import BoundCampaign, bind, read_campaign
from fitting.campaign.parameters import references, to_search
from fitting.fit.noise import noise_of
from fitting.fit.objective import evaluate_many, make_objective
from fitting.fit.problem import problem_of
from fitting.fmu.description import FmuVariable, read_description
from fitting.fmu.pool import FmuWorkers
from fitting.inference.determine import InferenceOptions, determine
from fitting.inference.likelihood.knowledge import Determined
from fitting.lab.bench import Instrument, Measured, measure
from fitting.lab.benches import string_bench
from fitting.lab.instruments import LockIns
from fitting.lab.laboratories import changed
from fitting.lab.string import TwoModes, steady_state
from fitting.lab.writer import campaign_files
from fitting.measurements.measurement import Response
from fitting.text.results_folder import write_all
from tests.support.datasets import drafted, through
from tests.support.phasors import PhasorResponse

Variables = Mapping[str, FmuVariable]

#: Departure from the straight line at the middle of a series, Hz (standard deviation).
CURVED_HZ = 30.0
#: Relative noise of every amplitude where the other mode is recorded too.
CROSS_NOISE = 0.01
#: Of the instrument against the drive, where phases are recorded.
REFERENCE_RAD = 0.8


@dataclass(frozen=True)
class Laboratory:
    """A campaign as measured, and the truth of what is asked of it, by name."""

    bound: BoundCampaign
    truth: dict[str, float]
    start: dict[str, float]


@dataclass(frozen=True)
class Setting:
    """A kind of laboratory: how one is made from a seed, and whether its bounds are searched."""

    name: str
    words: str
    make: Callable[[int, Variables, Path], Laboratory]
    is_searched: bool = False


def width_of(modes: TwoModes, mode: int) -> float:
    """Full width of a mode, Hz: c^2 d1 + s^2 d2, or s^2 d1 + c^2 d2."""
    c2, s2 = math.cos(modes.theta_rad) ** 2, math.sin(modes.theta_rad) ** 2
    return (c2 * modes.d1_hz + s2 * modes.d2_hz, s2 * modes.d1_hz + c2 * modes.d2_hz)[mode]


def coupling_of(series: Measured) -> float:
    """Mean of lambda over the experiments, Hz: sqrt(-1/2 sin 2 theta (eta-^2 - eta+^2))."""
    found = [
        math.sqrt(
            -0.5
            * math.sin(2.0 * m.theta_rad)
            * (m.eta_minus_hz - m.eta_plus_hz)
            * (m.eta_minus_hz + m.eta_plus_hz)
        )
        for m in series.true_modes
    ]
    return float(np.mean(found))


def bound_of(
    series: Measured,
    variables: Variables,
    folder: Path,
    *,
    swept: bool = False,
    declared_hz: float | None = None,
) -> BoundCampaign:
    """The campaign of a series, written, read and bound; with offsets if the drift bends.

    With `swept` its sweep is fitted, with `declared_hz` as the error of what is stated of it.
    """
    files = dict(campaign_files(series, "bench_coverage"))
    if swept:
        text = 'use = "fit"'
        if declared_hz is not None:
            each = (f'{name} = "{declared_hz} Hz"' for name in ("eta_plus", "eta_minus"))
            text += f"\nset_sigma = {{ {', '.join(each)} }}"
        assert files["campaign.toml"].count('use = "scale"') == 1
        files["campaign.toml"] = files["campaign.toml"].replace('use = "scale"', text)
    write_all(folder, files)
    bound = bind(read_campaign(folder / "campaign.toml"), variables)
    return replace(bound, alternatives=bound.alternatives[:1])


def truth_of(series: Measured) -> dict[str, float]:
    """Width and quality factor of the observed mode, and the coupling."""
    bench = series.bench
    width = width_of(bench.modes, bench.observed)
    etas = [(m.eta_plus_hz, m.eta_minus_hz)[bench.observed] for m in series.true_modes]
    sign = ("plus", "minus")[bench.observed]
    quality = float(np.mean(etas)) / width
    return {f"width_{sign}": width, f"Q_{sign}": quality, "lambda": coupling_of(series)}


def linear(name: str) -> Callable[[int, Variables, Path], Laboratory]:
    """The paper's series with a drift that is linear, as the campaign assumes."""

    def make(seed: int, variables: Variables, folder: Path) -> Laboratory:
        bench = replace(string_bench(name), curvature_hz=0.0)
        series = measure(bench, seed)
        bound = bound_of(series, variables, folder)
        return Laboratory(bound, truth_of(series), {})

    return make


def offsets(
    seed: int, variables: Variables, folder: Path, instrument: Instrument | None = None
) -> Laboratory:
    """A drift that bends by 30 Hz (one sigma), with one fitted offset per experiment."""
    bend = CURVED_HZ * float(np.random.default_rng([seed, 2]).standard_normal())
    bench = replace(string_bench("q1"), curvature_hz=bend)
    series = measure(replace(bench, instrument=instrument or bench.instrument), seed)
    bound = bound_of(series, variables, folder)
    truth = truth_of(series)
    return Laboratory(bound, truth | pair_offsets(series, bound), {})


def pair_offsets(series: Measured, bound: BoundCampaign) -> dict[str, float]:
    """True offsets of the experiments, by the parameter's name; none where the drift is linear."""
    ends = series.eta_before_hz[0], series.eta_after_hz[0]
    last = len(series.true_modes) - 1
    return {
        parameter.name: modes.eta_plus_hz - (ends[0] + (ends[1] - ends[0]) * k / last)
        for k, (parameter, modes) in enumerate(zip(bound.offsets, series.true_modes, strict=False))
    }


def phases(seed: int, variables: Variables, folder: Path) -> Laboratory:
    """The same with X and Y, 1 % noise, and a restart before the fourth pair."""
    return offsets(
        seed, variables, folder, LockIns(CROSS_NOISE, both=False, phases=True, restarts=(3,))
    )


def gain(seed: int, variables: Variables, folder: Path) -> Laboratory:
    """The same through a complex gain that nobody knows: without a sweep."""
    laboratory = phases(seed, variables, folder)
    experiments = tuple(replace(e, unknown="gain") for e in laboratory.bound.experiments)
    return replace(laboratory, bound=replace(laboratory.bound, experiments=experiments, sweep=None))


def cross_phases(seed: int, variables: Variables, folder: Path) -> Laboratory:
    """X and Y of both modes at the pairs of both series, against one reference phase."""
    return cross(seed, variables, folder, phases=True)


def cross(seed: int, variables: Variables, folder: Path, *, phases: bool = False) -> Laboratory:
    """Both modes at the pairs of both series, 1 % noise each: what determines the coupling.

    Five pairs around the lower mode, where the other is recorded too, and five around the upper
    one, at the same drive and gain.
    """
    bench = replace(string_bench("q1"), curvature_hz=0.0)
    series = measure(bench, seed)
    bound = bound_of(series, variables, folder)
    generator = np.random.default_rng([seed, 3])
    upper = string_bench("q2").pairs_hz
    rows = []
    for k, (own, modes) in enumerate(zip(bound.experiments, series.true_modes, strict=True)):
        for label, pair, mode in (
            ("", own.tones_hz, 0),
            ("_cross", own.tones_hz, 1),
            ("_upper", upper[k], 1),
        ):
            waves = series.gain * steady_state(modes, np.array(pair))[:, mode]
            noise = generator.standard_normal(waves.size)
            if phases:
                noise = noise + 1j * generator.standard_normal(waves.size)
            noisy = np.exp(1j * REFERENCE_RAD) * waves * (1.0 + CROSS_NOISE * noise)
            if not phases:
                noisy = np.abs(waves) * (1.0 + CROSS_NOISE * noise)
            settings = {
                **own.settings,
                **dict(zip(bound.setup.drive.frequency_names, pair, strict=True)),
            }
            rows.append(
                replace(
                    own,
                    label=own.label + label,
                    tones_hz=tuple(pair),
                    settings=settings,
                    peaks_v=np.abs(noisy),
                    sigmas_v=CROSS_NOISE * np.abs(noisy),
                    phases_rad=np.angle(noisy) if phases else None,
                    spectrum=None,
                    output=("q1_hybrid", "q2_hybrid")[mode],
                )
            )
    bound = replace(bound, experiments=tuple(rows))
    return Laboratory(bound, truth_of(series), {"theta": 1.9635})


def swept(seed: int, variables: Variables, folder: Path) -> Laboratory:
    """A series and its sweep fitted together, other numbers each time: see `stated_wrongly`.

    Drift offsets with their prior, which the sweep has, too: its stated eigenfrequencies are off by
    up to half a line width.
    """
    return stated_wrongly(seed, variables, folder, off_hz=15.0)


def swept_linear(seed: int, variables: Variables, folder: Path) -> Laboratory:
    """The same with a drift that is linear, and half a hertz declared for the stated values.

    They are wrong by up to three times of that.
    """
    return stated_wrongly(seed, variables, folder, off_hz=0.5, declared=True)


def stated_wrongly(
    seed: int, variables: Variables, folder: Path, *, off_hz: float, declared: bool = False
) -> Laboratory:
    """A laboratory whose sweep is fitted, and whose stated eigenfrequencies are not the true ones.

    The modes are 5 to 20 kHz apart, so that the damping they share moves the line by hertz: a
    stated eigenfrequency that is believed tells of the damping what is not so.
    """
    rng = np.random.default_rng([seed, 5])
    modes = {
        "theta_rad": float(rng.uniform(1.7, 3.0)),
        "d1_hz": float(rng.uniform(40.0, 300.0)),
        "d2_hz": float(rng.uniform(40.0, 300.0)),
        "eta_minus_hz": 6940260.0 + float(rng.uniform(5e3, 2e4)),
    }
    bend = 0.0 if declared else CURVED_HZ * float(rng.standard_normal())
    series = measure(changed(string_bench("q1"), curvature_hz=bend, **modes), seed)
    declared_hz = off_hz if declared else None
    bound = bound_of(series, variables, folder, swept=True, declared_hz=declared_hz)
    assert bound.sweep is not None
    wrong = off_hz * np.clip(rng.standard_normal(2), -3.0, 3.0)
    settings = {
        name: float(bound.sweep.settings[name]) + float(off)
        for name, off in zip(("eta_plus", "eta_minus"), wrong, strict=True)
    }
    bound = replace(bound, sweep=replace(bound.sweep, settings=settings))
    truth = {"width_plus": width_of(series.bench.modes, 0), "d1": modes["d1_hz"]}
    first = series.bench.at(0.0).modes
    places = {"eta_plus": first.eta_plus_hz, "eta_minus": first.eta_minus_hz}
    swept = {f"offset {name}[sweep]": hz - settings[name] for name, hz in places.items()}
    truth["offset eta_plus[sweep]"] = swept["offset eta_plus[sweep]"]
    # the noise of the sweep is told by what is left of it at the point of the fit
    begun = swept | pair_offsets(series, bound)
    near = {"theta": modes["theta_rad"], "d1": modes["d1_hz"], "d2": modes["d2_hz"]}
    return Laboratory(bound, truth, begun | near)


SETTINGS = (
    Setting("q1", "q1 series, linear drift", linear("q1")),
    Setting("q2", "q2 series, linear drift", linear("q2")),
    Setting("offsets", "q1 series, drift bent by 30 Hz, offsets fitted", offsets),
    Setting("cross", "both modes at both series' pairs, 1 % noise", cross, is_searched=True),
    Setting("phases", "q1 series with phases, bent drift, a restart, 1 % noise", phases),
    Setting("gain", "the same, gain unknown, no sweep", gain),
    Setting("sweep", "a fitted sweep, its stated place 15 Hz off, drift offsets", swept),
    Setting("stated", "a fitted sweep, 0.5 Hz declared of its place", swept_linear),
    Setting(
        "cross-phases", "both modes, both pairs, with phases, 1 %", cross_phases, is_searched=True
    ),
)


def ask(
    setting: Setting, laboratory: Laboratory, respond: Callable[[BoundCampaign], Response]
) -> Determined:
    """What the data of one laboratory determine, asked for the values of known truth alone."""
    bound = laboratory.bound
    names = tuple(laboratory.truth)
    bound = replace(bound, derived=tuple(name for name in bound.derived if name in names))
    objective = make_objective(respond(bound), bound.parameters, problem_of([bound]).data)
    p = references(bound.parameters)
    for k, parameter in enumerate(bound.parameters):
        p[k] = laboratory.start.get(parameter.name, p[k])
    x = to_search(bound.parameters, p)
    [point] = evaluate_many(objective, [x])
    minima = None if setting.is_searched else ()
    options = InferenceOptions(only=names, minima=minima, budget=60000, directions=False)
    return determine(objective, x, noise_of(objective, point), options)


@dataclass
class Count:
    """Of one value: laboratories, truths inside, verdicts, widths of the interval and range."""

    inside: int = 0
    total: int = 0
    determined: int = 0
    open: int = 0
    shares: float = 0.0
    narrowest: float = math.inf
    #: Laboratories without a verdict: the model was not found to describe their data.
    withdrawn: int = 0

    def told(self, knowledge: Determined, name: str, truth: float) -> None:
        """Count one laboratory."""
        profile = knowledge.profiled[name]
        low, high = profile.ci95
        if profile.status == "no verdict":
            self.withdrawn += 1
            return
        share = (high - low) / (profile.bounds[1] - profile.bounds[0])
        self.total += 1
        self.inside += low <= truth <= high
        self.determined += profile.status == "determined"
        self.open += profile.status == "unconstrained"
        self.shares += share
        self.narrowest = min(self.narrowest, share)

    def plus(self, other: Count) -> Count:
        """Both together."""
        return Count(
            self.inside + other.inside,
            self.total + other.total,
            self.determined + other.determined,
            self.open + other.open,
            self.shares + other.shares,
            min(self.narrowest, other.narrowest),
            self.withdrawn + other.withdrawn,
        )


Counts = dict[str, Count]


def coverage(setting: Setting, seeds: Sequence[int], fmu: Path, *, by_fmu: bool) -> Counts:
    """Count over laboratories of these seeds, by value; drift offsets are counted together."""
    variables = read_description(fmu).variables
    counts: Counts = {}
    with FmuWorkers(fmu, workers=2) if by_fmu else nullcontext() as workers:

        def respond(bound: BoundCampaign) -> Response:
            if workers is None:
                return PhasorResponse(bound)
            return through(workers, bound, drafted(bound), bound.alternatives[0])

        for seed in seeds:
            with tempfile.TemporaryDirectory() as folder:
                laboratory = setting.make(seed, variables, Path(folder))
                knowledge = ask(setting, laboratory, respond)
            for name, truth in laboratory.truth.items():
                offset = any(p.name == name and p.experiments for p in laboratory.bound.parameters)
                kind = "drift offsets" if offset else name
                counts.setdefault(kind, Count()).told(knowledge, name, truth)
    return counts


def share(setting: str, seeds: Sequence[int], fmu: Path, by_fmu: bool) -> Counts:
    """`coverage` by the setting's name, for a process of its own."""
    [chosen] = [s for s in SETTINGS if s.name == setting]
    return coverage(chosen, seeds, fmu, by_fmu=by_fmu)


def added(parts: Sequence[Counts]) -> Counts:
    """Counts of several parts together."""
    whole: Counts = {}
    for part in parts:
        for name, count in part.items():
            whole[name] = whole[name].plus(count) if name in whole else count
    return whole


def table_rows(setting: Setting, counts: dict[str, Count]) -> list[str]:
    """Rows of the Markdown table."""
    rows = []
    for name, c in counts.items():
        word = (
            "determined"
            if c.determined == c.total
            else (f"determined in {c.determined}" if c.determined else "unconstrained")
        )
        word += f", no verdict in {c.withdrawn}" if c.withdrawn else ""
        rows.append(
            f"| {setting.words} | {name} | {word} | {c.inside}/{c.total} | "
            f"{100.0 * c.inside / c.total:.1f} % | {100.0 * c.shares / c.total:.3g} % |"
        )
    return rows


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--laboratories", type=int, default=200)
    parser.add_argument("--setting", choices=[s.name for s in SETTINGS], action="append")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fmu", action="store_true", help="fit through the FMU")
    args = parser.parse_args()
    print("| laboratory | value | verdict | truth inside | coverage | interval / range |")
    print("|---|---|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as folder, ProcessPoolExecutor(args.workers) as pool:
        fmu = build_fmu.build("CoupledOscillator", Path(folder))
        for setting in SETTINGS:
            if args.setting and setting.name not in args.setting:
                continue
            begun = time.monotonic()
            seeds = [10_000 * args.seed + k for k in range(args.laboratories)]
            parts = [seeds[k :: args.workers] for k in range(args.workers)]
            pending = [pool.submit(share, setting.name, part, fmu, args.fmu) for part in parts]
            counts = added([future.result() for future in pending])
            print("\n".join(table_rows(setting, counts)), flush=True)
            print(f"<!-- {setting.name}: {time.monotonic() - begun:.0f} s -->", flush=True)


if __name__ == "__main__":
    main()
