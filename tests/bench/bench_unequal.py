"""Noise that grows with the amplitude, or hangs together, in lines of known truth.

    python -m tests.bench.bench_unequal [SWEEPS]

Every row is SWEEPS sweeps (300) of one line with another seed each: how many were found to have
residuals that are correlated or are of unequal size, the factor on the errors, and how many of
100 intervals hold the truth: frequency, width and amplitude, as they are printed and as they would
be without the factor.
"""

from __future__ import annotations

import sys

import numpy as np

from fitting.lines.form import LineFit, fit_resonance
from fitting.signal.student import ratio95
from fitting.text.arrays import FloatArray
from tests.support.coloured import coloured

ETA, WIDTH = 7e6, 50.0
#: Points, and widths that they span.
SWEEPS = ((40, 8), (201, 12), (801, 40))
#: Share of every amplitude, share of the peak, correlation of neighbours.
NOISES = {
    "0.5 % of the peak": (0.0, 0.005, 0.0),
    "1 % of each": (0.01, 0.0, 0.0),
    "both": (0.01, 0.002, 0.0),
    "of the peak, correlated": (0.0, 0.005, 0.7),
    "of each, correlated": (0.01, 0.0, 0.7),
}


def main(count: int) -> None:
    """Print the table.

    Args:
        count: sweeps of every row.
    """
    print("| points | widths | noise | together | unequal | factor | 68 % | 95 % | 95 % plain |")
    print("|---|---|---|---|---|---|---|---|---|")
    for points, widths in SWEEPS:
        for name, noise in NOISES.items():
            rng = np.random.default_rng(points)
            found = [measured(points, widths, noise, rng) for _ in range(count)]
            print(f"| {points} | {widths} | {name} | {row(found)} |", flush=True)


def measured(
    points: int, widths: float, noise: tuple[float, float, float], rng: np.random.Generator
) -> LineFit:
    """The line of one sweep, 1 V high.

    Args:
        points: of the sweep.
        widths: of the line that it spans.
        noise: share of every amplitude, share of the peak, correlation of neighbours.
        rng: of the noise.
    """
    f = ETA + 0.5 * widths * WIDTH * np.linspace(-1.0, 1.0, points)
    line = 0.5 * WIDTH / np.hypot(f - ETA, 0.5 * WIDTH)
    each, floor, rho = noise
    one, two = (coloured(rho, points, rng) for _ in range(2))
    return fit_resonance(f, line * (1.0 + each * one) + floor * two)


def row(found: list[LineFit]) -> str:
    """What was counted.

    Args:
        found: lines, the truth of which is the same.
    """
    off = np.array([pulls(line) for line in found])
    wider = np.array([[line.structure.widening] for line in found])
    reach = np.array([[ratio95(line.dof)] for line in found])
    together = np.mean([line.structure.order > 0 for line in found])
    unequal = np.mean([line.structure.is_unequal for line in found])
    columns = (
        f"{100 * together:.0f}",
        f"{100 * unequal:.0f}",
        f"{np.median(wider):.2f}",
        hold(off < 1.0),
        hold(off < reach),
        hold(off * wider < 1.96),
    )
    return " | ".join(columns)


def pulls(line: LineFit) -> FloatArray:
    """Distances of frequency, width and amplitude from the truth over their errors, (3,).

    Args:
        line: as it was fitted.
    """
    errors = (line.frequency.std, line.width.std, line.amplitude.std)
    values = (line.frequency.value - ETA, line.width.value - WIDTH, line.amplitude.value - 1.0)
    return np.asarray(np.abs(np.array(values) / np.array(errors)))


def hold(inside: np.ndarray) -> str:
    """Of a hundred, one number for each column.

    Args:
        inside: whether the truth is held, shape (sweeps, 3).
    """
    return ", ".join(f"{100 * share:.0f}" for share in np.mean(inside, axis=0))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 300)
