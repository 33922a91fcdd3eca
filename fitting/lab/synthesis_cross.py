"""A series of the virtual laboratory that records both modes at every drive pair.

The other mode answers 2000 times more weakly there, far below the floor of a spectrum that shows
the resonant one. A laboratory would not read it off such a spectrum: it records each mode with a
lock-in amplifier of its own, the weak one at more gain and for longer, and states amplitudes with
their standard deviations. So ready peaks come out, each with the same relative noise, referred to
the drive and the gain of the sweep. Both modes of a pair are recorded at once: they share their
time stamp, and with it the drift.
"""

from __future__ import annotations

import numpy as np

from fitting.lab.string import Series, steady_state
from fitting.lab.synthesis import CAMPAIGN_NAME, OUTPUTS, campaign_files, marked, mhz
from fitting.text.arrays import FloatArray

#: Minutes from one drive pair to the next.
PAUSE_MIN = 10.0
HEAD = "experiment,time (min),u1 (MHz),u2 (MHz),output,p1 (uV),p2 (uV),s1 (uV),s2 (uV)"
READ = """\
# Lock-in amplitudes of both modes, recorded at once and averaged to {percent:g} % each; the weak
# one referred to the drive and gain of the sweep.
peaks = ["p1", "p2"]
peak_sigmas = ["s1", "s2"]
"""
DRIFT = """\
time = "time"
model = "offsets"                  # one offset per drive pair beside the linear drift
prior = "30 Hz"
"""


def cross_files(series: Series, noise: float, command: str) -> dict[str, str]:
    """Texts by relative file name, as `campaign_files`, with both modes at every drive pair.

    ``noise`` is the relative standard deviation of every amplitude (times the bench's noise scale).
    """
    files = {
        name: text
        for name, text in campaign_files(series, command).items()
        if not name.startswith("spectra/")
    }
    files["experiments.csv"] = _experiments(series, noise, marked(series.seed, command))
    files[CAMPAIGN_NAME] = _campaign(files[CAMPAIGN_NAME], noise)
    return files


def _experiments(series: Series, noise: float, mark: str) -> str:
    generator = np.random.default_rng([series.seed, 1])
    bench, rows = series.bench, [mark, HEAD]
    for m, (pair, state) in enumerate(zip(bench.pairs_hz, series.true_modes, strict=True)):
        lines = series.gain * np.abs(steady_state(state, np.array(pair)))
        for mode in (bench.observed, 1 - bench.observed):
            scatter = 1.0 + noise * bench.noise_scale * generator.standard_normal(len(pair))
            peaks: FloatArray = lines[:, mode] * scatter
            label = f"pair{m + 1}" if mode == bench.observed else f"pair{m + 1}_cross"
            numbers = [*(1e6 * peaks), *(1e6 * noise * peaks)]
            cells = [label, repr(PAUSE_MIN * m), *(repr(mhz(f)) for f in pair), OUTPUTS[mode]]
            rows.append(",".join([*cells, *(repr(float(v)) for v in numbers)]))
    return "\n".join(rows) + "\n"


def _campaign(text: str, noise: float) -> str:
    """The campaign with ready peaks, offsets from the drift, and least squares: noise is known."""
    start = text.index("spectra = ")
    end = text.index('amplitude = "V peak"', start)
    text = text[:start] + READ.format(percent=100.0 * noise) + text[end:]
    changes = (
        ('noise_floor = "robust"\n', ""),
        (" series (synthetic)", " series and the other mode (synthetic)"),
        ("eta_plus = { before", DRIFT + "eta_plus = { before"),
        ('misfit = "slack"', 'misfit = "squares"'),
    )
    for old, new in changes:
        text = text.replace(old, new, 1)
    return text
