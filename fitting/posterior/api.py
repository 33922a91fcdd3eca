"""Draws from the posterior of a problem, for those who want one besides the profiles."""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fitting import Problem
from fitting.extension.problem import Result, Valued, one_thread
from fitting.extension.report import (
    Figure,
    Table,
    exact_text,
    phrase,
    printed_lines,
    table,
    write_page,
)
from fitting.posterior import CHAIN_FILE, FILES, LEAST_STEPS, LEAST_WALKERS
from fitting.posterior.chain import Chain
from fitting.posterior.summary import (
    CONVERGED,
    PosteriorOutput,
    PosteriorSummary,
    PosteriorValue,
    outputs_of,
    summary_of,
)
from fitting.text.arguments import checked
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, did_you_mean
from fitting.text.notation import unit_text, with_unit
from fitting.text.old_names import renamed
from fitting.text.records import write_json
from fitting.text.results_folder import remove_earlier, results_folder, write_whole
from fitting.text.tables import csv_text

__all__ = [
    "Posterior",
    "PosteriorCost",
    "Sampling",
    "posterior",
    "posterior_cost",
    "write_posterior",
]


@checked
@dataclass(frozen=True, kw_only=True)
class Sampling:
    """Draws from a posterior: how many, from which seed.

    Args:
        walkers: Even, at least 4 and twice the parameters; None: 24, or 2 n + 2 if that is more.
        steps: Most steps of every walker, at least 200; fewer where these are enough.
        seed: Of the draws, at least 0.
        resume: Whether a chain in the folder is continued.

    Raises:
        BadInput: a number out of its range.
    """

    walkers: int | None = None
    steps: int = 5000
    seed: int = 1
    resume: bool = False

    def __post_init__(self) -> None:
        if self.steps < LEAST_STEPS:
            raise BadInput(f"Sampling: steps is {self.steps!r}, wanted at least {LEAST_STEPS}")
        if self.walkers is not None and (self.walkers < LEAST_WALKERS or self.walkers % 2):
            raise BadInput(
                f"Sampling: walkers is {self.walkers!r}, wanted an even number of at least "
                f"{LEAST_WALKERS}"
            )
        if self.seed < 0:
            raise BadInput(f"Sampling: seed is {self.seed!r}, wanted at least 0")


@dataclass(frozen=True, repr=False)
class Posterior:
    """Draws from a posterior: their ``summary``, and all of them.

    ``draws`` (steps, walkers, n) in the parameters' units, order ``names``, without the chain's
    beginning, periodic values in the period of the fit; ``log`` (steps, walkers): ln of the
    posterior but for a constant; ``outputs``: derived outputs by name at ``thinned`` draws, (k,),
    NaN without a value. Values are reported where ``status`` is "converged".
    """

    summary: PosteriorSummary
    names: tuple[str, ...]
    draws: FloatArray
    log: FloatArray
    outputs: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def status(self) -> str:
        """Whether there are enough draws: "converged", "not converged" or "interrupted"."""
        return self.summary.status

    @property
    def message(self) -> str:
        """Why it is that, a sentence."""
        return self.summary.message

    @property
    def values(self) -> Mapping[str, PosteriorValue]:
        """Every parameter by name."""
        return self.summary.values

    @property
    def derived(self) -> Mapping[str, PosteriorOutput]:
        """Every derived output by name; none where the draws have not converged."""
        return self.summary.derived

    @property
    def thinned(self) -> FloatArray:
        """Draws that are nearly independent, (k, n): one in so many steps as τ is at most."""
        longest = max(value.tau for value in self.values.values())
        every = math.ceil(min(longest, len(self.draws)))
        return np.asarray(self.draws[every - 1 :: every].reshape(-1, len(self.names)))

    def __getitem__(self, name: str) -> PosteriorValue | PosteriorOutput:
        values: Mapping[str, PosteriorValue | PosteriorOutput] = {**self.derived, **self.values}
        if name not in values:
            raise KeyError(f"no value '{name}'{did_you_mean(name, sorted(values))}")
        return values[name]

    def __repr__(self) -> str:
        return "\n".join(screen_lines(self.summary, verbose=True))


@dataclass(frozen=True, kw_only=True)
class PosteriorCost:
    """Expected cost of draws: ``evaluations`` of the model, least and most, ``seconds_each``.

    With ``walkers`` from ``minima``, as measured over a batch at their start.
    """

    walkers: int
    minima: int
    evaluations: tuple[int, int]
    seconds_each: float

    @property
    def seconds(self) -> tuple[float, float]:
        """Least and most, s."""
        least, most = self.evaluations
        return least * self.seconds_each, most * self.seconds_each


@checked
@one_thread()
def posterior(
    problem: Problem,
    at: Valued | Result,
    options: Sampling | None = None,
    *,
    truth: Mapping[str, float] | None = None,
    out: str | Path | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Posterior:
    """Draw from the posterior of a problem, from every minimum of a fit of it.

        p(theta | data) ~ L(theta) prior(theta)          `Problem.logp`

    The chain has converged at 50 correlation times, if its walkers agree (split R at most 1.01) and
    draws are near every value that the fit's profiles accept; else no interval is reported. A bent
    posterior needs a fit with profiles.

    Args:
        problem: The problem; unknown noise is integrated out.
        at: A fit or inference of it: walkers start at its minima.
        options: Walkers and steps; None: `Sampling()`.
        truth: True values by name, in the parameters' units, for tables and figures.
        out: Folder for the growing chain; None: nothing is written.
        progress: Called with a line at every step.

    Returns:
        The draws; ``posterior["name"]`` has median and central intervals, of derived outputs too.

    Raises:
        BadInput: no such fit, noise that too few rows determine, too few walkers, or ``emcee`` is
            missing.
        FmuFailure: the FMU failed where the fit ended.
    """
    sampling = options or Sampling()
    chain = Chain(problem, at, sampling.walkers, sampling.steps, sampling.seed)
    path = None if out is None else Path(out) / CHAIN_FILE
    true, so_far = truth or {}, ""
    folder = (
        nullcontext()
        if path is None
        else results_folder(path.parent, "posterior", (*FILES, CHAIN_FILE))
    )
    with folder:
        if path is not None and sampling.resume:
            chain.resume(path)
        try:
            for total in chain.tests():
                done = chain.sampler.iteration
                if total > done:
                    words = f"drawing steps {done + 1} to {total}, of {chain.steps} at most"
                    progress(words + so_far)
                    chain.sample(total, path)
                summary = summary_of(chain, true)
                so_far = f"; so far {summary.message}"
                progress(summary.message)
                if summary.status == CONVERGED:
                    break
        except KeyboardInterrupt:
            steps = chain.sampler.iteration
            if steps < LEAST_STEPS:
                kept = f"interrupted; {steps} steps of every walker are kept in {path}"
                raise KeyboardInterrupt(kept if path is not None and steps else "") from None
            summary = summary_of(chain, true, interrupted=True)
        log = chain.sampler.get_log_prob(discard=chain.discarded)
        drawn = Posterior(summary, chain.problem.names, chain.draws, log)
        if summary.status == CONVERGED and chain.fit.derived:
            progress("derived outputs at the draws")
            with suppress(KeyboardInterrupt):  # the draws are there
                derived, outputs = outputs_of(chain, drawn.thinned, true)
                drawn = replace(drawn, summary=replace(summary, derived=derived), outputs=outputs)
        return drawn


@checked
def posterior_cost(
    problem: Problem, at: Valued | Result, options: Sampling | None = None
) -> PosteriorCost:
    """Expected cost of `posterior`, from one evaluation of every walker.

    Args:
        problem: The problem; unknown noise is integrated out.
        at: A fit or inference of it: walkers start at its minima.
        options: Walkers and steps; None: `Sampling()`.

    Raises:
        BadInput: as `posterior`.
        FmuFailure: the FMU failed where the fit ended.
    """
    sampling = options or Sampling()
    chain = Chain(problem, at, sampling.walkers, sampling.steps, sampling.seed)
    before, started = chain.target.evaluations, time.perf_counter()
    chain.target.log(chain.start.coords)
    least = before + chain.walkers * LEAST_STEPS
    return PosteriorCost(
        walkers=chain.walkers,
        minima=len({m.valley for m in chain.minima}),
        evaluations=(least, before + chain.walkers * sampling.steps),
        seconds_each=(time.perf_counter() - started) / chain.walkers,
    )


@renamed
def write_posterior(result: Posterior, out: str | Path, *, drawn: bool = True) -> list[Path]:
    """Write posterior.json, draws.csv, a corner figure and report.html, as the command does.

    Args:
        result: Of `posterior`.
        out: Folder, made where there is none.
        drawn: Whether figure and report are written.

    Returns:
        The files.

    Raises:
        BadInput: the folder cannot be written, or holds other files of these names.
    """
    folder = Path(out)
    with results_folder(folder, "posterior", FILES):
        paths = [folder / "posterior.json", folder / "draws.csv"]
        write_json(paths[0], result.summary)
        units = {**result.values, **{name: result.derived[name] for name in result.outputs}}
        heads = [with_unit(name, unit_text(v.unit)) for name, v in units.items()]
        rows = np.column_stack([result.thinned, *result.outputs.values()]).tolist()
        cells = ([exact_text(v) if math.isfinite(v) else "" for v in row] for row in rows)
        write_whole(paths[1], csv_text([heads, *cells]))
        if drawn:
            # matplotlib takes a second to import: only where something is drawn
            drawing = importlib.import_module("fitting.posterior.figure")
            flat = result.draws.reshape(-1, len(result.names))
            figure = drawing.save_figure(result.summary, flat, folder / "figures")
            paths += [*figure.files, _write_report(result.summary, figure, folder)]
        remove_earlier(folder, FILES)
    return paths


def _write_report(summary: PosteriorSummary, figure: Figure, folder: Path) -> Path:
    return write_page(
        folder,
        "posterior/page.html.j2",
        title=summary.title,
        kind="posterior",
        status=summary.status,
        message=phrase("posterior/text", "ending", summary),
        mark="" if summary.status == CONVERGED else "bad",
        synthetic=summary.synthetic,
        figures=[figure],
        posterior=summary,
        tables=tables_of(summary),
    )


def tables_of(summary: PosteriorSummary, *, short: bool = False) -> list[Table]:
    """Parameters, derived outputs and minima, those that there are.

    Args:
        summary: of the draws.
        short: whether the first one has no columns on convergence.
    """
    tables = [table("posterior/posterior", rows=summary.values, title="Values", short=short)]
    if summary.derived:
        rows, title = summary.derived, "Derived outputs"
        tables.append(table("posterior/posterior", rows=rows, title=title, outputs=True))
    if len(summary.modes) > 1:
        tables.append(table("posterior/minima", posterior=summary))
    return tables


def screen_lines(
    summary: PosteriorSummary, files: Sequence[Path] = (), *, again: str = "", verbose: bool = False
) -> list[str]:
    """What `fmu-fit posterior` prints: values with intervals, and how to continue.

    Args:
        summary: the draws, summarised.
        files: that were written, the report last.
        again: the command that continues; empty where there are enough draws.
        verbose: whether convergence, outputs and minima are printed.
    """
    short, tables = tables_of(summary, short=True)[0], tables_of(summary)
    return printed_lines("posterior/text", "screen", summary, short, tables, verbose, again, files)
