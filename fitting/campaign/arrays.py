"""Data without files: parameters, tones and sweeps as a program has them, checked as files are.

What is nonsense is refused where it is made; what depends on the FMU (names, units, ranges) when
`bind_arrays` meets its variables. Plain numbers are in the FMU's unit, texts such as "6.94 MHz"
have their own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fitting.campaign.binder import IN_PROGRAM, Binder
from fitting.campaign.binding import (
    bind_alternatives,
    bind_drive,
    bind_experiment,
    bind_parameters,
    completed,
    factor_to_output,
    parameter_of,
    written_numbers,
)
from fitting.campaign.bound import BoundCampaign, Setup
from fitting.campaign.drift import bind_sigmas
from fitting.campaign.file import offset_trouble
from fitting.campaign.kind import SeriesMeasurement, labels_of
from fitting.campaign.measured import NO_FILE, Experiment, SweepData, checked_experiment
from fitting.campaign.noise import Noise
from fitting.campaign.parameters import SCOPES
from fitting.fmu.description import READABLE, FmuVariable
from fitting.lines.names import BACKGROUNDS
from fitting.signal.scale import SCALES
from fitting.text.arguments import checked
from fitting.text.arrays import Scalar, as_numbers, as_values
from fitting.text.errors import BadInput
from fitting.text.units import Written, as_written, checked_accuracy, written_values


@checked
@dataclass(frozen=True)
class Parameter:
    """A fitted Real parameter of the FMU with its bounds.

    Args:
        name: A variable of the FMU, or a coefficient of a law.
        start: Start of the search, within the bounds; in ``unit``, or, like all that follow, a text
            as "400 Hz".
        bounds: Lower and upper bound, in ``unit``.
        unit: Of plain numbers; None: the FMU's.
        reference: Centre of Tikhonov term and prior, in ``unit``; None: the start.
        scale: Change by 1 of the search vector, in ``unit``; None: half the distance of the bounds.
        period: Values that far apart are equal, in ``unit``; None: none are.
        prior: Standard deviation of a Gaussian prior about ``reference``, in ``unit``; None:
            uniform within the bounds.
        scope: "campaign": one value; "experiment": one for each experiment.

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
    scope: str = SCOPES[0]

    def __post_init__(self) -> None:
        who = f"parameter '{self.name}'"
        if self.scope not in SCOPES:
            raise BadInput(f"{who}: scope is {self.scope!r}, wanted one of {', '.join(SCOPES)}")
        if np.shape(self.bounds) != (2,):
            raise BadInput(f"{who}: bounds are {self.bounds!r}, wanted (lower, upper)")
        numbers = written_numbers(self)
        # where some have a unit, plain numbers are in the FMU's, which is known beside it alone
        if len({written.unit is None for written in numbers.values()}) == 1:
            parameter_of(self.name, self.unit, numbers)

    @property
    def lower(self) -> float | str:
        """Lower bound."""
        return self.bounds[0]

    @property
    def upper(self) -> float | str:
        """Upper bound."""
        return self.bounds[1]


@checked
@dataclass(frozen=True, eq=False)
class Tones:
    """Amplitudes of a steady response under some tones at a time: m experiments.

    Args:
        setup: How the FMU is driven and what is observed.
        drive_hz: Frequencies of the tones, shape (m, k), Hz.
        peaks_v: Peak amplitudes of the lines, shape (m, l), in ``amplitude_unit``, or complex z,
            Re[z exp(i 2 pi u t)].
        sigmas_v: Their standard deviations, or of each quadrature, shape (m, l), in
            ``amplitude_unit``; NaN or None: unknown.
        lines_hz: Frequencies of the lines, shape (m, l), Hz; None: the tones.
        settings: Start values of the FMU by variable, one or (m,), in the FMU's units.
        labels: Names of the m experiments; None: "1", "2", ...
        output: The observed output of the FMU; empty: the setup's.
        amplitude_unit: The detector's.
        series: Measurements of one series share scale and setup.
        unknown: Solved for with complex values: "phase": one reference phase; "gain": one complex
            gain; "none": phases are those of the drive.
        restarted: Labels of experiments at which a new reference phase begins.

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

    def __post_init__(self) -> None:
        _check_setup("tones", self.setup)
        _ = self.experiments  # what is nonsense is refused here

    @cached_property
    def experiments(self) -> tuple[Experiment, ...]:
        """What was measured, as of a file."""
        drive, drive_hz = self.setup.drive, _table(self.drive_hz, "drive_hz", None)
        count, names, tones = len(drive_hz), drive.frequency_names, drive.kind == "tones"
        if tones and drive_hz.shape[1] != len(names):
            raise BadInput(
                f"tones: drive_hz has the shape {drive_hz.shape}, wanted ({count}, {len(names)}), "
                f"a column for each of {', '.join(names)}"
            )
        lines_hz = drive_hz if self.lines_hz is None else _table(self.lines_hz, "lines_hz", count)
        values = _table(self.peaks_v, "peaks_v", count, as_values)
        is_complex = np.iscomplexobj(values)
        peaks_v = np.abs(values) if is_complex else values
        sigmas_v = np.full(peaks_v.shape, np.nan)
        if self.sigmas_v is not None:
            sigmas_v = _table(self.sigmas_v, "sigmas_v", count)
        labels = self.labels if self.labels is not None else [str(k + 1) for k in range(count)]
        if len(labels) != count:
            raise BadInput(f"tones: {len(labels)} labels, wanted {count}, one per experiment")
        columns = {name: _column(each, count, name) for name, each in self.settings.items()}
        if not is_complex and (self.restarted or self.unknown != "phase"):
            key = "restarted" if self.restarted else "unknown"
            raise BadInput(f"tones: {key} has a meaning with complex peaks_v only")
        for label in self.restarted:
            if label not in labels:
                raise BadInput(f"tones: restarted names '{label}', wanted some of the labels")
        made = []
        for i, label in enumerate(labels):
            where = f"{_top(self.series)}tones: experiment '{label}'"
            written = written_values({name: column[i] for name, column in columns.items()}, where)
            for name, tone in zip(names if tones else (), drive_hz[i], strict=tones):
                written[name] = Written(float(tone), "Hz", f"{where}: {name}")
            experiment = Experiment(
                label=str(label),
                tones_hz=tuple(map(float, drive_hz[i])),
                lines_hz=tuple(map(float, lines_hz[i])),
                peaks_v=peaks_v[i],
                sigmas_v=sigmas_v[i],
                written=written,
                observed=Written(self.output, None, "tones: output") if self.output else None,
                phases_rad=np.angle(values[i]) if is_complex else None,
                unknown=self.unknown,
                restarted=label in self.restarted,
            )
            made.append(checked_experiment(experiment))
        return tuple(made)


@checked
@dataclass(frozen=True, eq=False)
class Sweep:
    """Amplitudes of a steady response to one tone after another: n points.

    Args:
        setup: How the FMU is driven and what is observed.
        frequency_hz: Frequencies of the tone, shape (n,), Hz, rising.
        amplitude_v: Peak amplitudes, shape (n,), in ``amplitude_unit``.
        sigma_v: Standard errors of the amplitudes, shape (n,), in ``amplitude_unit``, above zero;
            None: unknown.
        phase_rad: Phases, shape (n,), rad, for figures; None: not measured.
        settings: Start values of the FMU by variable, in the FMU's units.
        setting_sigma: Standard deviations of settings, numbers in the FMU's units or texts as "0.2
            Hz": an offset of each is fitted; others are exact.
        use: "fit": every point is fitted; "scale": only the scale is taken from it.
        scale: From simulated to measured amplitudes: "fit": least squares; "maximum": ratio of
            maxima; "robust": Huber's estimate; "free": a fitted parameter; "none": 1.
        background: Of the line fitted without the FMU: "none" or "complex"; with ``use`` "fit"
            solved together with the FMU: "offset", a constant added to amplitudes, or "slope",
            linear in frequency.
        amplitude_unit: The detector's.
        series: Measurements of one series share scale and setup.

    Raises:
        BadInput: fewer than 8 points, shapes that differ, frequencies that do not rise, negative
            amplitudes, a ``use``, ``scale`` or ``background`` that there is not.
    """

    setup: Setup
    frequency_hz: npt.ArrayLike
    amplitude_v: npt.ArrayLike
    _: KW_ONLY
    sigma_v: npt.ArrayLike | None = None
    phase_rad: npt.ArrayLike | None = None
    settings: Mapping[str, Scalar] | None = None
    setting_sigma: Mapping[str, float | str] | None = None
    use: str = "fit"
    scale: str = "fit"
    background: str = "none"
    amplitude_unit: str = "V"
    series: str = ""

    def __post_init__(self) -> None:
        _check_setup("sweep", self.setup)
        if np.iscomplexobj(self.amplitude_v):
            raise BadInput("sweep: amplitude_v is complex, wanted peak amplitudes (numpy.abs)")
        for key, known in (
            ("use", ("fit", "scale")),
            ("scale", SCALES),
            ("background", BACKGROUNDS),
        ):
            word = getattr(self, key)
            if word not in known:
                raise BadInput(f"sweep: {key} is {word!r}, wanted one of {', '.join(known)}")
        if self.setting_sigma and self.use != "fit":
            raise BadInput('sweep: setting_sigma has a meaning with use = "fit" only')
        for trouble in offset_trouble(self.background, self.use, self.scale):
            raise BadInput(f"sweep: background: {trouble}")
        for name in ("frequency_hz", "amplitude_v", "sigma_v", "phase_rad"):
            object.__setattr__(self, name, getattr(self.data, name))

    @cached_property
    def data(self) -> SweepData:
        """What was measured, as of a file."""
        return SweepData(
            frequency_hz=self.frequency_hz,  # type: ignore[arg-type]  # made an array there
            amplitude_v=self.amplitude_v,  # type: ignore[arg-type]
            sigma_v=self.sigma_v,  # type: ignore[arg-type]
            phase_rad=self.phase_rad,  # type: ignore[arg-type]
            source=Path(f"{_top(self.series)}sweep"),
            unit=self.amplitude_unit,
            use=self.use,
            scale=self.scale,
            background=self.background,
        )


def _top(series: str) -> str:
    """What opens errors about a series: nothing where there is but one."""
    return f"series '{series}': " if series else ""


def _check_setup(kind: str, setup: Setup) -> None:
    if setup.drive.kind == "none":
        raise BadInput(
            f"{kind}: its drive has neither frequency_names nor an input; wanted what drives the "
            "FMU"
        )


def _table(
    values: npt.ArrayLike, name: str, rows: int | None, read: Callable[..., Any] = as_numbers
) -> Any:
    """An array of numbers (m, k), real or complex."""
    table = read(values, f"tones: {name}")
    if table.ndim != 2 or table.size == 0 or (rows is not None and len(table) != rows):
        wanted = "(experiments, tones)" if rows is None else f"({rows}, lines)"
        raise BadInput(f"tones: {name} has the shape {table.shape}, wanted {wanted}")
    return table


def _column(values: object, count: int, name: str) -> list[Scalar]:
    """One value per experiment."""
    result = np.asarray(values)
    if result.ndim > 1 or (result.ndim == 1 and result.size != count):
        raise BadInput(
            f"tones: settings '{name}' have the shape {result.shape}, wanted one value or "
            f"({count},)"
        )
    column: list[Scalar] = np.broadcast_to(result, count).tolist()
    return column


Measured = Tones | Sweep | SeriesMeasurement


def bind_arrays(
    parameters: Sequence[Parameter],
    measurements: Sequence[Measured],
    variables: Mapping[str, FmuVariable],
    *,
    derived: Sequence[str] = (),
    alternatives: Mapping[str, Sequence[Scalar]] | None = None,
    noise: Noise | None = None,
) -> tuple[BoundCampaign, ...]:
    """The campaigns that such data are, one for each series, in the FMU's names and units.

    Args:
        parameters: that are looked for.
        measurements: those of further kinds are in the FMU's units already.
        variables: of the FMU, by name.
        derived: outputs of the FMU that are reported.
        alternatives: values to try by variable, in all combinations.
        noise: what is declared next to the ``sigmas_v``.

    Raises:
        BadInput: nothing to fit, unknown variables, units or kinds that do not match, one series
            with two setups or two sweeps.
    """
    if not parameters:
        raise BadInput("problem: no parameters, wanted at least one")
    for thing in parameters:
        if not isinstance(thing, Parameter):
            raise BadInput(f"problem: parameters hold a {type(thing).__name__}, wanted Parameter")
    for other in measurements:
        if not isinstance(other, Tones | Sweep) and not hasattr(other, "within"):
            raise BadInput(
                f"problem: measurements hold a {type(other).__name__}, wanted Tones or Sweep"
            )
    if not any(
        m.use == "fit" if isinstance(m, Sweep) else isinstance(m, Tones) or m.rows > 0
        for m in measurements
    ):
        raise BadInput('problem: nothing to fit, wanted tones, or a sweep with use = "fit"')
    tried = alternatives or {}
    for name, values in tried.items():
        if isinstance(values, str) or np.ndim(values) != 1 or not len(values):
            raise BadInput(
                f"problem: alternatives: {name}: found {values!r}, wanted a list of values"
            )
    written = {
        name: [as_written(value, f"problem: alternatives: {name}") for value in values]
        for name, values in tried.items()
    }
    bounds = []
    for name in dict.fromkeys(m.series for m in measurements):
        mine = [m for m in measurements if m.series == name]
        bounds.append(
            _bound_series(mine, parameters, variables, derived, written, noise or Noise())
        )
    return tuple(bounds)


def _bound_series(
    mine: Sequence[Measured],
    parameters: Sequence[Parameter],
    variables: Mapping[str, FmuVariable],
    derived: Sequence[str],
    alternatives: Mapping[str, Sequence[Written]],
    noise: Noise,
) -> BoundCampaign:
    """The measurements of one series as a campaign."""
    given, name, top = mine[0].setup, mine[0].series, _top(mine[0].series)
    binder = Binder(variables, given.laws.names, top, IN_PROGRAM)
    if any(m.setup != given for m in mine):
        raise BadInput(
            f"{top}measurements with different setups; wanted a series for each setup, or of "
            "several outputs under one drive one setup, and output= of each measurement"
        )
    output = binder.real(given.output, f"{top}setup: output", READABLE, "observed")
    tones = [m for m in mine if isinstance(m, Tones)]
    sweeps = [m for m in mine if isinstance(m, Sweep)]
    if len(sweeps) > 1:
        raise BadInput(f"{top}{len(sweeps)} sweeps, wanted a series for each of them")
    factor, unit = _unit([m for m in mine if isinstance(m, Tones | Sweep)], output, top)
    drive = given.drive
    if drive.kind != "none":
        drive, _ = bind_drive(drive, binder, f"{top}setup: drive")

    def settings(values: Mapping[str, Scalar], what: str) -> dict[str, Scalar]:
        return binder.settings(written_values(values, f"{top}{what}"))

    setup = replace(
        given,
        drive=drive,
        start_values=settings(given.start_values, "setup: start_values"),
        accuracy=checked_accuracy(given.accuracy, f"{top}setup: accuracy"),
        source=f"{top}setup",
    )
    measured = [e for m in tones for e in m.experiments]
    experiments = [
        replace(e, peaks_v=factor * e.peaks_v, sigmas_v=factor * e.sigmas_v)
        for e in (bind_experiment(each, binder, drive, output) for each in measured)
    ]
    others = [m.within(setup, "") for m in mine if not isinstance(m, Tones | Sweep)]
    labels = [*(e.label for e in experiments), *labels_of(others)]
    if len(set(labels)) < len(labels):
        raise BadInput(
            f"{top}tones: labels {', '.join(labels)}; wanted another one for each experiment"
        )
    for key in derived:
        binder.reported(key, "problem: derived", setup.laws.formulas)
    sweep: SweepData | None = None
    for own in sweeps:
        sigmas = written_values(own.setting_sigma or {}, f"{top}sweep: setting_sigma")
        sweep = replace(
            own.data,
            amplitude_v=factor * own.data.amplitude_v,
            sigma_v=None if own.data.sigma_v is None else factor * own.data.sigma_v,
            settings=settings(own.settings or {}, "sweep: settings"),
            setting_sigma=bind_sigmas(sigmas, binder),
            source=NO_FILE / name,
            unit=unit,
        )
    bound = BoundCampaign(
        title="Data from arrays",
        path=NO_FILE / name,
        setup=setup,
        experiments=tuple(experiments),
        sweep=sweep,
        parameters=(),
        derived=tuple(derived),
        alternatives=bind_alternatives(alternatives, binder),
        amplitude_unit=unit,
        files=(),
        noise=noise,
        measurements={f"{type(m).__name__} {k}": m for k, m in enumerate(others, start=1)},
    )
    return completed(bound, binder, bind_parameters(parameters, binder))


def _unit(given: Sequence[Tones | Sweep], output: FmuVariable, top: str) -> tuple[float, str]:
    """Factor and unit of the amplitudes: the output's where no scale stands between the two."""
    if not given:
        return 1.0, output.unit or "V"
    units = {m.amplitude_unit: type(m).__name__.lower() for m in reversed(given)}
    if len(units) > 1:
        each = ", ".join(f"{kind} in {unit!r}" for unit, kind in reversed(units.items()))
        raise BadInput(f"{top}{each}; wanted one amplitude_unit")
    [(unit, kind)] = units.items()
    free = any(isinstance(m, Tones) and m.unknown == "gain" for m in given)
    scaled = any(isinstance(m, Sweep) and m.scale != "none" for m in given)
    if output.unit is None or free or scaled:
        return 1.0, unit
    return factor_to_output(unit, output, f"{top}{kind}: amplitude_unit"), output.unit
