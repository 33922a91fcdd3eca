"""What a check of an FMU prints, its page with the figure, its document for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fitting.check.api import Check
from fitting.check.findings import MOST_LISTED, Severity
from fitting.check.runs import ROUNDING
from fitting.check.steps import SHIFT
from fitting.extension.fmu import FmuDescription, FmuVariable
from fitting.extension.report import lines_of, phrase, phrases, printed_lines, table, write_page
from fitting.text.errors import spelled_out

#: Kinds of variables of an FMU that are listed, as far as they are no observed ones.
SHOWN = ("parameter", "input", "output", "calculatedParameter")
#: What the document has of each variable; what a record has for the figure alone.
VARIABLE = (
    "causality",
    "variability",
    "kind",
    "unit",
    "start",
    "min",
    "max",
    "items",
    "description",
)
DRAWN = ("outputs", "times_s", "differences")
#: What sentences on an FMU need besides its record.
CHECKED = {"rounding": ROUNDING, "shift": SHIFT, "most": MOST_LISTED}


def screen_lines(checked: Check, *, verbose: bool = False, report: Path | None = None) -> list[str]:
    """What `fmu-fit check` prints.

    Args:
        checked: of the FMU.
        verbose: whether all that was tried is printed, with a row for each variable.
        report: the page, if one was written.
    """
    careful = [f for f in checked.findings if f.severity is Severity.CAREFUL]
    urgent = [phrase("check/text", "described", f) for f in careful]
    urgent += [f"the FMU reports: {warning}" for warning in checked.warnings]
    numbers = {**CHECKED, "urgent": urgent}
    listed = table("check/variables", variables=variables_of(checked.description), meaning=False)
    variables = lines_of(listed) if verbose else ""
    lines = printed_lines("check/text", "screen", checked, numbers, verbose, variables, report)
    return [spelled_out(line) for line in lines]


def variables_of(description: FmuDescription) -> list[FmuVariable]:
    """Parameters, inputs and outputs, and what else is observed.

    Args:
        description: of the FMU.
    """
    observed = {v.name for v in description.observable}
    every = description.variables.values()
    return [v for v in every if v.causality in SHOWN or v.name in observed]


def document(checked: Check) -> dict[str, Any]:
    """What was found of an FMU, as plain data.

    Args:
        checked: of the FMU.
    """
    d, repeats = checked.description, checked.examination.repeats
    return {
        "fmu": str(d.path),
        "model_name": d.model_name,
        "fmi_version": d.fmi_version,
        "guid": d.guid,
        "sha256": d.sha256,
        "platforms": d.platforms,
        "variables": {
            v.name: {name: getattr(v, name) for name in VARIABLE} for v in d.variables.values()
        },
        "sound": checked.sound,
        "findings": checked.findings,
        "trial": checked.examination.trial,
        "resets": checked.examination.resets,
        "repeats": repeats and {k: v for k, v in vars(repeats).items() if k not in DRAWN},
        "effects": checked.examination.effects,
        "costs": checked.examination.costs,
        "refused": checked.examination.refused,
        "failed": checked.examination.failed,
        "skipped": checked.examination.skipped,
        "failure": None if checked.failure is None else str(checked.failure),
        "suits": checked.suits and {**vars(checked.suits), "campaign": str(checked.suits.campaign)},
        "unsuited": checked.unsuited,
        "warnings": checked.warnings,
    }


def write_report(checked: Check, out_dir: Path) -> Path:
    """Draw the figure (`out_dir`/figures), write `report.html` and return its path.

    Args:
        checked: of the FMU.
        out_dir: where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    # matplotlib takes a second to import: only where something is drawn
    from fitting.check.figure import draw_repeats
    from fitting.extension.drawing import save, style

    d, examination = checked.description, checked.examination
    figures = []
    with style():
        repeats = examination.repeats
        drawing = None if repeats is None else draw_repeats(repeats, d.model_name)
        if drawing is not None:
            figures.append(save(drawing, out_dir / "figures", for_page=True))
    costs = "" if examination.costs is None else phrase("check/text", "costs", examination.costs)
    status, message, mark = _status(checked)
    return write_page(
        out_dir,
        "check/page.html.j2",
        title=d.model_name,
        kind="check of an FMU",
        status=status,
        message=message,
        mark=mark,
        warnings=checked.warnings,
        figures=figures,
        cost=costs,
        findings=[phrase("check/text", "finding", f) for f in checked.findings],
        tried=[
            *(() if checked.suits is None else (phrase("check/text", "suits", checked.suits),)),
            *checked.unsuited,
            *phrases("check/text", "examination", checked, {**CHECKED, "most": None}),
        ],
        variables=variables_of(d),
        origin={
            "file": str(d.path),
            "FMI": d.fmi_version,
            "platforms": ", ".join(d.platforms),
            "guid": d.guid,
            "sha256": d.sha256,
            "made by": phrase("check/text", "tool", d),
            "further": "; ".join(phrases("check/text", "further", d)) or "nothing",
        },
    )


def _status(checked: Check) -> tuple[str, str, str]:
    if checked.failure is not None:
        return "Fails", str(checked.failure), "bad"
    if checked.unsuited:
        return "Runs, does not suit", checked.unsuited[0], "bad"
    careful = sum(f.count for f in checked.findings if f.severity is Severity.CAREFUL)
    if careful:
        return "Runs", f"Warnings: {careful}.", "doubt"
    return "Sound", "It runs, repeats, and violates no rule that matters.", ""
