"""The oscillator FMU in a host without Python: a C program that replays scripts of FMI calls.

``tests/hosts/replay.c`` is compiled here with the system's compiler and loads the FMU as its
documentation says: a libpython first, with global symbols, then the binary of the FMU.
"""

from __future__ import annotations

import math
import re
import subprocess
import sysconfig
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from tests.support import reference
from tests.support.fmus import (
    DISCARD,
    ERROR,
    FATAL,
    LIVELY,
    OK,
    REFUSALS,
    TIMES,
    WARNING,
    Unpacked,
    steady_state,
    worst,
)
from tests.support.processes import MOST_S


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


@dataclass(frozen=True)
class Host:
    """The compiled host and the FMU that it loads."""

    program: Path
    fmu: Unpacked

    def play(self, script: Iterable[str], libpython: Path | str = OWN) -> Transcript:
        """Replay a script; every line must be answered and the host must end well."""
        done = self.run(script, libpython)
        assert done.returncode == 0, f"{done.stdout[-300:]}\n{done.stderr}"
        *answers, end = done.stdout.splitlines()
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

    def run(
        self, script: Iterable[str], libpython: Path | str = OWN, **environment: str
    ) -> subprocess.CompletedProcess[str]:
        """Run the host in an environment that knows no Python but the library's own."""
        description = self.fmu.description
        identifier = description.coSimulation.modelIdentifier
        return subprocess.run(
            [
                self.program,
                libpython,
                self.fmu.folder / "binaries" / "linux64" / f"{identifier}.so",
                (self.fmu.folder / "resources").as_uri(),
                description.guid,
            ],
            input="".join(f"{line}\n" for line in script),
            capture_output=True,
            text=True,
            timeout=MOST_S,
            # else the library asks the python3 on the PATH, any python3, where its modules are
            env={"PATH": "/usr/bin:/bin", "PYTHONHOME": str(home(libpython)), **environment},
        )

    def set(self, slot: int, values: Mapping[str, Any]) -> list[str]:
        """Return the script that sets variables."""
        types = {v.name: v.type for v in self.fmu.description.modelVariables}
        verbs = {"Real": "setr", "Integer": "seti", "Boolean": "setb"}
        return [
            f"{verbs[types[name]]} {slot} {self.fmu.references[name]} {float(value)!r}"
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


@pytest.fixture(scope="module")
def host(oscillator: Unpacked, compiled: Callable[..., Path]) -> Host:
    """The C program and the FMU that it is to load."""
    if not LIBPYTHONS:
        pytest.skip("this machine has no shared libpython, 3.8 to 3.13")
    return Host(compiled("replay"), oscillator)


def test_without_a_python_library_the_loader_says_so(host: Host) -> None:
    done = host.run([], "-")
    assert done.returncode == 3
    assert "undefined symbol" in done.stderr
    assert "Py" in done.stderr


ORBIT = {"phase1": 0.4, "A2": 0.5}


@pytest.fixture(scope="module")
def truth(oscillator: Unpacked) -> tuple[list[Any], list[Any]]:
    """The true q~ of the lively run from rest and of the string on its orbit, at TIMES."""
    rest = [row[:2] for row in reference.displacements(oscillator.parameters(**LIVELY), TIMES)]
    return rest, steady_state(oscillator.parameters(**ORBIT), TIMES)


@pytest.mark.parametrize("libpython", LIBPYTHONS, ids=lambda path: path.name[3:-7])
def test_runs_are_those_of_the_closed_form(
    host: Host, libpython: Path, truth: tuple[list[Any], list[Any]]
) -> None:
    """A run from rest and one on the periodic orbit, side by side in two slots of one process."""
    names = "q1_hybrid", "q2_hybrid"
    transcript = host.play(
        [
            "new 0 rest",
            "new 1 orbit",
            *host.start(0, **LIVELY),
            *host.start(1, periodic_start=True, **ORBIT),
            *host.steps(TIMES, *names, slot=0),
            *host.steps(TIMES, *names, slot=1),
            "terminate 0",
            "free 0",
            "terminate 1",
            "free 1",
        ],
        libpython,
    )
    assert {status for _, _, status, _ in transcript.lines} == {OK}
    assert transcript.log == []
    rows = transcript.reals()
    assert worst(rows[: len(TIMES)], truth[0]) < 1e-13
    assert worst(rows[len(TIMES) :], truth[1]) < 1e-11


def test_one_process_survives_every_failure(host: Host) -> None:
    """All refusals one after the other, each mended by a reset and followed by a good run."""
    outputs = host.fmu.names("output")
    good = [*host.start(**LIVELY), *host.steps(TIMES[:3], "q1_hybrid", "q2_hybrid")]
    script = ["new 0 enduring", *good]
    for refusal in REFUSALS:
        script += [
            "reset 0",
            *host.start(**refusal.values),
            *host.get(*outputs),
            "step 0 0 1e-5",
            "step 0 1e-5 1e-5",
            *host.get(*outputs),
            host.message,
            "reset 0",
            host.message,
            *good,
        ]
    transcript = host.play([*script, "terminate 0", "free 0"])

    statuses = {status for status, _ in transcript.of("step")}
    assert statuses == {OK, DISCARD}
    assert [s for s, _ in transcript.of("step")].count(DISCARD) == 2 * len(REFUSALS)
    others = {status for verb, _, status, _ in transcript.lines if verb != "step"}
    assert others == {OK}

    rows = transcript.reals()
    wanted, size = rows[:3], 3 + 2
    for k, refusal in enumerate(REFUSALS):
        block = rows[3 + k * size : 3 + (k + 1) * size]
        assert all(math.isnan(x) for row in block[:2] for x in row), refusal.label
        assert block[2:] == wanted, refusal.label

    sentences = [text for _, text in transcript.of("gets")]
    assert sentences[1::2] == [""] * len(REFUSALS)  # after the reset
    logged = {text for status, text in transcript.log if status >= DISCARD}
    for refusal, sentence in zip(REFUSALS, sentences[::2], strict=True):
        assert refusal.name in sentence, refusal.label
        assert refusal.value in sentence, refusal.label
        assert sentence in logged, refusal.label


def test_calls_out_of_order_do_not_end_the_process(host: Host) -> None:
    references = host.fmu.references
    transcript = host.play(
        [
            "new 0 misused",
            "step 0 0 1e-5",  # before initialisation
            "reset 0",
            f"setr 0 {references['solver']} 1",  # an Integer
            "reset 0",
            f"setr 0 {references['q1']} 1",  # an output
            "reset 0",
            "getr 0 9999",  # not a variable
            "reset 0",
            *host.start(),
            "step 0 0 1e-5",
            "step 0 5e-5 1e-5",  # not where the last step ended
            "reset 0",
            *host.start(),
            "step 0 0 -1e-5",  # backwards
            "reset 0",
            *host.start(),
            "step 0 0 1e-5",
            "free 0",  # without terminate
        ]
    )
    assert [s for s, _ in transcript.of("step")] == [DISCARD, OK, DISCARD, DISCARD, OK]
    assert FATAL not in {status for _, _, status, _ in transcript.lines}
    assert len([s for s, _ in transcript.log if s == ERROR]) == 6


def test_negative_damping_grows_with_a_warning(host: Host) -> None:
    values = dict(LIVELY) | {"d1": -2e3}
    script = ["new 0 a", *host.start(**values), *host.steps(TIMES, "q1_hybrid", "q2_hybrid")]
    transcript = host.play(script)
    truth = [row[:2] for row in reference.displacements(host.fmu.parameters(**values), TIMES)]
    assert worst(transcript.reals(), truth) < 1e-12
    assert any(status == WARNING and "d1 = -2000.0" in text for status, text in transcript.log)


def test_a_restored_state_continues_bit_for_bit(host: Host) -> None:
    tail = [
        "step 0 1e-5 1e-5",
        *host.get("q1_hybrid", "q2"),
        *host.set(0, {"theta": 2.2, "b": 1e9}),
        "step 0 2e-5 1e-5",
        *host.get("q1_hybrid", "q2"),
    ]
    transcript = host.play(
        [
            "new 0 a",
            *host.start(**LIVELY),
            "step 0 0 1e-5",
            "save 0",
            *tail,
            *host.set(0, {"theta": math.nan}),
            "step 0 3e-5 1e-5",
            "restore 0",
            *tail,
            "drop 0",
            "free 0",
        ]
    )
    rows = transcript.reals()
    assert rows[2:] == rows[:2]
    assert [s for s, _ in transcript.of("step")] == [OK, OK, OK, DISCARD, OK, OK]


def test_no_freed_memory_is_touched_from_the_first_call_to_the_exit(
    host: Host, compiled: Callable[..., Path]
) -> None:
    fence = compiled("fence", "-shared", "-fPIC")
    good = [*host.start(0), *host.steps(TIMES[:3], "q1_hybrid", "lambda"), host.message]
    script = [
        "new 0 good",
        "new 1 bad",
        *good,
        *host.start(1, eta_plus=-1.0),
        "step 1 0 1e-5",
        "save 0",
        "restore 0",
        "drop 0",
        "free 1",
        "reset 0",
        *good,
        "terminate 0",
        "free 0",
    ]
    done = host.run(script, LD_PRELOAD=str(fence))
    assert done.returncode == 0, done.stdout
    assert done.stdout.splitlines()[-1] == "end"
