"""A check of an FMU: does it load, validate, run, survive a reset, suit a campaign."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fitting import Fmu
from fitting.check import FILES
from fitting.check.examination import Examination, examine
from fitting.check.findings import Finding, Severity, rule_findings, trial_findings
from fitting.extension.fmu import FmuDescription, opened_fmu, validation_problems
from fitting.extension.records import BoundCampaign, Campaign, bind, read_campaign
from fitting.text.errors import BadInput, FmuFailure
from fitting.text.old_names import renamed
from fitting.text.results_folder import remove_earlier, results_folder


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
    why it does not run; ``suits`` is what the campaign would fit, ``unsuited`` why it does not
    suit; ``warnings`` are what the FMU logged.
    """

    description: FmuDescription
    findings: tuple[Finding, ...]
    examination: Examination
    suits: Suits | None
    unsuited: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def failure(self) -> FmuFailure | None:
        """Why it does not run."""
        return self.examination.failure

    @property
    def sound(self) -> bool:
        """Whether it runs and suits, and whatever rules it breaks are cosmetic."""
        cosmetic = all(f.severity is Severity.COSMETIC for f in self.findings)
        return cosmetic and not self.unsuited


def check(
    fmu: Fmu | str | Path,
    campaign: str | Path | Campaign | None = None,
    *,
    step_s: float | None = None,
    budget_s: float = 60.0,
    show: Callable[[str], None] = lambda _what: None,
) -> Check:
    """Examine an FMU: errors are reported, not raised.

    Args:
        fmu: The FMU, its path, or a model of this project.
        campaign: A campaign for it, whose start values are used.
        step_s: Trial step, s, above zero; None: the FMU's, four of its solver's fixed steps, else
            by its response, else 1 ms.
        budget_s: Time that all probes may take when it runs, s, above zero; what has none left is
            listed.
        show: Is called with what is tried.

    Returns:
        ``sound``; ``findings`` by severity, ``failure`` and ``unsuited``; what was tried and
        measured in ``examination``.

    Raises:
        BadInput: no FMU that this machine can run, a campaign that cannot be read, no time.
    """
    for name, time_s in {"step_s": step_s, "budget_s": budget_s}.items():
        if time_s is not None and not time_s > 0.0:
            raise BadInput(f"{name}: found {time_s!r}, wanted a positive time")
    opened = opened_fmu(fmu)  # its processes live as long as it does
    workers = opened.workers
    if campaign is not None and not isinstance(campaign, Campaign):
        campaign = read_campaign(campaign)
    description = workers.description
    bound: BoundCampaign | None = None
    unsuited: tuple[str, ...] = ()
    if campaign is not None:
        try:
            bound = bind(campaign, description.variables)
        except BadInput as error:
            unsuited = tuple(map(str, error.args))
    values = bound.setup.start_values if bound else {}
    examination = examine(workers, step_s, values, budget_s=budget_s, show=show)
    findings = (
        *trial_findings(description, examination),
        *rule_findings(validation_problems(description.path)),
    )
    suits = None
    if bound is not None:
        suits = Suits(
            campaign=bound.path,
            parameters=len(bound.parameters),
            experiments=len(bound.experiments),
            output=bound.setup.output,
        )
    return Check(
        description=description,
        findings=tuple(sorted(findings, key=lambda f: f.severity.rank)),
        examination=examination,
        suits=suits,
        unsuited=unsuited,
        warnings=workers.warnings,
    )


@renamed
def write_check(result: Check, out: str | Path) -> Path:
    """Write what was found as a page, report.html with its figure.

    Args:
        result: What `check` returned.
        out: Folder, made where there is none.

    Returns:
        The path of the page.

    Raises:
        BadInput: the folder cannot be written, or holds files of these names that are not ours.
    """
    # matplotlib takes a second to import: only where something is drawn
    report = importlib.import_module("fitting.check.report")
    with results_folder(Path(out), "check", FILES):
        page: Path = report.write_report(result, Path(out))
        remove_earlier(Path(out), FILES)
    return page
