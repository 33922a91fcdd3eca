"""The FMU's variables next to a campaign: of the right kind, numbers in their unit; contradictions.

A bound campaign must not contradict itself: settings of variables, tones, laws. `[[assumptions]]`
are what it fixes although it might be otherwise; `fitting.inference.checks.assumptions` computes
what a fit would give then.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

from fitting.campaign.bound import Assumption, BoundCampaign
from fitting.campaign.file import WrittenAssumption
from fitting.campaign.laws import Law, Laws
from fitting.fmu.description import READABLE, REPORTABLE, SETTABLE, FmuVariable, other_tones
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, did_you_mean, gathered
from fitting.text.finding import Finding, Kind, note
from fitting.text.formula import Formula
from fitting.text.notation import listed, number
from fitting.text.units import Written, dimension_of, in_unit, parse_quantity, same_kind, to_base

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
#: Items of an enumeration that an error lists.
MOST_ITEMS = 10
#: Values of Boolean variables as they may be written.
BOOLEANS = {
    **dict.fromkeys(("true", "1", "1.0"), True),
    **dict.fromkeys(("false", "0", "0.0"), False),
}


class Binder:
    """The FMU's variables, and the notes that converting to their units leaves.

    ``named`` are names in laws: where the FMU has no variable of such a name it is a coefficient
    if it is a parameter, else a control quantity, whose numbers stay in the unit that they are
    first met in, see ``control_units``. ``top`` opens errors, which call a campaign's ``parts`` so.
    """

    def __init__(
        self,
        variables: Mapping[str, FmuVariable],
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

    def variable(self, name: str, where: str, causalities: Sequence[str], role: str) -> FmuVariable:
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

    def real(self, name: str, where: str, causalities: Sequence[str], role: str) -> FmuVariable:
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

    def reported(self, name: str, where: str, by_laws: Collection[str]) -> FmuVariable:
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

    def value(self, variable: FmuVariable, written: Written) -> Scalar:
        """A written value as the FMU takes it.

        Args:
            variable: of the FMU.
            written: number or quantity as the file has it.
        """
        raw, kind = written.value, variable.kind
        if is_real(variable):
            return self.number(variable, written)
        if kind == "Boolean" and str(raw).lower() in BOOLEANS:
            return BOOLEANS[str(raw).lower()]
        items = variable.items
        if isinstance(raw, str) and raw in items:
            return items[raw]
        if kind == "Integer" and not isinstance(raw, bool):
            with suppress(ValueError):  # of a text that is no number
                if float(raw).is_integer():
                    return raw if isinstance(raw, int) else int(float(raw))
        if kind == "String" and isinstance(raw, str):
            return raw
        raise BadInput(
            f"{written.where}: found {raw!r}, but '{variable.name}' is {_of_kind(variable)}"
        )

    def number(self, variable: FmuVariable, written: Written) -> float:
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

    def note_missing_unit(self, variable: FmuVariable) -> None:
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


def _of_kind(variable: FmuVariable) -> str:
    if variable.items:
        return f"an enumeration of {listed(variable.items, MOST_ITEMS)}"
    return f"{'an' if variable.kind[0] in 'AEIOU' else 'a'} {variable.kind} variable"


def is_real(variable: FmuVariable) -> bool:
    """Whether the variable is a Real one.

    Args:
        variable: of the FMU.
    """
    return variable.kind == "Real"


def check_conflicts(bound: BoundCampaign, binder: Binder) -> None:
    """A fitted or alternated variable must not be set in another way as well.

    A variable of which every experiment has its own value may have a start value: the sweep's.

    Args:
        bound: campaign, bound to its FMU.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: a parameter named twice, or a variable that is fitted or tried and also set.
    """
    top, parameters = binder.top, binder.part("parameters")
    named = [p.name for p in bound.parameters]
    if len(set(named)) < len(named):
        raise BadInput(f"{top}{parameters} {named} names one twice")
    sweep, gains = bound.sweep, [e for e in bound.experiments if e.phases_rad is not None]
    if sweep is not None and sweep.use == "scale" and any(e.unknown == "gain" for e in gains):
        raise BadInput(
            f'{top}the sweep gives a scale alone, which the experiments\' unknown = "gain" '
            'does without; wanted the sweep with use = "fit", or unknown = "phase"'
        )
    own = {p.target for p in bound.parameters if p.experiments and not p.adds_to}
    everywhere = {p.name for p in bound.parameters if not p.experiments and p.moves_model}
    for name in sorted(own & everywhere):
        raise BadInput(
            f"{top}{parameters} '{name}' is fitted both with "
            'scope = "experiment" and for the whole campaign; wanted one of them'
        )
    fitted = [p.target for p in bound.parameters if p.role == "model" and not p.adds_to]
    tried, laws, drive = bound.alternatives[0], bound.setup.laws.formulas, bound.setup.drive
    driven = dict.fromkeys((*drive.frequency_names, *drive.amplitude_names), 0.0)
    roles = dict.fromkeys(laws, "is given by a law")
    roles |= dict.fromkeys(tried, "is an alternative") | dict.fromkeys(fitted, "is fitted")
    for name, role in roles.items():
        by_law = name in laws
        also: tuple[tuple[bool, str, Mapping[str, object]], ...] = (
            (name in fitted or by_law, "alternatives", tried),
            (name in everywhere or by_law, "start", bound.setup.start_values),
            (name in fitted, "laws", laws),
            (by_law, "drive", driven),
        )
        for place, settings in (
            *settings_by_place(bound, binder),
            *((binder.part(part), others) for applies, part, others in also if applies),
        ):
            if name in settings:
                raise BadInput(f"{top}'{name}' {role} and also set by {place}; wanted one of them")


def settings_by_place(
    bound: BoundCampaign, binder: Binder
) -> Iterator[tuple[str, Mapping[str, Scalar]]]:
    """What everything that was measured sets, by its name in errors.

    Args:
        bound: campaign, bound to its FMU.
        binder: of the campaign to its FMU.
    """
    for e in bound.experiments:
        yield f"experiment '{e.label}'", e.settings
    if bound.sweep is not None:
        yield binder.part("sweep"), bound.sweep.settings
    for table, measurement in bound.measurements.items():
        for label, own in measurement.places:
            yield f"{binder.part('measurement', table)} {label}".strip(), own


def check_tones(bound: BoundCampaign, binder: Binder) -> None:
    """Refuse a tone next to those that the drive names, with an amplitude that is not zero.

    These are tones whose parameters are named like those of the drive, as u2 and A2 next to u1.

    Args:
        bound: campaign, bound to its FMU.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: there is one.
    """
    drive = bound.setup.drive
    if drive.kind != "tones":
        return
    described = {n: v for n, v in binder.variables.items() if isinstance(v, FmuVariable)}
    set_otherwise = {p.target for p in bound.parameters} | set(bound.setup.laws.formulas)
    common = {**bound.setup.start_values, **bound.alternatives[0]}
    places = list(settings_by_place(bound, binder))
    for place, settings in (("", {}), *places):
        for tone in other_tones(drive.frequency_names, {**common, **settings}, described):
            unit = described[tone.frequency].unit
            if tone.amplitude in set_otherwise or unit is None or not same_kind(unit, "Hz"):
                continue
            if not place and places and all(tone.amplitude in own for _, own in places):
                continue  # everything that was measured sets the amplitude itself
            amplitude = described[tone.amplitude]
            value = common.get(amplitude.name, amplitude.start)
            size = f"{number(float(value or 0.0), 4)} {amplitude.unit or ''}".strip()
            raise BadInput(
                f"{binder.top}{binder.part('drive')} names {listed(drive.frequency_names)}, "
                f"but the FMU drives at {tone.frequency} as well, with {tone.amplitude} = {size}; "
                f"wanted {tone.frequency} and {tone.amplitude} named as well, or {tone.amplitude} "
                f"= 0 in {binder.part('start')}"
            )


def bound_laws(laws: Laws, bound: BoundCampaign, binder: Binder) -> Laws:
    """Laws with the units of all that they name, tried at every place of a campaign.

    Args:
        laws: as they were written.
        bound: campaign, bound to its FMU but for them.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: a law of a variable that cannot be set, that names what there is not, whose
            dimension is not that of the variable, or that has no value somewhere.
    """
    variables, controls = binder.variables, dict(binder.control_units)
    targets = {
        name: binder.real(name, f"{laws.source} {name}", SETTABLE, "set by a law").unit or ""
        for name in laws.formulas
    }
    for measurement in bound.measurements.values():
        for name, unit in measurement.control_units.items():
            if name not in variables and controls.setdefault(name, unit) != unit:
                raise BadInput(
                    f"{laws.source} the control quantity '{name}' is in {unit} and in "
                    f"{controls[name]}; wanted one unit"
                )
    made = laws.with_units(
        targets,
        parameters={p.target: p.unit for p in bound.parameters if p.moves_model},
        variables={n: variables[n].unit or "1" for n in laws.names if n in variables},
        controls=controls,
    )
    common = {**bound.setup.start_values, **bound.alternatives[0]}
    made.check(
        ((place, {**common, **own}) for place, own in settings_by_place(bound, binder)),
        {p.target: p.start for p in bound.parameters if p.moves_model and not p.adds_to},
    )
    return made


def with_laws(bound: BoundCampaign, binder: Binder) -> BoundCampaign:
    """A campaign whose laws are bound to the FMU: units of all that they name, and finite values.

    Args:
        bound: campaign, bound to its FMU.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: as `bound_laws`.
    """
    if not bound.setup.laws.formulas:
        return bound
    made = bound_laws(bound.setup.laws, bound, binder)
    notes = (*bound.notes, *(law.note for law in made.bound))
    return replace(bound, setup=replace(bound.setup, laws=made), notes=notes)


def with_assumptions(
    bound: BoundCampaign, written: Sequence[WrittenAssumption], binder: Binder
) -> BoundCampaign:
    """A campaign with its assumptions.

    Args:
        bound: campaign, bound to its FMU, with its laws.
        written: as they are written.
        binder: of the campaign to its FMU.

    Raises:
        BadInput: a quantity that there is not or that is fitted, a formula or value that it cannot
            have; a line each.
    """
    readers = [partial(_bound, one, bound, binder) for one in written]
    return replace(bound, assumptions=tuple(gathered(readers)))


def _bound(written: WrittenAssumption, bound: BoundCampaign, binder: Binder) -> Assumption:
    where, name = f"{binder.top}[assumptions '{written.that}']", written.quantity
    words, setup = Assumption(that=written.that, otherwise=written.otherwise), bound.setup
    if name is None:
        return replace(words, start=_start(written.start, bound, where))
    if name in {p.target for p in bound.parameters}:
        raise BadInput(f"{where} quantity: '{name}' is fitted; wanted one that is fixed")
    formulas, constants = dict(setup.laws.formulas), dict(setup.laws.constants)
    if written.law is not None:
        if name in constants:
            raise BadInput(f"{where} law: '{name}' is a constant; wanted its 'value'")
        # names of laws stand for their formulas in it
        law = Formula(written.law, f"{where} law", derivatives=True)
        law = law.written_out(setup.laws.parsed)
        formulas[name] = law.text
    elif written.value is not None and name in constants:
        constants[name] = written.value
    else:
        if name in formulas:
            raise BadInput(f"{where} value: '{name}' follows a law; wanted another 'law'")
        if name not in binder.variables:
            known = sorted((*constants, *binder.variables))
            raise BadInput(
                f"{where} quantity: '{name}' is neither a constant nor a variable of the FMU"
                f"{did_you_mean(name, known)}"
            )
        assert written.value is not None  # noqa: S101 - the table wants a law or a value
        changed = {**setup.start_values, name: binder.setting(name, written.value)}
        return replace(words, setup=replace(setup, start_values=changed))
    # another law may do without some constants
    named = Laws(formulas, source=f"{where}:").names
    constants = {n: value for n, value in constants.items() if n in named}
    laws = bound_laws(Laws(formulas, constants, source=f"{where}:"), bound, binder)
    return replace(words, setup=replace(setup, laws=laws))


def _start(formulas: Mapping[str, str], bound: BoundCampaign, where: str) -> dict[str, Law]:
    """Formulas of parameters in the fitted values of all of them."""
    units = {p.name: p.unit for p in bound.parameters if p.moves_model and not p.experiments}

    def check(name: str, place: str) -> None:
        if name not in units:
            raise BadInput(
                f"{place}: '{name}' is no fitted parameter of the whole campaign"
                f"{did_you_mean(name, sorted(units))}"
            )

    for name in formulas:
        check(name, f"{where} start")
    laws = {}
    for name, text in formulas.items():
        formula = Formula(text, f"{where} start.{name}")
        for other in formula.names:
            check(other, formula.where)
        own = {other: units[other] for other in formula.names}
        laws[name] = Law(name, formula, text=text, units=own, unit=units[name])
    return laws
