"""Scenes of the Duffing oscillator's FMU: every solver, branch and kind of nonlinearity."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

ONE = {"A1": 0.05, "A2": 0.0}
BOTH = {"A1": 0.02, "A2": 0.02}
LINEAR = {"alpha1": 0.0, "alpha2": 0.0, "kappa": 0.0}
ORBIT = {"periodic_start": True}
RK4 = {"solver": 2}

#: Start values, and what is changed on the way.
SCENES: Mapping[str, tuple[Mapping[str, Any], Mapping[str, Any]]] = {
    "from rest": ({}, {}),
    "one tone": (ONE, {"A1": 0.1}),
    "lower branch": (ONE | ORBIT, {"u1": 6.9403e6}),
    "upper branch": (ONE | ORBIT | {"branch": 1, "u1": 6.9404e6}, {}),
    "coupled by kappa": ({"kappa": 2e31, "A1": 0.1, "A2": 0.1}, {"kappa": -1e31}),
    "two tones on their orbit": (BOTH | ORBIT, {"theta": 1.2}),
    "two tones on one mode": (BOTH | ORBIT | {"theta": 0.0, "alpha2": 0.0}, {"d1": 200.0}),
    "softening": (ONE | ORBIT | {"alpha1": -1e32}, {"d1": 200.0}),
    "linear": (LINEAR | ORBIT, {"alpha1": 1e32}),
    "no drive": ({"A1": 0.0, "A2": 0.0}, {"A1": 0.1}),
    "a mode that follows, far above": (
        ONE | ORBIT | {"g2": 0.0, "eta_minus": 3e7, "A1": 0.3},
        {},
    ),
    "driven far above a mode": (
        ONE | ORBIT | {"eta_minus": 3e7, "u1": 3e7, "A1": 30.0, "kappa": 3e31},
        {},
    ),
    "exceptional point": (ONE | {"theta": 0.785398, "eta_minus": 6.9404e6, "d1": 150.0}, {}),
    "fine steps": (ONE | {"tolerance": 1e-11}, {}),
    "reflection": (ONE | {"reflection": True, "g2": -1.0}, {}),
    "rk4": (ONE | RK4, {"d1": 200.0, "b": 1.0}),
    "rk4 on an orbit": (ONE | RK4 | ORBIT, {}),
    "rk4 on the orbit of two": (BOTH | RK4 | ORBIT | {"tolerance": 1e-2}, {"u1": 6.9e6}),
    "rk4, linear": (LINEAR | RK4 | ORBIT, {}),
}
