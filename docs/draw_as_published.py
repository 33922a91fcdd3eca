"""Draw what the published improvement is made of: `docs/img/as_published.png`.

    python docs/draw_as_published.py

Three fits of the shipped campaign `string_q1_published` (synthetic) through the FMU, five minutes:
where they start, where the method ends as it is published, where it ends with settled amplitudes,
and where with one offset from the drift per drive pair.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import fitting as ff

OUT = Path(__file__).parent / "img" / "as_published.png"
#: What is replaced in the campaign, one after the other.
AS_PUBLISHED = ("as_published = true", "as_published = false")
OFFSETS = ("[drift]", '[drift]\nmodel = "offsets"\nprior = "30 Hz"')
#: Deviations below this are drawn at it: the fit of Σ|r| meets as many peaks as it has unknowns.
LEAST = 1e-3


def main() -> None:
    """Fit twice and draw."""
    fmu = ff.Fmu("CoupledOscillator")
    with tempfile.TemporaryDirectory() as folder:
        path = ff.example("string_q1_published", Path(folder) / "campaign")
        published = ff.fit(ff.Problem.of(path, fmu), starts=1).result
        results = []
        for old, new in (AS_PUBLISHED, OFFSETS):
            path.write_text(path.read_text("utf-8").replace(old, new, 1), "utf-8")
            results.append(ff.fit(ff.Problem.of(path, fmu), starts=1).result)
    panels = {
        "as published: start,\ndamping at width / 2π": published.deviations.initial,
        "as published: end": published.deviations.final,
        "settled amplitudes,\ndrift a straight line": results[0].deviations.final,
        "settled amplitudes, one\noffset per drive pair": results[1].deviations.final,
    }
    pairs = np.array([peak.frequency_hz for peak in published.peaks]).reshape(-1, 2)
    f_hz = pairs.ravel() - pairs.mean()
    figure = Figure(figsize=(11.0, 3.4), layout="constrained")
    axes = figure.subplots(1, 4, sharey=True)
    for ax, (title, found), colour in zip(
        axes, panels.items(), ("#777777", "#d55e00", "#cc79a7", "#0072b2"), strict=True
    ):
        deviation = np.maximum(np.array(found.per_peak), LEAST)
        ax.vlines(f_hz, LEAST, deviation, color=colour, lw=1.5)
        ax.plot(f_hz, deviation, "o", color=colour)
        ax.axhline(found.mean, color=colour, ls="--", lw=1.0)
        ax.set_title(f"{title}\nmean {found.mean:.2g}", fontsize=10)
        ax.set_xlabel(f"f − {pairs.mean() / 1e6:.5f} MHz (Hz)")
        ax.set_yscale("log")
        ax.set_ylim(LEAST, 2.0)
        ax.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("deviation of a peak, |χ z − z*| / z*")
    figure.suptitle("String, q1 series as published (synthetic data)", fontsize=10)
    figure.savefig(OUT, dpi=110)
    means = ", ".join(f"{found.mean:.3g}" for found in panels.values())
    print(f"{OUT.relative_to(OUT.parents[2])}: mean deviations {means}")


if __name__ == "__main__":
    main()
