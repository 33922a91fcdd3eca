"""Schemas of `result.json`: one of schema 1 is read as one of schema 2, which has a JSON Schema."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fitting.text.estimate import OLD_STATUS, Verdict

#: Version of the keys of `result.json`; schema 1 is that of 0.2.0.
SCHEMA = 2
#: Keys of what the data determine in schema 1 whose numbers are those of values now.
PROFILES = ("parameters", "derived", "findings")
#: Keys under which texts were stored, and where.
TEXTS, WITH_TEXTS = ("sentence", "sentences"), ("knowledge", "joint", "external", "quadratures")
#: What closes a side, by how its scan ended in files written before 0.3; why it stopped before.
CLOSED = {
    "crossed": "data",
    "prior": "prior",
    "held": "bound",
    "bound": "bound",
    "round": "periodic",
    "lost": "",
    "cost": "",
}
STOPPED = {"lost": "search", "cost": "budget"}
#: Numbers of a line in schema 1, by their names now; the key of the amplitude's unit is `unit`.
OF_A_LINE = {
    "frequency": ("frequency_hz", "frequency_std_hz", "Hz"),
    "width": ("width_hz", "width_std_hz", "Hz"),
    "q": ("q", "q_std", "1"),
}
#: Keys of a value in schema 1 that are computed from others now.
COMPUTED = ("identifiable", "bars", "boxes", "box", "mean", "precision", "parameter")


#: How a fit ended by the words that were stored, and with them as a kind.
ENDINGS = {
    "converged and describes the data": "described",
    "converged but does not describe the data": "not_described",
    "converged, but no line exceeds the noise": "no_line",
    "converged, but the campaigns contradict each other": "contradiction",
}


def upgraded(data: Mapping[str, Any]) -> dict[str, Any]:
    """A result of schema 1 with the keys of schema 2; one of schema 2 as it is.

    Schema 1 had three records for values: `identifiable` is `status` now, `boxes` are
    `active_bounds`, the range `box` of an output is `lower` and `upper`, and the sides `bars` of a
    68 % interval are the interval `ci68`. A profile repeated all that in `knowledge`; its points
    are in `knowledge.scans` now. Numbers of the sweep's line became values, too; that is also read
    where a file of schema 2 has it.

    Args:
        data: as it was read from the file.
    """
    made = {key: _without_texts(item) if key in WITH_TEXTS else item for key, item in data.items()}
    if "frequency_hz" in (data.get("line") or {}):
        made["line"] = _line(data["line"])
    _rename_ending(made)
    made["alternatives"] = [_alternative(each) for each in data.get("alternatives", ())]
    if data.get("schema", 1) != 1:
        _rename_ends(made)
        return made
    knowledge = made.get("knowledge") or {}
    profiles = {**knowledge.get("parameters", {}), **knowledge.get("derived", {})}
    made["schema"] = SCHEMA
    if knowledge:
        made["knowledge"] = {key: item for key, item in knowledge.items() if key not in PROFILES}
        made["knowledge"]["scans"] = {name: _scan(profile) for name, profile in profiles.items()}
    for key, role in (("parameters", "parameter"), ("derived", "derived")):
        made[key] = {
            name: _estimate(name, role, value, profiles.get(name))
            for name, value in data.get(key, {}).items()
        }
    made["offsets"] = [
        _estimate(value.get("parameter", ""), "offset", value, None)
        for value in data.get("offsets", ())
    ]
    _rename_ends(made)
    return made


def _rename_ending(made: dict[str, Any]) -> None:
    """How the fit ended as a kind, and its residuals without words, in place."""
    knowledge, ending = made.get("knowledge") or {}, made.get("ending") or {}
    adequacy = knowledge.get("adequacy")
    if adequacy and "absent" in adequacy:
        old = {"against", "remedy", "absent"}
        adequacy = {key: item for key, item in adequacy.items() if key not in old}
        adequacy["no_line"] = bool(knowledge["adequacy"]["absent"])
        made["knowledge"] = {**knowledge, "adequacy": adequacy}
    if "words" in ending:
        kind = ENDINGS.get(ending["words"], "not_converged")
        made["ending"] = {"kind": kind, "adequacy": adequacy}


def _without_texts(node: Any) -> Any:
    """The same without sentences, which templates make of the numbers."""
    if isinstance(node, list):
        return [_without_texts(item) for item in node]
    if not isinstance(node, dict):
        return node
    return {key: _without_texts(item) for key, item in node.items() if key not in TEXTS}


def _rename_ends(made: dict[str, Any]) -> None:
    """What closes sides of intervals by the words of now, in place; why scans stopped with them."""
    scans = dict((made.get("knowledge") or {}).get("scans", {}))
    for key in ("parameters", "derived"):
        values = made[key] = dict(made.get(key, {}))
        for name, value in values.items():
            ends = value.get("closed_by") or ()
            status = Verdict(OLD_STATUS).value if value.get("status") == OLD_STATUS else None
            if status is not None:
                values[name] = value = {**value, "status": status}
            if not any(end in CLOSED and end not in CLOSED.values() for end in ends):
                continue
            values[name] = {**value, "closed_by": [CLOSED.get(end, end) for end in ends]}
            if name in scans:
                stopped = [STOPPED.get(end, "") for end in ends]
                scans[name] = {**scans[name], "stopped": stopped}
    if scans:
        made["knowledge"] = {**made["knowledge"], "scans": scans}
    bootstrap = (made.get("knowledge") or {}).get("bootstrap") or {}
    for name, value in bootstrap.get("values", {}).items():
        if "median" in value:  # percentiles had no unit of their own
            unit = {**made["parameters"], **made["derived"]}[name]["unit"]
            number = {"name": name, "value": value["median"], "unit": unit, "std": value["std"]}
            bootstrap["values"][name] = {**number, "ci95": value["interval95"]}
    for quality in (made.get("quadratures") or {}).get("qualities", ()):
        quality.setdefault("unit", "")


def _estimate(
    name: str, role: str, value: Mapping[str, Any], profile: Mapping[str, Any] | None
) -> dict[str, Any]:
    made = {key: item for key, item in value.items() if key not in COMPUTED}
    made |= {"name": name, "role": role, "status": value.get("identifiable")}
    made["active_bounds"] = value.get("boxes", [])
    if "box" in value:
        made["lower"], made["upper"] = value["box"]
    sides = value.get("bars") or {}
    best = value.get("most_likely")
    best = value.get("value") if best is None else best
    if None not in (best, sides.get("below"), sides.get("above")):
        made["ci68"] = [best - sides["below"], best + sides["above"]]
    if profile is not None:
        made |= {"method": "profile", "closed_by": profile["ends"]}
        made["ci68"] = profile["interval68"]
    return made


def _alternative(old: Mapping[str, Any]) -> dict[str, Any]:
    """An alternative whose starts were lowered by J: their ends are not those of chi square."""
    if "chi_square" in old:
        return dict(old)
    kept = ("settings", "parameters", "derived", "j_fit", "reported", "equal_to_best")
    made: dict[str, Any] = {key: old[key] for key in kept if key in old}
    return made | {"chi_square": None, "converged": old.get("status") == "optimal", "starts": []}


def _scan(profile: Mapping[str, Any]) -> dict[str, Any]:
    kept = {key: profile[key] for key in ("sigma", "values", "path", "held")}
    return {**kept, "delta_chi2": profile["delta"]}


def _line(old: Mapping[str, Any]) -> dict[str, Any]:
    """The sweep's line of schema 1; intervals of 95 % were not stored, and are unknown."""
    kept = ("unit", "background", "message", "instrument", "notes", "background_p")
    made = {key: old[key] for key in (*kept, "values") if key in old}
    made["rms_residual"] = old["residual"]
    amplitude = ("amplitude", "amplitude_std", old["unit"])
    for name, (value, std, unit) in {**OF_A_LINE, "amplitude": amplitude}.items():
        made[name] = _number(name, old.get(value), old.get(std), unit)
    if old.get("amplitude_mirrored") is not None:
        other = old["amplitude_mirrored"], old.get("amplitude_mirrored_std")
        made["mirrored"] = _number("amplitude", *other, old["unit"])
    made["dof"] = old.get("freedom", "inf")
    made["forms"] = [_form(fit) for fit in old.get("fits", ())]
    taken = [form for form in made["forms"] if form["name"] == old.get("background")]
    return {**made, "structure": taken[0]["structure"]} if taken else made


def _form(old: Mapping[str, Any]) -> dict[str, Any]:
    numbers = {
        name: _number(name, old[value], old[std], unit)
        for name, (value, std, unit) in OF_A_LINE.items()
    }
    structure = {
        "p_value": old["structure_p"],
        "sizes_p": old.get("sizes_p"),
        "order": 0,
        "points": old["points"],
        "widening": old["widening"],
        "together": None,
    }
    rest = {"name": old["background"], "message": old["message"], "rms_residual": old["residual"]}
    return {**numbers, **rest, "structure": structure}


def _number(name: str, value: float | None, std: float | None, unit: str) -> dict[str, Any]:
    status = Verdict.UNKNOWN if value is None else Verdict.LINEARISED
    return {"name": name, "value": value, "std": std, "unit": unit, "status": status.value}


def json_schema(kind: type) -> dict[str, Any]:
    """The JSON Schema of a record's file: a number that there is not is null, infinity a text.

    Args:
        kind: class of the record.
    """
    from pydantic import TypeAdapter  # a library of campaigns: most commands need no schema

    made: dict[str, Any] = _with_missing(TypeAdapter(kind).json_schema())
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **made}


def _with_missing(node: Any) -> Any:
    if isinstance(node, list):
        return [_with_missing(item) for item in node]
    if not isinstance(node, dict):
        return node
    made = {key: _with_missing(item) for key, item in node.items() if key != "default"}
    if made.get("type") == "number":
        return {"anyOf": [{"type": ["number", "null"]}, {"enum": ["inf", "-inf"]}]}
    return made
