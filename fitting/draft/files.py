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

from fitting.draft.noise import NOISE, SWEEP, NoiseLook, kind_question, noise_look
from fitting.draft.questions import Answers, Question
from fitting.draft.two_modes import BESIDE, TwoModes, two_modes_of
from fitting.lines.excluded import spike_note, spikes_in
from fitting.lines.line import Line, line_of
from fitting.lines.noise_model import TOGETHER
from fitting.lines.record import LineResult, line_numbers
from fitting.lines.several import TwoLines, TwoResonances, as_two
from fitting.resonance.control_map import ControlMap
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
from fitting.text.errors import BadInput, gathered
from fitting.text.finding import Finding, Kind, of_kind
from fitting.text.notation import listed
from fitting.text.tables import Column, read_table
from fitting.text.units import same_kind

#: The column that makes a table one of experiments.
LABEL = "experiment"
PHASE_UNITS = ("deg", "rad", "°")
#: Units that a person may answer with, by the field of `Columns` that tells one.
UNITS = {"unit_frequency": ("Hz", "kHz", "MHz", "GHz"), "unit_phase": ("deg", "rad")}
SIGMA_PREFIXES = ("s_", "sigma", "std", "err")


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
    """Spectra over a control quantity in one table: ``found`` says which."""

    path: Path
    roles: Roles
    found: ControlMap

    def refused(self, why: str, *, drafted: bool = False) -> BadInput:
        """What to do with it by hand, where no draft can be made of it.

        Args:
            why: no draft can be made.
            drafted: whether another FMU would have one.
        """
        way = self.found.way(phases=self.roles.is_complex, drafted=drafted)
        return BadInput(f"{self.path}: is a map, {self.found.words}; {why}. {way}")


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
    def two(self) -> TwoLines | None:
        """The two resonances of the first sweep that shows them, where none shows a single one."""
        if self.line is not None:
            return None
        return next((sweep.two for sweep in self.sweeps if sweep.two is not None), None)

    @property
    def describes_two(self) -> bool:
        """Whether a model of two modes describes these two; so it is, where none was looked at."""
        result = next((s.modes for s in self.sweeps if s.two is not None), None)
        return result is None or result.describes

    @property
    def modes(self) -> TwoModes | None:
        """What describes these two, where it is more than each of them by itself."""
        result = next((s.modes for s in self.sweeps if s.two is not None), None)
        return None if self.line is not None or result is None or result.kind == BESIDE else result


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
                maps.append(MapFile(path=path, roles=roles, found=result))
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
    given = "kind" in answers.told
    made = []
    for sweep in files.sweeps:
        look, kind = sweep.noise, SWEEP
        if look is None and answers.told.get("kind") == (NOISE,):
            raise BadInput(
                f"--kind {NOISE}: {sweep.path} cannot be one; wanted a table with a unit of its "
                "frequencies, which rise, and amplitudes or densities above zero"
            )
        if look is not None and look.is_sure and not given:
            kind = NOISE
        elif look is not None and (given or look.by):
            [kind] = answers.of(kind_question(sweep.path.name, look))
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
