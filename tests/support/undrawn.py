"""Commands that write figures beside their tables, without the figures: for tests of the tables."""

from __future__ import annotations

import pytest

from fitting.report.figures import simulate


def without_figures(patch: pytest.MonkeyPatch) -> None:
    """Let ``simulate`` and ``sweep`` draw nothing: a figure takes longer than most of their runs.

    Args:
        patch: in force for as long as nothing is drawn.
    """
    for name in ("save_figures", "save_frf"):
        patch.setattr(simulate, name, lambda *_: [])
