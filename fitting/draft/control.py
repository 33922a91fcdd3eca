"""A campaign from a map: spectra over a control quantity, and an FMU of two modes that meet."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fitting.draft.campaign import (
    CONTINUATION,
    Remarks,
    accuracy,
    columns_of,
    meaning,
    of_whole_file,
    parameter_table,
    put_remarks,
)
from fitting.draft.checked import Draft, check_text
from fitting.draft.crossing import Crossing, Spectra, crossing_of, phases_of
from fitting.draft.files import MapFile
from fitting.draft.model import Offer
from fitting.draft.questions import Answers, Question
from fitting.draft.source import Source, relative_path
from fitting.draft.values import Box
from fitting.resonance.control_map import PAGE, TABLES
from fitting.resonance.reading import POWERS, hertz_in, lead, values_in
from fitting.signal.roughness import roughness
from fitting.text.arrays import ComplexArray
from fitting.text.errors import BadInput
from fitting.text.notation import hertz, listed, number
from fitting.text.sentences import sentence_lines
from fitting.text.toml import rewritten, toml_text
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


@dataclass(frozen=True)
class _Control:
    """The quantity that laws count on, and its unit."""

    name: str
    unit: str


@dataclass(frozen=True, kw_only=True)
class _Law:
    """The law of a mode that follows the control, ``origin`` where it counts from."""

    variable: str
    letter: str
    formula: str
    coefficients: tuple[float, ...]
    units: tuple[str, ...]
    constant: str
    origin: float


def map_draft_of(
    file: MapFile, source: Source, offer: Offer, answers: Answers, folder: Path
) -> Draft:
    """A campaign from a map and an FMU of two coupled modes.

    Args:
        file: the map.
        source: the FMU.
        offer: what it offers.
        answers: of flags, of a person, or by default.
        folder: where the campaign will stand.

    Raises:
        BadInput: another FMU, a map over several controls or over one that no law can name, one
            that shows a single line; or the draft does not suit, as the campaign's reader says.
    """
    outputs = _outputs(offer)
    if not outputs:
        why = f"{source.name} is no FMU of two modes with {listed(PAIR)} in Hz"
        raise file.refused(why, drafted=True)
    for key in ("fit", "tone", "input"):
        if answers.told.get(key):
            raise BadInput(
                f"--{key}: of a map {listed(PAIR)} are fitted, under one tone; wanted another "
                "choice in the campaign itself"
            )
    control = _control(file, offer)
    [output] = answers.of(
        Question(
            key="output",
            words="Which output of the FMU does the detector see?",
            options=outputs,
            default=outputs[:1],
            why="mode 1 is driven and seen",
        )
    )
    spectra, values = _spectra(file)
    crossing = crossing_of(spectra)
    if not crossing.is_seen:
        raise file.refused("it shows one line, and none that it meets")
    laws = _laws(crossing, spectra, control)
    free = _exceeds_noise(crossing, spectra) and READOUT in outputs
    if free and "output" not in answers.told:
        output = READOUT
    boxes = _boxes(crossing, spectra, laws)
    if free and output == READOUT:
        boxes += [_share(name, offer) for name in SHARES]
    made = _Written(
        shared=free and output == READOUT,
        file=file,
        source=source,
        steady=offer.steady,
        output=output,
        crossing=crossing,
        laws=laws,
        boxes=tuple(boxes),
        control=control,
        kind=(answers.told.get("amplitudes") or ("peak",))[0],
        phases=phases_of(crossing, spectra, values) if values else (False, False),
    )
    check_text(made.text(None), source)
    said = (*sentence_lines(lead(file.roles)), *_said(made), *answers.said, *_starts(boxes))
    return Draft(text=made.text(folder), said=said)


def _outputs(offer: Offer) -> tuple[str, ...]:
    """Outputs that show mode 1 of an FMU of two modes in their own coordinates; else none."""
    known = offer.description.variables
    places = tuple(name for name in offer.places if name[:1] == "f")
    hertzes = all(n in known and same_kind(known[n].unit or "1", "Hz") for n in PAIR)
    driven = any(tone.frequency == "u1" for tone in offer.tones)
    still = all(name in known for name in STILL)
    if not (hertzes and still and driven and offer.steady and places == PAIR[:2]):
        return ()
    return tuple(name for name in OUTPUTS if name in offer.outputs)


def _control(file: MapFile, offer: Offer) -> _Control:
    """The control, if a law can have it."""
    found = file.found
    if len(found.controls) > 1:
        raise file.refused("a draft has one control")
    if len(found.rows) < LEAST_SPECTRA:
        raise file.refused(f"wanted {LEAST_SPECTRA} spectra at least, which tell a law")
    [channel] = found.controls
    if channel.name in [taken.name for taken in file.roles.all]:
        raise file.refused("no other column seems the amplitude, wanted its name by --amplitude")
    taken = {*offer.description.variables, "a0", "a1", "a2", "pi", "f"}
    if not channel.name.isidentifier() or channel.name in taken:
        raise file.refused(f"wanted another name than '{channel.name}', one word for laws")
    if channel.unit is None:
        raise file.refused(f"wanted the unit of {channel.name} in the header, 1 where it has none")
    return _Control(channel.name, channel.unit)


def _spectra(file: MapFile) -> tuple[Spectra, list[ComplexArray]]:
    """Amplitudes of the map, and its complex values if it has them."""
    sizes = file.roles.sizes
    if sizes is not None and sizes.unit and any(same_kind(sizes.unit, p) for p in POWERS):
        raise file.refused(f"'{sizes.name}' is a power, wanted its root, an amplitude")
    f = hertz_in(file.roles)
    values, _, _ = values_in(file.roles)
    order = [rows[np.argsort(f[rows])] for rows in file.found.rows]
    for rows in order:
        if not np.any(np.abs(values[rows]) > 0.0):
            raise BadInput(
                f"{file.path}: a spectrum is zero at all frequencies, wanted a resonance"
            )
    made = Spectra(
        file.found.settings[:, 0],
        [f[rows] for rows in order],
        [np.abs(values[rows]) for rows in order],
    )
    if not np.iscomplexobj(values):
        return made, []
    return made, [np.asarray(values[rows], dtype=complex) for rows in order]


def _laws(crossing: Crossing, spectra: Spectra, control: _Control) -> tuple[_Law, ...]:
    """Of the modes that follow the control."""
    tuned = crossing.tuned
    laws = [(f"f{tuned}", "a", crossing.law)]
    if len(crossing.other) > 1:
        laws.append((f"f{3 - tuned}", "b", crossing.other))
    return tuple(_law(v, letter, law, spectra, control) for v, letter, law in laws)


def _law(
    variable: str,
    letter: str,
    law: Sequence[float],
    spectra: Spectra,
    control: _Control,
) -> _Law:
    """The polynomial, about zero or, where the control is far from it, about its middle."""
    unit = control.unit
    far = abs(spectra.middle) > FAR * spectra.half
    origin = float(f"{spectra.middle:.3g}") if far else 0.0
    moved = np.polynomial.Polynomial(law)(np.polynomial.Polynomial([origin, 1.0])).coef
    constant = f"{control.name}_middle" if far else ""
    x = f"({control.name} - {constant})" if far else control.name
    per = "" if unit == "1" else f"/{unit if unit.isalnum() else f'({unit})'}"
    terms = [f"{letter}{k}" + (f"*{x}" + f"**{k}" * (k > 1)) * (k > 0) for k in range(len(moved))]
    return _Law(
        variable=variable,
        letter=letter,
        formula=" + ".join(terms),
        coefficients=tuple(float(c) for c in moved),
        units=tuple(
            "Hz" + (per + f"**{k}" * (k > 1 and per != "")) * (k > 0) for k in range(len(moved))
        ),
        constant=constant,
        origin=origin,
    )


def _boxes(crossing: Crossing, spectra: Spectra, laws: Sequence[_Law]) -> list[Box]:
    """Boxes of all that is fitted."""
    low, high = spectra.range_hz
    span, width = high - low, min(crossing.widths_hz)
    why = "two modes laid through the map by least squares"
    made = []
    for law in laws:
        made.append(_place(f"{law.letter}0", law.coefficients[0], span, width, why))
        for k, (value, unit) in enumerate(zip(law.coefficients[1:], law.units[1:], strict=True), 1):
            power = spectra.half**k
            size = STEEPER * max(abs(value), 0.05 * span / power)
            made.append(_box(f"{law.letter}{k}", unit, (-size, size), value, width / power, why))
    if len(laws) == 1:
        made.append(_place(f"f{3 - crossing.tuned}", crossing.other[0], span, width, why))
    coupling, gap = crossing.coupling_hz, hertz(crossing.gap_hz, digits=3)
    ends = (COUPLED[0] * coupling, COUPLED[1] * coupling)
    apart = f"{why}: {gap} apart at the crossing, and lambda^2 is f times that"
    made.append(_box("lambda12", "Hz", ends, coupling, 0.1 * coupling, apart))
    for name, size in zip(("d1", "d2"), crossing.widths_hz, strict=True):
        made.append(_box(name, "Hz", (size / WIDER, WIDER * size), size, 0.3 * size, why))
    return made


def _place(name: str, value: float, span: float, width: float, why: str) -> Box:
    reach = min(REACH * span, 0.5 * value)
    return _box(name, "Hz", (value - reach, value + reach), value, width, why)


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


@dataclass(frozen=True, kw_only=True)
class _Written:
    """What the campaign is written from."""

    file: MapFile
    source: Source
    steady: str
    output: str
    crossing: Crossing
    laws: tuple[_Law, ...]
    boxes: tuple[Box, ...]
    control: _Control
    kind: str
    phases: tuple[bool, bool]
    shared: bool

    @property
    def table(self) -> str:
        return TABLES[self.file.roles.is_complex]

    def text(self, folder: Path | None) -> str:
        """The campaign, its paths relative to a folder; None: absolute."""
        remarks: Remarks = {}
        tables: dict[str, Any] = {"title": self.file.path.stem}
        tables["fmu"] = self._fmu(folder, remarks)
        tables["observe"] = {"output": self.output, "steady_start": True}
        remarks["observe", "output"] = (
            "what the detector reads: both modes"
            if self.shared
            else "what the detector sees: mode 1"
        )
        remarks["observe", "steady_start"] = "nothing to settle"
        tables["drive"] = {
            "kind": "tones",
            "frequencies": ["u1"],
            "amplitudes": ["A1"],
            "level": 1.0,
        }
        tables[self.table] = self._measured(folder, remarks)
        tables["laws"] = {law.variable: law.formula for law in self.laws}
        for law in self.laws:
            remarks["laws", law.variable] = f"{self.control.name} moves it, a guess"
        if constant := self.laws[0].constant:
            tables["constants"] = {constant: f"{self.laws[0].origin:g} {self.control.unit}"}
            remarks["constants", constant] = "laws count from here"
        tables["parameters"] = [
            parameter_table(box, k, remarks) for k, box in enumerate(self.boxes)
        ]
        tables["continuation"] = dict(CONTINUATION)
        remarks["continuation", "nu_start"] = "the prior only helps at the start"
        remarks["continuation", "starts"] = "3: also the lowest minima that a search finds"
        tables["accuracy"] = {"amplitude": accuracy(self.crossing.left, held=False)}
        remarks["accuracy", "amplitude"] = "of the simulation, relative: well below the scatter"
        head = (
            "A first campaign, written by fmu-fit init from this map: it runs as it is.",
            f"What a remark calls a guess is one; {PAGE} tells more of maps.",
        )
        return rewritten(toml_text(tables, head), lambda made: put_remarks(made, remarks))

    def _fmu(self, folder: Path | None, remarks: Remarks) -> dict[str, Any]:
        made: dict[str, Any] = dict(self.source.table(folder))
        made["start"] = {self.steady: True, "A2": 0.0}
        remarks["fmu", "start", self.steady] = "the FMU begins on its periodic orbit"
        remarks["fmu", "start", "A2"] = "one tone drives"
        if not self.shared:
            made["taken"] = ["g2"]
            remarks["fmu", "taken"] = "nobody measured it: leave it out where you know it to be so"
            made["start"]["g2"] = 0.0
            remarks["fmu", "start", "g2"] = "it drives mode 1 alone, a guess"
        return made

    def _measured(self, folder: Path | None, remarks: Remarks) -> dict[str, Any]:
        at, roles = self.table, self.file.roles
        of_whole_file(roles, at)
        made: dict[str, Any] = {
            "file": relative_path(self.file.path, folder),
            "controls": [self.control.name],
        }
        remarks[at, "controls"] = f"{len(self.file.found.rows)} values, a spectrum for each"
        if not roles.is_complex:
            assert roles.sizes is not None  # noqa: S101 - a map without phases has amplitudes
            made["amplitude"] = meaning([roles.sizes.unit or ""], self.kind)
            remarks[at, "amplitude"] = "peak or rms plays no part: each spectrum has its own scale"
            if made["amplitude"] == "dBm":
                made["impedance"] = "50 ohm"
                remarks[at, "impedance"] = "plays no part either"
            return made | columns_of(roles, remarks, (at,))
        made |= columns_of(roles, remarks, (at,))
        turned, cabled = self.phases
        if turned:
            made["conjugate"] = True
            remarks[at, "conjugate"] = "the phase rises over the resonance"
        if cabled:
            made["delay"] = "fit"
            remarks[at, "delay"] = "of the cable: found by comparing"
        return made


def _said(made: _Written) -> list[str]:
    """What the map was found to be."""
    crossing = made.crossing
    kind = "amplitude and phase" if made.file.roles.is_complex else "amplitudes"
    apart = hertz(crossing.gap_hz, digits=3)
    at = "beyond the values that were measured"
    if crossing.place is not None:
        half = 0.5 * float(np.ptp(made.file.found.settings[:, 0]))
        digits = 2 + math.ceil(math.log10(max(10.0, abs(crossing.place) / half)))
        value = number(crossing.place, digits)
        unit = "" if made.control.unit == "1" else made.control.unit
        at = f"at {made.control.name} = {value} {unit}".rstrip()
    left = f"{number(100.0 * crossing.left, 2)} %"
    who = ("the one that is driven and seen", "the one that is not driven")[crossing.tuned - 1]
    who = who if len(made.laws) == 1 else "both"
    said = [
        f"A map of {kind}: {made.file.found.words}.",
        f"Two modes that meet {at}, {apart} apart, leave {left} of the largest amplitude of each "
        f"spectrum, root mean square. {made.control.name} moves {who}.",
    ]
    return said + ["Beside them, found by comparing: the delay of a cable."] * made.phases[1]


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


def _share(name: str, offer: Offer) -> Box:
    """A box of the share of mode 2 in the drive or in the detector, over that of mode 1."""
    return Box(
        name=name,
        unit=offer.unit(name),
        lower=-MOST_SHARE,
        upper=MOST_SHARE,
        start=0.0,
        scale=1.0,
        why="free: with mode 1 alone driven and read the misfit exceeds the noise",
    )


def _starts(boxes: Sequence[Box]) -> list[str]:
    return [f"{box.name}: from {box.start:.9g} {box.unit}, {box.why}." for box in boxes]
