"""What came of a drive or a sweep of an FMU, in lines."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from fitting.signal.combinations import combination_name
from fitting.simulate.drive_plan import DrivePlan
from fitting.simulate.frf import SweepResponse
from fitting.simulate.response import DriveResponse
from fitting.simulate.unsteady import Sideband
from fitting.simulate.words import (
    difference_in_words,
    plan_in_words,
    remainder_in_words,
    settling_in_words,
    spectrum_in_words,
    warnings_in_words,
)
from fitting.text.notation import hertz

MOST_MIXED = 4


def plan_lines(plan: DrivePlan, of: str = "themselves") -> list[str]:
    """A line per decision of a plan, and their sum.

    Args:
        plan: settings, settling and windows, with what they promise.
        of: what errors are relative to.
    """
    return list(plan_in_words(plan.budget, of))


def plan_warnings(plan: DrivePlan) -> list[str]:
    """What a user must know of a plan: a promise that cannot be given, reductions beyond bounds.

    Args:
        plan: settings, settling and windows, with what they promise.
    """
    return list(warnings_in_words(plan.budget))


def drive_lines(response: DriveResponse, units: Mapping[str, str]) -> list[str]:
    """Spectrum, settling, what there is beside the tones, every peak, the largest mixed lines.

    Args:
        response: of the FMU.
        units: of the outputs by name, empty where there is none.
    """
    remainder = remainder_in_words(response.remainder)
    lines = [
        spectrum_in_words(response.spectrum),
        settling_in_words(response.plan),
        remainder if response.remainder.explained else f"warning: {remainder}",
    ]
    tones = response.drive.tones_hz
    for name, peaks in zip(response.drive.outputs, response.peaks.T, strict=True):
        unit = units[name]
        if name in response.constants:
            lines.append(f"{name}: constant, {response.constants[name]:.9g} {unit}".rstrip())
            continue
        lines += [
            f"{name}: {peak:.9g} {unit} peak at {hertz(tone, digits=10)}"
            for tone, peak in zip(tones, peaks, strict=True)
        ]
    return [*lines, *_mixed(response, units)]


def _mixed(response: DriveResponse, units: Mapping[str, str]) -> list[str]:
    """The largest lines at combinations of the tones, as a response has that is not linear."""
    mixed, said = response.lines, []
    for k, name in enumerate(response.drive.outputs):
        if name in response.constants:
            continue
        sizes = sorted((m.amplitudes[k] for m in mixed), reverse=True)[:MOST_MIXED]
        shown = [m for m in mixed if m.amplitudes[k] in sizes]
        said += [
            f"{name}: {m.amplitudes[k]:.9g} {units[name]} at "
            f"{combination_name(m.factors, response.drive.names)} = "
            f"{hertz(m.frequency_hz, digits=10)}"
            for m in shown
        ]
        if len(mixed) > len(shown):
            said.append(f"{name}: {len(mixed) - len(shown)} smaller lines are in lines.csv")
    if said:
        said.append("The accuracy is that of the tones: lines at combinations are known less well.")
    return said


def sweep_lines(response: SweepResponse, unit: str) -> list[str]:
    """The largest amplitude each way, by how much the ways differ, the jumps.

    Args:
        response: of the FMU.
        unit: of the output, empty where there is none.
    """
    frequencies_hz = response.sweep.frequencies_hz
    lines = []
    for curve in response.curves:
        top = int(np.argmax(curve.amplitudes))
        lines.append(
            f"{curve.direction}ward: largest {curve.amplitudes[top]:.9g} {unit} at "
            f"{hertz(frequencies_hz[top], digits=10)}"
        )
    lines.append(difference_in_words(response))
    lines += [
        f"{jump.direction}ward jump: {0.5 * (jump.low_hz + jump.high_hz):.10g} Hz +- "
        f"{0.5 * (jump.high_hz - jump.low_hz):.3g} Hz"
        for jump in response.jumps
    ]
    return lines


def unsteady_line(
    response: DriveResponse, sideband: Sideband | None, names: Collection[str]
) -> str:
    """Why amplitudes do not stand still, and what would help.

    Args:
        response: of the FMU.
        sideband: what its line beside the tones is, if that is known.
        names: of the FMU's variables.
    """
    beside, tones = response.beside, ", ".join(response.drive.names)
    settle = "more damping, or a longer time before sampling by --settle TIME"
    if beside is None:
        return f"not steady: wanted {settle}"
    found = f"{hertz(beside.at_hz, digits=6)}, {beside.share:.1e} of the largest peak"
    if sideband is None:
        return (
            f"not steady: there is a line at {found}, which is no combination of {tones}; wanted "
            f"{settle}, if it is a free oscillation, or else outputs that hold the tones alone"
        )
    alone = [f"{output}_at_{sideband.tone}" for output in response.drive.outputs]
    known = [name for name in alone if name in names]
    such = f", as {', '.join(known)}" if known else ""
    return (
        f"not steady: there is a line at {sideband.tone} {sideband.sign} {sideband.parameter} = "
        f"{found}, which does not go; whole periods of {tones} do not tell the two apart; wanted "
        f"outputs that hold {sideband.tone} alone{such}"
    )
