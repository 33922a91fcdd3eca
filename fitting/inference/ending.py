"""How a reconstruction ended, in the words that terminal, page and `result.json` share.

Whoever reads one line reads this one: it says whether the optimiser is content *and* whether the
model describes the data, and on what ground.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from fitting.fit.fit import Status
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.measurements.dataset import Dataset
from fitting.signal.residual_tests import NOTABLE, Structure
from fitting.text.arrays import FloatArray
from fitting.text.notation import freedom_words, number

DESCRIBES = "converged and describes the data"
MISFIT = "converged but does not describe the data"
NOT_CONVERGED = "not converged"
ABSENT = "converged, but no line stands out of the noise"
CONTRADICTED = "converged, but the campaigns contradict each other"
#: Probability from which chi square is smaller than the noise lets it be.
TOO_SMALL = 1.0 - 1e-4
#: Where nothing was tested, and why: no row has a noise of its own, or there are too few rows.
UNTESTED = "nothing tested it"
UNSTATED = "the noise was not stated and is taken from the residuals"
LIKE_NOISE = "; that looks like noise"
TOO_FEW = "as many values are fitted as there are data, so that nothing tests the model"


@dataclass(frozen=True, kw_only=True)
class Ending:
    """How it ended, in `words`; `ground`: what that rests on, empty where it says nothing more.

    `extent` says how far the data are described, where residuals are no noise of one size or no
    noise was stated: what is left of the curve that is described worst, root mean square, over its
    largest amplitude; of complex values it is their distance from the model. `whole`: chi square is
    what the noise explains, so that nothing need be added.
    """

    words: str = ""
    ground: str = ""
    whole: bool = False
    extent: str = ""

    @property
    def clause(self) -> str:
        """The words, and how far they hold."""
        return f"{self.words} {self.extent}".rstrip()

    def told(self, message: str) -> str:
        """The words, their ground, and what else there is to say, as sentences.

        Args:
            message: how the search itself ended, in sentences.
        """
        first = f"{self.words[:1].upper()}{self.clause[1:]}"
        return f"{first}{f': {self.ground}' if self.ground else ''}. {message}"


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
        adequacy: chi square of the rows of known noise, None where it was not looked at.
        inflation: of all errors, for residuals beyond the noise.
        structure: of the residuals of curves, None without any.
        extent: how far curves are described (`extent_of`), said where their structure is.
        noise: what chi square is held against (`Dataset.noise_words`).
    """
    if status not in (Status.CONVERGED, Status.MISFIT):
        return Ending(words=NOT_CONVERGED)
    chi = "" if adequacy is None or math.isnan(adequacy.p_value) else _chi_words(adequacy)
    if status is Status.MISFIT:
        absent = adequacy is not None and bool(adequacy.absent)
        found = "" if adequacy is None else misfit_ground(adequacy)
        return Ending(words=ABSENT if absent else MISFIT, ground=found)
    said, seen = [chi] if chi else [], ""
    if adequacy is not None and adequacy.noise_factor > 1.0:
        factor = f"{adequacy.noise_factor:.3g}"
        said.append(f"uncorrelated noise {factor} times as large as stated, errors scaled by it")
    elif inflation > NOTABLE:
        said.append(f"errors {inflation:.3g} times as wide for residuals beyond the noise")
    if structure is not None and structure.widening > NOTABLE:
        found = " and ".join(structure.found)
        said.append(f"errors {structure.widening:.3g} times as wide for residuals that {found}")
        seen = extent
    if len(said) > bool(chi):
        return Ending(words=DESCRIBES, ground=", ".join(said), extent=seen)
    if adequacy is None or not chi:
        ground, noise_alone = _untested(adequacy, structure)
        return Ending(words=DESCRIBES, ground=ground, extent=extent if noise_alone else "")
    if adequacy.p_value > TOO_SMALL:
        return Ending(words=DESCRIBES, ground=f"{chi}, less than the {noise} would leave")
    return Ending(words=DESCRIBES, ground=f"{chi}, as the {noise} explains", whole=True)


def _untested(adequacy: Adequacy | None, structure: Structure | None) -> tuple[str, bool]:
    """Why chi square tested nothing, and whether it was for noise that nobody stated."""
    if adequacy is None:
        return UNTESTED, False
    if not math.isnan(adequacy.chi_square):
        return TOO_FEW, False
    alike = structure is not None and not structure.found
    return UNSTATED + LIKE_NOISE * alike, True


def extent_of(data: Dataset, residuals: FloatArray) -> str:
    """How far curves are described, in words; empty where rows are no shares of an amplitude.

    Args:
        data: all measurements.
        residuals: rows of all of them, (m,).
    """
    fitted = [(m, k) for m, k in zip(data.measurements, data.slices, strict=True) if m.rows]
    left = [m.share_left(residuals[mine]) for m, mine in fitted if m.is_curve]
    known = [share for share in left if math.isfinite(share)]
    if not known:
        return ""
    share = f"to {number(100.0 * max(known), 2)} % of the largest amplitude"
    return share if len(known) == len(fitted) else f"(curves {share})"


def misfit_ground(adequacy: Adequacy) -> str:
    """What it rests on that a model does not describe the data; empty: nothing was tested.

    Args:
        adequacy: of the residuals.
    """
    chi = "" if math.isnan(adequacy.p_value) else _chi_words(adequacy)
    if not adequacy.is_correlated or adequacy.against or adequacy.absent:
        return chi
    share = f"{number(100.0 * adequacy.share, 2)} %"
    part = f"structured residuals of {share} of the largest amplitude"
    return f"{chi}, {part}" if chi else part


def _chi_words(adequacy: Adequacy) -> str:
    # priors leave no whole number; of a misfit chi square over it is told to three digits
    free = adequacy.freedom
    freedom = number(round(free, 1)) if adequacy.describes else number(free, 3)
    against = f" against {adequacy.against}" if adequacy.against else ""
    return f"χ² = {number(adequacy.chi_square, 3)} on {freedom_words(freedom)}{against}"
