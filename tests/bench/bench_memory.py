"""Memory of fits of many samples and records: what a dry run says beside what the fit then takes.

    python -m tests.bench.bench_memory [RECORDSxSAMPLES ...]

Ringdowns of a beam, 1 % noise that nobody stated. The dry run and the fit are commands of their
own; their processes are looked at twenty times a second, all together.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tests.support.cfmu_build import build_c_fmu

CASES = ("1x10000", "1x100000", "1x1000000", "100x10000")
LOOKED_S = 0.05
MASS, DAMPING, STIFFNESS = 1e-3, 2e-2, 4e3
#: Decay times of a record.
DECAYS = 2.0
HEAD = """title = "Ringdowns of a beam"
[fmu]
file = "{fmu}"
[observe]
output = "displacement"
[[parameters]]
name = "damping"
start = 0.025
lower = 0.005
upper = 0.1
[[parameters]]
name = "stiffness"
start = 3999.0
lower = 3800.0
upper = 4200.0
"""
TRACE = """[[trace]]
file = "ring{k}.csv"
label = "ring{k}"
input = "force"
start = "unknown"
"""


def written(folder: Path, records: int, samples: int) -> Path:
    """A campaign of so many ringdowns of so many samples."""
    rng = np.random.default_rng(7)
    rate = DAMPING / (2.0 * MASS)
    t = np.linspace(0.0, DECAYS / rate, samples)
    turned = np.exp((-rate + 1j * np.sqrt(STIFFNESS / MASS - rate**2)) * t)
    text = HEAD.format(fmu=build_c_fmu(folder))
    for k in range(records):
        clean = 1e-3 * np.real(np.exp(2j * np.pi * rng.random()) * turned)
        y = clean + 1e-5 * rng.standard_normal(samples)
        table = np.column_stack([t, y])
        with (folder / f"ring{k}.csv").open("w") as file:
            file.write("time (s),displacement (m)\n")
            np.savetxt(file, table, fmt="%.12g", delimiter=",")
        text += TRACE.format(k=k)
    (folder / "campaign.toml").write_text(text)
    return folder / "campaign.toml"


def resident(pid: int) -> int:
    """Bytes that a process and its children hold."""
    try:
        status = Path(f"/proc/{pid}/status").read_text("ascii", "replace")
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text("ascii").split()
    except OSError:
        return 0
    own = re.search(r"VmRSS:\s+(\d+)", status)
    return (1024 * int(own[1]) if own else 0) + sum(resident(int(child)) for child in children)


def peak_of(command: Sequence[str]) -> tuple[str, float, float]:
    """What a command prints, the most that its processes held in MB, and its seconds."""
    begun, most = time.perf_counter(), 0
    with tempfile.TemporaryFile("w+") as out:
        process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT)
        while process.poll() is None:
            most = max(most, resident(process.pid))
            time.sleep(LOOKED_S)
        out.seek(0)
        return out.read(), most / 1e6, time.perf_counter() - begun


def main() -> None:
    """Each case: what is said, and what is taken."""
    for case in sys.argv[1:] or CASES:
        records, samples = map(int, case.split("x"))
        with tempfile.TemporaryDirectory() as name:
            path = written(Path(name), records, samples)
            command = [sys.executable, "-m", "fitting", "reconstruct", str(path), "--workers", "1"]
            said, dry_mb, dry_s = peak_of([*command, "--dry-run"])
            for line in said.splitlines():
                if line.startswith("memory") or "rror" in line:
                    print(
                        f"{case}: {line} (the dry run: {dry_mb:.0f} MB, {dry_s:.0f} s)", flush=True
                    )
            said, fit_mb, fit_s = peak_of([*command, "--out", f"{name}/out", "--no-report"])
            [last] = said.splitlines()[-1:] or [""]
            print(f"{case}: the fit {fit_mb:.0f} MB, {fit_s:.0f} s ({last})", flush=True)


if __name__ == "__main__":
    main()
