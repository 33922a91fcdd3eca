"""Wiring: how the response H of the FMU stands in what an instrument sees.

    transmission   S = e (a H + b + b' x)            a resonance that is driven and read
    notch          S = a e (1 + s x + c H)           one beside a feed line; hanger
    reflection     S = a e (1 + s x + c H)           one at the end of a line

    e = exp(-i 2 pi (u - u0) tau)     x = (u - u0)/half the span     u0 the middle of the sweep

a, b, b', s and c are complex and enter linearly, as a, b, b', a s and a c: they are solved inside
every evaluation (variable projection). The delay tau is a parameter of the fit. A complex gain
beside a constant background makes a Fano line. Values count phases as Re[S exp(i 2 pi u t)].

Where one mode is seen, with loaded quality Q and the dip D = -c H(eta) at its eigenfrequency,

    notch          D = (Q/|Qc|) exp(i phi)           reflection     D = 2 (Q/|Qc|) exp(i phi)

    1/Qc = Re(1/(|Qc| exp(-i phi)))                  1/Qi = 1/Q - 1/Qc

which is the diameter correction: the real part of D counts, not its modulus.
Source: S. Probst, F. Song, P. Bushev, A. Ustinov, M. Weides, Rev. Sci. Instrum. 86 (2015) 024706;
G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413 (variable projection).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.signal.complex_line import complex_line
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput

WIRINGS = ("transmission", "notch", "reflection")
BACKGROUNDS = ("none", "constant", "slope")
#: What one mode may leave of a response that counts as that of a single one.
SINGLE = 1e-2


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
        beside = BACKGROUNDS.index(self.background)
        return 1 + (max(beside, 1) if self.has_baseline else beside)

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
        turned = np.exp(-2j * np.pi * (frequency_hz - middle_hz) * delay_s)
        x = (frequency_hz - middle_hz) / max(0.5 * float(np.ptp(frequency_hz)), 1e-300)
        columns = np.column_stack([response, np.ones_like(x), x][: self.columns])
        return np.asarray(columns * turned[:, None])


@dataclass(frozen=True)
class Solved:
    """Linear least squares of one sweep: `values` (n,), `coefficients` of the columns (k,)."""

    values: ComplexArray
    coefficients: ComplexArray


def solve(
    designs: Sequence[ComplexArray],
    measured: Sequence[ComplexArray],
    weights: Sequence[float],
    *,
    turned: bool = False,
) -> list[Solved]:
    """Sweeps that share the gain of their first column; what is beside it is each one's own.

    With ``turned`` they share the modulus of the gain alone, each with a phase of its own: beside
    the background, taken out of response h and values y of sweep k,

        |a| = sum_k w_k^2 |<h_k, y_k>| / sum_k w_k^2 <h_k, h_k>      arg a_k = arg <h_k, y_k>

    Args:
        designs: columns of each sweep, (n, k).
        measured: values of each sweep, (n,).
        weights: of each sweep's residuals.
        turned: whether each sweep has a phase of its own.
    """
    if len(designs) == 1 and not turned:
        return [_solved(designs[0], _least_squares(designs[0], measured[0]))]
    inner, own, beside = [], [], []
    for design, y in zip(designs, measured, strict=True):
        ground = design[:, 1:]
        both = np.column_stack([design[:, 0], y])
        coefficients = _least_squares(ground, both)
        left = both - ground @ coefficients
        inner.append(np.vdot(left[:, 0], left[:, 1]))
        own.append(float(np.vdot(left[:, 0], left[:, 0]).real))
        beside.append(coefficients)
    squares = np.array(weights) ** 2
    products = np.array(inner)
    total = max(float(squares @ np.array(own)), 1e-300)
    if turned:
        modulus = float(squares @ np.abs(products)) / total
        gains = modulus * np.exp(1j * np.angle(products))
    else:
        gains = np.full(len(designs), complex(squares @ products) / total)
    return [
        _solved(design, np.concatenate([[gain], c[:, 1] - gain * c[:, 0]]))
        for design, gain, c in zip(designs, gains, beside, strict=True)
    ]


def _least_squares(design: ComplexArray, values: ComplexArray) -> ComplexArray:
    """Coefficients of columns of any size."""
    if design.shape[1] == 0:
        return np.empty((0, *values.shape[1:]), dtype=complex)
    sizes = np.linalg.norm(design, axis=0)
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    found = np.linalg.lstsq(design / sizes, values, rcond=None)[0]
    return np.asarray(found / (sizes if found.ndim == 1 else sizes[:, None]))


def _solved(design: ComplexArray, coefficients: ComplexArray) -> Solved:
    return Solved(design @ coefficients, coefficients)


@dataclass(frozen=True, kw_only=True)
class Dip:
    """A mode beside a line: loaded quality `loaded_q`, its dip D = -c H(eta) at resonance."""

    kind: str
    loaded_q: float
    depth: complex

    @property
    def coupling_q(self) -> float:
        """Qc, diameter corrected: 1/Qc = Re D/(k Q), k = 1 for a notch and 2 in reflection."""
        share = self.depth.real / (2.0 if self.kind == "reflection" else 1.0)
        return self.loaded_q / share if share > 0.0 else float("nan")

    @property
    def internal_q(self) -> float:
        """Qi of 1/Qi = 1/Q - 1/Qc; NaN where the coupling takes more than all."""
        left = 1.0 / self.loaded_q - 1.0 / self.coupling_q
        return 1.0 / left if left > 0.0 else float("nan")


def dip_of(
    wiring: Wiring, frequency_hz: FloatArray, response: ComplexArray, coefficients: ComplexArray
) -> Dip | None:
    """The dip of a single mode, None where the response is no single mode or nothing passes it by.

    Args:
        wiring: what stands beside the response.
        frequency_hz: u (n,), Hz.
        response: H (n,), in the FMU's unit.
        coefficients: of the columns H, 1, x, (k,).
    """
    line = complex_line(frequency_hz, response)
    alone = line.misfit < SINGLE and line.width_hz > 0.0
    inside = frequency_hz[0] < line.eta_hz < frequency_hz[-1]
    if not (wiring.has_baseline and alone and inside):
        return None
    baseline = coefficients[1]
    if coefficients.size > 2:
        half = 0.5 * float(np.ptp(frequency_hz))
        baseline = baseline + coefficients[2] * (line.eta_hz - frequency_hz[0] - half) / half
    return Dip(
        kind=wiring.kind,
        loaded_q=line.eta_hz / line.width_hz,
        depth=complex(-coefficients[0] / baseline * line.top),
    )
