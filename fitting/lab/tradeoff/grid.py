"""The settings of a scene that are tried: solver, settling, window, sweep points, Jacobian."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

from fitting.lab.names import AMPLITUDES, WIDTH_PEAKS, WIDTH_SWEEP
from fitting.lab.tradeoff.records import FLAT_TOP, HELD, NO_WINDOW, SUBSTEPS, Setting
from fitting.lab.tradeoff.scenes import Scene, Solver

Start = tuple[bool, float]  # periodic start, settling in s


@dataclass(frozen=True, kw_only=True)
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
    left=(1e-2, 1e-4, 1e-8),
    samples=(7, 64),
    flat_beats=(12.37,),
    plain_beats=(5.37, 20.37),
    sweep_points=(9, 41),
    nodes=(3, 7),
    jacobian_steps=(1e-2, 1e-6),
    iterations=(1, 2, 4),
)
#: What is left of a transient where every settling is a long run.
STEPPED_LEFT, ORBIT_LEFT = (1e-2, 1e-4, 1e-6, 1e-10), (1e-2, 1e-4, 1e-7)
#: Finest tolerance and the substeps per period of which a fit of the width is made.
FIT_TOLERANCE, FIT_SUBSTEPS = 0.9e-6, (20.0, 80.0)
#: Samples in a beat for the readers that need no whole periods.
PER_BEAT = 8
#: Held steps per period of a drive that the tool generates.
HELD_STEPS = (8, 16, 32, 64, 128)
#: Jacobian steps and iterations where they are not what is varied.
FEW_JACOBIAN_STEPS, FEW_ITERATIONS = (1e-2, 1e-4), (1, 2, 3)


def settings_of(scene: Scene, *, quick: bool = False) -> list[Setting]:
    """The whole grid of a scene, each setting once, quantity by quantity.

    Args:
        scene: an FMU with start values, tones and truth.
        quick: whether few settings will do.
    """
    grid = _Grid(scene, QUICK if quick else Fineness(), quick)
    found = [s for solver in scene.solvers for s in grid.amplitudes(solver)]
    found += grid.held_amplitudes()
    if scene.linear or (scene.sample is None and scene.sweep_hz and scene.tone):
        found += [s for solver in scene.solvers for s in grid.width_by_sweep(solver)]
    if scene.sample is not None:
        found += [s for solver in scene.solvers for s in grid.width_by_peaks(solver)]
    return list({setting.key: setting for setting in found}.values())


def setting_of(
    scene: Scene, solver: Solver, resolution: float, start: Start, samples: int
) -> Setting:
    """Amplitudes by whole periods, so many samples in each.

    Args:
        scene: an FMU with start values, tones and truth.
        solver: settings that choose a solver.
        resolution: of the solver: substep or samples, as its kind says.
        start: how the run begins.
        samples: number of samples.
    """
    return Setting(
        quantity=AMPLITUDES,
        solver=solver.name,
        values=scene.values_of(solver, resolution, start[0]),
        resolution=resolution,
        resolution_kind=solver.kind,
        periodic=start[0],
        settle_s=start[1],
        window_s=scene.period_s,
        samples=samples,
    )


@dataclass(frozen=True)
class _Grid:
    scene: Scene
    fine: Fineness
    quick: bool

    def amplitudes(self, solver: Solver) -> Iterator[Setting]:
        """Resolution x start x window.

        One window where every run is a long one, and for a solver of some resolution where it has
        not settled.
        """
        scene, usual = self.scene, 64 if self.scene.sample is not None else 7
        bases = self._bases(solver, self._all_starts(solver), usual)
        if solver.kind == SUBSTEPS:
            yield from bases
            if scene.linear and not scene.high_q:
                resolutions = self._resolutions(solver)
                middle = resolutions[len(resolutions) // 2]
                start = (False, scene.settling_s(1e-4))
                yield from self._windows(setting_of(scene, solver, middle, start, usual))
            return
        settled = (True, 0.0) if scene.periodic else (False, scene.settling_s(1e-4))
        for base in bases:
            few = bool(solver.kind) and (base.periodic, base.settle_s) != settled
            yield from [base] if few else self._windows(base)

    def held_amplitudes(self) -> list[Setting]:
        """Held steps x start, of a drive that the tool generates."""
        steps = HELD_STEPS if self.scene.held else ()
        solver, samples = Solver("fmu", kind=HELD), self.fine.samples[0]
        rows = product(steps, self._starts())
        return [setting_of(self.scene, solver, float(n), start, samples) for n, start in rows]

    def width_by_sweep(self, solver: Solver) -> Iterator[Setting]:
        """Points of a sweep x settling; every point is a run."""
        stepped = solver.kind == SUBSTEPS
        if stepped and self.scene.high_q:
            return  # the amplitudes show what it costs; a sweep of it costs as many times more
        starts, points = self._starts(), self.fine.sweep_points
        if stepped:
            longest = self.scene.settling_s(0.9e-6)
            starts, points = [s for s in starts if s[1] <= longest], points[:2]
        for base in self._bases(solver, starts, self._plain_samples(), fitted=True):
            for count in points:
                yield replace(base, quantity=WIDTH_SWEEP, sweep_points=count)

    def width_by_peaks(self, solver: Solver) -> Iterator[Setting]:
        """Points about the maximum x Jacobian step x iterations, at few settlings."""
        scene, starts = self.scene, self._starts()
        stepped, first = solver.kind == SUBSTEPS, solver is scene.solvers[0]
        if stepped and (scene.high_q or (self.quick and not scene.linear)):
            return
        if stepped:
            starts = [s for s in starts if s[1] in map(scene.settling_s, (1e-4, 1e-6))]
        elif not first or solver.kind:
            starts = starts[:1]
        nodes = self.fine.nodes if scene.linear else (0,)
        few = (nodes[1:2] or nodes[:1], FEW_JACOBIAN_STEPS, FEW_ITERATIONS)
        many = (nodes, self.fine.jacobian_steps, self.fine.iterations)
        for base in self._bases(solver, starts, self._plain_samples(), fitted=True):
            start = base.periodic, base.settle_s
            varied = first and start == starts[0] and not solver.kind
            for count, step, iterations in product(*(many if varied else few)):
                yield replace(
                    base,
                    quantity=WIDTH_PEAKS,
                    sweep_points=count,
                    jacobian_step=step,
                    iterations=iterations,
                )

    def _bases(
        self, solver: Solver, starts: list[Start], samples: int, *, fitted: bool = False
    ) -> Iterator[Setting]:
        """Resolution x start; `fitted`: of resolutions that are worth a fit."""
        for resolution, start in product(self._resolutions(solver), starts):
            if not fitted or _worth_a_fit(solver, resolution):
                yield setting_of(self.scene, solver, resolution, start, samples)

    def _windows(self, base: Setting) -> Iterator[Setting]:
        """The setting with every window."""
        for samples in self.fine.samples:
            yield replace(base, samples=samples)
        beat = self.scene.beat_s
        for reader, many in ((FLAT_TOP, self.fine.flat_beats), (NO_WINDOW, self.fine.plain_beats)):
            for beats in many:
                count = math.ceil(PER_BEAT * beats)
                yield replace(base, reader=reader, window_s=beats * beat, samples=count)

    def _starts(self) -> list[Start]:
        """Ways to be rid of the transient."""
        periodic = [(True, 0.0)] if self.scene.periodic else []
        if self.scene.steady:
            return [*periodic, (False, 0.0)]
        return periodic + [(False, self.scene.settling_s(left)) for left in self.fine.left]

    def _all_starts(self, solver: Solver) -> list[Start]:
        """Those of a solver: with a fixed substep and cubic terms also from the averaged orbit."""
        scene, starts = self.scene, self._starts()
        if solver.kind != SUBSTEPS or scene.linear:
            return starts
        if not self.quick:
            starts = [(False, scene.settling_s(left)) for left in STEPPED_LEFT]
        # from the averaged orbit only its error has to settle
        return starts + [(True, scene.settling_s(left)) for left in ORBIT_LEFT]

    def _resolutions(self, solver: Solver) -> tuple[float, ...]:
        return solver.quick if self.quick else solver.resolutions

    def _plain_samples(self) -> int:
        return 7 if self.scene.linear else 64


def _worth_a_fit(solver: Solver, resolution: float) -> bool:
    """The finest resolutions cost most and show nothing new."""
    if solver.kind == SUBSTEPS:
        return resolution in FIT_SUBSTEPS or resolution in solver.quick
    return not solver.kind or resolution > FIT_TOLERANCE
