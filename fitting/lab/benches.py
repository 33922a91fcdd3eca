"""Benches that are built in: the paper's series, these as published, a string driven hard."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from fitting.lab.bench import Bench
from fitting.lab.duffing import Cubic, CubicModes
from fitting.lab.instruments.analyser import Analyser
from fitting.lab.instruments.markers import Markers
from fitting.lab.names import BENCHES, DUFFING
from fitting.lab.string import TwoModes
from fitting.text.errors import BadInput

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
#: Cubic terms of the string that is driven hard.
DUFFING_CUBIC = Cubic(1e32, 0.8e32, 0.5e32)


def bench_named(name: str) -> Bench:
    """A built-in bench.

    Args:
        name: of the bench.

    Raises:
        BadInput: no such bench.
    """
    if name == DUFFING:
        return duffing_bench()
    if name in SERIES_THETA:
        return string_bench(name)
    if name in PUBLISHED_BEND_HZ:
        paper = string_bench(name.removesuffix("-published"))
        return replace(paper, series=name, curvature_hz=PUBLISHED_BEND_HZ[name])
    raise BadInput(f"bench {name!r}: wanted one of {', '.join(BENCHES)}")


def string_bench(series: str) -> Bench:
    """The bench of the paper's nanostring for ``series`` "q1" or "q2": its pairs, its angle."""
    return Bench(
        series=series,
        sample=TwoModes(
            theta_rad=SERIES_THETA[series],
            d1_hz=120.0,
            d2_hz=90.0,
            eta_plus_hz=6940260.0,
            eta_minus_hz=7027600.0,
        ),
        observed=("q1", "q2").index(series),
        pairs_hz=DRIVE_PAIRS_HZ[series],
        instrument=Analyser(),
    )


def duffing_bench() -> Bench:
    """The paper's string, q1 series, driven up to a shift of about a line width."""
    eta, gaps, levels = 6940260.0, (20.0, 30.0), (0.25, 0.35)
    modes = TwoModes(
        theta_rad=1.9498, d1_hz=120.0, d2_hz=90.0, eta_plus_hz=eta, eta_minus_hz=7027600.0
    )
    return Bench(
        series=DUFFING,
        sample=CubicModes(modes, DUFFING_CUBIC),
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


def changed(bench: Bench, **values: Any) -> Bench:
    """The bench with fields of its own, of its modes or of its cubic terms replaced, by name.

    ``level`` is the strongest drive, as `with_level` takes it.

    Args:
        bench: the laboratory: sample, drives, instrument, noise.
        **values: new values of the fields of bench and sample, by name.

    Raises:
        ValueError: values that are impossible.
        BadInput: a name that this bench does not have.
    """
    own = {name: v for name, v in values.items() if name in Bench.__dataclass_fields__}
    modes = {name: v for name, v in values.items() if name in TwoModes.__dataclass_fields__}
    cubic = {name: v for name, v in values.items() if name in Cubic.__dataclass_fields__}
    sample = bench.sample
    if isinstance(sample, CubicModes):
        linear = replace(sample.modes, **modes)
        sample = CubicModes(linear, replace(sample.cubic, **cubic))
    else:
        sample = replace(sample.modes, **modes)
    known = {*own, *modes, *(cubic if isinstance(bench.sample, CubicModes) else ())}
    if bench.levels and "level" in values:
        bench, known = with_level(bench, values["level"]), {*known, "level"}
    for name in values:
        if name not in known:
            raise BadInput(f"{name}: has no meaning for the bench {bench.series!r}")
    return replace(bench, **{"sample": sample, **own})
