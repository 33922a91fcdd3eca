"""Curves of the virtual laboratory: what they have in common."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, Self

import numpy as np

from fitting.lab.writer import synthetic_files
from fitting.text.toml import toml_text

#: Levels of the regularisation where the start is near.
FEW_LEVELS = {"nu_start": 1e-6, "beta": 0.01, "iterations": 1, "misfit": "squares", "starts": 1}
#: Numbers that may have either sign, and least values of some; all others are above zero.
SIGNED = frozenset(
    [
        "delay_s",
        "drift_hz",
        "gain_phase_rad",
        "offset_v",
        "phase_rad",
        "slope",
        "theta_rad",
        "tuning_hz_v",
    ]
)
LEAST = {"noise": 0, "before_s": 0, "points": 8, "volts": 2}


class Curve(ABC):
    """A record of a measurement by a closed form, with a campaign of its own.

    Raises:
        ValueError: numbers that no laboratory has.
    """

    #: Table of truth.toml that holds the record.
    TABLE: ClassVar[str] = "curve"
    #: What it is called.
    kind: str

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, str | bool):
                continue
            above = name not in SIGNED and name not in LEAST
            if not math.isfinite(value) or (above and value <= 0.0):
                wanted = "a number above zero" if above else "a number"
                raise ValueError(f"{name}: found {value!r}, wanted {wanted}")
            if value < LEAST.get(name, -math.inf):
                raise ValueError(f"{name}: found {value!r}, wanted {LEAST[name]} or more")

    @abstractmethod
    def recorded(
        self, rng: np.random.Generator
    ) -> tuple[dict[str, dict[str, Any]], dict[str, float]]:
        """Columns by file name, with noise, and what truth.toml states besides of the outcome.

        Args:
            rng: of the noise.
        """

    @abstractmethod
    def campaign(self) -> dict[str, Any]:
        """Tables of its campaign."""

    def truth(self, seed: int, **outcome: float) -> dict[str, Any]:
        """Tables of truth.toml.

        Args:
            seed: of the noise.
            **outcome: what follows from the record.
        """
        return {self.TABLE: dict(vars(self)), "outcome": {"seed": seed, **outcome}}

    def made(self, seed: int, head: Sequence[str]) -> tuple[Self, dict[str, Any], dict[str, str]]:
        """Itself, its truth, and the files of the campaign by name.

        Args:
            seed: of the noise.
            head: lines that open every file.
        """
        data, outcome = self.recorded(np.random.default_rng(seed))
        truth = self.truth(seed, **outcome)
        return self, truth, synthetic_files(toml_text(self.campaign(), head), data, truth, head)


def parameter(
    name: str, unit: str, bounds: tuple[float, float], start: float, digits: int = 17
) -> dict[str, float | str]:
    """Table of a parameter for a campaign.

    Args:
        name: of the variable.
        unit: of all numbers.
        bounds: lower and upper one.
        start: where a fit starts.
        digits: that are written.
    """
    numbers = {"lower": bounds[0], "upper": bounds[1], "start": start}
    return {"name": name, "unit": unit, **{k: float(f"{v:.{digits}g}") for k, v in numbers.items()}}
