"""What columns of a recognised file seem to be, as tests ask for it."""

from __future__ import annotations

from fitting.campaign.instruments.recording import Recording, Selection


def is_sweep(recording: Recording) -> bool:
    """Whether it seems to hold a response over frequency."""
    observed = any(recording.role(name) for name in ("amplitude", "re", "complex"))
    return recording.role("frequency") is not None and observed


def is_complex(recording: Recording) -> bool:
    """Whether it seems to hold complex values, or amplitude and phase."""
    roles = {c.role for c in recording.channels}
    return bool(roles & {"complex", "re"}) or roles >= {"amplitude", "phase"}


def without_unit(recording: Recording) -> tuple[str, ...]:
    """Roles whose column states no unit: the campaign has to, as "column 1 (Hz)"."""
    return tuple(c.role for c in recording.channels if c.role and c.unit is None)


def seeming_selection(recording: Recording) -> Selection:
    """Names of the columns as they seem to be."""
    names = {c.role: c.name for c in recording.channels}
    return Selection(
        frequency=names.get("frequency", ""),
        amplitude=names.get("complex") or names.get("amplitude", ""),
        phase=names.get("phase", ""),
        x=names.get("re", ""),
        y=names.get("im", ""),
    )
