"""Every benchmark of this folder: what it measures, and with which settings it is run."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PYTHON = sys.executable


@dataclass(frozen=True)
class Command:
    """One benchmark: ``python -m tests.bench.bench_NAME``.

    Args:
        name: of its file, without "bench_".
        what: it measures.
        full: settings of the runs whose results are published, each a run of its own; those that
            the documentation names are among them.
        smoke: the smallest settings that go through all of it.
        quick: whether that takes less than 10 s of wall time on an idle machine.
        before: commands that make what it reads, run first, in the same folder; "python" is this
            one, "ROOT" the checkout.
    """

    name: str
    what: str
    full: tuple[str, ...] = ("",)
    smoke: str = ""
    quick: bool = False
    before: tuple[str, ...] = ()

    @property
    def module(self) -> str:
        """What ``python -m`` is given."""
        return f"tests.bench.bench_{self.name}"

    @property
    def preparation(self) -> list[list[str]]:
        """Commands that are run first."""
        texts = [text.replace("ROOT", shlex.quote(str(ROOT))) for text in self.before]
        return [[PYTHON, *shlex.split(text)[1:]] for text in texts]


COMMANDS = (
    Command("command", "time of a whole reconstruct", smoke="--rounds 1"),
    Command("coupled_rlc", "measured spectra of two coupled circuits by closed form", quick=True),
    Command(
        "coverage",
        "coverage of the intervals of two-tone series",
        full=(
            "--laboratories 200",
            "--laboratories 70 --setting sweep --seed 3",
        ),
        smoke="--laboratories 2 --setting sweep",
    ),
    Command(
        "crossing",
        "coverage of couplings from avoided crossings",
        smoke="--laboratories 1 --modes 2 --rising 1 --noise 0.3 --fmu 0",
    ),
    Command(
        "curve",
        "errors and savings of a sweep from few runs",
        full=("--before",),
        smoke="--scenes 4",
    ),
    Command("demodulated", "coverage of demodulated ringdowns", smoke="1 '1 modes' 1e+03"),
    Command(
        "design",
        "expected against found errors of proposed measurements",
        smoke="--laboratories 3 --number 2",
    ),
    Command("drafts", "campaigns of init for FMUs of others", smoke="--only 'locals only'"),
    Command("drift", "cost of an offset per experiment", smoke="--pairs 5", quick=True),
    Command("duffing", "cost and error of the solvers of DuffingOscillator"),
    Command(
        "ensemble",
        "cost of the engine of ensembles",
        full=("--laboratories 20 --change points=15 --value d1",),
        smoke="--laboratories 2 --change points=15 --no-profiles --calls 50",
    ),
    Command(
        "envelope_error",
        "errors of averaging against their bound",
        smoke="--scenes 8",
        quick=True,
    ),
    Command("extremes", "where the whole chain holds and where it stops", smoke="--smoke"),
    Command("faults", "faults of input survived", smoke="--each 60"),
    Command("fmu", "time per step of every solver", smoke="--steps 50 --rounds 1"),
    Command(
        "fmus",
        "what four commands make of FMUs of others, from records by plain fmpy",
        smoke="--only 'a lag'",
    ),
    Command(
        "hidden",
        "false statements about hidden laboratories, a third of them wrong",
        full=("--record hidden.jsonl",),
        smoke="--kind traces --only 1005 --workers 1",
    ),
    Command(
        "kills",
        "runs that survive being killed",
        full=("--tries 17",),
        smoke="--tries 1",
    ),
    Command(
        "laboratories",
        "false statements about virtual laboratories",
        full=("--laboratories 100 --first 20000 --widen 10 --record out.jsonl",),
        smoke="--kind pairs --laboratories 1 --widen 2",
    ),
    Command("lines", "coverage of lines of sweeps, and sweeps without one", ("20",), smoke="1"),
    Command("memory", "memory of fits of many samples", smoke="1x1000"),
    Command(
        "minima",
        "lowest minima found, beside differential evolution",
        full=("--campaigns 50",),
        smoke="--campaigns 1 --kind pairs",
    ),
    Command(
        "modes",
        "cost of CoupledModes",
        smoke="--modes 2 --steps 5",
        quick=True,
    ),
    Command(
        "misfit_rule", "false acceptances and refusals of a misfit", smoke="--drawn 60", quick=True
    ),
    Command(
        "mutants",
        "faults put into the code that tests notice",
        full=("--count 320 --longest 60 --most 40",),
        smoke="--count 20 --longest 10 --most 1 --tests tests/signal/test_rational.py",
    ),
    Command("nightly", "tests of which every run of the checks takes a sample", smoke="--smoke"),
    Command("noise", "coverage of noise spectra", smoke="2 10"),
    Command("noise_bias", "bias of the widths of noise spectra", smoke="4 10", quick=True),
    Command(
        "objective",
        "objective evaluations per second",
        smoke="--evaluations 40 --workers 1",
    ),
    Command("path", "the levels of Algorithm 2 beside a plain script", smoke="--rounds 1"),
    Command("peers", "the task that other programs were given"),
    Command("plans", "promises of plans for FMUs of others", smoke="--laboratories 1"),
    Command("platforms", "native FMUs on other platforms, bit for bit"),
    Command(
        "posterior",
        "ranks of the truth among draws",
        full=("--kind line --laboratories 100",),
        smoke="--kind line --laboratories 1",
    ),
    Command(
        "pumped",
        "coverage of pumped sweeps",
        full=("--by-fmu 0",),
        smoke="--laboratories 1 --by-fmu 0",
    ),
    Command(
        "pumped_error",
        "errors of pumped modes against what is declared",
        smoke="--smoke",
        quick=True,
    ),
    Command(
        "pumped_string",
        "lambda from pumped sweeps without the pump's depth",
        full=("", "--coupling 0.05 --laboratories 20", "--fisher"),
        smoke="--fisher",
    ),
    Command(
        "quirks",
        "what check and init make of FMUs of others",
        smoke="--coverage 1 --only 'reset keeps'",
    ),
    Command(
        "scaling",
        "cost of a fit as it grows",
        full=(
            "--only experiments",
            "--only points",
            "--only parameters --size 3 --size 10 --size 30 --size 100 --size 300 --size 1000",
            "--only pairs --size 20 --size 50 --size 200 --size 1000",
            "--only memory",
            "--only laboratories",
        ),
        smoke="--only points --size 101",
    ),
    Command(
        "scenes",
        "promises of `simulate` and `sweep` for random extreme scenes",
        smoke="--only 0 9 10",
    ),
    Command(
        "statements",
        "statements of the program that the tests run",
        smoke="tests/text/test_formula.py",
    ),
    Command("tests", "processor time of the tests", smoke="tests/text"),
    Command(
        "thousand",
        "an ensemble that is interrupted and loses a worker",
        full=("--fmu native/CoupledOscillator.fmu",),
        smoke="--laboratories 4 --fmu native/CoupledOscillator.fmu",
        before=("python ROOT/build_fmu.py --model CoupledOscillator --native --out native",),
    ),
    Command("traces", "coverage of traces", smoke="1"),
    Command(
        "tradeoff",
        "speed against accuracy of five campaigns, and the plan's choice",
        smoke="--only mass_spring --quick --no-fit",
    ),
    Command(
        "twin",
        "native twins beside the Python FMUs",
        full=(
            "",
            "--fit",
        ),
        smoke="--steps 20 --starts 2 --fit",
    ),
    Command("unequal", "noise that grows or is correlated", smoke="2", quick=True),
    Command(
        "vdc",
        "lambda from a map over V_DC and pumped sweeps",
        full=("", "--laboratories 5 --without-map"),
        smoke="--laboratories 1",
    ),
    Command(
        "ways",
        "kinds of measurements against what design expects of them",
        full=("out/ways",),
        smoke="out/ways --laboratories 2",
        before=(
            "python -m tests.bench.bench_ways --candidates out",
            "python -m fitting synthesize --series crossing --reference --seed 3 --out out/map",
            *(
                f"python -m fitting design out/map/campaign.toml --candidates out/{kind}.toml "
                f"--time 1min --out out/ways/{kind}"
                for kind in ("tones", "sweeps")
            ),
        ),
    ),
    Command("windows", "ranges about one of two lines", smoke="2", quick=True),
    Command("wiring", "coverage of notches and reflections", smoke="--laboratories 1"),
)
