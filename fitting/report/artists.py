"""Processes that draw a report: they load what they draw with while others wait for an FMU.

Nothing here loads a library that draws, as the process that asks has no need of one.
"""

from __future__ import annotations

import gc
import importlib
import os
import pickle
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec, TypeVar

from fitting.text.files import write_whole
from fitting.text.scratch import Scratch

if TYPE_CHECKING:  # a process that draws loads them with all the rest
    from fitting.measurements.figure import Figure
    from fitting.report.shown import ShownCampaign
    from fitting.result.result import Result


#: How much they stand back behind those who fit meanwhile, as `nice` counts it.
BEHIND = 5

Drawn = TypeVar("Drawn")
Arguments = ParamSpec("Arguments")


@dataclass(frozen=True)
class Begun:
    """Figures that are drawn while the rest of a result is inferred: of what, and by number."""

    of: bytes
    shares: tuple[Future[dict[str, Figure]], ...]

    def of_these(self, result: Result, data: ShownCampaign) -> dict[str, Figure]:
        """Those that are figures of this result too, when all are drawn; none if it is another.

        Args:
            result: of a reconstruction.
            data: what is shown of the campaign.
        """
        wait(self.shares)
        if self.of != _seen(result, data) or any(share.exception() for share in self.shares):
            return {}  # drawn again: what failed then fails with its own words
        return {number: file for share in self.shares for number, file in share.result().items()}


@dataclass(frozen=True)
class Artists:
    """So many processes that draw side by side, into one folder."""

    executor: Executor
    count: int
    folder: Path

    def get_ready(self) -> None:
        """Have them load what they draw with, which takes seconds."""
        for _ in range(self.count):
            self.executor.submit(_load)

    def begin(self, result: Result, data: ShownCampaign) -> Begun:
        """Draw what an inference does not change, while it goes on.

        Args:
            result: of a fit.
            data: what is shown of the campaign.
        """
        shares = [(k, self.count) for k in range(self.count)]
        asked = (self.executor.submit(_begin, result, data, self.folder, own) for own in shares)
        return Begun(_seen(result, data), tuple(asked))

    def report(
        self, result: Result, data: ShownCampaign, out_dir: Path, begun: Begun | None = None
    ) -> Path:
        """The same report as of one process; the path of its page.

        Args:
            result: of a reconstruction.
            data: what is shown of the campaign.
            out_dir: where the files go.
            begun: figures that were begun before.

        Raises:
            BadInput: the folder cannot be written.
            BrokenExecutor: processes are lost again and again.
        """
        with Scratch(self.folder) as scratch:
            folder = scratch / "report"
            ready = {} if begun is None else begun.of_these(result, data)
            left = self._asked(_numbers, result, data, tuple(ready))
            # whoever is free takes the next one
            asked = {k: self.executor.submit(_draw, result, data, folder, k) for k in left}
            try:
                drawn = ready | {
                    k: self._answer(future, _draw, result, data, folder, k)
                    for k, future in asked.items()
                }
            finally:  # where one failed, the others are to end before their folder does
                for future in asked.values():
                    future.cancel()
                wait(asked.values())
            figures = [drawn[number] for number in sorted(drawn)]
            page = self._asked(_write, result, data, folder, figures)
            # this process knows which files of a folder are its own to replace
            for path in sorted(path for figure in figures for path in figure.files):
                write_whole(out_dir / path.parent.name / path.name, path.read_bytes())
            for path in sorted(path for path in folder.iterdir() if path.is_file()):
                write_whole(out_dir / path.name, path.read_bytes())
            return out_dir / page.name

    def _asked(
        self, draw: Callable[Arguments, Drawn], *args: Arguments.args, **kwargs: Arguments.kwargs
    ) -> Drawn:
        """What a process makes of that."""
        return self._answer(self.executor.submit(draw, *args, **kwargs), draw, *args, **kwargs)

    def _answer(
        self,
        future: Future[Drawn],
        draw: Callable[Arguments, Drawn],
        *args: Arguments.args,
        **kwargs: Arguments.kwargs,
    ) -> Drawn:
        """What came of that; asked again where a process was lost, whose place another takes."""
        for _ in range(self.count):
            try:
                return future.result()
            except BrokenExecutor:
                future = self.executor.submit(draw, *args, **kwargs)
        return future.result()


def _stand_back() -> None:
    """Let the fit go first, on whose cores this draws: the report waits for it in any case."""
    if hasattr(os, "nice"):
        os.nice(max(0, BEHIND - os.nice(0)))


def _load() -> None:
    _stand_back()
    gc.disable()  # nothing that is loaded is garbage
    for name in (
        "fitting.report.reconstruction",
        "matplotlib.backends.backend_pdf",
        "matplotlib.backends.backend_svg",
    ):
        importlib.import_module(name)
    gc.freeze()  # nor is it looked at whenever that of figures is collected
    gc.enable()


def _seen(result: Result, data: ShownCampaign) -> bytes:
    """All that figures are drawn from that no inference changes."""
    return pickle.dumps((result.peaks, result.deviations, data))


def _begin(
    result: Result, data: ShownCampaign, folder: Path, share: tuple[int, int]
) -> dict[str, Figure]:
    """A share of the figures that a fit settles: from the first on, each so many-th."""
    from fitting.report.figures.reconstruction import (
        longest_first,
        planned_figures,
        settled,
        write_figure,
    )

    _stand_back()  # also where one process has loaded for all
    planned = settled(planned_figures(result, data), data)
    own = longest_first(planned)[share[0] :: share[1]]
    return {number: write_figure(planned[number], number, folder) for number in own}


def _numbers(result: Result, data: ShownCampaign, drawn: Sequence[str]) -> list[str]:
    """Numbers of the figures that are still to be drawn, those that take longest first."""
    from fitting.report.figures.reconstruction import longest_first, planned_figures

    order = longest_first(planned_figures(result, data))
    return [number for number in order if number not in drawn]


def _draw(result: Result, data: ShownCampaign, out_dir: Path, number: str) -> Figure:
    """The figure of that number."""
    from fitting.report.figures.reconstruction import planned_figures, write_figure

    return write_figure(planned_figures(result, data)[number], number, out_dir)


def _write(result: Result, data: ShownCampaign, out_dir: Path, figures: list[Figure]) -> Path:
    """Everything but the figures."""
    from fitting.report.reconstruction import write_report_of

    return write_report_of(result, data, out_dir, figures)
