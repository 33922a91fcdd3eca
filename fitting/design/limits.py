"""The limits of an instrument: what [design] says, else what the campaign itself kept to."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np

from fitting import Drive
from fitting.campaign.binder import Binder
from fitting.design.candidates import MOST_NUMBER, Limits
from fitting.design.sweep_limits import HEADROOM, asked_of, sweep_limits, with_unit
from fitting.design.table import DesignTable, most_of, timed
from fitting.design.trace_limits import trace_limits, traces_asked_of
from fitting.extension.records import BoundCampaign, WrittenCampaign, WrittenDesign
from fitting.fmu.variables import READABLE, SETTABLE, VariableLike
from fitting.signal.combinations import Combination
from fitting.signal.scale import half_power_width, laboratory_maximum
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.keys import Keys, Missing
from fitting.text.schema import read_record
from fitting.text.toml import read_toml
from fitting.text.units import convert, same_kind
from fitting.text.written import Written, as_written, difference_in, in_unit, positive_in

#: Drive levels and numbers of averaged spectra that are tried where nothing is said.
LEVELS, REPEATS = (1.0, 10.0, 100.0), (1, 10, 100)
#: Noise of a peak in proportion to it.
RELATIVE_NOISE = 0.01
#: Departure of what drifts from the line between its two measured values, as a share of the drift.
OFF_THE_LINE = 0.05
#: Relative difference of two limits that are the same one, written in two units.
ROUNDING = 1e-12
#: Tables by which a file is known as a campaign.
OF_A_CAMPAIGN = ("fmu", "drive", "parameters")


@dataclass(frozen=True, kw_only=True)
class WrittenCandidates(Keys):
    """A file that holds limits and nothing else."""

    design: Annotated[WrittenDesign, Missing("wanted a table [design] with limits")]
    """The instrument's limits."""


def read_design_table(path: Path) -> DesignTable:
    """The table [design] of a campaign file, empty where there is none.

    Args:
        path: of the campaign file.

    Raises:
        BadInput: no such file, not TOML, or something wrong with the table.
    """
    table = read_toml(path).get("design", {})
    return DesignTable(path, read_record(WrittenDesign, table, path, "design"), frozenset(table))


def read_candidates(path: Path) -> DesignTable:
    """The table [design] of a file that has to have one: nothing else, or a whole campaign.

    Args:
        path: of the file.

    Raises:
        BadInput: no such file, not TOML, no such table, or a table or key that there is not.
    """
    tables = read_toml(path)
    if any(name in tables for name in OF_A_CAMPAIGN):
        read_record(WrittenCampaign, tables, path)
        if "design" not in tables:
            raise BadInput(f"{path}: has no table [design], wanted one with limits")
    else:
        read_record(WrittenCandidates, tables, path)
    return read_design_table(path)


def refuse_wider(
    limits: Limits,
    own: Limits,
    table: DesignTable,
    where: Callable[[str], str],
    amplitude_unit: str,
) -> None:
    """Complain of limits that go beyond what the campaign says that its instrument bears.

    Args:
        limits: that are to hold.
        own: the campaign's.
        table: the campaign's [design]; what it does not say is no limit.
        where: place of a key of `limits`, for complaints.
        amplitude_unit: the detector's.

    Raises:
        BadInput: one is wider.
    """
    for key, found, most, unit in (
        ("levels", max(limits.levels), max(own.levels), ""),
        ("largest", limits.largest_v, own.largest_v, amplitude_unit),
        ("farthest", limits.farthest_hz, own.farthest_hz, "Hz"),
        ("least_spacing", -limits.least_spacing_hz, -own.least_spacing_hz, "Hz"),
    ):
        if key in table.said and found - most > ROUNDING * abs(most):
            wanted = "at most" if most > 0.0 else "at least"
            high, low = (f"{abs(value):.9g} {unit}".rstrip() for value in (found, most))
            raise BadInput(
                f"{where(key)}: found {high}, wanted {wanted} the {low} of {table.where(key)}"
            )
    if "phases" in table.said and limits.phases and not own.phases:
        raise BadInput(
            f"{where('phases')}: found true, wanted false as in {table.where('phases')}: the "
            "detector measures none"
        )
    more = [name for name in limits.outputs if name not in own.outputs]
    if "outputs" in table.said and more:
        raise BadInput(
            f"{where('outputs')}: '{more[0]}' is none of those of {table.where('outputs')}, wanted "
            f"some of {', '.join(own.outputs)}"
        )


def check_names(
    limits: Limits, variables: Mapping[str, VariableLike], controls: Mapping[str, str]
) -> None:
    """Complain of names and values that neither the FMU nor a law has.

    Args:
        limits: made by a program.
        variables: of the FMU, by name.
        controls: units of the control quantities of laws, by name.

    Raises:
        BadInput: an unknown variable, or a value of the wrong kind.
    """
    binder = _binder(variables, controls)
    for name in limits.outputs:
        binder.real(name, "limits: outputs", READABLE, "observed")
    for name, values in limits.settings.items():
        for value in values:
            written = as_written(value, f"limits: settings '{name}'")
            binder.setting(name, with_unit(written, controls.get(name, "")))
    for name in limits.setting_sigmas:
        binder.real(name, "limits: setting_sigmas", SETTABLE, "set")


def limits_of(
    bound: BoundCampaign,
    variables: Mapping[str, VariableLike],
    table: DesignTable,
    read: tuple[Combination, ...] = (),
) -> Limits:
    """Limits of a bound campaign's instrument from a table [design].

    What it does not say is taken from the campaign: outputs like the observed one (same unit, same
    name but for digits), resonances at the sweep's maximum and at every drifting frequency, the
    grid, least spacing and largest detuning of its own drive frequencies, the noise of its peaks.
    Of a campaign of a map alone sweeps are proposed, at the values of its controls so far, of one
    of traces alone recordings like these.

    Args:
        bound: campaign, bound to its FMU.
        variables: of the FMU, by name.
        table: [design], as it was read.
        read: lines that the instrument reads, empty for the tones themselves.

    Raises:
        BadInput: a value of the wrong kind or unit, an unknown variable, nothing to place tones by.
    """
    said = asked_of(bound, table.keys, table.said)
    if said.sweeps is None and traces_asked_of(bound, said, table.said):
        return timed(trace_limits(bound, replace(table, keys=said)), said)
    if said.sweeps is not None:
        return timed(sweep_limits(bound, variables, replace(table, keys=said)), said)
    if bound.setup.drive.kind == "none":
        raise BadInput(
            f"{bound.path}: has no [drive], wanted one: tones are proposed where [design] asks for "
            "neither sweeps nor traces"
        )
    centres = _centres(bound, variables, table)
    own = _own_grid(bound, centres)
    found = Limits(
        outputs=_outputs(bound, variables, table),
        centres_hz=centres,
        frequency_step_hz=said.frequency_step or own[0],
        least_spacing_hz=said.least_spacing or own[1],
        farthest_hz=said.farthest or own[2],
        both_sides=said.both_sides,
        levels=_levels(bound.setup.drive, table),
        repeats=_repeats(table),
        noise_floor_v=_amplitude(bound, said.noise_floor, _own_noise(bound)),
        relative_noise=_relative_noise(bound, table),
        largest_v=_amplitude(bound, said.largest, HEADROOM * _largest(bound)),
        settings=_settings(bound, variables, said),
        setting_sigmas=_setting_sigmas(bound, variables, said),
        number=_number(table),
        tones=_tones(bound, table),
        lines=() if all(line.order == 1 for line in read) else read,
        phases=_phases(bound, said),
    )
    return timed(found, said)


def _phases(bound: BoundCampaign, said: WrittenDesign) -> bool:
    if said.phases is not None:
        return said.phases
    return any(e.phases is not None for e in bound.experiments)


def _levels(drive: Drive, table: DesignTable) -> tuple[float, ...]:
    tones = drive.kind == "tones"
    levels = _ascending(table.keys.levels or (LEVELS if tones else (1.0,)))
    if not tones and levels != (1.0,):
        raise BadInput(f"{table.where('levels')}: has no meaning with a drive through the input")
    return levels


def _repeats(table: DesignTable) -> tuple[int, ...]:
    values = _ascending(table.keys.repeats or REPEATS)
    if any(v != int(v) for v in values):
        raise BadInput(f"{table.where('repeats')}: found {values!r}, wanted whole numbers")
    return tuple(int(v) for v in values)


def _ascending(values: Iterable[float]) -> tuple[float, ...]:
    return tuple(sorted({float(v) for v in values}))


def _relative_noise(bound: BoundCampaign, table: DesignTable) -> float:
    relative = table.keys.relative_noise
    if relative is None:
        return bound.noise.relative or RELATIVE_NOISE
    if relative < 0.0:
        raise BadInput(f"{table.where('relative_noise')}: found {relative}, wanted zero or more")
    return relative


def _number(table: DesignTable) -> int:
    number = most_of(table.keys)
    if number > MOST_NUMBER:
        raise BadInput(f"{table.where('number')}: found {number}, wanted at most {MOST_NUMBER}")
    return number


def _tones(bound: BoundCampaign, table: DesignTable) -> int:
    """Tones that are driven at once: the campaign's, one where it has a sweep only."""
    driven = len(bound.setup.drive.frequency_names)
    tones = table.keys.tones or (driven if bound.experiments else 1)
    if tones > min(2, driven):
        raise BadInput(
            f"{table.where('tones')}: {tones} tones; a design places one or two, as many as "
            "[drive] has at most"
        )
    return tones


def _outputs(
    bound: BoundCampaign, variables: Mapping[str, VariableLike], table: DesignTable
) -> tuple[str, ...]:
    names = table.keys.outputs
    if names is not None:
        if not names:
            raise BadInput(f"{table.where('outputs')}: is empty, wanted at least one name")
        for name in names:
            Binder(variables).real(name, table.where("outputs"), READABLE, "observed")
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
    bound: BoundCampaign, variables: Mapping[str, VariableLike], table: DesignTable
) -> tuple[float, ...]:
    """Resonances in Hz: as written, or where the campaign knows some."""
    if table.keys.centres is not None:
        return tuple(sorted(in_unit(written, "Hz") for written in table.keys.centres))
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
        raise BadInput(f"{table.where('centres')}: wanted frequencies to place the tones around")
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
        "frequencies nor a sweep determine them"
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


def _amplitude(bound: BoundCampaign, written: Written | None, default: float) -> float:
    return default if written is None else positive_in(written, bound.amplitude_unit)


def _settings(
    bound: BoundCampaign, variables: Mapping[str, VariableLike], said: WrittenDesign
) -> dict[str, tuple[Scalar, ...]]:
    """Lists of values of further FMU parameters or control quantities, in their units."""
    controls = bound.setup.laws.controls
    binder = _binder(variables, controls)
    return {
        name: tuple(binder.setting(name, with_unit(w, controls.get(name, ""))) for w in values)
        for name, values in said.settings.items()
    }


def _binder(variables: Mapping[str, VariableLike], controls: Mapping[str, str]) -> Binder:
    """Of the FMU's variables, and of control quantities in their units."""
    binder = Binder(variables, controls)
    binder.control_units.update(controls)
    return binder


def _setting_sigmas(
    bound: BoundCampaign, variables: Mapping[str, VariableLike], said: WrittenDesign
) -> dict[str, float]:
    """Errors of what is set to the value that the laboratory believes, by FMU variable."""
    found = {
        name: OFF_THE_LINE * abs(after - before)
        for name, (before, after) in bound.drift.ends.items()
        if after != before
    }
    for parameter in bound.offsets:  # that the campaign fits: their own prior
        if parameter.prior_sigma is not None:
            found.update(dict.fromkeys(parameter.adds_to, parameter.prior_sigma))
    binder = Binder(variables)
    for name, written in said.setting_sigma.items():
        variable = binder.real(name, written.where, SETTABLE, "set")
        value = difference_in(written, variable.unit)
        if value < 0.0:
            raise BadInput(f"{written.where}: found {written.value!r}, wanted zero or more")
        found[name] = value
    return {name: sigma for name, sigma in found.items() if sigma > 0.0}
