"""Keys that tables of complex sweeps share: columns, noise, wiring, delay, gain."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from fitting.campaign.complex_trace import (
    MeasuredComplex,
    check_delay,
    check_sense,
    conjugated,
)
from fitting.campaign.instruments import ComplexColumns
from fitting.measurements.clipped import cut_off
from fitting.measurements.complex.curve import ComplexCurve
from fitting.measurements.complex.wiring import BACKGROUNDS, WIRINGS, Wiring
from fitting.text.errors import BadInput
from fitting.text.keys import Keys, OneOf, Refused, Switch, Text, Value, refusing
from fitting.text.units import convert, parse_quantity
from fitting.text.written import in_unit


@dataclass(frozen=True, kw_only=True)
class ComplexKeys(Keys):
    """How complex values are read, and how the response stands in them."""

    columns: ComplexColumns = field(default_factory=ComplexColumns)
    """Names of columns, where they are not the usual ones; with the unit in brackets, as "X1 (mV)",
    where the file tells none."""
    conjugate: Switch = False
    """The instrument counts phases the other way: the phase of a response rises with frequency."""
    sigma: Value | None = None
    """Standard deviation of each quadrature, as "0.1 uV"; without it the residuals tell it."""
    output: Text | None = None
    """The FMU output that is seen; without it that of [observe]."""
    wiring: Annotated[Text, OneOf(WIRINGS)] = "transmission"
    """How the response stands in what is seen, see the page on amplitude and phase."""
    background: Annotated[Text, OneOf(BACKGROUNDS)] = "none"
    """Complex background beside the response, solved inside."""
    delay: Text = "none"
    """Of the cable: "none", "fit", or a known one as "40 ns"."""
    scale: Annotated[Text, OneOf(("own", "shared"))] = "own"
    """Complex gain: its own, or one for all sweeps that share it."""
    restarted: Switch = False
    """With scale = "shared": the phase of the gain is its own, as after a restart of the
    instrument."""

    def check(self) -> None:
        """Complain of keys that do not go together.

        Raises:
            Refused: names the key.
        """
        if self.restarted and self.scale != "shared":
            raise Refused('has a meaning with scale = "shared" only', "restarted")
        if self.wiring != "transmission":
            if self.scale == "shared":
                raise Refused(f'wanted "own" with wiring = "{self.wiring}"', "scale")
            if self.background == "constant":
                raise Refused(
                    f'"constant" is what passes by in wiring = "{self.wiring}" anyway; wanted '
                    '"none" or "slope"',
                    "background",
                )
        with refusing("delay"):
            self.delay_s("")

    def delay_s(self, where: str) -> float | None:
        """Known delay, s; None: it is fitted.

        Args:
            where: what complaints name.

        Raises:
            BadInput: it is no time.
        """
        if self.delay in ("none", "fit"):
            return 0.0 if self.delay == "none" else None
        value, unit = parse_quantity(self.delay, where=where, wanted="s")
        if unit is None:
            raise BadInput(
                f'{where}: found "{self.delay}", wanted "none", "fit" or a time as "40 ns"'
            )
        return convert(value, unit, "s", where=where)

    def curve_of(self, measured: MeasuredComplex, label: str) -> ComplexCurve:
        """A sweep as it was measured; settings and output are bound later.

        Args:
            measured: its values as the file has them.
            label: of the sweep.

        Raises:
            BadInput: phases that run the wrong way, or as behind another cable; no noise at all.
        """
        measured = conjugated(measured) if self.conjugate else measured
        delay_s, where = self.delay_s(""), measured.source
        check_sense(measured, delay_s, where)
        check_delay(measured, delay_s, where)
        sigma = 0.0
        if self.sigma is not None:
            sigma = in_unit(self.sigma, measured.unit)
            if not sigma > 0.0:
                raise BadInput(f"{self.sigma.where}: found {sigma:g}, wanted more than zero")
        f, values = measured.u_hz, measured.y
        cut, left_out = cut_off(f, values, measured.unit, f"{where}{f', {label}' * bool(label)}")
        return ComplexCurve(
            f[~cut],
            values[~cut],
            sigma=sigma,
            label=label,
            wiring=Wiring(kind=self.wiring, background=self.background),
            delay_s=delay_s,
            shared=self.scale == "shared",
            restarted=self.restarted,
            unit=measured.unit,
            source=where,
            left_out=(*measured.left_out, *left_out),
        )
