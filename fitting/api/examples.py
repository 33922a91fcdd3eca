"""The campaigns that are shipped, to be read where they are or copied; models built ahead."""

from __future__ import annotations

from pathlib import Path

from fitting.fmu.models import built_ahead as built_ahead
from fitting.text.errors import BadInput
from fitting.text.files import shipped
from fitting.text.results_folder import write_all
from fitting.text.toml import read_toml

CAMPAIGN = "campaign.toml"


def example(name: str = "string_q1", out: str | Path | None = None) -> Path:
    """Path of the campaign.toml of a shipped example.

    Args:
        name: Of `fmu-fit example`'s list.
        out: New or empty folder for a copy of all files; None: no copy.

    Raises:
        BadInput: there is none of that name, or the folder holds something already.
    """
    known = _folders()
    if name not in known:
        raise BadInput(f"example: found {name!r}, wanted one of {', '.join(known)}")
    source = known[name]
    if out is None:
        return source / CAMPAIGN
    out = Path(out)
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise BadInput(f"{out}: is there already, wanted a new or an empty folder")
    files = sorted(path for path in source.rglob("*") if path.is_file())
    write_all(out, {path.relative_to(source).as_posix(): path.read_bytes() for path in files})
    return out / CAMPAIGN


def example_titles() -> dict[str, str]:
    """The titles of all shipped campaigns, by name."""
    return {
        name: str(read_toml(folder / CAMPAIGN).get("title", ""))
        for name, folder in _folders().items()
    }


def _folders() -> dict[str, Path]:
    result = sorted(shipped("data").glob(f"*/{CAMPAIGN}"))
    return {path.parent.name: path.parent for path in result}
