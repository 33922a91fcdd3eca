"""The solvers ``exact`` and ``envelope``: the kernel of a set of parameters applied to a run.

A run is a chain of stretches without a change of input or parameters. Each stretch is evaluated
from its anchor (a time and a state), never from the step before, so that the result at a
communication point does not depend on how the steps in between were cut.
"""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING, Any, NamedTuple

from .model_error import ModelError
from .oscillator_equations import TWO_PI, Parameters, damping, phasors, rotating_phasors
from .oscillator_exact import (
    CONFLUENT,
    DECAYED,
    NOTHING,
    Kernel,
    ToneKernel,
    first_difference,
    oscillator_pencil,
    rotating_pencil,
    second_difference,
)
from .oscillator_phase import Frequency, difference, kept_phases
from .oscillator_precise import Precise, in_precise_arithmetic

if TYPE_CHECKING:  # subscripted here, these would need a host with Python 3.9 or later
    from .oscillator_exact import Pair
    from .oscillator_precise import Polynomial

    #: Displacements and velocities over 2 pi of both modes (exact); analytic signals (envelope).
    State = tuple[complex, complex, complex, complex]


class Tone(NamedTuple):
    """An active drive tone: A exp(i phase), frequency, cycles added by retuning, phasors."""

    amplitude: complex
    u: float
    frequency: Frequency
    offset: float
    response: Pair


class LinearSolver:
    """The two-mode oscillator between changes of its parameters, exactly or in a rotating frame."""

    def __init__(self, p: Parameters, envelope: bool, offsets: tuple[float, float] = (0.0, 0.0)):
        """Prepare the periodic part; the transient's kernel is made when first needed."""
        self.p, self.envelope, self.offsets = p, envelope, offsets
        self.centre = centre_of(p) if envelope else 0.0
        self.tones = tuple(self._tone(i) for i in (0, 1) if (p.A1, p.A2)[i] and (p.g1 or p.g2))
        self._kernel: Kernel | None = None
        self._tone_kernels: list[ToneKernel] = []
        self._free: tuple[list[Pair], list[Pair]] | None = None

    def _tone(self, index: int) -> Tone:
        p = self.p
        u, size, phase = ((p.u1, p.A1, p.phase1), (p.u2, p.A2, p.phase2))[index]
        return Tone(cmath.rect(size, phase), u, Frequency(u), self.offsets[index], self.response(u))

    def response(self, u: float) -> Pair:
        """Return the phasors of both modes for a drive of unit amplitude at ``u`` Hz, in s^2."""
        return rotating_phasors(self.p, u, self.centre) if self.envelope else phasors(self.p, u)

    def start(self, t: float, state: State | None, b: float) -> None:
        """Begin at ``t`` s from a state (None: on the periodic orbit) with input ``b``."""
        if b and self.envelope:
            raise ModelError(
                f"b = {b!r}: the rotating frame of solver 1 (envelope) cannot carry an arbitrary "
                "input; use solver 0 (exact) or 2 (rk4)"
            )
        self.anchor, self.state, self.b = t, state, b
        p = self.p
        self._static = (
            b * p.g1 / (TWO_PI * p.eta_plus) ** 2,
            b * p.g2 / (TWO_PI * p.eta_minus) ** 2,
        )
        self._periodic = [
            (tone, tone.amplitude * tone.response[0], tone.amplitude * tone.response[1])
            for tone in self.tones
        ]
        #: Whether a transient can leave the range of a double.
        self.grows = False
        if state is not None:
            self._prepare_transient(state)
            self.grows = self._roots.growth1 > 0.0

    def advance(self, t: float) -> None:
        """Do nothing: the motion at ``t`` s is evaluated from the anchor when it is asked for."""

    def displacement(self, t: float) -> tuple[float, float]:
        """Return q~1, q~2 at ``t`` s."""
        if self.state is None:
            return self._orbit(t)
        dt, dt_low = difference(t, self.anchor)
        if dt < self._early_until:
            z1, z2, _, _ = self._early(t, dt, dt_low)
            return self._static[0] + z1.real, self._static[1] + z2.real
        q1, q2 = self._orbit(t)
        if self._roots.growth1 * dt < DECAYED:
            return q1, q2
        e12, e2 = self._exponentials(dt, dt_low)
        (a1, a2), (c1, c2) = self._sum_first, self._sum_second
        return q1 + (a1 * e12 + c1 * e2).real, q2 + (a2 * e12 + c2 * e2).real

    def full_state(self, t: float) -> State:
        """Return displacements and velocities over 2 pi (exact) or analytic signals at ``t`` s."""
        z1, z2, w1, w2 = self._signals(t)
        if self.envelope:
            return z1, z2, 0j, 0j
        return (
            complex(self._static[0] + z1.real),
            complex(self._static[1] + z2.real),
            complex(w1.real),
            complex(w2.real),
        )

    def retuned(self, p: Parameters, t: float) -> LinearSolver:
        """Return the solver for new parameters, with state and drive phases kept at ``t`` s."""
        before = self.p.u1, self.p.u2
        offsets = kept_phases(self.offsets, before, (p.u1, p.u2), t)
        solver = LinearSolver(p, self.envelope, offsets)
        solver.start(t, self.full_state(t), self.b)
        return solver

    def with_input(self, b: float, t: float) -> None:
        """Hold the input at ``b`` from ``t`` s on."""
        self.start(t, self.full_state(t), b)

    def snapshot(self) -> dict[str, Any]:
        """Return what must be stored, besides parameters, to continue bit for bit."""
        state = None if self.state is None else [[z.real, z.imag] for z in self.state]
        return {"anchor": self.anchor, "state": state, "b": self.b, "offsets": list(self.offsets)}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Take up a snapshot of a solver with the same parameters and offsets."""
        state = snapshot["state"]
        values = None if state is None else tuple(complex(*pair) for pair in state)
        self.start(snapshot["anchor"], values, snapshot["b"])  # type: ignore[arg-type]

    # -- evaluation -----------------------------------------------------------------------------

    def _orbit(self, t: float) -> tuple[float, float]:
        """Return the periodic and the static part."""
        q1, q2 = self._static
        for tone, y1, y2 in self._periodic:
            angle = TWO_PI * (tone.frequency.cycles(t) + tone.offset)
            c, s = math.cos(angle), math.sin(angle)
            q1 += y1.real * c - y1.imag * s
            q2 += y2.real * c - y2.imag * s
        return q1, q2

    def _exponentials(self, dt: float, dt_low: float) -> tuple[complex, complex]:
        """Return E[x1, x2] and E[x2] over the time since the anchor."""
        roots = self._roots
        e1 = cmath.rect(math.exp(roots.growth1 * dt), TWO_PI * roots.frequency1.cycles(dt, dt_low))
        e2 = cmath.rect(math.exp(roots.growth2 * dt), TWO_PI * roots.frequency2.cycles(dt, dt_low))
        return first_difference(e1, e2, roots.gap, dt), e2

    def _signals(self, t: float) -> State:
        """Return complex displacements and velocities over 2 pi whose real parts are meant."""
        if self.state is not None:
            dt, dt_low = difference(t, self.anchor)
            if dt < self._early_until:
                return self._early(t, dt, dt_low)
            e12, e2 = self._exponentials(dt, dt_low)
            x1, x2 = self._roots.x1, self._roots.x2
            z = [a * e12 + c * e2 for a, c in zip(self._sum_first, self._sum_second)]
            d12, d2 = x1 * e12 + e2, x2 * e2
            w = [a * d12 + c * d2 for a, c in zip(self._sum_first, self._sum_second)]
        else:
            z, w = [0j, 0j], [0j, 0j]
        for tone, y1, y2 in self._periodic:
            turn = cmath.rect(1.0, TWO_PI * (tone.frequency.cycles(t) + tone.offset))
            for i, y in enumerate((y1 * turn, y2 * turn)):
                z[i] += y
                w[i] += 1j * tone.u * y
        return z[0], z[1], w[0], w[1]

    def _early(self, t: float, dt: float, dt_low: float) -> State:
        """Return the signals while a tone and a pole have not yet come apart in phase."""
        roots = self._roots
        e12, e2 = self._exponentials(dt, dt_low)
        d12, d2 = roots.x1 * e12 + e2, roots.x2 * e2
        e1 = e2 + roots.gap * e12
        first, second = list(self._free_first), list(self._free_second)
        z, w = [0j, 0j], [0j, 0j]
        for tone, kernel, amplitude, until in self._prepared:
            if dt < until:
                e0 = cmath.rect(1.0, TWO_PI * tone.frequency.cycles(dt, dt_low))
                e012 = second_difference((*kernel.gaps, roots.gap), (e0, e1, e2), dt)
                d012 = kernel.node * e012 + e12
                f0, f01, f012 = kernel.confluent
                for i in (0, 1):
                    z[i] += amplitude * (f0[i] * e012 + f01[i] * e12 + f012[i] * e2)
                    w[i] += amplitude * (f0[i] * d012 + f01[i] * d12 + f012[i] * d2)
            else:
                turn = cmath.rect(1.0, TWO_PI * (tone.frequency.cycles(t) + tone.offset))
                for i in (0, 1):
                    y = tone.amplitude * kernel.periodic[i] * turn
                    z[i] += y
                    w[i] += 1j * tone.u * y
                    first[i] += amplitude * kernel.pair[0][i]
                    second[i] += amplitude * kernel.pair[1][i]
            for i in (0, 1):
                first[i] += (amplitude * kernel.mirror[0][i]).conjugate()
                second[i] += (amplitude * kernel.mirror[1][i]).conjugate()
        for i in (0, 1):
            z[i] += first[i] * e12 + second[i] * e2
            w[i] += first[i] * d12 + second[i] * d2
        return z[0], z[1], w[0], w[1]

    # -- preparation ----------------------------------------------------------------------------

    def _prepare_transient(self, state: State) -> None:
        """Fold tones, input and state at the anchor into the coefficients of the exponentials."""
        if self._kernel is None:
            self._kernel = self._make_kernel()
        self._free_first, self._free_second = self._free_part(self._kernel, state)
        first, second = list(self._free_first), list(self._free_second)
        self._prepared = []
        self._periodic = []
        for tone, kernel in zip(self.tones, self._tone_kernels):
            turn = cmath.rect(1.0, TWO_PI * (tone.frequency.cycles(self.anchor) + tone.offset))
            amplitude = tone.amplitude * turn
            for i in (0, 1):
                mirror = kernel.mirror
                first[i] += amplitude * kernel.pair[0][i] + (amplitude * mirror[0][i]).conjugate()
                second[i] += amplitude * kernel.pair[1][i] + (amplitude * mirror[1][i]).conjugate()
            nearest = min(abs(gap) for gap in kernel.gaps)
            self._prepared.append((tone, kernel, amplitude, CONFLUENT / (TWO_PI * nearest)))
            y1, y2 = (tone.amplitude * response for response in kernel.periodic)
            self._periodic.append((tone, y1, y2))
        self._early_until = max((until for *_, until in self._prepared), default=0.0)
        self._sum_first, self._sum_second = (first[0], first[1]), (second[0], second[1])

    def _make_kernel(self) -> Kernel:
        with in_precise_arithmetic():
            pencil = (
                rotating_pencil(self.p, self.centre) if self.envelope else oscillator_pencil(self.p)
            )
            kernel = Kernel(pencil, (self.p.g1, self.p.g2))
        self._roots = kernel.roots
        self._tone_kernels = [kernel.tone(tone.u) for tone in self.tones]
        return kernel

    def _free_part(self, kernel: Kernel, state: State) -> tuple[Pair, Pair]:
        """Return the coefficients of E[x1, x2] and E[x2] of the motion left to itself."""
        start = (state[0] - self._static[0], state[1] - self._static[1], state[2], state[3])
        if not any(start):
            return NOTHING, NOTHING
        if self._free is None:
            self._free = kernel.free(self._columns())
        first, second = [0j, 0j], [0j, 0j]
        scale = 1.0 if self.envelope else 2.0  # exact: the mirrored poles add the conjugate
        for value, f, s in zip(start, *self._free):
            for i in (0, 1):
                first[i] += scale * value * f[i]
                second[i] += scale * value * s[i]
        return (first[0], first[1]), (second[0], second[1])

    def _columns(self) -> list[tuple[Polynomial, Polynomial]]:
        """Return the Laplace numerators of unit initial states."""
        with in_precise_arithmetic():
            zero, one = [Precise(0)], [Precise(1)]
            if self.envelope:
                unit = [Precise(0.0, 2.0 * self.centre)]
                return [(unit, zero), (zero, unit)]
            w11, w22, w12 = (Precise(w) for w in damping(self.p))
            return [
                ([w11, Precise(1)], [w12]),
                ([w12], [w22, Precise(1)]),
                (one, zero),
                (zero, one),
            ]


def centre_of(p: Parameters) -> float:
    """Return the frequency of the rotating frame: the mean of the active tones, or of the modes."""
    active = [u for u, size in ((p.u1, p.A1), (p.u2, p.A2)) if size]
    return sum(active) / len(active) if active else 0.5 * (p.eta_plus + p.eta_minus)
