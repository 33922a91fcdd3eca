"""Models run in this process, by the calls that a host makes, without an FMU around them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from fmu_src.slave import STATUS_MESSAGE, ModelSlave

_SETTERS = {"Real": "set_real", "Integer": "set_integer", "Boolean": "set_boolean"}


class Slave:
    """One run of a model.

    Args:
        model: the class of the FMU.
        begin: start time, s.
        values: parameters and inputs by name.
    """

    def __init__(self, model: type[ModelSlave], begin: float = 0.0, **values: Any) -> None:
        self._slave = model(instance_name="run")
        self._places = {variable.name: k for k, variable in enumerate(model.variables)}
        self._kinds = {variable.name: variable.kind for variable in model.variables}
        self.now = begin
        self.set(**values)
        self._slave.setup_experiment(begin)
        self._slave.enter_initialization_mode()
        self._slave.exit_initialization_mode()

    def set(self, **values: Any) -> None:
        """Set parameters and inputs.

        Args:
            values: by name.
        """
        for name, value in values.items():
            getattr(self._slave, _SETTERS[self._kinds[name]])([self._places[name]], [value])

    def get(self, *names: str) -> list[float]:
        """Real outputs.

        Args:
            names: of the outputs.
        """
        return list(self._slave.get_real([self._places[name] for name in names]))

    def step(self, time: float) -> bool:
        """Move on to a time; whether that went well.

        Args:
            time: s.
        """
        done = bool(self._slave.do_step(self.now, time - self.now))
        self.now += time - self.now
        return done

    def run(self, times: Sequence[float], *names: str) -> list[list[float]]:
        """Outputs at ascending times, a row for each.

        Args:
            times: s.
            names: of the outputs.
        """
        rows = []
        for time in times:
            assert self.step(time), self.message
            rows.append(self.get(*names))
        return rows

    def state(self) -> str:
        """Variables and motion, as an FMU serialises them."""
        return json.dumps([self.now, self._slave._get_fmu_state()])

    def take(self, state: str) -> None:
        """Go on from a state.

        Args:
            state: that of another run of the same model.
        """
        self.now, kept = json.loads(state)
        self._slave._set_fmu_state(kept)

    @property
    def message(self) -> str:
        """Why the run failed, empty while it has not."""
        return str(self._slave.get_string([self._places[STATUS_MESSAGE]])[0])
