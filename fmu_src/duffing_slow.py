"""The slow model of the Duffing oscillator: averaging to second order around an exact linear part.

In the plane of the two oscillating modes, q~ = z + conj(z) with z' = S z in the linear system
(:mod:`duffing_plane`), the equations read, with nothing left out,

    Z = 2 z,   Z' = S Z + 2 G f(t),   q~ = Re Z,   G = (S - conj S)^-1,

f the drive less the cubic forces. In the frame of the phase phi = 2 pi c t, with c the mean drive
frequency, q~ = Re[Q exp(i phi) + R exp(3 i phi)], Q = (linear periodic response) + y - B N,

    y' = (S - 2 pi i c) y - G N(Q, R),    R = -X(3 c) N3(Q),

where N and N3 are the parts at exp(i phi) and exp(3 i phi) of the cubic forces. B and X are
matrices: a mode that only follows the other has no cubic force to speak of, and what it gets
through the damping is of the order of the other's shift. To first order
N1 = 3/4 alpha1 |Q1|^2 Q1 + kappa/4 (2 |Q2|^2 Q1 + conj(Q1) Q2^2); kept as well are what R does to
N and the response -B N to the part at exp(-i phi). So the linear limit is exact, and what is left
out is of second order: about eps (3 eps + |u1 - u2|/c) of an amplitude, with eps its relative
frequency shift by the cubic terms (N. N. Bogoliubov, Y. A. Mitropolsky, Asymptotic Methods in the
Theory of Non-linear Oscillations, Gordon and Breach 1961, section 1). The slow variables are the
coordinates w of y along the eigenvectors of S.
"""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING, NamedTuple

from .duffing_plane import inverse, plane
from .model_error import ModelError
from .oscillator_equations import TWO_PI, Parameters, damping, phasors, transformation
from .oscillator_phase import Frequency

if TYPE_CHECKING:
    from .duffing_equations import Cubic

    Pair = tuple[complex, complex]
    Matrix = tuple[complex, complex, complex, complex]
    #: Displacements in m and velocities over 2 pi of both modes, as complex numbers.
    State = tuple[complex, complex, complex, complex]

#: The frame turns at a frequency between these multiples of an eigenfrequency, ...
FRAME = 0.5, 2.0
#: ... no tone is further from it than this part of it, ...
SPREAD = 0.25
#: ... and three times the frame's frequency is further than this part from an eigenfrequency.
THIRD = 0.1


class Tone(NamedTuple):
    """A drive tone: its detuning from the frame, cycles added, and the responses with amplitude.

    ``response`` is the phasor X(u) A exp(i phase), ``mirror`` the conjugate of what its
    counter-rotating half does to Z.
    """

    detuning: Frequency
    offset: float
    response: Pair
    mirror: Pair


class SlowModel:
    """Everything about a set of parameters that the slow motion needs."""

    def __init__(self, p: Parameters, cubic: Cubic, offsets: tuple[float, float]) -> None:
        """Settle the frame; raise ModelError for a scene to which averaging does not apply."""
        self.p, self.cubic = p, cubic
        active = [
            (u, cmath.rect(size, phase), offset)
            for u, size, phase, offset in zip(
                (p.u1, p.u2), (p.A1, p.A2), (p.phase1, p.phase2), offsets
            )
            if size
        ]
        self.centre = frame_frequency(p)
        self.detunings = [u - self.centre for u, _, _ in active]
        self._spread = abs(p.u1 - p.u2) / self.centre if p.A1 and p.A2 else 0.0
        if any(cubic):
            _check_frame(p, self.centre, self.detunings)
        self.plane = plane(p, self.centre)
        #: The rates of the linear motion of w, in 1/s.
        self.rates = self.plane.rates
        self._set_corrections(p)
        self.tones = [self._tone(u, amplitude, offset) for u, amplitude, offset in active]
        self._responses = [tone.response for tone in self.tones]
        self._carrier = Frequency(self.centre)
        #: The mode that has the only cubic term, where no mode moves another one.
        self.lone = self._lone_mode()

    def _set_corrections(self, p: Parameters) -> None:
        """Make the responses to cubic forces away from the carrier, across the modes as well.

        A mode that only follows the other one through the damping has no cubic force to speak of:
        what the other's does to it is of the order of its shift, and not less.
        """
        omega, widths = TWO_PI * self.centre, damping(p)
        #: B and its like at 3 c, and X(3 c).
        self._behind = self._mirrored(omega)
        self._behind3 = self._mirrored(3.0 * omega)
        cross = complex(0.0, 3.0 * omega * TWO_PI * widths.w12)
        first, second = (
            complex(
                TWO_PI * (eta - 3.0 * self.centre) * TWO_PI * (eta + 3.0 * self.centre),
                3.0 * omega * TWO_PI * width,
            )
            for eta, width in ((p.eta_plus, widths.w11), (p.eta_minus, widths.w22))
        )
        self._third = inverse(first, cross, cross, second)

    def _mirrored(self, omega: float) -> Matrix:
        s11, s12, s21, s22 = (s.conjugate() for s in self.plane.solvent)
        turn = 1j * omega
        m11, m12, m21, m22 = inverse(turn - s11, -s12, -s21, turn - s22)
        h11, h12, h21, h22 = self.plane.gain
        return (
            1j * (m11 * h11 + m12 * h21),
            1j * (m11 * h12 + m12 * h22),
            1j * (m21 * h11 + m22 * h21),
            1j * (m21 * h12 + m22 * h22),
        )

    def _tone(self, u: float, amplitude: complex, offset: float) -> Tone:
        p, (s11, s12, s21, s22) = self.p, (s.conjugate() for s in self.plane.solvent)
        turn = 1j * TWO_PI * u
        m11, m12, m21, m22 = inverse(turn - s11, -s12, -s21, turn - s22)
        h11, h12, h21, h22 = self.plane.gain
        k1, k2 = 1j * (h11 * p.g1 + h12 * p.g2), 1j * (h21 * p.g1 + h22 * p.g2)
        x1, x2 = phasors(p, u)
        return Tone(
            Frequency(u - self.centre),
            offset,
            (x1 * amplitude, x2 * amplitude),
            ((m11 * k1 + m12 * k2) * amplitude, (m21 * k1 + m22 * k2) * amplitude),
        )

    # -- the slow equations ---------------------------------------------------------------------

    def linear(self, t: float) -> Pair:
        """Return the slow amplitudes of the linear periodic response at ``t`` s, in m."""
        return self.rotated(self.turns(t))

    def turns(self, t: float) -> list[complex]:
        """Return each tone's phase in the frame at ``t`` s, as a complex number of size 1."""
        return [
            cmath.rect(1.0, TWO_PI * (detuning.cycles(t) + offset))
            for detuning, offset, _, _ in self.tones
        ]

    def onwards(self, h: float) -> list[complex]:
        """Return what the turns of the tones are multiplied by in ``h`` s."""
        return [cmath.rect(1.0, TWO_PI * tone.detuning.cycles(h)) for tone in self.tones]

    def rotated(self, turns: list[complex]) -> Pair:
        """Return what :meth:`linear` does, from the turns of the tones."""
        q1 = q2 = 0j
        for (r1, r2), turn in zip(self._responses, turns):
            q1 += r1 * turn
            q2 += r2 * turn
        return q1, q2

    def lone_rotated(self, turns: list[complex]) -> complex:
        """Return what :meth:`turned` does, of the lone mode."""
        q = 0j
        for response, turn in zip(self._own_responses, turns):
            q += response * turn
        return q

    def amplitudes(self, w: Pair, linear: Pair) -> Pair:
        """Return Q of both modes, in m: |Q| is the amplitude at the drive frequencies.

        Q = Q0 - B N(Q), Q0 all but the last term, in two rounds: a mode far below the drive is
        moved by several times its relative frequency shift.
        """
        y1, y2 = self.plane.amplitudes(*w)
        q1, q2 = linear[0] + y1, linear[1] + y2
        if self.lone is not None:
            q = self.lone_amplitude((q1, q2)[self.lone])
            return (q1, q) if self.lone else (q, q2)
        b11, b12, b21, b22 = self._behind
        n1, n2 = self.leading_forces(q1, q2)
        n1, n2 = self.forces(q1 - (b11 * n1 + b12 * n2), q2 - (b21 * n1 + b22 * n2))
        return q1 - (b11 * n1 + b12 * n2), q2 - (b21 * n1 + b22 * n2)

    def moved(self, q1: complex, q2: complex) -> Pair:
        """Return B N: how far the counter-rotating half of the cubic forces moves both modes."""
        return times(self._behind, *self.forces(q1, q2))

    def deviation(self, q: Pair, linear: Pair) -> Pair:
        """Return w from Q, the inverse of ``amplitudes``."""
        n1, n2 = self.moved(*q)
        return self.plane.coordinates(q[0] + n1 - linear[0], q[1] + n2 - linear[1])

    def slope(self, w: Pair, linear: Pair) -> tuple[complex, complex, complex, complex]:
        """Return w' less the part with ``rates``, and Q, of both modes."""
        q1, q2 = self.amplitudes(w, linear)
        n1, n2 = self.forces(q1, q2)
        (h11, h12, h21, h22), (c12, c21) = self.plane.gain, self.plane.cross
        s1, s2 = self.plane.coordinates(1j * (h11 * n1 + h12 * n2), 1j * (h21 * n1 + h22 * n2))
        return s1 + c12 * w[1], s2 + c21 * w[0], q1, q2

    def _lone_mode(self) -> int | None:
        """Return the mode with the only cubic term, None where modes move each other."""
        (_, h12, h21, _), (alpha1, alpha2, kappa) = self.plane.gain, self.cubic
        coupled = (h12, h21, kappa, *self.plane.cross, *self.plane.mix)
        if any(coupled) or bool(alpha1) == bool(alpha2):
            return None
        lone = int(not alpha1)
        alpha, third = self.cubic[lone], self._third[3 * lone]
        #: N = Q |Q|^2 (first + second |Q|^2) of this mode alone: ``forces`` in one line.
        self._first, self._second = 0.75 * alpha, -0.1875 * alpha * alpha * third
        self._own_behind, self._own_gain = self._behind[3 * lone], 1j * self.plane.gain[3 * lone]
        self._own_responses = [response[lone] for response in self._responses]
        return lone

    def lone_amplitude(self, q: complex) -> complex:
        """Return Q of the lone mode from what it is without -B N."""
        first, second, behind = self._first, self._second, self._own_behind
        m = q.real * q.real + q.imag * q.imag
        moved = q - behind * (q * (m * first))
        m = moved.real * moved.real + moved.imag * moved.imag
        return q - behind * (moved * m * (first + second * m))

    def lone_slope(self, w: complex, linear: complex) -> tuple[complex, complex]:
        """Return what :meth:`slope` does, of the lone mode."""
        first, second = self._first, self._second
        q0 = linear + w
        m = q0.real * q0.real + q0.imag * q0.imag
        # lone_amplitude: a step comes here five times
        q = q0 - self._own_behind * (q0 * (m * first))
        m = q.real * q.real + q.imag * q.imag
        q = q0 - self._own_behind * (q * m * (first + second * m))
        m = q.real * q.real + q.imag * q.imag
        return self._own_gain * (q * m * (first + second * m)), q

    def leading_forces(self, q1: complex, q2: complex) -> Pair:
        """Return N of both modes without what third harmonics do to it."""
        alpha1, alpha2, kappa = self.cubic
        m1, m2 = q1.real * q1.real + q1.imag * q1.imag, q2.real * q2.real + q2.imag * q2.imag
        n1, n2 = 0.75 * alpha1 * m1 * q1, 0.75 * alpha2 * m2 * q2
        if kappa:
            n1 += 0.25 * kappa * (2.0 * m2 * q1 + q1.conjugate() * (q2 * q2))
            n2 += 0.25 * kappa * (2.0 * m1 * q2 + q2.conjugate() * (q1 * q1))
        return n1, n2

    def forces(self, q1: complex, q2: complex) -> Pair:
        """Return N, the cubic forces at the carrier, of both modes."""
        alpha1, alpha2, kappa = self.cubic
        s1, s2 = q1 * q1, q2 * q2
        c1, c2 = q1.conjugate(), q2.conjugate()
        m1, m2 = (q1 * c1).real, (q2 * c2).real
        # R = -X(3 c) N3, less its sign
        (t11, t12, t21, t22), n1, n2 = self._third, 0.25 * q1, 0.25 * q2
        n1, n2 = n1 * (alpha1 * s1 + kappa * s2), n2 * (alpha2 * s2 + kappa * s1)
        r1, r2 = t11 * n1 + t12 * n2, t21 * n1 + t22 * n2
        n1 = 0.75 * alpha1 * (m1 * q1 - c1 * c1 * r1)
        n2 = 0.75 * alpha2 * (m2 * q2 - c2 * c2 * r2)
        if kappa:
            both = 2.0 * c1 * c2
            n1 += 0.25 * kappa * (2.0 * m2 * q1 + c1 * s2 - c2 * c2 * r1 - both * r2)
            n2 += 0.25 * kappa * (2.0 * m1 * q2 + c2 * s1 - c1 * c1 * r2 - both * r1)
        return n1, n2

    # -- what averaging leaves out --------------------------------------------------------------

    def averaging_error(self, w: Pair, t: float, eps: float) -> float:
        """Return the bound of what averaging leaves out of a displacement's largest line.

        Relative to that line, the worst of q~1, q~2, q1, q2; ``eps`` is the relative frequency
        shift at ``t`` s. Each mode's own part is eps (3 eps + |u1 - u2|/c), the latter at least
        1.5 |B N|/|Q| |u1 - u2|/c, and what is left of the rounds of ``amplitudes``. A mode that
        follows the other one through the damping takes over what that one lacks, which is more
        where the drive of its own nearly cancels it; so does a sum of both modes.
        """
        if eps == 0.0:
            return 0.0
        linear, y = self.linear(t), self.plane.amplitudes(*w)
        first = linear[0] + y[0], linear[1] + y[1]
        moved = times(self._behind, *self.leading_forces(*first))
        moved = self.moved(first[0] - moved[0], first[1] - moved[1])
        q = first[0] - moved[0], first[1] - moved[1]
        after = self.moved(*q)
        pace = self._pace(w, linear, t)
        lacks = [
            self._size(q[i], pace[i]) * eps * 3.0 * eps
            + self._spread * max(eps * self._size(q[i], pace[i]), 1.5 * abs(after[i]))
            + 2.0 * abs(after[i] - moved[i])
            for i in (0, 1)
        ]
        follows = self._follows(eps)
        errors = max(lacks[0], follows[0] * lacks[1]), max(lacks[1], follows[1] * lacks[0])
        return self._largest_share(errors, q, pace)

    def _largest_share(self, errors: tuple[float, float], q: Pair, pace: Pair) -> float:
        """Return the largest part that the modes' errors are of a displacement, 1 at most."""
        t11, t12, t21, t22 = transformation(self.p.theta, self.p.reflection)
        result = 0.0
        for a, b in ((1.0, 0.0), (0.0, 1.0), (t11, t21), (t12, t22)):
            error = abs(a) * errors[0] + abs(b) * errors[1]
            size = self._size(a * q[0] + b * q[1], a * pace[0] + b * pace[1])
            if error > 0.0:
                result = max(result, error / size if error < size else 1.0)
        return result

    def _pace(self, w: Pair, linear: Pair, t: float) -> Pair:
        """Return Q' over pi |u1 - u2| of both modes, which turns with two lines of a beat."""
        if not self._spread:
            return 0j, 0j
        rotated = [1j * TWO_PI * d * turn for d, turn in zip(self.detunings, self.turns(t))]
        d1, d2 = self.rotated(rotated)
        n1, n2, _, _ = self.slope(w, linear)
        y1, y2 = self.plane.amplitudes(self.rates[0] * w[0] + n1, self.rates[1] * w[1] + n2)
        scale = 1.0 / (0.5 * TWO_PI * self._spread * self.centre)
        return scale * (d1 + y1), scale * (d2 + y2)

    def _size(self, q: complex, pace: complex) -> float:
        """Return |Q|; of two tones the root of the sum of their lines' squares, which is steady."""
        if not self._spread:
            return abs(q)
        return abs(complex(abs(q), abs(pace))) * math.sqrt(0.5)

    def _follows(self, eps: float) -> tuple[float, float]:
        """Return what each mode takes over of the other one through the damping, at c."""
        omega, widths = TWO_PI * self.centre, damping(self.p)
        across, room = omega * TWO_PI * abs(widths.w12), 6.0 * eps * omega * omega
        if across == 0.0:
            return 0.0, 0.0
        result = []
        for eta, width in ((self.p.eta_plus, widths.w11), (self.p.eta_minus, widths.w22)):
            apart = abs(TWO_PI * (eta - self.centre) * TWO_PI * (eta + self.centre))
            resists = abs(complex(max(apart - room, 0.0), omega * TWO_PI * width))
            result.append(across / resists if across < 1e300 * resists else 1e300)
        return result[0], result[1]

    # -- the full motion ------------------------------------------------------------------------

    def displacement(self, q: Pair, t: float) -> tuple[float, float]:
        """Return q~1, q~2 in m from Q at ``t`` s, third harmonics included."""
        q1, q2 = q
        turn = cmath.rect(1.0, TWO_PI * self._carrier.cycles(t))
        r1, r2 = times(self._third, *self._third_forces(q1, q2))
        cube = turn * turn * turn
        return (q1 * turn).real - (r1 * cube).real, (q2 * turn).real - (r2 * cube).real

    def full_state(self, w: Pair, t: float) -> State:
        """Return displacements and velocities over 2 pi."""
        turn = cmath.rect(1.0, TWO_PI * self._carrier.cycles(t))
        rest1, rest2 = self._next_to(w, self.linear(t), t, turn)
        y1, y2 = self.plane.amplitudes(*w)
        z1, z2 = y1 * turn + rest1, y2 * turn + rest2
        s11, s12, s21, s22 = self.plane.solvent
        v1, v2 = s11 * z1 + s12 * z2, s21 * z1 + s22 * z2
        return (
            complex(z1.real),
            complex(z2.real),
            complex(v1.real / TWO_PI),
            complex(v2.real / TWO_PI),
        )

    def slow_state(self, state: State, t: float) -> Pair:
        """Return w, the inverse of ``full_state``.

        What lies next to w depends on it through the cubic forces: iterated, it gains the factor
        of the relative frequency shift each time.
        """
        q1, q2 = state[0].real, state[1].real
        v1, v2 = TWO_PI * state[2].real, TWO_PI * state[3].real
        s11, s12, s21, s22 = (s.conjugate() for s in self.plane.solvent)
        w1, w2 = v1 - s11 * q1 - s12 * q2, v2 - s21 * q1 - s22 * q2
        h11, h12, h21, h22 = self.plane.gain
        z1, z2 = -2j * (h11 * w1 + h12 * w2), -2j * (h21 * w1 + h22 * w2)
        linear, turn = self.linear(t), cmath.rect(1.0, TWO_PI * self._carrier.cycles(t))
        back = turn.conjugate()
        w = self.plane.coordinates(z1 * back - linear[0], z2 * back - linear[1])
        for _ in range(12):
            rest1, rest2 = self._next_to(w, linear, t, turn)
            w = self.plane.coordinates((z1 - rest1) * back, (z2 - rest2) * back)
        return w

    def _next_to(self, w: Pair, linear: Pair, t: float, turn: complex) -> Pair:
        """Return Z less y exp(i phi): the linear response and the parts away from the carrier."""
        ahead, mirror = [0j, 0j], [0j, 0j]
        for tone in self.tones:
            part = cmath.rect(1.0, TWO_PI * (tone.detuning.cycles(t) + tone.offset))
            for i in (0, 1):
                mirror[i] += tone.mirror[i] * part
                ahead[i] += (tone.response[i] - tone.mirror[i]) * part
        y, q = self.plane.amplitudes(*w), self.amplitudes(w, linear)
        forces, cube, total = self._third_forces(*q), turn * turn * turn, [0j, 0j]
        mirror3, third = times(self._behind3, *forces), times(self._third, *forces)
        for i in (0, 1):
            behind = mirror[i] + (q[i] - linear[i] - y[i])
            behind3 = -mirror3[i]
            ahead3 = -third[i] - behind3
            total[i] = ahead[i] * turn + ahead3 * cube
            total[i] += (behind * turn + behind3 * cube).conjugate()
        return total[0], total[1]

    def _third_forces(self, q1: complex, q2: complex) -> Pair:
        """Return N3, the cubic forces at three times the carrier, to first order."""
        alpha1, alpha2, kappa = self.cubic
        s1, s2 = q1 * q1, q2 * q2
        return 0.25 * q1 * (alpha1 * s1 + kappa * s2), 0.25 * q2 * (alpha2 * s2 + kappa * s1)


def times(matrix: Matrix, x1: complex, x2: complex) -> Pair:
    """Return a matrix times a pair."""
    m11, m12, m21, m22 = matrix
    return m11 * x1 + m12 * x2, m21 * x1 + m22 * x2


def frame_frequency(p: Parameters) -> float:
    """Return c in Hz: the mean of the active tones' frequencies, or the mode nearest to u1."""
    active = [u for u, size in ((p.u1, p.A1), (p.u2, p.A2)) if size]
    if any(active):
        return sum(active) / len(active)
    return min((p.eta_plus, p.eta_minus), key=lambda eta: abs(eta - p.u1))


def _check_frame(p: Parameters, centre: float, detunings: list[float]) -> None:
    """Raise ModelError where a frame at ``centre`` Hz does not hold the cubic motion."""
    low, high = min(p.eta_plus, p.eta_minus), max(p.eta_plus, p.eta_minus)
    where = f"the drive's centre {centre!r} Hz, eta_plus = {p.eta_plus!r} Hz, eta_minus = "
    where += f"{p.eta_minus!r} Hz"
    if not FRAME[0] * low <= centre <= FRAME[1] * high:
        why = f"the drive is beyond {FRAME[0]!r} to {FRAME[1]!r} times the eigenfrequencies"
    elif any(abs(detuning) > SPREAD * centre for detuning in detunings):
        why = f"u1 = {p.u1!r} Hz and u2 = {p.u2!r} Hz are too far apart for one rotating frame"
    elif any(abs(3.0 * centre / eta - 1.0) < THIRD for eta in (p.eta_plus, p.eta_minus)):
        why = "the third harmonic of the drive meets an eigenfrequency"
    else:
        return
    raise ModelError(f"{why} ({where}): use solver 2 (rk4)")
