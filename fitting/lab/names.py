"""Names of what is built in here: the help of a command lists them before any library is loaded."""

from __future__ import annotations

#: Benches, `fitting.lab.benches`.
DUFFING = "duffing"
BENCHES = ("q1", "q2", "q1-published", "q2-published", DUFFING)
#: The bench under a parametric pump, `fitting.lab.pumped`.
PUMPED = "pumped"
#: The bench under a pump at the distance of the modes and at half of it, `fitting.lab.subharmonic`.
SUBHARMONIC = "string_pumped"
#: The bench over a bias voltage, and under a pump by it, `fitting.lab.voltage`.
VOLTAGE = "string_vdc"
#: Curves, `fitting.lab.curves`.
WIRED = ("transmission", "notch", "reflection")
CROSSING = "crossing"
#: Time series, `fitting.lab.time_series`.
RINGDOWN, CHIRP = TIME_SERIES = ("ringdown", "chirp")
#: Demodulated decays, likewise.
LOCK_IN, ZERO_SPAN = DEMODULATED = ("lock-in", "zero-span")
CURVES = (*WIRED, CROSSING, *TIME_SERIES, *DEMODULATED)
#: Series of the virtual laboratory.
SERIES = (*BENCHES, PUMPED, SUBHARMONIC, VOLTAGE)
#: Synthetic campaigns whose accuracy is compared with its cost: a series of the virtual laboratory,
#: or a curve.
SCENES = {
    "string": ("series", "q1"),
    "duffing-string": ("series", DUFFING),
    "pumped-string": ("series", SUBHARMONIC),
    "ringdown": ("curve", RINGDOWN),
}
USUAL_SCENE = "string"
#: The file that holds the truth behind a campaign.
TRUTH_NAME = "truth.toml"
#: What synthetic campaigns consist of, whichever of them was made before in the same folder.
SYNTHETIC_FILES = (
    "campaign.toml",
    TRUTH_NAME,
    "experiments.csv",
    "sweep.*",
    "sweeps.csv",
    "map.csv",
    "trace.csv",
    "next[0-9]*.csv",
    "spectra/*.csv",
)
