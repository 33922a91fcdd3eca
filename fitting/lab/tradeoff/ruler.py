"""The measurement of one setting on a bench: its error against the references, and its cost."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from fitting.lab.names import AMPLITUDES, WIDTH_PEAKS
from fitting.lab.tradeoff.bench import Bench
from fitting.lab.tradeoff.extrapolation import Extrapolation
from fitting.lab.tradeoff.plan import Planned
from fitting.lab.tradeoff.quantities import error_of, values_of
from fitting.lab.tradeoff.records import RATIOS, TOLERANCE, Cost, Measurement, Reference, Setting
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, FmuFailure


def work_of(
    bench: Bench, setting: Setting, planned: Planned | None, data: Reference | None = None
) -> Callable[[], FloatArray]:
    """What is timed: the plan's runs, or those of a setting; the workers know their layout.

    Args:
        bench: the scene on its FMU.
        setting: of the simulation: solver, settling, samples.
        planned: the plan that is timed instead; None: the setting itself.
        data: amplitudes that a fit of the width is made to.
    """
    if planned is not None:
        bench.warm(dict(planned.plans[0].settings))
        return lambda: planned.amplitudes(bench)
    bench.warm(dict(setting.values))
    return lambda: values_of(bench, setting, data)


class Ruler:
    """Measures settings on a bench against the references.

    Args:
        bench: the scene on its FMU.
        references: that errors are measured from.
        longest_s: longest run of a setting, s; what takes longer is extrapolated or left out.
    """

    def __init__(self, bench: Bench, references: Sequence[Reference], longest_s: float) -> None:
        self.bench, self.references, self.longest_s = bench, tuple(references), longest_s
        self._references = {r.quantity: r for r in references}
        self._extrapolation = Extrapolation(bench)

    def measure(self, setting: Setting) -> Measurement | None:
        """The row of a setting; None for one that takes too long and cannot be extrapolated.

        Args:
            setting: of the simulation: solver, settling, samples.
        """
        if self._extrapolation.expected_s(setting) > self.longest_s:
            return self._extrapolation.measurement(setting, self._references[setting.quantity])
        data = None  # amplitudes that a fit of the width is made to
        if setting.quantity == WIDTH_PEAKS:
            data = self._references[RATIOS if setting.sweep_points else AMPLITUDES]
        try:
            measured = self._measured(setting, work_of(self.bench, setting, None, data))
        except (FmuFailure, BadInput, ValueError, ArithmeticError) as failure:
            return without_number(setting, " ".join(str(failure).split()))
        if setting.resolution_kind != TOLERANCE:
            return measured
        return replace(measured, cost=replace(measured.cost, solver_steps=None))

    def measure_planned(self, planned: Planned) -> Measurement:
        """The row of the plan's choice for an accuracy.

        Args:
            planned: the plan.
        """
        setting = planned.setting(self.bench.scene)
        found = self._measured(setting, work_of(self.bench, setting, planned))
        return replace(
            found,
            cost=replace(found.cost, solver_steps=None),
            planned_for=planned.accuracy,
            note=f"promised {planned.promised:.1e}",
        )

    def _measured(self, setting: Setting, work: Callable[[], FloatArray]) -> Measurement:
        reference = self._references[setting.quantity]
        values, cost = self.bench.timed(work)
        error = error_of(values, reference)
        if not math.isfinite(error):
            return replace(without_number(setting, "no number came out"), cost=cost)
        return Measurement(
            setting=setting,
            error=max(error, reference.error),
            bounded=error <= reference.error,
            cost=cost,
        )


def without_number(setting: Setting, why: str) -> Measurement:
    """The row of a setting that gave nothing.

    Args:
        setting: of the simulation: solver, settling, samples.
        why: in words.
    """
    return Measurement(setting=setting, error=math.inf, cost=Cost(), note=why)
