"""The campaign's [drift]: how variables move over the experiments, as written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fitting.campaign.section import Section, Written
from fitting.text.errors import BadInput

MODELS = ("linear", "offsets", "walk")
SETTINGS = ("model", "prior", "time", "share", "before_time", "after_time")


@dataclass(frozen=True)
class DriftChoice:
    """How variables move over the experiments.

    ``ends`` maps a variable to its values before and after the series. ``model`` "linear":
    interpolated between them; "offsets": and one fitted offset per experiment, ``prior`` its
    standard deviation; "walk": and a random walk, ``prior`` the standard deviation of a step.
    ``share``: one offset for all variables. ``time`` names the column of time stamps, ``span`` the
    stamps of before and after (None: first and last experiment).
    """

    ends: Mapping[str, tuple[Written, Written]]
    model: str = "linear"
    prior: Written | None = None
    time: str = ""
    share: bool = True
    span: tuple[Written | None, Written | None] = (None, None)
    where: str = ""


def drift_choice(top: Section) -> DriftChoice:
    """Read and check the table [drift]; empty if there is none.

    Raises:
        BadInput: an unknown key, a prior that is missing or has no meaning.
    """
    section = top.sub("drift")
    ends = {}
    for name, value in section.data.items():
        if isinstance(value, Mapping) or name not in SETTINGS:
            both = section.sub(name, ("before", "after"))
            ends[name] = (both.written("before"), both.written("after"))
    settings = {k: v for k, v in section.data.items() if k not in ends}
    chosen = Section(top.path, "drift", settings, SETTINGS)
    model = chosen.choice("model", MODELS, "linear")
    _check(chosen, model, bool(ends))
    return DriftChoice(
        ends=ends,
        model=model,
        prior=chosen.written("prior") if "prior" in chosen else None,
        time=chosen.text("time") if "time" in chosen else "",
        share=chosen.boolean("share", True),
        span=(
            chosen.written("before_time") if "before_time" in chosen else None,
            chosen.written("after_time") if "after_time" in chosen else None,
        ),
        where=section.where(),
    )


def _check(section: Section, model: str, drifts: bool) -> None:
    if section.data and not drifts:
        raise BadInput(
            f"{section.where()}: names no variable; wanted at least one that drifts, as in "
            'eta = { before = "6.94021 MHz", after = "6.94031 MHz" }'
        )
    if model == "linear":
        for key in ("prior", "share"):
            if key in section:
                raise BadInput(f'{section.where(key)}: has no meaning with model = "linear"')
    elif "prior" not in section:
        what = "of an offset" if model == "offsets" else "of a step of the walk"
        raise BadInput(
            f'{section.where("prior")}: is missing; model = "{model}" wants the standard '
            f'deviation {what}, as in prior = "30 Hz"'
        )
    for key in ("before_time", "after_time"):
        if key in section and "time" not in section:
            raise BadInput(f"{section.where(key)}: wanted only beside time = a column")
