"""The campaign file: TOML -> what it says, checked key by key, no data file opened yet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fitting.campaign.accuracy import AccuracyChoice, read_accuracy
from fitting.campaign.drift_table import DriftChoice, drift_choice
from fitting.campaign.instruments import LAYOUTS, Selection
from fitting.campaign.noise_table import NoiseChoice, noise_choice
from fitting.campaign.section import Section, Written, as_written
from fitting.signal.amplitudes import Amplitude, declared_amplitude
from fitting.signal.combinations import Combination, lines_to_read
from fitting.signal.peaks import BACKGROUNDS, FLOOR_KINDS
from fitting.signal.scale import SCALES
from fitting.text.errors import BadInput
from fitting.text.toml import read_toml

TOP_KEYS = (
    "title",
    "synthetic",
    "fmu",
    "observe",
    "drive",
    "experiments",
    "drift",
    "noise",
    "sweep",
    "parameters",
    "derived",
    "alternatives",
    "continuation",
    "accuracy",
    "design",
)
TRACE_KEYS = ("layout", "amplitude", "impedance", "columns", "trace", "chunk")
MISFITS = ("slack", "absolute", "squares")


@dataclass(frozen=True)
class FmuChoice:
    """Which FMU: ``model`` of this project, built on demand, or ``file``; its start values."""

    model: str | None
    file: Path | None
    timeout_s: float
    start: Mapping[str, Written]


@dataclass(frozen=True)
class Observation:
    """The observed FMU output, and what is known about its settling."""

    output: str
    line_width_hz: float | None
    steady_start: bool


@dataclass(frozen=True)
class DriveChoice:
    """How the FMU is driven; ``level`` of an active tone as written, ``input`` for kind input.

    ``read`` are the lines whose peaks are compared, ``order`` the highest order of combinations of
    the tones that the response may hold beside them.
    """

    kind: str
    frequencies: tuple[str, ...]
    amplitudes: tuple[str, ...]
    input: str | None
    level: Written
    samples_per_period: int
    read: tuple[Combination, ...]
    order: int


@dataclass(frozen=True)
class TraceFormat:
    """How a trace file is read: layout, amplitude declaration, selection within the file."""

    layout: str
    amplitude: Amplitude
    selection: Selection


@dataclass(frozen=True)
class ExperimentsChoice:
    """The experiments file, with a pattern of ``spectra`` or columns of ready ``peaks``."""

    file: Path
    spectra: str | None
    format: TraceFormat
    peaks: tuple[str, ...]
    peak_sigmas: tuple[str, ...]
    noise_floor: str


@dataclass(frozen=True)
class SweepChoice:
    """The FRF sweep: its file, the FMU variables during it, what it serves."""

    file: Path
    format: TraceFormat
    settings: Mapping[str, Written]
    use: str
    scale: str
    background: str


@dataclass(frozen=True)
class ParameterChoice:
    """A fitted FMU parameter as written; ``unit`` belongs to every bare number of the entry.

    ``scope`` "experiment": every experiment has a value of its own.
    """

    name: str
    unit: str | None
    numbers: Mapping[str, Written]
    where: str
    scope: str = "campaign"


@dataclass(frozen=True)
class ContinuationSettings:
    """Algorithm 2: nu_start, factor beta, number of nu, tolerance, misfit form, starts, seed."""

    nu_start: float = 0.1
    beta: float = 0.1
    iterations: int = 9
    tolerance: float = 2.22e-16
    misfit: str = "slack"
    starts: int = 3
    seed: int = 1


@dataclass(frozen=True)
class CampaignFile:
    """Everything the TOML says; data files are named here, not read."""

    path: Path
    title: str
    synthetic: bool
    fmu: FmuChoice
    observe: Observation
    drive: DriveChoice
    experiments: ExperimentsChoice | None
    drift: DriftChoice
    noise: NoiseChoice
    sweep: SweepChoice | None
    parameters: tuple[ParameterChoice, ...]
    derived: tuple[str, ...]
    alternatives: Mapping[str, tuple[Written, ...]]
    continuation: ContinuationSettings
    accuracy: AccuracyChoice


def read_campaign_file(path: Path) -> CampaignFile:
    """Read and check the TOML of a campaign.

    Raises:
        BadInput: no such file, not TOML, a key missing, unknown or of the wrong kind.
    """
    top = Section(path, "", read_toml(path), TOP_KEYS)
    drive = _drive(top)
    campaign = CampaignFile(
        path=path,
        title=top.text("title"),
        synthetic=top.boolean("synthetic", False),
        fmu=_fmu(top),
        observe=_observe(top),
        drive=drive,
        experiments=_experiments(top, len(drive.read)) if "experiments" in top else None,
        drift=drift_choice(top),
        noise=noise_choice(top),
        sweep=_sweep(top) if "sweep" in top else None,
        parameters=_parameters(top),
        derived=top.sub("derived", ("outputs",)).texts("outputs", ()),
        alternatives=_alternatives(top),
        continuation=_continuation(top),
        accuracy=read_accuracy(top),
    )
    _check_whole(campaign, top)
    return campaign


def _check_whole(campaign: CampaignFile, top: Section) -> None:
    fits_sweep = campaign.sweep is not None and campaign.sweep.use == "fit"
    if campaign.experiments is None and not fits_sweep:
        raise BadInput(
            f"{top.path}: nothing to fit: wanted a table [experiments], "
            'or a [sweep] with use = "fit"'
        )
    observe = campaign.observe
    if not observe.steady_start and observe.line_width_hz is None and campaign.sweep is None:
        raise BadInput(
            f"{top.where('observe')}: wanted line_width (a rough one sets the settling time), or "
            "steady_start = true if the FMU starts on its periodic orbit, or a [sweep]"
        )
    if campaign.drift.ends and campaign.experiments is None:
        raise BadInput(f"{top.where('drift')}: drifts over experiments, but there are none")


def _fmu(top: Section) -> FmuChoice:
    section = Section(top.path, "fmu", top.required("fmu"), ("model", "file", "timeout_s", "start"))
    if ("model" in section) == ("file" in section):
        raise BadInput(f"{section.where()}: wanted either 'model' or 'file'")
    start = section.sub("start")
    return FmuChoice(
        model=section.text("model") if "model" in section else None,
        file=top.path.parent / section.text("file") if "file" in section else None,
        timeout_s=section.number("timeout_s", 60.0, positive=True),
        start={name: start.written(name) for name in start.data},
    )


def _observe(top: Section) -> Observation:
    allowed = ("output", "line_width", "steady_start")
    section = Section(top.path, "observe", top.required("observe"), allowed)
    width = "line_width" in section
    return Observation(
        output=section.text("output"),
        line_width_hz=section.quantity("line_width", "Hz", positive=True) if width else None,
        steady_start=section.boolean("steady_start", False),
    )


def _drive(top: Section) -> DriveChoice:
    allowed = (
        "kind",
        "frequencies",
        "amplitudes",
        "input",
        "level",
        "samples_per_period",
        "read",
        "order",
    )
    section = Section(top.path, "drive", top.required("drive"), allowed)
    kind = section.choice("kind", ("tones", "input"))
    frequencies = section.texts("frequencies")
    amplitudes = section.texts("amplitudes") if kind == "tones" else ()
    for key in ("input", "samples_per_period") if kind == "tones" else ("amplitudes",):
        if key in section:
            raise BadInput(f'{section.where(key)}: has no meaning with kind = "{kind}"')
    if not frequencies:
        raise BadInput(f"{section.where('frequencies')}: is empty, wanted at least one name")
    if kind == "tones" and len(amplitudes) != len(frequencies):
        raise BadInput(
            f"{section.where('amplitudes')}: {len(amplitudes)} names, "
            f"wanted {len(frequencies)}, one per frequency"
        )
    read, order = lines_to_read(
        section.texts("read", frequencies),
        section.integer("order", 0, least=1) if "order" in section else None,
        frequencies,
        section.where("read"),
    )
    return DriveChoice(
        kind=kind,
        frequencies=frequencies,
        amplitudes=amplitudes,
        input=section.text("input") if kind == "input" else None,
        level=section.written("level")
        if "level" in section
        else as_written(1.0, section.where("level")),
        samples_per_period=section.integer("samples_per_period", 200, least=4),
        read=read,
        order=order,
    )


def _trace_format(section: Section, *, ready: bool = False) -> TraceFormat:
    columns = section.sub("columns", ("frequency", "amplitude", "phase"))
    chunk = section.integer("chunk", 0) if "chunk" in section else None
    selection = Selection(
        columns.text("frequency", ""),
        columns.text("amplitude", ""),
        columns.text("phase", ""),
        section.integer("trace", 1, least=1),
        chunk,
    )
    impedance = (
        section.quantity("impedance", "ohm", positive=True) if "impedance" in section else None
    )
    if "amplitude" not in section:
        raise BadInput(
            f'{section.where()}: key \'amplitude\' is missing: wanted "V peak", "V rms" or '
            '"dBm"; files do not tell which they mean'
        )
    amplitude = declared_amplitude(section.text("amplitude"), impedance, section.where("amplitude"))
    layout = "csv" if ready else section.choice("layout", tuple(LAYOUTS), "csv")
    for key, only in (("trace", "rohde-schwarz"), ("chunk", "zurich")):
        if key in section and layout != only:
            found = "ready peaks" if ready else f'layout = "{layout}"'
            raise BadInput(
                f'{section.where(key)}: has no meaning with {found}, only with layout = "{only}"'
            )
    return TraceFormat(layout, amplitude, selection)


def _experiments(top: Section, lines: int) -> ExperimentsChoice:
    allowed = ("file", "spectra", "peaks", "peak_sigmas", "noise_floor", *TRACE_KEYS)
    section = Section(top.path, "experiments", top.required("experiments"), allowed)
    if ("spectra" in section) == ("peaks" in section):
        raise BadInput(f"{section.where()}: wanted either 'spectra' or 'peaks'")
    spectra = section.text("spectra") if "spectra" in section else None
    if spectra is not None and "{experiment}" not in spectra:
        raise BadInput(
            f"{section.where('spectra')}: '{spectra}' wanted with '{{experiment}}' in it"
        )
    peaks, sigmas = section.texts("peaks", ()), section.texts("peak_sigmas", ())
    for key, columns in (("peaks", peaks), ("peak_sigmas", sigmas)):
        if key in section and len(columns) != lines:
            raise BadInput(
                f"{section.where(key)}: {len(columns)} columns, wanted {lines}, one per tone"
            )
    if sigmas and not peaks:
        raise BadInput(f"{section.where('peak_sigmas')}: wanted only beside 'peaks'")
    form = _trace_format(section, ready=spectra is None)
    if sigmas and form.amplitude.kind == "dBm":
        raise BadInput(
            f"{section.where('peak_sigmas')}: a standard deviation in dBm is a ratio, not an "
            'amplitude; wanted peaks and sigmas in "V peak" or "V rms"'
        )
    return ExperimentsChoice(
        file=top.path.parent / section.text("file"),
        spectra=spectra,
        format=form,
        peaks=peaks,
        peak_sigmas=sigmas,
        noise_floor=section.choice("noise_floor", FLOOR_KINDS, "robust"),
    )


def _sweep(top: Section) -> SweepChoice:
    allowed = ("file", "set", "use", "scale", "background", *TRACE_KEYS)
    section = Section(top.path, "sweep", top.required("sweep"), allowed)
    settings = section.sub("set")
    return SweepChoice(
        file=top.path.parent / section.text("file"),
        format=_trace_format(section),
        settings={name: settings.written(name) for name in settings.data},
        use=section.choice("use", ("scale", "fit"), "scale"),
        scale=section.choice("scale", SCALES, "maximum"),
        background=section.choice("background", BACKGROUNDS, "none"),
    )


def _parameters(top: Section) -> tuple[ParameterChoice, ...]:
    entries = top.required("parameters")
    if not isinstance(entries, list) or not entries:
        raise BadInput(f"{top.where('parameters')}: wanted one [[parameters]] table or more")
    return tuple(_parameter(top, i, entry) for i, entry in enumerate(entries, start=1))


def _parameter(top: Section, index: int, entry: Any) -> ParameterChoice:
    needed = ("lower", "upper", "start")
    further = ("reference", "scale", "period", "prior")
    allowed = ("name", "unit", "scope", *needed, *further)
    name = entry.get("name", index) if isinstance(entry, Mapping) else index
    section = Section(top.path, f"parameters '{name}'", entry, allowed)
    keys = [*needed, *(k for k in further if k in section)]
    return ParameterChoice(
        name=section.text("name"),
        unit=section.text("unit") if "unit" in section else None,
        numbers={key: section.written(key) for key in keys},
        where=section.where(),
        scope=section.choice("scope", ("campaign", "experiment"), "campaign"),
    )


def _alternatives(top: Section) -> dict[str, tuple[Written, ...]]:
    section = top.sub("alternatives")
    alternatives = {}
    for name, values in section.data.items():
        where = section.where(name)
        if not isinstance(values, list) or not values:
            raise BadInput(f"{where}: found {values!r}, wanted a list of values to try")
        alternatives[name] = tuple(as_written(v, where) for v in values)
    return alternatives


def _continuation(top: Section) -> ContinuationSettings:
    usual = ContinuationSettings()
    allowed = tuple(vars(usual))
    section = top.sub("continuation", allowed)
    beta = section.number("beta", usual.beta, positive=True)
    nu_start = section.number("nu_start", usual.nu_start)
    if nu_start < 0.0:
        raise BadInput(f"{section.where('nu_start')}: found {nu_start}, wanted zero or more")
    if beta >= 1.0:
        raise BadInput(f"{section.where('beta')}: found {beta}, wanted a factor below 1")
    return ContinuationSettings(
        nu_start=nu_start,
        beta=beta,
        iterations=section.integer("iterations", usual.iterations, least=1),
        tolerance=section.number("tolerance", usual.tolerance, positive=True),
        misfit=section.choice("misfit", MISFITS, usual.misfit),
        starts=section.integer("starts", usual.starts, least=1),
        seed=section.integer("seed", usual.seed),
    )
