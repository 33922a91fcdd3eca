"""The quantities whose error is measured: amplitudes of the drives, and the line width two ways."""

from __future__ import annotations

import numpy as np

from fitting.lab import exact as exact_modes
from fitting.lab.tradeoff.bench import Bench
from fitting.lab.tradeoff.records import AMPLITUDES, WIDTH_PEAKS, WIDTH_SWEEP, Reference, Setting
from fitting.lab.tradeoff.scenes import Scene, scaled, single_tone
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
    """Largest relative deviation of values from the reference."""
    truth = np.array(reference.values)
    return float(np.max(np.abs(values / truth - 1.0)))


def exact_references(scene: Scene) -> list[Reference]:
    """What a linear scene of known modes gives, from 50-digit arithmetic."""
    if scene.modes is None or not scene.linear:
        raise ValueError(f"{scene.name}: not a linear scene of known modes")
    tones = [tone for drive in scene.drives for tone in drive.tones_hz]
    peaks = exact_modes.amplitudes(scene.modes, scene.observed, tones) * scene.level
    width = exact_modes.line_width_hz(scene.modes, scene.observed)
    top = exact_modes.crest(scene.modes, scene.observed) * scene.level
    rounding = float(np.finfo(float).eps)
    source = f"closed form with {exact_modes.DIGITS} digits"
    return [
        Reference(AMPLITUDES, tuple(map(float, peaks)), rounding, source),
        Reference(WIDTH_SWEEP, (width,), rounding, source),
        Reference(WIDTH_PEAKS, (width,), rounding, source),
        # data of the fit to amplitudes: those over the maximum of the sweep, as Algorithm 1 does
        Reference(RATIOS, tuple(map(float, peaks / top)), rounding, source),
    ]


#: Name of the reference of amplitudes over the maximum of the sweep.
RATIOS = "amplitudes over the maximum"


def _width_by_sweep(bench: Bench, setting: Setting) -> float:
    """Width in Hz of one mode and a complex background fitted to a sweep."""
    scene = bench.scene
    if scene.sweep_hz:
        low, high = scene.sweep_hz[0], scene.sweep_hz[-1]
        f = np.linspace(low, high, setting.sweep_points)
    else:
        offsets = SWEEP_REACH * scene.width_hz * np.linspace(-1.0, 1.0, setting.sweep_points)
        f = scene.centre_hz + offsets
    f = np.array([float(f"{x:.12g}") for x in f])
    drives = [single_tone(scene, float(tone)) for tone in f]
    a = np.concatenate(bench.amplitudes(setting, drives))
    return fit_resonance(f, a, background="complex").width_hz


def _width_by_peaks(bench: Bench, setting: Setting, data: FloatArray) -> float:
    """Width in Hz by Gauss-Newton steps on the relative deviations r of the amplitudes.

    s <- s - (J . r)/(J . J), s the factor on all damping, J = (r(s (1 + h)) - r(s))/(s h); where
    sweep points are set, amplitudes are taken over the maximum interpolated through them.
    """
    s = FIRST_WIDTH
    for _ in range(setting.iterations):
        h = setting.jacobian_step
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
    scene = scaled(bench.scene, factor)
    nodes: FloatArray = np.empty(0)
    if setting.sweep_points:
        spacing = CREST_SPAN * scene.width_hz / (setting.sweep_points - 1)
        nodes = nodes_around(scene.centre_hz, spacing, setting.sweep_points)
        nodes = np.array([float(f"{x:.12g}") for x in nodes])
    drives = [*scene.drives, *(single_tone(scene, float(tone)) for tone in nodes)]
    found = bench.amplitudes(setting, drives, scene)
    peaks = np.concatenate(found[: len(scene.drives)])
    if not nodes.size:
        return peaks
    top = refine_maximum(nodes, np.concatenate(found[len(scene.drives) :]))
    return np.asarray(peaks / top.value)
