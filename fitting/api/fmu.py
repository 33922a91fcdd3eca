"""An FMU as its users hold it: started when first needed, ended with the object."""

from __future__ import annotations

import math
import sys
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy.typing as npt

from fitting.api.early import DRIVE_FILES, SWEEP_FILES
from fitting.api.printed import written
from fitting.api.request import USUAL_TONES, drive_request, sweep_request
from fitting.campaign.bound import Drive as WantedDrive
from fitting.campaign.file import WrittenFmu
from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.fmu.description import (
    FmuDescription,
    FmuVariable,
    OtherTone,
    other_tones,
    read_description,
)
from fitting.fmu.isolation import Isolate, Isolation
from fitting.fmu.models import provide_fmu
from fitting.fmu.pool import MOST_WORKERS as MOST_WORKERS
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
    """How accurate simulated amplitudes are wanted, and what their plan has to keep to.

    Args:
        relative: Wanted largest error, above 0 and below 1: of a drive relative to each amplitude,
            of a sweep to the largest; None: 1e-6 of a drive, 1e-4 of a sweep.
        settle_s: Time before sampling, in a sweep at every point, s; None: found by watching the
            amplitudes. What a given time leaves of the transient is a part of the promise.
        window_s: Length of the spectrum that is shown of a drive, s; None: some common periods.
        samples: Number of samples in it; None: by the band.
        force: Reductions of the model that a drive takes, whatever they cost.
        forbid: Reductions that it does not take.
        work: Communication steps and substeps that a run may take, at most; None: 2e6.

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
        source: Path of an FMU file (FMI 2.0 or 3.0), or the name of a model of this project, as
            "CoupledOscillator", which is built on the spot.
        workers: Number of processes, at least 1; they start at the first run, or with a
            ``with`` block, and end with it, with ``close``, or when nothing refers to this object
            any more.
        timeout_s: Longest time for one run, s; then the FMU counts as failed.
        timeout_name: What complaints call that time.
        isolate: Whether its processes run with limits of memory, processor time, open files and
            written bytes, in a folder of their own and without network; "strict": a system that
            cannot hold all of it is refused; or these limits.
        interface: By which it is run, "co-simulation" or "model-exchange", whose equations are
            integrated here; None: the first of these that it offers.
        native: Whether a model of this project is compiled from C, where there is a compiler: the
            same numbers, faster.
        output_delay_steps: Communication steps by which its outputs come late, at least 0: they are
            read so many steps later, which co-simulation alone has.

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
    ) -> None:
        if not isinstance(source, str | PathLike):
            raise BadInput(f"Fmu: found a {type(source).__name__}, wanted a path or a model's name")
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
        self.workers = FmuWorkers(
            replace(description, output_delay_steps=output_delay_steps),
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
        return provide_fmu(WrittenFmu(model=model, native=self._native), scratch.path)

    @property
    def description(self) -> FmuDescription:
        """What the FMU declares."""
        return self.workers.description

    @property
    def variables(self) -> Mapping[str, FmuVariable]:
        """Its variables by name, in the order of the modelDescription."""
        return self.description.variables

    @property
    def warnings(self) -> tuple[str, ...]:
        """The different warnings that it logged."""
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
            start_values: Start values by variable: numbers in the FMU's units, or texts such as
                "6.94 MHz"; the others are the FMU's own.
            tones: Parameters of the FMU that hold the frequencies of the tones; with ``drive`` the
                frequencies themselves, in Hz or as "280 Hz".
            drive: What makes tones of these frequencies: an input of the FMU, or parameters that
                are set; None: the FMU does, by its start values.
            outputs: Names of outputs; none: the first continuous one.
            accuracy: Wanted largest relative error of every amplitude, between 0 and 1, or an
                `Accuracy` with more to keep to; None: 1e-6, or what the FMU can give.

        Returns:
            ``peaks`` (tones, outputs) in the outputs' units, spectrum, traces, and the plan with
            the promised accuracy.

        Raises:
            BadInput: names, values or units that do not fit the FMU.
            FmuFailure: the FMU failed.
        """
        requested = Accuracy.of(accuracy)
        plan = self.plan(
            start_values, tones=tones, drive=drive, outputs=outputs, accuracy=requested
        )
        return respond(self.workers, plan, Shown(requested.window_s, requested.samples))

    def plan(
        self,
        start_values: Mapping[str, Scalar] | None = None,
        *,
        tones: Iterable[str | float] | str = USUAL_TONES,
        drive: WantedDrive | None = None,
        outputs: str | Sequence[str] = (),
        accuracy: float | Accuracy | None = None,
    ) -> DrivePlan:
        """The plan on which `simulate` stands, without the response: settling, windows, settings.

        Args:
            start_values: As `simulate` takes them.
            tones: Likewise.
            drive: Likewise.
            outputs: Likewise.
            accuracy: Likewise.

        Returns:
            ``budget`` holds the decisions with what they promise, ``promised`` their sum.

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

        Other tones of the FMU do not drive: their amplitudes are set to zero, see `other_tones`.

        Args:
            frequency_hz: Frequencies of the tone, shape (n,), Hz, rising.
            start_values: Start values by variable: numbers in the FMU's units, or texts such as
                "0.3 m/s2"; the others are the FMU's own.
            tone: The tunable parameter of the FMU that is moved.
            output: The output that is read; empty: the first continuous one.
            directions: Any of "up" and "down".
            accuracy: Wanted largest error relative to the largest amplitude, between 0 and 1, or
                an `Accuracy` with the time to settle at every point; None: 1e-4, or what the FMU
                can give.

        Returns:
            ``curves`` of amplitudes (n,) by direction, in the output's unit, and their jumps.

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
        """Tones by which the FMU drives besides some: named like them, with an amplitude.

        Args:
            tones: Parameters that hold the frequencies of the known tones.
            start_values: Start values by variable; the others are the FMU's own.

        Returns:
            ``frequency`` and ``amplitude``, the parameters of each.
        """
        return other_tones(tones, start_values or {}, self.variables)

    def sideband(self, response: DriveResponse) -> Sideband | None:
        """What a line next to the tones is, where it keeps the amplitudes from standing still.

        Args:
            response: What `simulate` returned.

        Returns:
            ``tone``, ``sign`` and ``parameter``: the line is at their sum or difference; None where
            there is no such line, or not one parameter of the FMU with that frequency.
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
            Their names; none where there is no such line, or no single parameter damps it.

        Raises:
            FmuFailure: the FMU's process does not answer.
        """
        if response.other_line is None:
            return ()
        return missing_damping(self.workers, response.plan, response.other_line, self.variables)

    @renamed
    def write(self, result: DriveResponse | SweepResponse, out: str | Path) -> tuple[Path, ...]:
        """Write what the command line writes of a response: CSV tables and figures.

        Args:
            result: What `simulate` or `sweep` returned.
            out: Folder, made where there is none.

        Returns:
            The files.

        Raises:
            BadInput: the folder cannot be written, or holds files of these names that are not ours.
        """
        description = self.description
        if isinstance(result, DriveResponse):
            return written(
                out, "simulate", DRIVE_FILES, lambda to: write_drive(result, description, to)
            )
        return written(out, "sweep", SWEEP_FILES, lambda to: write_sweep(result, description, to))

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
