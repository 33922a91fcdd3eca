"""The FMUs ``CoupledModes1`` to ``CoupledModes9``: N coupled modes, with a parametric pump.

The number of modes is a part of the model's name, because an FMU's variables are settled when it is
built: ``build_fmu.py --model CoupledModes3`` or ``--model CoupledModes --modes 3``.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from .driven_slave import (
    PERIODIC_START,
    STATUS,
    DrivenSlave,
    checked_substep,
    fixed,
    moving,
    parameter,
    steady,
    substep_parameter,
)
from .model_error import ModelError
from .modes_equations import SINGLE, Parameters, check, matrices, pairs
from .modes_linear import FOUR_PI_SQUARED, NO_OFFSETS, TWO_PI, ModesSolver, at_rest
from .modes_rk4 import ModesRungeKutta
from .modes_steady import TOLERANCES
from .oscillator_phase import Frequency
from .variables import START, Accuracy, Variable

if TYPE_CHECKING:
    from .modes_linear import Offsets
    from .modes_steady import Steady

EXACT, ENVELOPE, RK4 = 0, 1, 2
STEM = "CoupledModes"
#: The names lambda12 and so on hold single digits.
MOST_MODES = 9
PARTS = (("X", "in-phase", "cosine"), ("Y", "quadrature", "minus sine"))
SIDES = (("upper", 1, "u{0} + pump_hz"), ("lower", -1, "u{0} - pump_hz"))


def _marks(n: int) -> list[str]:
    return [f"{i + 1}{j + 1}" for i, j in pairs(n)]


def _example(n: int) -> tuple[list[float], list[float], list[float]]:
    """Return f, lambda and the eigenfrequencies of a string-like example, in Hz."""
    f = [6.9523e6 + 63.4e3 * i for i in range(n)]
    coupling = [0.6476e6 if j == i + 1 else 0.0 for i, j in pairs(n)]
    zeros, none = (0.0,) * n, (0.0,) * len(coupling)
    off: dict[str, Any] = dict.fromkeys(SINGLE, 0.0)
    p = Parameters(
        f=tuple(f),
        d=zeros,
        coupling=tuple(coupling),
        g=zeros,
        depth_f=zeros,
        depth_coupling=none,
        **off,
    )
    return f, coupling, [10.0 * round(eta / 10.0) for eta in matrices(p).eta]


def _mode_parameters(f: Sequence[float], coupling: Sequence[float]) -> list[Variable]:
    """Return what describes the modes: frequencies, damping, coupling, gains, read-out."""
    n = len(f)
    made = [
        parameter(
            f"f{i}",
            start,
            "Hz",
            f"eigenfrequency of mode {i} without coupling",
            minimum=1e-12,
            nominal=1e6,
        )
        for i, start in enumerate(f, start=1)
    ]
    made += [
        parameter(
            f"d{i}",
            100.0,
            "Hz",
            f"damping coefficient of mode {i} (full line width f/Q)",
            nominal=100.0,
        )
        for i in range(1, n + 1)
    ]
    made += [
        parameter(
            f"lambda{i + 1}{j + 1}",
            start,
            "Hz",
            f"coupling of modes {i + 1} and {j + 1}: the force on either, per mass, is "
            f"(2 pi lambda{i + 1}{j + 1})^2 times the other's displacement",
            minimum=0.0,
            nominal=1e6,
        )
        for (i, j), start in zip(pairs(n), coupling)
    ]
    made += [parameter(f"g{i}", 1.0, None, f"gain of the drive on mode {i}") for i in _modes(n)]
    made += [
        parameter(
            f"readout{i}", 1.0 if i == 1 else 0.0, None, f"weight of q{i} in the output readout"
        )
        for i in _modes(n)
    ]
    return made


def _modes(n: int) -> range:
    return range(1, n + 1)


def _drive_parameters(eta: Sequence[float]) -> list[Variable]:
    """Return the two tones, near the lowest eigenfrequency."""
    made = [
        parameter(
            f"u{tone}",
            eta[0] + shift,
            "Hz",
            f"frequency of drive tone {tone}; phase-continuous when changed",
            minimum=0.0,
            nominal=1e6,
        )
        for tone, shift in ((1, -100.0), (2, 100.0))
    ]
    made += [
        parameter(f"A{tone}", 1.0, "m/s2", f"amplitude of drive tone {tone} (force per mass)")
        for tone in (1, 2)
    ]
    made += [
        parameter(
            f"phase{tone}",
            0.0,
            "rad",
            f"phase of drive tone {tone} at time 0: A{tone} cos(2 pi u{tone} t + phase{tone})",
        )
        for tone in (1, 2)
    ]
    return made


def _pump_parameters(eta: Sequence[float]) -> list[Variable]:
    """Return the pump, off, at the distance of the two lowest modes (twice a single one)."""
    n = len(eta)
    made = [
        parameter(
            "pump_hz",
            eta[1] - eta[0] if n > 1 else 2.0 * eta[0],
            "Hz",
            "frequency of the parametric pump; phase-continuous when changed; without effect while "
            "all depths are 0",
            minimum=0.0,
            nominal=1e5,
        ),
        parameter("pump_phase", 0.0, "rad", "phase of the pump at time 0"),
    ]
    made += [
        parameter(
            f"depth_{name}",
            0.0,
            None,
            f"depth of the pump on {name}^2: {name}^2 (1 + depth_{name} cos(2 pi pump_hz t + "
            "pump_phase))",
            nominal=1e-3,
        )
        for name in (*(f"f{i}" for i in _modes(n)), *(f"lambda{mark}" for mark in _marks(n)))
    ]
    return made


def _settings() -> list[Variable]:
    return [
        PERIODIC_START,
        fixed(
            "solver",
            "Integer",
            EXACT,
            "0 exact (sidebands and propagator, any step), 1 envelope (rotating frame, error about "
            "1/Q), 2 rk4 (classical Runge-Kutta, fixed substep)",
            minimum=0,
            maximum=2,
        ),
        substep_parameter(RK4),
        fixed(
            "tolerance",
            "Real",
            TOLERANCES[0],
            "error allowed to the periodic motion under a pump, relative to the amplitude at each "
            "tone of readout and of the largest displacement; not below 1e-14 of the largest "
            "sideband",
            minimum=TOLERANCES[0],
            maximum=TOLERANCES[1],
        ),
        Variable(
            "b",
            "Real",
            "input",
            "discrete",
            "further drive on all modes (times g1, g2, ...), held over each step",
            0.0,
            "m/s2",
        ),
    ]


def _displacements(n: int) -> list[Variable]:
    return [
        moving("readout", "weighted sum of the displacements: readout1 q1 + readout2 q2 + ..."),
        *(moving(f"q{i}", f"displacement of mode {i}") for i in _modes(n)),
        *(
            moving(
                f"readout_at_u{tone}",
                f"the part of readout at u{tone} alone, as an ideal lock-in amplifier passes it: "
                f"periodic response to tone {tone}, without transient and the pump's sidebands",
            )
            for tone in (1, 2)
        ),
    ]


def _quadratures(n: int) -> list[Variable]:
    """Return the lock-in outputs of read-out and modes, and the read-out's first sidebands."""
    made = [
        steady(
            f"{name}_{part}_u{tone}",
            "m",
            f"lock-in {word} of {name} at u{tone}: {trig} part of the periodic response to tone "
            f"{tone}, reference cos(2 pi u{tone} t), transient excluded",
            1e-11,
        )
        for name in ("readout", *(f"q{i}" for i in _modes(n)))
        for tone in (1, 2)
        for part, word, trig in PARTS
    ]
    made += [
        steady(
            f"readout_{part}_u{tone}_{side}",
            "m",
            f"lock-in {word} of readout at {where.format(tone)}, the pump's {side} sideband of "
            f"tone {tone}; reference cos(2 pi ({where.format(tone)}) t)",
            1e-11,
        )
        for tone in (1, 2)
        for side, _, where in SIDES
        for part, word, _ in PARTS
    ]
    return made


def _derived(n: int) -> list[Variable]:
    """Return errors, the sidebands in use, and what the unpumped modes look like."""
    made = [
        steady(
            f"{name}_error",
            None,
            f"bound of the relative error of {name}'s amplitude at the active tones by solver 1 "
            "and, under a pump, by the cut of its sidebands and rounding; 0 with neither; rk4's "
            "substep not included",
            1e-5,
        )
        for name in ("readout", *(f"q{i}" for i in _modes(n)))
    ]
    made.append(
        steady(
            "pump_sidebands",
            None,
            "sidebands of the pump in use, on the side with more, for the active tones; 0 without "
            "a pump",
            10.0,
        )
    )
    made += [
        steady(
            f"eta{i}", "Hz", f"eigenfrequency {i} of the coupled modes without pump, rising", 1e6
        )
        for i in _modes(n)
    ]
    made += [
        steady(
            f"width{i}",
            "Hz",
            f"line width of the coupled mode at eta{i}, full width of its squared amplitude",
            100.0,
        )
        for i in _modes(n)
    ]
    made += [
        steady(f"Q{i}", None, f"quality factor eta{i}/width{i}; NaN without damping", 1e5)
        for i in _modes(n)
    ]
    return made


class CoupledModes(DrivenSlave["ModesSolver | ModesRungeKutta"]):
    """N coupled, damped modes under a two-tone drive and a parametric pump."""

    modes: ClassVar[int]
    version = "1.0"
    license = "MIT"
    accuracy = Accuracy(
        None,
        "rk4_substep",
        {},
        (
            ("periodic start", {"periodic_start": True}, START),
            ("rotating frame", {"solver": ENVELOPE}, "{output}_error", 1.0),
        ),
    )

    # -- outputs --------------------------------------------------------------------------------

    def moving_outputs(self) -> Sequence[float]:
        """Return read-out, displacements, and the read-out's parts at the tones."""
        solver = self.running()
        q = solver.displacement(self.time)
        parts = [0.0, 0.0]
        for tone, ((u, size, phase), offset) in enumerate(zip(solver.p.tones, solver.offsets)):
            if size:
                turn = TWO_PI * (Frequency(u).cycles(self.time) + offset) + phase
                observed = self._read_out(solver.response(u).sideband(0)) / FOUR_PI_SQUARED
                parts[tone] = (observed * cmath.rect(size, turn)).real
        return self._read_out(q).real, *q, *parts

    def _read_out(self, q: Sequence[complex]) -> complex:
        return sum((w * x for w, x in zip(self._row("readout"), q)), 0j)

    def steady_outputs(self) -> Sequence[float]:
        """Return quadratures, sidebands, errors, and what the modes are without pump."""
        solver = self.running()
        p = solver.p
        n = self.modes
        nothing = [0j] * (n + 1)
        carrier, sides = [nothing, nothing], [0j] * 4
        for tone, (u, size, phase) in enumerate(p.tones):
            if size:
                result = solver.response(u)
                amplitude = cmath.rect(size, phase) / FOUR_PI_SQUARED
                carrier[tone] = [amplitude * x for x in self._observed(result, 0)]
                for place, (_, side, _) in enumerate(SIDES):
                    turn = cmath.rect(1.0, side * p.pump_phase)
                    sides[2 * tone + place] = amplitude * turn * self._observed(result, side)[0]
        ordered = [*(carrier[tone][i] for i in range(n + 1) for tone in (0, 1)), *sides]
        parts = [part for z in ordered for part in (z.real, z.imag)]
        return *parts, *self._left_out(), self._sidebands(), *self._unpumped()

    def _observed(self, result: Steady, k: int) -> list[complex]:
        """Return a sideband of read-out and modes."""
        x = result.sideband(k)
        return [self._read_out(x), *x]

    def _active(self) -> list[float]:
        return [u for u, size, _ in self.running().p.tones if size]

    def _left_out(self) -> list[float]:
        """Return the relative errors of read-out and modes, the largest of the active tones."""
        solver = self.running()
        worst = [0.0] * (self.modes + 1)
        if not (solver.envelope or solver.p.pumped):
            return worst
        reach = math.hypot(*self._row("readout"))
        for u in self._active():
            result, full = solver.response(u), solver.full_response(u)
            cut = result.bound + (full.bound if solver.envelope else 0.0)
            pairs_observed = zip(self._observed(result, 0), self._observed(full, 0))
            for i, (x, truth) in enumerate(pairs_observed):
                error = abs(x - truth) + cut * (1.0 if i else reach)
                if error:
                    worst[i] = max(worst[i], error / abs(truth) if truth else 1.0)
        return worst

    def _sidebands(self) -> float:
        solver = self.running()
        if not solver.p.pumped:
            return 0.0
        result = [solver.response(u) for u in self._active()]
        return float(max((max(f.below, len(f.sidebands) - 1 - f.below) for f in result), default=0))

    def _unpumped(self) -> list[float]:
        """Return eigenfrequencies, line widths and Qs of the coupled modes without pump."""
        solver = self.running()
        m = solver.steady.matrices if isinstance(solver, ModesRungeKutta) else solver.matrices
        widths = [
            sum(d * row[i] * row[i] for d, row in zip(solver.p.d, m.shapes))
            for i in range(self.modes)
        ]
        factors = [eta / width if width > 0.0 else math.nan for eta, width in zip(m.eta, widths)]
        return [*m.eta, *widths, *factors]

    # -- the solver -----------------------------------------------------------------------------

    def first_solver(self, t: float) -> ModesSolver | ModesRungeKutta:
        """Return the solver, started at rest or on the periodic orbit."""
        p = self._parameters()
        periodic, b = self.value("periodic_start"), self.value("b")
        self.warn_all(check(p, periodic))
        if not math.isfinite(b):
            raise ModelError(f"b = {b!r} m/s2 is not a finite number")
        solver = self._new_solver(p, NO_OFFSETS)
        solver.start(t, None if periodic else at_rest(self.modes), b)
        return solver

    def next_solver(
        self, solver: ModesSolver | ModesRungeKutta, t: float
    ) -> ModesSolver | ModesRungeKutta:
        """Return the solver that goes on from ``t`` s with new parameters, in state and phase."""
        p = self._parameters()
        self.warn_all(check(p, periodic_start=False))
        return solver.retuned(p, t)

    def restored_solver(self, motion: dict[str, Any]) -> ModesSolver | ModesRungeKutta:
        """Return the solver that a snapshot was taken of, without its state."""
        offsets = motion["offsets"]
        return self._new_solver(self._parameters(), (offsets[0], offsets[1], offsets[2]))

    def _new_solver(self, p: Parameters, offsets: Offsets) -> ModesSolver | ModesRungeKutta:
        """Return the solver by its number."""
        kind, substep = self.value("solver"), checked_substep(self.value("rk4_substep"))
        if kind not in (EXACT, ENVELOPE, RK4):
            raise ModelError(f"solver = {kind!r}: 0 (exact), 1 (envelope) or 2 (rk4) is wanted")
        if not TOLERANCES[0] <= p.tolerance <= TOLERANCES[1]:
            raise ModelError(
                f"tolerance = {p.tolerance!r}: {TOLERANCES[0]!r} to {TOLERANCES[1]!r} is wanted"
            )
        if kind == RK4:
            return ModesRungeKutta(p, substep, offsets)
        return ModesSolver(p, kind == ENVELOPE, offsets)

    def _row(self, stem: str) -> tuple[float, ...]:
        return tuple(self.value(f"{stem}{i}") for i in _modes(self.modes))

    def _parameters(self) -> Parameters:
        marks = _marks(self.modes)
        return Parameters(
            f=self._row("f"),
            d=self._row("d"),
            coupling=tuple(self.value(f"lambda{mark}") for mark in marks),
            g=self._row("g"),
            depth_f=self._row("depth_f"),
            depth_coupling=tuple(self.value(f"depth_lambda{mark}") for mark in marks),
            readout=self._row("readout"),
            tolerance=self.value("tolerance"),
            **{name: self.value(name) for name in SINGLE},
        )


def _model(n: int) -> type[CoupledModes]:
    """Return the model of n modes."""
    f, coupling, eta = _example(n)
    displacements = _displacements(n)
    variables = (
        *_mode_parameters(f, coupling),
        *_drive_parameters(eta),
        *_pump_parameters(eta),
        *_settings(),
        *displacements,
        *_quadratures(n),
        *_derived(n),
        STATUS,
    )
    what = f"{n} coupled modes" if n > 1 else "One mode"
    return type(
        f"{STEM}{n}",
        (CoupledModes,),
        {
            "__doc__": CoupledModes.__doc__,
            "modes": n,
            "description": (
                f"{what} in physical coordinates under a two-tone drive, an arbitrary held input "
                "and a parametric pump"
            ),
            "variables": variables,
            "moving": tuple(v.name for v in displacements),
        },
    )


def __getattr__(name: str) -> type[CoupledModes]:
    """Return the model of that name, made when it is asked for."""
    number = name[len(STEM) :]
    if name.startswith(STEM) and len(number) == 1 and number in "123456789":
        model = _model(int(number))
        globals()[name] = model  # the next time it is found without asking
        return model
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
