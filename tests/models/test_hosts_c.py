"""The oscillator FMU in a host without Python: a C program that replays scripts of FMI calls.

The host is compiled here with the system's compiler and loads the FMU as its documentation says: a
libpython first, with global symbols, then the binary of the FMU.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.support import reference
from tests.support.c_hosts import LIBPYTHONS, Host
from tests.support.fmus import (
    DISCARD,
    ERROR,
    FATAL,
    LIVELY,
    OK,
    REFUSALS,
    TIMES,
    WARNING,
    Unpacked,
    steady_state,
    worst,
)


@pytest.fixture(scope="module")
def host(oscillator: Unpacked, compiled: Callable[..., Path]) -> Host:
    """The C program and the FMU that it is to load."""
    if not LIBPYTHONS:
        pytest.skip("this machine has no shared libpython, 3.8 to 3.13")
    return Host(compiled("replay"), oscillator)


def test_without_a_python_library_the_loader_says_so(host: Host) -> None:
    done = host.run([], "-")
    assert done.returncode == 3
    assert "undefined symbol" in done.stderr
    assert "Py" in done.stderr


ORBIT = {"phase1": 0.4, "A2": 0.5}


@pytest.fixture(scope="module")
def truth(oscillator: Unpacked) -> tuple[list[Any], list[Any]]:
    """The true q~ of the lively run from rest and of the string on its orbit, at TIMES."""
    rest = [row[:2] for row in reference.displacements(oscillator.parameters(**LIVELY), TIMES)]
    return rest, steady_state(oscillator.parameters(**ORBIT), TIMES)


@pytest.mark.parametrize("libpython", LIBPYTHONS, ids=lambda path: path.name[3:-7])
def test_runs_are_those_of_the_closed_form(
    host: Host, libpython: Path, truth: tuple[list[Any], list[Any]]
) -> None:
    """A run from rest and one on the periodic orbit, side by side in two slots of one process."""
    names = "q1_hybrid", "q2_hybrid"
    transcript = host.play(
        [
            "new 0 rest",
            "new 1 orbit",
            *host.start(0, **LIVELY),
            *host.start(1, periodic_start=True, **ORBIT),
            *host.steps(TIMES, *names, slot=0),
            *host.steps(TIMES, *names, slot=1),
            "terminate 0",
            "free 0",
            "terminate 1",
            "free 1",
        ],
        libpython,
    )
    assert {status for _, _, status, _ in transcript.lines} == {OK}
    assert transcript.log == []
    rows = transcript.reals()
    assert worst(rows[: len(TIMES)], truth[0]) < 1e-13
    assert worst(rows[len(TIMES) :], truth[1]) < 1e-11


def test_one_process_survives_every_failure(host: Host) -> None:
    """All refusals one after the other, each mended by a reset and followed by a good run."""
    outputs = host.fmu.names("output")
    good = [*host.start(**LIVELY), *host.steps(TIMES[:3], "q1_hybrid", "q2_hybrid")]
    script = ["new 0 enduring", *good]
    for refusal in REFUSALS:
        script += [
            "reset 0",
            *host.start(**refusal.values),
            *host.get(*outputs),
            "step 0 0 1e-5",
            "step 0 1e-5 1e-5",
            *host.get(*outputs),
            host.message,
            "reset 0",
            host.message,
            *good,
        ]
    transcript = host.play([*script, "terminate 0", "free 0"])

    statuses = {status for status, _ in transcript.of("step")}
    assert statuses == {OK, DISCARD}
    assert [s for s, _ in transcript.of("step")].count(DISCARD) == 2 * len(REFUSALS)
    others = {status for verb, _, status, _ in transcript.lines if verb != "step"}
    assert others == {OK}

    rows = transcript.reals()
    wanted, size = rows[:3], 3 + 2
    for k, refusal in enumerate(REFUSALS):
        block = rows[3 + k * size : 3 + (k + 1) * size]
        assert all(math.isnan(x) for row in block[:2] for x in row), refusal.label
        assert block[2:] == wanted, refusal.label

    sentences = [text for _, text in transcript.of("gets")]
    assert sentences[1::2] == [""] * len(REFUSALS)  # after the reset
    logged = {text for status, text in transcript.log if status >= DISCARD}
    for refusal, sentence in zip(REFUSALS, sentences[::2], strict=True):
        assert refusal.name in sentence, refusal.label
        assert refusal.value in sentence, refusal.label
        assert sentence in logged, refusal.label


def test_calls_out_of_order_do_not_end_the_process(host: Host) -> None:
    references = host.fmu.references
    transcript = host.play(
        [
            "new 0 misused",
            "step 0 0 1e-5",  # before initialisation
            "reset 0",
            f"setr 0 {references['solver']} 1",  # an Integer
            "reset 0",
            f"setr 0 {references['q1']} 1",  # an output
            "reset 0",
            "getr 0 9999",  # not a variable
            "reset 0",
            *host.start(),
            "step 0 0 1e-5",
            "step 0 5e-5 1e-5",  # not where the last step ended
            "reset 0",
            *host.start(),
            "step 0 0 -1e-5",  # backwards
            "reset 0",
            *host.start(),
            "step 0 0 1e-5",
            "free 0",  # without terminate
        ]
    )
    assert [s for s, _ in transcript.of("step")] == [DISCARD, OK, DISCARD, DISCARD, OK]
    assert FATAL not in {status for _, _, status, _ in transcript.lines}
    assert len([s for s, _ in transcript.log if s == ERROR]) == 6


def test_negative_damping_grows_with_a_warning(host: Host) -> None:
    values = dict(LIVELY) | {"d1": -2e3}
    script = ["new 0 a", *host.start(**values), *host.steps(TIMES, "q1_hybrid", "q2_hybrid")]
    transcript = host.play(script)
    truth = [row[:2] for row in reference.displacements(host.fmu.parameters(**values), TIMES)]
    assert worst(transcript.reals(), truth) < 1e-12
    assert any(status == WARNING and "d1 = -2000.0" in text for status, text in transcript.log)


def test_a_restored_state_continues_bit_for_bit(host: Host) -> None:
    tail = [
        "step 0 1e-5 1e-5",
        *host.get("q1_hybrid", "q2"),
        *host.set(0, {"theta": 2.2, "b": 1e9}),
        "step 0 2e-5 1e-5",
        *host.get("q1_hybrid", "q2"),
    ]
    transcript = host.play(
        [
            "new 0 a",
            *host.start(**LIVELY),
            "step 0 0 1e-5",
            "save 0",
            *tail,
            *host.set(0, {"theta": math.nan}),
            "step 0 3e-5 1e-5",
            "restore 0",
            *tail,
            "drop 0",
            "free 0",
        ]
    )
    rows = transcript.reals()
    assert rows[2:] == rows[:2]
    assert [s for s, _ in transcript.of("step")] == [OK, OK, OK, DISCARD, OK, OK]


def test_no_freed_memory_is_touched_from_the_first_call_to_the_exit(
    host: Host, compiled: Callable[..., Path]
) -> None:
    fence = compiled("fence", "-shared", "-fPIC")
    good = [*host.start(0), *host.steps(TIMES[:3], "q1_hybrid", "lambda"), host.message]
    script = [
        "new 0 good",
        "new 1 bad",
        *good,
        *host.start(1, eta_plus=-1.0),
        "step 1 0 1e-5",
        "save 0",
        "restore 0",
        "drop 0",
        "free 1",
        "reset 0",
        *good,
        "terminate 0",
        "free 0",
    ]
    done = host.run(script, LD_PRELOAD=str(fence))
    assert done.returncode == 0, done.stdout
    assert done.stdout.splitlines()[-1] == "end"
