"""The FMU as one series of measurements drives it: parameters become start values, tones inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

from fitting.campaign import Setup
from fitting.campaign.parameters import Parameter
from fitting.fmu import InputSignal
from fitting.measurements.plan import Plan
from fitting.signal.combinations import mixed_hz
from fitting.signal.grid import Grid, window_on
from fitting.signal.window import Window, plan_window
from fitting.simulate.batch import alike
from fitting.simulate.drive import Drive
from fitting.text.arrays import FloatArray, IntArray, Scalar
from fitting.text.units import convert


@lru_cache(maxsize=4096)
def _window(
    read_hz: tuple[float, ...],
    tones_hz: tuple[float, ...],
    settle_s: float,
    held: int,
    order: int,
    grid: Grid,
) -> Window:
    """A window, planned once: the same ones come back in every evaluation."""
    mixtures_hz = mixed_hz(tones_hz, order)
    if grid.step_s:
        found = window_on(grid, read_hz, settle_s, samples_per_period=held, mixtures_hz=mixtures_hz)
    else:
        found = plan_window(read_hz, settle_s, samples_per_period=held, mixtures_hz=mixtures_hz)
    return replace(found, longest_s=grid.longest_s)


@lru_cache(maxsize=4096)
def _in_unit(tone_hz: float, unit: str) -> float:
    return convert(tone_hz, "Hz", unit, where="[sweep] frequency")


@dataclass(frozen=True, kw_only=True)
class DrivenModel:
    """How parameter vectors become runs of the FMU, for one series and one discrete alternative.

    `own_step_s` is the step that the FMU was made for, None where it tells none; `any_steps`:
    whether its communication steps may differ from each other.
    """

    setup: Setup
    parameters: tuple[Parameter, ...]
    plan: Plan
    alternative: Mapping[str, Scalar] = field(default_factory=dict)
    own_step_s: float | None = None
    any_steps: bool = True

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
        drive = self.setup.drive
        values: dict[str, Scalar] = {**self.setup.start_values, **self.plan.settings}
        values.update(dict.fromkeys(drive.amplitude_names, drive.amplitude))
        values.update(self.alternative)
        values.update(settings)
        acting = [(self.parameters[i], float(p[i])) for i in self.columns(label)]
        own = [(q, value) for q, value in acting if not q.adds_to]
        values.update({q.target: value for q, value in own if q.role == "model"})
        coefficients = {q.target: value for q, value in own if q.role == "coefficient"}
        values = self.setup.laws.applied(values, coefficients)
        for parameter, value in acting:
            for name in parameter.adds_to:
                values[name] = float(values[name]) + value
        return values

    def single_tone_values(
        self,
        p: FloatArray,
        settings: Mapping[str, Scalar],
        tone_hz: float,
        label: str | None = None,
    ) -> dict[str, Scalar]:
        """Start values under one tone: its frequency (Hz), the other amplitudes zero.

        Args:
            p: parameters (n,), each in its own unit.
            settings: values of FMU variables, by name.
            tone_hz: frequency of the tone, Hz.
            label: of the place whose own parameters act, None for a sweep.
        """
        return self.one_tone_of(self.values(p, label, settings)) | self.tone_values(tone_hz)

    def one_tone_of(self, values: Mapping[str, Scalar]) -> dict[str, Scalar]:
        """Start values for one tone, but for those of the tone itself: other amplitudes zero.

        Args:
            values: start values, by name.
        """
        drive, found = self.setup.drive, dict(values)
        if drive.kind == "tones":
            found.pop(drive.frequency_names[0], None)
            found.update(dict.fromkeys(drive.amplitude_names[1:], 0.0))
        return found

    def tone_values(self, tone_hz: float) -> dict[str, Scalar]:
        """Start values that a single tone has of its own; none where the tool applies it.

        Args:
            tone_hz: frequency of the tone, Hz.
        """
        drive = self.setup.drive
        if drive.kind != "tones":
            return {}
        return {drive.frequency_names[0]: _in_unit(tone_hz, drive.tone_unit)}

    def with_part(self, part: float, values: Mapping[str, Scalar]) -> dict[str, Scalar]:
        """Start values of a single tone with a part of the drive's amplitude.

        Where the tool applies the tone, its signal has the part (`signal`), and nothing changes.

        Args:
            part: of the amplitude.
            values: start values under the tone, by name.
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

    def window(self, read_hz: tuple[float, ...], tones_hz: tuple[float, ...]) -> Window:
        """Settling and samples to read lines (n,) of a response to tones (k,), Hz.

        Args:
            read_hz: lines that are read, Hz.
            tones_hz: frequencies of the tones, Hz.
        """
        drive = self.setup.drive
        held = drive.samples_per_period if drive.kind == "input" else 0
        order = max(drive.highest_order, self.plan.order)
        return _window(read_hz, tones_hz, self.plan.settle_s, held, order, self.plan.grid)

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
