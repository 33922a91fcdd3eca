"""A fit and what its checks examine, computed once and passed to all of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from fitting.campaign.parameters import to_search
from fitting.fit.fit import Fit
from fitting.fit.noise import RowNoise, noise_of
from fitting.fit.objective import Point, evaluate_many
from fitting.fit.problem import Problem
from fitting.fit.solution import Solution
from fitting.inference.estimates import Outputs
from fitting.inference.likelihood.knowledge import Adequacy, JointResult
from fitting.inference.sweeps import SweepFindings
from fitting.measurements.dataset import Dataset
from fitting.text.arrays import FloatArray
from fitting.text.estimate import (
    FittedEstimate,
    OffsetEstimate,
    OutputEstimate,
    ParameterEstimate,
)
from fitting.text.finding import Finding


@dataclass(frozen=True, kw_only=True)
class Solved:
    """A fit, its values, and what is known of its residuals.

    Args:
        fit: a solved problem.
        solution: its reported end, errors as wide as the residuals require.
        best: most likely parameters, in their units, shape (n,).
        adequacy: whether the model describes the data; None: not examined.
        inflation: factor on all errors for residuals beyond the noise.
        describes: whether there are values: the fit converged and the model describes the data.
        is_best: whether a better fit than the descent from the start was searched for.
        sweeps: lines, faults and scale of the sweeps.
        parameters: their values, as they are reported, by name.
        derived: outputs of the FMU that follow from them, by name.
        offsets: values of single experiments.
        outputs: derived outputs at the solution and around; None: not evaluated.
        joint: tests of campaigns that are fitted together; None: there is one.
        equivalents: findings of other solutions that profiles met.
        profiles: findings of the profiles.
        causes: what one mistake of the measurement would explain.
    """

    fit: Fit
    solution: Solution
    best: FloatArray
    adequacy: Adequacy | None = None
    inflation: float = 1.0
    describes: bool = True
    is_best: bool = True
    sweeps: SweepFindings = field(default_factory=SweepFindings)
    parameters: Mapping[str, ParameterEstimate] = field(default_factory=dict)
    derived: Mapping[str, OutputEstimate] = field(default_factory=dict)
    offsets: tuple[OffsetEstimate, ...] = ()
    outputs: Outputs | None = None
    joint: JointResult | None = None
    equivalents: tuple[Finding, ...] = ()
    profiles: tuple[Finding, ...] = ()
    causes: tuple[Finding, ...] = ()

    @property
    def values(self) -> dict[str, FittedEstimate]:
        """Parameters and derived outputs, by name."""
        return {**self.parameters, **self.derived}

    @property
    def problem(self) -> Problem:
        """Parameters and measurements."""
        return self.fit.problem

    @property
    def data(self) -> Dataset:
        """All measurements, as they were fitted."""
        return self.solution.objective.data

    @cached_property
    def noise(self) -> RowNoise:
        """Noise of the rows at the solution, as stated or as they scatter."""
        return noise_of(self.solution.objective, self.solution.final)

    @cached_property
    def likeliest(self) -> Point:
        """The model at the most likely parameters.

        Raises:
            FmuFailure: the model failed there.
        """
        x = to_search(self.solution.parameters, self.best)
        [point] = evaluate_many(self.solution.objective, [x])
        return point
