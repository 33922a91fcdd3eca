"""What all tests share: the FMU, built once for the session as a user builds it."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import hypothesis
import pytest

import build_fmu
from fitting.engine import process
from fitting.fmu import models
from fitting.fmu.worker import process as worker_process
from tests.support.c_hosts import compile_program
from tests.support.fmus import Instance, Unpacked, unpack
from tests.support.processes import Clock
from tests.support.shipped_runs import ShippedRun, shipped_run
from tests.support.twins import swift_model, swiftly_built, twin_of
from tests.support.warm_starts import WarmStarts

# no claim about time: a busy machine is no fault of the code
hypothesis.settings.register_profile(
    "untimed",
    deadline=None,
    derandomize="CI" in os.environ,  # the same examples in every run of continuous integration
    suppress_health_check=[hypothesis.HealthCheck.too_slow],
)
hypothesis.settings.load_profile("untimed")


@pytest.fixture(scope="session", autouse=True)
def _warm() -> Iterator[WarmStarts]:
    """Workers are forks of a process that has imported what they need."""
    warm = WarmStarts(process._started)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(process, "_started", warm)
        yield warm
    warm.close()


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """FMUs that commands build are kept for the session, not in the cache of who runs the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(models.CACHE, str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(autouse=True)
def _cold_where_marked(request: pytest.FixtureRequest, _warm: WarmStarts) -> Iterator[None]:
    """Tests of how workers are started, and of their memory, have them as users have them."""
    _warm.is_wanted = request.node.get_closest_marker("cold_start") is None
    yield
    _warm.is_wanted = True


@pytest.fixture(scope="session")
def oscillator_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The FMU ``CoupledOscillator`` as ``build_fmu.py`` makes it."""
    return build_fmu.build("CoupledOscillator", tmp_path_factory.mktemp("fmu"))


@pytest.fixture(scope="session")
def oscillator(oscillator_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Unpacked:
    """The same FMU, unpacked."""
    return unpack(oscillator_fmu, tmp_path_factory.mktemp("unpacked"))


@pytest.fixture(scope="session")
def twin_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its native twin, as ``build_fmu.py --native`` makes it."""
    return twin_of("CoupledOscillator", tmp_path_factory)


@pytest.fixture(scope="session")
def swift_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The twin, which answers in a fifth of the time; without a compiler the FMU itself.

    For tests of what is made of the answers: `tests/models/test_native.py` holds both together.
    """
    return swift_model("CoupledOscillator", tmp_path_factory)


@pytest.fixture(scope="session")
def swift_modes_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The like of ``CoupledModes2``."""
    return swift_model("CoupledModes2", tmp_path_factory)


@pytest.fixture(scope="module")
def swift_models(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Models that campaigns name are their twins: for modules that ask what is made of answers."""
    with swiftly_built(tmp_path_factory):
        yield


@pytest.fixture(scope="session")
def string_q1_run(tmp_path_factory: pytest.TempPathFactory) -> ShippedRun:
    """The first shipped series, reconstructed by the command with ``--quick``."""
    return shipped_run("string_q1", tmp_path_factory)


@pytest.fixture(scope="session")
def string_q2_run(tmp_path_factory: pytest.TempPathFactory) -> ShippedRun:
    """The second shipped series, reconstructed by the command with ``--quick``."""
    return shipped_run("string_q2", tmp_path_factory)


@pytest.fixture(scope="session")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """A function that compiles a program of ``tests/support/hosts``, for FMI 2.0 or 3.0."""
    compiler = shutil.which("cc")
    folder = tmp_path_factory.mktemp("compiled")

    @cache
    def compile_source(name: str, *options: str, fmi: int = 2) -> Path:
        if compiler is None:
            pytest.skip("this machine has no C compiler")
        program = folder / str(len(list(folder.iterdir()))) / name
        program.parent.mkdir()
        compile_program([compiler], name, program, [*options, "-ldl"], fmi)
        return program

    return compile_source


@pytest.fixture
def instance(oscillator: Unpacked) -> Iterator[Instance]:
    """A new instance of the FMU in this process."""
    with Instance(oscillator) as made:
        yield made


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """The clock by which workers are late, which no busy machine can disturb."""
    clock = Clock()
    monkeypatch.setattr(worker_process, "time", clock)
    return clock


@pytest.fixture(autouse=True)
def _patient_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a busy machine a line of progress would stand among the complaints that tests count."""
    monkeypatch.setattr("fitting.api.progress.FIRST_S", 1e6)
    monkeypatch.setattr("fitting.api.progress.MOST_S", 1e6)
