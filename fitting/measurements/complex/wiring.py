"""Wiring: how the response H of the FMU stands in what an instrument sees.

    transmission   S = e (a H + b + b' x)            a resonance that is driven and read
    notch          S = a e (1 + s x + c H)           one beside a feed line; hanger
    reflection     S = a e (1 + s x + c H)           one at the end of a line

    e = exp(-i 2 pi (u - u0) tau)     x = (u - u0)/half the span     u0 the middle of the sweep

a, b, b', s and c are complex and enter linearly, as a, b, b', a s and a c: they are solved inside
every evaluation (`fitting.measurements.complex.gain`). The delay tau is a parameter of the fit. A
complex gain with a constant background background makes a Fano line. Values count phases as
Re[S exp(i 2 pi u t)].

Source: S. Probst, F. Song, P. Bushev, A. Ustinov, M. Weides, Rev. Sci. Instrum. 86 (2015) 024706.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.text.arguments import checked
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput

WIRINGS = ("transmission", "notch", "reflection")
BACKGROUNDS = ("none", "constant", "slope")


@checked
@dataclass(frozen=True, kw_only=True)
class Wiring:
    """What stands beside the response.

    Args:
        kind: "transmission", "notch" or "reflection".
        background: "none", "constant" or "slope"; the constant of a notch or reflection is there
            anyway.

    Raises:
        BadInput: another word.
    """

    kind: str = "transmission"
    background: str = "none"

    def __post_init__(self) -> None:
        for name, known in (("kind", WIRINGS), ("background", BACKGROUNDS)):
            if getattr(self, name) not in known:
                raise BadInput(
                    f"wiring: {name} is {getattr(self, name)!r}, wanted one of {', '.join(known)}"
                )

    @property
    def has_baseline(self) -> bool:
        """Whether something passes the resonance by that its gain multiplies, too."""
        return self.kind != "transmission"

    @property
    def columns(self) -> int:
        """Number of complex unknowns that enter linearly."""
        nearby = BACKGROUNDS.index(self.background)
        return 1 + (max(nearby, 1) if self.has_baseline else nearby)

    def design(
        self, frequency_hz: FloatArray, response: ComplexArray, delay_s: float, middle_hz: float
    ) -> ComplexArray:
        """Columns H e, e, x e, as many as there are: (n, columns).

        Args:
            frequency_hz: u (n,), Hz.
            response: H (n,), in the FMU's unit.
            delay_s: tau, s.
            middle_hz: u0, Hz.
        """
        rotated = np.exp(-2j * np.pi * (frequency_hz - middle_hz) * delay_s)
        x = (frequency_hz - middle_hz) / max(0.5 * float(np.ptp(frequency_hz)), 1e-300)
        columns = np.column_stack([response, np.ones_like(x), x][: self.columns])
        return np.asarray(columns * rotated[:, None])
