"""Native FMUs on platforms that this machine is not: compiled by zig, run by wine and qemu."""

from __future__ import annotations

import importlib.util
import math
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

import build_fmu
from fmu_src import native_binary
from tests.support.c_hosts import Host, Pythonless, Transcript, compile_program
from tests.support.fmus import unpack
from tests.support.native_runs import Case, rows_of, scales
from tests.support.twins import shipped_binary

#: Where Debian's libc6-arm64-cross puts the C library of ARM.
ARM_ROOT = Path("/usr/aarch64-linux-gnu")
QEMU = ("qemu-aarch64-static", "qemu-aarch64")


@dataclass(frozen=True)
class Platform:
    """A platform by its name in FMUs, and the programs that run its programs here, the first found.

    ``root`` is a folder that they need.
    """

    name: str
    emulators: tuple[str, ...]
    root: Path | None = None

    def why_not(self) -> str:
        """Return why nothing of this platform can be built and run here; empty if it can."""
        if importlib.util.find_spec("ziglang") is None:
            return "compiling for other platforms needs the package ziglang"
        if not any(map(shutil.which, self.emulators)):
            return f"running programs of {self.name} needs {' or '.join(self.emulators)}"
        if self.root is not None and not self.root.is_dir():
            return f"running programs of {self.name} needs {self.root} (libc6-arm64-cross)"
        return ""

    def launcher(self, folder: Path) -> tuple[str, ...]:
        """Return the words before a program; ``folder`` may be written to."""
        [emulator, *_] = [path for name in self.emulators if (path := shutil.which(name))]
        if self.root is not None:
            return (emulator, "-L", str(self.root))
        # wine needs a home for what it takes for the disk of Windows
        home = f"HOME={folder}", f"WINEPREFIX={folder / 'wine'}", "WINEDEBUG=-all"
        return ("/usr/bin/env", *home, "PATH=/usr/bin:/bin", emulator)


PLATFORMS = (
    Platform("win64", ("wine64", "wine")),
    Platform("aarch64-linux", QEMU, ARM_ROOT),
)


def host_of(platform: Platform, case: Case, folder: Path) -> Pythonless:
    """Return a model's native FMU in the C host, both compiled for a platform."""
    place = folder / f"{case.model}_fmi{case.fmi}"
    variant = build_fmu.Variant(fmi=case.fmi)
    fmu = build_fmu.build(case.model, place, variant=variant, native=(platform.name,))
    [part] = native_binary.TARGETS[platform.name].zig
    program = place / "replay.exe"
    # Windows' C library calls plain fopen and the like unsafe; its own replacements are no C11
    words = (sys.executable, "-m", "ziglang", "cc", "-target", part, "-D_CRT_SECURE_NO_WARNINGS")
    links = () if platform.name == "win64" else ("-ldl",)
    compile_program(words, "replay", program, links, case.fmi)
    unpacked = unpack(fmu, place / "unpacked")
    launcher = platform.launcher(folder)
    return Pythonless(program, unpacked, shipped_binary(unpacked.folder), launcher)


@dataclass(frozen=True)
class Agreement:
    """How two platforms' numbers of the same runs agree, relative to the size of what differs."""

    numbers: int
    equal: int
    worst: float
    where: str


def agreement(host: Host, ours: Transcript, theirs: Transcript) -> Agreement:
    """Compare two transcripts of one script; words and statuses must be the same."""
    assert [line[:3] for line in ours.lines] == [line[:3] for line in theirs.lines]
    assert ours.log == theirs.log
    assert ours.of("gets") == theirs.of("gets")
    numbers = equal = 0
    worst, where = 0.0, "nowhere"
    pairs = zip(rows_of(host, ours), rows_of(host, theirs), strict=True)
    for number, (run, other) in enumerate(pairs):
        size = scales(run)
        for row, beside in zip(run, other, strict=True):
            for name, value in row.items():
                assert math.isnan(value) == math.isnan(beside[name]), name
                if math.isnan(value):
                    continue
                numbers += 1
                equal += value == beside[name]
                apart = abs(value - beside[name]) / size[name]
                if apart > worst:
                    worst, where = apart, f"{name} of run {number}"
    return Agreement(numbers, equal, worst, where)
