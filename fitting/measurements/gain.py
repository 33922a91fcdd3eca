"""Complex gains: what multiplies a response and what is added to it, solved inside.

    y_k = A_k c_k + noise,   A_k = [h_k, further columns],   c_k = [a_k, coefficients of these]

Segments k of data y, whose responses h the model's parameters p move. The coefficients enter
linearly; at every p they are the best ones, and the rows of the fit depend on p alone:

    min_p min_c sum_k w_k^2 |A_k(p) c_k - y_k|^2 = min_p sum_k w_k^2 |A_k A_k^+ y_k - y_k|^2

(variable projection; the right side with a gain of its own for each segment). Segments that share
a gain have either one a for all, or its modulus alone and each a phase of its own, as after a
restart of the instrument: with the further columns projected out of h and y,

    one gain       a   = sum_k w_k^2 <h_k, y_k> / sum_k w_k^2 <h_k, h_k>
    one modulus    |a| = sum_k w_k^2 |<h_k, y_k>| / sum_k w_k^2 <h_k, h_k>
                   arg a_k = arg <h_k, y_k>

Source: G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from fitting.text.arrays import ComplexArray


@dataclass(frozen=True)
class Solved:
    """What was solved inside one record: columns ``design`` (n, k), their ``coefficients`` (k,)."""

    design: npt.NDArray[Any]
    coefficients: npt.NDArray[Any]

    @property
    def values(self) -> npt.NDArray[Any]:
        """What is observed, (n,)."""
        return np.asarray(self.design @ self.coefficients)


@dataclass(frozen=True)
class SharedGain:
    """The gain of the segments ``members``, by number; with ``modulus_only`` its modulus alone.

    The background of the response is each segment's own.
    """

    members: tuple[int, ...]
    modulus_only: bool = False

    def unknowns(self, columns: Sequence[int]) -> int:
        """Number of real unknowns.

        Args:
            columns: number of columns of every segment, of those of other gains as well.
        """
        nearby = sum(2 * (columns[k] - 1) for k in self.members)
        return nearby + (1 + len(self.members) if self.modulus_only else 2)

    def solve(
        self,
        designs: Sequence[ComplexArray],
        measured: Sequence[ComplexArray],
        weights: Sequence[float],
    ) -> dict[int, Solved]:
        """The members with the coefficients of least squares, by number.

        Args:
            designs: columns of every segment, (n, k), the response first.
            measured: values of every segment, (n,).
            weights: of every segment's residuals.
        """
        if len(self.members) == 1:
            [k] = self.members
            return {k: Solved(designs[k], _least_squares(designs[k], measured[k]))}
        products, powers, nearby = [], [], []
        for k in self.members:
            ground = designs[k][:, 1:]
            both = np.column_stack([designs[k][:, 0], measured[k]])
            coefficients = _least_squares(ground, both)
            h, y = (both - ground @ coefficients).T
            products.append(weights[k] ** 2 * np.vdot(h, y))
            powers.append(weights[k] ** 2 * float(np.vdot(h, h).real))
            nearby.append(coefficients)
        gains = gains_of(products, powers, rotated=self.modulus_only)
        return {
            k: Solved(designs[k], np.concatenate([[gain], c[:, 1] - gain * c[:, 0]]))
            for k, gain, c in zip(self.members, gains, nearby, strict=True)
        }

    def columns(self, solved: Mapping[int, Solved]) -> list[dict[int, ComplexArray]]:
        """Derivatives of the members' values by every real unknown: by member, zero elsewhere.

        Args:
            solved: members by number.
        """
        gains = {k: solved[k].design[:, 0] for k in self.members}
        result: list[dict[int, ComplexArray]] = []
        if self.modulus_only:
            phases = {k: np.exp(1j * np.angle(solved[k].coefficients[0])) for k in gains}
            result.append({k: phases[k] * h for k, h in gains.items()})
            result += [{k: 1j * phases[k] * h} for k, h in gains.items()]
        else:
            result += [gains, {k: 1j * h for k, h in gains.items()}]
        for k in self.members:
            for nearby in solved[k].design[:, 1:].T:
                result += [{k: nearby}, {k: 1j * nearby}]
        return result


def gains_of(
    products: Sequence[complex], powers: Sequence[float], *, rotated: bool
) -> ComplexArray:
    """Gain a_k of every segment, equal or of equal moduli: (segments,).

    Args:
        products: w_k^2 <h_k, y_k> of every segment.
        powers: w_k^2 <h_k, h_k> of every segment.
        rotated: whether each has a phase of its own.
    """
    total = max(sum(powers), 1e-300)
    if not rotated:
        return np.full(len(products), sum(products) / total)
    modulus = float(np.sum(np.abs(products))) / total
    return np.asarray(modulus * np.exp(1j * np.angle(products)))


def _least_squares(design: ComplexArray, values: ComplexArray) -> ComplexArray:
    """Coefficients of columns of any size."""
    if design.shape[1] == 0:
        return np.empty((0, *values.shape[1:]), dtype=complex)
    sizes = np.linalg.norm(design, axis=0)
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    result = np.linalg.lstsq(design / sizes, values, rcond=None)[0]
    return np.asarray(result / (sizes if result.ndim == 1 else sizes[:, None]))
