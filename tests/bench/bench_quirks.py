"""FMUs of others: what a doctor finds of each quirk, and whether a first campaign of `init` runs.

    python -m tests.bench.bench_quirks [--folder FMUS] [--no-fits] [--coverage N [--only WORD]]

The first table has one FMU in C for every quirk (``tests/support/cfmus``), Reference FMUs of the
Modelica Association, and those of a folder: what `ff.check` finds beside cosmetic things; of the
oscillators as well what plans promise of an amplitude, and the largest error over its promise.

The second one has those that oscillate: a sweep in closed form, 1/|k - m w^2 + i c w| with a gain,
0.1 % of noise and k = 4100 N/m, c = 0.2 N.s/m, is written to a file, `fmu-fit init` makes a
campaign of it and the FMU, `fmu-fit reconstruct` fits it unedited, without profiles.

With --coverage there is a table of its own: laboratories whose truth, noise (0.1 to 1 %) and start
values are drawn, measured by closed forms, and how often intervals of 95 % hold the truth.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import math
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

import fitting as ff
from fitting.check.findings import Severity
from fitting.cli.main import main as fmu_fit
from fitting.result.result import read_result
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.estimate import FittedEstimate
from tests.support.cfmu_build import (
    build_c_fmu,
    build_lag_fmu,
    build_matrix_fmu,
    build_own_step_fmu,
    build_reference_fmu,
    reworded,
)
from tests.support.own_step import phasor

QUICK = ff.Tikhonov(nu=1e-6, levels=1, misfit="squares")
STIFFNESS, DAMPING, MASS, GAIN = 4100.0, 0.2, 1e-3, 0.37
TIMEOUT_S = 3.0
LOCALS = {'causality="output"': 'causality="local"'}
REFERENCE = ("Dahlquist", "VanDerPol", "BouncingBall", "Feedthrough", "Stair")
STEPPING = {
    "LOSES_TIME": "forgets what is shorter than its step",
    "REFUSES": "refuses other steps than whole ones",
    "UNEVEN": "steps of many lengths",
    "FOLLOWS": "one step of its solver in each communication step",
}
FIXED = {"<CoSimulation ": '<CoSimulation fixedInternalStepSize="1e-5" '}


class Quirk(NamedTuple):
    """A kind of FMU; ``build`` makes it in a folder.

    ``fits``: it can be fitted; ``driven``: it is the oscillator, whose amplitudes are known.
    """

    kind: str
    build: Callable[[Path], Path]
    fits: bool
    driven: bool = False


def oscillator(
    kind: str, *, fits: bool = True, words: Mapping[str, str] | None = None, **how: object
) -> Quirk:
    """The oscillator with a quirk."""

    def build(folder: Path) -> Path:
        made = build_c_fmu(folder, **how)  # type: ignore[arg-type]
        return reworded(made, words) if words else made

    return Quirk(kind, build, fits, driven="when freed" not in kind)


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
        Quirk("values in arrays", build_matrix_fmu, fits=False),
        *(Quirk(said, stepping(kind), fits=False) for kind, said in STEPPING.items()),
        *(Quirk(f"Reference FMU {name}", reference(name), fits=False) for name in REFERENCE),
    ]


def stepping(kind: str) -> Callable[[Path], Path]:
    """What builds the oscillator of own_step.h."""
    return lambda folder: build_own_step_fmu(folder, kind)


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
    elif tried.resets is not None:
        said += [f"{name} does nothing" for name in tried.resets.idle]
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


def off(found: FittedEstimate, true: float) -> str:
    """How far a value is from the truth, in its standard errors."""
    if found.std is None or not found.std > 0.0:
        return "not told"
    return f"{(found.value - true) / found.std:+.1f}"


def kept(path: Path) -> str:
    """Promises of plans at three accuracies, and the largest error over its promise: 1 at most."""
    worst, promised = 0.0, []
    with ff.Fmu(path, 1) as fmu:
        for f, wanted in ((310.0, None), (320.0, 1e-4), (400.0, 1e-3)):
            w = 2.0 * math.pi * f
            true = 1.0 / abs(complex(4e3 - 1e-3 * w * w, 0.2 * w))
            plan = fmu.plan(
                {"damping": 0.2},
                tones=[f],
                drive=ff.Drive(input="force", samples_per_period=28),
                outputs="displacement",
                accuracy=wanted,
            )
            off_by = abs(float(plan.amplitudes[0][0, 0]) / true - 1.0)
            worst = max(worst, off_by / plan.promised)
            promised.append(f"{plan.promised:.0e}")
    return f"{', '.join(promised)} | {worst:.2g}"


class Sample(NamedTuple):
    """A laboratory: its true values, and how the FMU is driven and fitted to what was measured."""

    truth: dict[str, float]
    drive: ff.Drive
    output: str
    line_width_hz: float | None
    f_hz: FloatArray
    volt: FloatArray
    parameters: tuple[ff.Parameter, ...]
    held: Mapping[str, float]


Laboratory = Callable[[np.random.Generator], Sample]


def resonance(rng: np.random.Generator) -> Sample:
    """1/|k - m w^2 + i c w| through the line, k and c drawn, Q of 3 to 7."""
    k, c = rng.uniform(3700.0, 4300.0), rng.uniform(0.3, 0.6)
    width = c / (2.0 * math.pi * MASS)
    f = math.sqrt(k / MASS) / (2.0 * math.pi) + width * np.linspace(-1.1, 1.1, 13)
    w = 2.0 * np.pi * f
    return Sample(
        truth={"stiffness": k, "damping": c},
        drive=ff.Drive(input="force", samples_per_period=28),
        output="displacement",
        line_width_hz=width,
        f_hz=f,
        volt=1.0 / np.abs(k - MASS * w**2 + 1j * c * w),
        parameters=(
            ff.Parameter("stiffness", rng.uniform(3700, 4300), bounds=(3e3, 5e3), unit="N/m"),
            ff.Parameter("damping", rng.uniform(0.3, 0.6), bounds=(0.2, 1.0), unit="N.s/m"),
        ),
        held={},
    )


def stepped(rng: np.random.Generator) -> Sample:
    """The oscillator of own_step.h with steps of 1 ms, by its difference equation."""
    f0, width = rng.uniform(30.0, 32.0), rng.uniform(2.0, 5.0)
    f = np.arange(25.0, 37.1, 1.0)
    return Sample(
        truth={"eigenfrequency": f0, "line_width": width},
        drive=ff.Drive(frequency_names=("tone",), amplitude_names=("level",)),
        output="displacement",
        line_width_hz=width,
        f_hz=f,
        volt=np.array([abs(phasor(x, 1e-3, f0, width)) for x in f.tolist()]),
        parameters=(
            ff.Parameter("eigenfrequency", rng.uniform(30, 32), bounds=(28.0, 34.0), unit="Hz"),
            ff.Parameter("line_width", rng.uniform(2.0, 5.0), bounds=(1.0, 12.0), unit="Hz"),
        ),
        held={},
    )


def through(rng: np.random.Generator) -> Sample:
    """|1/(1 + i w tau) + p|: a lag of which the output sees a part p of the input at once."""
    tau, share = rng.uniform(1e-3, 4e-3), rng.uniform(0.3, 1.0)
    f = np.geomspace(20.0, 300.0, 9)
    return Sample(
        truth={"tau": tau, "through": share},
        # coarse, so that a hundred are cheap: what the plan cannot exclude widens the intervals
        drive=ff.Drive(input="u", samples_per_period=40),
        output="y",
        line_width_hz=None,
        f_hz=f,
        volt=np.abs(1.0 / (1.0 + 2j * np.pi * f * tau) + share),
        parameters=(
            ff.Parameter("tau", rng.uniform(1e-3, 4e-3), bounds=(5e-4, 8e-3), unit="s"),
            ff.Parameter("through", rng.uniform(0.3, 1.0), bounds=(0.0, 2.0), unit=""),
        ),
        held={},
    )


#: FMUs of the table whose values are recovered, with their laboratories.
COVERED: Mapping[str, tuple[Callable[[Path], Path], Laboratory]] = {
    "a step of its own, not told": (build_own_step_fmu, stepped),
    "reset keeps derived values": (
        lambda d: build_c_fmu(d, reset="RESET_KEEPS_DERIVED"),
        resonance,
    ),
    "noise of 1e-5": (lambda d: build_c_fmu(d, marks={"NOISE": 1e-5}), resonance),
    "noise that grows": (
        lambda d: build_c_fmu(d, marks={"NOISE": 1e-6, "GROWTH": 1e3}),
        resonance,
    ),
    "once per process": (lambda d: build_c_fmu(d, once=True), resonance),
    "feed-through": (build_lag_fmu, through),
}


def coverage(kind: str, count: int) -> Iterator[str]:
    """Rows: how often intervals hold the truth, and the rms of deviations over errors."""
    build, laboratory = COVERED[kind]
    held: dict[str, list[bool]] = {}
    pulls: dict[str, list[float]] = {}
    unfinished = 0
    with tempfile.TemporaryDirectory() as folder, ff.Fmu(build(Path(folder)), 1) as fmu:
        for seed in range(count):
            fit, truth = one_fit(fmu, laboratory, seed)
            unfinished += not fit.success
            for name, true in truth.items():
                low, high = fit[name].interval(0.95)
                held.setdefault(name, []).append(bool(low <= true <= high))
                pulls.setdefault(name, []).append((fit[name].value - true) / fit[name].std)
    for name, inside in held.items():
        rms = float(np.sqrt(np.mean(np.square(pulls[name]))))
        yield f"| {kind} | {name} | {sum(inside)} of {count} | {rms:.2f} | {unfinished} |"


def one_fit(fmu: ff.Fmu, laboratory: Laboratory, seed: int) -> tuple[ff.Fit, dict[str, float]]:
    """The fit of a laboratory, and its truth."""
    rng = np.random.default_rng(seed)
    sample = laboratory(rng)
    noise = float(10.0 ** rng.uniform(-3.0, -2.0))
    volt = GAIN * sample.volt * (1.0 + noise * rng.standard_normal(sample.volt.size))
    setup = ff.Setup(
        sample.drive,
        sample.output,
        line_width_hz=sample.line_width_hz,
        accuracy=max(0.03 * noise, 1e-4),
    )
    sweep = ff.Sweep(setup, sample.f_hz, volt, scale="fit")
    problem = ff.Problem(fmu, sample.parameters, [sweep], noise=ff.Noise(relative=noise))
    return ff.fit(problem, QUICK, starts=1), sample.truth


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
    parser.add_argument("--coverage", type=int, metavar="N", help="N laboratories instead")
    parser.add_argument("--only", default="", metavar="WORD", help="of the FMUs with this word")
    args = parser.parse_args()
    if args.coverage:
        print(
            "| FMU | value | 95 % intervals with the truth | rms of deviation over error |", end=""
        )
        print(" not converged |\n|---|---|---|---|---|")
        for kind in COVERED:
            if args.only in kind:
                print(*coverage(kind, args.coverage), sep="\n", flush=True)
        return
    with tempfile.TemporaryDirectory() as made:
        root = Path(made)
        kinds = list(built(quirks(root), root))
        print("| FMU | what `check` finds | promised | error over promise |\n|---|---|---|---|")
        for quirk, path, _ in kinds:
            promise = kept(path) if quirk.driven else "|"
            print(f"| {quirk.kind} | {shortened(verdict(path), path)} | {promise} |", flush=True)
        for path in sorted(args.folder.glob("*.fmu")) if args.folder else ():
            print(f"| {path.stem} | {shortened(verdict(path), path)} | | |", flush=True)
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
