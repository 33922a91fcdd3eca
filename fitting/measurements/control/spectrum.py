"""Control spectrum: amplitudes over drive frequency at one value of the controls, their noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from fitting.campaign.instruments.plain import LEAST_POINTS
from fitting.measurements.record import Curve
from fitting.signal.rician import quadrature_noise
from fitting.signal.roughness import roughness
from fitting.text.arguments import checked
from fitting.text.arrays import FloatArray, Scalar, as_numbers, require_size
from fitting.text.errors import BadInput
from fitting.text.finding import Finding


@checked
@dataclass(frozen=True, eq=False)
class ControlSpectrum(Curve):
    """Amplitudes over drive frequency at one value of the controls.

    Args:
        frequency_hz: Frequencies of the tone, shape (n,), Hz, rising.
        amplitude: Measured peak amplitudes, shape (n,), in the unit of the control sweep.
        settings: Values of the controls, and of variables of the FMU, by name.
        label: Name of the place; empty: the values of the controls.
        sigma: Standard deviations of the amplitudes, shape (n,) or one; 0: not known.
        drive: Amplitude of the drive over its level, shape (n,) or one.
        left_out: Which points of the file are not here, and why.
        scattered: Whether `sigma` is how the points scatter about a smooth curve.

    Raises:
        BadInput: fewer than 8 points, shapes that differ, frequencies that do not rise, amplitudes
            that are negative or no numbers.
    """

    frequency_hz: npt.ArrayLike
    amplitude: npt.ArrayLike
    settings: Mapping[str, Scalar]
    _: KW_ONLY
    label: str = ""
    sigma: npt.ArrayLike = 0.0
    drive: npt.ArrayLike = 1.0
    left_out: tuple[Finding, ...] = ()
    scattered: bool = False
    u_hz: FloatArray = field(init=False)
    y: FloatArray = field(init=False)
    sigmas: FloatArray = field(init=False)
    level: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        where = f"control sweep: spectrum at {self.label or dict(self.settings)}"
        u, y = (as_numbers(v, where) for v in (self.frequency_hz, self.amplitude))
        if u.ndim != 1 or u.shape != y.shape or u.size < LEAST_POINTS:
            raise BadInput(
                f"{where}: frequencies of the shape {u.shape}, amplitudes {y.shape}; wanted (n,) "
                f"each, n at least {LEAST_POINTS}"
            )
        if not np.all(np.isfinite(u) & (u > 0.0)) or np.any(np.diff(u) <= 0.0):
            raise BadInput(f"{where}: wanted positive frequencies that rise strictly")
        if not np.all(np.isfinite(y) & (y >= 0.0)) or not np.any(y > 0.0):
            raise BadInput(f"{where}: wanted amplitudes from zero on, not all of them zero")
        require_size(u, f"{where}: frequencies")
        require_size(y, f"{where}: amplitudes")
        object.__setattr__(self, "u_hz", u)
        object.__setattr__(self, "y", y)
        for name, value in (("sigmas", self.sigma), ("level", self.drive)):
            object.__setattr__(self, name, np.broadcast_to(as_numbers(value, where), u.shape))

    @cached_property
    def largest(self) -> float:
        """The largest amplitude."""
        return float(np.max(self.y))

    def scatter(self, *, rectified: bool = False) -> float:
        """Standard deviation of the amplitudes about a smooth curve; 0 where too few tell it.

        Args:
            rectified: they are magnitudes of two quadratures, and told is the noise of each.
        """
        return quadrature_noise(self.y) if rectified else roughness(self.y)
