"""One posterior: what is drawn from, where walkers begin, the chain as it grows, its summary."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import version
from pathlib import Path

import numpy as np

import fitting
from fitting import Problem
from fitting.extension.problem import (
    NOTABLE,
    Inferred,
    Result,
    Structure,
    Valued,
    curve_structure,
    evaluate_many,
    fitted_noise,
    require_same_data,
    scales,
)
from fitting.extension.report import phrases
from fitting.posterior import LEAST_STEPS
from fitting.posterior.chain import (
    Chain,
    Samples,
    SamplingInterrupted,
    read_chain,
    sampled,
    sampler_library,
    write_chain,
)
from fitting.posterior.convergence import accepted_by
from fitting.posterior.minima import Target, as_likely, images_of, minima_of, polished
from fitting.posterior.mixture import UNLIKELY, Mixture, share_of
from fitting.posterior.summary import (
    CONVERGED,
    INTERRUPTED,
    NOT_CONVERGED,
    PosteriorSummary,
    Reached,
    modes_of,
    outputs_of,
    reached,
    read_outputs,
    values_of,
)
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, FmuFailure, NoAnswer, NoScale
from fitting.text.notation import listed, settings_words

#: The factor from one time at which it is asked whether there are enough draws to the next.
LONGER = 1.5
#: Share of independent draws among proposals about the minima below which a posterior is bent.
GOOD = 0.3
#: Walkers where no number is given, at least.
FEWEST = 24
#: Standard deviation of parameters, over their scales, that is as good as none.
ANY = 1e6
#: Rounds in which a walker that began where the model has no value is moved towards a minimum.
ROUNDS = 40

Tell = Callable[[str], None]


def thinned(draws: FloatArray, longest: float) -> FloatArray:
    """One in so many steps of draws (steps, walkers, n) as the longest correlation time, (k, n).

    Args:
        draws: of the chain.
        longest: correlation time, in steps.
    """
    every = max(1, math.ceil(longest)) if math.isfinite(longest) else len(draws)
    return np.asarray(draws[every - 1 :: every].reshape(-1, draws.shape[-1]))


class Job:
    """What is drawn from, where walkers begin, and what that has cost.

    Args:
        problem: What is looked for, and from what.
        at: A fit of it.
        walkers: None: as many as suit the parameters.
        steps: Of every walker, at most.
        seed: Of the draws.

    Raises:
        BadInput: another fit, too few walkers, noise that too few rows determine, or no ``emcee``.
        FmuFailure: the FMU failed where the fit ended.
    """

    def __init__(
        self, problem: Problem, at: Valued | Result, walkers: int | None, steps: int, seed: int
    ) -> None:
        sampler_library()  # complained of before anything runs
        self.steps, self.seed = steps, seed
        places = self._take_fit(problem, at)
        wanted = dict(self.alternative)
        for k, one in enumerate(problem.record.alternatives):
            if dict(one) == wanted:
                self.problem = problem.with_alternative(k)
                break
        else:
            raise BadInput(f"posterior: the problem has no alternative {settings_words(wanted)}")
        self.evaluations = self.failed = 0
        self.target = Target(
            parameters=self.problem.record.parameters, log=self._log, rows=self._rows
        )
        n = len(self.problem.names)
        self.walkers = walkers or max(FEWEST, 2 * n + 2)
        if self.walkers < 2 * n:
            raise BadInput(
                f"posterior: {self.walkers} walkers for {n} parameters, wanted at least {2 * n}"
            )
        self.structure = self._structure(places[0][1])
        if self.structure is not None and self.structure.widening > 1.0:
            self.problem = self.problem.widened(self.structure.widening, places[0][1])
        self.minima = minima_of(self.target, places)[: self.walkers]
        self.mixture = Mixture.of(self.minima)
        likely = self.target.in_units(self.minima[0].centre)
        self.images = as_likely(self.target, images_of(self.target), likely)
        #: Samples so far; where their last part was interrupted, where it ends, how it goes on.
        self.samples: Samples | None = None
        self._until: int | None = None
        self._random: FloatArray | None = None

    def _take_fit(self, problem: Problem, at: Valued | Result) -> list[tuple[str, FloatArray]]:
        """Keep values, intervals and alternative of a fit; its minima with their origins.

        Raises:
            BadInput: no fit, or that of other parameters, another FMU or other data.
        """
        self.fit: Inferred
        if isinstance(at, Valued) and at.is_stored:
            at = at.result
        if isinstance(at, Valued):
            self.fit, source, sha256 = at.inferred, at.source.record, ""
            alternatives, self.alternative = source.alternatives, source.alternative
            likely = at.fitted_values
        elif isinstance(at, Result):
            self.fit, sha256 = at, at.provenance.fmu_sha256
            alternatives, self.alternative = at.alternatives, at.alternative
            likely = dict(at.fitted_values)
        else:
            raise BadInput(
                f"posterior: found a {type(at).__name__}, wanted a Fit, an Inference or a Result"
            )
        # values of single experiments are reported as offsets from the drift: other numbers
        for name, e in self.fit.parameters.items():
            if not math.isnan(e.most_likely):
                likely[name] = e.most_likely
        self.likely = likely
        known: list[tuple[str, Mapping[str, float]]] = [("the fit", dict(likely))]
        knowledge = self.fit.knowledge
        if knowledge is not None:
            known.insert(0, ("the fit", dict(knowledge.most_likely)))
            known += [(e.origin, e.parameters) for e in knowledge.equivalents if not e.where]
        ends = [a.starts for a in alternatives if dict(a.settings) == dict(self.alternative)]
        known += [("a start of the fit", s.parameters) for starts in ends for s in starts]
        places = [
            (origin, np.array([place[n] for n in problem.names]))
            for origin, place in known
            if all(n in place for n in problem.names)
        ]
        missing = sorted(set(problem.names) ^ set(likely))
        if missing or not places:
            raise BadInput(
                f"posterior: the fit is of another problem: {listed(missing) or 'its values'} "
                "stand in one of them alone"
            )
        if sha256 and problem.has_fmu and problem.fmu.description.sha256 != sha256:
            raise BadInput(
                "posterior: the fit is of another FMU: found sha256 "
                f"{problem.fmu.description.sha256[:12]}, wanted {sha256[:12]}"
            )
        if isinstance(at, Result):
            require_same_data(at, list(problem.record.campaigns.values()), whole=True)
        return places

    def _structure(self, place: FloatArray) -> Structure | None:
        """What residuals of unknown noise show besides white noise of one size, at the fit."""
        self.problem.logl(place)  # complains of noise that too few rows tell
        if not self.problem.unknown_noise:
            return None
        objective, parameters = self.problem.objective, self.problem.record.parameters
        [point] = evaluate_many(objective, [self.problem.to_search(place)])
        matrix = self.problem.jac(place) * scales(parameters)
        noise = fitted_noise(objective, point, matrix, np.full(len(parameters), ANY))
        return curve_structure(objective, point, matrix, noise)

    # --- the posterior as a function -------------------------------------------------------------

    def _log(self, p: FloatArray) -> FloatArray:
        """ln of the posterior, (k,), where the model has a value; else -inf, and counted."""
        lower, upper = self.problem.bounds
        inside = int(np.sum(np.all((p >= lower) & (p <= upper), axis=1)))
        try:
            logs = self.problem.logp(p)
        except NoAnswer:  # every attempt would cost as much time
            raise
        except (FmuFailure, NoScale):
            if len(p) == 1:
                self.evaluations += inside
                self.failed += 1
                return np.array([-np.inf])
            return np.concatenate([self._log(row[None]) for row in p])
        self.evaluations += inside
        return logs

    def _in_box(self, u: FloatArray) -> FloatArray:
        return self._log(self.target.in_units(u))

    def _rows(self, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        self.evaluations += 2 * p.size + 1
        return self.problem.white_rows(p)

    # --- the chain -------------------------------------------------------------------------------

    def begin(self) -> tuple[FloatArray, FloatArray]:
        """Places (walkers, n) in units of the box to begin at, and ln of the posterior there.

        Draws about the minima; those that a bent posterior leaves far from them begin near the
        place of it that is next to them.
        """
        random = np.random.RandomState(self.seed % 2**32)
        places = self.mixture.spread(self.walkers, random)
        log = self._in_box(places)
        own = [m for m in self.minima if m.copy_of < 0]
        least = min(m.log for m in own) - UNLIKELY
        whose = np.argmin([m.distances(places) for m in own], axis=0)
        towards = np.array([m.centre for m in own])[whose]
        along = []
        for k in np.flatnonzero(np.isfinite(log) & (log < least)):
            near = polished(self.target, "", self.target.in_units(places[k]))
            if near is not None and near.log >= least:
                towards[k] = near.centre
                along.append(near)
                step = np.linalg.solve(near.root, random.standard_normal(places.shape[1]))
                places[k] = np.clip(near.centre + step, 0.0, 1.0)
        if along:  # proposals along it, too, which do not change once draws begin
            self.mixture = Mixture.of(self.minima).joined(Mixture.along([*self.minima, *along]))
        for _ in range(ROUNDS):
            lost = ~(log >= least)
            if not np.any(lost):
                break
            places[lost] = towards[lost] + 0.5 * (places[lost] - towards[lost])
            log[lost] = self._in_box(places[lost])
        return places, log

    def draw(self, path: Path | None, tell: Tell) -> tuple[str, Samples, Reached]:
        """Steps until there are enough, each part kept: status, samples, how far these are.

        Args:
            path: of the file; None: nothing is kept.
            tell: is called with a line of what is under way.

        Raises:
            KeyboardInterrupt: before there are steps enough for a summary.
        """
        at: Reached | None = None

        def tell_both(words: str) -> None:
            tell(f"{words}; so far {at.message}" if at else words)

        status = NOT_CONVERGED
        try:
            for samples in self._parts(tell_both):
                self._keep(path)
                at = self._reached(samples)
                tell(at.message)
                if at.converged:
                    status = CONVERGED
                    break
        except KeyboardInterrupt:
            if self._random is not None:  # in the middle of a part
                self._keep(path)
                at = None
            steps = 0 if self.samples is None else self.samples.steps
            if not steps or (path is None and steps < LEAST_STEPS):
                raise
            if steps < LEAST_STEPS:
                kept = f"interrupted; {steps} steps of every walker are kept in {path}"
                raise KeyboardInterrupt(kept) from None
            status = INTERRUPTED
        if self.samples is None:
            raise RuntimeError("a chain without a part")
        return status, self.samples, at or self._reached(self.samples)

    def _parts(self, tell: Tell) -> Iterator[Samples]:
        """The samples as they grow, from what there is."""
        if self.samples is not None and self._random is None:
            yield self.samples
        while self.samples is None or self._random is not None or self.samples.steps < self.steps:
            samples, done = self.samples, 0 if self.samples is None else self.samples.steps
            total = min(self.steps, max(LEAST_STEPS, math.ceil(LONGER * done)))
            seed: tuple[int, ...] | FloatArray = (self.seed, done)
            if self._random is not None and self._until is not None:
                total, seed = self._until, self._random
            self._random = None
            begin = self.begin() if samples is None else (samples.places[-1], samples.log[-1])
            tell(f"drawing steps {done + 1} to {total}, of {self.steps} at most")
            try:
                part = sampled(self._in_box, self.mixture, self.images, begin, total - done, seed)
            except SamplingInterrupted as early:
                self.samples = (
                    early.samples if samples is None else samples.with_more(early.samples)
                )
                self._until, self._random = total, early.random
                raise
            self.samples = part if samples is None else samples.with_more(part)
            yield self.samples

    def _keep(self, path: Path | None) -> None:
        if path is not None and self.samples is not None:
            costs = self.evaluations, self.failed
            last = (self._until, self._random) if self._random is not None else ()
            chain = Chain(self.samples, self.mixture, *costs, *last)
            write_chain(path, self._fingerprint, chain)

    def resume(self, path: Path) -> None:
        """Continue the chain of a file, if there is one.

        Args:
            path: of the file.

        Raises:
            BadInput: it is no chain, or that of another job.
        """
        chain = read_chain(path, self._fingerprint)
        if chain is not None:
            self.samples, self.mixture = chain.samples, chain.mixture
            self._until, self._random = chain.until, chain.random
            self.evaluations += chain.evaluations
            self.failed += chain.failed

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
            "alternative": settings_words(self.alternative),
            "fmu": self.problem.fmu.description.sha256 if self.problem.has_fmu else "",
            "seed": self.seed,
            "walkers": self.walkers,
            "version": fitting.__version__,
            "versions": {name: version(name) for name in ("numpy", "scipy", "emcee")},
        }
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    # --- what the draws give ---------------------------------------------------------------------

    def _reached(self, samples: Samples) -> Reached:
        """How far samples are, compared with what the fit accepts."""
        parameters = self.problem.record.parameters
        known = accepted_by(self.fit, parameters)
        blind = not all(p.name in known for p in parameters if not p.experiments)
        if blind:  # it matters where the minima alone do not show the shape of the posterior
            late = slice(samples.steps // 2, None)
            places, log = samples.places[late], samples.log[late].ravel()
            flat = places.reshape(-1, places.shape[-1])
            blind = share_of(Mixture.of(self.minima), flat, log) <= GOOD
        return reached(self.target, self.minima, samples, self.likely, None if blind else known)

    def summary(
        self, drawn: tuple[str, Samples, Reached], truth: Mapping[str, float], tell: Tell
    ) -> tuple[PosteriorSummary, dict[str, FloatArray]]:
        """The record of the draws, and derived outputs at those that are nearly independent.

        Args:
            drawn: as `draw` returns it.
            truth: by name.
            tell: is called with a line of what is under way.
        """
        status, samples, at = drawn
        record, problem = self.problem.record, self.problem
        outputs: dict[str, FloatArray] = {}
        if status == CONVERGED and self.fit.derived:
            tell("derived outputs at the draws")
            with contextlib.suppress(KeyboardInterrupt):  # the draws are there
                read = problem.objective.response.derived_many
                few = thinned(at.draws, float(np.max(at.taus)))
                outputs = read_outputs(read, few, tuple(self.fit.derived))
        summary = PosteriorSummary(
            title=record.title,
            synthetic=record.synthetic,
            status=status,
            message=at.message,
            values=values_of(self.target, at, self.fit, self.likely, truth),
            modes=modes_of(self.target, self.minima, samples, at),
            alternative=self.alternative,
            walkers=self.walkers,
            steps=samples.steps,
            discarded=at.discarded,
            evaluations=self.evaluations,
            failed=self.failed,
            accepted=samples.accepted,
            seed=self.seed,
            findings=(at.missed,) if at.missed is not None and at.is_enough else (),
            notes=phrases("posterior/text", "notes", self, NOTABLE, at.begins.tolist()),
            derived=outputs_of(outputs, self.fit.derived, truth),
            provenance={
                "FMU": problem.fmu.description.model_name if problem.has_fmu else "none",
                "versions": f"fmu-fit {fitting.__version__}, emcee {version('emcee')}, numpy "
                f"{np.__version__}",
            },
        )
        return summary, outputs
