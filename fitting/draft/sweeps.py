"""A campaign of sweeps, spectra and tables of experiments, or of an FMU alone."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fitting.draft.boxes import Box, Shown, boxes_of, coupled_boxes, lines_shown, strength_box
from fitting.draft.document import (
    HEAD,
    LOAD,
    MARK,
    Draft,
    accuracy_table,
    columns_of,
    draft_from,
    fitted_tables,
    fmu_table,
    in_file,
    meaning,
    noted,
    of_whole_file,
    phase_keys,
    starts_words,
)
from fitting.draft.files import Files, SweepFile
from fitting.draft.model import COUPLING, UNCOUPLED, Offer
from fitting.draft.questions import Answers, Question
from fitting.draft.trial import line_pairs, linear_level, response_at
from fitting.draft.two_modes import DRIVEN, TwoModes
from fitting.lines.names import (
    FANO,
    FLOOR,
    OFFSET,
    RICE,
    SLOPE,
    SLOPED,
    TAIL,
    WORDS,
    WORDS_COMPLEX,
)
from fitting.measurements.noise.record import THERMAL, WHITE
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.notation import hertz, listed
from fitting.text.rendering import blocks
from fitting.text.sentences import sentence_lines
from fitting.text.units import convert, same_kind

#: The parameter of two modes that weighs the upper one against the lower one.
STRENGTH = "g2"
#: Start values of two modes of which the first is driven and observed, and moves the second.
THROUGH_COUPLING: dict[str, tuple[Scalar, str]] = {
    "readout2": (0.0, "the detector sees mode 1"),
    STRENGTH: (0.0, "the drive moves mode 1, and the coupling mode 2"),
}
#: Values of the FMU that are taken, where they are not fitted.
TAKEN_VALUES = (STRENGTH, "readout2", COUPLING)
#: Widths by which lines of several sweeps differ that are not of one mode.
APART = 3.0
#: Parameters that a line determines: its frequency and its width.
PER_LINE = 2
#: Held steps per period of an input: the drive is scaled so that its fundamental is right.
STEPS_PER_PERIOD = 28
#: Forms of amplitudes beside which no campaign has an FMU's.
BEYOND = (FANO, FLOOR, RICE, TAIL)
#: Backgrounds of complex sweeps, and of amplitudes with the remark on them, by the line's form.
BACKGROUNDS = {FANO: "constant", SLOPED: "slope"}
BESIDE = {
    OFFSET: (OFFSET, "a constant besides the line: solved inside"),
    SLOPED: (SLOPE, "with a slope, besides the line: solved inside"),
}
#: What a campaign without measurements lacks, as remarks that become its table.
MISSING = f"""
# MISSING: what was measured. With a file of it, all of this is found by itself:
#     fmu-fit init {{fmu}} SWEEP.csv --out FOLDER
# By hand: put the file into this folder, and take the marks from the lines below.
{MARK}[sweep]
{MARK}file = "sweep.csv" # a column of frequencies and one of amplitudes
{MARK}layout = "csv"
{MARK}amplitude = "V peak" # what the file means
{MARK}use = "fit"
{MARK}scale = "fit" # of measured over simulated amplitudes: by least squares
{MARK}columns = {{{{ frequency = "frequency (Hz)", amplitude = "amplitude (V)" }}}}
"""


def sweeps_draft(files: Files, offer: Offer, answers: Answers, folder: Path) -> Draft:
    """A campaign of sweeps, spectra and a table of experiments, or without any of them.

    Args:
        files: of the measurements, as they were looked at.
        offer: what the FMU offers.
        answers: of flags, of a person, or by default.
        folder: of the campaign.

    Raises:
        BadInput: files that are not read, an FMU without what a measurement needs, an answer that
            is none; or files and FMU do not suit each other, by the campaign's own reader.
        FmuFailure: the FMU failed with its own start values.
    """
    measured, line, table = files.sweeps or files.table, files.line, files.table
    one_line = files.two is None or len(offer.places) < 2
    if measured and offer.is_model and line is None and one_line:
        trouble = next((sweep.trouble for sweep in files.sweeps), "")
        raise BadInput(trouble or "wanted a sweep as well, which determines frequency and width")
    output = _output(files, offer, answers)
    tones, driven = _driven(files, offer, answers)
    start: dict[str, tuple[Scalar, str]] = {}
    if offer.steady:
        start[offer.steady] = True, "the FMU begins on its periodic orbit"
    for frequency, amplitude in offer.tones:
        if tones and (frequency, amplitude) not in tones:
            start[amplitude] = 0.0, f"no drive at {frequency}, which was not measured with"
    values = {name: value for name, (value, _) in start.items()}
    response = None
    if table is None and line is not None and offer.steady and tones:
        response = response_at(offer, values, tones[0], output, line.frequency.value)
    pair = files.two is not None and offer.is_two_modes
    modes = files.modes if pair else None
    more: tuple[str, ...] = (STRENGTH,) if pair else ()
    if modes is not None:
        more = (COUPLING, STRENGTH) if modes.kind == DRIVEN else (COUPLING,)
    trial = []
    if response is not None and line is not None and len(offer.places) > 1:
        trial = line_pairs(response, offer, line.frequency.value, line.width.value)
    fitted = answers.of(_fitted(files, offer, more, trial))
    if pair:
        start |= _start_of_pair(modes, fitted)
        values = {name: value for name, (value, _) in start.items()}
    lines = lines_shown(line, files.two, files.where)
    boxes = _boxes(files, offer, fitted, more, values)
    kept = [n for n in (*offer.places, *offer.widths) if n not in fitted]
    if line is None or len(offer.places) < 2:  # else those of further modes, which no line shows
        kept = []
    amplitude = _amplitude(files, answers)
    derived: tuple[str, ...] = ()
    if modes is None or modes.tells_lines:
        derived = _derived(offer, fitted, kept=bool(kept))
    level = 1.0
    if response is not None:
        placed = {b.name: convert(b.start, b.unit, offer.unit(b.name), where=b.name) for b in boxes}
        level = linear_level(response, placed)
    width = min((each.width_hz for each in lines), default=0.0)
    residual = 0.0 if line is None else line.rms_residual
    titles = ", ".join(sweep.path.stem for sweep in files.sweeps)
    tables: dict[str, Any] = {
        "title": titles or (table.path.stem if table else offer.description.model_name),
        "fmu": fmu_table(offer, start, [n for n in TAKEN_VALUES if n in start] if pair else ()),
        "observe": _observe(offer, output, width, steady=bool(start.get(offer.steady))),
        "drive": _drive(files, offer, tones, driven, level),
        **_measured(files, amplitude),
        **fitted_tables(
            boxes,
            noted(list(derived), "outputs of the FMU that are reported, too") if derived else (),
            searched=True,
        ),
        "accuracy": accuracy_table(
            residual,
            "of the simulation, relative" + ": well below the scatter" * (residual > 0.0),
            kept=bool(driven),
        ),
    }
    if offer.is_model:
        tables["fmu"]["model"] = noted(offer.name, "shipped with fmu-fit and built on demand")
    stated = [*_described(files), *answers.said, *starts_words(boxes)]
    stated += _conditions(files, offer, kept, reported=bool(derived))
    if measured:
        return draft_from(tables, offer, folder, stated, undescribed=_undescribed(files, offer))
    name = shlex.quote(offer.name)
    head = "A campaign for this FMU, written by fmu-fit init: what is missing stands at its end."
    missing = MISSING.format(fmu=f"--fmu {name}" if offer.is_model else name)
    return draft_from(tables, offer, folder, stated, ((head, HEAD[1]), missing))


def _boxes(
    files: Files,
    offer: Offer,
    fitted: Sequence[str],
    more: Sequence[str],
    start: Mapping[str, Scalar],
) -> list[Box]:
    """Boxes of what is fitted; ``more`` are what is fitted of two modes besides their lines."""
    lines = lines_shown(files.line, files.two, files.where)
    boxes = boxes_of(offer, fitted, _by_name(fitted, offer, lines), start)
    if more and files.modes is not None:
        own = {box.name: box for box in coupled_boxes(offer, files.modes, lines, more)}
        boxes = [own.get(box.name, box) for box in boxes]
    elif more and STRENGTH in fitted:
        boxes[fitted.index(STRENGTH)] = _strength(files, offer, lines)
    for box in boxes:
        if not box.lower < box.start < box.upper:
            raise BadInput(
                f"{box.name}: its start {box.start:g} {box.unit}, {box.why}, is not inside the "
                f"range that the FMU declares, {box.lower:g} to {box.upper:g}; wanted another --fit"
            )
    return boxes


def _conditions(files: Files, offer: Offer, kept: Sequence[str], *, reported: bool) -> list[str]:
    """What results will rest on, in sentences."""
    words, stated, modes = blocks("draft/text"), [], files.modes
    if files.two is not None and offer.is_two_modes:
        kind = "" if modes is None else modes.kind
        stated.append(str(words.taken_modes(kind, files.where, files.is_noise)))
    if kept:
        stated.append(str(words.held(kept)))
    elif modes is not None and not reported and not modes.tells_lines:
        stated.append(str(words.not_reported(modes, offer.derived)))
    return stated


def check_one_line(files: Files) -> None:
    """Refuse sweeps that one mode cannot all have: their lines are further apart than wide.

    Args:
        files: of the measurements, as they were looked at.

    Raises:
        BadInput: two of them show single lines that are not the same.
    """
    shown = [(sweep.path, sweep.line) for sweep in files.sweeps if sweep.line is not None]
    for path, line in shown[1:]:
        first_path, first = shown[0]
        apart = abs(line.frequency.value - first.frequency.value)
        if apart > APART * (line.width.value + first.width.value):
            raise BadInput(
                f"{path}: shows a line at {hertz(line.frequency.value, digits=7)}, {first_path} "
                f"one at {hertz(first.frequency.value, digits=7)}; wanted sweeps of one line, or "
                "--control, the quantity that moves it, as --control Vg=-6:6:1, or --fmu"
            )


def _derived(offer: Offer, fitted: Sequence[str], *, kept: bool) -> tuple[str, ...]:
    """Numbers of the model that are reported; where modes are held, those of the fitted one."""
    result = tuple(name for name in (*offer.derived, *offer.qualities) if name not in fitted)
    marks = {name.rpartition("_")[2] for name in fitted if name in offer.places and "_" in name}
    of_mode = tuple(name for name in result if name.rpartition("_")[2] in marks)
    return of_mode if kept and of_mode else result


def _undescribed(files: Files, offer: Offer) -> str:
    """What the campaign's FMU does not describe of a sweep, and what would help."""
    if files.table is not None:
        return ""
    if offer.is_model and files.two is not None and not files.describes_two:
        return str(blocks("draft/text").two_and_more())
    for sweep in files.sweeps:
        line = None if sweep.is_complex else sweep.driven_line
        if line is not None and line.forms[0].name in BEYOND:
            return str(blocks("draft/text").undescribed(line, WORDS, offer.is_model))
    return ""


def _described(files: Files) -> list[str]:
    """What every file was found to be, in sentences."""
    words, stated = blocks("draft/text"), list[str]()
    for sweep in files.sweeps:
        stated += sentence_lines(sweep.reading)
        line = sweep.driven_line
        if sweep.is_noise and sweep.noise is not None:
            stated += str(words.noise(sweep.noise)).splitlines()
        elif line is not None:
            known = WORDS_COMPLEX if line.is_complex else WORDS
            stated += str(words.line(line, known.get(line.forms[0].name))).splitlines()
        elif sweep.two is not None and files.line is None:
            stated.append(str(words.two_lines(sweep.two, sweep.is_complex)))
        else:
            stated.append(str(words.no_line(sweep)))
    return stated + ([str(words.experiments(files.table, files.pattern))] if files.table else [])


def _by_name(fitted: Sequence[str], offer: Offer, lines: Sequence[Shown]) -> dict[str, Shown]:
    """The line that each parameter sets: with two of them the first place and width the lower."""
    result: dict[str, Shown] = {}
    for group in (offer.places, offer.widths):
        names = [name for name in group if name in fitted]
        several = lines if len(lines) > 1 else [*lines] * len(names)
        result |= dict(zip(names, several, strict=False))
    return result


def _start_of_pair(modes: TwoModes | None, fitted: Sequence[str]) -> dict[str, tuple[Scalar, str]]:
    """What makes two modes those of the sweep, with reasons, but for what is fitted."""
    made = dict(UNCOUPLED)
    if modes is not None:
        result = "as both lines have it"
        made = THROUGH_COUPLING | {COUPLING: (modes.coupling_hz, result)}
        made |= {STRENGTH: (modes.drive, result)} if modes.kind == DRIVEN else {}
    return {name: value for name, value in made.items() if name not in fitted}


def _strength(files: Files, offer: Offer, lines: Sequence[Shown]) -> Box:
    """How strongly the upper mode is driven: heights of modes go with g/(f d).

    The sign is that of the phase between both lines; amplitudes show it by what lies between.
    """
    assert files.two is not None  # noqa: S101 - asked by the caller
    ratio = files.two.ratio
    one, two = (each.frequency_hz * each.width_hz for each in lines)
    start = math.copysign(abs(ratio) * two / one, ratio.real)
    why = f"heights, widths and places of the two lines in the {files.where}: g2 goes with them"
    if any(sweep.has_own_forces for sweep in files.sweeps):  # heat drives no mode against another
        return strength_box(offer, STRENGTH, start, why, positive=True)
    return strength_box(offer, STRENGTH, start, f"{why}; its sign with the phase between them")


def _output(files: Files, offer: Offer, answers: Answers) -> str:
    if not offer.outputs:
        raise BadInput(
            f"{offer.description.path}: has no continuous Real output that is no frequency, wanted "
            "one that a detector can see"
        )
    sizes = [sweep.roles.sizes or sweep.roles.real for sweep in files.sweeps]
    unit = next((c.unit for c in sizes if c is not None and c.unit), None)
    alike = [n for n in offer.outputs if unit and same_kind(offer.unit(n), unit)]
    default = (alike or offer.outputs)[0]
    why = "the first one with continuous values"
    if alike:
        why = f"in {offer.unit(default)} like the file"
    words = "Which output of the FMU does the detector see?"
    return answers.one_of("output", words, offer.outputs, default, why)


def _driven(files: Files, offer: Offer, answers: Answers) -> tuple[list[tuple[str, str]], str]:
    """The tones that drive, or else the input."""
    pairs = dict(offer.tones)
    if pairs and "input" not in answers.told and files.table is not None:
        names = [c.name for c in files.table.tones]
        if any(name not in pairs for name in names):
            raise BadInput(
                f"{files.table.path}: its tones are called {listed(names)}, the FMU's "
                f"{listed(pairs)}; wanted the FMU's names in the header, or --input"
            )
        return [(name, pairs[name]) for name in names], ""
    if pairs and "input" not in answers.told:
        first = next(iter(pairs))
        words = "Which parameter of the FMU holds the frequency of the drive?"
        question = Question(
            key="tone",
            words=words,
            options=tuple(pairs),
            default=(first,),
            why=f"its amplitude is {pairs[first]}",
        )
        return [(name, pairs[name]) for name in answers.of(question)], ""
    if not offer.inputs:
        raise BadInput(
            f"{offer.description.path}: has neither a pair of parameters that seem frequency and "
            "amplitude of a tone, nor a Real input, wanted something to drive"
        )
    named = [n for n in offer.inputs if n.lower() in ("force", "f", "b", "u", "drive", "v")]
    default, why = (named or offer.inputs)[0], "the likeliest input by its name"
    why = "the only input" if len(offer.inputs) == 1 else why
    words = "Which input of the FMU is driven?"
    [driven] = answers.of(
        Question(key="input", words=words, options=offer.inputs, default=(default,), why=why)
    )
    return [], driven


def _fitted(
    files: Files, offer: Offer, more: tuple[str, ...], trial: Sequence[tuple[str, str]]
) -> Question:
    """Which parameters: for each line one that sets its place and one that sets its width.

    Those whose line the output showed in a trial, if any did, else by names and units.
    """
    line, known = files.line, offer.description.variables
    places, widths = list(offer.places), list(offer.widths)
    if line is not None:

        def far(name: str) -> float:
            own = offer.start(name)
            known = same_kind(offer.unit(name), "Hz") and own
            return abs(own / line.frequency.value - 1.0) if known else 1e300

        places.sort(key=far)
    pair = next(((place, width) for place in places for n, width in trial if n == place), ())
    mark = places[0][-1:] if places else ""
    widths.sort(key=lambda name: name[-1:] != mark)
    default = pair or (*places[:1], *widths[:1])
    if not default:  # what has a value can be searched about it
        default = tuple(n for n in offer.parameters if known[n].start)[:PER_LINE]
    sets_line = set(default) <= {*offer.places, *offer.widths} and len(default) == PER_LINE
    why = "they set where the line is and how wide" if sets_line else "a guess"
    if files.two is not None and min(len(offer.places), len(offer.widths)) >= 2:
        default = (*offer.places[:2], *offer.widths[:2], *more)
        why = "they set where the two lines are, how wide" + (" and how high" if more else "")
    return Question(
        key="fit",
        words="Which parameters of the FMU are fitted?",
        options=offer.parameters,
        default=default,
        why=f"{why}, {'as a trial shows' if pair else 'by their units, names and descriptions'}",
        several=True,
    )


def _amplitude(files: Files, answers: Answers) -> str:
    """What amplitudes mean, as the campaign declares it."""
    sizes = [sweep.roles.sizes for sweep in (*files.sweeps, *files.spectra)]
    peaks = files.table.peaks if files.table else ()
    units = [c.unit or "" for c in (*peaks, *sizes) if c is not None]
    if files.table is None or meaning(units, "peak") in ("dB", "dBm"):
        return meaning(units, "peak")
    [kind] = answers.of(
        Question(
            key="amplitudes",
            words="Are the amplitudes in the files peak values or rms?",
            options=("peak", "rms"),
            default=("peak",),
            why="no file states which they are, and a scale takes it out where all mean the same",
        )
    )
    return meaning(units, kind)


def _observe(offer: Offer, output: str, width_hz: float, *, steady: bool) -> dict[str, Any]:
    others = [name for name in offer.outputs if name != output][:4]
    made = {"output": noted(output, f"or {', '.join(others)}" if others else "the only one")}
    if steady:
        made["steady_start"] = noted(True, "nothing to settle")
    elif width_hz > 0.0:
        words = "of the line: sets the time to settle"
        made["line_width"] = noted(hertz(width_hz, digits=3), words)
    return made


def _drive(
    files: Files, offer: Offer, tones: Sequence[tuple[str, str]], driven: str, level: float
) -> dict[str, Any]:
    words = f"amplitude of every tone, {offer.unit(tones[0][1])}" if tones else ""
    if tones:
        spectrum = "the spectrum is made of the response to a tone"
        small = ": small, so that the response is in proportion" * (level < 1.0)
        return {
            "kind": noted("tones", spectrum) if files.is_noise else "tones",
            "frequencies": noted(
                [f for f, _ in tones], "parameters of the FMU that hold the tones"
            ),
            "amplitudes": [amplitude for _, amplitude in tones],
            "level": noted(level, words + small),
        }
    words = f"amplitude of every tone, in the FMU's unit, {offer.unit(driven)}"
    return {
        "kind": "input",
        "frequencies": [c.name for c in files.table.tones] if files.table else ["f"],
        "input": noted(driven, "the signal is made here and held over each step"),
        "level": noted(1.0, words),
        "samples_per_period": STEPS_PER_PERIOD,
    }


def _measured(files: Files, amplitude: str) -> dict[str, Any]:
    """Tables of the measurements: of complex sweeps and noise spectra one each, of others one."""
    made: dict[str, Any] = {}
    table = files.table
    if table is not None:
        own: dict[str, Any] = {"file": table.path}
        if files.pattern:
            own["spectra"] = noted(Path(files.pattern), "a spectrum for each row")
            own |= columns_of(files.spectra[0].roles)
        else:
            columns = {"peaks": table.peaks, "peak_sigmas": table.sigmas, "phases": table.phases}
            own |= {key: [c.name for c in each] for key, each in columns.items() if each}
        own["amplitude"] = noted(amplitude, "what the files mean: peak or rms")
        made["experiments"] = own
    phased = [sweep for sweep in files.sweeps if sweep.is_complex and table is None]
    noise = [sweep for sweep in files.sweeps if sweep.is_noise and table is None]
    if phased:
        made["complex_sweep"] = [_complex(sweep, len(phased)) for sweep in phased]
    if noise:
        made["noise_spectrum"] = [_noise(sweep, len(noise)) for sweep in noise]
    for sweep in [each for each in files.sweeps if each not in (*phased, *noise)][:1]:
        made["sweep"] = _sweep(sweep, amplitude, fitted=table is None)
    return made


def _sweep(sweep: SweepFile, amplitude: str, *, fitted: bool) -> dict[str, Any]:
    """A sweep of amplitudes."""
    no_part = "peak or rms plays no part here: the scale is fitted"
    made: dict[str, Any] = {
        "file": sweep.path,
        "layout": sweep.roles.recording.layout,
        **columns_of(sweep.roles),
        "amplitude": noted(amplitude, no_part if fitted else "what the file means: peak or rms"),
        "use": noted("fit", "every point is fitted, too"),
        "scale": noted("fit", "of measured over simulated amplitudes: by least squares"),
    }
    if amplitude == "dBm":
        guess = "a guess: of the input; plays no part in a fitted scale"
        made["impedance"] = noted(LOAD, guess)
    form = "" if sweep.driven_line is None else sweep.driven_line.forms[0].name
    if form == FANO:
        made["background"] = noted("complex", "of the line by itself, found by comparing")
    elif form in BESIDE and fitted:
        made["background"] = noted(*BESIDE[form])
    return made


def _complex(sweep: SweepFile, count: int) -> dict[str, Any]:
    """A complex sweep, one of some."""
    made: dict[str, Any] = {
        "file": sweep.path,
        "layout": sweep.roles.recording.layout,
        **columns_of(sweep.roles),
    }
    line = sweep.driven_line
    background = "" if line is None else BACKGROUNDS.get(line.forms[0].name, "")
    if count > 1:
        made["label"] = sweep.path.stem
    if sweep.two is not None:
        made["background"] = noted("constant", "complex, besides the lines: solved inside")
    made |= phase_keys(rotated=sweep.phases_reversed, delayed=False)
    if background:
        made["background"] = noted(background, "complex, besides the line: from a comparison")
    return made | phase_keys(rotated=False, delayed=bool(line and line.forms[0].delayed))


def _noise(sweep: SweepFile, count: int) -> dict[str, Any]:
    """A noise spectrum, one of some: level and floor are solved for."""
    roles, own = sweep.roles, sweep.has_own_forces
    of_whole_file(roles, "noise_spectrum")
    made = {
        "file": noted(sweep.path, "averages = N states how many periodograms were averaged"),
        "force": noted(
            THERMAL if own else WHITE,
            "heat moves each mode; temperature and mass determine the read-out"
            if own
            else '"thermal", with temperature and mass, determines the read-out',
        ),
    }
    if sweep.noise is not None and sweep.noise.holds:
        made["holds"] = noted(sweep.noise.holds, "the unit does not state it")
    if count > 1:
        made["label"] = sweep.path.stem
    density = "" if roles.sizes is None else in_file(roles.sizes)
    columns = {"frequency": in_file(roles.frequency), "density": density}
    made["columns"] = noted(columns, "as they were recognised")
    return made
