"""A campaign from a map: spectra over a control quantity, and an FMU of two modes that meet.

Sweeps in files of their own, one for each value of the control, are a map as well. The control is
told by whoever drafts, or found in the files' names ("crossing_Vg=-5.0V.txt") or in the lines above
their tables ("% Vg = -5.0 V"), where it is the one number that differs from file to file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fitting.campaign.instruments.recording import channel_of
from fitting.draft.boxes import Box
from fitting.draft.crossing import Crossing, Spectra, crossing_of, phases_of
from fitting.draft.document import (
    LOAD,
    Draft,
    accuracy_table,
    columns_of,
    draft_from,
    fitted_tables,
    fmu_table,
    meaning,
    noted,
    of_whole_file,
    phase_keys,
    relative_path,
    starts_words,
)
from fitting.draft.files import BY_SCATTER, MapFile, noise_look
from fitting.draft.model import Offer
from fitting.draft.questions import Answers
from fitting.extension.records import Channel, Recording
from fitting.measurements.control_tables import FILE
from fitting.resonance.control_map import PAGE, TABLES, ControlMap
from fitting.resonance.file_control import (
    NAME,
    REAL,
    UNIT,
    differing,
    differing_quantity,
    settings_of_name,
)
from fitting.resonance.noise_reading import stated_density
from fitting.resonance.reading import (
    POWERS,
    Columns,
    Roles,
    hertz_in,
    lead,
    map_in,
    roles_of,
    values_in,
)
from fitting.signal.roughness import roughness
from fitting.text.arrays import ComplexArray, Scalar
from fitting.text.errors import BadInput, gathered, shown
from fitting.text.notation import hertz, how_many, listed, number
from fitting.text.rendering import blocks, sentence_lines
from fitting.text.tables import csv_text
from fitting.text.units import same_kind

#: Name of the table that a drafted map of several files reads: the control, and each file.
LIST = "spectra.csv"
#: Sweeps with phases that are a map without being told so, and spectra that determine a law, at
#: least; values of a control that may be told, at most.
LEAST_SPECTRA, MOST_VALUES = 3, 10_000
#: Parameters of an FMU of two modes in their own coordinates, in Hz, and what keeps mode 2 still.
SHARES, READOUT = ("g2", "readout2"), "readout"
PAIR, STILL, OUTPUTS = ("f1", "f2", "lambda12", "d1", "d2"), ("g2", "A2"), ("q1", "readout")
#: Residuals over the noise from which both modes may be driven and read, and shares at most.
BEYOND, MOST_SHARE = 1.5, 10.0
#: How far boxes reach: factors on slopes, couplings and widths, shares of the frequencies' range.
STEEPER, COUPLED, WIDER, REACH = 5.0, (0.1, 3.0), 10.0, 0.5
#: Middles of the control over half its range from which its law counts from the middle.
FAR = 3.0

#: Control as it is told: its name, its values, their unit.
_REQUESTED = re.compile(
    rf"(?P<name>{NAME})\s*(?:[(\[](?P<told>[^()\[\]]*)[)\]])?\s*(?:=\s*(?P<values>.+))?"
)
_RANGE = re.compile(rf"(?P<a>{REAL}):(?P<b>{REAL}):(?P<step>{REAL})\s*(?P<unit>{UNIT})?")
_LIST = re.compile(rf"(?P<list>{REAL}(?:\s*,\s*{REAL})*)\s*(?P<unit>{UNIT})?")
#: Columns of a sweep by the fields of `Roles`.
_FIELDS = ("axis", "sizes", "phase", "real", "imaginary")


#: Laws of the variables that follow a control: formula, and coefficients with their units, by name.
Laws = Mapping[str, tuple[str, Mapping[str, tuple[float, str]]]]


def series_of(
    paths: Sequence[Path], columns: Columns, requested: str | None, folder: Path, *, joint: bool
) -> MapFile | None:
    """Several sweeps as a map over a control; None where they are none, and may be fitted jointly.

    Args:
        paths: of the files, in the order of values that are told.
        columns: what is told of their columns.
        requested: the control by its name, or with its values, as "Vg=-6:6:1"; None: it is found.
        folder: in which the campaign and the list of the files will be.
        joint: whether sweeps with phases are one campaign without a control, too.

    Raises:
        BadInput: several sweeps of amplitudes without a control, or one that does not suit them.
    """
    if len(paths) < 2:
        if requested is not None:
            raise BadInput(
                f"--control: is of several sweeps, a file for each value; found "
                f"{how_many(len(paths), 'file')}"
            )
        return None
    try:
        roles = gathered([partial(roles_of, path, columns) for path in paths])
    except BadInput:
        if requested is not None:
            raise
        return None  # tables of experiments, recordings: their readers complain
    phased = any(each.is_complex for each in roles)
    if requested is None and (
        any(stated_density(each) is not None or map_in(each) is not None for each in roles)
        or (phased and (joint or len(paths) < LEAST_SPECTRA))
    ):
        return None
    match = None if requested is None else _REQUESTED.fullmatch(requested.strip())
    if requested is not None and match is None:
        raise BadInput(
            f"--control: found {shown(requested)}, wanted a name and values, as Vg=-6:6:1"
        )
    if match is not None and match["values"] is not None:
        where, name = "as asked for", match["name"]
        values, unit = _requested_values(match["values"].strip(), requested or "", name, paths)
        unit = match["told"] or unit or "1"
    else:
        result = differing_quantity(paths, requested)
        if result is None:
            look = noise_look(roles[0], hertz_in(roles[0]))
            if phased or (look is not None and look.by == BY_SCATTER):
                return None
            names = listed(path.name for path in paths[:3]) + (", ..." if len(paths) > 3 else "")
            raise BadInput(
                f"{how_many(len(paths), 'sweep')} of amplitudes, {names}: neither their names nor "
                "the lines above their tables contain one quantity that differs from file to file; "
                "wanted it by --control, as --control Vg=-6:6:1 in the order of the files, or one "
                "sweep"
            )
        where, name, unit, values = result
    if len(set(values)) < len(values):
        raise BadInput(f"--control: '{name}' has a value twice, {where}; wanted a sweep at each")
    return _joined(paths, roles, (name, unit, values), where, folder)


def _requested_values(
    text: str, requested: str, name: str, paths: Sequence[Path]
) -> tuple[tuple[float, ...], str]:
    """The values of a control that are told, one for each file, and their unit."""
    steps, several = _RANGE.fullmatch(text), _LIST.fullmatch(text)
    if steps is not None:
        a, b, step = (float(steps[key]) for key in ("a", "b", "step"))
        count = (b - a) / step if step else math.inf
        if not 0.0 < count < MOST_VALUES or abs(count - round(count)) > 1e-6:
            raise BadInput(
                f"--control: found {shown(requested)}, wanted first:last:step, whole steps"
            )
        made = np.linspace(a, b, round(count) + 1)
        values, unit = tuple(float(f"{value:.12g}") for value in made), steps["unit"] or ""
    elif several is not None:
        values, unit = tuple(map(float, several["list"].split(","))), several["unit"] or ""
    else:
        raise BadInput(
            f"--control: found {shown(requested)}, wanted first:last:step, or values with commas"
        )
    if len(values) != len(paths):
        raise BadInput(
            f"--control: {how_many(len(values), 'value')} for {how_many(len(paths), 'file')}; "
            "wanted one for each"
        )
    written = differing([settings_of_name(path) for path in paths]).get(name)
    if written is not None and written[1] != values:
        raise BadInput(
            f"--control: {name} is {values[0]:g} to {values[-1]:g} in the order of the files, but "
            f"{written[1][0]:g} to {written[1][-1]:g} by their names; wanted the values in the "
            "order of the files, or the name alone"
        )
    return values, unit


def _joined(
    paths: Sequence[Path],
    roles: Sequence[Roles],
    control: tuple[str, str, tuple[float, ...]],
    where: str,
    folder: Path,
) -> MapFile:
    """One recording of all points, the files in the order of the control."""
    name, unit, values = control
    order = np.argsort(values, kind="stable")
    settings = np.array([values[k] for k in order])
    paths, roles = [paths[k] for k in order], [roles[k] for k in order]
    columns = [[getattr(each, key) for key in _FIELDS] for each in roles]
    kinds = [[c and (c.name.lower(), c.unit) for c in own] for own in columns]
    for path, kind in zip(paths, kinds, strict=True):
        if kind != kinds[0]:
            raise BadInput(
                f"{path}: its columns are not those of {paths[0]}; wanted sweeps alike in one map"
            )
    # every column of all files, one below the other
    joined: dict[str, Channel | None] = {}
    for key, parts in zip(_FIELDS, zip(*columns, strict=True), strict=True):
        if parts[0] is None:
            joined[key] = None
            continue
        numbers = [column.read() for column in parts]
        joined[key] = replace(parts[0], read=partial(np.concatenate, numbers))
    counts = [len(each.recording.places) for each in roles]
    quantity = channel_of(name, unit, np.repeat(settings, counts))
    table, own = folder / LIST, roles[0].recording
    recording = Recording(
        path=table,
        channels=(
            quantity,
            # in the units of the file, not in those that are told of its columns
            *(replace(c, unit=own.column(c.name).unit) for c in joined.values() if c is not None),
        ),
        places=tuple(
            f"{p.name}, {x}" for p, e in zip(paths, roles, strict=True) for x in e.recording.places
        ),
        words=f"{how_many(len(paths), 'sweep')}, a file for each value of '{name}'",
        layout=own.layout,
        remarks=own.remarks,
    )
    made: dict[str, Any] = {"recording": recording, "left_out": (), **joined}
    rows = np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])
    result = ControlMap(
        path=table, controls=(quantity,), settings=settings[:, None], rows=tuple(rows)
    )
    cells = [[f"{name} ({unit})", FILE]]
    for value, path in zip(settings, paths, strict=True):
        cells.append([f"{value:.12g}", relative_path(path, folder)])
    return MapFile(
        roles=replace(roles[0], **made),
        control_map=result,
        listing=csv_text(cells),
        words=str(blocks("draft/text").control(quantity, settings.tolist(), where)),
    )


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
    control, outputs = _suited(file, offer, answers)
    words = "Which output of the FMU does the detector see?"
    why = "mode 1 is driven and observed"
    output = answers.one_of("output", words, outputs, outputs[0], why)
    spectra, values = _spectra(file)
    crossing = crossing_of(spectra)
    if not crossing.is_observed:
        raise file.refused("it shows one line, and none that it meets")
    # laws count from zero or, where the control is far from it, from its middle
    far = abs(spectra.middle) > FAR * spectra.half
    origin = float(f"{spectra.middle:.3g}") if far else 0.0
    laws = {f"f{crossing.tuned}": _law("a", crossing.law, control, origin)}
    if len(crossing.other) > 1:
        laws[f"f{3 - crossing.tuned}"] = _law("b", crossing.other, control, origin)
    # both modes may be driven and read where one is not enough
    shared = _exceeds_noise(crossing, spectra) and READOUT in outputs
    if shared and "output" not in answers.requested:
        output = READOUT
    shared = shared and output == READOUT
    boxes = _boxes(crossing, spectra, laws)
    start: dict[str, tuple[Scalar, str]] = {
        offer.steady: (True, "the FMU begins on its periodic orbit"),
        "A2": (0.0, "one tone drives"),
    }
    if shared:
        why = "free: with mode 1 alone driven and read the misfit exceeds the noise"
        ends = -MOST_SHARE, MOST_SHARE
        boxes += [_box(name, offer.unit(name), ends, 0.0, 1.0, why) for name in SHARES]
    else:
        start["g2"] = 0.0, "it drives mode 1 alone, a guess"
    rotated, delayed = phases_of(crossing, spectra, values) if values else (False, False)
    name = TABLES[file.roles.is_complex]
    of_whole_file(file.roles, name)
    taken = "not measured: leave it out where you know it to be so"
    read = "what the detector reads: both modes" if shared else "what the detector sees: mode 1"
    moved = f"{control.name} moves it, a guess"
    tables: dict[str, Any] = {
        "title": file.control_map.path.stem,
        "fmu": fmu_table(offer, start, () if shared else ("g2",), taken),
        "observe": {
            "output": noted(output, read),
            "steady_start": noted(True, "nothing to settle"),
        },
        "drive": {"kind": "tones", "frequencies": ["u1"], "amplitudes": ["A1"], "level": 1.0},
        name: _measured(file, answers) | phase_keys(rotated=rotated, delayed=delayed),
        "laws": {variable: noted(law, moved) for variable, (law, _) in laws.items()},
    }
    if origin:
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
    notes = (*sentence_lines(lead(file.roles)), *str(result).splitlines(), *answers.notes)
    head = (
        "A first campaign, written by fmu-fit init from this map: it runs as it is.",
        f"What a remark calls a guess is one; {PAGE} describes maps.",
    )
    return draft_from(tables, offer, folder, (*notes, *starts_words(boxes)), (head, ""))


def _suited(file: MapFile, offer: Offer, answers: Answers) -> tuple[Channel, tuple[str, ...]]:
    """The control, if a law can have it, and outputs that show mode 1 of an FMU of two modes."""
    known = offer.description.variables
    places = tuple(name for name in offer.places if name[:1] == "f")
    hertzes = all(n in known and same_kind(known[n].unit or "1", "Hz") for n in PAIR)
    driven = any(frequency == "u1" for frequency, _ in offer.tones)
    still = all(name in known for name in STILL)
    outputs = tuple(name for name in OUTPUTS if name in offer.outputs)
    is_pair = hertzes and still and driven and offer.steady and places == PAIR[:2]
    if not (is_pair and outputs):
        why = f"{offer.name} is no FMU of two modes with {listed(PAIR)} in Hz"
        raise file.refused(why, drafted=True)
    for key in ("fit", "tone", "input"):
        if answers.requested.get(key):
            raise BadInput(
                f"--{key}: of a map {listed(PAIR)} are fitted, under one tone; wanted another "
                "choice in the campaign itself"
            )
    if len(file.control_map.controls) > 1:
        raise file.refused("a draft has one control")
    if len(file.control_map.rows) < LEAST_SPECTRA:
        raise file.refused(f"wanted {LEAST_SPECTRA} spectra at least, which determine a law")
    [channel] = file.control_map.controls
    if channel.name in [column.name for column in file.roles.all]:
        raise file.refused("no other column seems the amplitude, wanted its name by --amplitude")
    taken = {*known, "a0", "a1", "a2", "pi", "f"}
    if not channel.name.isidentifier() or channel.name in taken:
        raise file.refused(f"wanted another name than '{channel.name}', one word for laws")
    if channel.unit is None:
        raise file.refused(f"wanted the unit of {channel.name} in the header, 1 where it has none")
    return channel, outputs


def _spectra(file: MapFile) -> tuple[Spectra, list[ComplexArray]]:
    """Amplitudes of the map, and its complex values if it has them."""
    sizes = file.roles.sizes
    if sizes is not None and sizes.unit and any(same_kind(sizes.unit, p) for p in POWERS):
        raise file.refused(f"'{sizes.name}' is a power, wanted its root, an amplitude")
    f = hertz_in(file.roles)
    values, _, _ = values_in(file.roles)
    order = [rows[np.argsort(f[rows])] for rows in file.control_map.rows]
    amplitudes = [np.abs(values[rows]) for rows in order]
    if not all(np.any(each > 0.0) for each in amplitudes):
        raise BadInput(
            f"{file.control_map.path}: a spectrum is zero at all frequencies, wanted a resonance"
        )
    spectra = Spectra(file.control_map.settings[:, 0], [f[rows] for rows in order], amplitudes)
    phased = order if np.iscomplexobj(values) else []
    return spectra, [np.asarray(values[rows], dtype=complex) for rows in phased]


def _measured(file: MapFile, answers: Answers) -> dict[str, Any]:
    """The table of a map."""
    made: dict[str, Any] = {
        "file": file.control_map.path,
        "controls": noted(
            [channel.name for channel in file.control_map.controls],
            f"{len(file.control_map.rows)} values, a spectrum for each",
        ),
    }
    if file.roles.sizes is not None and not file.roles.is_complex:
        [kind] = answers.requested.get("amplitudes") or ("peak",)
        kind = meaning([file.roles.sizes.unit or ""], kind)
        no_part = "peak or rms plays no part: each spectrum has its own scale"
        made["amplitude"] = noted(kind, no_part)
        if kind == "dBm":
            made["impedance"] = noted(LOAD, "plays no part either")
    return made | columns_of(file.roles)


def _law(
    letter: str, law: Sequence[float], control: Channel, origin: float
) -> tuple[str, Mapping[str, tuple[float, str]]]:
    """A polynomial of the control less its origin: its formula, and its coefficients by name."""
    unit = control.unit or "1"
    moved = np.polynomial.Polynomial(law)(np.polynomial.Polynomial([origin, 1.0])).coef
    x = f"({control.name} - {control.name}_middle)" if origin else control.name
    per = "" if unit == "1" else f"/{unit if unit.isalnum() else f'({unit})'}"
    terms, coefficients = [], {}
    for k, value in enumerate(moved):
        power = f"**{k}" if k > 1 else ""
        terms.append(f"{letter}{k}" + (f"*{x}{power}" if k else ""))
        coefficients[f"{letter}{k}"] = float(value), "Hz" + (per + power * bool(per) if k else "")
    return " + ".join(terms), coefficients


def _boxes(crossing: Crossing, spectra: Spectra, laws: Laws) -> list[Box]:
    """Boxes of all that is fitted but of shares."""
    low, high = spectra.range_hz
    span, width = high - low, min(crossing.widths_hz)
    why = "two modes laid through the map by least squares"

    def place(name: str, value: float) -> Box:
        reach = min(REACH * span, 0.5 * value)
        return _box(name, "Hz", (value - reach, value + reach), value, width, why)

    boxes = []
    for _, coefficients in laws.values():
        for k, (name, (value, unit)) in enumerate(coefficients.items()):
            power = spectra.half**k
            size = STEEPER * max(abs(value), 0.05 * span / power)
            slope = _box(name, unit, (-size, size), value, width / power, why)
            boxes.append(slope if k else place(name, value))
    if len(laws) == 1:
        boxes.append(place(f"f{3 - crossing.tuned}", crossing.other[0]))
    coupling, gap = crossing.coupling_hz, hertz(crossing.gap_hz, digits=3)
    ends = (COUPLED[0] * coupling, COUPLED[1] * coupling)
    apart = f"{why}: {gap} apart at the crossing, and lambda^2 is f times that"
    boxes.append(_box("lambda12", "Hz", ends, coupling, 0.1 * coupling, apart))
    for name, size in zip(("d1", "d2"), crossing.widths_hz, strict=True):
        boxes.append(_box(name, "Hz", (size / WIDER, WIDER * size), size, 0.3 * size, why))
    return boxes


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
