"""The native FMUs on other platforms: how many numbers are those of this machine, bit for bit.

    python -m tests.bench.bench_platforms [PLATFORM ...]

Builds the FMUs and a host in C for this machine with its own compiler, for Windows and Linux on ARM
with zig (``pip install fmu-fit[native]``, some minutes the first time), runs them under wine and
qemu, and prints a line for each model. A platform that cannot be run here is named with the reason.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import build_fmu
from tests.support.c_hosts import Pythonless, compile_program
from tests.support.fmus import unpack
from tests.support.native_runs import CASES, Case, closed_form, script_of
from tests.support.platforms import PLATFORMS, agreement, host_of
from tests.support.twins import shipped_binary


def host_here(case: Case, folder: Path) -> Pythonless:
    """Return a model's native FMU in the C host, by this machine's compiler."""
    place = folder / f"{case.model}_fmi{case.fmi}"
    fmu = build_fmu.build(case.model, place, variant=build_fmu.Variant(fmi=case.fmi), native=())
    compile_program(["cc"], "replay", place / "replay", ["-ldl"], case.fmi)
    unpacked = unpack(fmu, place / "unpacked")
    return Pythonless(place / "replay", unpacked, shipped_binary(unpacked.folder))


def main(names: list[str]) -> None:
    """Print the table."""
    print("platform       model                     numbers  equal  worst    closed form")
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        here = {case: host_here(case, folder) for case in CASES}
        for platform in PLATFORMS:
            if names and platform.name not in names:
                continue
            if obstacle := platform.why_not():
                print(f"{platform.name}: {obstacle}")
                continue
            for case, own in here.items():
                other = host_of(platform, case, folder / platform.name)
                script = script_of(own, case)
                found = agreement(own, own.play(script), other.play(script))
                errors = ""
                if case.model == "CoupledOscillator":
                    runs = closed_form(other)
                    errors = f"{runs.rest_error:.1e} {runs.orbit_error:.1e}"
                print(
                    f"{platform.name:14} {case.name:25} {found.numbers:7} {found.equal:6}"
                    f"  {found.worst:.1e}  {errors}"
                )


if __name__ == "__main__":
    main(sys.argv[1:])
