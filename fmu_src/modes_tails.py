"""What lies beyond the cut of a chain of sidebands: bounds from scalars alone.

Beyond the cut X_k = -S_k^-1 C_p/2 X_(k-1), k counted outwards, with the Schur complements S_k =
A(v_k) - C_p/2 S_(k+1)^-1 C_p/2. Let p = |C_p|, a_k <= 1/|A(v_k)^-1| (``Frame.distance``), d the
least damping, c_k = |v_k| (the envelope's: its centre), and s_k a bound of |S_k^-1|.

1. s_k = 1/(a_k - p^2 s_(k+1)/4), where that is positive.
2. Far out, where v^2 is above the eigenvalues of C by g >= 2 p, the fixed point of that recursion,
   s = 2/(g + sqrt(g^2 - p^2)): all further a_k are larger.
3. Where v keeps its sign from k outwards, damping alone bounds S_k, at a resonance too. With
   |x| = 1 and y = S_(k+1)^-1 C_p/2 x, the imaginary part of x* S_k x is that of x* A x plus that of
   y* S_(k+1) y, all of this sign, so that |S_k x| >= d c_k (1 + |y|^2); and |S_k x| >= a_k -
   p |y|/2. One of both holds as |y| is below or above a_k/p:
   s_k = 1/max(d c_k, min(a_k/2, d c_k (1 + (a_k/p)^2))).
4. By the same sign all X_j, j > k, together are at most z |X_k| in the 2-norm, z = p/(2 d c_(k+1)).
   N of them come before those of 2, which fall to 1/3.7 each: their sum is z (sqrt(N) + 1/2).
5. Below the lowest eigenfrequency e, on the way from v to -v, every a_k >= G = e^2 - v^2. If G >=
   2 p and a sideband m on the other side of 0 has p^2 s_m <= 2 G by 3, then 1 gives s_k <= 2/G for
   all between at once: what resounds at -e is not followed.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from .model_error import ModelError

if TYPE_CHECKING:
    from .modes_steady import Frame

#: Sidebands beyond the cut for which the recursion is walked, as it is the tightest bound.
FOLLOWED = 4
#: Where a sideband of 5 is looked for, over e: damping bounds it best at e/sqrt(7).
MIRROR = 0.38
#: No more steps of the recursion than this, where nothing else bounds.
MOST_BOUNDED = 200_000


class Tail(NamedTuple):
    """Bounds beyond the sideband ``end``, the first one from the asked one on that has them.

    ``schur``: of |S^-1| of the next one; ``rest``: of the sum of |X| of all beyond over |X_end|.
    """

    end: int
    schur: float
    rest: float


class Side:
    """The sidebands on one side of a tone, upwards or downwards by ``sign``, counted from 1."""

    def __init__(self, frame: Frame, u: float, sign: int) -> None:
        self._frame, self._u, self._sign = frame, u, sign
        self._p = frame.matrices.pump_norm
        self._half = 0.5 * self._p

    def at(self, k: float) -> float:
        """Return the frequency of the k-th sideband in Hz."""
        return self._u + self._sign * k * self._frame.pump_hz

    def guess(self, wanted: float, most: int) -> int:
        """Return after how many sidebands, at most ``most``, a part of the carrier may be left."""
        k, left = 0, 1.0
        while left > wanted and k <= most:
            k += 1
            distance = self._frame.distance(self.at(k))
            left = min(1.0, left * self._half / distance) if distance > 0.0 else 1.0
        return max(k - 1, 1)

    def tail(self, end: int) -> Tail:
        """Return what is beyond a chain that reaches ``end``, or the next one that has bounds.

        Raises ModelError where that would have to be looked for too far.
        """
        k = end + 1
        while k < end + FOLLOWED and not self._far(k):
            k += 1
        started = self._started(k)
        if started is None:
            k, started = self._followed_from(end)
        schur, rest = started
        for inner in range(k - 1, end, -1):
            rest = self._half * schur * (1.0 + rest)
            following = self._recursion(inner, schur)
            if following == math.inf:
                return Tail(inner, schur, rest)
            schur = following
        return Tail(end, schur, self._half * schur * (1.0 + rest))

    def _started(self, k: int) -> tuple[float, float] | None:
        """Return s_k and the sum of |X_j|, j > k, over |X_k|, by 2 to 5; None where none holds."""
        p, far = self._p, self._far(k)
        if far:
            schur = 2.0 / (far + math.sqrt((far - p) * (far + p)))
            ratio = self._half * schur
            return schur, ratio / (1.0 - ratio)
        if self._loss(k):
            return self._damped(k), self._together(k)
        if self._frame.centre is not None:
            return None
        mirror = self._mirror()
        widest = max(abs(self.at(k)), abs(self.at(mirror)))
        gap = self._frame.matrices.lowest - widest * widest
        if not (gap >= 2.0 * p and p * p * self._damped(mirror) <= 2.0 * gap):
            return None
        ratio = p / gap
        left = ratio ** (mirror - 1.0 - k) * self._together(mirror - 1.0)
        return 2.0 / gap, ratio / (1.0 - ratio) + left

    def _mirror(self) -> float:
        """Return a sideband of 5, beyond 0 Hz."""
        e = math.sqrt(self._frame.matrices.lowest)
        return math.floor((MIRROR * e - self._sign * self._u) / self._frame.pump_hz) + 1.0

    def _followed_from(self, end: int) -> tuple[int, tuple[float, float]]:
        """Return from where the recursion is followed to ``end``, and what ``_started`` has of it.

        That is where 5 begins to hold, below a resonance, or else a sideband beyond 0 Hz.
        """
        below = math.sqrt(max(self._frame.matrices.lowest - 2.0 * self._p, 0.0))
        gap = math.floor((-self._sign * self._u - below) / self._frame.pump_hz) + 1.0
        for k in (gap, self._mirror()):
            if end < k <= end + MOST_BOUNDED:
                started = self._started(int(k))
                if started is not None:
                    return int(k), started
        raise ModelError(
            f"pump_hz = {self._frame.pump_hz!r} Hz is too slow: what more than {MOST_BOUNDED} "
            f"sidebands of a drive at {self._u!r} Hz do cannot be bounded"
        )

    def _far(self, k: float) -> float:
        """Return a bound of a_j for all j >= k if it is twice the pump's norm, else 0."""
        v, m = self.at(k), self._frame.matrices
        square = self._frame.square(v)
        rising = self._frame.centre is None or self._sign > 0
        gap = square - m.highest if rising else m.lowest - square
        outwards = self._frame.centre is not None or v * self._sign > 0.0
        return gap if outwards and gap >= 2.0 * self._p else 0.0

    def _loss(self, k: float) -> float:
        """Return d c_k if the damping of all from k outwards has one sign, else 0."""
        v, c = self.at(k), self._frame.centre
        carrier = v * self._sign if c is None else abs(c)
        return max(carrier, 0.0) * self._frame.matrices.narrowest

    def _damped(self, k: float) -> float:
        """Return s_k by 3."""
        loss, distance = self._loss(k), self._frame.distance(self.at(k))
        part = distance / self._p
        least = max(loss, min(0.5 * distance, loss * (1.0 + part * part)))
        return 1.0 / least if least > 0.0 else math.inf

    def _together(self, k: float) -> float:
        """Return the sum of |X_j|, j > k, over |X_k|, by 4."""
        m, c = self._frame.matrices, self._frame.centre
        loss = self._loss(k + 1.0)
        if c is None:
            edge = math.sqrt(m.highest + 2.0 * self._p)
        else:
            square = m.highest + 2.0 * self._p if self._sign > 0 else m.lowest - 2.0 * self._p
            edge = 0.5 * (square / c + c) * self._sign
        near = max(math.ceil((edge - self.at(k) * self._sign) / self._frame.pump_hz), 1)
        return self._half / loss * (math.sqrt(near) + 0.5) if loss > 0.0 else math.inf

    def _recursion(self, k: int, outer: float) -> float:
        """Return s_k by 1, by 3 where that is less; inf where there is none."""
        rest = self._frame.distance(self.at(k)) - 0.25 * self._p * self._p * outer
        result = 1.0 / rest if rest > 0.0 else math.inf
        return min(result, self._damped(k)) if self._loss(k) else result
