"""Figure of an FRF: upward and downward sweep over the frequency, jumps marked."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fitting.report.figures.style import (
    BLUE,
    GREY,
    RED,
    Drawing,
    new_figure,
    plain_ticks,
    save,
    style,
)
from fitting.simulate.frf import FrfResult
from fitting.text.notation import mathtext, number, prefixed, scaling_for

#: Up to so many points each is marked.
MOST_MARKS = 81
LOOKS = {"up": (BLUE, "^", "-"), "down": (RED, "v", "--")}


def save_frf(result: FrfResult, model: str, unit: str, folder: Path) -> list[Path]:
    """Draw and write the figure; the files written."""
    with style():
        file = save(draw_frf(result, model, unit), folder)
    return [file.png, file.svg]


def draw_frf(result: FrfResult, model: str, unit: str) -> Drawing:
    """Amplitude over frequency, each way with a marker of its own."""
    sweep = result.sweep
    title = f"Amplitude of {sweep.output} under a moved tone"
    figure = new_figure(title, model, synthetic=False, height=3.4)
    axes = figure.subplots()
    along = scaling_for(sweep.frequencies_hz, "Hz")
    f = [along(u) for u in sweep.frequencies_hz]
    factor, shown = prefixed(max(float(np.max(c.amplitudes)) for c in result.curves), unit)
    for curve in result.curves:
        colour, marker, line = LOOKS[curve.direction]
        axes.plot(
            f,
            curve.amplitudes / factor,
            color=colour,
            linestyle=line,
            linewidth=1.2,
            marker=marker if len(f) <= MOST_MARKS else "",
            markersize=4.0,
            fillstyle="none",
            label=f"{curve.direction}ward",
        )
    for jump in result.jumps:
        at = along(0.5 * (jump.low_hz + jump.high_hz))
        axes.axvline(at, color=GREY, linewidth=0.8, linestyle=":", zorder=0)
        side = "left" if jump.direction == "up" else "right"
        axes.annotate(
            f"{jump.direction}ward jump",
            (at, 0.97),
            xycoords=("data", "axes fraction"),
            rotation=90,
            ha=side,
            va="top",
            fontsize=7.5,
            color=GREY,
        )
    axes.set_xlabel(along.label(f"frequency {mathtext(sweep.tone)}"))
    axes.set_ylabel(f"amplitude ({shown + ', ' if shown else ''}peak)")
    top = max(float(np.max(c.amplitudes)) for c in result.curves) / factor
    axes.set_ylim(0.0, (1.7 if result.jumps else 1.1) * top)  # room for the words at the jumps
    axes.set_xlim(f[0], f[-1])
    plain_ticks(axes)
    axes.legend(loc="upper left")
    caption = (
        f"{title}, {model}: {len(f)} points, phase and state carried on from point to point. "
        + " ".join(f"{reason[0].upper()}{reason[1:]}." for reason in result.reasons)
    )
    caption += "".join(
        f" The {jump.direction}ward sweep jumps between {number(jump.low_hz, 10)} and "
        f"{number(jump.high_hz, 10)} Hz."
        for jump in result.jumps
    )
    return Drawing("sweep", title, caption, caption, figure)
