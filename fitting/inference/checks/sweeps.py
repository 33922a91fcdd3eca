"""Sweeps against peaks and bounds, the scale between simulation and measurement, and drift."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import replace

from fitting.campaign import BoundCampaign
from fitting.campaign.parameters import Parameter
from fitting.fit.options import LIKELIHOOD
from fitting.inference.solved import Solved
from fitting.inference.sweep_line import SweepLine, line_findings
from fitting.signal.combinations import mixed_hz
from fitting.signal.peaks import DETECTION_SIGMA, unknown_line
from fitting.signal.scale import laboratory_maximum
from fitting.text.errors import BadInput
from fitting.text.estimate import FittedEstimate, OffsetEstimate
from fitting.text.finding import Finding, Kind, note, warning
from fitting.text.notation import hertz
from fitting.text.units import convert

#: Factors between the amplitudes of a sweep and of peaks, and what makes them.
FACTORS = {
    math.sqrt(2.0): "rms",
    math.sqrt(0.5): "rms",
    2.0: "peak_to_peak",
    0.5: "peak_to_peak",
}
#: Factors of a unit with a wrong prefix, and the ratio of bounds that imply a frequency.
PREFIXES = (1e3, 1e-3, 1e6, 1e-6)
NARROW = 10.0
#: How far lines of one experiment may be apart, relative.
NEAR = 0.2
#: Highest order of mixtures of tones that explain a line of a spectrum.
MIXED_ORDER = 5
#: Weak peaks that are named one by one.
MOST_WEAK = 3
#: Share of the error by noise from which that by the simulation is reported.
WORTH_SAYING = 0.1
#: A drift of this share of the line width may be why a model does not describe the data: half of it
#: as a departure from a straight line moves a peak on the flank by some per cent.
SUSPECT = 0.1


# --- sweeps ---------------------------------------------------------------------------------------


def check_lines(solved: Solved) -> Iterator[Finding]:
    """What a reader of the sweeps must know: of their lines, of points and tops that no line has.

    Of one campaign; and points of files that are not fitted.
    """
    measurements, sweeps = solved.problem.measurements, solved.sweeps
    fitted = any(m.rows for m in measurements if m.is_curve)
    for line in () if solved.problem.is_joint else sweeps.lines.values():
        yield from line_findings(line, fitted=fitted)
    yield from sweeps.faults
    for name, bound in solved.problem.campaigns.items():
        for finding in () if bound.sweep is None else bound.sweep.left_out:
            yield replace(finding, subject=name)
    for measurement in measurements:
        for finding in measurement.left_out:
            yield replace(finding, subject=measurement.series)


def check_agreement(solved: Solved) -> Iterator[Finding]:
    """Series whose peaks contradict their sweep, and the factor that would explain it."""
    for test in solved.sweeps.agreement:
        if not test.contradicts:
            continue
        numbers: dict[str, float] = {"sigmas": test.sigmas}
        if not math.isnan(test.factor):
            numbers |= {"factor": test.factor, "factor_std": test.factor_std}
        reasons = [
            why
            for value, why in FACTORS.items()
            if abs(test.factor / value - 1.0) < max(0.02, 3.0 * test.factor_std / value)
        ]
        names = {"reason": tuple(reasons[:1])}
        yield warning(Kind.scale_contradicted, test.series, names, **numbers)


def check_frequency_bounds(solved: Solved) -> Iterator[Finding]:
    """Bounds of a frequency that are a unit's prefix off the line of the sweep."""
    for name, line in solved.sweeps.lines.items():
        sweep = solved.problem.campaigns[name].sweep
        file = "" if sweep is None else sweep.source.name
        yield from bounds_off_line(solved.problem.parameters, line, file)


def bounds_off_line(
    parameters: tuple[Parameter, ...], line: SweepLine, file: str
) -> Iterator[Finding]:
    """The first frequency whose bounds are off the line by a prefix, if all are.

    Wide bounds, as those of a width, imply no frequency and do not count.

    Args:
        parameters: of the problem.
        line: of a sweep.
        file: of the sweep.
    """
    boxes = []
    for p in parameters:
        try:
            low, high = (convert(e, p.unit, "Hz", where=p.name) for e in (p.lower, p.upper))
        except BadInput:  # no frequency
            continue
        if 0.0 < low < high < NARROW * low:
            places = (f for f in PREFIXES if low <= f * line.frequency.value <= high)
            boxes.append((p.name, low, high, next(places, 0.0)))
    if boxes and all(factor for *_, factor in boxes):
        name, low, high, factor = boxes[0]
        numbers = {"frequency_hz": line.frequency.value, "lower_hz": low, "upper_hz": high}
        names = {"file": (file,)}
        yield warning(Kind.bounds_off_line, name, names, **numbers, factor=factor)


def check_frequencies(solved: Solved) -> Iterator[Finding]:
    """Frequencies of a sweep that are a unit's prefix off those of the experiments."""
    for name, line in solved.sweeps.lines.items():
        campaign = solved.problem.campaigns[name]
        tones = [float(f) for e in campaign.experiments for f in e.tones_hz]
        if campaign.sweep is None or not tones:
            continue
        here, other = line.frequency.value, statistics.median(tones)
        if any(abs(other / (factor * here) - 1.0) < NEAR for factor in PREFIXES):
            names = {"file": (campaign.sweep.source.name,)}
            numbers = {"frequency_hz": here, "other_hz": other}
            yield warning(Kind.frequencies_apart, name, names, **numbers)


def check_unknown_lines(solved: Solved) -> Iterator[Finding]:
    """The largest line in the spectra at no tone of the drive, nor at a mixture of tones."""
    unknown = []
    for e in solved.problem.experiments:
        if e.spectrum is not None:
            known = (*e.tones_hz, *e.read_hz, *mixed_hz(e.tones_hz, MIXED_ORDER))
            line = unknown_line(e.spectrum.frequency_hz, e.spectrum.amplitude_v, known)
            if line is not None:
                unknown.append((e.label, e.spectrum.unit, *line))
    if unknown:
        label, unit, place, height = max(unknown, key=lambda each: each[3])
        numbers = {"count": float(len(unknown)), "frequency_hz": place, "height": height}
        yield warning(Kind.unknown_line, label, {"unit": (unit,)}, **numbers)


# --- the scale, and the simulation's error --------------------------------------------------------


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
        gains = [e.unknown == "gain" for e in experiments if e.phases_rad is not None]
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


# --- drift ----------------------------------------------------------------------------------------


def check_drift(solved: Solved) -> Iterator[Finding]:
    """The drift of every campaign against the width of its sweep's line, else the declared one."""
    describes = solved.describes or bool(solved.causes)
    for name, bound in solved.problem.campaigns.items():
        labels = {e.label for e in bound.experiments}
        labels |= set() if bound.sweep is None else {bound.sweep.label}
        offsets = tuple(o for o in solved.offsets if o.experiments[0] in labels)
        line = solved.sweeps.lines.get(name)
        width_hz = math.nan if line is None else line.width.value
        if not width_hz > 0.0:
            width_hz = bound.setup.line_width_hz or math.nan
        yield from drift_findings(bound, offsets, width_hz, describes, name)


def drift_findings(
    bound: BoundCampaign,
    offsets: Sequence[OffsetEstimate],
    width_hz: float,
    describes: bool = True,
    subject: str = "",
) -> Iterator[Finding]:
    """Where the drift over the series, or an offset from it, exceeds the line width.

    Of a model that does not describe the data a smaller drift is named too: it may be the cause.

    Args:
        bound: campaign, bound to its FMU.
        offsets: values of single experiments.
        width_hz: full line width, Hz; NaN: not known.
        describes: whether the model describes the data.
        subject: name of the campaign where there are several.
    """
    if not width_hz > 0.0:
        return
    moved = {
        name: abs(after - before) * _in_hertz(bound.drift.units.get(name, "Hz"))
        for name, (before, after) in bound.drift.ends.items()
    }
    wide = {name: hz for name, hz in moved.items() if hz > width_hz}
    suspected = not (describes or offsets) and max(moved.values(), default=0.0) > SUSPECT * width_hz
    if wide or suspected:
        kind = Kind.drift_wide if wide else Kind.drift_suspected
        shown = wide or moved
        names = {"variables": tuple(shown), "offsets": tuple(o.name for o in offsets)}
        finding = note if describes else warning
        yield finding(kind, subject, names, **{"width_hz": width_hz} | shown)
    far = {
        f"{o.experiments[0]} ({', '.join(o.variables)})": abs(o.value) * _in_hertz(o.unit)
        for o in offsets
        if not math.isnan(o.prior) and abs(o.value) * _in_hertz(o.unit) > width_hz
    }
    if far:
        names = {"offsets": tuple(far)}
        yield warning(Kind.drift_offset_wide, subject, names, **{"width_hz": width_hz} | far)


def _in_hertz(unit: str) -> float:
    """Hertz per unit, zero where it is no frequency."""
    try:
        return convert(1.0, unit, "Hz", where="")
    except BadInput:
        return 0.0
