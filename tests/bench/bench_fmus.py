"""Foreign FMUs through `check`, `init`, `reconstruct` and `calibrate`: right status, right value.

    python -m tests.bench.bench_fmus [--folder FMUS] [--only WORD] [--limit S]

The FMUs are those of `bench_quirks` and all below a folder. Plain fmpy runs each over its default
experiment, or 1 s; what it does not run is no FMU that can be fitted, and is to be refused. Of the
others a parameter that changes an output is set to 1.05 times its start, the output that it changes
most is recorded by plain fmpy in 60 samples with 0.1 % of noise, and the commands run on that file:

    check FMU; init record.csv --fmu FMU --fit NAME; reconstruct --no-profiles; calibrate

A status is right if it is a documented exit code without a fault in the program: 0 where plain fmpy
runs, or a refusal in words (2; 3 where plain fmpy fails, too; 1 or 4 of a fit, as documented). A
value is right if it is within 3 errors of the truth.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from tests.bench.bench_quirks import quirks

SAMPLES, NOISE, MOVED, LEAST = 60, 1e-3, 1.05, 1e-3
#: Runs in a process of its own: an FMU may end that. Prints a table of outputs of two runs.
PLAIN = """
import json, sys
import fmpy, numpy as np
path, name, factor, samples, number = sys.argv[1], sys.argv[2], *map(float, sys.argv[3:])
model = fmpy.read_model_description(path, validate=False)
declared = getattr(model.defaultExperiment, "stopTime", None)
stop = float(declared) if declared else 1.0
start = float(getattr(model.defaultExperiment, "startTime", None) or 0.0)
span = stop - start
numbers = {v.name: v for v in model.modelVariables if v.causality == "output"}
if not numbers:
    numbers = {v.name: v for v in model.modelVariables if v.causality == "local"}
kinds = ("Real", "Float64", "Float32")
real = [n for n, v in numbers.items() if v.type in kinds and not v.dimensions]
values = {}
if name:
    [variable] = [v for v in model.modelVariables if v.name == name]
    values[name] = factor * float(variable.start)
result = fmpy.simulate_fmu(path, validate=False, start_time=start, stop_time=stop,
    output_interval=span / samples, start_values=values, output=real[:40],
    fmi_type="CoSimulation" if model.coSimulation else "ModelExchange")
step = span / samples
rows = [np.asarray(result[n], dtype=float) for n in result.dtype.names]
at = np.asarray(rows[0])
keep = [int(np.argmin(abs(at - start - k * step))) for k in range(int(samples) + 1)]
print(json.dumps({"names": result.dtype.names, "rows": [r[keep].tolist() for r in rows]}))
"""


def plain(fmu: Path, name: str, factor: float, limit: float) -> dict[str, Any] | None:
    """What fmpy alone simulates; None: it fails."""
    words = [sys.executable, "-c", PLAIN, str(fmu), name, str(factor), str(SAMPLES), "0"]
    try:
        made = subprocess.run(words, capture_output=True, text=True, timeout=limit, check=False)
    except subprocess.TimeoutExpired:
        return None
    lines = [line for line in made.stdout.splitlines() if line.startswith("{")]
    return json.loads(lines[-1]) if made.returncode == 0 and lines else None


class Ended:
    """How a command ended: code (-1: not in time), what it printed, seconds."""

    def __init__(self, limit: float, *words: str) -> None:
        began = time.perf_counter()
        command = [sys.executable, "-m", "fitting", *words]
        try:
            made = subprocess.run(
                command, capture_output=True, text=True, timeout=limit, check=False
            )
            self.code, self.out, self.err = made.returncode, made.stdout, made.stderr
        except subprocess.TimeoutExpired:
            self.code, self.out, self.err = -1, "", ""
        self.seconds = time.perf_counter() - began

    @property
    def is_documented(self) -> bool:
        """Whether it is an exit code of `docs/reference/exit-codes.md`, and no fault of ours."""
        return self.code in (0, 1, 2, 3, 4) and "Traceback" not in self.err

    @property
    def why(self) -> str:
        """The last line of a failure, shortened; paths go."""
        lines = [x for x in self.err.splitlines() if x.startswith("fmu-fit")] if self.code else []
        return re.sub(r"/\S*/", "", lines[-1].removeprefix("fmu-fit: "))[:70] if lines else ""


def row(fmu: Path, folder: Path, limit: float) -> tuple[list[str], bool]:
    """A row of the table, and whether all in it is right."""
    began = time.perf_counter()
    rest = plain(fmu, "", 1.0, limit)
    checked = Ended(2.0 * limit, "check", str(fmu), "--budget", f"{limit} s", "--json")
    cells = ["runs" if rest else "fails", str(checked.code)]
    right = checked.is_documented and (checked.code == 0 or rest is None)
    if rest is None or checked.code:
        why = checked.why or ("plain fmpy fails" if rest is None else "")
        return [*cells, "", "", "", "", f"{time.perf_counter() - began:.0f}", why], right

    # the parameter that moves an output most, of those that fmpy and the check call effective
    found = json.loads(checked.out)
    idle = {*(found["resets"] or {}).get("idle", ()), *(found["resets"] or {}).get("unvaried", ())}
    names = [
        name
        for name, v in found["variables"].items()
        if v["causality"] == "parameter" and v["kind"] == "Real" and v["start"] and name not in idle
    ]
    best: tuple[float, str, int, dict[str, Any]] = (LEAST, "", 0, {})
    for name in names[:4]:
        moved = plain(fmu, name, MOVED, limit)
        if moved is None:
            continue
        for k, (one, two) in enumerate(zip(rest["rows"], moved["rows"], strict=True)):
            size = float(np.ptp(one)) if k else 0.0
            change = float(np.max(np.abs(np.subtract(one, two)))) / size if size > 0.0 else 0.0
            if math.isfinite(change) and change > best[0]:
                best = change, name, k, moved
    if not best[1]:
        took = f"{time.perf_counter() - began:.0f}"
        return [*cells, "", "", "", "", took, "no parameter moves a record"], right
    _, name, k, moved = best
    times, values = np.array(moved["rows"][0]), np.array(moved["rows"][k])
    times = times - times[0]
    noise = NOISE * float(np.ptp(values))
    values = values + noise * np.random.default_rng(1).standard_normal(values.size)
    output = moved["names"][k]
    pairs = zip(times.tolist(), values.tolist(), strict=True)
    text = "time (s),y\n" + "".join(f"{t!r},{y!r}\n" for t, y in pairs)
    (folder / "record.csv").write_text(text)
    words = [str(folder / "record.csv"), "--fmu", str(fmu), "--out", str(folder), "--yes"]
    draft = Ended(limit, "init", *words, "--fit", name, "--output", f"y={output}")
    cells.append(str(draft.code))
    right &= draft.is_documented
    if draft.code:
        took = f"{time.perf_counter() - began:.0f}"
        return [*cells, "", "", "", took, f"{name}: {draft.why}"], right
    out = folder / "out"
    words = [str(folder / "campaign.toml"), "--out", str(out), "--workers", "1"]
    fit = Ended(limit, "reconstruct", *words, "--no-profiles", "--no-report")
    cells.append(str(fit.code))
    right &= fit.is_documented and fit.code != 3
    if fit.code not in (0, 4, 1) or not (out / "result.json").exists():
        took = f"{time.perf_counter() - began:.0f}"
        return [*cells, "", "", took, f"{name}: {fit.why}"], right
    handed = Ended(
        limit, "calibrate", str(out / "result.json"), "--out", str(folder / "c"), "--all"
    )
    value = json.loads((out / "result.json").read_text())["parameters"][name]
    true = MOVED * float(found["variables"][name]["start"])
    std = value["std"]
    off = (value["value"] - true) / std if std else math.nan
    right &= handed.code == 0 and (fit.code != 0 or not math.isfinite(off) or abs(off) <= 3.0)
    took = f"{time.perf_counter() - began:.0f}"
    deviation = f"{off:+.1f}" if math.isfinite(off) else "no error"
    return [*cells, str(handed.code), deviation, took, name], right


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, help="further FMUs, below it")
    parser.add_argument("--only", default="", help="FMUs with this word in their name")
    parser.add_argument("--limit", type=float, default=60.0, help="of a command, s")
    args = parser.parse_args()
    print("| FMU | plain fmpy | check | init | reconstruct | calibrate | deviation, errors | s | |")
    print("|---|---|---|---|---|---|---|---|---|")
    wrong, count = [], 0
    with tempfile.TemporaryDirectory() as scratch:
        fmus: dict[str, Path] = {}
        for number, quirk in enumerate(quirks(Path(scratch))):
            if args.only in quirk.kind:
                folder = Path(scratch) / f"q{number}"
                folder.mkdir()
                fmus[quirk.kind] = quirk.build(folder)
        if args.folder is not None:
            found = {str(p.relative_to(args.folder)): p for p in args.folder.rglob("*.fmu")}
            fmus |= {name: path for name, path in sorted(found.items()) if args.only in name}
        for name, fmu in fmus.items():
            work = Path(scratch) / "work"
            shutil.rmtree(work, ignore_errors=True)
            work.mkdir()
            cells, right = row(fmu, work, args.limit)
            count += 1
            wrong += [] if right else [name]
            print(f"| {name} | {' | '.join(cells)}{'' if right else ' (wrong)'} |", flush=True)
    print(f"\n{count} FMUs, {count - len(wrong)} right; wrong: {', '.join(wrong) or 'none'}")


if __name__ == "__main__":
    main()
