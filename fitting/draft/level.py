"""The level of a drive that no file tells: small enough for the response to be in proportion."""

from __future__ import annotations

from collections.abc import Mapping

from fitting.fmu import FmuWorkers
from fitting.simulate.drive import Drive
from fitting.simulate.response import plan_drive
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, FmuFailure

#: Relative error of the simulated amplitudes, and how far, relatively, a tenth of the drive may be
#: from a tenth of the response.
ACCURACY, LINEAR = 1e-6, 1e-4
#: Powers of ten by which the level is lowered, at most.
DECADES = 9


def linear_level(
    workers: FmuWorkers,
    start: Mapping[str, Scalar],
    amplitude: str,
    frequency_hz: float,
    output: str,
) -> float:
    """The largest power of ten, 1 at most, at which a tenth of the drive has a tenth of the answer.

    A line whose drive nobody stated is fitted with a free scale, and its shape is that of a linear
    response. 1 where no power is found, or the FMU cannot be asked.

    Args:
        workers: processes that run the FMU.
        start: its start values, with what places its line and the drive.
        amplitude: its parameter of the drive's amplitude.
        frequency_hz: where it is driven, Hz.
        output: that is read.
    """

    def answer(level: float) -> float:
        values = {**start, amplitude: level}
        drive = Drive(start_values=values, tones_hz=(frequency_hz,), outputs=(output,))
        plan = plan_drive(workers, drive, ACCURACY)
        [samples] = workers.run(plan.runs[:1])
        return float(plan.read(samples)[0, 0])

    try:
        above = answer(1.0)
        for decade in range(DECADES):
            level = 10.0**-decade
            below = answer(0.1 * level)
            if abs(10.0 * below - above) <= LINEAR * above:
                return level
            above = below
    except (BadInput, FmuFailure):
        return 1.0
    return 1.0
