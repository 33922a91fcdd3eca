"""Records of measured values: what all of them hold, be they over frequency or over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fitting.campaign import Setup
from fitting.campaign.parameters import Parameter
from fitting.measurements.datum_noise import white_noise
from fitting.measurements.measurement import Values
from fitting.measurements.residual_curve import ResidualCurve
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.finding import Finding


class Measured:
    """Values ``y`` (n,) of one place, real or complex: a base class for their record.

    ``rows`` is their number of residual rows, ``largest`` what these are relative to.
    """

    label: str
    settings: Mapping[str, Scalar]
    y: Values
    #: The FMU's output that is observed; empty: the setup's.
    output: str = ""
    #: Which points of the file are not here, and why.
    left_out: tuple[Finding, ...] = ()
    #: Standard deviations of settings, in the FMU's units; None: errors cannot be declared.
    setting_sigma: Mapping[str, float] | None = None

    @property
    def solved_inside(self) -> int:
        """How many real numbers are solved for inside its rows."""
        return 0

    @property
    def rows(self) -> int:
        """Number of residual rows: one for each value."""
        return int(self.y.size)

    @property
    def row_sigma(self) -> float:
        """Standard deviation of its rows; zero where unknown."""
        raise NotImplementedError

    @property
    def estimated_noise(self) -> float:
        """Standard deviation of a datum over the largest one, from the scatter of all."""
        largest = float(np.max(np.abs(self.y), initial=0.0))
        return white_noise(self.y) / largest if largest > 0.0 else 0.0

    def rows_of(self, values: Values) -> FloatArray:
        """Rows of a difference from the data.

        Args:
            values: simulated less measured, (n,), in the unit of the data.
        """
        raise NotImplementedError

    def residuals(self, simulated: Values) -> FloatArray:
        """Rows of simulated values.

        Args:
            simulated: S (n,), in the unit of the data.
        """
        return self.rows_of(simulated - self.y)

    def share_left(self, rows: FloatArray) -> float:
        """Root mean square of its residuals, over its largest amplitude.

        Args:
            rows: residuals, (rows,).
        """
        return float(np.sqrt(np.mean(rows**2)))

    def residual_curve(self, at: slice, rows: FloatArray) -> ResidualCurve:
        """Its residuals along the axis of its values.

        Args:
            at: which rows of the measurement these are.
            rows: residuals, (rows,).
        """
        raise NotImplementedError


class Curve(Measured):
    """Values over the frequency ``u_hz`` (n,), Hz, of a tone that drives: a base class."""

    u_hz: FloatArray

    @property
    def top_hz(self) -> float:
        """Where the response is largest, Hz."""
        return float(self.u_hz[int(np.argmax(self.y))])


@dataclass(frozen=True, eq=False, kw_only=True)
class Record(Measured):
    """What is known of measured values, whatever their kind; the kinds explain the fields."""

    settings: Mapping[str, Scalar] = field(default_factory=dict)
    label: str = ""
    output: str = ""
    unit: str = "V"

    @property
    def places(self) -> tuple[tuple[str, Mapping[str, Scalar]], ...]:
        """Label and settings."""
        return ((self.label, self.settings),)

    @property
    def control_units(self) -> Mapping[str, str]:
        """None: settings are variables of the FMU."""
        return {}

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """None beside the FMU's."""
        return ()


@dataclass(frozen=True, eq=False, kw_only=True)
class OfSetup:
    """What makes a record a measurement by itself: its setup, and the series that it belongs to."""

    setup: Setup
    series: str = ""
