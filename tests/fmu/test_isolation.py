"""An FMU that is isolated gets what its limits say, and is stopped with a sentence beyond them."""

from __future__ import annotations

import ctypes
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.cli.main import main
from fitting.fmu.isolation import Isolation
from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import Run
from fitting.text.errors import BadInput, FmuFailure
from tests.support.cfmu_build import PULLED, build_c_fmu, misbehaving

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")

LIMITS = Isolation(memory_mb=200.0, processor_s=0.5, files=40, written_mb=2.0)
# values of `misbehave`, in the order of the enum in model.h
HANGS, ABORTS, FILLS_MEMORY, FILLS_DISK = 1, 10, 16, 17
OPENS_MANY, OPENS_SOCKET, ESCAPES = 18, 19, 20


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_c_fmu(tmp_path_factory.mktemp("cfmus"))


@pytest.fixture(scope="module")
def isolated(good: Path) -> Iterator[FmuWorkers]:
    """One for all tests: after a failure it can be used on."""
    with FmuWorkers(good, timeout_s=100.0, isolation=LIMITS) as workers:
        yield workers


def landlock() -> bool:
    """Whether this system can keep a program to a folder (Linux 5.13 and later)."""
    return int(ctypes.CDLL(None).syscall(444, None, ctypes.c_size_t(0), 1)) > 0


@pytest.mark.parametrize(
    ("how", "label", "words"),
    [
        pytest.param(FILLS_DISK, "one", "2 MB.* stopped", marks=pytest.mark.nightly),
        (FILLS_DISK, "many", "2 MB.* stopped"),
        (HANGS, "", r"0\.5 s of processor time.* stopped"),
        (OPENS_SOCKET, "9", "network.* stopped"),
        (OPENS_MANY, "/dev/null", "files.* 40 open files"),
    ],
)
def test_what_takes_too_much_is_stopped(
    isolated: FmuWorkers, how: int, label: str, words: str
) -> None:
    with pytest.raises(FmuFailure, match=words):
        isolated.run([misbehaving(how, label)])
    isolated.run([PULLED])


#: A small caller, and one of 300 MB: Linux counts a caller's memory for what it starts.
CALLER = """
import sys
from pathlib import Path
from fitting.text.errors import FmuFailure
from fitting.fmu.pool import FmuWorkers
from tests.fmu.test_isolation import LIMITS, misbehaving
ballast = bytearray(int(sys.argv[2]) * 1000000)
with FmuWorkers(Path(sys.argv[1]), timeout_s=100.0, isolation=LIMITS) as workers:
    try:
        workers.run([misbehaving(int(sys.argv[3]))])
    except FmuFailure as failure:
        print(failure)
"""


@pytest.mark.parametrize(
    ("caller_mb", "how", "of_memory"),
    [
        (0, FILLS_MEMORY, True),
        (300, FILLS_MEMORY, False),
        pytest.param(300, ABORTS, False, marks=pytest.mark.nightly),
    ],
)
def test_memory_is_named_where_it_is_known_to_have_been_the_end(
    good: Path, caller_mb: int, how: int, of_memory: bool
) -> None:
    """What a caller of 300 MB starts counts as that large: its sentence names the limits alone."""
    command = [sys.executable, "-c", CALLER, str(good), str(caller_mb), str(how)]
    ended = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    assert ("more than 200 MB" in ended.stdout) is of_memory
    assert "200 MB" in ended.stdout


def test_nothing_is_written_outside_its_folder(isolated: FmuWorkers, tmp_path: Path) -> None:
    if not landlock():
        isolated.run([PULLED])
        assert any("write files" in text for text in isolated.warnings)
        return
    kept = tmp_path / "kept"
    kept.write_text("mine")
    for label in (kept, tmp_path / "new"):
        with pytest.raises(FmuFailure, match="Permission denied"):
            isolated.run([misbehaving(ESCAPES, label)])
    assert kept.read_text() == "mine"
    assert not (tmp_path / "new").exists()
    isolated.run([misbehaving(ESCAPES, "here.txt")])


def test_without_isolation_the_same_fmu_finds_the_network_and_the_files(
    good: Path, tmp_path: Path
) -> None:
    """So that the tests above do not pass for another reason."""
    with socket.create_server(("127.0.0.1", 0)) as server, FmuWorkers(good) as workers:
        port = server.getsockname()[1]
        workers.run([misbehaving(OPENS_SOCKET, str(port)), misbehaving(ESCAPES, tmp_path / "new")])
        server.accept()[0].close()
    assert (tmp_path / "new").exists()


def test_an_isolated_fmu_answers_the_same(good: Path, isolated: FmuWorkers) -> None:
    with FmuWorkers(good) as workers:
        [free] = workers.run([PULLED])
    [kept] = isolated.run([PULLED])
    assert kept.tobytes() == free.tobytes()


def test_an_fmu_of_python_runs_isolated(oscillator_fmu: Path) -> None:
    """λ = sqrt(-sin 2θ (η₋² - η₊²) / 2) at the published angle."""
    with ff.Fmu(oscillator_fmu, 1, isolate=True) as fmu:
        run = Run(
            start_values={"theta": 1.95},
            settle_s=0.0,
            sample_step_s=1e-6,
            samples=1,
            outputs=("lambda", "eta_plus", "eta_minus"),
        )
        [[found, *_]] = fmu.workers.run([replace(run, outputs=("lambda",))])
        variables = fmu.variables
        plus, minus = (float(variables[name].start or 0.0) for name in ("eta_plus", "eta_minus"))
    truth = np.sqrt(-0.5 * np.sin(2 * 1.95) * (minus**2 - plus**2))
    assert found[0] == pytest.approx(truth, rel=1e-12)


def test_the_command_ends_with_the_code_of_a_failed_fmu(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = ["--input", "force", "--drive", "300 Hz", "--set", "misbehave=19", "--set", "label=9"]
    out = ["--out", str(tmp_path / "out")]
    assert main(["simulate", str(good), *drive, *out, "--isolate"]) == 3
    told = capsys.readouterr().err
    assert "network" in told
    assert told.count("\n") == 1
    assert main(["check", str(good), "--isolate"]) == 0


def test_limits_that_are_none_are_refused() -> None:
    with pytest.raises(BadInput, match=r"memory_mb is 0\.0,"):
        Isolation(memory_mb=0.0)
    with pytest.raises(BadInput, match=r"files is 3,.* 24"):
        Isolation(files=3)
