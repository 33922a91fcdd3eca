"""How an FMU is built from the sources here, the same bytes from the same sources and options.

pythonfmu does the building; what it leaves to chance is settled here. With ``native`` a C compiler
does it: the same model and variables in a binary that needs no Python. Every FMU is assembled
twice: first under a blank name, then under the name that is the digest of that content. The name
goes into the GUID and into the module names inside the FMU, so that two FMUs, or a rebuilt one,
never share a Python module in one process. The archive is stored, not deflated: deflated bytes
differ between zlib and its replacements, and half a megabyte is not worth an FMU that depends on
it.
"""

from __future__ import annotations

import ast
import contextlib
import difflib
import hashlib
import importlib
import importlib.metadata
import importlib.util
import io
import json
import os
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import jinja2
import pythonfmu

from fmu_src import native_binary
from fmu_src.start_values import BuildError, checked_start_values

if TYPE_CHECKING:
    from fmu_src.slave import ModelSlave
    from fmu_src.start_values import StartValue

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "fmu_src"
OUT = ROOT / "build"

# needsExecutionTool: the binary inside is a bridge to a Python interpreter that the machine must
# have (libpython 3.8 or later), which is what this flag tells a host.
OPTIONS = {
    "needsExecutionTool": True,
    "canHandleVariableCommunicationStepSize": True,
    "canInterpolateInputs": False,
    "canBeInstantiatedOnlyOncePerProcess": False,
    "canGetAndSetFMUstate": True,
    "canSerializeFMUstate": True,
}

BRIDGE = "bridge"  # the module of the package that every slave module needs
BLANK_TAG = "0" * 12
BLANK_GUID = f"{{{uuid.UUID(int=0)}}}"
ZIP_DATE = (1980, 1, 1, 0, 0, 0)  # the earliest date a zip can hold

SLAVE = '''\
"""The slave of this FMU: the model, named, with the start values that it was built with."""

from {package}.bridge import attach
from {package}.{module} import {model} as Fmi2Slave

attach(globals(), {name!r})


class {name}(Fmi2Slave):
    start_overrides = {overrides!r}
    guid_text = {guid!r}
'''


class _Identity(NamedTuple):
    tag: str
    guid: str


class Variant(NamedTuple):
    """A model under a name of its own (empty: the model's), with the history of its start values.

    The history is a sentence for the page in the FMU; ``fmi`` is the version of the interface, 2 or
    (native alone) 3.
    """

    name: str = ""
    history: str = ""
    fmi: int = 2


class _Job(NamedTuple):
    model: str
    source: Path
    module: str
    overrides: Mapping[str, StartValue]
    variant: Variant
    native: Sequence[str] | None

    @property
    def name(self) -> str:
        """The name of the FMU, of its binary and of its class."""
        return self.variant.name or self.model


def build(
    model: str = "CoupledOscillator",
    out: str | os.PathLike[str] = OUT,
    start_values: Mapping[str, StartValue] | None = None,
    *,
    source: Path = SOURCE,
    variant: Variant | None = None,
    native: Sequence[str] | None = None,
) -> Path:
    """Build one model into ``out`` and return the path of the FMU.

    ``start_values`` replaces start values of parameters, by variable name, in the variable's unit;
    text is read as on the command line. ``source`` is the package with the models; ``variant``
    gives the FMU another name or FMI 3.0; ``native`` names platforms to compile the native twin for
    (none: the present one) instead.

    Raises ``BuildError`` for an unknown model, for a start value that is unknown, not a
    parameter's, of the wrong type or out of bounds, and where a compiler is missing; nothing is
    written then.
    """
    content = fmu_bytes(model, start_values, source=source, variant=variant, native=native)
    name = variant.name if variant is not None and variant.name else model
    return _write_all({name: content}, out)[0]


def build_all(
    models: Sequence[str] | None = None,
    out: str | os.PathLike[str] = OUT,
    start_values: Mapping[str, StartValue] | None = None,
    *,
    source: Path = SOURCE,
    variant: Variant | None = None,
    native: Sequence[str] | None = None,
) -> list[Path]:
    """Build several models (all of them by default); either all are written or none is.

    Where ``native`` is given, all that have a native twin are built by default. Raises
    ``BuildError`` as ``build`` does, for a start value that one of the models refuses too.
    """
    modules = model_modules(source)
    names = list(models) if models is not None else list(modules)
    if models is None and native is not None:
        names = [name for name in names if native_binary.has_twin(source, modules[name])]
    contents = {
        name: fmu_bytes(name, start_values, source=source, variant=variant, native=native)
        for name in names
    }
    return _write_all(contents, out)


def _write_all(contents: Mapping[str, bytes], out: str | os.PathLike[str]) -> list[Path]:
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return [_write_whole(folder / f"{name}.fmu", content) for name, content in contents.items()]
    except OSError as error:
        raise BuildError(f"cannot write into {folder}: {error.strerror}") from error


def fmu_bytes(
    model: str,
    start_values: Mapping[str, StartValue] | None = None,
    *,
    source: Path = SOURCE,
    variant: Variant | None = None,
    native: Sequence[str] | None = None,
) -> bytes:
    """Return the archive of one FMU; raises ``BuildError`` as ``build`` does."""
    variant = variant or Variant()
    if variant.name and (not variant.name.isascii() or not variant.name.isidentifier()):
        raise BuildError(f"name {variant.name!r}: wanted letters, digits and _, no digit first")
    if variant.fmi not in (2, 3) or (variant.fmi == 3 and native is None):
        raise BuildError(f"FMI {variant.fmi}: there are 2 and, of native FMUs, 3")
    module_name = module_of(model, source)
    with loaded(source, module_name) as module:
        model_class = getattr(module, model)
        overrides = checked_start_values(model_class, start_values or {})
        _try_start(model_class, overrides)
        job = _Job(model, source, module_name, overrides, variant, native)
        with tempfile.TemporaryDirectory(prefix="build_fmu_") as folder:
            assemble = _compiled if native is not None else _packaged
            entries = assemble(Path(folder), job, model_class)
            return _archive(entries(_identity(entries(_Identity(BLANK_TAG, BLANK_GUID)))))


def _packaged(
    stage: Path, job: _Job, model_class: type[ModelSlave]
) -> Callable[[_Identity], dict[str, bytes]]:
    """Return what assembles the Python FMU under an identity."""

    def entries(identity: _Identity) -> dict[str, bytes]:
        folder = stage / identity.tag
        _write_documentation(folder / "documentation", _page(job, model_class, identity))
        return _assemble(folder, job, identity)

    return entries


def _compiled(
    stage: Path, job: _Job, model_class: type[ModelSlave]
) -> Callable[[_Identity], dict[str, bytes]]:
    """Compile the native twin, and return what assembles it under an identity."""
    folder = job.source / native_binary.FOLDER
    if not native_binary.has_twin(job.source, job.module):
        raise BuildError(f"--native: {job.model} has no native twin")
    made_here = native_binary.written(model_class, job.module, job.overrides)
    fmi = job.variant.fmi
    sources = native_binary.needed_sources(folder, job.module, fmi)
    interface = native_binary.Interface(fmi, native_binary.differentiable(sources))
    platforms = job.native or ()
    objects = [
        native_binary.compiled(stage, sources, made_here, tool)
        for tool in native_binary.toolchains(platforms)
    ]

    def entries(identity: _Identity) -> dict[str, bytes]:
        licence = (ROOT / "LICENSE").read_bytes()
        model = (model_class, job.name, job.overrides, identity.guid)
        given = native_binary.description(*model, interface)
        page = _page(job, model_class, identity, interface.derivatives).encode()
        made = {
            "modelDescription.xml": given,
            native_binary.RECORD: native_binary.record(job.model, job.overrides, platforms, fmi),
            "documentation/index.html": page,
            "documentation/licenses/license.txt": licence,
            "documentation/licenses/fmi.txt": native_binary.headers_licence(),
            **dict(native_binary.binaries(objects, job.name, identity.guid, fmi)),
        }
        return dict(sorted(made.items()))

    return entries


def _try_start(model_class: type[ModelSlave], overrides: Mapping[str, StartValue]) -> None:
    """Refuse to build what would fail at every start, in the model's own words."""
    trial = type(model_class.__name__, (model_class,), {"start_overrides": overrides})
    instance = trial(instance_name="trial")
    instance.setup_experiment(0.0)
    instance.enter_initialization_mode()
    instance.exit_initialization_mode()
    refusal = instance.value("status_message")
    if refusal:
        raise BuildError(f"{model_class.__name__} cannot start with these values: {refusal}")


def model_modules(source: Path = SOURCE) -> dict[str, str]:
    """Return the models that are built where none is named: class name -> module name."""
    with loaded(source, None) as package:
        return dict(package.MODELS)


def module_of(model: str, source: Path = SOURCE) -> str:
    """Return the module of a model, which may be of a family with a number in the name.

    Raises ``BuildError`` for an unknown model.
    """
    with loaded(source, None) as package:
        models, families = dict(package.MODELS), dict(package.FAMILIES)
    if model in models:
        return str(models[model])
    names = list(models)
    for family, (module, least, most) in families.items():
        if model in (f"{family}{number}" for number in range(least, most + 1)):
            return str(module)
        names.append(f"{family}{least} to {family}{most}")
    near = difflib.get_close_matches(model, names, n=1)
    hint = f" (did you mean {near[0]!r}?)" if near else ""
    raise BuildError(f"there is no model {model!r}{hint}; there are {', '.join(names)}")


class Built(NamedTuple):
    """What an FMU of this builder was built from: the model, the start values that it replaced."""

    model: str
    start_values: Mapping[str, StartValue]
    native: Sequence[str] | None = None
    fmi: int = 2


def built_from(fmu: Path) -> Built:
    """Return what an FMU was built from; raises ``BuildError`` if this builder did not make it."""
    try:
        with zipfile.ZipFile(fmu) as archive:
            if native_binary.RECORD in archive.namelist():
                made = json.loads(archive.read(native_binary.RECORD))
                return Built(
                    made["model"],
                    dict(made["start_values"]),
                    made["platforms"],
                    made.get("fmi", 2),
                )
            module = archive.read("resources/slavemodule.txt").decode().strip()
            tree = ast.parse(archive.read(f"resources/{module}.py"))
        imported = next(
            alias.name
            for node in tree.body
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
            if alias.asname == "Fmi2Slave"
        )
        slave = next(node for node in tree.body if isinstance(node, ast.ClassDef))
        values = next(
            ast.literal_eval(node.value)
            for node in slave.body
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "start_overrides"
        )
        return Built(imported, dict(values))
    except OSError as error:
        raise BuildError(f"{fmu}: cannot be read: {error.strerror}") from error
    except (zipfile.BadZipFile, KeyError, StopIteration, SyntaxError, ValueError) as error:
        raise BuildError(f"{fmu}: is no FMU that build_fmu.py made") from error


# --- loading the sources without leaving a trace -------------------------------------------------


@contextlib.contextmanager
def _no_trace() -> Iterator[None]:
    """Forget what is imported meanwhile: modules, search paths, and no bytecode is written."""
    modules, path, bytecode = set(sys.modules), list(sys.path), sys.dont_write_bytecode
    sys.dont_write_bytecode = True
    try:
        yield
    finally:
        sys.dont_write_bytecode = bytecode
        sys.path[:] = path
        for name in set(sys.modules) - modules:
            if name.startswith(("fmu_", "slave_", "_fmu_source")):
                del sys.modules[name]


@contextlib.contextmanager
def loaded(source: Path, module: str | None) -> Iterator[Any]:
    """Import the source package, or one of its modules, afresh and under a name of its own."""
    name = "_fmu_source"
    spec = importlib.util.spec_from_file_location(
        name, source / "__init__.py", submodule_search_locations=[str(source)]
    )
    if spec is None or spec.loader is None or not (source / "__init__.py").is_file():
        raise BuildError(f"{source} is not a package with models")
    with _no_trace():
        package = importlib.util.module_from_spec(spec)
        sys.modules[name] = package
        spec.loader.exec_module(package)
        importlib.invalidate_caches()
        yield package if module is None else importlib.import_module(f"{name}.{module}")


def needed_modules(source: Path, *modules: str) -> list[str]:
    """Return the modules of the package that some of them need, themselves included, sorted."""
    needed: set[str] = set()
    result = list(modules)
    while result:
        name = result.pop()
        if name in needed or not (source / f"{name}.py").is_file():
            continue
        needed.add(name)
        for node in ast.walk(ast.parse((source / f"{name}.py").read_bytes())):
            if isinstance(node, ast.ImportFrom) and node.level == 1:
                result += [node.module] if node.module else [alias.name for alias in node.names]
    return sorted(needed)


# --- one FMU ------------------------------------------------------------------------------------


def _identity(entries: Mapping[str, bytes]) -> _Identity:
    """Return the name that follows from the content: SHA-256 over all names, lengths and bytes."""
    digest = hashlib.sha256()
    for name, content in entries.items():
        digest.update(f"{name}\0{len(content)}\0".encode())
        digest.update(content)
    return _Identity(digest.hexdigest()[:12], f"{{{uuid.UUID(bytes=digest.digest()[:16])}}}")


def _assemble(stage: Path, job: _Job, identity: _Identity) -> dict[str, bytes]:
    """Let pythonfmu build the FMU in ``stage`` and return its content, sorted by name."""
    package = stage / f"fmu_{job.name.lower()}_{identity.tag}"
    package.mkdir()
    for name in ["__init__", *needed_modules(job.source, job.module, BRIDGE)]:
        (package / f"{name}.py").write_bytes((job.source / f"{name}.py").read_bytes())
    script = stage / f"slave_{job.name.lower()}_{identity.tag}.py"
    slave = SLAVE.format(
        package=package.name,
        module=job.module,
        model=job.model,
        name=job.name,
        overrides=dict(job.overrides),
        guid=identity.guid,
    )
    script.write_text(slave, encoding="utf-8", newline="\n")
    with _no_trace():
        built = pythonfmu.FmuBuilder.build_FMU(
            script,
            dest=stage / "built",
            project_files=[package],
            documentation_folder=stage / "documentation",
            **OPTIONS,
        )
    with zipfile.ZipFile(built) as archive:
        return {name: archive.read(name) for name in sorted(archive.namelist())}


def _archive(entries: Mapping[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name, content in entries.items():
            info = zipfile.ZipInfo(name, ZIP_DATE)
            info.create_system = 3  # Unix, wherever it is built
            info.external_attr = 0o100644 << 16
            archive.writestr(info, content)
    return buffer.getvalue()


def _write_whole(path: Path, content: bytes) -> Path:
    """Write under a temporary name and rename, so that no reader meets half an FMU."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.write_bytes(content)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    return path


# --- documentation ------------------------------------------------------------------------------


def _page(
    job: _Job, model_class: type[ModelSlave], identity: _Identity, derivatives: bool = False
) -> str:
    """Return index.html, made from the variable table by the model's template, else the base's."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(job.source / "documentation"),
        undefined=jinja2.StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    binaries = Path(pythonfmu.__file__).parent / "resources" / "binaries"
    platforms = [path.name for path in binaries.iterdir() if path.is_dir()]
    if job.native is not None:
        tools = native_binary.toolchains(job.native)
        platforms = [tool.folder(job.variant.fmi) for tool in tools]
    family = job.model.rstrip("0123456789")
    templates = [f"{name}.html.j2" for name in (job.model, family, "base")]
    return environment.select_template(templates).render(
        model=job.name,
        history=job.variant.history,
        description=model_class.description,
        version=model_class.version,
        guid=identity.guid,
        pythonfmu_version=pythonfmu.__version__,
        platforms=sorted(set(platforms)),
        native=job.native is not None,
        fmi=job.variant.fmi,
        derivatives=derivatives,
        variables=model_class.variables,
        overrides=job.overrides,
        number=_number,
    )


def _write_documentation(folder: Path, page: str) -> None:
    licences = folder / "licenses"
    licences.mkdir(parents=True)
    for path, text in (
        (folder / "index.html", page),
        (licences / "license.txt", (ROOT / "LICENSE").read_text(encoding="utf-8")),
        (licences / "pythonfmu.txt", _pythonfmu_licence()),
    ):
        path.write_text(text, encoding="utf-8", newline="\n")


def _number(value: StartValue | None) -> str:
    """Return a value as the tables show it: exact, in the shortest digits."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.17g}" if isinstance(value, float) and value.is_integer() else str(value)


def _pythonfmu_licence() -> str:
    """Return the licence of pythonfmu, whose runtime and binaries every FMU carries."""
    distribution = importlib.metadata.distribution("pythonfmu")
    for path in distribution.files or ():
        if path.stem.upper() == "LICENSE":
            return path.read_text(encoding="utf-8")
    raise BuildError("the installed pythonfmu comes without its licence, which the FMU must carry")
