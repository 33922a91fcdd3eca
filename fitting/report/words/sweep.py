"""The scale between simulated and measured amplitudes in words."""

from __future__ import annotations

import math

from fitting.result.result import Scale
from fitting.text.notation import number

KINDS = {
    "maximum": "ratio of the maxima of measured and simulated sweep (Algorithm 1)",
    "fit": "least squares over the whole sweep",
    "robust": "Huber's estimate over the whole sweep",
    "free": "fitted with the rest, the whole sweep its prior",
}


def scale_sentence(scale: Scale) -> str:
    """How the scale was found, its values, and what may bias it.

    Args:
        scale: χ before and after.
    """
    if scale.kind not in KINDS:
        return "Simulated amplitudes are compared as they are, without a scale."
    said = (
        f"Scale χ by {KINDS[scale.kind]}: {number(scale.initial, 6)} with the start, "
        f"{number(scale.final, 6)} with the fitted parameters."
    )
    if scale.kind != "maximum":
        return said
    top = (
        "no top could be fitted to the measured sweep."
        if math.isnan(scale.maximum_bias)
        else f"the largest measured point lies {number(100.0 * scale.maximum_bias, 2)} % "
        f"(± {number(100.0 * scale.maximum_bias_std, 2)} %) off the fitted top of the measured "
        "sweep."
    )
    return (
        f"{said} The grid of the simulated sweep biases it by no more than "
        f"{number(scale.grid_bias, 2)}, relatively; {top}"
    )
