"""The campaign that a draft becomes, and the questions on what no file holds.

A value with a remark is `noted`; a `Path` is written as seen from the campaign. Every draft is made
of tables of such values once, and `draft_from` reads and binds them as `reconstruct` will do it,
with absolute paths, before it writes them with relative ones. Each question has a default, and is
answered by a flag or a person.
"""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from textwrap import wrap
from typing import Any

from fitting import Problem
from fitting.draft.model import Box, Offer, Starts
from fitting.extension.fmu import OutOfTime
from fitting.extension.records import Channel, bind, read_campaign
from fitting.resonance.reading import Roles
from fitting.text.errors import BadInput, FmuFailure, did_you_mean
from fitting.text.files import path_from
from fitting.text.notation import listed
from fitting.text.rendering import blocks
from fitting.text.results_folder import write_whole
from fitting.text.scratch import Scratch
from fitting.text.tables import csv_text
from fitting.text.toml import Tables, put, rewritten, toml_text
from fitting.text.units import convert, parse_quantity, same_kind

#: A sweep, to see whether a campaign that has none yet can be read.
EXAMPLE = "frequency (Hz),amplitude (V)\n" + "".join(f"{f},{1.0 + f % 3}\n" for f in range(1, 9))
HEAD = (
    "A first campaign, written by fmu-fit init from these files: it runs as it is.",
    "What a remark calls a guess is one; fmu-fit help campaign lists every key.",
)
#: Name of the table that a drafted map of several files reads: the control, and each file.
LIST = "spectra.csv"
#: Processor time of runs in which a draft is planned and run once, s.
MOST_S = 10.0
#: Letters in a line of the head.
HEAD_WIDTH = 98
#: Of the input of an instrument with levels in dBm, unless another is given.
LOAD = "50 ohm"
#: Before each line of a table that is missing.
MARK = "#: "
#: Options that are listed in a question, at most, and how often a person is asked a question.
MOST_SHOWN, MOST_TRIES = 12, 3
#: Questions by their keys; of others the words are those of the file.
WORDS = {
    "output": "Which output of the FMU was measured?",
    "tone": "Which parameter of the FMU holds the frequency of the drive?",
    "input": "Which input of the FMU is driven?",
    "fit": "Which parameters of the FMU are fitted?",
    "amplitudes": "Are the amplitudes in the files peak values or rms?",
}
#: Questions with more than one answer.
SEVERAL = ("fit", "tone")


@dataclass(frozen=True)
class Draft:
    """A campaign as text, and what was found, taken and guessed, in sentences.

    ``undescribed`` is what of the measurements its FMU cannot describe, and why; empty: nothing
    that was observed. ``listing`` is the text of the table of files that it reads, of a map.
    ``failure`` is why it does not run at its start values; None: it was run there, or lacks a
    measurement.
    """

    text: str
    notes: tuple[str, ...]
    undescribed: str = ""
    listing: str = ""
    failure: BadInput | FmuFailure | None = None


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


@dataclass(frozen=True, kw_only=True)
class Question:
    """Something to choose.

    Attributes:
        key: short name of it, that of its flag.
        words: the question.
        options: what may be chosen.
        default: what is taken without an answer.
        why: the reason for it, in words; without a default the error that there is none.
        unit: of an answer that is a positive quantity, and no option; empty: it is one.
    """

    key: str
    words: str
    options: tuple[str, ...]
    default: tuple[str, ...]
    why: str
    unit: str = ""


#: Answers a question with words; None: the default.
Ask = Callable[[Question], Sequence[str] | None]


@dataclass
class Answers:
    """Answers by flags, then by a person, else by default; and what was taken, in sentences.

    Attributes:
        requested: answers by flags, by the question's key.
        ask: asks a person; None: there is none.
        notes: what was taken and why, in sentences.
        columns: names of columns of a recording that hold what is stated, as "input" or "output".
    """

    requested: dict[str, tuple[str, ...]] = field(default_factory=dict)
    ask: Ask | None = None
    notes: list[str] = field(default_factory=list)
    columns: dict[str, str] = field(default_factory=dict)

    def one(self, key: str) -> str | None:
        """The answer of a flag with one answer; None: there is none.

        Args:
            key: of its question.
        """
        return next(iter(self.requested.get(key, ())), None)

    def of(self, question: Question) -> tuple[str, ...]:
        """The answer to a question.

        Args:
            question: with its options.

        Raises:
            BadInput: a flag that names none of the options, or nothing to choose from.
        """
        key, text = question.key, blocks("draft/text")
        answer, where, asked = self.requested.get(key), f"--{key}", question
        tries = MOST_TRIES if self.ask and (len(question.options) > 1 or question.unit) else 0
        while answer or tries:
            if not answer and self.ask is not None:
                answer, where, tries = tuple(self.ask(asked) or ()), key, tries - 1
            if not answer:
                break
            try:
                taken = _checked(question, answer, where)
            except BadInput as error:
                if not tries:
                    raise
                asked, answer = replace(question, words=f"{error}"), None
                continue
            shown = " ".join(answer) if question.unit else listed(answer)
            self.notes.append(str(text.requested(key, shown)))
            return taken
        if not question.default:
            options = ", ".join(question.options[:MOST_SHOWN])
            wanted = f"--{key}: nothing suits by itself, wanted one of {options}"
            if not options:
                wanted = f"--{key}: nothing of the FMU can be named here; wanted a Real parameter"
            raise BadInput(question.why if question.unit else wanted)
        others = any(name not in question.default for name in question.options)
        self.notes.append(str(text.default(key, question.default, question.why, others)))
        return question.default

    def choose(
        self, key: str, options: Sequence[str], default: Sequence[str], why: str, words: str = ""
    ) -> tuple[str, ...]:
        """The answer to a question by its key, of which the only option needs no reason.

        Args:
            key: see `Question`.
            options: see `Question`.
            default: what is taken without an answer.
            why: see `Question`.
            words: see `Question`; empty: those of the key.

        Raises:
            BadInput: see `of`.
        """
        why, words = "the only one" if len(options) == 1 else why, words or WORDS[key]
        options, default = tuple(options), tuple(default)
        return self.of(Question(key=key, words=words, options=options, default=default, why=why))


def _checked(question: Question, answer: tuple[str, ...], where: str) -> tuple[str, ...]:
    """An answer that is one of the options, several where there may be; or a quantity in Hz."""
    if question.unit:
        text = " ".join(answer)
        value, unit = parse_quantity(text, where=where, wanted=question.unit)
        result = value if unit is None else convert(value, unit, question.unit, where=where)
        if not 0.0 < result < math.inf:
            raise BadInput(
                f"{where}: found '{text}', wanted a positive quantity in {question.unit}"
            )
        return (repr(result),)
    for name in answer:
        if name not in question.options:
            hint = did_you_mean(name, question.options, listed=where.startswith("--"))
            raise BadInput(f"{where}: found '{name}'{hint}")
    if len(answer) > 1 and question.key not in SEVERAL:
        raise BadInput(f"{where}: found {len(answer)} names, wanted one")
    return answer


def draft_from(  # noqa: PLR0913 - the parts of a campaign
    offer: Offer,
    folder: Path,
    answers: Answers,
    *,
    title: str,
    start: Starts,
    taken: Sequence[str],
    measured: Mapping[str, Any],
    boxes: Sequence[Box],
    notes: Sequence[str],
    derived: Sequence[str] = (),
    undescribed: str = "",
    missing: str = "",
    listing: Sequence[Sequence[str | Path]] = (),
    unused: Sequence[tuple[Path, Sequence[str]]] = (),
) -> Draft:
    """The draft of a campaign, after it was read and bound as `reconstruct` will do it.

    Where a measurement is missing, with one that is made up for this alone.

    Args:
        offer: the FMU.
        folder: of the campaign.
        answers: what was taken.
        title: of the campaign.
        start: start values of the FMU, with their reasons.
        taken: those of them that the files do not determine.
        measured: all tables but those of the FMU and of what is fitted.
        boxes: of the parameters.
        notes: sentences on the files.
        derived: outputs that are reported.
        undescribed: see `Draft`.
        missing: what becomes a table at the end without its marks; empty: nothing is missing.
        listing: rows of the table of files that it reads; empty: there is none.
        unused: columns of the files that vary and that the campaign does not use.

    Raises:
        BadInput: the tables do not suit the FMU or its files.
    """
    fmu: dict[str, Any] = {"file": Path(offer.name)}
    if offer.is_model:
        fmu = {"model": noted(offer.name, "shipped with fmu-fit and built on demand")}
    elif offer.interface is not None:
        fmu["interface"] = offer.interface
    if taken:
        fmu["taken"] = noted(list(taken), "not measured: leave out what you know to be so")
    if start:
        fmu["start"] = {name: noted(value, why) for name, (value, why) in start.items()}
    parameters = []
    for box in boxes:
        unit = {} if box.unit == "1" else {"unit": box.unit}
        ends = {"lower": box.lower, "upper": box.upper}
        begin = {"start": noted(box.start, box.why), "scale": box.scale}
        parameters.append({"name": box.name, **unit, **ends, **begin})
    tables: dict[str, Any] = {"title": title, "fmu": fmu, **measured, "parameters": parameters}
    if derived:
        reported = "outputs of the FMU that are reported, too"
        tables["derived"] = {"outputs": noted(list(derived), reported)}
    tables["continuation"] = {
        "nu_start": noted(1e-6, "the prior only helps at the start"),
        "beta": 0.001,
        "iterations": 2,
        "misfit": "squares",
        "starts": noted(1, "3: also the lowest minima that a search finds"),
        "seed": 1,
    }

    # as `reconstruct` will read it, with absolute paths
    text = _text(tables, None, HEAD) + missing
    text = text.replace(_path(folder / LIST, None), LIST)
    tomllib.loads(text)
    with Scratch() as scratch:
        write_whole(scratch / LIST, _listing(listing, None))
        path = scratch / "campaign.toml"
        write_whole(path, text.replace(f"\n{MARK}", "\n"))
        write_whole(scratch / "sweep.csv", EXAMPLE)
        failure, is_run = _tried(path, offer, is_whole=not missing)
    first = "A campaign for this FMU, written by fmu-fit init: what is missing stands at its end."
    text = blocks("draft/text")
    without = [str(text.unused(path.name, columns)) for path, columns in unused if columns]
    beyond = [line for each in (*without, undescribed) for line in wrap(each, HEAD_WIDTH)]
    opening = HEAD[0] if failure is None else str(text.fails(failure))
    opening = opening if is_run else str(text.slow(MOST_S))
    notes = (*notes, *(() if is_run else (opening,)))
    head = (first, HEAD[1]) if missing else (*wrap(opening, HEAD_WIDTH), HEAD[1], *beyond)
    starts = [str(text.start(box)) for box in boxes]
    notes = (*notes, *without, *answers.notes, *starts)
    listed_files = _listing(listing, folder) if listing else ""
    return Draft(
        _text(tables, folder, head) + missing, notes, undescribed, listed_files, failure=failure
    )


def _tried(
    path: Path, offer: Offer, *, is_whole: bool
) -> tuple[BadInput | FmuFailure | None, bool]:
    """Bind a campaign; plan and run a whole one once where it starts: what fails there fails a fit.

    Returns:
        why it does not run, and whether the time was enough for it to run.

    Raises:
        BadInput: it does not suit the FMU.
    """
    is_bound, workers = False, offer.fmu.workers
    try:
        campaign = read_campaign(path)
        bind(campaign, offer.variables)
        is_bound = True
        if is_whole:
            workers.until_s = workers.counts.processor_s + MOST_S
            problem = Problem.of(campaign, offer.fmu)
            problem.residuals(problem.start)
    except OutOfTime:
        return None, False
    except BadInput as error:
        errors = (str(t).replace(f"{path}: ", "").replace(str(path), "draft") for t in error.args)
        failure = BadInput(*(f"the draft does not suit: {each}" for each in errors))
        if not is_bound:
            raise failure from error
        return failure, True
    except FmuFailure as error:
        return error, True
    finally:
        workers.until_s = math.inf
    return None, True


def _path(path: Path, folder: Path | None) -> str:
    """A path as seen from the campaign, with slashes on every system; absolute without a folder."""
    return Path(os.path.abspath(path)).as_posix() if folder is None else path_from(folder, path)


def _listing(rows: Sequence[Sequence[str | Path]], folder: Path | None) -> str:
    """A table of files as text."""
    cells = [[_path(c, folder) if isinstance(c, Path) else c for c in row] for row in rows]
    return csv_text(cells)


def _text(tables: Mapping[str, Any], folder: Path | None, head: Sequence[str]) -> str:
    """Tables as TOML with remarks; paths relative to a folder, or absolute without one."""
    remarks: dict[tuple[str | int, ...], str] = {}

    def plain(value: Any, at: tuple[str | int, ...]) -> Any:
        if isinstance(value, Noted):
            remarks[at] = value.remark
            return plain(value.value, at)
        if isinstance(value, Path):
            return _path(value, folder)
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


def accuracy_table(residual: float, *, kept: bool = False) -> dict[str, Any]:
    """The accuracy of the simulation: a hundredth of the scatter, as a power of ten.

    From 1e-6 to 1e-4; with an input that is held over each step from 1e-5: no more can be promised.

    Args:
        residual: relative scatter of the data; 0: unknown.
        kept: whether an input is driven.
    """
    power = least = -5 if kept else -6
    if residual > 0.0:
        power = min(max(math.floor(math.log10(residual / 100.0)), least), -4)
    remark = "of the simulation, relative" + ": well below the scatter" * (residual > 0.0)
    return {"amplitude": noted(float(f"1e{power}"), remark)}


def columns_of(roles: Roles) -> dict[str, Any]:
    """Names of the columns, with units where the file has none, and which part of it is meant.

    Args:
        roles: of a file.
    """
    named = {"frequency": roles.frequency, "x": roles.real, "y": roles.imaginary}
    if roles.real is None:
        named |= {"amplitude": roles.sizes, "phase": roles.phase}
    columns = {}
    for key, channel in named.items():
        if channel is not None:
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


def amplitude_keys(units: Sequence[str], kind: str, remark: str) -> dict[str, Any]:
    """What amplitudes mean, as a campaign declares it: "V peak", "m rms", "dBm" or "dB".

    Args:
        units: of the amplitudes, the first one counts.
        kind: "peak" or "rms".
        remark: what that is for.
    """
    unit = next((u for u in units if u), "1" if units else "V")
    if unit == "dBm":
        guess = "a guess: of the input; plays no part in a fitted scale"
        return {"amplitude": noted(unit, remark), "impedance": noted(LOAD, guess)}
    bases = ("V", "m", "A", "rad", "m/s", "Pa", "K")
    base = next((base for base in bases if same_kind(unit, base)), unit)
    return {"amplitude": noted(unit if unit == "dB" else f"{base} {kind}", remark)}


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
