"""What begins before a command has loaded what it works with."""

from __future__ import annotations

from fitting.fmu.models import built_ahead

__all__ = ["built_ahead"]
