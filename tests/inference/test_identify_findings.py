"""`identify` and `reconstruct` say the same of the residuals, as records: in identify.json too."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fitting.inference.likelihood.knowledge import Identification
from fitting.text.finding import Finding, Kind
from fitting.text.records import read_json
from tests.inference.test_causes import LINE, TOP, Laboratory, drawn, struck, swept, warm
from tests.support.in_process import told
from tests.support.samples import cases

ABOUT_RESIDUALS = {Kind.not_described, Kind.correlated_residuals, Kind.noise_underestimated}
LABORATORIES: dict[str, tuple[Laboratory, Kind | None]] = {
    "right": (swept(LINE), None),
    "gain": (swept(1.7 * LINE), Kind.not_described),
    "ripple": (
        swept(LINE + 0.03 * TOP * np.cos(np.linspace(0.0, 20.0, LINE.size))),
        Kind.correlated_residuals,
    ),
    "noise": (swept(LINE + 3.0 * drawn(7, LINE.size)), Kind.noise_underestimated),
    "temperature": (warm(450.0), Kind.not_described),
    "offset of a step": (struck(offset=0.15), Kind.not_described),
}


def about_residuals(findings: tuple[Finding, ...]) -> dict[Kind, Finding]:
    return {f.kind: f for f in findings if f.kind in ABOUT_RESIDUALS}


@pytest.mark.parametrize("name", cases(LABORATORIES, "ripple", "noise"))
def test_both_commands_find_the_same(name: str, swift_fmu: Path, tmp_path: Path) -> None:
    laboratory, kind = LABORATORIES[name]
    _, result, _ = laboratory.reconstructed(swift_fmu, tmp_path)
    words = ("--out", tmp_path / "identified", "--no-report", "--workers", "1")
    assert told("identify", tmp_path / "campaign.toml", *words).code == 0
    one = about_residuals(result.findings)
    written = read_json(tmp_path / "identified" / "identify.json", Identification)
    other = about_residuals(written.findings)
    assert set(one) == set(other) == ({kind} if kind else set())
    for found, same in ((one[k], other[k]) for k in one):
        assert (found.severity, found.subject) == (same.severity, same.subject)
        assert set(found.numbers) == set(same.numbers)
        for number in ("chi_square", "freedom", "share", "widening", "factor"):
            if number in found.numbers:  # ends of two searches
                assert same.numbers[number] == pytest.approx(found.numbers[number], rel=0.02)
