"""What drives a sample of the virtual laboratory: tones, and the lines that are read of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass


@dataclass(frozen=True)
class Drive:
    """Tones in Hz, all with phase zero, and the acceleration of each in m/s^2.

    ``gains`` is what each of the two modes sees of them; ``lines`` are the combinations that are
    read, "2 u1 - u2" as (2, -1); () the tones themselves.

    Raises:
        ValueError: not a tone, two that are equal, or not an amplitude for each.
    """

    tones_hz: tuple[float, ...]
    amplitudes: tuple[float, ...]
    _: KW_ONLY
    gains: tuple[float, float] = (1.0, 1.0)
    lines: tuple[tuple[int, ...], ...] = ()

    def __post_init__(self) -> None:
        if not self.tones_hz or len(set(self.tones_hz)) < len(self.tones_hz):
            raise ValueError(f"tones {self.tones_hz} Hz, wanted one or two that differ")
        if len(self.amplitudes) != len(self.tones_hz):
            raise ValueError(f"{len(self.amplitudes)} amplitudes for tones {self.tones_hz} Hz")

    @classmethod
    def equal(cls, tones_hz: Sequence[float], level: float) -> Drive:
        """Tones that all have the same amplitude.

        Args:
            tones_hz: frequencies of the tones, Hz.
            level: amplitude of every tone, m/s².
        """
        return cls(tuple(tones_hz), (level,) * len(tones_hz))

    @property
    def read(self) -> tuple[tuple[int, ...], ...]:
        """The combinations that are read, written out."""
        count = len(self.tones_hz)
        alone = tuple(tuple(int(i == k) for i in range(count)) for k in range(count))
        return self.lines or alone

    def tone_of(self, line: Sequence[int]) -> int | None:
        """The place of the tone that a combination is, None for one of several.

        Args:
            line: factors of the tones, one each.
        """
        return list(line).index(1) if sorted(line)[-1] == 1 and sum(map(abs, line)) == 1 else None
