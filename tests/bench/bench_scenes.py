"""Random scenes through `simulate` and `sweep`: is every promise kept, and does every scene settle?

    python -m tests.bench.bench_scenes [--scenes 300] [--seed 1] [--workers 1] [--only N ...]

Three FMUs in turn, every fourth round by `sweep`: one of two coupled modes, one of modes that are
coupled by their stiffness, and one with cubic terms; Q from 5 to 1e8, modes at 1 mHz to 1 THz,
amplitudes over 20 decades, equal modes, tones 1 ppm apart, without and with a requested accuracy.
The truth is a linear system at 50 digits, or harmonic balance. All scenes are damped, so each
command has to end with 0. Prints a Markdown table; exit code 1 if a promise is broken or a command
ends otherwise.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

import build_fmu
from fitting.cli.main import main as fmu_fit
from fitting.text.arrays import FloatArray
from tests.support import modes_reference, reference
from tests.support.envelope_scenes import Balance, NotComparable
from tests.support.envelope_scenes import Scene as BalanceScene

MODELS = ("CoupledOscillator", "CoupledModes2", "DuffingOscillator")
ACCURACIES = (None, 1e-2, 1e-4, 1e-6, 1e-9)
#: Those of the model with cubic terms, whose averaging leaves out about 1/Q of its shift.
NONLINEAR_ACCURACIES = (None, 1e-2, 1e-3, 1e-4)
POINTS = 11
#: Rounding of a tone's frequency, as a part of it: it counts Q times.
ROUNDING = 1e-15
#: Orders of the balance with two tones, points on the phase of each: the first that is enough.
ORDERS = ((13, 48), (21, 84))
#: Steps of the drive to its end; part of a promise up to which a last order is enough.
STEPS, ENOUGH = 4, 1e-3
#: Modes of the model with cubic terms lie no further apart: one at the third harmonic of the drive
#: is not averaged, and whole periods of a narrow line take longer than a run may.
MOST_APART = 2.4


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Start values of a model, and what is asked of it; `q` of the narrower mode."""

    number: int
    model: str
    values: dict[str, Any]
    q: float
    accuracy: float | None
    sweep: tuple[float, float] | None = None
    both: bool = False

    @property
    def outputs(self) -> tuple[str, ...]:
        """What is read: all modes of a drive, the first one of a sweep."""
        names = ("q1", "q2") if self.model == "CoupledModes2" else ("q1_hybrid", "q2_hybrid")
        return names if self.sweep is None else names[:1]

    def words(self, fmu: Path, out: Path) -> list[str]:
        """The command."""
        command = "simulate" if self.sweep is None else "sweep"
        words = [command, str(fmu), "--json", "--out", str(out), "--timeout", "1h"]
        if self.sweep is None:
            words += ["--outputs", ",".join(self.outputs)]
        else:
            low, high = self.sweep
            words += ["--from", f"{low!r} Hz", "--to", f"{high!r} Hz", "--points", str(POINTS)]
            words += ["--output", *self.outputs, *(["--direction", "both"] if self.both else [])]
        if self.accuracy is not None:
            words += ["--accuracy", repr(self.accuracy)]
        for name, value in self.values.items():
            if self.sweep is None or name not in ("u1", "u2", "A2"):
                words += ["--set", f"{name}={value if isinstance(value, bool) else repr(value)}"]
        return words


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How a command ended: exit code, what it promised, how far off it was, and its last words."""

    scene: Scene
    code: int
    promised: float = math.nan
    error: float = math.nan
    text: str = ""

    @property
    def kept(self) -> bool:
        """Whether the error is within what was promised, and what the truth is known to."""
        return self.error <= self.promised + ROUNDING * self.scene.q


def scene_of(seed: int, number: int) -> Scene:
    """A scene of a seed, by its number.

    Args:
        seed: of all scenes.
        number: 0 and up; models and commands come in turn.
    """
    rng, model = np.random.default_rng([seed, number]), MODELS[number % len(MODELS)]
    sweeps, cubic = number // len(MODELS) % 4 == 3, model == "DuffingOscillator"
    eta = float(10.0 ** rng.uniform(-3.0, 12.0))
    lowest, highest = math.log10(5.0), 8.0
    if cubic and sweeps:  # a sweep takes the model as it is: averaged where that leaves out nothing
        lowest = 6.0
    quality = [float(10.0**x) for x in rng.uniform(lowest, highest, 2)]
    width = eta / quality[0]
    other = eta * (1.0 + float(10.0 ** rng.uniform(-6.0, 0.3)))
    other = eta if rng.random() < 0.15 else other
    other = min(other, MOST_APART * eta) if cubic else other
    u1 = float(f"{eta + width * rng.uniform(-2.0, 2.0):.12g}")
    kind = rng.random()
    apart = 1e-6 * u1 if kind < 0.25 else width * 10.0 ** rng.uniform(-3.0, 1.0)
    # tones as people write them, and in every fifth scene as nobody does
    digits = 15 if number % 5 == 4 else 1 + math.ceil(math.log10(u1 / apart) + 1.0)
    u1, u2 = (float(f"{u:.{digits}g}") for u in (u1, u1 + apart))
    size, single = float(10.0 ** rng.uniform(-10.0, 10.0)), kind > 0.75 or sweeps
    drive: dict[str, Any] = {"u1": u1, "u2": u2, "A1": size}
    drive |= {"A2": 0.0 if single else size * float(rng.choice([1.0, 0.1]))}
    drive |= {
        "phase1": float(rng.uniform(-3.0, 3.0)),
        "g1": 1.0,
        "g2": float(rng.uniform(0.1, 1.0)),
    }
    values: dict[str, Any] = {"d1": width, "d2": other / quality[1], **drive}
    angle, reflection = float(rng.uniform(0.0, math.pi)), bool(rng.integers(2))
    if model == "CoupledModes2":
        coupling = eta * float(10.0 ** rng.uniform(-5.0, -0.3))
        values |= {"f1": eta, "f2": other, "lambda12": coupling}
    else:
        values |= {"eta_plus": eta, "eta_minus": other, "theta": angle, "reflection": reflection}
    if cubic:
        stiffness = (2.0 * math.pi * eta) ** 2
        level = float(10.0 ** rng.uniform(-3.0, -0.5 if single else -1.5))
        # d1 and d2 damp the modes that are coupled: what is driven is as wide as its share of each
        narrow = width * math.cos(angle) ** 2 + other / quality[1] * math.sin(angle) ** 2
        largest = size / stiffness * eta / narrow
        alpha = level * 8.0 / 3.0 * stiffness * narrow / eta / largest**2
        values |= {"reflection": False, "alpha1": float(rng.choice([1.0, -1.0])) * alpha}
        values |= {"alpha2": alpha, "kappa": float(rng.choice([0.0, 0.3])) * alpha}
    ends = tuple(
        float(f"{eta + k * width * (0.4 if width > 0.1 * eta else 2.0):.12g}") for k in (-1, 1)
    )
    return Scene(
        number=number,
        model=model,
        values=values,
        q=float(max(quality)),
        accuracy=(NONLINEAR_ACCURACIES if cubic else ACCURACIES)[
            int(rng.integers(4 if cubic else 5))
        ],
        sweep=(ends[0], ends[1]) if sweeps else None,
        both=bool(rng.integers(2)),
    )


def truth(scene: Scene, tones: dict[float, float], promised: float) -> FloatArray:
    """Amplitudes (tones, modes) of the steady response to tones (Hz) of these amplitudes.

    Args:
        scene: with the model's values.
        tones: amplitude of each by its frequency.
        promised: relative error that it is compared with.
    """
    values = scene.values
    if scene.model == "DuffingOscillator":
        for order, phases in ORDERS[:-1]:
            with suppress(NotComparable):
                return _balanced(values, tones, order, phases, promised)
        return _balanced(values, tones, *ORDERS[-1], promised)
    rows = []
    for u, a in tones.items():
        modes = scene.model == "CoupledModes2"
        p = SimpleNamespace(**values)
        x = modes_reference.phasors(values, u) if modes else reference.phasors(p, u)
        rows.append([float(a * abs(each)) for each in x])
    return np.array(rows)


def _balanced(
    values: dict[str, Any], tones: dict[float, float], order: int, phases: int, promised: float
) -> FloatArray:
    """By harmonic balance, from a weak drive to the whole one: the branch without a jump."""
    pairs, lines = list(tones.items()), None
    for step in range(1, STEPS + 1):
        driven = dict(values)
        for k, (u, a) in enumerate(pairs):
            driven |= {f"u{k + 1}": u, f"A{k + 1}": a * step / STEPS}
        one = BalanceScene(driven, beat=len(pairs) - 1)
        balance = Balance(one, order if len(pairs) > 1 else 7, phases)
        if lines is None:
            force = balance.force.T[..., np.newaxis]
            lines = np.linalg.solve(balance.linear, force)[..., 0].T
        lines = balance.solved(lines, max(1e-9, ENOUGH * min(promised, 1.0)))
    orders = list(map(balance.orders.index, [(1,)] if len(pairs) == 1 else [(1, 0), (0, 1)]))
    return np.asarray(np.abs(np.asarray(lines)[:, orders].T))


def outcome_of(scene: Scene, fmus: dict[str, Path]) -> Outcome:
    """Run the command of a scene, and compare what it hands over with the truth.

    Args:
        scene: to be run.
        fmus: of the models.
    """
    out, err = io.StringIO(), io.StringIO()
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(out), redirect_stderr(err):
        code = fmu_fit(scene.words(fmus[scene.model], Path(folder) / "out"))
    text = err.getvalue().strip().splitlines()[-1:]
    try:
        found = json.loads(out.getvalue())
    except ValueError:
        return Outcome(scene=scene, code=code, text=" ".join(text))
    promised = _number(found["accuracy"])
    if scene.sweep is not None:
        amplitudes = np.array([found["amplitude"][d] for d in found["amplitude"]])
        size = scene.values["A1"]
        exact = np.array([truth(scene, {f: size}, promised)[0, 0] for f in found["frequency_hz"]])
        error = float(np.max(np.abs(amplitudes - exact)) / np.max(exact))
    else:
        v, peaks = scene.values, [found["outputs"][n]["peaks"] for n in scene.outputs]
        tones = {v[f"u{k}"]: v[f"A{k}"] for k in (1, 2) if v[f"A{k}"]}
        seen = np.array([[p[name] for p in peaks] for name in found["tones_hz"]])
        error = float(np.max(np.abs(seen / truth(scene, tones, promised) - 1.0)))
    text = [] if code == 0 else found["plan"]["warnings"]
    return Outcome(scene=scene, code=code, promised=promised, error=error, text=" ".join(text))


def _number(value: Any) -> float:
    return math.inf if value is None else float(value)


def report(outcomes: Sequence[Outcome]) -> list[str]:
    """A Markdown table, a row for each model and command.

    Args:
        outcomes: of the scenes.
    """
    heads = (
        "FMU",
        "command",
        "scenes",
        "exit code 0",
        "promise kept",
        "largest error over promise",
    )
    lines = [f"| {' | '.join(heads)} |", "|---|---|---|---|---|---|"]
    for model in MODELS:
        for command in ("simulate", "sweep"):
            rows = [
                o
                for o in outcomes
                if o.scene.model == model and (o.scene.sweep is None) == (command == "simulate")
            ]
            if rows:
                ended, kept = sum(o.code == 0 for o in rows), sum(o.kept for o in rows)
                ratios = [o.error / o.promised for o in rows if o.promised > 0.0]
                largest = max((r for r in ratios if math.isfinite(r)), default=math.nan)
                cells = (model, f"`{command}`", len(rows), ended, kept, f"{largest:.2g}")
                lines.append(f"| {' | '.join(map(str, cells))} |")
    return lines


def main(words: Sequence[str] | None = None) -> int:
    """Run the scenes and print the table; 1 where a promise is broken or a command does not end.

    Args:
        words: of the command line, None: those of the process.
    """
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--only", type=int, nargs="+", metavar="N", help="numbers of scenes")
    args = parser.parse_args(words)
    outcomes = []
    with tempfile.TemporaryDirectory() as folder, ProcessPoolExecutor(args.workers) as pool:
        fmus = {model: build_fmu.build(model, Path(folder)) for model in MODELS}
        scenes = [scene_of(args.seed, k) for k in args.only or range(args.scenes)]
        for outcome in pool.map(partial(outcome_of, fmus=fmus), scenes):
            outcomes.append(outcome)
            print(f"\r{len(outcomes)} of {len(scenes)}", end="", file=sys.stderr, flush=True)
            if outcome.code or not outcome.kept:
                what = f"exit code {outcome.code}, promised {outcome.promised:.2g}"
                print(f"{outcome.scene}", file=sys.stderr)
                print(
                    f"  {what}, error {outcome.error:.2g}; {outcome.text}",
                    file=sys.stderr,
                    flush=True,
                )
    print(*report(outcomes), sep="\n")
    return int(any(outcome.code or not outcome.kept for outcome in outcomes))


if __name__ == "__main__":
    sys.exit(main())
