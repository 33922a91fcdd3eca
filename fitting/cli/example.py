"""``fmu-fit example``: a shipped campaign with all its files, to try and to start from."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from fitting.text.errors import BadInput
from fitting.text.files import write_all
from fitting.text.shipped import shipped
from fitting.text.toml import read_toml

NAME = "example"
EXAMPLE = "fmu-fit example string_q1 --out string_q1"

CAMPAIGN = "campaign.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        "name", metavar="NAME", nargs="?", help="which campaign; without it they are listed"
    )
    parser.add_argument("--out", type=Path, help="new folder for its files (NAME)")


def run(args: argparse.Namespace) -> int:
    """List the examples, or write one; returns 0.

    Raises:
        BadInput: no example of that name, or a folder that holds something already.
    """
    examples = _examples()
    if args.name is None:
        if args.out is not None:
            raise BadInput(f"--out {args.out}: wanted a NAME as well, one of {', '.join(examples)}")
        width = max(len(name) for name in examples)
        for name, folder in examples.items():
            print(f"{name:{width}}  {read_toml(folder / CAMPAIGN).get('title', '')}")
        return 0
    if args.name not in examples:
        raise BadInput(f"NAME: found {args.name!r}, wanted one of {', '.join(examples)}")
    source, out = examples[args.name], args.out or Path(args.name)
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise BadInput(f"--out {out}: is there already, wanted a new or an empty folder")
    files = sorted(path for path in source.rglob("*") if path.is_file())
    write_all(out, {path.relative_to(source).as_posix(): path.read_bytes() for path in files})
    print(f"written: {', '.join(str(out / path.relative_to(source)) for path in files)}")
    print(f"go on with: {shlex.join(['fmu-fit', 'reconstruct', str(out / CAMPAIGN)])}")
    return 0


def _examples() -> dict[str, Path]:
    """Name and folder of every shipped campaign, by name."""
    found = sorted(shipped("data").glob(f"*/{CAMPAIGN}"))
    return {path.parent.name: path.parent for path in found}
