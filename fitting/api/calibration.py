"""What a fit found, for other tools: an FMU with the fitted start values, and parameter sets."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from fitting.api.fitted import Valued
from fitting.api.printed import HtmlText
from fitting.api.written import CALIBRATED_FILES
from fitting.fmu import FmuDescription, read_description
from fitting.fmu.models import Rebuilding, rebuilt
from fitting.fmu.parameter_set import parameter_set, system_structure
from fitting.result.calibration import Calibration, calibration, calibration_csv
from fitting.result.result import Result, read_result
from fitting.text.errors import BadInput
from fitting.text.files import write_whole
from fitting.text.results_folder import remove_earlier, results_folder

__all__ = ["Calibrated", "calibrate"]


@dataclass(frozen=True, kw_only=True)
class Calibrated(HtmlText):
    """What was handed on: values in ``calibration``, and the files.

    ``fmu`` is None where the FMU is not of this project: its start values are compiled in. ``ssv``
    is the parameter set, ``ssp`` the FMU and the set together, ``table`` all fitted parameters.
    """

    calibration: Calibration
    fmu: Path | None
    ssv: Path
    ssp: Path
    table: Path


def calibrate(
    found: Valued | Result | str | Path,
    out: str | Path,
    *,
    fmu: str | Path | None = None,
    also: Collection[str] = (),
) -> Calibrated:
    """Hand a fit on: an FMU with the fitted start values, .ssv, .ssp and a table.

    Only what the data determine is handed on by itself; everything else stays at the start value
    of the FMU. Errors and intervals go along as annotations.

    Args:
        found: An inference, its result, or the path of a result.json.
        out: Folder for the files, made where there is none.
        fmu: The FMU that was fitted; None: the one in ``fmu/`` beside result.json, or that of the
            problem.
        also: Parameters that are handed on although the data do not determine them.

    Raises:
        BadInput: no result, another FMU than the one that was fitted, or a folder that cannot be
            written.
    """
    result, source = _result(found)
    path = _fmu(result, source, fmu)
    description = read_description(path)
    if description.sha256 != result.provenance.fmu_sha256:
        raise BadInput(
            f"{path}: is not the FMU that was fitted: found sha256 {description.sha256[:12]}, "
            f"wanted {result.provenance.fmu_sha256[:12]}"
        )
    handed = calibration(result, description, also)
    out = Path(out)
    with results_folder(out, "calibrate", CALIBRATED_FILES):
        written = _written(handed, result, description, out)
        remove_earlier(out, CALIBRATED_FILES)
        return written


def _written(
    handed: Calibration, result: Result, description: FmuDescription, out: Path
) -> Calibrated:
    name = f"{description.model_name}_calibrated"
    wanted = Rebuilding(
        name=name, history=_history(handed, result, description), start_values=handed.start_values
    )
    built = rebuilt(description.file, wanted, out)
    values = parameter_set(name, handed.set_values(), description)
    ssv, ssp, table = out / f"{name}.ssv", out / f"{name}.ssp", out / "parameters.csv"
    write_whole(ssv, values)
    packed = description if built is None else read_description(built)
    write_whole(ssp, system_structure(packed.path, values, packed))
    write_whole(table, calibration_csv(handed))
    return Calibrated(calibration=handed, fmu=built, ssv=ssv, ssp=ssp, table=table)


def _history(handed: Calibration, result: Result, description: FmuDescription) -> str:
    names = ", ".join(handed.start_values) or "no parameter"
    synthetic = " to synthetic data" if result.synthetic else ""
    return (
        f"Start values of {names} come from a fit{synthetic}: {result.title}, finished "
        f"{result.provenance.finished}, {result.status}. The FMU that was fitted has the GUID "
        f"{description.guid}."
    )


def _result(found: Valued | Result | str | Path) -> tuple[Result, Path | None]:
    """The result, and the file that it was read from."""
    if isinstance(found, Valued):
        return found.result, None
    if isinstance(found, Result):
        return found, None
    return read_result(Path(found)), Path(found)


def _fmu(result: Result, source: Path | None, fmu: str | Path | None) -> Path:
    """Where the FMU is that was fitted."""
    if fmu is not None:
        return Path(fmu)
    name = result.provenance.fmu_file
    if source is not None and (source.parent / "fmu" / name).is_file():
        return source.parent / "fmu" / name
    where = "" if source is None else f"{source}: "
    raise BadInput(
        f"{where}the FMU that was fitted, {name}, is not in the folder of the result: wanted --fmu"
    )
