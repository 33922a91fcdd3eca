"""Recordings over time as other programs write them, drafted: heads behind #, oscilloscopes."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fitting as ff
from fitting.draft.api import Question, init
from fitting.measurements.records import ReadRecords
from fitting.measurements.traces import TraceTable

pytestmark = pytest.mark.usefixtures("swift_models")

#: A line of 4.1 kHz, 70 Hz wide, in closed form.
F_HZ, WIDTH_HZ = 4100.0, 70.0
LECROY = (
    "LECROYWR104Xi,12345,Waveform\nSegments,1,SegmentSize,2000\nSegment,TrigTime,TimeSinceSegment1\n"
    "#1,01-Jan-2010 10:00:00,0\nTime,Ampl\n"
)
SIGLENT = (
    "Record Length,Analog:2000\nSample Interval,Analog:0.00001\nVertical Units,CH2:V\n"
    "Vertical Scale,CH2:1.00\nHorizontal Units,s\nModel Number,SDS2104X Plus\nSource,CH2\n"
    "Second,Value\n"
)


def ringdown(time_s: Any) -> Any:
    fall = np.exp(-np.pi * WIDTH_HZ * (time_s - time_s[0]))
    noise = 2e-3 * np.random.default_rng(3).standard_normal(time_s.size)
    return fall * np.cos(2.0 * np.pi * F_HZ * time_s + 0.4) + noise


def rows(t: Any, y: Any, between: str) -> str:
    return "".join(f"{a:.7g}{between}{b:.7g}\n" for a, b in zip(t, y, strict=True))


FILES: dict[str, tuple[Callable[[Any, Any], str], str]] = {
    "tabs": (lambda t, y: "# time(ms)\tx(nm)\n" + rows(1e3 * t, 7.0 * y, "\t"), "x"),
    "two remarks": (
        lambda t, y: "# by hand\n# t (us), U (mV)\n" + rows(1e6 * t, 1e3 * y, ","),
        "U",
    ),
    "LeCroy": (lambda t, y: LECROY + rows(t - 1e-3, y, ","), "Ampl"),
    "Siglent": (lambda t, y: SIGLENT + rows(t - 1e-3, y, ","), "CH2"),
}


@pytest.mark.parametrize(
    "name",
    [
        *("tabs", "Siglent"),
        *(pytest.param(name, marks=pytest.mark.nightly) for name in ("two remarks", "LeCroy")),
    ],
)
def test_a_ringdown_is_read_and_drafted_with_its_units(name: str, tmp_path: Path) -> None:
    """`init` read tables of one kind only, and sent these to `line`."""
    write, column = FILES[name]
    path = tmp_path / "ring.txt"
    time_s = np.arange(2000) * 1e-5
    path.write_text(write(time_s, ringdown(time_s)))
    found = ff.ringdown(path)
    assert found.frequency.value == pytest.approx(F_HZ, abs=0.2)
    assert found.width.value == pytest.approx(WIDTH_HZ, abs=0.4)
    made, _ = init(path, out=tmp_path / "o")
    written = tomllib.loads(made.read_text("utf-8"))
    assert written["trace"][0]["columns"]["output"] == column
    boxes = {p["name"]: p["start"] for p in written["parameters"]}
    assert boxes["f1"] == pytest.approx(F_HZ, abs=2.0)
    assert boxes["d1"] == pytest.approx(WIDTH_HZ, rel=0.2)
    traces = ff.read_campaign(made).measurements["trace"]
    assert isinstance(traces, ReadRecords)
    [table] = traces.tables
    assert isinstance(table, TraceTable)
    time, output, *_ = table.read_columns("readout")
    np.testing.assert_allclose(np.diff(time.values), 1e-5, rtol=1e-6)
    assert output.unit == {"x": "nm", "U": "mV"}.get(column, "V")


def test_a_sweep_behind_a_sign_of_a_remark_has_names_and_units(tmp_path: Path) -> None:
    f = np.linspace(60e3, 140e3, 161)
    r = 2e-3 / np.abs(1.0 - (f / 1e5) ** 2 + 1j * f / 1e5 / 20.0)
    path = tmp_path / "sweep.txt"
    path.write_text("# f (kHz)\tR (mV)\n" + rows(f / 1e3, 1e3 * r, "\t"))
    _, said = init(path, out=tmp_path / "o")
    assert any("'f' (kHz)" in each and "'R' (mV)" in each for each in said)
    assert ff.line(path).frequency.value == pytest.approx(1e5, rel=1e-4)


@pytest.mark.parametrize("phases", [False, True], ids=["amplitudes", "phases"])
def test_a_person_is_asked_for_units_and_a_script_is_told_the_flag(
    phases: bool, tmp_path: Path
) -> None:
    """A line of 100 kHz in a file that names no unit."""
    f = np.linspace(60e3, 140e3, 161)
    y = 2e-3 / (1.0 - (f / 1e5) ** 2 + 1j * f / 1e5 / 20.0)
    columns = [f / 1e3, np.abs(y), np.degrees(np.angle(y))][: 3 if phases else 2]
    path = tmp_path / "sweep.csv"
    head = "frequency,amplitude (V),phase" if phases else "frequency,amplitude (V)"
    lines = [",".join(f"{v:.9g}" for v in row) for row in np.column_stack(columns)]
    path.write_text("\n".join([head, *lines]) + "\n")
    asked: list[Question] = []

    def answer(question: Question) -> Sequence[str] | None:
        asked.append(question)
        return {"unit-frequency": ["kHz"], "unit-phase": ["deg"]}.get(question.key)

    made, said = init(path, out=tmp_path / "o", ask=answer)
    assert asked[0].key == "unit-frequency"
    assert (asked[1].key == "unit-phase") is phases
    assert all(token in asked[0].words for token in ("sweep.csv", "'frequency'"))
    assert any(each.startswith("unit-frequency:") and "kHz" in each for each in said)
    starts = {p["name"]: p["start"] for p in tomllib.loads(made.read_text("utf-8"))["parameters"]}
    assert starts["f1"] == pytest.approx(1e5, rel=1e-4)
    with pytest.raises(ff.BadInput, match="--unit-frequency"):
        init(path, out=tmp_path / "script")
    with pytest.raises(ff.BadInput, match=r"unit-frequency:.*kHz"):
        init(path, out=tmp_path / "nothing", ask=lambda _: None)


def test_all_units_that_files_lack_are_named_at_once(tmp_path: Path) -> None:
    """Of every file, of the control of a map, and of a lock-in's record."""
    t = np.arange(600) / 2000.0
    z = np.exp((-12.0 + 195.0j) * t)
    f, volt = np.tile(np.linspace(990.0, 1010.0, 41), 3), np.repeat([0.0, 1.0, 2.0], 41)
    r = 1.0 / np.hypot(f - 1000.0, 2.0)
    lock_in, map_, sweep = (tmp_path / f"{name}.csv" for name in ("lock_in", "map", "sweep"))
    for path, head, columns in (
        (lock_in, "time,R,theta", (t, np.abs(z), np.unwrap(np.angle(z)))),
        (map_, "V,frequency,amplitude", (volt, f, r)),
        (sweep, "frequency,amplitude", (f[:41], r[:41])),
    ):
        np.savetxt(path, np.column_stack(columns), delimiter=",", header=head, comments="")
    wanted = {
        (lock_in,): ["unit-phase", "unit-time", "demodulated-at"],
        (map_,): ["unit-frequency", "'V'"],
        (map_, sweep): ["map.*unit-frequency", "'V'", "sweep.*unit-frequency"],
    }
    for paths, tokens in wanted.items():
        with pytest.raises(ff.BadInput) as caught:
            init(list(paths), out=tmp_path / "o")
        assert len(caught.value.args) == len(tokens)
        for text, token in zip(caught.value.args, tokens, strict=True):
            assert re.search(token, text)
