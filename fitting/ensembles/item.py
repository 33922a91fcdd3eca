"""One item of an ensemble, as a worker does it: a function of the item alone."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import fitting as ff
from fitting.ensembles.result import FAILED, EnsembleRow, EnsembleValue
from fitting.extension.fmu import NeededFile, place_of
from fitting.extension.problem import Valued
from fitting.extension.records import WrittenFmu, read_campaign
from fitting.lab.laboratories import AnyBench, bench_of
from fitting.lab.names import CURVES, TRUTH_NAME
from fitting.lab.synthesis import Synthetic, synthesize, synthesize_curves
from fitting.lab.true_values import nearest, true_values
from fitting.text.arguments import checked
from fitting.text.errors import BadInput, FmuFailure
from fitting.text.estimate import Estimate
from fitting.text.results_folder import write_all
from fitting.text.scratch import Scratch
from fitting.text.toml import read_toml

_log = logging.getLogger(__name__)


@checked
@dataclass(frozen=True)
class Laboratories:
    """Virtual laboratories of one kind, with seeds from ``seed`` on.

    Args:
        truth: As of `synthesize` and `synthesize_curves`: a name as "q1" or "notch", a bench, or
            the path of a synthetic campaign or its truth.toml.
        count: Number, at least 1.
        seed: The first seed, at least 0.
        changes: Numbers of the laboratory by name, as ``noise_scale``.

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
    def portable(self) -> Laboratories:
        """The same without any path, as other machines can use it."""
        truth = str(self.truth) if str(self.truth) in CURVES else bench_of(self.truth)
        return replace(self, truth=truth)

    def first(self) -> Synthetic:
        """The campaign of the first laboratory, with the truth behind it.

        Raises:
            BadInput: impossible numbers.
        """
        if isinstance(self.truth, str) and self.truth in CURVES:
            return synthesize_curves(self.truth, seed=self.seed, **self.changes)
        return synthesize(self.truth, seed=self.seed, **self.changes)


@checked
@dataclass(frozen=True, kw_only=True)
class EnsembleOptions:
    """How each item is fitted.

    Args:
        values: Parameters and derived outputs to profile; none: all.
        profiles: Whether profiles are scanned; else errors are from the covariance.
        starts: Number of starts; None: as each campaign states.
        quick: One start where ``starts`` is None.
        budget: Runs of the FMU by the profiles of an item, about; None: as of `profile`.
        resume: Whether finished items in ``out`` are kept.

    Raises:
        BadInput: a number out of its range.
    """

    values: str | Sequence[str] = ()
    profiles: bool = True
    starts: int | None = None
    quick: bool = False
    budget: int | None = None
    resume: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "values", (self.values,) if isinstance(self.values, str) else tuple(self.values)
        )
        for name in ("starts", "budget"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise BadInput(f"EnsembleOptions: {name} is {value!r}, wanted at least 1")


@dataclass(frozen=True, kw_only=True)
class Item:
    """One item: one laboratory or the path of a campaign, with its FMU, or why there is none."""

    index: int
    label: str
    what: Laboratories | Path
    fmu: NeededFile | str
    options: EnsembleOptions

    @property
    def fmu_digest(self) -> str:
        """SHA-256 of the FMU, empty where there is none."""
        return self.fmu.digest if isinstance(self.fmu, NeededFile) else ""


@dataclass(frozen=True, kw_only=True)
class Kept:
    """An item that has ended: its row, how long it took, and what it depended on.

    ``fmu`` is the SHA-256 of the FMU, ``files`` those of the files of its campaign, by their paths.
    """

    row: EnsembleRow
    seconds: float = 0.0
    fmu: str = ""
    files: Mapping[str, str] = field(default_factory=dict)


def solved(item: Item) -> Kept:
    """Fit one item; whatever goes wrong with it is a row, too.

    Args:
        item: laboratory or campaign.
    """
    started = time.perf_counter()
    files: dict[str, str] = {}
    with Scratch() as folder:
        try:
            row = _row(item, folder, files)
        except Exception as error:
            if not isinstance(error, BadInput | FmuFailure):
                _log.exception("%s", item.label)
            row = _failed(item, error, str(folder))
    return Kept(row=row, seconds=time.perf_counter() - started, fmu=item.fmu_digest, files=files)


def digests(paths: Iterable[str]) -> dict[str, str]:
    """SHA-256 of files as they are now, by their paths; empty where one cannot be read.

    Args:
        paths: of the files.
    """
    digest_of = dict.fromkeys(paths, "")
    for path in digest_of:
        with contextlib.suppress(OSError):
            digest_of[path] = hashlib.sha256(Path(path).read_bytes()).hexdigest()
    return digest_of


def _row(item: Item, folder: Path, files: dict[str, str]) -> EnsembleRow:
    truth: Mapping[str, Any] = {}
    if isinstance(item.what, Laboratories):
        made = item.what.first()
        truth = made.truth
        write_all(folder, made.files)
        campaign = read_campaign(folder / "campaign.toml")
    else:
        campaign = read_campaign(item.what)
        files.update(digests(map(str, campaign.files)))
        own = item.what.parent / TRUTH_NAME
        if campaign.file.synthetic and own.is_file():
            truth = read_toml(own)
    if isinstance(item.fmu, str):
        raise BadInput(item.fmu)
    fmu = _opened_fmu(item.fmu, campaign.file.fmu)
    problem = ff.Problem.of(campaign, fmu)
    how = item.options
    # the values of the likelihood do not rest on the levels of Algorithm 2
    method = replace(ff.Tikhonov.of(problem.options), path=False)
    starts = 1 if how.quick and how.starts is None else how.starts
    result: Valued = ff.fit(problem, method, starts=starts)
    if how.profiles:
        result = ff.profile(result.source, tuple(how.values) or None, budget=how.budget)
    reflection = bool(result.source.record.alternative.get("reflection", False))
    true = true_values(truth, reflection=reflection) if truth else {}
    values = []
    for v in result.values.values():
        # values of single experiments are left out
        if v.role == "offset" or (how.values and v.name not in how.values):
            continue
        low, high = v.interval(0.95)
        shared = {each.name: getattr(v, each.name) for each in fields(Estimate)}
        shared |= {"ci68": v.interval(0.68), "ci95": (low, high)}
        known = nearest(v.name, true.get(v.name, float("nan")), 0.5 * (low + high))
        values.append(EnsembleValue(**shared, truth=known))
    return EnsembleRow(
        index=item.index,
        label=item.label,
        status=result.inferred.status,
        message=result.inferred.message,
        values=tuple(values),
    )


def _failed(item: Item, error: Exception, folder: str) -> EnsembleRow:
    """The row of an item without a fit, without where it ran, which differs from run to run."""
    words = f"{error}"
    if not isinstance(error, BadInput | FmuFailure):
        words = f"a fault of this program: {type(error).__name__}: {words}"
    words = words.replace(f"{folder}/", "").replace(folder, "")
    if isinstance(item.what, Path):  # as its user names it
        words = words.replace(str(item.what.parent), Path(item.label).parent.as_posix())
    if isinstance(error, FmuFailure):
        words = words.replace(str(error.fmu), error.fmu.name)
    words = " ".join(words.split())
    return EnsembleRow(index=item.index, label=item.label, status=FAILED, message=words)


#: The FMU that a thread of a worker has open, with its key: loaded once for all its items.
_OPEN = threading.local()


def _opened_fmu(file: NeededFile, named: WrittenFmu) -> ff.Fmu:
    how: dict[str, Any] = {
        "timeout_s": named.timeout_s,
        "interface": named.interface,
        "output_delay_steps": named.output_delay_steps,
        "tolerance": named.tolerance,
        "start_time_s": named.start_time,
        "stop_time_s": named.stop_time,
    }
    key = (file.digest, *how.values())
    last, fmu = getattr(_OPEN, "last", (None, None))
    if last != key or fmu is None:
        if fmu is not None:
            fmu.workers.close()
        fmu = ff.Fmu(place_of(file), 1, **how)
        _OPEN.last = (key, fmu)
    return fmu
