"""A first campaign from files and an FMU."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from fitting.api.fmu import Fmu
from fitting.draft.demodulated import DemodulatedFile, demodulated_of
from fitting.draft.draft import (
    draft_of,
    model_for,
    model_for_recordings,
    trace_draft_of,
)
from fitting.draft.files import files_of, settled
from fitting.draft.questions import Answers, Ask, Question
from fitting.draft.source import Source
from fitting.draft.traces import recordings_of
from fitting.resonance.reading import TIME_PAGE, Columns
from fitting.text.errors import BadInput
from fitting.text.files import write_whole
from fitting.text.results_folder import results_folder

__all__ = ["CAMPAIGN", "KEYS", "Ask", "Question", "init"]

CAMPAIGN = "campaign.toml"
#: What may be told beforehand, by name.
KEYS = ("output", "tone", "input", "fit", "amplitudes", "kind", "demodulated-at", "interface")


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

    Of an FMU alone it is a skeleton, at whose end stands what is missing.

    Args:
        files: Sweeps of any instrument, amplitudes or with phases; or a table of experiments, with
            peaks or a spectrum each, and a sweep; or a map, spectra over a control quantity in one
            table, for an FMU of two coupled modes; or recordings over time, of an output and
            perhaps an input, for an FMU that is named, or ringdowns. One of them may be the FMU
            (.fmu).
        fmu: Path of an FMU, or the name of a model of this project; None: one mode, or two
            where a sweep shows two lines, and for a map.
        out: Folder for campaign.toml, made where there is none.
        columns: What the files do not tell of their columns.
        told: What is chosen beforehand: "output", "tone", "input", "fit" (several), "amplitudes"
            ("peak" or "rms"), "kind" ("noise" or "sweep", of a spectrum of amplitudes), "interface"
            ("co-simulation" or "model-exchange").
        ask: Asks a person what nobody told; None: the default is taken, and said.

    Returns:
        The path of the campaign, and what was found, taken and guessed, in sentences.

    Raises:
        BadInput: files or an FMU that cannot be used, or do not suit each other; a folder that
            holds another campaign.
        FmuFailure: the FMU failed with its own start values.
    """
    made = drafted(files, fmu, out=out, columns=columns, told=told, ask=ask)
    return made.path, (*made.said, *((made.undescribed,) if made.undescribed else ()))


@dataclass(frozen=True)
class Drafted:
    """A campaign that was written; what was found, and what its FMU does not describe, or empty."""

    path: Path
    said: tuple[str, ...]
    undescribed: str


def drafted(
    files: str | Path | Sequence[str | Path],
    fmu: str | Path | None = None,
    *,
    out: str | Path = ".",
    columns: Columns | None = None,
    told: Mapping[str, str | Sequence[str]] | None = None,
    ask: Ask | None = None,
) -> Drafted:
    """The same as `init`, with what the campaign does not describe by itself.

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
    paths, fmu = told_apart(
        [Path(f) for f in ((files,) if isinstance(files, str | os.PathLike) else files)], fmu
    )
    answers = Answers({k: _names(v) for k, v in (told or {}).items()}, ask)
    unknown = [key for key in answers.told if key not in KEYS]
    if unknown:
        raise BadInput(f"init: found {unknown[0]!r} told, wanted any of {', '.join(KEYS)}")
    [interface] = answers.told.get("interface", (None,))
    with results_folder(Path(out), "init", (CAMPAIGN,)):
        demodulated = _demodulated(paths, columns or Columns(), fmu)
        recordings = demodulated or recordings_of(paths)
        if recordings:
            recorded = fmu or model_for_recordings(recordings)
            if recorded is None:
                raise BadInput(
                    f"{paths[0]}: is a recording over time, and no free decay of one column; "
                    f"wanted --fmu, the FMU whose output was recorded: {TIME_PAGE}"
                )
            with _source(recorded, interface) as source:
                draft = trace_draft_of(recordings, source, answers, Path(out))
        else:
            looked_at = settled(files_of(paths, columns or Columns(), answers), answers)
            with _source(fmu or model_for(looked_at), interface) as source:
                draft = draft_of(looked_at, source, answers, Path(out))
        path = Path(out) / CAMPAIGN
        write_whole(path, draft.text)
    return Drafted(path, draft.said, draft.undescribed)


def told_apart(
    files: Sequence[Path], fmu: str | Path | None
) -> tuple[list[Path], str | Path | None]:
    """Files of measurements, and the FMU, which may stand among them.

    Args:
        files: measurements, and perhaps an FMU.
        fmu: the FMU where it is told by itself.

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


def _demodulated(
    paths: Sequence[Path], columns: Columns, fmu: str | Path | None
) -> tuple[DemodulatedFile, ...]:
    """The files as demodulated ringdowns; none of an FMU that has variables of their names."""
    files = demodulated_of(paths, columns)
    if not files or fmu is None:
        return files
    with Fmu(fmu, 1) as held:
        known = {name.lower() for name in held.workers.description.variables}
    seen = [name for key, name in files[0].columns.items() if key != "time"]
    return () if all(name.lower() in known for name in seen) else files


@contextmanager
def _source(fmu: str | Path, interface: str | None) -> Iterator[Source]:
    """The FMU, with a worker for as long as the context lasts."""
    with Fmu(fmu, 1, interface=interface) as held:
        is_model = isinstance(fmu, str) and fmu.isidentifier()
        yield Source(str(fmu), is_model, held.workers, interface)


def _names(value: str | Sequence[str]) -> tuple[str, ...]:
    return (value,) if isinstance(value, str) else tuple(value)
