"""The quantities whose error is measured: amplitudes of the drives, and the line width two ways."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.lab.names import AMPLITUDES, WIDTH_SWEEP
from fitting.lab.tradeoff.bench import Bench
from fitting.lab.tradeoff.records import Reference, Setting
from fitting.signal.peaks import fit_resonance
from fitting.signal.scale import nodes_around, refine_maximum
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput

#: Half the span of a sweep, in line widths.
SWEEP_REACH = 3.0
#: Distance of the points about a maximum, all together, in line widths.
CREST_SPAN = 2.0
#: A fit of the width begins with this many times the true one.
FIRST_WIDTH = 1.1


def values_of(bench: Bench, setting: Setting, reference: Reference | None) -> FloatArray:
    """Values of the setting's quantity, shape (n,): amplitudes in the FMU's unit, or the width.

    A fit to amplitudes takes the reference of the amplitudes as its data.

    Args:
        bench: the laboratory: sample, drives, instrument, noise.
        setting: of the simulation: solver, settling, samples.
        reference: truth, or the best that is known.

    Raises:
        BadInput: a sweep in which no line can be found.
        FmuFailure: the FMU failed.
    """
    if setting.quantity == AMPLITUDES:
        return np.concatenate(bench.amplitudes(setting))
    if setting.quantity == WIDTH_SWEEP:
        return np.array([_width_by_sweep(bench, setting)])
    if reference is None:
        raise BadInput("a fit of the width wants reference amplitudes")
    return np.array([_width_by_peaks(bench, setting, np.array(reference.values))])


def error_of(values: FloatArray, reference: Reference) -> float:
    """Largest relative deviation of values from the reference.

    Args:
        values: as they were simulated, any shape.
        reference: truth, or the best that is known.
    """
    return largest_change(values, np.array(reference.values))


def largest_change(values: FloatArray, truth: FloatArray) -> float:
    """Largest relative deviation of values from others.

    Args:
        values: as they were simulated, any shape.
        truth: true values, of the same shape.
    """
    return float(np.max(np.abs(values / truth - 1.0)))


def _twelve_digits(frequencies_hz: Sequence[float] | FloatArray) -> FloatArray:
    """Frequencies as people would write them, whose periods are exact."""
    return np.array([float(f"{f:.12g}") for f in frequencies_hz])


def _width_by_sweep(bench: Bench, setting: Setting) -> float:
    """Width in Hz of one mode and a complex background fitted to a sweep."""
    scene = bench.scene
    reach = SWEEP_REACH * scene.width_hz
    ends = scene.sweep_hz or (scene.centre_hz - reach, scene.centre_hz + reach)
    f = _twelve_digits(np.linspace(ends[0], ends[-1], setting.sweep_points))
    found = bench.amplitudes(setting, [scene.single_tone(float(tone)) for tone in f])
    return fit_resonance(f, np.concatenate(found), background="complex").width.value


def _width_by_peaks(bench: Bench, setting: Setting, data: FloatArray) -> float:
    """Width in Hz by Gauss-Newton steps on the relative deviations r of the amplitudes.

    s <- s - (J . r)/(J . J), s the factor on all damping, J = (r(s (1 + h)) - r(s))/(s h); where
    sweep points are set, amplitudes are taken over the maximum interpolated through them.
    """
    s, h = FIRST_WIDTH, setting.jacobian_step
    for _ in range(setting.iterations):
        r = _ratios(bench, setting, s) / data - 1.0
        moved = _ratios(bench, setting, s * (1.0 + h)) / data - 1.0
        slope = (moved - r) / (s * h)
        square = float(slope @ slope)
        if not square > 0.0:
            break
        s = max(0.1, s - float(slope @ r) / square)
    return s * bench.scene.width_hz


def _ratios(bench: Bench, setting: Setting, factor: float) -> FloatArray:
    """Amplitudes of the drives with the width times a factor, over the sweep's maximum if due."""
    scene = bench.scene.scaled(factor)
    nodes: FloatArray = np.empty(0)
    if setting.sweep_points:
        spacing = CREST_SPAN * scene.width_hz / (setting.sweep_points - 1)
        nodes = _twelve_digits(nodes_around(scene.centre_hz, spacing, setting.sweep_points))
    drives = [*scene.drives, *(scene.single_tone(float(tone)) for tone in nodes)]
    found = bench.amplitudes(setting, drives)
    peaks = np.concatenate(found[: len(scene.drives)])
    if not nodes.size:
        return peaks
    top = refine_maximum(nodes, np.concatenate(found[len(scene.drives) :]))
    return np.asarray(peaks / top.value)
