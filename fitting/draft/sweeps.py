"""A campaign of sweeps, spectra and tables of experiments, or of an FMU alone."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from fitting.draft.boxes import Box, Shown, boxes_of, coupled_boxes, in_unit, strength_box
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
from fitting.draft.model import COUPLING, FIRST_OUTPUT, UNCOUPLED, Offer
from fitting.draft.questions import Answers, Question
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
from fitting.lines.record import LineResult
from fitting.measurements.noise import THERMAL, WHITE
from fitting.simulate.drive import Drive
from fitting.simulate.response import plan_drive
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, FmuFailure
from fitting.text.notation import hertz, listed
from fitting.text.rendering import blocks, sentence_lines
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
#: Relative error of the simulated amplitudes, and how far, relatively, a tenth of the drive may be
#: from a tenth of the response.
ACCURACY, LINEAR = 1e-6, 1e-4
#: Powers of ten by which the level is lowered, at most; and a level at which a look is taken.
DECADES, WEAK = 9, 1e-3
#: Widths from a line at which it has gone, and what its top then is over that, at least.
AWAY, LEAST_CONTRAST = 5.0, 3.0
#: Step of a logarithm, and change of an amplitude with it, relatively, that counts.
STEP, COUNTS = 0.1, 0.2
#: Forms of amplitudes beside which no campaign has an FMU's.
BEYOND = (FANO, FLOOR, RICE, TAIL)
#: Backgrounds of complex sweeps, and of amplitudes with the remark on them, by the line's form.
BACKGROUNDS = {FANO: "constant", SLOPED: "slope"}
BACKGROUNDS_OF_AMPLITUDES = {
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


#: Amplitude of a response to further start values, a level, and a distance from the line, Hz.
Response = Callable[[Mapping[str, Scalar], float, float], float]


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
    pair = files.two is not None and offer.is_two_modes
    two_lines = files.two is not None and len(offer.places) > 1
    if measured and offer.is_model and line is None and not two_lines:
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
    # what of an FMU is fitted to a line is tried where it begins on its periodic orbit
    response = None
    if table is None and line is not None and offer.steady and tones:
        values = {name: value for name, (value, _) in start.items()}
        response = _response_at(offer, values, tones[0], output, line.frequency.value)
    fitted = _fitted(files, offer, answers, response)
    modes = files.modes if pair else None
    if pair:
        start |= {n: v for n, v in _pair_start(modes).items() if n not in fitted}
    boxes = _boxes(files, offer, fitted, {name: value for name, (value, _) in start.items()})
    level = 1.0 if response is None else _linear_level(response, offer, boxes)
    fixed, derived = _reported(offer, fitted, line, modes)
    # the campaign
    titles = ", ".join(sweep.path.stem for sweep in files.sweeps)
    others = [name for name in offer.outputs if name != output][:4]
    observed = {"output": noted(output, f"or {', '.join(others)}" if others else "the only one")}
    width = min((each.width_hz for each in files.lines), default=0.0)
    if offer.steady:
        observed["steady_start"] = noted(True, "nothing to settle")
    elif width > 0.0:
        words = "of the line: sets the time to settle"
        observed["line_width"] = noted(hertz(width, digits=3), words)
    residual = 0.0 if line is None else line.rms_residual
    scatter = "of the simulation, relative" + ": well below the scatter" * (residual > 0.0)
    reported = "outputs of the FMU that are reported, too"
    tables: dict[str, Any] = {
        "title": titles or (table.path.stem if table else offer.description.model_name),
        "fmu": fmu_table(offer, start, [n for n in TAKEN_VALUES if n in start] if pair else ()),
        "observe": observed,
        "drive": _drive(files, offer, tones, driven, level),
        **_measured(files, _amplitude(files, answers)),
        **fitted_tables(boxes, noted(list(derived), reported) if derived else (), searched=True),
        "accuracy": accuracy_table(residual, scatter, kept=bool(driven)),
    }
    if offer.is_model:
        tables["fmu"]["model"] = noted(offer.name, "shipped with fmu-fit and built on demand")
    # what the results will rest on
    text = blocks("draft/text")
    stated = [*_described(files), *answers.notes, *starts_words(boxes)]
    if pair:
        kind = "" if modes is None else modes.kind
        stated.append(str(text.taken_modes(kind, files.where, files.is_noise)))
    if fixed:
        stated.append(str(text.fixed(fixed)))
    elif modes is not None and not derived and not modes.matches_lines:
        stated.append(str(text.not_reported(modes, offer.derived)))
    if measured:
        return draft_from(tables, offer, folder, stated, undescribed=_undescribed(files, offer))
    name = shlex.quote(offer.name)
    head = "A campaign for this FMU, written by fmu-fit init: what is missing stands at its end."
    missing = MISSING.format(fmu=f"--fmu {name}" if offer.is_model else name)
    return draft_from(tables, offer, folder, stated, ((head, HEAD[1]), missing))


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


def _undescribed(files: Files, offer: Offer) -> str:
    """What the campaign's FMU does not describe of a sweep, and what would help."""
    if files.table is not None:
        return ""
    modes = None if files.pair is None else files.pair.modes
    if offer.is_model and modes is not None and not modes.describes:
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


def _reported(
    offer: Offer, fitted: Sequence[str], line: LineResult | None, modes: TwoModes | None
) -> tuple[list[str], tuple[str, ...]]:
    """Places and widths of further modes, which are held; numbers of the model that are reported.

    The latter are of all modes or, where others are held, of the fitted one; none of coupled modes
    whose own numbers are not those of the lines.
    """
    fixed = []
    if line is not None and len(offer.places) > 1:
        fixed = [n for n in (*offer.places, *offer.widths) if n not in fitted]
    if modes is not None and not modes.matches_lines:
        return fixed, ()
    derived = tuple(n for n in (*offer.derived, *offer.qualities) if n not in fitted)
    marks = {n.rpartition("_")[2] for n in fitted if n in offer.places and "_" in n}
    of_mode = tuple(n for n in derived if n.rpartition("_")[2] in marks)
    return fixed, of_mode if fixed and of_mode else derived


def _pair_start(modes: TwoModes | None) -> dict[str, tuple[Scalar, str]]:
    """Start values that make two modes those of the sweep, with reasons."""
    if modes is None:
        return dict(UNCOUPLED)
    why = "as both lines have it"
    made = {**UNCOUPLED, **THROUGH_COUPLING, COUPLING: (modes.coupling_hz, why)}
    return made | ({STRENGTH: (modes.drive, why)} if modes.kind == DRIVEN else {})


def _boxes(
    files: Files, offer: Offer, fitted: Sequence[str], start: Mapping[str, Scalar]
) -> list[Box]:
    """Boxes of what is fitted, under start values of what is not."""
    # the line that each parameter sets: of two, the first place and width the lower one
    lines, by_name = files.lines, dict[str, Shown]()
    for group in (offer.places, offer.widths):
        names = [name for name in group if name in fitted]
        by_name |= dict(zip(names, lines if len(lines) > 1 else lines * len(names), strict=False))
    boxes = boxes_of(offer, fitted, by_name, start)
    pair = files.two if offer.is_two_modes else None
    if pair is not None and files.modes is not None:
        own = {b.name: b for b in coupled_boxes(offer, files.modes, lines, _of_pair(files))}
        boxes = [own.get(box.name, box) for box in boxes]
    elif pair is not None and STRENGTH in fitted:
        # heights of modes go with g/(f d); the sign is that of the phase between both lines, and
        # amplitudes show it by what lies between
        one, two = (each.frequency_hz * each.width_hz for each in lines)
        size = math.copysign(abs(pair.ratio) * two / one, pair.ratio.real)
        heat = any(sweep.has_own_forces for sweep in files.sweeps)  # drives no mode against another
        why = f"heights, widths and places of the two lines in the {files.where}: g2 goes with them"
        why += "" if heat else "; its sign with the phase between them"
        boxes[fitted.index(STRENGTH)] = strength_box(offer, STRENGTH, size, why, positive=heat)
    for box in boxes:
        if not box.lower < box.start < box.upper:
            raise BadInput(
                f"{box.name}: its start {box.start:g} {box.unit}, {box.why}, is not inside the "
                f"range that the FMU declares, {box.lower:g} to {box.upper:g}; wanted another --fit"
            )
    return boxes


def _of_pair(files: Files) -> tuple[str, ...]:
    """What is fitted of two modes besides places and widths."""
    if files.modes is None:
        return (STRENGTH,)
    return (COUPLING, STRENGTH) if files.modes.kind == DRIVEN else (COUPLING,)


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
    why = f"in {offer.unit(default)} like the file" if alike else FIRST_OUTPUT
    words = "Which output of the FMU does the detector see?"
    return answers.one_of("output", words, offer.outputs, default, why)


def _driven(files: Files, offer: Offer, answers: Answers) -> tuple[list[tuple[str, str]], str]:
    """The tones that drive, or else the input."""
    pairs = dict(offer.tones)
    if pairs and "input" not in answers.requested and files.table is not None:
        names = [c.name for c in files.table.tones]
        if any(name not in pairs for name in names):
            raise BadInput(
                f"{files.table.path}: its tones are called {listed(names)}, the FMU's "
                f"{listed(pairs)}; wanted the FMU's names in the header, or --input"
            )
        return [(name, pairs[name]) for name in names], ""
    if pairs and "input" not in answers.requested:
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
    files: Files, offer: Offer, answers: Answers, response: Response | None
) -> tuple[str, ...]:
    """Parameters: for each line one that sets its place and one that sets its width.

    Those whose line the output shows in a trial, if any does, else by names and units.
    """
    line, known = files.line, offer.description.variables
    places, widths = list(offer.places), list(offer.widths)
    if line is not None:

        def far(name: str) -> float:
            own = offer.start(name)
            known = same_kind(offer.unit(name), "Hz") and own
            return abs(own / line.frequency.value - 1.0) if known else 1e300

        places.sort(key=far)
    trial = {}
    if response is not None and line is not None and len(places) > 1:
        trial = _line_pairs(response, offer, line.frequency.value, line.width.value)
    pair = next(((place, trial[place]) for place in places if place in trial), ())
    mark = places[0][-1:] if places else ""
    widths.sort(key=lambda name: name[-1:] != mark)
    default = pair or (*places[:1], *widths[:1])
    if not default:  # what has a value can be searched about it
        default = tuple(n for n in offer.parameters if known[n].start)[:PER_LINE]
    sets_line = set(default) <= {*offer.places, *offer.widths} and len(default) == PER_LINE
    why = "they set where the line is and how wide" if sets_line else "a guess"
    if files.two is not None and min(len(offer.places), len(offer.widths)) >= 2:
        more = _of_pair(files) if offer.is_two_modes else ()
        default = (*offer.places[:2], *offer.widths[:2], *more)
        why = "they set where the two lines are, how wide" + (" and how high" if more else "")
    why += ", as a trial shows" if pair else ", by their units, names and descriptions"
    return answers.fitted(offer.parameters, default, why)


def _response_at(
    offer: Offer,
    start: Mapping[str, Scalar],
    tone: tuple[str, str],
    output: str,
    frequency_hz: float,
) -> Response:
    """The response of an output to one tone near a line at ``frequency_hz``; NaN where it fails.

    ``tone`` are the parameters of the frequency and of the amplitude that drive.
    """

    def amplitude(values: Mapping[str, Scalar], level: float, away_hz: float) -> float:
        at = frequency_hz + away_hz
        frequency = in_unit(at, offer.unit(tone[0]))
        if frequency is None:
            return math.nan
        driven = {**start, **values, tone[0]: frequency, tone[1]: level}
        drive = Drive(start_values=driven, tones_hz=(at,), outputs=(output,))
        try:
            plan = plan_drive(offer.workers, drive, ACCURACY)
            [samples] = offer.workers.run(plan.runs[:1])
            return float(plan.read(samples)[0, 0])
        except (BadInput, FmuFailure):
            return math.nan

    return amplitude


def _linear_level(response: Response, offer: Offer, boxes: Sequence[Box]) -> float:
    """A power of ten, at most 1, at which the response is in proportion to the drive.

    A line with an unknown drive is fitted with a free scale, and its shape is that of a linear
    response. 1 where no power is found.
    """
    placed = {b.name: convert(b.start, b.unit, offer.unit(b.name), where=b.name) for b in boxes}
    above = response(placed, 1.0, 0.0)
    for decade in range(DECADES):
        level = 10.0**-decade
        below = response(placed, 0.1 * level, 0.0)
        if abs(10.0 * below - above) <= LINEAR * above:
            return level if decade == 0 else 0.1 * level  # the remainder falls with its square
        above = below
    return 1.0


def _line_pairs(
    response: Response, offer: Offer, frequency_hz: float, width_hz: float
) -> dict[str, str]:
    """Parameters that place a line which the output shows, each with the one that widens it."""
    sizes = {name: in_unit(width_hz, offer.unit(name)) for name in offer.widths}
    widths = {name: size for name, size in sizes.items() if size is not None}
    pairs = {}
    for place in offer.places:
        value = in_unit(frequency_hz, offer.unit(place))
        if value is None:
            continue
        placed = {place: value}
        here, away = (response({**widths, **placed}, WEAK, k * width_hz) for k in (0.0, AWAY))
        if not here > LEAST_CONTRAST * away:
            continue
        changes = [(0.0, "")]  # of the logarithm of the top with that of a width
        for name, size in widths.items():
            narrow, wide = (
                response({**placed, name: size * math.exp(step)}, WEAK, 0.0) for step in (0.0, STEP)
            )
            change = math.log(narrow / wide) / STEP if narrow > 0.0 < wide else 0.0
            changes.append((change, name))
        change, width = max(changes)
        if change > COUNTS:
            pairs[place] = width
    return pairs


def _amplitude(files: Files, answers: Answers) -> str:
    """What amplitudes mean, as the campaign declares it."""
    sizes = [sweep.roles.sizes for sweep in (*files.sweeps, *files.spectra)]
    peaks = files.table.peaks if files.table else ()
    units = [c.unit or "" for c in (*peaks, *sizes) if c is not None]
    if files.table is None or meaning(units, "peak") in ("dB", "dBm"):
        return meaning(units, "peak")
    words = "Are the amplitudes in the files peak values or rms?"
    why = "no file states which they are, and a scale takes it out where all mean the same"
    kind = answers.one_of("amplitudes", words, ("peak", "rms"), "peak", why)
    return meaning(units, kind)


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
    elif form in BACKGROUNDS_OF_AMPLITUDES and fitted:
        made["background"] = noted(*BACKGROUNDS_OF_AMPLITUDES[form])
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
