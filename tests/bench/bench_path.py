"""What the levels of Algorithm 2 cost, beside a plain script that runs the same ones.

    python -m tests.bench.bench_path [--rounds 5]

Processor time with all processes, of the shipped q1 series: `fmu-fit reconstruct` with the path
less the same with `--no-path` (no profiles, no report, one worker), and the plain script
`tests/support/hosts/plain_path.py`, which drives the same FMU through fmpy, less the imports of
fmpy and scipy. In every round each runs once,
in turn; times and the ratio are medians. J of every level stands beside the script's.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

import build_fmu
import fitting as ff
from fitting.campaign.parameters import search_bounds, starts, to_search
from fitting.fit.objective import weights
from fitting.result.result import read_result
from fitting.signal.scale import laboratory_maximum

ROOT = Path(__file__).resolve().parents[2]
CAMPAIGN = ROOT / "data" / "string_q1" / "campaign.toml"
SCRIPT = ROOT / "tests" / "support" / "hosts" / "plain_path.py"
IMPORTS = "import fmpy.fmi2, scipy.optimize, scipy.sparse"


def series(fmu: Path) -> dict[str, object]:
    """What the plain script needs of the campaign, in plain numbers."""
    problem = ff.Problem.of(CAMPAIGN, ff.Fmu(fmu, workers=1))
    record, objective, schedule = problem.record, problem.objective, problem.options.schedule
    parameters, sweep = record.parameters, record.sweep
    assert sweep is not None
    lower, upper = search_bounds(parameters)
    experiments = record.experiments
    start = to_search(parameters, starts(parameters))
    return {
        "tones_hz": [list(map(float, e.tones_hz)) for e in experiments],
        "etas_hz": [[float(e.settings[n]) for n in ("eta_plus", "eta_minus")] for e in experiments],
        "peaks_v": [list(map(float, e.peaks_v)) for e in experiments],
        "sweep_eta_hz": [float(sweep.settings[n]) for n in ("eta_plus", "eta_minus")],
        "maximum_v": laboratory_maximum(sweep.frequency_hz, sweep.amplitude_v).value_v,
        "scale": [p.scale for p in parameters],
        "reference": [p.reference for p in parameters],
        "lower": lower.tolist(),
        "upper": upper.tolist(),
        "start": start.tolist(),
        "steps": objective.steps.tolist(),
        "weights": [
            weights(objective, schedule.nu(k), "slack").tolist() for k in range(schedule.iterations)
        ],
    }


def processor_s(words: list[str]) -> tuple[float, str]:
    """What a command takes with its processes, s, and what it prints."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    ended = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = (after.ru_utime - before.ru_utime) + (after.ru_stime - before.ru_stime)
    return spent, ended.stdout


def main() -> int:
    """Run all rounds and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        build_fmu.main(["--out", name, "--model", "CoupledOscillator"])
        fmu, data = folder / "CoupledOscillator.fmu", folder / "series.json"
        data.write_text(json.dumps(series(fmu)))
        command = [sys.executable, "-m", "fitting", "reconstruct", str(CAMPAIGN)]
        command += ["--no-profiles", "--no-report", "--workers", "1", "--out"]
        path, plain, without = [], [], []
        for _ in range(args.rounds):
            without.append(processor_s([*command, str(folder / "without"), "--no-path"])[0])
            path.append(processor_s([*command, str(folder / "with")])[0] - without[-1])
            imports = processor_s([sys.executable, "-c", IMPORTS])[0]
            spent, printed = processor_s([sys.executable, str(SCRIPT), str(fmu), str(data)])
            plain.append(spent - imports)
        script = json.loads(printed.splitlines()[-1])
        history = read_result(folder / "with" / "result.json").history[1:]
    print("| | processor time | runs |\n|---|---|---|")
    runs = script["runs"]
    print(f"| the fit without the path | {median(without):.2f} s | |")
    print(f"| the path | {median(path):.2f} s | {sum(row.evaluations for row in history)} evals |")
    print(f"| plain script | {median(plain):.2f} s | {runs} runs |")
    ratio = median(a / b for a, b in zip(path, plain, strict=True))
    print(f"| ratio | {ratio:.2f} | |")
    print("\n| level | J | J of the script |\n|---|---|---|")
    for row, value in zip(history, script["j"], strict=True):
        print(f"| {row.level} | {row.j:.6f} | {value:.6f} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
