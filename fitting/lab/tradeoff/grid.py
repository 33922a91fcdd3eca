"""The settings of a scene that are tried: solver, settling, window, sweep points, Jacobian."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

from fitting.lab.tradeoff.bench import HELD, SUBSTEPS, setting_values
from fitting.lab.tradeoff.reading import LONGEST_PERIOD_S
from fitting.lab.tradeoff.records import (
    AMPLITUDES,
    COHERENT,
    FLAT_TOP,
    NO_WINDOW,
    WIDTH_PEAKS,
    WIDTH_SWEEP,
    Setting,
)
from fitting.lab.tradeoff.scenes import Scene, Solver
from fitting.signal.tones import common_period


@dataclass(frozen=True)
class Fineness:
    """How far the grid goes: what is left of a transient, samples, beats, points, steps."""

    left: tuple[float, ...] = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10)
    samples: tuple[int, ...] = (5, 7, 16, 30, 64, 256)
    flat_beats: tuple[float, ...] = (12.37, 24.37, 48.37)
    plain_beats: tuple[float, ...] = (1.37, 5.37, 20.37, 80.37)
    sweep_points: tuple[int, ...] = (9, 17, 41, 101)
    nodes: tuple[int, ...] = (3, 5, 7, 11, 21)
    jacobian_steps: tuple[float, ...] = (1e-1, 1e-2, 1e-4, 1e-6, 1e-8)
    iterations: tuple[int, ...] = (1, 2, 3, 4, 6)


QUICK = Fineness(
    (1e-2, 1e-4, 1e-8), (7, 64), (12.37,), (5.37, 20.37), (9, 41), (3, 7), (1e-2, 1e-6), (1, 2, 4)
)
#: What is left of a transient where every settling is a long run.
STEPPED_LEFT, ORBIT_LEFT = (1e-2, 1e-4, 1e-6, 1e-10), (1e-2, 1e-4, 1e-7)
#: Finest tolerance and the substeps per period of which a fit of the width is made.
FIT_TOLERANCE, FIT_SUBSTEPS = 0.9e-6, (20.0, 80.0)
#: Samples in a beat for the readers that need no whole periods.
PER_BEAT = 8
#: Held steps per period of a drive that the tool generates.
HELD_STEPS = (8, 16, 32, 64, 128)


def settings_of(scene: Scene, *, quick: bool = False) -> list[Setting]:
    """The whole grid of a scene, each setting once, quantity by quantity."""
    fine = QUICK if quick else Fineness()
    found = [*_amplitudes(scene, fine, quick)]
    if scene.modes is not None and scene.linear:
        found += [*_width_by_sweep(scene, fine, quick), *_width_by_peaks(scene, fine, quick)]
    elif scene.modes is not None:
        found += [*_width_by_peaks(scene, fine, quick)]
    elif scene.sweep_hz and scene.tone:
        found += [*_width_by_sweep(scene, fine, quick)]
    return list({setting.key: setting for setting in found}.values())


def beat_s(scene: Scene) -> float:
    """Period of the slowest beat of any drive, s."""
    gaps = [
        abs(a - b)
        for drive in scene.drives
        for i, a in enumerate(drive.tones_hz)
        for b in drive.tones_hz[:i]
    ]
    return 1.0 / min(gaps, default=scene.width_hz)


def period_s(scene: Scene) -> float:
    """Longest common period of the tones of a drive, s; some beats where there is none."""
    periods = [float(common_period(drive.tones_hz)) for drive in scene.drives]
    return max(p if p <= LONGEST_PERIOD_S else 2.5 * beat_s(scene) for p in periods)


def _resolutions(solver: Solver, quick: bool) -> tuple[float, ...]:
    return solver.quick if quick else solver.resolutions


def _starts(scene: Scene, fine: Fineness) -> Iterator[tuple[bool, float]]:
    """Ways to be rid of the transient: (periodic start, settling in s)."""
    if scene.start:
        yield True, 0.0
    if scene.steady:
        yield False, 0.0
    else:
        for left in fine.left:
            yield False, scene.settling_s(left)


def _setting(
    scene: Scene,
    solver: Solver,
    resolution: float,
    start: tuple[bool, float],
    window: tuple[str, float, int],
    quantity: str = AMPLITUDES,
    *,
    points: int = 0,
    jacobian_step: float = 0.0,
    iterations: int = 0,
) -> Setting:
    reader, window_s, samples = window
    return Setting(
        quantity,
        solver.name,
        setting_values(scene, solver, resolution, start[0]),
        resolution,
        solver.kind,
        start[0],
        start[1],
        reader,
        window_s,
        samples,
        points,
        jacobian_step,
        iterations,
    )


def _windows(scene: Scene, fine: Fineness) -> Iterator[tuple[str, float, int]]:
    """(reader, length in s, samples)."""
    for samples in fine.samples:
        yield COHERENT, period_s(scene), samples
    beat = beat_s(scene)
    for reader, many in ((FLAT_TOP, fine.flat_beats), (NO_WINDOW, fine.plain_beats)):
        for beats in many:
            yield reader, beats * beat, math.ceil(PER_BEAT * beats)


def _amplitudes(scene: Scene, fine: Fineness, quick: bool) -> Iterator[Setting]:
    """Solver x resolution x start x window."""
    for solver in scene.solvers:
        if solver.kind == SUBSTEPS:
            yield from _stepped(scene, solver, fine, quick)
        else:
            yield from _free(scene, solver, fine, quick)
    if scene.held:
        window = next(_windows(scene, fine))
        held = Solver("fmu", kind=HELD)
        for count in HELD_STEPS:
            for start in _starts(scene, fine):
                yield _setting(scene, held, float(count), start, window)


def _free(scene: Scene, solver: Solver, fine: Fineness, quick: bool) -> Iterator[Setting]:
    """A solver whose steps are its own: every window; one of them where it has not settled."""
    windows = list(_windows(scene, fine))
    settled = (bool(scene.start), 0.0 if scene.start else scene.settling_s(1e-4))
    for resolution in _resolutions(solver, quick):
        for start in _starts(scene, fine):
            few = bool(solver.kind) and start != settled
            for window in [_usual_window(scene)] if few else windows:
                yield _setting(scene, solver, resolution, start, window)


def _stepped(scene: Scene, solver: Solver, fine: Fineness, quick: bool) -> Iterator[Setting]:
    """A solver with a fixed substep: one window, because every one of them is a long run."""
    window = _usual_window(scene)
    starts = list(_starts(scene, fine))
    if not (scene.linear or quick):
        starts = [(False, scene.settling_s(left)) for left in STEPPED_LEFT]
    if not scene.linear:
        # from the averaged orbit, of which only the error has to settle
        starts += [(True, scene.settling_s(left)) for left in ORBIT_LEFT]
    resolutions = _resolutions(solver, quick)
    for resolution in resolutions:
        for start in starts:
            yield _setting(scene, solver, resolution, start, window)
    if scene.linear and not scene.high_q:
        middle = resolutions[len(resolutions) // 2]
        for other in _windows(scene, fine):
            yield _setting(scene, solver, middle, (False, scene.settling_s(1e-4)), other)


def _usual_window(scene: Scene) -> tuple[str, float, int]:
    return COHERENT, period_s(scene), 64 if scene.modes is not None else 7


def _plain_window(scene: Scene) -> tuple[str, float, int]:
    return COHERENT, period_s(scene), 7 if scene.linear else 64


def _width_by_sweep(scene: Scene, fine: Fineness, quick: bool) -> Iterator[Setting]:
    """Points of a sweep x settling x solver; every point is a run."""
    window = _plain_window(scene)
    for solver in scene.solvers:
        if solver.kind == SUBSTEPS and scene.high_q:
            continue  # the amplitudes show what it costs; a sweep of it costs as many times more
        for resolution in filter(partial(_fitted, solver), _resolutions(solver, quick)):
            for start in _starts(scene, fine):
                if solver.kind == SUBSTEPS and start[1] > scene.settling_s(0.9e-6):
                    continue
                points = fine.sweep_points[:2] if solver.kind == SUBSTEPS else fine.sweep_points
                for count in points:
                    yield _setting(
                        scene, solver, resolution, start, window, WIDTH_SWEEP, points=count
                    )


def _fitted(solver: Solver, resolution: float) -> bool:
    """Whether fits are made at this resolution: the finest ones cost most and show nothing new."""
    if solver.kind == SUBSTEPS:
        return resolution in FIT_SUBSTEPS or resolution in solver.quick
    return not solver.kind or resolution > FIT_TOLERANCE


def _width_by_peaks(scene: Scene, fine: Fineness, quick: bool) -> Iterator[Setting]:
    """Points about the maximum x Jacobian step x iterations, at few settlings of each solver."""
    window = _plain_window(scene)
    nodes = fine.nodes if scene.linear else (0,)
    first = scene.solvers[0]
    for solver in scene.solvers:
        if solver.kind == SUBSTEPS and (scene.high_q or (quick and not scene.linear)):
            continue
        full = solver is first
        starts = list(_starts(scene, fine))
        if solver.kind == SUBSTEPS:
            starts = [s for s in starts if s[1] in (scene.settling_s(1e-4), scene.settling_s(1e-6))]
        elif not full or solver.kind:
            starts = starts[:1]
        for resolution in filter(partial(_fitted, solver), _resolutions(solver, quick)):
            for start in starts:
                varied = full and start == starts[0] and not solver.kind
                for count in nodes if varied else nodes[1:2] or nodes[:1]:
                    for step in fine.jacobian_steps if varied else (1e-2, 1e-4):
                        for iterations in fine.iterations if varied else (1, 2, 3):
                            yield _setting(
                                scene,
                                solver,
                                resolution,
                                start,
                                window,
                                WIDTH_PEAKS,
                                points=count,
                                jacobian_step=step,
                                iterations=iterations,
                            )
