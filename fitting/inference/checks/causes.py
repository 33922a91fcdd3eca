"""Why a model does not describe the data: what one mistake of the measurement would explain."""

from __future__ import annotations

import numpy as np

from fitting.inference.checks.curve_mistakes import curve_mistake
from fitting.inference.checks.exchanges import exchanged_drift
from fitting.inference.checks.outliers import outlying_experiment, single_rows
from fitting.inference.solved import Solved
from fitting.text.errors import FmuFailure, NoScale
from fitting.text.finding import Finding


def causes_of(solved: Solved) -> tuple[Finding, ...]:
    """The mistakes that explain a misfit; none where the residuals are what they should be.

    Single rows first; then a number that mends curves; of a model that is refused also a drift the
    other way round, one experiment, and a factor on all peaks, the first that explains it.

    Args:
        solved: with what is known of the residuals.
    """
    adequacy = solved.adequacy
    if adequacy is None or adequacy.rival is not None or adequacy.no_line:
        return ()
    causes = [*single_rows(solved)]
    if adequacy.describes and not adequacy.is_correlated:
        return tuple(causes)
    solution = solved.solution
    try:
        causes += curve_mistake(solution, tones=False)
        if not causes and not adequacy.describes and solved.problem.data.tones:
            causes += [*exchanged_drift(solved)] or [*outlying_experiment(solution)]
        if not causes and not adequacy.describes:
            causes += curve_mistake(solution, tones=True)
    except (FmuFailure, NoScale, np.linalg.LinAlgError):  # where the model fails nothing is known
        pass
    return tuple(causes)
