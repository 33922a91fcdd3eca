"""Compile C FMUs for the tests with the system's compiler and fmpy's FMI headers.

``cfmus`` are the tests' own, ``reference_fmus`` those of the Modelica Association, unchanged.
"""

from __future__ import annotations

import shutil
import subprocess
import sysconfig
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import fmpy

from fitting.fmu.runs import Run

SOURCES = Path(__file__).parent / "cfmus"
REFERENCE = Path(__file__).parent / "reference_fmus"
HEADERS = Path(fmpy.__file__).parent / "c-code"
#: A run of the oscillator under a force.
PULLED = Run(
    start_values={"force": 1.0},
    settle_s=0.0,
    sample_step_s=1e-3,
    samples=4,
    outputs=("displacement",),
)


def misbehaving(how: int, label: Path | str = "") -> Run:
    """The same run, in which the oscillator does something wrong.

    Args:
        how: value of `misbehave`, in the order of the enum in model.h.
        label: path, port or word that this is done with.
    """
    return replace(PULLED, start_values={"force": 1.0, "misbehave": how, "label": str(label)})


def build_c_fmu(
    folder: Path,
    *,
    fmi: int = 2,
    reset: str = "RESET_WORKS",
    once: bool = False,
    platform: str | None = None,
    marks: Mapping[str, Path | float] | None = None,
) -> Path:
    """The driven oscillator m x'' + c x' + k x = F as an FMU in ``folder``.

    ``reset`` one of the RESET names in model.h; ``once``: a second instance in a process fails;
    ``platform`` files the binary under another platform's name; ``marks``: files that it writes
    when it hangs at another stiffness than its own (HANGS_WHERE_VARIED) or forks (FORKS_ONCE), the
    relative NOISE of its output, and any number where it CRASHES_WHEN_FREED.
    """
    stem = f"oscillator{fmi}_{reset.lower()}{'_once' if once else ''}"
    library = folder / f"{stem}{fmpy.sharedLibraryExtension}"
    defines = [f"-DRESET={reset}", *(["-DONLY_ONE_INSTANCE"] if once else [])]
    for name, value in (marks or {}).items():
        defines.append(f"-D{name}={value!r}" if isinstance(value, float) else f'-D{name}="{value}"')
    compile_library(SOURCES / f"oscillator{fmi}.c", library, defines)
    if platform is None:
        platform = fmpy.platform if fmi == 2 else fmpy.platform_tuple
    description = (SOURCES / f"oscillator{fmi}.xml").read_text("utf-8")
    path = folder / f"{stem}.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(
            "modelDescription.xml", description.replace("@ONCE@", "true" if once else "false")
        )
        archive.write(library, f"binaries/{platform}/oscillator{fmpy.sharedLibraryExtension}")
    return path


def reworded(fmu: Path, words: Mapping[str, str]) -> Path:
    """The same FMU with other words in its description, beside it."""
    path = fmu.with_name(f"{fmu.stem}_reworded.fmu")
    with zipfile.ZipFile(fmu) as source, zipfile.ZipFile(path, "w") as target:
        for name in source.namelist():
            content = source.read(name)
            if name == "modelDescription.xml":
                for before, after in words.items():
                    assert before.encode() in content
                    content = content.replace(before.encode(), after.encode())
            target.writestr(name, content)
    return path


def build_lag_fmu(folder: Path) -> Path:
    """The lag tau x' + x = gain u, y = x + through u as an FMU in ``folder``."""
    return _first_order(folder, "lag", ())


def build_euler_lag_fmu(
    folder: Path,
    step_s: float,
    *,
    divides: bool = False,
    told: bool = False,
    heun: bool = False,
    refuses: bool = False,
) -> Path:
    """The lag by steps of Euler's method of its own, which may stand in its description.

    ``divides``: shorter communication steps divide them; ``heun``: by his method, of second order;
    ``refuses``: communication steps that are no whole ones are refused.
    """
    options = [f"-DOWN_STEP={step_s!r}"]
    options += ["-DDIVIDES"] if divides else []
    options += ["-DHEUN"] if heun else []
    options += ["-DREFUSES"] if refuses else []
    path = _first_order(folder, "lag", options)
    if not told:
        return path
    usual = f'<DefaultExperiment stepSize="{step_s!r}"/>\n  <ModelVariables>'
    return reworded(path, {"<ModelVariables>": usual})


def build_wall_fmu(folder: Path) -> Path:
    """The wall C T' = (Ti1 - T)/R1 + (Ti2 - T)/R2 between two rooms as an FMU in ``folder``."""
    return _first_order(folder, "wall", ("-DWALL",))


def build_room_fmu(folder: Path) -> Path:
    """The heated room C T' = (To - T)/R1 + Q, Ti = T + R2 Q as an FMU in ``folder``."""
    return _first_order(folder, "room", ("-DROOM",))


def _first_order(folder: Path, name: str, options: Sequence[str]) -> Path:
    library = folder / f"{name}{fmpy.sharedLibraryExtension}"
    compile_library(SOURCES / "lag2.c", library, options)
    path = folder / f"{name}.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(SOURCES / f"{name}2.xml", "modelDescription.xml")
        archive.write(library, f"binaries/{fmpy.platform}/{library.name}")
    return path


def build_own_step_fmu(
    folder: Path,
    kind: str = "STANDS_BETWEEN",
    *,
    told: bool = False,
    step_s: float = 1e-3,
    fmi: int = 2,
) -> Path:
    """The driven oscillator that advances in steps of its own as an FMU in ``folder``.

    ``kind`` one of the names in own_step.h; ``told``: the step stands in its description, in FMI 3
    as the fixed one of its solver.
    """
    library = folder / f"own_step{fmpy.sharedLibraryExtension}"
    options = [f"-DKIND={kind}", f"-DSTEP={step_s!r}"]
    compile_library(SOURCES / f"own_step{fmi}.c", library, options)
    usual = f'<DefaultExperiment stepSize="{step_s!r}"/>'
    experiment = (usual if fmi == 2 else f'fixedInternalStepSize="{step_s!r}"') if told else ""
    description = (SOURCES / f"own_step{fmi}.xml").read_text("utf-8")
    platform = fmpy.platform if fmi == 2 else fmpy.platform_tuple
    path = folder / f"own_step_{kind.lower()}.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", description.replace("@EXPERIMENT@", experiment))
        archive.write(library, f"binaries/{platform}/{library.name}")
    return path


def build_exchange_fmu(folder: Path, fmi: int = 2, *, both: bool = False) -> Path:
    """m x'' = force + weight - c x' - k x, with a wall or without, of model exchange alone.

    ``both``: of co-simulation, too, by a method of first order over the communication steps.
    """
    library = folder / f"exchange{fmpy.sharedLibraryExtension}"
    compile_library(SOURCES / f"exchange{fmi}.c", library, ["-DBOTH"] if both else [])
    path = folder / f"exchange{fmi}.fmu"
    platform = fmpy.platform if fmi == 2 else fmpy.platform_tuple
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(SOURCES / f"exchange{fmi}.xml", "modelDescription.xml")
        archive.write(library, f"binaries/{platform}/{library.name}")
    offer = '<ModelExchange modelIdentifier="exchange"/>'
    co_simulation = (
        '<CoSimulation modelIdentifier="exchange" canHandleVariableCommunicationStepSize="true"/>'
    )
    return reworded(path, {offer: offer + co_simulation}) if both else path


def build_matrix_fmu(folder: Path) -> Path:
    """x' = A x + B u, y = x of two states by FMI 3.0, its variables arrays."""
    library = folder / f"matrix{fmpy.sharedLibraryExtension}"
    compile_library(SOURCES / "matrix3.c", library)
    path = folder / "matrix3.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(SOURCES / "matrix3.xml", "modelDescription.xml")
        archive.write(library, f"binaries/{fmpy.platform_tuple}/{library.name}")
    return path


def build_reference_fmu(folder: Path, name: str) -> Path:
    """The Reference FMU of a name in ``reference_fmus``, for FMI 2.0, in ``folder``.

    Its co-simulation takes steps of Euler's method of its own, FIXED_SOLVER_STEP of its config.h.
    """
    model, sources = REFERENCE / name, REFERENCE / "src"
    library = folder / f"{name}{fmpy.sharedLibraryExtension}"
    headers = (f"-I{model}", f"-I{REFERENCE / 'include'}")
    further = (model / "model.c", sources / "cosimulation.c")
    options = ("-DFMI_VERSION=2", "-DDISABLE_PREFIX", "-fvisibility=hidden", *headers)
    compile_library(sources / "fmi2Functions.c", library, [*options, *map(str, further)])
    path = folder / f"{name}.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(model / "FMI2.xml", "modelDescription.xml")
        archive.write(library, f"binaries/{fmpy.platform}/{library.name}")
    return path


def compile_library(source: Path, library: Path, options: Sequence[str] = ()) -> None:
    """Shared library of one C file, with the compiler that ``cc`` is here."""
    compiler = shutil.which("cc") or sysconfig.get_config_var("CC").split()[0]
    command = [compiler, "-shared", "-fPIC", "-O1", f"-I{HEADERS}", *options]
    subprocess.run([*command, str(source), "-o", str(library), "-lm"], check=True)
