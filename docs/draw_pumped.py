"""Draw λ of the pumped sweeps beside published values: `docs/img/string_pumped_lambda.png`.

    fmu-fit reconstruct data/string_pumped/campaign.toml --out out/pumped
    python docs/draw_pumped.py out/pumped

The published values are those of data/paper.toml, of the paper's own laboratory; the pumped sweeps
are synthetic, made with λ of the first of them.
"""

from __future__ import annotations

import json
import sys
import tomllib
from pathlib import Path

from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "docs" / "img" / "string_pumped_lambda.png"
#: The most that the model can have with these eigenfrequencies, MHz: any λ below it fits a series.
MOST_MHZ = 0.781


def main() -> None:
    """Draw the values, a row each."""
    result = json.loads((Path(sys.argv[1]) / "result.json").read_text("utf-8"))
    found = result["derived"]["lambda12"]
    low, high = (1e-6 * end for end in found["ci95"])
    paper = tomllib.loads((ROOT / "data" / "paper.toml").read_text("utf-8"))
    series = paper["series"]
    rows = [("pumped sweeps (synthetic), 95 %", 1e-6 * found["value"], (low, high))]
    for name, word in (("q1", "first"), ("q2", "second")):
        value, spread = series[name]["lambda_mhz"], series[name]["lambda_spread_mhz"]
        rows.append((f"published, {word} series", value, (value - spread, value + spread)))
    other = paper["independent"]["lambda_mhz"]
    rows.append(("published, another method", other, (other, other)))
    figure = Figure(figsize=(8.0, 2.6), layout="constrained")
    ax = figure.subplots()
    for k, (_label, value, ends) in enumerate(rows):
        colour = "#0072b2" if k == 0 else "#555555"
        ax.plot(ends, (-k, -k), color=colour, lw=4.0, solid_capstyle="butt")
        ax.plot(value, -k, "|", color=colour, ms=12.0)
        ax.annotate(f"{value:.4f}", (value, -k), (0, 7), textcoords="offset points", ha="center")
    series_allow = "any λ that a two-tone series allows"
    ax.plot((0.0, MOST_MHZ), (-len(rows), -len(rows)), color="#d55e00", lw=4.0)
    labels = [label for label, _, _ in rows] + [series_allow]
    ax.set_yticks([-k for k in range(len(labels))], labels)
    ax.set_ylim(-len(rows) - 0.6, 0.8)
    ax.set_xlim(0.0, 0.95)
    ax.set_xlabel("λ (MHz)")
    ax.spines[["top", "right"]].set_visible(False)
    figure.savefig(OUT, dpi=110)
    print(OUT.relative_to(ROOT))


if __name__ == "__main__":
    main()
