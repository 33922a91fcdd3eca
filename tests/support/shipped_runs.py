"""Shipped campaigns as the command reconstructs them: once for all tests that read the results."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import filelock
import pytest

from fitting.result.result import Result, read_result
from tests.support.in_process import told
from tests.support.twins import shared_folder, swiftly_built

DATA = Path(__file__).parents[2] / "data"
#: With looser tolerances, which take half as long.
QUICK = "--quick"


@dataclass(frozen=True)
class ShippedRun:
    """What the command wrote and printed; tests share the folder, so nothing is written there."""

    folder: Path
    printed: str

    @property
    def result(self) -> Result:
        """Read from its file."""
        return read_result(self.folder / "result.json")


def shipped_run(name: str, factory: pytest.TempPathFactory) -> ShippedRun:
    """A shipped campaign with its profiles, run unless another test process has done so.

    Args:
        name: folder of the campaign.
        factory: of pytest, for the folder that the test processes of a session have in common.
    """
    shared = shared_folder(factory, "shipped")
    out, printed = shared / name, shared / f"{name}.txt"
    with filelock.FileLock(shared / f"{name}.lock"):  # of a process that ends, however, it is free
        if not printed.exists():
            words = ["reconstruct", str(DATA / name / "campaign.toml"), "--out", str(out)]
            ended = told(*words, "--no-report", "--verbose", "--workers", "2", QUICK)
            assert ended.code == 0, ended.err
            printed.write_text(ended.out, "utf-8")
    return ShippedRun(out, printed.read_text("utf-8"))


def swift_shipped_run(name: str, factory: pytest.TempPathFactory) -> ShippedRun:
    """The same by the native twin, which answers alike in a fifth of the time.

    Args:
        name: folder of the campaign.
        factory: of pytest, as for `shipped_run`.
    """
    with swiftly_built(factory):
        return shipped_run(name, factory)
