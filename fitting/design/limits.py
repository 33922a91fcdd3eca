"""The limits of an instrument: what [design] says, else what the campaign itself kept to."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import reduce
from itertools import pairwise
from pathlib import Path

import numpy as np

from fitting.campaign import BoundCampaign
from fitting.campaign.binder import Binder
from fitting.campaign.section import Section, Written, as_written, in_unit
from fitting.design.candidates import Limits
from fitting.fmu.variables import READABLE, SETTABLE, VariableLike
from fitting.signal.combinations import Combination
from fitting.signal.scale import half_power_width, laboratory_maximum
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.toml import read_toml
from fitting.text.units import convert, same_kind

KEYS = (
    "outputs",
    "centres",
    "frequency_step",
    "least_spacing",
    "farthest",
    "both_sides",
    "levels",
    "repeats",
    "noise_floor",
    "relative_noise",
    "largest",
    "settings",
    "setting_sigma",
    "number",
    "target",
    "criterion",
    "averaged",
    "tones",
)
#: Drive levels and numbers of averaged spectra that are tried where nothing is said.
LEVELS, REPEATS = (1.0, 10.0, 100.0), (1, 10, 100)
#: Noise of a peak in proportion to it, and detector range in units of the largest amplitude seen.
RELATIVE_NOISE, HEADROOM = 0.01, 2.0
#: Departure of what drifts from the line between its two measured values, as a share of the drift.
OFF_THE_LINE = 0.05
MOST_NUMBER = 50


def design_section(path: Path) -> Section:
    """The table [design] of a TOML file, empty where there is none.

    Raises:
        BadInput: no such file, not TOML, or an unknown key in the table.
    """
    top = Section(path, "", read_toml(path))
    return top.sub("design", KEYS)


def limits_of(
    bound: BoundCampaign,
    variables: Mapping[str, VariableLike],
    section: Section,
    read: tuple[Combination, ...] = (),
) -> Limits:
    """Limits of a bound campaign's instrument from a table [design]; `read` are its lines.

    What it does not say is taken from the campaign: outputs like the observed one (same unit, same
    name but for digits), resonances at the sweep's maximum and at every drifting frequency, the
    grid, least spacing and largest detuning of its own drive frequencies, the noise of its peaks.

    Raises:
        BadInput: a value of the wrong kind or unit, an unknown variable, nothing to place tones by.
    """
    spread = _Frequencies(section)
    centres = _centres(bound, variables, section)
    own = _own_grid(bound, centres)
    repeats = _whole_numbers(section, "repeats", REPEATS)
    levels = _numbers(section, "levels", LEVELS if bound.setup.drive.kind == "tones" else (1.0,))
    if bound.setup.drive.kind != "tones" and levels != (1.0,):
        raise BadInput(f"{section.where('levels')}: has no meaning with a drive through the input")
    number = section.integer("number", Limits.number, least=1)
    if number > MOST_NUMBER:
        raise BadInput(f"{section.where('number')}: found {number}, wanted at most {MOST_NUMBER}")
    relative = section.number("relative_noise", bound.noise.relative or RELATIVE_NOISE)
    if relative < 0.0:
        raise BadInput(f"{section.where('relative_noise')}: found {relative}, wanted zero or more")
    return Limits(
        outputs=_outputs(bound, variables, section),
        centres_hz=centres,
        frequency_step_hz=spread.get("frequency_step", own[0]),
        least_spacing_hz=spread.get("least_spacing", own[1]),
        farthest_hz=spread.get("farthest", own[2]),
        both_sides=section.boolean("both_sides", True),
        levels=levels,
        repeats=repeats,
        noise_floor_v=_amplitude(bound, section, "noise_floor", _own_noise(bound)),
        relative_noise=relative,
        largest_v=_amplitude(bound, section, "largest", HEADROOM * _largest(bound)),
        settings=_settings(variables, section),
        setting_sigmas=_setting_sigmas(bound, variables, section),
        number=number,
        tones=_tones(bound, section),
        lines=() if all(line.order == 1 for line in read) else read,
    )


def _tones(bound: BoundCampaign, section: Section) -> int:
    """Tones that are driven at once: the campaign's, one where it has a sweep only."""
    usual = len(bound.setup.drive.frequencies) if bound.experiments else 1
    tones = section.integer("tones", usual, least=1)
    if tones > min(2, len(bound.setup.drive.frequencies)):
        raise BadInput(
            f"{section.where('tones')}: {tones} tones; a design places one or two, as many as "
            "[drive] has at most"
        )
    return tones


class _Frequencies:
    def __init__(self, section: Section) -> None:
        self.section = section

    def get(self, key: str, default: float) -> float:
        """A frequency in Hz, the default where nothing is written."""
        return self.section.quantity(key, "Hz", positive=True) if key in self.section else default


def _outputs(
    bound: BoundCampaign, variables: Mapping[str, VariableLike], section: Section
) -> tuple[str, ...]:
    binder = Binder(variables)
    if "outputs" in section:
        names = section.texts("outputs")
        if not names:
            raise BadInput(f"{section.where('outputs')}: is empty, wanted at least one name")
        for name in names:
            binder.real(name, section.where("outputs"), READABLE, "observed")
        return names
    unit, shape = variables[bound.setup.output].unit, _without_digits(bound.setup.output)
    alike = [
        name
        for name, v in variables.items()
        if v.causality == "output" and v.unit == unit and _without_digits(name) == shape
    ]
    used = dict.fromkeys([bound.setup.output, *(e.output for e in bound.experiments if e.output)])
    return tuple(dict.fromkeys([*used, *alike]))


def _without_digits(name: str) -> str:
    return re.sub(r"\d+", "#", name)


def _centres(
    bound: BoundCampaign, variables: Mapping[str, VariableLike], section: Section
) -> tuple[float, ...]:
    """Resonances in Hz: as written, or where the campaign knows some."""
    if "centres" in section:
        values = section.required("centres")
        if not isinstance(values, list) or not values:
            raise BadInput(f"{section.where('centres')}: found {values!r}, wanted frequencies")
        where = section.where("centres")
        return tuple(sorted(in_unit(as_written(v, where), "Hz") for v in values))
    found = [
        convert(after, variables[name].unit or "Hz", "Hz", where="[drift]")
        for name, (_, after) in bound.drift.ends.items()
        if same_kind(variables[name].unit or "1", "Hz")
    ]
    sweep = bound.sweep
    if sweep is not None:
        top = laboratory_maximum(sweep.frequency_hz, sweep.amplitude_v).frequency_hz
        reach = 2.0 * half_power_width(sweep.frequency_hz, sweep.amplitude_v)
        drifts = [abs(b - a) for a, b in bound.drift.ends.values()]
        if all(abs(top - f) > reach + max(drifts, default=0.0) for f in found):
            found.append(top)
    if not found and bound.experiments:
        found.append(float(np.mean([f for e in bound.experiments for f in e.tones_hz])))
    if not found:
        raise BadInput(f"{section.where('centres')}: wanted frequencies to place the tones around")
    return tuple(sorted(found))


def _own_grid(bound: BoundCampaign, centres: tuple[float, ...]) -> tuple[float, float, float]:
    """Step, least spacing and farthest detuning of the campaign's own tones, Hz."""
    tones = sorted({round(f) for e in bound.experiments for f in e.tones_hz})
    steps = [b - a for a, b in pairwise(tones)]
    spacings = [b - a for e in bound.experiments for a, b in pairwise(sorted(e.tones_hz))]
    if not steps:
        step = _round(0.1 * _width(bound))
        return step, 2.0 * step, 15.0 * step
    step = float(reduce(math.gcd, steps))
    middles = [0.5 * (min(e.tones_hz) + max(e.tones_hz)) for e in bound.experiments]
    farthest = max(
        abs(f - m) for e, m in zip(bound.experiments, middles, strict=True) for f in e.tones_hz
    )
    if not spacings:  # single tones: how far they are from the nearest resonance
        farthest = max(min(abs(f - c) for c in centres) for f in tones)
    step = max(step, farthest / 50.0)
    return step, min(spacings, default=step), max(farthest, 2.0 * step)


def _round(value: float) -> float:
    """Down to one digit, a number that a dial shows."""
    place = 10.0 ** math.floor(math.log10(value))
    return math.floor(value / place) * place


def _width(bound: BoundCampaign) -> float:
    if bound.setup.line_width_hz is not None:
        return bound.setup.line_width_hz
    if bound.sweep is not None:
        return half_power_width(bound.sweep.frequency_hz, bound.sweep.amplitude_v)
    raise BadInput(
        f"{bound.path}: [design]: wanted frequency_step, least_spacing and farthest: neither drive "
        "frequencies nor a sweep tell them"
    )


def _own_noise(bound: BoundCampaign) -> float:
    """Noise that is declared, else the peaks' median; the detector's unit; zero if unknown."""
    if bound.noise.absolute_v > 0.0:
        return bound.noise.absolute_v
    sigmas = np.concatenate([e.sigmas_v for e in bound.experiments] or [np.zeros(0)])
    known = sigmas[np.isfinite(sigmas) & (sigmas > 0.0)]
    if known.size:
        return float(np.median(known))
    if bound.sweep is not None:
        top = laboratory_maximum(bound.sweep.frequency_hz, bound.sweep.amplitude_v)
        return top.scatter * top.value_v
    return 0.0


def _largest(bound: BoundCampaign) -> float:
    peaks = [float(np.max(e.peaks_v)) for e in bound.experiments]
    if bound.sweep is not None:
        peaks.append(float(np.max(bound.sweep.amplitude_v)))
    return max(peaks)


def _amplitude(bound: BoundCampaign, section: Section, key: str, default: float) -> float:
    if key not in section:
        return default
    return section.quantity(key, bound.amplitude_unit, positive=True)


def _numbers(section: Section, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
    """A list of different positive numbers, ascending."""
    values = section.data.get(key, list(default))
    good = isinstance(values, list) and values
    if not good or not all(
        isinstance(v, int | float) and not isinstance(v, bool) and 0.0 < v < np.inf for v in values
    ):
        raise BadInput(f"{section.where(key)}: found {values!r}, wanted a list of positive numbers")
    return tuple(sorted({float(v) for v in values}))


def _whole_numbers(section: Section, key: str, default: tuple[int, ...]) -> tuple[int, ...]:
    values = _numbers(section, key, tuple(map(float, default)))
    if any(v != int(v) for v in values):
        raise BadInput(f"{section.where(key)}: found {values!r}, wanted whole numbers")
    return tuple(int(v) for v in values)


def _settings(
    variables: Mapping[str, VariableLike], section: Section
) -> dict[str, tuple[Scalar, ...]]:
    """Lists of values of further FMU parameters, in their units."""
    table, binder = section.sub("settings"), Binder(variables)
    found = {}
    for name, values in table.data.items():
        where = table.where(name)
        if not isinstance(values, list) or not values:
            raise BadInput(f"{where}: found {values!r}, wanted a list of values to try")
        found[name] = tuple(binder.setting(name, as_written(v, where)) for v in values)
    return found


def _setting_sigmas(
    bound: BoundCampaign, variables: Mapping[str, VariableLike], section: Section
) -> dict[str, float]:
    """Errors of what is set to the value that the laboratory believes, by FMU variable."""
    found = {
        name: OFF_THE_LINE * abs(after - before)
        for name, (before, after) in bound.drift.ends.items()
        if after != before
    }
    for parameter in bound.parameters:  # offsets that the campaign fits: their own prior
        if parameter.prior_sigma is not None:
            found.update(dict.fromkeys(parameter.adds_to, parameter.prior_sigma))
    table, binder = section.sub("setting_sigma"), Binder(variables)
    for name in table.data:
        variable = binder.real(name, table.where(name), SETTABLE, "set")
        written: Written = table.written(name)
        value = in_unit(written, variable.unit)
        if value < 0.0:
            raise BadInput(f"{written.where}: found {written.value!r}, wanted zero or more")
        found[name] = value
    return {name: sigma for name, sigma in found.items() if sigma > 0.0}
