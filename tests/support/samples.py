"""How many cases a statistical test takes: a few in every run, all of them before a release."""

from __future__ import annotations

import pytest


def sampled(few: int, many: int) -> pytest.MarkDecorator:
    """Gives a test its `count`: few, and in the nightly run many.

    Args:
        few: cases, enough to fail when what is tested is broken.
        many: cases, enough for the shares that the test's name claims.
    """
    return pytest.mark.parametrize("count", [few, pytest.param(many, marks=pytest.mark.nightly)])
