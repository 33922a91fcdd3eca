"""Complex sweep: amplitude and phase of the response to one tone after another, over frequency.

    r = [Re(S - y), Im(S - y)]/max|y|        y measured, S as `Wiring` has it

Two rows for each value, all real parts of a curve before its imaginary parts. Gain and background
are complex, unknown, and solved inside. Lock-in amplifiers and network analysers give such curves;
output(t) = Re[H A exp(i (2 pi u t + phase))], A and phase those of the drive.

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

A file has complex values in one of four ways, each column with its unit: X and Y, real and
imaginary part, amplitude and phase, or dB and phase. Phases may be wrapped or not. Values count
phases as output(t) = Re[value exp(i 2 pi u t)]: the phase of a response falls with frequency.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, ClassVar, Self

import numpy as np
import numpy.typing as npt

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.file import LayoutKeys
from fitting.campaign.instruments import LAYOUTS, read_recording
from fitting.campaign.instruments.recording import (
    Channel,
    ComplexColumns,
    Recording,
    Selection,
    check_axis,
    unit_of,
)
from fitting.campaign.instruments.roles import (
    PHASE,
    X,
    Y,
    amplitude_of,
    frequency_of,
    parts_of,
    requested_column,
    without_zero,
)
from fitting.campaign.measured import check_count, check_rising
from fitting.campaign.parameters import Parameter
from fitting.fmu.description import READABLE
from fitting.lines.starts import ComplexLine, complex_line
from fitting.measurements.control_sweep import ControlPlace, ControlTable, cut_off
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import (
    OF_LARGEST,
    Axis,
    Figure,
    compared,
    residual_points,
    root_mean_square,
    worded,
)
from fitting.measurements.gain import SharedGain, Solved
from fitting.measurements.maps import ControlMaps, MappedSpectrum
from fitting.measurements.measurement import Estimated, Measurement, Predicting, Prediction, Values
from fitting.measurements.records import (
    Curve,
    Record,
    StatedTable,
    SweepsTogether,
    check_pair,
    check_words,
)
from fitting.measurements.tones import PLATEAU
from fitting.signal.roughness import roughness
from fitting.simulate.batch import Batch
from fitting.text.arguments import checked
from fitting.text.arrays import (
    ComplexArray,
    FloatArray,
    as_numbers,
    as_values,
)
from fitting.text.errors import BadInput
from fitting.text.finding import Finding
from fitting.text.notation import hertz, prefixed
from fitting.text.schema import FileName, Keys, OneOf, Refused, Switch, Text, Value, refusing
from fitting.text.tables import hertz_of
from fitting.text.units import convert, in_unit, parse_quantity

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
        check_words(self, "wiring", kind=WIRINGS, background=BACKGROUNDS)

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

    NOUN = "complex sweep"

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
        check_pair(where, "frequencies", f, "values", values)
        check_count(f.size, where)
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
    def top_hz(self) -> float:
        """Where its line is, or the end of the sweep that is nearest to it, Hz."""
        return float(np.clip(self.line.eta_hz, self.u_hz[0], self.u_hz[-1]))

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

    def figure(self, before: Values, after: Values) -> Figure:
        """X and Y over frequency, and residuals of both in % of the largest modulus.

        Args:
            before: as simulated with the start parameters, (n,), in the curve's unit.
            after: with the fitted ones.
        """
        f, x = self.u_hz, Axis("drive frequency f", "Hz")
        sigma = np.full(f.size, self.sigma) if self.sigma > 0.0 else None
        panels = [
            compared(
                (x, Axis(f"quadrature {name}", self.unit)),
                f,
                part(self.y),
                part(before),
                part(after),
                sigma,
            )
            for name, part in (("X", np.real), ("Y", np.imag))
        ]
        left = 100.0 * (after - self.y) / self.largest
        panels.append(residual_points((x, OF_LARGEST), f, (("X", left.real), ("Y", left.imag))))
        rms = root_mean_square([left.real, left.imag])
        rows = [[panel] for panel in panels]
        return worded("complex_sweep", rows, label=self.label, curve=self, rms=rms)


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


def complex_maps(sweeps: ComplexSweep, fitted: Sequence[Values]) -> Figure:
    """Moduli of all sweeps over the control, and the modulus of what is left of both quadratures.

    Where something passes the resonance by its lines are no maxima, and none are marked.

    Args:
        sweeps: as measured.
        fitted: as simulated with the fitted parameters, (n,) each, in their unit.
    """
    curves = sweeps.records
    known = all(c.sigma > 0.0 for c in curves)
    bare = all(c.wiring.columns == 1 for c in curves)
    spectra = tuple(
        MappedSpectrum(
            label=c.label,
            settings=c.settings,
            frequency_hz=c.u_hz,
            measured=np.abs(c.y),
            fitted=np.abs(s),
            left=np.abs(s - c.y) / (c.sigma if known else 0.01 * c.largest),
            response=np.abs(s) if bare else np.empty(0),
        )
        for c, s in zip(curves, fitted, strict=True)
    )
    most = max(float(np.max(s.left)) for s in spectra) or 1.0
    return ControlMaps(
        spectra=spectra,
        units=sweeps.units,
        amplitude=Axis("modulus", curves[0].unit),
        rest=Axis("|simulated - measured|", "σ" if known else "% of largest", low=0.0, high=most),
        name="complex_control_sweep",
        what="Moduli",
        series=sweeps.series,
    ).figure


#: Role of a parameter that is a cable's delay.
DELAY = "delay"
#: Half the box of a delay, in 1/span: a turn more or less over the sweep is no better fit.
DELAY_REACH = 2.0


@checked
@dataclass(frozen=True, eq=False)
class ComplexSweep(SweepsTogether[ComplexCurve]):
    """Amplitude and phase of a steady response to one tone after another, of one or several sweeps.

    Args:
        setup: How the FMU is driven and what is observed.
        curves: One sweep or several.
        units: Units of control quantities in the settings of sweeps, for laws.
        one_delay: Whether all fitted delays are one.
        series: Measurements of one series share their setup.

    Raises:
        BadInput: no sweep, two of one name, or a delay that a sweep cannot resolve.
    """

    FIELD = "curves"
    has_phases = True

    curves: ComplexCurve | Sequence[ComplexCurve]
    _: KW_ONLY
    one_delay: bool = False

    def __post_init__(self) -> None:
        curves = (self.curves,) if isinstance(self.curves, ComplexCurve) else tuple(self.curves)
        object.__setattr__(self, "curves", curves)
        super().__post_init__()
        for k, curve in enumerate(curves):
            for other in curves[:k]:
                if np.array_equal(curve.u_hz, other.u_hz) and np.array_equal(curve.y, other.y):
                    raise BadInput(
                        f"complex sweep '{curve.label}' ({curve.source}): is the data of "
                        f"'{other.label}' again; wanted every measurement once"
                    )
        for curve in self._telling_delays:
            curve.check_delay()

    @property
    def table(self) -> str:
        """The table of a campaign that it is of."""
        return "[complex_control_sweep]" if self.units else "[[complex_sweep]]"

    @property
    def line_width_hz(self) -> float | None:
        """Width of the line that the first sweep follows, Hz."""
        line = self.records[0].line
        inside = 0.0 < abs(line.width_hz) < np.ptp(self.records[0].u_hz)
        return abs(line.width_hz) if inside and line.misfit < PLATEAU else None

    @cached_property
    def _gains(self) -> tuple[SharedGain, ...]:
        """The gains of all sweeps: those of single ones, then the one that others share."""
        shared = tuple(k for k, c in enumerate(self.records) if c.shared)
        alone = [SharedGain((k,)) for k, c in enumerate(self.records) if not c.shared]
        rotated = any(self.records[k].restarted for k in shared)
        return (*alone, *([SharedGain(shared, modulus_only=rotated)] if shared else []))

    @property
    def solved_inside(self) -> int:
        """Real unknowns: two for every gain and background, shared ones once."""
        columns = [c.wiring.columns for c in self.records]
        return sum(gain.unknowns(columns) for gain in self._gains)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The delay of every sweep that has it fitted, about the one that its phases show.

        Where all have one it is looked for about that of the sweep that one mode describes best.
        """
        result = []
        for curve in self._telling_delays:
            turn, start = 1.0 / float(np.ptp(curve.u_hz)), curve.line.delay_s
            result.append(
                Parameter(
                    name=self.delay_name(curve),
                    unit="s",
                    lower=start - DELAY_REACH * turn,
                    upper=start + DELAY_REACH * turn,
                    start=start,
                    reference=start,
                    scale=0.1 * turn,
                    role=DELAY,
                )
            )
        return tuple(result)

    @property
    def _telling_delays(self) -> list[ComplexCurve]:
        """The sweeps by which delays that are fitted are looked for."""
        fitted = [c for c in self.records if c.delay_s is None]
        if self.one_delay and fitted:
            return [min(fitted, key=lambda c: c.line.misfit)]
        return fitted

    def delay_name(self, curve: ComplexCurve) -> str:
        """Name of the parameter that a fitted delay is.

        Args:
            curve: one of the sweeps.
        """
        tag = self.series if self.one_delay else curve.label or self.series
        return f"{DELAY}[{tag}]" if tag else DELAY

    def without_delay(self, curve: ComplexCurve, values: Mapping[str, float]) -> ComplexArray:
        """Measured values (n,) of a sweep, the delay of its cable taken off.

        Args:
            curve: one of the sweeps.
            values: of the fitted parameters, by name.
        """
        known = curve.delay_s
        tau = values[self.delay_name(curve)] if known is None else known
        rotated = np.exp(2j * np.pi * (curve.u_hz - 0.5 * (curve.u_hz[0] + curve.u_hz[-1])) * tau)
        return np.asarray(curve.y * rotated)

    def predict(
        self, model: DrivenModel, table: FloatArray, batch: Batch, *, whole: bool = False
    ) -> Predicting:
        """Complex responses at all frequencies, wired; see `Measurement.predict`."""
        result = yield from self.responses(model, table, batch)
        places = {q.name: i for i, q in enumerate(model.parameters) if q.role == DELAY}
        delays_s = [
            [
                float(p[places[self.delay_name(c)]]) if c.delay_s is None else float(c.delay_s)
                for c in self.records
            ]
            for p in table
        ]
        return [
            self.wired([responses[k] for responses in result], delay_s)
            for k, delay_s in enumerate(delays_s)
        ]

    def wired(self, responses: Sequence[ComplexArray], delays_s: Sequence[float]) -> Prediction:
        """What is seen of responses, with the gains and backgrounds that suit the data best.

        Args:
            responses: H of every sweep, (n,), in the FMU's unit.
            delays_s: of every sweep, s.
        """
        u = self.records[0].u_hz
        middle = 0.5 * float(u[0] + u[-1])  # of all: gains that are shared are of one phase
        designs = [
            c.wiring.design(c.u_hz, h, tau, middle)
            for c, h, tau in zip(self.records, responses, delays_s, strict=True)
        ]
        measured = [c.y for c in self.records]
        weights = [1.0 / (c.sigma or c.largest) for c in self.records]
        solved: dict[int, Solved] = {}
        for gain in self._gains:
            solved |= gain.solve(designs, measured, weights)
        each = tuple(solved[k] for k in range(len(self.records)))
        return Prediction(
            np.concatenate([s.values for s in each]), responses=tuple(responses), solved=each
        )

    def solved_blocks(self, prediction: Prediction) -> Sequence[FloatArray]:
        """Derivatives of the rows by real and imaginary parts of gains and backgrounds."""
        solved = dict(enumerate(prediction.solved))
        rows = [
            [
                c.rows_of(column.get(k, np.zeros(c.y.size, dtype=complex)))
                for k, c in enumerate(self.records)
            ]
            for gain in self._gains
            for column in gain.columns(solved)
        ]
        return (np.stack([np.concatenate(row) for row in rows], axis=1),)

    def amplitude_rows(self, prediction: Prediction, rows: FloatArray) -> FloatArray:
        """Real parts of exp(-i arg S) dS: what a change is along S."""
        made, begin = [], 0
        for s in self.split(prediction.values):
            real, imaginary = np.split(rows[begin : begin + 2 * s.size], 2)
            begin += 2 * s.size
            turn = np.exp(-1j * np.angle(s))[:, None]
            made.append((turn * (real + 1j * imaginary)).real)
        return np.concatenate(made)

    def qualities(self, prediction: Prediction, sigma: FloatArray) -> Mapping[str, Estimated]:
        """Coupling and internal quality of every notch or reflection that one mode makes."""
        spreads = [float(np.mean(sigma[mine])) for mine in self.slices]
        result: dict[str, Estimated] = {}
        each = zip(self.records, prediction.responses, prediction.solved, spreads, strict=True)
        for curve, response, solved, spread in each:
            tag = f"[{curve.label}]" if curve.label else ""
            values = dip_qualities(curve, response, solved, curve.largest * spread)
            result |= {f"{name}{tag}": value for name, value in values.items()}
        return result

    @property
    def rows_without_response(self) -> FloatArray:
        """What a constant, and what is added to the response, leave of each sweep, (rows,)."""
        return np.concatenate([c.rows_of(c.without_response()) for c in self.records])

    def part(self, labels: Collection[str]) -> Self | None:
        """The sweeps at the places of these labels.

        Args:
            labels: of places.

        Raises:
            BadInput: others have a delay of their own that is fitted.
        """
        if not self.one_delay and self.parameters:
            return Measurement.part(self, labels)
        return super().part(labels)

    def figures(self, before: Values, after: Values) -> Sequence[Figure]:
        """X and Y of every sweep and their residuals; of many, maps of both."""
        if self.units:
            return (complex_maps(self, self.split(after)),)
        return super().figures(before, after)


#: A sweep is told to count phases the wrong way, or to have another unit of phase, only where one
#: mode describes it that well the other way: root mean square over that of the data.
PLAIN_LINE = 0.15
#: How many times better a mode has to describe the data with the other unit of phase.
MUCH_BETTER = 5.0

#: Turns over a sweep from which a cable can be told from what a line turns by itself.
LEAST_CABLE = 0.25


@dataclass(frozen=True, kw_only=True)
class ComplexKeys(Keys):
    """How complex values are read, and how the response stands in them."""

    columns: ComplexColumns = field(default_factory=ComplexColumns)
    """Columns of other than the usual names, with unit as "X1 (mV)" if the file states none."""
    conjugate: Switch = False
    """Phases are counted the other way: that of a response rises with frequency."""
    sigma: Value | None = None
    """Standard deviation of each quadrature, as "0.1 uV"; without it from the residuals."""
    output: Text | None = None
    """The observed FMU output; without it that of [observe]."""
    wiring: Annotated[Text, OneOf(WIRINGS)] = "transmission"
    """How the response is part of the values, see `fmu-fit help phases`."""
    background: Annotated[Text, OneOf(BACKGROUNDS)] = "none"
    """Complex background next to the response, solved for."""
    delay: Text = "none"
    """Of the cable: "none", "fit", or a known one as "40 ns"."""
    scale: Annotated[Text, OneOf(("own", "shared"))] = "own"
    """Complex gain: its own, or one for all that share it."""
    restarted: Switch = False
    """With scale = "shared": its phase of the gain is its own, as after a restart of the
    instrument."""

    def check(self) -> None:
        """Complain of keys that do not go together.

        Raises:
            Refused: names the key.
        """
        if self.restarted and self.scale != "shared":
            raise Refused('has a meaning with scale = "shared" only', "restarted")
        if self.wiring != "transmission":
            if self.scale == "shared":
                raise Refused(f'wanted "own" with wiring = "{self.wiring}"', "scale")
            if self.background == "constant":
                raise Refused(
                    f'"constant" is what passes by in wiring = "{self.wiring}" anyway; wanted '
                    '"none" or "slope"',
                    "background",
                )
        with refusing("delay"):
            self.delay_s("")

    def delay_s(self, where: str) -> float | None:
        """Known delay, s; None: it is fitted.

        Args:
            where: what complaints name.

        Raises:
            BadInput: it is no time.
        """
        if self.delay in ("none", "fit"):
            return 0.0 if self.delay == "none" else None
        value, unit = parse_quantity(self.delay, where=where, wanted="s")
        if unit is None:
            raise BadInput(
                f'{where}: found "{self.delay}", wanted "none", "fit" or a time as "40 ns"'
            )
        return convert(value, unit, "s", where=where)

    def curve_of(self, measured: ComplexCurve, label: str) -> ComplexCurve:
        """A sweep as it was measured; settings and output are bound later.

        Args:
            measured: its values as the file has them.
            label: of the sweep.

        Raises:
            BadInput: phases that run the wrong way, or as behind another cable; no noise at all.
        """
        if self.conjugate:
            measured = replace(measured, values=np.conj(measured.y))
        delay_s, where = self.delay_s(""), measured.source
        check_sense(measured, delay_s, where)
        check_delay(measured, delay_s, where)
        sigma = 0.0
        if self.sigma is not None:
            sigma = in_unit(self.sigma, measured.unit)
            if not sigma > 0.0:
                raise BadInput(f"{self.sigma.where}: found {sigma:g}, wanted more than zero")
        f, values = measured.u_hz, measured.y
        cut, left_out = cut_off(f, values, measured.unit, f"{where}{f', {label}' * bool(label)}")
        return replace(
            measured,
            frequency_hz=f[~cut],
            values=values[~cut],
            sigma=sigma,
            label=label,
            wiring=Wiring(kind=self.wiring, background=self.background),
            delay_s=delay_s,
            shared=self.scale == "shared",
            restarted=self.restarted,
            left_out=(*measured.left_out, *left_out),
        )


def read_complex(
    path: Path, layout: str | None = None, selection: Selection | None = None
) -> ComplexCurve:
    """A complex trace of a file.

    Args:
        path: of the file.
        layout: how the instrument writes; None: recognised by the content.
        selection: what is taken of the file; None: the usual columns.

    Raises:
        BadInput: a column or unit is missing, a cell is no number, frequencies do not rise,
            radians that are degrees or degrees that are radians.
    """
    selection = selection or Selection()
    return complex_of(read_recording(path, layout, selection), selection)


def complex_of(recording: Recording, columns: ComplexColumns) -> ComplexCurve:
    """The complex values that columns of a recording hold.

    Args:
        recording: as it was read, one sweep.
        columns: names of columns, where they are not the usual ones.

    Raises:
        BadInput: as `read_complex`.
    """
    path = recording.path
    frequency = frequency_of(recording, columns.frequency)
    recording, frequency, left_out = without_zero(recording, frequency)
    drive = recording.column(columns.drive) if columns.drive else None
    x, y = requested_column(recording, columns.x, X), requested_column(recording, columns.y, Y)
    amplitude = amplitude_of(recording, columns.amplitude) if columns.amplitude else None
    varying: list[tuple[Channel, str, str]] = []  # what is no resonance if it is one number
    radians, phase_unit = None, ""
    taken: tuple[Channel | None, ...] = (x, y)
    if amplitude is None and x is not None and y is not None:
        _check_different(recording, frequency, x, y)
        values, unit = parts_of(recording, x, y)
        varying = [(part, f"column '{part.name}'", part.unit or unit) for part in (x, y)]
    else:
        amplitude = amplitude or amplitude_of(recording, "")
        whole = amplitude is not None and amplitude.is_complex
        phase = None if whole else requested_column(recording, columns.phase, PHASE)
        if amplitude is not None and whole:
            unit = unit_of(recording, amplitude, f"{amplitude.name} (uV)")
            values = recording.values(amplitude)
        elif amplitude is not None and phase is not None:
            _check_different(recording, frequency, amplitude, phase)
            phase_unit = unit_of(recording, phase, "phase (deg)")
            factor = convert(1.0, phase_unit, "rad", where=f"{path}: phase")
            radians = recording.numbers(phase) * factor
            sizes, unit = _sizes(recording, amplitude)
            values = np.asarray(sizes * np.exp(1j * radians), dtype=complex)
            varying = [(phase, "the phase", phase_unit)]
        else:
            if (x is None) != (y is None):
                parts_of(recording, x, y)  # names the one that is missing
            what = "amplitude" if amplitude is None else "phase"
            there = ", ".join(c.name for c in recording.channels)
            raise BadInput(
                f"{path}: no column '{what}'; wanted frequency with X and Y, Re and Im, "
                f"amplitude and phase, or dB and phase, there is: {there}"
            )
        taken = amplitude, phase
    written = unit_of(recording, frequency, "frequency (MHz)")
    axis = recording.numbers(frequency)
    check_axis(path, axis, written, recording.places)
    result = ComplexCurve(
        frequency_hz=hertz_of(axis, written, where=f"{path}: column 'frequency'"),
        values=values,
        unit=unit,
        source=str(path),
        left_out=(*left_out, *recording.unused(frequency, drive, *taken)),
    )
    for channel, what, its_unit in varying:
        column = recording.numbers(channel)
        if np.all(column == column[0]):
            raise BadInput(
                f"{path}: {what} is {column[0]:.6g} {its_unit} at all {column.size} points; "
                "wanted values that change over a resonance"
            )
    if radians is not None:
        _check_phase(result, radians, phase_unit)
    if drive is None:
        return result
    unit_of(recording, drive, f"{drive.name} (V)")
    level = recording.numbers(drive)
    for i in np.flatnonzero(level <= 0.0)[:1]:
        raise BadInput(
            f"{path}: {recording.places[i]}, column '{drive.name}': {level[i]:.6g}; wanted the "
            "amplitude of the drive, above zero"
        )
    return replace(result, values=result.y * (level[0] / level))  # relative to the first point's


def _check_different(recording: Recording, *channels: Channel) -> None:
    """Refuse a column that is taken twice, and cells that are no numbers."""
    names = [channel.name for channel in channels]
    for name in names:
        if names.count(name) > 1:
            raise BadInput(
                f"{recording.path}: column '{name}' is taken for two things; wanted a column for "
                "each"
            )
    recording.check(channels)


def _sizes(recording: Recording, amplitude: Channel) -> tuple[FloatArray, str]:
    """Magnitudes of a column of amplitudes, or of dB, and their unit."""
    unit = unit_of(recording, amplitude, f"{amplitude.name} (uV)")
    sizes = written = recording.numbers(amplitude)
    if unit in ("dB", "dBm"):  # the load of dBm is a factor, which the gain takes
        sizes, unit = 10.0 ** (written / 20.0), "1"
    for i in np.flatnonzero(sizes < 0.0)[:1]:
        raise BadInput(
            f"{recording.path}: {recording.places[i]}, column '{amplitude.name}': "
            f"{written[i]:.6g} {unit}; wanted a magnitude (are columns exchanged, or is it in dB?)"
        )
    return sizes, unit


def _check_phase(result: ComplexCurve, phase_rad: FloatArray, unit: str) -> None:
    """Complain of radians that are degrees, and the other way round.

    Radians beyond a turn are unwrapped ones, whose neighbours are less than half a turn apart; and
    one mode with a delay describes the data as they are, not with the other unit.
    """
    written_radians = bool(np.isclose(convert(1.0, unit, "rad", where=""), 1.0))
    largest = float(np.max(np.abs(phase_rad)))
    if written_radians and largest > 2.0 * np.pi:
        jumps = float(np.max(np.abs(np.diff(phase_rad)))) > np.pi * (1.0 + 1e-9)
        if jumps or _fits_better(result, np.deg2rad(phase_rad)):
            raise BadInput(
                f"{result.source}: phases up to {largest:.4g} are declared to be in {unit}; wanted "
                "radians within 2 pi or unwrapped ones, or the unit deg"
            )
    degrees = np.rad2deg(phase_rad)
    smallest = float(np.max(np.abs(degrees)))
    if not written_radians and smallest <= 2.0 * np.pi and _fits_better(result, degrees):
        raise BadInput(
            f"{result.source}: phases up to {smallest:.4g} are declared to be in {unit}; wanted "
            "degrees, or the unit rad"
        )


def _fits_better(result: ComplexCurve, phase_rad: FloatArray) -> bool:
    """Whether one mode describes the amplitudes far better with these phases."""
    other = np.abs(result.y) * np.exp(1j * phase_rad)
    here = complex_line(result.u_hz, result.y, None).misfit
    there = complex_line(result.u_hz, other, None).misfit
    return there < PLAIN_LINE and there * MUCH_BETTER < here


def check_sense(result: ComplexCurve, delay_s: float | None, where: str) -> None:
    """Complain of phases that plainly run the wrong way over a resonance.

    Args:
        result: complex values.
        delay_s: of the cable, s; None: not known.
        where: file and table, for complaints.

    Raises:
        BadInput: one mode describes the data, but with phases counted the other way.
    """
    line = complex_line(result.u_hz, result.y, delay_s)
    spacing = float(np.median(np.diff(result.u_hz)))
    inside = result.u_hz[0] <= line.eta_hz <= result.u_hz[-1]
    observed = 2.0 * spacing < -line.width_hz < float(np.ptp(result.u_hz))
    if line.misfit < PLAIN_LINE and inside and observed:
        raise BadInput(
            f"{where}: the phase rises with frequency over the resonance at {line.eta_hz:.9g} Hz; "
            "wanted X and Y in this order, or conjugate = true for an instrument that counts "
            "phases the other way"
        )


def check_delay(result: ComplexCurve, delay_s: float | None, where: str) -> None:
    """Complain of a cable that turns the phases by more than a turn and that was not stated.

    Args:
        result: complex values.
        delay_s: of the cable as it was stated, s; None: it is fitted.
        where: file and table, for complaints.

    Raises:
        BadInput: one mode describes the data, but behind another delay.
    """
    if delay_s is None:
        return
    given = complex_line(result.u_hz, result.y, delay_s)
    free = complex_line(result.u_hz, result.y, None)
    turns = (free.delay_s - delay_s) * float(np.ptp(result.u_hz))
    if abs(turns) < 1.0 or free.misfit > PLAIN_LINE or free.misfit * MUCH_BETTER > given.misfit:
        return
    unit_text = f"{_seconds(delay_s)} were stated" if delay_s else "no delay was stated"
    is_cable = abs(free.delay_s) * float(np.ptp(result.u_hz)) >= LEAST_CABLE
    cable_s = free.delay_s
    if cable_s < 0.0:  # frequencies an equal step apart tell a delay up to one over the step
        cable_s += 1.0 / float(np.median(np.diff(result.u_hz)))
    observed = f"behind a cable of {_seconds(cable_s)}" if is_cable else "without a cable"
    wanted = "the one of the cable" if is_cable else '"none"'
    raise BadInput(
        f'{where}: the phases turn as {observed}, {unit_text}; wanted delay = "fit", or {wanted}'
    )


def _seconds(value: float) -> str:
    factor, unit = prefixed(abs(value), "s")
    return f"{value / factor:.3g} {unit}"


@dataclass(frozen=True, kw_only=True)
class ComplexSweepTable(StatedTable, LayoutKeys, ComplexKeys):
    """A complex frequency response: lock-in amplifier or network analyser, over drive frequency.

    Several of these tables are fitted together.
    """

    TABLE: ClassVar[str] = "complex_sweep"
    TOGETHER = ComplexSweep

    file: FileName
    """Frequency with X and Y, or amplitude or dB and phase, each with its unit."""

    def __post_init__(self) -> None:
        self.check()
        self.check_layout()

    def record(self, label: str) -> ComplexCurve:
        """The sweep of the file.

        Args:
            label: of the sweep.
        """
        measured = read_complex(self.file, self.layout, self.selection(self.columns))
        return self.curve_of(measured, label)


@dataclass(frozen=True, kw_only=True)
class ComplexControlSweepTable(ControlTable, ComplexKeys):
    """Complex sweeps over drive frequency at several values of a control, fitted as a whole."""

    TABLE: ClassVar[str] = "complex_control_sweep"

    file: FileName
    """A row for each point: controls, frequency, X and Y (or amplitude or dB and phase); or for
    each sweep: controls, and its file in the column file."""
    layout: Annotated[Text | None, OneOf(LAYOUTS)] = None
    """Format of the instrument; without it recognised."""

    def __post_init__(self) -> None:
        self.check()
        self.check_controls("X", "Y", "phase", *vars(self.columns).values())

    def spectrum_at(self, recording: Recording, place: ControlPlace) -> ComplexCurve:
        """The complex values of a place in Hz, as far as they are in the range."""
        if place.file != recording.path:
            measured = read_complex(place.file, self.layout, Selection(**vars(self.columns)))
        else:
            measured = complex_of(recording.part(place.rows), self.columns)
        kept = self.inside(measured.u_hz, f"{measured.source}: the sweep at {place.label}")
        part = replace(measured, frequency_hz=measured.u_hz[kept], values=measured.y[kept])
        return self.curve_of(part, place.label)

    def bind_spectra(
        self,
        places: Sequence[ControlPlace],
        spectra: Sequence[ComplexCurve],
        binder: Binder,
        setup: Setup,
    ) -> ComplexSweep:
        """The sweeps with the controls in the units of laws and of the FMU."""
        output = self.output or ""
        if output:
            where = f"{setup.source}: [{self.TABLE}] output"
            binder.real(output, where, READABLE, "observed")
        curves = []
        for place, curve in zip(places, spectra, strict=True):
            settings = {n: float(binder.setting(n, w)) for n, w in place.controls.items()}
            curves.append(replace(curve, settings=settings, output=output))
        return ComplexSweep(
            setup=setup, curves=tuple(curves), units=self.control_units(binder), one_delay=True
        )
