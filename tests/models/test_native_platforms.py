"""The native twin on Windows (wine) and on Linux on ARM (qemu), where both can be had.

Not among what continuous integration installs: zig compiles for minutes before the first of these.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from tests.support.c_hosts import Pythonless
from tests.support.fmus import REFUSALS, unpack
from tests.support.native_runs import CASES, Case, closed_form, refusals, script_of
from tests.support.platforms import PLATFORMS, Platform, agreement, host_of
from tests.support.twins import shipped_binary, twin_of

OSCILLATORS = [case for case in CASES if case.model == "CoupledOscillator"]
Made = Callable[[Case], Pythonless]


@pytest.fixture(scope="module", params=PLATFORMS, ids=lambda platform: platform.name)
def there(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Made:
    """The C host with a model's FMU, on another platform."""
    platform: Platform = request.param
    if obstacle := platform.why_not():
        pytest.skip(obstacle)
    folder = tmp_path_factory.mktemp(platform.name)
    return cache(lambda case: host_of(platform, case, folder))


@pytest.fixture(scope="module")
def here(compiled: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Made:
    """The same on this one, by its own compiler."""

    @cache
    def made(case: Case) -> Pythonless:
        fmu = unpack(
            twin_of(case.model, tmp_path_factory, case.fmi), tmp_path_factory.mktemp("here")
        )
        return Pythonless(compiled("replay", fmi=case.fmi), fmu, shipped_binary(fmu.folder))

    return made


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_numbers_and_words_are_those_of_this_platform(there: Made, here: Made, case: Case) -> None:
    """All outputs, statuses and messages; what differs are the last bits of sin, cos and exp."""
    script = script_of(here(case), case)
    ours, theirs = here(case).play(script), there(case).play(script)
    assert agreement(here(case), ours, theirs).worst <= 1e-12


@pytest.mark.parametrize("case", OSCILLATORS, ids=lambda case: case.name)
def test_runs_are_those_of_the_closed_form(there: Made, case: Case) -> None:
    found = closed_form(there(case))
    assert found.rest_error < 1e-13
    assert found.orbit_error < 1e-11


@pytest.mark.parametrize("case", OSCILLATORS, ids=lambda case: case.name)
def test_refusals_are_those_of_this_platform(there: Made, here: Made, case: Case) -> None:
    """Numbers in sentences, too, which each C library writes by itself."""
    script = ["new 0 a", *refusals(here(case)), "free 0"]
    ours, theirs = here(case).play(script), there(case).play(script)
    assert theirs.log == ours.log
    assert len(theirs.log) == len(REFUSALS)
    assert theirs.of("gets") == ours.of("gets")
