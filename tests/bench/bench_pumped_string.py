"""Lambda without the pump's depth: laboratories of pumped sweeps at two subharmonics, by the FMU.

    python -m tests.bench.bench_pumped_string                # 100 laboratories, native FMU
    python -m tests.bench.bench_pumped_string --coupling 0.05 --laboratories 20
    python -m tests.bench.bench_pumped_string --fisher       # standard errors against a closed form

Every laboratory has an angle, damping, noise (0.2 to 1 % of the peak) and gain of the pump of its
own, the gain anywhere in the three decades of its bounds, and states eta_plus and eta_minus with
errors; both drift by the same amount from sweep to sweep, which the campaign solves for. Its pump
is set as a laboratory sets one: the voltage is raised until the line opens by 2 to 8 FWHM at the
distance of the lines and by 1 to 5 FWHM at half of it, its frequency to where the two peaks are
closest. The data come from `fitting.lab.modes`, which shares no code with the FMU. Every run
counts: one that gives no interval has none that holds the truth.

The table has the share of 95 % intervals of the profile likelihood that hold the truth with the
one-sided binomial p of "at least 95 %", the share that is determined, and the mean deviation in
standard errors. With --coupling the pump acts on lambda^2 as well, by this share of f1^2, which the
fit is not told: the table then holds how far lambda is off against what the finding says. A fit
starts at the gain that the first opening has at the start's angle, and searches no box.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

import build_fmu
import fitting as ff
from fitting.lab.string import STRING
from fitting.lab.subharmonic import PumpedSweep, SubharmonicBench
from fitting.lab.synthesis import synthesize
from fitting.lab.true_values import true_values
from fitting.lab.writer import written_mhz
from fitting.text.estimate import FittedEstimate, Verdict
from fitting.text.finding import Kind
from tests.bench.records import Records
from tests.support.closest_peaks import closest_peaks_hz, peaks_hz

NAMES = ("lambda12", "theta", "d1", "d2", "f1", "f2")
#: Bounds of the gain in the campaign, 1/V.
GAINS = (1e-5, 1e-2)
#: Openings, in line widths, that voltages are raised to, by order of the subharmonic.
OPENINGS = {1: (2.0, 8.0), 2: (1.0, 5.0)}
#: A voltage is raised from this share of what opens the line so far, by so much at a time.
BELOW, RAISED = 0.8, 1.06
#: Where the campaign starts theta.
START_RAD = 2.1
#: Errors of what the campaign states of both lines, Hz, uniform.
ETA_ERRORS = (40.0, 300.0)
#: How far both lines drift between two sweeps, Hz, Gaussian; a line is some 100 Hz wide.
DRIFT_HZ = 15.0
#: What a campaign takes for the drift of the second and the third sweep.
DRIFTED = """
[[parameters]]
name = "{name}"
lower = "-100 Hz"
upper = "100 Hz"
start = "0 Hz"
"""


@dataclass(frozen=True)
class Laboratory:
    """A bench, and what happens to its lines.

    ``stated_hz``: eta_plus and eta_minus as its campaign states them; ``drifts_hz``: how far both
    lines are off at each sweep, by the first one.
    """

    bench: SubharmonicBench
    stated_hz: tuple[float, float]
    drifts_hz: tuple[float, ...]


def laboratory(seed: int, coupling: float = 0.0) -> Laboratory:
    """A string, a pump and a noise of its own.

    Args:
        seed: of all of them.
        coupling: p12/p11 of the pump.
    """
    rng = np.random.default_rng(seed)
    d1, d2 = (float(d) for d in rng.uniform(60.0, 160.0, 2))
    string = replace(STRING, theta_rad=float(rng.uniform(1.75, 2.2)), d1_hz=d1, d2_hz=d2)
    gain = float(np.exp(rng.uniform(*np.log(GAINS))))
    plain = SubharmonicBench(string=string, depth_per_volt=gain, coupling_share=coupling)
    noise = plain.crest_v * float(rng.uniform(0.002, 0.01))
    pumped = [set_pump(plain, order, float(rng.uniform(*OPENINGS[order]))) for order in (1, 2)]
    off = rng.uniform(-1.0, 1.0, 2) * ETA_ERRORS
    still = PumpedSweep(volts=0.0, pump_hz=0.0, span_hz=10.0 * string.widths_hz()[0])
    bench = replace(plain, noise_v=noise, sweeps=(still, *pumped))
    stated = (string.eta_plus_hz + float(off[0]), string.eta_minus_hz + float(off[1]))
    steps = np.append(0.0, rng.normal(0.0, DRIFT_HZ, 2))
    return Laboratory(bench, stated, tuple(map(float, np.cumsum(steps))))


def set_pump(bench: SubharmonicBench, order: int, widths: float) -> PumpedSweep:
    """The sweep under a pump whose voltage was raised until the line opens by so many widths.

    Args:
        bench: whose line it is.
        order: of the subharmonic.
        widths: FWHM of the unpumped line.
    """
    width = bench.string.widths_hz()[0]
    volts = BELOW * _depth(bench, order, widths * width) / bench.depth_per_volt
    while True:
        try:
            pump_hz, apart_hz = closest_peaks_hz(bench, volts, order)
        except ValueError:
            apart_hz = pump_hz = 0.0
        if apart_hz >= widths * width:
            span = apart_hz + 7.0 * width
            return PumpedSweep(volts=volts, pump_hz=round(pump_hz), span_hz=span)
        volts *= RAISED


def _depth(bench: SubharmonicBench, order: int, opening_hz: float) -> float:
    """About the depth that opens the line so far: the first order of J_n(beta)/beta."""
    string = bench.string
    eta, theta = 0.5 * (string.eta_plus_hz + string.eta_minus_hz), string.theta_rad
    first = 0.25 * eta * abs(np.sin(2.0 * theta))  # Hz for a depth of 1
    if order == 1:
        return float(opening_hz / first)
    beta = 0.5 * eta * abs(np.cos(2.0 * theta)) / (bench.eta_apart_hz / order)
    return float(np.sqrt(opening_hz / (0.5 * first * beta)))


def first_gain(bench: SubharmonicBench) -> float:
    """The gain that the opening at the distance of the lines has at the start's angle, 1/V.

    What a laboratory reads off the screen: a product of gain and |sin 2 theta|.

    Args:
        bench: with the sweep as its second one.
    """
    first = bench.sweeps[1]
    low, high = peaks_hz(bench, first.volts, first.pump_hz, 0.5 * first.span_hz)
    begun = replace(bench, string=replace(bench.string, theta_rad=START_RAD))
    return float(np.clip(_depth(begun, 1, high - low) / first.volts, *GAINS))


def drifted(rows: str, drifts_hz: Sequence[float]) -> str:
    """The table of sweeps with lines that drift: two more columns say which sweep a row is of.

    Lines and the frequencies they are seen at move alike: of 7 MHz, 50 Hz change no width.

    Args:
        rows: of sweeps.csv.
        drifts_hz: of each sweep.
    """
    lines = rows.splitlines()
    head = next(k for k, line in enumerate(lines) if line.startswith("volts"))
    points = (len(lines) - head - 1) // len(drifts_hz)
    made = [*lines[:head], f"second (1),third (1),{lines[head]}"]
    for k, line in enumerate(lines[head + 1 :]):
        sweep = k // points
        volts, pump, mhz, seen = line.split(",")
        at = float(mhz) + 1e-6 * drifts_hz[sweep]
        made.append(f"{int(sweep == 1)},{int(sweep == 2)},{volts},{pump},{at!r},{seen}")
    return "\n".join(made) + "\n"


def found(seed: int, fmu: ff.Fmu, coupling: float) -> dict[str, Any]:
    """What a laboratory's fit says: a row (inside, deviation, determined) by value, and findings.

    Args:
        seed: of the laboratory and its noise.
        fmu: CoupledModes2.
        coupling: p12/p11 of the pump.
    """
    lab, begun = laboratory(seed, coupling), time.process_time()
    with tempfile.TemporaryDirectory() as name:
        made = synthesize(lab.bench, seed=seed, out=Path(name))
        path = Path(name) / "campaign.toml"
        text = path.read_text("utf-8")
        string = lab.bench.string
        for true, stated in zip(
            (string.eta_plus_hz, string.eta_minus_hz), lab.stated_hz, strict=True
        ):
            text = text.replace(written_mhz(true), written_mhz(stated))
        text = text.replace("start = 1e-4", f"start = {first_gain(lab.bench)!r}")
        text = text.replace('controls = ["', 'controls = ["second", "third", "')
        # a design would have to say which sweep is next
        before, _, after = text.partition("[design.sweeps]")
        text = before + "[continuation]" + after.partition("[continuation]")[2]
        for line in ("plus", "minus"):
            moved = f"at_{line} + drift2*second + drift3*third)"
            text = text.replace(f"at_{line})", moved)
        text = text.replace(
            "# What the result rests on",
            "".join(DRIFTED.format(name=name) for name in ("drift2", "drift3"))
            + "\n# What the result rests on",
        )
        path.write_text(text, "utf-8")
        table = path.with_name("sweeps.csv")
        table.write_text(drifted(table.read_text("utf-8"), lab.drifts_hz), "utf-8")
        truth = true_values(made.truth)
        fit = ff.fit(ff.Problem.of(ff.read_campaign(path), fmu))
        if coupling:
            return _rests(fit.result, truth["lambda12"])
        result = ff.profile(fit, NAMES).result
    rows = {}
    values: dict[str, FittedEstimate] = {**result.parameters, **result.derived}
    for name, value in values.items():
        if name in NAMES:
            low, high = value.ci95
            determined = value.status is Verdict.DETERMINED
            off = (value.value - truth[name]) / value.std if value.std > 0.0 else np.nan
            rows[name] = (bool(low <= truth[name] <= high), float(off), determined)
    return {"rows": rows, "status": result.status, "seconds": time.process_time() - begun}


def _rests(result: Any, true: float) -> dict[str, Any]:
    """How far lambda is off, and what the finding on the direction of the pump says, Hz."""
    said = [f for f in result.findings if f.kind is Kind.assumption and "lambda12^2" in f.subject]
    shift = said[0].numbers["shift_lambda12"] if said else float("nan")
    return {"off": true - result.derived["lambda12"].value, "said": shift, "status": result.status}


def coverage(answers: Mapping[int, Mapping[str, Any]]) -> None:
    """Print the table of laboratories.

    Args:
        answers: of `found`, by seed.
    """
    count = len(answers)
    print("\n| value | inside 95 % | p | mean deviation, sigma | 4 sigma off | determined |")
    print("|---|---|---|---|---|---|")
    for name in NAMES:
        rows = np.array(
            [a["rows"].get(name, (0, np.nan, 0)) for a in answers.values()], dtype=float
        )
        inside, off, known = rows.T
        p = binomtest(int(inside.sum()), count, 0.95, alternative="less").pvalue
        cells = f"{100.0 * inside.mean():.0f} % | {p:.2g} | {np.nanmean(off):+.2f}"
        far = int(np.sum(np.abs(off[known > 0.0]) > 4.0))
        print(f"| {name} | {cells} | {far} | {int(known.sum())} of {count} |", flush=True)


def rests(answers: Mapping[int, Mapping[str, Any]]) -> None:
    """Print how far lambda is off where the pump acts on it, against what the finding says.

    Args:
        answers: of `found`, by seed.
    """
    print("\n| laboratory | lambda is off, kHz | the finding, kHz | ratio |\n|---|---|---|---|")
    for seed, a in answers.items():
        ratio = a["said"] / a["off"]
        print(f"| {seed} | {a['off'] / 1e3:.2f} | {a['said'] / 1e3:.2f} | {ratio:.3f} |")
    ratios = np.array([a["said"] / a["off"] for a in answers.values()])
    print(f"within 20 %: {int(np.sum(np.abs(ratios - 1.0) < 0.2))} of {ratios.size}", flush=True)


#: Sweeps, and sigma(lambda) in kHz with the depth known, to 10 % and not at all, of a Hill matrix.
FISHER = (
    ((0, 1), (0.64, 32.0, 194.0)),
    ((0, 2), (1.19, 1.23, 1.23)),
    ((0, 1, 2), (0.54, 0.67, 0.67)),
)


def fisher(fmu: ff.Fmu) -> list[tuple[float, ...]]:
    """sigma(lambda) in kHz of three sweeps of 61 points through the FMU, by `FISHER`'s rows.

    The pump of the third one is 118.5 Hz above half of the distance, as there.

    Args:
        fmu: CoupledModes2.
    """
    bench = SubharmonicBench(points=61)
    third = replace(bench.sweeps[2], pump_hz=0.5 * bench.eta_apart_hz + 118.5)
    bench = replace(bench, sweeps=(*bench.sweeps[:2], third), noise_scale=0.0)
    with tempfile.TemporaryDirectory() as name:
        made = synthesize(bench, out=Path(name))
        problem = ff.Problem.of(ff.read_campaign(Path(name) / "campaign.toml"), fmu)
        truth = true_values(made.truth)
        p = np.array([truth.get(name, 0.0) for name in problem.names])
        # the scale is solved inside: rows and slopes without what it takes
        matrix = np.array(problem.jac(p)) / problem.objective.data.sigma[:, np.newaxis]
        shares = made.measured.true_v.ravel() / bench.noise_v
    theta, gain = problem.names.index("theta"), problem.names.index("gain")
    rows = []
    for kept, _ in FISHER:
        mine = np.concatenate([np.arange(61 * k, 61 * (k + 1)) for k in kept])
        columns = np.column_stack([matrix[mine], shares[mine]])
        information = columns.T @ columns
        slope = _slope(truth["theta"], bench)
        row = []
        for known in (np.inf, 1.0 / (0.1 * bench.depth_per_volt), 0.0):
            added = information.copy()
            free = [k for k in range(added.shape[0]) if not (np.isinf(known) and k == gain)]
            if np.isfinite(known):
                added[gain, gain] += known**2
            variance = np.linalg.inv(_scaled(added[np.ix_(free, free)])[0])
            unit = _scaled(added[np.ix_(free, free)])[1]
            at = free.index(theta)
            row.append(abs(slope) * float(np.sqrt(variance[at, at])) / unit[at] / 1e3)
        rows.append(tuple(row))
    return rows


def _scaled(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A matrix with ones on its diagonal, and what its rows were divided by."""
    unit = np.sqrt(np.diag(matrix))
    return matrix / np.outer(unit, unit), unit


def _slope(theta: float, bench: SubharmonicBench) -> float:
    """d lambda/d theta, Hz/rad, from lambda^2 = -sin 2 theta (eta_minus^2 - eta_plus^2)/2."""
    plus, minus = bench.string.eta_plus_hz, bench.string.eta_minus_hz
    apart = 0.5 * (minus - plus) * (minus + plus)
    return float(-np.cos(2.0 * theta) * apart / np.sqrt(-np.sin(2.0 * theta) * apart))


@contextmanager
def opened(file: Path | None) -> Iterator[ff.Fmu]:
    """CoupledModes2 of a file, else its native twin.

    Args:
        file: of an FMU; None: it is built.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = file or build_fmu.build("CoupledModes2", Path(folder), native=())
        with ff.Fmu(path, 1) as fmu:
            yield fmu


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--laboratories", type=int, default=100)
    parser.add_argument("--seed", type=int, default=49000)
    parser.add_argument("--coupling", type=float, default=0.0, help="p12/p11 of the pump")
    parser.add_argument("--fisher", action="store_true", help="standard errors alone")
    parser.add_argument("--fmu-file", type=Path, help="another CoupledModes2.fmu")
    parser.add_argument("--record", type=Path, help="JSON lines, to resume from")
    options = parser.parse_args()
    with opened(options.fmu_file) as fmu:
        if options.fisher:
            print("| sweeps | depth known | to 10 % | unknown |\n|---|---|---|---|")
            for (kept, wanted), row in zip(FISHER, fisher(fmu), strict=True):
                cells = " | ".join(f"{a:.3g} ({b:g})" for a, b in zip(row, wanted, strict=True))
                print(f"| {', '.join(str(k + 1) for k in kept)} | {cells} |")
            return
        records, answers = Records(options.record), {}
        for seed in range(options.seed, options.seed + options.laboratories):
            key = (seed, options.coupling)
            if key not in records.known:
                records.keep(key, found(seed, fmu, options.coupling))
            answers[seed] = records.known[key]
            print(".", end="", flush=True)
        (rests if options.coupling else coverage)(answers)


if __name__ == "__main__":
    main()
