"""A look at an FMU that begins on its periodic orbit: which parameters make the line that is seen.

Others would have to settle first; of these names, units and descriptions tell.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from fitting.draft.model import Offer, Tone
from fitting.draft.values import in_unit
from fitting.fmu import FmuWorkers
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
AWAY, STANDS_OUT = 5.0, 3.0
#: Step of a logarithm, and change of an amplitude with it, relatively, that counts.
STEP, COUNTS = 0.1, 0.2


@dataclass(frozen=True, kw_only=True)
class Trial:
    """An FMU that is driven at one tone, near one line.

    Attributes:
        workers: processes that run the FMU.
        offer: what it offers.
        start: its start values.
        tone: that drives.
        output: that is read.
        frequency_hz: of the line, Hz.
        width_hz: full width of the line, Hz.
    """

    workers: FmuWorkers
    offer: Offer
    start: Mapping[str, Scalar]
    tone: Tone
    output: str
    frequency_hz: float
    width_hz: float

    def amplitude(self, values: Mapping[str, Scalar], level: float, away_hz: float = 0.0) -> float:
        """Of the response; NaN where the FMU does not answer.

        Args:
            values: further start values.
            level: of the drive.
            away_hz: by how much it is driven beside the line, Hz.
        """
        at = self.frequency_hz + away_hz
        frequency = in_unit(at, self.offer.unit(self.tone.frequency))
        if frequency is None:
            return math.nan
        driven = {self.tone.frequency: frequency, self.tone.amplitude: level}
        drive = Drive(
            start_values={**self.start, **values, **driven},
            tones_hz=(at,),
            outputs=(self.output,),
        )
        try:
            plan = plan_drive(self.workers, drive, ACCURACY)
            [samples] = self.workers.run(plan.runs[:1])
            return float(plan.read(samples)[0, 0])
        except (BadInput, FmuFailure):
            return math.nan

    def level(self, values: Mapping[str, Scalar]) -> float:
        """A power of ten, at most 1, at which the answer is in proportion to the drive.

        A line whose drive nobody stated is fitted with a free scale, and its shape is that of a
        linear response. 1 where no power is found.

        Args:
            values: further start values, that place the line.
        """
        above = self.amplitude(values, 1.0)
        for decade in range(DECADES):
            level = 10.0**-decade
            below = self.amplitude(values, 0.1 * level)
            if abs(10.0 * below - above) <= LINEAR * above:
                return level if decade == 0 else 0.1 * level  # what is left falls with its square
            above = below
        return 1.0

    def pairs(self) -> list[tuple[str, str]]:
        """Parameters that place a line which the output shows, each with the one that widens it."""
        places = [self._placed(name) for name in self.offer.places]
        shown = [values for values in places if values and self._stands_out(values)]
        return [
            (name, width) for values in shown for name in values if (width := self._width(values))
        ]

    def _placed(self, name: str) -> dict[str, float]:
        """The start value that puts a parameter's line there; empty if none is known."""
        value = in_unit(self.frequency_hz, self.offer.unit(name))
        return {} if value is None else {name: value}

    def _stands_out(self, values: Mapping[str, float]) -> bool:
        sizes = {n: in_unit(self.width_hz, self.offer.unit(n)) for n in self.offer.widths}
        widths = {name: size for name, size in sizes.items() if size is not None}
        here, away = (
            self.amplitude({**widths, **values}, WEAK, k * self.width_hz) for k in (0.0, AWAY)
        )
        return here > STANDS_OUT * away

    def _width(self, values: Mapping[str, float]) -> str:
        """The parameter that lowers the top most as it grows; empty if none does plainly."""
        found: list[tuple[float, str]] = []
        for name in self.offer.widths:
            size = in_unit(self.width_hz, self.offer.unit(name))
            if size is None:
                continue
            narrow, wide = (
                self.amplitude({**values, name: size * math.exp(step)}, WEAK)
                for step in (0.0, STEP)
            )
            found.append((math.log(narrow / wide) / STEP if narrow > 0.0 < wide else 0.0, name))
        change, name = max(found, default=(0.0, ""))
        return name if change > COUNTS else ""
