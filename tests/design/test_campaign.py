"""A design's campaign: the old one in any spelling of TOML, rewritten, can be read again."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fitting.campaign import BoundCampaign, bind, read_campaign
from fitting.campaign.file import WrittenCampaign, read_campaign_file
from fitting.design.campaign import campaign_files
from fitting.design.limits import Limits
from fitting.design.result import Design, Expected, Proposal
from fitting.text.schema import read_record
from tests.campaign.test_campaign import oscillator

TABLES: dict[str, Any] = {
    "title": "String",
    "synthetic": True,
    "fmu": {"file": "models/string.fmu", "start": {"periodic_start": True, "g1": 1.0}},
    "observe": {"output": "q1_hybrid", "steady_start": True},
    "drive": {
        "kind": "tones",
        "frequencies": ["u1", "u2"],
        "amplitudes": ["A1", "A2"],
        "read": ["u2", "u1"],
    },
    "experiments": {
        "file": "experiments.csv",
        "peaks": ["p", "q"],
        "peak_sigmas": ["sp", "sq"],
        "amplitude": "V rms",
    },
    "drift": {
        "model": "offsets",
        "prior": "30 Hz",
        "time": "hour",
        "after_time": "9 h",
        "eta_plus": {"before": "6.94021 MHz", "after": "6.94031 MHz"},
        "eta_minus": {"before": 7027550.0, "after": 7027650.0},
    },
    "sweep": {
        "file": "sweep.csv",
        "amplitude": "V peak",
        "use": "fit",
        "set": {"eta_plus": "6.94021 MHz"},
    },
    "parameters": [
        {"name": "d1", "unit": "Hz", "lower": 1, "upper": 1e3, "start": 94.1},
        {"name": "theta", "lower": -6.3, "upper": 6.3, "start": "0 rad", "period": "180 deg"},
    ],
    "derived": {"outputs": ["lambda", "f1"]},
    "alternatives": {"reflection": [False, True]},
    "accuracy": {"reductions": [{"name": "far mode", "set": {"g2": 0.0}}]},
    "design": {"number": 2, "settings": {"g2": [0.0, 1.0]}},
}
EXPERIMENTS = "experiment,u1 (MHz),u2 (MHz),hour (h),p (uV),q (uV),sp (nV),sq (nV)\n" + "".join(
    f"{m},{6.94016 + 1e-5 * m},{6.94036 - 1e-5 * m},{m},10,20,100,200\n" for m in range(1, 5)
)
SWEEP = "frequency (MHz),amplitude (uV)\n" + "".join(
    f"{6.9400 + 5e-5 * k},{40.0 / (1.0 + (k - 6) ** 2)}\n" for k in range(12)
)
#: Tables of which the new campaign has its own.
NEW = ("experiments", "drift", "design")


def laid(folder: Path, text: str) -> BoundCampaign:
    """The campaign of a text, bound."""
    (folder / "experiments.csv").write_text(EXPERIMENTS)
    (folder / "sweep.csv").write_text(SWEEP)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    return bind(read_campaign(folder / "campaign.toml"), oscillator())


def designed(tones: int) -> tuple[Design, Limits]:
    """Two proposals of one or two tones."""
    expected = Expected(1.0, 2.0, 3.0)
    one = Proposal(
        rank=1,
        tones_hz=(6940300.0, 6940320.0)[:tones],
        centre_hz=6940310.0,
        output="q1_hybrid",
        level=10.0,
        settings={"g2": 0.5},
        repeats=100,
        peaks_v=(1e-5, 2e-5)[:tones],
        sigmas_v=(1e-7, 1e-7)[:tones],
        expected=expected,
    )
    design = Design(
        title="String",
        synthetic=True,
        campaign="campaign.toml",
        target="lambda",
        unit="Hz",
        amplitude_unit="V",
        criterion="target",
        before=expected,
        spread=1.0,
        span=(0.0, 1.0),
        proposals=(one, replace(one, rank=2)),
        kinds=(),
        places=(),
        equal_fits=1,
        valueless=0,
        setups=1,
        candidates=1,
        sentences=(),
        provenance={"command": "a test"},
    )
    limits = Limits(
        outputs=("q1_hybrid",),
        centres_hz=(6940310.0,),
        frequency_step_hz=10.0,
        least_spacing_hz=20.0,
        farthest_hz=100.0,
        both_sides=True,
        levels=(1.0, 10.0),
        repeats=(1, 100),
        noise_floor_v=1e-7,
        relative_noise=0.01,
        largest_v=8e-5,
        settings={"g2": (0.0, 1.0)},
        setting_sigmas={"eta_plus": 5.0},
        tones=tones,
    )
    return design, limits


def rewritten_campaign(bound: BoundCampaign, tones: int) -> str:
    design, limits = designed(tones)
    folder = bound.path.parent / "next" / "campaign"
    files = campaign_files(design, bound, {}, limits, folder)
    return str(files["campaign.toml"])


def check(text: str, bound: BoundCampaign, tones: int) -> None:
    """What is not the design's own is as it was, file names relative to the new place."""
    folder = bound.path.parent
    old = read_campaign_file(bound.path)
    new = read_record(WrittenCampaign, tomllib.loads(text), folder / "next/campaign/campaign.toml")
    assert new.title == "Next: String"
    assert new.synthetic
    assert new.fmu.file is not None
    assert old.fmu.file is not None
    assert new.fmu.file.resolve() == old.fmu.file.resolve()
    assert plain(new.fmu.start) == plain(old.fmu.start)
    assert new.driven.frequencies == ("u1", "u2")[:tones]
    assert [line.text for line in new.driven.lines] == ["u1", "u2"][:tones]
    assert new.sweep is not None
    assert old.sweep is not None
    assert (new.sweep.use, new.sweep.file.name) == ("scale", "sweep.csv")
    assert plain(new.sweep.set) == plain(old.sweep.set)
    assert new.experiments is not None
    assert new.experiments.peaks == ("peak_1", "peak_2")[:tones]
    assert new.experiments.amplitude == "V peak"
    assert (new.drift.model, new.drift.time, new.drift.after_time) == ("offsets", "", None)
    ends = {name: (e.before.value, e.after.value) for name, e in new.drift.ends.items()}
    assert ends == {"eta_plus": ("6.94031 MHz",) * 2, "eta_minus": (7027650.0,) * 2}
    assert new.design.averaged == (100, 100)
    assert new.design.number == 6
    for name in ("observe", "parameters", "derived", "alternatives", "accuracy"):
        assert bare(getattr(new, name)) == bare(getattr(old, name))


def plain(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: written.value for name, written in values.items()}


def bare(record: object) -> str:
    """A record without the places of its values."""
    return re.sub(r"where='[^']*(?:\\'[^']*)*'|where=\"[^\"]*\"", "", repr(record))


DOTTED = """\
# who made it
title = "String"  # of the title
synthetic = true
fmu = { file = "models/string.fmu", start = { periodic_start = true, g1 = 1.0 } }
observe.output = "q1_hybrid"
observe.steady_start = true
drive.kind = "tones"
drive.frequencies = [
  "u1",  # the low one
  "u2",
]
drive.amplitudes = [ "A1",
                     "A2" ]
experiments.file = "experiments.csv"
experiments.peaks = ["p", "q"]
experiments.peak_sigmas = ["sp", "sq"]
experiments.amplitude = "V rms"
drift.model = "offsets"
drift.prior = "30 Hz"
drift.time = "hour"
drift.eta_plus.before = "6.94021 MHz"
drift.eta_plus.after = "6.94031 MHz"
drift.eta_minus = { before = 7027550.0, after = 7027650.0 }
parameters = [
  { name = "d1", unit = "Hz", lower = 1, upper = 1000, start = 94.1 },  # of the first
  { name = "theta", lower = -6.3, upper = 6.3, start = 0.0 },
]
sweep.file = "sweep.csv"   # of the sweep
sweep.amplitude = "V peak"
sweep.use = "fit"

# in front of derived
[derived]  # of derived
outputs = ["lambda"]
"""


def test_dotted_keys_inline_tables_and_arrays_over_lines(tmp_path: Path) -> None:
    bound = laid(tmp_path, DOTTED)
    text = rewritten_campaign(bound, 2)
    check(text, bound, 2)
    check(rewritten_campaign(bound, 1), bound, 1)
    head, _, rest = text.partition("title =")
    assert head.count("\n") == 3
    assert head.endswith(": a test\n")
    assert rest.splitlines()[:2] == [' "Next: String"  # of the title', "synthetic = true"]
    kept = (
        '"u1",  # the low one',
        "# of the first",
        "# in front of derived",
        "[derived]  # of derived",
    )
    for words in kept:
        assert words in text
    assert "# who" not in text
    assert 'sweep.file = "sweep.csv" #' in text


@dataclass
class Speller:
    """Tables in some spelling, chosen by ``draw``, with numbered remarks."""

    draw: st.DrawFn
    remarks: int = 0

    def either(self) -> bool:
        return bool(self.draw(st.booleans()))

    def remark(self) -> str:
        self.remarks += 1
        return f"  # remark {self.remarks}\n" if self.either() else "\n"

    def value(self, item: Any) -> str:
        if isinstance(item, Mapping):
            return "{ " + ", ".join(f"{k} = {self.value(v)}" for k, v in item.items()) + " }"
        if isinstance(item, list) and self.either():
            return "[\n" + "".join(f"  {self.value(v)},{self.remark()}" for v in item) + "]"
        if isinstance(item, list):
            return "[" + ", ".join(map(self.value, item)) + "]"
        return json.dumps(item)

    def lines(self, table: Mapping[str, Any], prefix: str = "") -> str:
        """Keys, tables among them dotted or inline."""
        made = ""
        for key, item in table.items():
            if isinstance(item, Mapping) and self.either():
                made += self.lines(item, f"{prefix}{key}.")
            else:
                made += f"{prefix}{key} = {self.value(item)}{self.remark()}"
        return made

    def headed(self, name: str, item: Any) -> list[str]:
        """A table below its header, or in parts below headers of their own."""
        if isinstance(item, list):
            return ["".join(f"[[{name}]]{self.remark()}{self.lines(entry)}\n" for entry in item)]
        inner = {k: v for k, v in item.items() if isinstance(v, Mapping) and self.either()}
        own = {k: v for k, v in item.items() if k not in inner}
        parts = [f"[{name}.{k}]{self.remark()}{self.lines(v)}\n" for k, v in inner.items()]
        return [f"# in front of {name}\n[{name}]{self.remark()}{self.lines(own)}\n", *parts]


@st.composite
def spelled(draw: st.DrawFn) -> str:
    """The campaign's tables; parts of a table may stand behind other tables."""
    speller = Speller(draw)
    at_top = {k for k, v in TABLES.items() if not isinstance(v, Mapping | list) or speller.either()}
    root = speller.lines({k: v for k, v in TABLES.items() if k in at_top})
    tables = [speller.headed(k, v) for k, v in TABLES.items() if k not in at_top]
    ordered = draw(st.permutations(tables))
    firsts = [first for first, *_ in ordered]
    return root + "".join(firsts) + "".join(part for _, *parts in ordered for part in parts)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("spelled")


@settings(max_examples=60, deadline=None)
@given(text=spelled(), tones=st.sampled_from([1, 2]))
def test_every_campaign_that_is_read_can_be_rewritten_and_read(
    folder: Path, text: str, tones: int
) -> None:
    assert tomllib.loads(text) == TABLES
    bound = laid(folder, text)
    check(rewritten_campaign(bound, tones), bound, tones)
