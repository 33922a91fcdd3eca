"""What a model leaves of a free decay, against one more line that decays beside it.

Noise that nobody stated is taken from what the model leaves: a mode that it does not have is then
part of the noise. One line more than the model has states for, in closed form, leaves noise alone
where a mode is missing (F test, as of sweeps in `fitting.inference.closer_form`).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.special import fdtrc

from fitting.fit.solution import Solution
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.measurements.traces.record import UNKNOWN, TraceRecord
from fitting.measurements.traces.traces import Traces
from fitting.signal.decaying_lines import DecayingLines, decaying_lines
from fitting.signal.pair import NO_NOISE
from fitting.signal.residual_tests import residual_structure
from fitting.text.arrays import FloatArray
from fitting.text.notation import hertz

#: Samples that are looked at, at most, the first ones.
MOST = 20_000
#: Probability below which chance does not explain a gain.
IMPROBABLE = 1e-4
#: Numbers of lines in words.
WORDS = {2: "two", 3: "three", 4: "four"}


def closer_decays(solution: Solution) -> Iterator[Adequacy]:
    """Every free decay of unknown noise that one more line describes, and the model does not.

    Args:
        solution: the end of a fit.
    """
    data = solution.objective.data
    for traces, place in zip(data.measurements, data.slices, strict=True):
        if not isinstance(traces, Traces):
            continue
        moving = np.count_nonzero(np.any(solution.matrix[place] != 0.0, axis=0))
        begin = place.start
        for trace in traces.traces:
            rows = solution.final.residuals[begin : begin + trace.y.size]
            begin += trace.y.size
            if trace.sigma == 0.0 and trace.start == UNKNOWN and not trace.is_driven:
                found = compared_decay(trace, rows, trace.solved_inside + int(moving))
                if found is not None:
                    yield found


def compared_decay(trace: TraceRecord, residuals: FloatArray, unknowns: int) -> Adequacy | None:
    """What a model leaves of a free decay, against one line more; None where that is no better.

    Args:
        trace: the free decay.
        residuals: of the model, over its largest value, shape (n,).
        unknowns: of the model for this trace.
    """
    count = trace.states // 2 + 1
    seen = np.asarray(trace.y[:MOST] / trace.largest)
    if seen.size < 4 * (4 * count + 1):
        return None
    lines = decaying_lines(seen, trace.spacing_s, count, offset=trace.offset)
    squares = float(residuals[:MOST] @ residuals[:MOST])
    if lines is None or not lines.squares < squares:
        return None
    structure = residual_structure(lines.left, lines.columns)
    freedom = seen.size - lines.unknowns
    more = max(1, lines.unknowns - unknowns)
    chance = float(fdtrc(more, freedom, (squares / lines.squares - 1.0) / more * freedom))
    if structure.p_value <= NO_NOISE or chance > IMPROBABLE / seen.size:
        return None
    return Adequacy(
        chi_square=squares * freedom / lines.squares,
        freedom=float(freedom),
        p_value=chance,
        describes=False,
        against=_words(lines),
        remedy=f"states = {2 * count} and an FMU of {WORDS.get(count, count)} modes",
    )


def _words(lines: DecayingLines) -> str:
    places = hertz(*lines.frequency_hz, digits=6)
    return f"a sum of {WORDS.get(len(lines.frequency_hz), 'more')} decaying lines ({places})"
