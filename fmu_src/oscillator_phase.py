"""Phases of long runs: the fractional part of frequency times time, to a double's last bit.

At 10 GHz and 1e4 s a phase counts 1e14 cycles, of which a plain product keeps two decimals. Here
the product is carried as an unevaluated sum of two doubles (T. J. Dekker, Numer. Math. 18, 224,
1971), from which the whole cycles drop out exactly.
"""

from __future__ import annotations

_SPLITTER = 134_217_729.0  # 2^27 + 1
#: Above this a product with the splitter could overflow.
LARGEST = 1e150


def halves(x: float) -> tuple[float, float]:
    """Return x as high + low, each of at most 26 bits, so that their products are exact."""
    c = _SPLITTER * x
    high = c - (c - x)
    return high, x - high


class Frequency:
    """A frequency in Hz as the sum of two doubles, ready for exact phases."""

    __slots__ = ("high", "high_high", "high_low", "low")

    def __init__(self, high: float, low: float = 0.0) -> None:
        self.high, self.low = high, low
        self.high_high, self.high_low = halves(high)

    def cycles(self, t: float, t_low: float = 0.0) -> float:
        """Return frequency times (t + t_low) less whole cycles, within [-1/2, 3/2)."""
        product = self.high * t
        c = _SPLITTER * t
        t_high = c - (c - t)
        t_rest = t - t_high
        error = (
            (self.high_high * t_high - product) + self.high_high * t_rest + self.high_low * t_high
        ) + self.high_low * t_rest
        return product % 1.0 + (error + (self.low * t + self.high * t_low))


def difference(t: float, origin: float) -> tuple[float, float]:
    """Return t - origin as the unevaluated sum of two doubles (D. E. Knuth's two-sum)."""
    high = t - origin
    back = high - t
    return high, (t - (high - back)) - (origin + back)


def kept_phase(offset: float, before: float, after: float, t: float) -> float:
    """Return the cycles to add to a tone so that a new frequency continues its phase at ``t`` s."""
    if before == after:
        return offset
    return (offset + Frequency(before).cycles(t) - Frequency(after).cycles(t)) % 1.0


def kept_phases(
    offsets: tuple[float, float],
    before: tuple[float, float],
    after: tuple[float, float],
    t: float,
) -> tuple[float, float]:
    """Return the offsets in cycles of both tones, as ``kept_phase`` does for one."""
    return (
        kept_phase(offsets[0], before[0], after[0], t),
        kept_phase(offsets[1], before[1], after[1], t),
    )
