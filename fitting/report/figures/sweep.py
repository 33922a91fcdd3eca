"""Figure of the frequency response: laboratory, resonance fit, simulation."""

from __future__ import annotations

import numpy as np

from fitting.report import plot
from fitting.report.figures.style import Drawing, new_figure
from fitting.report.plot.sweep import resonance_words
from fitting.report.shown import ShownCampaign, ShownSweep
from fitting.result.result import Result, SweepCurves


def draw_response(result: Result, data: ShownCampaign) -> Drawing:
    """The laboratory's frequency response with its resonance fit, and the simulated sweep.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    sweep, curves = data.sweep, result.sweep
    if sweep is None or curves is None:
        raise ValueError("a campaign without a sweep has no frequency response to draw")
    title = "Frequency response: laboratory, resonance fit, simulation"
    figure = new_figure(title, data.title, synthetic=data.synthetic, height=5.2)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.6, 1.0))
    plot.frequency_response(curves, resonance=sweep.resonance, unit=sweep.unit, ax=upper)
    plot.response_residuals(curves, resonance=sweep.resonance, ax=lower)
    upper.set_xlabel("")
    upper.legend(loc="upper left")
    caption, alt = _response_words(result, sweep, curves)
    return Drawing(
        name="8_frequency_response", title=title, caption=caption, alt=alt, figure=figure
    )


def _response_words(result: Result, sweep: ShownSweep, curves: SweepCurves) -> tuple[str, str]:
    fit = sweep.resonance
    measured, final = np.array(curves.measured_v), np.array(curves.final_v)
    rms = float(np.sqrt(np.mean(((final - measured) / np.max(measured)) ** 2)))
    role = "is fitted point by point" if sweep.fitted else "sets the scale χ only"
    kind = {
        "maximum": "from the ratio of the maxima",
        "fit": "by least squares",
        "robust": "by Huber's estimate",
        "free": "fitted with the rest",
    }
    how = kind.get(result.scale.kind, "not scaled")
    caption = (
        f"Frequency response as measured ({len(measured)} points), which {role} (χ {how}), and as "
        "simulated with the start and with the fitted parameters. Below: differences from the "
        f"laboratory; those of the simulation have an rms of {100 * rms:.2g} % of the maximum."
    )
    if fit is None:
        caption += f" One damped mode could not be fitted to it: {sweep.message}."
    else:
        caption += (
            " The fit of one damped mode to the laboratory points gives "
            f"{', '.join(resonance_words(fit))}; its residual is {100 * fit.residual_rms:.2g} % of "
            "its amplitude."
        )
    alt = f"Resonance curve with {len(measured)} measured points and the simulated curve" + (
        f"; {', '.join(resonance_words(fit))}." if fit is not None else "."
    )
    return caption, alt
