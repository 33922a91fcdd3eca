"""Instances of the FMUs of N coupled modes, each built when it is first asked for."""

from __future__ import annotations

from collections.abc import Callable

import pytest

import build_fmu
from tests.support.fmus import Instance, unpack

Models = Callable[[int], Instance]


class ModesFmus:
    """One instance for each number of modes."""

    def __init__(self, folders: pytest.TempPathFactory) -> None:
        self._folders = folders
        self._made: dict[int, Instance] = {}

    def of(self, n: int) -> Instance:
        """The instance with n modes, reset."""
        if n not in self._made:
            folder = self._folders.mktemp(f"modes{n}")
            fmu = unpack(build_fmu.build(f"CoupledModes{n}", folder), folder / "unpacked")
            self._made[n] = Instance(fmu)
        self._made[n].slave.reset()
        self._made[n].messages.clear()
        return self._made[n]

    def free(self) -> None:
        """Free all instances."""
        for one in self._made.values():
            one.slave.freeInstance()
