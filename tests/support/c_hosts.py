"""Hosts in C: a program that replays scripts of FMI calls, and what is said to it and heard.

``hosts/replay.c`` is linked to the calls of one version of FMI and loads an FMU's binary; that of a
native FMU as it is, that of a Python FMU as its documentation says, a libpython before it.
"""

from __future__ import annotations

import re
import subprocess
import sysconfig
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import fmpy

from tests.support.fmus import Unpacked
from tests.support.processes import MOST_S

FOLDER = Path(__file__).parent / "hosts"
#: Programs that call an FMU have these beside a file of their own and that of a version of FMI.
CALLING = ("play", "library")
STRICT = ("-std=c11", "-D_GNU_SOURCE", "-Wall", "-Wextra", "-Werror", "-O1")
VERBS = {
    "Real": "setr",
    "Float64": "setr",
    "Integer": "seti",
    "Int32": "seti",
    "Boolean": "setb",
}


def compile_program(
    compiler: Sequence[str], name: str, program: Path, options: Sequence[str], fmi: int = 2
) -> None:
    """Compile a program of ``hosts/`` without a warning; one that calls FMUs, for that FMI."""
    parts = [name]
    if '"host.h"' in (FOLDER / f"{name}.c").read_text("utf-8"):
        parts += [*CALLING, f"host_fmi{fmi}"]
    headers = Path(fmpy.__file__).parent / "c-code"
    sources = [str(FOLDER / f"{part}.c") for part in parts]
    command = [*compiler, *STRICT, f"-I{headers}", *sources, "-o", str(program), *options]
    subprocess.run(command, check=True, timeout=MOST_S)


def libpythons() -> list[Path]:
    """Return one libpython for each version from 3.8 to 3.13, this interpreter's first."""
    own = Path(sysconfig.get_config_var("LIBDIR") or "/") / str(
        sysconfig.get_config_var("INSTSONAME")
    )
    candidates = [own, *sorted(Path("/usr").glob("lib/*/libpython3.*.so.1.0"))]
    candidates += sorted(Path.home().glob(".pyenv/versions/*/lib/libpython3.*.so.1.0"))
    found: dict[str, Path] = {}
    for path in candidates:
        version = re.fullmatch(r"libpython3\.(\d+)\.so\.1\.0", path.name)
        if version and 8 <= int(version[1]) <= 13 and path.is_file():
            found.setdefault(path.name, path)
    return list(found.values())


LIBPYTHONS = libpythons()
OWN = LIBPYTHONS[0] if LIBPYTHONS else ""


def home(libpython: Path | str) -> Path:
    """Return the prefix of the Python that a library belongs to."""
    folder = Path(libpython).resolve().parent
    return next((p for p in folder.parents if (p / "bin" / "python3").exists()), folder)


@dataclass(frozen=True)
class Transcript:
    """What the host printed, in order; a line is (verb, slot, status, the rest)."""

    lines: list[tuple[str, int, int, str]] = field(default_factory=list)
    log: list[tuple[int, str]] = field(default_factory=list)

    def reals(self) -> list[list[float]]:
        """Return the values of every getReal."""
        return [
            [float(x) for x in rest.split()] for verb, _, _, rest in self.lines if verb == "getr"
        ]

    def of(self, verb: str) -> list[tuple[int, str]]:
        """Return (status, rest) of every call of a function."""
        return [(status, rest) for name, _, status, rest in self.lines if name == verb]

    @staticmethod
    def read(printed: str) -> Transcript:
        """Read what a program printed that came to the end of its script."""
        *answers, end = printed.splitlines()
        assert end == "end"
        transcript = Transcript()
        for answer in answers:
            verb, first, rest = answer.split(" ", 2)
            if verb == "log":
                transcript.log.append((int(first), rest.split(" ", 1)[1]))
            else:
                status, _, values = rest.partition(" ")
                transcript.lines.append((verb, int(first), int(status), values))
        return transcript


@dataclass(frozen=True)
class Host:
    """The compiled host and the FMU that it loads."""

    program: Path
    fmu: Unpacked

    def play(self, script: Iterable[str], libpython: Path | str = OWN) -> Transcript:
        """Replay a script; every line must be answered and the host must end well."""
        done = self.run(script, libpython)
        assert done.returncode == 0, f"{done.stdout[-300:]}\n{done.stderr}"
        return Transcript.read(done.stdout)

    def run(
        self, script: Iterable[str], libpython: Path | str = OWN, **environment: str
    ) -> subprocess.CompletedProcess[str]:
        """Run the host in an environment that knows no Python but the library's own."""
        identifier = self.fmu.description.coSimulation.modelIdentifier
        binary = self.fmu.folder / "binaries" / "linux64" / f"{identifier}.so"
        # else the library asks the python3 on the PATH, any python3, where its modules are
        python = {"PATH": "/usr/bin:/bin", "PYTHONHOME": str(home(libpython))}
        return self._run([self.program, libpython, binary], script, {**python, **environment})

    def _run(
        self, command: Sequence[Path | str], script: Iterable[str], environment: Mapping[str, str]
    ) -> subprocess.CompletedProcess[str]:
        resources = self.fmu.folder / "resources"
        old = self.fmu.description.fmiVersion.startswith("2")  # which wants a URI
        return subprocess.run(
            [*command, resources.as_uri() if old else resources, self.fmu.description.guid],
            input="".join(f"{line}\n" for line in script),
            capture_output=True,
            text=True,
            timeout=MOST_S,
            env=environment,
        )

    def set(self, slot: int, values: Mapping[str, Any]) -> list[str]:
        """Return the script that sets variables."""
        types = {v.name: v.type for v in self.fmu.description.modelVariables}
        return [
            f"{VERBS[types[name]]} {slot} {self.fmu.references[name]} {float(value)!r}"
            for name, value in values.items()
        ]

    def start(self, slot: int = 0, **values: Any) -> list[str]:
        """Return the script that sets start values and initialises."""
        return [*self.set(slot, values), f"setup {slot} 0", f"enter {slot}", f"exit {slot}"]

    def get(self, *names: str, slot: int = 0) -> list[str]:
        """Return the script that reads Reals."""
        return [f"getr {slot} " + " ".join(str(self.fmu.references[name]) for name in names)]

    def steps(self, times: Iterable[float], *names: str, slot: int = 0) -> list[str]:
        """Return the script that steps from 0 to each of the times and reads there."""
        script, now = [], 0.0
        for time in times:
            script += [f"step {slot} {now!r} {time - now!r}", *self.get(*names, slot=slot)]
            now = time
        return script

    @property
    def message(self) -> str:
        """Return the script that reads the status message of slot 0."""
        return f"gets 0 {self.fmu.references['status_message']}"


@dataclass(frozen=True)
class Pythonless(Host):
    """The C program and a native binary, in an environment without anything of Python.

    ``launcher`` is what runs programs of another platform here.
    """

    binary: Path
    launcher: tuple[str, ...] = ()

    def run(
        self, script: Iterable[str], libpython: Path | str = "-", **environment: str
    ) -> subprocess.CompletedProcess[str]:
        """Run the host without a libpython."""
        return self._run([*self.launcher, self.program, "-", self.binary], script, environment)
