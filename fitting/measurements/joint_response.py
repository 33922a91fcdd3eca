"""Several campaigns as one response: each sees its own parameters and answers beside the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.measurements.response import Evaluation, Response
from fitting.text.arrays import FloatArray


@dataclass(frozen=True)
class JointResponse:
    """`Response` of joined campaigns; ``columns`` are the positions of a member's parameters in p.

    Peaks and derived outputs stand one campaign after the other. Sweeps are only in the parts of an
    evaluation, each beside its own scale.
    """

    members: tuple[Response, ...]
    columns: tuple[tuple[int, ...], ...]

    def evaluate_many(self, ps: Sequence[FloatArray]) -> list[Evaluation]:
        """Answers of all campaigns to every parameter vector, one batch per campaign."""
        answers = [
            member.evaluate_many([np.asarray(p)[list(own)] for p in ps])
            for member, own in zip(self.members, self.columns, strict=True)
        ]
        return [
            Evaluation(
                np.concatenate([part.peaks for part in parts]),
                np.empty(0),
                None,
                sum(part.runs for part in parts),
                parts,
            )
            for parts in zip(*answers, strict=True)
        ]

    def peaks(self, p: FloatArray) -> FloatArray:
        """Amplitudes at the tones of all campaigns, shape (n_peaks,)."""
        return np.concatenate([m.peaks(q) for m, q in self._split(p)])

    def sweep(self, p: FloatArray) -> FloatArray:
        """Nothing: every campaign has a sweep of its own."""
        return np.empty(0)

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        """Derived outputs of all experiments; of a campaign that lacks one there are none."""
        answers = [
            member.derived_many([np.asarray(p)[list(own)] for p in ps])
            for member, own in zip(self.members, self.columns, strict=True)
        ]
        joined = []
        for parts in zip(*answers, strict=True):
            names = dict.fromkeys(name for part in parts for name in part)
            joined.append(
                {n: np.concatenate([part[n] for part in parts if n in part]) for n in names}
            )
        return joined

    def _split(self, p: FloatArray) -> list[tuple[Response, FloatArray]]:
        return [
            (member, np.asarray(p)[list(own)])
            for member, own in zip(self.members, self.columns, strict=True)
        ]
