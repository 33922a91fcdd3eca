"""Plugin of pytest that tells coverage which test runs: `-p tests.support.line_contexts`.

Coverage's own `dynamic_context` goes by the names of functions on the stack and loses the tests
that hypothesis runs. What earlier tests have left in the caches of `MODULES` is forgotten before
every test, so that each is seen to run the lines that it needs.
"""

from __future__ import annotations

import sys
from collections.abc import Generator

import coverage
import pytest

#: Beginnings of the modules whose lines are asked for.
MODULES = ("fitting.signal.", "fitting.simulate.", "fitting.fit.", "fmu_src.")


def _running() -> coverage.Coverage:
    running = coverage.Coverage.current()
    if running is None:
        raise pytest.UsageError("no coverage runs that could be told of tests")
    return running


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None]:
    """Lines that fixtures run are those of the whole file: which tests ask for them is not known.

    Args:
        item: the test, one case of it.
    """
    running = _running()
    running.switch_context(item.nodeid.split("::")[0])
    yield
    running.switch_context("")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None]:
    """Lines that a test's function runs are its own.

    Args:
        item: the test, one case of it.
    """
    running = _running()
    for name, module in list(sys.modules.items()):
        if name.startswith(MODULES):
            for value in vars(module).values():
                getattr(value, "cache_clear", lambda: None)()
    running.switch_context(item.nodeid.split("[")[0])
    yield
    running.switch_context("")
