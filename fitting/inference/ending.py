"""How a fit ended: whether it converged, whether the model describes the data, and why."""

from __future__ import annotations

import math

from fitting.fit.fit import Status
from fitting.inference.likelihood.knowledge import Adequacy, Ending
from fitting.measurements.dataset import Dataset
from fitting.signal.residual_tests import Structure
from fitting.text.arrays import FloatArray


def ending_of(
    status: Status,
    adequacy: Adequacy | None,
    *,
    inflation: float,
    structure: Structure | None,
    data: Dataset,
    residuals: FloatArray | None = None,
) -> Ending:
    """How a fit ended.

    Args:
        status: of the fit itself, or that its model does not describe the data.
        adequacy: chi square of the rows of known noise, None where it was not tested.
        inflation: of all errors, for residuals beyond the noise.
        structure: of the residuals of curves, None without any.
        data: all measurements.
        residuals: rows of all of them, (m,); None: they are not compared with the curves.
    """
    if status not in (Status.CONVERGED, Status.MISFIT):
        return Ending(kind="not_converged")
    kind: str = "described"
    if status is Status.MISFIT:
        kind = "no_line" if adequacy is not None and adequacy.no_line else "not_described"
    fitted = [(m, k) for m, k in zip(data.measurements, data.slices, strict=True) if m.rows]
    shares = [
        share
        for m, rows in fitted
        if residuals is not None and m.is_curve
        if math.isfinite(share := m.share_left(residuals[rows]))
    ]
    return Ending(
        kind=kind,  # type: ignore[arg-type]
        adequacy=adequacy,
        inflation=inflation,
        structure=structure,
        noise="estimated" if any(m.estimates_noise for m in data.measurements) else "stated",
        share=max(shares, default=math.nan),
        is_part=len(shares) < len(fitted),
    )
