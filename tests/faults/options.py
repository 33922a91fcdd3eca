"""Faults on the command line: every option of every command with values that it cannot have."""

from __future__ import annotations

import argparse
import random
from collections.abc import Iterator, Mapping

from fitting.cli.words.parser import COMMANDS, add_options, command_of
from tests.faults.case import HERE, OUT, Case
from tests.faults.scene import CAMPAIGN, FMU

OPTIONS, WORDS = "options of every command", "words of the command line"

ABSENT = f"{HERE}/absent.toml"
OUTPUT = ("--out", f"{HERE}/{OUT}")
#: Words that make a command complete; where an option that is right would begin hours of work, the
#: campaign is not there.
COMPLETE: Mapping[str, tuple[str, ...]] = {
    "reconstruct": (ABSENT, *OUTPUT, "--no-report", "--no-profiles", "--quick"),
    "identify": (ABSENT, *OUTPUT, "--no-report"),
    "design": (ABSENT, *OUTPUT, "--no-report"),
    "tradeoff": ("--campaign", ABSENT, *OUTPUT),
    "simulate": (f"{HERE}/{FMU}", *OUTPUT, "--plan", "--set", "A2=0"),
    "sweep": (f"{HERE}/{FMU}", *OUTPUT, "--from", "300 Hz", "--to", "340 Hz", "--points", "3"),
    "synthesize": ("--series", "q1", *OUTPUT),
    "calibrate": (ABSENT, *OUTPUT),
    "check": (f"{HERE}/{FMU}",),
    "example": ("string_q1", *OUTPUT),
    "completion": ("bash",),
    "line": (f"{HERE}/sweep.csv", *OUTPUT),
    "init": (f"{HERE}/sweep.csv", "--fmu", f"{HERE}/{FMU}", *OUTPUT, "--yes"),
}

VALUES = (
    *("", " ", "nan", "inf", "-inf", "NaN Hz", "1e300", "-1e300", "1e-300", "1e400", "0", "-0"),
    *("-1", "-1 s", "1.5", "1e3", "9" * 30, "9" * 5000, "1 parsec", "1 kg", "1e300 Hz", "1e400 s"),
    *("1e-300 s", "abc", "é", "\udcff", "\U0001f600", "a\nb", "=", "a=b", "=1", "a=", "d1=nan"),
    *("d1=1e300", "theta=abc", "solver=1.5", "solver=99999999999", "solver=1e300", "d1=1 kg"),
    *("reflection=maybe", "lambda=1", "lambda=0.8 MHz", "status_message=x", "u1=0", "u1=-1 Hz"),
    *("u1=1e300", "A1=0", ",", "1,nan", "1e-2,,1e-3", "u1,u1", "u1,nothing", "q1_hybrid,", "%s"),
    *("-", "--", "--out", "x" * 5000, "/dev/null", "/dev/zero", f"{HERE}/{CAMPAIGN}", HERE, "/"),
    *(f"{HERE}/one.csv", f"{HERE}/{FMU}", "/proc/self/mem", "far mode left out", "0,1,2"),
)


def _parser(name: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser()
    add_options(parser, command_of(name))
    return parser


def _options(name: str) -> list[str]:
    found = [max(a.option_strings, key=len) for a in _parser(name)._actions if a.option_strings]
    return [option for option in found if option not in ("--help", "--out")]


def cases(count: int, seed: int) -> Iterator[Case]:
    """So many cases, drawn without repeating one."""
    draw = random.Random(seed)
    all_of_them = [
        (name, option, value)
        for name in COMMANDS
        if name in COMPLETE
        for option in _options(name)
        for value in VALUES
    ]
    for name, option, value in draw.sample(all_of_them, min(count, len(all_of_them))):
        yield Case(
            kind=OPTIONS,
            name=f"{name} {option}={value[:40]!r} of {len(value)}",
            words=(name, *COMPLETE[name], f"{option}={value}"),
            about=(*_names(option), *_shown(value), "absent.toml", FMU, "--help", "tones "),
        )


def _names(option: str) -> tuple[str, ...]:
    return option, option.removeprefix("--").replace("-", "_")


def _shown(word: str) -> tuple[str, ...]:
    """The beginning of a word as a complaint may show it."""
    shown = " ".join(word[:10].split())
    return tuple(text for text in (shown, ascii(shown)[1:-1]) if text) or ("' '", ".:")


def word_cases(count: int, seed: int) -> Iterator[Case]:
    """Words that are missing, too many, or files that are none."""
    draw = random.Random(seed)
    files = (
        *("", " ", ".", "/", "-", "--", "nothing", "\udcff", "x" * 5000, "/dev/zero", "/dev/null"),
        *("/dev/random", "/proc/self/mem", "/proc/self/environ", f"{HERE}/one.csv", HERE, "a\nb"),
        *(f"{HERE}/{CAMPAIGN}", f"{HERE}/{FMU}", f"{HERE}/{FMU}/x", f"{HERE}/{CAMPAIGN}/"),
    )
    all_of_them = [
        (name, k, word)
        for name in COMMANDS
        if name in COMPLETE
        for k in range(len(COMPLETE[name]))
        for word in (None, *files)
        if COMPLETE[name][k] != "string_q1" or word != f"{HERE}/{CAMPAIGN}"
    ]
    for name, k, word in draw.sample(all_of_them, min(count, len(all_of_them))):
        words = list(COMPLETE[name])
        words[k : k + 1] = [] if word is None else [word]
        if word in ("/", ".") and COMPLETE[name][k - 1] == "--out":
            continue  # is a folder, and would be written into
        yield Case(
            kind=WORDS,
            name=f"{name}: word {k} is {word and word[:40]!r}",
            words=(name, *words),
            about=("--", "absent.toml", FMU, "CAMPAIGN", name, "/proc/", *_shown(word or ""), HERE),
        )
