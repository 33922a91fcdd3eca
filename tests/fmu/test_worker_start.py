"""Workers start by themselves: they import nothing of the caller, and end with what holds them."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from pathlib import Path

import pytest

from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import Run
from tests.support.cfmu_build import build_c_fmu
from tests.support.processes import is_gone, wait_until

pytestmark = pytest.mark.cold_start

ROOT = Path(__file__).parents[2]
PULLED = Run(
    start_values={"force": 1.0},
    settle_s=0.0,
    sample_step_s=1e-3,
    samples=2,
    outputs=("displacement",),
)

#: Fifteen lines as one types them: no function, no guard, nothing closed.
SCRIPT = """
import sys
print("imported")
sys.path.insert(0, {root!r})
from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import Run

workers = FmuWorkers({fmu!r}, workers=2)
for force in (1.0, 2.0, 4.0):
    run = Run(
        start_values={{"force": force}}, settle_s=0.0, sample_step_s=1e-3, samples=2,
        outputs=("displacement",),
    )
    first, second = workers.run([run, run])
    assert (first == second).all()
    print(force, float(first[-1, 0]))

state = workers._open
print(state.home, *(worker.pid for worker in state.processes))
"""


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_c_fmu(tmp_path_factory.mktemp("cfmus"))


def run_python(arguments: list[str], folder: Path, text: str | None = None) -> list[str]:
    """Output of Python as lines, run in a folder with nothing of this checkout on its path."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    ran = subprocess.run(
        [sys.executable, *arguments],
        input=text,
        capture_output=True,
        text=True,
        cwd=folder,
        env=environment,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    assert ran.stderr == ""
    return ran.stdout.splitlines()


@pytest.mark.parametrize(
    "how",
    ["standard input", *(pytest.param(x, marks=pytest.mark.nightly) for x in ("file", "argument"))],
)
def test_a_plain_script_makes_runs(good: Path, tmp_path: Path, how: str) -> None:
    """Once imported, no guard, and nothing is left when it ends without closing anything."""
    text = SCRIPT.format(root=str(ROOT), fmu=str(good))
    script = tmp_path / "plain.py"
    script.write_text(text)
    arguments = {"file": [str(script)], "standard input": ["-"], "argument": ["-c", text]}[how]
    lines = run_python(arguments, tmp_path, text if how == "standard input" else None)
    assert lines[0] == "imported"
    pairs = [tuple(map(float, line.split())) for line in lines[1:4]]
    assert [force for force, _ in pairs] == [1.0, 2.0, 4.0]
    displacements = [displacement for _, displacement in pairs]
    assert displacements[0] > 0
    # linear: twice the force, twice the way, exactly in binary numbers
    assert displacements[1:] == [2 * displacements[0], 4 * displacements[0]]
    assert len(lines) == 5
    home, *pids = lines[4].split()
    assert len(pids) == 2
    assert not Path(home).exists()
    assert all(is_gone(int(pid)) for pid in pids)


def test_files_beside_the_caller_are_not_taken_for_libraries(good: Path, tmp_path: Path) -> None:
    """In the current folder a file may be called as a module that workers import."""
    for name in ("numpy", "fmpy", "signal", "queue", "log"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('the wrong file was imported')\n")
    script = tmp_path / "folder" / "plain.py"
    script.parent.mkdir()
    script.write_text(SCRIPT.format(root=str(ROOT), fmu=str(good)))
    assert len(run_python([str(script)], tmp_path)) == 5


def test_a_worker_imports_what_it_needs_and_no_more() -> None:
    code = "import sys, fitting.fmu.worker.loop; print(*sorted({m for m in sys.modules}))"
    [line] = run_python(["-c", f"import sys; sys.path.insert(0, {str(ROOT)!r}); {code}"], ROOT)
    loaded = set(line.split())
    assert {"numpy", "fmpy", "fitting.fmu.worker.loop"} <= loaded
    for library in ("scipy", "matplotlib", "jinja2", "pint", "mpmath", "tqdm", "pythonfmu"):
        assert library not in loaded
    rooms = {name.split(".")[1] for name in loaded if name.startswith("fitting.")}
    assert rooms <= {"engine", "fmu", "signal", "text"}


def test_fmpy_is_loaded_only_for_what_needs_it() -> None:
    code = "import fitting.fmu.accuracy, fitting.fmu.runs, fitting.fmu.pool"
    show = f"import sys; sys.path.insert(0, {str(ROOT)!r}); {code}; print('fmpy' in sys.modules)"
    assert run_python(["-c", show], ROOT) == ["False"]


def test_no_process_is_started_before_the_first_run(good: Path) -> None:
    workers = FmuWorkers(good, workers=2)
    assert workers.counts.processes == 0
    assert workers._open.home is None
    workers.run([PULLED])
    assert workers.counts.processes == 2
    workers.close()
    workers.close()
    [again] = workers.run([PULLED])  # closing is not for good
    assert again[1, 0] > 0
    workers.close()
    assert workers.counts.processes == 4


def test_what_nobody_refers_to_is_closed(good: Path) -> None:
    workers = FmuWorkers(good)
    workers.run([PULLED])
    [process], home = workers._open.processes, workers._open.home
    assert process is not None
    assert home is not None
    pid = process.pid
    assert home.exists()
    del workers, process
    gc.collect()
    assert not home.exists()
    assert is_gone(pid)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks of POSIX")
def test_a_fork_leaves_the_workers_to_their_owner(good: Path) -> None:
    script = f"""
import gc, os, sys
sys.path.insert(0, {str(ROOT)!r})
from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import Run
workers = FmuWorkers({str(good)!r})
run = Run(
    start_values={{"force": 1.0}}, settle_s=0.0, sample_step_s=1e-3, samples=2,
    outputs=("displacement",),
)
before = workers.run([run])[0].tobytes()
if os.fork() == 0:
    del workers
    gc.collect()
    sys.exit(0)  # with everything that is called at exit
_, status = os.wait()
assert status == 0
assert workers.run([run])[0].tobytes() == before
print(workers.counts.processes)
"""
    # Python 3.12 warns of forks beside threads, such as those of linear algebra
    assert run_python(["-W", "ignore::DeprecationWarning", "-c", script], ROOT) == ["1"]


def test_a_process_that_cannot_be_started_is_a_sentence(
    good: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from fitting.text.errors import FmuFailure

    monkeypatch.setattr("multiprocessing.spawn.get_executable", lambda: "/nowhere/python")
    with pytest.raises(FmuFailure, match="/nowhere/python"):
        FmuWorkers(good).run([PULLED])


def test_wait_until_gives_up() -> None:
    """The helper of these tests can fail."""
    with pytest.raises(AssertionError, match="never"):
        wait_until(lambda: False, "never", most_s=0.1)
