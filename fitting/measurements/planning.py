"""The plan of a campaign: settling, windows and sweep points, each with reason and bound."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fitting.campaign import BoundCampaign
from fitting.signal.combinations import mixed_hz
from fitting.signal.scale import FINE_POINTS, half_power_width, laboratory_maximum, nodes_around
from fitting.signal.window import Window, plan_window
from fitting.simulate.budget import (
    SHARES,
    Basis,
    Budget,
    Decision,
    Kind,
    PlanRecord,
    record_of,
)
from fitting.simulate.planner import window_decision
from fitting.simulate.settling import settling_s
from fitting.simulate.words import decision_in_words, sum_in_words, window_in_words
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput

#: Part of the wanted accuracy that a transient planned from a line width may leave.
TRANSIENT = 0.1


@dataclass(frozen=True)
class Plan:
    """Windows of a campaign: one per experiment, one per sweep frequency, and what they rest on.

    `settings` are start values of the FMU that the plan chose; `budget` holds its decisions, None
    where nothing was decided; `remarks` are sentences beside them. `maximum_bias` is what the
    simulated maximum of the sweep may be off by, `maximum_bend` (1/Hz) the third derivative of
    1/A^2 over its second, which bounds that from three points (None: not known).
    """

    experiments: tuple[Window, ...]
    settle_s: float
    nodes_hz: tuple[float, ...]
    budget: Budget | None = None
    remarks: tuple[str, ...] = ()
    settings: Mapping[str, Scalar] = field(default_factory=dict)
    maximum_bias: float | None = None
    maximum_bend: float | None = None

    @property
    def decisions(self) -> tuple[Decision, ...]:
        """Every choice with its bound."""
        return () if self.budget is None else self.budget.decisions

    @property
    def promised(self) -> float:
        """Sum of the bounds, NaN where nothing was decided."""
        return float("nan") if self.budget is None else self.budget.promised

    @property
    def sentences(self) -> tuple[str, ...]:
        """The plan for a report: a line per decision, the sum, remarks."""
        if self.budget is None:
            return self.remarks
        return (*map(_sentence, self.budget.decisions), sum_in_words(self.budget), *self.remarks)

    @property
    def record(self) -> PlanRecord | None:
        """The plan for a result."""
        return None if self.budget is None else record_of(self.budget, self.settings)


def _sentence(decision: Decision) -> str:
    text = decision_in_words(decision)
    return f"{text[0].upper()}{text[1:]}."


def plan_campaign(bound: BoundCampaign) -> Plan:
    """Settling, windows and sweep points of a campaign from what it says of itself, unmeasured.

    `fitting.measurements.campaign_plan.measured_plan` asks the FMU as well.

    Raises:
        BadInput: no way to know how long the FMU takes to settle, or tones that cannot be told
            apart.
    """
    settling = _settling(bound)
    return with_windows(bound, settling[0], Budget(bound.setup.accuracy, (settling[1],)))


def with_windows(
    bound: BoundCampaign,
    settle_s: float,
    budget: Budget,
    settings: Mapping[str, Scalar] | None = None,
) -> Plan:
    """The plan of a campaign whose time to settle is known: windows and sweep points added."""
    held = bound.setup.drive.samples_per_period if bound.setup.drive.kind == "input" else 0
    windows = tuple(
        plan_window(
            e.read_hz,
            settle_s,
            samples_per_period=held,
            mixtures_hz=mixed_hz(e.tones_hz, bound.setup.drive.order),
        )
        for e in bound.experiments
    )
    if windows:
        budget = budget.with_decision(window_decision(windows))
    remarks = tuple(
        f"Experiment {e.label}: {window_in_words(w)}."
        for e, w in zip(bound.experiments, windows, strict=True)
    )
    nodes: tuple[float, ...] = ()
    bias = None
    if bound.sweep is not None and bound.sweep.scale == "maximum":
        f, a = bound.sweep.frequency_hz, bound.sweep.amplitude_v
        centre = laboratory_maximum(f, a).frequency_hz
        spacing = 0.5 * half_power_width(f, a)
        nodes = tuple(map(float, nodes_around(centre, spacing)))
        bias = SHARES[Kind.MAXIMUM] * bound.setup.accuracy
        budget = budget.with_decision(
            Decision(
                kind=Kind.MAXIMUM,
                basis=Basis.POLYNOMIAL,
                bound=bias,
                numbers={"points": FINE_POINTS, "spacing_hz": spacing, "centre_hz": centre},
            )
        )
    return Plan(windows, settle_s, nodes, budget, remarks, settings or {}, bias)


def _settling(bound: BoundCampaign) -> tuple[float, Decision]:
    if bound.setup.steady_start:
        return 0.0, Decision(Kind.SETTLING, Basis.DECLARED, 0.0, numbers={"settle_s": 0.0})
    width = known_width_hz(bound)
    if width is None:
        raise BadInput(
            f"{bound.path}: [observe] says neither steady_start = true nor a line_width; wanted "
            "one of them, or a sweep, to know how long the FMU takes to settle"
        )
    left = TRANSIENT * bound.setup.accuracy
    settle = settling_s(width, left)
    return settle, Decision(
        kind=Kind.SETTLING,
        basis=Basis.LINE_WIDTH,
        bound=left,
        numbers={"settle_s": settle, "width_hz": width},
    )


def known_width_hz(bound: BoundCampaign) -> float | None:
    """Line width that a campaign states, or that its sweep shows, Hz."""
    if bound.setup.line_width_hz is None and bound.sweep is not None:
        return half_power_width(bound.sweep.frequency_hz, bound.sweep.amplitude_v)
    return bound.setup.line_width_hz
