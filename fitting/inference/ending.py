"""How a reconstruction ended, in the words that terminal, page and `result.json` share.

Whoever reads one line reads this one: whether the optimiser converged *and* whether the model
describes the data, and what that rests on. Texts are those of the template `status.txt.j2`.
"""

from __future__ import annotations

import math

from fitting.fit.fit import Status
from fitting.inference.likelihood.knowledge import Adequacy, Ending
from fitting.measurements.dataset import Dataset
from fitting.signal.residual_tests import NOTABLE, Structure
from fitting.text.arrays import FloatArray
from fitting.text.rendering import phrase

DESCRIBES = "converged and describes the data"
MISFIT = "converged but does not describe the data"
NOT_CONVERGED = "not converged"
ABSENT = "converged, but no line exceeds the noise"
CONTRADICTED = "converged, but the campaigns contradict each other"
#: Probability from which chi square is smaller than the noise lets it be.
TOO_SMALL = 1.0 - 1e-4


def ending_of(
    status: Status,
    adequacy: Adequacy | None,
    *,
    inflation: float,
    structure: Structure | None,
    extent: str = "",
    noise: str = "stated noise",
) -> Ending:
    """How a fit ended.

    Args:
        status: of the fit itself, or that its model does not describe the data.
        adequacy: chi square of the rows of known noise, None where it was not examined.
        inflation: of all errors, for residuals beyond the noise.
        structure: of the residuals of curves, None without any.
        extent: how far curves are described (`extent_of`), printed where their structure is.
        noise: what chi square is compared with (`Dataset.noise_words`).
    """
    if status not in (Status.CONVERGED, Status.MISFIT):
        return Ending(words=NOT_CONVERGED)
    if status is Status.MISFIT:
        absent = adequacy is not None and bool(adequacy.absent)
        ground = "" if adequacy is None else phrase("status", "misfit", adequacy)
        return Ending(words=ABSENT if absent else MISFIT, ground=ground)
    structured = structure is not None and structure.widening > NOTABLE
    wider = structured or inflation > NOTABLE
    wider = wider or (adequacy is not None and adequacy.noise_factor > 1.0)
    unstated = adequacy is not None and math.isnan(adequacy.chi_square)
    tested = adequacy is not None and not math.isnan(adequacy.p_value)
    numbers = (adequacy, inflation, structure, noise, NOTABLE, TOO_SMALL)
    return Ending(
        words=DESCRIBES,
        ground=phrase("status", "ground", *numbers),
        whole=tested and not wider and adequacy is not None and adequacy.p_value <= TOO_SMALL,
        extent=extent if structured or (unstated and not wider) else "",
    )


def extent_of(data: Dataset, residuals: FloatArray) -> str:
    """How far curves are described, in words; empty where rows are no shares of an amplitude.

    Args:
        data: all measurements.
        residuals: rows of all of them, (m,).
    """
    fitted = [(m, k) for m, k in zip(data.measurements, data.slices, strict=True) if m.rows]
    shares = [m.share_left(residuals[mine]) for m, mine in fitted if m.is_curve]
    known = [share for share in shares if math.isfinite(share)]
    return phrase("status", "extent", max(known), len(known) < len(fitted)) if known else ""
