"""The seam between model and fit: parameters in, peak amplitudes and sweep out.

Whatever answers the `Response` protocol can be fitted; the FMU does in
`fitting.measurements.fmu_response`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from fitting.signal.scale import Maximum
from fitting.text.arrays import FloatArray


@dataclass(frozen=True)
class Evaluation:
    """What the model answers for one parameter vector, amplitudes in its own unit.

    `peaks` (n_peaks,) in the order experiments x tones; `sweep_amplitudes` (n_sweep,) at the
    laboratory's frequencies, empty where the objective does not use them; `sweep_maximum` the
    maximum of the simulated sweep (None without a sweep that is scaled by its maximum); `runs`
    the simulations it took; `parts` the answers of the campaigns of a joint fit, one by one.
    """

    peaks: FloatArray
    sweep_amplitudes: FloatArray
    sweep_maximum: Maximum | None
    runs: int = 0
    parts: tuple[Evaluation, ...] = ()


class Response(Protocol):
    """Model of a campaign; p is (n_parameters,) in the parameters' own units."""

    def evaluate_many(self, ps: Sequence[FloatArray]) -> list[Evaluation]:
        """Peaks and scale of several parameter vectors in one batch."""
        ...

    def peaks(self, p: FloatArray) -> FloatArray:
        """Amplitudes at the tones, shape (n_peaks,)."""
        ...

    def sweep(self, p: FloatArray) -> FloatArray:
        """Amplitudes at the laboratory's sweep frequencies, shape (n_sweep,)."""
        ...

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        """Derived outputs by name, each (n_experiments,); NaN where the model has no value."""
        ...
