"""The draft as the text of campaign.toml: every key with a remark that says where it comes from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import wrap
from typing import Any

from fitting.campaign.instruments import Channel
from fitting.draft.files import Files, SweepFile, TableFile
from fitting.draft.model import Offer
from fitting.draft.source import Source, relative_path
from fitting.draft.values import Box
from fitting.measurements.noise.record import THERMAL, WHITE
from fitting.resonance.form import FANO, SLOPED
from fitting.resonance.reading import Roles
from fitting.signal.peaks import OFFSET, SLOPE
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.notation import hertz
from fitting.text.toml import Tables, put, rewritten, toml_text
from fitting.text.units import same_kind

#: Held steps per period of an input: the drive is scaled so that its fundamental is right.
STEPS_PER_PERIOD = 28
#: Of the input of an instrument that tells dBm, where nobody says another.
LOAD = "50 ohm"
BACKGROUNDS = {FANO: "constant", SLOPED: "slope"}
#: The remark on start values that are taken.
TAKEN_REMARK = "nobody measured these: leave out what you know to be so"
#: The fit of a line by itself: the prior only helps at the start.
CONTINUATION: Mapping[str, Any] = {
    "nu_start": 1e-6,
    "beta": 0.001,
    "iterations": 2,
    "misfit": "squares",
    "starts": 1,
    "seed": 1,
}

#: Letters in a line of the head.
HEAD_WIDTH = 98
#: Before each line of a table that is missing.
MARK = "#: "

Remarks = dict[tuple[str | int, ...], str]


@dataclass(frozen=True, kw_only=True)
class Chosen:
    """What every draft chooses of an FMU.

    Attributes:
        source: the FMU.
        output: observed output.
        boxes: what is fitted.
        start: start values of the FMU, each with its reason.
        taken: those of them that the files do not tell.
        derived: outputs that are reported.
    """

    source: Source
    output: str
    boxes: tuple[Box, ...]
    start: Mapping[str, tuple[Scalar, str]] = field(default_factory=dict)
    taken: tuple[str, ...] = ()
    derived: tuple[str, ...] = ()

    def fmu_table(self, folder: Path | None, remarks: Remarks) -> dict[str, Any]:
        """The table of the FMU and its start values.

        Args:
            folder: to which paths are relative; None: they are absolute.
            remarks: to which its own are added.
        """
        made: dict[str, Any] = dict(self.source.table(folder))
        if self.taken:
            made["taken"] = list(self.taken)
            remarks["fmu", "taken"] = TAKEN_REMARK
        if self.start:
            made["start"] = {name: value for name, (value, _) in self.start.items()}
        for name, (_, why) in self.start.items():
            remarks["fmu", "start", name] = why
        return made

    def fitted_tables(self, remarks: Remarks) -> dict[str, Any]:
        """The tables of what is fitted, how, and what else is reported.

        Args:
            remarks: to which their own are added.
        """
        made: dict[str, Any] = {
            "parameters": [parameter_table(box, k, remarks) for k, box in enumerate(self.boxes)]
        }
        if self.derived:
            made["derived"] = {"outputs": list(self.derived)}
        made["continuation"] = dict(CONTINUATION)
        remarks["continuation", "nu_start"] = "the prior only helps at the start"
        return made


@dataclass(frozen=True, kw_only=True)
class Choices(Chosen):
    """What was chosen for sweeps and experiments.

    Attributes:
        title: of the campaign.
        tones: parameters of frequency and amplitude, one pair for each tone of the data; empty: an
            input is driven.
        driven: the input.
        names: of the tones' columns, where an input is driven.
        amplitude: what amplitudes mean, "V peak".
        held: places and widths of further modes that are held.
        width_hz: full width of the line in the sweep, Hz; 0: unknown.
        residual: what the line leaves of the sweep, relative; 0: unknown.
        level: of the drive, where tones of the FMU drive.
    """

    title: str
    tones: tuple[tuple[str, str], ...]
    driven: str
    names: tuple[str, ...]
    amplitude: str
    held: tuple[str, ...]
    width_hz: float = 0.0
    residual: float = 0.0
    level: float = 1.0


def campaign_text(
    choices: Choices, files: Files, offer: Offer, folder: Path | None, undescribed: str = ""
) -> str:
    """The text of a campaign.

    Args:
        choices: what was chosen.
        files: of the measurements.
        offer: what the FMU offers.
        folder: where the campaign stands, to which paths are relative; None: they are absolute.
        undescribed: what of the measurements the FMU does not describe, for the head.
    """
    remarks: Remarks = {}
    tables: dict[str, Any] = {"title": choices.title}
    tables["fmu"] = choices.fmu_table(folder, remarks)
    if choices.source.is_model:
        remarks["fmu", "model"] = "shipped with fmu-fit and built on demand"
    tables["observe"] = _observe(choices, offer, remarks)
    tables["drive"] = _drive(choices, files, offer, remarks)
    if files.table is not None:
        tables["experiments"] = _experiments(choices, files, folder, remarks)
    _add_sweeps(tables, choices, files, folder, remarks)
    tables |= choices.fitted_tables(remarks)
    if choices.derived:
        remarks["derived", "outputs"] = "outputs of the FMU that are reported, too"
    remarks["continuation", "starts"] = "3: also the lowest minima that a search finds"
    tables["accuracy"] = {"amplitude": accuracy(choices.residual, held=bool(choices.driven))}
    well = ": well below the scatter" if choices.residual > 0.0 else ""
    remarks["accuracy", "amplitude"] = f"of the simulation, relative{well}"
    head = (
        "A first campaign, written by fmu-fit init from these files: it runs as it is."
        if files.sweeps or files.table
        else "A campaign for this FMU, written by fmu-fit init: what is missing stands at its end.",
        "What a remark calls a guess is one; docs/reference/campaign.md tells every key.",
        *wrap(undescribed, HEAD_WIDTH),
    )
    return rewritten(toml_text(tables, head), lambda made: put_remarks(made, remarks))


def missing_text(fmu: str) -> str:
    """What a campaign without measurements lacks, as remarks that become its table.

    Args:
        fmu: the FMU, as the command line takes it.
    """
    return f"""
# MISSING: what was measured. With a file of it, all of this is found by itself:
#     fmu-fit init {fmu} SWEEP.csv --out FOLDER
# By hand: put the file beside this one, and take the marks from the lines below.
{MARK}[sweep]
{MARK}file = "sweep.csv" # a column of frequencies and one of amplitudes
{MARK}layout = "csv"
{MARK}amplitude = "V peak" # what the file means
{MARK}use = "fit"
{MARK}scale = "fit" # of measured over simulated amplitudes: by least squares
{MARK}columns = {{ frequency = "frequency (Hz)", amplitude = "amplitude (V)" }}
"""


def completed(text: str) -> str:
    """The campaign with the marks taken from what is missing.

    Args:
        text: of a campaign and `missing_text`.
    """
    return text.replace(f"\n{MARK}", "\n")


def accuracy(residual: float, *, held: bool) -> float:
    """A hundredth of the scatter, as a power of ten from 1e-6 to 1e-4.

    An input that is held over each step lets nobody promise less than 1e-5: more was asked for in
    vain, and a warning told so.

    Args:
        residual: what is left, relative; 0: unknown.
        held: whether an input is driven.
    """
    least = -5 if held else -6
    if not residual > 0.0:
        return float(f"1e{least}")
    power = math.floor(math.log10(residual / 100.0))
    return float(f"1e{min(max(power, least), -4)}")


def put_remarks(tables: Tables, remarks: Remarks) -> None:
    """Set the remark beside every key that has one.

    Args:
        tables: of the campaign.
        remarks: by the way to the key.
    """
    for path, words in remarks.items():
        table: Any = tables
        for key in path[:-1]:
            table = table[key]
        value = table[path[-1]]
        put(table, str(path[-1]), value.unwrap() if hasattr(value, "unwrap") else value, words)


def _observe(choices: Choices, offer: Offer, remarks: Remarks) -> dict[str, Any]:
    made: dict[str, Any] = {"output": choices.output}
    others = [name for name in offer.outputs if name != choices.output]
    remarks["observe", "output"] = f"or {', '.join(others[:4])}" if others else "the only one"
    if offer.steady and choices.start.get(offer.steady, (False, ""))[0]:
        made["steady_start"] = True
        remarks["observe", "steady_start"] = "nothing to settle"
    elif choices.width_hz > 0.0:
        made["line_width"] = hertz(choices.width_hz, digits=3)
        remarks["observe", "line_width"] = "of the line: sets the time to settle"
    return made


def _drive(choices: Choices, files: Files, offer: Offer, remarks: Remarks) -> dict[str, Any]:
    level = "amplitude of every tone, in the FMU's unit"
    if choices.tones:
        remarks["drive", "frequencies"] = "parameters of the FMU that hold the tones"
        if files.is_noise:
            remarks["drive", "kind"] = "the spectrum is made of the response to a tone"
        unit = offer.unit(choices.tones[0][1])
        remarks["drive", "level"] = f"amplitude of every tone, {unit}"
        if choices.level < 1.0:
            remarks["drive", "level"] += ": small, so that the response is in proportion"
        return {
            "kind": "tones",
            "frequencies": [frequency for frequency, _ in choices.tones],
            "amplitudes": [amplitude for _, amplitude in choices.tones],
            "level": choices.level,
        }
    remarks["drive", "input"] = "the signal is made here and held over each step"
    remarks["drive", "level"] = f"{level}, {offer.unit(choices.driven)}"
    return {
        "kind": "input",
        "frequencies": list(choices.names),
        "input": choices.driven,
        "level": 1.0,
        "samples_per_period": STEPS_PER_PERIOD,
    }


def _experiments(
    choices: Choices, files: Files, folder: Path | None, remarks: Remarks
) -> dict[str, Any]:
    table: TableFile = files.table  # type: ignore[assignment]
    made: dict[str, Any] = {"file": relative_path(table.path, folder)}
    if files.pattern:
        made["spectra"] = relative_path(Path(files.pattern), folder)
        remarks["experiments", "spectra"] = "a spectrum for each row"
        made |= columns_of(files.spectra[0].roles, remarks, ("experiments",))
    else:
        made["peaks"] = [column.name for column in table.peaks]
        if table.sigmas:
            made["peak_sigmas"] = [column.name for column in table.sigmas]
        if table.phases:
            made["phases"] = [column.name for column in table.phases]
    made["amplitude"] = choices.amplitude
    remarks["experiments", "amplitude"] = "what the files mean: peak or rms"
    return made


def _add_sweeps(
    tables: dict[str, Any],
    choices: Choices,
    files: Files,
    folder: Path | None,
    remarks: Remarks,
) -> None:
    """The sweeps: complex ones each a table of its own, of amplitudes one."""
    phased = [sweep for sweep in files.sweeps if sweep.is_complex and files.table is None]
    if phased:
        tables["complex_sweep"] = [
            _complex(sweep, k, len(phased), folder, remarks) for k, sweep in enumerate(phased)
        ]
    noise = [sweep for sweep in files.sweeps if sweep.is_noise and files.table is None]
    if noise:
        tables["noise_spectrum"] = [
            _noise(sweep, k, len(noise), folder, remarks) for k, sweep in enumerate(noise)
        ]
    plain = [sweep for sweep in files.sweeps if sweep not in phased and sweep not in noise]
    for sweep in plain[:1]:
        fitted = files.table is None
        tables["sweep"] = {
            "file": relative_path(sweep.path, folder),
            "layout": sweep.roles.recognised.layout,
            **columns_of(sweep.roles, remarks, ("sweep",)),
            "amplitude": choices.amplitude,
            "use": "fit",
            "scale": "fit",
        }
        if choices.amplitude == "dBm":
            tables["sweep"]["impedance"] = LOAD
            remarks["sweep", "impedance"] = "a guess: of the input; plays no part in a fitted scale"
        remarks["sweep", "amplitude"] = (
            "peak or rms plays no part here: the scale is fitted"
            if fitted
            else "what the file means: peak or rms"
        )
        beside = "" if sweep.driven_line is None else sweep.driven_line.forms[0].name
        if beside == FANO:
            tables["sweep"]["background"] = "complex"
            remarks["sweep", "background"] = "of the line by itself, found by comparing"
        if beside == OFFSET and fitted:
            tables["sweep"]["background"] = OFFSET
            remarks["sweep", "background"] = "a constant beside the line: solved inside"
        if beside == SLOPED and fitted:
            tables["sweep"]["background"] = SLOPE
            remarks["sweep", "background"] = "with a slope, beside the line: solved inside"
        remarks["sweep", "use"] = "every point is fitted, too"
        remarks["sweep", "scale"] = "of measured over simulated amplitudes: by least squares"


def _complex(
    sweep: SweepFile, k: int, count: int, folder: Path | None, remarks: Remarks
) -> dict[str, Any]:
    at = ("complex_sweep", k)
    made: dict[str, Any] = {
        "file": relative_path(sweep.path, folder),
        "layout": sweep.roles.recognised.layout,
        **columns_of(sweep.roles, remarks, at),
    }
    if count > 1:
        made["label"] = sweep.path.stem
    if sweep.two is not None:
        made["background"] = "constant"
        remarks[(*at, "background")] = "complex, beside the lines: solved inside"
    if sweep.phases_reversed:
        made["conjugate"] = True
        remarks[(*at, "conjugate")] = "the phase rises over the resonance"
    if sweep.driven_line is None:
        return made
    background = BACKGROUNDS.get(sweep.driven_line.forms[0].name)
    if background:
        made["background"] = background
        remarks[(*at, "background")] = "complex, beside the line: found by comparing"
    if sweep.driven_line.forms[0].delayed:
        made["delay"] = "fit"
        remarks[(*at, "delay")] = "of the cable: found by comparing"
    return made


def _noise(
    sweep: SweepFile, k: int, count: int, folder: Path | None, remarks: Remarks
) -> dict[str, Any]:
    """A spectrum of what nobody drove: level and floor are solved for."""
    at, roles, look = ("noise_spectrum", k), sweep.roles, sweep.noise
    of_whole_file(roles, "noise_spectrum")
    own = sweep.has_own_forces
    made: dict[str, Any] = {"file": relative_path(sweep.path, folder)}
    remarks[(*at, "file")] = "averages = N tells how many periodograms were averaged"
    made["force"] = THERMAL if own else WHITE
    remarks[(*at, "force")] = (
        "heat moves each mode; temperature and mass tell the read-out"
        if own
        else '"thermal", with temperature and mass, tells the read-out'
    )
    if look is not None and look.holds:
        made["holds"] = look.holds
        remarks[(*at, "holds")] = "the unit does not tell it"
    if count > 1:
        made["label"] = sweep.path.stem
    density = "" if roles.sizes is None else in_file(roles.sizes)
    made["columns"] = {"frequency": in_file(roles.frequency), "density": density}
    remarks[(*at, "columns")] = "as they were recognised"
    return made


def columns_of(roles: Roles, remarks: Remarks, at: tuple[str | int, ...]) -> dict[str, Any]:
    """Names of the columns, with units where the file tells none, and which part of it is meant.

    Args:
        roles: of a file.
        remarks: to which its own is added.
        at: the way to the table.
    """
    parts = roles.real is not None
    named = {"frequency": roles.frequency}
    if parts:
        named |= {"x": roles.real, "y": roles.imaginary}  # type: ignore[dict-item]
    else:
        named |= {"amplitude": roles.sizes}  # type: ignore[dict-item]
        if roles.phase is not None:
            named |= {"phase": roles.phase}
    remarks[(*at, "columns")] = "as they were recognised"
    columns = {key: _told(channel, roles) for key, channel in named.items()}
    return {**roles.part, "columns": columns}


def of_whole_file(roles: Roles, table: str) -> None:
    """Complain of a part of a file that a campaign's table has no key for.

    Args:
        roles: of the file.
        table: of the campaign, as "noise_spectrum".

    Raises:
        BadInput: a trace, a chunk or a row of names is told.
    """
    for key in roles.part:
        raise BadInput(
            f"--{key.replace('_', '-')}: [[{table}]] of a campaign cannot tell it; wanted what is "
            f"meant of {roles.recording.path} in a file of its own"
        )


def _told(channel: Any, roles: Any) -> str:
    """A column's name, with its unit where only the user knows it, and 1 where it has none."""
    own, name = roles.recording.column(channel.name).unit, in_file(channel)
    if own is not None and own == channel.unit:
        return name
    return f"{name} ({channel.unit or 1})"


def in_file(channel: Channel) -> str:
    """The name by which a file that holds several sweeps has a column.

    Args:
        channel: of the file.
    """
    return channel.whole or channel.name


def parameter_table(box: Box, k: int, remarks: Remarks) -> dict[str, Any]:
    """Table of a parameter.

    Args:
        box: its bounds and start.
        k: how many stand before it.
        remarks: to which its own are added.
    """
    remarks["parameters", k, "start"] = box.why
    made: dict[str, Any] = {"name": box.name}
    if box.unit != "1":
        made["unit"] = box.unit
    return made | {
        "lower": box.lower,
        "upper": box.upper,
        "start": box.start,
        "scale": box.scale,
    }


def meaning(sweep_units: Sequence[str], kind: str) -> str:
    """What amplitudes mean, as a campaign declares it: "V peak", "m rms", "dBm" or "dB".

    Args:
        sweep_units: units of the amplitudes, the first one counts.
        kind: "peak" or "rms".
    """
    unit = next((u for u in sweep_units if u), "1" if sweep_units else "V")
    if unit in ("dBm", "dB"):
        return unit
    for base in ("V", "m", "A", "rad", "m/s", "Pa", "K"):
        if same_kind(unit, base):
            return f"{base} {kind}"
    return f"{unit} {kind}"
