"""What a fit found, for other tools: an FMU with the fitted start values, and parameter sets."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from fitting.api.early import CALIBRATED_FILES
from fitting.api.fitted import Valued
from fitting.api.printed import HtmlText, written
from fitting.campaign.file import read_campaign_file
from fitting.fmu.description import read_description
from fitting.fmu.models import rebuilt
from fitting.fmu.parameter_set import parameter_set, system_structure
from fitting.measurements.kinds import KINDS
from fitting.result.calibration import Calibration, calibration, calibration_csv
from fitting.result.result import Result, read_result
from fitting.text.errors import BadInput
from fitting.text.old_names import renamed
from fitting.text.results_folder import write_whole

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


@renamed
def calibrate(
    result: Valued | Result | str | Path,
    out: str | Path,
    *,
    fmu: str | Path | None = None,
    also: Collection[str] = (),
) -> Calibrated:
    """Write a fit for other tools: an FMU with fitted start values, .ssv, .ssp and a table.

    Only determined values are written, with errors and intervals as annotations; others keep the
    FMU's start values.

    Args:
        result: An inference, its result, or the path of a result.json.
        out: Folder for the files, made where there is none.
        fmu: The fitted FMU; None: that in ``fmu/`` next to result.json, or the campaign's.
        also: Parameters to write although the data do not determine them.

    Raises:
        BadInput: no result, another FMU than the one that was fitted, or a folder that cannot be
            written.
    """
    source = Path(result) if isinstance(result, str | Path) else None
    if isinstance(result, Valued):
        fitted = result.result
    else:
        fitted = result if isinstance(result, Result) else read_result(Path(result))
    provenance = fitted.provenance
    written_campaign = None
    with suppress(BadInput):  # it may be elsewhere by now
        written_campaign = read_campaign_file(Path(provenance.campaign), KINDS)
    if fmu is None:  # a model that was built lies in the folder of the results
        places = [] if source is None else [source.parent / "fmu" / provenance.fmu_file]
        if written_campaign is not None and written_campaign.fmu.file is not None:
            places.append(written_campaign.fmu.file)
        fmu = next((place for place in places if place.is_file()), None)
        if fmu is None:
            where = "" if source is None else f"{source}: "
            raise BadInput(
                f"{where}the FMU that was fitted, {provenance.fmu_file}, is neither in the folder "
                "of the result nor where its campaign names one: wanted --fmu"
            )
    description = read_description(Path(fmu))
    if description.sha256 != provenance.fmu_sha256:
        raise BadInput(
            f"{fmu}: is not the FMU that was fitted: found sha256 {description.sha256[:12]}, "
            f"wanted {provenance.fmu_sha256[:12]}"
        )
    drive = None if written_campaign is None else written_campaign.drive
    tones = drive.frequencies if drive is not None and drive.kind == "tones" else ()
    handed = calibration(fitted, description, also, tones)
    name, out = f"{description.model_name}_calibrated", Path(out)
    ssv, ssp, parameters = out / f"{name}.ssv", out / f"{name}.ssp", out / "parameters.csv"
    names = ", ".join(handed.start_values) or "no parameter"
    synthetic = " to synthetic data" if fitted.synthetic else ""
    history = (
        f"Start values of {names} come from a fit{synthetic}: {fitted.title}, finished "
        f"{provenance.finished}, {fitted.status}. The FMU that was fitted has the GUID "
        f"{description.guid}."
    )

    def write(to: Path) -> Path | None:
        built = rebuilt(description.file, to, name, history, handed.start_values)
        values = parameter_set(name, handed.set_values(description), description)
        packed = description if built is None else read_description(built)
        write_whole(ssv, values)
        write_whole(ssp, system_structure(packed.path, values, packed))
        write_whole(parameters, calibration_csv(handed))
        return built

    built = written(out, "calibrate", CALIBRATED_FILES, write)
    return Calibrated(calibration=handed, fmu=built, ssv=ssv, ssp=ssp, table=parameters)
