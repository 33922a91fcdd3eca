"""What a reader of the result must know of the data themselves: their scale, and weak peaks."""

from __future__ import annotations

import math
from collections.abc import Sequence

from fitting.campaign import BoundCampaign, Experiment
from fitting.signal.peaks import DETECTION_SIGMA
from fitting.signal.scale import LaboratoryMaximum
from fitting.text.notation import hertz

#: Weak peaks that are named one by one.
MOST_NAMED = 3


def data_warnings(
    campaigns: Sequence[BoundCampaign], maximum: LaboratoryMaximum | None, scale_bias: float
) -> list[str]:
    """Sentences on peaks, on the measured maximum and on the simulated one's bias."""
    said = weak_peaks([e for bound in campaigns for e in bound.experiments])
    sweeps = [bound.sweep for bound in campaigns if bound.sweep is not None]
    if len(campaigns) == 1 and not sweeps:
        said.append("No sweep: simulated amplitudes are compared as they are, in the FMU's unit.")
    elif maximum is not None and sweeps[0].scale == "maximum":
        said += maximum_warnings(maximum)
    wanted = min(bound.setup.accuracy for bound in campaigns)
    if scale_bias > wanted:
        said.append(
            f"The simulated maximum is known to {scale_bias:.1e} only, wanted {wanted:.1e}."
        )
    return said


def weak_peaks(experiments: Sequence[Experiment]) -> list[str]:
    """Ready peaks below what a reader of spectra would have refused (`fitting.signal.peaks`)."""
    weak = [
        f"{experiment.label} at {hertz(tone)}"
        for experiment in experiments
        for tone, peak, sigma in zip(
            experiment.read_hz, experiment.peaks_v, experiment.sigmas_v, strict=True
        )
        if peak < DETECTION_SIGMA * sigma
    ]
    if not weak:
        return []
    more = f" and {len(weak) - MOST_NAMED} more" if len(weak) > MOST_NAMED else ""
    return [
        f"Peaks less than {DETECTION_SIGMA:.0f} standard deviations high: "
        f"{', '.join(weak[:MOST_NAMED])}{more}. Noise alone makes such peaks, and makes small ones "
        "larger than they are."
    ]


def maximum_warnings(maximum: LaboratoryMaximum) -> list[str]:
    """What Algorithm 1 cannot know of a sweep with such a largest point."""
    if maximum.on_edge:
        return [
            f"The largest point of the sweep, at {hertz(maximum.frequency_hz)}, is at its end: its "
            'maximum may lie outside, and the scale may be wrong (scale = "fit" needs no maximum).'
        ]
    if math.isnan(maximum.bias):
        return [
            "The sweep shows no top that could be fitted, it falls by "
            f"{100 * maximum.fall:.0f} % beside its largest point: noise, or a grid coarser than "
            'the line, biases the scale by an unknown amount (scale = "fit" avoids it).'
        ]
    if not maximum.is_biased:
        return []
    return [
        f"The largest point of the sweep is {100 * maximum.bias:+.2f} % from the fitted top of it: "
        'noise or a coarse grid biases the scale by as much (scale = "fit" avoids it).'
    ]
