"""The campaign that a draft becomes: tables whose values carry remarks, checked, then written.

A value with a remark is `noted`; a `Path` is written as seen from the campaign. Every draft is made
of such tables once, and `draft_from` reads and binds them as `reconstruct` will do it, with
absolute paths, before it writes them with relative ones.
"""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap
from typing import Any

from fitting.draft.boxes import Box
from fitting.draft.model import Offer
from fitting.extension.records import Channel, bind, read_campaign
from fitting.resonance.reading import Roles
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.files import path_from
from fitting.text.rendering import blocks
from fitting.text.results_folder import write_whole
from fitting.text.scratch import Scratch
from fitting.text.toml import Tables, put, rewritten, toml_text
from fitting.text.units import same_kind

#: A sweep, to see whether a campaign that has none yet can be read.
EXAMPLE = "frequency (Hz),amplitude (V)\n" + "".join(f"{f},{1.0 + f % 3}\n" for f in range(1, 9))
HEAD = (
    "A first campaign, written by fmu-fit init from these files: it runs as it is.",
    "What a remark calls a guess is one; fmu-fit help campaign lists every key.",
)
#: Letters in a line of the head.
HEAD_WIDTH = 98
#: Of the input of an instrument with levels in dBm, unless another is given.
LOAD = "50 ohm"
#: Before each line of a table that is missing.
MARK = "#: "
#: The remark on start values that are taken.
TAKEN = "not measured: leave out what you know to be so"
#: Start values of an FMU by name, each with its reason.
Starts = Mapping[str, tuple[Scalar, str]]


@dataclass(frozen=True)
class Draft:
    """A campaign as text, and what was found, taken and guessed, in sentences.

    ``undescribed`` is what of the measurements its FMU cannot describe, and why; empty: nothing
    that was observed.
    """

    text: str
    notes: tuple[str, ...]
    undescribed: str = ""


@dataclass(frozen=True)
class Noted:
    """A value of a campaign, and the remark behind it."""

    value: Any
    remark: str


def noted(value: Any, remark: str) -> Any:
    """A value with a remark, which `draft_from` writes behind it.

    Args:
        value: of a key.
        remark: where it comes from.
    """
    return Noted(value, remark)


#: The fit of a line by itself.
CONTINUATION: Mapping[str, Any] = {
    "nu_start": noted(1e-6, "the prior only helps at the start"),
    "beta": 0.001,
    "iterations": 2,
    "misfit": "squares",
    "starts": 1,
    "seed": 1,
}


def draft_from(
    tables: Mapping[str, Any],
    offer: Offer,
    folder: Path,
    stated: Sequence[str],
    frame: tuple[Sequence[str], str] = (HEAD, ""),
    undescribed: str = "",
) -> Draft:
    """The draft of some tables, after it was read and bound as `reconstruct` will do it.

    Where a measurement is missing, with one that is made up for this alone.

    Args:
        tables: of the campaign.
        offer: the FMU.
        folder: of the campaign.
        stated: sentences on what was found, taken and guessed.
        frame: remarks at the top, and at the end what becomes a table without its marks.
        undescribed: see `Draft`.

    Raises:
        BadInput: the tables do not suit the FMU or its files.
    """
    head, missing = frame
    text = _text(tables, None, head) + missing
    tomllib.loads(text)
    with Scratch() as scratch:
        path = scratch / "campaign.toml"
        write_whole(path, text.replace(f"\n{MARK}", "\n"))
        write_whole(scratch / "sweep.csv", EXAMPLE)
        try:
            bind(read_campaign(path), offer.description.variables)
        except BadInput as error:
            errors = (
                str(t).replace(f"{path}: ", "").replace(str(path), "draft") for t in error.args
            )
            raise BadInput(*(f"the draft does not suit: {each}" for each in errors)) from error
    head = (*head, *wrap(undescribed, HEAD_WIDTH))
    return Draft(_text(tables, folder, head) + missing, tuple(stated), undescribed)


def _text(tables: Mapping[str, Any], folder: Path | None, head: Sequence[str]) -> str:
    """Tables as TOML with remarks; paths relative to a folder, or absolute without one."""
    remarks: dict[tuple[str | int, ...], str] = {}

    def plain(value: Any, at: tuple[str | int, ...]) -> Any:
        if isinstance(value, Noted):
            remarks[at] = value.remark
            return plain(value.value, at)
        if isinstance(value, Path):
            return relative_path(value, folder)
        if isinstance(value, Mapping):
            return {key: plain(each, (*at, key)) for key, each in value.items()}
        if isinstance(value, list | tuple):
            return [plain(each, (*at, k)) for k, each in enumerate(value)]
        return value

    def put_remarks(made: Tables) -> None:
        for path, words in remarks.items():
            table: Any = made
            for key in path[:-1]:
                table = table[key]
            value = table[path[-1]]
            put(table, str(path[-1]), value.unwrap() if hasattr(value, "unwrap") else value, words)

    return rewritten(toml_text(plain(tables, ()), head), put_remarks)


def relative_path(path: Path, folder: Path | None) -> str:
    """A path as seen from the campaign, with slashes on every system.

    Args:
        path: of a file.
        folder: of the campaign; None: the path is absolute.
    """
    return Path(os.path.abspath(path)).as_posix() if folder is None else path_from(folder, path)


def fmu_table(
    offer: Offer, start: Starts, taken: Sequence[str] = (), remark: str = TAKEN
) -> dict[str, Any]:
    """The table of the FMU and its start values.

    Args:
        offer: the FMU.
        start: values with their reasons.
        taken: those of them that the files do not determine.
        remark: on these.
    """
    made: dict[str, Any] = {"model": offer.name} if offer.is_model else {"file": Path(offer.name)}
    if offer.interface is not None and not offer.is_model:
        made["interface"] = offer.interface
    if taken:
        made["taken"] = noted(list(taken), remark)
    if start:
        made["start"] = {name: noted(value, why) for name, (value, why) in start.items()}
    return made


def fitted_tables(
    boxes: Sequence[Box], derived: Any = (), *, searched: bool = False
) -> dict[str, Any]:
    """The tables of what is fitted, how, and what else is reported.

    Args:
        boxes: of the parameters.
        derived: outputs that are reported.
        searched: whether the remark on other minima is wanted.
    """
    parameters = []
    for box in boxes:
        unit = {} if box.unit == "1" else {"unit": box.unit}
        ends = {"lower": box.lower, "upper": box.upper}
        start = {"start": noted(box.start, box.why), "scale": box.scale}
        parameters.append({"name": box.name, **unit, **ends, **start})
    made: dict[str, Any] = {"parameters": parameters}
    if derived:
        made["derived"] = {"outputs": derived}
    made["continuation"] = dict(CONTINUATION)
    if searched:
        minima = "3: also the lowest minima that a search finds"
        made["continuation"]["starts"] = noted(CONTINUATION["starts"], minima)
    return made


def starts_words(boxes: Sequence[Box]) -> list[str]:
    """Where every parameter starts, and why, in sentences.

    Args:
        boxes: of the parameters.
    """
    return [str(blocks("draft/text").start(box)) for box in boxes]


def accuracy_table(residual: float, remark: str, *, kept: bool) -> dict[str, Any]:
    """The accuracy of the simulation: a hundredth of the scatter, as a power of ten.

    From 1e-6 to 1e-4; with an input that is held over each step from 1e-5: no more can be promised.

    Args:
        residual: relative scatter of the data; 0: unknown.
        remark: on it.
        kept: whether an input is driven.
    """
    power = least = -5 if kept else -6
    if residual > 0.0:
        power = min(max(math.floor(math.log10(residual / 100.0)), least), -4)
    return {"amplitude": noted(float(f"1e{power}"), remark)}


def columns_of(roles: Roles) -> dict[str, Any]:
    """Names of the columns, with units where the file has none, and which part of it is meant.

    Args:
        roles: of a file.
    """
    named = {"frequency": roles.frequency}
    if roles.real is not None:
        named |= {"x": roles.real, "y": roles.imaginary}  # type: ignore[dict-item]
    else:
        named |= {"amplitude": roles.sizes}  # type: ignore[dict-item]
        if roles.phase is not None:
            named |= {"phase": roles.phase}
    columns = {}
    for key, channel in named.items():
        own = roles.recording.column(channel.name).unit
        known = own is not None and own == channel.unit
        columns[key] = in_file(channel) + ("" if known else f" ({channel.unit or 1})")
    return {**roles.part, "columns": noted(columns, "as they were recognised")}


def of_whole_file(roles: Roles, table: str) -> None:
    """Refuse a part of a file that a campaign's table has no key for.

    Args:
        roles: of the file.
        table: of the campaign, as "noise_spectrum".

    Raises:
        BadInput: a trace, a chunk or a row of names is requested.
    """
    for key in roles.part:
        raise BadInput(
            f"--{key.replace('_', '-')}: [[{table}]] of a campaign has no key for it; wanted what "
            f"is meant of {roles.recording.path} in a file of its own"
        )


def meaning(units: Sequence[str], kind: str) -> str:
    """What amplitudes mean, as a campaign declares it: "V peak", "m rms", "dBm" or "dB".

    Args:
        units: of the amplitudes, the first one counts.
        kind: "peak" or "rms".
    """
    unit = next((u for u in units if u), "1" if units else "V")
    if unit in ("dBm", "dB"):
        return unit
    bases = ("V", "m", "A", "rad", "m/s", "Pa", "K")
    return f"{next((base for base in bases if same_kind(unit, base)), unit)} {kind}"


def phase_keys(*, rotated: bool, delayed: bool) -> dict[str, Any]:
    """What a campaign has on phases.

    Args:
        rotated: whether an instrument counts them the other way.
        delayed: whether a cable turns them.
    """
    made = {}
    if rotated:
        made["conjugate"] = noted(True, "the phase rises over the resonance")
    if delayed:
        made["delay"] = noted("fit", "of the cable: found by comparing")
    return made


def in_file(channel: Channel) -> str:
    """The name by which a file that holds several sweeps has a column.

    Args:
        channel: of the file.
    """
    return channel.whole or channel.name
