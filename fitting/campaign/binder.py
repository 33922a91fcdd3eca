"""The FMU's variables as a campaign meets them: found, of the right kind, numbers in their unit."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields
from functools import partial

from fitting.campaign.file import WrittenAccuracy
from fitting.fmu.accuracy import AccuracyAnnotation, AccuracyNames, Reduction
from fitting.fmu.variables import READABLE, REPORTABLE, SETTABLE, VariableLike
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, Complaints, did_you_mean, gathered
from fitting.text.units import dimension_of, parse_quantity, to_base
from fitting.text.written import Written, in_unit

#: What names that are no variables of the FMU may be as well: what a law names.
NAMED_BY_LAWS = ("set", "fitted")


class Binder:
    """The FMU's variables, and the notes that converting to their units leaves.

    ``named`` are names in laws: where the FMU has no variable of such a name it is a coefficient
    if it is a parameter, else a control quantity, whose numbers stay in the unit that they are
    first met in, see ``control_units``.
    """

    def __init__(self, variables: Mapping[str, VariableLike], named: Collection[str] = ()) -> None:
        self.variables = variables
        self.notes: list[str] = []
        self.control_units: dict[str, str] = {}
        self.free_names = frozenset(named).difference(variables)

    def variable(
        self, name: str, where: str, causalities: Sequence[str], role: str
    ) -> VariableLike:
        """The variable of that name, if it may play the role.

        Args:
            name: of the variable.
            where: file, row or key, for complaints.
            causalities: FMI causalities that will do.
            role: what the variable is for, for complaints.
        """
        if name not in self.variables:
            free = sorted(self.free_names) if role in NAMED_BY_LAWS else []
            named = ", and no law names it" if free else ""
            hint = did_you_mean(name, [*free, *sorted(self.variables)])
            raise BadInput(f"{where}: the FMU has no variable '{name}'{named}{hint}")
        variable = self.variables[name]
        if variable.causality not in causalities and not _starts(variable, role):
            raise BadInput(
                f"{where}: '{name}' is a variable of causality {variable.causality}, which cannot "
                f"be {role}; wanted {' or '.join(causalities[:2])}"
            )
        return variable

    def real(self, name: str, where: str, causalities: Sequence[str], role: str) -> VariableLike:
        """As :meth:`variable`, and a Real one.

        Args:
            name: of the variable.
            where: file, row or key, for complaints.
            causalities: FMI causalities that will do.
            role: what the variable is for, for complaints.
        """
        variable = self.variable(name, where, causalities, role)
        if not is_real(variable):
            raise BadInput(
                f"{where}: '{name}' is {_of_kind(variable)} of the FMU, wanted a Real one"
            )
        return variable

    def value(self, variable: VariableLike, written: Written) -> Scalar:
        """A written value as the FMU takes it.

        Args:
            variable: of the FMU.
            written: number or quantity as the file has it.
        """
        raw = written.value
        if is_real(variable):
            return self.number(variable, written)
        if variable.kind == "Boolean" and (isinstance(raw, bool) or raw in (0, 1)):
            return bool(raw)
        if variable.kind == "String" and isinstance(raw, str):
            return raw
        whole = isinstance(raw, int) and not isinstance(raw, bool)
        if variable.kind == "Integer" and whole:
            return raw
        raise BadInput(
            f"{written.where}: found {raw!r}, but '{variable.name}' is {_of_kind(variable)}"
        )

    def reported(self, name: str, where: str, by_laws: Collection[str]) -> VariableLike:
        """A real variable that is reported; a parameter only where a law sets it.

        A parameter that the fit sets itself is reported in any case.

        Args:
            name: of the variable.
            where: that names it, for complaints.
            by_laws: names of the variables that laws set.

        Raises:
            BadInput: no such variable, or none that can be reported.
        """
        return self.real(name, where, REPORTABLE if name in by_laws else READABLE, "reported")

    def number(self, variable: VariableLike, written: Written) -> float:
        """A written number in the variable's unit, within its min and max.

        Args:
            variable: of the FMU.
            written: number or quantity as the file has it.
        """
        where = written.where
        has_unit = isinstance(written.value, str) or written.unit is not None
        if has_unit and variable.unit is None:
            self.note_missing_unit(variable)
        value = in_unit(written, variable.unit)
        low, high = variable.min, variable.max
        if (low is not None and value < low) or (high is not None and value > high):
            raise BadInput(
                f"{where}: {value:.10g} {variable.unit or ''} is outside the range "
                f"[{low}, {high}] that the FMU declares for '{variable.name}'"
            )
        return value

    def note_missing_unit(self, variable: VariableLike) -> None:
        """Note, once, what is done where the FMU declares no unit.

        Args:
            variable: of the FMU.
        """
        note = (
            f"The FMU declares no unit for '{variable.name}': values written with a unit "
            "were taken in SI base units."
        )
        self.note(note)

    def note(self, words: str) -> None:
        """Note what was taken, once.

        Args:
            words: a sentence.
        """
        if words not in self.notes:
            self.notes.append(words)

    def setting(self, name: str, written: Written) -> Scalar:
        """Check that a variable may be set, and convert the value; or that of a control quantity.

        Args:
            name: of the variable, or of the control quantity.
            written: number or quantity as the file has it.
        """
        if name in self.free_names:
            return self._control(name, written)
        return self.value(self.variable(name, written.where, SETTABLE, "set"), written)

    def settings(self, asked: Mapping[str, Written]) -> dict[str, Scalar]:
        """Values of several variables or control quantities, as `setting` takes each.

        Args:
            asked: as the file has them, by name.

        Raises:
            BadInput: a line for each that cannot be had.
        """
        values = gathered(partial(self.setting, name, written) for name, written in asked.items())
        return dict(zip(asked, values, strict=True))

    def _control(self, name: str, written: Written) -> float:
        """A number of a control quantity in its unit."""
        unit = written.unit
        if isinstance(written.value, str):
            unit = parse_quantity(written.value, where=written.where)[1]
        if unit is None:
            raise BadInput(
                f"{written.where}: the control quantity '{name}' has no unit, wanted one; "
                "a plain number has the unit 1"
            )
        if name not in self.control_units:
            _check_linear(name, unit, written.where)
        return in_unit(written, self.control_units.setdefault(name, unit))


def bind_annotation(choice: WrittenAccuracy, binder: Binder, where: str) -> AccuracyAnnotation:
    """The [accuracy] table in the FMU's names and units.

    Args:
        choice: the table as it is written.
        binder: of the campaign to its FMU.
        where: what complaints name it by.

    Raises:
        BadInput: a variable that is not there, or cannot be set or read; force or forbid of what
            is no reduction.
    """
    said = Complaints()
    reductions: list[Reduction] = []
    for name in (choice.tolerance, choice.substep):
        with said:
            if name is not None:
                binder.real(name, where, SETTABLE, "set")
    for entry in choice.reductions:
        with said:
            if entry.bound is not None and "{output}" not in entry.bound:
                inside = f"{where.removesuffix(']')}.reductions '{entry.name}'] bound"
                binder.real(entry.bound, inside, READABLE, "read")
        with said:
            values = binder.settings(entry.set)
            reductions.append(Reduction(entry.name, values, bound=entry.bound, cost=entry.cost))
    with said:
        full = binder.settings(choice.full)
    said.check()
    names = {of.name: getattr(choice, of.name) for of in fields(AccuracyNames)}
    try:
        return AccuracyAnnotation(**names, full=full, reductions=tuple(reductions))
    except BadInput as error:
        raise BadInput(f"{where} {error}") from error


def _starts(variable: VariableLike, role: str) -> bool:
    """Whether it may be set or fitted since it is the start value of a state."""
    exact = getattr(variable, "initial", None) == "exact"
    constant = getattr(variable, "variability", None) == "constant"
    return exact and not constant and (role.startswith("set") or role == "fitted")


def _of_kind(variable: VariableLike) -> str:
    return f"{'an' if variable.kind[0] in 'AEIOU' else 'a'} {variable.kind} variable"


def _check_linear(name: str, unit: str, where: str) -> None:
    """Complain of a control quantity whose unit no law could work in."""
    dimension_of(unit, where=where)
    try:
        to_base(1.0, unit, where=where)
    except BadInput as error:
        raise BadInput(
            f"{where}: the control quantity '{name}' is in the logarithmic unit '{unit}'; wanted a "
            "linear one, or 1 for plain numbers"
        ) from error


def is_real(variable: VariableLike) -> bool:
    """Whether the variable is a Real one.

    Args:
        variable: of the FMU.
    """
    return variable.kind == "Real"
