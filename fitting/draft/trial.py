"""A look at an FMU that begins on its periodic orbit: which parameters make the line of the data.

Others would have to settle first; for these names, units and descriptions decide.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from fitting.draft.boxes import in_unit
from fitting.draft.model import Offer
from fitting.simulate.drive import Drive
from fitting.simulate.response import plan_drive
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, FmuFailure

#: Relative error of the simulated amplitudes, and how far, relatively, a tenth of the drive may be
#: from a tenth of the response.
ACCURACY, LINEAR = 1e-6, 1e-4
#: Powers of ten by which the level is lowered, at most; and a level at which a look is taken.
DECADES, WEAK = 9, 1e-3
#: Widths from a line at which it has gone, and what its top then is over that, at least.
AWAY, LEAST_CONTRAST = 5.0, 3.0
#: Step of a logarithm, and change of an amplitude with it, relatively, that counts.
STEP, COUNTS = 0.1, 0.2

#: Amplitude of a response to further start values, a level, and a distance from the line, Hz.
Response = Callable[[Mapping[str, Scalar], float, float], float]


def response_at(
    offer: Offer,
    start: Mapping[str, Scalar],
    tone: tuple[str, str],
    output: str,
    frequency_hz: float,
) -> Response:
    """The response of an FMU to one tone near a line; NaN where the FMU fails.

    Args:
        offer: what it offers.
        start: its start values.
        tone: parameters of the frequency and of the amplitude that drive.
        output: that is read.
        frequency_hz: of the line, Hz.
    """

    def amplitude(values: Mapping[str, Scalar], level: float, away_hz: float) -> float:
        at = frequency_hz + away_hz
        frequency = in_unit(at, offer.unit(tone[0]))
        if frequency is None:
            return math.nan
        driven = {**start, **values, tone[0]: frequency, tone[1]: level}
        drive = Drive(start_values=driven, tones_hz=(at,), outputs=(output,))
        try:
            plan = plan_drive(offer.workers, drive, ACCURACY)
            [samples] = offer.workers.run(plan.runs[:1])
            return float(plan.read(samples)[0, 0])
        except (BadInput, FmuFailure):
            return math.nan

    return amplitude


def linear_level(response: Response, values: Mapping[str, Scalar]) -> float:
    """A power of ten, at most 1, at which the response is in proportion to the drive.

    A line with an unknown drive is fitted with a free scale, and its shape is that of a linear
    response. 1 where no power is found.

    Args:
        response: of the FMU.
        values: further start values, that place the line.
    """
    above = response(values, 1.0, 0.0)
    for decade in range(DECADES):
        level = 10.0**-decade
        below = response(values, 0.1 * level, 0.0)
        if abs(10.0 * below - above) <= LINEAR * above:
            return level if decade == 0 else 0.1 * level  # the remainder falls with its square
        above = below
    return 1.0


def line_pairs(
    response: Response, offer: Offer, frequency_hz: float, width_hz: float
) -> list[tuple[str, str]]:
    """Parameters that place a line which the output shows, each with the one that widens it.

    Args:
        response: of the FMU.
        offer: what it offers.
        frequency_hz: of the line, Hz.
        width_hz: full width of the line, Hz.
    """
    sizes = {name: in_unit(width_hz, offer.unit(name)) for name in offer.widths}
    widths = {name: size for name, size in sizes.items() if size is not None}
    pairs = []
    for place in offer.places:
        value = in_unit(frequency_hz, offer.unit(place))
        if value is None:
            continue
        placed = {place: value}
        here, away = (response({**widths, **placed}, WEAK, k * width_hz) for k in (0.0, AWAY))
        if not here > LEAST_CONTRAST * away:
            continue
        changes = [(0.0, "")]  # of the logarithm of the top with that of a width
        for name, size in widths.items():
            narrow, wide = (
                response({**placed, name: size * math.exp(step)}, WEAK, 0.0) for step in (0.0, STEP)
            )
            change = math.log(narrow / wide) / STEP if narrow > 0.0 < wide else 0.0
            changes.append((change, name))
        change, width = max(changes)
        if change > COUNTS:
            pairs.append((place, width))
    return pairs
