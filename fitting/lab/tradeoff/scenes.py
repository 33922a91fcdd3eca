"""The scenes in which accuracy is measured against cost; those that are built in.

They belong to the virtual laboratory: they know their modes, so that there is a truth outside the
simulator.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from fitting.campaign import WrittenFmu
from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.lab.exact import line_width_hz
from fitting.lab.string import TwoModes
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.notation import hertz
from fitting.text.units import convert

#: Line width over the highest frequency below which a scene is one of high Q.
HIGH_Q = 1e-4


@dataclass(frozen=True)
class Solver:
    """A solver of the FMU and how finely it can be set.

    `values` select it; `resolutions` (`quick` for a hurry) are of the kind `kind`, written to the
    FMU's `variable` ("" for none): "tolerance" as it is, "substeps per period" as a time.
    """

    name: str
    values: Mapping[str, Scalar] = field(default_factory=dict)
    kind: str = ""
    variable: str = ""
    resolutions: tuple[float, ...] = (0.0,)
    quick: tuple[float, ...] = (0.0,)


@dataclass(frozen=True)
class Drive:
    """One run of the scene: tones in Hz, what they set in the FMU, the output ("": the scene's)."""

    tones_hz: tuple[float, ...]
    values: Mapping[str, Scalar]
    output: str = ""


@dataclass(frozen=True)
class Scene:
    """What is simulated.

    `values` of the FMU in every run; `drives` the experiments; `width_hz` the line width that
    settling is reckoned with; `fastest_hz` the highest frequency of the system; `start` the FMU's
    Boolean for a periodic start ("": it has none), `steady` where it
    starts so anyway; `modes` the truth, None for a campaign, with the
    cubic coefficients in `values`; `tone` and `levels` the FMU's parameters for sweeps; `input` a
    held input instead of tones of the FMU; `sweep_hz` frequencies of a
    campaign's own sweep; `annotation` what a campaign tells the plan.
    """

    name: str
    title: str
    description: str
    fmu: WrittenFmu
    values: Mapping[str, Scalar]
    drives: tuple[Drive, ...]
    output: str
    width_hz: float
    fastest_hz: float
    solvers: tuple[Solver, ...]
    start: str = ""
    modes: TwoModes | None = None
    observed: int = 0
    steady: bool = False
    linear: bool = True
    tone: str = ""
    tone_unit: str = "Hz"
    levels: tuple[str, ...] = ()
    level: float = 1.0
    input: str | None = None
    held: int = 0
    damping: tuple[str, ...] = ()
    sweep_values: Mapping[str, Scalar] = field(default_factory=dict)
    sweep_hz: tuple[float, ...] = ()
    annotation: AccuracyAnnotation | None = None
    synthetic: bool = True

    @property
    def centre_hz(self) -> float:
        """Eigenfrequency of the observed mode, or the mean of the drive where it is unknown."""
        if self.modes is not None:
            return (self.modes.eta_plus_hz, self.modes.eta_minus_hz)[self.observed]
        tones = self.drives[0].tones_hz
        return sum(tones) / len(tones)

    @property
    def high_q(self) -> bool:
        """Whether carrier-resolved steps to the end of the transient are millions."""
        return self.width_hz < HIGH_Q * self.fastest_hz

    def settling_s(self, left: float) -> float:
        """Time after which exp(-pi w t) is that, s."""
        return math.log(1.0 / left) / (math.pi * self.width_hz)


#: Longest run of a scene, s.
TIMEOUT_S = 3600.0
#: Substeps per period of the fastest eigenfrequency.
SUBSTEPS = (10.0, 14.0, 20.0, 28.0, 40.0, 57.0, 80.0, 160.0, 320.0, 640.0)
CUBIC_SUBSTEPS = (10.0, 20.0, 40.0, 80.0, 160.0, 320.0, 640.0)
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10)

LINEAR_SOLVERS = (
    Solver("exact", {"solver": 0}),
    Solver("envelope", {"solver": 1}),
    Solver(
        "rk4", {"solver": 2}, "substeps per period", "rk4_substep", SUBSTEPS, (14.0, 28.0, 57.0)
    ),
)
DUFFING_SOLVERS = (
    Solver(
        "envelope",
        {"solver": 1, "rk4_substep": 0.0},
        "tolerance",
        "tolerance",
        TOLERANCES,
        (1e-1, 1e-3, 1e-6),
    ),
    Solver(
        "rk4",
        {"solver": 2, "tolerance": 1e-3},
        "substeps per period",
        "rk4_substep",
        CUBIC_SUBSTEPS,
        (14.0, 40.0),
    ),
)

STRING_TONES = (6.94016e6, 6.94036e6)
STRING = TwoModes(1.9498, 120.0, 90.0, 6.94026e6, 7.02760e6)
SENSOR = TwoModes(1.9498, 650.0, 550.0, 30.3e3, 41.0e3)
DUFFING = TwoModes(1.9498, 520.0, 480.0, 100.0e3, 113.0e3)

BUILT_IN = ("string", "low-q", "duffing", "duffing-string")


def scene_named(name: str) -> Scene:
    """A built-in scene.

    Raises:
        BadInput: no such scene.
    """
    if name == "string":
        return _scene(name, "Published string", "linear", STRING, STRING_TONES)
    if name == "low-q":
        return _scene(name, "Sensor of low Q", "linear", SENSOR, (30.15e3, 30.45e3))
    if name == "duffing":
        cubic = {"alpha1": 1.3e27, "alpha2": 1.3e27, "kappa": 4e26}
        return _scene(name, "Duffing resonator", "cubic", DUFFING, (99.9e3, 100.2e3), cubic)
    if name == "duffing-string":
        cubic = {"alpha1": 1.5e31, "alpha2": 1.5e31, "kappa": 5e30}
        return _scene(name, "Duffing string", "cubic", STRING, STRING_TONES, cubic)
    raise BadInput(f"--scene {name}: wanted one of {', '.join(BUILT_IN)}")


def _scene(
    name: str,
    title: str,
    kind: str,
    modes: TwoModes,
    tones_hz: tuple[float, float],
    cubic: Mapping[str, float] | None = None,
) -> Scene:
    width = line_width_hz(modes, 0)
    values: dict[str, Scalar] = {
        "theta": modes.theta_rad,
        "reflection": modes.reflection,
        "d1": modes.d1_hz,
        "d2": modes.d2_hz,
        "eta_plus": modes.eta_plus_hz,
        "eta_minus": modes.eta_minus_hz,
        "A1": 1.0,
        "A2": 1.0,
        "periodic_start": False,
        "rk4_substep": 0.0,
        **(cubic or {}),
    }
    return Scene(
        name=name,
        title=title,
        description=(
            f"{kind}, {hertz(modes.eta_plus_hz, digits=4)}, Q {modes.eta_plus_hz / width:,.0f}, "
            f"tones {abs(tones_hz[0] - tones_hz[1]):g} Hz apart"
        ),
        fmu=WrittenFmu(
            model="CoupledOscillator" if cubic is None else "DuffingOscillator",
            timeout_s=TIMEOUT_S,
        ),
        values=values,
        drives=(Drive(tones_hz, dict(zip(("u1", "u2"), tones_hz, strict=True))),),
        output="q1_hybrid",
        width_hz=width,
        fastest_hz=max(modes.eta_plus_hz, modes.eta_minus_hz, *tones_hz),
        solvers=LINEAR_SOLVERS if cubic is None else DUFFING_SOLVERS,
        start="periodic_start",
        modes=modes,
        linear=cubic is None,
        tone="u1",
        levels=("A1", "A2"),
        damping=("d1", "d2"),
    )


def scaled(scene: Scene, factor: float) -> Scene:
    """The scene with all damping, and so the line width, times a factor."""
    widths = {name: float(scene.values[name]) * factor for name in scene.damping}
    return replace(scene, values={**scene.values, **widths}, width_hz=scene.width_hz * factor)


def single_tone(scene: Scene, tone_hz: float) -> Drive:
    """A point of a sweep: the first tone moved, the others silent."""
    values: dict[str, Scalar] = dict(scene.sweep_values)
    if scene.tone:
        values[scene.tone] = convert(tone_hz, "Hz", scene.tone_unit, where="sweep")
        values.update(dict.fromkeys(scene.levels[1:], 0.0))
    return Drive((tone_hz,), values)
