"""Noise of rows as a diagonal and a few columns: against arrays (m, m), for many rows without."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from fitting.fit.covariance import BoundedErrors, RowCovariance, WhitenedErrors
from fitting.text.arrays import FloatArray

RNG = np.random.default_rng(21)


def random_noise(m: int, k: int, size: float) -> RowCovariance:
    return RowCovariance(10.0 ** RNG.uniform(-3.0, 0.0, m), size * RNG.standard_normal((m, k)))


def dense(noise: RowCovariance) -> FloatArray:
    return np.asarray(np.diag(noise.sigma**2) + noise.common @ noise.common.T)


@pytest.mark.parametrize(
    ("m", "k", "size"), [(1, 1, 0.1), (7, 0, 0.0), (12, 1, 0.02), (30, 3, 5.0), (3, 5, 1.0)]
)
def test_everything_is_that_of_the_full_array(m: int, k: int, size: float) -> None:
    noise = random_noise(m, k, size)
    v = dense(noise)
    inverse = np.linalg.inv(v)
    rows, matrix = RNG.standard_normal(m), RNG.standard_normal((m, 4))
    white, slopes = noise.whitened(rows), noise.whitened(matrix)
    assert white @ white == pytest.approx(rows @ inverse @ rows, rel=1e-9)
    assert slopes.T @ slopes == pytest.approx(matrix.T @ inverse @ matrix, rel=1e-8)
    assert slopes.T @ white == pytest.approx(matrix.T @ inverse @ rows, rel=1e-7, abs=1e-9)
    assert noise.coloured(white) == pytest.approx(rows, rel=1e-8, abs=1e-10)
    assert noise.coloured(slopes) == pytest.approx(matrix, rel=1e-8, abs=1e-10)
    # back from slopes of whitened rows: W^T W = V^-1
    assert noise.pulled_back(white) == pytest.approx(inverse @ rows, rel=1e-7, abs=1e-9)
    assert noise.precision == pytest.approx(np.diag(inverse), rel=1e-8)
    assert noise.row_sigma == pytest.approx(np.sqrt(np.diag(v)), rel=1e-12)
    assert noise.log_determinant == pytest.approx(np.linalg.slogdet(v)[1], rel=1e-9)
    kept = np.arange(m) % 2 == 0
    assert dense(noise.restricted(kept)) == pytest.approx(v[np.ix_(kept, kept)])
    assert dense(noise.times(3.0)) == pytest.approx(9.0 * v)


def test_rows_that_share_nothing_are_divided_by_their_own_noise() -> None:
    sigma, rows = RNG.uniform(0.1, 1.0, 6), RNG.standard_normal(6)
    noise = RowCovariance.of(sigma)
    assert noise.whitened(rows) == pytest.approx(rows / sigma)
    assert noise.common.size == 0
    assert noise.log_determinant == pytest.approx(2.0 * np.sum(np.log(sigma)))


def test_parts_share_nothing_with_each_other() -> None:
    parts = [random_noise(5, 2, 0.3), random_noise(3, 0, 0.0), random_noise(4, 1, 2.0)]
    whole = np.zeros((12, 12))
    for part, first in zip(parts, (0, 5, 8), strict=True):
        whole[first : first + part.size, first : first + part.size] = dense(part)
    joined = RowCovariance.joined(parts)
    assert dense(joined) == pytest.approx(whole)


def test_what_a_simulation_may_be_off_by_is_that_of_its_columns() -> None:
    m = 9
    noise = random_noise(m, 2, 0.5)
    errors = BoundedErrors(RNG.uniform(-1.0, 1.0, m), RNG.standard_normal((m, 2)))
    columns = np.hstack([np.diag(errors.own), errors.common])
    assert errors.largest == pytest.approx(np.sum(np.abs(columns), axis=1))
    loose = dense(noise) + columns.shape[1] * columns @ columns.T
    assert dense(noise.loosened(errors)) == pytest.approx(loose)
    assert noise.loosened(BoundedErrors.none()) is noise
    # scales in doubt move values, and excuse no misfit
    doubts = RNG.standard_normal((m, 1))
    for each in (errors, BoundedErrors.none()):
        more, pull = each.with_scales(doubts), RNG.standard_normal(m)
        assert more.columns == max(each.columns, m) + 1
        before = each.moved(pull) if each.columns else 0.0
        assert more.moved(pull) == pytest.approx(before + float(abs(pull @ doubts)[0]))
        assert dense(noise.loosened(more)) == pytest.approx(dense(noise.loosened(each)))
        kept = np.arange(m) > 3
        assert more.restricted(kept).scales == pytest.approx(doubts[kept])
    # among whitened rows: every column whitened by itself, slopes by differences of nothing at all
    white, slopes = WhitenedErrors(errors, noise), RNG.standard_normal(m)
    whitened = noise.whitened(columns)
    assert white.moved(slopes) == pytest.approx(np.sum(np.abs(slopes @ whitened)))
    assert white.reach == pytest.approx(np.sum(np.linalg.norm(whitened, axis=0)))
    assert white.widened(4.0).moved(slopes) == pytest.approx(white.moved(slopes) / 4.0)
    kept = np.arange(m) > 3
    some = errors.restricted(kept)
    assert some.moved(slopes[kept]) == pytest.approx(np.sum(np.abs(slopes[kept] @ columns[kept])))


def test_memory_grows_with_the_rows_and_not_with_their_square() -> None:
    """16,441 rows: an array (m, m) would be 2 GB."""
    m = 41 * 401
    noise, rows = random_noise(m, 2, 0.1), RNG.standard_normal((m, 5))
    errors = BoundedErrors(np.full(m, 1e-4), np.full((m, 1), 1e-4))
    tracemalloc.start()
    try:
        white = noise.loosened(errors).whitened(rows)
        WhitenedErrors(errors, noise).moved(white[:, 0])
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 200 * rows.nbytes / 5
