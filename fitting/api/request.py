"""What a program asks of an FMU, bound to its variables: drives of some tones, a sweep of one.

Errors begin with the argument of `fitting.Fmu.simulate` or `fitting.Fmu.sweep`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from fitting.campaign.binder import Binder
from fitting.campaign.bound import Drive as WantedDrive
from fitting.fmu.description import (
    READABLE,
    SETTABLE,
    FmuDescription,
    amplitude_of,
    other_tones,
)
from fitting.simulate.drive import Drive
from fitting.simulate.frf import DIRECTIONS, Sweep
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.units import as_written, convert, in_unit, same_kind

#: Parameters that hold the frequencies of the tones in the models of this project.
USUAL_TONES = ("u1", "u2")


def drive_request(
    description: FmuDescription,
    start_values: Mapping[str, Scalar] | None,
    tones: Iterable[str | float] | str,
    drive: WantedDrive | None,
    outputs: str | Sequence[str],
) -> Drive:
    """A drive of an FMU: its tones are its own, or made by an input or by parameters.

    Args:
        description: of the FMU, to whose variables names, numbers and quantities are bound.
        start_values: by variable.
        tones: parameters that hold the frequencies, or with ``drive`` the frequencies, Hz.
        drive: what makes the tones.
        outputs: names; none: the first continuous one.

    Raises:
        BadInput: names, values or units that do not fit the FMU.
    """
    variables = description.variables
    binder = Binder(variables)
    values = _start_values(binder, start_values)
    tones = (tones,) if isinstance(tones, str) else tuple(tones)
    if drive is None:
        if tones == USUAL_TONES and not all(name in variables for name in tones):
            raise BadInput(
                f"{description.path}: has no parameters {' and '.join(USUAL_TONES)}; "
                "wanted the names of those that hold the frequencies of the tones, or an "
                "input to drive"
            )
        # a tone whose amplitude is 0 has no frequency; where none drives, all have
        driving = []
        for name in map(str, tones):
            amplitude = amplitude_of(name, variables)
            if amplitude is None or values.get(amplitude.name, amplitude.start or 0.0):
                driving.append(name)
        names, frequencies_hz = tuple(driving or map(str, tones)), []
        for name in names:
            where = f"tones '{name}'"
            unit = _frequency_unit(binder, "tones", name)
            value = values.get(name, variables[name].start)
            if value is None:
                raise BadInput(f"{where}: has no start value, wanted one in start_values")
            frequencies_hz.append(convert(float(value), unit, "Hz", where=where))
        return Drive(
            start_values=values,
            tones_hz=tuple(frequencies_hz),
            outputs=_outputs(description, outputs, "outputs"),
            tone_names=names,
        )
    plain = (tone if isinstance(tone, str) else float(tone) for tone in tones)
    tones_hz = tuple(in_unit(as_written(tone, "tones"), "Hz") for tone in plain)
    read = _outputs(description, outputs, "outputs")
    if drive.input is not None:
        binder.real(drive.input, "drive", ("input",), "driven")
    elif len(tones_hz) != len(drive.frequency_names):
        raise BadInput(
            f"tones: found {len(tones_hz)} frequencies, wanted {len(drive.frequency_names)}, "
            f"one for each of {', '.join(drive.frequency_names)}"
        )
    else:
        units = [_frequency_unit(binder, "drive", name) for name in drive.frequency_names]
        made: dict[str, Scalar] = dict.fromkeys(drive.amplitude_names, drive.amplitude)
        made |= {
            name: convert(tone, "Hz", unit, where=f"drive '{name}'")
            for name, tone, unit in zip(drive.frequency_names, tones_hz, units, strict=True)
        }
        for name in made:
            binder.real(name, "drive", SETTABLE, "set")
            if name in values:
                raise BadInput(f"start_values '{name}': is set by the drive, wanted it there")
        values = {**values, **made}
    return Drive(
        start_values=values,
        tones_hz=tones_hz,
        outputs=read,
        tone_names=drive.frequency_names,
        input=drive.input,
        amplitude=drive.amplitude,
        steps_per_period=drive.samples_per_period,
        highest_order=drive.highest_order,
    )


def sweep_request(
    description: FmuDescription,
    frequency_hz: npt.ArrayLike,
    start_values: Mapping[str, Scalar] | None,
    tone: str,
    output: str,
    directions: Sequence[str],
) -> Sweep:
    """A sweep of one tone, with which other tones of the FMU do not drive.

    Args:
        description: of the FMU, to whose variables names, numbers and quantities are bound.
        frequency_hz: of the tone, shape (n,), Hz, rising.
        start_values: by variable.
        tone: the parameter that is moved.
        output: name; empty: the first continuous one.
        directions: any of "up" and "down".

    Raises:
        BadInput: names, values or units that do not fit the FMU.
    """
    directions = (directions,) if isinstance(directions, str) else tuple(directions)
    unknown = [d for d in directions if d not in DIRECTIONS]
    if unknown or not directions:
        raise BadInput(f"directions: found {directions!r}, wanted some of up, down")
    grid = np.asarray(frequency_hz, dtype=float)
    if grid.ndim != 1 or grid.size < 2:
        raise BadInput(f"frequency_hz has the shape {grid.shape}, wanted (n,), two or more")
    binder = Binder(description.variables)
    unit = _frequency_unit(binder, "tone", tone)
    values = _start_values(binder, start_values)
    if tone in values:
        raise BadInput(
            f"start_values '{tone}': is the tone that is moved, wanted its frequencies alone"
        )
    others = other_tones((tone,), values, description.variables)
    for other in others:
        if other.amplitude in values:
            raise BadInput(
                f"start_values '{other.amplitude}': found {values[other.amplitude]!r}, with "
                f"which {other.frequency} would drive together with {tone}; wanted 0 in a "
                "sweep of one tone"
            )
    return Sweep(
        start_values={**values, **{other.amplitude: 0.0 for other in others}},
        tone=tone,
        tone_unit=unit,
        frequencies_hz=tuple(map(float, grid)),
        output=_outputs(description, output, "output")[0],
        directions=directions,
    )


def _start_values(binder: Binder, given: Mapping[str, Scalar] | None) -> dict[str, Scalar]:
    """Start values in the FMU's units, given as numbers in these or as texts such as "0.3 m/s2".

    Raises:
        BadInput: no such variable, or a value that it cannot have.
    """
    return binder.settings(
        {name: as_written(v, f"start_values '{name}'") for name, v in (given or {}).items()}
    )


def _frequency_unit(binder: Binder, argument: str, name: str) -> str:
    """The unit of a parameter that holds a frequency, which an argument names.

    Raises:
        BadInput: no such parameter, or one of another dimension.
    """
    variable = binder.real(name, f"{argument} '{name}'", SETTABLE, "set")
    if not same_kind(variable.unit or "1", "Hz"):
        raise BadInput(f"{argument} '{name}': its unit is {variable.unit!r}, wanted a frequency")
    return variable.unit or "1"


def _outputs(
    description: FmuDescription, names: str | Sequence[str], argument: str
) -> tuple[str, ...]:
    """Names of outputs, as an argument names them; none: the first continuous one.

    Raises:
        BadInput: no such output, or none at all.
    """
    requested = ((names,) if names else ()) if isinstance(names, str) else tuple(names)
    for name in requested:
        Binder(description.variables).real(name, f"{argument} '{name}'", READABLE, "read")
    if requested:
        return requested
    for v in description.observable:
        if (v.kind, v.variability) == ("Real", "continuous"):
            return (v.name,)
    raise BadInput(f"{description.path}: has no continuous Real output, wanted {argument}")
