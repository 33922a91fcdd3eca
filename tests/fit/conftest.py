"""Shipped campaigns by the native twin: what is asked here is what is made of its answers."""

from __future__ import annotations

import pytest

from tests.support.shipped_runs import ShippedRun, swift_shipped_run


@pytest.fixture(scope="session")
def string_q1_run(tmp_path_factory: pytest.TempPathFactory) -> ShippedRun:
    """The first shipped series, reconstructed by the command with ``--quick``."""
    return swift_shipped_run("string_q1", tmp_path_factory)


@pytest.fixture(scope="session")
def string_q2_run(tmp_path_factory: pytest.TempPathFactory) -> ShippedRun:
    """The second shipped series, reconstructed by the command with ``--quick``."""
    return swift_shipped_run("string_q2", tmp_path_factory)
