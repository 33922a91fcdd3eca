"""Data without files: parameters, tones and sweeps as a program has them, checked as files are.

What is nonsense is refused where it is made; what only the FMU can tell (names, units, ranges) when
`bind_arrays` meets its variables. Plain numbers are in the FMU's unit, texts such as "6.94 MHz"
have their own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fitting.campaign import parameters as bound_parameters
from fitting.campaign.asked_parameters import bind_parameters
from fitting.campaign.binder import Binder
from fitting.campaign.binding import bind_alternatives, bind_experiment, free_scale
from fitting.campaign.bound import BoundCampaign, SweepData
from fitting.campaign.bound_laws import with_laws
from fitting.campaign.conflicts import check_conflicts
from fitting.campaign.file import ContinuationSettings, offset_trouble
from fitting.campaign.kind import BoundMeasurement, is_measurement, labels_of
from fitting.campaign.measured import NO_FILE, MeasuredExperiment, MeasuredSweep, Phases
from fitting.campaign.noise import Noise
from fitting.campaign.places import Places, places_of_series
from fitting.campaign.setup import Drive, Setup
from fitting.campaign.stated import DriftPriors, bind_sigmas, with_offsets
from fitting.campaign.unnamed_tones import check_tones
from fitting.fmu.variables import READABLE, SETTABLE, VariableLike
from fitting.signal.peaks import BACKGROUNDS
from fitting.signal.scale import SCALES
from fitting.text.arguments import checked
from fitting.text.arrays import ComplexArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.units import checked_accuracy, convert, parse_quantity, same_kind
from fitting.text.written import Written, as_written, difference_in, in_unit, written_values

SCOPES = ("campaign", "experiment")


@checked
@dataclass(frozen=True)
class Parameter:
    """A coefficient that is looked for: a Real parameter of the FMU and the box it lies in.

    Args:
        name: The FMU's variable, or a coefficient that a law names.
        start: Where the search begins, inside the box; a number in ``unit``, or a text with a unit
            of its own as "400 Hz", like all that follow.
        bounds: Lower and upper end of the box, in ``unit``.
        unit: Of all plain numbers here; None: the FMU's.
        reference: Where the Tikhonov term pulls to, in ``unit``; None: the start.
        scale: The change that counts as one in the search vector, in ``unit``; None: half the box.
        period: Values that far apart are the same system, in ``unit``; None: none are.
        prior: Standard deviation of a Gaussian prior about ``reference``, in ``unit``; None: all
            values in the box are equally likely.
        scope: "campaign": one value for all data; "experiment": every experiment has its own.

    Raises:
        BadInput: bounds reversed, a start outside, numbers that are not finite or not positive.
    """

    name: str
    start: float | str
    _: KW_ONLY
    bounds: tuple[float | str, float | str]
    unit: str | None = None
    reference: float | str | None = None
    scale: float | str | None = None
    period: float | str | None = None
    prior: float | str | None = None
    scope: str = "campaign"

    def __post_init__(self) -> None:
        if self.scope not in SCOPES:
            raise BadInput(
                f"parameter '{self.name}': scope is {self.scope!r}, wanted one of "
                f"{', '.join(SCOPES)}"
            )
        if np.shape(self.bounds) != (2,):
            raise BadInput(
                f"parameter '{self.name}': bounds are {self.bounds!r}, wanted (lower, upper)"
            )
        numbers = self.numbers
        if len({written.unit is None for written in numbers.values()}) > 1:
            return  # plain numbers are in the FMU's unit, which is known beside it alone
        found = {
            key: (difference_in if key in bound_parameters.DIFFERENCES else in_unit)(
                written, self.unit
            )
            for key, written in numbers.items()
        }
        bound_parameters.Parameter(
            name=self.name,
            unit=self.unit or "",
            lower=found["lower"],
            upper=found["upper"],
            start=found["start"],
            reference=found.get("reference", found["start"]),
            scale=found.get("scale", max(0.5 * (found["upper"] - found["lower"]), 1e-300)),
            period=found.get("period"),
            prior_sigma=found.get("prior"),
        )

    @property
    def numbers(self) -> dict[str, Written]:
        """What was said of it by key, each in the unit that stands with it, else in ``unit``.

        Raises:
            BadInput: what is neither a number nor a quantity with a unit.
        """
        said = {
            "lower": self.bounds[0],
            "upper": self.bounds[1],
            "start": self.start,
            "reference": self.reference,
            "scale": self.scale,
            "period": self.period,
            "prior": self.prior,
        }
        return {
            key: _number(value, self.unit, f"parameter '{self.name}': {key}")
            for key, value in said.items()
            if value is not None
        }


@checked
@dataclass(frozen=True, eq=False)
class Tones:
    """Amplitudes of a steady response, read under some tones at a time: m experiments.

    Args:
        setup: How the FMU is driven and what is observed.
        drive_hz: Frequencies of the tones, shape (m, k), Hz.
        peaks_v: Measured peak amplitudes of the lines, shape (m, l), in ``amplitude_unit``; or
            complex values z of Re[z exp(i 2 pi u t)], as a lock-in amplifier has them.
        sigmas_v: Standard deviations of the amplitudes, or of each quadrature, shape (m, l), in
            ``amplitude_unit``; NaN or None where nobody knows them.
        lines_hz: Frequencies of the lines, shape (m, l), Hz; None: the tones.
        settings: Start values of the FMU by variable, one for all experiments or (m,) of them, in
            the FMU's units.
        labels: Names of the experiments, m of them; None: "1", "2", ...
        output: The FMU's output that these experiments observe; empty: the setup's.
        amplitude_unit: The detector's.
        series: Measurements of one series share their scale and setup.
        unknown: What is solved inside, with complex values: "phase", one reference phase; "gain",
            one complex gain; "none": phases are those of the drive.
        restarted: Labels of experiments from which on the reference phase is another one.

    Raises:
        BadInput: shapes that do not fit, amplitudes or frequencies that are not positive.
    """

    setup: Setup
    drive_hz: npt.ArrayLike
    peaks_v: npt.ArrayLike
    _: KW_ONLY
    sigmas_v: npt.ArrayLike | None = None
    lines_hz: npt.ArrayLike | None = None
    settings: Mapping[str, Scalar | Sequence[Scalar] | npt.NDArray[np.float64]] = field(
        default_factory=dict
    )
    labels: Sequence[str] | None = None
    output: str = ""
    amplitude_unit: str = "V"
    series: str = ""
    unknown: str = "phase"
    restarted: Sequence[str] = ()
    experiments: tuple[MeasuredExperiment, ...] = field(init=False)

    def __post_init__(self) -> None:
        _check_setup("tones", self.setup)
        drive_hz = _table(self.drive_hz, "drive_hz", None)
        count = len(drive_hz)
        names = self.setup.drive.frequency_names
        if self.setup.drive.kind == "tones" and drive_hz.shape[1] != len(names):
            raise BadInput(
                f"tones: drive_hz has the shape {drive_hz.shape}, wanted ({count}, {len(names)}), "
                f"a column for each of {', '.join(names)}"
            )
        lines_hz = drive_hz if self.lines_hz is None else _table(self.lines_hz, "lines_hz", count)
        values = _table(self.peaks_v, "peaks_v", count, complex)
        peaks_v = np.abs(values)
        if not np.iscomplexobj(self.peaks_v):
            peaks_v = values.real
        sigmas_v = np.full(peaks_v.shape, np.nan)
        if self.sigmas_v is not None:
            sigmas_v = _table(self.sigmas_v, "sigmas_v", count)
        labels = self.labels if self.labels is not None else [str(k + 1) for k in range(count)]
        if len(labels) != count:
            raise BadInput(f"tones: {len(labels)} labels, wanted {count}, one per experiment")
        columns = {name: _column(each, count, name) for name, each in self.settings.items()}
        phases = self._phases(values, labels)
        made = tuple(
            MeasuredExperiment(
                label=str(label),
                tones_hz=tuple(map(float, drive_hz[i])),
                lines_hz=tuple(map(float, lines_hz[i])),
                peaks_v=peaks_v[i],
                sigmas_v=sigmas_v[i],
                settings=self._settings(drive_hz[i], {n: c[i] for n, c in columns.items()}, label),
                output=Written(self.output, None, "tones: output") if self.output else None,
                phases=phases[i],
            )
            for i, label in enumerate(labels)
        )
        object.__setattr__(self, "experiments", made)

    def _phases(self, values: ComplexArray, labels: Sequence[str]) -> list[Phases | None]:
        """Phases of every experiment; None for amplitudes."""
        if not np.iscomplexobj(self.peaks_v):
            if self.restarted or self.unknown != "phase":
                key = "restarted" if self.restarted else "unknown"
                raise BadInput(f"tones: {key} has a meaning with complex peaks_v only")
            return [None] * len(labels)
        for label in self.restarted:
            if label not in labels:
                raise BadInput(f"tones: restarted names '{label}', wanted some of the labels")
        return [
            Phases(radians=np.angle(row), unknown=self.unknown, restarted=label in self.restarted)
            for row, label in zip(values, labels, strict=True)
        ]

    def _settings(
        self, tones_hz: npt.NDArray[np.float64], own: Mapping[str, Scalar], label: str
    ) -> dict[str, Written]:
        where = f"{places_of_series(self.series).top}tones: experiment '{label}'"
        drive = self.setup.drive
        held = written_values(own, where)
        if drive.kind == "tones":
            for name, tone in zip(drive.frequency_names, tones_hz, strict=True):
                held[name] = Written(float(tone), "Hz", f"{where}: {name}")
        return held


@checked
@dataclass(frozen=True, eq=False)
class Sweep:
    """Amplitudes of a steady response to one tone after another: n points.

    Args:
        setup: How the FMU is driven and what is observed.
        frequency_hz: Frequencies of the tone, shape (n,), Hz, rising.
        amplitude_v: Measured peak amplitudes, shape (n,), in ``amplitude_unit``.
        phase_rad: Measured phases, shape (n,), rad, for the figures; None: not measured.
        settings: Start values of the FMU during the sweep by variable, in the FMU's units.
        setting_sigma: Standard deviations of settings, numbers in the FMU's units or texts as
            "0.2 Hz": an offset of each is fitted; what has none is exact.
        use: "fit": every point is fitted; "scale": the sweep gives the scale alone.
        scale: The factor between simulated and measured amplitudes: "fit": least squares over the
            points; "maximum": ratio of the maxima; "robust": Huber's estimate over the points;
            "free": a fitted one; "none": 1.
        background: Of the line that is fitted to it without the FMU: "none" or "complex"; "offset"
            (use "fit"): a constant added to the amplitudes, which is solved beside the FMU's, too;
            "slope": one that changes linearly with frequency.
        amplitude_unit: The detector's.
        series: Measurements of one series share their scale and setup.

    Raises:
        BadInput: fewer than 8 points, shapes that differ, frequencies that do not rise, negative
            amplitudes, a ``use``, ``scale`` or ``background`` that there is not.
    """

    setup: Setup
    frequency_hz: npt.ArrayLike
    amplitude_v: npt.ArrayLike
    _: KW_ONLY
    phase_rad: npt.ArrayLike | None = None
    settings: Mapping[str, Scalar] = field(default_factory=dict)
    setting_sigma: Mapping[str, float | str] = field(default_factory=dict)
    use: str = "fit"
    scale: str = "fit"
    background: str = "none"
    amplitude_unit: str = "V"
    series: str = ""
    measured: MeasuredSweep = field(init=False)

    def __post_init__(self) -> None:
        _check_setup("sweep", self.setup)
        if np.iscomplexobj(self.amplitude_v):
            raise BadInput("sweep: amplitude_v is complex, wanted peak amplitudes (numpy.abs)")
        for name, known in (
            ("use", ("fit", "scale")),
            ("scale", SCALES),
            ("background", BACKGROUNDS),
        ):
            if getattr(self, name) not in known:
                raise BadInput(
                    f"sweep: {name} is {getattr(self, name)!r}, wanted one of {', '.join(known)}"
                )
        if self.setting_sigma and self.use != "fit":
            raise BadInput('sweep: setting_sigma has a meaning with use = "fit" only')
        for trouble in offset_trouble(self.background, self.use, self.scale):
            raise BadInput(f"sweep: background: {trouble}")
        measured = MeasuredSweep(
            frequency_hz=self.frequency_hz,  # type: ignore[arg-type]  # made an array there
            amplitude_v=self.amplitude_v,  # type: ignore[arg-type]
            phase_rad=self.phase_rad,  # type: ignore[arg-type]
            source=Path(f"{places_of_series(self.series).top}sweep"),
            unit=self.amplitude_unit,
        )
        object.__setattr__(self, "measured", measured)


def _number(value: object, unit: str | None, where: str) -> Written:
    """A number in ``unit``, or a text with its own."""
    if isinstance(value, str):
        number, own = parse_quantity(value, where=where, wanted=unit)
        return Written(number, own or unit, where)
    try:
        return Written(float(value), unit, where)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise BadInput(f'{where}: found {value!r}, wanted a number or a text as "400 Hz"') from None


def _check_setup(kind: str, setup: object) -> None:
    if not isinstance(setup, Setup):
        raise BadInput(f"{kind}: setup is a {type(setup).__name__}, wanted a Setup")
    if setup.drive.kind == "none":
        raise BadInput(
            f"{kind}: its drive has neither frequency_names nor an input; wanted what drives the "
            "FMU"
        )


def _table(values: npt.ArrayLike, name: str, rows: int | None, kind: type = float) -> Any:
    """An array of numbers (m, k), real or complex."""
    try:
        table: npt.NDArray[Any] = np.asarray(values, dtype=kind)
    except (TypeError, ValueError, OverflowError):
        raise BadInput(f"tones: {name} is not an array of numbers") from None
    if table.ndim != 2 or table.size == 0 or (rows is not None and len(table) != rows):
        wanted = "(experiments, tones)" if rows is None else f"({rows}, lines)"
        raise BadInput(f"tones: {name} has the shape {table.shape}, wanted {wanted}")
    return table


def _column(values: object, count: int, name: str) -> list[Scalar]:
    """One value per experiment."""
    found = np.asarray(values)
    if found.ndim > 1 or (found.ndim == 1 and found.size != count):
        raise BadInput(
            f"tones: settings '{name}' have the shape {found.shape}, wanted one value or ({count},)"
        )
    column: list[Scalar] = np.broadcast_to(found, count).tolist()
    return column


def _kind(measurement: Tones | Sweep) -> str:
    """What complaints call it."""
    return type(measurement).__name__.lower()


@dataclass(frozen=True, kw_only=True)
class ArrayData:
    """Everything that a campaign file would say, of a program.

    ``alternatives`` hold values to try by variable, in all combinations; ``derived`` names outputs
    of the FMU that are reported; ``noise`` is what is declared beside the ``sigmas_v``; further
    kinds of measurements are in the FMU's units already.
    """

    parameters: Sequence[Parameter]
    measurements: Sequence[Tones | Sweep | BoundMeasurement]
    derived: Sequence[str] = ()
    alternatives: Mapping[str, Sequence[Scalar]] = field(default_factory=dict)
    noise: Noise = field(default_factory=Noise)
    title: str = ""


def bind_arrays(
    data: ArrayData, variables: Mapping[str, VariableLike]
) -> tuple[BoundCampaign, ...]:
    """The campaigns that such data are, one for each series, in the FMU's names and units.

    Args:
        data: parameters and measurements.
        variables: of the FMU, by name.

    Raises:
        BadInput: nothing to fit, unknown variables, units or kinds that do not match, one series
            with two setups or two sweeps.
    """
    if not data.parameters:
        raise BadInput("problem: no parameters, wanted at least one")
    for thing in data.parameters:
        if not isinstance(thing, Parameter):
            raise BadInput(f"problem: parameters hold a {type(thing).__name__}, wanted Parameter")
    for other in data.measurements:
        if not isinstance(other, Tones | Sweep) and not is_measurement(other):
            raise BadInput(
                f"problem: measurements hold a {type(other).__name__}, wanted Tones or Sweep"
            )
    if not any(_is_fitted(m) for m in data.measurements):
        raise BadInput('problem: nothing to fit, wanted tones, or a sweep with use = "fit"')
    names = dict.fromkeys(m.series for m in data.measurements)
    made = []
    for name in names:
        mine = [m for m in data.measurements if m.series == name]
        made.append(_Series(data, name, Binder(variables, mine[0].setup.laws.names)).bound())
    return tuple(made)


def _is_fitted(measurement: Tones | Sweep | BoundMeasurement) -> bool:
    if isinstance(measurement, Sweep):
        return measurement.use == "fit"
    return isinstance(measurement, Tones) or measurement.rows > 0


@dataclass(frozen=True)
class _Series:
    """The measurements of one series, and the variables of its FMU."""

    data: ArrayData
    name: str
    binder: Binder

    @property
    def path(self) -> Path:
        """What results name it by."""
        return NO_FILE / self.name

    @property
    def places(self) -> Places:
        """What complaints name it and its parts by."""
        return places_of_series(self.name)

    @property
    def top(self) -> str:
        """What opens complaints: nothing where there is but one series."""
        return self.places.top

    @property
    def mine(self) -> list[Tones | Sweep | BoundMeasurement]:
        """Its measurements."""
        return [m for m in self.data.measurements if m.series == self.name]

    def further(self, setup: Setup) -> dict[str, BoundMeasurement]:
        """Its measurements of further kinds, driven so, by a name for complaints."""
        others = [m for m in self.mine if not isinstance(m, Tones | Sweep)]
        return {
            f"{type(m).__name__} {k}": m.within(setup, "") for k, m in enumerate(others, start=1)
        }

    def bound(self) -> BoundCampaign:
        """The series as a campaign."""
        given, binder = self._setup(), self.binder
        output = binder.real(given.output, f"{self.top}setup: output", READABLE, "observed")
        swept, factor, unit = self._sweep(), *self._unit(output)
        setup = replace(
            given,
            drive=self._drive(given.drive),
            start_values={
                name: binder.setting(
                    name, as_written(value, f"{self.top}setup: start_values: {name}")
                )
                for name, value in given.start_values.items()
            },
            accuracy=checked_accuracy(given.accuracy, f"{self.top}setup: accuracy"),
            source=f"{self.top}setup",
        )
        measured = [e for m in self.mine if isinstance(m, Tones) for e in m.experiments]
        experiments = tuple(
            bind_experiment(
                replace(e, peaks_v=factor * e.peaks_v, sigmas_v=factor * e.sigmas_v),
                binder,
                setup.drive,
                output,
            )
            for e in measured
        )
        further = self.further(setup)
        labels = [*(e.label for e in experiments), *labels_of(further.values())]
        if len(set(labels)) < len(labels):
            raise BadInput(
                f"{self.top}tones: labels {', '.join(labels)}; wanted another one for each "
                "experiment"
            )
        for name in self.data.derived:
            binder.reported(name, "problem: derived", setup.laws.formulas)
        sweep = None if swept is None else self._sweep_data(swept, factor, unit)
        bound = BoundCampaign(
            title=self.data.title or "Data from arrays",
            path=self.path,
            synthetic=False,
            setup=setup,
            experiments=experiments,
            sweep=sweep,
            parameters=(
                *bind_parameters(self.data.parameters, binder, self.places, labels),
                *free_scale(sweep, self.data.noise),
                *(p for m in further.values() for p in m.parameters),
            ),
            derived=tuple(self.data.derived),
            alternatives=self._alternatives(),
            continuation=ContinuationSettings(),
            amplitude_unit=unit,
            notes=tuple(binder.notes),
            files=(),
            noise=self.data.noise,
            measurements=further,
        )
        bound = with_offsets(bound, binder, DriftPriors())
        check_conflicts(bound, self.places)
        check_tones(bound, binder.variables, self.places)
        return with_laws(bound, binder, self.places)

    def _setup(self) -> Setup:
        setups = [m.setup for m in self.mine]
        if any(setup != setups[0] for setup in setups):
            raise BadInput(
                f"{self.top}measurements with different setups; wanted a series for each setup"
            )
        return setups[0]

    def _sweep(self) -> Sweep | None:
        found = [m for m in self.mine if isinstance(m, Sweep)]
        if len(found) > 1:
            raise BadInput(f"{self.top}{len(found)} sweeps, wanted a series for each of them")
        return found[0] if found else None

    def _unit(self, output: VariableLike) -> tuple[float, str]:
        """Factor and unit of the amplitudes: the output's where no scale stands between the two."""
        given = [m for m in self.mine if isinstance(m, Tones | Sweep)]
        if not given:
            return 1.0, output.unit or "V"
        units = {m.amplitude_unit: _kind(m) for m in reversed(given)}
        if len(units) > 1:
            said = ", ".join(f"{kind} in {unit!r}" for unit, kind in reversed(units.items()))
            raise BadInput(f"{self.top}{said}; wanted one amplitude_unit")
        sweep, [(unit, kind)] = self._sweep(), units.items()
        free = any(isinstance(m, Tones) and m.unknown == "gain" for m in given)
        if output.unit is None or free or (sweep is not None and sweep.scale != "none"):
            return 1.0, unit
        where = f"{self.top}{kind}: amplitude_unit"
        try:
            return convert(1.0, unit, output.unit, where=where), output.unit
        except BadInput as error:
            raise BadInput(
                f"{error}; without a scale amplitudes are compared with '{output.name}' as they are"
            ) from error

    def _drive(self, drive: Drive) -> Drive:
        where = f"{self.top}setup: drive"
        if drive.kind == "none":
            return drive
        if drive.input is not None:
            self.binder.real(drive.input, where, ("input",), "driven")
            return drive
        for name in drive.amplitude_names:
            self.binder.real(name, where, SETTABLE, "set")
        names = drive.frequency_names
        declared = [self.binder.real(name, where, SETTABLE, "set").unit for name in names]
        units = [unit or drive.tone_unit for unit in declared]
        if len(set(units)) > 1:
            raise BadInput(f"{where}: the FMU has the frequencies in different units: {units}")
        if drive.frequency_unit not in ("", units[0]):
            raise BadInput(
                f"{where}: frequency_unit is {drive.frequency_unit!r}, but the FMU has "
                f"'{names[0]}' in {units[0]!r}; wanted that, or nothing"
            )
        if not same_kind(units[0], "Hz"):
            raise BadInput(f"{where}: the unit of '{names[0]}' is {units[0]!r}, wanted a frequency")
        return replace(drive, frequency_unit=units[0])

    def _sweep_data(self, sweep: Sweep, factor: float, unit: str) -> SweepData:
        written = written_values(sweep.settings, f"{self.top}sweep: settings")
        return SweepData(
            frequency_hz=sweep.measured.frequency_hz,
            amplitude_v=factor * sweep.measured.amplitude_v,
            phase_rad=sweep.measured.phase_rad,
            settings={name: self.binder.setting(name, w) for name, w in written.items()},
            setting_sigma=bind_sigmas(
                written_values(sweep.setting_sigma, f"{self.top}sweep: setting_sigma"),
                self.binder,
            ),
            use=sweep.use,
            scale=sweep.scale,
            source=self.path,
            background=sweep.background,
            unit=unit,
        )

    def _alternatives(self) -> tuple[Mapping[str, Scalar], ...]:
        for name, values in self.data.alternatives.items():
            if isinstance(values, str) or np.ndim(values) != 1 or not len(values):
                raise BadInput(
                    f"problem: alternatives: {name}: found {values!r}, wanted a list of values"
                )
        asked = {
            name: [as_written(value, f"problem: alternatives: {name}") for value in values]
            for name, values in self.data.alternatives.items()
        }
        return bind_alternatives(asked, self.binder)
