"""Complex sweep: amplitude and phase of the response to one tone after another, over frequency.

    r = [Re(S - y), Im(S - y)]/max|y|        y measured, S as `fitting.measurements.wiring` has it

Two rows for each value, all real parts of a curve before its imaginary parts. Gain and background
are complex, unknown, and solved inside. Lock-in amplifiers and network analysers give such curves;
output(t) = Re[H A exp(i (2 pi u t + phase))], A and phase those of the drive.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from fitting.campaign import Setup
from fitting.campaign.binder import Binder
from fitting.campaign.complex_trace import (
    MeasuredComplex,
    WrittenComplexColumns,
    check_sense,
    conjugated,
    read_complex,
)
from fitting.campaign.instruments import LAYOUTS, PLAIN
from fitting.campaign.kind import MeasurementTable
from fitting.campaign.parameters import Parameter
from fitting.fmu.variables import READABLE
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import Axis, Figure, Form, Layer, Panel, Role
from fitting.measurements.measurement import (
    Estimated,
    MeasurementKind,
    Predicting,
    Prediction,
    Sampled,
    Values,
    without_drive,
)
from fitting.measurements.plan import Plan
from fitting.measurements.response_curve import ResponseCurve, together
from fitting.measurements.tones import PLATEAU
from fitting.measurements.wiring import BACKGROUNDS, WIRINGS, Solved, Wiring, dip_of, solve
from fitting.signal.complex_line import ComplexLine, complex_line
from fitting.simulate.batch import Batch, Workers
from fitting.simulate.drive import Drive
from fitting.text.arrays import ComplexArray, FloatArray, Scalar
from fitting.text.errors import BadInput, gathered
from fitting.text.keys import (
    FileName,
    OneOf,
    Refused,
    Switch,
    Text,
    Usually,
    Value,
    WholeNumber,
    refusing,
)
from fitting.text.notation import hertz, number
from fitting.text.units import convert, parse_quantity
from fitting.text.written import in_unit

#: Role of a parameter that is a cable's delay.
DELAY = "delay"
#: Line widths that a sweep has to span for a delay to be told from the phase of the line itself.
WIDTHS_FOR_DELAY = 3.0
#: Half the box of a delay, in 1/span: a turn more or less over the sweep is no better fit.
DELAY_REACH = 2.0
#: Residuals below this share of the largest value are no misfit.
SMALLEST_MISFIT = 1e-3


@dataclass(frozen=True, kw_only=True)
class ComplexSweepTable(MeasurementTable):
    """A complex frequency response: lock-in amplifier or network analyser, over drive frequency.

    Several of these tables are fitted together.
    """

    TABLE: ClassVar[str] = "complex_sweep"
    REPEATED: ClassVar[bool] = True

    file: FileName
    """Frequency with X and Y, real and imaginary part, amplitude and phase, or dB and phase, each
    column with its unit."""
    layout: Annotated[Text | None, OneOf(LAYOUTS), Usually(PLAIN)] = None
    """How the instrument writes."""
    chunk: WholeNumber | None = None
    """(zurich only) which sweep of the file; without it the only one there is."""
    columns: WrittenComplexColumns = field(default_factory=WrittenComplexColumns)
    """Names of columns, where they are not the usual ones."""
    conjugate: Switch = False
    """The instrument counts phases the other way: the phase of a response rises with frequency."""
    sigma: Value | None = None
    """Standard deviation of each quadrature, as "0.1 uV"; without it the residuals tell it."""
    output: Text | None = None
    """The FMU output that is seen; without it that of [observe]."""
    label: Text = ""
    """Name of the sweep, for values of its own; without it "1", "2" where there are several."""
    set: Mapping[str, Value] = field(default_factory=dict)
    """Start values of the FMU during the sweep."""
    wiring: Annotated[Text, OneOf(WIRINGS)] = "transmission"
    """How the response stands in what is seen, see the README."""
    background: Annotated[Text, OneOf(BACKGROUNDS)] = "none"
    """Complex background beside the response, solved inside."""
    delay: Text = "none"
    """Of the cable: "none", "fit", or a known one as "40 ns"."""
    scale: Annotated[Text, OneOf(("own", "shared"))] = "own"
    """Complex gain: its own, or one for all sweeps that share it."""
    restarted: Switch = False
    """With scale = "shared": the phase of the gain is its own, as after a restart of the
    instrument."""

    def __post_init__(self) -> None:
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
            _delay_of(self.delay, "")
        if self.chunk is not None and self.layout != "zurich":
            raise Refused('has no meaning without layout = "zurich"', "chunk")

    def curve(self, label: str) -> ComplexCurve:
        """The sweep of the file; settings and output are bound later.

        Args:
            label: of the sweep.
        """
        measured = read_complex(self.file, self.layout or PLAIN, self.columns, chunk=self.chunk)
        measured = conjugated(measured) if self.conjugate else measured
        delay_s = _delay_of(self.delay, "")
        check_sense(measured, delay_s, str(self.file))
        sigma = 0.0
        if self.sigma is not None:
            sigma = in_unit(self.sigma, measured.unit)
            if not sigma > 0.0:
                raise BadInput(f"{self.sigma.where}: found {sigma:g}, wanted more than zero")
        return ComplexCurve(
            measured.frequency_hz,
            measured.values,
            sigma=sigma,
            label=label,
            wiring=Wiring(kind=self.wiring, background=self.background),
            delay_s=delay_s,
            shared=self.scale == "shared",
            restarted=self.restarted,
            unit=measured.unit,
            source=str(self.file),
        )

    @classmethod
    def read_together(cls, tables: Sequence[Self]) -> ReadComplexSweeps:
        """All sweeps, with the labels that they are told apart by."""
        alone = len(tables) == 1
        labels = [t.label or ("" if alone else str(k)) for k, t in enumerate(tables, start=1)]
        for k, label in enumerate(labels):
            if label in labels[:k]:
                raise BadInput(
                    f"{tables[k].file}: is the second sweep of the label '{label}'; wanted a label "
                    "of its own for every [[complex_sweep]]"
                )
        pairs = zip(tables, labels, strict=True)
        curves = gathered(_reader(table, label) for table, label in pairs)
        return ReadComplexSweeps(tuple(tables), tuple(curves))


def _reader(table: ComplexSweepTable, label: str) -> Any:
    return lambda: table.curve(label)


def _delay_of(text: str, where: str) -> float | None:
    """Known delay, s; None: it is fitted."""
    if text in ("none", "fit"):
        return 0.0 if text == "none" else None
    value, unit = parse_quantity(text, where=where, wanted="s")
    if unit is None:
        raise BadInput(f'{where}: found "{text}", wanted "none", "fit" or a time as "40 ns"')
    return convert(value, unit, "s", where=where)


@dataclass(frozen=True)
class ReadComplexSweeps:
    """The sweeps of all tables [[complex_sweep]], as their files have them."""

    tables: tuple[ComplexSweepTable, ...]
    curves: tuple[ComplexCurve, ...]

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of all tables, each once."""
        return tuple(dict.fromkeys(table.file for table in self.tables))

    def bind(self, binder: Binder, setup: Setup) -> ComplexSweeps:
        """The sweeps with settings and outputs of the FMU."""
        bound = []
        for table, curve in zip(self.tables, self.curves, strict=True):
            output = table.output or ""
            if output:
                where = f"{setup.source}: [complex_sweep] output"
                binder.real(output, where, READABLE, "observed")
            settings = {name: binder.setting(name, w) for name, w in table.set.items()}
            bound.append(replace(curve, settings=settings, output=output))
        return ComplexSweeps(setup=setup, curves=tuple(bound))


@dataclass(frozen=True, eq=False)
class ComplexCurve:
    """Complex values of one sweep.

    Args:
        frequency_hz: Frequencies of the tone, shape (n,), Hz, rising.
        values: Measured X + i Y, shape (n,), in ``unit``, phases as Re[values exp(i 2 pi u t)].
        sigma: Standard deviation of each quadrature, in ``unit``; 0: the residuals tell it.
        settings: Start values of the FMU during the sweep by variable, in the FMU's units.
        label: Name of the sweep; wanted where there are several.
        output: The FMU's output that is seen; empty: the setup's.
        wiring: What stands beside the response.
        delay_s: Delay of the cable, s; None: it is fitted.
        shared: Whether it shares its complex gain with all others that do.
        restarted: Whether the phase of a shared gain is its own.
        unit: Of the values.
        source: What complaints name it by.

    Raises:
        BadInput: fewer than 8 points, shapes that differ, values that are no numbers, a delay that
            the sweep cannot resolve.
    """

    frequency_hz: npt.ArrayLike
    values: npt.ArrayLike
    _: KW_ONLY
    sigma: float = 0.0
    settings: Mapping[str, Scalar] = field(default_factory=dict)
    label: str = ""
    output: str = ""
    wiring: Wiring = field(default_factory=Wiring)
    delay_s: float | None = 0.0
    shared: bool = False
    restarted: bool = False
    unit: str = "V"
    source: str = "complex sweep"
    u_hz: FloatArray = field(init=False)
    y: ComplexArray = field(init=False)

    def __post_init__(self) -> None:
        checked = MeasuredComplex(
            frequency_hz=np.asarray(self.frequency_hz, dtype=float),
            values=np.asarray(self.values, dtype=complex),
            source=Path(self.source),
        )
        object.__setattr__(self, "u_hz", checked.frequency_hz)
        object.__setattr__(self, "y", checked.values)
        if self.delay_s is None and self._hides_delay:
            raise BadInput(
                f"{self.source}: the sweep spans {hertz(float(np.ptp(self.u_hz)))}, its line is "
                f"{hertz(abs(self.line.width_hz))} wide: a delay is not resolved beside the phase "
                f"of the line itself; wanted {WIDTHS_FOR_DELAY:g} line widths, or the delay"
            )

    @property
    def _hides_delay(self) -> bool:
        width = abs(self.line.width_hz)
        return bool(width * WIDTHS_FOR_DELAY > np.ptp(self.u_hz))

    @cached_property
    def line(self) -> ComplexLine:
        """One mode that the values follow, found without the FMU."""
        return complex_line(self.u_hz, self.y, self.delay_s)

    @cached_property
    def largest(self) -> float:
        """The largest modulus, in ``unit``."""
        return float(np.max(np.abs(self.y)))

    def rows_of(self, values: ComplexArray) -> FloatArray:
        """Real, then imaginary parts over the largest measured modulus, (2 n,).

        Args:
            values: complex (n,), in the curve's unit.
        """
        return np.concatenate([values.real, values.imag]) / self.largest


@dataclass(frozen=True, kw_only=True)
class Wired(Prediction):
    """Complex sweeps as predicted: `responses` H of each at `delays_s`, and what was solved."""

    responses: tuple[ComplexArray, ...] = ()
    delays_s: tuple[float, ...] = ()
    solved: tuple[Solved, ...] = ()


@dataclass(frozen=True, eq=False)
class ComplexSweep:
    """Amplitude and phase of a steady response to one tone after another, of one or several sweeps.

    Args:
        setup: How the FMU is driven and what is observed.
        curves: The sweeps; one alone will do.
        series: Measurements of one series share their setup.

    Raises:
        BadInput: no sweep, or two of one name.
    """

    setup: Setup
    curves: ComplexCurve | Sequence[ComplexCurve]
    _: KW_ONLY
    series: str = ""

    def __post_init__(self) -> None:
        self.within(self.setup, self.series)

    @property
    def rows(self) -> int:
        """Number of residual rows: two for each value."""
        return self.within(self.setup, self.series).rows

    @property
    def places(self) -> tuple[tuple[str, Mapping[str, Scalar]], ...]:
        """Label and settings of every sweep."""
        return self.within(self.setup, self.series).places

    @property
    def control_units(self) -> Mapping[str, str]:
        """None: settings are variables of the FMU."""
        return {}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The delays that are fitted."""
        return self.within(self.setup, self.series).parameters

    def within(self, setup: Setup, series: str) -> ComplexSweeps:
        """The measurement, as part of a series that is driven so.

        Args:
            setup: how the series drives the FMU.
            series: its name.
        """
        given = self.curves
        curves = (given,) if isinstance(given, ComplexCurve) else tuple(given)
        return ComplexSweeps(setup=setup, curves=curves, series=series)


@dataclass(frozen=True, kw_only=True)
class ComplexSweeps(MeasurementKind):
    """One or several complex sweeps `curves` that are fitted together, two rows for each value.

    Raises:
        BadInput: no sweep, or two of one name.
    """

    setup: Setup
    curves: tuple[ComplexCurve, ...]
    series: str = ""

    def __post_init__(self) -> None:
        labels = [c.label for c in self.curves]
        if not labels or len(set(labels)) < len(labels):
            raise BadInput(
                f"complex sweep: labels {', '.join(labels) or 'of no curve'}; wanted one curve at "
                "least, each with a name of its own"
            )
        for k, curve in enumerate(self.curves):
            for other in self.curves[:k]:
                if np.array_equal(curve.u_hz, other.u_hz) and np.array_equal(curve.y, other.y):
                    raise BadInput(
                        f"complex sweep '{curve.label}' ({curve.source}): is the data of "
                        f"'{other.label}' again; wanted every measurement once"
                    )

    @property
    def is_curve(self) -> bool:
        """Its values follow each other."""
        return True

    @property
    def has_phases(self) -> bool:
        """Two rows for each value."""
        return True

    @property
    def line_width_hz(self) -> float | None:
        """Width of the line that the first sweep follows, Hz."""
        line = self.curves[0].line
        inside = 0.0 < abs(line.width_hz) < np.ptp(self.curves[0].u_hz)
        return abs(line.width_hz) if inside and line.misfit < PLATEAU else None

    @property
    def rows(self) -> int:
        """Two for each value."""
        return 2 * sum(c.y.size for c in self.curves)

    @cached_property
    def sigma(self) -> FloatArray:
        """Standard deviation of every row, (rows,); zero where unknown."""
        return np.concatenate([np.full(2 * c.y.size, c.sigma / c.largest) for c in self.curves])

    @property
    def places(self) -> tuple[tuple[str, Mapping[str, Scalar]], ...]:
        """Label and settings of every sweep."""
        return tuple((c.label, c.settings) for c in self.curves)

    @cached_property
    def _groups(self) -> tuple[tuple[tuple[int, ...], bool], ...]:
        """Sweeps by number that are solved together, and whether each has a phase of its own."""
        shared = tuple(k for k, c in enumerate(self.curves) if c.shared)
        alone = [((k,), False) for k, c in enumerate(self.curves) if not c.shared]
        turned = any(self.curves[k].restarted for k in shared)
        return (*alone, *([(shared, turned)] if shared else []))

    @property
    def solved_inside(self) -> int:
        """Real unknowns: two for every gain and background, shared ones once."""
        total = 0
        for group, turned in self._groups:
            total += sum(2 * (self.curves[k].wiring.columns - 1) for k in group)
            total += 1 + len(group) if turned else 2
        return total

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The delay of every sweep that has it fitted, about the one that its phases show."""
        return tuple(self._delay(c) for c in self.curves if c.delay_s is None)

    def _delay_name(self, curve: ComplexCurve) -> str:
        tag = curve.label or self.series
        return f"{DELAY}[{tag}]" if tag else DELAY

    def _delay(self, curve: ComplexCurve) -> Parameter:
        turn = 1.0 / float(np.ptp(curve.u_hz))
        start = curve.line.delay_s
        return Parameter(
            name=self._delay_name(curve),
            unit="s",
            lower=start - DELAY_REACH * turn,
            upper=start + DELAY_REACH * turn,
            start=start,
            reference=start,
            scale=0.1 * turn,
            role=DELAY,
        )

    def drives(self, model: DrivenModel, p: FloatArray) -> list[Drive]:
        """Those of the first sweep's first point, its line's and its last one's."""
        curve = self.curves[0]
        f = curve.u_hz
        line = float(np.clip(curve.line.eta_hz, f[0], f[-1]))
        tones = dict.fromkeys(map(float, (f[0], f[int(np.argmin(np.abs(f - line)))], f[-1])))
        output = curve.output or self.setup.output
        return [
            model.drive(
                model.single_tone_values(p, curve.settings, u, curve.label or None), (u,), output
            )
            for u in tones
        ]

    def refined(self, model: DrivenModel, points: Sequence[FloatArray], workers: Workers) -> Plan:
        """The plan with few runs for each sweep, where the response is measured to be rational."""
        for curve in self.curves:
            top_hz = float(np.clip(curve.line.eta_hz, curve.u_hz[0], curve.u_hz[-1]))
            plan = self._curve(model, curve).planned(curve.u_hz, points, workers, top_hz)
            model = replace(model, plan=plan)
        return model.plan

    def predict(
        self, model: DrivenModel, table: FloatArray, batch: Batch, *, whole: bool = False
    ) -> Predicting:
        """Complex responses at all frequencies, wired; see `Measurement.predict`."""
        curves = [(self._curve(model, c), c.u_hz) for c in self.curves]
        found = yield from together([each.predict(table, u, batch) for each, u in curves])
        return [
            self.wired([responses[k] for responses in found], tuple(map(float, delay)))
            for k, delay in enumerate(self._delays(model, table))
        ]

    def _curve(self, model: DrivenModel, curve: ComplexCurve) -> ResponseCurve:
        return ResponseCurve(model, curve.settings, curve.output, label=curve.label or None)

    def _delays(self, model: DrivenModel, table: FloatArray) -> FloatArray:
        """Delay of every sweep, s, for every row of the table: (k, sweeps)."""
        places = {q.name: i for i, q in enumerate(model.parameters) if q.role == DELAY}
        columns = [
            np.full(len(table), c.delay_s)
            if c.delay_s is not None
            else table[:, places[self._delay_name(c)]]
            for c in self.curves
        ]
        return np.stack(columns, axis=1)

    def wired(self, responses: Sequence[ComplexArray], delays_s: Sequence[float]) -> Wired:
        """What is seen of responses, with the gains and backgrounds that suit the data best.

        Args:
            responses: H of every sweep, (n,), in the FMU's unit.
            delays_s: of every sweep, s.
        """
        designs = self._designs(responses, delays_s)
        solved: dict[int, Solved] = {}
        for group, turned in self._groups:
            found = solve(
                [designs[k] for k in group],
                [self.curves[k].y for k in group],
                [1.0 / (self.curves[k].sigma or self.curves[k].largest) for k in group],
                turned=turned,
            )
            solved.update(zip(group, found, strict=True))
        each = tuple(solved[k] for k in range(len(self.curves)))
        return Wired(
            np.concatenate([s.values for s in each]),
            responses=tuple(responses),
            delays_s=tuple(delays_s),
            solved=each,
        )

    def _designs(
        self, responses: Sequence[ComplexArray], delays_s: Sequence[float]
    ) -> list[ComplexArray]:
        u = self.curves[0].u_hz
        middle = 0.5 * float(u[0] + u[-1])  # of all: gains that are shared are of one phase
        return [
            c.wiring.design(c.u_hz, h, tau, middle)
            for c, h, tau in zip(self.curves, responses, delays_s, strict=True)
        ]

    def sampled(self, model: DrivenModel, p: FloatArray, batch: Batch) -> list[Sampled]:
        """The run at the first point of every sweep."""
        found = []
        for curve in self.curves:
            window = model.single_tone_window(float(curve.u_hz[0]))
            [tone] = window.tones_hz
            values = model.single_tone_values(p, curve.settings, tone, curve.label or None)
            output, signal = curve.output or self.setup.output, model.signal(window, (tone,))
            run = batch.ask(values, window, signal, output)
            found.append(Sampled(run, window, output))
        return found

    def first_drive(self, *, driven: bool) -> ComplexSweeps:
        """Its first sweep, which begins with its first point."""
        curve = self.curves[0]
        if driven:
            return replace(self, curves=(curve,))
        setup, settings = without_drive(self.setup, curve.settings)
        return replace(self, setup=setup, curves=(replace(curve, settings=settings),))

    def residuals(self, prediction: Prediction, chi: float) -> FloatArray:
        """Real and imaginary part of (S - y)/max|y|, (rows,)."""
        pairs = zip(self.curves, self._split(prediction.values), strict=True)
        return np.concatenate([c.rows_of(s - c.y) for c, s in pairs])

    def scaled(self, prediction: Prediction, chi: float) -> Values:
        """S itself: the gain is in it."""
        return prediction.values

    def solved_columns(self, prediction: Prediction) -> FloatArray:
        """Derivatives of the rows by real and imaginary parts of gains and backgrounds."""
        if not isinstance(prediction, Wired):
            raise TypeError(f"a complex sweep is predicted by {prediction!r}")
        designs = self._designs(prediction.responses, prediction.delays_s)
        columns: list[dict[int, ComplexArray]] = []
        for group, turned in self._groups:
            gains = {k: designs[k][:, 0] for k in group}
            phases = {k: np.exp(1j * np.angle(prediction.solved[k].coefficients[0])) for k in group}
            if turned:
                columns.append({k: phases[k] * h for k, h in gains.items()})
                columns += [{k: 1j * phases[k] * h} for k, h in gains.items()]
            else:
                columns += [gains, {k: 1j * h for k, h in gains.items()}]
            for k in group:
                for beside in designs[k][:, 1:].T:
                    columns += [{k: beside}, {k: 1j * beside}]
        rows = [
            [
                c.rows_of(column.get(k, np.zeros(c.y.size, dtype=complex)))
                for k, c in enumerate(self.curves)
            ]
            for column in columns
        ]
        return np.stack([np.concatenate(row) for row in rows], axis=1)

    def amplitude_rows(self, prediction: Prediction, rows: FloatArray) -> FloatArray:
        """Real parts of exp(-i arg S) dS: what a change is along S."""
        made, begin = [], 0
        for s in self._split(prediction.values):
            real, imaginary = np.split(rows[begin : begin + 2 * s.size], 2)
            begin += 2 * s.size
            turn = np.exp(-1j * np.angle(s))[:, None]
            made.append((turn * (real + 1j * imaginary)).real)
        return np.concatenate(made)

    def qualities(self, prediction: Prediction, sigma: FloatArray) -> Mapping[str, Estimated]:
        """Coupling and internal quality of every notch or reflection that one mode makes."""
        if not isinstance(prediction, Wired):
            raise TypeError(f"a complex sweep is predicted by {prediction!r}")
        designs = self._designs(prediction.responses, prediction.delays_s)
        found: dict[str, Estimated] = {}
        ends = np.cumsum([2 * c.y.size for c in self.curves])[:-1]
        each = zip(
            self.curves,
            prediction.responses,
            prediction.solved,
            designs,
            np.split(sigma, ends),
            strict=True,
        )
        for curve, response, solved, design, spread in each:
            tag = f"[{curve.label}]" if curve.label else ""
            values = _dip_values(curve, response, solved.coefficients)
            if not values:
                continue
            # Gaussian errors of each quadrature: those of the coefficients are circular, too
            errors = curve.largest * float(np.mean(spread)) * _root(design)
            steps = [
                _dip_values(curve, response, solved.coefficients + factor * column)
                for column in errors.T
                for factor in (1.0, 1.0j)
            ]
            for name, value in values.items():
                changes = [step.get(name, np.nan) - value for step in steps]
                found[f"{name}{tag}"] = Estimated(value, float(np.linalg.norm(changes)))
        return found

    def unexplained(self, residuals: FloatArray) -> str:
        """Sweeps of whose variance less than half is explained are not described."""
        y = np.concatenate([c.rows_of(c.y - np.mean(c.y)) for c in self.curves])
        spread, left = float(y @ y), float(residuals @ residuals)
        if left > PLATEAU * spread and left > SMALLEST_MISFIT**2 * residuals.size:
            return "the simulated complex sweep does not follow the measured one"
        return ""

    def figures(self, before: Values, after: Values) -> Sequence[Figure]:
        """X and Y of every sweep, and what the fit leaves of them."""
        trios = zip(self.curves, self._split(before), self._split(after), strict=True)
        return tuple(complex_figure(c, b, a, self.series) for c, b, a in trios)

    def _split(self, values: Values) -> list[ComplexArray]:
        ends = np.cumsum([c.y.size for c in self.curves])[:-1]
        return list(np.split(np.asarray(values, dtype=complex), ends))

    def within(self, setup: Setup, series: str) -> Self:
        """The same as part of a series, whose name its labels carry."""
        curves = self.curves
        if series and series != self.series:
            curves = tuple(
                replace(c, label=f"{series}/{c.label}") if c.label else c for c in curves
            )
        return replace(self, setup=setup, series=series, curves=curves)


def _dip_values(
    curve: ComplexCurve, response: ComplexArray, coefficients: ComplexArray
) -> dict[str, float]:
    """Coupling and internal quality by name; nothing where there is no single mode's dip."""
    dip = dip_of(curve.wiring, curve.u_hz, response, coefficients)
    if dip is None:
        return {}
    return {"Q_coupling": dip.coupling_q, "Q_internal": dip.internal_q}


def _root(design: ComplexArray) -> ComplexArray:
    """R (k, k), R R^H = (A^H A)^-1: errors of coefficients of columns A for errors of one."""
    sizes = np.linalg.norm(design, axis=0)
    upper = np.linalg.qr(design / sizes, mode="r")
    return np.asarray(np.linalg.inv(upper) / sizes[:, None])


def complex_figure(
    curve: ComplexCurve, before: ComplexArray, after: ComplexArray, series: str = ""
) -> Figure:
    """X and Y over frequency with the model, and residuals of both in % of the largest modulus.

    Args:
        curve: as measured.
        before: as simulated with the start parameters, (n,), in the curve's unit.
        after: with the fitted ones.
        series: name of the series.
    """
    f = curve.u_hz
    x = Axis("drive frequency f", "Hz")
    unit = "" if curve.unit == "1" else curve.unit
    sigma = np.full(f.size, curve.sigma) if curve.sigma > 0.0 else np.empty(0)
    parts = (("X", np.real), ("Y", np.imag))
    panels = [
        Panel(
            x=x,
            y=Axis(f"quadrature {name}", unit),
            layers=(
                Layer(Role.MEASURED, Form.POINTS, f, part(curve.y), label="measured", sigma=sigma),
                Layer(Role.START, Form.CURVE, f, part(before), label="model, start parameters"),
                Layer(Role.SIMULATED, Form.CURVE, f, part(after), label="model, fitted parameters"),
            ),
        )
        for name, part in parts
    ]
    left = 100.0 * (after - curve.y) / curve.largest
    rest = Panel(
        x=x,
        y=Axis("minus measured", "% of largest"),
        layers=(
            Layer(Role.SIMULATED, Form.POINTS, f, left.real, label="X"),
            Layer(Role.OTHER, Form.POINTS, f, left.imag, label="Y"),
        ),
        level=0.0,
        height=0.5,
    )
    rms = number(float(np.sqrt(np.mean(np.abs(left) ** 2) / 2.0)), 2)
    name = f"8_complex_sweep{f'_{curve.label}' if curve.label else ''}".replace("/", "_")
    said = f" {curve.label}" if curve.label else ""
    return Figure(
        name=name,
        title=f"Complex sweep{said}: measured and simulated",
        caption=(
            f"Both quadratures at {f.size} frequencies with the model before and after the fit; "
            f"wiring: {curve.wiring.kind}, background: {curve.wiring.background}. Below: what the "
            f"fit leaves, {rms} % of the largest value in each quadrature (rms)."
        ),
        alt=f"X and Y at {f.size} frequencies with the fitted model; residual {rms} % rms.",
        rows=((panels[0],), (panels[1],), (rest,)),
        series=series,
    )
