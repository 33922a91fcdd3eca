"""What a reduction leaves out, measured against the full model with its substep refined."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from fitting.simulate.probe import Probe, off
from fitting.simulate.settling import SAFETY, watch
from fitting.text.arrays import Scalar

#: Both models settle until what is left of the transient is this part of what is wanted.
STEADY = 0.02
#: The full model is fine enough when its own error is this part of the reduction's.
FINE = 0.1
#: Halvings of the substep, at most, and the largest factor by which one may have helped.
HALVINGS, ORDER_FOUR = 8, 16.0


@dataclass(frozen=True)
class Refined:
    """The full model: its start values, the name of its substep and a first value of that, s.

    `order`: no combination of tones up to it folds onto a tone, as only one of the models has them.
    """

    settings: Mapping[str, Scalar]
    substep: str
    first: float
    order: int

    def at(self, step: float) -> dict[str, Scalar]:
        """Its start values with that substep."""
        return {**self.settings, self.substep: step}


def measured_error(
    probe: Probe,
    reduced: Mapping[str, Scalar],
    full: Refined,
    wanted: tuple[float, float],
    limit_s: float,
) -> tuple[float, str] | None:
    """Bound of a reduction's error by runs of the full model, and how it was found; None: by none.

    2 (|reduced - full| + own) + what is left of both transients, relative to each amplitude. `own`
    is the full model's error, by Richardson's rule |h -> h/2| / (r - 1) with the factor r <= 16 by
    which the change fell from one halving to the next (all of the change where r < 2). Halving
    ends when the bound is at most the first of `wanted` or cannot come below the second, when
    `own` is small beside the reduction's error, or when a run would take more than `limit_s`.
    None: the substep changes nothing, or no run is affordable.

    Raises:
        BadInput: no sampling keeps combinations of the tones off them up to that order.
        FmuFailure: the FMU failed.
    """
    enough, most = wanted
    steady = watch(probe, full.settings, STEADY * most, limit_s)
    cheap = probe.read(reduced, steady.settle_s, full.order)[0]
    step, previous, best = full.first, math.inf, math.inf
    here, seconds = probe.read(full.at(step), steady.settle_s, full.order)
    how = ""
    for _ in range(HALVINGS):
        if 2.0 * seconds > limit_s:
            break
        step /= 2.0
        better, seconds = probe.read(full.at(step), steady.settle_s, full.order)
        change, error = off(here, better), off(cheap, better)
        if change == 0.0:
            return None  # it is not the substep that sets the full model's accuracy
        fell = min(previous / change, ORDER_FOUR) if previous < math.inf else 1.0
        own = change / max(fell - 1.0, 1.0)
        bound = SAFETY * (error + own) + 2.0 * steady.bound
        if bound < best:
            best = bound
            how = (
                f"measured: {SAFETY:g} times the {error:.1e} by which it differs from the full "
                f"model with {full.substep} = {step:.3g} and that one's own {own:.1e} (by halving)"
            )
        if bound <= enough or own <= FINE * error or SAFETY * (error - 2.0 * own) > most:
            break
        here, previous = better, change
    return (best, how) if how else None
