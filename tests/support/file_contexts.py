"""Plugin of pytest that tells coverage which test file runs: `-p tests.support.file_contexts`.

With coverage's core `sysmon` (Python 3.12 or later), which costs a tenth of the time that a trace
function takes: a line is reported once, so all lines are made new at every change of file.
"""

from __future__ import annotations

import sys

import coverage
import pytest


class _Contexts:
    """Changes coverage's context with the file of the test."""

    def __init__(self) -> None:
        self._file = ""

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> None:
        """A test is about to run: it and its fixtures are its file's."""
        file, running = item.nodeid.split("::")[0], coverage.Coverage.current()
        if file != self._file and running is not None:
            self._file = file
            running.switch_context(file)
            if sys.version_info >= (3, 12):
                sys.monitoring.restart_events()

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self) -> None:
        """What was seen is kept now: test processes of pytest-xdist are ended from outside."""
        running = coverage.Coverage.current()
        if running is not None:
            running.save()


def pytest_configure(config: pytest.Config) -> None:
    """In every process that runs tests."""
    config.pluginmanager.register(_Contexts(), "file_contexts")
