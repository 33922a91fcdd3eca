"""Instruments' files: layouts from their manuals, round trips, and every complaint about a file."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fitting.campaign.file import WrittenSweep
from fitting.campaign.instruments import LAYOUTS, layout_of, read_trace
from fitting.campaign.instruments.recording import Layout, Recording, Selection, channel_of
from fitting.signal.amplitudes import Amplitude, declared_amplitude, to_peak
from fitting.text.errors import BadInput
from fitting.text.schema import read_record
from fitting.text.tables import parse_number, read_text

PLAIN = "frequency (MHz),amplitude (uV)\n6.94,1.5\n6.95,2.5e1\n6.96,3\n"

# The data section after the tables of "ASCII File Export Format" in the FSW and FPL user manuals.
ROHDE_SCHWARZ = """\
Type;R&S FSW;
Version;5.00;
Date;01.Oct 2006;
Mode;ANALYZER;
Center Freq;55000;Hz
Span;90000;Hz
RBW;100000;Hz
x-Unit;Hz;
y-Unit;dBm;
Window;1;Frequency Sweep
Trace 1;;
Trace Mode;AVERAGE;
Detector;AUTOPEAK;
Values; 3;
10000;-10.3;-15.7
10130;-11.5;-16.9
10360;-12.0;-17.4
Trace 2;;
Trace Mode;CLR/WRITE;
Detector;RMS;
Values; 3;
10000;-20.0
10130;-21.0
10360;-22.0
"""

ZURICH = """\
chunk;timestamp;size;fieldname;
0;1050;4;frequency;1000.0;1001.0;1002.0;nan
0;1050;4;r;1e-3;2e-3;1.5e-3;nan
0;1050;4;phase;0.1;0.2;0.3;nan
"""

AFM = """\
Experiment\tFrequency Sweep\t
f_res (Hz)\t30281.5211\t

[DATA]
Frequency Shift (Hz)\tCenter Frequency (Hz)\tAmplitude (m)\tPhase (deg)
-1.5000E+0\t30.2829E+3\t520.545E-12\t90.3060E+0
0.0000E+0\t30.2829E+3\t519.420E-12\t45.0E+0
1.5000E+0\t30.2829E+3\t518.0E-12\t0.0E+0
"""


def put(folder: Path, text: str, name: str = "trace.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def complaint(path: Path, layout: str = "csv", selection: Selection | None = None) -> str:
    with pytest.raises(BadInput) as caught:
        read_trace(path, layout, selection)
    text = str(caught.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    return text.removeprefix(f"{path}: ")


def test_plain_csv_with_units_in_its_header(tmp_path: Path) -> None:
    trace = read_trace(put(tmp_path, "# a note\n\n" + PLAIN), "csv")
    np.testing.assert_array_equal(trace.frequency, [6.94, 6.95, 6.96])
    np.testing.assert_array_equal(trace.amplitude, [1.5, 25.0, 3.0])
    assert (trace.frequency_unit, trace.amplitude_unit, trace.phase) == ("MHz", "uV", None)
    assert trace.places == ("row 4", "row 5", "row 6")


def test_square_brackets_phase_quotes_and_trailing_delimiter(tmp_path: Path) -> None:
    text = '"Frequency [Hz]","Amplitude [V]",Phase [deg],\n1,1e-6,90,\n2,2e-6,45,\n3,1e-6,0,\n'
    trace = read_trace(put(tmp_path, text), "csv")
    assert trace.phase is not None
    assert trace.phase_unit == "deg"
    np.testing.assert_array_equal(trace.phase, [90.0, 45.0, 0.0])


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_decimal_comma(tmp_path: Path, delimiter: str) -> None:
    text = "frequency (MHz),amplitude (µV)\n6,94,1,5\n".replace("),", f"){delimiter}")
    text = text.replace("6,94,", f"6,94{delimiter}") + f"6,95{delimiter}2,5e1\n6,96{delimiter}3\n"
    trace = read_trace(put(tmp_path, text), "csv")
    np.testing.assert_array_equal(trace.frequency, [6.94, 6.95, 6.96])
    np.testing.assert_array_equal(trace.amplitude, [1.5, 25.0, 3.0])


def test_latin1_micro_sign_and_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "old.csv"
    path.write_bytes(PLAIN.replace("uV", "µV").encode("latin-1"))
    assert read_trace(path, "csv").amplitude_unit == "µV"
    path.write_bytes(PLAIN.encode("utf-8-sig"))
    assert read_trace(path, "csv").frequency_unit == "MHz"


def test_named_columns(tmp_path: Path) -> None:
    path = put(tmp_path, "X1 (kHz),ch2 (mV),amplitude (V)\n1,5,0\n2,6,0\n3,7,0\n")
    trace = read_trace(path, "csv", Selection(frequency="X1", amplitude="ch2"))
    np.testing.assert_array_equal(trace.amplitude, [5.0, 6.0, 7.0])
    told = complaint(path, selection=Selection(frequency="X1", amplitude="ch3"))
    assert "'ch3'" in told
    assert "'ch2'" in told


def test_rohde_schwarz_takes_the_larger_level_and_the_named_trace(tmp_path: Path) -> None:
    path = put(tmp_path, ROHDE_SCHWARZ)
    trace = read_trace(path, "rohde-schwarz")
    np.testing.assert_array_equal(trace.frequency, [10000.0, 10130.0, 10360.0])
    np.testing.assert_array_equal(trace.amplitude, [-10.3, -11.5, -12.0])
    assert (trace.frequency_unit, trace.amplitude_unit) == ("Hz", "dBm")
    assert trace.notes["type"] == "R&S FSW"
    assert trace.notes["rbw"] == "100000 Hz"
    second = read_trace(path, "rohde-schwarz", Selection(trace=2))
    np.testing.assert_array_equal(second.amplitude, [-20.0, -21.0, -22.0])
    comma = put(tmp_path, ROHDE_SCHWARZ.replace("-10.3", "-10,3"))
    assert read_trace(comma, "rohde-schwarz").amplitude[0] == -10.3


def test_zurich_by_field_stops_at_the_padding(tmp_path: Path) -> None:
    trace = read_trace(put(tmp_path, ZURICH), "zurich")
    np.testing.assert_array_equal(trace.frequency, [1000.0, 1001.0, 1002.0])
    np.testing.assert_array_equal(trace.amplitude, [1e-3, 2e-3, 1.5e-3])
    assert trace.phase is not None
    assert trace.phase_unit == "rad"
    assert (trace.frequency_unit, trace.amplitude_unit) == ("Hz", "V")


def test_zurich_of_several_sweeps_wants_a_chunk(tmp_path: Path) -> None:
    second = ZURICH.split("\n", 1)[1].replace("0;1050", "1;2050").replace("1e-3", "7e-3")
    path = put(tmp_path, ZURICH + second)
    assert re.search(r"\b0, 1; .*'chunk = 1'", complaint(path, "zurich"))
    assert read_trace(path, "zurich", Selection(chunk=1)).amplitude[0] == 7e-3
    assert read_trace(path, "zurich", Selection(chunk=0)).amplitude[0] == 1e-3


def test_zurich_by_point(tmp_path: Path) -> None:
    text = "chunk;timestamp;frequency;r;phase\n0;1;1000;1e-3;0\n0;2;1001;2e-3;0\n0;3;1002;1e-3;0\n"
    trace = read_trace(put(tmp_path, text), "zurich")
    np.testing.assert_array_equal(trace.amplitude, [1e-3, 2e-3, 1e-3])
    assert (trace.frequency_unit, trace.amplitude_unit, trace.phase_unit) == ("Hz", "V", "rad")


def test_afm_adds_shift_and_center(tmp_path: Path) -> None:
    trace = read_trace(put(tmp_path, AFM), "afm")
    np.testing.assert_allclose(trace.frequency, [30281.4, 30282.9, 30284.4], rtol=1e-15)
    assert (trace.amplitude_unit, trace.phase_unit) == ("m", "deg")
    assert trace.notes["f_res (Hz)"] == "30281.5211"


def test_shipped_afm_file_is_the_original() -> None:
    import hashlib

    path = Path(__file__).parents[2] / "data" / "afm_sensor" / "afm_sensor_sweep.dat"
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    assert digest in (path.parent / "README.md").read_text(encoding="utf-8")
    assert read_trace(path, "afm").frequency.size == 256


EDITS = [
    (
        "csv",
        PLAIN,
        "2.5e1",
        "nan",
        "row 3, column 'amplitude': found 'nan', wanted a finite number",
    ),
    ("csv", PLAIN, "2.5e1", "inf", "row 3, column 'amplitude': found 'inf'"),
    ("csv", PLAIN, "2.5e1", "1e999", "row 3, column 'amplitude': found '1e999'"),
    ("csv", PLAIN, "2.5e1", "high", "row 3, column 'amplitude': found 'high'"),
    ("csv", PLAIN, "2.5e1", "", "row 3, column 'amplitude': found ''"),
    ("csv", PLAIN, "6.95", "1_0", "row 3, column 'frequency': found '1_0'"),
    ("csv", PLAIN, "6.95", "6.93", "row 3: frequency 6.93 MHz follows 6.94: not sorted"),
    ("csv", PLAIN, "6.95", "6.94", "row 3: frequency 6.94 MHz appears twice"),
    ("csv", PLAIN, " (MHz)", "", "column 'frequency' has no unit in its header"),
    ("csv", PLAIN, " (uV)", " ()", "column 'amplitude' has no unit in its header"),
    ("csv", PLAIN, "amplitude", "amplitud", "no column 'amplitude'; did you mean 'amplitud'?"),
    ("csv", PLAIN, "amplitude", "Frequency", "row 1: column 'Frequency' appears twice"),
    ("csv", PLAIN, "6.95,", "6,95,", "row 3 has 3 cells, the rows above it 2: found '6,95,2.5e1'"),
    ("csv", PLAIN, "6.96,3\n", "", "2 points; wanted at least 3"),
    (
        "csv",
        PLAIN,
        PLAIN[31:],
        "",
        "row 1 is the last; wanted rows of numbers",
    ),
    ("csv", PLAIN, PLAIN, "# nothing\n", "is empty"),
    ("rohde-schwarz", ROHDE_SCHWARZ, "-11.5", "----", "row 16, column 'Level': found '----'"),
    ("rohde-schwarz", ROHDE_SCHWARZ, "y-Unit;dBm;", "", "no 'y-unit' line before the values"),
    (
        "rohde-schwarz",
        ROHDE_SCHWARZ,
        "Values; 3;",
        "Points; 3;",
        "0 traces ('Values;<number>' lines)",
    ),
    ("rohde-schwarz", ROHDE_SCHWARZ, "Values; 3;", "Values; 99;", "99 points announced"),
    (
        "rohde-schwarz",
        ROHDE_SCHWARZ,
        "10130;-11.5",
        "10000;-11.5",
        "row 16: frequency 10000 Hz appears",
    ),
    ("zurich", ZURICH, "2e-3", "nan", "row 3, field 'r', value 2: found 'nan'"),
    ("zurich", ZURICH, ";r;", ";x;", "no column 'amplitude'; there is: frequency, x, phase"),
    ("zurich", ZURICH, "1001.0", "999.0", "row 2, value 2: frequency 999 Hz follows 1000"),
    ("afm", AFM, "[DATA]", "DATA", "no line '[DATA]'"),
    (
        "afm",
        AFM,
        "Center Frequency (Hz)",
        "Center Frequency (kHz)",
        "in Hz and 'Center Frequency' in kHz",
    ),
    ("afm", AFM, "519.420E-12", "nan", "row 7, column 'Amplitude': found 'nan'"),
]


@pytest.mark.parametrize(("layout", "text", "old", "new", "words"), EDITS)
def test_bad_files_are_named_with_row_and_column(
    tmp_path: Path, layout: str, text: str, old: str, new: str, words: str
) -> None:
    assert old in text
    assert words in complaint(put(tmp_path, text.replace(old, new)), layout)


def test_missing_file_names_its_neighbour(tmp_path: Path) -> None:
    put(tmp_path, PLAIN, "pair1.csv")
    assert "'pair1.csv'" in complaint(tmp_path / "pari1.csv")
    assert "'" not in complaint(tmp_path / "nowhere" / "x.csv")
    assert "folder" in complaint(tmp_path)
    told = complaint(tmp_path / "a", "cvs")
    assert "'cvs'" in told
    assert "'csv'" in told


NUMBERS = st.lists(
    st.floats(1e-9, 1e9, allow_nan=False, allow_infinity=False),
    min_size=3,
    max_size=20,
    unique=True,
).map(sorted)
WRITERS = {
    "csv": lambda f, a: (
        "f (Hz),level (V)\n" + "".join(f"{x!r},{y!r}\n" for x, y in zip(f, a, strict=True))
    ),
    "comma": lambda f, a: (
        "f (Hz);level (V)\n" + "".join(f"{x!r};{y!r}\n" for x, y in zip(f, a, strict=True))
    ).replace(".", ","),
    "rohde-schwarz": lambda f, a: (
        f"Type;FSV-7;\nTrace 1;;\nx-Unit;Hz;\ny-Unit;V;\nValues;{len(f)};\n"
        + "".join(f"{x!r};{y!r};\n" for x, y in zip(f, a, strict=True))
    ),
    "zurich": lambda f, a: (
        "chunk;timestamp;size;fieldname\n"
        f"3;9;{len(f)};frequency;{';'.join(map(repr, f))}\n"
        f"3;9;{len(f)};r;{';'.join(map(repr, a))};nan;nan\n"
    ),
    "afm": lambda f, a: (
        "Date\t1\n[DATA]\nFrequency Shift (Hz)\tCenter Frequency (Hz)\tAmplitude (m)\n"
        + "".join(f"{x!r}\t0\t{y!r}\n" for x, y in zip(f, a, strict=True))
    ),
}


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@pytest.mark.parametrize("layout", list(WRITERS))
@given(frequency=NUMBERS, data=st.data())
def test_what_is_written_with_all_digits_is_read_back(
    tmp_path: Path, layout: str, frequency: list[float], data: st.DataObject
) -> None:
    amplitude = data.draw(
        st.lists(st.floats(0.0, 1e3), min_size=len(frequency), max_size=len(frequency))
    )
    path = put(tmp_path, WRITERS[layout](frequency, amplitude))
    trace = read_trace(path, "csv" if layout == "comma" else layout)
    np.testing.assert_array_equal(trace.frequency, frequency)
    np.testing.assert_array_equal(trace.amplitude, amplitude)


@given(st.text(max_size=30))
def test_any_text_is_a_number_or_a_complaint(text: str) -> None:
    looks = re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", text)
    if looks and math.isfinite(float(text)):
        assert parse_number(text, "file: row 1") == float(text)
        return
    with pytest.raises(BadInput, match=r"^file: row 1: ") as caught:
        parse_number(text, "file: row 1")
    assert "\n" not in str(caught.value)


def test_amplitude_declarations() -> None:
    where = "c.toml: [sweep] amplitude"
    assert declared_amplitude("V peak", None, where) == Amplitude("peak", "V")
    assert declared_amplitude("m peak", None, where) == Amplitude("peak", "m")
    one = np.array([1.0])
    rms = to_peak(one, "uV", Amplitude("rms", "V"), "f", ["row 1"])
    np.testing.assert_allclose(rms, math.sqrt(2) * 1e-6, rtol=1e-15)
    # 0 dBm into 50 ohm is 1 mW: 223.6 mV rms, the number printed on every signal generator
    dbm = declared_amplitude("dBm", 50.0, where)
    found = to_peak(np.array([0.0, -20.0]), "dBm", dbm, "f", ["row 1", "row 2"])
    np.testing.assert_allclose(found / math.sqrt(2), [0.2236068, 0.02236068], rtol=1e-7)


@pytest.mark.parametrize(
    ("text", "impedance", "words"),
    [
        ("V", None, 'found "V", .*"V peak", "V rms" or "dBm"'),
        ("peak", None, 'found "peak"'),
        ("V pk", None, 'found "V pk"'),
        ("dBm", None, 'impedance = "50 ohm"'),
        ("V peak", 50.0, 'impedance .*"dBm"'),
        ("Vlot peak", None, "Vlot"),
        ("mW peak", None, "a power; .*root"),
        ("V**2 rms", None, "a power; .*root"),
    ],
)
def test_bad_declarations(text: str, impedance: float | None, words: str) -> None:
    where = "c.toml: [sweep] amplitude"
    with pytest.raises(BadInput, match=words) as caught:
        declared_amplitude(text, impedance, where)
    assert str(caught.value).startswith(where)


@pytest.mark.parametrize(
    ("unit", "amplitude", "words"),
    [
        (
            "dBm",
            Amplitude("peak", "V"),
            "column 'amplitude': is in dBm, but the campaign declares V peak",
        ),
        ("uV", Amplitude("dBm", "V", 50.0), "is in uV, but the campaign declares dBm"),
        ("uV", Amplitude("peak", "V"), "row 9, column 'amplitude': negative amplitude -1 uV"),
        ("m", Amplitude("peak", "V"), "column 'amplitude'"),
    ],
)
def test_amplitudes_that_contradict_their_declaration(
    unit: str, amplitude: Amplitude, words: str
) -> None:
    values = np.array([2.0, -1.0]) if unit == "uV" else np.array([2.0, 1.0])
    with pytest.raises(BadInput, match=words):
        to_peak(values, unit, amplitude, "trace.csv", ["row 8", "row 9"])


@pytest.mark.parametrize(
    ("text", "layout"),
    [
        (PLAIN, "csv"),
        (ROHDE_SCHWARZ, "rohde-schwarz"),
        (ZURICH, "zurich"),
        ("chunk,timestamp,frequency,r\n0,1,1.0,2.0\n", "zurich"),
        (AFM, "afm"),
        ("", "csv"),
    ],
)
def test_a_layout_is_known_by_its_content(tmp_path: Path, text: str, layout: str) -> None:
    assert layout_of(put(tmp_path, text)) == layout


def read_toy(path: Path, selection: Selection) -> Recording:
    values = np.array(read_text(path).split()[1:], dtype=float).reshape(-1, 2)
    places = tuple(f"pair {i + 1}" for i in range(len(values)))
    channels = channel_of("f", "kHz", values[:, 0]), channel_of("R", "mV", values[:, 1])
    return Recording(path=path, channels=channels, places=places)


def test_a_layout_is_added_by_one_entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A reader and a sign: read by, allowed in a campaign and known by content."""
    path = put(tmp_path, "TOY 1 10 2 20 3 30")
    with pytest.raises(BadInput, match="'toy'"):
        read_trace(path, "toy")
    toy = Layout("toy", read_toy, lambda head: head.data.startswith(b"TOY"), keys=("chunk",))
    monkeypatch.setitem(LAYOUTS, "toy", toy)
    assert next(iter(LAYOUTS)) == "csv"
    assert layout_of(path) == "toy"
    table = {"file": path.name, "layout": "toy", "amplitude": "V rms", "chunk": 1}
    how = read_record(WrittenSweep, table, tmp_path / "campaign.toml", "sweep")
    trace = read_trace(path, how.layout, how.selection(how.columns))
    assert trace.frequency.tolist() == [1.0, 2.0, 3.0]
    assert (trace.amplitude_unit, trace.places[2]) == ("mV", "pair 3")
    with pytest.raises(BadInput, match=r'trace: .*layout = "toy"'):
        read_record(WrittenSweep, table | {"trace": 1}, tmp_path / "campaign.toml", "sweep")
