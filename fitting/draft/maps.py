"""A campaign from a map: spectra over a control quantity, and an FMU of two modes that meet.

Sweeps in files of their own, one for each value of the control, are a map as well. The control is
stated by whoever drafts, or found in the files' names ("crossing_Vg=-5.0V.txt") or in the lines
above their tables ("% Vg = -5.0 V"), where it is the one number that differs from file to file.

The closed form of two coupled modes through the map gives start values:

    q1 = N2/(N1 N2 - l^4)      N_i = f_i^2 - u^2 + i u d_i      f1, f2 polynomials of the control

is what one tone on mode 1 makes of it, q1 in units of no interest: every spectrum has a scale of
its own, by least squares. One of the modes stands still where that will do. At the crossing both
lines are gap = l^2/f apart. Starts come from the ridge, the frequencies of the largest amplitudes:
mode 1 shows, so that the ridge follows it where both are far from each other.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial.polynomial import Polynomial, polyfit, polyval

from fitting.campaign.instruments.recording import channel_of
from fitting.draft.document import (
    LIST,
    Answers,
    Draft,
    accuracy_table,
    amplitude_keys,
    columns_of,
    draft_from,
    noted,
    of_whole_file,
    phase_keys,
)
from fitting.draft.model import Box, Offer, Starts, box_of
from fitting.extension.records import Channel
from fitting.measurements.control_sweep import FILE
from fitting.resonance.control_map import TABLES, ControlMap
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
    SQUARES,
    Columns,
    Roles,
    hertz_in,
    lead,
    map_in,
    roles_of,
    unused_columns,
    values_in,
)
from fitting.signal.least_squares import minimise_squares
from fitting.signal.roughness import roughness
from fitting.signal.scale import half_power_width
from fitting.text.arrays import ComplexArray, FloatArray, IntArray
from fitting.text.errors import BadInput, gathered, shown
from fitting.text.notation import hertz, how_many, listed, number
from fitting.text.rendering import blocks, sentence_lines
from fitting.text.units import same_kind

#: Spectra that determine a law, at least; values of a control that may be stated, at most.
LEAST_SPECTRA, MOST_VALUES = 3, 10_000
#: Parameters of an FMU of two modes in their own coordinates, in Hz, and what keeps mode 2 still.
SHARES, READOUT = ("g2", "readout2"), "readout"
PAIR, STILL, OUTPUTS = ("f1", "f2", "lambda12", "d1", "d2"), ("g2", "A2"), ("q1", "readout")
#: Residuals over the noise from which both modes may be driven and read.
BEYOND = 1.5
#: How far slopes of laws may be off, in slopes, and places, in ranges of the frequencies.
STEEP, REACH = 5.0, 0.5
#: Middles of the control over half its range from which its law counts from the middle.
FAR = 3.0
#: Spectra that are fitted, at most; starts that are refined, and evaluations for each.
MOST_SPECTRA, REFINED, ROUNDS = 12, 6, 60
#: Tried: places of the crossing over the control from -1 to 1, and gaps in widths of a line.
PLACES, GAPS = np.linspace(-1.0, 1.0, 9), (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
#: Tried slopes of the tuned mode: in slopes of the ridge, or in spans over half the control; and of
#: the other one, in slopes of the tuned one.
STEEPER, SLOPES = (1.0, 1.5, 2.5), (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
OTHER_SLOPES = (0.0, -2.0, -1.0, -0.5, 0.5)
#: A square of the control counts from this fall of the sum of squares, a second mode from that one,
#: and where each of its three numbers gains so many times what noise would.
BENT, SECOND, BEYOND_NOISE = 0.8, 0.9, 10.0
#: Turns of a cable over a sweep, at most, and steps for each; its share of the sum of squares.
MOST_TURNS, STEPS, CABLE = 40, 16, 0.8
#: Exponents of the logarithms of gap and widths stay below it.
LARGEST = 50.0

#: Control as it is stated: its name, and first:last:step or values, with their unit.
_REQUESTED = re.compile(
    rf"\s*(?P<name>{NAME})\s*(?:=\s*(?:(?P<range>{REAL}:{REAL}:{REAL})|"
    rf"(?P<list>{REAL}(?:\s*,\s*{REAL})*))\s*(?P<unit>{UNIT})?\s*)?"
)


# --- files ---------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class MapFile:
    """Spectra over a control quantity: one table, or a list of files, which ``listing`` is.

    ``roles`` are the columns of the table, or of the first file, ``control_map`` the control and
    its values, ``spectra`` frequencies that rise, (n,), Hz, and values (n,) of each; ``words``
    where the control of several files was found.
    """

    roles: Roles
    control_map: ControlMap
    spectra: tuple[tuple[FloatArray, FloatArray | ComplexArray], ...]
    listing: tuple[tuple[str | Path, ...], ...] = ()
    words: str = ""

    def refused(self, why: str, *, drafted: bool = False) -> BadInput:
        """What to do with it by hand, where no draft can be made of it.

        Args:
            why: no draft can be made.
            drafted: whether another FMU would have one.
        """
        way = self.control_map.way(phases=self.roles.is_complex, drafted=drafted)
        return BadInput(
            f"{self.control_map.path}: is a map, {self.control_map.words}; {why}. {way}"
        )

    def over_one_control(self, answers: Answers) -> MapFile:
        """The map over the control that is asked for, or over the only one.

        Args:
            answers: of flags or a person.

        Raises:
            BadInput: several controls of which none is stated, or that has a value twice.
        """
        names = [c.name for c in self.control_map.controls]
        chosen = names[0]
        if len(names) > 1 or answers.one("control"):
            if answers.ask is None and not answers.one("control"):
                raise self.refused(
                    f"a draft has one control, and {listed(names)} differ from spectrum to "
                    f"spectrum; wanted one of them by --control, as --control {names[0]}, if the "
                    "other changes nothing"
                )
            words = "Which column is the control? All others are taken to change nothing."
            [chosen] = answers.choose("control", names, (), "", words)
        k = names.index(chosen)
        settings = self.control_map.settings[:, [k]]
        if np.unique(settings).size < len(settings):
            raise self.refused(f"'{chosen}' alone has a value twice, wanted a spectrum at each")
        controls = (self.control_map.controls[k],)
        return replace(
            self, control_map=replace(self.control_map, controls=controls, settings=settings)
        )

    def amplitudes(self) -> Spectra:
        """The amplitudes of all spectra.

        Raises:
            BadInput: powers, or a spectrum of zeros.
        """
        sizes = self.roles.sizes
        if sizes is not None and sizes.unit and any(same_kind(sizes.unit, p) for p in SQUARES):
            raise self.refused(f"'{sizes.name}' is a power, wanted its root, an amplitude")
        if not all(np.any(values) for _, values in self.spectra):
            raise self.refused("a spectrum is zero at all frequencies, wanted a resonance")
        sizes_of = [np.abs(values) for _, values in self.spectra]
        return Spectra(self.control_map.settings[:, 0], [f for f, _ in self.spectra], sizes_of)


def _spectrum(
    roles: Roles, rows: IntArray | None = None
) -> tuple[FloatArray, FloatArray | ComplexArray]:
    """Frequencies that rise, Hz, and values there, of a file or of some of its rows."""
    f, values = hertz_in(roles), values_in(roles)[0]
    rows = np.arange(f.size) if rows is None else rows
    rows = rows[np.argsort(f[rows])]
    return f[rows], values[rows]


def map_of_files(
    given: Sequence[tuple[Path, Columns]], answers: Answers, folder: Path, *, joint: bool
) -> MapFile | None:
    """A file that is a map, or several sweeps as one over a control; None of other files.

    Args:
        given: the files, in the order of values that are stated, with what is stated of columns.
        answers: of flags or a person: the control by its name, or of several files with its values,
            as "Vg=-6:6:1"; without it is found.
        folder: in which the campaign and the list of the files will be.
        joint: whether sweeps with phases are one campaign without a control, too.

    Raises:
        BadInput: a map next to other files; several sweeps of amplitudes without a control, or one
            that does not suit them.
    """
    paths, requested = [path for path, _ in given], answers.one("control")
    try:
        roles = gathered([partial(roles_of, *each) for each in given])
        maps = [(each, map_in(each)) for each in roles]
    except BadInput:
        if requested is not None:
            raise
        return None  # the readers of other kinds name the errors
    for each, control_map in maps:
        if control_map is not None:
            spectra = tuple(_spectrum(each, rows) for rows in control_map.rows)
            file = MapFile(roles=each, control_map=control_map, spectra=spectra)
            if len(paths) > 1:
                raise file.refused("wanted it without other files")
            return file.over_one_control(answers)
    if len(paths) < 2 and requested is not None:
        raise BadInput(
            "--control: is a column of a map, or of several sweeps, a file for each value; found "
            f"{how_many(len(paths), 'file')} without such a column"
        )
    phased = any(each.is_complex for each in roles)
    few = len(paths) < (LEAST_SPECTRA if phased else 2)
    if requested is None and (
        few or (phased and joint) or any(stated_density(each) is not None for each in roles)
    ):
        return None

    # the control: its values are stated, or it is the one quantity that differs
    result = None if requested is None else _requested_values(requested, paths)
    if result is None:
        result = differing_quantity(paths, requested)
        if result is None:
            if phased:
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

    # sweeps alike, in the order of the control, which a list of the files states
    order = np.argsort(values, kind="stable")
    settings = np.array([values[k] for k in order])
    paths, roles = [paths[k] for k in order], [roles[k] for k in order]
    kinds = [[(c.name.lower(), c.unit) for c in each.all] for each in roles]
    for path, kind in zip(paths, kinds, strict=True):
        if kind != kinds[0]:
            raise BadInput(
                f"{path}: its columns are not those of {paths[0]}; wanted sweeps alike in one map"
            )
    spectra = tuple(map(_spectrum, roles))
    control = channel_of(name, unit, settings)
    rows = [(f"{v:.12g}", path) for v, path in zip(settings, paths, strict=True)]
    return MapFile(
        roles=roles[0],
        control_map=ControlMap(
            path=folder / LIST,
            controls=(control,),
            settings=settings[:, None],
            rows=tuple(np.arange(f.size) for f, _ in spectra),
        ),
        spectra=spectra,
        listing=((f"{name} ({unit})", FILE), *rows),
        words=str(blocks("draft/text").control(control, settings.tolist(), where)),
    )


def _requested_values(
    text: str, paths: Sequence[Path]
) -> tuple[str, str, str, tuple[float, ...]] | None:
    """A control with values, one for each file, as `differing_quantity` has it; None: a name."""
    match = _REQUESTED.fullmatch(text)
    if match is None:
        raise BadInput(
            f"--control: found {shown(text)}, wanted a name, and values as first:last:step or with "
            "commas, as Vg=-6:6:1"
        )
    name, values = match["name"], tuple(map(float, (match["list"] or "nan").split(",")))
    if match["range"]:
        a, b, step = map(float, match["range"].split(":"))
        count = (b - a) / step if step else math.inf
        if not 0.0 < count < MOST_VALUES or abs(count - round(count)) > 1e-6:
            raise BadInput(f"--control: found {shown(text)}, wanted first:last:step, whole steps")
        steps = np.linspace(a, b, round(count) + 1).tolist()
        values = tuple(float(f"{value:.12g}") for value in steps)
    elif not match["list"]:
        return None
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
    return "as asked for", name, match["unit"] or "1", values


# --- two modes through a map ---------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossing:
    """Two modes, one of which follows the control, as a map shows them.

    Attributes:
        tuned: 1: the mode that is driven and observed follows the control, 2: the other one.
        law: coefficients of its frequency, Hz, of powers of the control, from 0.
        other: those of the other mode, one where it does not follow the control.
        coupling_hz: l.
        widths_hz: full widths of modes 1 and 2.
        gap_hz: between both lines where they come closest.
        place: of the control there, None: beyond what was measured.
        residual: root mean square of the residuals, over the largest amplitude of each spectrum.
        is_observed: whether a second mode is there at all, by the extra sum of squares
            (N. Draper and H. Smith, Applied Regression Analysis).
    """

    tuned: int
    law: tuple[float, ...]
    other: tuple[float, ...]
    coupling_hz: float
    widths_hz: tuple[float, float]
    gap_hz: float
    place: float | None
    residual: float
    is_observed: bool


@dataclass(frozen=True, eq=False)
class Spectra:
    """Amplitudes (n,) over frequencies (n,), Hz, at each value of the control, of a map."""

    control: FloatArray
    frequency_hz: Sequence[FloatArray]
    amplitude: Sequence[FloatArray]

    @cached_property
    def middle(self) -> float:
        """Of the control."""
        return 0.5 * float(np.min(self.control) + np.max(self.control))

    @cached_property
    def half(self) -> float:
        """Half of what the control runs over."""
        return 0.5 * float(np.ptp(self.control))

    @cached_property
    def x(self) -> FloatArray:
        """The control from -1 to 1, (spectra,)."""
        return np.asarray((self.control - self.middle) / self.half)

    @cached_property
    def range_hz(self) -> tuple[float, float]:
        """First and last frequency of all."""
        return min(float(f[0]) for f in self.frequency_hz), max(
            float(f[-1]) for f in self.frequency_hz
        )

    @cached_property
    def width_hz(self) -> float:
        """A typical width of a line, and no less than the points are apart."""
        pairs = zip(self.frequency_hz, self.amplitude, strict=True)
        widths = [half_power_width(f, a) for f, a in pairs]
        apart = float(np.median(np.concatenate([np.diff(f) for f in self.frequency_hz])))
        resolved = [width for width in widths if width > 0.0 and math.isfinite(width)]
        return max(float(np.median(resolved)) if resolved else 0.0, apart)


@dataclass(frozen=True, eq=False)
class _Model:
    """The closed form over a map, as a function of values (degree + other + 5,).

    They are, in spans of the frequencies from their middle, the coefficients of the tuned mode
    (degree + 1) and of the other one (other + 1); logarithms of gap and both widths, in line
    widths. With ``alone`` there is no coupling: mode 1 is all that shows.
    """

    spectra: Spectra
    tuned: int
    degree: int
    other: int = 0
    alone: bool = False

    @cached_property
    def middle_hz(self) -> float:
        return 0.5 * sum(self.spectra.range_hz)

    @cached_property
    def span_hz(self) -> float:
        low, high = self.spectra.range_hz
        return high - low

    def laws(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coefficients of the tuned mode and of the other one."""
        return values[: self.degree + 1], values[self.degree + 1 : self.degree + self.other + 2]

    def places_hz(self, values: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Frequencies of modes 1 and 2 at the control x, without coupling."""
        one, two = (
            np.asarray(self.middle_hz + self.span_hz * polyval(x, law), dtype=float)
            for law in self.laws(values)
        )
        return (one, two) if self.tuned == 1 else (two, one)

    def sizes_hz(self, values: FloatArray) -> tuple[float, float, float]:
        """Gap at the crossing and widths of modes 1 and 2."""
        unit = self.spectra.width_hz
        gap, one, two = (unit * math.exp(min(float(v), LARGEST)) for v in values[-3:])
        return (0.0 if self.alone else gap), one, two

    @cached_property
    def _rows(self) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        """Frequencies, amplitudes over their largest, control and first row of each spectrum."""
        s = self.spectra
        counts = [f.size for f in s.frequency_hz]
        sizes = np.concatenate([a / np.max(a) for a in s.amplitude])
        first = np.repeat(np.arange(len(counts)), counts)
        return np.concatenate(s.frequency_hz), sizes, np.repeat(s.x, counts), first

    def residuals(self, values: FloatArray) -> FloatArray:
        """Of all amplitudes, under a scale of each spectrum by least squares."""
        u, measured, x, group = self._rows
        gap, *widths = self.sizes_hz(values)
        coupling = (gap * self.middle_hz) ** 2
        made = np.abs(_response(u, self.places_hz(values, x), widths, coupling))
        made = made * self.middle_hz * self.spectra.width_hz
        power = np.bincount(group, made**2)
        scale = np.bincount(group, made * measured) / np.maximum(power, 1e-300)
        return np.asarray(scale[group] * made - measured)

    def squares(self, values: FloatArray) -> float:
        rows = self.residuals(values)
        return float(rows @ rows)

    def fitted(self, start: FloatArray) -> tuple[FloatArray, float]:
        """Values of the least sum of squares from a start, and that sum."""
        return minimise_squares(self.residuals, start, rounds=ROUNDS, gain=1e-9)

    def starts(self) -> Iterator[FloatArray]:
        """Where a fit may begin, the tuned mode with a law of a square."""
        # lines and parabolas along the ridge
        s = self.spectra
        pairs = zip(s.frequency_hz, s.amplitude, strict=True)
        ridge_hz = np.array([f[int(np.argmax(a))] for f, a in pairs])
        x, f = s.x, (ridge_hz - self.middle_hz) / self.span_hz
        both = [(i, j) for i, j in itertools.combinations(range(x.size), 2) if x[i] != x[j]]
        slope = float(np.median([(f[j] - f[i]) / (x[j] - x[i]) for i, j in both]))
        ridges = [np.array([float(np.median(f - slope * x)), slope, 0.0])]
        if np.unique(x).size > 3:
            ridges.append(polyfit(x, f, 2))
        if self.alone:
            yield from (np.array([*ridge, 0.0, 0.0, 0.0, 0.0]) for ridge in ridges)
            return
        gaps = [math.log(gap) for gap in GAPS if gap * s.width_hz < self.span_hz]
        still = float(np.median(f))
        for place, gap in itertools.product(map(float, PLACES), gaps):
            if self.tuned == 1:
                # mode 1 follows the ridge or is steeper, and meets the other one at that place
                for ridge, steeper in itertools.product(ridges, STEEPER):
                    law = ridge * np.array([1.0, steeper, steeper])
                    yield np.array([*law, float(polyval(place, law)), gap, 0.0, 0.0])
                continue
            for size, sign in itertools.product(SLOPES, (-1.0, 1.0)):
                law = np.array([still - sign * size * place, sign * size, 0.0])
                yield np.array([*law, still, gap, 0.0, 0.0])


def crossing_of(spectra: Spectra) -> Crossing:
    """The two modes that describe a map best.

    Args:
        spectra: of the map, three or more.
    """
    # a dozen of them at most, over the whole range
    count, fits = spectra.control.size, []
    kept = np.unique(np.round(np.linspace(0, count - 1, MOST_SPECTRA)).astype(int))
    kept = np.argsort(spectra.control)[kept]
    few = Spectra(
        spectra.control[kept],
        [spectra.frequency_hz[k] for k in kept],
        [spectra.amplitude[k] for k in kept],
    )
    # either mode may follow the control, by a law with a square
    for tuned in (1, 2):
        model = _Model(few, tuned, 2)
        starts = sorted(model.starts(), key=model.squares)[:REFINED]
        fits.append((model, *min(map(model.fitted, starts), key=lambda each: each[1])))
    model, values, squares = min(fits, key=lambda each: each[2])
    # the square goes where a straight law leaves hardly more
    straight = replace(model, degree=1)
    fewer, left = straight.fitted(np.delete(values, 2))
    if left * BENT <= squares:
        model, values, squares = straight, fewer, left
    # the other mode follows, too, if a slope of its law is worth it
    rows = model.residuals(values).size
    further, at = replace(model, other=1), model.degree + 2
    tried = [further.fitted(np.insert(values, at, t * values[1])) for t in OTHER_SLOPES]
    best, left = min(tried, key=lambda each: each[1])
    if rows * (squares - left) >= 3.0 * BEYOND_NOISE * left:
        model, values, squares = further, best, left
    lone = _Model(few, 1, 2, alone=True)
    one = min(lone.fitted(start)[1] for start in lone.starts())

    # the same in Hz and in the control's own unit, and where both are closest, if that was measured
    laws = []
    for scaled in model.laws(values):
        domain = [few.middle - few.half, few.middle + few.half]
        plain = Polynomial(scaled, domain=domain).convert().coef
        law = np.zeros(scaled.size)
        law[: plain.size] = model.span_hz * np.asarray(plain, dtype=float)
        law[0] += model.middle_hz
        laws.append(tuple(float(c) for c in law))
    gap, d1, d2 = model.sizes_hz(values)
    x = np.linspace(-1.0, 1.0, 2001)
    k = int(np.argmin(np.abs(np.subtract(*model.places_hz(values, x)))))
    gains = rows * (one - squares) > 3.0 * BEYOND_NOISE * squares
    return Crossing(
        tuned=model.tuned,
        law=laws[0],
        other=laws[1],
        coupling_hz=math.sqrt(gap * model.middle_hz),
        widths_hz=(d1, d2),
        gap_hz=gap,
        place=few.middle + few.half * float(x[k]) if 0 < k < x.size - 1 else None,
        residual=math.sqrt(squares / rows),
        is_observed=squares < SECOND * one and gains,
    )


def _response(
    u: FloatArray,
    places_hz: Sequence[FloatArray | float],
    widths_hz: Sequence[float],
    coupling: float,
) -> ComplexArray:
    """q1 (n,) at frequencies u (n,), Hz, of modes 1 and 2, to a factor; ``coupling`` is l^4."""
    one, two = ((f - u) * (f + u) + 1j * u * d for f, d in zip(places_hz, widths_hz, strict=True))
    return np.asarray(1.0 / (one - coupling / two))


def _phases_of(crossing: Crossing, file: MapFile) -> tuple[bool, bool]:
    """Whether an instrument counts phases the other way, and whether a cable turns them."""
    all_hz = np.concatenate([f for f, _ in file.spectra])
    fewest = min(f.size for f, _ in file.spectra)
    turns = min(MOST_TURNS, fewest // 2) * STEPS
    delays = np.arange(-turns, turns + 1) / (STEPS * float(np.ptp(all_hz)))
    # share of the squares that a gain of each spectrum takes, as they are and reversed, (2, delays)
    shares = np.zeros((2, delays.size))
    controls = file.control_map.settings[:, 0].tolist()
    for control, (f, values) in zip(controls, file.spectra, strict=True):
        places = [float(polyval(control, law)) for law in (crossing.law, crossing.other)]
        places = places if crossing.tuned == 1 else places[::-1]
        made = _response(f, places, crossing.widths_hz, crossing.coupling_hz**4)
        turning = np.exp(2j * np.pi * np.outer(delays, f - f[0]))
        power = np.sum(np.abs(made) ** 2) * np.sum(np.abs(values) ** 2)
        for k, each in enumerate((values, np.conj(values))):
            shares[k] += np.abs(turning @ (each * np.conj(made))) ** 2 / power
    plain, reverse = 1.0 - shares / len(controls)
    is_reversed = float(np.min(reverse)) < float(np.min(plain))
    left = reverse if is_reversed else plain
    return is_reversed, bool(np.min(left) < CABLE * left[turns])


def _exceeds_noise(crossing: Crossing, spectra: Spectra) -> bool:
    """Whether two modes of which one is driven and read leave more of a map than its noise.

    The noise is how points scatter about a smooth curve; spectra of few points do not show it.
    """
    sizes = [a / float(np.max(a)) for a in spectra.amplitude]
    noise = [roughness(a) for a in sizes]
    counts = np.array([a.size for a in sizes])
    expected = float(np.sqrt(np.sum(counts * np.square(noise)) / np.sum(counts)))
    return all(noise) and crossing.residual > BEYOND * expected


# --- the campaign --------------------------------------------------------------------------------


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
    spectra = file.amplitudes()
    crossing = crossing_of(spectra)
    if not crossing.is_observed:
        raise file.refused("it shows one line, and none that it meets")

    # laws count from zero or, where the control is far from it, from its middle
    far = abs(spectra.middle) > FAR * spectra.half
    origin = float(f"{spectra.middle:.3g}") if far else 0.0
    # both modes may be driven and read where one is not enough
    shared = _exceeds_noise(crossing, spectra) and READOUT in outputs
    likely, seen = outputs[0], "mode 1 is driven and observed"
    if shared:
        likely, seen = READOUT, "mode 1 alone leaves more of the map than its noise"
    [output] = answers.choose("output", outputs, [likely], seen)
    shared = shared and output == READOUT
    laws, boxes = _laws(crossing, spectra, control, origin, shared)
    start: Starts = {
        offer.steady: (True, "the FMU begins on its periodic orbit"),
        "A2": (0.0, "one tone drives"),
    }
    if shared:
        why = "free: with mode 1 alone driven and read the misfit exceeds the noise"
        boxes += [offer.box(name, 0.0, why, reach=10.0) for name in SHARES]
    else:
        start["g2"] = (0.0, "it drives mode 1 alone, a guess")
    rotated, delayed = _phases_of(crossing, file) if file.roles.is_complex else (False, False)

    # the tables
    name, roles = TABLES[file.roles.is_complex], file.roles
    of_whole_file(roles, name)
    remark = f"{len(file.control_map.rows)} values, a spectrum for each"
    measured: dict[str, Any] = {"file": file.control_map.path}
    measured["controls"] = noted([control.name], remark)
    if roles.sizes is not None and not roles.is_complex:
        [kind] = answers.requested.get("amplitudes") or ("peak",)
        no_part = "peak or rms plays no part: each spectrum has its own scale"
        measured |= amplitude_keys([roles.sizes.unit or ""], kind, no_part)
    measured |= columns_of(roles) | phase_keys(rotated=rotated, delayed=delayed)
    read = "what the detector reads: " + ("both modes" if shared else "mode 1")
    moved = f"{control.name} moves it, a guess"
    tables: dict[str, Any] = {
        "observe": {
            "output": noted(output, read),
            "steady_start": noted(True, "nothing to settle"),
        },
        "drive": {"kind": "tones", "frequencies": ["u1"], "amplitudes": ["A1"], "level": 1.0},
        name: measured,
        "laws": {variable: noted(law, moved) for variable, law in laws.items()},
        "accuracy": accuracy_table(crossing.residual),
    }
    if origin:
        value = f"{origin:g} {control.unit}"
        tables["constants"] = {f"{control.name}_middle": noted(value, "laws count from here")}
    place = ""
    if crossing.place is not None:
        more = math.log10(max(10.0, abs(crossing.place) / spectra.half))
        place = number(crossing.place, 2 + math.ceil(more))
    result = blocks("draft/text").map(file, crossing, control, place, len(laws) > 1, delayed)
    notes = (*sentence_lines(lead(roles)), *str(result).splitlines())
    taken = roles.all if file.listing else (control, *roles.all)
    return draft_from(
        offer,
        folder,
        answers,
        title=file.control_map.path.stem,
        start=start,
        taken=() if shared else ("g2",),
        measured=tables,
        boxes=boxes,
        notes=(*([file.words] if file.words else []), *notes),
        listing=file.listing,
        unused=[(roles.recording.path, unused_columns(roles.recording, taken))],
    )


def _suited(file: MapFile, offer: Offer, answers: Answers) -> tuple[Channel, tuple[str, ...]]:
    """The control, if a law can have it, and outputs that show mode 1 of an FMU of two modes."""
    known = offer.variables
    outputs = tuple(name for name in OUTPUTS if name in offer.outputs)
    hertzes = all(name in known and same_kind(offer.unit(name), "Hz") for name in PAIR)
    if not (
        hertzes and {*STILL} <= {*known} and "u1" in dict(offer.tones) and offer.steady and outputs
    ):
        why = f"{offer.name} is no FMU of two modes with {listed(PAIR)} in Hz"
        raise file.refused(why, drafted=True)
    for key in ("fit", "tone", "input"):
        if answers.requested.get(key):
            raise BadInput(
                f"--{key}: of a map {listed(PAIR)} are fitted, under one tone; wanted another "
                "choice in the campaign itself"
            )
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


def _laws(
    crossing: Crossing, spectra: Spectra, control: Channel, origin: float, shared: bool
) -> tuple[dict[str, str], list[Box]]:
    """Polynomials of the control less its origin for what follows it, and all that is fitted."""
    low, high = spectra.range_hz
    span, width = high - low, min(crossing.widths_hz)
    why = "two modes laid through the map by least squares"
    unit = control.unit or "1"
    per = "" if unit == "1" else f"/{unit if unit.isalnum() else f'({unit})'}"
    x = f"({control.name} - {control.name}_middle)" if origin else control.name
    laws, boxes = {}, []

    def place(name: str, value: float) -> Box:
        reach = min(REACH * span, 0.5 * value)
        return box_of(name, "Hz", value, why, reach=reach, scale=width)

    modes = {crossing.tuned: crossing.law, 3 - crossing.tuned: crossing.other}
    for letter, (mode, law) in zip("ab", modes.items(), strict=True):
        if len(law) == 1:
            boxes.append(place(f"f{mode}", law[0]))
            continue
        moved = Polynomial(law)(Polynomial([origin, 1.0])).coef
        terms = [f"{letter}0"]
        boxes.append(place(terms[0], float(moved[0])))
        for k, value in enumerate(map(float, moved[1:]), 1):
            power = f"**{k}" if k > 1 else ""
            terms.append(f"{letter}{k}*{x}{power}")
            own = spectra.half**k
            reach = STEEP * max(abs(value), 0.05 * span / own)
            of = f"Hz{per}{power * bool(per)}"
            boxes.append(box_of(f"{letter}{k}", of, value, why, reach=reach, scale=width / own))
        laws[f"f{mode}"] = " + ".join(terms)
    apart = f"{why}: {hertz(crossing.gap_hz, digits=3)} apart at the crossing, and lambda^2 is f "
    boxes.append(box_of("lambda12", "Hz", crossing.coupling_hz, f"{apart}times that"))
    sizes = list(zip(("d1", "d2"), crossing.widths_hz, strict=True))
    if shared:
        # a model that leaves more than the noise has the widths of both together, hardly of each
        sizes = [(name, sum(crossing.widths_hz) / 2) for name, _ in sizes]
    return laws, boxes + [box_of(name, "Hz", size, why) for name, size in sizes]
