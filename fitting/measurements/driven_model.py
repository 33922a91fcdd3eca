"""The FMU as one series of measurements drives it: parameters become start values, tones inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial

from fitting.campaign import Setup
from fitting.campaign.parameters import Parameter
from fitting.fmu.runs import InputSignal
from fitting.measurements.plan import Plan
from fitting.signal.combinations import mixed_hz
from fitting.signal.grid import Grid, window_on
from fitting.signal.window import Window, plan_window, whole_steps
from fitting.simulate.batch import alike
from fitting.simulate.drive import Drive
from fitting.text.arrays import FloatArray, IntArray, Scalar
from fitting.text.units import convert

#: Longest common period of tones that share a run, as a part of the time to settle.
COMMON = 0.1
#: Windows that are kept: more than experiments of a campaign have, as all come back in their order.
MOST_WINDOWS = 2**16


@lru_cache(maxsize=MOST_WINDOWS)
def _window(
    read_hz: tuple[float, ...],
    tones_hz: tuple[float, ...],
    settle_s: float,
    kept: int,
    order: int,
    grid: Grid,
) -> Window:
    """A window, planned once: the same ones come back in every evaluation."""
    planned = partial(window_on, grid) if grid.step_s else plan_window
    mixtures_hz = mixed_hz(tones_hz, order)
    result = planned(read_hz, settle_s, samples_per_period=kept, mixtures_hz=mixtures_hz)
    return replace(result, longest_s=grid.longest_s)


@lru_cache(maxsize=MOST_WINDOWS)
def _superposed(tones_hz: tuple[float, ...], settle_s: float, hold_s: float, grid: Grid) -> Window:
    """Likewise, for tones of which no mixtures are kept off, in a window that is short.

    Held steps all have the same length, that their images are alike from run to run.
    """
    if grid.step_s or hold_s:
        on = grid if grid.step_s else Grid(step_s=hold_s, longest_s=grid.longest_s)
        result = window_on(on, tones_hz, settle_s, longest_s=COMMON * settle_s)
        if hold_s:
            settle_s, steps = whole_steps(settle_s, on.step_s), round(result.step_s / on.step_s)
            result = replace(result, settle_s=settle_s, hold_steps=steps)
    else:
        result = plan_window(tones_hz, settle_s, longest_s=COMMON * settle_s)
    return replace(result, longest_s=grid.longest_s)


@lru_cache(maxsize=MOST_WINDOWS)
def _in_unit(tone_hz: float, unit: str) -> float:
    return convert(tone_hz, "Hz", unit, where="[sweep] frequency")


#: Positions in p with the start values that they are, laws' coefficients, or are added to.
_Roles = tuple[
    tuple[tuple[int, str], ...],
    tuple[tuple[int, str], ...],
    tuple[tuple[int, tuple[str, ...]], ...],
]


@dataclass(frozen=True, kw_only=True)
class DrivenModel:
    """How parameter vectors become runs of the FMU, for one series and one discrete alternative.

    `own_step_s` is the step that the FMU declares, None where it declares none; `any_steps`:
    whether its communication steps may differ from each other; `integrated`: whether its equations
    are integrated here, by model exchange.
    """

    setup: Setup
    parameters: tuple[Parameter, ...]
    plan: Plan
    alternative: Mapping[str, Scalar] = field(default_factory=dict)
    own_step_s: float | None = None
    any_steps: bool = True
    integrated: bool = False

    @cached_property
    def _acting(self) -> dict[str | None, list[int]]:
        """Positions of the FMU's parameters that act in an experiment, by its label; None: all."""
        model = [(i, q) for i, q in enumerate(self.parameters) if q.moves_model]
        everywhere = [i for i, q in model if not q.experiments]
        acting: dict[str | None, list[int]] = {None: everywhere}
        for i, parameter in model:
            for label in parameter.experiments:
                acting.setdefault(label, list(everywhere)).append(i)
        return acting

    def columns(self, label: str | None) -> list[int]:
        """Positions in p of what acts in an experiment; None: in what belongs to no experiment.

        Args:
            label: of the experiment, None for a sweep.
        """
        return self._acting.get(label, self._acting[None])

    def groups(self, table: FloatArray, label: str | None) -> tuple[IntArray, IntArray]:
        """Rows of a table (k, n) that are alike to an experiment: first of each group, groups.

        Args:
            table: parameter vectors (p, n).
            label: of the experiment, None for a sweep.
        """
        return alike(table[:, self.columns(label)])

    def values(
        self, p: FloatArray, label: str | None, settings: Mapping[str, Scalar]
    ) -> dict[str, Scalar]:
        """Start values: campaign's, plan's, alternative's, experiment's, the fitted ones, laws'.

        Args:
            p: parameters (n,), each in its own unit.
            label: of the experiment, None for a sweep.
            settings: values of FMU variables and of control quantities, by name.

        Raises:
            FmuFailure: a law has no finite value there.
        """
        number = p.item  # a few of perhaps a thousand
        targets, laws, added = self._roles(label)
        values = {**self._common, **settings}
        values.update({target: number(i) for i, target in targets})
        coefficients = {target: number(i) for i, target in laws}
        values = self.setup.laws.applied(values, coefficients)
        for i, names in added:
            for name in names:
                values[name] = float(values[name]) + number(i)
        return values

    @cached_property
    def _common(self) -> dict[str, Scalar]:
        """Start values of every run: campaign's, plan's, the drive's, alternative's."""
        drive = self.setup.drive
        amplitudes = dict.fromkeys(drive.amplitude_names, drive.amplitude)
        return {
            **self.setup.start_values,
            **self.plan.settings,
            **amplitudes,
            **self.alternative,
        }

    @cached_property
    def whole(self) -> DrivenModel:
        """The same without what reductions have left out of the model.

        What a reduction costs is known under the tones that it was measured with. A record over
        time has others, or none: then the mode next to the tones may be any, and what is left out
        the very one that is observed.
        """
        reduced = {n for d in self.plan.decisions if d.is_reduction for n in d.settings}
        if not reduced:
            return self
        settings = {n: value for n, value in self.plan.settings.items() if n not in reduced}
        return replace(self, plan=replace(self.plan, settings=settings))

    def _roles(self, label: str | None) -> _Roles:
        """What the parameters are to an experiment, by its label; looked up at every run."""
        result = self._known_roles.get(label)
        if result is None:
            acting = [(i, self.parameters[i]) for i in self.columns(label)]
            own = [(i, q) for i, q in acting if not q.adds_to]
            result = self._known_roles[label] = (
                tuple((i, q.target) for i, q in own if q.role == "model"),
                tuple((i, q.target) for i, q in own if q.role == "coefficient"),
                tuple((i, q.adds_to) for i, q in acting if q.adds_to),
            )
        return result

    @cached_property
    def _known_roles(self) -> dict[str | None, _Roles]:
        return {}

    def tones_of(self, values: Mapping[str, Scalar], count: int = 1) -> dict[str, Scalar]:
        """Start values for some tones of one amplitude, but for those of the tones themselves.

        All have the first one's amplitude, others have none.

        Args:
            values: start values, by name.
            count: number of the tones.
        """
        drive, result = self.setup.drive, dict(values)
        if drive.kind == "tones":
            for name in drive.frequency_names[:count]:
                result.pop(name, None)
            first, *others = drive.amplitude_names
            result.update(dict.fromkeys(others[: count - 1], result[first]))
            result.update(dict.fromkeys(others[count - 1 :], 0.0))
        return result

    def tone_values(self, tones_hz: Sequence[float]) -> dict[str, Scalar]:
        """Start values that tones have of their own; none where the tool applies them.

        Args:
            tones_hz: frequencies of the tones, Hz, not more than the FMU has names for.
        """
        drive = self.setup.drive
        if drive.kind != "tones":
            return {}
        values = (_in_unit(tone, drive.tone_unit) for tone in tones_hz)
        return dict(zip(drive.frequency_names, values, strict=False))

    @property
    def most_tones(self) -> int | None:
        """The number of tones that a run can have; None: any, the tool applies them."""
        drive = self.setup.drive
        return len(drive.frequency_names) if drive.kind == "tones" else None

    def with_part(self, part: float, values: Mapping[str, Scalar]) -> dict[str, Scalar]:
        """Start values with a part of the amplitude of the drive's first tone.

        Where the tool applies the tones, their signal has the part (`signal`), and nothing changes.

        Args:
            part: of the amplitude.
            values: start values, by name.
        """
        drive = self.setup.drive
        if drive.kind == "input" and drive.input is not None:
            return dict(values)
        name = drive.amplitude_names[0]
        return {**values, name: part * float(values[name])}

    def single_tone_window(self, tone_hz: float) -> Window:
        """Settling and samples under one tone.

        Args:
            tone_hz: frequency of the tone, Hz.
        """
        return self.window((tone_hz,), (tone_hz,))

    def superposed_window(self, tones_hz: tuple[float, ...], fastest_hz: float) -> Window:
        """Settling and samples under several tones of a linear FMU: no mixtures are kept off.

        A common period that is no small part of the settling is given up for a tone fit.

        Args:
            tones_hz: frequencies of the tones (n,), Hz.
            fastest_hz: as for which tones are held over steps, Hz, where the tool applies them.

        Raises:
            BadInput: no samples keep them apart.
        """
        hold_s = self.single_tone_window(fastest_hz).input_step_s if self.hold_steps else 0.0
        return _superposed(tones_hz, self.plan.settle_s, hold_s, self.plan.grid)

    @property
    def hold_steps(self) -> int:
        """Steps in a period of the fastest tone for which the tool holds it; 0: the FMU drives."""
        drive = self.setup.drive
        return drive.samples_per_period if drive.kind == "input" else 0

    def window(self, read_hz: tuple[float, ...], tones_hz: tuple[float, ...]) -> Window:
        """Settling and samples to read lines (n,) of a response to tones (k,), Hz.

        Args:
            read_hz: lines that are read, Hz.
            tones_hz: frequencies of the tones, Hz.
        """
        order = max(self.setup.drive.highest_order, self.plan.order)
        return _window(
            read_hz, tones_hz, self.plan.settle_s, self.hold_steps, order, self.plan.grid
        )

    def drive(
        self, values: Mapping[str, Scalar], tones_hz: tuple[float, ...], output: str
    ) -> Drive:
        """One drive for the planner: start values, tones (Hz), the output that is read.

        Args:
            values: start values, by name.
            tones_hz: frequencies of the tones, Hz.
            output: name of the output.
        """
        drive = self.setup.drive
        return Drive(
            start_values=values,
            tones_hz=tones_hz,
            outputs=(output,),
            input=drive.input if drive.kind == "input" else None,
            amplitude=drive.amplitude,
            steps_per_period=drive.samples_per_period,
            highest_order=drive.highest_order,
        )

    def signal(
        self, window: Window, tones_hz: Sequence[float], part: float = 1.0
    ) -> InputSignal | None:
        """The tones as input of the FMU, where the tool applies them; None where the FMU does.

        Args:
            window: settling and samples of a run.
            tones_hz: frequencies of the tones, Hz.
            part: of the drive's amplitude.
        """
        drive = self.setup.drive
        if drive.kind != "input" or drive.input is None:
            return None
        rows = tuple((tone, part * drive.amplitude, 0.0) for tone in tones_hz)
        return InputSignal(drive.input, rows, window.input_step_s)
