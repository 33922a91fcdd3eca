"""Faults of the machine: files that are none, streams that are closed, little of everything."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.faults.campaign_keys import COMMAND
from tests.faults.case import HERE, OUT, Case, drawn
from tests.faults.scene import CAMPAIGN, EXPERIMENTS, FMU, ONE, SWEEP, TWO

FILES, MACHINE = "files that are none", "the machine"

CHECK = f"check {HERE}/{FMU}"
FIT = " ".join(COMMAND)
EXAMPLE = f"example string_q1 --out {HERE}/{OUT}"
SIMULATE = f"simulate {HERE}/{FMU} --set A2=0 --set u1=320 --out {HERE}/{OUT}"
SYNTHESIZE = f"synthesize --series q1 --out {HERE}/{OUT}"


def _replaced(name: str, make: Callable[[Path], None]) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        path = folder / name
        if path.exists():
            path.unlink()
        make(path)

    return change


def _hole(path: Path) -> None:
    path.touch()
    os.truncate(path, 10**11)


KINDS: dict[str, Callable[[Path], None]] = {
    "a pipe": os.mkfifo,
    "a folder": Path.mkdir,
    "a device without end": lambda path: path.symlink_to("/dev/zero"),
    "a device of chance": lambda path: path.symlink_to("/dev/random"),
    "a device without anything": lambda path: path.symlink_to("/dev/null"),
    "memory": lambda path: path.symlink_to("/proc/self/mem"),
    "a link to itself": lambda path: path.symlink_to(path),
    "a link to nothing": lambda path: path.symlink_to("nothing"),
    "gone": lambda path: None,
    "empty": Path.touch,
    "a hole of 100 GB": _hole,
}


def file_cases(count: int, seed: int) -> Iterator[Case]:
    """So many of the files that are none, drawn."""
    yield from drawn(_file_cases(), count, seed)


def _file_cases() -> Iterator[Case]:
    """Each file of the campaign, and the folder of the results, is something else."""
    for name in (CAMPAIGN, EXPERIMENTS, SWEEP, ONE, TWO, FMU):
        for what, make in KINDS.items():
            yield Case(
                kind=FILES,
                name=f"{name} is {what}",
                words=COMMAND,
                change=_replaced(name, make),
                about=(name,),
                codes=(2,),
            )
    for what, make in KINDS.items():
        if what in ("a folder", "gone"):
            continue
        yield Case(
            kind=FILES,
            name=f"--out is {what}",
            words=("example", "string_q1", "--out", f"{HERE}/{OUT}"),
            change=_replaced(OUT, make),
            about=(OUT,),
            codes=(0, 2) if what == "a link to nothing" else (2,),
        )


#: Shell lines in which {fit}, {check} and their kin are commands.
LINES: dict[str, tuple[str, tuple[int, ...]]] = {
    "output into a full device": (f"{{run}} {CHECK} > /dev/full", (2,)),
    "output of a fit into a full device": (f"{{run}} {FIT} > /dev/full", (2,)),
    "help into a full device": ("{run} reconstruct --help > /dev/full", (0, 2)),
    "complaints into a full device": (f"{{run}} check {HERE}/absent.fmu 2> /dev/full", (2,)),
    "output closed": (f"{{run}} {CHECK} >&-", (0,)),
    "complaints closed": (f"{{run}} {CHECK} 2>&-", (0,)),
    "complaint into a closed stream": (f"{{run}} check {HERE}/absent.fmu 2>&-", (2,)),
    "everything closed": (f"{{run}} {CHECK} <&- >&- 2>&-", (0,)),
    "a fit with everything closed": (f"{{run}} {FIT} <&- >&- 2>&-", (0,)),
    "a reader that has seen enough": (f"{{run}} {CHECK} | head -n 1", (0,)),
    "a reader that is not there": (f"{{run}} {EXAMPLE} | true", (0,)),
    "a working folder that is gone": (f"mkdir g; cd g; rmdir ../g; {{run}} {CHECK}", (0, 2)),
    "a fit in a folder that is gone": (f"mkdir g; cd g; rmdir ../g; {{run}} {FIT}", (0, 2)),
    "results in a folder that is gone": (
        "mkdir g; cd g; rmdir ../g; {run} example string_q1 --out o",
        (2,),
    ),
    "a campaign in a folder that is gone": (
        "mkdir g; cd g; rmdir ../g; {run} reconstruct campaign.toml",
        (2,),
    ),
    **{
        f"{n} open files, {name}": (f"ulimit -n {n}; {{run}} {words}", (0, 2, 3))
        for n in (8, 12, 16, 24, 40)
        for name, words in (("check", CHECK), ("fit", FIT), ("example", EXAMPLE))
    },
    **{
        f"{n} MB of memory, {name}": (f"ulimit -v {n}000; {{run}} {words}", (0, 2, 3))
        for n in (100, 200, 300, 400, 600, 800)
        for name, words in (("check", CHECK), ("fit", FIT), ("laboratory", SYNTHESIZE))
    },
    **{
        f"files of {n} kB at most, {name}": (f"ulimit -f {n}; {{run}} {words}", (0, 2, 3))
        for n in (0, 8, 200)
        for name, words in (("check", CHECK), ("fit", FIT), ("example", EXAMPLE))
    },
    "no folder for temporary files": (f"TMPDIR={HERE}/nothing {{run}} {CHECK}", (0, 2)),
    "a file for temporary files": (f"TMPDIR={HERE}/one.csv {{run}} {CHECK}", (0, 2)),
    "temporary files with a bracket": (
        f"mkdir {HERE}/'t (1)'; TMPDIR={HERE}/'t (1)' {{run}} {CHECK}; c=$?; "
        f"rmdir {HERE}/'t (1)'; exit $c",
        (0, 2),
    ),
    "no home": (f"env -u HOME {{run}} {SIMULATE}", (0,)),
    "a home that is none": (f"HOME=/dev/null {{run}} {SIMULATE}", (0,)),
    "no path": (f"PATH= {{run}} {CHECK}", (0,)),
    "ASCII alone": (f"PYTHONIOENCODING=ascii {{run}} {FIT}", (0,)),
    "no language": (f"LC_ALL=C PYTHONUTF8=0 PYTHONCOERCECLOCALE=0 {{run}} {FIT}", (0,)),
    "a result on a system that is read": (
        "{run} example string_q1 --out /proc/nothing",
        (2,),
    ),
    "a small stack": (f"ulimit -s 256; {{run}} {CHECK}", (0, 2, 3)),
}
#: Such words stand in a complaint about the machine.
ABOUT = (
    *(HERE, FMU, CAMPAIGN, "memory", "ulimit", "library", "folder", "output", "TMPDIR", "/proc"),
    *(".json", "worker process", "o: ", "campaign.toml"),
)


def machine_cases() -> Iterator[Case]:
    """Shell lines, each a process of its own."""
    for name, (line, codes) in LINES.items():
        heard = "2>" not in line
        yield Case(
            kind=MACHINE,
            name=name,
            words=(line,),
            about=ABOUT if heard else (),
            codes=codes,
            shell=True,
        )
