"""What all tests share: the FMU, built once for the session as a user builds it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import build_fmu
from tests.fmus import Instance, Unpacked, unpack


@pytest.fixture(scope="session")
def oscillator_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The FMU ``CoupledOscillator`` as ``build_fmu.py`` makes it."""
    return build_fmu.build("CoupledOscillator", tmp_path_factory.mktemp("fmu"))


@pytest.fixture(scope="session")
def oscillator(oscillator_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Unpacked:
    """The same FMU, unpacked."""
    return unpack(oscillator_fmu, tmp_path_factory.mktemp("unpacked"))


@pytest.fixture
def instance(oscillator: Unpacked) -> Iterator[Instance]:
    """A new instance of the FMU in this process."""
    with Instance(oscillator) as made:
        yield made
