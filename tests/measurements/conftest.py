"""What tests of several kinds of measurements share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import fitting as ff


@pytest.fixture(scope="session")
def swift(swift_fmu: Path) -> Iterator[ff.Fmu]:
    """The native twin in one process for all tests: starting one costs more than most fits."""
    with ff.Fmu(swift_fmu, workers=1) as fmu:
        yield fmu
