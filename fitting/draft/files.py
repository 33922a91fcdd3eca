"""Files of measurements as a draft looks at them: which kind each is, and what it shows."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fitting.campaign.instruments.roles import (
    DENSITY,
    HOLDS,
    OBSERVED_UNITS,
    ROOT,
    Density,
    relative_density,
)
from fitting.draft.boxes import REACH, Shown
from fitting.draft.questions import Answers, Question
from fitting.draft.two_modes import COUPLED as COUPLED_MODES
from fitting.draft.two_modes import SEPARATE, TwoModes, two_modes_of
from fitting.extension.records import PLAIN
from fitting.lines.excluded import spike_note, spikes_in
from fitting.lines.line import Line, line_of
from fitting.lines.noise_spectrum import COUPLED, TOGETHER, NoiseFit, noise_lines
from fitting.lines.record import LineResult, line_numbers
from fitting.lines.several import TwoLines, TwoResonances, as_two
from fitting.resonance.control_map import ControlMap
from fitting.resonance.noise_reading import BY_NAME, BY_UNIT, stated_density
from fitting.resonance.reading import (
    AMPLITUDE,
    Columns,
    Roles,
    hertz_in,
    map_in,
    read_trace_of,
    roles_of,
    units_untold,
)
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, gathered
from fitting.text.finding import Finding, Kind, of_kind
from fitting.text.notation import listed
from fitting.text.tables import Column, read_table
from fitting.text.units import same_kind

NOISE, SWEEP = KINDS = ("noise", "sweep")
#: Gain of the logarithm of the likelihood from which the scatter tells, span of the lines over
#: their floor below which it does not, and the least share of itself that a density scatters by.
LEAST_GAIN, SPAN, SHARE = 10.0, 3.0, 0.05
#: Mean square of steps between residuals over that of these: 2 of noise, 0 of a smooth misfit.
ROUGH = 1.0
#: How much less a density has to scatter than its root, where the unit is that of amplitudes.
PLAINLY = 1.5
#: Why a file is taken for a noise spectrum that neither unit nor name calls one.
BY_SCATTER = "scatter"
#: The column that makes a table one of experiments.
LABEL = "experiment"
PHASE_UNITS = ("deg", "rad", "°")
#: Units that a person may answer with, by the field of `Columns` that tells one.
UNITS = {"unit_frequency": ("Hz", "kHz", "MHz", "GHz"), "unit_phase": ("deg", "rad")}
SIGMA_PREFIXES = ("s_", "sigma", "std", "err")


@dataclass(frozen=True, kw_only=True)
class NoiseLook:
    """What a file shows if it is a noise spectrum.

    `by` is why it seems to be one, empty where nothing says so; `holds` what its column holds where
    the unit does not tell it, else empty, and `is_root` whether that is the root of the density;
    `lines` None where it shows none.
    """

    lines: NoiseFit | None
    by: str
    holds: str
    is_root: bool

    @property
    def column(self) -> str:
        """What its column holds, in words."""
        return "root of the density" if self.is_root else "density"

    @property
    def is_sure(self) -> bool:
        """Whether it follows from unit or name, so that no question is needed."""
        return self.by in (BY_UNIT, BY_NAME)

    @property
    def two(self) -> TwoLines | None:
        """Its two lines as those of a sweep; None of others.

        The height of a mode that has a force of its own goes with g/(f^2 w), of modes under one
        force with the square of g/(f w): `ratio` is what makes g of both alike.
        """
        lines = self.lines
        if lines is None or len(lines.lines) < 2:
            return None
        (f1, w1), (f2, w2) = ((line.frequency.value, line.width.value) for line in lines.lines)
        a1, a2 = lines.height
        ratio = a2 / a1 * f2 / f1
        if lines.kind == TOGETHER:
            ratio = math.copysign(math.sqrt(abs(a2 / a1)), a2)
        return TwoLines((f1, f2), (w1, w2), complex(ratio))

    @property
    def modes(self) -> TwoModes | None:
        """Its coupled modes; None where it shows none."""
        lines = self.lines
        if lines is None or lines.kind != COUPLED:
            return None
        f1, w1, f2, w2, coupling = lines.modes
        return TwoModes(
            kind=COUPLED_MODES,
            frequency_hz=(f1, f2),
            width_hz=(w1, w2),
            coupling_hz=coupling,
            drive=0.0,
            describes=True,
            lines=(*(x.frequency for x in lines.lines), *(x.width for x in lines.lines)),
        )

    @property
    def residual(self) -> float:
        """By which share of itself it scatters; 0: unknown."""
        return 0.0 if self.lines is None else 1.0 / math.sqrt(max(self.lines.averages, 1.0))


@dataclass(frozen=True, kw_only=True)
class SweepFile:
    """A response over frequency: amplitudes or complex values.

    ``line`` is the resonance that it shows, None where it shows no single one, as ``trouble`` says;
    ``two`` are those that it shows if there are two, ``modes`` what describes them, and
    ``phases_reversed`` whether their phases rise over a resonance. ``noise`` is what it shows if it
    is a noise spectrum, ``is_noise`` whether it is taken for one: then the rest is of that, too.
    """

    path: Path
    roles: Roles
    reading: tuple[Finding, ...]
    line: LineResult | None
    trouble: str = ""
    two: TwoLines | None = None
    modes: TwoModes | None = None
    phases_reversed: bool = False
    noise: NoiseLook | None = None
    is_noise: bool = False

    @property
    def driven_line(self) -> Line | None:
        """The line of a sweep, with all that was found of it; None of a noise spectrum."""
        return self.line if isinstance(self.line, Line) else None

    @property
    def is_complex(self) -> bool:
        """Whether it has phases."""
        return self.roles.is_complex

    @property
    def has_own_forces(self) -> bool:
        """Whether it is a noise spectrum of two modes that heat moves, each by itself."""
        lines = None if self.noise is None else self.noise.lines
        single = lines is None or len(lines.lines) < 2 or lines.kind == TOGETHER
        return self.is_noise and not single

    def as_noise(self) -> SweepFile:
        """The same, taken for a noise spectrum."""
        look = self.noise
        if look is None:
            return self
        reading = []
        for each in self.reading:
            names = dict(each.names)
            if each.kind is Kind.file_read:  # its sizes are those of a density, not amplitudes
                roles = names["roles"]
                names["roles"] = tuple(look.column if r == AMPLITUDE else r for r in roles)
            if each.kind is Kind.file_remark:
                text = names["text"][0].replace("the amplitude:", f"the {look.column}:")
                names["text"] = (text,)
            if each.kind is not Kind.values_converted:
                reading.append(replace(each, names=names))
        lines, line, trouble = look.lines, None, ""
        if lines is None:
            trouble = f"{self.path}: shows no line as a noise spectrum that its points resolve"
        elif look.two is None:  # its single line, without errors, and its scatter
            f, width = lines.lines[0].frequency.value, lines.lines[0].width.value
            numbers = line_numbers((f, math.nan), (width, math.nan), (f / width, math.nan))
            line = LineResult(**numbers, unit="1", rms_residual=look.residual)
        return replace(
            self,
            is_noise=True,
            reading=tuple(reading),
            line=line,
            two=look.two,
            modes=look.modes,
            phases_reversed=False,
            trouble=trouble,
        )


@dataclass(frozen=True, kw_only=True)
class MapFile:
    """Spectra over a control quantity in one table: ``control_map`` says which.

    Of several files that make one, ``listing`` is the text of the table that lists them, and
    ``words`` the sentence on what the control is and where it was found.
    """

    roles: Roles
    control_map: ControlMap
    listing: str = ""
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


@dataclass(frozen=True, kw_only=True)
class TableFile:
    """A table of experiments: a row each, with the frequencies of its tones.

    ``tones`` are the columns of frequencies, ``peaks`` those of amplitudes, one per tone (none:
    there are spectra), ``sigmas`` and ``phases`` next to them.
    """

    path: Path
    labels: tuple[str, ...]
    tones: tuple[Column, ...]
    peaks: tuple[Column, ...]
    sigmas: tuple[Column, ...]
    phases: tuple[Column, ...]


@dataclass(frozen=True, kw_only=True)
class Files:
    """All files: sweeps, and perhaps a table of experiments with a spectrum for each; or a map."""

    sweeps: tuple[SweepFile, ...]
    table: TableFile | None = None
    map: MapFile | None = None
    spectra: tuple[SweepFile, ...] = ()
    pattern: str = ""

    @property
    def line(self) -> LineResult | None:
        """The resonance of the first sweep that shows one."""
        return next((sweep.line for sweep in self.sweeps if sweep.line is not None), None)

    @property
    def is_noise(self) -> bool:
        """Whether the first of them is a noise spectrum."""
        return any(sweep.is_noise for sweep in self.sweeps[:1])

    @property
    def where(self) -> str:
        """What shows the lines, in words."""
        return "spectrum" if self.is_noise else "sweep"

    @property
    def lines(self) -> list[Shown]:
        """The lines that they show, the lower one first; none where neither one nor two are known.

        The place of one of two is off by no more than half the way to the other.
        """
        line, two, where = self.line, self.two, self.where
        result: list[tuple[str, float, float, float]] = []
        if line is not None:
            f, w = line.frequency.value, line.width.value
            result = [(f"the line in the {where}", f, w, math.inf)]
        elif two is not None:
            half = 0.5 * (two.frequency_hz[1] - two.frequency_hz[0])
            names = (f"the {each} line in the {where}" for each in ("lower", "upper"))
            pairs = zip(names, two.frequency_hz, two.width_hz, strict=True)
            result = [(name, f, w, half) for name, f, w in pairs]
        return [
            Shown(
                frequency_hz=f,
                width_hz=w,
                reach_hz=min(REACH * w, most),
                frequency_words=f"frequency of {name}",
                width_words=f"width of {name}",
            )
            for name, f, w, most in result
        ]

    @property
    def pair(self) -> SweepFile | None:
        """The first sweep that shows two resonances, where none shows a single one."""
        if self.line is not None:
            return None
        return next((sweep for sweep in self.sweeps if sweep.two is not None), None)

    @property
    def two(self) -> TwoLines | None:
        """These two resonances."""
        return None if self.pair is None else self.pair.two

    @property
    def modes(self) -> TwoModes | None:
        """What describes them, where it is more than each of them by itself."""
        modes = None if self.pair is None else self.pair.modes
        return None if modes is None or modes.kind == SEPARATE else modes


def files_of(paths: Sequence[Path], columns: Columns, answers: Answers) -> Files:
    """Look at files.

    Args:
        paths: of the files; without any there is no sweep.
        columns: what is told of the sweeps' columns.
        answers: of a person, for units that neither file nor columns tell.

    Raises:
        BadInput: a file that cannot be read; two tables; a table with too many spectra, or none; a
            map beside other files.
    """
    tables = [table for table in map(_table, paths) if table is not None]
    if len(tables) > 1:
        names = ", ".join(str(table.path) for table in tables)
        raise BadInput(f"{names}: are tables of experiments, wanted one in a campaign")
    table = tables[0] if tables else None
    others = [path for path in paths if table is None or path != table.path]
    maps: list[MapFile] = []
    given = [(path, _with_units(path, columns, answers)) for path in others]
    for path, own in given:
        with contextlib.suppress(BadInput):  # its reader complains
            roles = roles_of(path, own)
            if (result := map_in(roles)) is not None:
                maps.append(MapFile(roles=roles, control_map=result))
    if maps and len(paths) > 1:
        raise maps[0].refused("wanted it without other files")
    if maps:
        return Files(sweeps=(), map=maps[0])
    sweeps = tuple(gathered([partial(_sweep, path, own) for path, own in given]))
    if table is None:
        return Files(sweeps=sweeps)
    labels = [label for label in table.labels if label]
    spectra = tuple(f for f in sweeps if any(label in f.path.stem for label in labels))
    if table.peaks and spectra:
        raise BadInput(
            f"{table.path}: has peaks, {', '.join(c.name for c in table.peaks)}, and there are "
            "spectra, too; wanted one or the other"
        )
    if not table.peaks and not spectra:
        raise BadInput(
            f"{table.path}: has no peaks; wanted a column of amplitudes for each of "
            f"{', '.join(c.name for c in table.tones)}, or a spectrum for each experiment, its "
            "file named after it"
        )
    return Files(
        sweeps=tuple(f for f in sweeps if f not in spectra),
        table=table,
        spectra=spectra,
        pattern=_pattern(table, spectra) if spectra else "",
    )


def _with_units(path: Path, columns: Columns, answers: Answers) -> Columns:
    """What is told of a file's columns, with the units that a person answers."""
    if answers.ask is None:
        return columns
    try:
        untold = units_untold(path, columns)
    except BadInput:
        return columns  # its reader complains
    given: dict[str, Any] = {}
    for key, name in untold.items():
        flag, words = key.replace("_", "-"), f"{path.name}: in which unit is column '{name}'?"
        question = Question(key=flag, words=words, options=UNITS[key], default=(), why="")
        [given[key]] = answers.of(question)
    return replace(columns, **given)


def noise_look(roles: Roles, frequency_hz: FloatArray) -> NoiseLook | None:
    """What a file shows if it is a noise spectrum; None where it cannot be one.

    A density that nobody drove scatters by the same share of itself everywhere; a sweep scatters by
    the same amount. With m the lines that follow the points y best, the logarithms of the
    likelihood are

        by a share     -n ln(rms((y - m)/m)) - sum ln m
        by an amount   -n ln(rms(y - m))

    Args:
        roles: of its columns.
        frequency_hz: of its points, shape (n,), Hz.
    """
    channel, table = roles.sizes, roles.recording
    if channel is None or roles.is_complex or np.any(np.diff(frequency_hz) <= 0.0):
        return None
    frequency = table.find(roles.frequency.name)
    plain = table.layout == PLAIN and table.find(channel.name) is not None
    if not plain or frequency is None or frequency.unit is None:
        return None  # no table of text whose frequencies have a unit in their header
    given = stated_density(roles)
    if given is not None:
        return _look(given, frequency_hz)
    numbers, unit = table.numbers(channel), channel.unit or ""
    if np.any(numbers < 0.0) and not unit.startswith("dB"):
        return None
    # without unit or name it is what scatters less, density or root: of a density that is read as
    # a root the squares scatter twice as much
    looks = {
        way: _look(replace(relative_density(numbers, channel.unit, way), holds=way), frequency_hz)
        for way in HOLDS
    }
    left = {
        way: look.residual / (2.0 if way == ROOT else 1.0)
        for way, look in looks.items()
        if look is not None and look.lines is not None
    }
    if any(same_kind(unit, each) for each in OBSERVED_UNITS[:-1]) and DENSITY in left:
        left[DENSITY] *= PLAINLY  # an amplitude by its unit
    look = looks.get(min(left, key=lambda way: left[way], default=""))
    if look is None or look.lines is None:
        return None
    curve = np.sqrt(look.lines.curve) if look.is_root else look.lines.curve
    flat = not float(np.max(curve)) > SPAN * float(np.min(curve))
    if look.residual < SHARE or flat:
        return look
    y = numbers
    if unit.startswith("dB"):
        y = relative_density(numbers, unit, DENSITY).numbers
    shares = (y - curve) / curve
    square = float(np.mean(shares**2))
    # those of noise, next to each other, differ by twice their mean square; a curve that is another
    # leaves residuals that follow each other, and these are not what points scatter by
    if not float(np.mean(np.diff(shares) ** 2)) > ROUGH * square:
        return look
    amount = y.size * math.log(float(np.sqrt(np.mean((y - curve) ** 2))))
    share = y.size * math.log(float(np.sqrt(square)))
    by_share = amount - share - float(np.sum(np.log(curve))) > LEAST_GAIN
    return replace(look, by=BY_SCATTER) if by_share else look


def _look(density: Density, frequency_hz: FloatArray) -> NoiseLook | None:
    result = density.numbers
    if not np.all(np.isfinite(result)) or np.any(result <= 0.0):
        return None
    try:
        lines = noise_lines(frequency_hz, result)
    except ValueError:  # of a line that is not resolved nothing can be drafted
        lines = None
    return NoiseLook(lines=lines, by=density.by, holds=density.holds, is_root=density.is_root)


def _sweep(path: Path, columns: Columns) -> SweepFile:
    roles, trace = roles_of(path, columns), read_trace_of(path, columns)
    line, trouble, two, modes, rising = None, "", None, None, False
    counted = (spike_note(spike, trace.unit, campaign=True) for spike in spikes_in(trace))
    reading = [*trace.reading, *counted]
    try:
        line = line_of(trace)
        rising = line.phases_reversed
        reading += of_kind(line.reading, Kind.top_excluded)
        if line.second is not None:  # a model of two modes describes both
            two = as_two(line, line.second)
            line = None
    except TwoResonances as error:
        trouble, two, rising = str(error), error.lines, error.phases_reversed
    except BadInput as error:
        trouble = str(error)
    if two is not None:
        values = np.conj(trace.values) if rising else trace.values
        modes = two_modes_of(replace(trace, values=values))
    return SweepFile(
        path=path,
        roles=roles,
        reading=tuple(reading),
        line=line,
        trouble=trouble,
        two=two,
        modes=modes,
        phases_reversed=rising,
        noise=noise_look(roles, hertz_in(roles)),
    )


def settled(files: Files, answers: Answers) -> Files:
    """The files, each taken for a noise spectrum or for a sweep, as it tells or as is answered.

    Args:
        files: as they were looked at.
        answers: of flags, of a person, or by default.

    Raises:
        BadInput: an answer that is none.
    """
    if files.table is not None:
        _check_one_sweep([s for s in files.sweeps if not s.is_complex])
        return files
    given = "kind" in answers.requested
    made = []
    for sweep in files.sweeps:
        look, kind = sweep.noise, SWEEP
        if look is None and answers.requested.get("kind") == (NOISE,):
            raise BadInput(
                f"--kind {NOISE}: {sweep.path} cannot be one; wanted a table with a unit of its "
                "frequencies, which rise, and amplitudes or densities above zero"
            )
        if look is not None and look.is_sure and not given:
            kind = NOISE
        elif look is not None and (given or look.by):
            why = "neither unit, name nor scatter indicates noise"
            if look.by == BY_SCATTER:
                why = (
                    "a guess: its points scatter by the same share of themselves everywhere, as "
                    f"the {look.column} of noise does"
                )
            words = "is it a noise spectrum without a drive, or a sweep of amplitudes?"
            default = NOISE if look.by == BY_SCATTER else SWEEP
            kind = answers.one_of("kind", f"{sweep.path.name}: {words}", KINDS, default, why)
        made.append(sweep.as_noise() if kind == NOISE else sweep)
    _check_one_sweep([s for s in made if not (s.is_complex or s.is_noise)])
    return replace(files, sweeps=tuple(made))


def _check_one_sweep(sweeps: Sequence[SweepFile]) -> None:
    """Complain of several sweeps of amplitudes: a campaign has one, and none is dropped."""
    if len(sweeps) > 1:
        names = listed(str(sweep.path) for sweep in sweeps)
        raise BadInput(
            f"{names}: are {len(sweeps)} sweeps of amplitudes, of which a campaign has one; wanted "
            "one of them, or sweeps at values of a quantity by themselves, with --control"
        )


def _table(path: Path) -> TableFile | None:
    """A table of experiments; None for a file of another kind."""
    try:
        table = read_table(path)
    except BadInput:
        return None  # its reader complains, if it is none either
    label = table.find(LABEL)
    if label is None:
        return None
    others = [c for c in table.columns if c is not label]
    tones = tuple(c for c in others if c.unit is not None and same_kind(c.unit, "Hz"))
    phases = tuple(c for c in others if c.unit in PHASE_UNITS)
    sized = [c for c in others if c.unit and c not in tones and c not in phases]
    sigmas = tuple(c for c in sized if c.name.lower().startswith(SIGMA_PREFIXES))
    heights = [c for c in sized if c not in sigmas]
    groups = [[c for c in heights if c.unit == u] for u in dict.fromkeys(c.unit for c in heights)]
    # peaks are the columns of one unit, if there is one for each tone
    peaks = tuple(next((group for group in groups if len(group) == len(tones)), ()))
    if not tones:
        raise BadInput(
            f"{path}: is a table of experiments without a column of frequencies, as 'u1 (MHz)'; "
            "wanted one for each tone of the drive"
        )
    return TableFile(
        path=path,
        labels=table.texts(label),
        tones=tones,
        peaks=peaks,
        sigmas=sigmas if len(sigmas) == len(peaks) else (),
        phases=phases if len(phases) == len(peaks) else (),
    )


def _pattern(table: TableFile, spectra: Sequence[SweepFile]) -> str:
    """Names of the spectra with the label left out, as "spectra/{experiment}.csv"."""
    names = {f.path for f in spectra}
    for label in table.labels:
        for path in sorted(names):
            pattern = path.as_posix().replace(label, "{experiment}")
            wanted = {Path(pattern.replace("{experiment}", each)) for each in table.labels}
            if path.stem.count(label) and wanted <= names:
                return pattern
    missing = [label for label in table.labels if not any(label in p.stem for p in names)]
    raise BadInput(
        f"{table.path}: there is no spectrum for {', '.join(missing) or 'some experiments'}; "
        "wanted a file for each, named alike but for the experiment's name"
    )
