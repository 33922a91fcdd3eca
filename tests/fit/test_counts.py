"""Runs, evaluations and loaded modules of shipped jobs: none takes a tenth more than committed."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.support.shipped_runs import DATA, ShippedRun

ROOT = Path(__file__).parents[2]
COMMITTED = tomllib.loads((ROOT / "tests" / "counts.toml").read_text("utf-8"))
#: What a job may take more than committed: other processors round otherwise, and take other steps.
MORE = 1.1
SWEEP = DATA / "afm_sensor" / "afm_sensor_sweep.dat"
COMMANDS = {
    "import fitting": "import fitting",
    "fmu-fit --help": "from fitting.cli.main import main; main(['--help'])",
    "fmu-fit line": f"from fitting.cli.main import main; main(['line', {str(SWEEP)!r}])",
}


@pytest.mark.parametrize("name", COMMITTED["reconstruct"])
def test_a_shipped_campaign_takes_no_more_runs(name: str, request: pytest.FixtureRequest) -> None:
    run: ShippedRun = request.getfixturevalue(f"{name}_run")
    result = run.result
    assert result.knowledge is not None
    taken = {
        "evaluations": result.evaluations.objective,
        "fmu_runs": result.evaluations.fmu_runs,
        "profile_evaluations": result.knowledge.effort.evaluations,
        "profile_runs": result.knowledge.effort.fmu_runs,
    }
    committed = COMMITTED["reconstruct"][name]
    assert {key: n for key, n in taken.items() if n > MORE * committed[key]} == {}, taken


@pytest.mark.parametrize("command", COMMITTED["modules"])
def test_a_command_loads_no_more_modules(command: str) -> None:
    counted = (
        "import sys\n"
        "try:\n"
        f"    {COMMANDS[command]}\n"
        "except SystemExit:\n"
        "    pass\n"
        "print(sum(name.partition('.')[0] == 'fitting' for name in sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", counted], cwd=ROOT, capture_output=True, text=True, check=True
    )
    loaded = int(done.stdout.split()[-1])
    assert loaded <= MORE * COMMITTED["modules"][command], loaded
