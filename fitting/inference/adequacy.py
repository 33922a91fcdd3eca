"""Does the model describe the data at all? Chi square of the rows whose noise is known.

    chi^2 = r^T V^-1 r at the most likely point        freedom = m - s - tr(W C W^T)

over rows of declared or measured noise, s the unknowns that are solved for inside them; where
noise is taken from the scatter of the residuals themselves, chi square says nothing. The model is
said not to describe the data where chi square is both several times its degrees of freedom and too
improbable for chance:

    chi^2/freedom > RATIO = 4        P(chi^2 or more) < IMPROBABLE = 1e-4

(`fitting.signal.chi_square`: noise that was estimated beside the fit leaves larger ones).

Noise that was stated two times too small, as happens, reaches the first and is met by wider errors
(the scale factor of the Particle Data Group, Review of Particle Physics, section 5.2.2); with few
degrees of freedom noise alone reaches it, but the second only once in ten thousand fits. What the
simulation may be off by (`fitting.fit.noise`) excuses what it can explain: it is in the intervals
then, and no fault of the model.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fitting.campaign.parameters import Parameter, outside_box, to_model
from fitting.fit.covariance import RowCovariance
from fitting.fit.likelihood.descent import Optimum
from fitting.inference.likelihood.exploration import data_covariance
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.signal.chi_square import tail
from fitting.signal.residual_tests import TOLD, Structure
from fitting.text.arrays import FloatArray
from fitting.text.notation import freedom_words, number

#: Chi square over its degrees of freedom, and probability, beyond which a model is given up.
RATIO, IMPROBABLE = 4.0, 1e-4


def adequacy_of(
    optimum: Optimum,
    structure: Structure | None = None,
    closer: Adequacy | None = None,
    scale_off: float = math.nan,
) -> Adequacy:
    """Chi square of the rows of known noise at the most likely point, and whether it will do.

    Args:
        optimum: the most likely point and its likelihood.
        structure: of the residuals of curves, by which their noise was taken wider: that excuses
            no model, the noise is known.
        closer: what another form of a line says of a sweep whose residuals tell its noise, where it
            leaves far less.
        scale_off: factor by which the scale of peaks may be off, where that is beyond their noise:
            what they tell with it is not judged by errors about one point; else NaN.
    """
    widening = 1.0 if structure is None else structure.widening
    found = _of_known_noise(optimum, widening)
    if closer is not None and found.describes:
        return closer
    if found.describes and scale_off > 1.0:
        return replace(found, describes=False, scale_off=scale_off)
    return found


def _of_known_noise(optimum: Optimum, widening: float) -> Adequacy:
    likelihood, m = optimum.likelihood, optimum.likelihood.data_rows
    data = likelihood.objective.data
    known = data.sigma > 0.0
    here = optimum.expansion
    rows = likelihood.residuals(here.sample.rows[:m])[known]
    matrix = likelihood.residuals(here.matrix[:m])[known]
    covariance = data_covariance(optimum, stated=True)
    solved = data.solved_of(known=True)
    noise = likelihood.noise

    def by(wider: RowCovariance) -> Adequacy:
        sigma = wider.sigma.copy()
        sigma[data.curve_rows] /= widening
        own = replace(wider, sigma=sigma).restricted(known)
        white, slopes = own.whitened(rows), wider.restricted(known).whitened(matrix)
        return judged(white, slopes, covariance, solved, data.noise_freedom)

    found = by(noise)
    if found.describes or not likelihood.bounded.columns:
        return found
    return replace(found, describes=by(noise.loosened(likelihood.bounded)).describes)


def judged(
    white: FloatArray,
    slopes: FloatArray,
    covariance: FloatArray,
    solved: int = 0,
    noise_freedom: float = np.inf,
) -> Adequacy:
    """Whether residuals are what their noise explains.

    Args:
        white: residuals of known noise, of unit variance by it, shape (m,).
        slopes: their derivatives in x, by the noise that `covariance` is of, shape (m, n).
        covariance: of x, shape (n, n), from all data.
        solved: number of unknowns that the rows are solved for inside.
        noise_freedom: degrees of freedom of the noise where it is estimated, else infinite.
    """
    if not white.size:
        return Adequacy(chi_square=np.nan, freedom=0.0, p_value=np.nan, describes=True)
    square = float(white @ white)
    freedom = float(white.size - solved - np.sum((slopes @ covariance) * slopes))
    if freedom < 0.5:  # as many unknowns as rows: nothing is left to judge by
        return Adequacy(chi_square=square, freedom=0.0, p_value=np.nan, describes=True)
    p_value = tail(square, freedom, noise_freedom)
    bad = square > RATIO * freedom and p_value < IMPROBABLE
    return Adequacy(chi_square=square, freedom=freedom, p_value=p_value, describes=not bad)


def is_redundant(optimum: Optimum) -> bool:
    """Whether there are more data than unknowns: else every model fits, and none is tested.

    A Gaussian prior of a parameter counts as one more datum.

    Args:
        optimum: the most likely point and its likelihood.
    """
    likelihood = optimum.likelihood
    priors = np.count_nonzero(likelihood.inverse_prior_sigma)
    rows = likelihood.data_rows - likelihood.objective.data.solved_inside
    return bool(rows + priors > len(likelihood.parameters))


def adequacy_sentences(
    adequacy: Adequacy, optimum: Optimum, structure: Structure | None = None
) -> tuple[str, ...]:
    """How well the model describes the data, in words.

    Args:
        adequacy: of the rows of known noise.
        optimum: the most likely point and its likelihood.
        structure: of the residuals of curves, None without any.
    """
    likelihood = optimum.likelihood
    inflation = likelihood.inflation
    square, freedom = number(optimum.chi_square, 3), number(optimum.degrees_of_freedom, 3)
    said = f"χ² = {square} on {freedom_words(freedom)}"
    if not adequacy.describes:
        return (misfit_sentence(adequacy, drifts=bool(likelihood.objective.data.tones)),)
    if structure is not None and structure.widening > TOLD:
        return (
            f"The residuals of the curve {' and '.join(structure.found)}: errors are "
            f"{structure.widening:.3g} times as wide, so that its points weigh as the equal and "
            "independent ones they are worth.",
        )
    if inflation > 1.0:
        return (f"{said}: all errors are {inflation:.3g} times as wide.",)
    if np.isnan(adequacy.chi_square):
        return (f"{said}: the noise is taken from the scatter of the residuals themselves.",)
    return (f"{said}: the {likelihood.objective.data.noise_words} explains the residuals.",)


def misfit_sentence(adequacy: Adequacy, *, drifts: bool) -> str:
    """That the model does not describe the data, as far as was searched, and why.

    Args:
        adequacy: of the rows of known noise.
        drifts: whether there are experiments between which something may drift.
    """
    if adequacy.scale_off > 1.0:
        return misfit_advice(adequacy, drifts=drifts)
    if adequacy.absent:
        return f"No line stands out of the noise. {misfit_advice(adequacy, drifts=drifts)}"
    return (
        f"The model does not describe the data: χ² = {number(adequacy.chi_square, 3)} on "
        f"{freedom_words(number(adequacy.freedom, 3))}. "
        f"{misfit_advice(adequacy, drifts=drifts)}"
    )


def misfit_advice(adequacy: Adequacy, *, drifts: bool) -> str:
    """How far the best parameters are from describing the data, and what may help.

    Args:
        adequacy: of the rows of known noise.
        drifts: whether there are experiments between which something may drift.
    """
    if adequacy.scale_off > 1.0:
        return (
            "The scale of the peaks is taken from a sweep whose top is not that of a line: it may "
            f"be off by a factor of {number(adequacy.scale_off, 2)}. No value is called "
            'determined; wanted a sweep without that, or scale = "free".'
        )
    if adequacy.absent:
        return (
            f"Without one {adequacy.absent} are described nearly as well. No value is called "
            "determined; wanted a stronger drive, more averaging, or points about the lines."
        )
    times = f"{adequacy.chi_square / adequacy.freedom:.3g} times"
    if adequacy.against:
        way = adequacy.remedy or "a sweep without that, or phases"
        return (
            f"What it leaves is {times} (in squares) what {adequacy.against} leaves. "
            f"No value is called determined; wanted {way}, or another model."
        )
    return (
        f"At the best parameters that were found χ² is {times} what the noise explains. No value "
        "is called determined; wanted narrower boxes or a nearer start, if better parameters were "
        f"missed, else another model, {'another drift, ' if drifts else ''}or the noise that the "
        "data have."
    )


def outside_sentences(optimum: Optimum) -> tuple[str, ...]:
    """Parameters that the data want outside the box of the campaign, a sentence each.

    Args:
        optimum: the most likely point and its likelihood.
    """
    parameters, x = optimum.likelihood.parameters, optimum.expansion.x
    at = to_model(parameters, x)
    return tuple(_outside_words(parameters[i], float(at[i])) for i in outside_box(parameters, x))


def _outside_words(parameter: Parameter, value: float) -> str:
    found = f"{number(value, 5)} {parameter.unit}".rstrip()
    box = f"{number(parameter.lower)} to {number(parameter.upper)} {parameter.unit}".rstrip()
    return f"The data want {parameter.name} = {found}, beyond its box of {box}."
