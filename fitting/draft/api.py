"""A first campaign from files and an FMU."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from fitting import Fmu
from fitting.draft.decays import (
    DemodulatedFile,
    decaying,
    decays_draft,
    demodulated_draft,
    demodulated_of,
    lines_of_recording,
)
from fitting.draft.document import Draft
from fitting.draft.files import NOISE, MapFile, files_of, settled
from fitting.draft.maps import LIST, map_draft, series_of
from fitting.draft.model import ONE_MODE, TWO_MODES, Offer, offer_of
from fitting.draft.questions import Answers, Ask, Question
from fitting.draft.sweeps import check_one_line, sweeps_draft
from fitting.draft.traces import INPUT, OUTPUT, recordings_of, requested_columns, traces_draft
from fitting.lines.names import TIME_PAGE
from fitting.lines.ringdown import ringdown_of
from fitting.resonance.reading import Columns
from fitting.text.errors import BadInput
from fitting.text.results_folder import results_folder, write_whole

__all__ = ["CAMPAIGN", "KEYS", "Ask", "Question", "init"]

CAMPAIGN = "campaign.toml"
#: What may be told beforehand, by name.
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
#: What is written beside it: of sweeps at values of a control the list of their files.
FILES = (CAMPAIGN, LIST)


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
            "rms"), "kind" ("noise", "sweep"), "interface", "control" of several files, as "Vg" or
            "Vg=-6:6:1".
        ask: Asks a person for further choices; None: defaults are used and reported.

    Returns:
        The path of the campaign; what was recognised, chosen and guessed, in sentences.

    Raises:
        BadInput: files or an FMU that cannot be used, or do not suit each other; a folder that
            holds another campaign.
        FmuFailure: the FMU failed with its own start values.
    """
    path, made = drafted(files, fmu, out=out, columns=columns, told=told, ask=ask)
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
    listed_files = (files,) if isinstance(files, str | os.PathLike) else files
    paths, fmu = measurements_and_fmu([Path(file) for file in listed_files], fmu)
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
    with results_folder(folder, "init", FILES):
        draft = _of_time(paths, columns, answers, fmu, folder)
        draft = draft or _of_frequency(paths, columns, answers, fmu, folder)
        path = folder / CAMPAIGN
        write_whole(path, draft.text)
    return path, draft


def measurements_and_fmu(
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


def _of_time(
    paths: Sequence[Path], columns: Columns, answers: Answers, fmu: str | Path | None, folder: Path
) -> Draft | None:
    """A draft of demodulated ringdowns or of recordings over time; None of other files."""
    demodulated: tuple[DemodulatedFile, ...] = demodulated_of(paths, columns)
    if demodulated and fmu is not None:
        # columns that are called like variables of the FMU are a recording of these
        with Fmu(fmu, 1) as opened:
            known = {name.lower() for name in opened.workers.description.variables}
        names = [name for key, name in demodulated[0].columns.items() if key != "time"]
        if all(name.rpartition("/")[2].lower() in known for name in names):
            demodulated = ()
    recordings = () if demodulated else recordings_of(paths, columns, simulated=fmu is not None)
    if not (demodulated or recordings):
        return None
    for key in columns.selection.parts:
        raise BadInput(
            f"--{key.replace('_', '-')}: a campaign of recordings does not choose it; wanted that "
            f"part of {paths[0]} in a file of its own"
        )
    if fmu is None:  # as many modes as ringdowns show
        shown = [len(decaying(ringdown_of(file.record))) for file in demodulated]
        shown += [len(lines_of_recording(each)) for each in recordings]
        if min(shown) == 0:
            raise BadInput(
                f"{paths[0]}: is a recording over time, and no free decay of one column; "
                f"wanted --fmu, the FMU whose output was recorded: {TIME_PAGE}"
            )
        fmu = ONE_MODE if max(shown) == 1 else TWO_MODES
    with _offer(fmu, answers) as offer:
        if demodulated:
            return demodulated_draft(demodulated, offer, answers, folder)
        recordings = tuple(requested_columns(each, answers.columns, offer) for each in recordings)
        draft = decays_draft(recordings, offer, answers, folder)
        return draft or traces_draft(recordings, offer, answers, folder)


def _of_frequency(
    paths: Sequence[Path], columns: Columns, answers: Answers, fmu: str | Path | None, folder: Path
) -> Draft:
    """A draft of sweeps, spectra, a table of experiments or a map; or of an FMU alone."""
    for key, column in answers.columns.items():
        raise BadInput(
            f"--{key}: found the column '{column}', which a recording over time has; wanted the "
            f"FMU's {key} alone"
        )
    [control] = answers.requested.get("control", (None,))
    if control is not None or NOISE not in answers.requested.get("kind", ()):
        joint = fmu is not None and fmu != TWO_MODES
        series = series_of(paths, columns, control, folder, joint=joint)
        if series is not None:
            with _listed(series, folder), _offer(fmu or TWO_MODES, answers) as offer:
                draft = map_draft(series, offer, answers, folder)
            return replace(draft, notes=(series.words, *draft.notes))
    files = settled(files_of(paths, columns, answers), answers)
    if fmu in (None, ONE_MODE):
        check_one_line(files)
    # as many modes as the files show lines, two for a map
    model = ONE_MODE if files.two is None and files.map is None else TWO_MODES
    with _offer(fmu or model, answers) as offer:
        if files.map is not None:
            return map_draft(files.map, offer, answers, folder)
        return sweeps_draft(files, offer, answers, folder)


@contextmanager
def _listed(series: MapFile, folder: Path) -> Iterator[None]:
    """The list of a map's files beside the campaign; as it was where no campaign comes of it."""
    path = folder / LIST
    before = path.read_bytes() if path.is_file() else None
    write_whole(path, series.listing)
    try:
        yield
    except BaseException:
        if before is None:
            path.unlink(missing_ok=True)
        else:
            write_whole(path, before)  # the folder's record is told of it, too
        raise


@contextmanager
def _offer(fmu: str | Path, answers: Answers) -> Iterator[Offer]:
    """What the FMU offers, with a worker for as long as the context lasts."""
    [interface] = answers.requested.get("interface", (None,))
    with Fmu(fmu, 1, interface=interface) as opened:
        is_model = isinstance(fmu, str) and fmu.isidentifier()
        yield offer_of(str(fmu), opened.workers, interface, is_model=is_model)
