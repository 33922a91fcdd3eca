"""FMUs that the tests of several models share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.support.modes_fmus import Models, ModesFmus


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Models]:
    """An instance of the FMU with as many modes as asked for; each is built once."""
    fmus = ModesFmus(tmp_path_factory)
    yield fmus.of
    fmus.free()
