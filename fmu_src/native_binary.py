"""The native twin of a model: the C sources of ``native/`` compiled into the binaries of an FMU.

The variable table is written out as C, so that both FMUs have one; a platform's objects are made
once and linked to the FMU's identity, which is known only when everything else of it is.
"""

from __future__ import annotations

import importlib.util
import json
import math
import platform
import re
import shutil
import struct
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from xml.dom.minidom import parseString
from xml.etree.ElementTree import tostring

from .fmi3_description import to_fmi3
from .start_values import BuildError
from .variables import make_table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .slave import ModelSlave
    from .start_values import StartValue

FOLDER = "native"
#: Sources that every model needs for a version of FMI; the rest is found by what they include.
INTERFACE = {2: ("fmi2", "slave"), 3: ("fmi3", "fmi3_refused", "slave")}
#: The file in ``resources`` that says what a native FMU was made from.
RECORD = "resources/built_from.json"

#: The header of a model of a family: the number in its name.
SIZE = """\
/* Written by build_fmu.py from the model's name. */
#ifndef SIZE_H
#define SIZE_H

enum {{ SIZE = {number} }};

#endif
"""

#: No contraction to fused products: sums of two doubles would lose their second, and results would
#: differ from one compiler to the next.
COMPILE = ("-std=c11", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-g0", "-I.")
#: What else the binary is for, with zig: no checks that end a host, no path of this machine.
ZIG = ("-fno-sanitize=undefined",)
LINK_LINUX = ("-Wl,--build-id=none", "-Wl,-Bsymbolic", "-s")


@dataclass(frozen=True)
class Target:
    """A platform by the name of its folder in ``binaries``: extension, zig's names of its parts."""

    extension: str
    zig: tuple[str, ...]
    compile: tuple[str, ...] = ()
    link: tuple[str, ...] = ()


#: FMI 2.0 has no name for Linux on ARM; FMI 3.0's is taken. A Mac's binary of FMI 2.0 holds both
#: processors, in FMI 3.0 each has a folder.
TARGETS = {
    "linux64": Target(".so", ("x86_64-linux-gnu.2.17",), ("-fPIC",), LINK_LINUX),
    "win64": Target(".dll", ("x86_64-windows-gnu",), (), ("-s",)),
    "aarch64-linux": Target(".so", ("aarch64-linux-gnu.2.17",), ("-fPIC",), LINK_LINUX),
    "darwin64": Target(".dylib", ("x86_64-macos", "aarch64-macos"), ("-fPIC",)),
}
#: The system of a platform, as FMI 3.0 calls it after the processor.
SYSTEMS = {
    "linux64": "linux",
    "aarch64-linux": "linux",
    "win64": "windows",
    "darwin64": "darwin",
}
THIS = {"linux": "linux64", "win32": "win64", "darwin": "darwin64"}


@dataclass(frozen=True)
class Toolchain:
    """One compiler for one platform: the command, and what it needs besides ``COMPILE``."""

    platform: str
    command: tuple[str, ...]
    part: str  # of the platform, with zig
    compile: tuple[str, ...]
    link: tuple[str, ...]

    def folder(self, fmi: int) -> str:
        """Return the folder of the binary in ``binaries`` of an FMU of that version of FMI."""
        if fmi == 2:
            return self.platform
        arm = self.part.lower().startswith(("aarch64", "arm64"))
        return f"{'aarch64' if arm else 'x86_64'}-{SYSTEMS[self.platform]}"


def toolchains(platforms: Sequence[str]) -> list[Toolchain]:
    """Return the compilers for platforms, by zig; none named is this one, by its own ``cc`` or zig.

    Raises ``BuildError`` for an unknown platform and where there is no compiler.
    """
    if not platforms:
        if shutil.which("cc") is None and importlib.util.find_spec("ziglang") is not None:
            return toolchains([THIS[sys.platform]])
        return [_own()]
    unknown = [name for name in platforms if name not in TARGETS]
    if unknown:
        raise BuildError(f"platform {unknown[0]!r}: there are {', '.join(TARGETS)}")
    if importlib.util.find_spec("ziglang") is None:
        raise BuildError(
            "--platforms: compiling for other platforms needs the package ziglang "
            "(pip install fmu-fit[native])"
        )
    zig = (sys.executable, "-m", "ziglang", "cc")
    return [
        Toolchain(
            name,
            (*zig, "-target", part),
            part,
            (*TARGETS[name].compile, *ZIG),
            TARGETS[name].link,
        )
        for name in sorted(set(platforms))
        for part in TARGETS[name].zig
    ]


def _own() -> Toolchain:
    compiler = shutil.which("cc")
    if compiler is None or sys.platform not in THIS:
        raise BuildError(
            "--native: there is no C compiler 'cc' here; wanted is one, or the package ziglang "
            "(pip install fmu-fit[native])"
        )
    name = THIS[sys.platform]
    target = TARGETS[name]
    # a host on Linux looks into linux64 whatever the processor
    return Toolchain(name, (compiler,), platform.machine(), target.compile, target.link)


# --- sources ------------------------------------------------------------------------------------


def headers() -> Path:
    """Return the folder with the official headers of FMI, which fmpy brings."""
    spec = importlib.util.find_spec("fmpy")
    folder = Path(str(spec.origin)).parent / "c-code" if spec else Path()
    if not (folder / "fmi2Functions.h").is_file():
        raise BuildError("--native: the headers of FMI are missing; wanted is the package fmpy")
    return folder


def headers_licence() -> bytes:
    """Return the licence of the headers, which they carry in their first comment of that kind."""
    text = (headers() / "fmi2Functions.h").read_text("utf-8")
    comments: list[str] = re.findall(r"/\*(.*?)\*/", text, re.S)
    for comment in comments:
        start = comment.find("Copyright")
        if start >= 0:
            lines = [line.strip() for line in comment[start:].strip().splitlines()]
            return ("\n".join(lines) + "\n").encode()
    raise BuildError("the headers of FMI come without their licence, which the FMU must carry")


def needed_sources(folder: Path, model: str, fmi: int = 2) -> list[Path]:
    """Return the C files that a model's module and the interface need, headers included."""
    needed: dict[str, Path] = {}
    result = [f"{name}.c" for name in (model, *INTERFACE[fmi])]
    while result:
        name = result.pop()
        if name in needed or not (folder / name).is_file():
            continue
        needed[name] = folder / name
        included = re.findall(r'^#include "(\w+)\.h"', needed[name].read_text("utf-8"), re.M)
        result += [f"{stem}{end}" for stem in included for end in (".h", ".c")]
    return [needed[name] for name in sorted(needed)]


def has_twin(source: Path, module: str) -> bool:
    """Return whether a model has a native twin."""
    return (source / FOLDER / f"{module}.c").is_file()


def _table_header(model_class: type[ModelSlave], module: str) -> str:
    """Return ``model.h``: the variables' references by name, and how many there are of a kind."""
    variables = model_class.variables
    table = make_table(variables, model_class.moving, {})
    names = "\n".join(f"    V_{v.name} = {i}," for i, v in enumerate(variables))
    return f"""\
/* Written by build_fmu.py from the variable table of fmu_src/{module}.py. */
#ifndef MODEL_H
#define MODEL_H

#include "{module}.h"

enum {{
{names}
    VARIABLE_COUNT = {len(variables)},
    MOVING_COUNT = {len(model_class.moving)},
    STEADY_COUNT = {len(table.steady)}
}};

#endif
"""


def _table_source(model_class: type[ModelSlave], overrides: Mapping[str, StartValue]) -> str:
    """Return ``table.c``: the variable table with its start values, to their last bit."""
    variables = model_class.variables
    starts = make_table(variables, model_class.moving, overrides).starts
    rows = []
    for variable, start in zip(variables, starts):
        moves = variable.name in model_class.moving
        fields = (
            f'"{variable.name}"',
            variable.kind.upper(),
            variable.causality.upper(),
            str(variable.variability == "fixed").lower(),
            str(moves).lower(),
            _constant(start),
        )
        rows.append(f"    {{{', '.join(fields)}}},")
    body = "\n".join(rows)
    return f"""\
/* Written by build_fmu.py. */
#include <math.h>

#include "slave.h"

const struct variable variables[VARIABLE_COUNT] = {{
{body}
}};
"""


def written(
    model_class: type[ModelSlave], module: str, overrides: Mapping[str, StartValue]
) -> dict[str, str]:
    """Return the sources that are made for one FMU: file name -> text."""
    made = {
        "model.h": _table_header(model_class, module),
        "table.c": _table_source(model_class, overrides),
    }
    if number := re.search(r"[0-9]+$", model_class.__name__):
        made["size.h"] = SIZE.format(number=number[0])
    return made


def _constant(value: StartValue) -> str:
    if isinstance(value, str):
        return "0.0"  # the one String is no number: its text begins empty
    number = float(value)
    return number.hex() if math.isfinite(number) else "NAN"


# --- compiling ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Objects:
    """The objects of a model for one compiler, in a folder of their own, without an identity."""

    folder: Path
    toolchain: Toolchain
    files: tuple[str, ...]

    def link(self, guid: str) -> bytes:
        """Return the binary of the FMU with this GUID."""
        tool = self.toolchain
        identity = f'#include "identity.h"\n\nconst char model_guid[] = "{guid}";\n'
        (self.folder / "identity.c").write_text(identity, encoding="utf-8")
        options = (*COMPILE, *tool.compile)
        compiled_to = ("-o", "identity.o")
        _run([*tool.command, *options, "-c", "identity.c", *compiled_to], self.folder)
        # the name is written into a Mac's and a Windows binary
        name = f"model{TARGETS[tool.platform].extension}"
        objects = (*self.files, "identity.o")
        _run([*tool.command, "-shared", *tool.link, "-o", name, *objects, "-lm"], self.folder)
        return (self.folder / name).read_bytes()


def compiled(
    stage: Path, sources: Sequence[Path], made: Mapping[str, str], tool: Toolchain
) -> Objects:
    """Compile the sources, and those made for this FMU, in a folder of ``stage``."""
    folder = stage / f"{tool.platform}_{tool.part}"
    folder.mkdir(parents=True)
    for path in (*sources, *headers().glob("fmi[23]*.h")):
        shutil.copyfile(path, folder / path.name)
    for name, text in made.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    names = sorted(path.name for path in folder.glob("*.c"))
    objects = tuple(f"{Path(name).stem}.o" for name in names)
    for name, made_of in zip(objects, names):  # zig makes no two objects for Windows in one call
        _run([*tool.command, *COMPILE, *tool.compile, "-c", made_of, "-o", name], folder)
    return Objects(folder, tool, objects)


def _run(command: Sequence[str], folder: Path) -> None:
    # relative names and a folder of its own: nothing of this machine gets into the binary
    done = subprocess.run(  # noqa: S603
        command, cwd=folder, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL
    )
    if done.returncode != 0:
        message = [line for line in done.stderr.splitlines() if "error" in line.lower()]
        reason = (message or done.stderr.splitlines() or ["no message"])[0].strip()
        raise BuildError(f"the C compiler {' '.join(command[:4])} failed: {reason}")


def binaries(
    objects: Sequence[Objects], name: str, guid: str, fmi: int = 2
) -> list[tuple[str, bytes]]:
    """Return path in the FMU and content of the binary of each platform."""
    linked: dict[str, list[bytes]] = {}
    for one in objects:
        extension = TARGETS[one.toolchain.platform].extension
        path = f"binaries/{one.toolchain.folder(fmi)}/{name}{extension}"
        linked.setdefault(path, []).append(one.link(guid))
    return [
        (path, parts[0] if len(parts) == 1 else _universal(parts)) for path, parts in linked.items()
    ]


#: Mac binaries of several processors: the file's mark, and where a part may begin.
_UNIVERSAL, _ALIGNMENT = 0xCAFEBABE, 14


def _universal(parts: Sequence[bytes]) -> bytes:
    """Return one Mac binary of several, each with the processor that its own header names."""
    head = struct.pack(">II", _UNIVERSAL, len(parts))
    size = 1 << _ALIGNMENT
    place, body = size, b""
    for part in parts:
        processor, kind = struct.unpack_from("<II", part, 4)
        head += struct.pack(">IIIII", processor, kind, place + len(body), len(part), _ALIGNMENT)
        body += part + b"\0" * (-len(part) % size)
    return head.ljust(size, b"\0") + body


# --- the rest of the FMU ------------------------------------------------------------------------


def differentiable(sources: Sequence[Path]) -> bool:
    """Return whether a model of these sources knows derivatives in closed form."""
    return any(path.name == "tangent.c" for path in sources)


@dataclass(frozen=True)
class Interface:
    """What a native FMU offers its host: the version of FMI, derivatives in closed form."""

    fmi: int
    derivatives: bool


def description(
    model_class: type[ModelSlave],
    name: str,
    overrides: Mapping[str, StartValue],
    guid: str,
    interface: Interface,
) -> bytes:
    """Return the Python FMU's modelDescription.xml, with what differs in a binary of its own."""
    twin = type(name, (model_class,), {"start_overrides": dict(overrides), "guid_text": guid})
    root = twin(instance_name="described").to_xml({"canGetAndSetFMUstate": "true"})
    root.set("generationTool", "fmu-fit build_fmu.py, C11")
    co_simulation = root.find("CoSimulation")
    if co_simulation is None:
        raise BuildError("pythonfmu wrote no CoSimulation")
    co_simulation.set("needsExecutionTool", "false")
    co_simulation.set("canSerializeFMUstate", "true")
    if interface.derivatives:
        co_simulation.set("providesDirectionalDerivative", "true")
    if interface.fmi == 3:
        root = to_fmi3(root)
    text: bytes = parseString(tostring(root, "UTF-8")).toprettyxml(encoding="UTF-8")  # noqa: S318
    return text


def record(
    model: str, overrides: Mapping[str, StartValue], platforms: Sequence[str], fmi: int
) -> bytes:
    """Return what the FMU was built from, for ``--like``."""
    content = {
        "model": model,
        "start_values": dict(overrides),
        "platforms": list(platforms),
        "fmi": fmi,
    }
    return (json.dumps(content, indent=1) + "\n").encode()
