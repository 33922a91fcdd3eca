"""A file of limits: every table and key is checked, so that none is left out by a slip."""

from __future__ import annotations

from pathlib import Path

import pytest

from fitting.design.limits import read_candidates
from fitting.text.errors import BadInput
from fitting.text.toml import toml_text
from tests.design.test_campaign import TABLES


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[desing]\nlevels = [1]\n", "top level: unknown key 'desing'"),
        ("levels = [1]\n", "top level: unknown key 'levels'"),
        ("[design]\nlevel = [1]\n", "[design]: unknown key 'level'"),
        ("[design]\nlevels = [1]\n[noise]\nrelative = 0.1\n", "top level: unknown key 'noise'"),
        ("[design]\nfarthest = 80\n", "[design] farthest: 80 "),
        ("", "key 'design'"),
        ("[design]\nlevels = []\n", "[design] levels: found []"),
        ('[fmu]\nmodel = "CoupledOscillator"\n[design]\n', "key 'title'"),
    ],
)
def test_what_is_misspelt_is_refused(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "limits.toml"
    path.write_text(text)
    with pytest.raises(BadInput) as refused:
        read_candidates(path)
    assert any(complaint in line for line in refused.value.args)
    assert all(line.startswith(f"{path}: ") for line in refused.value.args)


def test_a_campaign_without_limits_is_no_file_of_limits(tmp_path: Path) -> None:
    path = tmp_path / "campaign.toml"
    path.write_text(toml_text({k: v for k, v in TABLES.items() if k != "design"}))
    with pytest.raises(BadInput, match=r"campaign\.toml: .*\[design\]"):
        read_candidates(path)
    path.write_text(toml_text(TABLES))
    assert read_candidates(path).keys.number == 2
    assert read_candidates(path).written == {"number", "settings"}
