"""A first campaign from files and an FMU."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from fitting.draft.document import LIST, Answers, Ask, Draft, Question
from fitting.draft.maps import map_draft, map_of_files
from fitting.draft.model import TWO_MODES, opened_offer
from fitting.draft.records import INPUT, OUTPUT, records_draft
from fitting.draft.sweeps import NOISE, sweeps_draft, table_of, with_units
from fitting.resonance.reading import Columns
from fitting.text.errors import BadInput, gathered
from fitting.text.notation import listed
from fitting.text.rendering import blocks
from fitting.text.results_folder import results_folder, write_whole

__all__ = ["CAMPAIGN", "KEYS", "Ask", "Question", "init"]

CAMPAIGN = "campaign.toml"
#: What may be stated beforehand, by name.
KEYS = (
    "output",
    "tone",
    "input",
    "fit",
    "amplitudes",
    "kind",
    "demodulated-at",
    "interface",
    "control",
)


def init(
    files: str | Path | Sequence[str | Path],
    fmu: str | Path | None = None,
    *,
    out: str | Path = ".",
    columns: Columns | None = None,
    told: Mapping[str, str | Sequence[str]] | None = None,
    ask: Ask | None = None,
) -> tuple[Path, tuple[str, ...]]:
    """Write a first campaign.toml that runs as it is, from files of measurements and an FMU.

    Of an FMU alone it is a skeleton, which ends with what is missing.

    Args:
        files: Sweeps; a table of experiments with peaks or spectra, and a sweep; a map of spectra
            over a control; ringdowns; or, with ``fmu``, recordings over time. One may be the FMU
            (.fmu).
        fmu: Its path, or a model of this project; None: one mode, or two for two lines and for a
            map.
        out: Folder for campaign.toml, made where there is none.
        columns: Of the files, what they do not state.
        told: Choices by name: "output", "tone", "input", "fit" (several), "amplitudes" ("peak",
            "rms"), "kind" ("noise", "sweep"), "interface", "control" of a map with several, as
            "Vg", or of several files, as "Vg" or "Vg=-6:6:1".
        ask: Asks a person for further choices; None: defaults are used and reported.

    Returns:
        The path of the campaign; what was recognised, chosen and guessed, in sentences.

    Raises:
        BadInput: files or an FMU that cannot be used, or do not suit each other; a folder that
            holds another campaign.
        FmuFailure: the FMU failed with its own start values, or where the campaign starts, which is
            written all the same.
    """
    path, made = drafted(files, fmu, out=out, columns=columns, told=told, ask=ask)
    if made.failure is not None:
        raise made.failure
    return path, (*made.notes, *((made.undescribed,) if made.undescribed else ()))


def drafted(
    files: str | Path | Sequence[str | Path],
    fmu: str | Path | None = None,
    *,
    out: str | Path = ".",
    columns: Columns | None = None,
    told: Mapping[str, str | Sequence[str]] | None = None,
    ask: Ask | None = None,
) -> tuple[Path, Draft]:
    """The same as `init`: the path of the campaign and the draft, with what that cannot describe.

    Args:
        files: see `init`.
        fmu: see `init`.
        out: see `init`.
        columns: see `init`.
        told: see `init`.
        ask: see `init`.

    Raises:
        BadInput: see `init`.
        FmuFailure: see `init`.
    """
    several = (files,) if isinstance(files, str | os.PathLike) else files
    paths, fmu = measurements_and_fmu([Path(file) for file in several], fmu)
    named = {k: (v,) if isinstance(v, str) else tuple(v) for k, v in (told or {}).items()}
    for key in named:
        if key not in KEYS:
            raise BadInput(f"init: found key {key!r}, wanted any of {', '.join(KEYS)}")
    answers = Answers(named, ask)
    for key in (OUTPUT, INPUT):
        # a column of a recording before the variable that it holds, as "u=F"
        for name in named.get(key, ())[:1]:
            column, equals, variable = name.rpartition("=")
            if equals:
                named[key], answers.columns[key] = (variable.strip(),), column.strip()
    columns, folder = columns or Columns(), Path(out)
    with results_folder(folder, "init", (CAMPAIGN, LIST)):
        draft = records_draft(paths, columns, answers, fmu, folder) if paths else None
        draft = draft or _of_frequency(paths, columns, answers, fmu, folder)
        if draft.listing:
            write_whole(folder / LIST, draft.listing)
        path = folder / CAMPAIGN
        if path.exists() and path.read_text("utf-8") != draft.text:
            words = str(blocks("draft/text").replaced(path))
            draft = replace(draft, notes=(*draft.notes, words))
        write_whole(path, draft.text)
    return path, draft


def measurements_and_fmu(
    files: Sequence[Path], fmu: str | Path | None
) -> tuple[list[Path], str | Path | None]:
    """Files of measurements, and the FMU, which may stand among them.

    Args:
        files: measurements, and perhaps an FMU.
        fmu: the FMU where it is named by itself.

    Raises:
        BadInput: two FMUs, or neither an FMU nor a file of measurements.
    """
    fmus = [path for path in files if path.suffix.lower() == ".fmu"]
    if len(fmus) + (fmu is not None) > 1:
        raise BadInput(f"init: found {len(fmus) + (fmu is not None)} FMUs, wanted one")
    measured = [path for path in files if path not in fmus]
    if fmus:
        return measured, str(fmus[0])
    if not measured and fmu is None:
        raise BadInput("init: found neither an FMU nor a file, wanted one of them at least")
    return measured, fmu


def _of_frequency(
    paths: Sequence[Path], columns: Columns, answers: Answers, fmu: str | Path | None, folder: Path
) -> Draft:
    """A draft of sweeps, spectra, a table of experiments or a map; or of an FMU alone."""
    for key, column in answers.columns.items():
        raise BadInput(
            f"--{key}: found the column '{column}', which a recording over time has; wanted the "
            f"FMU's {key} alone"
        )
    tables = [table for table in map(table_of, paths) if table is not None]
    if len(tables) > 1:
        names = listed(str(table.path) for table in tables)
        raise BadInput(f"{names}: are tables of experiments, wanted one in a campaign")
    others = [path for path in paths if path not in [table.path for table in tables]]
    units = gathered([partial(with_units, path, columns, answers) for path in others])
    given = list(zip(others, units, strict=True))
    control = answers.one("control")
    if not tables and (control is not None or NOISE not in answers.requested.get("kind", ())):
        joint = fmu is not None and fmu != TWO_MODES
        file = map_of_files(given, answers, folder, joint=joint)
        if file is not None:
            with opened_offer(fmu or TWO_MODES, answers.one("interface")) as offer:
                return map_draft(file, offer, answers, folder)
    return sweeps_draft(given, tables[0] if tables else None, answers, fmu, folder)
