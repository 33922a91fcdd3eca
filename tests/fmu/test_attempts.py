"""What FMUs attempt: isolated ones reach nothing outside their folder, all hurt only themselves."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fitting.fmu.isolation import Isolation, lacks
from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import Run
from fitting.text.errors import BadInput, FmuFailure
from tests.support.attempts import KINDS
from tests.support.cfmu_build import PULLED, build_c_fmu, misbehaving
from tests.support.processes import is_gone, wait_until

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="system calls of Linux")

RUNS_PYTHON = 21  # of `misbehave`, in the order of the enum in model.h
#: What refuses: the system, or that there is nothing to be had.
REFUSALS = (
    "PermissionError",
    "MemoryError",
    "KeyError",
    "ValueError: not allowed",
    "OSError: [Errno 18]",  # Landlock: of a link that would bring a right
    "OSError: [Errno 38]",
)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_c_fmu(tmp_path_factory.mktemp("cfmus"))


def running(code: str, folder: Path) -> Run:
    """A run in which the FMU has code of Python run in its worker."""
    path = folder / "code.py"
    path.write_text(code)
    return misbehaving(RUNS_PYTHON, path)


@pytest.fixture
def given(tmp_path: Path) -> Iterator[dict[str, Any]]:
    """Places and processes of others, on which attempts are made."""
    folder = tmp_path / "others"
    (folder / "empty").mkdir(parents=True)
    for name in ("kept", "spare"):
        (folder / name).write_text(name)
    os.setxattr(folder / "kept", "user.kept", b"1")
    stream, datagrams = folder / "s", folder / "d"
    with (
        socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as first,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as second,
        socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as third,
        subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other,
    ):
        first.bind(str(stream))
        second.bind(str(datagrams))
        token = folder.parent.name + str(os.getpid())
        third.bind("\0fmu-fit-attempt-" + token)
        first.listen()
        third.listen()
        yield {
            "folder": str(folder),
            "kept": str(folder / "kept"),
            "spare": str(folder / "spare"),
            "socket": str(stream),
            "datagrams": str(datagrams),
            "token": token,
            "caller": os.getpid(),
            "other": other.pid,
            "address": 0x1000,
            "inode": os.fstat(first.fileno()).st_ino,
        }
        other.communicate(b"\n")


def outcomes(fmu: Path, given: dict[str, Any], folder: Path, isolation: Isolation | None) -> Any:
    """What came of all attempts, by kind and name."""
    (folder / "given.json").write_text(json.dumps(given))
    code = f"from tests.support.attempts import make_all\nmake_all({str(folder / 'given.json')!r})"
    with FmuWorkers(fmu, isolation=isolation) as workers:
        workers.run([running(code, folder)])
        home = workers._open.home
        assert home is not None
        [path] = home.glob("worker0-*/outcomes.json")
        return json.loads(path.read_text())


@pytest.mark.skipif(bool(lacks()), reason="this system cannot hold all of it, and says so")
def test_an_isolated_fmu_reaches_nothing_outside(
    good: Path, given: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FMU_FIT_TOKEN", "secret")
    before = {
        p.name: (p.lstat().st_mode, p.lstat().st_mtime) for p in (tmp_path / "others").iterdir()
    }
    found = outcomes(good, given, tmp_path, Isolation(strict=True))
    assert len(found) == sum(map(len, KINDS.values())) >= 80
    through = {name for name, what in found.items() if not what.startswith(REFUSALS)}
    assert not through, {name: found[name] for name in through}
    after = {
        p.name: (p.lstat().st_mode, p.lstat().st_mtime) for p in (tmp_path / "others").iterdir()
    }
    assert after == before


@pytest.mark.nightly
def test_without_isolation_most_of_it_is_let_through(
    good: Path, given: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that the test above does not pass for another reason."""
    if os.getuid() != 0:
        pytest.skip("what the system keeps from every user is no measure")
    monkeypatch.setenv("FMU_FIT_TOKEN", "secret")
    found = outcomes(good, given, tmp_path, None)
    print(json.dumps(found, indent=1))
    assert sum(not what.startswith(REFUSALS) for what in found.values()) >= 60


#: How an FMU meddles with its process, what is told of it, and whether that takes the time-out.
PIPE = """
import os, stat, struct, sys
[pipe] = [n for n in range(3, 64) if os.path.exists(f"/proc/self/fd/{n}") and
          stat.S_ISSOCK(os.fstat(n).st_mode)]
"""
MEDDLING = {
    "becomes another program": (
        "import os, sys\nos.execv(sys.executable, ['x', '-c', 'import time; time.sleep(1000)'])",
        r"closed the pipe",
    ),
    "writes a text": (f"{PIPE}os.write(pipe, b'what is this?')", "wrote into the pipe"),
    "writes a short message": (
        f"{PIPE}os.write(pipe, struct.pack('!i', 5) + b'hello')",
        "wrote into the pipe",
    ),
    "writes the beginning of a long one": (
        f"{PIPE}os.write(pipe, struct.pack('!i', 10**6) + b'hello')",
        "no answer within|wrote into the pipe",
    ),
    "writes a program": (
        f"{PIPE}import pickle\nclass Bomb:\n    def __reduce__(self):\n"
        "        return os.mkdir, ('BOMB',)\nbomb = pickle.dumps(Bomb())\n"
        "os.write(pipe, struct.pack('!i', len(bomb)) + bomb)",
        "wrote into the pipe",
    ),
    "closes all": ("import os\nos.closerange(3, 64)", "closed the pipe"),
    "ends": ("import os\nos._exit(0)", r"exit code 0"),
}


@pytest.mark.parametrize("isolation", [None, Isolation()], ids=["free", "isolated"])
def test_who_meddles_with_its_process_is_told_as_a_failure(
    good: Path, tmp_path: Path, isolation: Isolation | None
) -> None:
    """One failure each, no program of its pickles, and the next batch is answered as ever."""
    with FmuWorkers(good, timeout_s=10.0, isolation=isolation) as workers:
        [expected] = workers.run([PULLED])
        for number, (code, words) in enumerate(MEDDLING.values()):
            folder = tmp_path / str(number)
            folder.mkdir()
            run = running(code.replace("BOMB", str(tmp_path / "bomb")), folder)
            before = workers.counts.processes
            with pytest.raises(FmuFailure, match=words) as failure:
                workers.run([PULLED, run])
            assert failure.value.parameters == run.start_values
            [result] = workers.run([PULLED])
            assert result.tobytes() == expected.tobytes()
            assert workers.counts.processes == before + 1
    assert not (tmp_path / "bomb").exists()


def test_of_an_fmu_that_forks_one_process_answers(good: Path, tmp_path: Path) -> None:
    """Both return from the call: the copy ends there."""
    several = [replace(PULLED, start_values={"force": 1.0 + k}) for k in range(5)]
    with FmuWorkers(good) as workers:
        expected = workers.run(several)
        run = running("import os\nos.fork()", tmp_path)
        for _ in range(3):
            workers.run([run])
            results = workers.run(several)
            assert [r.tobytes() for r in results] == [r.tobytes() for r in expected]


DAEMON = """
import os, time
if not os.fork():
    os.setsid()
    if not os.fork():
        with open(LABEL, "w") as file:
            file.write(f"{os.getpid()}\\n")
        time.sleep(1000)
    os._exit(0)
os.wait()
"""


@pytest.mark.cold_start
@pytest.mark.parametrize("then", ["closed", "crashed"])
def test_what_has_left_the_group_of_its_worker_ends_with_it(
    good: Path, tmp_path: Path, then: str
) -> None:
    label = tmp_path / "daemon"
    code = DAEMON.replace("LABEL", repr(str(label)))
    with FmuWorkers(good) as workers:
        if then == "crashed":
            with pytest.raises(FmuFailure):
                workers.run([running(f"{code}\nos.abort()", tmp_path)])
        else:
            workers.run([running(code, tmp_path)])
        wait_until(lambda: label.exists() and label.read_text().endswith("\n"), "the daemon")
    wait_until(lambda: is_gone(int(label.read_text())), "the end of the daemon")


def test_what_is_left_among_temporary_files_goes_with_the_worker(
    good: Path, tmp_path: Path
) -> None:
    code = "import os, tempfile\nleft = tempfile.mkdtemp()\nopen(LABEL, 'w').write(left)"
    label = tmp_path / "left"
    with FmuWorkers(good) as workers:
        workers.run([running(code.replace("LABEL", repr(str(label))), tmp_path)])
        left = Path(label.read_text())
        assert workers._open.home in left.parents
        assert left.exists()
    assert not left.exists()


def test_strict_is_refused_where_a_part_cannot_be_held(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fitting.fmu.isolation.landlock_version", lambda: 2)
    assert len(lacks()) == 1
    Isolation()
    with pytest.raises(BadInput, match="signals"):
        Isolation(strict=True)
