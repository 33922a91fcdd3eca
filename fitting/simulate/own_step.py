"""Steps of an FMU's own: those that it stands still between, and those by which it integrates.

An FMU may advance in steps that it chose itself, whatever it is asked for, or take one step of its
solver in every communication step. Neither is told by most that do so, and both are seen from
outside: the one stands still between its steps, the other answers otherwise in shorter ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.fmu import Run
from fitting.signal.grid import Grid
from fitting.simulate.budget import Basis, Decision, Kind
from fitting.simulate.probe import Probe
from fitting.simulate.settling import SAFETY
from fitting.text.arrays import IntArray, Scalar
from fitting.text.errors import FmuFailure, NoAnswer

#: Looks at a period, from this many samples in it on and this much finer each time, and the
#: samples of a look.
COARSEST, FINER, SCALES, SAMPLES = 64, 8.0, 7, 512
#: Of the samples of a look, how many stand still where the FMU has a step of its own, and how many
#: steps there are to be told apart.
STILL, LEAST_STEPS = 0.2, 8
#: Samples of a closer look at a step, and in one step.
CLOSER, PER_STEP = 4096, 3.3
#: Steps that are tried where an FMU refuses some: so many in a period of the fastest tone.
FEWEST, MOST = 4.0, 1e4
#: The first communication steps of an FMU that integrates by them, in a period, and the change of
#: an amplitude at which a step may be called one that it can be integrated by.
FIRST, COARSE = 16, 0.1
#: How well changes must follow a power of the step, for its order to be called seen, and the part
#: of the change before above which they do not fall.
SEEN, FALLING = 0.2, 0.75
#: Highest order that is looked for.
HIGHEST = 6


@dataclass(frozen=True)
class Steps:
    """Communication steps with what they cost: the grid, the bound, the order that was seen (0)."""

    grid: Grid
    bound: float
    order: int = 0


def grids(step_s: float | None, probe: Probe, settings: Mapping[str, Scalar]) -> Iterator[Grid]:
    """Times that an FMU with a step of its own may be asked at, the likeliest first.

    At the end of its steps, and in the middle between: there an FMU that adds up its time, or that
    rounds it, has made the same number of steps as without rounding.

    Args:
        step_s: step that the FMU was made for, s; None: it tells none.
        probe: trial runs of the FMU.
        settings: values of FMU variables, by name.
    """
    observed = watched_steps_s(probe, settings)
    drive = probe.drives[0]
    given = () if step_s is None else (step_s,)
    for result in dict.fromkeys((*given, *observed)):
        if result * probe.fastest_hz >= 0.5:
            continue
        yield Grid(step_s=result)
        if drive.input is None and drive.approach is None:
            yield Grid(step_s=result, offset=0.5)


def watched_steps_s(probe: Probe, settings: Mapping[str, Scalar]) -> tuple[float, ...]:
    """What the step may be between which the outputs of an FMU stand still, s; empty: they do not.

    Args:
        probe: trial runs of the FMU.
        settings: values of FMU variables, by name.
    """
    spacing_s = 1.0 / (COARSEST * probe.fastest_hz)
    for _ in range(SCALES):
        try:
            moved = _moves(probe, settings, spacing_s, SAMPLES)
        except NoAnswer:
            raise
        except FmuFailure:  # it does not bear such steps
            return ()
        if moved.size < LEAST_STEPS:
            return ()  # finer looks see less
        whole = moved[-1] - moved[0] + 1
        if 1.0 - moved.size / whole > STILL:
            coarse_s = spacing_s * (moved[-1] - moved[0]) / (moved.size - 1)
            return _closer(probe, settings, coarse_s)
        spacing_s /= FINER
    return ()


def _closer(probe: Probe, settings: Mapping[str, Scalar], coarse_s: float) -> tuple[float, ...]:
    """The simplest numbers within what a longer look tells of a step."""
    spacing_s = coarse_s / PER_STEP
    moved = _moves(probe, settings, spacing_s, CLOSER)
    if moved.size < LEAST_STEPS:
        return ()
    step_s = float(spacing_s * (moved[-1] - moved[0]) / (moved.size - 1))
    return simplest(step_s, 1.0 / (PER_STEP * (moved.size - 1)))


def simplest(step_s: float, within: float) -> tuple[float, ...]:
    """The number of fewest digits, and one over such a number, within a part of a step, s.

    Args:
        step_s: as it was seen, s.
        within: what it may be off by, as a part of it.
    """
    decimals = (float(f"{step_s:.{digits}g}") for digits in range(1, 18))
    inverse = (1.0 / float(f"{1.0 / step_s:.{digits}g}") for digits in range(1, 18))
    result = (
        next((f for f in each if abs(f / step_s - 1.0) <= within), step_s)
        for each in (decimals, inverse)
    )
    return tuple(dict.fromkeys(result))


def _moves(
    probe: Probe, settings: Mapping[str, Scalar], spacing_s: float, samples: int
) -> IntArray:
    """Numbers of the samples at which any output differs from the sample before."""
    drive = probe.drives[0]
    pushed = {} if drive.input is None else {drive.input: drive.amplitude}
    run = Run(
        start_values={**drive.start_values, **settings, **pushed},
        settle_s=0.0,
        sample_step_s=spacing_s,
        samples=samples,
        outputs=drive.outputs,
    )
    values = probe.workers.run([run])[0]
    return np.flatnonzero(np.any(np.diff(values, axis=0) != 0.0, axis=1))


# -- steps that are refused -------------------------------------------------------------------


def accepted_grid(
    step_s: float | None, probe: Probe, settings: Mapping[str, Scalar]
) -> Grid | None:
    """The grid of an FMU that refuses steps which are no multiple of its own; None: it takes none.

    Its own step where it tells one, else the shortest of 1, 2 and 5 times the powers of ten before
    one that it refuses: every refusal is the end of a process.

    Args:
        step_s: step that the FMU was made for, s; None: it tells none.
        probe: trial runs of the FMU.
        settings: values of FMU variables, by name.
    """
    highest_s, lowest_s = (1.0 / (n * probe.fastest_hz) for n in (FEWEST, MOST))
    if step_s is not None and step_s * probe.fastest_hz < 0.5 and _takes(probe, settings, step_s):
        return Grid(step_s=step_s)
    powers = range(math.ceil(math.log10(highest_s)), math.floor(math.log10(lowest_s)) - 1, -1)
    result = None
    for tried in (float(f"{digit}e{power}") for power in powers for digit in (5, 2, 1)):
        if lowest_s <= tried <= highest_s:
            if _takes(probe, settings, tried):
                result = Grid(step_s=tried)
            elif result is not None:
                break
    return result


def _takes(probe: Probe, settings: Mapping[str, Scalar], step_s: float) -> bool:
    """Whether the FMU takes some steps of that length."""
    try:
        _moves(probe, settings, step_s, LEAST_STEPS)
    except NoAnswer:
        raise
    except FmuFailure:
        return False
    return True


# -- steps of the solver ----------------------------------------------------------------------


def rests_on_steps(probe: Probe, settings: Mapping[str, Scalar], wanted: float) -> bool:
    """Whether an FMU answers otherwise in communication steps of half the length.

    Not where it does so as much in those of a quarter: that is no error of the steps, but what its
    own solver leaves, whatever they are. An input is held over steps anyway, and how long these may
    be is a decision of its own.

    Args:
        probe: trial runs of the FMU.
        settings: values of FMU variables, by name.
        wanted: relative error of an amplitude that is allowed.
    """
    if any(drive.input is not None for drive in probe.drives):
        return False
    step_s = min(drive.window(0.0, 1, probe.longest_s).step_s for drive in probe.drives)
    half, quarter = (probe.on(Grid(longest_s=part * step_s)) for part in (0.5, 0.25))
    try:
        halved = half.read(settings, 0.0)
        change = probe.errors(probe.read(settings, 0.0), halved)
        if change <= wanted:
            return False
        next_change = probe.errors(halved, quarter.read(settings, 0.0))
    except NoAnswer:
        raise
    except FmuFailure:
        return True
    return not FALLING * change < next_change < COARSE


def first_steps(
    probe: Probe, settings: Mapping[str, Scalar], settle_s: float, work: float
) -> Grid | None:
    """The longest communication steps by which an FMU can be integrated; None: there are none.

    Args:
        probe: trial runs of the FMU.
        settings: values of FMU variables, by name.
        settle_s: time before the first sample, s.
        work: most that a run may cost.
    """
    step_s = 1.0 / (FIRST * probe.fastest_hz)
    while True:
        grid, half = Grid(longest_s=step_s), Grid(longest_s=0.5 * step_s)
        coarse, fine = probe.on(grid), probe.on(half)
        if fine.work(settings, settle_s) > work:
            return None
        try:
            change = fine.errors(coarse.read(settings, settle_s), fine.read(settings, settle_s))
        except NoAnswer:
            raise
        except FmuFailure:  # steps too long for its solver end in what is no number
            change = math.inf
        if change <= COARSE:
            return half
        step_s *= 0.5


def refined_steps(
    probe: Probe, settings: Mapping[str, Scalar], settle_s: float, limits: tuple[float, float]
) -> Steps:
    """The longest communication steps whose error fits into a share, or the best that may be had.

    The error of the shorter steps is twice the change that they make; where three steps show
    changes that fall as the step to a power p, twice the change over 2^p - 1. Steps are shortened
    no further where changes do not fall.

    Args:
        probe: trial runs of the FMU, at the first steps.
        settings: values of FMU variables, by name.
        settle_s: time before the first sample, s.
        limits: relative error that is allowed, and most that a run may cost.
    """
    share, work = limits
    grid, last = probe.drives[0].grid, math.inf
    here, steps = probe.read(settings, settle_s), Steps(grid, 1.0)
    while True:
        grid = replace(grid, longest_s=0.5 * grid.longest_s)
        finer = probe.on(grid)
        if finer.work(settings, settle_s) > work:
            return steps
        there = finer.read(settings, settle_s)
        change = finer.errors(here, there)
        order = _order(last, change)
        steps = Steps(grid, SAFETY * change / (2.0**order - 1.0 if order else 1.0), order)
        if steps.bound <= share or change > FALLING * last:
            return steps
        here, last = there, change


def _order(before: float, after: float) -> int:
    """Power of the step as which changes fall; 0 where they follow none."""
    if not (math.isfinite(before) and after > 0.0):
        return 0
    observed = math.log2(before / after)
    order = round(observed)
    return order if 1 <= order <= HIGHEST and abs(observed - order) <= SEEN else 0


# -- decisions --------------------------------------------------------------------------------


def grid_decision(grid: Grid, basis: Basis, numbers: Mapping[str, Scalar]) -> Decision:
    """The decision on when an FMU with a step of its own is asked.

    Args:
        grid: at which times the FMU is asked.
        basis: how it is known.
        numbers: what its sentence tells besides.
    """
    return Decision(
        kind=Kind.GRID,
        basis=basis,
        bound=0.0,
        numbers={"step_s": grid.step_s, "offset": grid.offset, **numbers},
    )


def steps_decision(steps: Steps, fastest_hz: Sequence[float]) -> Decision:
    """The decision on the communication steps of an FMU that integrates by them.

    Args:
        steps: with what they cost.
        fastest_hz: the fastest tones of the drives, Hz.
    """
    return Decision(
        kind=Kind.STEP,
        basis=Basis.ORDER if steps.order else Basis.COMPARED,
        bound=steps.bound,
        numbers={
            "step_s": steps.grid.longest_s,
            "per_period": 1.0 / (steps.grid.longest_s * max(fastest_hz)),
            "order": steps.order,
            "safety": SAFETY,
        },
    )
