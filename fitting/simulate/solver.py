"""What an FMU integrates by: parameters of its solver, steps of its own, communication steps.

A tolerance or a substep is as coarse as a wanted accuracy allows. An FMU may also advance in steps
that it chose itself, whatever it is asked for, or take one step of its solver in every
communication step. Most that do so declare neither, and both are seen from outside: the one stands
still between its steps, the other answers otherwise in shorter ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from fitting.fmu.runs import Run
from fitting.signal.grid import Grid
from fitting.simulate.budget import Basis, Decision, Kind
from fitting.simulate.probe import Knowledge, Probe, attempt
from fitting.simulate.settling import SAFETY
from fitting.text.arrays import IntArray, Scalar

#: A refinement stops when its bound lies within its share and above this part of it.
WASTED = 0.02
ROUNDS = 10
#: By which part of it a tolerance or a substep is tried finer, and the power of it that errors go
#: as, at a guess.
TOLERANCE_PART, SUBSTEP_PART = 0.01, 0.5
TOLERANCE_ORDER, SUBSTEP_ORDER = 1.0, 4.0
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
FIRST, COARSE_STEP = 16, 0.1
#: How well changes must follow a power of the step, for its order to be called seen, and the part
#: of the change before above which they do not fall.
CLEAR, FALLING = 0.2, 0.75
#: Highest order that is looked for.
HIGHEST = 6


# -- parameters of its solver -------------------------------------------------------------------


def limits(known: Knowledge, name: str) -> tuple[float, float]:
    """Least and largest value that the FMU takes of a parameter, in its unit.

    Args:
        known: of the FMU.
        name: of the parameter.
    """
    variable = known.variables.get(name)
    low, high = (None, None) if variable is None else (variable.min, variable.max)
    return max(low or 0.0, 1e-300), math.inf if high is None else high


def part_of(known: Knowledge, name: str) -> float:
    """By which part of it a value of a solver's parameter is tried finer.

    Args:
        known: of the FMU.
        name: of the parameter.
    """
    return TOLERANCE_PART if name == known.annotation.tolerance else SUBSTEP_PART


def solver_error(
    probe: Probe, name: str, settings: Mapping[str, Scalar], settle_s: float, value: float
) -> float:
    """Change of the amplitudes by a finer value; infinite where the FMU fails.

    Below zero: it is not this parameter that sets the accuracy. Where none is finer, the change
    from a coarser one, which is more than what is left.

    Args:
        probe: runs of the drives.
        name: of the parameter.
        settings: start values of all that is decided already.
        settle_s: time to settle, s.
        value: of the parameter.

    Raises:
        NoAnswer: a worker does not answer.
    """
    (low, high), part = limits(probe.known, name), part_of(probe.known, name)
    finer = max(value * part, low)
    coarser = value if finer < value else min(value / part, high)
    here = attempt(partial(probe.read, {**settings, name: coarser}, settle_s))
    better = here and attempt(partial(probe.read, {**settings, name: finer}, settle_s))
    if here is None or better is None:
        return math.inf
    if all((a.tones == b.tones).all() for a, b in zip(here, better, strict=True)):
        return -1.0
    return max(SAFETY * probe.errors(here, better), probe.changes(better, here))


def coarsest_value(  # noqa: PLR0913 - one setting, and what bounds it
    probe: Probe,
    name: str,
    settings: Mapping[str, Scalar],
    settle_s: float,
    *,
    first: float,
    share: float,
    work: float,
) -> tuple[float, float]:
    """Bound and value, the coarsest whose measured error fits into a share.

    The bound is below zero where the parameter changes nothing.

    Args:
        probe: runs of the drives.
        name: of the parameter.
        settings: start values of all that is decided already.
        settle_s: time to settle, s.
        first: value to try first.
        share: relative error that is allowed.
        work: most that a run may cost.

    Raises:
        NoAnswer: a worker does not answer.
    """
    low, high = limits(probe.known, name)
    order = TOLERANCE_ORDER if name == probe.known.annotation.tolerance else SUBSTEP_ORDER
    best, value = (math.inf, first), min(max(first, low), high)
    for _ in range(ROUNDS):
        bound = solver_error(probe, name, settings, settle_s, value)
        if bound < 0.0:
            return bound, value
        # a value that keeps the share beats a finer one that does; else the smaller error
        keeps = best[0] > share or value > best[1] if bound <= share else bound < best[0]
        if keeps:
            best = bound, value
        if WASTED * share <= bound <= share:
            break
        factor = (0.3 * share / max(bound, 1e-300)) ** (1.0 / order)
        factor = min(max(factor, 0.05), 10.0)
        # no finer than runs may take: the work is taken to go as one over the value
        spent = probe.work({**settings, name: value}, settle_s) / work
        there = min(max(value * max(factor, min(1.0, spent)), low), high)
        if there == value or (bound > share and there > 0.9 * value):
            break
        value = there
    return best


# -- steps between which an FMU stands still ----------------------------------------------------


def grids(probe: Probe, settings: Mapping[str, Scalar]) -> Iterator[Grid]:
    """Times at which an FMU with a step of its own may be sampled, the likeliest first.

    At the end of its steps, and in the middle between: there an FMU that adds up its time, or that
    rounds it, has made the same number of steps as without rounding.

    Args:
        probe: trial runs of the FMU.
        settings: values of FMU variables, by name.
    """
    drive, declared_s = probe.drives[0], probe.known.step_s
    observed = own_steps_s(probe, settings)
    for step_s in dict.fromkeys(observed if declared_s is None else (declared_s, *observed)):
        if step_s * probe.fastest_hz >= 0.5:
            continue
        yield Grid(step_s=step_s)
        if drive.input is None and drive.approach is None:
            yield Grid(step_s=step_s, offset=0.5)


def own_steps_s(probe: Probe, settings: Mapping[str, Scalar]) -> tuple[float, ...]:
    """What the step may be between which the outputs of an FMU stand still, s; empty: they do not.

    Args:
        probe: trial runs of the FMU.
        settings: values of FMU variables, by name.
    """
    spacing_s = 1.0 / (COARSEST * probe.fastest_hz)
    for _ in range(SCALES):
        moves = _moves(probe, settings, spacing_s, SAMPLES)
        if moves is None or moves.size < LEAST_STEPS:
            return ()  # it refuses such steps, or finer looks see less
        if 1.0 - moves.size / (moves[-1] - moves[0] + 1) > STILL:
            break
        spacing_s /= FINER
    else:
        return ()
    # a longer look at these steps, of which a number of few digits is the likeliest
    coarse_s = spacing_s * (moves[-1] - moves[0]) / (moves.size - 1)
    spacing_s = coarse_s / PER_STEP
    moves = _moves(probe, settings, spacing_s, CLOSER)
    if moves is None or moves.size < LEAST_STEPS:
        return ()
    step_s = float(spacing_s * (moves[-1] - moves[0]) / (moves.size - 1))
    return simplest(step_s, 1.0 / (PER_STEP * (moves.size - 1)))


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
) -> IntArray | None:
    """Samples at which any output differs from the one before; None: it refuses such steps."""
    drive = probe.drives[0]
    pushed = {} if drive.input is None else {drive.input: drive.amplitude}
    run = Run(
        start_values={**drive.start_values, **settings, **pushed},
        settle_s=0.0,
        sample_step_s=spacing_s,
        samples=samples,
        outputs=drive.outputs,
    )
    answers = attempt(partial(probe.workers.run, [run]))
    if answers is None:
        return None
    return np.flatnonzero(np.any(np.diff(answers[0], axis=0) != 0.0, axis=1))


def accepted_grid(probe: Probe, settings: Mapping[str, Scalar]) -> Grid | None:
    """The grid of an FMU that refuses steps which are no multiple of its own; None: it takes none.

    Its own step where it declares one, else the shortest of 1, 2 and 5 times the powers of ten
    before one that it refuses: every refusal is the end of a process.

    Args:
        probe: trial runs of the FMU.
        settings: values of FMU variables, by name.
    """

    def is_accepted(step_s: float) -> bool:
        return _moves(probe, settings, step_s, LEAST_STEPS) is not None

    declared_s, fastest_hz = probe.known.step_s, probe.fastest_hz
    if declared_s is not None and declared_s * fastest_hz < 0.5 and is_accepted(declared_s):
        return Grid(step_s=declared_s)
    highest_s, lowest_s = (1.0 / (n * fastest_hz) for n in (FEWEST, MOST))
    powers = range(math.ceil(math.log10(highest_s)), math.floor(math.log10(lowest_s)) - 1, -1)
    result = None
    for step_s in (float(f"{digit}e{power}") for power in powers for digit in (5, 2, 1)):
        if lowest_s <= step_s <= highest_s:
            if is_accepted(step_s):
                result = Grid(step_s=step_s)
            elif result is not None:
                break
    return result


def grid_decision(grid: Grid, basis: Basis, **numbers: Scalar) -> Decision:
    """The decision on when an FMU with a step of its own is sampled.

    Args:
        grid: at which times the FMU is asked.
        basis: how it is known.
        **numbers: what its sentence states besides.
    """
    numbers = {"step_s": grid.step_s, "offset": grid.offset, **numbers}
    return Decision(Kind.GRID, basis, 0.0, numbers=numbers)


# -- communication steps by which an FMU integrates ---------------------------------------------


def depends_on_steps(probe: Probe, settings: Mapping[str, Scalar], wanted: float) -> bool:
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
    step_s = min(window.step_s for window in probe.windows(0.0))
    half, quarter = (probe.on(Grid(longest_s=part * step_s)) for part in (0.5, 0.25))
    halved = attempt(partial(half.read, settings, 0.0))
    if halved is None:
        return True
    change = probe.errors(probe.read(settings, 0.0), halved)
    if change <= wanted:
        return False
    quartered = attempt(partial(quarter.read, settings, 0.0))
    return quartered is None or not FALLING * change < probe.errors(halved, quartered) < COARSE_STEP


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
        half = Grid(longest_s=0.5 * step_s)
        finer = probe.on(half)
        if finer.work(settings, settle_s) > work:
            return None
        # steps too long for its solver end in what is no number
        coarse = attempt(partial(probe.on(Grid(longest_s=step_s)).read, settings, settle_s))
        fine = None if coarse is None else attempt(partial(finer.read, settings, settle_s))
        if coarse and fine and finer.errors(coarse, fine) <= COARSE_STEP:
            return half
        step_s *= 0.5


def step_decision(
    probe: Probe, settings: Mapping[str, Scalar], settle_s: float, share: float, work: float
) -> tuple[Grid, Decision]:
    """The longest communication steps whose error fits into a share, or the best that may be had.

    The error of the shorter steps is twice the change that they make; where three steps show
    changes that fall as the step to a power p, twice the change over 2^p - 1. Steps are shortened
    no further where changes do not fall.

    Args:
        probe: trial runs of the FMU, at the first steps.
        settings: values of FMU variables, by name.
        settle_s: time before the first sample, s.
        share: relative error that is allowed.
        work: most that a run may cost.
    """
    grid, bound, order, last = probe.drives[0].grid, 1.0, 0, math.inf
    here = probe.read(settings, settle_s)
    while True:
        shorter = replace(grid, longest_s=0.5 * grid.longest_s)
        finer = probe.on(shorter)
        if finer.work(settings, settle_s) > work:
            break
        there = finer.read(settings, settle_s)
        change = finer.errors(here, there)
        power = math.log2(last / change) if math.isfinite(last) and change > 0.0 else 0.0
        order = round(power)
        if not 1 <= order <= HIGHEST or abs(power - order) > CLEAR:
            order = 0
        grid, bound = shorter, SAFETY * change / (2.0**order - 1.0 if order else 1.0)
        if bound <= share or change > FALLING * last:
            break
        here, last = there, change
    numbers: dict[str, Scalar] = {
        "step_s": grid.longest_s,
        "per_period": 1.0 / (grid.longest_s * probe.fastest_hz),
        "order": order,
        "safety": SAFETY,
    }
    basis = Basis.ORDER if order else Basis.COMPARED
    return grid, Decision(Kind.STEP, basis, bound, numbers=numbers)
