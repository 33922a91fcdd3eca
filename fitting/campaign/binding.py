"""Campaign meets FMU: names, kinds and units checked, every number converted to the FMU's unit."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from fitting.campaign.binder import Binder, bind_annotation
from fitting.campaign.data import Campaign, in_other_unit
from fitting.campaign.drift import Drifting, bind_drift
from fitting.campaign.file import SAMPLES_PER_PERIOD, ContinuationSettings
from fitting.campaign.kind import BoundMeasurement, labels_of
from fitting.campaign.laws import Known, Laws
from fitting.campaign.measured import MeasuredExperiment, Phases, Spectrum
from fitting.campaign.noise import (
    Noise,
    bind_noise,
    scale_parameter,
    sweep_scale_sigma,
    sweep_sigmas,
)
from fitting.campaign.parameters import Parameter
from fitting.campaign.places import Places, places_of_file
from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.fmu.variables import READABLE, REPORTABLE, SETTABLE, VariableLike
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.units import base_unit, convert, parse_quantity
from fitting.text.written import Written, in_unit

#: Each combination of alternatives is a fit of its own.
MOST_ALTERNATIVES = 100


@dataclass(frozen=True, kw_only=True)
class Drive:
    """How the FMU is driven: it drives itself by parameters of its own, or we drive an input.

    Args:
        frequency_names: Parameters of the FMU that hold the frequencies, one per tone.
        amplitude_names: Those that hold the amplitudes, one per tone.
        input: The input that is driven instead.
        amplitude: Of every tone that drives, in the unit of ``amplitude_names`` or ``input``.
        samples_per_period: How often ``input`` is set anew in a period.
        frequency_unit: Of ``frequency_names``, where the FMU declares none; empty: as the FMU says.
        highest_order: Combinations of tones up to this order may be in the response.

    Raises:
        BadInput: neither parameters nor an input, or both; numbers that no drive has.
    """

    frequency_names: tuple[str, ...] = ()
    amplitude_names: tuple[str, ...] = ()
    input: str | None = None
    amplitude: float = 1.0
    samples_per_period: int = SAMPLES_PER_PERIOD
    frequency_unit: str = ""
    highest_order: int = 1

    def __post_init__(self) -> None:
        for name in ("frequency_names", "amplitude_names"):
            value = getattr(self, name)
            if isinstance(value, str):
                raise BadInput(f"drive: {name} is {value!r}, wanted a sequence of names")
            object.__setattr__(self, name, tuple(value))
        if self.input is None and not self.frequency_names:
            raise BadInput(
                "drive: neither frequency_names nor an input; wanted what drives the FMU"
            )
        if self.input is None and len(self.amplitude_names) != len(self.frequency_names):
            raise BadInput(
                f"drive: {len(self.amplitude_names)} amplitude_names, wanted "
                f"{len(self.frequency_names)}, one per frequency"
            )
        if self.input is not None and self.amplitude_names:
            raise BadInput(f"drive: amplitude_names have no meaning for the input '{self.input}'")
        if not 0.0 <= self.amplitude < math.inf:
            raise BadInput(f"drive: amplitude is {self.amplitude!r}, wanted an amplitude")

    @property
    def tone_unit(self) -> str:
        """Unit of ``frequency_names``; Hz where nobody says another."""
        return self.frequency_unit or "Hz"

    @property
    def kind(self) -> str:
        """Who makes the tones: "tones", the FMU; "input", its input is driven."""
        return "tones" if self.input is None else "input"


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """One experiment, ``settings`` in the FMU's units (tones and interpolated drift included).

    ``tones_hz``, ``peaks_v``, ``sigmas_v`` (n,) as in
    :class:`fitting.campaign.measured.MeasuredExperiment`; ``lines_hz`` are those of the peaks,
    empty where they are the tones. ``output`` is the FMU output that is observed (the campaign's,
    where empty). ``phases`` are those of the peaks, None where nobody measured them.
    """

    label: str
    settings: Mapping[str, Scalar]
    tones_hz: tuple[float, ...]
    peaks_v: FloatArray
    sigmas_v: FloatArray
    floor_v: float
    spectrum: Spectrum | None
    lines_hz: tuple[float, ...] = ()
    output: str = ""
    phases: Phases | None = None

    @property
    def read_hz(self) -> tuple[float, ...]:
        """Frequencies of the peaks, Hz."""
        return self.lines_hz or self.tones_hz


@dataclass(frozen=True, kw_only=True)
class SweepData:
    """The FRF sweep, ``settings`` in the FMU's units; what it serves in ``use``, ``scale``."""

    frequency_hz: FloatArray
    amplitude_v: FloatArray
    phase_rad: FloatArray | None
    settings: Mapping[str, Scalar]
    use: str
    scale: str
    source: Path
    background: str = "none"
    unit: str = "V"
    notes: Mapping[str, str] | None = None


@dataclass(frozen=True)
class Setup:
    """How a series of measurements drives the FMU and what it observes, in the FMU's units.

    Args:
        drive: How the FMU is driven.
        output: The variable that is observed.
        start_values: Start values of every run by variable, none of them a fitted one.
        steady_start: Whether the FMU begins on its periodic orbit: then nothing has to settle.
        line_width_hz: Width of the narrowest line, Hz, which tells how long settling takes.
        accuracy: Wanted relative accuracy of simulated amplitudes, above 0 and below 1.
        annotation: What is known of the FMU's accuracy, and of what it may leave out.
        laws: Formulas that variables of the FMU follow.
        source: What complaints name it by.
    """

    drive: Drive
    output: str
    _: KW_ONLY
    start_values: Mapping[str, Scalar] = field(default_factory=dict)
    steady_start: bool = False
    line_width_hz: float | None = None
    accuracy: float = 1e-6
    annotation: AccuracyAnnotation = field(default_factory=AccuracyAnnotation)
    laws: Laws = field(default_factory=Laws)
    source: str = ""


@dataclass(frozen=True)
class Drift:
    """Variables that move over a series: ``ends`` (before, after) and ``units`` by variable."""

    ends: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class BoundCampaign:
    """A campaign that fits one FMU: every name exists there, every number is in its unit.

    ``alternatives`` holds one mapping per combination (one empty mapping without any);
    ``amplitude_unit`` is the detector's; ``noise`` is the declared one; ``notes`` are sentences for
    the report; ``files`` all files read; ``measurements`` those of further kinds, by their tables.
    """

    title: str
    path: Path
    synthetic: bool
    setup: Setup
    experiments: tuple[Experiment, ...]
    sweep: SweepData | None
    parameters: tuple[Parameter, ...]
    derived: tuple[str, ...]
    alternatives: tuple[Mapping[str, Scalar], ...]
    continuation: ContinuationSettings
    amplitude_unit: str
    notes: tuple[str, ...]
    files: tuple[Path, ...]
    drift: Drift = field(default_factory=Drift)
    noise: Noise = field(default_factory=Noise)
    measurements: Mapping[str, BoundMeasurement] = field(default_factory=dict)


def bind(campaign: Campaign, variables: Mapping[str, VariableLike]) -> BoundCampaign:
    """Check a campaign against the variables of its FMU and convert it to their units.

    Bare numbers are in the FMU's unit already. Drifting variables are interpolated linearly over
    the experiments, as the paper does, see `fitting.campaign.drift`; their offsets are parameters
    after those of the file.

    Args:
        campaign: campaign as it was read.
        variables: of the FMU, by name.

    Raises:
        BadInput: unknown variable, one that cannot be set, read or fitted, a unit or kind that does
            not match, a value outside the FMU's range, a variable set in two ways.
    """
    file, top, places = campaign.file, str(campaign.path), places_of_file(campaign.path)
    laws = Laws(file.laws, file.constants, source=f"{places.top}{places.laws}")
    binder = Binder(variables, laws.names)
    output = binder.real(file.observe.output, f"{top}: [observe] output", READABLE, "observed")
    campaign = _in_unit_of_output(campaign, output, binder)
    drive = _bind_drive(campaign, binder)
    drift, noise = bind_drift(campaign, binder), _bind_noise(campaign)
    experiments = _bind_experiments(campaign, binder, drive, drift, output)
    for name in file.derived.outputs:
        # a parameter that the fit sets itself is reported in any case
        kinds = REPORTABLE if name in laws.formulas else READABLE
        binder.real(name, f"{top}: [derived] outputs", kinds, "reported")
    setup = Setup(
        drive=drive,
        output=output.name,
        start_values={name: binder.setting(name, w) for name, w in file.fmu.start.items()},
        steady_start=file.observe.steady_start,
        line_width_hz=file.observe.line_width,
        accuracy=file.accuracy.amplitude,
        annotation=bind_annotation(campaign, binder),
        laws=laws,
        source=top,
    )
    sweep = _bind_sweep(campaign, binder)
    further = {name: m.bind(binder, setup) for name, m in campaign.measurements.items()}
    labels = [*(e.label for e in experiments), *labels_of(further.values())]
    bound = BoundCampaign(
        title=file.title,
        path=campaign.path,
        synthetic=file.synthetic,
        setup=setup,
        experiments=experiments,
        sweep=sweep,
        parameters=(
            *bind_parameters(file.parameters, binder, places, labels),
            *drift.parameters,
            *free_scale(sweep, noise),
            *(p for m in further.values() for p in m.parameters),
        ),
        derived=file.derived.outputs,
        alternatives=bind_alternatives(file.alternatives, binder),
        continuation=file.continuation,
        amplitude_unit=campaign.amplitude_unit,
        notes=tuple(binder.notes),
        files=campaign.files,
        drift=Drift(drift.ends, {name: variables[name].unit or "1" for name in drift.ends}),
        noise=noise,
        measurements=further,
    )
    check_conflicts(bound, places)
    return with_laws(bound, binder, places)


def _in_unit_of_output(campaign: Campaign, output: VariableLike, binder: Binder) -> Campaign:
    """Amplitudes in the output's unit where no scale stands between the two, else as they are."""
    if campaign.is_scaled or not (campaign.experiments or campaign.sweep):
        return campaign
    found, section = campaign.amplitude_unit, "sweep" if campaign.sweep else "experiments"
    try:
        where = f"{campaign.path}: [{section}] amplitude"
        factor = convert(1.0, found, output.unit, where=where)
    except BadInput as error:
        raise BadInput(
            f"{error}; without a scale amplitudes are compared with '{output.name}' as they are"
        ) from error
    if output.unit is None:
        binder.note_missing_unit(output)
    if factor == 1.0:
        return campaign
    unit = output.unit or base_unit(found)
    binder.notes.append(
        f"There is no scale: amplitudes were converted from {found} to {unit}, the unit of "
        f"'{output.name}'."
    )
    return in_other_unit(campaign, factor, unit)


def _bind_noise(campaign: Campaign) -> Noise:
    declared = campaign.file.experiments or campaign.file.sweep
    if declared is None:
        return Noise()
    noise = bind_noise(campaign.file.noise, declared.format.amplitude, campaign.amplitude_unit)
    unknown = [e.label for e in campaign.experiments if not np.all(e.sigmas_v > 0.0)]
    if noise.outliers == "huber" and unknown and not noise.declared:
        raise BadInput(
            f'{campaign.path}: [noise] outliers = "huber" wants the noise of every peak, unknown '
            f"for '{unknown[0]}'; wanted peak_sigmas, or relative or absolute in [noise]"
        )
    return noise


def free_scale(sweep: SweepData | None, noise: Noise) -> list[Parameter]:
    """The parameter of a scale that is fitted with the rest; none for any other scale.

    Args:
        sweep: the measured sweep, None without one.
        noise: declared noise of the amplitudes.
    """
    if sweep is None or sweep.scale != "free":
        return []
    spread = sweep_sigmas(sweep.frequency_hz, sweep.amplitude_v, noise)
    sigma = sweep_scale_sigma(sweep.amplitude_v, spread, "fit")
    return [scale_parameter(sigma, swept=sweep.use == "fit")]


def _bind_drive(campaign: Campaign, binder: Binder) -> Drive:
    choice, where = campaign.file.drive, f"{campaign.path}: [drive]"
    if choice.kind == "input":
        target = binder.real(choice.input or "", f"{where} input", ("input",), "driven")
        units = ["Hz"]
    else:
        drives = ("parameter", "input")
        tones = [binder.real(n, f"{where} frequencies", drives, "set") for n in choice.frequencies]
        targets = [
            binder.real(n, f"{where} amplitudes", drives, "set") for n in choice.amplitudes or ()
        ]
        target, units = targets[0], [tone.unit or "Hz" for tone in tones]
        if len(set(units)) > 1:
            raise BadInput(f"{where} frequencies: the FMU has them in different units: {units}")
    amplitude = binder.number(target, choice.level)
    if amplitude <= 0.0:
        raise BadInput(f"{choice.level.where}: found {amplitude:.6g}, wanted a positive amplitude")
    return Drive(
        frequency_names=choice.frequencies,
        amplitude_names=choice.amplitudes or (),
        input=choice.input,
        amplitude=amplitude,
        samples_per_period=choice.samples_per_period or SAMPLES_PER_PERIOD,
        frequency_unit=units[0],
        highest_order=choice.highest_order,
    )


def _bind_experiments(
    campaign: Campaign,
    binder: Binder,
    drive: Drive,
    drift: Drifting,
    output: VariableLike,
) -> tuple[Experiment, ...]:
    bound = []
    for measured, position in zip(campaign.experiments, drift.positions, strict=True):
        experiment = bind_experiment(measured, binder, drive, output)
        settings = dict(experiment.settings)
        for name, (before, after) in drift.ends.items():
            if name in settings:
                where = measured.settings[name].where
                raise BadInput(f"{where}: '{name}' is set here and by [drift]; wanted one of them")
            settings[name] = before + position * (after - before)
        bound.append(replace(experiment, settings=settings))
    return tuple(bound)


def bind_experiment(
    measured: MeasuredExperiment, binder: Binder, drive: Drive, output: VariableLike
) -> Experiment:
    """One experiment in the names and units of the FMU.

    Args:
        measured: an experiment as it was read.
        binder: of the campaign to its FMU.
        drive: the campaign's drive.
        output: name of the output.

    Raises:
        BadInput: a variable that is not there or cannot be set, another unit of what is observed.
    """
    return Experiment(
        label=measured.label,
        settings=_experiment_settings(measured, binder, drive),
        tones_hz=measured.tones_hz,
        peaks_v=measured.peaks_v,
        sigmas_v=measured.sigmas_v,
        floor_v=measured.floor_v,
        spectrum=measured.spectrum,
        lines_hz=measured.lines_hz,
        output=_observed(measured, binder, output),
        phases=measured.phases,
    )


def _observed(measured: MeasuredExperiment, binder: Binder, output: VariableLike) -> str:
    """The output that an experiment observes; all share a unit, because they share a scale."""
    if measured.output is None:
        return output.name
    name, where = str(measured.output.value), measured.output.where
    other = binder.real(name, where, READABLE, "observed")
    if other.unit != output.unit:
        raise BadInput(
            f"{where}: '{name}' is in {other.unit or 'no unit'}, [observe] output in "
            f"{output.unit or 'no unit'}; wanted one unit, because they share the scale"
        )
    return name


def _experiment_settings(
    measured: MeasuredExperiment, binder: Binder, drive: Drive
) -> dict[str, Scalar]:
    settings = {name: binder.setting(name, w) for name, w in measured.settings.items()}
    if drive.kind == "tones":
        for name, tone in zip(drive.frequency_names, measured.tones_hz, strict=True):
            where = measured.settings[name].where
            # from the rounded hertz, so that the FMU is driven at the very frequency that is read
            settings[name] = convert(tone, "Hz", drive.tone_unit, where=where)
    return settings


def _bind_sweep(campaign: Campaign, binder: Binder) -> SweepData | None:
    choice, measured = campaign.file.sweep, campaign.sweep
    if choice is None or measured is None:
        return None
    return SweepData(
        frequency_hz=measured.frequency_hz,
        amplitude_v=measured.amplitude_v,
        phase_rad=measured.phase_rad,
        settings={name: binder.setting(name, w) for name, w in choice.set.items()},
        use=choice.use,
        scale=choice.scale,
        source=measured.source,
        background=choice.background,
        unit=measured.unit,
        notes=measured.notes,
    )


class AskedParameter(Protocol):
    """A parameter as it was asked for, in a file or in a program."""

    @property
    def name(self) -> str:
        """The FMU's variable."""

    @property
    def unit(self) -> str | None:
        """Unit of its bare numbers, None for the FMU's."""

    @property
    def scope(self) -> str:
        """One value for the "campaign", or one for every "experiment"."""

    @property
    def numbers(self) -> Mapping[str, Written]:
        """What was said of it: lower, upper, start and any of reference, scale, period, prior."""


def bind_parameters(
    asked: Sequence[AskedParameter], binder: Binder, places: Places, labels: Sequence[str]
) -> list[Parameter]:
    """Parameters in the FMU's units; of the scope "experiment" one for each of the labels.

    Args:
        asked: as the file or the program has them.
        binder: of the campaign to its FMU.
        places: what complaints name the parameters by.
        labels: of the experiments.

    Raises:
        BadInput: no such variable, or numbers that it cannot have.
    """
    made = []
    for choice in asked:
        parameter = _bind_parameter(choice, binder, places.of_parameter(choice.name))
        if choice.scope == "campaign":
            made.append(parameter)
            continue
        made += [
            replace(
                parameter, name=f"{choice.name}[{label}]", variable=choice.name, experiment=label
            )
            for label in labels
        ]
    return made


def _bind_parameter(choice: AskedParameter, binder: Binder, where: str) -> Parameter:
    if choice.name in binder.free_names:
        return _bind_coefficient(choice, where)
    variable = binder.real(choice.name, where, ("parameter",), "fitted")
    numbers = {}
    for key, written in _with_units(choice).items():
        if key in ("lower", "upper", "start"):
            numbers[key] = binder.number(variable, written)
        else:  # a difference or a prior: the FMU's range does not bind it
            numbers[key] = in_unit(written, variable.unit)
    made = _parameter(choice, variable.unit or choice.unit or "1", numbers, where)
    return replace(
        made,
        least=-math.inf if variable.min is None else variable.min,
        most=math.inf if variable.max is None else variable.max,
    )


def _bind_coefficient(choice: AskedParameter, where: str) -> Parameter:
    """A parameter that is no variable of the FMU but named by a law."""
    written = _with_units(choice)
    start = written["start"]
    unit = start.unit
    if isinstance(start.value, str):
        unit = choice.unit or parse_quantity(start.value, where=start.where)[1]
    if unit is None:
        raise BadInput(
            f'{where}: a coefficient of laws has no unit, wanted unit = "Hz/V", for example; a '
            'plain number has the unit "1"'
        )
    numbers = {key: in_unit(each, unit) for key, each in written.items()}
    return replace(_parameter(choice, unit, numbers, where), role="coefficient")


def _with_units(choice: AskedParameter) -> dict[str, Written]:
    """What was said of a parameter, bare numbers in the unit of the entry."""
    return {
        key: written
        if isinstance(written.value, str)
        else Written(written.value, written.unit or choice.unit, written.where)
        for key, written in choice.numbers.items()
    }


def _parameter(
    choice: AskedParameter, unit: str, numbers: Mapping[str, float], where: str
) -> Parameter:
    try:
        return Parameter(
            name=choice.name,
            unit=unit,
            lower=numbers["lower"],
            upper=numbers["upper"],
            start=numbers["start"],
            reference=numbers.get("reference", numbers["start"]),
            scale=numbers.get("scale", 0.5 * (numbers["upper"] - numbers["lower"])),
            period=numbers.get("period"),
            prior_sigma=numbers.get("prior"),
        )
    except BadInput as error:
        raise BadInput(f"{where}: {error}") from error


def bind_alternatives(
    asked: Mapping[str, Sequence[Written]], binder: Binder
) -> tuple[Mapping[str, Scalar], ...]:
    """Every combination of the values to try; one empty mapping without any.

    Args:
        asked: values to try, by name.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: a variable that cannot be set, a value that it cannot have, or too many
            combinations.
    """
    count = math.prod(len(values) for values in asked.values())
    if count > MOST_ALTERNATIVES:
        raise BadInput(
            f"[alternatives]: {count} combinations of values, wanted {MOST_ALTERNATIVES} at most: "
            "each is a fit of its own"
        )
    tried = {name: [binder.setting(name, w) for w in values] for name, values in asked.items()}
    return tuple(
        dict(zip(tried, combination, strict=True))
        for combination in itertools.product(*tried.values())
    )


def check_conflicts(bound: BoundCampaign, places: Places) -> None:
    """A fitted or alternated variable must not be set in another way as well.

    A variable of which every experiment has its own value may have a start value: the sweep's.

    Args:
        bound: campaign, bound to its FMU.
        places: what complaints name its parts by.

    Raises:
        BadInput: a parameter named twice, or a variable that is fitted or tried and also set.
    """
    named = [p.name for p in bound.parameters]
    if len(set(named)) < len(named):
        raise BadInput(f"{places.top}{places.parameters} {named} names one twice")
    sweep, gains = bound.sweep, [e.phases for e in bound.experiments if e.phases is not None]
    if sweep is not None and sweep.use == "scale" and any(p.unknown == "gain" for p in gains):
        raise BadInput(
            f'{places.top}the sweep gives a scale alone, which the experiments\' unknown = "gain" '
            'does without; wanted the sweep with use = "fit", or unknown = "phase"'
        )
    own = {p.target for p in bound.parameters if p.experiments and not p.adds_to}
    everywhere = {p.name for p in bound.parameters if not p.experiments and p.moves_model}
    for name in sorted(own & everywhere):
        raise BadInput(
            f"{places.top}{places.parameters} '{name}' is fitted both with scope = \"experiment\" "
            "and for the whole campaign; wanted one of them"
        )
    fitted = [p.target for p in bound.parameters if p.role == "model" and not p.adds_to]
    tried, laws = bound.alternatives[0], bound.setup.laws.formulas
    said = list(_settings_by_place(bound, places))
    roles = dict.fromkeys(laws, "is given by a law")
    roles |= dict.fromkeys(tried, "is an alternative") | dict.fromkeys(fitted, "is fitted")
    for name, role in roles.items():
        also: dict[str, Mapping[str, object]] = {}
        if name in fitted or name in laws:
            also[places.alternatives] = tried
        if name in everywhere or name in laws:
            also[places.start] = bound.setup.start_values
        if name in fitted:
            also[places.laws.rstrip(":")] = laws
        for place, settings in (*said, *also.items()):
            if name in settings:
                raise BadInput(
                    f"{places.top}'{name}' {role} and also set by {place}; wanted one of them"
                )


def _settings_by_place(
    bound: BoundCampaign, places: Places
) -> Iterator[tuple[str, Mapping[str, Scalar]]]:
    """What everything that was measured sets, by its name in complaints."""
    for e in bound.experiments:
        yield f"experiment '{e.label}'", e.settings
    if bound.sweep is not None:
        yield places.sweep, bound.sweep.settings
    for table, measurement in bound.measurements.items():
        name = places.measurement.format(table)
        for label, own in measurement.places:
            yield f"{name} {label}".strip(), own


def with_laws(bound: BoundCampaign, binder: Binder, places: Places) -> BoundCampaign:
    """A campaign whose laws are bound to the FMU: units of all that they name, and finite values.

    Args:
        bound: campaign, bound to its FMU.
        binder: of the campaign to its FMU.
        places: what complaints name its parts by.

    Raises:
        BadInput: a law of a variable that cannot be set, that names what there is not, whose
            dimension is not that of the variable, or that has no value somewhere.
    """
    laws, variables = bound.setup.laws, binder.variables
    if not laws.formulas:
        return bound
    controls = dict(binder.control_units)
    for measurement in bound.measurements.values():
        for name, unit in measurement.control_units.items():
            if name not in variables and controls.setdefault(name, unit) != unit:
                raise BadInput(
                    f"{laws.source} the control quantity '{name}' is in {unit} and in "
                    f"{controls[name]}; wanted one unit"
                )
    targets = {
        name: binder.real(name, f"{laws.source} {name}", SETTABLE, "set").unit or ""
        for name in laws.formulas
    }
    made = laws.with_units(
        targets,
        Known(
            parameters={p.target: p.unit for p in bound.parameters if p.moves_model},
            variables={n: variables[n].unit or "1" for n in laws.names if n in variables},
            controls=controls,
        ),
    )
    setup = replace(bound.setup, laws=made)
    common = {**setup.start_values, **bound.alternatives[0]}
    made.check(
        ((place, {**common, **own}) for place, own in _settings_by_place(bound, places)),
        {p.target: p.start for p in bound.parameters if p.moves_model and not p.adds_to},
    )
    notes = (*bound.notes, *(law.words for law in made.bound))
    return replace(bound, setup=setup, notes=notes)
