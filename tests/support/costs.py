"""A pytest plugin that writes down what each test and each fixture costs in processor time.

    python -m pytest -p tests.support.costs --costs FOLDER ...

One file of JSON lines per test process: ``{"kind": "test" or "fixture", "name", "phase", "s"}``.
Processor time is that of the test process, of the children that it has waited for and of all
descendants that still run; what a child that nobody waits for took after the last look is lost.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest


def processor_s() -> float:
    """Processor time of this process and all its descendants so far, in s."""
    own = os.times()
    total = own.user + own.system + own.children_user + own.children_system
    for pid in _descendants(os.getpid()):
        try:
            times = psutil.Process(pid).cpu_times()
        except psutil.Error:  # it has ended meanwhile, and counts once it is waited for
            continue
        total += times.user + times.system
        total += getattr(times, "children_user", 0.0) + getattr(times, "children_system", 0.0)
    return total


def _descendants(pid: int) -> list[int]:
    """Processes that run below one, which may have ended itself."""
    if not sys.platform.startswith("linux"):
        return [child.pid for child in psutil.Process(pid).children(recursive=True)]
    children: list[int] = []
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            children += map(int, (task / "children").read_text("ascii").split())
    return children + [further for child in children for further in _descendants(child)]


class Costs:
    """Writes a row for each phase of a test and each fixture that is made."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._file = (folder / f"{os.getpid()}.jsonl").open("a", encoding="utf-8")

    def _timed(self, kind: str, name: str, phase: str) -> Iterator[None]:
        before = processor_s()
        try:
            return (yield)
        finally:
            row = {"kind": kind, "name": name, "phase": phase, "s": processor_s() - before}
            self._file.write(json.dumps(row) + "\n")
            self._file.flush()

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> Iterator[None]:
        """All fixtures of a test that are not made yet."""
        return (yield from self._timed("test", item.nodeid, "setup"))

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        """The test itself."""
        return (yield from self._timed("test", item.nodeid, "call"))

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_teardown(self, item: pytest.Item) -> Iterator[None]:
        """Whatever its fixtures undo."""
        return (yield from self._timed("test", item.nodeid, "teardown"))

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[Any]) -> Iterator[None]:
        """One fixture, without those that it names as arguments."""
        where = fixturedef.baseid or "conftest"
        return (yield from self._timed("fixture", f"{where}::{fixturedef.argname}", "make"))


def pytest_addoption(parser: pytest.Parser) -> None:
    """Where the rows go."""
    parser.addoption("--costs", metavar="FOLDER", help="write processor times of tests there")


def pytest_configure(config: pytest.Config) -> None:
    """Measures in processes that run tests: not in the one that deals them out."""
    folder = config.getoption("--costs")
    deals = getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput")
    if folder and not deals:
        config.pluginmanager.register(Costs(Path(folder)), "costs")
