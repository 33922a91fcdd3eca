"""What a doctor finds of an FMU: does it load, validate, run, survive a reset, suit a campaign."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fitting.campaign.binding import bind
from fitting.campaign.bound import BoundCampaign
from fitting.campaign.data import Campaign
from fitting.fmu import FmuDescription, FmuWorkers, validation_problems
from fitting.fmu.findings import Finding, Severity, rule_findings
from fitting.fmu.trial.examination import Examination, examine
from fitting.fmu.trial.findings import trial_findings
from fitting.fmu.trial.runs import trial_step_s
from fitting.text.errors import BadInput, FmuFailure


@dataclass(frozen=True, kw_only=True)
class Suits:
    """What a campaign would do with an FMU that it suits: how much there is to fit, from what."""

    campaign: Path
    parameters: int
    experiments: int
    output: str


@dataclass(frozen=True, kw_only=True)
class Check:
    """What was found of an FMU; ``sound`` sums it up.

    ``findings`` are rules of FMI that it breaks, and what it does that a fit or another tool may
    not expect, by severity; ``examination`` is what came of everything that was tried, ``failure``
    what ended that, if anything did; ``suits`` says that it suits the campaign, ``unsuited`` why it
    does not; ``warnings`` are what the FMU logged.
    """

    description: FmuDescription
    findings: tuple[Finding, ...]
    examination: Examination
    suits: Suits | None
    unsuited: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def failure(self) -> FmuFailure | None:
        """What ended the examination."""
        return self.examination.failure

    @property
    def sound(self) -> bool:
        """Whether it runs and suits, and whatever rules it breaks are cosmetic."""
        cosmetic = all(f.severity is Severity.COSMETIC for f in self.findings)
        return cosmetic and not self.unsuited


def check_fmu(workers: FmuWorkers, campaign: Campaign | None, step_s: float | None) -> Check:
    """Look at an FMU: what is wrong with it is told, not raised.

    Args:
        workers: processes that run the FMU.
        campaign: a campaign that it may suit; its start values hold for the trial run.
        step_s: length of the trial step, s; None: one that suits the FMU.

    Raises:
        BadInput: it has neither an output nor a local variable that is a number.
    """
    description = workers.description
    bound: BoundCampaign | None = None
    unsuited: tuple[str, ...] = ()
    if campaign is not None:
        try:
            bound = bind(campaign, description.variables)
        except BadInput as error:
            unsuited = tuple(map(str, error.args))
    values = bound.setup.start_values if bound else {}
    step_s = trial_step_s(description) if step_s is None else step_s
    found = examine(workers, step_s, values)
    findings = (
        *trial_findings(description, found),
        *rule_findings(validation_problems(description.path)),
    )
    return Check(
        description=description,
        findings=tuple(sorted(findings, key=lambda f: f.severity.rank)),
        examination=found,
        suits=None if bound is None else _suits(bound),
        unsuited=unsuited,
        warnings=workers.warnings,
    )


def _suits(bound: BoundCampaign) -> Suits:
    return Suits(
        campaign=bound.path,
        parameters=len(bound.parameters),
        experiments=len(bound.experiments),
        output=bound.setup.output,
    )
