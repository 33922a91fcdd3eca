"""The plan of a campaign: settling, windows and sweep points, each with its reason."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fitting.combinations import mixed_hz
from fitting.errors import BadInput
from fitting.labdata import BoundCampaign
from fitting.notation import hertz
from fitting.plan import Window, plan_window, settling_s
from fitting.scaling import FINE_POINTS, half_power_width, laboratory_maximum, nodes_around

Scalar = float | int | bool | str


@dataclass(frozen=True)
class Plan:
    """Windows of a campaign: one per experiment, one per sweep frequency, and what they rest on.

    `sentences` for the report; `settings` are start values of the FMU that the plan chose.
    """

    experiments: tuple[Window, ...]
    settle_s: float
    nodes_hz: tuple[float, ...]
    sentences: tuple[str, ...]
    settings: Mapping[str, Scalar] = field(default_factory=dict)


def plan_campaign(bound: BoundCampaign) -> Plan:
    """Settling, windows and sweep points of a campaign.

    Raises:
        BadInput: no way to know how long the FMU takes to settle, or tones that cannot be told
            apart.
    """
    settle, why = _settling(bound)
    held = bound.drive.samples_per_period if bound.drive.kind == "input" else 0
    order = bound.drive.order
    windows = tuple(
        plan_window(
            e.read_hz, settle, samples_per_period=held, beside_hz=mixed_hz(e.tones_hz, order)
        )
        for e in bound.experiments
    )
    sentences = [why]
    sentences += [
        f"Experiment {e.label}: {w.reason}."
        for e, w in zip(bound.experiments, windows, strict=True)
    ]
    nodes: tuple[float, ...] = ()
    if bound.sweep is not None and bound.sweep.scale == "maximum":
        f, a = bound.sweep.frequency_hz, bound.sweep.amplitude_v
        centre = laboratory_maximum(f, a).frequency_hz
        spacing = 0.5 * half_power_width(f, a)
        nodes = tuple(map(float, nodes_around(centre, spacing)))
        sentences.append(
            f"Scale: the simulated maximum is interpolated through {FINE_POINTS} points "
            f"{spacing:.4g} Hz apart around {hertz(centre)} (1/A^2 as a polynomial of "
            f"degree four); more are added where its bias exceeds {bound.accuracy:.1g}."
        )
    return Plan(windows, settle, nodes, tuple(sentences))


def _settling(bound: BoundCampaign) -> tuple[float, str]:
    if bound.steady_start:
        return 0.0, "The FMU is declared to start on its periodic orbit: nothing has to settle."
    width = bound.line_width_hz
    if width is None and bound.sweep is not None:
        width = half_power_width(bound.sweep.frequency_hz, bound.sweep.amplitude_v)
    if width is None:
        raise BadInput(
            f"{bound.path}: [observe] says neither steady_start = true nor a line_width; wanted "
            "one of them, or a sweep, to know how long the FMU takes to settle"
        )
    settle = settling_s(width, 0.1 * bound.accuracy)
    return settle, (
        f"Settling {settle:.6g} s: exp(-pi w t) falls below {0.1 * bound.accuracy:.1g} for half "
        f"the line width of {width:.6g} Hz."
    )
