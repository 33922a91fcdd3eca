"""Limits of sweeps as next measurements: what [design] says, else as the campaign's had them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fitting.campaign.binder import Binder
from fitting.design.candidates import Limits, SweepLimits
from fitting.design.continued import Continued, continued_of
from fitting.design.sweeps import check_controls
from fitting.design.table import DesignTable, most_of
from fitting.extension.records import BoundCampaign, WrittenDesign, WrittenSweeps
from fitting.fmu.variables import VariableLike
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.written import Written, in_unit, positive_in

#: Keys of [design] that place tones.
OF_TONES: tuple[str, ...] = (
    "outputs",
    "frequency_step",
    "least_spacing",
    "farthest",
    "both_sides",
    "tones",
    "levels",
    "repeats",
    "phases",
    "settings",
    "setting_sigma",
)
#: Values of all controls together that are tried where nothing is said, at most.
TRIED = 41
#: Largest amplitude that is proposed, in units of the largest one seen.
HEADROOM = 2.0
#: A part of the noise below this share of the other is none.
ROUNDING = 1e-6


def asked_of(bound: BoundCampaign, said: WrittenDesign, keys: frozenset[str]) -> WrittenDesign:
    """What [design] asks; of a campaign of a map alone sweeps at the values of its controls so far.

    That is, unless it asks for tones.

    Args:
        bound: campaign, bound to its FMU.
        said: [design], as it was read.
        keys: those that are written there.
    """
    others = bound.experiments or bound.sweep is not None
    if said.sweeps is not None or others or keys & {*OF_TONES, "centres"}:
        return said
    try:
        so_far = continued_of(bound)
    except BadInput:
        return said
    names = list(so_far.last)
    most = max(2, round(TRIED ** (1.0 / max(1, len(names)))))
    where = f"{bound.path}: [design] sweeps"
    controls = {
        name: tuple(Written(value, None, where) for value in _some(so_far, name, most))
        for name in names
    }
    return replace(said, sweeps=WrittenSweeps(controls=controls))


def _some(so_far: Continued, name: str, most: int) -> list[Scalar]:
    """Values of a control so far, over the whole range."""
    values = sorted({s.settings[name] for s in so_far.sweeps}, key=float)
    kept = np.unique(np.round(np.linspace(0, len(values) - 1, most)).astype(int))
    return [values[k] for k in kept]


def sweep_limits(
    bound: BoundCampaign,
    variables: Mapping[str, VariableLike],
    table: DesignTable,
) -> Limits:
    """Limits of a campaign whose next measurements are sweeps.

    Args:
        bound: campaign, bound to its FMU.
        variables: of the FMU, by name.
        table: [design], as it was read.

    Raises:
        BadInput: no sweeps over a control, an unknown control, a value of the wrong unit, a key
            that places tones, no noise.
    """
    so_far, said = continued_of(bound), table.keys
    _check_places(bound, table)
    if so_far.has_own_drive:
        raise BadInput(
            f"{table.where('sweeps')}: the spectra of [{so_far.table}] have a drive of their own; "
            "wanted sweeps with one amplitude of the drive"
        )
    for key in OF_TONES:
        if key in table.said:
            raise BadInput(
                f"{table.where(key)}: has no meaning together with sweeps, which are proposed in "
                f"place of "
                "tones"
            )
    first = min(s.frequency_hz[0] for s in so_far.sweeps)
    last = max(s.frequency_hz[-1] for s in so_far.sweeps)
    centre_hz = float(0.5 * (first + last))
    if said.centres is not None:
        if len(said.centres) != 1:
            raise BadInput(
                f"{table.where('centres')}: {len(said.centres)} frequencies, wanted one, the "
                "middle of the sweeps"
            )
        centre_hz = in_unit(said.centres[0], "Hz")
    limits = SweepLimits(
        span_hz=_asked(said).span or float(last - first),
        points=_asked(said).points or max(s.frequency_hz.size for s in so_far.sweeps),
        controls=_controls(bound, variables, table, so_far),
    )
    step_hz = limits.span_hz / (limits.points - 1)
    floor, relative = _noise(so_far, table)
    return Limits(
        outputs=(so_far.output,),
        centres_hz=(centre_hz,),
        frequency_step_hz=step_hz,
        least_spacing_hz=step_hz,
        farthest_hz=0.5 * limits.span_hz,
        both_sides=True,
        levels=(1.0,),
        repeats=(1,),
        noise_floor_v=floor,
        relative_noise=relative,
        largest_v=_amplitude(so_far, said.largest, HEADROOM * so_far.largest),
        number=most_of(said),
        sweeps=limits,
    )


def _asked(said: WrittenDesign) -> WrittenSweeps:
    return said.sweeps or WrittenSweeps(controls={})


def _check_places(bound: BoundCampaign, table: DesignTable) -> None:
    """Complain of what is fitted to each spectrum: a new one would have a value of its own."""
    own = next((p.name for p in bound.parameters if p.experiments), None)
    if own is not None:
        raise BadInput(
            f"{table.where('sweeps')}: '{own}' is fitted to single spectra, and nothing is known "
            "of it in a new one; wanted parameters that all spectra share"
        )


def _controls(
    bound: BoundCampaign,
    variables: Mapping[str, VariableLike],
    table: DesignTable,
    so_far: Continued,
) -> dict[str, tuple[Scalar, ...]]:
    binder = Binder(variables, bound.setup.laws.names)
    binder.control_units.update({n: unit for n, unit in so_far.units.items() if unit})
    written = _asked(table.keys).controls
    check_controls(written, so_far, table.where("sweeps"))
    return {
        name: tuple(binder.setting(name, with_unit(value, so_far.units[name])) for value in values)
        for name, values in written.items()
    }


def with_unit(written: Written, unit: str) -> Written:
    """A plain number in the unit of a control quantity; what has a unit stays.

    Args:
        written: as the file has it.
        unit: of the control quantity; empty: an FMU variable, whose own unit holds.
    """
    plain = written.unit is None and not isinstance(written.value, str)
    return replace(written, unit=unit or None) if plain else written


def _amplitude(so_far: Continued, written: Written | None, default: float) -> float:
    return default if written is None else positive_in(written, so_far.unit)


def _noise(so_far: Continued, table: DesignTable) -> tuple[float, float]:
    """Noise of a point of a sweep, and the part of it that is a share of the amplitude.

    Least squares of sigma^2 = floor^2 + (relative A)^2 over the measured points, where it is
    stated; the median of what the sweeps' scatter says elsewhere.
    """
    said = table.keys
    sigma = np.concatenate([s.sigma for s in so_far.sweeps])
    amplitude = np.concatenate([s.amplitude for s in so_far.sweeps])
    size = so_far.largest
    squares = np.array([float(np.median(sigma / size)) ** 2, 0.0])
    if not so_far.estimated:
        matrix = np.column_stack([np.ones(amplitude.size), (amplitude / size) ** 2])
        squares = np.linalg.lstsq(matrix, (sigma / size) ** 2, rcond=None)[0]
    found = np.sqrt(np.maximum(squares, 0.0))
    found[found < ROUNDING * found.max()] = 0.0
    floor = _amplitude(so_far, said.noise_floor, float(f"{size * float(found[0]):.9g}"))
    relative = float(found[1]) if said.relative_noise is None else said.relative_noise
    if not (floor > 0.0 or relative > 0.0):
        raise BadInput(
            f"{table.where('noise_floor')}: is not there and [{so_far.table}] states no noise; "
            "wanted that of a point of a sweep"
        )
    return floor, relative
