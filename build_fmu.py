"""Build the FMUs of ``fmu_src/``: the same sources and options give the same bytes.

    python build_fmu.py [--out DIR] [--model NAME ...] [--modes N] [--set NAME=VALUE ...]
    python build_fmu.py --native [--fmi 3] [--platforms NAME ...] [--model NAME ...] ...
    python build_fmu.py --like FMU [--name NAME] [--history TEXT] [--out DIR] [--set NAME=VALUE ...]

How they are built is in ``fmu_src/building.py``, whose functions are here, too: ``build``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from fmu_src import native_binary
from fmu_src.building import (
    OUT,
    SOURCE,
    Variant,
    build,
    build_all,
    built_from,
    loaded,
    model_modules,
    module_of,
)
from fmu_src.start_values import BuildError

__all__ = [
    "SOURCE",
    "BuildError",
    "Variant",
    "build",
    "build_all",
    "built_from",
    "model_modules",
    "module_of",
]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code: 0 built, 2 bad input."""
    parser = argparse.ArgumentParser(
        description="Build the FMUs of fmu_src/ and print their paths.",
        epilog="example: python build_fmu.py --out build --set theta=1.95 d1=118",
    )
    parser.add_argument("--out", type=Path, default=OUT, help=f"folder to write into ({OUT})")
    parser.add_argument(
        "--model", nargs="+", action="extend", metavar="NAME", help="models to build (all)"
    )
    parser.add_argument(
        "--modes",
        metavar="N",
        help="number of modes of a model that is named without it: --model CoupledModes --modes 3",
    )
    parser.add_argument(
        "--set",
        nargs="+",
        action="extend",
        default=[],
        metavar="NAME=VALUE",
        help="other start values of parameters, in the units of the FMU",
    )
    parser.add_argument(
        "--like",
        type=Path,
        metavar="FMU",
        help="build the model of this FMU, which build_fmu.py made, with its start values",
    )
    parser.add_argument("--name", default="", help="with --like: another name for the FMU")
    parser.add_argument(
        "--history", default="", help="with --like: a sentence on the start values, for its page"
    )
    parser.add_argument(
        "--native",
        action="store_true",
        help="build the native twins, which need no Python, with this machine's C compiler",
    )
    parser.add_argument(
        "--platforms",
        nargs="+",
        action="extend",
        metavar="NAME",
        help="with --native: compile for these with the package ziglang instead: "
        + ", ".join(native_binary.TARGETS),
    )
    parser.add_argument(
        "--fmi", type=int, choices=(2, 3), default=2, help="with --native: version of FMI (2)"
    )
    options = parser.parse_args(arguments)
    try:
        start_values = dict(_assignment(text) for text in options.set)
        if options.like is None and (options.name or options.history):
            raise BuildError("--name and --history: have a meaning with --like alone")
        if options.like is not None:
            print(_build_like(options, start_values))
            return 0
        if options.platforms and not options.native:
            raise BuildError("--platforms: has a meaning with --native alone")
        if options.fmi == 3 and not options.native:
            raise BuildError("--fmi 3: has a meaning with --native alone")
        models = _numbered(options.model, options.modes)
        native = (options.platforms or ()) if options.native else None
        variant = Variant(fmi=options.fmi)
        for path in build_all(models, options.out, start_values, variant=variant, native=native):
            print(path)
    except BuildError as error:
        print(f"build_fmu.py: {error}", file=sys.stderr)
        return 2
    return 0


def _build_like(options: argparse.Namespace, start_values: Mapping[str, str]) -> Path:
    if options.model or options.modes:
        raise BuildError("--like: has the model and its modes; --model and --modes have no meaning")
    if options.native or options.platforms or options.fmi == 3:
        raise BuildError(
            "--like: has its platforms; --native, --platforms and --fmi have no meaning"
        )
    like = built_from(options.like)
    values = {**like.start_values, **start_values}
    variant = Variant(options.name, options.history, like.fmi)
    return build(like.model, options.out, values, variant=variant, native=like.native)


def _numbered(models: Sequence[str] | None, modes: str | None) -> Sequence[str] | None:
    """Return the names of models, those of a family with the number of modes at their end."""
    with loaded(SOURCE, None) as package:
        families = dict(package.FAMILIES)
    named = [name for name in models or () if name in families]
    if modes is not None and not named:
        counted = ", ".join(families)
        raise BuildError(f"--modes {modes}: wanted is a --model that it counts: {counted}")
    for name in named:
        _, least, most = families[name]
        if modes is None:
            raise BuildError(f"--model {name}: needs --modes, a number from {least} to {most}")
        if modes not in map(str, range(least, most + 1)):
            raise BuildError(
                f"--modes {modes}: {name} has a number of modes from {least} to {most}"
            )
    return None if models is None else [f"{m}{modes}" if m in families else m for m in models]


def _assignment(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise BuildError(f"--set {text}: wanted is NAME=VALUE")
    return name.strip(), value.strip()


if __name__ == "__main__":
    sys.exit(main())
