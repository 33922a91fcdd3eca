"""A campaign of files over time: free decays of one or two lines, or recordings of an FMU's output.

A record of one column that decays (`fitting.lines.ringdown`), of X and Y or of amplitudes of a
lock-in is a ringdown from an unknown state, which a pulse at an input spans. Of any other recording
the parameters are fitted that it shows: whose small change changes the output, each otherwise than
those before it, by runs of the FMU at its own start values under the recorded input:

    s_k = d y/d ln p_k,     p_k is taken while |s_k - (its projection on those taken)| > 1 % |s_k|

and while |s_k| is more than 1/1000 of the largest. An FMU comes with the values of its author: a
time constant of one second is no start for a step of milliseconds. Parameters therefore start where

    least over p of  |y - c s(p)|^2,   p_k times 10^(-3), ..., 10^3, in turn

with the best factor c: a time constant shows whatever the gain. Values that c takes up, as a gain,
then follow with c = 1, where no detector is between.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fitting.campaign.instruments.roles import TIME, usual, usual_frequency
from fitting.draft.document import (
    Answers,
    Draft,
    Question,
    draft_from,
    in_file,
    noted,
)
from fitting.draft.model import (
    COUPLING,
    FIRST_OUTPUT,
    ONE_MODE,
    OWN,
    TWO_MODES,
    UNCOUPLED,
    Offer,
    Shown,
    Starts,
    is_of_solver,
    line_boxes,
    opened_offer,
    shown_lines,
)
from fitting.extension.fmu import FmuVariable, Run
from fitting.extension.records import Channel, Pulse, Recording, Trace, read_recording
from fitting.lines.names import TIME_PAGE
from fitting.lines.ringdown import Ringdown, ringdown_of
from fitting.lines.trace import AMPLITUDES, PHASORS, SAMPLES, DecayRecord, decay_record_of
from fitting.measurements.time_record import DETECTED
from fitting.measurements.traces import FIT, STATES_OF_ONE, UNKNOWN
from fitting.measurements.waveform import HOLD, LINEAR
from fitting.resonance.decay_reading import decay_roles_of, is_over_time, read_decay_of
from fitting.resonance.reading import Columns, Roles, unused_columns, with_unit
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure
from fitting.text.notation import how_many, listed
from fitting.text.rendering import blocks
from fitting.text.units import convert, same_kind

#: Columns that may be stated, by what of the FMU they hold.
OUTPUT, INPUT = "output", "input"
#: Size of the second half over the first below which samples decay, and periods, at least.
DECAYS, PERIODS = 0.8, 4.0
#: Samples of the answer to a pulse that are examined, and the share of the best output's second
#: line from which another one shows both as well.
AFTER_PULSE, SHOWS = 2000, 0.3
#: Share of a record behind which its decay begins late; standard errors from which a constant next
#: to X and Y is solved for.
LATEST, LEAST_ERRORS = 0.02, 2.0
#: Share of the rate of the samples to either side of a line: beyond half of it another line gives
#: the same samples.
ALIKE = 0.45
#: Samples of a recording that are simulated; the share of those of an input at which it may change
#: and still seem held.
MOST_SAMPLES, CHANGES = 4000, 0.25
#: Change of a logarithm, and shares of a change below which a parameter has no effect of its own.
STEP, LEAST_EFFECT, APART = 1e-3, 1e-3, 1e-2
#: Factors on a value that are tried for a closer start, how often all values are gone through, and
#: how many are moved at most: each costs a run for every factor and round.
FACTORS, ROUNDS, MOST_MOVED = tuple(10.0 ** (0.5 * k) for k in range(-6, 7) if k), 2, 6
#: Share of the squares below which another start is closer; their change below which a value has no
#: effect on the shape.
CLOSER, NO_EFFECT = 0.9, 1e-6
#: Remarks on how an input moves between samples.
MOVES = {
    HOLD: 'a guess: it stands still and jumps; or "linear" between samples',
    LINEAR: 'a guess: it moves from sample to sample; or "held" from each to the next',
}

#: The output (n,) at start values by name; None where the FMU refuses them.
Simulated = Callable[[Mapping[str, Scalar]], FloatArray | None]


@dataclass(frozen=True)
class TimeFile:
    """Columns over time, and what they hold as far as that is known.

    ``observed`` is the output's, ``driven`` the input's, None: none drives; ``further`` are those
    of further inputs, by their names; ``kept`` all names that are stated, empty: any column counts.
    """

    table: Recording
    time: Channel
    observed: Channel
    driven: Channel | None = None
    interpolation: str = LINEAR
    further: tuple[Channel, ...] = ()
    kept: frozenset[str] = frozenset()

    @property
    def others(self) -> tuple[Channel, ...]:
        """All columns that count but that of times."""
        channels = (c for c in self.table.channels if c.name != self.time.name)
        return tuple(c for c in channels if not self.kept or c.name in self.kept)

    @property
    def taken(self) -> tuple[Channel, ...]:
        """All columns that are taken for something."""
        driven = () if self.driven is None else (self.driven,)
        return (self.time, self.observed, *driven, *self.further)

    def time_s(self, most: int | None = None) -> FloatArray:
        """Times of the first samples, s.

        Args:
            most: samples; None: all.
        """
        factor = convert(1.0, self.time.unit or "s", "s", where=str(self.table.path))
        return np.asarray(factor * self.table.numbers(self.time)[:most])

    def called(self, name: str) -> Channel | None:
        """The column that is called like a variable, capitals apart; None where none is.

        Args:
            name: of the variable; brackets in it are those of an array, and no unit.
        """
        matches = [c for c in self.others if _is_called(c, name)]
        exact = [c for c in matches if c.name.lower() == name.lower()]
        return exact[0] if exact else matches[0] if len(matches) == 1 else None

    def has_no_unit(self, column: Channel) -> bool:
        """Whether the file has no unit of a column.

        Args:
            column: of the file.
        """
        return all(c.unit is None for c in self.table.channels if c.name == column.name)


def records_draft(
    paths: Sequence[Path], columns: Columns, answers: Answers, fmu: str | Path | None, folder: Path
) -> Draft | None:
    """A campaign of files over time; None of other files.

    Args:
        paths: of the files.
        columns: what is stated of their columns.
        answers: of flags, of a person, or by default.
        fmu: the FMU; None: one mode, or two, as many as ringdowns show.
        folder: of the campaign.

    Raises:
        BadInput: a unit or a frequency that the files lack, no free decay and no FMU, columns that
            suit no variable, an FMU with other modes than the record shows, an answer that is none;
            or the draft does not suit, by the campaign's reader.
        FmuFailure: the FMU failed with its own start values.
    """
    demodulated = _demodulated(paths, columns, is_alone=fmu is None)
    files = _time_files(paths, columns, simulated=fmu is not None)
    if not (demodulated or files):
        return None
    for key in columns.selection.parts:
        raise BadInput(
            f"--{key.replace('_', '-')}: a campaign of recordings does not choose it; wanted that "
            f"part of {paths[0]} in a file of its own"
        )
    interface = answers.one("interface")
    with ExitStack() as stack:
        offer = None if fmu is None else stack.enter_context(opened_offer(fmu, interface))
        if offer is not None:
            # columns that are called like variables of the FMU are a recording of these
            known = {name.lower() for name in offer.variables}
            names = [c.name for _, roles in demodulated[:1] for c in roles.values]
            if files and all(name.rpartition("/")[2].lower() in known for name in names):
                demodulated = []
            files = [_requested_columns(file, answers.columns, offer) for file in files]
        ringdowns = [] if demodulated else [r for r in map(_free_decay, files) if r is not None]
        for path, (record, _) in zip(paths, demodulated, strict=bool(demodulated)):
            asked = _question_of(path)
            if not math.isfinite(record.reference_hz) or asked.key in answers.requested:
                [requested] = answers.of(asked)
                record = replace(record, reference_hz=float(requested))
            ringdowns.append(ringdown_of(record))
        if offer is None:
            most = max((len(_lines(each)) for each in ringdowns), default=0)
            if len(ringdowns) < len(paths) or not most:
                raise BadInput(
                    f"{paths[0]}: is a recording over time, and no free decay of one column; "
                    f"wanted --fmu, the FMU whose output was recorded: {TIME_PAGE}"
                )
            model = ONE_MODE if most == 1 else TWO_MODES
            offer = stack.enter_context(opened_offer(model, interface))
        draft = None
        if len(ringdowns) == len(paths):
            sources = [roles for _, roles in demodulated] or files
            draft = _decays_draft(paths, sources, ringdowns, offer, answers, folder)
        return draft or _traces_draft(files, offer, answers, folder)


def _demodulated(
    paths: Sequence[Path], columns: Columns, *, is_alone: bool
) -> list[tuple[DecayRecord, Roles]]:
    """What a lock-in recorded, and its columns; nothing where one of the files is something else.

    Of files without an FMU, ``is_alone``, every unit that is missing is named at once.
    """
    try:
        if not all(is_over_time(path, columns) for path in paths):
            return []
    except BadInput:
        return []  # another reader names the error
    demodulated, missing = [], list[str]()
    for path in paths:
        roles = None
        try:
            roles = decay_roles_of(path, columns)
            record = read_decay_of(path, columns)
        except BadInput as error:
            if roles is not None and roles.is_complex:
                raise
            if not is_alone:
                return []  # FMI counts in seconds, and programs that run FMUs write no units
            try:  # with units it is a record of a decay, which may lack its reference, too
                known = replace(columns, unit_time="s", unit_phase="deg")
                record = read_decay_of(path, known)
            except BadInput:
                return []  # another reader names the error
            missing += error.args
            if record.kind == PHASORS and not math.isfinite(record.reference_hz):
                missing.append(_question_of(path).why)
            continue
        # swings, or a further column that moves, are what no demodulator shows
        names = [c.name for c in roles.all]
        others = [c for c in roles.recording.channels if c.name not in names]
        moving = any(c.is_complex or np.ptp(roles.recording.numbers(c)) > 0.0 for c in others)
        swings = record.kind == AMPLITUDES and bool(np.any(record.values.real < 0.0))
        whole = roles.sizes is not None and roles.sizes.is_complex  # a campaign reads X and Y
        if record.kind not in (PHASORS, AMPLITUDES) or moving or swings or whole:
            return []
        demodulated.append((record, roles))
    if missing:
        raise BadInput(*missing)
    return demodulated


def _question_of(path: Path) -> Question:
    """What no file of a lock-in without such a column contains."""
    return Question(
        key="demodulated-at",
        words=f"{path}: at which frequency was it demodulated, as 1.2 MHz?",
        options=(),
        default=(),
        why=f"{path}: does not contain the frequency at which it was demodulated; wanted it by "
        '--demodulated-at, as "1.2 MHz"',
        unit="Hz",
    )


def _time_files(paths: Sequence[Path], columns: Columns, *, simulated: bool) -> list[TimeFile]:
    """The files as recordings over time; none where one of them is something else.

    ``simulated``: an FMU is named whose variables they hold; FMI counts time in seconds.
    """
    files: list[TimeFile] = []
    for path in paths:
        try:
            table = read_recording(path, selection=columns.selection)
        except BadInput:
            return []  # its reader names the error, if it is none either
        time = _time(table, columns, simulated=simulated)
        units = [c.unit for c in table.channels if c.unit]
        other = any(same_kind(u, "Hz") for u in units) and not (columns.time or simulated)
        free = [c for c in table.channels if time is not None and c.name != time.name]
        if time is None or not free or other or any(c.is_complex for c in table.channels):
            return []
        files.append(TimeFile(table, time, free[0]))
    return files


def _time(table: Recording, columns: Columns, *, simulated: bool) -> Channel | None:
    """The column of times, in its own unit, a stated one, or that of FMI; None: there is none.

    A response over frequency is no recording, unless its column of times is stated.
    """
    requested = columns.unit_time
    if columns.time:
        column = table.column(columns.time)
        return with_unit(column, requested or ("" if column.unit else "s"))
    if usual_frequency(table) is not None:
        return None
    times = [c for c in table.channels if c.unit and same_kind(c.unit, "s")]
    named = usual(table, TIME)
    if len(times) == 1 or (simulated and named in times):
        return times[0] if len(times) == 1 else named
    if times or named is None or named.unit is not None or not (requested or simulated):
        return None
    return with_unit(named, requested or "s")


def _requested_columns(file: TimeFile, columns: Mapping[str, str], offer: Offer) -> TimeFile:
    """Of a recording whose output is stated the stated columns, and those of FMU inputs."""
    if OUTPUT not in columns:
        return file
    table = file.table
    kept = {table.column(name).name for name in columns.values()}
    kept |= {c.name for c in file.others if any(_is_called(c, n) for n in offer.inputs)}
    return replace(file, kept=frozenset(kept))


# --- free decays ---------------------------------------------------------------------------------


def _free_decay(file: TimeFile) -> Ringdown | None:
    """The ringdown that a recording of one column is; None where it does not decay freely."""
    if len(file.others) != 1:
        return None
    return decay_of(file.time_s(), file.table.numbers(file.others[0]))


def decay_of(time_s: FloatArray, values: FloatArray) -> Ringdown | None:
    """The ringdown of a record that decays freely over some periods; None where it does not.

    Args:
        time_s: times of the samples, evenly spaced, shape (n,), s.
        values: of the record, shape (n,), in any unit.
    """
    halves = np.array_split(values - np.mean(values), 2)
    first, second = (float(np.sqrt(np.mean(half**2))) for half in halves)
    if not 0.0 < second < DECAYS * first:
        return None
    try:
        record = decay_record_of(time_s, values, "1")
        ringdown = ringdown_of(replace(record, kind=SAMPLES))
    except BadInput:
        return None
    periods = ringdown.frequency.value * float(np.ptp(time_s))
    return ringdown if periods >= PERIODS else None


def _lines(ringdown: Ringdown, most_hz: float = math.inf) -> tuple[Shown, ...]:
    """The lines of a ringdown that decay, each within so much of its place."""
    second = ringdown.second
    parts = [(ringdown.frequency.value, ringdown.width.value, 1.0)]
    if second is not None and second.decays:
        parts.append((second.frequency.value, second.width.value, second.share))
    words = "a line that decays, fitted to the record"
    lines = [Shown(frequency_hz=f, width_hz=w, words=words, height=size) for f, w, size in parts]
    return shown_lines(lines, most_hz)


def _decays_draft(
    paths: Sequence[Path],
    sources: Sequence[Roles | TimeFile],
    ringdowns: Sequence[Ringdown],
    offer: Offer,
    answers: Answers,
    folder: Path,
) -> Draft | None:
    """A campaign of ringdowns; None where the FMU has no place and width in Hz for each line."""
    first = ringdowns[0]
    is_demodulated, phased = first.kind != SAMPLES, first.kind != AMPLITUDES
    shown = lines = _lines(first, ALIKE / first.spacing_s if first.kind == PHASORS else math.inf)
    if len(offer.places) == len(offer.widths) == 1 < len(shown) and not is_demodulated:
        lines = shown_lines([max(shown, key=lambda line: line.height)])
    # amplitudes do not constrain the frequency
    names = (*offer.places, *offer.widths) if phased else offer.widths
    alike = {len(lines), len(offer.places), len(offer.widths)} == {len(lines)}
    if not (alike and {*map(offer.unit, names)} == {"Hz"} and offer.inputs and offer.outputs):
        if not is_demodulated:
            return None
        raise BadInput(
            f"{paths[0]}: shows {how_many(len(lines), 'line')}; wanted an FMU with an input, "
            "an output, and a parameter for the frequency and one for the width of each, in Hz"
        )

    # start values: no tone drives, and what two lines do not determine is taken
    start: Starts = {
        tone[1]: (0.0, "off: nothing drives while it rings down") for tone in offer.tones
    }
    start |= UNCOUPLED if offer.is_two_modes else {}
    left: list[str] = []
    if len(lines) > 1:
        other = {name for tone in offer.tones for name in tone} | {*names}
        free = [n for n in offer.parameters if n not in other]
        left = [n for n in free if not is_of_solver(offer.variables[n])]
        left = [COUPLING] if offer.is_two_modes else left
        start = {name: (offer.start(name), OWN) for name in left} | start
    if not phased:
        start[offer.places[0]] = first.reference_hz, "what was demodulated at"
    known = line_boxes(offer, names, lines, {})

    # the output: one that is called like a column, or one that shows both lines
    default, why, source = offer.outputs[0], FIRST_OUTPUT, sources[0]
    if isinstance(source, TimeFile):
        named = [name for name in offer.outputs if source.called(name) is not None]
        if named:
            default, why = named[0], "named like a column"
        elif len(offer.outputs) > 1 and len(lines) > 1:
            values = {name: value for name, (value, _) in start.items()}
            values |= {name: box.start for name, box in known.items()}
            default = _showing(offer, lines, values, source.time_s(AFTER_PULSE))
            why = "shows both lines after a pulse"
    [output] = answers.choose(OUTPUT, offer.outputs, [default], why)
    each = "each of its modes" if len(lines) > 1 else "its mode"
    what = f"a ringdown determines {'frequency and width' if phased else 'the width'} of {each}"
    fitted = answers.choose("fit", offer.parameters + offer.further, names, what)
    boxes = [known.get(n) or offer.box(n, offer.start(n), OWN) for n in fitted]

    made = [
        _decay_table(path, source, ringdown, len(lines), offer, output)
        for path, source, ringdown in zip(paths, sources, ringdowns, strict=True)
    ]
    traces, described = [table for table, _ in made], [x for _, notes in made for x in notes]
    kept = {box.name for box in boxes}
    start = {name: value for name, value in start.items() if name not in kept}
    qualities = offer.qualities if phased and len(offer.qualities) == len(lines) else ()
    late = any("begin" in each for each in traces)
    words = blocks("draft/text").decay(first, shown, lines, offer, left, late)
    name = "demodulated_trace" if is_demodulated else "trace"
    return draft_from(
        offer,
        folder,
        answers,
        title=", ".join(path.stem for path in paths),
        start=start,
        taken=[name for name in left if name not in kept],
        measured={"observe": {"output": output}, name: traces},
        boxes=boxes,
        derived=qualities,
        notes=(*described, *str(words).splitlines()),
    )


def _decay_table(
    path: Path, source: Roles | TimeFile, ringdown: Ringdown, lines: int, offer: Offer, output: str
) -> tuple[dict[str, Any], Sequence[str]]:
    """The table of a ringdown, and what its file was taken for, in sentences."""
    made: dict[str, Any] = {"file": path}
    made["input"] = noted(offer.inputs[0], "a pulse at it spans the states that ring down")
    if ringdown.left_out > LATEST * (ringdown.left_out + len(ringdown.points.place)):
        made["begin"] = noted(DETECTED, "earlier samples, of a drive or a blow, are not used")
    if isinstance(source, TimeFile):
        made["start"] = noted(UNKNOWN, "solved for: the start of a ringdown is not known")
        if lines > 1:
            made["states"] = noted(STATES_OF_ONE * lines, "two for each mode")
        file = replace(source, observed=_in_unit_of(source.others[0], offer.unit(output)))
        return made | _trace_columns(file, output, ""), _described(file, output, "")
    made["frequency"] = noted(f"{ringdown.reference_hz!r} Hz", "what was demodulated at")
    if lines > 1:
        made["modes"] = lines
    constant = abs(ringdown.background) > LEAST_ERRORS * ringdown.background_std > 0.0
    if ringdown.kind == PHASORS and constant:
        made["offset"] = noted(True, "a constant is seen, as of a reference that leaks")
    parts = {"X": source.real, "Y": source.imaginary, "amplitude": source.sizes}
    parts |= {"time": source.axis, "phase": source.phase}
    columns = {key: in_file(c) for key, c in parts.items() if c is not None}
    columns = {key: name for key, name in columns.items() if name != key}
    return made | ({"columns": columns} if columns else {}), ringdown.remarks


def _showing(
    offer: Offer, lines: Sequence[Shown], start: Mapping[str, Scalar], time_s: FloatArray
) -> str:
    """The first output that shows both lines as well as the best one does, after a pulse.

    Of modes m with decays g_m, every output is fitted by sum c_m e^(-g_m t), and the smaller
    |c_m| over the larger one compared.
    """
    pulse = Pulse(length_s=float(time_s[1] - time_s[0]))
    try:
        trace = Trace(time_s - time_s[0], np.cos(time_s), input=offer.inputs[0], driven=pulse)
        [simulated] = offer.fmu.workers.run([_run_of(trace, start, offer.outputs)])
    except (FmuFailure, BadInput):
        return offer.outputs[0]
    poles = [complex(-math.pi * x.width_hz, 2.0 * math.pi * x.frequency_hz) for x in lines]
    waves = np.exp(np.outer(trace.window().times_s()[2:], poles))
    columns = np.concatenate([waves.real, waves.imag], axis=1)
    c = np.linalg.lstsq(columns, np.asarray(simulated)[2:], rcond=None)[0]
    sizes = np.hypot(c[: len(poles)], c[len(poles) :])
    shares = sizes.min(axis=0) / np.maximum(sizes.max(axis=0), 1e-300)
    enough = SHOWS * float(np.max(shares))
    return next(n for n, share in zip(offer.outputs, shares, strict=True) if share >= enough)


# --- recordings of an output ---------------------------------------------------------------------


def _traces_draft(
    recordings: Sequence[TimeFile], offer: Offer, answers: Answers, folder: Path
) -> Draft:
    """A campaign of traces: the first record decides what is fitted, and from where."""
    if not offer.outputs:
        raise BadInput(f"{offer.name}: has no continuous Real output, wanted one")
    output, driven = _variable(OUTPUT, recordings[0], offer.outputs, answers), ""
    if offer.inputs and any(len(each.others) != 1 for each in recordings):
        driven = _variable(INPUT, recordings[0], offer.inputs, answers)
    files = [_assigned(each, output, driven, offer, answers.columns) for each in recordings]
    driven = driven if any(file.driven is not None for file in files) else ""
    scaled = [_is_scaled(file, offer, output) for file in files]

    # what is fitted, and where it starts
    record = _record(files[0], offer, driven)
    simulated = _simulation(record, offer, output)
    default, why, alike = _fitted(simulated, offer)
    names = answers.choose("fit", offer.parameters + offer.further, default, why)
    unit, values = files[0].observed.unit, record.y
    if unit and not scaled[0]:  # as the campaign reads it: to base units where the FMU has none
        values = _converted(values, unit, offer.variables[output].unit, str(files[0].table.path))
    variables = {name: offer.variables[name] for name in names}
    closer = _closer_starts(values, simulated, variables, is_scaled=scaled[0])
    boxes = []
    for name in names:
        words = "closer to the record than the FMU's own start value, by runs half a decade apart"
        words = words if name in closer else "the FMU's own start value"
        start = float(f"{closer.get(name, offer.start(name)):.4g}")
        boxes.append(offer.box(name, start, f"{words}; bounds are a guess"))

    # the tables
    traces, notes = [], list[str]()
    for file, is_scaled in zip(files, scaled, strict=True):
        made: dict[str, Any] = {"file": file.table.path}
        if file.driven is not None:
            how = noted(file.interpolation, MOVES[file.interpolation])
            made |= {"input": driven, "interpolation": how}
        if is_scaled:
            words = f"{file.observed.unit} for the FMU's output: in proportion"
            made["gain"] = noted(FIT, words)
        if file.further:
            made["further_inputs"] = [column.name for column in file.further]
        traces.append(made | _trace_columns(file, output, driven))
        notes += _described(file, output, driven)
    if not driven and offer.inputs:
        notes.append(str(blocks("draft/text").undriven(TIME_PAGE)))
    taken: Starts = {name: (offer.start(name), OWN) for name in alike if name not in names}
    return draft_from(
        offer,
        folder,
        answers,
        title=", ".join(file.table.path.stem for file in files),
        start=taken,
        taken=tuple(taken),
        measured={"observe": {"output": output}, "trace": traces},
        boxes=boxes,
        notes=notes,
        unused=[(each.table.path, unused_columns(each.table, each.taken)) for each in files],
    )


def _variable(key: str, file: TimeFile, options: tuple[str, ...], answers: Answers) -> str:
    """The output, or the input, that was recorded: the one that a column is called by."""
    named = [name for name in options if file.called(name) is not None]
    why = FIRST_OUTPUT if key == OUTPUT else "the first one"
    default = (named or list(options))[:1]
    [name] = answers.choose(key, options, default, "named like a column" if named else why)
    return name


def _trace_columns(file: TimeFile, output: str, driven: str) -> dict[str, Any]:
    """Names of columns that are not the usual ones, with units where the file has none."""
    named = {"time": (file.time, "time"), "output": (file.observed, output)}
    if file.driven is not None:
        named["input"] = file.driven, driven
    columns = {}
    for key, (column, usual_name) in named.items():
        name = in_file(column) + (f" ({column.unit})" if file.has_no_unit(column) else "")
        if name != usual_name:
            columns[key] = name
    return {"columns": columns} if columns else {}


def _described(file: TimeFile, output: str, driven: str) -> list[str]:
    """What a file was taken for, in sentences."""
    words = blocks("draft/text")
    taken = [f"'{c.name}' in {c.unit}" for c in file.taken if file.has_no_unit(c)]
    stated = [str(words.recording(file, output, driven))]
    return stated + ([str(words.assumed(taken))] if taken else [])


def _in_unit_of(channel: Channel, unit: str) -> Channel:
    """A column in the unit of the FMU's variable where it has none."""
    return channel if channel.unit is not None else replace(channel, unit=unit)


def _is_called(channel: Channel, name: str) -> bool:
    """Whether a column is called like a variable, alone or within a model, as "model.fmu.y"."""
    return f".{channel.name.lower()}".endswith(f".{name.lower()}")


def _is_scaled(file: TimeFile, offer: Offer, output: str) -> bool:
    """Whether a detector is between the output and what was recorded, by their units."""
    unit, observed = offer.variables[output].unit, file.observed.unit
    return bool(observed and unit) and not same_kind(observed or "", unit or "")


def _assigned(
    file: TimeFile, output: str, driven: str, offer: Offer, columns: Mapping[str, str]
) -> TimeFile:
    """Which columns are which: as stated, by their names, else the input is before the output."""
    table = file.table
    inputs = [name for name in offer.inputs if name != driven]
    further = tuple(c for c in file.others if driven and c.name in inputs)
    others = [c for c in file.others if c not in further]
    observed = table.column(columns[OUTPUT]) if OUTPUT in columns else file.called(output)
    source = file.called(driven) if driven else None
    if driven and INPUT in columns:
        source = table.column(columns[INPUT])

    # columns of the FMU's other variables are what they are called, one that is left is the rest
    named = [c.name for c in (observed, source) if c is not None]
    free = [c for c in others if c.name not in named]
    free = [c for c in free if not any(_is_called(c, name) for name in offer.variables)]
    wants_input = driven != "" and source is None
    least = 1 if observed is None else 0
    if not least <= len(free) <= least + wants_input and (least or wants_input):
        wanted = output if observed is None else driven
        key = OUTPUT if wanted in offer.outputs else INPUT
        names = listed(f"'{c.name}'" for c in others) or "none"
        column = others[-1].name if others else "y"
        raise BadInput(
            f"{table.path}: no column '{wanted}' among {names}; wanted one that is called like the "
            f"FMU's {key}, or its name by --{key} {column}={wanted}"
        )
    observed = _in_unit_of(free.pop() if observed is None else observed, offer.unit(output))
    source = free[0] if wants_input and free else source
    if source is None:
        return replace(file, observed=observed)
    u = table.numbers(source)
    changes = np.count_nonzero(np.diff(u)) / max(1, u.size - 1)
    return replace(
        file,
        observed=observed,
        driven=_in_unit_of(source, offer.unit(driven)),
        interpolation=HOLD if changes <= CHANGES else LINEAR,
        further=tuple(_in_unit_of(c, offer.unit(c.name)) for c in further),
    )


def _record(file: TimeFile, offer: Offer, driven: str) -> Trace:
    """The first samples of a recording, inputs in the units of the FMU."""
    time_s, path = file.time_s(MOST_SAMPLES), str(file.table.path)

    def driving(column: Channel, name: str) -> tuple[FloatArray, FloatArray]:
        u = file.table.numbers(column)[:MOST_SAMPLES]
        if column.unit is not None:
            u = _converted(u, column.unit, offer.variables[name].unit, path)
        return time_s, u

    return Trace(
        time_s,
        file.table.numbers(file.observed)[:MOST_SAMPLES],
        input=driven if file.driven is not None else "",
        driven=None if file.driven is None else driving(file.driven, driven),
        further={column.name: driving(column, column.name) for column in file.further},
        interpolation=file.interpolation,
        source=path,
    )


def _converted(values: FloatArray, unit: str, wanted: str | None, where: str) -> FloatArray:
    zero, one = (convert(x, unit, wanted, where=where) for x in (0.0, 1.0))
    return np.asarray(zero + (one - zero) * values)


def _run_of(trace: Trace, start: Mapping[str, Scalar], outputs: tuple[str, ...]) -> Run:
    """The run of a trace's times under its input."""
    window = trace.window()
    return Run(
        start_values=dict(start),
        settle_s=window.settle_s,
        sample_step_s=window.step_s,
        samples=window.samples,
        outputs=outputs,
        input_signal=trace.signal(1),
    )


def _simulation(trace: Trace, offer: Offer, output: str) -> Simulated:
    """The output of the FMU under a record as a function of start values."""

    def simulated(values: Mapping[str, Scalar]) -> FloatArray | None:
        try:
            [observed] = offer.fmu.workers.run([_run_of(trace, values, (output,))])
        except FmuFailure:
            return None
        return np.asarray(observed[:, 0])

    return simulated


def _fitted(simulated: Simulated, offer: Offer) -> tuple[tuple[str, ...], str, list[str]]:
    """Parameters that the record shows, each by itself; why these; those that look like others."""
    names = [n for n in offer.parameters if offer.variables[n].start]
    base = simulated({})
    if base is None:  # its own start values do not run
        return (), "the FMU fails with its own start values under the record", []
    slopes, sizes = {}, {}
    for name in names:
        y = simulated({name: (1.0 + STEP) * offer.start(name)})
        if y is not None:
            slopes[name] = y - base
            sizes[name] = float(np.linalg.norm(slopes[name]))
    moved = [n for n in slopes if sizes[n] > LEAST_EFFECT * max(sizes.values())]
    # Gram and Schmidt, the largest effect first
    taken: list[str] = []
    basis = np.empty((base.size, 0))
    for name in sorted(moved, key=lambda n: -sizes[n]):
        rest = slopes[name] - basis @ (basis.T @ slopes[name])
        own = float(np.linalg.norm(rest))
        if own > APART * sizes[name]:
            taken.append(name)
            basis = np.column_stack([basis, rest / own])
    alike = [n for n in moved if n not in taken]
    why = "each changes the output otherwise than the others, at the FMU's start values"
    why += f"; not {listed(alike)}, which look like others there" if alike else ""
    return tuple(n for n in names if n in taken), why, alike


def _closer_starts(
    record: FloatArray,
    simulated: Simulated,
    variables: Mapping[str, FmuVariable],
    *,
    is_scaled: bool,
) -> dict[str, float]:
    """Start values with smaller residuals of a record (n,) than the FMU's own; those that moved.

    With ``is_scaled`` the record has another unit than the output, so that a factor is free.
    """
    own = {name: float(v.start or 0.0) for name, v in variables.items() if v.start}
    at, without_effect = dict(own), list(own)[:MOST_MOVED]

    def squares(values: Mapping[str, float], *, scaled: bool) -> float:
        """Sum of squared residuals; infinite outside the ranges that the FMU declares."""
        for name, value in values.items():
            low, high = variables[name].min, variables[name].max
            if (low is not None and value <= low) or (high is not None and value >= high):
                return math.inf
        y = simulated(values)
        if y is None or not np.all(np.isfinite(y)):
            return math.inf
        size, factor = float(y @ y), 1.0
        if scaled:
            factor = float(y @ record) / size if size > 0.0 else 0.0
        return float(np.sum((record - factor * y) ** 2))

    def move(name: str, *, scaled: bool) -> bool:
        """Move one value to where the squares are least; whether it has any effect on them."""
        values = [at[name], *(at[name] * factor for factor in FACTORS)]
        sizes = [squares({**at, name: value}, scaled=scaled) for value in values]
        finite = [size for size in sizes if math.isfinite(size)]
        if finite and min(sizes) < CLOSER * sizes[0]:
            at[name] = values[int(np.argmin(sizes))]
        return bool(finite) and max(finite) - min(finite) > NO_EFFECT * max(finite)

    for _ in range(ROUNDS):
        for name in list(own)[:MOST_MOVED]:
            if move(name, scaled=True) and name in without_effect:
                without_effect.remove(name)
    for name in without_effect * (not is_scaled):
        move(name, scaled=False)
    if not squares(at, scaled=is_scaled) < CLOSER * squares(own, scaled=is_scaled):
        return {}
    return {name: value for name, value in at.items() if value != own[name]}
