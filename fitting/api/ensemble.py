"""Many independent fits: virtual laboratories or campaigns, on processes or on a cluster."""

from __future__ import annotations

import hashlib
import importlib
import json
import os
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import fitting
from fitting.api.choices import CURVES
from fitting.api.ensemble_item import EnsembleOptions, Item, Kept, Laboratory, kept_digests, solved
from fitting.api.fitted import known_values, require_values
from fitting.api.fmu import Fmu
from fitting.api.problem import Problem
from fitting.api.written import ENSEMBLE_FILES, ITEMS_FILE
from fitting.campaign import WrittenFmu
from fitting.engine.files import NeededFile
from fitting.engine.place import Where, opened
from fitting.engine.run import run
from fitting.fmu.models import provide_fmu
from fitting.lab.synthesis import AnyBench, bench_of
from fitting.lab.writer import CAMPAIGN_NAME
from fitting.report.ensemble import csv_of, document, markdown, write_report
from fitting.result.ensemble import FAILED, FINISHED, INTERRUPTED, Ensemble, EnsembleRow
from fitting.text.arguments import checked
from fitting.text.errors import BadInput
from fitting.text.files import write_whole
from fitting.text.journal import Journal
from fitting.text.records import to_plain, write_json
from fitting.text.results_folder import remove_earlier, results_folder
from fitting.text.scratch import Scratch
from fitting.text.tables import read_table
from fitting.text.toml import read_toml

__all__ = [
    "Ensemble",
    "EnsembleOptions",
    "Laboratories",
    "Progress",
    "ensemble",
    "finished_items",
    "first_campaign",
    "write_ensemble",
]

#: Processes where nothing is said, at most.
MOST_USUAL = 8
#: Column of a table that holds the paths of campaigns.
CAMPAIGN = "campaign"


@checked
@dataclass(frozen=True)
class Laboratories:
    """Virtual laboratories of one kind, with a seed each, from ``seed`` on.

    Args:
        truth: What is measured, as `synthesize` and `synthesize_curves` take it: a name as "q1" or
            "notch", a bench, or the path of a synthetic campaign or of its truth.toml.
        count: How many, at least 1.
        seed: The first seed, at least 0.
        changes: Numbers of the laboratory that are different, by name, as ``noise_scale``.

    Raises:
        BadInput: no such laboratory, or numbers out of their range.
    """

    truth: AnyBench | Path | str = "q1"
    count: int = 100
    seed: int = 1
    changes: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.count < 1 or self.seed < 0:
            raise BadInput(
                f"Laboratories: count is {self.count!r}, seed {self.seed!r}; wanted at least 1 and "
                "at least 0"
            )

    @property
    def source(self) -> AnyBench | str:
        """The truth without any path, as other machines can use it."""
        return str(self.truth) if str(self.truth) in CURVES else bench_of(self.truth)

    def one(self, number: int, source: AnyBench | str) -> Laboratory:
        """One of the laboratories, as other machines can make it.

        Args:
            number: from 0.
            source: of all.
        """
        return Laboratory(source, self.seed + number, dict(self.changes))


@dataclass(frozen=True)
class Progress:
    """How far an ensemble is: items that have ended, of how many, without a fit, found finished.

    ``item_seconds`` is what the items took that were done now, s, summed over all workers.
    """

    done: int
    total: int
    failed: int
    resumed: int
    item_seconds: float


Campaigns = str | Path | Sequence[str | Path]


def ensemble(
    of: Laboratories | Campaigns,
    fmu: Fmu | str | Path | None = None,
    options: EnsembleOptions | None = None,
    *,
    executor: Where | None = None,
    out: str | Path | None = None,
    progress: Callable[[Progress], None] = lambda _: None,
) -> Ensemble:
    """Fit many campaigns, or many virtual laboratories and hold what is found against the truth.

    The numbers depend neither on how many workers there are nor on the order in which items end. An
    item that fails is a row that says why; one whose worker is lost is done once more.

    Args:
        of: Virtual laboratories; or campaigns: paths of campaign files, of folders (every
            campaign.toml below them) and of tables with a column "campaign".
        fmu: The FMU of all items, a model's name or a path; None: the one that each item names.
        options: How each item is fitted; None: as its campaign says, with profiles of all values.
        executor: Where items run: a number of processes of this machine (None: one per processor,
            up to 8), the address of a dask scheduler as "tcp://10.0.0.1:8786", which gets the FMU
            to its workers, or an executor, whose workers find all files by their paths.
        out: Folder in which finished items are kept as they end; None: nothing is written.
        progress: Is called after every item.

    Returns:
        A row per item in their order, and the coverage of every value of known truth. Where it was
        interrupted, of what had ended.

    Raises:
        BadInput: nothing to do, no such laboratory, scheduler or FMU, or finished items of another
            ensemble.
    """
    asked = options or EnsembleOptions()
    folder = None if out is None else Path(out)
    if isinstance(of, Laboratories) and asked.values:
        _require_values(of, fmu, asked.values)
    with ExitStack() as stack:
        if folder is not None:
            stack.enter_context(results_folder(folder, "ensemble", (*ENSEMBLE_FILES, ITEMS_FILE)))
        built = stack.enter_context(Scratch()) if folder is None else folder / "fmu"
        job = _job(of, fmu, asked, built)
        files = list(dict.fromkeys(i.fmu for i in job.items if isinstance(i.fmu, NeededFile)))
        done = _Done(job, folder, asked, progress)
        if done.waiting:
            where = _usual_workers() if executor is None else executor
            with opened(where, files) as place:
                done.take(lambda items: run(solved, items, place))
        return done.ensemble()


def first_campaign(
    of: Laboratories | Campaigns, fmu: Fmu | str | Path | None, folder: Path
) -> tuple[Path, Fmu, int]:
    """The first campaign, written where it is a laboratory's, its FMU, and how many there are.

    Args:
        of: As `ensemble` takes it.
        fmu: Likewise.
        folder: For the files of a laboratory, and an FMU that is built.

    Raises:
        BadInput: as `ensemble`; the first campaign cannot be read.
    """
    job = _job(of, fmu, EnsembleOptions(), folder)
    first = job.items[0]
    if isinstance(first.fmu, str):
        raise BadInput(first.fmu)
    path = first.what.write(folder) if isinstance(first.what, Laboratory) else first.what
    return path, Fmu(first.fmu.path, 1), len(job.items)


def finished_items(
    of: Laboratories | Campaigns,
    fmu: Fmu | str | Path | None,
    options: EnsembleOptions,
    out: Path,
    folder: Path,
) -> int:
    """How many items an interrupted ensemble has kept, which need not be done again.

    Args:
        of: As `ensemble` takes it.
        fmu: Likewise.
        options: Likewise.
        out: Its folder; nothing is written there.
        folder: For an FMU that is built.

    Raises:
        BadInput: as `ensemble`; the kept items are of another one.
    """
    job = _job(of, fmu, options, folder)
    journal = Journal(out / ITEMS_FILE, job.fingerprint, Kept)
    return len(_as_they_were(job, journal.read()))


def write_ensemble(found: Ensemble, out: str | Path, *, drawn: bool = True) -> list[Path]:
    """Write what the command line writes: ensemble.json, tables, figure, report.

    Args:
        found: Many fits.
        out: Folder, made where there is none.
        drawn: Whether figure and report are wanted.

    Returns:
        The paths of all files.

    Raises:
        BadInput: the folder cannot be written, or holds files of these names of others.
    """
    folder = Path(out)
    with results_folder(folder, "ensemble", ENSEMBLE_FILES):
        paths = [folder / name for name in ("ensemble.json", "ensemble.csv", "ensemble.md")]
        write_json(paths[0], document(found))
        write_whole(paths[1], csv_of(found))
        write_whole(paths[2], markdown(found))
        if drawn:
            paths += _draw(found, folder)
        remove_earlier(folder, ENSEMBLE_FILES)
    return paths


def _draw(found: Ensemble, folder: Path) -> list[Path]:
    # matplotlib takes a second to import: only where something is drawn
    drawing = importlib.import_module("fitting.report.figures.ensemble")
    figures = drawing.save_figures(found, folder / "figures")
    pictures = [figure.file(kind) for figure in figures for kind in ("png", "svg")]
    return [*pictures, write_report(found, figures, folder)]


@dataclass(frozen=True)
class _Job:
    """What is to be done: items, their title, and the fingerprint of how they are done."""

    title: str
    synthetic: bool
    items: tuple[Item, ...]
    fingerprint: str


def _require_values(of: Laboratories, fmu: Fmu | str | Path | None, names: Sequence[str]) -> None:
    """Laboratories are alike: a value that the first one has not would be missed in all of them."""
    with Scratch() as folder:
        path, opened_fmu, _ = first_campaign(replace(of, count=1), fmu, folder)
        try:
            record = Problem.of(path, opened_fmu).record
        finally:
            opened_fmu.workers.close()
    require_values(names, known_values(record), "value")


class _Done:
    """Items that have ended, by their labels; each is kept as it comes."""

    def __init__(
        self,
        job: _Job,
        folder: Path | None,
        asked: EnsembleOptions,
        progress: Callable[[Progress], None],
    ) -> None:
        self._job, self._progress = job, progress
        self._rows: dict[str, EnsembleRow] = {}
        self._journal: Journal[Kept] | None = None
        self._status, self._message = FINISHED, ""
        self._seconds, self._failed = 0.0, 0
        if folder is not None:
            self._journal = Journal(folder / ITEMS_FILE, job.fingerprint, Kept)
            if asked.resume:
                self._resume(self._journal)
        self._resumed = len(self._rows)

    @property
    def waiting(self) -> list[Item]:
        """Items that have not ended, in their order."""
        return [item for item in self._job.items if item.label not in self._rows]

    def take(self, results: Callable[[list[Item]], Iterator[Any]]) -> None:
        """Take results until there are no more, or an end is asked for.

        Args:
            results: gives them for the items that are wanted, as they end.

        Raises:
            KeyboardInterrupt: nothing has ended so far.
        """
        try:
            self._tell()
            for ended in results(self.waiting):
                kept = ended.result or _lost(ended.item, ended.how_lost)
                if self._journal is not None:
                    self._journal.record(kept)
                self._rows[ended.item.label] = kept.row
                self._seconds += kept.seconds
                self._failed += kept.row.failed
                self._tell()
        except KeyboardInterrupt:
            if not self._rows:
                raise
            self._status = INTERRUPTED
        except BrokenExecutor as error:
            self._status, self._message = INTERRUPTED, f"the executor takes no more: {error}"

    def ensemble(self) -> Ensemble:
        """The record of what has ended."""
        job = self._job
        rows = tuple(self._rows[item.label] for item in job.items if item.label in self._rows)
        failed = sum(row.failed for row in rows)
        words = f"{len(rows)} of {len(job.items)} items have ended"
        words += f", {failed} of them without a fit" if failed else ""
        return Ensemble(
            title=job.title,
            synthetic=job.synthetic,
            status=self._status,
            message="; ".join(text for text in (words, self._message) if text),
            total=len(job.items),
            rows=rows,
            provenance=_provenance(job),
        )

    def _resume(self, journal: Journal[Kept]) -> None:
        self._rows.update(_as_they_were(self._job, journal.resume()))

    def _tell(self) -> None:
        total = len(self._job.items)
        state = Progress(len(self._rows), total, self._failed, self._resumed, self._seconds)
        self._progress(state)


def _as_they_were(job: _Job, parts: Iterator[Kept]) -> dict[str, EnsembleRow]:
    """Rows of items that are as they were, by their labels; what had no fit is done again."""
    wanted, rows = {item.label: item for item in job.items}, {}
    for kept in parts:
        item = wanted.get(kept.row.label)
        if item is None or kept.row.failed or kept.fmu != item.fmu_digest:
            continue
        if kept.files == kept_digests(kept.files):
            rows[item.label] = replace(kept.row, index=item.index)
    return rows


def _lost(item: Item, how: str) -> Kept:
    return Kept(row=EnsembleRow(index=item.index, label=item.label, status=FAILED, message=how))


def _job(
    of: Laboratories | Campaigns, fmu: Fmu | str | Path | None, asked: EnsembleOptions, built: Path
) -> _Job:
    sources = _Sources(built, fmu)
    content = {
        "options": to_plain(replace(asked, resume=False)),
        "versions": {name: version(name) for name in ("numpy", "scipy")},
        "version": fitting.__version__,
    }
    if isinstance(of, Laboratories):
        items, title = _laboratories(of, sources, asked), _title(of)
        content["of"] = repr((of.source, sorted(of.changes.items())))
    else:
        items, title = _campaigns(of, sources, asked), "Campaigns"
    digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    return _Job(title, isinstance(of, Laboratories), tuple(items), digest)


def _title(of: Laboratories) -> str:
    name = of.truth if isinstance(of.truth, str) else getattr(of.truth, "series", "")
    name = of.truth.as_posix() if isinstance(of.truth, Path) else name
    return f"Virtual laboratories {name}".rstrip()


def _laboratories(of: Laboratories, sources: _Sources, asked: EnsembleOptions) -> Iterator[Item]:
    source = of.source
    text = of.one(0, source).made().files[CAMPAIGN_NAME]
    fmu = sources.of_text(str(text), Path(CAMPAIGN_NAME))
    if isinstance(fmu, str):
        raise BadInput(fmu)
    for k in range(of.count):
        what = of.one(k, source)
        yield Item(index=k, label=f"seed {what.seed}", what=what, fmu=fmu, options=asked)


def _campaigns(of: Campaigns, sources: _Sources, asked: EnsembleOptions) -> Iterator[Item]:
    given = [of] if isinstance(of, str | Path) else list(of)
    paths = list(dict.fromkeys(p for place in given for p in _paths(Path(place))))
    if not paths:
        raise BadInput("ensemble: no campaigns, wanted at least one")
    for k, path in enumerate(paths):
        fmu = sources.of_campaign(path)
        yield Item(index=k, label=path.as_posix(), what=path.resolve(), fmu=fmu, options=asked)


def _paths(place: Path) -> list[Path]:
    """Campaigns that a path names: a file, all below a folder, those of a table."""
    if place.is_dir():
        found = sorted(place.rglob(CAMPAIGN_NAME))
        if not found:
            raise BadInput(f"{place}: no {CAMPAIGN_NAME} below it, wanted at least one")
        return found
    if place.suffix.lower() == ".toml":
        return [place]
    table = read_table(place)
    return [place.parent / text for text in table.texts(table.column(CAMPAIGN))]


class _Sources:
    """FMUs that campaigns name, each found or built once; a complaint where there is none."""

    def __init__(self, built: Path, given: Fmu | str | Path | None) -> None:
        self._built = built
        self._known: dict[tuple[str | None, Path | None], NeededFile | str] = {}
        self._given: NeededFile | None = None
        if isinstance(given, Fmu):
            self._given = NeededFile.of(given.description.file)
        elif given is not None:
            model = isinstance(given, str) and given.isidentifier()
            named = WrittenFmu(model=str(given)) if model else WrittenFmu(file=Path(given))
            self._given = NeededFile.of(provide_fmu(named, built))

    def of_campaign(self, path: Path) -> NeededFile | str:
        """The FMU of a campaign file, as far as that can be read."""
        if self._given is not None:
            return self._given
        try:
            return self._of_tables(read_toml(path), path)
        except BadInput as error:
            return f"{error}"

    def of_text(self, text: str, path: Path) -> NeededFile | str:
        """The FMU of a campaign that is no file yet."""
        return self._given or self._of_tables(tomllib.loads(text), path)

    def _of_tables(self, tables: Mapping[str, Any], path: Path) -> NeededFile | str:
        table = tables.get("fmu")
        table = table if isinstance(table, Mapping) else {}
        model, file = table.get("model"), table.get("file")
        # one FMU whose path is written in two ways is one
        place = (path.parent / file).resolve() if isinstance(file, str) else None
        key = (model if isinstance(model, str) else None, place)
        if key == (None, None):
            return f"{path}: [fmu]: names neither a model nor a file"
        if key not in self._known:
            try:
                named = WrittenFmu(model=key[0], file=place)
                self._known[key] = NeededFile.of(provide_fmu(named, self._built))
            except BadInput as error:
                self._known[key] = f"{error}"
        return self._known[key]


def _usual_workers() -> int:
    return min(os.cpu_count() or 1, MOST_USUAL)


def _provenance(job: _Job) -> dict[str, str]:
    """Where the rows come from: nothing in it depends on where they ran."""
    fmus = (i.fmu for i in job.items if isinstance(i.fmu, NeededFile))
    named = list(dict.fromkeys(f"{Path(f.path).name}, SHA-256 {f.digest}" for f in fmus))
    shown = [*named[:3], *([f"and {len(named) - 3} more"] if len(named) > 3 else [])]
    return {
        "command": "fitting.ensemble",
        "FMU": "; ".join(shown) or "none",
        "versions": f"fmu-fit {fitting.__version__}, numpy {version('numpy')}, "
        f"scipy {version('scipy')}",
    }
