"""Which values of a result are handed on to other tools, and which are left, with the reason."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from fitting.fmu.description import FmuDescription
from fitting.fmu.parameter_set import SetValue
from fitting.result.result import Result
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.estimate import ParameterEstimate, Verdict
from fitting.text.tables import csv_text
from fitting.text.units import convert


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """What a result hands on: ``parameters``, ``settings``, and what the campaign set besides.

    ``parameters`` are all that were fitted, in the units of the FMU; ``left`` are the reasons why
    some of them are not handed on, by name. ``settings`` are of the alternative that fits best,
    ``open_settings`` those of one that others equal, which are left. ``campaign_values`` are start
    values of the campaign, with which the parameters were fitted, and frequencies of a drive.
    """

    parameters: tuple[ParameterEstimate, ...]
    left: Mapping[str, str]
    campaign_values: Mapping[str, Scalar]
    settings: Mapping[str, Scalar]
    open_settings: Mapping[str, Scalar]

    @property
    def handed(self) -> tuple[ParameterEstimate, ...]:
        """The parameters that are handed on."""
        return tuple(p for p in self.parameters if p.name not in self.left)

    @property
    def start_values(self) -> dict[str, Scalar]:
        """Start values by variable of the FMU, in its units."""
        fitted = {p.name: p.value for p in self.handed}
        return {**self.campaign_values, **self.settings, **fitted}

    def set_values(self, description: FmuDescription) -> list[SetValue]:
        """The same for a parameter set, with errors and verdicts as notes.

        Args:
            description: of the FMU, in whose units they are.
        """
        plain, variables = {**self.campaign_values, **self.settings}, description.variables
        return [
            SetValue(name=name, value=value, unit=variables[name].unit)
            for name, value in plain.items()
        ] + [
            SetValue(name=p.name, value=p.value, unit=p.unit or None, notes=_notes(p))
            for p in self.handed
        ]


def calibration(
    result: Result,
    description: FmuDescription,
    also: Collection[str],
    tones: Sequence[str] = (),
) -> Calibration:
    """What a result hands on to an FMU: by itself only what the data determine.

    A value without a profile is one: its error comes from the covariance.

    Args:
        result: of a reconstruction.
        description: of the FMU.
        also: parameters that are handed on although the data do not determine them.
        tones: variables of the FMU that hold the frequencies of its drive, which go along: those of
            the highest peak, or of the top of the sweep. The FMU's own may be far from the line.

    Raises:
        BadInput: ``also`` names what was not fitted.
    """
    known = (*result.parameters, *result.alternative)
    for name in also:
        if name not in known:
            raise BadInput(f"also: {name!r} was not fitted, wanted one of {', '.join(known)}")
    parameters, left = [], dict[str, str]()
    for name, fitted in result.parameters.items():
        variable, unit = description.variables.get(name), fitted.unit
        if variable is None:
            left[name] = "is no variable of the FMU"
        elif not variable.can_be_started:
            left[name] = "cannot be set in the FMU"
        else:
            unit = variable.unit or unit
            is_sure = fitted.status in (Verdict.DETERMINED, Verdict.LINEARISED)
            if name not in also and not is_sure:
                left[name] = str(fitted.status)
        factor = convert(1.0, fitted.unit, unit, where=name) if unit != fitted.unit else 1.0
        parameters.append(fitted.in_unit(unit, factor))
    if len(left) == len(parameters) and not result.alternative:
        reasons = ", ".join(f"{name}: {reason}" for name, reason in left.items())
        raise BadInput(
            f"the data determine no parameter ({reasons}): nothing to calibrate; "
            "wanted --also NAME, or --all for the best fit as a whole"
        )
    tied = sum(a.equal_to_best for a in result.alternatives) > 1
    form = {n: v for n, v in result.alternative.items() if n in description.variables}
    sure = {name: value for name, value in form.items() if not tied or name in also}
    return Calibration(
        parameters=tuple(parameters),
        left=left,
        campaign_values={**result.provenance.start_values, **_driven(result, description, tones)},
        settings=sure,
        open_settings={name: value for name, value in form.items() if name not in sure},
    )


def _driven(result: Result, description: FmuDescription, tones: Sequence[str]) -> dict[str, Scalar]:
    """Frequencies of the drive at the highest peak, else at the top of the sweep, by variable."""
    known = [name for name in tones if name in description.variables]
    frequencies: list[float] = []
    if result.peaks:
        top = max(result.peaks, key=lambda peak: peak.measured_v).experiment
        frequencies = [peak.frequency_hz for peak in result.peaks if peak.experiment == top]
    elif result.sweep is not None:
        f_hz, measured_v = result.sweep.frequency_hz, result.sweep.measured_v
        frequencies = [max(zip(measured_v, f_hz, strict=True))[1]]
    units = [description.variables[name].unit or "Hz" for name in known]
    return {
        name: convert(f, "Hz", unit, where=name) if unit != "Hz" else f
        for name, unit, f in zip(known, units, frequencies, strict=False)
    }


def _notes(p: ParameterEstimate) -> dict[str, str]:
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
        rows.append([p.name, p.unit, *numbers, p.status, result.left.get(p.name, "")])
    return csv_text(rows)
