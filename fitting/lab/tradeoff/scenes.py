"""The scenes in which accuracy is measured against cost: an FMU, its drives, what is true of it.

The built-in ones belong to the virtual laboratory: they know their modes, so that there is a truth
outside the simulator.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from itertools import pairwise

from fitting.extension.records import WrittenFmu
from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.lab.duffing import Cubic, CubicModes
from fitting.lab.exact import line_width_hz
from fitting.lab.names import SCENES
from fitting.lab.sample import Sample
from fitting.lab.string import TwoModes
from fitting.lab.tradeoff.records import SUBSTEPS, TOLERANCE
from fitting.signal.tones import common_period
from fitting.simulate.drive import Drive
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.notation import hertz
from fitting.text.units import convert

#: Line width over the highest frequency below which a scene is one of high Q.
HIGH_Q = 1e-4
#: Longest common period that is taken for a window, s; and beats instead of a longer one.
LONGEST_PERIOD_S, BEATS = 10.0, 2.5


@dataclass(frozen=True)
class Solver:
    """A solver of the FMU and how finely it can be set.

    `values` select it; `resolutions` (`quick` for a hurry) are of the kind `kind`, written to the
    FMU's `variable` ("" for none): a tolerance as it is, substeps per period as a time.
    """

    name: str
    _: KW_ONLY
    values: Mapping[str, Scalar] = field(default_factory=dict)
    kind: str = ""
    variable: str = ""
    resolutions: tuple[float, ...] = (0.0,)
    quick: tuple[float, ...] = (0.0,)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """An FMU with drives and a reference.

    `width_hz` is the line width that settling is reckoned with, `fastest_hz` the highest frequency
    of the system; `single` a drive by one tone, moved by the FMU's parameter `tone` in `tone_unit`
    ("": the tone is an input). `periodic` is the FMU's Boolean for a periodic start ("": it has
    none), `steady`: it starts so anyway. `sample` is the truth, its first mode
    observed, None for a campaign. `damping` are the parameters that the line width follows,
    `sweep_hz` the ends of a campaign's own sweep, `annotation` what it tells the plan.
    """

    name: str
    title: str
    description: str
    fmu: WrittenFmu
    drives: tuple[Drive, ...]
    single: Drive
    width_hz: float
    fastest_hz: float
    solvers: tuple[Solver, ...]
    periodic: str = ""
    steady: bool = False
    sample: Sample | None = None
    tone: str = ""
    tone_unit: str = "Hz"
    damping: tuple[str, ...] = ()
    sweep_hz: tuple[float, ...] = ()
    annotation: AccuracyAnnotation | None = None
    synthetic: bool = True

    @property
    def tones_hz(self) -> list[float]:
        """The tones of all drives."""
        return [tone for drive in self.drives for tone in drive.tones_hz]

    @property
    def linear(self) -> bool:
        """Whether the truth is known to be linear."""
        return isinstance(self.sample, TwoModes)

    @property
    def held(self) -> int:
        """Held steps in a period of a generated drive, 0 where the FMU makes its tones."""
        return self.single.steps_per_period if self.single.input is not None else 0

    @property
    def centre_hz(self) -> float:
        """Eigenfrequency of the observed mode, or the mean of the drive where it is unknown."""
        tones = self.drives[0].tones_hz
        if self.sample is None:
            return sum(tones) / len(tones)
        return self.sample.modes.eta_plus_hz

    @property
    def high_q(self) -> bool:
        """Whether carrier-resolved steps to the end of the transient are millions."""
        return self.width_hz < HIGH_Q * self.fastest_hz

    @property
    def beat_s(self) -> float:
        """Period of the slowest beat of any drive, s."""
        tones = [sorted(drive.tones_hz) for drive in self.drives]
        gaps = [b - a for row in tones for a, b in pairwise(row)]
        return 1.0 / min(gaps, default=self.width_hz)

    @property
    def period_s(self) -> float:
        """Longest common period of the tones of a drive, s; some beats where there is none."""
        periods = [float(common_period(drive.tones_hz)) for drive in self.drives]
        return max(p if p <= LONGEST_PERIOD_S else BEATS * self.beat_s for p in periods)

    def settling_s(self, left: float) -> float:
        """Time after which exp(-pi w t) is that, s.

        Args:
            left: share that may be left of a transient.
        """
        return math.log(1.0 / left) / (math.pi * self.width_hz)

    def single_tone(self, tone_hz: float) -> Drive:
        """The drive by one tone alone, as at a point of a sweep.

        Args:
            tone_hz: frequency of the tone, Hz.
        """
        values: dict[str, Scalar] = {}
        if self.tone:
            values = {self.tone: convert(tone_hz, "Hz", self.tone_unit, where="sweep")}
        return replace(_with(self.single, values), tones_hz=(tone_hz,))

    def scaled(self, factor: float) -> Scene:
        """The scene with all damping, and so the line width, times a factor.

        Args:
            factor: by which amplitudes are multiplied.
        """
        start = self.single.start_values
        widths = {name: float(start[name]) * factor for name in self.damping}
        return replace(
            self,
            drives=tuple(_with(drive, widths) for drive in self.drives),
            single=_with(self.single, widths),
            width_hz=self.width_hz * factor,
        )

    def values_of(
        self, solver: Solver, resolution: float, periodic: bool = False
    ) -> dict[str, Scalar]:
        """Start values of a solver at a resolution; every setting of a scene sets the same ones.

        Then all runs share one layout, and the workers prove only once that a reset may vary them.

        Args:
            solver: settings that choose a solver.
            resolution: of the solver: substep or samples, as its kind says.
            periodic: whether the run begins on its periodic orbit.
        """
        values: dict[str, Scalar] = {other.variable: 0.0 for other in self.solvers}
        for other in reversed(self.solvers):
            values.update(other.values)
        values.update(solver.values)
        fine = 1.0 / (resolution * self.fastest_hz) if solver.kind == SUBSTEPS else resolution
        values.update({solver.variable: fine, self.periodic: periodic})
        values.pop("", None)
        return values


def _with(drive: Drive, values: Mapping[str, Scalar]) -> Drive:
    return replace(drive, start_values={**drive.start_values, **values})


#: Longest run of a scene, s.
TIMEOUT_S = 3600.0
#: Substeps per period of the fastest eigenfrequency.
FEW_SUBSTEPS = (10.0, 14.0, 20.0, 28.0, 40.0, 57.0, 80.0, 160.0, 320.0, 640.0)
CUBIC_SUBSTEPS = (10.0, 20.0, 40.0, 80.0, 160.0, 320.0, 640.0)
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10)
QUICK_TOLERANCES = (1e-1, 1e-3, 1e-6)

LINEAR_SOLVERS = (
    Solver("exact", values={"solver": 0}),
    Solver("envelope", values={"solver": 1}),
    Solver(
        "rk4",
        values={"solver": 2},
        kind=SUBSTEPS,
        variable="rk4_substep",
        resolutions=FEW_SUBSTEPS,
        quick=(14.0, 28.0, 57.0),
    ),
)
AVERAGED, STEPPED = {"solver": 1, "rk4_substep": 0.0}, {"solver": 2, "tolerance": 1e-3}
CUBIC_SOLVERS = (
    Solver(
        "envelope",
        values=AVERAGED,
        kind=TOLERANCE,
        variable="tolerance",
        resolutions=TOLERANCES,
        quick=QUICK_TOLERANCES,
    ),
    Solver(
        "rk4",
        values=STEPPED,
        kind=SUBSTEPS,
        variable="rk4_substep",
        resolutions=CUBIC_SUBSTEPS,
        quick=(14.0, 40.0),
    ),
)

STRING_TONES = (6.94016e6, 6.94036e6)
STRING = TwoModes(
    theta_rad=1.9498, d1_hz=120.0, d2_hz=90.0, eta_plus_hz=6.94026e6, eta_minus_hz=7.02760e6
)
SENSOR = TwoModes(
    theta_rad=1.9498, d1_hz=650.0, d2_hz=550.0, eta_plus_hz=30.3e3, eta_minus_hz=41.0e3
)
DUFFING = TwoModes(
    theta_rad=1.9498, d1_hz=520.0, d2_hz=480.0, eta_plus_hz=100.0e3, eta_minus_hz=113.0e3
)

#: Title, modes, tones and cubic terms of the built-in scenes.
_SCENES: dict[str, tuple[str, TwoModes, tuple[float, float], dict[str, float]]] = {
    "string": ("Published string", STRING, STRING_TONES, {}),
    "low-q": ("Sensor of low Q", SENSOR, (30.15e3, 30.45e3), {}),
    "duffing": (
        "Duffing resonator",
        DUFFING,
        (99.9e3, 100.2e3),
        {"alpha1": 1.3e27, "alpha2": 1.3e27, "kappa": 4e26},
    ),
    "duffing-string": (
        "Duffing string",
        STRING,
        STRING_TONES,
        {"alpha1": 1.5e31, "alpha2": 1.5e31, "kappa": 5e30},
    ),
}


def scene_named(name: str) -> Scene:
    """A built-in scene.

    Args:
        name: of the scene.

    Raises:
        BadInput: no such scene.
    """
    if name not in _SCENES:
        raise BadInput(f"--scene {name}: wanted one of {', '.join(SCENES)}")
    title, modes, tones_hz, cubic = _SCENES[name]
    width = line_width_hz(modes, 0)
    values: dict[str, Scalar] = {
        "theta": modes.theta_rad,
        "reflection": modes.reflection,
        "d1": modes.d1_hz,
        "d2": modes.d2_hz,
        "eta_plus": modes.eta_plus_hz,
        "eta_minus": modes.eta_minus_hz,
        "u1": tones_hz[0],
        "u2": tones_hz[1],
        "A1": 1.0,
        "A2": 1.0,
        "periodic_start": False,
        "rk4_substep": 0.0,
        **cubic,
    }
    drive = Drive(start_values=values, tones_hz=tones_hz, outputs=("q1_hybrid",))
    return Scene(
        name=name,
        title=title,
        description=(
            f"{'cubic' if cubic else 'linear'}, {hertz(modes.eta_plus_hz, digits=4)}, "
            f"Q {modes.eta_plus_hz / width:,.0f}, tones {abs(tones_hz[0] - tones_hz[1]):g} Hz apart"
        ),
        fmu=WrittenFmu(
            model="DuffingOscillator" if cubic else "CoupledOscillator",
            timeout_s=TIMEOUT_S,
        ),
        drives=(drive,),
        single=_with(drive, {"A2": 0.0}),
        width_hz=width,
        fastest_hz=max(modes.eta_plus_hz, modes.eta_minus_hz, *tones_hz),
        solvers=CUBIC_SOLVERS if cubic else LINEAR_SOLVERS,
        periodic="periodic_start",
        sample=CubicModes(modes, Cubic(**cubic)) if cubic else modes,
        tone="u1",
        damping=("d1", "d2"),
    )
