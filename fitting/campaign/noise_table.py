"""The campaign's [noise]: what the user knows of the scatter of amplitudes, as written."""

from __future__ import annotations

from dataclasses import dataclass

from fitting.campaign.section import Section, Written, as_written
from fitting.text.errors import BadInput

OUTLIERS = ("keep", "huber")


@dataclass(frozen=True)
class NoiseChoice:
    """Declared noise: ``relative`` (a share of the amplitude), ``absolute`` as written.

    Both are standard deviations and add in quadrature to what the data tell of themselves.
    ``outliers`` "keep" or "huber"; rows beyond ``threshold`` standard deviations are named.
    """

    relative: float = 0.0
    absolute: Written | None = None
    outliers: str = "keep"
    threshold: float = 4.0


def noise_choice(top: Section) -> NoiseChoice:
    """Read and check the table [noise]; nothing declared if there is none.

    Raises:
        BadInput: an unknown key, or a share that is negative or has a unit other than %.
    """
    section = top.sub("noise", ("relative", "absolute", "outliers", "threshold"))
    return NoiseChoice(
        relative=_share(section, "relative") if "relative" in section else 0.0,
        absolute=section.written("absolute") if "absolute" in section else None,
        outliers=section.choice("outliers", OUTLIERS, "keep"),
        threshold=section.number("threshold", 4.0, positive=True),
    )


def _share(section: Section, key: str) -> float:
    """A share as 0.01 or "1 %"."""
    value, where = section.required(key), section.where(key)
    if isinstance(value, str) and value.strip().endswith("%"):
        try:
            value = 0.01 * float(value.strip()[:-1])
        except ValueError:
            value = section.data[key]
    written = as_written(value, where).value
    if isinstance(written, bool | str) or not 0.0 <= written < 1.0:
        raise BadInput(f'{where}: found {section.data[key]!r}, wanted a share as "1 %" or 0.01')
    return float(written)
