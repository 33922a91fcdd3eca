"""The solver ``envelope``: the slow amplitudes in a rotating frame, with a step that is controlled.

The steps are the solver's own: it runs past a communication point as far as the tolerance lets it
and answers for the times in between, so the cut of a run into communication steps does not change
a bit of the result. Only a change of parameters ends a step.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from .duffing_equations import Cubic, shift
from .duffing_exponential import PROBE, Step, notched, take_lone_step, take_step, weights
from .duffing_orbit import averaged_orbit, fixed_point
from .duffing_period import Period, period_of
from .duffing_slow import SlowModel
from .model_error import ModelError
from .oscillator_equations import AT_REST
from .oscillator_phase import kept_phases

if TYPE_CHECKING:
    from .duffing_exponential import Weights
    from .duffing_slow import Pair, State
    from .oscillator_equations import Parameters

#: The relative frequency shift by the cubic terms beyond which an expansion in it says nothing.
LARGEST_SHIFT = 0.1
#: Share of the tolerance that one step may take: the errors of a few steps are alive at a time.
PER_STEP = 0.03
#: Tolerance of the steps that settle, while what they miss has the time to be forgotten.
SETTLING = 1e-2


class Settings(NamedTuple):
    """How an envelope is integrated: relative tolerance, and the branch of a periodic start."""

    tolerance: float
    upper: bool


class Coefficients(NamedTuple):
    """What a step of one length needs: weights of both components, how far the tones turn.

    ``kept`` is what is left of both scales, as they are forgotten.
    """

    weights: tuple[Weights, Weights]
    to_probe: list[complex]
    to_middle: list[complex]
    kept: tuple[float, float]


class EnvelopeSolver:
    """The Duffing oscillator's slow motion between changes of its parameters."""

    grows = False  # a motion that grows leaves the range of the averaging and is refused there

    def __init__(
        self,
        p: Parameters,
        cubic: Cubic,
        settings: Settings,
        offsets: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.p, self.cubic, self.settings, self.offsets = p, cubic, settings, offsets
        self.model = SlowModel(p, cubic, offsets)
        self.centre = self.model.centre
        self.b = 0.0
        growth = max(rate.real for rate in self.model.rates)
        self._longest = 1.0 / growth if growth > 0.0 else math.inf
        self._coefficients: dict[float, Coefficients] = {}
        self._period: Period | None = None
        #: Until when the motion settles, and how fast what it misses is forgotten, in 1/s.
        self._settling = -math.inf, 0.0

    # -- start and state ------------------------------------------------------------------------

    def start(self, t: float, state: State | None, b: float) -> None:
        """Begin at ``t`` s from displacements and velocities over 2 pi (None: periodic orbit)."""
        self.with_input(b, t)
        if state is not None:
            self._begin(t, self.model.slow_state(state, t))
        elif not any(self.cubic):
            self._begin(t, (0j, 0j))
        elif len(set(self.model.detunings)) <= 1:
            self._start_on_orbit(t)
        elif self.settings.upper:
            raise ModelError(
                "branch = 1: the upper branch is that of one active tone (A1 = 0 or A2 = 0), not "
                f"of two, at u1 = {self.p.u1!r} Hz and u2 = {self.p.u2!r} Hz"
            )
        else:
            self._settle(t, None)
            self._repeat(t)

    def _start_on_orbit(self, t: float) -> None:
        """Begin on the periodic orbit of one tone, on the branch that the settings name."""
        model, linear = self.model, self.model.linear(t)
        if not any(linear):
            self._begin(t, (0j, 0j))
            return
        q = averaged_orbit(model, linear, self.settings.upper)
        guess = model.deviation(q, linear)
        w = fixed_point(model, linear, guess)
        if w is None:  # at the edge of a branch only the motion itself knows where it ends
            self._settle(t, guess)
        else:
            self._begin(t, w)

    def _settle(self, t: float, w: Pair | None) -> None:
        """Begin at ``t`` s where the motion from ``w`` (None: rest) long before has come to."""
        lone = self.model.lone
        rates = self.model.rates if lone is None else (self.model.rates[lone],)
        decay = min(-rate.real for rate in rates)
        begin = t - math.log(100.0 / self.settings.tolerance) / decay
        self._begin(begin, self.model.slow_state(AT_REST, begin) if w is None else w)
        self._settling = t, decay
        self.advance(t)
        self._settling = -math.inf, 0.0
        w1, w2 = self._slow(t)
        if lone is not None:  # the other mode is linear: its deviation is gone in the end
            w1, w2 = (0j, w2) if lone else (w1, 0j)
        self._begin(t, (w1, w2))

    def _repeat(self, t: float) -> None:
        """Let every period of the settled motion from ``t`` s on be a copy of the first."""
        self._period = period_of(self.model, t)
        self._origin = self._reached[1], self._scale, self._next

    def _begin(self, t: float, w: Pair) -> None:
        """Stand at ``t`` s with ``w``, before the first step."""
        self._stand(t, w)
        q1, q2 = self._amplitudes(t)
        self._scale = abs(q1), abs(q2)
        fastest = max(abs(rate.real) for rate in self.model.rates)
        self._next = 0.1 / fastest if fastest else 10.0 / self.model.centre

    def _stand(self, t: float, w: Pair) -> None:
        self._turns = self.model.turns(t)
        n1, n2, _, _ = self.model.slope(w, self.model.rotated(self._turns))
        self._step: Step | None = None
        self._reached = t, w, (n1, n2)
        self._read: tuple[float, Pair] | None = None

    def full_state(self, t: float) -> State:
        """Return displacements and velocities over 2 pi at ``t`` s."""
        return self.model.full_state(self._slow(t), t)

    def retuned(self, p: Parameters, t: float, cubic: Cubic | None = None) -> EnvelopeSolver:
        """Return the solver for new parameters, with state and drive phases kept at ``t`` s."""
        before = self.p.u1, self.p.u2
        offsets = kept_phases(self.offsets, before, (p.u1, p.u2), t)
        solver = EnvelopeSolver(p, cubic or self.cubic, self.settings, offsets)
        solver.start(t, self.full_state(t), self.b)
        return solver

    def with_input(self, b: float, t: float) -> None:
        """Refuse an input: a rotating frame cannot carry it."""
        if b:
            raise ModelError(
                f"b = {b!r}: the rotating frame of solver 1 (envelope) cannot carry an arbitrary "
                "input; use solver 2 (rk4)"
            )

    def snapshot(self) -> dict[str, Any]:
        """Return what must be stored, besides parameters, to continue bit for bit."""
        step, period = self._step, self._period
        t, w = (step.t, step.y) if step else self._reached[:2]
        scale, following = self._scale, self._next
        if period is not None:  # its steps are taken anew
            t, (w, scale, following) = period.begin, self._origin
        return {
            "t": t,
            "w": [w[0].real, w[0].imag, w[1].real, w[1].imag],
            "h": step.h if step and period is None else 0.0,
            "next": following,
            "scale": list(scale),
            "b": self.b,
            "offsets": list(self.offsets),
            "reached": self._reached[0] if period is not None else None,
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Take up a snapshot of a solver with the same parameters and offsets."""
        w = snapshot["w"]
        self._stand(snapshot["t"], (complex(w[0], w[1]), complex(w[2], w[3])))
        if snapshot["h"]:
            self._accept(self._attempt(snapshot["h"]))
        self._next = snapshot["next"]
        self._scale = snapshot["scale"][0], snapshot["scale"][1]
        if snapshot["reached"] is not None:
            self._repeat(snapshot["t"])
            self._move(snapshot["reached"])

    # -- motion ---------------------------------------------------------------------------------

    def displacement(self, t: float) -> tuple[float, float]:
        """Return q~1, q~2 at ``t`` s."""
        return self.model.displacement(self._amplitudes(t), t)

    def squares(self, t: float) -> tuple[float, float]:
        """Return the squared amplitudes of both modes at ``t`` s, in m^2."""
        q1, q2 = self._amplitudes(t)
        return abs(q1) ** 2, abs(q2) ** 2

    def averaging_error(self, t: float, result: float) -> float:
        """Return the bound of what averaging leaves out at ``t`` s, with the shift ``found``."""
        return self.model.averaging_error(self._slow(t), t, result)

    def _amplitudes(self, t: float) -> Pair:
        """Return Q at ``t`` s; the last answer is kept for the next reader."""
        if self._read is None or self._read[0] != t:
            self._read = t, self.model.amplitudes(self._slow(t), self.model.linear(t))
        return self._read[1]

    def _slow(self, t: float) -> Pair:
        """Return w at a time within the last step, or within what a period was taken of."""
        if self._step is None:
            return self._reached[1]
        if self._period is not None:
            return self._period.slow(t)
        return self._step.between(self.model.rates, t)

    def advance(self, t: float) -> None:
        """Take steps until one of them holds ``t`` s, or what ``t`` s is a copy of."""
        if self._period is not None:
            self._move(self._period.within(t))
        if self._period is None:  # or no more: it took too many steps to be kept
            self._move(t)

    def _move(self, t: float) -> None:
        while self._reached[0] < t:
            try:
                self._take()
            except OverflowError as error:
                raise ModelError(
                    f"the envelope left the range of numbers after t = {self._reached[0]!r} s"
                ) from error

    def _take(self) -> None:
        """Take one step as long as the tolerance allows."""
        h = notched(min(self._next, self._longest))
        tolerance = PER_STEP * self._tolerance()
        while True:
            step = self._attempt(h)
            scale = self._scale_after(step)
            worst = max(map(_relative, step.error, scale)) / tolerance
            self._check(step, worst)
            factor = min(5.0, 0.9 * worst**-0.25) if worst else 5.0
            if worst <= 1.0:
                break
            h = notched(h * max(0.2, factor))
        self._next = h * max(0.2, factor)
        self._scale = scale
        self._accept(step)

    def _tolerance(self) -> float:
        """Return what a step may miss; what is missed while settling is forgotten as it decays."""
        until, decay = self._settling
        wanted, left = self.settings.tolerance, until - self._reached[0]
        if left <= 0.0 or wanted >= SETTLING:
            return wanted
        grown = math.log(SETTLING / wanted)
        return wanted * math.exp(min(decay * left, grown))

    def _attempt(self, h: float) -> Step:
        t, model = self._reached[0], self.model
        pair, to_probe, to_middle, _ = self._coefficients_of(h)
        probed = [a * b for a, b in zip(self._turns, to_probe)]
        middle = [a * b for a, b in zip(self._turns, to_middle)]
        there = self._turns_after = model.turns(t + h)
        lone = model.lone
        if lone is None:
            rotated = model.rotated
            forces = rotated(probed), rotated(middle), rotated(there)
            return take_step(self._reached, h, pair, model.slope, forces)
        own = model.lone_rotated
        forced = own(probed), own(middle), own(there)
        return take_lone_step(self._reached, h, pair, model.lone_slope, forced, lone)

    def _coefficients_of(self, h: float) -> Coefficients:
        """Return the coefficients of a step of ``h`` s, kept for the next one of this length."""
        result = self._coefficients.get(h)
        if result is None:
            first, second = self.model.rates
            onwards = self.model.onwards
            pair = weights(first, h), weights(second, h)
            kept = math.exp(min(first.real, 0.0) * h), math.exp(min(second.real, 0.0) * h)
            result = Coefficients(pair, onwards(PROBE * h), onwards(0.5 * h), kept)
            self._coefficients[h] = result
        return result

    def _accept(self, step: Step) -> None:
        self._step = step
        self._reached = step.end, step.y_end, step.n_end
        self._turns = self._turns_after
        self._read = None
        if self._period is not None:
            self._period.add(step)
            if self._period.full:
                self._period = None

    def _scale_after(self, step: Step) -> tuple[float, float]:
        """Return the amplitudes that errors are relative to: the largest, as it is forgotten."""
        (before1, before2), (largest1, largest2) = self._scale, step.largest
        kept1, kept2 = self._coefficients_of(step.h).kept
        return max(before1 * kept1, largest1), max(before2 * kept2, largest2)

    def _check(self, step: Step, worst: float) -> None:
        """Raise ModelError where the averaging does not hold or the numbers end."""
        if not math.isfinite(worst) or not math.isfinite(sum(step.largest)):
            raise OverflowError
        squares = step.largest[0] ** 2, step.largest[1] ** 2
        result = shift(self.cubic, squares, self.model.centre)
        if worst <= 1.0 and not result <= LARGEST_SHIFT:
            raise ModelError(
                f"the cubic terms shift the frequency by {result!r} of the drive's at t = "
                f"{step.end!r} s, beyond the {LARGEST_SHIFT!r} up to which an envelope holds; "
                "use solver 2 (rk4)"
            )
        if step.end == step.t:
            raise ModelError(
                f"the envelope cannot keep its tolerance {self.settings.tolerance!r} at t = "
                f"{step.t!r} s"
            )


def _relative(error: float, scale: float) -> float:
    return error / scale if scale else 0.0
