"""The steps that an FMU tells of itself."""

from __future__ import annotations

from pathlib import Path

import pytest

from fitting.fmu.description import read_description
from fitting.text.errors import BadInput
from tests.support.cfmu_build import build_c_fmu, reworded

EXPERIMENT = {"<ModelStructure>": '<DefaultExperiment stepSize="0.004"/><ModelStructure>'}
ANY_LENGTH = 'canHandleVariableCommunicationStepSize="true"'
FIXED = {"<CoSimulation ": '<CoSimulation fixedInternalStepSize="5e-4" '}


def test_own_steps_are_read(tmp_path: Path) -> None:
    """A fixed step of its own goes before that of its default experiment."""
    told = read_description(reworded(build_c_fmu(tmp_path, fmi=3), {**EXPERIMENT, **FIXED}))
    assert (told.internal_step_s, told.usual_step_s, told.any_steps) == (5e-4, 0.004, True)
    assert told.step_s == 5e-4
    usual = read_description(reworded(build_c_fmu(tmp_path), EXPERIMENT))
    assert usual.step_s == 0.004
    none = read_description(reworded(build_c_fmu(tmp_path), {ANY_LENGTH: ""}))
    assert (none.internal_step_s, none.usual_step_s, none.any_steps) == (None, None, False)
    assert none.step_s is None


def test_a_step_that_is_no_number_is_refused(tmp_path: Path) -> None:
    words = {"<ModelStructure>": '<DefaultExperiment stepSize="soon"/><ModelStructure>'}
    with pytest.raises(BadInput, match="stepSize: found 'soon'"):
        read_description(reworded(build_c_fmu(tmp_path), words))
