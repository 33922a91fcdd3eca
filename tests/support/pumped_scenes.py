"""Scenes of pumped modes, and how far the FMU's outputs are from 50 digits beside what it declares.

The truth is a chain of sidebands in mpmath, so much longer than the FMU's that a longer one changes
nothing.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import mpmath as mp
import numpy as np

from fmu_src import coupled_modes
from tests.support import modes_reference as reference
from tests.support.modes_scenes import eigenfrequencies, scenes
from tests.support.slaves import Slave

KINDS = ("string", "resonance at -eta", "near a sum", "wide range", "soft and deep")
ENVELOPE = 1
#: A chain of the truth has as many more sidebands than the FMU's at first, and no more than MOST.
FURTHER, MOST = 12, 700
#: What is left of the carrier where a longer chain changes nothing.
SETTLED = mp.mpf(10) ** -30
#: Rounding of sums of lines in time, whose phases are doubles, over the sum of their amplitudes.
IN_TIME = 1e-13
Scene = dict[str, Any]


class NotComparable(Exception):
    """The FMU refuses the scene, or its truth is too long to be calculated here."""


@dataclass(frozen=True)
class Compared:
    """Of one scene: error over what is declared for every output, by its name.

    ``declared``: what the FMU declares for the read-out; ``asked``: what was asked for;
    ``sidebands``: in use.
    """

    kind: str
    solver: int
    ratios: dict[str, float]
    declared: float
    asked: float
    sidebands: int

    def exceeds(self, least: float) -> bool:
        """Whether more than the tolerance is declared, of solver 0.

        Args:
            least: tolerance from which on it counts.
        """
        return self.solver == 0 and self.asked >= least and self.declared > self.asked

    @property
    def worst(self) -> float:
        """The largest ratio; a bound is broken above 1."""
        return max(self.ratios.values())


# --- scenes --------------------------------------------------------------------------------------


def scene(seed: int) -> tuple[str, Scene]:
    """Return the kind of a scene and the start values that make it.

    Args:
        seed: of all that is drawn; kinds take turns.
    """
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    drawn = {
        "string": _string,
        "resonance at -eta": _mirrored,
        "near a sum": _near_a_sum,
        "wide range": _wide,
        "soft and deep": _soft,
    }[kind](rng)
    drawn |= {"pump_phase": float(rng.uniform(-3.0, 3.0)), "periodic_start": True}
    if rng.random() < 0.8:
        drawn["tolerance"] = float(10.0 ** rng.uniform(-14.0, -1.0))
    if rng.random() < 0.15:
        drawn["solver"] = ENVELOPE
    return kind, drawn


def _two(rng: np.random.Generator) -> tuple[Scene, float, float, float]:
    """Two hybridised modes like those of the string: the scene, both lines and a width in Hz."""
    theta = float(rng.uniform(1.6, 3.1))
    plus = 6.94026e6 * float(rng.uniform(0.9, 1.1))
    minus = plus + 8.734e4 * float(rng.uniform(0.2, 5.0))
    c, s = math.cos(theta), math.sin(theta)
    width = float(10.0 ** rng.uniform(0.5, 3.0))
    made = {
        "f1": math.hypot(c * plus, s * minus),
        "f2": math.hypot(s * plus, c * minus),
        "lambda12": math.sqrt(-s * c * (minus - plus) * (minus + plus)),
        "d1": width,
        "d2": width * float(rng.uniform(0.3, 3.0)),
        "g1": c + s,
        "g2": c - s,
        "readout1": c,
        "readout2": -s,
        "A1": 1.0,
        "A2": float(rng.integers(2)) * 0.7,
        "phase1": float(rng.uniform(-3.0, 3.0)),
        "phase2": float(rng.uniform(-3.0, 3.0)),
    }
    near = float(rng.choice([plus, minus]))
    made |= {f"u{k}": near + float(rng.uniform(-5.0, 5.0)) * width for k in (1, 2)}
    return made, plus, minus, width


def _depths(rng: np.random.Generator, made: Scene, depth: float) -> Scene:
    """A pump on the first mode alone, or on everything."""
    if rng.random() < 0.5:
        return {"depth_f1": depth}
    names = [name for name in made if name[0] == "f" or name.startswith("lambda")]
    return {f"depth_{name}": depth * float(rng.uniform(-1.0, 1.0)) for name in names}


def _string(rng: np.random.Generator) -> Scene:
    made, plus, minus, width = _two(rng)
    made["pump_hz"] = (minus - plus) / int(rng.integers(1, 4)) + float(rng.normal()) * width
    return made | _depths(rng, made, float(10.0 ** rng.uniform(-5.0, -2.2)))


def _mirrored(rng: np.random.Generator) -> Scene:
    """A sideband within some widths of minus an eigenfrequency."""
    made, plus, minus, width = _two(rng)
    line = float(rng.choice([plus, minus]))
    sum_hz = made["u1"] + line + float(rng.normal()) * width
    made["pump_hz"] = sum_hz / int(10.0 ** rng.uniform(0.8, 2.6))
    return made | _depths(rng, made, float(10.0 ** rng.uniform(-5.0, -2.2)))


def _near_a_sum(rng: np.random.Generator) -> Scene:
    """Parametric amplification: about as deep as twice the width over the frequency."""
    made, plus, minus, width = _two(rng)
    pair = rng.choice([plus, minus], 2)
    made["pump_hz"] = float(pair.sum()) / int(rng.integers(1, 4)) + float(rng.normal()) * width
    return made | _depths(rng, made, 2.0 * width / plus * float(10.0 ** rng.uniform(-2.0, 1.0)))


def _wide(rng: np.random.Generator) -> Scene:
    """1 to 4 modes from kHz to GHz, Q from 10 to 1e8, degenerate, uncoupled, drives far away."""
    n = int(rng.integers(1, 5))
    made = scenes(n, 5, int(rng.integers(1 << 31)))[int(rng.integers(5))]
    eta = eigenfrequencies(made)
    depth = float(10.0 ** rng.uniform(-7.0, -1.5))
    slow = 0.1 * eta[0] * depth + 0.01 * eta[0]
    between = abs(float(eta[-1] - eta[0]))
    fast = float(eta[0] * 10.0 ** rng.uniform(-1.5, 0.5))
    made["pump_hz"] = float(max(between, slow)) if rng.random() < 0.4 else fast
    return made | _depths(rng, made, depth)


def _soft(rng: np.random.Generator) -> Scene:
    """1 to 3 modes about 1 Hz, Q from 3 to 300, pumped deeply, at any frequency."""
    n = int(rng.integers(1, 4))
    made: Scene = {f"f{i + 1}": float(rng.uniform(0.8, 1.5)) for i in range(n)}
    for i, j in itertools.combinations(range(n), 2):
        made[f"lambda{i + 1}{j + 1}"] = float(rng.uniform(0.0, 0.45))
    for i in range(1, n + 1):
        made[f"d{i}"] = float(10.0 ** rng.uniform(-2.5, -0.5))
        made[f"g{i}"], made[f"readout{i}"] = map(float, rng.uniform(-1.0, 1.0, 2))
    made |= {"A1": 1.0, "A2": 0.6, "phase1": 0.3, "phase2": -1.0}
    made |= {f"u{k}": float(rng.uniform(0.0, 3.0)) for k in (1, 2)}
    made["pump_hz"] = float(10.0 ** rng.uniform(-1.7, 0.6))
    return made | _depths(rng, made, float(10.0 ** rng.uniform(-2.5, -0.3)))


# --- the comparison ------------------------------------------------------------------------------


def compared(seed: int) -> Compared:
    """Return how far the outputs of a scene are from the truth beside what the FMU declares.

    Amplitudes of read-out and modes at both tones, of the read-out's first sidebands, of all
    sidebands together, and what moves in time, each in the terms of its declared error.

    Args:
        seed: of the scene.

    Raises:
        NotComparable: there is nothing to compare.
    """
    kind, values = scene(seed)
    n = reference.count(values)
    slave = Slave(getattr(coupled_modes, f"CoupledModes{n}"), **values)
    if slave.message:
        raise NotComparable(slave.message)
    used = int(slave.get("pump_sidebands")[0])
    truths = {tone: _truth(values, tone, used) for tone in (1, 2) if values[f"A{tone}"]}
    if not truths:
        raise NotComparable("no tone")
    names = ("readout", *(f"q{i + 1}" for i in range(n)))
    declared = dict(zip(names, slave.get(*(f"{name}_error" for name in names)), strict=True))
    with mp.workdps(reference.DIGITS):
        seen = {
            tone: {k: _seen(values, x) for k, x in found.items()} for tone, found in truths.items()
        }
        ratios = _amplitudes(slave, seen, names, declared)
        if values.get("solver") != ENVELOPE:
            ratios |= _first_sidebands(slave, seen, declared["readout"])
            ratios |= _moving(slave, seen, names, declared)
            ratios |= _all_sidebands(slave, values, truths)
    return Compared(
        kind,
        values.get("solver", 0),
        ratios,
        declared["readout"],
        values.get("tolerance", 1e-14),
        used,
    )


def _truth(values: Scene, tone: int, used: int) -> dict[int, list[Any]]:
    """The sidebands under a tone of its amplitude, from a chain that is long enough."""
    u, reach = values[f"u{tone}"], used + FURTHER
    with mp.workdps(reference.DIGITS):
        amplitude = mp.mpf(values[f"A{tone}"]) * mp.expj(mp.mpf(values[f"phase{tone}"]))
        before: dict[int, list[Any]] | None = None
        while reach <= MOST:
            found = reference.long_sidebands(values, u, reach, values["pump_phase"])
            if before is not None and _largest_change(before, found) <= SETTLED:
                return {k: [amplitude * z for z in x] for k, x in found.items()}
            before, reach = found, reach + reach // 2
    raise NotComparable(f"more than {MOST} sidebands")


def _largest_change(before: dict[int, list[Any]], found: dict[int, list[Any]]) -> Any:
    """Of any sideband, relative to the carrier."""
    changes = [mp.norm(mp.matrix(found[k]) - mp.matrix(x)) for k, x in before.items()]
    return max(changes) / mp.norm(found[0])


def _seen(values: Scene, x: list[Any]) -> list[Any]:
    """A sideband of read-out and modes."""
    weights = [values.get(f"readout{i + 1}", 1.0 if i == 0 else 0.0) for i in range(len(x))]
    return [mp.fsum(mp.mpf(w) * z for w, z in zip(weights, x, strict=True)), *x]


def _over(error: Any, bound: Any) -> float:
    return float(error / bound) if bound else (math.inf if error else 0.0)


def _amplitudes(
    slave: Slave, seen: dict[int, Any], names: tuple[str, ...], declared: dict[str, float]
) -> dict[str, float]:
    ratios = {}
    for tone, lines in seen.items():
        for i, name in enumerate(names):
            found = mp.mpc(*slave.get(f"{name}_X_u{tone}", f"{name}_Y_u{tone}"))
            bound = declared[name] * abs(lines[0][i])
            ratios[f"{name} at u{tone}"] = _over(abs(found - lines[0][i]), bound)
    return ratios


def _first_sidebands(slave: Slave, seen: dict[int, Any], declared: float) -> dict[str, float]:
    """Of the read-out, relative to its amplitude at the tone."""
    ratios = {}
    for tone, lines in seen.items():
        for k, side in ((1, "upper"), (-1, "lower")):
            parts = [f"readout_{part}_u{tone}_{side}" for part in "XY"]
            error = abs(mp.mpc(*slave.get(*parts)) - lines[k][0])
            ratios[f"{side} at u{tone}"] = _over(error, declared * abs(lines[0][0]))
    return ratios


def _moving(
    slave: Slave, seen: dict[int, Any], names: tuple[str, ...], declared: dict[str, float]
) -> dict[str, float]:
    """At time 0, where no rounding of the time counts."""
    ratios = {}
    for i, name in enumerate(names):
        [found] = slave.get(name)
        truth = mp.fsum(mp.re(x[i]) for lines in seen.values() for x in lines.values())
        carriers = mp.fsum(abs(lines[0][i]) for lines in seen.values())
        size = mp.fsum(abs(x[i]) for lines in seen.values() for x in lines.values())
        ratios[name] = _over(abs(found - truth), declared[name] * carriers + IN_TIME * size)
    for tone, lines in seen.items():
        [found] = slave.get(f"readout_at_u{tone}")
        bound = (declared["readout"] + IN_TIME) * abs(lines[0][0])
        ratios[f"readout_at_u{tone}"] = _over(abs(found - mp.re(lines[0][0])), bound)
    return ratios


def _all_sidebands(
    slave: Slave, values: Scene, truths: dict[int, dict[int, list[Any]]]
) -> dict[str, float]:
    """The sum of all errors of a response, beside its own bound."""
    solver: Any = slave._slave.running()
    ratios = {}
    for tone, truth in truths.items():
        found = solver.response(values[f"u{tone}"])
        scale = (2 * mp.pi) ** 2 / (
            mp.mpf(values[f"A{tone}"]) * mp.expj(mp.mpf(values[f"phase{tone}"]))
        )
        total = mp.mpf(0)
        for k, x in truth.items():
            turn = scale * mp.expj(-k * mp.mpf(values["pump_phase"]))
            total += mp.norm([turn * z - y for z, y in zip(x, found.sideband(k), strict=True)])
        ratios[f"all sidebands of u{tone}"] = _over(total, found.bound)
    return ratios
