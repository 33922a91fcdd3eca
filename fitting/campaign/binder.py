"""The FMU's variables as a campaign meets them: there, of the right kind, numbers in their unit."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import partial

from fitting.fmu.variables import READABLE, REPORTABLE, SETTABLE, VariableLike
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, did_you_mean, gathered
from fitting.text.finding import Finding, Kind, note
from fitting.text.units import dimension_of, parse_quantity, to_base
from fitting.text.written import Written, in_unit

#: Parts of a campaign as errors name them in a file; ``measurement`` is the table of another kind.
IN_FILE: Mapping[str, str] = {
    "parameters": "[[parameters]]",
    "parameter": "[parameters '{}']",
    "start": "[fmu.start]",
    "drive": "[drive]",
    "sweep": "[sweep.set]",
    "measurement": "[{}]",
    "alternatives": "[alternatives]",
    "laws": "[laws]",
}
#: The same as arguments of a program.
IN_PROGRAM: Mapping[str, str] = {
    "parameters": "parameters",
    "parameter": "parameter '{}'",
    "start": "the setup's start_values",
    "drive": "the setup's drive",
    "sweep": "the sweep's settings",
    "measurement": "the measurement {}",
    "alternatives": "alternatives",
    "laws": "laws",
}


class Binder:
    """The FMU's variables, and the notes that converting to their units leaves.

    ``named`` are names in laws: where the FMU has no variable of such a name it is a coefficient
    if it is a parameter, else a control quantity, whose numbers stay in the unit that they are
    first met in, see ``control_units``. ``top`` opens errors, which call a campaign's ``parts`` so.
    """

    def __init__(
        self,
        variables: Mapping[str, VariableLike],
        named: Collection[str] = (),
        top: str = "",
        parts: Mapping[str, str] = IN_FILE,
    ) -> None:
        self.variables = variables
        self.notes: list[Finding] = []
        self.control_units: dict[str, str] = {}
        self.free_names = frozenset(named).difference(variables)
        self.top = top
        self._parts = parts

    def part(self, part: str, name: str = "") -> str:
        """What a part of the campaign is called.

        Args:
            part: as "drive".
            name: of it, where there are several.
        """
        return self._parts[part].format(name)

    def variable(
        self, name: str, where: str, causalities: Sequence[str], role: str
    ) -> VariableLike:
        """The variable of that name, if it may play the role.

        Args:
            name: of the variable.
            where: file, row or key, for errors.
            causalities: FMI causalities that will do.
            role: what the variable is for, for errors.
        """
        if name not in self.variables:
            # what a law names may be set or fitted as well
            free = sorted(self.free_names) if role in ("set", "fitted") else []
            named = ", and no law names it" if free else ""
            hint = did_you_mean(name, [*free, *sorted(self.variables)])
            raise BadInput(f"{where}: the FMU has no variable '{name}'{named}{hint}")
        variable = self.variables[name]
        # the start value of a state may be set and fitted, whatever its causality
        is_start = getattr(variable, "initial", None) == "exact"
        is_start &= getattr(variable, "variability", None) != "constant"
        is_start &= role.startswith("set") or role == "fitted"
        if variable.causality not in causalities and not is_start:
            raise BadInput(
                f"{where}: '{name}' is a variable of causality {variable.causality}, which cannot "
                f"be {role}; wanted {' or '.join(causalities[:2])}"
            )
        return variable

    def real(self, name: str, where: str, causalities: Sequence[str], role: str) -> VariableLike:
        """As :meth:`variable`, and a Real one.

        Args:
            name: of the variable.
            where: file, row or key, for errors.
            causalities: FMI causalities that will do.
            role: what the variable is for, for errors.
        """
        variable = self.variable(name, where, causalities, role)
        if not is_real(variable):
            raise BadInput(
                f"{where}: '{name}' is {_of_kind(variable)} of the FMU, wanted a Real one"
            )
        return variable

    def reported(self, name: str, where: str, by_laws: Collection[str]) -> VariableLike:
        """A real variable that is reported; a parameter only where a law sets it.

        A parameter that the fit sets itself is reported in any case.

        Args:
            name: of the variable.
            where: that names it, for errors.
            by_laws: names of the variables that laws set.

        Raises:
            BadInput: no such variable, or none that can be reported.
        """
        return self.real(name, where, REPORTABLE if name in by_laws else READABLE, "reported")

    def value(self, variable: VariableLike, written: Written) -> Scalar:
        """A written value as the FMU takes it.

        Args:
            variable: of the FMU.
            written: number or quantity as the file has it.
        """
        raw, kind = written.value, variable.kind
        if is_real(variable):
            return self.number(variable, written)
        if kind == "Boolean" and (isinstance(raw, bool) or raw in (0, 1)):
            return bool(raw)
        whole = isinstance(raw, int) and not isinstance(raw, bool)
        if (kind == "String" and isinstance(raw, str)) or (kind == "Integer" and whole):
            return raw
        raise BadInput(
            f"{written.where}: found {raw!r}, but '{variable.name}' is {_of_kind(variable)}"
        )

    def number(self, variable: VariableLike, written: Written) -> float:
        """A written number in the variable's unit, within its min and max.

        Args:
            variable: of the FMU.
            written: number or quantity as the file has it.
        """
        has_unit = isinstance(written.value, str) or written.unit is not None
        if has_unit and variable.unit is None:
            self.note_missing_unit(variable)
        value = in_unit(written, variable.unit)
        low, high = variable.min, variable.max
        if (low is not None and value < low) or (high is not None and value > high):
            raise BadInput(
                f"{written.where}: {value:.10g} {variable.unit or ''} is outside the range "
                f"[{low}, {high}] that the FMU declares for '{variable.name}'"
            )
        return value

    def note_missing_unit(self, variable: VariableLike) -> None:
        """Note, once, what is done where the FMU declares no unit.

        Args:
            variable: of the FMU.
        """
        self.note(note(Kind.unit_undeclared, variable.name))

    def note(self, finding: Finding) -> None:
        """Note what was taken, once.

        Args:
            finding: that asks nothing of the reader.
        """
        if finding not in self.notes:
            self.notes.append(finding)

    def setting(self, name: str, written: Written) -> Scalar:
        """Check that a variable may be set, and convert the value; or that of a control quantity.

        Args:
            name: of the variable, or of the control quantity.
            written: number or quantity as the file has it.
        """
        where, unit = written.where, written.unit
        if name not in self.free_names:
            return self.value(self.variable(name, where, SETTABLE, "set"), written)
        if isinstance(written.value, str):
            unit = parse_quantity(written.value, where=where)[1]
        if unit is None:
            raise BadInput(
                f"{where}: the control quantity '{name}' has no unit, wanted one; a plain number "
                "has the unit 1"
            )
        if name not in self.control_units:
            dimension_of(unit, where=where)
            try:
                to_base(1.0, unit, where=where)
            except BadInput as error:  # no law could work in it
                raise BadInput(
                    f"{where}: the control quantity '{name}' is in the logarithmic unit '{unit}'; "
                    "wanted a linear one, or 1 for plain numbers"
                ) from error
        return in_unit(written, self.control_units.setdefault(name, unit))

    def settings(self, written: Mapping[str, Written]) -> dict[str, Scalar]:
        """Values of several variables or control quantities, as `setting` takes each.

        Args:
            written: as the file has them, by name.

        Raises:
            BadInput: a line for each that cannot be had.
        """
        values = gathered(partial(self.setting, *each) for each in written.items())
        return dict(zip(written, values, strict=True))


def _of_kind(variable: VariableLike) -> str:
    return f"{'an' if variable.kind[0] in 'AEIOU' else 'a'} {variable.kind} variable"


def is_real(variable: VariableLike) -> bool:
    """Whether the variable is a Real one.

    Args:
        variable: of the FMU.
    """
    return variable.kind == "Real"
