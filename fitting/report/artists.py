"""Processes that draw a report: they load what they draw with while others wait for an FMU.

Nothing here loads a library that draws, as the process that asks has no need of one.
"""

from __future__ import annotations

import gc
import importlib
from concurrent.futures import Executor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fitting.text.files import write_whole
from fitting.text.scratch import Scratch

if TYPE_CHECKING:  # a process that draws loads them with all the rest
    from fitting.report.figures.file import FigureFile
    from fitting.report.shown import ShownCampaign
    from fitting.result.result import Result


@dataclass(frozen=True)
class Artists:
    """So many processes that draw side by side."""

    executor: Executor
    count: int

    def get_ready(self) -> None:
        """Have them load what they draw with, which takes seconds."""
        for _ in range(self.count):
            self.executor.submit(_load)

    def report(self, result: Result, data: ShownCampaign, out_dir: Path) -> Path:
        """The same report as of one process; the path of its page.

        Args:
            result: of a reconstruction.
            data: what is shown of the campaign.
            out_dir: where the files go.

        Raises:
            BadInput: the folder cannot be written.
            BrokenExecutor: a process was lost.
        """
        with Scratch() as folder:
            there = folder / "report"
            places = self.executor.submit(_places, result, data).result()
            # whoever is free takes the next one
            asked = {k: self.executor.submit(_draw, result, data, there, k) for k in places}
            try:
                figures = [asked[k].result() for k in sorted(places)]
            finally:  # where one failed, the others are to end before their folder does
                for future in asked.values():
                    future.cancel()
                wait(asked.values())
            page = self.executor.submit(_write, result, data, there, figures).result()
            # this process knows which files of a folder are its own to replace
            for path in sorted(path for path in there.rglob("*") if path.is_file()):
                write_whole(out_dir / path.relative_to(there), path.read_bytes())
            return out_dir / page.name


def _load() -> None:
    gc.disable()  # nothing that is loaded is garbage
    for name in (
        "fitting.report.reconstruction",
        "fitting.report.interactive.document",
        "matplotlib.backends.backend_pdf",
        "matplotlib.backends.backend_svg",
    ):
        importlib.import_module(name)
    gc.freeze()  # nor is it looked at whenever that of figures is collected
    gc.enable()


def _places(result: Result, data: ShownCampaign) -> list[int]:
    """Places of all figures on the page, those that take longest first."""
    from fitting.report.figures.reconstruction import longest_first, planned_figures

    return longest_first(planned_figures(result, data))


def _draw(result: Result, data: ShownCampaign, out_dir: Path, place: int) -> FigureFile:
    """The figure at that place."""
    from fitting.report.figures.reconstruction import planned_figures, write_figure

    return write_figure(planned_figures(result, data)[place], out_dir)


def _write(result: Result, data: ShownCampaign, out_dir: Path, figures: list[FigureFile]) -> Path:
    """Everything but the figures."""
    from fitting.report.reconstruction import write_report_of

    return write_report_of(result, data, out_dir, figures)
