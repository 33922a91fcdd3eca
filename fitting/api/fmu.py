"""An FMU as its users hold it: started when first needed, ended with the object."""

from __future__ import annotations

import math
import sys
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, wraps
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy.typing as npt

from fitting.api.early import DRIVE_FILES, SWEEP_FILES
from fitting.api.printed import written
from fitting.api.request import USUAL_TONES, drive_request, sweep_request
from fitting.campaign.bound import Drive as WantedDrive
from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.fmu.description import (
    FmuDescription,
    FmuVariable,
    OtherTone,
    other_tones,
    read_description,
)
from fitting.fmu.isolation import Isolate, Isolation
from fitting.fmu.models import built_model
from fitting.fmu.pool import FmuWorkers
from fitting.report.simulation import write_drive, write_sweep
from fitting.report.table import html_table, table
from fitting.simulate.frf import SweepResponse
from fitting.simulate.frf import sweep as sweep_through
from fitting.simulate.planner import DrivePlan
from fitting.simulate.response import (
    DriveResponse,
    Shown,
    Sideband,
    missing_damping,
    plan_drive,
    respond,
    sideband_of,
)
from fitting.text.arguments import checked
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.old_names import renamed
from fitting.text.scratch import Scratch
from fitting.text.units import checked_accuracy

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


@checked
@dataclass(frozen=True)
class Accuracy:
    """How accurately amplitudes are simulated, and what the plan must use.

    Args:
        relative: Largest relative error of each amplitude of a drive, of a sweep over its largest,
            in (0, 1); None: 1e-6 of a drive, 1e-4 of a sweep.
        settle_s: Time before sampling, in a sweep at every point, s; None: until the amplitudes are
            steady. The promised error includes the transient that is left.
        window_s: Length of the shown spectrum of a drive, s; None: some common periods.
        samples: Samples in it; None: by the band.
        force: Reductions of the model to use, whatever they cost.
        forbid: Reductions not to use.
        work: Most communication steps and substeps of a run; None: 2e6.

    Raises:
        BadInput: a number out of its range.
    """

    relative: float | None = None
    settle_s: float | None = None
    window_s: float | None = None
    samples: int | None = None
    force: str | Sequence[str] = ()
    forbid: str | Sequence[str] = ()
    work: float | None = None

    def __post_init__(self) -> None:
        if self.relative is not None:
            checked_accuracy(self.relative, "accuracy")
        if self.settle_s is not None and not 0.0 <= self.settle_s < math.inf:
            raise BadInput(f"settle_s: found {self.settle_s!r}, wanted a time of at least 0")
        if self.window_s is not None and not 0.0 < self.window_s < math.inf:
            raise BadInput(f"window_s: found {self.window_s!r}, wanted a positive time")
        if self.work is not None and not 0.0 < self.work < math.inf:
            raise BadInput(f"work: found {self.work!r}, wanted a positive number of steps")
        if self.samples is not None and self.samples < 1:
            raise BadInput(f"samples: found {self.samples!r}, wanted at least 1")
        for name in ("force", "forbid"):
            value = getattr(self, name)
            object.__setattr__(self, name, (value,) if isinstance(value, str) else tuple(value))

    @classmethod
    def of(cls, accuracy: float | Accuracy | None) -> Accuracy:
        """The settings, of which the relative accuracy is the one mostly given.

        Args:
            accuracy: Settings, or the relative accuracy alone.
        """
        return accuracy if isinstance(accuracy, Accuracy) else cls(accuracy)

    @property
    def annotation(self) -> AccuracyAnnotation:
        """What is to be forced and forbidden."""
        return AccuracyAnnotation(force=tuple(self.force), forbid=tuple(self.forbid))


@checked
class Fmu:
    """An FMU: its variables, and worker processes that run it.

    Args:
        source: Path of an FMU (FMI 2.0 or 3.0), or a model of this project, as "CoupledOscillator".
        workers: Processes, at least 1, from the first run, or in a ``with`` block, until `close`.
        timeout_s: Longest run, s; then the FMU has failed.
        timeout_name: Name of that time in errors.
        isolate: Whether runs have limits of memory, time and files, and no network; "strict": an
            error where the system cannot enforce all; or an `Isolation`.
        interface: "co-simulation" or "model-exchange", whose equations are integrated here; None:
            the first that the FMU offers.
        native: Whether a model of this project is compiled from C, if there is a compiler: the same
            numbers, faster.
        output_delay_steps: Communication steps by which outputs come late, at least 0: they are
            read so much later (co-simulation).
        tolerance: Relative tolerance of the FMU's own solver, above zero; None: as its
            DefaultExperiment declares.
        start_time_s: Time of the FMU at which every run begins, s; None: as declared, or 0.
        stop_time_s: Stop time that its set-up is given, s, or the end of a longer run; None: as
            declared.

    Raises:
        BadInput: no such file or model, no FMU that this machine can run, no positive numbers.
    """

    def __init__(  # noqa: PLR0913 - keywords that all have defaults
        self,
        source: str | Path,
        workers: int = 2,
        timeout_s: float = 60.0,
        timeout_name: str = "timeout_s",
        isolate: Isolate | Isolation = False,
        interface: str | None = None,
        native: bool = False,
        output_delay_steps: int = 0,
        tolerance: float | None = None,
        start_time_s: float | None = None,
        stop_time_s: float | None = None,
    ) -> None:
        is_model = isinstance(source, str) and source.isidentifier()
        self._model, self._native = str(source) if is_model else "", native
        path = self._built(self._model) if is_model else source
        isolation: Isolation | None = None
        if isolate is not False:
            if sys.platform == "win32":
                raise BadInput("isolate: Windows has no such limits, wanted Linux or macOS")
            strict = isolate == "strict"
            isolation = isolate if isinstance(isolate, Isolation) else Isolation(strict=strict)
        description = read_description(path, interface)
        if output_delay_steps < 0:
            raise BadInput(
                f"output_delay_steps: found {output_delay_steps}, wanted a number of at least 0"
            )
        if output_delay_steps and description.exchange is not None:
            raise BadInput(
                f"output_delay_steps: found {output_delay_steps}, wanted 0: model exchange has no "
                "communication steps"
            )
        experiment = {"tolerance": tolerance, "start_s": start_time_s, "stop_s": stop_time_s}
        given: dict[str, Any] = {key: v for key, v in experiment.items() if v is not None}
        self.workers = FmuWorkers(
            replace(description, output_delay_steps=output_delay_steps, **given),
            workers=workers,
            timeout_s=timeout_s,
            timeout_name=timeout_name,
            isolation=isolation,
        )

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Of a pickle: a model that was built went with its process, and is built again."""
        self.__dict__.update(state)
        if self._model and not self.description.file.is_file():
            path = self._built(self._model)
            self.workers.description = replace(self.description, path=path)

    def _built(self, model: str) -> Path:
        scratch = Scratch()
        weakref.finalize(self, scratch.remove)
        return built_model(model, scratch.path, native=self._native)

    @property
    def description(self) -> FmuDescription:
        """What the FMU declares."""
        return self.workers.description

    @property
    def variables(self) -> Mapping[str, FmuVariable]:
        """Its variables by name."""
        return self.description.variables

    @property
    def warnings(self) -> tuple[str, ...]:
        """Its different logged warnings."""
        return self.workers.warnings

    def simulate(
        self,
        start_values: Mapping[str, Scalar] | None = None,
        *,
        tones: Iterable[str | float] | str = USUAL_TONES,
        drive: WantedDrive | None = None,
        outputs: str | Sequence[str] = (),
        accuracy: float | Accuracy | None = None,
    ) -> DriveResponse:
        """Drive the FMU with some tones and read its steady response.

        Args:
            start_values: By variable: numbers in the FMU's units, or texts as "6.94 MHz"; others
                are the FMU's own.
            tones: Parameters of the FMU that hold the frequencies; with ``drive`` frequencies, in
                Hz or as "280 Hz".
            drive: An input of the FMU that is driven, or parameters that are set; None: start
                values alone drive it.
            outputs: Names; none: the first continuous output.
            accuracy: Largest relative error of every amplitude, in (0, 1), or an `Accuracy`; None:
                1e-6, or the FMU's best.

        Returns:
            ``peaks`` (tones, outputs) in the outputs' units, spectrum, traces, and the plan.

        Raises:
            BadInput: names, values or units that do not fit the FMU.
            FmuFailure: the FMU failed.
        """
        accuracy = Accuracy.of(accuracy)
        plan = self.plan(start_values, tones=tones, drive=drive, outputs=outputs, accuracy=accuracy)
        return respond(self.workers, plan, Shown(accuracy.window_s, accuracy.samples))

    def plan(
        self,
        start_values: Mapping[str, Scalar] | None = None,
        *,
        tones: Iterable[str | float] | str = USUAL_TONES,
        drive: WantedDrive | None = None,
        outputs: str | Sequence[str] = (),
        accuracy: float | Accuracy | None = None,
    ) -> DrivePlan:
        """The plan of `simulate`, without the response: settling, windows, settings.

        Args:
            start_values: By variable: numbers in the FMU's units, or texts as "6.94 MHz"; others
                are the FMU's own.
            tones: Parameters of the FMU that hold the frequencies; with ``drive`` frequencies, in
                Hz or as "280 Hz".
            drive: An input of the FMU that is driven, or parameters that are set; None: start
                values alone drive it.
            outputs: Names; none: the first continuous output.
            accuracy: Largest relative error of every amplitude, in (0, 1), or an `Accuracy`; None:
                1e-6, or the FMU's best.

        Returns:
            ``budget`` has the decisions with their errors, ``promised`` is the sum.

        Raises:
            BadInput: as `simulate`.
            FmuFailure: the FMU failed.
        """
        requested = Accuracy.of(accuracy)
        return plan_drive(
            self.workers,
            drive_request(self.description, start_values, tones, drive, outputs),
            requested.relative,
            settle_s=requested.settle_s,
            annotation=requested.annotation,
            shown=Shown(requested.window_s, requested.samples),
            work=requested.work,
        )

    def sweep(
        self,
        frequency_hz: npt.ArrayLike,
        start_values: Mapping[str, Scalar] | None = None,
        *,
        tone: str = USUAL_TONES[0],
        output: str = "",
        directions: Sequence[str] = ("up",),
        accuracy: float | Accuracy | None = None,
    ) -> SweepResponse:
        """Move a tone through the FMU while it runs and read the amplitude at every point.

        Args:
            frequency_hz: Frequencies of the tone, shape (n,), Hz, rising.
            start_values: By variable: numbers in the FMU's units, or texts as "6.94 MHz"; others
                are the FMU's own.
            tone: The tunable parameter that is moved.
            output: The output that is read; empty: the first continuous one.
            directions: Any of "up" and "down".
            accuracy: Largest error over the largest amplitude, in (0, 1), or an `Accuracy` with the
                time to settle at every point; None: 1e-4, or the FMU's best.

        Returns:
            ``curves`` of amplitudes (n,) by direction, in the output's unit, with their jumps.

        Raises:
            BadInput: names, values or units that do not fit the FMU, frequencies that do not rise.
            FmuFailure: the FMU failed.
        """
        requested = Accuracy.of(accuracy)
        for name in ("window_s", "samples", "force", "forbid"):
            if getattr(requested, name) not in (None, ()):
                raise BadInput(f"{name}: has no meaning in a sweep, only in a drive")
        wanted = sweep_request(
            self.description, frequency_hz, start_values, tone, output, directions
        )
        settle_s, work = requested.settle_s, requested.work
        return sweep_through(self.workers, wanted, requested.relative, settle_s=settle_s, work=work)

    def other_tones(
        self, tones: Sequence[str], start_values: Mapping[str, Scalar] | None = None
    ) -> tuple[OtherTone, ...]:
        """Further tones by which the FMU drives itself: parameters named like the known ones.

        Args:
            tones: Parameters that hold the frequencies of the known tones.
            start_values: By variable: numbers in the FMU's units, or texts as "6.94 MHz"; others
                are the FMU's own.

        Returns:
            ``frequency`` and ``amplitude``, the parameters of each.
        """
        return other_tones(tones, start_values or {}, self.variables)

    def sideband(self, response: DriveResponse) -> Sideband | None:
        """The origin of a line next to the tones that keeps the amplitudes from being steady.

        Args:
            response: What `simulate` returned.

        Returns:
            ``tone``, ``sign`` and ``parameter``, whose sum or difference is the line's frequency;
            None without such a line, or without exactly one such parameter.
        """
        if response.other_line is None:
            return None
        drive = response.drive
        tones = dict(zip(drive.names, drive.tones_hz, strict=True))
        return sideband_of(response.other_line, tones, drive.start_values, self.variables)

    def missing_damping(self, response: DriveResponse) -> tuple[str, ...]:
        """Parameters that are 0 and keep a line next to the tones from decaying.

        Args:
            response: What `simulate` returned.

        Returns:
            Their names; none without such a line, or if no single parameter damps it.

        Raises:
            FmuFailure: the FMU's process does not answer.
        """
        if response.other_line is None:
            return ()
        return missing_damping(self.workers, response.plan, response.other_line, self.variables)

    @renamed
    def write(self, result: DriveResponse | SweepResponse, out: str | Path) -> tuple[Path, ...]:
        """Write CSV tables and figures of a response, as the commands do.

        Args:
            result: What `simulate` or `sweep` returned.
            out: Folder, made where there is none.

        Returns:
            The files.

        Raises:
            BadInput: the folder cannot be written, or holds other files of these names.
        """
        if isinstance(result, DriveResponse):
            write = partial(write_drive, result, self.description)
            return written(out, "simulate", DRIVE_FILES, write)
        return written(out, "sweep", SWEEP_FILES, partial(write_sweep, result, self.description))

    def close(self) -> None:
        """End the worker processes until the next run."""
        self.workers.close()

    def __enter__(self) -> Fmu:
        self.workers.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        d = self.description
        return f"<Fmu {d.model_name}: FMI {d.fmi_version}, {len(d.variables)} variables, {d.path}>"

    def _repr_html_(self) -> str:
        d = self.description
        stated = {
            f"{v.causality} {v.name}": " ".join(
                str(part) for part in (v.start, v.unit) if part is not None
            )
            for v in d.variables.values()
        }
        caption = f"{d.model_name} (FMI {d.fmi_version})"
        pairs = table("pairs", caption=caption, heads=("variable", "start"), pairs=stated)
        return html_table(pairs)


def opened_fmu(fmu: Fmu | str | Path) -> Fmu:
    """The FMU itself, or that of a path or of a model's name.

    Args:
        fmu: Any of them.

    Raises:
        BadInput: no such file or model, no FMU that this machine can run.
    """
    return fmu if isinstance(fmu, Fmu) else Fmu(fmu)


def _of_any_fmu(
    method: Callable[Concatenate[Fmu, Arguments], Result],
) -> Callable[Concatenate[Fmu | str | Path, Arguments], Result]:
    """A method of an FMU as a function of one, which may be given by its path or name."""

    @wraps(method)
    def function(
        fmu: Fmu | str | Path, /, *args: Arguments.args, **kwargs: Arguments.kwargs
    ) -> Result:
        return method(opened_fmu(fmu), *args, **kwargs)

    return function


#: `Fmu.simulate` and `Fmu.sweep` as functions of the FMU, its path, or a model's name.
simulate = _of_any_fmu(Fmu.simulate)
sweep = _of_any_fmu(Fmu.sweep)
