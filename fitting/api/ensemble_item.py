"""One item of an ensemble, as a worker does it: a function of the item alone."""

from __future__ import annotations

import hashlib
import logging
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from fitting.api.choices import CURVES, TRUTH_NAME
from fitting.api.fitted import Tikhonov, Value, Valued, fit, profile
from fitting.api.fmu import Fmu
from fitting.api.problem import Problem
from fitting.campaign.file import WrittenFmu
from fitting.engine.files import NeededFile, place_of
from fitting.lab.synthesis import AnyBench, SyntheticFiles, synthesize, synthesize_curves
from fitting.lab.true_values import nearest, true_values
from fitting.measurements.kinds import read_campaign
from fitting.result.ensemble import FAILED, EnsembleRow, EnsembleValue
from fitting.text.arguments import checked
from fitting.text.errors import BadInput, FmuFailure
from fitting.text.estimate import Estimate
from fitting.text.files import write_all
from fitting.text.scratch import Scratch
from fitting.text.toml import read_toml

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Laboratory:
    """A virtual laboratory: what is measured, its seed, and numbers that are different."""

    truth: AnyBench | str
    seed: int
    changes: Mapping[str, Any] = field(default_factory=dict)

    def made(self) -> SyntheticFiles:
        """Its campaign with the truth behind it.

        Raises:
            BadInput: impossible numbers.
        """
        if isinstance(self.truth, str) and self.truth in CURVES:
            return synthesize_curves(self.truth, seed=self.seed, **self.changes)
        return synthesize(self.truth, seed=self.seed, **self.changes)

    def write(self, folder: Path) -> Path:
        """Write the campaign; its path.

        Args:
            folder: where the files go.
        """
        return self.made().write(folder)


@checked
@dataclass(frozen=True, kw_only=True)
class EnsembleOptions:
    """How each item is fitted.

    Args:
        values: Parameters and derived outputs that are profiled; none: all.
        profiles: Whether profiles are walked; else errors are those of the linearised problem.
        starts: How many starts are followed; None: as each campaign says.
        quick: Looser tolerances, and one start where ``starts`` is not said.
        budget: Runs of the FMU by the profiles of an item, about, at most; None: as `profile` says.
        resume: Whether finished items in ``out`` count.

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
    """One item: a laboratory or the path of a campaign, with its FMU, or why there is none."""

    index: int
    label: str
    what: Laboratory | Path
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
    begun = time.perf_counter()
    files: dict[str, str] = {}
    with Scratch() as folder:
        try:
            row = _row(item, folder, files)
        except Exception as error:
            if not isinstance(error, BadInput | FmuFailure):
                _log.exception("%s", item.label)
            row = _failed(item, error, str(folder))
    return Kept(row=row, seconds=time.perf_counter() - begun, fmu=item.fmu_digest, files=files)


def kept_digests(files: Mapping[str, str]) -> dict[str, str]:
    """SHA-256 of files as they are now, by their paths; empty where one cannot be read.

    Args:
        files: by their paths.
    """
    return {path: _digest(Path(path)) for path in files}


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


def _row(item: Item, folder: Path, files: dict[str, str]) -> EnsembleRow:
    truth: Mapping[str, Any] = {}
    if isinstance(item.what, Laboratory):
        made = item.what.made()
        truth = made.truth
        write_all(folder, made.files)
        campaign = read_campaign(folder / "campaign.toml")
    else:
        campaign = read_campaign(item.what)
        files.update(kept_digests(dict.fromkeys(map(str, campaign.files), "")))
        beside = item.what.parent / TRUTH_NAME
        if campaign.file.synthetic and beside.is_file():
            truth = read_toml(beside)
    if isinstance(item.fmu, str):
        raise BadInput(item.fmu)
    fmu = _held(item.fmu, campaign.file.fmu)
    problem = Problem.of(campaign, fmu)
    how = item.options
    method = None
    if how.quick:
        own = Tikhonov.of(problem.options)
        method = Tikhonov(**{**vars(own), "quick": True})
    starts = 1 if how.quick and how.starts is None else how.starts
    found: Valued = fit(problem, method, starts=starts)
    if how.profiles:
        found = profile(found.source, tuple(how.values) or None, budget=how.budget)
    return EnsembleRow(
        index=item.index,
        label=item.label,
        status=found.inferred.status,
        message=found.inferred.message,
        values=_values(found, truth, how.values),
    )


def _values(found: Valued, truth: Mapping[str, Any], only: Any) -> tuple[EnsembleValue, ...]:
    """Values of the whole sample beside what is true; those of single experiments are left out."""
    chosen = found.source.record.alternative
    true = true_values(truth, reflection=bool(chosen.get("reflection", False))) if truth else {}
    shared = [
        v for v in found.values.values() if v.role != "offset" and (not only or v.name in only)
    ]
    return tuple(_value(value, true.get(value.name, float("nan"))) for value in shared)


def _value(v: Value, true: float) -> EnsembleValue:
    low, high = v.interval(0.95)
    shared = {each.name: getattr(v, each.name) for each in fields(Estimate)}
    shared |= {"ci68": v.interval(0.68), "ci95": (low, high)}
    return EnsembleValue(**shared, truth=nearest(v.name, true, 0.5 * (low + high)))


def _failed(item: Item, error: Exception, folder: str) -> EnsembleRow:
    """The row of an item without a fit; where it ran is not told, which differs from run to run."""
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


class _Holder(threading.local):
    """The FMU that a thread of a worker has open: loaded once, however many items there are."""

    key: tuple[str, float, str | None] | None = None
    fmu: Fmu | None = None


_HELD = _Holder()


def _held(file: NeededFile, named: WrittenFmu) -> Fmu:
    key = (file.digest, named.timeout_s, named.interface)
    if _HELD.key != key or _HELD.fmu is None:
        if _HELD.fmu is not None:
            _HELD.fmu.workers.close()
        opened = Fmu(place_of(file), 1, named.timeout_s, interface=named.interface)
        _HELD.fmu, _HELD.key = opened, key
    return _HELD.fmu
