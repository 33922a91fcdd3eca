"""What a design is for: the value to be known, how it is judged, the fit that it sets out from."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitting.design.weighing import DesignGoal
from fitting.extension.problem import Result
from fitting.extension.records import BoundCampaign, WrittenDesign
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.choices import CRITERIA
from fitting.text.errors import BadInput


def goal_of(
    bound: BoundCampaign, table: WrittenDesign, target: str = "", criterion: str = ""
) -> DesignGoal:
    """Target and criterion: what is said, else what the campaign says, else the first value.

    Args:
        bound: the campaign that is to be continued.
        table: its table [design].
        target: a parameter or derived output; empty: not said.
        criterion: one of `CRITERIA`; empty: not said.
    """
    names = [*bound.derived, *(parameter.name for parameter in bound.parameters)]
    return DesignGoal(
        target=target or table.target or names[0],
        criterion=criterion or table.criterion or CRITERIA[0],
    )


def start_of(
    result: Result, bound: BoundCampaign, where: str
) -> tuple[Mapping[str, Scalar], FloatArray]:
    """Alternative and parameters (n,) of a result, which must be of this campaign's parameters.

    Args:
        result: of a fit.
        bound: the campaign that is to be continued.
        where: what the result is called in complaints.

    Raises:
        BadInput: the result is of another campaign.
    """
    values = {name: p.value for name, p in result.parameters.items()}
    p = []
    for parameter in bound.parameters:
        if parameter.name not in values and not parameter.experiments:
            raise BadInput(
                f"{where}: has no parameter '{parameter.name}'; wanted a result of {bound.path}"
            )
        p.append(values.get(parameter.name, parameter.reference))
    for alternative in bound.alternatives:
        if dict(alternative) == dict(result.alternative):
            return alternative, np.array(p)
    raise BadInput(
        f"{where}: alternative {dict(result.alternative)} is none of those of {bound.path}; wanted "
        "a result of that campaign"
    )


def variable_of(bound: BoundCampaign, target: str) -> str:
    """The FMU variable that a target is, for its unit.

    Args:
        bound: the campaign.
        target: a parameter or derived output.
    """
    for parameter in bound.parameters:
        if parameter.name == target and not parameter.adds_to:
            return parameter.target
    return target
