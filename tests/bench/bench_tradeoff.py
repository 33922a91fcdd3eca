"""What speed costs in accuracy, and whether the plan chooses well: trade-offs of five campaigns.

    python -m tests.bench.bench_tradeoff [--only NAME ...] [--no-fit] [--quick]

The shipped series q1 and the Duffing string, and three FMUs with solvers of their own: van der
Pol's oscillator (Euler's steps of 0.01 s, a Reference FMU), a stiff thermal room (implicit steps of
20 s) and a mass on a hardening spring (Runge and Kutta's steps of 1 ms). Data of these three are
synthetic, by scipy at rtol 1e-10, with noise from a seed; starts are a tenth off, so that errors
relative to the data and to the model's largest value mean the same. Prints the table of every
campaign, then one row each: what the plan costs against the cheapest setting that moves no value by
0.1 standard errors, and how many settings are further from the reference than they and it promise.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pythonfmu
from scipy.integrate import solve_ivp

import fitting as ff
from fitting.lab.tradeoff.records import Study
from fitting.lab.tradeoff.report import markdown
from fitting.text.arrays import FloatArray
from tests.support.cfmu_build import build_reference_fmu

ROOT = Path(__file__).resolve().parents[2]
FOREIGN = Path(__file__).with_name("foreign")
HEAD = (
    "| campaign | plan | off by | cheapest sufficient | its cost | plan over cheapest | "
    "promises broken | failed |\n|---|---|---|---|---|---|---|---|"
)
TRACE = """title = "{title} (synthetic)"
synthetic = true

[fmu]
file = "{fmu}"

[observe]
output = "{output}"

[[trace]]
file = "trace.csv"
{keys}
"""
PARAMETER = """
[[parameters]]
name = "{}"
start = {}
lower = {}
upper = {}
"""


def _written(
    folder: Path,
    fmu: Path,
    title: str,
    output: str,
    columns: dict[str, FloatArray],
    parameters: Sequence[tuple[str, float, float, float]],
    *keys: str,
) -> Path:
    """The campaign of one trace, and its file."""
    rows = zip(*(map(float, column) for column in columns.values()), strict=True)
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in rows)]
    (folder / "trace.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    text = TRACE.format(title=title, fmu=fmu.name, output=output, keys="\n".join(keys))
    path = folder / "campaign.toml"
    path.write_text(text + "".join(PARAMETER.format(*p) for p in parameters), encoding="utf-8")
    return path


def _integrated(
    slope: Callable[[float, FloatArray, float], Sequence[float]],
    t: FloatArray,
    start: Sequence[float],
    held: FloatArray,
) -> FloatArray:
    """States at the samples, (n, states), an input held from each sample to the next."""
    states = [np.array(start)]
    for ends, level in zip(itertools.pairwise(t), held[:-1], strict=True):
        found = solve_ivp(slope, ends, states[-1], "LSODA", rtol=1e-10, atol=1e-12, args=(level,))
        states.append(found.y[:, -1])
    return np.array(states)


def van_der_pol(folder: Path) -> Path:
    """x'' = mu (1 - x^2) x' - x from 2, mu = 1.2, samples of 0.05 s over 20 s with 1 % of noise."""
    fmu = build_reference_fmu(folder, "VanDerPol")
    t = 0.05 * np.arange(401.0)
    states = _integrated(
        lambda _, x, __: (x[1], 1.2 * (1.0 - x[0] ** 2) * x[1] - x[0]), t, (2.0, 0.0), 0.0 * t
    )
    x0 = states[:, 0] + 0.02 * np.random.default_rng(1).standard_normal(t.size)
    columns = {"time (s)": t, "x0 (1)": x0}
    return _written(
        folder, fmu, "Van der Pol", "x0", columns, [("mu", 1.1, 0.1, 5.0)], "sigma = 0.02"
    )


def _built(folder: Path, name: str) -> Path:
    """An FMU that pythonfmu builds from the folder `foreign`."""
    return Path(pythonfmu.FmuBuilder.build_FMU(str(FOREIGN / f"{name}.py"), dest=str(folder)))


def room(folder: Path) -> Path:
    """Two days of a heating schedule in samples of five minutes, noise of 0.05 K."""
    t = 300.0 * np.arange(576.0)
    power = np.where((t % 86400.0 > 21600.0) & (t % 86400.0 < 75600.0), 1500.0, 200.0)
    r, outer, wall, air = 1.3e-3, 1.37e-2, 1.6e7, 6e4
    states = _integrated(
        lambda _, x, p: (
            ((x[1] - x[0]) / r + p) / air,
            ((x[0] - x[1]) / r - x[1] / outer) / wall,
        ),
        t,
        (0.0, 0.0),
        power,
    )
    seen = states[:, 0] + 0.05 * np.random.default_rng(2).standard_normal(t.size)
    bounds = [("R", 1.2e-3, 1e-4, 1e-2), ("Ro", 1.3e-2, 1e-3, 0.1), ("Cw", 1.5e7, 1e6, 1e8)]
    keys = 'input = "P"', 'interpolation = "held"', "sigma = 0.05"
    columns = {"time (s)": t, "P (1)": power, "T (1)": seen}
    return _written(folder, _built(folder, "StiffRoom"), "Stiff room", "T", columns, bounds, *keys)


def mass_spring(folder: Path) -> Path:
    """Ten seconds under a force of random levels, samples of 20 ms, noise of 1 mm."""
    rng = np.random.default_rng(5)
    t, force = 0.02 * np.arange(500.0), np.repeat(rng.uniform(-6.0, 6.0, 20), 25)
    states = _integrated(
        lambda _, x, f: (x[1], (f - 0.63 * x[1] - 46.0 * x[0] - 350.0 * x[0] ** 3) / 0.5),
        t,
        (0.0, 0.0),
        force,
    )
    seen = states[:, 0] + 1e-3 * rng.standard_normal(t.size)
    bounds = [("c", 0.6, 0.1, 5.0), ("k", 45.0, 10.0, 100.0), ("k3", 330.0, 10.0, 2000.0)]
    keys = 'input = "F"', 'interpolation = "held"', "sigma = 1e-3"
    columns = {"time (s)": t, "F (1)": force, "x (1)": seen}
    return _written(
        folder, _built(folder, "MassSpring"), "Mass and spring", "x", columns, bounds, *keys
    )


CAMPAIGNS: dict[str, Callable[[Path], Path]] = {
    "q1": lambda _: ROOT / "data/string_q1/campaign.toml",
    "duffing": lambda _: ROOT / "data/duffing_string/campaign.toml",
    "van_der_pol": van_der_pol,
    "room": room,
    "mass_spring": mass_spring,
}


def row_of(name: str, study: Study) -> str:
    """The plan against the cheapest sufficient setting; a promise has the reference's besides."""
    plan, best = study.planned, study.cheapest
    ran = [row for row in study.rows if not row.failed]
    broken = sum(row.error > row.promised + study.reference.promised for row in ran)
    cells = [name, "–", "–", "–", "–", "–"]
    if plan is not None:
        cells[1:3] = f"{plan.cost_s:.3g} s", f"{plan.off:.2g} σ"
    if best is not None:
        cells[3:5] = best.setting.name, f"{best.cost_s:.3g} s"
    if plan is not None and best is not None:
        cells[5] = f"{plan.cost_s / best.cost_s:.2f}"
    cells += [f"{broken} of {len(ran)}", str(len(study.rows) - len(ran))]
    return f"| {' | '.join(cells)} |"


def main(arguments: Sequence[str] | None = None) -> int:
    """Study every campaign, print the tables; returns 1 if a promise is broken."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=tuple(CAMPAIGNS), default=[])
    parser.add_argument("--no-fit", action="store_true", help="no fits: an evaluation decides")
    parser.add_argument("--quick", action="store_true", help="few accuracies")
    options = parser.parse_args(arguments)
    wanted = ff.StudyOptions(quick=options.quick, fit=not options.no_fit)
    rows = []
    for name in options.only or CAMPAIGNS:
        with tempfile.TemporaryDirectory() as folder:
            campaign = CAMPAIGNS[name](Path(folder))
            study = ff.tradeoff(
                campaign, options=wanted, progress=lambda text: print(text, file=sys.stderr)
            )
        print(markdown(study), flush=True)
        rows.append(row_of(name, study))
    print(HEAD, *rows, sep="\n")
    return int(any("| 0 of" not in row for row in rows))


if __name__ == "__main__":
    sys.exit(main())
