"""What several campaigns fitted together say of each other, and of a value from elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

#: Disagreement, in standard deviations, that is worth a warning; and that no noise explains, among
#: as many tests as people make.
WORTH_A_WARNING, CONTRADICT = 3.0, 4.0


@dataclass(frozen=True)
class ValueAlone:
    """A value as one campaign alone determines it (NaN where it does not), with its error."""

    value: float
    std: float


@dataclass(frozen=True, kw_only=True)
class SeriesPart:
    """One campaign of a joint fit.

    `chi` is its scale; `determined` how many numbers its data determine; `chi_square_joint` of its
    rows at the joint solution and `chi_square_alone` at its own, both linearised at the former;
    `rows` the number of its rows, `alone` what it determines by itself, by name; `swept_initial_v`
    and `swept_final_v` its sweep as simulated (scaled) before and after, at the measured points.
    """

    name: str
    campaign: str
    scale_kind: str
    chi: float
    rows: int
    determined: int
    chi_square_joint: float
    chi_square_alone: float
    inflation: float
    alone: Mapping[str, ValueAlone]
    swept_initial_v: tuple[float, ...] = ()
    swept_final_v: tuple[float, ...] = ()


@dataclass(frozen=True, kw_only=True)
class PairTest:
    """Test of the numbers that two sets of campaigns both determine.

    `chi_square` of their difference, against `freedom` of them; `sigmas` the same as standard
    deviations of a normal distribution (NaN where they determine nothing in common).
    """

    one: str
    other: str
    chi_square: float
    freedom: int
    p_value: float
    sigmas: float

    @property
    def level(self) -> Literal["agreement", "tension", "contradiction"]:
        """Whether both sets of campaigns agree, as far as noise explains."""
        if self.sigmas > CONTRADICT:
            return "contradiction"
        return "tension" if self.sigmas > WORTH_A_WARNING else "agreement"


@dataclass(frozen=True)
class JointResult:
    """Campaigns of a joint fit, and whether they agree."""

    series: tuple[SeriesPart, ...]
    tensions: tuple[PairTest, ...]


@dataclass(frozen=True, kw_only=True)
class ExternalTest:
    """Distance of a result from a value found elsewhere, in standard deviations (NaN: untestable).

    `std` of the external value is zero where none was given; `found`, `found_std` are the result's.
    """

    name: str
    value: float
    std: float
    unit: str
    found: float
    found_std: float
    sigmas: float
