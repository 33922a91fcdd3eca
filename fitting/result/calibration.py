"""Which values of a result are handed on to other tools, and which are left, with the reason."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields

from fitting.fmu.description import FmuDescription
from fitting.fmu.parameter_set import SetValue
from fitting.result.result import Result
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.estimate import ParameterEstimate, Verdict
from fitting.text.tables import csv_text
from fitting.text.units import convert


@dataclass(frozen=True, kw_only=True)
class Handed(ParameterEstimate):
    """One fitted parameter in the unit of the FMU.

    ``left`` is the reason why it is not handed on; empty: it is.
    """

    left: str = ""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """What a result hands on: ``parameters``, ``settings``, and what the campaign set besides.

    ``settings`` are of the alternative that fits best, ``open_settings`` those of one that others
    equal, which are left. ``campaign_values`` are start
    values of the campaign, with which the parameters were fitted.
    """

    parameters: tuple[Handed, ...]
    campaign_values: Mapping[str, Scalar]
    settings: Mapping[str, Scalar]
    open_settings: Mapping[str, Scalar]

    @property
    def handed(self) -> tuple[Handed, ...]:
        """The parameters that are handed on."""
        return tuple(p for p in self.parameters if not p.left)

    @property
    def start_values(self) -> dict[str, Scalar]:
        """Start values by variable of the FMU, in its units."""
        fitted = {p.name: p.value for p in self.handed}
        return {**self.campaign_values, **self.settings, **fitted}

    def set_values(self) -> list[SetValue]:
        """The same for a parameter set, with errors and verdicts as notes."""
        plain = {**self.campaign_values, **self.settings}
        return [SetValue(name=name, value=value) for name, value in plain.items()] + [
            SetValue(name=p.name, value=p.value, unit=p.unit or None, notes=_notes(p))
            for p in self.handed
        ]


def calibration(result: Result, description: FmuDescription, also: Collection[str]) -> Calibration:
    """What a result hands on to an FMU: by itself only what the data determine.

    Args:
        result: of a reconstruction.
        description: of the FMU.
        also: parameters that are handed on although the data do not determine them.

    Raises:
        BadInput: ``also`` names what was not fitted.
    """
    known = (*result.parameters, *result.alternative)
    for name in also:
        if name not in known:
            raise BadInput(f"also: {name!r} was not fitted, wanted one of {', '.join(known)}")
    parameters = tuple(
        _handed(name, value, description, name in also) for name, value in result.parameters.items()
    )
    if not any(not p.left for p in parameters) and not result.alternative:
        reasons = ", ".join(f"{p.name}: {p.left}" for p in parameters)
        raise BadInput(
            f"the data determine no parameter ({reasons}): nothing to calibrate; "
            "wanted --also NAME, or --all for the best fit as a whole"
        )
    tied = sum(a.equal_to_best for a in result.alternatives) > 1
    form = {n: v for n, v in result.alternative.items() if n in description.variables}
    sure = {name: value for name, value in form.items() if not tied or name in also}
    left = {name: value for name, value in form.items() if name not in sure}
    return Calibration(
        parameters=parameters,
        campaign_values=result.provenance.start_values,
        settings=sure,
        open_settings=left,
    )


def _handed(
    name: str, result: ParameterEstimate, description: FmuDescription, wanted: bool
) -> Handed:
    variable = description.variables.get(name)
    unit = result.unit
    if variable is None:
        left = "is no variable of the FMU"
    elif not variable.can_be_started:
        left = "cannot be set in the FMU"
    else:
        left = "" if wanted or result.status is Verdict.DETERMINED else str(result.status)
        unit = variable.unit or unit
    factor = convert(1.0, result.unit, unit, where=name) if unit != result.unit else 1.0
    there = result.in_unit(unit, factor)
    shared = {each.name: getattr(there, each.name) for each in fields(ParameterEstimate)}
    return Handed(**shared, left=left)


def _notes(p: Handed) -> dict[str, str]:
    numbers = {"std": p.std, "ci95_low": p.ci95[0], "ci95_high": p.ci95[1]}
    return {"verdict": str(p.status)} | {
        name: repr(value) for name, value in numbers.items() if not math.isnan(value)
    }


def calibration_csv(result: Calibration) -> str:
    """All fitted parameters as CSV: value, error, interval, verdict, and whether it is handed on.

    Args:
        result: what is handed on.
    """
    rows = [["name", "unit", "value", "std", "ci95_low", "ci95_high", "verdict", "left"]]
    for p in result.parameters:
        numbers = ("" if math.isnan(v) else repr(v) for v in (p.value, p.std, *p.ci95))
        rows.append([p.name, p.unit, *numbers, p.status, p.left])
    return csv_text(rows)
