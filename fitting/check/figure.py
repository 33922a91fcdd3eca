"""The figure of a check: how far outputs depend on the communication step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fitting.check.runs import ROUNDING
from fitting.check.steps import Repeatability
from fitting.extension.drawing import SERIES, described, new_figure
from fitting.extension.report import Figure as Described

#: Outputs that are drawn, those that differ most.
MOST = len(SERIES)


def draw_repeats(repeats: Repeatability, model: str) -> Described | None:
    """Differences with half the step over time; None where outputs are the same to rounding.

    Args:
        repeats: how well outputs repeat.
        model: name of the model.
    """
    most = np.max(np.nan_to_num(repeats.differences), axis=0)
    shown = [int(k) for k in np.argsort(-most)[:MOST] if most[k] > 0.0]
    if not shown or not repeats.halves > ROUNDING:
        return None
    words = described("check/repeats", model=model, repeats=repeats)
    steps = f"steps of {repeats.step_s:g} s"
    figure = new_figure(words.title, f"{model}, {steps}", synthetic=False, height=3.2)
    axes = figure.subplots()
    for k, colour in zip(shown, SERIES, strict=False):
        values = repeats.differences[:, k]
        known = values > 0.0
        axes.semilogy(
            repeats.times_s[known], values[known], color=colour, label=repeats.outputs[k], lw=1.0
        )
    axes.set_xlabel("time (s)")
    axes.set_ylabel("difference (unit of the output)")
    axes.legend(loc="best")
    return replace(words, drawn=figure, number=1)
