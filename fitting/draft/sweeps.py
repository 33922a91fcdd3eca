"""A campaign of sweeps, noise spectra and tables of experiments, or of an FMU alone.

files -> kind and lines of each (`fitting.lines`) -> what is fitted -> starts and bounds -> tables.

Two lines of one sweep are two modes. With D = f0^2 - f^2 + i f d of each mode by itself, and
k = lambda^2 the coupling,

    separate   S = 1/D1 + g/D2                     each line is a mode, both are observed
    coupled    S = D2/(D1 D2 - k^2)                mode 1 is driven and observed, mode 2 is coupled
    driven     S = (D2 + k g)/(D1 D2 - k^2)        and mode 2 is driven, too

times a gain, and next to a constant where there are phases. The first has lines in phase, or half a
turn apart; of coupled modes of unlike dampings they are not. The simplest one is taken that leaves
no more than noise lets it beyond two lines of any heights and phases (`fitting.lines.several`);
both with one unknown less are equally simple, and the first of them goes before.

The lines of a pair, p = f + i w/2 with residues r, give the begin: z = (r1 p2 + r2 p1)/(r1 + r2) is
where nothing is observed, which is mode 2 of `coupled`, and p1 + p2 - z is mode 1. Amplitudes are
as well those of the mirrored z.
"""

from __future__ import annotations

import contextlib
import math
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import gammaln

from fitting.campaign.instruments.roles import (
    DENSITY,
    HOLDS,
    OBSERVED_UNITS,
    ROOT,
    Density,
    relative_density,
)
from fitting.draft.document import (
    MARK,
    Answers,
    Draft,
    Question,
    accuracy_table,
    amplitude_keys,
    columns_of,
    draft_from,
    in_file,
    noted,
    of_whole_file,
    phase_keys,
)
from fitting.draft.model import (
    COUPLING,
    FIRST_OUTPUT,
    ONE_MODE,
    STRENGTH,
    TWO_MODES,
    UNCOUPLED,
    Box,
    Offer,
    Shown,
    Starts,
    in_unit,
    line_boxes,
    opened_offer,
    shown_lines,
)
from fitting.extension.fmu import HOLD_STEPS
from fitting.extension.records import PLAIN
from fitting.lines import noise_spectrum
from fitting.lines.choice import SIMPLER, chance
from fitting.lines.excluded import spike_note, spikes_in
from fitting.lines.line import Line, line_of
from fitting.lines.names import (
    FANO,
    FLOOR,
    OFFSET,
    RICE,
    SLOPE,
    SLOPED,
    SQUARED,
    TAIL,
    WORDS,
    WORDS_COMPLEX,
)
from fitting.lines.several import TwoLines, TwoResonances, as_two, fit_lines
from fitting.lines.trace import Trace
from fitting.measurements.noise import THERMAL, WHITE
from fitting.resonance.noise_reading import stated_density
from fitting.resonance.reading import (
    Columns,
    Roles,
    hertz_in,
    lead,
    map_in,
    read_trace_of,
    roles_of,
    sweep_roles,
    unused_columns,
)
from fitting.signal.least_squares import minimise_squares
from fitting.text.arrays import FloatArray, Scalar, both_parts
from fitting.text.errors import BadInput, FmuFailure, gathered
from fitting.text.finding import Finding, Kind, of_kind
from fitting.text.notation import hertz, listed
from fitting.text.rendering import blocks, sentence_lines
from fitting.text.tables import Column, read_table
from fitting.text.units import same_kind

NOISE = "noise"
SEPARATE, COUPLED, DRIVEN = MODELS = ("separate", "coupled", "driven")
#: Gain of the logarithm of the likelihood from which the scatter shows noise, span of the lines
#: over their floor below which it does not, and the least share of itself by which it scatters.
LEAST_GAIN, SPAN, SHARE = 10.0, 3.0, 0.05
#: Mean square of steps between residuals over that of these: 2 of noise, 0 of a smooth misfit.
ROUGH = 1.0
#: The column that makes a table one of experiments, and what columns of errors begin with.
LABEL, SIGMA_PREFIXES = "experiment", ("s_", "sigma", "std", "err")
PHASE_UNITS = ("deg", "rad", "°")
#: Units that a person may answer with, by the field of `Columns` that states one.
UNITS = {"unit_frequency": ("Hz", "kHz", "MHz", "GHz"), "unit_phase": ("deg", "rad")}
#: Probability from which noise is why two lines of any phases leave less than two modes.
BY_CHANCE = 0.01
#: Evaluations of a fit of two modes, and the relative fall of the squares at which it ends.
ROUNDS, GAIN = 300, 1e-12
#: Start values of two modes of which the first is driven and observed, and moves the second.
THROUGH_COUPLING: Starts = {
    "readout2": (0.0, "the detector observes mode 1"),
    STRENGTH: (0.0, "the drive moves mode 1, and the coupling mode 2"),
}
#: Widths by which lines of several sweeps differ that are not of one mode.
APART = 3.0
#: Relative error of the simulated amplitudes, and how far, relatively, a tenth of the drive may be
#: from a tenth of the response.
ACCURACY, LINEAR = 1e-6, 1e-4
#: Powers of ten by which the level is lowered, at most; and the level of a trial.
DECADES, WEAK = 9, 1e-3
#: Widths from a line at which it has gone, and what its top then is over that, at least.
AWAY, LEAST_CONTRAST = 5.0, 3.0
#: Step of a logarithm, and change of an amplitude with it, relatively, that counts.
STEP, COUNTS = 0.1, 0.2
#: Forms of amplitudes next to which no campaign has an FMU's.
BEYOND = (FANO, FLOOR, RICE, TAIL)
#: Backgrounds of complex sweeps and of amplitudes with the remark on them, by the line's form.
BACKGROUNDS = {
    (FANO, True): ("constant", "complex, next to the line: from a comparison"),
    (SLOPED, True): ("slope", "complex, next to the line: from a comparison"),
    (FANO, False): ("complex", "of the line by itself, found by comparing"),
    (OFFSET, False): (OFFSET, "a constant next to the line: solved inside"),
    (SLOPED, False): (SLOPE, "with a slope, next to the line: solved inside"),
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


@dataclass(frozen=True)
class TwoModes:
    """Two modes that describe a sweep: `kind` of model, and its values.

    `frequency_hz` and `width_hz` (2,) of each mode by itself, Hz; `coupling_hz` is lambda, Hz,
    `drive` g2, zero where there is none. `describes` is False where even this one leaves more than
    the noise.
    """

    kind: str
    frequency_hz: tuple[float, float]
    width_hz: tuple[float, float]
    coupling_hz: float
    drive: float = 0.0
    describes: bool = True


@dataclass(frozen=True, kw_only=True)
class SweepFile:
    """A response over frequency, or a noise spectrum, with the lines that it shows.

    ``shown`` are its lines, two at most, none where ``trouble`` says why; ``two`` both of them,
    ``modes`` the coupled modes that describe them, ``scatter`` that of the points, relatively, 0:
    unknown. ``line`` is the single line of a sweep, ``density`` what a noise spectrum holds and
    ``noise`` its lines.
    """

    path: Path
    roles: Roles
    reading: tuple[Finding, ...]
    shown: tuple[Shown, ...] = ()
    scatter: float = 0.0
    two: TwoLines | None = None
    modes: TwoModes | None = None
    line: Line | None = None
    density: Density | None = None
    noise: noise_spectrum.NoiseFit | None = None
    trouble: str = ""
    phases_reversed: bool = False

    @property
    def is_noise(self) -> bool:
        """Whether it is a noise spectrum."""
        return self.density is not None

    @property
    def unused(self) -> tuple[str, ...]:
        """Columns that vary and are not taken."""
        return unused_columns(self.roles.recording, self.roles.all)

    @property
    def has_own_forces(self) -> bool:
        """Whether it is the noise of two modes that heat moves, each by itself."""
        lines = self.noise
        return lines is not None and len(lines.lines) > 1 and lines.kind != noise_spectrum.TOGETHER


@dataclass(frozen=True, kw_only=True)
class TableFile:
    """A table of experiments: a row each, with the frequencies of its tones.

    ``tones`` are the columns of frequencies, ``peaks`` those of amplitudes, one per tone (none:
    there are spectra), ``sigmas`` and ``phases`` next to them; ``unused`` names others that vary.
    """

    path: Path
    labels: tuple[str, ...]
    tones: tuple[Column, ...]
    peaks: tuple[Column, ...]
    sigmas: tuple[Column, ...]
    phases: tuple[Column, ...]
    unused: tuple[str, ...]


# --- what files hold -----------------------------------------------------------------------------


def with_units(path: Path, columns: Columns, answers: Answers) -> Columns:
    """What is stated of a file's columns, with the units that a person answers.

    Args:
        path: of the file.
        columns: what is stated of its columns.
        answers: of a person, for units that neither file nor columns state.

    Raises:
        BadInput: all units that are missing, where there is no person.
    """
    try:
        roles = sweep_roles(path, columns)
        control_map = map_in(roles)
    except BadInput:
        return columns  # its reader names the error
    channels = {"unit_frequency": roles.axis, "unit_phase": roles.phase}
    missing = {key: c for key, c in channels.items() if c is not None and c.unit is None}
    if missing and answers.ask is None:
        controls = () if control_map is None else control_map.controls
        heads = [
            f"{path}: states no unit of '{c.name}', over which its spectra are; wanted it in the "
            f"header, as '{c.name} (V)', 1 where it has none"
            for c in controls
            if c.unit is None
        ]
        try:
            roles_of(path, columns)
        except BadInput as error:
            raise BadInput(*error.args, *heads) from error
    given: dict[str, Any] = {}
    for key, channel in missing.items():
        words = f"{path.name}: in which unit is column '{channel.name}'?"
        flag = key.replace("_", "-")
        question = Question(key=flag, words=words, options=UNITS[key], default=(), why="")
        [given[key]] = answers.of(question)
    return replace(columns, **given)


def table_of(path: Path) -> TableFile | None:
    """A table of experiments; None for a file of another kind.

    Args:
        path: of the file.

    Raises:
        BadInput: a table of experiments without frequencies.
    """
    try:
        table = read_table(path)
    except BadInput:
        return None  # its reader names the error, if it is none either
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
    sigmas = sigmas if len(sigmas) == len(peaks) else ()
    phases = phases if len(phases) == len(peaks) else ()
    taken = [label, *tones, *peaks, *sigmas, *phases]
    free = [c for c in table.columns if c not in taken and len({*table.texts(c)}) > 1]
    return TableFile(
        path=path,
        labels=table.texts(label),
        tones=tones,
        peaks=peaks,
        sigmas=sigmas,
        phases=phases,
        unused=tuple(f"'{c.name}'" for c in free),
    )


def _pattern(table: TableFile, sweeps: Sequence[SweepFile]) -> str:
    """Names of its spectra with the label left out, as "{experiment}.csv"; empty: it has peaks."""
    names = {sweep.path for sweep in sweeps}
    missing = [x for x in table.labels if not any(x and x in path.stem for path in names)]
    if table.peaks:
        if len(missing) < len([x for x in table.labels if x]):
            raise BadInput(
                f"{table.path}: has peaks, {listed(c.name for c in table.peaks)}, and there are "
                "spectra, too; wanted one or the other"
            )
        return ""
    for label in filter(None, table.labels):
        for path in sorted(names):
            pattern = path.as_posix().replace(label, "{experiment}")
            wanted = {Path(pattern.replace("{experiment}", each)) for each in table.labels}
            if label in path.stem and wanted <= names:
                return pattern
    raise BadInput(
        f"{table.path}: has neither peaks, a column of amplitudes for each of "
        f"{listed(c.name for c in table.tones)}, nor a spectrum for "
        f"{listed(missing) or 'some experiments'}; wanted one or the other, a file for each "
        "experiment, named alike but for its name"
    )


def _guessed(
    roles: Roles, frequency_hz: FloatArray
) -> tuple[Density, noise_spectrum.NoiseFit, bool] | None:
    """The density that a column may be without its unit or name, and whether its scatter shows it.

    A density that nothing drives scatters by the same share of itself everywhere, a sweep by the
    same amount. With m the lines that follow the points y best, the logarithms of the likelihood
    are

        by a share     -n ln(rms((y - m)/m)) - sum ln m
        by an amount   -n ln(rms(y - m))
    """
    channel = roles.sizes
    if channel is None or roles.is_complex:
        return None
    numbers, unit = roles.recording.numbers(channel), channel.unit or ""
    levels = unit.startswith("dB")
    if not levels and np.any(numbers <= 0.0):
        return None
    ways: tuple[str, ...] = HOLDS
    if levels:
        ways = (DENSITY,)  # in decibels both are one
    elif any(same_kind(unit, each) for each in OBSERVED_UNITS[:-1]):
        ways = (ROOT,)
    tried = []
    for way in ways:
        density = replace(relative_density(numbers, channel.unit, way), holds=way)
        with contextlib.suppress(ValueError):
            lines = noise_spectrum.noise_lines(frequency_hz, density.numbers)
            if lines is not None:
                tried.append((_criterion(density, lines), density, lines))
    if not tried:
        return None
    near = min(criterion for criterion, _, _ in tried) + SIMPLER
    _, density, lines = min(
        (each for each in tried if each[0] <= near), key=lambda each: (each[2].unknowns, each[0])
    )
    curve = np.sqrt(lines.curve) if density.is_root else lines.curve
    y = relative_density(numbers, unit, DENSITY).numbers if levels else numbers
    shares = (y - curve) / curve
    # residuals of another curve follow each other, and are not what points scatter by
    is_rough = float(np.mean(np.diff(shares) ** 2)) > ROUGH * float(np.mean(shares**2))
    tiny = np.finfo(float).tiny  # of points without any scatter
    amount, share = (
        0.5 * y.size * math.log(max(float(np.mean(each**2)), tiny)) for each in (y - curve, shares)
    )
    gains = amount - share - float(np.sum(np.log(curve))) > LEAST_GAIN
    high = float(np.max(curve)) > SPAN * float(np.min(curve))
    return density, lines, is_rough and gains and high and SHARE**2 * lines.averages < 1.0


def _criterion(density: Density, lines: noise_spectrum.NoiseFit) -> float:
    """Akaike's criterion of a column as a density, or as its root, of which it has the lines.

    A density and its root scatter alike; what differs is how many lines they need, and how well
    these follow the points. The likelihood is that of the column itself in both cases.
    """
    p, m = density.numbers, lines.averages
    share = m * p / lines.curve
    column = np.log(2.0) + 0.5 * np.log(p) if density.is_root else 0.0  # d p/d y
    terms = m * np.log(share) - share - gammaln(m) - np.log(p) + column
    return 2.0 * (lines.unknowns + 1) - 2.0 * float(np.sum(terms))


def sweep_of(path: Path, columns: Columns, answers: Answers) -> SweepFile:
    """A file over frequency as the noise spectrum or the sweep that it is, with its lines.

    Args:
        path: of the file.
        columns: what is stated of its columns.
        answers: of flags, of a person, or by default, where neither unit nor name shows its kind.

    Raises:
        BadInput: a file that cannot be read, or that is no noise spectrum where it should be; an
            answer that is none.
    """
    roles = roles_of(path, columns)
    f, kind = hertz_in(roles), answers.one("kind")
    density = None if kind == "sweep" else stated_density(roles)
    # the campaign reads tables of text whose frequencies have a unit in their header
    frequency = roles.recording.find(roles.frequency.name)
    plain = roles.recording.layout == PLAIN and frequency is not None and frequency.unit is not None
    plain = plain and bool(np.all(np.diff(f) > 0.0))
    guessed = _guessed(roles, f) if plain and density is None and kind != "sweep" else None
    if guessed is not None and (kind or guessed[2]):
        density, lines, _ = guessed
        words = f"{path.name}: is it a noise spectrum without a drive, or a sweep of amplitudes?"
        why = "a guess: its points scatter by the same share of themselves everywhere, as the "
        why += f"{'root of the density' if density.is_root else 'density'} of noise does"
        [kind] = answers.choose("kind", (NOISE, "sweep"), [NOISE], why, words)
        density = density if kind == NOISE else None
        if density is not None and not (roles.sizes and roles.sizes.unit):
            text = blocks("draft/text").assumed_density(roles.sizes, density.is_root, lines)
            answers.notes.append(str(text))
    if density is not None and plain and np.all(density.numbers > 0.0):
        return _noise_of(path, roles, density)
    if kind == NOISE:
        raise BadInput(
            f"--kind {NOISE}: {path} cannot be one; wanted a table with a unit of its frequencies, "
            "which rise, and amplitudes or densities above zero"
        )

    # a sweep with one line or two
    trace = read_trace_of(path, columns)
    spikes = (spike_note(spike, trace.unit, campaign=True) for spike in spikes_in(trace))
    # columns that are not used are listed of all files together
    reading = tuple(f for f in trace.reading if f.kind is not Kind.other_columns)
    made = SweepFile(path=path, roles=roles, reading=(*reading, *spikes))
    try:
        line = line_of(trace)
    except TwoResonances as error:
        two, is_reversed = error.lines, error.phases_reversed
    except BadInput as error:
        return replace(made, trouble=str(error))
    else:
        if line.wiring in SQUARED:
            raise BadInput(
                f"{path}: its column of amplitudes looks like a power: the square of a line "
                "describes its points, and a line does not; wanted its root, an amplitude"
            )
        reading = (*made.reading, *of_kind(line.reading, Kind.top_excluded))
        made, is_reversed = replace(made, reading=reading), line.phases_reversed
        both = as_two(line, line.second)
        if both is None:
            shown = _shown([(line.frequency.value, line.width.value)], "sweep")
            made = replace(made, phases_reversed=is_reversed, line=line, shown=shown)
            return replace(made, scatter=line.rms_residual)
        two = both
    values = np.conj(trace.values) if is_reversed else trace.values
    return replace(
        made,
        phases_reversed=is_reversed,
        shown=_shown(zip(two.frequency_hz, two.width_hz, strict=True), "sweep"),
        two=two,
        modes=two_modes_of(replace(trace, values=values)),
    )


def _noise_of(path: Path, roles: Roles, density: Density) -> SweepFile:
    """A noise spectrum with its lines.

    The height of a mode that has a force of its own goes with g/(f^2 w), of modes under one force
    with the square of g/(f w): the ratio is what makes g of both alike.
    """
    reading = lead(roles, "root of the density" if density.is_root else "density")
    made = SweepFile(path=path, roles=roles, reading=reading, density=density)
    lines = None
    with contextlib.suppress(ValueError):  # of a line that is not resolved nothing can be drafted
        lines = noise_spectrum.noise_lines(hertz_in(roles), density.numbers)
    if lines is None:
        trouble = f"{path}: shows no line as a noise spectrum that its points resolve"
        return replace(made, trouble=trouble)
    parts = [(line.frequency.value, line.width.value) for line in lines.lines]
    two = modes = None
    if len(parts) > 1:
        (f1, w1), (f2, w2) = parts
        a1, a2 = lines.height
        ratio = a2 / a1 * f2 / f1
        if lines.kind == noise_spectrum.TOGETHER:
            ratio = math.copysign(math.sqrt(abs(a2 / a1)), a2)
        two = TwoLines((f1, f2), (w1, w2), complex(ratio))
        if lines.kind == noise_spectrum.COUPLED:
            f1, w1, f2, w2, coupling = lines.modes
            modes = TwoModes(COUPLED, (f1, f2), (w1, w2), coupling)
    scatter = 1.0 / math.sqrt(max(lines.averages, 1.0))
    shown = _shown(parts, "spectrum")
    return replace(made, noise=lines, scatter=scatter, shown=shown, two=two, modes=modes)


def _shown(parts: Iterable[tuple[float, float]], where: str) -> tuple[Shown, ...]:
    """Frequencies and widths of one line or two, the lower one first."""
    pairs = list(parts)
    names = ("the line",) if len(pairs) == 1 else ("the lower line", "the upper line")
    return shown_lines(
        [
            Shown(frequency_hz=f, width_hz=w, words=f"{name} in the {where}")
            for name, (f, w) in zip(names, pairs, strict=True)
        ]
    )


# --- two lines of one sweep ----------------------------------------------------------------------


def two_modes_of(trace: Trace) -> TwoModes | None:
    """The simplest model of two modes that describes a trace; None where no two lines fit it.

    A model's unknowns x are shifts of both modes from the middle of the lines and logarithms of
    their widths, both over the larger of the widths and the distance, then k over 2 f0 of it, and
    g; of separate modes g alone.

    Args:
        trace: what was measured.
    """
    f, values = trace.frequency_hz, trace.values if trace.is_complex else trace.amplitude
    pair = fit_lines(f, values, 2)
    if pair is None:
        return None
    y = values / float(np.max(trace.amplitude))
    lines = sorted(
        (
            (line.frequency.value, line.width.value, height)
            for line, height in ((pair, 1.0 + 0j), (pair.others[0], pair.others[0].height))
        ),
        key=lambda each: each[0],
    )
    places, widths = (np.array([line[k] for line in lines]) for k in (0, 1))
    middle, unit = float(np.mean(places)), float(max(np.ptp(places), np.max(widths)))

    def modes(x: FloatArray) -> list[tuple[float, float]]:
        """Frequency and width of each mode by itself, Hz."""
        sizes = unit * np.exp(np.clip(x[2:4], -30.0, 30.0))
        return [(middle + unit * float(x[k]), float(sizes[k])) for k in (0, 1)]

    def residuals(x: FloatArray, kind: str) -> FloatArray:
        """What the best gain, and a constant next to phases, leaves of S."""
        size = 2.0 * middle * unit
        one, two = (((a - f) * (a + f) + 1j * f * w) / size for a, w in modes(x))
        if kind == SEPARATE:
            response = 1.0 / one + x[4] / two
        else:
            response = (two + (x[4] * x[5] if kind == DRIVEN else 0.0)) / (one * two - x[4] ** 2)
        if not trace.is_complex:
            made = np.abs(response)
            return np.asarray(made * float(made @ y) / float(made @ made) - y)
        columns = np.column_stack([response, np.ones(f.size)])
        return both_parts(columns @ np.linalg.lstsq(columns, y, rcond=None)[0] - y)

    # the lowest minimum of each model, and the probability that noise gains as much to two lines
    poles = [complex(p) for p in (places - middle + 0.5j * widths) / unit]
    residues = [line[2] * line[1] for line in lines]
    fits: dict[str, tuple[float, FloatArray]] = {}
    likely: list[str] = []
    for kind in MODELS:
        tried = []
        for start in _mode_starts(kind, poles, residues, is_complex=trace.is_complex):
            with contextlib.suppress(ValueError, np.linalg.LinAlgError):
                fit = minimise_squares(
                    partial(residuals, kind=kind), start, rounds=ROUNDS, gain=GAIN
                )
                tried.append((fit[1], fit[0]))
        if not tried:
            continue
        squares, x = fits[kind] = min(tried, key=lambda each: each[0])
        unknowns = x.size + (4 if trace.is_complex else 1)
        more = pair.squares, pair.unknowns, pair.structure, trace.rows
        if chance(squares, unknowns, *more) > BY_CHANCE:
            likely.append(kind)
    if not fits:
        return None
    kind = likely[0] if likely else min(fits, key=lambda each: fits[each][0])
    x = fits[kind][1]
    coupling, drive = 0.0, float(x[4])
    if kind != SEPARATE:
        coupling = math.sqrt(2.0 * middle * unit * abs(float(x[4])))
        # lambda^2 has a sign of its own, which g2 takes
        drive = math.copysign(float(x[5]), float(x[4] * x[5])) if kind == DRIVEN else 0.0
    (f1, w1), (f2, w2) = modes(x)
    return TwoModes(kind, (f1, f2), (w1, w2), coupling, drive, bool(likely))


def _mode_starts(
    kind: str, poles: Sequence[complex], residues: Sequence[complex], *, is_complex: bool
) -> list[FloatArray]:
    """Where the fit of a model begins, from the poles of two lines and their residues."""
    (p1, p2), (r1, r2) = poles, residues
    z = complex((r1 * p2 + r2 * p1) / (r1 + r2))
    zeros = [z] if is_complex else [z, z.conjugate()]

    def start(one: complex, two: complex, *more: float) -> FloatArray:
        widths = [math.log(2.0 * max(p.imag, 1e-6)) for p in (one, two)]
        return np.array([one.real, two.real, *widths, *more])

    if kind == SEPARATE:  # of both signs: those of the pair may be the mirrored ones
        ratios = {abs((zero - p2) / (p1 - zero)) for zero in zeros if zero != p1}
        return [start(p1, p2, sign * g) for g in sorted(ratios) for sign in (1.0, -1.0)]
    made, least = [], 0.05 * min(p1.imag, p2.imag)
    for zero in zeros:
        # modes with the poles and the zero, as near as a real coupling comes
        two = complex(zero.real, max(zero.imag, least))
        one = p1 + p2 - two
        one = complex(one.real, max(one.imag, least))
        k = math.sqrt(max((-(p1 - two) * (p2 - two)).real, 0.01))
        made += [start(one, two, k, *g) for g in (((0.1,), (-0.1,)) if kind == DRIVEN else ((),))]
    return made


# --- the campaign --------------------------------------------------------------------------------


def sweeps_draft(
    given: Sequence[tuple[Path, Columns]],
    table: TableFile | None,
    answers: Answers,
    fmu: str | Path | None,
    folder: Path,
) -> Draft:
    """A campaign of sweeps, spectra and a table of experiments, or without any of them.

    Args:
        given: files of sweeps and spectra, each with what is stated of its columns.
        table: of experiments; None: there is none.
        answers: of flags, of a person, or by default.
        fmu: the FMU; None: one mode, or two where a file shows two lines.
        folder: of the campaign.

    Raises:
        BadInput: files that are not read, an FMU without what a measurement needs, an answer that
            is none; or files and FMU do not suit each other, by the campaign's own reader.
        FmuFailure: the FMU failed with its own start values.
    """
    # the files, and the first one whose lines are those of the campaign
    sweeps = gathered([partial(sweep_of, *each, answers) for each in given])
    pattern = "" if table is None else _pattern(table, sweeps)
    labels = table.labels if table and pattern else ()
    spectra = [s for s in sweeps if any(x and x in s.path.stem for x in labels)]
    sweeps = [sweep for sweep in sweeps if sweep not in spectra]
    plain = [s for s in sweeps if not s.is_noise and (table or not s.roles.is_complex)]
    if len(plain) > 1:
        raise BadInput(
            f"{listed(str(s.path) for s in plain)}: are {len(plain)} sweeps of amplitudes, of "
            "which a campaign has one; wanted one of them, or sweeps at values of a quantity by "
            "themselves, with --control"
        )
    single = next((sweep for sweep in sweeps if len(sweep.shown) == 1), None)
    main = single or next((sweep for sweep in sweeps if sweep.shown), None)
    if fmu in (None, ONE_MODE):
        _check_one_line(sweeps)
    model = TWO_MODES if main is not None and single is None else ONE_MODE
    with opened_offer(fmu or model, answers.one("interface")) as offer:
        count = 0 if main is None else len(main.shown)
        if (sweeps or table) and offer.is_model and not 0 < count <= len(offer.places):
            trouble = next((sweep.trouble for sweep in sweeps), "")
            raise BadInput(
                trouble or "wanted a sweep as well, which determines frequency and width"
            )
        output = _output(sweeps, offer, answers)
        tones, driven = _driven(table, offer, answers)
        start: Starts = {}
        if offer.steady:
            start[offer.steady] = True, "the FMU begins on its periodic orbit"
        for frequency, amplitude in offer.tones:
            if tones and (frequency, amplitude) not in tones:
                start[amplitude] = 0.0, f"no drive at {frequency}, which was not measured with"

        # what is fitted, and where it starts; a drive so weak that the response is linear
        response = None
        if table is None and single is not None and offer.steady and tones:
            response = _response_at(offer, start, tones[0], output, single.shown[0].frequency_hz)
        boxes = _boxes(main, offer, answers, response, start)
        level = 1.0
        if response is not None:
            level = _linear_level(response, {box.name: box.start for box in boxes})
        fitted = [box.name for box in boxes]
        held: list[str] = []
        if single is not None and len(offer.places) > 1:
            held = [n for n in (*offer.places, *offer.widths) if n not in fitted]

        # the campaign, and what the results will rest on
        others = [name for name in offer.outputs if name != output][:4]
        seen = noted(output, f"or {', '.join(others)}" if others else "the only one")
        observe: dict[str, Any] = {"output": seen}
        if offer.steady:
            observe["steady_start"] = noted(True, "nothing to settle")
        elif main is not None:
            width = hertz(min(line.width_hz for line in main.shown), digits=3)
            observe["line_width"] = noted(width, "of the line: sets the time to settle")
        scatter = 0.0 if single is None else single.scatter
        undescribed = missing = ""
        if not (sweeps or table):
            name = shlex.quote(offer.name)
            missing = MISSING.format(fmu=f"--fmu {name}" if offer.is_model else name)
        elif table is None:
            undescribed = _undescribed(sweeps, main, offer)
        paths = [sweep.path for sweep in sweeps] or ([table.path] if table else [])
        titles = [path.stem for path in paths] or [offer.fmu.workers.description.model_name]
        taken = (STRENGTH, "readout2", COUPLING) if _is_pair(main, offer) else ()
        return draft_from(
            offer,
            folder,
            answers,
            title=", ".join(titles),
            start=start,
            taken=[name for name in taken if name in start],
            measured={
                "observe": observe,
                "drive": _drive(main, table, offer, tones, driven, level),
                **_measured(sweeps, table, pattern, spectra, answers),
                "accuracy": accuracy_table(scatter, kept=bool(driven)),
            },
            boxes=boxes,
            derived=_reported(offer, fitted, held, _coupled(main, offer)),
            notes=_notes(sweeps, main, table, pattern, offer, held),
            undescribed=undescribed,
            missing=missing,
            unused=[
                *((each.path, each.unused) for each in (*sweeps, *spectra[:1])),
                *([] if table is None else [(table.path, table.unused)]),
            ],
        )


def _is_pair(main: SweepFile | None, offer: Offer) -> bool:
    """Whether two lines are those of this project's model of two modes."""
    return main is not None and len(main.shown) > 1 and offer.is_two_modes


def _coupled(main: SweepFile | None, offer: Offer) -> TwoModes | None:
    """The coupled modes of two lines; None of others."""
    modes = main.modes if main is not None and _is_pair(main, offer) else None
    return None if modes is None or modes.kind == SEPARATE else modes


def _notes(
    sweeps: Sequence[SweepFile],
    main: SweepFile | None,
    table: TableFile | None,
    pattern: str,
    offer: Offer,
    held: Sequence[str],
) -> list[str]:
    """What every file was found to be, and what the results will rest on, in sentences."""
    text = blocks("draft/text")
    stated = [line for sweep in sweeps for line in _described(sweep)]
    stated += [str(text.experiments(table, pattern))] if table else []
    if main is not None and _is_pair(main, offer):
        modes = _coupled(main, offer)
        stated.append(str(text.taken_modes(modes.kind if modes else "", main.is_noise)))
    return stated + ([str(text.fixed(held))] if held else [])


def _boxes(
    main: SweepFile | None,
    offer: Offer,
    answers: Answers,
    response: Response | None,
    start: Starts,
) -> list[Box]:
    """What is fitted, with start values and bounds; ``start`` gets what of two modes is held."""
    modes, more = _coupled(main, offer), list[str]()
    if main is not None and _is_pair(main, offer):
        more = [COUPLING] if modes else []
        more += [STRENGTH] if modes is None or modes.kind == DRIVEN else []
    fitted = _fitted(main, more, offer, answers, response)
    held = dict(UNCOUPLED) if more else {}
    if modes is not None:
        held |= {**THROUGH_COUPLING, COUPLING: (modes.coupling_hz, "as both lines have it")}
    start |= {name: value for name, value in held.items() if name not in fitted}

    # of coupled modes both lines follow from what each is by itself
    lines = () if main is None else main.shown
    if modes is not None:
        apart = lines[1].frequency_hz - lines[0].frequency_hz
        room = 2.0 * (apart + max(line.width_hz for line in lines))
        words = "mode {} by itself: with the coupling both lines follow"
        parts = zip((1, 2), modes.frequency_hz, modes.width_hz, strict=True)
        lines = tuple(
            Shown(frequency_hz=f, width_hz=w, words=words.format(k), reach_hz=room)
            for k, f, w in parts
        )
    boxes = line_boxes(offer, fitted, lines, {name: v for name, (v, _) in start.items()})
    if modes is not None and COUPLING in fitted:
        why = "the shape and heights of both lines, which modes without it would not have"
        boxes[COUPLING] = offer.box(COUPLING, modes.coupling_hz, why)
    if modes is not None and STRENGTH in fitted:
        why = "the shape and heights of both lines: mode 2 is driven, too"
        boxes[STRENGTH] = offer.box(STRENGTH, modes.drive, why, signed=True)
    elif more and STRENGTH in fitted and main is not None and main.two is not None:
        # heights of modes go with g/(f d); the sign is that of the phase between both lines, and
        # amplitudes show it by what lies between; heat drives no mode against another
        one, two = (line.frequency_hz * line.width_hz for line in lines)
        size = math.copysign(abs(main.two.ratio) * two / one, main.two.ratio.real)
        why = "heights, widths and places of the two lines: g2 goes with them"
        why += "" if main.has_own_forces else "; its sign with the phase between them"
        boxes[STRENGTH] = offer.box(STRENGTH, size, why, signed=not main.has_own_forces)
    return list(boxes.values())


def _check_one_line(sweeps: Sequence[SweepFile]) -> None:
    """Refuse sweeps that one mode cannot all have: their lines are further apart than wide."""
    single = [(sweep.path, sweep.shown[0]) for sweep in sweeps if len(sweep.shown) == 1]
    for path, line in single[1:]:
        first_path, first = single[0]
        apart = abs(line.frequency_hz - first.frequency_hz)
        if apart > APART * (line.width_hz + first.width_hz):
            raise BadInput(
                f"{path}: shows a line at {hertz(line.frequency_hz, digits=7)}, {first_path} "
                f"one at {hertz(first.frequency_hz, digits=7)}; wanted sweeps of one line, or "
                "--control, the quantity that moves it, as --control Vg=-6:6:1, or --fmu"
            )


def _undescribed(sweeps: Sequence[SweepFile], main: SweepFile | None, offer: Offer) -> str:
    """What the campaign's FMU does not describe of a sweep, and what would help."""
    text = blocks("draft/text")
    modes = None if main is None else main.modes
    if offer.is_model and modes is not None and not modes.describes:
        return str(text.two_and_more())
    for sweep in sweeps:
        line = None if sweep.roles.is_complex else sweep.line
        if line is not None and line.forms[0].name in BEYOND:
            return str(text.undescribed(line, WORDS, offer.is_model))
    return ""


def _described(sweep: SweepFile) -> list[str]:
    """What a file was found to be, in sentences."""
    words, stated, line = blocks("draft/text"), [*sentence_lines(sweep.reading)], sweep.line
    if sweep.is_noise:
        return stated + str(words.noise(sweep.noise)).splitlines()
    if line is not None:
        known = WORDS_COMPLEX if line.is_complex else WORDS
        return stated + str(words.line(line, known.get(line.forms[0].name))).splitlines()
    if sweep.two is not None:
        return [*stated, str(words.two_lines(sweep.two, sweep.roles.is_complex))]
    return [*stated, str(words.no_line(sweep))]


def _reported(
    offer: Offer, fitted: Sequence[str], fixed: Sequence[str], modes: TwoModes | None
) -> tuple[str, ...]:
    """Numbers of the model that are reported: where modes are held, ``fixed``, of the fitted one.

    None of coupled modes, whose own numbers are those of lines of equal dampings.
    """
    if modes is not None:
        return ()
    derived = tuple(n for n in (*offer.derived, *offer.qualities) if n not in fitted)
    marks = {n.rpartition("_")[2] for n in fitted if n in offer.places and "_" in n}
    of_mode = tuple(n for n in derived if n.rpartition("_")[2] in marks)
    return of_mode if fixed and of_mode else derived


def _output(sweeps: Sequence[SweepFile], offer: Offer, answers: Answers) -> str:
    if not offer.outputs:
        raise BadInput(
            f"{offer.name}: has no continuous Real output that is no frequency, wanted one that a "
            "detector can observe"
        )
    sizes = [sweep.roles.sizes or sweep.roles.real for sweep in sweeps]
    unit = next((c.unit for c in sizes if c is not None and c.unit), None)
    alike = [n for n in offer.outputs if unit and same_kind(offer.unit(n), unit)]
    default = (alike or offer.outputs)[0]
    own = offer.unit(default)
    why = f"in {own} like the file" if own == unit else f"in {own}, which suits the file's {unit}"
    why = why if alike else FIRST_OUTPUT
    [output] = answers.choose("output", offer.outputs, [default], why)
    return output


def _driven(
    table: TableFile | None, offer: Offer, answers: Answers
) -> tuple[list[tuple[str, str]], str]:
    """The tones that drive, or else the input."""
    pairs = dict(offer.tones)
    if pairs and "input" not in answers.requested:
        if table is None:
            first = next(iter(pairs))
            names: Sequence[str] = answers.choose(
                "tone", list(pairs), [first], f"its amplitude is {pairs[first]}"
            )
        else:
            names = [c.name for c in table.tones]
        if any(name not in pairs for name in names):
            raise BadInput(
                f"{table.path if table else '--tone'}: its tones are called {listed(names)}, the "
                f"FMU's {listed(pairs)}; wanted the FMU's names in the header, or --input"
            )
        return [(name, pairs[name]) for name in names], ""
    if not offer.inputs:
        raise BadInput(
            f"{offer.name}: has neither a pair of parameters that seem frequency and amplitude of "
            "a tone, nor a Real input, wanted something to drive"
        )
    named = [n for n in offer.inputs if n.lower() in ("force", "f", "b", "u", "drive", "v")]
    why = "the likeliest input by its name"
    [driven] = answers.choose("input", offer.inputs, (named or offer.inputs)[:1], why)
    return [], driven


def _fitted(
    main: SweepFile | None,
    more: Sequence[str],
    offer: Offer,
    answers: Answers,
    response: Response | None,
) -> tuple[str, ...]:
    """Parameters: for each line one that sets its place and one that sets its width.

    Those whose line the output shows in a trial, if any does, else by names and units.
    """
    places, widths = list(offer.places), list(offer.widths)
    why = "they set where the line is and how wide"
    if main is not None and len(main.shown) > 1 and min(len(places), len(widths)) > 1:
        default = (*places[:2], *widths[:2], *more)
        why = "they set where the two lines are, how wide" + (" and how high" if more else "")
        why += ", by their units, names and descriptions"
        return answers.choose("fit", offer.parameters + offer.further, default, why)
    trial: dict[str, str] = {}
    if main is not None and main.shown:
        line = main.shown[0]

        def far(name: str) -> float:
            own = offer.start(name)
            known = same_kind(offer.unit(name), "Hz") and own
            return abs(own / line.frequency_hz - 1.0) if known else math.inf

        places.sort(key=far)
        if response is not None and len(places) > 1:
            trial = _line_pairs(response, offer, line)
    pair = next(((place, trial[place]) for place in places if place in trial), ())
    mark = places[0][-1:] if places else ""
    widths.sort(key=lambda name: name[-1:] != mark)
    default = pair or (*places[:1], *widths[:1])
    if len(default) < 2:
        why = "a guess"
    if not default:  # what has a value can be searched about it
        default = tuple(n for n in offer.parameters if offer.variables[n].start)[:2]
    why += ", as a trial shows" if pair else ", by their units, names and descriptions"
    return answers.choose("fit", offer.parameters + offer.further, default, why)


def _response_at(
    offer: Offer, start: Starts, tone: tuple[str, str], output: str, frequency_hz: float
) -> Response:
    """The response of an output to one tone near a line at ``frequency_hz``; NaN where it fails.

    ``tone`` are the parameters of the frequency and of the amplitude that drive.
    """
    fixed = {name: value for name, (value, _) in start.items()}

    def amplitude(values: Mapping[str, Scalar], level: float, away_hz: float) -> float:
        at = frequency_hz + away_hz
        frequency = in_unit(at, offer.unit(tone[0]))
        if frequency is None:
            return math.nan
        driven = {**fixed, **values, tone[0]: frequency, tone[1]: level}
        try:
            plan = offer.fmu.plan(driven, tones=(tone[0],), outputs=output, accuracy=ACCURACY)
            [samples] = offer.fmu.workers.run(plan.runs[:1])
            return float(plan.read(samples)[0, 0])
        except (BadInput, FmuFailure):
            return math.nan

    return amplitude


def _linear_level(response: Response, placed: Mapping[str, Scalar]) -> float:
    """A power of ten, at most 1, at which the response is in proportion to the drive.

    A line with an unknown drive is fitted with a free scale, and its shape is that of a linear
    response. 1 where no power is found.
    """
    above = response(placed, 1.0, 0.0)
    for decade in range(DECADES):
        level = 10.0**-decade
        below = response(placed, 0.1 * level, 0.0)
        if abs(10.0 * below - above) <= LINEAR * above:
            return level if decade == 0 else 0.1 * level  # the remainder falls with its square
        above = below
    return 1.0


def _line_pairs(response: Response, offer: Offer, line: Shown) -> dict[str, str]:
    """Parameters that place a line which the output shows, each with the one that widens it."""
    sizes = {name: in_unit(line.width_hz, offer.unit(name)) for name in offer.widths}
    widths = {name: size for name, size in sizes.items() if size is not None}
    pairs = {}
    for place in offer.places:
        value = in_unit(line.frequency_hz, offer.unit(place))
        if value is None:
            continue
        placed = {place: value}
        here, away = (response({**widths, **placed}, WEAK, k * line.width_hz) for k in (0.0, AWAY))
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


def _drive(
    main: SweepFile | None,
    table: TableFile | None,
    offer: Offer,
    tones: Sequence[tuple[str, str]],
    driven: str,
    level: float,
) -> dict[str, Any]:
    """The table of the drive: tones of the FMU, or an input for which a signal is made."""
    words = "amplitude of every tone"
    if tones:
        words += f", {offer.unit(tones[0][1])}"
        words += ": small, so that the response is in proportion" * (level < 1.0)
        spectrum = "the spectrum is made of the response to a tone"
        is_noise = main is not None and main.is_noise
        names = [frequency for frequency, _ in tones]
        return {
            "kind": noted("tones", spectrum) if is_noise else "tones",
            "frequencies": noted(names, "parameters of the FMU that hold the tones"),
            "amplitudes": [amplitude for _, amplitude in tones],
            "level": noted(level, words),
        }
    return {
        "kind": "input",
        "frequencies": [c.name for c in table.tones] if table else ["f"],
        "input": noted(driven, "the signal is made here and held over each step"),
        "level": noted(1.0, f"{words}, in the FMU's unit, {offer.unit(driven)}"),
        "samples_per_period": HOLD_STEPS,
    }


def _measured(
    sweeps: Sequence[SweepFile],
    table: TableFile | None,
    pattern: str,
    spectra: Sequence[SweepFile],
    answers: Answers,
) -> dict[str, Any]:
    """Tables of the measurements: of complex sweeps and noise spectra one each, of others one."""
    sizes = [sweep.roles.sizes for sweep in (*sweeps, *spectra)]
    units = [c.unit or "" for c in (*(table.peaks if table else ()), *sizes) if c is not None]
    kind, remark = "peak", "peak or rms plays no part here: the scale is fitted"
    made: dict[str, Any] = {}
    if table is not None:
        remark = "what the file means: peak or rms"
        if not any(unit.startswith("dB") for unit in units):
            why = "no file states which they are, and a scale takes it out where all mean the same"
            [kind] = answers.choose("amplitudes", ("peak", "rms"), ["peak"], why)
        own: dict[str, Any] = {"file": table.path}
        if pattern:
            own["spectra"] = noted(Path(pattern), "a spectrum for each row")
            own |= columns_of(spectra[0].roles)
        else:
            columns = {"peaks": table.peaks, "peak_sigmas": table.sigmas, "phases": table.phases}
            own |= {key: [c.name for c in each] for key, each in columns.items() if each}
        keys = amplitude_keys(units, kind, remark)
        made["experiments"] = own | {"amplitude": keys["amplitude"]}
    amplitude = amplitude_keys(units, kind, remark)
    lists: dict[str, list[SweepFile]] = {"complex_sweep": [], "noise_spectrum": []}
    for sweep in sweeps:
        if table is None and (sweep.is_noise or sweep.roles.is_complex):
            lists["noise_spectrum" if sweep.is_noise else "complex_sweep"].append(sweep)
        else:
            made["sweep"] = _sweep_table(sweep, amplitude, fitted=table is None)
    for name, files in lists.items():
        write = _complex_table if name == "complex_sweep" else _noise_table
        labels = [{"label": file.path.stem} if len(files) > 1 else {} for file in files]
        if files:
            made[name] = [write(file) | label for file, label in zip(files, labels, strict=True)]
    return made


def _file_keys(sweep: SweepFile) -> dict[str, Any]:
    layout = sweep.roles.recording.layout
    return {"file": sweep.path, "layout": layout, **columns_of(sweep.roles)}


def _background(sweep: SweepFile) -> dict[str, Any]:
    """What a comparison of forms found next to the line."""
    form = "" if sweep.line is None else sweep.line.forms[0].name
    known = BACKGROUNDS.get((form, sweep.roles.is_complex))
    return {} if known is None else {"background": noted(*known)}


def _sweep_table(sweep: SweepFile, amplitude: Mapping[str, Any], *, fitted: bool) -> dict[str, Any]:
    """A sweep of amplitudes."""
    form = "" if sweep.line is None else sweep.line.forms[0].name
    return {
        **_file_keys(sweep),
        **amplitude,
        "use": noted("fit", "every point is fitted, too"),
        "scale": noted("fit", "of measured over simulated amplitudes: by least squares"),
        **(_background(sweep) if fitted or form == FANO else {}),
    }


def _complex_table(sweep: SweepFile) -> dict[str, Any]:
    """A complex sweep, one of some."""
    made = _file_keys(sweep) | _background(sweep)
    if sweep.two is not None:
        made["background"] = noted("constant", "complex, next to the lines: solved inside")
    delayed = sweep.line is not None and sweep.line.forms[0].delayed
    return made | phase_keys(rotated=sweep.phases_reversed, delayed=delayed)


def _noise_table(sweep: SweepFile) -> dict[str, Any]:
    """A noise spectrum, one of some: level and floor are solved for."""
    roles = sweep.roles
    of_whole_file(roles, "noise_spectrum")
    force = noted(WHITE, '"thermal", with temperature and mass, determines the read-out')
    if sweep.has_own_forces:
        force = noted(THERMAL, "heat moves each mode; temperature and mass determine the read-out")
    states = "averages = N states how many periodograms were averaged"
    made = {"file": noted(sweep.path, states), "force": force}
    if sweep.density is not None and sweep.density.holds:
        made["holds"] = noted(sweep.density.holds, "the unit does not state it")
    density = "" if roles.sizes is None else in_file(roles.sizes)
    columns = {"frequency": in_file(roles.frequency), "density": density}
    return made | {"columns": noted(columns, "as they were recognised")}
