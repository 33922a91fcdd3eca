"""The chain of a posterior: where walkers start, how they move, its file; the one import of emcee.

Walkers start at every minimum that the fit knows, at images of it under symmetries that a model
may have, and at minima below the best of some random points. Some steps propose a point of a
mixture of Student's t, one about each of these places, or an image of the walker; the others are
stretches (Goodman and Weare) and differences of walkers (ter Braak), which need no shape:

    q(p) = sum_k w_k t_5(p; c_k, R_k)        ln t_5 = ln |det R| - (5 + n)/2 ln(1 + |R (p - c)|^2/5)

R is a root of the information about the place c, R^T R its inverse covariance. Each move leaves the
posterior as it is, whatever mixture and images are worth.

Sources: D. Foreman-Mackey, D. Hogg, D. Lang, J. Goodman, PASP 125 (2013) 306; C. ter Braak,
Statistics and Computing 16 (2006) 239; L. Tierney, Annals of Statistics 22 (1994) 1701.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import logsumexp, softmax

import fitting
from fitting import Problem
from fitting.extension.problem import (
    UNIFORM_WIDTH,
    Inferred,
    Result,
    Structure,
    Valued,
    answered_apart,
    curve_structure,
    evaluate_many,
    fitted_noise,
    require_same_data,
    scales,
)
from fitting.posterior import LEAST_STEPS
from fitting.text.arrays import FloatArray, IntArray
from fitting.text.errors import BadInput, MissingFile
from fitting.text.files import read_whole
from fitting.text.journal import OTHER_JOB
from fitting.text.notation import listed, settings_words
from fitting.text.results_folder import write_whole

#: Shares of steps by the mixture, by images, by stretches, by differences.
SHARES = {"mixture": 0.4, "image": 0.1, "stretch": 0.25, "difference": 0.25}
#: The factor from one number of steps at which convergence is tested to the next.
LONGER = 1.5
#: Walkers where no number is given, at least.
FEWEST = 24
#: Degrees of freedom of Student's t.
DOF = 5.0
#: Share of proposals that all minima have in equal parts, however unlike their masses.
EQUAL = 0.5
#: A minimum that is this much less likely (ln) than the best is none to start from.
UNLIKELY = 20.0
#: Gauss-Newton steps to a minimum at most; one that gains less than so much of ln is the last.
MOST_DESCENTS, GAIN = 8, 0.01
#: Random points within the bounds, and how many of the best, and of the best images, are followed.
SCREENED, FOLLOWED = 128, 8
#: By how much ln may fall between places of one valley, and rise next to one.
DIP, RISE = 2.0, 0.25
#: Share of the way to another place of a valley that each step takes, and the most steps.
STRIDE, MOST_STRIDES = 0.25, 16
#: Share of a chain that is left out at its beginning.
LEFT_OUT = 0.2
#: Standard deviation of parameters, over their scales, that is as good as none.
UNBOUNDED = 1e6

#: Parameters (..., n) to their images.
Image = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True)
class Minimum:
    """A minimum, or another place of its valley.

    `centre` (n,) in the parameters' units; `root` R (n, n) of the information there; `log` ln of
    the posterior; `origin` how it is known; `valley` the number of the minimum that it belongs to.
    """

    centre: FloatArray
    root: FloatArray
    log: float
    origin: str
    valley: int = -1


@dataclass(frozen=True)
class Mixture:
    """A mixture: `centres` (K, n), `roots` (K, n, n) upper triangular, `weights` (K,) of sum 1."""

    centres: FloatArray
    roots: FloatArray
    weights: FloatArray

    def draw(self, whose: IntArray, random: np.random.RandomState) -> FloatArray:
        """A point about each place of a list, (k, n); not all need be within the bounds.

        Args:
            whose: numbers of the places, (k,).
            random: source of the draws.
        """
        normal = random.standard_normal((len(whose), self.centres.shape[1], 1))
        steps = np.linalg.solve(self.roots[whose], normal)[..., 0]
        wide = np.sqrt(DOF / random.chisquare(DOF, len(whose)))
        return np.asarray(self.centres[whose] + wide[:, None] * steps)

    def log_density(self, p: FloatArray) -> FloatArray:
        """ln q, (k,), but for a constant.

        Args:
            p: points, (k, n).
        """
        rotated = (p - self.centres[:, None]) @ np.swapaxes(self.roots, 1, 2)
        sizes = np.linalg.slogdet(self.roots)[1]
        logs = -0.5 * (DOF + p.shape[1]) * np.log1p(np.sum(rotated**2, axis=2) / DOF)
        return np.asarray(logsumexp(logs + (np.log(self.weights) + sizes)[:, None], axis=0))


class Target:
    """A posterior as a function of parameters, each that has a period in one period of it.

    Args:
        problem: whose posterior it is.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem, self.parameters = problem, problem.record.parameters
        self.evaluations = self.failed = 0
        #: What is drawn: from `lower` to `lower + width`, (n,) each.
        self.lower, upper = problem.bounds
        self.period = np.array([p.period or math.nan for p in self.parameters])
        wide = upper - self.lower
        whole = np.isclose(wide, self.period) | (wide > self.period)
        self.width = np.where(whole, self.period, wide)

    def in_period(self, p: FloatArray, lower: FloatArray | None = None) -> FloatArray:
        """Parameters (..., n), each that has a period in the one that is drawn.

        Args:
            p: in their units.
            lower: where periods begin instead, (n,).
        """
        begin = self.lower if lower is None else lower
        off = p - begin
        return np.where(np.isfinite(self.period), begin + np.mod(off, self.period), p)

    def apart(self, p: FloatArray, centre: FloatArray) -> FloatArray:
        """Differences p - centre, (..., n); the shortest way round of each that has a period.

        Args:
            p: parameters, (..., n).
            centre: likewise.
        """
        off = np.asarray(p - centre)
        around = off - self.period * np.round(off / self.period)
        return np.where(self.width == self.period, around, off)

    def distance(self, minimum: Minimum, p: FloatArray) -> FloatArray:
        """|R (p - c)|, (...): distances of parameters from a minimum in standard deviations.

        Args:
            minimum: from which.
            p: parameters, (..., n).
        """
        off = self.apart(p, minimum.centre)
        return np.asarray(np.linalg.norm(off @ minimum.root.T, axis=-1))

    def within(self, p: FloatArray) -> FloatArray:
        """The same parameters (..., n) within the bounds of the problem.

        Args:
            p: parameters, (..., n).
        """
        lower, upper = self.problem.bounds
        return np.clip(self.in_period(p, lower), lower, upper)

    def log(self, p: FloatArray) -> FloatArray:
        """ln of the posterior, (k,); -inf beyond the bounds and where the model has no value.

        Args:
            p: parameters, (k, n).
        """
        inside = np.all((p >= self.lower) & (p <= self.lower + self.width), axis=1)

        def no_value(place: FloatArray, failure: Exception) -> float:
            self.failed += 1
            return -math.inf

        logs = np.full(len(p), -math.inf)
        if np.any(inside):
            self.evaluations += int(np.sum(inside))
            logs[inside] = answered_apart(
                lambda ps: self.problem.logp(np.array(ps)).tolist(),
                list(self.within(p[inside])),
                no_value,
            )
        return logs

    def minimum(self, origin: str, place: FloatArray) -> Minimum | None:
        """The minimum near a place; None where the model has no value.

        Args:
            origin: how the place is known.
            place: parameters, (n,).
        """
        upper = self.lower + self.width
        p = np.clip(self.in_period(place), self.lower, upper)
        log, gain = float(self.log(p[None])[0]), math.inf
        if not math.isfinite(log):
            return None
        for descent in range(MOST_DESCENTS + 1):
            residuals, slopes = self.problem.white_rows(self.within(p))
            self.evaluations += 2 * p.size + 1
            # bounds count as a uniform distribution: no step along what no data constrain
            whole = np.vstack([slopes * self.width, UNIFORM_WIDTH * np.eye(p.size)])
            if gain < GAIN or descent == MOST_DESCENTS:
                break
            # the step of Gauss and Newton and shorter ones, tried together
            step = np.linalg.lstsq(whole, np.append(-residuals, 0.0 * p))[0] * self.width
            shorter = p + 0.5 ** np.arange(6.0)[:, None] * step
            tried = np.clip(self.in_period(shorter), self.lower, upper)
            logs = self.log(tried)
            best = int(np.argmax(logs))
            gain = float(logs[best]) - log
            if gain > 0.0:
                p, log = tried[best], float(logs[best])
        root = np.asarray(np.linalg.qr(whole, mode="r") / self.width)
        return Minimum(centre=p, root=root, log=log, origin=origin)

    def images(self) -> list[tuple[str, Image]]:
        """Symmetries that a model may have, each by its name.

        Half periods and reflections of a parameter, exchanges of two of one unit, and both. They
        preserve volumes, and each is its own inverse but for whole periods: proposals of images
        leave any posterior as it is.
        """
        shared = [(i, p) for i, p in enumerate(self.parameters) if not p.experiments]
        n, axes = len(self.width), np.eye(len(self.width))
        turns = [("", np.ones(n), np.zeros(n))]
        for i, p in shared:
            if p.period is not None:
                half = 0.5 * p.period * axes[i]
                turns.append((f"{p.name} half a period off", np.ones(n), half))
                turns += [(f"{p.name} reflected", 1.0 - 2.0 * axes[i], k * half) for k in (0, 1)]
        orders = [("", np.arange(n))]
        for (i, p), (k, q) in combinations(shared, 2):
            if (p.unit, p.period) == (q.unit, q.period):
                order = np.arange(n)
                order[[i, k]] = k, i
                orders.append((f"{p.name} and {q.name} exchanged", order))
        return [
            (f"{exchange}, {turn}".strip(", "), partial(self._image, order, sign, shift))
            for exchange, order in orders
            for turn, sign, shift in turns
            if exchange or turn
        ]

    def _image(
        self, order: IntArray, sign: FloatArray, shift: FloatArray, p: FloatArray
    ) -> FloatArray:
        return self.in_period(sign * p[..., order] + shift)

    def minima(self, known: Sequence[tuple[str, FloatArray]]) -> list[Minimum]:
        """The minima to start from, the most likely first, with the places of their valleys.

        From then on each value with a whole period is drawn in the period whose ends are the
        farthest from them, counted from the value that the fit reports.

        Args:
            known: places (n,) in the parameters' units with their origin, that of the fit first.

        Raises:
            BadInput: none of them is possible.
        """
        minima: list[Minimum] = []
        for origin, place in (*known, *self._further(known[0][1])):
            new = self.minimum(origin, place)
            # one that is listed already keeps its first origin
            if new is None or any(self.distance(m, new.centre) <= 1.0 for m in minima):
                continue
            # where ln rises within a standard deviation is no minimum, but a maximum of chi square
            steps = np.linalg.solve(new.root, np.eye(place.size)).T
            around = self.log(self.in_period(new.centre + np.vstack([steps, -steps])))
            if not minima or np.max(around) < new.log + RISE:
                minima.append(new)
        if not minima:
            raise BadInput("posterior: the model has no value where the fit ended, wanted another")
        minima.sort(key=lambda m: -m.log)
        minima = [m for m in minima if m.log > minima[0].log - UNLIKELY]
        valleys: list[int] = []
        for k, m in enumerate(minima):
            joined = {k}
            for i in range(k):
                if valleys[i] not in joined and self._is_one_valley(minima[i], m):
                    joined.add(valleys[i])
            valleys = [min(joined) if v in joined else v for v in (*valleys, k)]
        for axis in np.flatnonzero(np.isfinite(self.period)):
            period, cut = self.period[axis], self.lower[axis]
            if self.width[axis] == period:
                angles = np.sort([np.mod(m.centre[axis], period) for m in minima])
                gaps = np.diff(angles, append=angles[0] + period)
                cut = angles[np.argmax(gaps)] + 0.5 * np.max(gaps)
            reported = np.mod(known[0][1][axis], period)
            self.lower[axis] = cut + period * np.floor((reported - cut) / period)
        return [
            replace(m, centre=self.in_period(m.centre), valley=v)
            for m, v in zip(minima, valleys, strict=True)
        ]

    def _further(self, place: FloatArray) -> Iterator[tuple[str, FloatArray]]:
        """The most likely images of a place, and the most likely ones of some random points."""
        points = np.random.default_rng(1).random((SCREENED, len(self.width)))
        images = [(name, image(place)) for name, image in self.images()]
        scattered = [("a point of the box", self.lower + self.width * u) for u in points]
        for places in (images, scattered):
            logs = self.log(np.array([p for _, p in places]).reshape(-1, place.size))
            for k in np.argsort(-logs, kind="stable")[:FOLLOWED]:
                if np.isfinite(logs[k]):
                    yield places[k]

    def _is_one_valley(self, one: Minimum, other: Minimum) -> bool:
        """Whether short steps lead from one to the other, each followed down to the valley.

        From one of two wells each step falls back.
        """
        place = one
        for _ in range(MOST_STRIDES):
            if self.distance(other, place.centre) <= 1.0:
                return True
            way = self.apart(other.centre, place.centre)
            step = self.minimum("", place.centre + STRIDE * way)
            if step is None or step.log < min(one.log, other.log) - DIP:
                return False
            place = step
        return False


class Chain:
    """What is drawn from, where walkers start, and the steps so far.

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
        self.fit: Inferred
        self.problem = problem
        _emcee()  # complained of before anything runs
        self.steps, self.seed = steps, seed
        places = self._take_fit(problem, at)
        n = len(problem.names)
        self.walkers = walkers or max(FEWEST, 2 * n + 2)
        if self.walkers < 2 * n:
            raise BadInput(
                f"posterior: {self.walkers} walkers for {n} parameters, wanted at least {2 * n}"
            )
        self.problem.logl(places[0][1])  # complains of noise that too few rows determine
        #: What residuals of unknown noise show besides white noise of one size, at the fit.
        self.structure = self._structure(places[0][1]) if self.problem.unknown_noise else None
        if self.structure is not None and self.structure.widening > 1.0:
            self.problem = self.problem.widened(self.structure.widening, places[0][1])
        self.target = target = Target(self.problem)
        self.minima = target.minima(places)[: self.walkers]
        # images under which the most likely minimum is as likely
        best, images = self.minima[0], [image for _, image in target.images()]
        logs = target.log(np.array([image(best.centre) for image in images]).reshape(-1, n))
        self.images = [i for i, log in zip(images, logs, strict=True) if log > best.log - DIP]
        self._start()

    def _take_fit(self, problem: Problem, at: Valued | Result) -> list[tuple[str, FloatArray]]:
        """Keep values, intervals and alternative of a fit; its minima with their origins.

        Raises:
            BadInput: no fit, or that of other parameters, another FMU or other data.
        """
        record: Any
        if isinstance(at, Valued) and at.is_stored:
            at = at.result
        if isinstance(at, Result):
            require_same_data(at, list(problem.record.campaigns.values()), whole=True)
            sha256 = at.provenance.fmu_sha256
            if problem.has_fmu and sha256 not in ("", problem.fmu.description.sha256):
                raise BadInput(
                    "posterior: the fit is of another FMU: found sha256 "
                    f"{problem.fmu.description.sha256[:12]}, wanted {sha256[:12]}"
                )
            self.fit = record = at
        else:
            self.fit, record = at.inferred, at.source.record
        knowledge = self.fit.knowledge
        self.likely = at.fitted_values | dict(knowledge.most_likely if knowledge else {})
        missing = sorted(set(problem.names) ^ set(self.likely))
        if missing:
            raise BadInput(
                f"posterior: the fit is of another problem: {listed(missing)} stand in one of them "
                "alone"
            )
        self.alternative = dict(record.alternative)
        settings = [dict(one) for one in problem.record.alternatives]
        if self.alternative not in settings:
            words = settings_words(self.alternative)
            raise BadInput(f"posterior: the problem has no alternative {words}")
        self.problem = problem.with_alternative(settings.index(self.alternative))
        known: list[tuple[str, Mapping[str, float]]] = [("the fit", self.likely)]
        others = knowledge.equivalents if knowledge else ()
        known += [(e.origin, e.parameters) for e in others if not e.where]
        for each in record.alternatives:
            if dict(each.settings) == self.alternative:
                known += [("a start of the fit", s.parameters) for s in each.starts]
        return [(origin, np.array([p[n] for n in problem.names])) for origin, p in known]

    def _structure(self, place: FloatArray) -> Structure | None:
        objective, parameters = self.problem.objective, self.problem.record.parameters
        [point] = evaluate_many(objective, [self.problem.to_search(place)])
        matrix = self.problem.jac(place) * scales(parameters)
        noise = fitted_noise(objective, point, matrix, np.full(len(parameters), UNBOUNDED))
        return curve_structure(objective, point, matrix, noise)

    def _start(self) -> None:
        """Make the sampler, its proposals, and the places (walkers, n) where walkers start."""
        emcee, target, minima = _emcee(), self.target, self.minima
        random = np.random.RandomState(self.seed % 2**32)
        centres = np.array([m.centre for m in minima])
        roots, logs = np.array([m.root for m in minima]), np.array([m.log for m in minima])
        masses = softmax(logs - np.linalg.slogdet(roots)[1])
        weights = EQUAL / len(minima) + (1.0 - EQUAL) * masses
        mixture = Mixture(centres, roots, weights)
        #: Whether ln falls on the straight way from a place of a valley to its first one.
        way = target.apart(centres, centres[[m.valley for m in minima]])
        middles = target.in_period(centres - 0.5 * way)
        self.is_bent = bool(np.any(target.log(middles) < logs - DIP))

        # about every place its share of walkers, one at least; where it is unlikely, at the place
        more = random.choice(len(minima), self.walkers - len(minima), p=weights)
        whose = np.append(np.arange(len(minima)), more)
        places = np.clip(mixture.draw(whose, random), target.lower, target.lower + target.width)
        log = target.log(places)
        lost = log < logs[whose] - UNLIKELY
        places[lost], log[lost] = centres[whose[lost]], logs[whose[lost]]

        def mixed(old: FloatArray, random: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
            which = random.choice(len(mixture.weights), size=len(old), p=mixture.weights)
            new = mixture.draw(which, random)
            return new, mixture.log_density(old) - mixture.log_density(new)

        def imaged(old: FloatArray, random: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
            which = random.randint(len(self.images), size=len(old))
            new = [self.images[k](place) for k, place in zip(which, old, strict=True)]
            return np.array(new), np.zeros(len(old))

        moves = [
            (emcee.moves.MHMove(mixed), SHARES["mixture"]),
            (emcee.moves.MHMove(imaged), SHARES["image"] if self.images else 0.0),
            (emcee.moves.StretchMove(), SHARES["stretch"]),
            (emcee.moves.DEMove(), SHARES["difference"]),
        ]
        self.sampler = emcee.EnsembleSampler(*places.shape, target.log, moves=moves, vectorize=True)
        # the library's wrapper prints a traceback of whatever comes out, an interrupt as well
        self.sampler.log_prob_fn = target.log
        self.start = emcee.State(places, log_prob=log, random_state=random.get_state())

    def tests(self) -> list[int]:
        """Numbers of steps at which convergence is tested, from those there are to the most.

        They do not depend on interruptions, and neither do the draws.
        """
        tests = [LEAST_STEPS]
        while tests[-1] < self.steps:
            tests.append(min(self.steps, math.ceil(LONGER * tests[-1])))
        done = self.sampler.iteration
        return [test for test in tests if test >= done] or [done]

    def sample(self, total: int, path: Path | None) -> None:
        """Take steps up to a number of them; what there is then, or when interrupted, is stored.

        Args:
            total: of steps.
            path: of the file; None: nothing is stored.
        """
        done, backend = self.sampler.iteration, self.sampler.backend
        state = self.sampler.get_last_sample() if done else self.start
        # the library doubts starts in a plane; walkers here have the width of the posterior
        steps = self.sampler.sample(state, iterations=total - done, skip_initial_state_check=True)
        try:
            for _ in steps:
                pass
        finally:
            if path is not None and backend.iteration:
                content, (name, key, *rest) = io.BytesIO(), backend.random_state
                np.savez(
                    content,
                    allow_pickle=False,
                    job=np.array(self._fingerprint),
                    places=self.sampler.get_chain(),
                    log=self.sampler.get_log_prob(),
                    accepted=backend.accepted,
                    counts=np.array([self.target.evaluations, self.target.failed]),
                    random=np.array(json.dumps([name, key.tolist(), *rest])),
                )
                write_whole(path, content.getvalue())

    @property
    def discarded(self) -> int:
        """Steps at the beginning that are left out."""
        return int(LEFT_OUT * self.sampler.iteration)

    @property
    def draws(self) -> FloatArray:
        """The other steps, (steps, walkers, n) in the parameters' units."""
        return np.asarray(self.sampler.get_chain(discard=self.discarded))

    def resume(self, path: Path) -> None:
        """Continue the chain of a file, if there is one.

        Args:
            path: Of the file.

        Raises:
            BadInput: it is no chain, or that of another job.
        """
        backend = self.sampler.backend
        try:
            content = io.BytesIO(read_whole(path, "a chain"))
            with np.load(content, allow_pickle=False) as file:
                job, (evaluations, failed) = str(file["job"]), file["counts"].tolist()
                random = tuple(json.loads(str(file["random"])))
                places, log, accepted = file["places"], file["log"], file["accepted"]
        except MissingFile:
            return
        except (ValueError, KeyError, OSError, zipfile.BadZipFile) as error:
            raise BadInput(f"{path}: is no chain of draws that can be continued") from error
        if job != self._fingerprint:
            raise BadInput(f"{path}: {OTHER_JOB}")
        backend.chain, backend.log_prob, backend.accepted = places, log, accepted
        backend.iteration, backend.random_state = len(places), random
        self.target.evaluations += evaluations
        self.target.failed += failed

    @property
    def _fingerprint(self) -> str:
        """Of all that the draws depend on."""
        problem, data = self.problem, self.problem.record.data
        arrays = [data.sigma, data.measured_rows, *problem.bounds, *(m.centre for m in self.minima)]
        content = [
            [array.tolist() for array in arrays],
            problem.names,
            settings_words(self.alternative),
            problem.fmu.description.sha256 if problem.has_fmu else "",
            (self.seed, self.walkers),
            fitting.__version__,
            [version(name) for name in ("numpy", "scipy", "emcee")],
        ]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def autocorrelation_times(draws: FloatArray) -> FloatArray:
    """Integrated autocorrelation times in steps, (n,), at least 1; infinite where nothing moved.

    Args:
        draws: (steps, walkers, n).
    """
    with np.errstate(invalid="ignore"):
        times = _emcee().autocorr.integrated_time(draws, tol=0)
    return np.asarray(np.where(np.isnan(times), math.inf, np.maximum(times, 1.0)))


def _emcee() -> Any:
    """The library of the sampler.

    Raises:
        BadInput: it is not installed; states how to install it.
    """
    try:
        import emcee
    except ImportError as error:
        raise BadInput(
            f"posterior: draws are made by emcee; to have it: pip install 'fmu-fit[posterior]' "
            f"({error})"
        ) from error
    return emcee
