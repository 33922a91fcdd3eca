"""The profile of a coupling over a map of spectra, against scipy with every scale written out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.special import ive

import fitting as ff
from fitting.text.arrays import FloatArray
from tests.support.virtual.crossing import CrossingLaboratory, laboratory, response_of

METHOD = ff.Tikhonov(nu=1e-6, beta=0.01, levels=2, misfit="squares")
COUPLING = "lambda12"


def chi_square_at(lab: CrossingLaboratory, begun: FloatArray, coupling: float | None) -> float:
    """Least chi square over all coefficients and scales; at one coupling, if it is given.

    The sample is solved in hybridised coordinates, and magnitudes are averaged by Bessel functions.
    """
    names = list(lab.truth)
    held = names.index(COUPLING)
    units = np.array([u.high - u.low for u in lab.unknowns]) * 1e-3
    sigma = lab.sigma[:, None]

    def amplitudes(p: FloatArray) -> FloatArray:
        values = dict(zip(names, map(float, p), strict=True))
        places = zip(lab.volts, lab.times_s, strict=True)
        found = [response_of(values, 2, float(v), float(t), lab.frequency_hz) for v, t in places]
        return np.abs(np.array(found))

    size = np.max(lab.amplitude, axis=1) / np.max(amplitudes(begun), axis=1)

    def rows(y: FloatArray) -> FloatArray:
        p = begun + units * y[: len(names)]
        if coupling is not None:
            p[held] = coupling
        a = (size * np.exp(1e-2 * y[len(names) :]))[:, None] * amplitudes(p)
        q = (a / sigma) ** 2 / 4.0
        mean = sigma * np.sqrt(np.pi / 2.0) * ((1.0 + 2.0 * q) * ive(0, q) + 2.0 * q * ive(1, q))
        own = 1e-6 * y[held] if coupling is not None else 0.0  # it has no effect: held at nothing
        return np.append(((mean - lab.amplitude) / sigma).ravel(), own)

    y = np.zeros(len(names) + lab.volts.size)
    return 2.0 * float(least_squares(rows, y, method="trf", x_scale="jac").cost)


@pytest.mark.parametrize(
    ("spectra", "points", "starts"),
    [
        (12, 21, 1),
        pytest.param(5, 61, 1, marks=pytest.mark.nightly),
        pytest.param(12, 41, 2, marks=pytest.mark.nightly),
    ],
)
def test_ends_of_its_interval_are_where_chi_square_has_risen_by_its_quantile(
    spectra: int, points: int, starts: int
) -> None:
    """Of twelve spectra a few are looked at first, in the search and along the ways to the ends."""
    lab = laboratory(5, spectra=spectra, points=points, noise=0.02)
    problem = lab.by_closed_form(ff.Fmu("CoupledModes2", workers=1))
    inference = ff.profile(ff.fit(problem, METHOD, starts=starts), [COUPLING])
    found = inference[COUPLING]
    assert found.status == "determined"
    low, high = found.interval(0.95)
    assert low < lab.truth[COUPLING] < high
    knowledge = inference.inferred.knowledge
    assert knowledge is not None
    assert knowledge.inflation == 1.0
    begun = np.array([knowledge.most_likely[name] for name in lab.truth])
    least = chi_square_at(lab, begun, None)
    assert knowledge.chi_square == pytest.approx(least, abs=1e-2)
    for end in (low, high):
        assert chi_square_at(lab, begun, end) - least == pytest.approx(3.84, abs=0.15)
