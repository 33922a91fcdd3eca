"""Benches that are built in: the paper's series, these as published, a string driven hard."""

from __future__ import annotations

from dataclasses import replace

from fitting.lab.bench import Bench
from fitting.lab.duffing import CubicModes
from fitting.lab.instruments import Analyser, Markers
from fitting.lab.names import DUFFING
from fitting.lab.string import STRING

DRIVE_PAIRS_HZ = {
    # Bartsch et al., arXiv:2412.07301, drive pairs of the two measurement series
    "q1": (
        (6940160.0, 6940360.0),
        (6940180.0, 6940340.0),
        (6940200.0, 6940320.0),
        (6940240.0, 6940280.0),
        (6940250.0, 6940270.0),
    ),
    "q2": (
        (7027500.0, 7027700.0),
        (7027520.0, 7027680.0),
        (7027540.0, 7027660.0),
        (7027580.0, 7027620.0),
        (7027590.0, 7027610.0),
    ),
}
SERIES_THETA = {"q1": 1.9498, "q2": 2.0406}
#: The same series with the drift and the start under which the method improves as much as the
#: paper prints: the eigenfrequencies bend by so many Hz, the damping starts at width / 2 pi.
PUBLISHED_BEND_HZ = {"q1-published": 30.0, "q2-published": 60.0}
#: The string that is driven hard, with its cubic terms.
DUFFING_STRING = CubicModes(STRING, alpha1=1e32, alpha2=0.8e32, kappa=0.5e32)


def string_bench(series: str) -> Bench:
    """The bench of the paper's nanostring for ``series`` "q1" or "q2": its pairs, its angle."""
    return Bench(
        series=series,
        sample=replace(STRING, theta_rad=SERIES_THETA[series]),
        observed=("q1", "q2").index(series),
        pairs_hz=DRIVE_PAIRS_HZ[series],
        instrument=Analyser(),
    )


def duffing_bench() -> Bench:
    """The paper's string, q1 series, driven up to a shift of about a line width."""
    eta, gaps, levels = STRING.eta_plus_hz, (20.0, 30.0), (0.25, 0.35)
    return Bench(
        series=DUFFING,
        sample=DUFFING_STRING,
        observed=0,
        pairs_hz=tuple((eta + 10.0 - gap, eta + 10.0 + gap) for gap in gaps for _ in levels),
        instrument=Markers(),
        crest_v=160e-6,
        drift_hz=0.0,
        curvature_hz=0.0,
        levels=levels * len(gaps),
        weak_level=0.04,
    )


def with_level(bench: Bench, strongest: float) -> Bench:
    """The same bench with all levels in proportion, the strongest one as given, m/s^2.

    Args:
        bench: the laboratory: sample, drives, instrument, noise.
        strongest: largest drive amplitude, m/s².
    """
    factor = strongest / max(bench.levels)
    return replace(bench, levels=tuple(factor * level for level in bench.levels))
