"""Complex curve: the values of one sweep, what is known of them, and one mode that they follow.

`Wiring` is how the response H of the FMU stands in what an instrument sees:

    transmission   S = e (a H + b + b' x)            a resonance that is driven and read
    notch          S = a e (1 + s x + c H)           one at a feed line; hanger
    reflection     S = a e (1 + s x + c H)           one at the end of a line

    e = exp(-i 2 pi (u - u0) tau)     x = (u - u0)/half the span     u0 the middle of the sweep

a, b, b', s and c are complex and enter linearly, as a, b, b', a s and a c: they are solved inside
every evaluation (`fitting.measurements.gain`). The delay tau is a parameter of the fit. A
complex gain with a constant background makes a Fano line. Values count phases as
Re[S exp(i 2 pi u t)].

`dip_qualities` are the quality factors of a mode at a line. Where one mode is observed, with loaded
quality Q and the dip D = -c H(eta) at its eigenfrequency, 1 + c H the wiring,

    notch          D = (Q/|Qc|) exp(i phi)           reflection     D = 2 (Q/|Qc|) exp(i phi)

    1/Qc = Re(1/(|Qc| exp(-i phi)))                  1/Qi = 1/Q - 1/Qc

which is the diameter correction: the real part of D counts, not its modulus.
Source: S. Probst, F. Song, P. Bushev, A. Ustinov, M. Weides, Rev. Sci. Instrum. 86 (2015) 024706.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from fitting.campaign.measured import check_count, check_rising
from fitting.lines.starts import ComplexLine, complex_line
from fitting.measurements.gain import Solved
from fitting.measurements.measurement import Estimated
from fitting.measurements.records import Curve, Record
from fitting.measurements.residuals import ResidualCurve, mistakes
from fitting.signal.roughness import roughness
from fitting.text.arguments import checked
from fitting.text.arrays import (
    ComplexArray,
    FloatArray,
    as_numbers,
    as_values,
    both_parts,
    require_size,
)
from fitting.text.errors import BadInput
from fitting.text.finding import Finding
from fitting.text.notation import hertz

WIRINGS = ("transmission", "notch", "reflection")
BACKGROUNDS = ("none", "constant", "slope")


@checked
@dataclass(frozen=True, kw_only=True)
class Wiring:
    """How a response is part of the measured values.

    Args:
        kind: "transmission", "notch" or "reflection".
        background: "none", "constant" or "slope"; a notch or reflection always has the constant.

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


#: Line widths that a sweep has to span for a delay to be told from the phase of the line itself.
WIDTHS_FOR_DELAY = 3.0


@checked
@dataclass(frozen=True, eq=False)
class ComplexCurve(Record, Curve):
    """Complex values of one sweep.

    Args:
        frequency_hz: Frequencies of the tone, shape (n,), Hz, rising.
        values: X + i Y, shape (n,), in ``unit``, phases as Re[values exp(i 2 pi u t)].
        sigma: Standard deviation of each quadrature, in ``unit``; 0: from the residuals.
        settings: Start values of the FMU by variable, in the FMU's units.
        setting_sigma: Standard deviations of settings, in the FMU's units: an offset of each is
            fitted; others are exact.
        label: Name of the sweep; required with several.
        output: The observed output of the FMU; empty: the setup's.
        wiring: How the response is part of the values.
        delay_s: Delay of the cable, s; None: fitted.
        shared: Whether it shares one complex gain with others.
        restarted: Whether its phase of a shared gain is its own.
        unit: Of the values.
        source: Its name in errors.
        left_out: Points of the file that are left out, with reasons.

    Raises:
        BadInput: fewer than 8 points, shapes that differ, values that are no numbers.
    """

    frequency_hz: npt.ArrayLike
    values: npt.ArrayLike
    _: KW_ONLY
    sigma: float = 0.0
    setting_sigma: Mapping[str, float] = field(default_factory=dict)
    wiring: Wiring = field(default_factory=Wiring)
    delay_s: float | None = 0.0
    shared: bool = False
    restarted: bool = False
    source: str = "complex sweep"
    left_out: tuple[Finding, ...] = ()
    u_hz: FloatArray = field(init=False)
    y: ComplexArray = field(init=False)

    def __post_init__(self) -> None:
        where = self.source
        f = as_numbers(self.frequency_hz, f"{where}: frequencies")
        values = np.asarray(as_values(self.values, f"{where}: values"), dtype=complex)
        if f.ndim != 1 or f.shape != values.shape:
            raise BadInput(
                f"{where}: frequencies {f.shape} and values {values.shape}; wanted (n,) for both"
            )
        check_count(f.size, where)
        for name, numbers in (("frequency", f), ("X", values.real), ("Y", values.imag)):
            for i in np.flatnonzero(~np.isfinite(numbers))[:1]:
                raise BadInput(
                    f"{where}: {name} number {i + 1} is {numbers[i]}, wanted a finite number"
                )
        require_size(values, f"{where}: values")
        check_rising(f, where)
        if not np.any(np.abs(values) > 0.0):
            raise BadInput(f"{where}: every value is zero; wanted a resonance")
        object.__setattr__(self, "u_hz", f)
        object.__setattr__(self, "y", values)

    def check_delay(self) -> None:
        """Refuse a delay that is to be fitted and that the sweep does not determine.

        Raises:
            BadInput: the phase of the line itself hides it.
        """
        if self.delay_s is not None:
            return
        span_hz, width_hz = float(np.ptp(self.u_hz)), abs(self.line.width_hz)
        if width_hz * WIDTHS_FOR_DELAY > span_hz:
            raise BadInput(
                f"{self.source}: the sweep spans {hertz(span_hz)}, its line is "
                f"{hertz(width_hz)} wide: a delay is not resolved from the phase "
                f"of the line itself; wanted {WIDTHS_FOR_DELAY:g} line widths, or the delay"
            )

    @cached_property
    def line(self) -> ComplexLine:
        """One mode that the values follow, found without the FMU."""
        return complex_line(self.u_hz, self.y, self.delay_s)

    @cached_property
    def largest(self) -> float:
        """The largest modulus, in ``unit``."""
        return float(np.max(np.abs(self.y)))

    def scatter(self) -> float:
        """Standard deviation of each quadrature about a smooth curve; 0 where there are too few.

        The turns of the cable are taken off, as its phases show them where the delay is unknown.
        """
        delay_s = self.line.delay_s if self.delay_s is None else self.delay_s
        return roughness(self.y * np.exp(2j * np.pi * (self.u_hz - self.u_hz[0]) * delay_s))

    @property
    def rows(self) -> int:
        """Number of residual rows: two for each value."""
        return 2 * int(self.y.size)

    @property
    def top_hz(self) -> float:
        """Where its line is, or the end of the sweep that is nearest to it, Hz."""
        return float(np.clip(self.line.eta_hz, self.u_hz[0], self.u_hz[-1]))

    def rows_of(self, values: FloatArray | ComplexArray) -> FloatArray:
        """Real, then imaginary parts over the largest measured modulus, (2 n,).

        Args:
            values: complex (n,), in the curve's unit.
        """
        return both_parts(np.asarray(values, dtype=complex)) / self.largest

    def without_response(self) -> ComplexArray:
        """Its values less a constant and what is declared to add to the response, (n,).

        Behind the delay that the best single line has.
        """
        middle = 0.5 * float(self.u_hz[0] + self.u_hz[-1])
        delay = self.line.delay_s if self.delay_s is None else self.delay_s
        # the first column is that of the response: without one it is a constant
        columns = self.wiring.design(self.u_hz, np.ones_like(self.y), delay, middle)
        coefficients = np.linalg.lstsq(columns, self.y, rcond=None)[0]
        return np.asarray(self.y - columns @ coefficients)

    def share_left(self, rows: FloatArray) -> float:
        """Distance from the model, root mean square over the largest modulus.

        Args:
            rows: residuals, (rows,).
        """
        return float(np.sqrt(2.0 * np.mean(rows**2)))

    def residual_curve(self, at: slice, rows: FloatArray) -> ResidualCurve:
        """Its residuals over frequency, its real parts, then its imaginary ones.

        Args:
            at: which rows of the measurement these are.
            rows: residuals, (rows,).
        """
        real, imaginary = np.split(rows, 2)
        values = self.y + self.largest * (real + 1j * imaginary)
        return ResidualCurve(
            rows=np.arange(at.start, at.stop),
            share=np.full(rows.size, np.sqrt(2.0)),  # of the distance from the model
            axis=np.tile(self.u_hz, 2),
            name=self.label,
            columns=mistakes(self.u_hz, values, 1.0 / self.largest),
            model=values,
            measured=self.y,
        )


#: What one mode may leave of a response that counts as that of a single one.
SINGLE = 1e-2


def dip_qualities(
    curve: ComplexCurve, response: ComplexArray, solved: Solved, spread: float
) -> dict[str, Estimated]:
    """Coupling and internal quality by name, as losses; nothing without a single mode's dip.

    Args:
        curve: as measured.
        response: H (n,), in the FMU's unit.
        solved: gain and backgrounds.
        spread: standard deviation of each quadrature, in ``curve.unit``.
    """
    values = _values(curve, response, solved.coefficients)
    if not values:
        return {}
    # Gaussian errors of each quadrature: those of the coefficients are circular, too
    errors = spread * _root(solved.design)
    steps = [
        _values(curve, response, solved.coefficients + factor * column)
        for column in errors.T
        for factor in (1.0, 1.0j)
    ]
    result = {}
    for name, value in values.items():
        changes = [step.get(name, np.nan) - value for step in steps]
        result[name] = Estimated(value, float(np.linalg.norm(changes)), is_loss=True)
    return result


def _values(
    curve: ComplexCurve, response: ComplexArray, coefficients: ComplexArray
) -> dict[str, float]:
    """Losses of coupling and of the mode itself by name; nothing without a single mode's dip.

    Args:
        curve: as measured.
        response: H (n,), in the FMU's unit.
        coefficients: of the columns H, 1, x, (k,).
    """
    u_hz, wiring = curve.u_hz, curve.wiring
    line = complex_line(u_hz, response)
    alone = line.misfit < SINGLE and line.width_hz > 0.0
    if not (wiring.has_baseline and alone and u_hz[0] < line.eta_hz < u_hz[-1]):
        return {}
    baseline = coefficients[1]
    if coefficients.size > 2:
        half = 0.5 * float(np.ptp(u_hz))
        baseline = baseline + coefficients[2] * (line.eta_hz - u_hz[0] - half) / half
    depth, loaded_q = complex(-coefficients[0] / baseline * line.top), line.eta_hz / line.width_hz
    divisor = 2.0 if wiring.kind == "reflection" else 1.0
    coupling = depth.real / divisor / loaded_q  # the diameter correction: not the modulus of D
    # what is left for the mode itself is negative where the coupling takes more than all
    return {"Q_coupling": coupling, "Q_internal": 1.0 / loaded_q - coupling}


def _root(design: ComplexArray) -> ComplexArray:
    """R (k, k), R R^H = (A^H A)^-1: errors of coefficients of columns A for errors of one."""
    sizes = np.linalg.norm(design, axis=0)
    upper = np.linalg.qr(design / sizes, mode="r")
    return np.asarray(np.linalg.inv(upper) / sizes[:, None])
