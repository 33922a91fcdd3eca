"""What the set-up of a run is given: tolerance, start and stop time, as declared or as stated."""

from __future__ import annotations

from pathlib import Path

import pytest
from pythonfmu import FmuBuilder

import fitting as ff
from fitting.campaign.binder import Binder
from fitting.fmu.description import read_description
from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import Run
from fitting.text.units import as_written
from tests.support.cfmu_build import build_c_fmu, build_reference_fmu, reworded

SLAVE = '''
from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Real


class Stated(Fmi2Slave):
    """Its outputs are what its set-up was given."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.start = self.stop = self.tolerance = self.at = -1.0
        self.default_experiment = DefaultExperiment(
            start_time=2.0, stop_time=5.0, step_size=1.0, tolerance=1e-5
        )
        for name in ("start", "stop", "tolerance", "at"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def setup_experiment(self, start_time, stop_time, tolerance):
        self.start, self.stop, self.tolerance = start_time, stop_time or -1.0, tolerance or -1.0

    def do_step(self, time, step):
        self.at = time + step
        return True
'''


@pytest.fixture(scope="module")
def stated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stated")
    (folder / "stated.py").write_text(SLAVE, "utf-8")
    FmuBuilder.build_FMU(str(folder / "stated.py"), dest=str(folder))
    return folder / "Stated.fmu"


def run(samples: int) -> Run:
    outputs = ("start", "stop", "tolerance", "at")
    return Run(start_values={}, settle_s=0.0, sample_step_s=1.0, samples=samples, outputs=outputs)


def test_the_default_experiment_goes_into_the_set_up(stated: Path) -> None:
    """A run that is longer than declared has a stop time that is no earlier than its end."""
    with FmuWorkers(stated) as workers:
        [short], [long] = workers.run([run(3)]), workers.run([run(9)])
    assert short[-1].tolist() == [2.0, 5.0, 1e-5, 4.0]
    start, stop, tolerance, at = long[-1].tolist()
    assert (start, tolerance, at) == (2.0, 1e-5, 10.0)
    assert stop >= 10.0


def test_what_is_stated_goes_before_what_is_declared(stated: Path) -> None:
    fmu = ff.Fmu(stated, 1, tolerance=1e-8, start_time_s=1.0, stop_time_s=7.0)
    [answer] = fmu.workers.run([run(3)])
    assert answer[-1].tolist() == [1.0, 7.0, 1e-8, 3.0]


def test_without_an_experiment_nothing_is_stated(tmp_path: Path) -> None:
    read = read_description(build_c_fmu(tmp_path))
    assert (read.start_s, read.stop_s, read.tolerance) == (0.0, None, None)


def test_items_of_enumerations_are_values(tmp_path: Path) -> None:
    """Feedthrough of the Modelica Association has an enumeration of two options."""
    fmu = build_reference_fmu(tmp_path, "Feedthrough")
    variables = read_description(fmu).variables
    choice = variables["Enumeration_input"]
    assert dict(choice.items) == {"Option 1": 1, "Option 2": 2}
    binder = Binder(variables)
    assert binder.value(choice, as_written("Option 2", "here")) == 2
    assert binder.value(choice, as_written(1, "here")) == 1
    with pytest.raises(ff.BadInput, match="Option 1 and Option 2"):
        binder.value(choice, as_written("Option 3", "here"))


def test_a_coefficient_in_an_input_is_fitted_where_it_is_named(tmp_path: Path) -> None:
    """The stiffness as an input: init offers it, and the campaign binds."""
    words = {
        'name="stiffness" valueReference="2" causality="parameter" variability="fixed" '
        'initial="exact"': 'name="stiffness" valueReference="2" causality="input" '
        'variability="continuous"'
    }
    fmu = reworded(build_c_fmu(tmp_path), words)
    rows = "".join(f"{f},{1.0 / abs(complex(320.0 - f, 15.0))}\n" for f in range(286, 359, 6))
    (tmp_path / "sweep.csv").write_text("frequency (Hz),R (V)\n" + rows, "utf-8")
    told = {"fit": ["stiffness", "damping"], "input": "force"}
    path, _ = ff.init([tmp_path / "sweep.csv"], fmu, out=tmp_path / "draft", told=told)
    problem = ff.Problem.of(path)
    assert set(problem.names) == {"stiffness", "damping"}
