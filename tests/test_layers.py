"""The shape of the code: imports climb down, foreign libraries have one door, parts are small."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

#: A module imports only from rows above its own; a new module takes its place in the table.
LADDER = (
    "errors",
    "joint_result",
    "fmu.log knowledge laboratory leastsq lockstep notation progress scaling structure variables",
    "laboratory_plan",
    "budget duffing_laboratory exact_modes files fmu.description fmu.records parameters peaks "
    "response spectrum tables units",
    "measured",
    "joint_response",
    "amplitudes campaign_section combinations fmu.hints fmu.orders fmu.signal instruments "
    "objective options plan records",
    "campaign_accuracy campaign_drift tradeoff_records",
    "campaign_noise tradeoff_front tradeoff_memory tradeoff_reading",
    "campaign_binder campaign_schema evaluator fmu.interface plan_probe plots_style result "
    "synthesis tradeoff_tables",
    "elsewhere plan_settling plots_tradeoff synthesis_plan",
    "plan_refined synthesis_cross",
    "campaign_data duffing_synthesis fmu.reuse fmu.simulation knowledge_words linear_program "
    "plan_search plots_knowledge symmetry uncertainty",
    "drifting gauss_newton",
    "bench_noise",
    "campaign_binding fmu.worker interior_point likelihood ranges",
    "continuation descent fmu.process labdata",
    "bootstrap nu_choice profiles tradeoff_scenes",
    "exploration reported tradeoff_campaign",
    "identifiability verdicts",
    "joint_campaign",
    "noise",
    "assembly checkpoint data_warnings fmu.workers job planning plots_campaign plots_deviation "
    "plots_history sweep_line",
    "consistency",
    "corrections",
    "joint_parts",
    "fmu inference plots_reconstruction reconstruction report_tables",
    "batch drive report_drift report_knowledge report_plan tradeoff_bench",
    "report_joint",
    "drive_lines drive_options driving frf report_sections tradeoff_grid tradeoff_quantities",
    "campaign_plan drive_plan tradeoff_reference",
    "external",
    "fmu_job identification plots_drive plots_frf report tradeoff_extrapolation tradeoff_plan",
    "design_candidates design_choice design_information design_result report_tradeoff "
    "tradeoff_study",
    "design_limits design_points",
    "design",
    "design_campaign design_proposal plots_design report_design",
    "commands.check commands.design commands.identify commands.reconstruct commands.simulate "
    "commands.sweep commands.synthesize commands.tradeoff",
    "cli",
    "__main__",
)
RANKS = {f"fitting.{name}": rank for rank, row in enumerate(LADDER) for name in row.split()}

#: The only doors through which a library comes in.
DOORS = {
    "fmpy": r"fitting\.fmu\..*",
    "jinja2": r"fitting\.report.*",
    "matplotlib": r"fitting\.plots.*",
    "mpmath": r"fitting\.exact_modes",
    "pint": r"fitting\.units",
    "scipy.optimize": r"fitting\.(interior_point|linear_program|leastsq|continuation)",
    "tqdm": r"fitting\.progress",
}
NOWHERE = ("build_fmu", "fmu_src", "pythonfmu", "tests")

MODULE_LINES, FUNCTION_LINES = 400, 50

SOURCES = sorted(
    [*ROOT.glob("fitting/**/*.py"), *ROOT.glob("fmu_src/**/*.py"), ROOT / "build_fmu.py"]
)
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for path in SOURCES
    if path.is_relative_to(ROOT / "fitting")
}


def imports(tree: ast.AST, known: set[str]) -> set[str]:
    """Full names of all modules imported anywhere in a module."""
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative import"
            base = node.module or ""
            inner = {f"{base}.{alias.name}" for alias in node.names}
            found |= inner & known or {base}
    return found


def climbs(name: str, tree: ast.AST) -> list[str]:
    """Imports of a module that do not climb down."""
    packages = {"fitting", "fitting.commands"}
    wanted = imports(tree, set(RANKS)) - packages
    return [
        m for m in sorted(wanted) if m.startswith("fitting") and RANKS.get(m, 99) >= RANKS[name]
    ]


def comes_through(tree: ast.AST) -> set[str]:
    """Foreign libraries with a door of their own that a module imports."""
    found = imports(tree, set())
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module == "scipy":
            found |= {f"scipy.{alias.name}" for alias in node.names}
    names = (*DOORS, *NOWHERE)
    return {lib for lib in names for m in found if m == lib or m.startswith(f"{lib}.")}


def long_functions(tree: ast.AST) -> list[str]:
    """Functions longer than allowed, the docstring apart."""
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    found = []
    for node in (n for n in ast.walk(tree) if isinstance(n, kinds)):
        lines = (node.end_lineno or 0) - node.lineno + 1
        if ast.get_docstring(node) is not None:
            text = node.body[0]
            lines -= (text.end_lineno or 0) - text.lineno + 1
        if lines > FUNCTION_LINES:
            found.append(f"{node.name}: {lines} lines")
    return found


@pytest.mark.parametrize("name", sorted(set(MODULES) - {"fitting", "fitting.commands"}))
def test_imports_climb_down(name: str) -> None:
    assert name in RANKS, f"{name} has no place in the ladder yet"
    assert climbs(name, ast.parse(MODULES[name].read_text("utf-8"))) == []


@pytest.mark.parametrize("name", sorted(MODULES))
def test_foreign_libraries_come_through_their_door(name: str) -> None:
    for library in comes_through(ast.parse(MODULES[name].read_text("utf-8"))):
        assert library in DOORS, f"{name} imports {library}"
        assert re.fullmatch(DOORS[library], name), f"{name} imports {library}"


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_parts_are_small(path: Path) -> None:
    text = path.read_text("utf-8")
    assert len(text.splitlines()) <= MODULE_LINES
    assert long_functions(ast.parse(text)) == []


def test_ladder_names_no_module_twice() -> None:
    assert len(RANKS) == sum(len(row.split()) for row in LADDER)


def test_these_checks_can_fail() -> None:
    """What they are there to find, in small."""
    upward = ast.parse("from fitting import cli\nfrom fitting.units import convert\n")
    assert climbs("fitting.units", upward) == ["fitting.cli", "fitting.units"]
    assert climbs("fitting.cli", ast.parse("from fitting import plan")) == []
    hidden = ast.parse(
        "def f():\n    from scipy import optimize\n    import fmpy.fmi2\n    import fmu_src\n"
    )
    assert comes_through(hidden) == {"scipy.optimize", "fmpy", "fmu_src"}
    body = "    x = 1\n" * FUNCTION_LINES
    doc = '    """Long.\n' + "\n" * 60 + '    """\n'
    assert long_functions(ast.parse(f"def f():\n{body}")) == ["f: 51 lines"]
    assert long_functions(ast.parse(f"def f():\n{doc}    x = 1\n")) == []
