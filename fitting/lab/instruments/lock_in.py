"""Lock-in amplifiers on both modes at every drive pair.

The other mode answers 2000 times more weakly there, far below the floor of a spectrum that shows
the resonant one. A laboratory would not read it off such a spectrum: it records each mode with a
lock-in amplifier of its own, the weak one at more gain and for longer, and states amplitudes with
their standard deviations. So ready peaks come out, each with the same relative noise, referred to
the drive and the gain of the sweep. Both modes of a pair are recorded at once: they share their
time stamp, and with it the drift.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.lab.bench import DRIFTING, OUTPUTS, Answer, Bench, Cell, Instrument
from fitting.lab.instruments.analyser import Analyser
from fitting.lab.instruments.peaks import peak_columns, peak_table
from fitting.text.errors import BadInput
from fitting.text.toml import Tables, inline, put

#: Minutes from one drive pair to the next.
PAUSE_MIN = 10.0
PEAKS, SIGMAS = ("p1", "p2"), ("s1", "s2")


def check_noise(noise: float) -> None:
    """Refuse a relative noise that no lock-in amplifier has.

    Args:
        noise: standard deviation over the amplitude.

    Raises:
        BadInput: it is no share between 0 and 0.5.
    """
    if not 0.0 < noise < 0.5:
        raise BadInput(f"lock-ins: noise {noise}, wanted a share between 0 and 0.5")


def with_offsets(tables: Tables) -> None:
    """Ask for an offset of every pair from the drift, and least squares: the noise is known.

    Args:
        tables: of the campaign, changed in place.
    """
    ends = {name: inline(tables["drift"][name]) for name in DRIFTING}
    drift = {"time": "time", "model": "offsets", "prior": "30 Hz", **ends}
    put(tables, "drift", drift, "one offset per drive pair besides the linear drift")
    tables["continuation"]["misfit"] = "squares"


@dataclass(frozen=True)
class LockIns(Instrument):
    """Arrays "peaks_v", "sigmas_v" (2,) and "time_min" (), of both modes at every pair.

    ``noise`` is the relative standard deviation of every amplitude (times the bench's noise scale).
    """

    noise: float = 0.01

    def __post_init__(self) -> None:
        check_noise(self.noise)

    def read(
        self, bench: Bench, answers: Sequence[Answer], rng: np.random.Generator, seed: int
    ) -> tuple[Answer, ...]:
        """|X| (1 + r) with r of the relative noise, the observed mode first."""
        # drawn and left: a seed has the same drift with and without lock-in amplifiers
        Analyser().read(bench, answers, rng, seed)
        own = np.random.default_rng([seed, 1])
        result = []
        for place, answer in enumerate(answers):
            for mode in (answer.observed, 1 - answer.observed):
                label = answer.label + ("" if mode == answer.observed else "_cross")
                lines = np.abs(answer.waves_v[:, mode])
                peaks = lines * (
                    1.0 + self.noise * bench.noise_scale * own.standard_normal(lines.size)
                )
                arrays = {
                    "peaks_v": peaks,
                    "sigmas_v": self.noise * peaks,
                    "time_min": np.array(PAUSE_MIN * place),
                }
                result.append(replace(answer.reading(arrays), label=label, observed=mode))
        return tuple(result)

    def edit(self, tables: Tables) -> None:
        """Ready peaks, an offset of every pair from the drift, least squares: noise is known."""
        tables["title"] = str(tables["title"]).replace(" series (", " series and the other mode (")
        experiments = peak_table(tables["experiments"]["file"], PEAKS, SIGMAS)
        put(tables, "experiments", experiments, "referred to drive and gain of the sweep")
        with_offsets(tables)

    def columns(self, reading: Answer) -> dict[str, Cell]:
        """Time, mode, peaks and standard deviations."""
        time, output = float(reading.arrays["time_min"]), OUTPUTS[reading.observed]
        return {"time (min)": time, "output": output, **peak_columns(reading, PEAKS, SIGMAS)}
