"""A campaign from a map: spectra over a control quantity, and an FMU of two modes that meet."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fitting.draft.boxes import Box
from fitting.draft.crossing import Crossing, Spectra, crossing_of, phases_of
from fitting.draft.document import (
    Draft,
    accuracy_table,
    columns_of,
    draft_from,
    fitted_tables,
    fmu_table,
    noted,
    of_whole_file,
    starts_words,
)
from fitting.draft.files import MapFile
from fitting.draft.model import Offer
from fitting.draft.questions import Answers, Question
from fitting.draft.sweeps import LOAD, meaning, phase_keys
from fitting.extension.records import Channel
from fitting.resonance.control_map import PAGE, TABLES
from fitting.resonance.reading import POWERS, hertz_in, lead, values_in
from fitting.signal.roughness import roughness
from fitting.text.arrays import ComplexArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.notation import hertz, listed, number
from fitting.text.rendering import blocks
from fitting.text.sentences import sentence_lines
from fitting.text.units import same_kind

#: Parameters of an FMU of two modes in their own coordinates, in Hz, and what keeps mode 2 still.
SHARES, READOUT = ("g2", "readout2"), "readout"
PAIR, STILL, OUTPUTS = ("f1", "f2", "lambda12", "d1", "d2"), ("g2", "A2"), ("q1", "readout")
#: Residuals over the noise from which both modes may be driven and read, and shares at most.
BEYOND, MOST_SHARE = 1.5, 10.0
#: Spectra that tell a law, at least.
LEAST_SPECTRA = 3
#: How far boxes reach: factors on slopes, couplings and widths, shares of the frequencies' range.
STEEPER, COUPLED, WIDER, REACH = 5.0, (0.1, 3.0), 10.0, 0.5
#: Middles of the control over half its range from which its law counts from the middle.
FAR = 3.0


def map_draft(file: MapFile, offer: Offer, answers: Answers, folder: Path) -> Draft:
    """A campaign from a map and an FMU of two coupled modes.

    Args:
        file: the map.
        offer: what the FMU offers.
        answers: of flags, of a person, or by default.
        folder: of the campaign.

    Raises:
        BadInput: another FMU, a map over several controls or over one that no law can name, one
            that shows a single line; or the draft does not suit, by the campaign's reader.
    """
    outputs = _outputs(offer)
    if not outputs:
        why = f"{offer.name} is no FMU of two modes with {listed(PAIR)} in Hz"
        raise file.refused(why, drafted=True)
    for key in ("fit", "tone", "input"):
        if answers.told.get(key):
            raise BadInput(
                f"--{key}: of a map {listed(PAIR)} are fitted, under one tone; wanted another "
                "choice in the campaign itself"
            )
    control = _control(file, offer)
    words = "Which output of the FMU does the detector see?"
    [output] = answers.of(
        Question(
            key="output",
            words=words,
            options=outputs,
            default=outputs[:1],
            why="mode 1 is driven and observed",
        )
    )
    spectra, values = _spectra(file)
    crossing = crossing_of(spectra)
    if not crossing.is_observed:
        raise file.refused("it shows one line, and none that it meets")
    laws = [_law(f"f{crossing.tuned}", "a", crossing.law, spectra, control)]
    if len(crossing.other) > 1:
        laws.append(_law(f"f{3 - crossing.tuned}", "b", crossing.other, spectra, control))
    shared = _exceeds_noise(crossing, spectra) and READOUT in outputs
    if shared and "output" not in answers.told:
        output = READOUT
    shared = shared and output == READOUT
    boxes = _boxes(crossing, spectra, laws)
    if shared:
        why = "free: with mode 1 alone driven and read the misfit exceeds the noise"
        ends = -MOST_SHARE, MOST_SHARE
        boxes += [_box(name, offer.unit(name), ends, 0.0, 1.0, why) for name in SHARES]
    start: dict[str, tuple[Scalar, str]] = {
        offer.steady: (True, "the FMU begins on its periodic orbit"),
        "A2": (0.0, "one tone drives"),
    }
    if not shared:
        start["g2"] = 0.0, "it drives mode 1 alone, a guess"
    rotated, delayed = phases_of(crossing, spectra, values) if values else (False, False)
    name = TABLES[file.roles.is_complex]
    of_whole_file(file.roles, name)
    measured: dict[str, Any] = {
        "file": file.path,
        "controls": noted([control.name], f"{len(file.found.rows)} values, a spectrum for each"),
    }
    if file.roles.sizes is not None and not file.roles.is_complex:
        kind = (answers.told.get("amplitudes") or ("peak",))[0]
        kind = meaning([file.roles.sizes.unit or ""], kind)
        no_part = "peak or rms plays no part: each spectrum has its own scale"
        measured["amplitude"] = noted(kind, no_part)
        if kind == "dBm":
            measured["impedance"] = noted(LOAD, "plays no part either")
    measured |= columns_of(file.roles)
    measured |= phase_keys(rotated=rotated, delayed=delayed)
    taken = "not measured: leave it out where you know it to be so"
    read = "what the detector reads: both modes" if shared else "what the detector sees: mode 1"
    tables: dict[str, Any] = {
        "title": file.path.stem,
        "fmu": fmu_table(offer, start, () if shared else ("g2",), taken),
        "observe": {
            "output": noted(output, read),
            "steady_start": noted(True, "nothing to settle"),
        },
        "drive": {"kind": "tones", "frequencies": ["u1"], "amplitudes": ["A1"], "level": 1.0},
        name: measured,
        "laws": {v: noted(formula, f"{control.name} moves it, a guess") for v, formula, *_ in laws},
    }
    if origin := _origin(spectra):
        value = f"{origin:g} {control.unit}"
        tables["constants"] = {f"{control.name}_middle": noted(value, "laws count from here")}
    tables |= fitted_tables(boxes, searched=True)
    scatter = "of the simulation, relative: well below the scatter"
    tables["accuracy"] = accuracy_table(crossing.left, scatter, kept=False)
    place = ""
    if crossing.place is not None:
        more = math.log10(max(10.0, abs(crossing.place) / spectra.half))
        place = number(crossing.place, 2 + math.ceil(more))
    result = blocks("draft/text").map(file, crossing, control, place, len(laws) > 1, delayed)
    notes = (*sentence_lines(lead(file.roles)), *str(result).splitlines(), *answers.said)
    head = (
        "A first campaign, written by fmu-fit init from this map: it runs as it is.",
        f"What a remark calls a guess is one; {PAGE} describes maps.",
    )
    return draft_from(tables, offer, folder, (*notes, *starts_words(boxes)), (head, ""))


def _outputs(offer: Offer) -> tuple[str, ...]:
    """Outputs that show mode 1 of an FMU of two modes in their own coordinates; else none."""
    known = offer.description.variables
    places = tuple(name for name in offer.places if name[:1] == "f")
    hertzes = all(n in known and same_kind(known[n].unit or "1", "Hz") for n in PAIR)
    driven = any(frequency == "u1" for frequency, _ in offer.tones)
    still = all(name in known for name in STILL)
    if not (hertzes and still and driven and offer.steady and places == PAIR[:2]):
        return ()
    return tuple(name for name in OUTPUTS if name in offer.outputs)


def _control(file: MapFile, offer: Offer) -> Channel:
    """The control, if a law can have it."""
    result = file.found
    if len(result.controls) > 1:
        raise file.refused("a draft has one control")
    if len(result.rows) < LEAST_SPECTRA:
        raise file.refused(f"wanted {LEAST_SPECTRA} spectra at least, which determine a law")
    [channel] = result.controls
    if channel.name in [taken.name for taken in file.roles.all]:
        raise file.refused("no other column seems the amplitude, wanted its name by --amplitude")
    taken = {*offer.description.variables, "a0", "a1", "a2", "pi", "f"}
    if not channel.name.isidentifier() or channel.name in taken:
        raise file.refused(f"wanted another name than '{channel.name}', one word for laws")
    if channel.unit is None:
        raise file.refused(f"wanted the unit of {channel.name} in the header, 1 where it has none")
    return channel


def _spectra(file: MapFile) -> tuple[Spectra, list[ComplexArray]]:
    """Amplitudes of the map, and its complex values if it has them."""
    sizes = file.roles.sizes
    if sizes is not None and sizes.unit and any(same_kind(sizes.unit, p) for p in POWERS):
        raise file.refused(f"'{sizes.name}' is a power, wanted its root, an amplitude")
    f = hertz_in(file.roles)
    values, _, _ = values_in(file.roles)
    order = [rows[np.argsort(f[rows])] for rows in file.found.rows]
    amplitudes = [np.abs(values[rows]) for rows in order]
    if not all(np.any(each > 0.0) for each in amplitudes):
        raise BadInput(f"{file.path}: a spectrum is zero at all frequencies, wanted a resonance")
    spectra = Spectra(file.found.settings[:, 0], [f[rows] for rows in order], amplitudes)
    phased = order if np.iscomplexobj(values) else []
    return spectra, [np.asarray(values[rows], dtype=complex) for rows in phased]


def _origin(spectra: Spectra) -> float:
    """Where laws count from: zero or, where the control is far from it, its middle."""
    far = abs(spectra.middle) > FAR * spectra.half
    return float(f"{spectra.middle:.3g}") if far else 0.0


def _law(
    variable: str, letter: str, law: Sequence[float], spectra: Spectra, control: Channel
) -> tuple[str, str, str, list[tuple[float, str]]]:
    """The law of a mode: its variable, its formula, and a letter and values of coefficients."""
    origin, unit = _origin(spectra), control.unit or "1"
    moved = np.polynomial.Polynomial(law)(np.polynomial.Polynomial([origin, 1.0])).coef
    x = f"({control.name} - {control.name}_middle)" if origin else control.name
    per = "" if unit == "1" else f"/{unit if unit.isalnum() else f'({unit})'}"
    terms, values = [], []
    for k, value in enumerate(moved):
        power = f"**{k}" if k > 1 else ""
        terms.append(f"{letter}{k}" + (f"*{x}{power}" if k else ""))
        values.append((float(value), "Hz" + (per + power * bool(per) if k else "")))
    return variable, " + ".join(terms), letter, values


def _boxes(
    crossing: Crossing,
    spectra: Spectra,
    laws: Sequence[tuple[str, str, str, list[tuple[float, str]]]],
) -> list[Box]:
    """Boxes of all that is fitted but of shares."""
    low, high = spectra.range_hz
    span, width = high - low, min(crossing.widths_hz)
    why = "two modes laid through the map by least squares"

    def place(name: str, value: float) -> Box:
        reach = min(REACH * span, 0.5 * value)
        return _box(name, "Hz", (value - reach, value + reach), value, width, why)

    made = []
    for _, _, letter, values in laws:
        made.append(place(f"{letter}0", values[0][0]))
        for k, (value, unit) in enumerate(values[1:], 1):
            power = spectra.half**k
            size = STEEPER * max(abs(value), 0.05 * span / power)
            made.append(_box(f"{letter}{k}", unit, (-size, size), value, width / power, why))
    if len(laws) == 1:
        made.append(place(f"f{3 - crossing.tuned}", crossing.other[0]))
    coupling, gap = crossing.coupling_hz, hertz(crossing.gap_hz, digits=3)
    ends = (COUPLED[0] * coupling, COUPLED[1] * coupling)
    apart = f"{why}: {gap} apart at the crossing, and lambda^2 is f times that"
    made.append(_box("lambda12", "Hz", ends, coupling, 0.1 * coupling, apart))
    for name, size in zip(("d1", "d2"), crossing.widths_hz, strict=True):
        made.append(_box(name, "Hz", (size / WIDER, WIDER * size), size, 0.3 * size, why))
    return made


def _box(
    name: str, unit: str, ends: tuple[float, float], start: float, scale: float, why: str
) -> Box:
    digits = 2 - math.floor(math.log10(scale))
    return Box(
        name=name,
        unit=unit,
        lower=round(ends[0], digits),
        upper=round(ends[1], digits),
        start=round(start, digits),
        scale=float(f"{scale:.2g}"),
        why=why,
    )


def _exceeds_noise(crossing: Crossing, spectra: Spectra) -> bool:
    """Whether two modes of which one is driven and read leave more of a map than its noise.

    The noise is how points scatter about a smooth curve; spectra of few points do not tell it.
    """
    sizes = [a / float(np.max(a)) for a in spectra.amplitude]
    noise = [roughness(a) for a in sizes]
    if not all(noise):
        return False
    counts = np.array([a.size for a in sizes])
    expected = float(np.sqrt(np.sum(counts * np.square(noise)) / np.sum(counts)))
    return crossing.left > BEYOND * expected
