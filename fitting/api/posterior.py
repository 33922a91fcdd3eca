"""Draws from the posterior of a problem, for those who want one beside the profiles."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

import fitting
from fitting.api.choices import LEAST_STEPS, LEAST_WALKERS, TRUTH_NAME
from fitting.api.fitted import Valued
from fitting.api.jobs import check_problem
from fitting.api.known_fit import KnownFit
from fitting.api.problem import Problem
from fitting.api.written import CHAIN_FILE, POSTERIOR_FILES
from fitting.campaign.parameters import Parameter, scales
from fitting.engine.threads import one_thread
from fitting.fit.noise import fitted_noise
from fitting.fit.objective import evaluate_many
from fitting.fit.solution import curve_structure
from fitting.inference.likelihood.knowledge import Knowledge
from fitting.inference.posterior.chain import Walk, WalkInterrupted, sampler_library, walked
from fitting.inference.posterior.first_walks import LEARNING, about_walk, evaluations
from fitting.inference.posterior.kept import Cut, Kept, keep, kept_in
from fitting.inference.posterior.learnt import TRIED, worth
from fitting.inference.posterior.minima import Target, minima_of
from fitting.inference.posterior.outputs import outputs_of, read_outputs
from fitting.inference.posterior.reach import accepted_by
from fitting.inference.posterior.start import Mixture
from fitting.inference.posterior.summary import (
    CONVERGED,
    INTERRUPTED,
    NOT_CONVERGED,
    PosteriorOutput,
    PosteriorSummary,
    PosteriorValue,
    Reached,
    modes_of,
    reached,
    values_of,
)
from fitting.lab.true_values import nearest, true_values
from fitting.report.posterior import draws_csv, write_report
from fitting.result.result import Result
from fitting.signal.residual_tests import NOTABLE, Structure
from fitting.text.arguments import checked
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, FmuFailure, NoAnswer, NoScale, did_you_mean
from fitting.text.files import write_whole
from fitting.text.notation import listed, number, settings_words, unit_text
from fitting.text.records import write_json
from fitting.text.results_folder import remove_earlier, results_folder
from fitting.text.toml import read_toml

__all__ = [
    "Posterior",
    "PosteriorCost",
    "Sampling",
    "posterior",
    "posterior_cost",
    "write_posterior",
]

#: Steps before it is first asked whether there are enough, and the factor to the next time.
FIRST, LONGER = LEAST_STEPS, 1.5
#: Share of independent draws among the proposals about the minima from which nothing is learnt.
GOOD = 0.3
#: Walkers where nothing is said, at least.
FEWEST = 24
#: Standard deviation of parameters, over their scales, that is as good as none.
ANY = 1e6
#: Rounds in which a walker that began where the model has no value is moved towards a minimum.
ROUNDS = 40


@checked
@dataclass(frozen=True, kw_only=True)
class Sampling:
    """How draws from a posterior are made: how many, from which seed.

    Args:
        walkers: How many, an even number of at least 4 and twice the parameters; None: 24, or
            2 n + 2 where these are more.
        steps: Steps of every walker, at most, 200 or more; the chain ends before where there are
            enough draws.
        seed: Of the draws, at least 0.
        resume: Whether a chain that is kept in the folder is gone on with.

    Raises:
        BadInput: a number out of its range.
    """

    walkers: int | None = None
    steps: int = 5000
    seed: int = 1
    resume: bool = False

    def __post_init__(self) -> None:
        if self.steps < FIRST:
            raise BadInput(f"Sampling: steps is {self.steps!r}, wanted at least {FIRST}")
        if self.walkers is not None and (self.walkers < LEAST_WALKERS or self.walkers % 2):
            raise BadInput(
                f"Sampling: walkers is {self.walkers!r}, wanted an even number of at least "
                f"{LEAST_WALKERS}"
            )
        if self.seed < 0:
            raise BadInput(f"Sampling: seed is {self.seed!r}, wanted at least 0")


@dataclass(frozen=True, repr=False)
class Posterior:
    """Draws from a posterior: what they say as ``summary``, and all of them.

    ``draws`` has the shape (steps, walkers, n), in the parameters' units and in the order of
    ``names``, without the beginning of the chain; a value with a period is told in the one in which
    the fit reports it. ``log`` (steps, walkers) is ln of the posterior but for a constant.
    ``outputs`` are derived outputs of the model by name, (k,), at the draws of ``thinned``, and NaN
    where it has no value. Values are told where ``status`` is "converged"; the draws are there
    always.
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
        return _thinned(self.draws, max(value.tau for value in self.values.values()))

    def __getitem__(self, name: str) -> PosteriorValue | PosteriorOutput:
        found: Mapping[str, PosteriorValue | PosteriorOutput] = {**self.derived, **self.values}
        if name not in found:
            raise KeyError(f"no value '{name}'{did_you_mean(name, sorted(found))}")
        return found[name]

    def __repr__(self) -> str:
        from fitting.report.screens import posterior_lines  # only where it is printed

        return "\n".join(posterior_lines(self.summary, verbose=True))


@dataclass(frozen=True, kw_only=True)
class PosteriorCost:
    """What draws will cost: ``evaluations`` of the model, least and most, and seconds of each.

    Of ``walkers``, from ``minima``; ``seconds_each`` was measured where the walkers begin, which is
    a batch of as many evaluations.
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
    """Draw from the posterior of a problem, from every minimum that a fit of it knows.

        p(theta | data) ~ L(theta) prior(theta)          `Problem.logp`

    The prior is uniform in the box of the parameters, with a Gaussian where one has its own. The
    chain is long enough at 50 of its correlation times, if its walkers agree (split R at most
    1.01), and draws come near every value that the fit's own profiles accept; else it is called not
    converged, and no interval is told. A bent posterior takes a fit that has profiles.

    Args:
        problem: What is looked for, and from what; noise of rows that is not known is integrated
            out.
        at: A fit of it, or what was inferred of one: walkers begin at its minima.
        options: How many walkers and steps; None: `Sampling()`.
        truth: What is true, by name, in the parameters' units: for tables and figures alone.
        out: Folder in which the chain is kept while it grows; None: nothing is written.
        progress: Is called with a line of what is under way.

    Returns:
        The draws, and medians with central intervals as ``posterior["name"]``, of derived outputs
        too.

    Raises:
        BadInput: no such fit, noise that too few rows tell, too few walkers, or ``emcee`` is
            missing.
        FmuFailure: the FMU failed where the fit ended.
    """
    asked = options or Sampling()
    job = _Job(problem, at, asked)
    folder = None if out is None else Path(out)
    if folder is None:
        return job.drawn(None, truth or {}, progress)
    with results_folder(folder, "posterior", (*POSTERIOR_FILES, CHAIN_FILE)):
        return job.drawn(folder / CHAIN_FILE, truth or {}, progress)


@checked
def posterior_cost(
    problem: Problem, at: Valued | Result, options: Sampling | None = None
) -> PosteriorCost:
    """What `posterior` will cost, from one evaluation of every walker.

    Args:
        problem: As `posterior` takes it.
        at: Likewise.
        options: Likewise.

    Raises:
        BadInput: as `posterior`.
        FmuFailure: the FMU failed where the fit ended.
    """
    asked = options or Sampling()
    job = _Job(problem, at, asked)
    set_out = job.evaluations
    begun = time.perf_counter()
    job.begin()
    each = (time.perf_counter() - begun) / (job.evaluations - set_out)
    return PosteriorCost(
        walkers=job.walkers,
        minima=sum(m.copy_of < 0 for m in job.minima),
        evaluations=(
            set_out + TRIED + job.walkers * (1 + FIRST),
            set_out + job.learning + job.walkers * (1 + asked.steps),
        ),
        seconds_each=each,
    )


def write_posterior(found: Posterior, out: str | Path, *, drawn: bool = True) -> list[Path]:
    """Write what the command line writes: posterior.json, draws.csv, a corner figure, report.html.

    Args:
        found: Draws.
        out: Folder, made where there is none.
        drawn: Whether figure and report are wanted.

    Returns:
        The paths of all files.

    Raises:
        BadInput: the folder cannot be written, or holds files of these names of others.
    """
    folder = Path(out)
    with results_folder(folder, "posterior", POSTERIOR_FILES):
        paths = [folder / "posterior.json", folder / "draws.csv"]
        write_json(paths[0], found.summary)
        write_whole(paths[1], draws_csv(found.summary, found.thinned, found.outputs))
        if drawn:
            # matplotlib takes a second to import: only where something is drawn
            drawing = importlib.import_module("fitting.report.figures.posterior")
            flat = found.draws.reshape(-1, len(found.names))
            figure = drawing.save_figure(found.summary, flat, folder / "figures")
            page = write_report(found.summary, figure, folder)
            paths += [figure.file("png"), figure.file("svg"), page]
        remove_earlier(folder, POSTERIOR_FILES)
    return paths


def truth_beside(problem: Problem, at: Result) -> dict[str, float]:
    """What is true of a synthetic campaign, by the truth.toml beside it; empty where nobody knows.

    Args:
        problem: Of campaign files.
        at: The fit, whose form of the model the truth is told in.
    """
    record = problem.record
    paths = [bound.path.parent / TRUTH_NAME for bound in record.campaigns.values()]
    if not record.synthetic or len(paths) != 1 or not paths[0].is_file():
        return {}
    reflected = bool(at.alternative.get("reflection", False))
    true = true_values(read_toml(paths[0]), reflection=reflected)
    likely = at.fitted_values
    return {n: nearest(n, v, likely.get(n, math.nan)) for n, v in true.items() if n in likely}


def _thinned(draws: FloatArray, longest: float) -> FloatArray:
    """One in so many steps of draws (steps, walkers, n) as the longest correlation time, (k, n)."""
    every = max(1, math.ceil(longest)) if math.isfinite(longest) else len(draws)
    return np.asarray(draws[every - 1 :: every].reshape(-1, draws.shape[-1]))


def _structure(problem: Problem, place: FloatArray) -> Structure | None:
    """What residuals of unknown noise do beside white noise of one size, where the fit ended.

    Raises:
        BadInput: noise that nobody knows, and the rows do not tell.
        FmuFailure: the FMU failed there.
    """
    problem.logl(place)  # complains
    if not problem.unknown_noise:
        return None
    objective, parameters = problem.objective, problem.record.parameters
    [point] = evaluate_many(objective, [problem.to_search(place)])
    matrix = problem.jac(place) * scales(parameters)
    noise = fitted_noise(objective, point, matrix, np.full(len(parameters), ANY))
    return curve_structure(objective, point, matrix, noise)


class _Job:
    """What is drawn from, where walkers begin, and what that has cost."""

    def __init__(self, problem: Problem, at: Valued | Result, asked: Sampling) -> None:
        check_problem("posterior", problem)
        sampler_library()  # complained of before anything runs
        self._fit = KnownFit.of(at, problem.names)
        self._fit.require(problem)
        self.problem = self._fit.chosen(problem)
        self.asked = asked
        self.evaluations = self.failed = 0
        self.target = Target(
            parameters=self.problem.record.parameters, log=self._log, rows=self._rows
        )
        least = 2 * len(self.problem.names)
        self.walkers = asked.walkers or max(FEWEST, least + 2)
        if self.walkers < least:
            raise BadInput(
                f"posterior: {self.walkers} walkers for {least // 2} parameters, wanted at least "
                f"{least}"
            )
        _, place = self._fit.places[0]
        self.structure = _structure(self.problem, place)
        if self.structure is not None and self.structure.widening > 1.0:
            self.problem = self.problem.widened(self.structure.widening, place)
        found = minima_of(self.target, self._fit.places)
        self.minima = found[: self.walkers]
        self.mixture = Mixture.of(self.minima)
        self.bent = False
        #: Of a part that was interrupted: the walk with its steps, and how it goes on.
        self._begun: Walk | None = None
        self._cut: Cut | None = None

    def set_out(self, progress: Callable[[str], None]) -> tuple[FloatArray, FloatArray]:
        """Where the walk begins; the mixture follows first walks where the posterior is bent.

        Args:
            progress: is called with a line.
        """
        progress("where walkers begin")
        begin, random = self.begin(), np.random.RandomState(self.asked.seed % 2**32 + 1)
        if worth(self.mixture, self._in_box, random) > GOOD:
            return begin
        self.bent, about_minima = True, self.mixture
        best = self.target.in_units(self.minima[0].centre)
        target = replace(self.target, rows=lambda p: self._rows(p, best))
        for k in range(LEARNING):
            progress(f"first walk, {k + 1} of {LEARNING}")
            first = walked(self._in_box, self.mixture, begin, FIRST, (self.asked.seed, k, 1))
            begin = first.places[-1], first.log[-1]
            self.mixture = about_walk(target, first, about_minima, self._in_box, random)
        return begin

    @property
    def learning(self) -> int:
        """Evaluations before draws begin, at most."""
        return TRIED + evaluations(self.walkers, len(self.problem.names), FIRST)

    def begin(self) -> tuple[FloatArray, FloatArray]:
        """Places (walkers, n) in units of the box to begin at, and ln of the posterior there."""
        random = np.random.RandomState(self.asked.seed % 2**32)
        places = self.mixture.spread(self.walkers, random)
        log = self._in_box(places)
        own = [m for m in self.minima if m.copy_of < 0]
        for _ in range(ROUNDS):
            lost = ~np.isfinite(log)
            if not np.any(lost):
                break
            whose = np.argmin([m.distances(places[lost]) for m in own], axis=0)
            towards = np.array([m.centre for m in own])[whose]
            places[lost] = towards + 0.5 * (places[lost] - towards)
            log[lost] = self._in_box(places[lost])
        return places, log

    def drawn(
        self, path: Path | None, truth: Mapping[str, float], progress: Callable[[str], None]
    ) -> Posterior:
        """Steps until there are enough, each part kept as it ends.

        Args:
            path: of the file; None: nothing is kept.
            truth: by name.
            progress: is called with a line.
        """
        status, found = NOT_CONVERGED, None
        walk = before = self._resumed(path)
        said = ""

        def tell(words: str) -> None:
            progress(f"{words}; so far {said}" if said else words)

        try:
            for walk in self._parts(before, tell):
                self._keep(path, walk)
                found = self._reached(walk)
                said = found.told(self.problem.names)
                progress(said)
                if found.converged:
                    status = CONVERGED
                    break
        except KeyboardInterrupt:
            if self._begun is not None:
                walk, found = self._begun, None
                self._keep(path, walk)
            if walk is None or (path is None and walk.steps < FIRST):
                raise
            if walk.steps < FIRST:
                kept = f"interrupted; {walk.steps} steps of every walker are kept in {path}"
                raise KeyboardInterrupt(kept) from None
            status = INTERRUPTED
        if walk is None:
            raise RuntimeError("a chain without a part")
        found = found or self._reached(walk)
        outputs: Mapping[str, FloatArray] = {}
        if status == CONVERGED:
            progress("derived outputs at the draws")
            with contextlib.suppress(KeyboardInterrupt):  # the draws are there
                outputs = self._outputs(found)
        derived = outputs_of(outputs, self._fit.values.derived, truth)
        return Posterior(
            summary=replace(self._summary(status, walk, found, truth), derived=derived),
            outputs=outputs,
            names=self.problem.names,
            draws=found.draws,
            log=walk.log[found.discarded :],
        )

    def _reached(self, walk: Walk) -> Reached:
        """How far a walk is, held against what the fit accepts."""
        parameters = self.problem.record.parameters
        known = accepted_by(self._fit.values, parameters)
        shared = [p.name for p in parameters if not p.experiments]
        blind = self.bent and not all(name in known for name in shared)
        accepted = None if blind else known
        return reached(self.target, self.minima, walk, self._fit.most_likely, accepted)

    def _outputs(self, found: Reached) -> dict[str, FloatArray]:
        """Derived outputs that the fit has, at draws that are nearly independent, (k,) each."""
        read = self.problem.objective.response.derived_many
        draws, names = _thinned(found.draws, float(np.max(found.taus))), self._fit.values.derived
        return read_outputs(read, draws, tuple(names)) if names else {}

    def _parts(self, walk: Walk | None, progress: Callable[[str], None]) -> Iterator[Walk]:
        """The walk as it grows, from what there is."""
        if walk is not None and self._cut is None:
            yield walk
        while walk is None or self._cut is not None or walk.steps < self.asked.steps:
            done = 0 if walk is None else walk.steps
            cut, self._cut = self._cut, None
            total = min(self.asked.steps, max(FIRST, math.ceil(LONGER * done)))
            total = total if cut is None else cut.steps
            begin = self.set_out(progress) if walk is None else (walk.places[-1], walk.log[-1])
            seed = (self.asked.seed, done) if cut is None else cut.random
            progress(f"drawing steps {done + 1} to {total}, of {self.asked.steps} at most")
            try:
                part = walked(self._in_box, self.mixture, begin, total - done, seed)
            except WalkInterrupted as early:
                self._begun = early.walk if walk is None else walk.with_more(early.walk)
                self._cut = Cut(total, early.random)
                raise
            walk = part if walk is None else walk.with_more(part)
            yield walk

    def _keep(self, path: Path | None, walk: Walk) -> None:
        """Replace the file of the chain, if there is to be one."""
        if path is not None:
            costs = self.evaluations, self.failed
            kept = Kept(walk, self.mixture, self.bent, *costs, self._cut)
            keep(path, self._fingerprint, kept)

    def _resumed(self, path: Path | None) -> Walk | None:
        if path is None or not self.asked.resume:
            return None
        kept = kept_in(path, self._fingerprint)
        if kept is None:
            return None
        self.mixture, self.bent, self._cut = kept.mixture, kept.bent, kept.cut
        self.evaluations += kept.evaluations
        self.failed += kept.failed
        return kept.walk

    def _log(self, p: FloatArray) -> FloatArray:
        """ln of the posterior, (k,), where the model has a value; else -inf, and counted."""
        lower, upper = self.problem.bounds
        inside = int(np.sum(np.all((p >= lower) & (p <= upper), axis=1)))
        try:
            found = self.problem.logp(p)
        except NoAnswer:  # every attempt would cost as much time
            raise
        except (FmuFailure, NoScale):
            if len(p) == 1:
                self.evaluations += inside
                self.failed += 1
                return np.array([-np.inf])
            return np.concatenate([self._log(row[None]) for row in p])
        self.evaluations += inside
        return found

    def _in_box(self, u: FloatArray) -> FloatArray:
        return self._log(self.target.in_units(u))

    def _rows(
        self, p: FloatArray, scatter_at: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        more = scatter_at is not None and bool(self.problem.unknown_noise)
        self.evaluations += 2 * p.size + 1 + more
        return self.problem.white_rows(p, scatter_at)

    @property
    def _fingerprint(self) -> str:
        """Of all that the draws depend on."""
        record = self.problem.record
        arrays = [record.data.sigma, record.data.measured_rows, *self.problem.bounds]
        arrays += [m.centre for m in self.minima]
        digests = [hashlib.sha256(np.ascontiguousarray(a).tobytes()).hexdigest() for a in arrays]
        content = {
            "arrays": digests,
            "names": self.problem.names,
            "alternative": settings_words(self._fit.alternative),
            "fmu": self.problem.fmu.description.sha256 if self.problem.has_fmu else "",
            "seed": self.asked.seed,
            "walkers": self.walkers,
            "version": fitting.__version__,
            "versions": {name: version(name) for name in ("numpy", "scipy", "emcee")},
        }
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def _summary(
        self, status: str, walk: Walk, found: Reached, truth: Mapping[str, float]
    ) -> PosteriorSummary:
        beside = {"most_likely": self._fit.most_likely, "truth": truth}
        record = self.problem.record
        return PosteriorSummary(
            title=record.title,
            synthetic=record.synthetic,
            status=status,
            message=found.told(self.problem.names),
            values=values_of(self.target, found, self._fit.values, beside),
            modes=modes_of(self.target, self.minima, walk, found),
            alternative=self._fit.alternative,
            walkers=self.walkers,
            steps=walk.steps,
            discarded=found.discarded,
            evaluations=self.evaluations,
            failed=self.failed,
            accepted=walk.accepted,
            seed=self.asked.seed,
            findings=found.findings if found.is_enough else (),
            notes=(*self._notes(), *_of_periods(record.parameters, found.begins)),
            provenance={
                "FMU": self.problem.fmu.description.model_name if self.problem.has_fmu else "none",
                "versions": f"fmu-fit {fitting.__version__}, emcee {version('emcee')}, numpy "
                f"{np.__version__}",
            },
        )

    def _notes(self) -> Iterator[str]:
        """What a reader must know of this posterior."""
        record, knowledge = self.problem.record, self._fit.values.knowledge
        held = [p.name for p in record.parameters if p.prior_sigma]
        prior = "The prior is uniform within the bounds of the parameters"
        told = f"; {listed(held)} have a Gaussian prior inside of it" if len(held) > 1 else ""
        told = told or (f"; {held[0]} has a Gaussian prior inside of it" if held else "")
        yield f"{prior}{told}."
        inside = record.data.solved_inside
        if inside:
            yield (
                "Not drawn, but at their best at every draw: values that measurements are solved "
                f"for inside, as scales, gains and backgrounds, {inside} in all."
            )
        if record.data.outliers == "huber":
            yield "Noise is taken for Gaussian; the fit counts what is far off less than that."
        if self.problem.unknown_noise:
            yield (
                "Noise that was not stated has one size, which is integrated out with the prior "
                "1/σ."
            )
        if self.structure is not None and self.structure.widening > NOTABLE:
            found, wider = listed(self.structure.found), number(self.structure.widening, 3)
            yield (
                f"The residuals of the fit {found}: its errors are {wider} times as wide for it, "
                "and so are draws about it."
            )
        if self.failed:
            yield (
                f"{self.failed} of {self.evaluations} evaluations had no value of the model, which "
                "counts as impossible."
            )
        if knowledge is not None:
            yield from _of_fit(knowledge)


def _of_periods(parameters: Sequence[Parameter], begins: FloatArray) -> Iterator[str]:
    """In which period values are told that have one."""
    for p, begin in zip(parameters, begins.tolist(), strict=True):
        if p.period is not None:
            unit = f" {unit_text(p.unit)}" if p.unit else ""
            yield (
                f"{p.name} has a period: draws, minima and intervals are given in the "
                f"one from {number(begin, 4)} to {number(begin + p.period, 4)}{unit}."
            )


def _of_fit(knowledge: Knowledge) -> Iterator[str]:
    """What the fit said that bears on draws."""
    if not knowledge.adequacy.gives_values:
        yield (
            f"{knowledge.adequacy.why_not.capitalize()}: draws hold for its parameters only if "
            "it does."
        )
    if knowledge.inflation > 1.0:
        yield (
            f"The fit widens its errors by {number(knowledge.inflation, 3)} for residuals beyond "
            "the stated noise; draws take that noise as it is stated."
        )
    others = dict.fromkeys(e.where for e in knowledge.equivalents if e.where)
    for where in others:
        yield f"Another form of the model fits as well and is not drawn from: {where}."
