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
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

import fitting
from fitting import Fmu, Problem
from fitting.ensembles import FILES, ITEMS_FILE
from fitting.ensembles.item import EnsembleOptions, Item, Kept, Laboratories, digests, solved
from fitting.ensembles.report import csv_of, document, markdown, write_report
from fitting.ensembles.result import FAILED, FINISHED, INTERRUPTED, Ensemble, EnsembleRow
from fitting.extension.fmu import NeededFile, Where, built_model, opened, run
from fitting.extension.problem import known_values, require_values
from fitting.lab.writer import CAMPAIGN_NAME
from fitting.text.errors import BadInput
from fitting.text.journal import Journal
from fitting.text.old_names import renamed
from fitting.text.records import to_plain, write_json
from fitting.text.results_folder import remove_earlier, results_folder, write_whole
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

#: Processes where no number is given, at most.
MOST_USUAL = 8
#: Column of a table that holds the paths of campaigns.
CAMPAIGN = "campaign"

Campaigns = str | Path | Sequence[str | Path]
AnyFmu: TypeAlias = "Fmu | str | Path | None"


@dataclass(frozen=True)
class Progress:
    """How far an ensemble is: items that have ended, of how many, without a fit, resumed.

    ``item_seconds`` is what the items took that were done now, s, summed over all workers.
    """

    done: int
    total: int
    failed: int
    resumed: int
    item_seconds: float


def ensemble(
    of: Laboratories | Campaigns,
    fmu: AnyFmu = None,
    options: EnsembleOptions | None = None,
    *,
    executor: Where | None = None,
    out: str | Path | None = None,
    progress: Callable[[Progress], None] = lambda _: None,
) -> Ensemble:
    """Fit many campaigns, or many virtual laboratories and compare the values with the truth.

    Numbers depend neither on the workers nor on the order. A failed item is a row with the reason;
    an item whose worker is lost is repeated once.

    Args:
        of: `Laboratories`; or paths of campaigns, of folders with them, or of tables with a column
            "campaign".
        fmu: The FMU of all items, a model's name or a path; None: each item's.
        options: How each item is fitted; None: as its campaign states, with all profiles.
        executor: A number of processes (None: one per processor, up to 8), a dask scheduler as
            "tcp://10.0.0.1:8786", or an executor whose workers have the files.
        out: Folder for finished items; None: nothing is written.
        progress: Called after every item.

    Returns:
        A row per finished item in order, and the coverage of every value of known truth.

    Raises:
        BadInput: nothing to do, no such laboratory, scheduler or FMU, or finished items of another
            ensemble.
    """
    chosen = options or EnsembleOptions()
    folder = None if out is None else Path(out)
    if isinstance(of, Laboratories) and chosen.values:
        # laboratories are alike: a value that the first one has not would be missed in all of them
        with Scratch() as scratch:
            path, first_fmu, _ = first_campaign(replace(of, count=1), fmu, scratch)
            with first_fmu:
                record = Problem.of(path, first_fmu).record
        require_values(chosen.values, known_values(record), "value")
    with ExitStack() as stack:
        if folder is not None:
            stack.enter_context(results_folder(folder, "ensemble", (*FILES, ITEMS_FILE)))
        built = stack.enter_context(Scratch()) if folder is None else folder / "fmu"
        job = _Job(of, fmu, chosen, built)
        if folder is not None:
            job.keep_in(folder, resume=chosen.resume)
        waiting = [item for item in job.items if item.label not in job.rows]
        if waiting:
            files = dict.fromkeys(i.fmu for i in job.items if isinstance(i.fmu, NeededFile))
            where = min(os.cpu_count() or 1, MOST_USUAL) if executor is None else executor
            with opened(where, list(files)) as place:
                job.take(run(solved, waiting, place), progress)
        return job.ensemble()


def first_campaign(
    of: Laboratories | Campaigns, fmu: AnyFmu, folder: Path
) -> tuple[Path, Fmu, int]:
    """The first campaign, written where it is a laboratory's, its FMU, and how many there are.

    Args:
        of: As `ensemble` takes it.
        fmu: Likewise.
        folder: For the files of a laboratory, and an FMU that is built.

    Raises:
        BadInput: as `ensemble`; the first campaign cannot be read.
    """
    items = _Job(of, fmu, EnsembleOptions(), folder).items
    first = items[0]
    if isinstance(first.fmu, str):
        raise BadInput(first.fmu)
    what = first.what
    path = what.first().write(folder) if isinstance(what, Laboratories) else what
    return path, Fmu(first.fmu.path, 1), len(items)


def finished_items(
    of: Laboratories | Campaigns, fmu: AnyFmu, options: EnsembleOptions, out: Path, folder: Path
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
    job = _Job(of, fmu, options, folder)
    return len(job.unchanged(Journal(out / ITEMS_FILE, job.fingerprint, Kept).read()))


@renamed
def write_ensemble(result: Ensemble, out: str | Path, *, drawn: bool = True) -> list[Path]:
    """Write ensemble.json, tables, figure and report, as the command does.

    Args:
        result: Of `ensemble`.
        out: Folder, made where there is none.
        drawn: Whether figure and report are written.

    Returns:
        The files.

    Raises:
        BadInput: the folder cannot be written, or holds other files of these names.
    """
    folder = Path(out)
    with results_folder(folder, "ensemble", FILES):
        paths = [folder / name for name in ("ensemble.json", "ensemble.csv", "ensemble.md")]
        write_json(paths[0], document(result))
        write_whole(paths[1], csv_of(result))
        write_whole(paths[2], markdown(result))
        if drawn:
            # matplotlib takes a second to import: only where something is drawn
            drawing = importlib.import_module("fitting.ensembles.figure")
            figures = drawing.save_figures(result, folder / "figures")
            paths += [path for figure in figures for path in figure.files]
            paths.append(write_report(result, figures, folder))
        remove_earlier(folder, FILES)
    return paths


class _Job:
    """What is to be done, the fingerprint of how it is done, and the rows of what has ended."""

    def __init__(
        self, of: Laboratories | Campaigns, fmu: AnyFmu, chosen: EnsembleOptions, built: Path
    ) -> None:
        sources = _Sources(built, fmu)
        content: dict[str, Any] = {
            "options": to_plain(replace(chosen, resume=False)),
            "versions": {name: version(name) for name in ("numpy", "scipy")},
            "version": fitting.__version__,
        }
        self.synthetic = isinstance(of, Laboratories)
        self.items: list[Item] = []
        if isinstance(of, Laboratories):
            name = of.truth if isinstance(of.truth, str) else getattr(of.truth, "series", "")
            name = of.truth.as_posix() if isinstance(of.truth, Path) else name
            self.title = f"Virtual laboratories {name}".rstrip()
            of = of.portable
            content["of"] = repr((of.truth, sorted(of.changes.items())))
            text = str(of.first().files[CAMPAIGN_NAME])
            source = sources.of_tables(tomllib.loads(text), Path(CAMPAIGN_NAME))
            if isinstance(source, str):
                raise BadInput(source)
            for k in range(of.count):
                one = replace(of, count=1, seed=of.seed + k)
                label = f"seed {one.seed}"
                item = Item(index=k, label=label, what=one, fmu=source, options=chosen)
                self.items.append(item)
        else:
            self.title = "Campaigns"
            given = [of] if isinstance(of, str | Path) else list(of)
            paths = list(dict.fromkeys(p for place in given for p in _paths(Path(place))))
            if not paths:
                raise BadInput("ensemble: no campaigns, wanted at least one")
            for k, path in enumerate(paths):
                what, own = path.resolve(), sources.of_campaign(path)
                item = Item(index=k, label=path.as_posix(), what=what, fmu=own, options=chosen)
                self.items.append(item)
        text = json.dumps(content, sort_keys=True)
        self.fingerprint = hashlib.sha256(text.encode()).hexdigest()
        self.rows: dict[str, EnsembleRow] = {}
        self._journal: Journal[Kept] | None = None
        self._status, self._message = FINISHED, ""

    def keep_in(self, folder: Path, *, resume: bool) -> None:
        """Keep items as they end, after those of an interrupted run if it is resumed.

        Raises:
            BadInput: that was another ensemble.
        """
        self._journal = Journal(folder / ITEMS_FILE, self.fingerprint, Kept)
        if resume:
            self.rows.update(self.unchanged(self._journal.resume()))

    def unchanged(self, parts: Iterator[Kept]) -> dict[str, EnsembleRow]:
        """Rows of items whose files have not changed, by their labels; no failures."""
        wanted, rows = {item.label: item for item in self.items}, {}
        for kept in parts:
            item = wanted.get(kept.row.label)
            if item is None or kept.row.failed or kept.fmu != item.fmu_digest:
                continue
            if kept.files == digests(kept.files):
                rows[item.label] = replace(kept.row, index=item.index)
        return rows

    def take(self, results: Iterator[Any], progress: Callable[[Progress], None]) -> None:
        """Take results until there are no more, or an end is asked for.

        Raises:
            KeyboardInterrupt: nothing has ended so far.
        """
        total, resumed, failed, seconds = len(self.items), len(self.rows), 0, 0.0
        try:
            progress(Progress(resumed, total, failed, resumed, seconds))
            for item, result, lost in results:
                message = f"its worker was lost, again when it was repeated: {lost}"
                kept = result or Kept(
                    row=EnsembleRow(
                        index=item.index, label=item.label, status=FAILED, message=message
                    )
                )
                if self._journal is not None:
                    self._journal.record(kept)
                self.rows[item.label] = kept.row
                seconds += kept.seconds
                failed += kept.row.failed
                progress(Progress(len(self.rows), total, failed, resumed, seconds))
        except KeyboardInterrupt:
            if self._journal is not None:  # it may fall between an item's line there and its row
                self.rows.update(self.unchanged(self._journal.recorded()))
            if not self.rows:
                raise
            self._status = INTERRUPTED
        except BrokenExecutor as error:
            self._status, self._message = INTERRUPTED, f"the executor takes no more: {error}"

    def ensemble(self) -> Ensemble:
        """The record of what has ended; nothing in it depends on where it ran."""
        rows = tuple(self.rows[item.label] for item in self.items if item.label in self.rows)
        failed = sum(row.failed for row in rows)
        message = f"{len(rows)} of {len(self.items)} items have ended"
        message += f", {failed} of them without a fit" if failed else ""
        fmus = (i.fmu for i in self.items if isinstance(i.fmu, NeededFile))
        named = list(dict.fromkeys(f"{Path(f.path).name}, SHA-256 {f.digest}" for f in fmus))
        shown = [*named[:3], *([f"and {len(named) - 3} more"] if len(named) > 3 else [])]
        return Ensemble(
            title=self.title,
            synthetic=self.synthetic,
            status=self._status,
            message="; ".join(filter(None, (message, self._message))),
            total=len(self.items),
            rows=rows,
            provenance={
                "command": "fitting.ensemble",
                "FMU": "; ".join(shown) or "none",
                "versions": f"fmu-fit {fitting.__version__}, numpy {version('numpy')}, "
                f"scipy {version('scipy')}",
            },
        )


def _paths(place: Path) -> list[Path]:
    """Campaigns that a path names: a file, all below a folder, those of a table."""
    if place.is_dir():
        campaigns = sorted(place.rglob(CAMPAIGN_NAME))
        if not campaigns:
            raise BadInput(f"{place}: no {CAMPAIGN_NAME} below it, wanted at least one")
        return campaigns
    if place.suffix.lower() == ".toml":
        return [place]
    table = read_table(place)
    return [place.parent / text for text in table.texts(table.column(CAMPAIGN))]


class _Sources:
    """FMUs that campaigns name, each opened or built once; a complaint where there is none."""

    def __init__(self, built: Path, given: AnyFmu) -> None:
        self._built = built
        self._known: dict[tuple[str | None, Path | None], NeededFile | str] = {}
        self._given: NeededFile | None = None
        if isinstance(given, Fmu):
            self._given = NeededFile.of(given.description.file)
        elif given is not None:
            is_model = isinstance(given, str) and given.isidentifier()
            file = built_model(str(given), built) if is_model else Path(given)
            self._given = NeededFile.of(file)

    def of_campaign(self, path: Path) -> NeededFile | str:
        """The FMU of a campaign file, as far as that can be read."""
        if self._given is not None:
            return self._given
        try:
            return self.of_tables(read_toml(path), path)
        except BadInput as error:
            return f"{error}"

    def of_tables(self, tables: Mapping[str, Any], path: Path) -> NeededFile | str:
        """The FMU of a campaign by its tables, whose file need not be there."""
        if self._given is not None:
            return self._given
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
                self._known[key] = NeededFile.of(place or built_model(str(model), self._built))
            except BadInput as error:
                self._known[key] = f"{error}"
        return self._known[key]
