"""Peaks of a pumped line of the virtual laboratory, and the pump at which they are closest."""

from __future__ import annotations

import numpy as np

from fitting.lab.subharmonic import SubharmonicBench
from fitting.text.arrays import FloatArray

#: Points in a line width where peaks are looked for; half spans at first and at last, in widths.
SOUGHT, FIRST_REACH, LAST_REACH = 10.0, 6.0, 60.0
#: Detunings of the pump that are tried, in line widths of the two modes together.
TRIED = np.linspace(-1.0, 1.0, 5)


def peaks_hz(
    bench: SubharmonicBench, volts: float, pump_hz: float, reach_hz: float
) -> tuple[float, float]:
    """The two highest peaks of the line under a pump, Hz, lower one first; equal: there is one.

    Args:
        bench: whose string is pumped.
        volts: of the pump.
        pump_hz: its frequency, Hz.
        reach_hz: how far from eta_plus they are looked for.
    """
    count = int(2.0 * reach_hz * SOUGHT / bench.string.widths_hz()[0]) + 1
    u_hz = bench.string.eta_plus_hz + np.linspace(-reach_hz, reach_hz, count)
    observed = np.abs(bench.phasors({"volts": volts, "pump": pump_hz}, u_hz))
    at = 1 + np.flatnonzero((observed[1:-1] > observed[:-2]) & (observed[1:-1] >= observed[2:]))
    tops = sorted(at, key=lambda k: -observed[k])[:2]
    result = sorted(_top(u_hz[k - 1 : k + 2], observed[k - 1 : k + 2]) for k in tops)
    return (result[0], result[-1]) if result else (float("nan"), float("nan"))


def _top(u_hz: FloatArray, observed: FloatArray) -> float:
    """Where the parabola through three points is highest."""
    left, middle, right = observed
    bend = left - 2.0 * middle + right
    return float(u_hz[1] + 0.5 * (u_hz[1] - u_hz[0]) * (left - right) / bend)


def closest_peaks_hz(bench: SubharmonicBench, volts: float, order: int) -> tuple[float, float]:
    """Frequency of a pump near a subharmonic at which the two peaks are closest, and how close, Hz.

    What a laboratory does: the pump is moved until the opening is smallest. The squares of the
    distances are a parabola of the detuning, as of any avoided crossing.

    Args:
        bench: whose string is pumped.
        volts: of the pump.
        order: of the subharmonic: 1 at the distance of the modes, 2 at half of it.

    Raises:
        ValueError: the line does not open there.
    """
    width = sum(bench.string.widths_hz()) / 2.0
    middle, reach = bench.eta_apart_hz / order, FIRST_REACH * width
    # the dynamic Stark shift goes with the square of the voltage and may be many widths
    for _ in range(16):
        pumps = middle + TRIED * width / order
        apart = np.array([np.ptp(peaks_hz(bench, volts, pump, reach)) for pump in pumps])
        if not np.all(apart > 0.0):
            if reach > LAST_REACH * width:
                raise ValueError(
                    f"a pump of {volts:g} V near {middle:.6g} Hz does not open the line by more "
                    "than its width; wanted a higher voltage"
                )
            reach *= 2.0
            continue
        bend, slope, _rest = np.polyfit(pumps - middle, apart**2, 2)
        step = float(np.clip(-0.5 * slope / bend, -5.0 * width, 5.0 * width))
        middle += step
        reach = 3.0 * width + 0.75 * float(apart.max())
        if abs(step) < 1e-3 * width:
            break
    return middle, float(np.ptp(peaks_hz(bench, volts, middle, reach)))
