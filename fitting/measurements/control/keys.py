"""Keys that tables of spectra over a control share: its columns, and the range that is fitted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fitting.campaign.binder import Binder
from fitting.campaign.control_table import OWN_COLUMNS
from fitting.text.keys import Frequencies, Keys, Refused, Texts, Usually, refusing
from fitting.text.notation import hertz, how_many
from fitting.text.tables import named_column
from fitting.text.written import in_unit


@dataclass(frozen=True, kw_only=True)
class ControlKeys(Keys):
    """What was changed from spectrum to spectrum, and what of each is fitted."""

    controls: Texts
    """Columns of the control quantities, each with its unit: what laws name, or variables of the
    FMU."""
    range: Annotated[Frequencies | None, Usually(None)] = None
    """First and last frequency that is fitted."""

    def check_controls(self, *own: str) -> None:
        """Complain of controls that are none, and of a range that is none.

        Args:
            own: further columns of a spectrum's own points.

        Raises:
            Refused: names the key.
        """
        if not self.controls:
            raise Refused("is empty, wanted at least one column", "controls")
        points = {named_column(each, 0).name.lower() for each in (*OWN_COLUMNS, *own) if each}
        for name in self.controls:
            if name.lower() in points:
                raise Refused(
                    f"'{name}' is the axis of a spectrum or a measured quantity; wanted columns of "
                    "what was changed from spectrum to spectrum",
                    "controls",
                )
        if self.range is None:
            return
        if len(self.range) != 2:
            raise Refused(
                f"{how_many(len(self.range), 'value')}, wanted the first and last one", "range"
            )
        with refusing("range"):
            low, high = self.range_hz
        if not low < high:
            raise Refused(
                f"from {hertz(low)} to {hertz(high)}, wanted the smaller frequency first", "range"
            )

    @property
    def range_hz(self) -> tuple[float, float]:
        """First and last frequency that is fitted, Hz; without a range all."""
        if self.range is None:
            return 0.0, float("inf")
        low, high = (in_unit(w, "Hz") for w in self.range)
        return low, high

    def control_units(self, binder: Binder) -> dict[str, str]:
        """Units of the controls: of laws, or of the FMU's own variables.

        Args:
            binder: of the campaign to its FMU.
        """
        return {
            name: binder.control_units.get(name)
            or getattr(binder.variables.get(name), "unit", None)
            or ""
            for name in self.controls
        }
