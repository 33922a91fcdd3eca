"""Values of a fit with the verdicts, errors and intervals of their profiles."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from fitting.inference.contradictions import without_verdicts
from fitting.inference.likelihood.knowledge import Knowledge, Profile
from fitting.text.estimate import NOWHERE, Estimate, Verdict


@dataclass(frozen=True)
class JudgedValues:
    """All values of a fit, and what profiles say of them; None: none were walked."""

    parameters: Mapping[str, Estimate]
    derived: Mapping[str, Estimate]
    offsets: tuple[Estimate, ...]
    knowledge: Knowledge | None

    @property
    def units(self) -> dict[str, str]:
        """Of parameters and outputs, by name."""
        both = (*self.parameters.items(), *self.derived.items())
        return {name: value.unit for name, value in both}

    def judged(self, apart: Mapping[str, str], why_not: str) -> JudgedValues:
        """With verdicts, errors and intervals of the profiles.

        Args:
            apart: why single values have none, by name.
            why_not: why none has any; empty: the fit converged and the model describes the data.
        """
        knowledge = self.knowledge
        if knowledge is not None and why_not:
            apart = {**dict.fromkeys(knowledge.profiles, why_not), **apart}
        if knowledge is not None and apart:
            knowledge = without_verdicts(knowledge, apart)
        known = knowledge.profiles if knowledge is not None else {}
        offsets = self.offsets
        if why_not:
            offsets = tuple(
                replace(o, std=math.nan, ci95=(math.nan, math.nan), status=Verdict.WITHDRAWN)
                for o in offsets
            )
        derived = {
            n: _judged(d, known.get(n), apart.get(n, why_not)) for n, d in self.derived.items()
        }
        return JudgedValues(
            {
                n: _judged(p, known.get(n), apart.get(n, why_not))
                for n, p in self.parameters.items()
            },
            {n: _withdrawn(d) if n in apart or why_not else d for n, d in derived.items()},
            offsets,
            knowledge,
        )


def _withdrawn(derived: Estimate) -> Estimate:
    """An output without errors of single places: the model does not describe the data."""
    nothing = (math.nan,) * len(derived.stds)
    return replace(derived, stds=nothing, halves95=nothing)


def _judged(value: Estimate, profile: Profile | None, withdrawn: str) -> Estimate:
    """A value with the verdict, error and interval of its profile, where one was walked.

    `withdrawn`: why no verdict is given; empty where the model describes the data.
    """
    nowhere = (math.nan, math.nan)
    if profile is None:
        if not withdrawn:
            return value
        return replace(
            value,
            std=math.nan,
            ci95=nowhere,
            status=Verdict.WITHDRAWN,
            reason=withdrawn,
        )
    low, high = profile.interval68
    std = 0.5 * (high - low) if profile.verdict.has_value else math.nan
    return replace(
        value,
        std=std,
        ci95=profile.interval95,
        shrinkage=profile.shrinkage,
        status=profile.verdict,
        simulation=profile.simulation,
        reason=profile.reason,
        ci68=profile.interval68 if profile.verdict.has_value else NOWHERE,
        method="profile",
        closed_by=profile.ends,
        active_bounds=profile.boxes,
    )
