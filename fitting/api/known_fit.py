"""What a fit knows that draws from a posterior begin with: its minima, values and intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fitting.api.fitted import Valued
from fitting.api.problem import Problem
from fitting.inference.inferred import Inferred
from fitting.result.result import Result
from fitting.result.same_data import require_same_data
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.notation import listed, settings_words

__all__ = ["KnownFit"]


@dataclass(frozen=True, kw_only=True)
class KnownFit:
    """What a fit knows: its minima (who, place), and its values.

    `result` is the record that it was read from, None of a fit of this process.
    """

    places: tuple[tuple[str, FloatArray], ...]
    most_likely: Mapping[str, float]
    values: Inferred
    alternative: Mapping[str, Scalar]
    sha256: str
    result: Result | None = None

    @classmethod
    def of(cls, at: Valued | Result, names: Sequence[str]) -> KnownFit:
        """From a fit, an inference, or the result of one.

        Args:
            at: the fit.
            names: of the parameters, in the order of the problem that is drawn from.

        Raises:
            BadInput: something else.
        """
        inferred: Inferred
        if isinstance(at, Valued):
            inferred = at.inferred
            alternatives, chosen = at.source.record.alternatives, at.source.record.alternative
            sha256 = ""
            own = (p.name for p in at.source.record.problem.parameters)
            likely = dict(zip(own, at.inferred.reported.tolist(), strict=True))
        elif isinstance(at, Result):
            inferred, alternatives, chosen = at, at.alternatives, at.alternative
            sha256 = at.provenance.fmu_sha256
            likely = dict(at.fitted_values)
        else:
            raise BadInput(
                f"posterior: found a {type(at).__name__}, wanted a Fit, an Inference or a Result"
            )
        # values of single experiments are told as offsets from the drift: other numbers
        results, knowledge = inferred.parameters, inferred.knowledge
        likely |= {n: r.most_likely for n, r in results.items() if not math.isnan(r.most_likely)}
        known: list[tuple[str, Mapping[str, float]]] = [("the fit", dict(likely))]
        if knowledge is not None:
            known.insert(0, ("the fit", dict(knowledge.most_likely)))
            known += [(e.origin, e.parameters) for e in knowledge.equivalents if not e.where]
        ends = [a.starts for a in alternatives if dict(a.settings) == dict(chosen)]
        known += [("a start of the fit", s.parameters) for starts in ends for s in starts]
        whole = [(who, place) for who, place in known if all(n in place for n in names)]
        return cls(
            places=tuple((who, np.array([p[n] for n in names])) for who, p in whole),
            most_likely=likely,
            values=inferred,
            alternative=chosen,
            sha256=sha256,
            result=at if isinstance(at, Result) else None,
        )

    def require(self, problem: Problem) -> None:
        """Complain of a fit of another problem.

        Args:
            problem: that is drawn from.

        Raises:
            BadInput: other parameters, another FMU, other data, or none that has a value of each.
        """
        wanted = set(problem.names)
        missing = sorted(wanted ^ set(self.most_likely))
        if missing or not self.places:
            raise BadInput(
                f"posterior: the fit is of another problem: {listed(missing) or 'its values'} "
                "stand in one of them alone"
            )
        if self.sha256 and problem.has_fmu and problem.fmu.description.sha256 != self.sha256:
            raise BadInput(
                "posterior: the fit is of another FMU: found sha256 "
                f"{problem.fmu.description.sha256[:12]}, wanted {self.sha256[:12]}"
            )
        if self.result is not None:
            require_same_data(self.result, list(problem.record.campaigns.values()), whole=True)

    def chosen(self, problem: Problem) -> Problem:
        """The problem with the alternative that the fit reports.

        Args:
            problem: with any of its alternatives.

        Raises:
            BadInput: it has no such alternative.
        """
        wanted = dict(self.alternative)
        for k, one in enumerate(problem.record.alternatives):
            if dict(one) == wanted:
                return problem.with_alternative(k)
        raise BadInput(f"posterior: the problem has no alternative {settings_words(wanted)}")
