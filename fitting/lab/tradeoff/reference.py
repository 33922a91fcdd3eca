"""References that errors are measured from, each with its own error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fitting.lab import exact
from fitting.lab.drive import Drive
from fitting.lab.duffing import CLOSED, CubicModes, lines_to_order
from fitting.lab.names import AMPLITUDES, WIDTH_PEAKS, WIDTH_SWEEP
from fitting.lab.string import TwoModes
from fitting.lab.tradeoff.bench import Bench
from fitting.lab.tradeoff.grid import setting_of
from fitting.lab.tradeoff.quantities import largest_change, values_of
from fitting.lab.tradeoff.records import HELD, RATIOS, SUBSTEPS, Reference, Setting
from fitting.lab.tradeoff.scenes import Scene, Solver
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure

#: Orders of the lines in harmonic balance, whose difference is its error.
COARSE_ORDER, ORDER = 11, 15
#: A change of the damping from which the sensitivity of the amplitudes is read.
NUDGE = 1e-2
#: Of the finest and the next finest run of a campaign: what is left of a transient, samples,
#: substeps per period, points of a sweep, held steps as a multiple of the campaign's own.
CAMPAIGN_FINEST = ((1e-13, 129, 640.0, 201, 4), (1e-11, 65, 320.0, 101, 2))


def references_of(bench: Bench) -> list[Reference]:
    """References of every quantity of the bench's scene; of a sample none that took an FMU.

    Args:
        bench: the laboratory: sample, drives, instrument, noise.

    Raises:
        FmuFailure: the FMU failed.
        BadInput: no line in a campaign's sweep.
    """
    scene = bench.scene
    if isinstance(scene.sample, TwoModes):
        return exact_references(scene.sample, scene.tones_hz)
    if isinstance(scene.sample, CubicModes):
        return balanced_references(scene.sample, scene)
    return _of_campaign(bench)


def exact_references(modes: TwoModes, tones_hz: list[float]) -> list[Reference]:
    """What linear modes give, from 50-digit arithmetic.

    Args:
        modes: the two modes: η, damping and angle, as `TwoModes` explains.
        tones_hz: frequencies of the tones, Hz.
    """
    peaks = exact.amplitudes(modes, 0, tones_hz)
    width = exact.line_width_hz(modes, 0)
    found = {
        AMPLITUDES: peaks.tolist(),
        WIDTH_SWEEP: [width],
        WIDTH_PEAKS: [width],
        # data of the fit to amplitudes: those over the maximum of the sweep, as Algorithm 1 does
        RATIOS: (peaks / exact.crest(modes, 0)).tolist(),
    }
    rounding = float(np.finfo(float).eps)
    source = f"closed form with {exact.DIGITS} digits"
    return [
        Reference(quantity=name, values=tuple(values), error=rounding, source=source)
        for name, values in found.items()
    ]


def balanced_references(sample: CubicModes, scene: Scene) -> list[Reference]:
    """What modes with cubic terms give, by harmonic balance: the full equations, no averaging.

    The width is the one that the data are made with; their error shifts it by error over
    sensitivity.

    Args:
        sample: the oscillators.
        scene: an FMU with start values, tones and truth.
    """
    value, before = (_balanced(sample, scene, order) for order in (ORDER, COARSE_ORDER))
    error = max(largest_change(value, before), CLOSED)
    source = f"harmonic balance with lines up to order {ORDER}"
    modes, more = sample.modes, 1.0 + NUDGE
    wider = replace(modes, d1_hz=modes.d1_hz * more, d2_hz=modes.d2_hz * more)
    moved = _balanced(replace(sample, modes=wider), scene, COARSE_ORDER)
    slope = np.abs(moved / value - 1.0) / NUDGE
    shift = error * float(np.sum(slope) / np.sum(slope**2))
    behind = f"the width behind the data; {source}"
    return [
        Reference(quantity=AMPLITUDES, values=tuple(value.tolist()), error=error, source=source),
        Reference(quantity=WIDTH_PEAKS, values=(scene.width_hz,), error=shift, source=behind),
    ]


def _balanced(sample: CubicModes, scene: Scene, order: int) -> FloatArray:
    """Amplitudes of the first mode at the tones of all drives."""
    found = []
    for driven in scene.drives:
        drive = Drive.equal(driven.tones_hz, 1.0)
        lines = lines_to_order(sample.modes, sample.cubic, drive, order)
        found += [abs(lines.at(*tone)[0]) for tone in drive.read]
    return np.array(found)


def _of_campaign(bench: Bench) -> list[Reference]:
    """The finest setting of a campaign's FMU, its distance from the next finest as its error.

    Of the full model; where that takes longer than the campaign's time limit, of the first
    reduction that does not, and the source says so.

    Raises:
        FmuFailure: every one of them failed.
    """
    scene = bench.scene
    quantities = [AMPLITUDES, *([WIDTH_SWEEP] if scene.sweep_hz and scene.tone else [])]
    failures = []
    first = {solver.name: solver for solver in reversed(scene.solvers)}  # of each name
    for solver in reversed(first.values()):
        try:
            return [_finest(bench, solver, quantity) for quantity in quantities]
        except FmuFailure as error:
            failures.append(error)
    raise failures[0]


def _finest(bench: Bench, solver: Solver, quantity: str) -> Reference:
    settings = (_finest_setting(bench.scene, solver, place, quantity) for place in (0, 1))
    value, before = (values_of(bench, setting, None) for setting in settings)
    error = max(largest_change(before, value), float(np.finfo(float).eps))
    source = f"the finest setting ({solver.name}) against the next finest"
    return Reference(quantity=quantity, values=tuple(value.tolist()), error=error, source=source)


def _finest_setting(scene: Scene, solver: Solver, place: int, quantity: str) -> Setting:
    """The finest setting (place 0) or the next (1), every knob of the FMU turned that far."""
    left, samples, substeps, points, held = CAMPAIGN_FINEST[place]
    start = (False, 0.0 if scene.steady else scene.settling_s(left))
    base = setting_of(scene, replace(solver, kind=""), solver.resolutions[0], start, samples)
    values = dict(base.values)
    for other in scene.solvers:
        if other.variable:
            fine = substeps if other.kind == SUBSTEPS else sorted(other.resolutions)[place]
            values[other.variable] = scene.values_of(other, fine)[other.variable]
    return replace(
        base,
        quantity=quantity,
        values=values,
        resolution=float(scene.held * held),
        resolution_kind=HELD if scene.held else "",
        sweep_points=points if quantity == WIDTH_SWEEP else 0,
    )
