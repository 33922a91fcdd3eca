"""Draw λ over the bias voltage with its intervals: `docs/img/string_vdc_lambda.png`.

fmu-fit reconstruct data/string_vdc/campaign.toml --quick --no-profiles --out out/vdc
python docs/draw_vdc.py out/vdc
"""

from __future__ import annotations

import json
import sys
import tomllib
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "docs" / "img" / "string_vdc_lambda.png"


def main() -> None:
    """Draw the values of the map, and what was put in."""
    result = json.loads((Path(sys.argv[1]) / "result.json").read_text("utf-8"))
    truth = tomllib.loads((ROOT / "data" / "string_vdc" / "truth.toml").read_text("utf-8"))
    volts = np.array(truth["string_vdc"]["volts"])
    true_khz = 1e-3 * np.array(truth["outcome"]["lambda_at_volts_hz"])
    output = result["derived"]["lambda12"]
    value, half = (1e-3 * np.array(output[name])[: volts.size] for name in ("values", "halves95"))
    figure = Figure(figsize=(8.0, 4.2), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
    above.plot(volts, true_khz, color="#555555", lw=1.0, label="truth (synthetic data)")
    above.errorbar(volts, value, half, fmt="o", color="#0072b2", ms=4.0, label="fit, 95 %")
    above.set_ylabel("λ (kHz)")
    above.legend(frameon=False)
    below.axhline(0.0, color="#555555", lw=1.0)
    below.errorbar(volts, value - true_khz, half, fmt="o", color="#0072b2", ms=4.0)
    below.set_ylabel("fit − truth (kHz)")
    below.set_xlabel("V_DC (V)")
    for ax in (above, below):
        ax.spines[["top", "right"]].set_visible(False)
    figure.savefig(OUT, dpi=110)
    print(OUT.relative_to(ROOT))


if __name__ == "__main__":
    main()
