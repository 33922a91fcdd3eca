"""A first campaign: files and an FMU are looked at, what they do not tell is asked or guessed."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from fitting.draft.campaign import Choices, campaign_text, meaning, missing_text
from fitting.draft.checked import Draft, check_text
from fitting.draft.control import map_draft_of
from fitting.draft.decays import decaying_lines
from fitting.draft.demodulated import DemodulatedFile, demodulated_draft_of, modes_of
from fitting.draft.files import Files
from fitting.draft.model import COUPLING, ONE_MODE, TWO_MODES, UNCOUPLED, Offer, Tone, offer_of
from fitting.draft.questions import Answers, Question
from fitting.draft.source import Source
from fitting.draft.trace_draft import Recording
from fitting.draft.traces import traces_of
from fitting.draft.trial import Trial
from fitting.draft.two_modes import COUPLED, DRIVEN, TwoModes
from fitting.draft.values import (
    Box,
    Seen,
    boxes_of,
    coupled_boxes,
    seen_of,
    strength_box,
)
from fitting.resonance.form import FANO, SLOPED, WORDS_BESIDE, WORDS_BESIDE_COMPLEX
from fitting.resonance.line import Line
from fitting.signal.peaks import FLOOR, OFFSET, RICE, SINGLE, TAIL
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.notation import hertz, how_many, listed, number, quantity, with_error
from fitting.text.sentences import sentence_lines
from fitting.text.units import convert, same_kind

#: The parameter of two modes that weighs the upper one against the lower one.
STRENGTH = "g2"
#: What a draft of two modes takes, by the kind of model (`fitting.draft.two_modes`).
TAKEN = {
    "": "each line is a mode of its own, without a coupling, and the detector sees both",
    COUPLED: "mode 1 alone is driven and seen, and lambda12 couples mode 2 to it",
    DRIVEN: "both modes are driven, mode 1 alone is seen, and lambda12 couples them",
}
#: The same of a noise spectrum, where it differs.
IN_HEAT = {COUPLED: "mode 1 alone is seen, heat moves both modes, and lambda12 couples them"}
#: What is said of a noise spectrum.
NOISE = (
    "The campaign fits the density, each point as an average of periodograms scatters, with a "
    "level and a white floor that are solved for. How many were averaged is taken from the "
    "scatter; averages = N under [[noise_spectrum]] states it."
)
#: The same of two modes of which the first is driven and seen, and moves the second.
THROUGH_COUPLING: dict[str, tuple[float, str]] = {
    "readout2": (0.0, "the detector sees mode 1"),
    STRENGTH: (0.0, "the drive moves mode 1, and the coupling mode 2"),
}
#: Values of the FMU that are taken, where they are not fitted.
TAKEN_VALUES = (STRENGTH, "readout2", COUPLING)
#: Widths by which lines of several sweeps differ that are not of one mode.
APART = 3.0
#: Parameters that a line determines: where it is and how wide.
PER_LINE = 2
#: What is said of two lines that no model of two modes describes.
TWO_AND_MORE = (
    "Not described by this campaign: two modes, beside each other or coupled, leave more of this "
    "sweep than its noise does. A fit may end as one that does not describe the data (exit code "
    "4); what would help: an FMU that has what stands beside them, as a third mode or a background."
)
#: Forms of amplitudes with what a campaign cannot put beside an FMU's, and what would help.
BEYOND = {
    FANO: "phases, or X and Y, or an FMU that has a background",
    FLOOR: "phases, or X and Y",
    RICE: "phases, or X and Y",
    TAIL: "a file that holds both lines, or an FMU with both",
}


def model_for(files: Files) -> str:
    """The model of this project that has as many modes as the files show lines; two for a map.

    Args:
        files: of the measurements.
    """
    return ONE_MODE if files.two is None and files.map is None else TWO_MODES


def model_for_recordings(
    recordings: Sequence[Recording] | Sequence[DemodulatedFile],
) -> str | None:
    """The model of this project for recordings over time: as many modes as ringdowns show, or none.

    Args:
        recordings: over time, all of samples or all demodulated.

    Raises:
        BadInput: demodulated, and no free decay.
    """
    shown = [
        modes_of(each) if isinstance(each, DemodulatedFile) else len(decaying_lines(each))
        for each in recordings
    ]
    if not shown or min(shown) == 0:
        return None
    return ONE_MODE if max(shown) == 1 else TWO_MODES


def trace_draft_of(
    recordings: Sequence[Recording] | Sequence[DemodulatedFile],
    source: Source,
    answers: Answers,
    folder: Path,
) -> Draft:
    """A campaign from recordings over time and an FMU.

    Args:
        recordings: at least one, all of samples or all demodulated.
        source: the FMU.
        answers: of flags, of a person, or by default.
        folder: where the campaign will stand.

    Raises:
        BadInput: as `draft_of`.
        FmuFailure: the FMU failed with its own start values.
    """
    offer = offer_of(source.workers.description)
    demodulated = [each for each in recordings if isinstance(each, DemodulatedFile)]
    samples = [each for each in recordings if isinstance(each, Recording)]
    made = (
        demodulated_draft_of(demodulated, source, offer, answers)
        if demodulated
        else traces_of(samples, source, offer, answers)
    )
    check_text(made.text(None), source)
    return Draft(text=made.text(folder), said=(*made.seen, *answers.said, *_boxes(made.boxes)))


def draft_of(files: Files, source: Source, answers: Answers, folder: Path) -> Draft:
    """A campaign from files and an FMU.

    Args:
        files: of the measurements, as they were looked at.
        source: the FMU.
        answers: of flags, of a person, or by default.
        folder: where the campaign will stand.

    Raises:
        BadInput: files that are not read, an FMU without what a measurement needs, an answer that
            is none; or files and FMU do not suit each other, as the campaign's own reader says.
        FmuFailure: the FMU failed with its own start values.
    """
    offer = offer_of(source.workers.description)
    if files.map is not None:
        return map_draft_of(files.map, source, offer, answers, folder)
    said = _said(files)
    choices = _chosen(files, source, offer, answers)
    name = shlex.quote(source.name)
    measured = files.sweeps or files.table
    missing = "" if measured else missing_text(f"--fmu {name}" if source.is_model else name)
    check_text(campaign_text(choices, files, offer, None) + missing, source)
    undescribed = _undescribed(files, source)
    text = campaign_text(choices, files, offer, folder, undescribed) + missing
    words = (
        f"Held at the FMU's own start values: {listed(choices.held)}, and all others. What is "
        "found holds with these, of which one line tells nothing."
    )
    tail = (words,) if choices.held else _lines_words(files.modes, choices, offer)
    tail = (*_taken(files, source), *tail)
    return Draft(
        text=text,
        said=(*said, *answers.said, *_boxes(choices.boxes), *tail),
        undescribed=undescribed,
    )


def check_one_line(files: Files) -> None:
    """Complain of sweeps that one mode cannot all have: their lines are further apart than wide.

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


def _taken(files: Files, source: Source) -> tuple[str, ...]:
    """What is taken of two modes that one sweep does not tell."""
    if files.two is None or not (source.is_model and source.name == TWO_MODES):
        return ()
    kind = "" if files.modes is None else files.modes.kind
    words, shares = TAKEN.get(kind, TAKEN[""]), "shares of the drive and of the detector"
    if files.is_noise:
        words, shares = IN_HEAT.get(kind, words), "couplings and shares of the detector"
    return (
        f"Taken: {words}. Other {shares} may give the same two lines, which one {files.where} does "
        "not tell: what is found holds under this.",
    )


def _lines_words(modes: TwoModes | None, choices: Choices, offer: Offer) -> tuple[str, ...]:
    """That outputs of the FMU are not the lines of the sweep, and where these are."""
    if modes is None or choices.derived or modes.tells_lines:
        return ()
    f1, f2, w1, w2 = (
        with_error(value, std, "Hz")
        for value, std in zip(modes.line_hz, modes.line_std_hz, strict=True)
    )
    off = number(max(modes.apart_hz), 2)
    return (
        f"Not reported: {listed(offer.derived)}. They are those of modes without damping, or of "
        f"like ones, up to {off} Hz off the lines, which are at {f1}, {w1} wide, and at {f2}, "
        f"{w2} wide. What is fitted is of each mode by itself, and tells both.",
    )


def _held(files: Files, offer: Offer, fitted: Sequence[str]) -> tuple[str, ...]:
    """Places and widths of further modes that one line does not tell of, and that are held."""
    if files.line is None or len(offer.places) < 2:
        return ()
    return tuple(name for name in (*offer.places, *offer.widths) if name not in fitted)


def _derived(offer: Offer, fitted: Sequence[str], *, held: bool) -> tuple[str, ...]:
    """Numbers of the model that are reported; where modes are held, those of the fitted one."""
    found = [name for name in (*offer.derived, *offer.qualities) if name not in fitted]
    marks = {name.rpartition("_")[2] for name in fitted if name in offer.places and "_" in name}
    of_mode = tuple(name for name in found if name.rpartition("_")[2] in marks)
    return of_mode if held and of_mode else tuple(found)


def _boxes(boxes: Sequence[Box]) -> list[str]:
    """Where every parameter starts, and why."""
    return [
        f"{box.name}: from {box.start:.9g} {'' if box.unit == '1' else box.unit}".rstrip()
        + f", {box.why}."
        for box in boxes
    ]


def _beside(line: Line) -> list[str]:
    """What was found beside the line, which the campaign has too."""
    form, known = line.forms[0], WORDS_BESIDE_COMPLEX if line.is_complex else WORDS_BESIDE
    beside = [known[form.name]] if form.name in known else []
    beside += ["the delay of a cable"] if form.delayed else []
    return [f"Beside the line, found by comparing: {listed(beside)}."] if beside else []


def _beyond_fmu(line: Line) -> list[str]:
    """What stands beside a line of amplitudes is in no FMU: what the campaign does about it."""
    size = f"{number(line.background, 4)} {line.unit if line.unit != '1' else ''}".rstrip()
    if line.forms[0].name == SLOPED:
        return [f"The campaign solves for it beside the FMU's amplitudes; here it is {size} at f."]
    if line.forms[0].name == OFFSET:
        return [f"The campaign solves for it beside the FMU's amplitudes; here it is {size}."]
    if line.forms[0].name == SINGLE:
        return [
            f"The noise of each reading, {size}, lifts amplitudes that are not far above it; the "
            "FMU's have none, and with X and Y nothing would be lifted."
        ]
    return []


def _undescribed(files: Files, source: Source) -> str:
    """What the campaign's FMU does not describe of a sweep, and what would help."""
    lines = [sweep.driven_line for sweep in files.sweeps if not sweep.is_complex]
    if files.table is not None:
        return ""
    if source.is_model and files.two is not None and not files.describes_two:
        return TWO_AND_MORE
    for line in lines:
        if line is None or line.forms[0].name not in BEYOND:
            continue
        form = line.forms[0].name
        way, noise = BEYOND[form], form in (FLOOR, RICE)
        own = "its FMU describes only if it has that itself"
        has = "its FMU does not have" if source.is_model or noise else own
        if form == FLOOR:
            size = f"{number(line.background, 4)} {line.unit if line.unit != '1' else ''}".rstrip()
            way = f"the square of {size} taken off their squares, or {way}"
        return (
            f"Not described by this campaign: {WORDS_BESIDE[form]}, beside the line of the sweep, "
            f"which {has}. A fit may end as one that does not describe the data (exit code 4); "
            f"what would help: {way}."
        )
    return ""


def _said(files: Files) -> list[str]:
    """What every file was found to be."""
    said: list[str] = []
    for sweep in files.sweeps:
        said += sentence_lines(sweep.reading)
        kind, line = "amplitude and phase" if sweep.is_complex else "amplitudes", sweep.driven_line
        if sweep.is_noise and sweep.noise is not None:
            said += [*sweep.noise.words, NOISE]
            continue
        if line is not None:
            f = quantity(line.frequency.value, line.frequency.std, "Hz")
            width = quantity(line.width.value, line.width.std, "Hz")
            said.append(f"A sweep of {kind} with one line: f = {f}, width {width}.")
            said += _beside(line)
            said += [] if sweep.is_complex else _beyond_fmu(line)
        elif sweep.two is not None and files.line is None:
            places = listed(
                f"{hertz(f, digits=7)} ({hertz(w, digits=3)} wide)"
                for f, w in zip(sweep.two.frequency_hz, sweep.two.width_hz, strict=True)
            )
            said.append(f"A sweep of {kind} with two lines, at {places}.")
        else:
            said.append(f"A sweep of {kind}: {sweep.trouble}.")
    if files.table is not None:
        table = files.table
        held = (
            f"peaks {listed(c.name for c in table.peaks)}"
            if table.peaks
            else f"a spectrum for each, {files.pattern}"
        )
        said.append(
            f"{table.path.name}: a table of {how_many(len(table.labels), 'experiment')}; tones "
            f"{listed(c.name for c in table.tones)}; {held}."
        )
    return said


def _chosen(files: Files, source: Source, offer: Offer, answers: Answers) -> Choices:
    """Everything that is not told by the files, asked or guessed."""
    measured = files.sweeps or files.table
    one_line = files.two is None or len(offer.places) < 2
    if measured and source.is_model and files.line is None and one_line:
        trouble = next((sweep.trouble for sweep in files.sweeps), "")
        raise BadInput(trouble or "wanted a sweep as well, which tells frequency and width")
    [output] = answers.of(_output(files, offer))
    tones, driven = _driven(files, offer, answers)
    start, words = _start_values(offer, tones)
    trial = _trial(files, source, offer, tones, output, start)
    pair = files.two is not None and source.is_model and source.name == TWO_MODES
    modes = files.modes if pair else None
    more = _more(modes) if pair else ()
    shown = trial.pairs() if trial and len(offer.places) > 1 else []
    fitted = answers.of(_fitted(files, offer, more, shown))
    if pair:
        of_pair = _start_of_pair(modes, fitted)
        start |= {name: value for name, (value, _) in of_pair.items()}
        words |= {name: why for name, (_, why) in of_pair.items()}
    line, seen = files.line, seen_of(files.line, files.two, files.where)
    held = _held(files, offer, fitted)
    boxes = boxes_of(source.workers, offer, fitted, _by_name(fitted, offer, seen), start)
    if modes is not None:
        own = {box.name: box for box in coupled_boxes(offer, modes, seen, more)}
        boxes = [own.get(box.name, box) for box in boxes]
    elif pair and STRENGTH in fitted:
        boxes[fitted.index(STRENGTH)] = _strength(files, offer, seen)
    boxes = [_in_box(box) for box in boxes]
    chosen = Choices(
        taken=tuple(n for n in TAKEN_VALUES if n in start) if pair else (),
        title=", ".join(sweep.path.stem for sweep in files.sweeps)
        or (str(files.table) if files.table else offer.description.model_name),
        source=source,
        output=output,
        tones=tuple((tone.frequency, tone.amplitude) for tone in tones),
        driven=driven,
        names=tuple(c.name for c in files.table.tones) if files.table else ("f",),
        start={name: (value, words.get(name, "")) for name, value in start.items()},
        amplitude=_amplitude(files, answers),
        boxes=tuple(boxes),
        derived=(
            _derived(offer, fitted, held=bool(held)) if modes is None or modes.tells_lines else ()
        ),
        held=held,
        width_hz=min((each.width_hz for each in seen), default=0.0),
        residual=0.0 if line is None else line.residual,
    )
    if trial is None:
        return chosen
    placed = {b.name: convert(b.start, b.unit, offer.unit(b.name), where=b.name) for b in boxes}
    return replace(chosen, level=trial.level(placed))


def _trial(
    files: Files,
    source: Source,
    offer: Offer,
    tones: Sequence[Tone],
    output: str,
    start: Mapping[str, Scalar],
) -> Trial | None:
    """A look at an FMU that begins on its periodic orbit, where one line was seen; else None."""
    if files.table is not None or files.line is None or not (offer.steady and tones):
        return None
    return Trial(
        workers=source.workers,
        offer=offer,
        start=start,
        tone=tones[0],
        output=output,
        frequency_hz=files.line.frequency.value,
        width_hz=files.line.width.value,
    )


def _by_name(fitted: Sequence[str], offer: Offer, seen: Sequence[Seen]) -> dict[str, Seen]:
    """The line that each parameter sets: with two of them the first place and width the lower."""
    found: dict[str, Seen] = {}
    for group in (offer.places, offer.widths):
        names = [name for name in group if name in fitted]
        if len(seen) < 2:
            found |= {name: each for each in seen for name in names}
        else:
            found |= dict(zip(names, seen, strict=False))
    return found


def _more(modes: TwoModes | None) -> tuple[str, ...]:
    """What is fitted of two modes beside their places and widths."""
    if modes is None:
        return (STRENGTH,)
    return (COUPLING, STRENGTH) if modes.kind == DRIVEN else (COUPLING,)


def _start_of_pair(modes: TwoModes | None, fitted: Sequence[str]) -> dict[str, tuple[float, str]]:
    """What makes two modes those of the sweep, with reasons, but for what is fitted."""
    made = dict(UNCOUPLED)
    if modes is not None:
        found = "as both lines have it"
        made = THROUGH_COUPLING | {COUPLING: (modes.coupling_hz, found)}
        made |= {STRENGTH: (modes.drive, found)} if modes.kind == DRIVEN else {}
    return {name: value for name, value in made.items() if name not in fitted}


def _strength(files: Files, offer: Offer, seen: Sequence[Seen]) -> Box:
    """How strongly the upper mode is driven: heights of modes go with g/(f d).

    The sign is that of the phase between both lines; amplitudes show it by what stands between.
    """
    assert files.two is not None  # noqa: S101 - asked by the caller
    ratio = files.two.ratio
    one, two = (each.frequency_hz * each.width_hz for each in seen)
    start = math.copysign(abs(ratio) * two / one, ratio.real)
    why = f"heights, widths and places of the two lines in the {files.where}: g2 goes with them"
    if any(sweep.has_own_forces for sweep in files.sweeps):  # heat drives no mode against another
        return strength_box(offer, STRENGTH, start, why, positive=True)
    return strength_box(offer, STRENGTH, start, f"{why}; its sign with the phase between them")


def _in_box(box: Box) -> Box:
    if not box.lower < box.start < box.upper:
        raise BadInput(
            f"{box.name}: its start {box.start:g} {box.unit}, {box.why}, is not inside the range "
            f"that the FMU declares, {box.lower:g} to {box.upper:g}; wanted another --fit"
        )
    return box


def _output(files: Files, offer: Offer) -> Question:
    if not offer.outputs:
        raise BadInput(
            f"{offer.description.path}: has no continuous Real output that is no frequency, wanted "
            "one that a detector can see"
        )
    sizes = [r.sizes or r.real for r in (sweep.roles for sweep in files.sweeps)]
    units = [c.unit for c in sizes if c is not None and c.unit]
    alike = [n for n in offer.outputs if units and same_kind(offer.unit(n), units[0])]
    default = (alike or offer.outputs)[0]
    why = "the only one" if len(offer.outputs) == 1 else "the first one with continuous values"
    if alike and len(offer.outputs) > 1:
        why = f"in {offer.unit(default)} like the file"
    return Question(
        key="output",
        words="Which output of the FMU does the detector see?",
        options=offer.outputs,
        default=(default,),
        why=why,
    )


def _driven(files: Files, offer: Offer, answers: Answers) -> tuple[list[Tone], str]:
    """The tones that drive, or else the input."""
    pairs = {tone.frequency: tone for tone in offer.tones}
    wants_input = "input" in answers.told
    if pairs and not wants_input:
        if files.table is not None:
            return _tones_of_table(files, offer), ""
        question = Question(
            key="tone",
            words="Which parameter of the FMU holds the frequency of the drive?",
            options=tuple(pairs),
            default=tuple(pairs)[:1],
            why=f"its amplitude is {pairs[next(iter(pairs))].amplitude}",
        )
        return [pairs[name] for name in answers.of(question)], ""
    if not offer.inputs:
        raise BadInput(
            f"{offer.description.path}: has neither a pair of parameters that seem frequency and "
            "amplitude of a tone, nor a Real input, wanted something to drive"
        )
    named = [n for n in offer.inputs if n.lower() in ("force", "f", "b", "u", "drive", "v")]
    why = "the only input" if len(offer.inputs) == 1 else "the likeliest input by its name"
    [driven] = answers.of(
        Question(
            key="input",
            words="Which input of the FMU is driven?",
            options=offer.inputs,
            default=tuple(named or offer.inputs)[:1],
            why=why,
        )
    )
    return [], driven


def _tones_of_table(files: Files, offer: Offer) -> list[Tone]:
    """The FMU's tones that the table's columns name."""
    assert files.table is not None  # noqa: S101 - asked for by the caller
    pairs = {tone.frequency: tone for tone in offer.tones}
    names = [c.name for c in files.table.tones]
    unknown = [name for name in names if name not in pairs]
    if unknown:
        raise BadInput(
            f"{files.table.path}: its tones are called {listed(names)}, the FMU's "
            f"{listed(pairs)}; wanted the FMU's names in the header, or --input"
        )
    return [pairs[name] for name in names]


def _start_values(offer: Offer, tones: Sequence[Tone]) -> tuple[dict[str, Scalar], dict[str, str]]:
    """Start values: the periodic orbit, and other tones of the FMU that do not drive."""
    start: dict[str, Scalar] = {}
    words: dict[str, str] = {}
    if offer.steady:
        start[offer.steady] = True
        words[offer.steady] = "the FMU begins on its periodic orbit"
    for tone in offer.tones:
        if tones and tone not in tones:
            start[tone.amplitude] = 0.0
            words[tone.amplitude] = f"no drive at {tone.frequency}, which nobody measured with"
    return start, words


def _fitted(
    files: Files, offer: Offer, more: tuple[str, ...], shown: Sequence[tuple[str, str]]
) -> Question:
    """Which parameters: for each line one that sets its place and one that sets its width.

    Those whose line the output was seen to show, if any were, else as names and units tell.
    """
    line = files.line
    places, widths = list(offer.places), list(offer.widths)
    if line is not None:

        def far(name: str) -> float:
            start = offer.description.variables[name].start
            known = same_kind(offer.unit(name), "Hz") and start
            return abs(float(start or 0.0) / line.frequency.value - 1.0) if known else 1e300

        places.sort(key=far)
    pair = next(((place, width) for place in places for n, width in shown if n == place), ())
    place = places[:1]
    mark = place[0][-1:] if place else ""
    widths.sort(key=lambda name: name[-1:] != mark)
    default = pair or (*place, *widths[:1])
    if not default:  # what has a value can be searched about it
        known = offer.description.variables
        default = tuple(n for n in offer.parameters if known[n].start)[:PER_LINE]
    told = set(default) <= {*offer.places, *offer.widths} and len(default) == PER_LINE
    why = "they set where the line is and how wide" if told else "a guess"
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
    sizes = [r.sizes for r in (s.roles for s in (*files.sweeps, *files.spectra))]
    units = [c.unit or "" for c in sizes if c is not None]
    if files.table is not None:
        units = [c.unit or "" for c in files.table.peaks] + units
    if files.table is None or meaning(units, "peak") in ("dB", "dBm"):
        return meaning(units, "peak")
    [kind] = answers.of(
        Question(
            key="amplitudes",
            words="Are the amplitudes in the files peak values or rms?",
            options=("peak", "rms"),
            default=("peak",),
            why="no file tells which they are, and a scale takes it out where all mean the same",
        )
    )
    return meaning(units, kind)
