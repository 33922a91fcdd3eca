"""However a command is asked to end, nothing that was found is lost, and nothing stays behind.

Real signals, to processes or to this one; what is waited for are files and processes, never a time.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from fitting.api.fitted import Spent
from fitting.check import command
from fitting.cli.running.interrupts import interruptible
from fitting.cli.running.remaining import Remaining
from fitting.fit import checkpoint
from fitting.fmu import models
from fitting.lab.tradeoff import ROWS_NAME
from fitting.result.result import Result, read_result
from fitting.text.finding import Kind, of_kind
from tests.support.asked import asked_to_end, harmless, temporary_files_in
from tests.support.cfmu_build import build_c_fmu
from tests.support.in_process import told
from tests.support.processes import Job, wait_until
from tests.support.small_campaign import STRING, small_campaign

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")

INTERRUPTED = "fmu-fit: interrupted\n"
QUICKLY = ("--no-profiles", "--no-report", "--workers", "1")
#: What a command says that goes on from a checkpoint.
FOUND = rf"\d+ finished levels? found .*{checkpoint.NAME}"


def goes_on(said: str) -> bool:
    """Whether the command is told that goes on."""
    return re.search("fmu-fit reconstruct .*--resume", said) is not None


@pytest.fixture(scope="module")
def campaign(oscillator_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_campaign(tmp_path_factory.mktemp("small") / "campaign", oscillator_fmu)


@contextmanager
def reconstructing(campaign: Path, folder: Path, *words: str, ignored: int = 0) -> Iterator[Job]:
    """``fmu-fit reconstruct`` with ``folder`` for its results and its temporary files."""
    command = ["reconstruct", str(campaign), "--out", str(folder / "out"), "--no-report"]
    with Job([*command, "--workers", "1", *words], folder / "tmp", ignored) as job:
        yield job


#: Sends SIGTERM while code that is made of text runs, as dataclasses do when a module is imported.
IN_TEXT = """
import os, signal, sys

def send(frame, event, argument):
    asked = signal.getsignal(signal.SIGTERM) not in (signal.SIG_DFL, None)
    if frame.f_code.co_filename == "<string>" and asked:
        os.kill(os.getpid(), signal.SIGTERM)
        len("")  # the signal is dealt with at a call

sys.settrace(send)
"""


#: Sends SIGINT when the module of the command line is begun, and when the process is about to end.
AT_BEGIN = """
import os, signal, sys

def send(frame, event, argument):
    if frame.f_code.co_filename.endswith("cli/main.py"):
        sys.settrace(None)
        os.kill(os.getpid(), signal.SIGINT)

sys.settrace(send)
"""
AT_END = """
import atexit, os, signal, threading

atexit.register(os.kill, os.getpid(), signal.SIGINT)
threading._register_atexit(os.kill, os.getpid(), signal.SIGINT)
"""


@pytest.mark.parametrize(
    ("when", "code"), [(IN_TEXT, 130), (AT_BEGIN, 130), (AT_END, 2)], ids=["text", "begin", "end"]
)
def test_an_end_while_python_begins_or_ends_has_the_exit_code_of_any_other(
    when: str, code: int, tmp_path: Path
) -> None:
    (tmp_path / "sitecustomize.py").write_text(when)
    ended = subprocess.run(
        [sys.executable, "-m", "fitting", "check", "none.fmu"],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ended.returncode, len(ended.stderr.splitlines())) == (code, 1), ended.stderr
    assert ended.stderr.startswith("fmu-fit: ")


@pytest.mark.parametrize("words", [(), ("--json",)])
def test_an_end_while_it_plans_is_one_line_and_130(
    words: tuple[str, ...], swift_fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = small_campaign(tmp_path / "campaign", swift_fmu)

    def asks(*_: object) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        len("")  # the signal is dealt with at a call

    monkeypatch.setattr("fitting.api.fitted.solve_problem", asks)
    with harmless(signal.SIGINT):
        ended = told("reconstruct", small, "--out", tmp_path / "out", *QUICKLY, *words)
    assert (ended.code, ended.out, ended.err) == (130, "", INTERRUPTED)
    assert not (tmp_path / "out").exists()


def test_a_library_that_makes_a_fault_of_an_interrupt_does_not_change_the_ending(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As compiled ones do that are being loaded."""

    def loaded(*_: object) -> None:
        try:
            os.kill(os.getpid(), signal.SIGINT)
            len("")
        except KeyboardInterrupt as error:
            raise ImportError("initialization failed") from error

    monkeypatch.setattr(command, "run", loaded)
    with harmless(signal.SIGINT):
        ended = told("check", tmp_path / "none.fmu")
    assert (ended.code, ended.err) == (130, INTERRUPTED)


def test_an_end_during_the_fit_is_reported_and_gone_on_from(campaign: Path, tmp_path: Path) -> None:
    kept = tmp_path / "out" / checkpoint.NAME
    with reconstructing(campaign, tmp_path, "--no-profiles") as job:
        wait_until(kept.exists, "the first level")
        job.send(signal.SIGTERM)
        code, out, err = job.ended()
    assert code == 1, err
    assert read_result(tmp_path / "out" / "result.json").status == "interrupted"
    assert goes_on(out)
    assert job.left_behind() == []
    out = str(tmp_path / "out")
    again = told("reconstruct", campaign, "--out", out, *QUICKLY, "--resume")
    assert again.code == 0, again.err
    assert re.search(FOUND, again.out)
    assert not kept.exists()


def test_an_end_during_the_profiles_keeps_the_fit(
    swift_fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The fit is written before the profiles begin; two signals at once do not lose it."""
    small = small_campaign(tmp_path / "campaign", swift_fmu)
    result = tmp_path / "out" / "result.json"
    seen: list[Result] = []

    def asks_twice(_: Remaining, spent: Spent) -> str:
        seen.append(read_result(result))
        try:
            os.kill(os.getpid(), signal.SIGHUP)
            return ""
        finally:
            os.kill(os.getpid(), signal.SIGHUP)

    monkeypatch.setattr(Remaining, "profiling", asks_twice)
    words = ("--out", str(result.parent), "--no-report", "--workers", "1")
    with harmless(signal.SIGHUP), temporary_files_in(tmp_path / "tmp"):
        ended = told("reconstruct", small, *words)
    [early] = seen
    late = read_result(result)
    assert (ended.code, ended.err) == (1, "")
    assert (early.status, early.knowledge) == ("converged", None)
    assert [f.subject for f in of_kind(early.findings, Kind.profiles_missing)] == ["pending"]
    assert of_kind(late.findings, Kind.profiles_missing)
    assert late.parameters == early.parameters
    assert goes_on(ended.out)
    assert (result.parent / checkpoint.NAME).exists()
    assert list((tmp_path / "tmp").iterdir()) == []


@pytest.mark.nightly
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGHUP])
def test_ends_during_the_profiles_keep_the_fit(
    campaign: Path, tmp_path: Path, how: signal.Signals
) -> None:
    """The fit is written before the profiles begin; two signals at once do not lose it.

    On a busy machine a signal may come after the last profile: it is then sent to another run.
    """
    code = 0
    for attempt in map(str, range(10)):
        result = tmp_path / attempt / "out" / "result.json"
        result.parent.parent.mkdir()
        # a bootstrap, too: the profiles alone may be done before a busy machine sends the signal
        with reconstructing(campaign, result.parent.parent, "--bootstrap", "500") as job:
            wait_until(result.exists, "the result of the fit")
            early = read_result(result)
            job.send(how)
            job.send(how)
            code, out, err = job.ended()
        if code != 0:
            break
    assert code == 1, err
    assert "Traceback" not in err
    assert early.status == "converged"
    late = read_result(result)
    assert early.knowledge is None
    assert [f.subject for f in of_kind(early.findings, Kind.profiles_missing)] == ["pending"]
    assert of_kind(late.findings, Kind.profiles_missing)
    assert late.parameters == early.parameters
    assert goes_on(out)
    assert (result.parent / checkpoint.NAME).exists()
    assert job.left_behind() == []


@pytest.mark.nightly
def test_an_interrupted_study_shows_the_settings_so_far(tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ["tradeoff", "--scene", "duffing-string", "--out", str(out)]
    with Job(words, tmp_path / "tmp") as job:
        wait_until((out / ROWS_NAME).exists, "the first row")
        job.send(signal.SIGINT)
        code, shown, err = job.ended()
    assert code == 1, err
    assert re.search(r"interrupted: \d+ of \d+ .*--resume", shown)
    assert (out / "tradeoff.md").exists()
    assert (out / ROWS_NAME).exists()
    assert job.left_behind() == []


@pytest.mark.parametrize(
    ("number", "ends"), [(signal.SIGINT, True), (signal.SIGHUP, False)], ids=["&", "nohup"]
)
def test_of_what_a_shell_lets_a_job_ignore_an_interrupt_alone_ends_it(
    number: signal.Signals, ends: bool
) -> None:
    """A job that is started with & ignores Ctrl-C, and is asked to end by kill -INT."""
    before = signal.signal(number, signal.SIG_IGN)
    try:
        asked = 0
        with interruptible():
            try:
                os.kill(os.getpid(), number)
            except KeyboardInterrupt:
                asked += 1
        assert asked == ends
        assert signal.getsignal(number) is signal.SIG_IGN
    finally:
        signal.signal(number, before)


@pytest.mark.nightly
def test_a_job_in_the_background_is_asked_to_end_by_int(campaign: Path, tmp_path: Path) -> None:
    """A shell that starts a job with & lets it ignore Ctrl-C."""
    kept = tmp_path / "out" / checkpoint.NAME
    with reconstructing(campaign, tmp_path, "--no-profiles", ignored=signal.SIGINT) as job:
        wait_until(kept.exists, "the first level")
        job.send(signal.SIGINT)
        code, _, err = job.ended()
    assert code == 1, err
    assert read_result(tmp_path / "out" / "result.json").status == "interrupted"


@pytest.mark.nightly
def test_a_hangup_that_is_ignored_stays_ignored(campaign: Path, tmp_path: Path) -> None:
    """As under nohup."""
    kept = tmp_path / "out" / checkpoint.NAME
    with reconstructing(campaign, tmp_path, "--no-profiles", ignored=signal.SIGHUP) as job:
        wait_until(kept.exists, "the first level")
        job.send(signal.SIGHUP)
        code, _, err = job.ended()
    assert code == 0, err


def test_another_command_ends_with_130_and_leaves_nothing(tmp_path: Path) -> None:
    """In the middle of an endless loop of the FMU."""
    hung = tmp_path / "hung"
    fmu = build_c_fmu(tmp_path, marks={"HANGS_WHERE_VARIED": hung})
    with temporary_files_in(tmp_path / "tmp"):
        ended = asked_to_end(signal.SIGTERM, hung.exists, "check", fmu, "--timeout", "1 d")
    assert (ended.code, ended.err) == (130, INTERRUPTED)
    assert list((tmp_path / "tmp").iterdir()) == []


# an interrupt may come between the opening of a file and its block
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_model_that_is_being_built_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(models.CACHE, "")  # none is kept of an earlier build
    temporary = tmp_path / "tmp"
    words = ("reconstruct", STRING / "campaign.toml", "--out", tmp_path / "out")
    with temporary_files_in(temporary):
        ended = asked_to_end(signal.SIGTERM, lambda: any(temporary.iterdir()), *words)
    assert (ended.code, ended.err) == (130, INTERRUPTED)
    assert list(temporary.iterdir()) == []


def test_a_worker_that_is_killed_again_and_again_names_the_way_on(
    campaign: Path, tmp_path: Path
) -> None:
    """As the system does for want of memory: once is not noticed, twice is told."""
    kept = tmp_path / "out" / checkpoint.NAME
    with reconstructing(campaign, tmp_path, "--no-profiles") as job:
        wait_until(kept.exists, "the first level")
        while job.is_running:
            job.kill_workers()
        code, _, err = job.ended()
    assert code == 3, err
    assert "SIGKILL" in err
    assert goes_on(err)
    assert err.count("\n") == 2
    assert kept.exists()


def test_what_is_printed_reaches_its_end_although_an_fmu_forks(tmp_path: Path) -> None:
    """The FMU's child keeps open what it has; ``| tail`` must not wait for it."""
    child = tmp_path / "child"
    fmu = build_c_fmu(tmp_path, marks={"FORKS_ONCE": child})
    ran = subprocess.run(
        [sys.executable, "-m", "fitting", "check", str(fmu)],
        stdin=subprocess.PIPE,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )
    assert child.exists()
    assert ran.returncode == 0, ran.stderr
    assert "trial run" in ran.stdout
    assert list(tmp_path.glob("fmu-fit-*")) == []
