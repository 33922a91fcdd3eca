"""The scale between simulated and measured amplitudes, weak peaks, and the simulation's error."""

from __future__ import annotations

import math
from collections.abc import Iterator

from fitting.fit.options import LIKELIHOOD
from fitting.inference.solved import Solved
from fitting.signal.peaks import DETECTION_SIGMA
from fitting.signal.scale import laboratory_maximum
from fitting.text.estimate import FittedEstimate
from fitting.text.finding import Finding, Kind, note, warning
from fitting.text.notation import hertz

#: Weak peaks that are named one by one.
MOST_WEAK = 3
#: Share of the error by noise from which that by the simulation is reported.
WORTH_SAYING = 0.1


def check_weak_peaks(solved: Solved) -> Iterator[Finding]:
    """Given peaks below what a reader of spectra refuses (`fitting.signal.peaks`)."""
    weak = [
        f"{e.label} at {hertz(tone)}"
        for e in solved.problem.experiments
        for tone, peak, sigma in zip(e.read_hz, e.peaks_v, e.sigmas_v, strict=True)
        if peak < DETECTION_SIGMA * sigma
    ]
    if weak:
        names = {"peaks": tuple(weak[:MOST_WEAK])}
        numbers = {"count": float(len(weak)), "threshold": DETECTION_SIGMA}
        yield warning(Kind.weak_peaks, "peaks", names, **numbers)


def check_scale(solved: Solved) -> Iterator[Finding]:
    """No scale, a measured maximum that Algorithm 1 cannot trust, a bias of the simulated one."""
    campaigns = tuple(solved.problem.campaigns.values())
    sweeps = [bound.sweep for bound in campaigns if bound.sweep is not None]
    if len(campaigns) == 1:
        experiments = campaigns[0].experiments
        gains = [e.phases.unknown == "gain" for e in experiments if e.phases is not None]
        if not sweeps and experiments and not any(gains):
            yield note(Kind.scale_none, "scale")
        elif sweeps and sweeps[0].scale == "maximum":
            maximum = laboratory_maximum(sweeps[0].frequency_hz, sweeps[0].amplitude_v)
            if maximum.on_edge:
                yield warning(Kind.scale_at_edge, "scale", frequency_hz=maximum.frequency_hz)
            elif math.isnan(maximum.bias):
                yield warning(Kind.scale_unknown, "scale", fall=maximum.fall)
            elif maximum.is_biased:
                yield warning(Kind.scale_biased, "scale", bias=maximum.bias)
    wanted = min((bound.setup.accuracy for bound in campaigns), default=math.inf)
    bias = solved.solution.final.scale_bias
    if bias > wanted:
        yield warning(Kind.scale_coarse, "scale", error=bias, accuracy=wanted)


def check_estimator(solved: Solved) -> Iterator[Finding]:
    """That the values are Algorithm 2's and the errors are not; values outside their intervals."""
    if solved.fit.options.estimator == LIKELIHOOD:
        return
    yield note(Kind.estimator, "values")
    for name, value in _every(solved).items():
        if value.status.has_value and value.is_outside:
            low, high = value.ci95
            names = {"unit": (value.unit,)}
            numbers = {"value": value.value, "low": low, "high": high}
            yield warning(Kind.outside_interval, name, names, **numbers)


def check_simulation(solved: Solved) -> Iterator[Finding]:
    """Values of whose errors the simulation's own, or a doubtful scale, is a notable part."""
    moved = {
        name: value
        for name, value in _every(solved).items()
        if value.status.has_value
        and value.simulation > WORTH_SAYING * (value.std - value.simulation)
    }
    if not moved:
        return
    # a doubtful scale is far more than the simulation's own error
    names = {"values": tuple(moved), "units": tuple(v.unit for v in moved.values())}
    shifts, scale_off = {n: v.simulation for n, v in moved.items()}, solved.sweeps.scale_off
    if scale_off > 1.0:
        yield warning(Kind.scale_doubt, "sweep", names, **{"error": scale_off - 1.0} | shifts)
    else:
        error = max(solved.solution.final.promised)
        yield note(Kind.simulation_error, "simulation", names, **{"error": error} | shifts)


def _every(solved: Solved) -> dict[str, FittedEstimate]:
    return {**solved.values, **{offset.name: offset for offset in solved.offsets}}
