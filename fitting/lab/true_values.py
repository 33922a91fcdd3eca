"""What is true of a virtual laboratory, by the names that the models give their values.

    lambda^2 = -1/2 sin 2 theta (eta-^2 - eta+^2)          Q = eta/width
    f1^2 = c^2 eta+^2 + s^2 eta-^2,  f2^2 = s^2 eta+^2 + c^2 eta-^2

Of a sample that drifts, means over the drives of its series, as a fit reports them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

from fitting.lab.names import CROSSING, PUMPED, SUBHARMONIC, VOLTAGE, WIRED
from fitting.lab.string import TwoModes

#: Parameters that no drift moves, and values that follow from all of them.
OWN = {"theta": "theta_rad", "d1": "d1_hz", "d2": "d2_hz"}
#: Angles that differ by it are the same.
PERIOD = {"theta": math.pi}


def true_values(truth: Mapping[str, Any], *, reflection: bool = False) -> dict[str, float]:
    """True values by name, of those that the laboratory has.

    A reflection answers every drive as the rotation with pi/2 - theta and d1, d2 exchanged does:
    what was made in one form is given in the other, if that is asked.

    Args:
        truth: tables of truth.toml.
        reflection: the form of the orthogonal matrix that a fit has chosen.
    """
    if "curve" in truth:
        return _of_curve(truth["curve"], truth.get("outcome", {}))
    if "trace" in truth:
        t = truth["trace"]
        return _of_samples([_told_in(reflection, _modes(t))])
    modes = _told_in(reflection, _modes(truth["modes"]))
    if PUMPED in truth:
        own = {name: float(getattr(modes, field)) for name, field in OWN.items()}
        return {**own, "lambda12": float(truth["outcome"]["lambda_hz"])}
    if SUBHARMONIC in truth:
        result = _of_sample(modes)
        same = {name: result[name] for name in ("theta", "d1", "d2", "f1", "f2")}
        gain = float(truth[SUBHARMONIC]["depth_per_volt"])
        return {**same, "lambda12": result["lambda"], "gain": gain}
    if VOLTAGE in truth:
        bench, outcome, pumped = truth[VOLTAGE], truth["outcome"], truth["sweep"]
        own = {name: float(getattr(modes, field)) for name, field in OWN.items()}
        coupling = [*outcome["lambda_at_volts_hz"], *(outcome["lambda_hz"] for _ in pumped)]
        own["lambda12"] = math.fsum(coupling) / len(coupling)
        return {**own, "gain": float(bench["gain"]), "g2": float(bench["drive"])}
    drives = truth.get("experiment", ())
    places = [{k: e[k] for k in ("eta_plus_hz", "eta_minus_hz")} for e in drives]
    result = _of_samples([replace(modes, **place) for place in places] or [modes])
    cubic = {name: float(value) for name, value in truth.get("cubic", {}).items()}
    return result | cubic


def nearest(name: str, value: float, to: float) -> float:
    """The value of a periodic parameter that is nearest to another one.

    Args:
        name: of the parameter.
        value: true value.
        to: what it is held against; infinite or nan: the value stays.
    """
    period = PERIOD.get(name)
    if period is None or not math.isfinite(to):
        return value
    return value + period * round((to - value) / period)


def _modes(table: Mapping[str, Any]) -> TwoModes:
    return TwoModes(**{f.name: table[f.name] for f in fields(TwoModes) if f.name in table})


def _told_in(reflection: bool, modes: TwoModes) -> TwoModes:
    if reflection == modes.reflection:
        return modes
    return replace(
        modes,
        theta_rad=0.5 * math.pi - modes.theta_rad,
        d1_hz=modes.d2_hz,
        d2_hz=modes.d1_hz,
        reflection=reflection,
    )


def _of_samples(samples: list[TwoModes]) -> dict[str, float]:
    """Means over what a sample was at each drive."""
    each = [_of_sample(sample) for sample in samples]
    names = [name for name in each[0] if all(name in result for result in each)]
    return {name: math.fsum(result[name] for result in each) / len(each) for name in names}


def _of_sample(m: TwoModes) -> dict[str, float]:
    plus, minus = m.eta_plus_hz, m.eta_minus_hz
    c2, s2 = math.cos(m.theta_rad) ** 2, math.sin(m.theta_rad) ** 2
    widths = m.widths_hz()
    square = -0.5 * math.sin(2.0 * m.theta_rad) * (minus - plus) * (minus + plus)
    result = {name: float(getattr(m, field)) for name, field in OWN.items()}
    result |= {"eta_plus": plus, "eta_minus": minus}
    result |= {"lambda": math.sqrt(square)} if square >= 0.0 else {}
    result |= {
        "f1": math.sqrt(c2 * plus**2 + s2 * minus**2),
        "f2": math.sqrt(s2 * plus**2 + c2 * minus**2),
        "width_plus": widths[0],
        "width_minus": widths[1],
        "Q_plus": plus / widths[0],
        "Q_minus": minus / widths[1],
    }
    return result


def _of_curve(curve: Mapping[str, Any], outcome: Mapping[str, Any]) -> dict[str, float]:
    if curve["kind"] in WIRED:
        width = float(curve["width_hz"])
        result = {"eta_plus": float(curve["eta_hz"]), "d1": width, "width_plus": width}
        given = ("Q_plus", "Q_coupling")
        result |= {name: float(outcome[name]) for name in given if name in outcome}
        return result | {"delay": float(curve["delay_s"])}
    if curve["kind"] != CROSSING:
        return {}
    named = {"lambda12": "lambda_hz", "d1": "d1_hz", "d2": "d2_hz", "a1": "tuning_hz_v"}
    third = curve.get("modes") == 3
    named |= {"lambda23": "lambda23_hz", "d3": "d3_hz"} if third else {}
    if not curve["drift_hz"]:  # else where they are depends on when
        named |= {"a0": "f1_hz", "f2": "f2_hz"} | ({"f3": "f3_hz"} if third else {})
    if curve.get("phases"):
        named["delay"] = "delay_s"
    return {name: float(curve[key]) for name, key in named.items()}
