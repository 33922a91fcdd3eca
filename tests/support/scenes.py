"""Scenes for the accuracy tests: the corners the model must survive, and a seeded grid."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Scene:
    """Parameters of one run by the FMU's names, how it starts, how long it is and its input."""

    label: str
    theta: float = 1.9498
    reflection: bool = False
    d1: float = 120.0
    d2: float = 90.0
    eta_plus: float = 6.94e6
    eta_minus: float = 7.03e6
    u1: float = 6.94016e6
    u2: float = 6.94036e6
    A1: float = 1.0
    A2: float = 1.0
    phase1: float = 0.0
    phase2: float = 0.0
    g1: float = 1.0
    g2: float = 1.0
    periodic_start: bool = False
    step_s: float = 0.048713719328
    inputs: tuple[float, ...] = ()

    @property
    def parameters(self) -> dict[str, float | bool]:
        """Return the start values by the FMU's variable names."""
        names = (
            "theta reflection d1 d2 eta_plus eta_minus u1 u2 A1 A2 phase1 phase2 g1 g2 "
            "periodic_start"
        )
        return {name: getattr(self, name) for name in names.split()}


STRING = Scene("string")
ANGLES = (0.0, math.pi / 4, math.pi / 2, math.pi, 3 * math.pi / 4, -math.pi / 4, 2 * math.pi)


def corners() -> list[Scene]:
    """Return the scenes named one by one: symmetries, degeneracies, resonances, long times."""
    scenes = [
        replace(STRING, label=f"theta={angle:.4g} reflection={form}", theta=angle, reflection=form)
        for angle in ANGLES
        for form in (False, True)
    ]
    cases: dict[str, dict[str, Any]] = {
        "equal damping": {"d1": 100.0, "d2": 100.0},
        "d1 far above d2": {"d1": 1e5, "d2": 1e-1},
        "d1 = 0": {"d1": 0.0},
        "undamped, off resonance": {"d1": 0.0, "d2": 0.0},
        "undamped, 1e4 s": {"d1": 0.0, "d2": 0.0, "step_s": 4871.3719328471},
        "undamped, 1 mHz off": {"d1": 0.0, "d2": 0.0, "u1": 6.94e6 + 1e-3, "step_s": 0.00987137},
        "equal tones": {"u1": 6.94026e6, "u2": 6.94026e6},
        "tones 1 mHz apart": {"u1": 7e6, "u2": 7e6 + 1e-3, "step_s": 98.713719328},
        "on resonance": {"u1": 6.94e6, "u2": 7.03e6},
        "far off resonance": {"u1": 1e3, "u2": 5e9},
        "no frequency": {"u1": 0.0, "u2": 0.0},
        "degenerate modes": {"eta_minus": 6.94e6},
        "degenerate modes, equal damping": {"eta_minus": 6.94e6, "d1": 100.0, "d2": 100.0},
        "degenerate modes, driven on resonance": {"eta_minus": 6.94e6, "u1": 6.94e6},
        "modes apart by 1e-12": {"eta_minus": 6.94e6 * (1.0 + 1e-12)},
        "one mode a thousand times higher": {"eta_minus": 6.94e9},
        "exceptional point": {
            "theta": math.pi / 4,
            "eta_minus": 6.94005e6,
            "d1": 150.0,
            "d2": 50.0,
        },
        "exceptional point, on it": {
            "theta": math.pi / 4,
            "eta_minus": 6.94005e6,
            "d1": 150.0,
            "d2": 50.0,
            "u1": 6.940025e6,
            "u2": 6.94e6,
        },
        "one mode driven": {"g2": 0.0},
        "drive without gain on mode 1": {"g1": 0.0},
        "drive of opposite gains": {"g1": 1.0, "g2": -1.0},
        "one tone, shifted phase": {"A2": 0.0, "phase1": 1.2345},
        "1e4 s": {"step_s": 4871.3719328471},
        "10 GHz, 1e4 s, Q = 1e8": {
            "eta_plus": 1e10,
            "eta_minus": 1.01e10,
            "d1": 100.0,
            "d2": 120.0,
            "u1": 1e10 + 30.0,
            "u2": 1e10 - 30.0,
            "step_s": 4871.3719328471,
        },
        "10 GHz, Q = 1e8, transient alive": {
            "eta_plus": 1e10,
            "eta_minus": 1.01e10,
            "d1": 100.0,
            "d2": 120.0,
            "u1": 1e10 + 30.0,
            "u2": 1e10 - 30.0,
            "step_s": 1.98713719328e-3,
        },
        "1 Hz, Q = 5": {
            "eta_plus": 1.0,
            "eta_minus": 1.5,
            "d1": 0.2,
            "d2": 0.3,
            "u1": 0.9,
            "u2": 1.1,
            "step_s": 1.7,
        },
        "1 Hz, Q = 1e8": {
            "eta_plus": 1.0,
            "eta_minus": 1.5,
            "d1": 1e-8,
            "d2": 1.5e-8,
            "u1": 1.0,
            "u2": 1.1,
            "step_s": 9.8713719328,
        },
        "a tenth of a period": {"step_s": 7.1e-9},
        "negative damping": {"d1": -20.0, "d2": 10.0, "step_s": 0.0098713719328},
    }
    scenes += [replace(STRING, label=label, **changes) for label, changes in cases.items()]
    scenes += [
        replace(scene, label=f"{scene.label}, periodic start", periodic_start=True)
        for scene in scenes
        if scene.d1 > 0.0 and scene.d2 > 0.0
    ]
    return scenes


def grid(count: int, seed: int) -> list[Scene]:
    """Return random scenes: Q 5 to 1e8, eta 1 Hz to 10 GHz, eta ratio 1 to 1e3, all angles."""
    rng = np.random.default_rng(seed)
    scenes = []
    for k in range(count):
        eta = 10.0 ** rng.uniform(0.0, 10.0)
        ratio = (1.0, 1.0 + 1e-12, 1.0 + 10 ** rng.uniform(-9, -1), 10 ** rng.uniform(0, 3))[k % 4]
        q1, q2 = 10.0 ** rng.uniform(np.log10(5.0), 8.0, 2)
        d1, d2 = eta / q1, eta / q2
        if k % 5 == 1:
            d2 = d1
        if k % 7 == 2:
            d1 = 0.0
        theta = rng.choice(ANGLES) if k % 3 == 0 else rng.uniform(-2 * math.pi, 2 * math.pi)
        width = max(d1, d2)
        # a degenerate undamped pair has no steady state on resonance
        on_resonance = 0.0 if d1 else 0.1
        u1 = abs(eta + width * rng.choice([on_resonance, 1.0, -0.5, 30.0]))
        u1 = u1 if k % 6 else eta * 0.3
        u2 = u1 if k % 11 == 3 else abs(eta * ratio + width * rng.uniform(-2.0, 2.0))
        span = rng.choice([1.0 / eta, 0.1 / width, 1.0 / width, 5.0 / width, 4871.3719328471])
        span *= 0.8713719328  # no common node of the beats at the times compared
        scenes.append(
            Scene(
                f"grid {k}",
                theta=float(theta),
                reflection=bool(rng.integers(2)),
                d1=d1,
                d2=d2,
                eta_plus=eta,
                eta_minus=eta * ratio,
                u1=u1,
                u2=u2,
                A1=float(10 ** rng.uniform(-3, 3)),
                A2=float(rng.choice([0.0, 1.0, 2.5])),
                phase1=float(rng.uniform(-3, 3)),
                phase2=float(rng.uniform(-3, 3)),
                g2=float(rng.choice([1.0, 0.3, -1.0, 0.0])),
                periodic_start=bool(k % 2 and d1 > 0.0),
                step_s=float(span),
            )
        )
    return scenes


def held_input(count: int, seed: int) -> list[Scene]:
    """Return scenes with an input that changes at every step, with and without tones."""
    rng = np.random.default_rng(seed)
    return [
        replace(
            STRING,
            label=f"held input {k}",
            A1=float(k % 2),
            A2=float(k % 2),
            theta=float(rng.uniform(0, math.pi)),
            step_s=2.0 ** -float(rng.integers(12, 26)),
            inputs=tuple(float(b) for b in rng.normal(size=12)),
            periodic_start=bool(k % 4 == 3),
        )
        for k in range(count)
    ]
