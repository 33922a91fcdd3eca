"""The line that the sweep shows by itself, before any model: what the FMU's fit can be held to."""

from __future__ import annotations

import math

from fitting.errors import BadInput
from fitting.instruments import own_estimates
from fitting.labdata import Sweep
from fitting.peaks import fit_resonance
from fitting.result import SweepLine


def line_of_sweep(sweep: Sweep) -> SweepLine:
    """One damped mode fitted to a sweep, with the background that the campaign declares.

    A sweep that shows no such line is no mistake here (another FMU may have two): every number is
    then NaN and the message says why. See `fitting.peaks.fit_resonance` for the formula.
    """
    notes = dict(sweep.notes or {})
    instrument = own_estimates(notes)
    nan = math.nan
    try:
        fit = fit_resonance(
            sweep.frequency_hz, sweep.amplitude_v, background=sweep.background,
            source=sweep.source.name,
        )  # fmt: skip
    except BadInput as error:
        return SweepLine(
            nan, nan, nan, nan, nan, nan, nan, nan, sweep.unit, nan, sweep.background, str(error),
            instrument, notes,
        )  # fmt: skip
    return SweepLine(
        fit.eta_hz, fit.eta_std_hz, fit.width_hz, fit.width_std_hz, fit.q, fit.q_std,
        fit.amplitude, fit.amplitude_std, sweep.unit, fit.residual_rms, sweep.background,
        fit.message, instrument, notes,
    )  # fmt: skip


def line_sentences(line: SweepLine) -> list[str]:
    """The line, and the instrument's own estimate of it, in a sentence each."""
    if math.isnan(line.frequency_hz):
        return [f"Sweep by itself: {line.message}."]
    said = [
        f"Sweep by itself: f = {line.frequency_hz:.9g} +- {line.frequency_std_hz:.2g} Hz, "
        f"width {line.width_hz:.6g} +- {line.width_std_hz:.2g} Hz, "
        f"Q = {line.q:.5g} +- {line.q_std:.2g}, "
        f"A = {line.amplitude:.5g} +- {line.amplitude_std:.2g} {line.unit}, "
        f"residual {100.0 * line.residual:.2g} % of the peak."
    ]
    own = []
    if "frequency_hz" in line.instrument:
        there = line.instrument["frequency_hz"]
        own.append(f"f = {there:.9g} Hz ({there - line.frequency_hz:+.3g} Hz from this fit)")
    if "q" in line.instrument:
        there = line.instrument["q"]
        own.append(f"Q = {there:g} ({100.0 * (there / line.q - 1.0):+.2g} %)")
    if own:
        said.append(f"The instrument's own estimate: {', '.join(own)}.")
    return said
