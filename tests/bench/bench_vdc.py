"""Lambda from a map over V_DC and two pumped sweeps, where the pump acts on lambda^2 as well.

    python -m tests.bench.bench_vdc                      # 100 laboratories, closed form
    python -m tests.bench.bench_vdc --laboratories 2 --by-fmu
    python -m tests.bench.bench_vdc --laboratories 5 --without-map     # by the FMU

Every laboratory has an angle, damping, noise, drive, slopes and gain of the electrode of its own,
and p12/p11 anywhere from 0 to 0.3. The data come from `fitting.lab.modes`; in place of the FMU
stands `tests.support.voltage_line`, which shares code with neither, unless --by-fmu. The table has
the share of 95 % intervals of the profile likelihood that hold the truth, the mean deviation in
standard errors, and how many are determined. --without-map leaves out the map and the laws that
share it: what is assumed of lambda^2 is then a finding, by how much lambda would shift.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import fitting as ff
from fitting.campaign import bind
from fitting.fit.problem import problem_of
from fitting.lab.string import STRING
from fitting.lab.subharmonic import PumpedSweep, SubharmonicBench
from fitting.lab.synthesis import synthesize
from fitting.lab.true_values import true_values
from fitting.lab.voltage import VoltageBench
from fitting.text.arrays import Scalar
from fitting.text.estimate import Verdict
from fitting.text.finding import Kind
from tests.bench.bench_pumped_string import opened
from tests.bench.records import Records
from tests.support.voltage_line import VoltageLine

NAMES = ("lambda12", "theta")
METHOD = ff.Tikhonov(nu=1e-6, beta=0.01, levels=1, misfit="squares")


def laboratory(seed: int) -> VoltageBench:
    """A string, an electrode and a noise of its own.

    Args:
        seed: of all of them.
    """
    rng = np.random.default_rng(seed)
    d1, d2 = (float(d) for d in rng.uniform(60.0, 160.0, 2))
    string = replace(STRING, theta_rad=float(rng.uniform(1.8, 2.2)), d1_hz=d1, d2_hz=d2)
    gain, apart_hz = float(rng.uniform(0.1, 2.0)), string.eta_minus_hz - string.eta_plus_hz
    first, second = (float(v) / gain for v in rng.uniform(0.7, 1.3, 2) * (0.25, 2.5))
    return VoltageBench(
        string=string,
        slopes_hz_v=(float(rng.uniform(-3300.0, -2700.0)), float(rng.uniform(2200.0, 2800.0))),
        coupling_share=float(rng.uniform(0.0, 0.3)),
        gain=gain,
        drive=float(rng.uniform(0.3, 1.5)),
        noise_v=40e-6 * float(rng.uniform(0.002, 0.01)),
        sweeps=(
            PumpedSweep(volts=first, pump_hz=apart_hz, span_hz=1000.0),
            PumpedSweep(volts=second, pump_hz=0.5 * apart_hz + 100.0, span_hz=1200.0),
        ),
    )


def found(seed: int, fmu: ff.Fmu, by_fmu: bool) -> dict[str, Any]:
    """Whether the interval holds the truth, the deviation in sigma, and determined, by name.

    Args:
        seed: of the laboratory and its noise.
        fmu: CoupledModes2.
        by_fmu: whether it is the model.
    """
    bench = laboratory(seed)
    with tempfile.TemporaryDirectory() as folder:
        made = synthesize(bench, seed=seed, out=Path(folder))
        campaign = ff.read_campaign(Path(folder) / "campaign.toml")

        def respond(_: Mapping[str, Scalar]) -> VoltageLine:
            return VoltageLine(bench)

        record = problem_of([bind(campaign, fmu.variables)])
        closed = ff.Problem.answered_by(respond, record)
        problem = ff.Problem.of(campaign, fmu) if by_fmu else closed
        inferred = ff.profile(ff.fit(problem, METHOD, starts=1), NAMES)
    truth = true_values(made.truth)
    rows = {}
    for name in NAMES:
        value = inferred[name]
        low, high = value.interval(0.95)
        off = (value.value - truth[name]) / value.std if value.std > 0.0 else np.nan
        is_determined = value.status == Verdict.DETERMINED
        rows[name] = (bool(low <= truth[name] <= high), float(off), bool(is_determined))
    return {"rows": rows, "std": inferred["lambda12"].std}


def without_map(seed: int, fmu: ff.Fmu) -> dict[str, Any]:
    """How far lambda is off by a pump that is taken not to act on it, and what the finding says.

    Args:
        seed: of the laboratory and its noise.
        fmu: CoupledModes2.
    """
    vdc = laboratory(seed)
    p = vdc.slopes
    f1 = vdc.at_voltage(vdc.bias_v).f_hz[0]
    still = PumpedSweep(volts=0.0, pump_hz=0.0, span_hz=1000.0)
    bench = SubharmonicBench(
        string=vdc.string,
        noise_v=vdc.noise_v,
        depth_per_volt=vdc.gain * float(abs(p[0, 0])) / f1**2,
        coupling_share=vdc.coupling_share,
        second_share=float(p[1, 1] / p[0, 0]),
        sweeps=(still, *vdc.sweeps),
    )
    with tempfile.TemporaryDirectory() as folder:
        made = synthesize(bench, seed=seed, out=Path(folder))
        campaign = ff.read_campaign(Path(folder) / "campaign.toml")
        result = ff.fit(ff.Problem.of(campaign, fmu), METHOD, starts=1).result
    said = [f for f in result.findings if f.kind is Kind.assumption and "lambda12^2" in f.subject]
    shift = said[0].numbers["shift_lambda12"] if said else float("nan")
    value = result.derived["lambda12"].value
    off = made.truth["outcome"]["lambda_hz"] - value
    return {"share": vdc.coupling_share, "off": off, "said": shift, "status": result.status}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--laboratories", type=int, default=100)
    parser.add_argument("--seed", type=int, default=56000)
    parser.add_argument("--by-fmu", action="store_true", help="fit through the FMU")
    parser.add_argument("--without-map", action="store_true", help="pumped sweeps alone")
    parser.add_argument("--fmu-file", type=Path, help="another CoupledModes2.fmu")
    parser.add_argument("--record", type=Path, help="JSON lines, to resume from")
    options = parser.parse_args()
    records, answers = Records(options.record), {}
    with opened(options.fmu_file) as fmu:
        for seed in range(options.seed, options.seed + options.laboratories):
            key = (seed, options.by_fmu, options.without_map)
            if key not in records.known:
                one = without_map(seed, fmu) if options.without_map else None
                records.keep(key, one or found(seed, fmu, options.by_fmu))
            answers[seed] = records.known[key]
            print(".", end="", flush=True)
    if options.without_map:
        print("\n| p12/p11 | lambda is off, kHz | the finding at 5 %, kHz |\n|---|---|---|")
        for a in answers.values():
            print(f"| {a['share']:.3f} | {a['off'] / 1e3:.1f} | {a['said'] / 1e3:.1f} |")
        return
    print("\n| value | inside 95 % | mean deviation, sigma | determined |\n|---|---|---|---|")
    for name in NAMES:
        inside, off, known = np.array([a["rows"][name] for a in answers.values()], dtype=float).T
        share, count = f"{int(inside.sum())} of {len(answers)}", f"{int(known.sum())}"
        print(f"| {name} | {share} | {np.nanmean(off):+.2f} | {count} |")
    stds = [a["std"] for a in answers.values()]
    print(f"sigma(lambda): {np.min(stds) / 1e3:.2f} to {np.max(stds) / 1e3:.2f} kHz", flush=True)


if __name__ == "__main__":
    main()
