"""FMUs of others: what a doctor finds of each quirk, and whether a first campaign of `init` runs.

    python -m tests.bench.bench_quirks [--folder FMUS] [--no-fits]

The first table has one FMU in C for every quirk (``tests/support/cfmus``), Reference FMUs of the
Modelica Association, and those of a folder: what `ff.check` finds beside cosmetic things.

The second one has those that oscillate: a sweep in closed form, 1/|k - m w^2 + i c w| with a gain,
0.1 % of noise and k = 4100 N/m, c = 0.2 N.s/m, is written to a file, `fmu-fit init` makes a
campaign of it and the FMU, `fmu-fit reconstruct` fits it unedited, without profiles.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

import fitting as ff
from fitting.cli.main import main as fmu_fit
from fitting.fmu.findings import Severity
from fitting.inference.values import ParameterResult
from fitting.result.result import read_result
from fitting.text.errors import BadInput
from tests.support.cfmu_build import build_c_fmu, build_lag_fmu, build_reference_fmu, reworded

STIFFNESS, DAMPING, MASS, GAIN = 4100.0, 0.2, 1e-3, 0.37
TIMEOUT_S = 3.0
LOCALS = {'causality="output"': 'causality="local"'}
REFERENCE = ("Dahlquist", "VanDerPol", "BouncingBall", "Feedthrough", "Stair")
FIXED = {"<CoSimulation ": '<CoSimulation fixedInternalStepSize="1e-5" '}


class Quirk(NamedTuple):
    """A kind of FMU; ``build`` makes it in a folder, ``fits``: it is one that can be fitted."""

    kind: str
    build: Callable[[Path], Path]
    fits: bool


def oscillator(
    kind: str, *, fits: bool = True, words: Mapping[str, str] | None = None, **how: object
) -> Quirk:
    """The oscillator with a quirk."""

    def build(folder: Path) -> Path:
        made = build_c_fmu(folder, **how)  # type: ignore[arg-type]
        return reworded(made, words) if words else made

    return Quirk(kind, build, fits)


def quirks(folder: Path) -> list[Quirk]:
    """All kinds that are made here."""
    never = {"marks": {"HANGS_WHEN_FREED": folder / "hung"}}
    return [
        oscillator("none, FMI 2.0"),
        oscillator("none, FMI 3.0", fmi=3),
        oscillator("reset does nothing", reset="RESET_DOES_NOTHING"),
        oscillator("reset keeps derived values", reset="RESET_KEEPS_DERIVED"),
        oscillator("reset keeps parameters", reset="RESET_KEEPS_PARAMETERS"),
        oscillator("reset freezes the output", reset="RESET_FREEZES_OUTPUT"),
        oscillator("reset fails, and says so", reset="RESET_FAILS"),
        oscillator("reset crashes", reset="RESET_CRASHES"),
        oscillator("reset hangs", reset="RESET_HANGS"),
        oscillator("once per process", once=True),
        oscillator("locals only", words=LOCALS),
        oscillator("a step of its own, told", fmi=3, words=FIXED, marks={"OWN_STEP": 1e-5}),
        oscillator("a step of its own, not told", fits=False, marks={"OWN_STEP": 3e-4}),
        oscillator("noise of 1e-5", fits=False, marks={"NOISE": 1e-5}),
        oscillator("noise that grows", fits=False, marks={"NOISE": 1e-6, "GROWTH": 1e3}),
        oscillator("crashes when freed", fits=False, marks={"CRASHES_WHEN_FREED": 1.0}),
        oscillator("hangs when freed", fits=False, **never),  # type: ignore[arg-type]
        Quirk("a lag, no resonance", build_lag_fmu, fits=False),
        Quirk("feed-through", fed_through, fits=False),
        *(Quirk(f"Reference FMU {name}", reference(name), fits=False) for name in REFERENCE),
    ]


def reference(name: str) -> Callable[[Path], Path]:
    """What builds a Reference FMU."""
    return lambda folder: build_reference_fmu(folder, name)


def fed_through(folder: Path) -> Path:
    """The lag whose output sees half of its input at once."""
    before = 'name="through" valueReference="2" causality="parameter" variability="fixed" '
    start = 'initial="exact"><Real start="{}"/>'
    words = {before + start.format(0): before + start.format(0.5)}
    return reworded(build_lag_fmu(folder), words)


def verdict(path: Path) -> str:
    """What is found beside broken rules, shortened."""
    try:
        found = ff.check(ff.Fmu(path, 1, TIMEOUT_S))
    except BadInput as error:
        return f"refused: {str(error).split(': ', 1)[-1]}"
    tried = found.examination
    said = [f.sentence for f in found.findings if f.severity is not Severity.COSMETIC]
    if found.failure is not None:
        said = [found.failure.message]
    if tried.resets is not None and "new instance" in tried.resets.reuse:
        said.append("every run has a new instance")
    through = [effect.name for effect in tried.effects if effect.at_once]
    if through:
        said.append(f"direct feed-through of {', '.join(through)}")
    return "; ".join(said) or "sound"


def fitted(path: Path, folder: Path) -> str:
    """Exit codes of `init` and `reconstruct`, and how far the values are from the truth."""
    f_hz = np.linspace(286.0, 358.0, 13)
    w = 2.0 * np.pi * f_hz
    volt = GAIN / np.abs(STIFFNESS - MASS * w**2 + 1j * DAMPING * w)
    volt *= 1.0 + 1e-3 * np.random.default_rng(1).standard_normal(f_hz.size)
    rows = "".join(f"{f},{v}\n" for f, v in zip(f_hz.tolist(), volt.tolist(), strict=True))
    (folder / "sweep.csv").write_text("frequency (Hz),R (V)\n" + rows)
    code, out = quietly("init", str(path), str(folder / "sweep.csv"), "--out", str(folder), "--yes")
    if code:
        return f"| {code} | | {out} | |"
    words = [str(folder / "campaign.toml"), "--out", str(folder / "out")]
    ended, out = quietly("reconstruct", *words, "--no-profiles", "--no-report", "--workers", "1")
    if ended not in (0, 1, 4):
        return f"| 0 | {ended} | {out} | |"
    if not (folder / "out" / "result.json").exists():
        return f"| 0 | {ended} | {out or 'no result'} | |"
    values = read_result(folder / "out" / "result.json").parameters
    truth = {"stiffness": STIFFNESS, "damping": DAMPING}
    cells = " | ".join(off(values[name], true) for name, true in truth.items())
    return f"| 0 | {ended} | {cells} |"


def off(found: ParameterResult, true: float) -> str:
    """How far a value is from the truth, in its standard errors."""
    if found.std is None or not found.std > 0.0:
        return "not told"
    return f"{(found.value - true) / found.std:+.1f}"


def quietly(*words: str) -> tuple[int, str]:
    """Exit code of a command, and its complaint."""
    with (
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()) as err,
    ):
        code = fmu_fit(list(words))
    said = [line for line in err.getvalue().splitlines() if line.startswith("fmu-fit: ")]
    return code, " ".join(said).replace("|", "/")


def built(kinds: list[Quirk], root: Path) -> Iterator[tuple[Quirk, Path, Path]]:
    """Every kind with its FMU and a folder of its own."""
    for number, quirk in enumerate(kinds):
        folder = root / str(number)
        folder.mkdir()
        yield quirk, quirk.build(folder), folder


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, help="further FMUs for the first table")
    parser.add_argument("--no-fits", action="store_true", help="the first table alone")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        root = Path(made)
        kinds = list(built(quirks(root), root))
        print("| FMU | what `check` finds |\n|---|---|")
        for quirk, path, _ in kinds:
            print(f"| {quirk.kind} | {shortened(verdict(path), path)} |", flush=True)
        for path in sorted(args.folder.glob("*.fmu")) if args.folder else ():
            print(f"| {path.stem} | {shortened(verdict(path), path)} |", flush=True)
        if args.no_fits:
            return
        print("\n| FMU | init | reconstruct | k off by, in σ | c off by, in σ |")
        print("|---|---|---|---|---|")
        for quirk, path, folder in kinds:
            if quirk.fits:
                print(f"| {quirk.kind} {fitted(path, folder)}", flush=True)


def shortened(text: str, path: Path) -> str:
    """A cell of the table."""
    return text.replace(f"{path}: ", "").replace(str(path.parent), "…").replace("|", "/")


if __name__ == "__main__":
    main()
