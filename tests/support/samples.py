"""How many cases a statistical test takes: a few in every run, all of them before a release."""

from __future__ import annotations

from collections.abc import Iterable

import pytest
from _pytest.mark import ParameterSet


def sampled(few: int, many: int) -> pytest.MarkDecorator:
    """Gives a test its `count`: few, and in the nightly run many.

    Args:
        few: cases, enough to fail when what is tested is broken.
        many: cases, enough for the shares that the test's name claims.
    """
    return pytest.mark.parametrize("count", [few, pytest.param(many, marks=pytest.mark.nightly)])


def cases(names: Iterable[str], *daily: str) -> list[ParameterSet]:
    """Parameters of a test: those named in every run, the others before a release.

    Args:
        names: of all cases.
        daily: that every run has.
    """
    return [
        pytest.param(name, marks=() if name in daily else pytest.mark.nightly, id=name)
        for name in names
    ]
