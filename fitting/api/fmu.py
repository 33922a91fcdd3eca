"""An FMU as its users hold it: started when first needed, ended with the object."""

from __future__ import annotations

import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType

import numpy as np
import numpy.typing as npt

from fitting.campaign.binder import Binder
from fitting.campaign.file import WrittenFmu
from fitting.fmu import FmuDescription, FmuVariable, FmuWorkers
from fitting.fmu.models import provide_fmu
from fitting.fmu.variables import READABLE, SETTABLE
from fitting.report.table import Table, html_table, pairs_table
from fitting.simulate.drive import Drive
from fitting.simulate.frf import DIRECTIONS, USUAL_SWEEP_ACCURACY, SweepResponse
from fitting.simulate.frf import Sweep as SweepRequest
from fitting.simulate.frf import sweep as sweep_through
from fitting.simulate.response import USUAL_ACCURACY, DriveResponse
from fitting.simulate.response import simulate as simulate_through
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.scratch import Scratch
from fitting.text.units import checked_accuracy, convert, same_kind
from fitting.text.written import as_written

#: Parameters that hold the frequencies of the tones in the models of this project.
USUAL_TONES = ("u1", "u2")


class Fmu:
    """An FMU: its variables, and worker processes that run it.

    Args:
        source: Path of an FMU file (FMI 2.0 or 3.0, co-simulation), or the name of a model of this
            project, as "CoupledOscillator", which is built on the spot.
        workers: Number of processes, at least 1; they start at the first run, or with a
            ``with`` block, and end with it, with ``close``, or when nobody refers to this object
            any more.
        timeout_s: Longest time for one run, s; then the FMU counts as failed.

    Raises:
        BadInput: no such file or model, no FMU that this machine can run, no positive numbers.
    """

    def __init__(self, source: str | Path, workers: int = 2, timeout_s: float = 60.0) -> None:
        is_model = isinstance(source, str) and source.isidentifier()
        path = self._built(str(source)) if is_model else source
        self.workers = FmuWorkers(path, workers=workers, timeout_s=timeout_s)

    def _built(self, model: str) -> Path:
        scratch = Scratch()
        weakref.finalize(self, scratch.remove)
        return provide_fmu(WrittenFmu(model=model), scratch.path)

    @property
    def description(self) -> FmuDescription:
        """What the FMU says of itself."""
        return self.workers.description

    @property
    def variables(self) -> Mapping[str, FmuVariable]:
        """Its variables by name, in the order of the modelDescription."""
        return self.description.variables

    def simulate(
        self,
        start_values: Mapping[str, Scalar] | None = None,
        *,
        tones: Sequence[str] = USUAL_TONES,
        outputs: str | Sequence[str] = (),
        accuracy: float = USUAL_ACCURACY,
        settle_s: float | None = None,
    ) -> DriveResponse:
        """Drive the FMU with some tones and read its steady response.

        Args:
            start_values: Start values by variable: numbers in the FMU's units, or texts such as
                "6.94 MHz"; the others are the FMU's own.
            tones: Parameters of the FMU that hold the frequencies of the tones.
            outputs: Names of outputs; none: the first continuous one.
            accuracy: Wanted largest relative error of every amplitude, between 0 and 1.
            settle_s: Time before sampling, s; None: found by watching the amplitudes.

        Returns:
            ``peaks`` (tones, outputs) in the outputs' units, spectrum, traces, and the plan with
            the promised accuracy.

        Raises:
            BadInput: names, values or units that do not fit the FMU.
            FmuFailure: the FMU failed.
        """
        values = self._start_values(start_values)
        drive = Drive(
            start_values=values,
            tones_hz=tuple(self._tone_hz(name, values) for name in tones),
            outputs=self._outputs(outputs),
        )
        accuracy = checked_accuracy(accuracy, "accuracy")
        return simulate_through(self.workers, drive, accuracy, settle_s=settle_s)

    def sweep(
        self,
        frequency_hz: npt.ArrayLike,
        start_values: Mapping[str, Scalar] | None = None,
        *,
        tone: str = USUAL_TONES[0],
        output: str = "",
        directions: Sequence[str] = ("up",),
    ) -> SweepResponse:
        """Move a tone through the FMU while it runs and read the amplitude at every point.

        Args:
            frequency_hz: Frequencies of the tone, shape (n,), Hz, rising.
            start_values: Start values by variable: numbers in the FMU's units, or texts such as
                "0.3 m/s2"; the others are the FMU's own.
            tone: The tunable parameter of the FMU that is moved.
            output: The output that is read; empty: the first continuous one.
            directions: Any of "up" and "down".

        Returns:
            ``curves`` of amplitudes (n,) by direction, in the output's unit, and their jumps.

        Raises:
            BadInput: names, values or units that do not fit the FMU, frequencies that do not rise.
            FmuFailure: the FMU failed.
        """
        unknown = [d for d in directions if d not in DIRECTIONS]
        if unknown or not directions:
            raise BadInput(f"directions: found {directions!r}, wanted some of up, down")
        grid = np.asarray(frequency_hz, dtype=float)
        if grid.ndim != 1 or grid.size < 2:
            raise BadInput(f"frequency_hz has the shape {grid.shape}, wanted (n,), two or more")
        values = self._start_values(start_values)
        wanted = SweepRequest(
            start_values=values,
            tone=tone,
            tone_unit=self._frequency_unit(tone),
            frequencies_hz=tuple(map(float, grid)),
            output=self._outputs(output)[0],
            directions=tuple(directions),
        )
        return sweep_through(self.workers, wanted, USUAL_SWEEP_ACCURACY)

    def close(self) -> None:
        """End the worker processes; a later run starts them again."""
        self.workers.close()

    def __enter__(self) -> Fmu:
        self.workers.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        d = self.description
        return f"<Fmu {d.model_name}: FMI {d.fmi_version}, {len(d.variables)} variables, {d.path}>"

    def _repr_html_(self) -> str:
        return html_table(self._table())

    def _table(self) -> Table:
        d = self.description
        said = {
            f"{v.causality} {v.name}": " ".join(
                str(part) for part in (v.start, v.unit) if part is not None
            )
            for v in d.variables.values()
        }
        return pairs_table(f"{d.model_name} (FMI {d.fmi_version})", ("variable", "start"), said)

    def _start_values(self, given: Mapping[str, Scalar] | None) -> dict[str, Scalar]:
        binder = Binder(self.variables)
        return {
            name: binder.setting(name, as_written(value, f"start value of '{name}'"))
            for name, value in (given or {}).items()
        }

    def _frequency_unit(self, name: str) -> str:
        variable = Binder(self.variables).real(name, "tone", SETTABLE, "set")
        if not same_kind(variable.unit or "1", "Hz"):
            raise BadInput(f"tone '{name}': its unit is {variable.unit!r}, wanted a frequency")
        return variable.unit or "1"

    def _tone_hz(self, name: str, values: Mapping[str, Scalar]) -> float:
        unit = self._frequency_unit(name)
        value = values.get(name, self.variables[name].start)
        if value is None:
            raise BadInput(f"tone '{name}': has no start value, wanted one in start_values")
        return convert(float(value), unit, "Hz", where=f"tone '{name}'")

    def _outputs(self, names: str | Sequence[str]) -> tuple[str, ...]:
        asked = ((names,) if names else ()) if isinstance(names, str) else tuple(names)
        for name in asked:
            Binder(self.variables).real(name, "outputs", READABLE, "read")
        if asked:
            return asked
        for v in self.variables.values():
            if (v.causality, v.kind, v.variability) == ("output", "Real", "continuous"):
                return (v.name,)
        raise BadInput(f"{self.description.path}: has no continuous Real output, wanted outputs")


def simulate(
    fmu: Fmu,
    start_values: Mapping[str, Scalar] | None = None,
    *,
    tones: Sequence[str] = USUAL_TONES,
    outputs: str | Sequence[str] = (),
    accuracy: float = USUAL_ACCURACY,
    settle_s: float | None = None,
) -> DriveResponse:
    """Drive an FMU with some tones and read its steady response; `Fmu.simulate` as a function.

    Args:
        fmu: The FMU.
        start_values: Start values by variable: numbers in the FMU's units, or texts such as
            "6.94 MHz"; the others are the FMU's own.
        tones: Parameters of the FMU that hold the frequencies of the tones.
        outputs: Names of outputs; none: the first continuous one.
        accuracy: Wanted largest relative error of every amplitude, between 0 and 1.
        settle_s: Time before sampling, s; None: found by watching the amplitudes.

    Raises:
        BadInput: names, values or units that do not fit the FMU.
        FmuFailure: the FMU failed.
    """
    return fmu.simulate(
        start_values, tones=tones, outputs=outputs, accuracy=accuracy, settle_s=settle_s
    )


def sweep(
    fmu: Fmu,
    frequency_hz: npt.ArrayLike,
    start_values: Mapping[str, Scalar] | None = None,
    *,
    tone: str = USUAL_TONES[0],
    output: str = "",
    directions: Sequence[str] = ("up",),
) -> SweepResponse:
    """Move a tone through an FMU and read the amplitude at every point; `Fmu.sweep` as a function.

    Args:
        fmu: The FMU.
        frequency_hz: Frequencies of the tone, shape (n,), Hz, rising.
        start_values: Start values by variable: numbers in the FMU's units, or texts such as
            "0.3 m/s2"; the others are the FMU's own.
        tone: The tunable parameter of the FMU that is moved.
        output: The output that is read; empty: the first continuous one.
        directions: Any of "up" and "down".

    Raises:
        BadInput: names, values or units that do not fit the FMU, frequencies that do not rise.
        FmuFailure: the FMU failed.
    """
    return fmu.sweep(frequency_hz, start_values, tone=tone, output=output, directions=directions)
