"""Formats with a specification of their own: written by their libraries, or by hand from it.

Every file holds the same resonance, which an independent least squares has to find behind the
reader. What cannot be used is called by its kind, with what to do.
"""

from __future__ import annotations

import gc
import sys
import tempfile
import warnings
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import pyuff
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from fitting.campaign.instruments import LAYOUTS, layout_of, read_recording, read_trace
from fitting.campaign.instruments.recording import Selection
from fitting.campaign.recognised import recognised
from fitting.measurements.complex_sweep import ComplexSweepTable, read_complex
from fitting.resonance.reading import Columns as LineColumns
from fitting.resonance.reading import roles_of
from fitting.signal.amplitudes import declared_amplitude, to_peak
from fitting.text.errors import BadInput
from fitting.text.schema import read_record
from tests.faults.test_readers import complaints
from tests.support.recognised import is_complex, is_sweep, seeming_selection, without_unit
from tests.support.written_resonance import AXIS_HZ, F_HZ, VALUES, WIDTH_HZ, found_line

R, DEGREES = np.abs(VALUES), np.rad2deg(np.angle(VALUES))
DB = 20.0 * np.log10(R)
#: Something else than the resonance, of the same size.
OTHER = np.full(AXIS_HZ.size, 1e-3 + 2e-3j)


def lines(*columns: np.ndarray, between: str = " ") -> list[str]:
    return [between.join(f"{v:.12e}" for v in row) for row in zip(*columns, strict=True)]


def touchstone(options: str, first: np.ndarray, second: np.ndarray, scale: float) -> str:
    """Version 1.1: an option line, then frequency and one pair per parameter."""
    head = ["! made by a test", f"# {options}", "! freq S11"]
    return "\n".join([*head, *lines(AXIS_HZ / scale, first, second), ""])


def two_ports(path: Path) -> None:
    """S11, S21, S12, S22 in this order, as version 1 has it for two ports."""
    pairs = [f(x) for x in (OTHER, VALUES, OTHER, OTHER) for f in (np.real, np.imag)]
    path.write_text("# kHz S RI R 50\n" + "\n".join(lines(AXIS_HZ / 1e3, *pairs)) + "\n")


def version_two(path: Path) -> None:
    head = "[Version] 2.0\n# Hz S RI R 50\n[Number of Ports] 1\n[Number of Frequencies] 57\n"
    rows = "\n".join(lines(AXIS_HZ, VALUES.real, VALUES.imag))
    path.write_text(f"{head}[Network Data]\n{rows}\n[End]\n")


ZEROS = {
    f"{axis}_{what}": 0
    for axis in ("abscissa", "ordinate", "orddenom", "z_axis")
    for what in ("len_unit_exp", "force_unit_exp", "temp_unit_exp")
} | {"z_axis_spec_data_type": 0}


def uff(path: Path, *, binary: int = 0, kind: int = 18, units: str = "Hz") -> None:
    """Two functions of dataset 58, by pyuff's own writer."""
    path.write_bytes(uff_bytes(binary, kind, units))


@cache
def uff_bytes(binary: int, kind: int, units: str) -> bytes:
    """What pyuff writes: once, because its open file is closed by collecting all garbage."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.uff"
        write_uff(path, binary, kind, units)
        return path.read_bytes()


def write_uff(path: Path, binary: int, kind: int, units: str) -> None:
    """By pyuff itself."""
    for k, values in enumerate((VALUES, OTHER), start=1):
        made = pyuff.prepare_58(
            binary=binary,
            id1="FRF",
            id2="",
            id3="",
            id4="",
            id5="",
            func_type=4 if kind == 18 else 1,
            ver_num=0,
            load_case_id=0,
            rsp_ent_name="NONE",
            ref_ent_name="NONE",
            rsp_node=k,
            rsp_dir=3,
            ref_node=1,
            ref_dir=-3,
            ord_data_type=6,
            num_pts=AXIS_HZ.size,
            abscissa_spacing=1,
            abscissa_min=AXIS_HZ[0],
            abscissa_inc=AXIS_HZ[1] - AXIS_HZ[0],
            z_axis_value=0.0,
            **ZEROS,
            abscissa_spec_data_type=kind,
            abscissa_axis_units_lab=units,
            ordinate_spec_data_type=8,
            ordinate_axis_units_lab="m",
            orddenom_spec_data_type=13,
            orddenom_axis_units_lab="N",
            z_axis_axis_units_lab="NONE",
            data=values,
            x=AXIS_HZ,
            return_full_dict=True,
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResourceWarning)  # the writer leaves its file open
            pyuff.UFF(str(path)).write_sets(made, mode="add")
            gc.collect()


def hdf5_by_attributes(path: Path) -> None:
    with h5py.File(path, "w") as file:
        group = file.create_group("sweep 1/demod")
        for name, unit, values in (
            ("frequency", "Hz", AXIS_HZ),
            ("x", "V", VALUES.real),
            ("y", b"V", VALUES.imag),
        ):
            group.create_dataset(name, data=values).attrs["unit"] = unit
        file.create_dataset("settings/gain", data=3.0)
        file.create_dataset("note", data="none")


def hdf5_complex(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("Frequency (kHz)", data=AXIS_HZ / 1e3)
        file.create_dataset("S21 (1)", data=VALUES)
        file.create_dataset("picture", data=np.zeros((40, 50)))


def hdf5_two(path: Path) -> None:
    with h5py.File(path, "w") as file:
        for name, values in (("cold", VALUES), ("warm", OTHER)):
            file.create_dataset(f"{name}/frequency (Hz)", data=AXIS_HZ)
            file.create_dataset(f"{name}/S (V)", data=values)


def hdf5_table(path: Path) -> None:
    rows = np.zeros(AXIS_HZ.size, dtype=[("f (Hz)", "f8"), ("re (V)", "f8"), ("im (V)", "f8")])
    rows["f (Hz)"], rows["re (V)"], rows["im (V)"] = AXIS_HZ, VALUES.real, VALUES.imag
    with h5py.File(path, "w") as file:
        file.create_dataset("run", data=rows)


def matlab_73(path: Path) -> None:
    """HDF5 behind a block of 512 bytes with MATLAB's text, vectors as 1×n matrices."""
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_dataset("freq", data=AXIS_HZ[None, :])
        file.create_dataset("mag", data=R[None, :])
        file.create_dataset("phase", data=DEGREES[None, :])
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 .".ljust(512))


def tdms(path: Path) -> None:
    with TdmsWriter(path) as writer:
        for name, unit, values in (
            ("Frequency", "Hz", AXIS_HZ),
            ("Amplitude", "V", R),
            ("Phase", "deg", DEGREES),
        ):
            writer.write_segment([ChannelObject("Sweep", name, values, {"unit_string": unit})])


def tdms_waveforms(path: Path, unit: str = "Hz") -> None:
    """A start and a step in place of a column of frequencies."""
    about = {
        "wf_start_offset": float(AXIS_HZ[0]),
        "wf_increment": float(AXIS_HZ[1] - AXIS_HZ[0]),
        "wf_xunit_string": unit,
        "unit_string": "V",
    }
    with TdmsWriter(path) as writer:
        for name, values in (("X", VALUES.real), ("Y", VALUES.imag)):
            writer.write_segment([ChannelObject("Sweep", name, values, about)])


KEYSIGHT = "!CSV A.01.01\n!Keysight Technologies,N5222A,MY1,A.10.00\n!Source: Standard\n\n"


def keysight(path: Path) -> None:
    """As the PNA writes "CSV formatted data, displayed traces" in real and imaginary part."""
    rows = "\n".join(lines(AXIS_HZ, VALUES.real, VALUES.imag, between=","))
    path.write_text(f"{KEYSIGHT}BEGIN CH1_DATA\nFreq(Hz),S21(REAL),S21(IMAG)\n{rows}\nEND\n")


def keysight_two(path: Path) -> None:
    """A block for every channel, in dB and degrees."""
    blocks = [
        f"BEGIN CH{k}_DATA\nFreq(Hz),S21(DB),S21(DEG)\n"
        + "\n".join(lines(AXIS_HZ, values, DEGREES, between=","))
        + "\nEND\n\n"
        for k, values in enumerate((0 * DB, DB), start=1)
    ]
    path.write_text(KEYSIGHT + "".join(blocks))


def fieldfox(path: Path) -> None:
    """Names and units above each block, in lines of their own."""
    blocks = [
        f"! DATA Freq,S21\n! FREQ UNIT Hz\n! DATA UNIT {unit}\nBEGIN\n"
        + "\n".join(lines(AXIS_HZ, values, between=","))
        + "\nEND\n"
        for unit, values in (("dB", DB), ("Degrees", DEGREES))
    ]
    path.write_text("! FILETYPE CSV\n! VERSION 1.0\n" + "".join(blocks))


def bode(path: Path) -> None:
    """The Bode plot of an oscilloscope, numbered rows and a sign of a number above them."""
    count = np.arange(1.0, AXIS_HZ.size + 1)
    rows = "\n".join(lines(count, AXIS_HZ, DB, DEGREES, between=","))
    path.write_text(f"#,Frequency (Hz),Gain (dB),Phase (°)\n{rows}\n", encoding="utf-8")


def nanonis(path: Path) -> None:
    rows = "\n".join(lines(AXIS_HZ, R, DEGREES, between="\t"))
    path.write_text(
        "Experiment\tFrequency Sweep\t\nDate\t1.1.2020\t\n\n[DATA]\n"
        f"Frequency (Hz)\tAmplitude (m)\tPhase (deg)\n{rows}\n"
    )


Columns = dict[str, Any]
#: Layout, name of the file, its writer, and what the campaign has to say.
FILES: dict[str, tuple[str, str, Callable[[Path], object], Columns]] = {
    "s1p, RI, Hz": (
        "touchstone",
        "a.s1p",
        lambda p: p.write_text(touchstone("HZ S RI R 50", VALUES.real, VALUES.imag, 1.0)),
        {},
    ),
    "s1p, MA, MHz": (
        "touchstone",
        "a.S1P",
        lambda p: p.write_text(touchstone("MHz S MA R 50", R, DEGREES, 1e6)),
        {},
    ),
    "s1p, dB, GHz, other ending": (
        "touchstone",
        "a.txt",
        lambda p: p.write_text(touchstone("ghz s db r 75", DB, DEGREES, 1e9)),
        {},
    ),
    "s2p": ("touchstone", "a.s2p", two_ports, {"amplitude": "S21"}),
    "s2p, other ending": ("touchstone", "a.dat", two_ports, {"amplitude": "s21"}),
    "Touchstone 2.0": ("touchstone", "a.ts", version_two, {}),
    "UFF 58, text": ("uff", "a.uff", uff, {"amplitude": "1z/1-z"}),
    "UFF 58, binary": (
        "uff",
        "a.unv",
        lambda p: uff(p, binary=1, units="NONE"),
        {"amplitude": "1z/1-z"},
    ),
    "HDF5, units as attributes": ("hdf5", "a.h5", hdf5_by_attributes, {}),
    "HDF5, complex": ("hdf5", "a.hdf5", hdf5_complex, {}),
    "HDF5, one of two": ("hdf5", "a.h5", hdf5_two, {"frequency": "cold/frequency"}),
    "HDF5, one of two by its values": ("hdf5", "a.h5", hdf5_two, {"amplitude": "cold/S"}),
    "HDF5, a table": ("hdf5", "a.h5", hdf5_table, {}),
    "MATLAB 7.3": (
        "hdf5",
        "a.mat",
        matlab_73,
        {"frequency": "freq (Hz)", "amplitude": "mag (V)", "phase": "phase (deg)"},
    ),
    "MATLAB 5": (
        "matlab",
        "a.mat",
        lambda p: savemat(p, {"f": AXIS_HZ, "H": VALUES, "gain": 2.0}),
        {"frequency": "f (Hz)", "amplitude": "H (V)"},
    ),
    "MATLAB 5, a structure": (
        "matlab",
        "a.mat",
        lambda p: savemat(p, {"run": {"freq": AXIS_HZ, "re": VALUES.real, "im": VALUES.imag}}),
        {"frequency": "freq (Hz)", "x": "re (V)", "y": "im (V)"},
    ),
    "MATLAB 5, a matrix": (
        "matlab",
        "a.mat",
        lambda p: savemat(p, {"data": np.column_stack([AXIS_HZ, R, DEGREES])}),
        {"frequency": "data 1 (Hz)", "amplitude": "data 2 (V)", "phase": "data 3 (deg)"},
    ),
    "MATLAB 4": (
        "matlab",
        "a.mat",
        lambda p: savemat(p, {"f": AXIS_HZ, "H": VALUES}, format="4"),
        {"frequency": "f (Hz)", "amplitude": "H (V)"},
    ),
    "TDMS": ("tdms", "a.tdms", tdms, {}),
    "TDMS, waveforms": ("tdms", "a.tdms", tdms_waveforms, {}),
    "Keysight": ("keysight", "a.csv", keysight, {}),
    "Bode plot of an oscilloscope": (
        "csv",
        "a.csv",
        bode,
        {"amplitude": "Gain", "phase": "Phase"},
    ),
    "Nanonis": ("afm", "a.dat", nanonis, {}),
}


@pytest.mark.parametrize("name", FILES)
def test_the_resonance_is_found(name: str, tmp_path: Path) -> None:
    layout, file, write, columns = FILES[name]
    path = tmp_path / file
    write(path)
    assert layout_of(path) == layout
    measured = read_complex(path, None, Selection(**columns))
    f, width = found_line(measured.u_hz, measured.y)
    assert f == pytest.approx(F_HZ, abs=1e-5)
    assert width == pytest.approx(WIDTH_HZ, rel=1e-6)
    np.testing.assert_allclose(measured.y, VALUES, atol=1e-9 * np.max(R))


@pytest.mark.parametrize("name", FILES)
def test_what_it_is_is_said(name: str, tmp_path: Path) -> None:
    layout, file, write, _ = FILES[name]
    path = tmp_path / file
    write(path)
    if "two" in name:
        with pytest.raises(BadInput, match=r"2 sweeps: cold/frequency \(Hz\) \(57"):
            recognised(path)
        return
    found = recognised(path)
    assert found.layout == layout
    assert is_sweep(found)
    assert is_complex(found)
    assert "57 points" in found.words


def test_words(tmp_path: Path) -> None:
    for file, write, words in (
        ("a.s2p", two_ports, "Touchstone, 2 ports, S11, S21, S12, S22, 57 points, Hz"),
        ("a.uff", uff, "UFF dataset 58, frequency response function and 1 more, 57 points, Hz"),
        ("a.tdms", tdms, "TDMS, Sweep/Frequency, 57 points, Hz"),
        ("a.csv", keysight, "Keysight network analyser CSV, CH1_DATA, 57 points, Hz"),
    ):
        write(tmp_path / file)
        assert recognised(tmp_path / file).words == words
    seen = recognised(tmp_path / "a.s2p")
    assert seeming_selection(seen).amplitude == "S21"
    assert seen.unused(*(c for c in seen.channels if c.role)) == ()  # the others do not vary


def test_one_of_several_blocks(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    keysight_two(path)
    assert "2 blocks, trace = 1" in recognised(path).words
    trace = read_trace(path, None, Selection(trace=2, amplitude="S21"))
    np.testing.assert_allclose(trace.amplitude, DB, rtol=1e-11)
    assert trace.amplitude_unit == "dB"
    with pytest.raises(BadInput, match=r"2 blocks \('BEGIN' lines\).* 3"):
        read_trace(path, None, Selection(trace=3))


def test_names_of_keysight_and_of_others_are_understood(tmp_path: Path) -> None:
    """Of the PNA's front panel, of the ENA (one name for both columns), of Rohde & Schwarz' ZNB."""
    path = tmp_path / "a.csv"
    rows = "\n".join(lines(AXIS_HZ, DB, DEGREES, between=","))
    path.write_text(
        f"{KEYSIGHT}BEGIN CH1_DATA\nFreq(Hz),S21 Log Mag(dB),S21 Phase(deg)\n{rows}\nEND\n"
    )
    found = recognised(path)
    assert [(c.unit, c.role) for c in found.channels] == [
        ("Hz", "frequency"),
        ("dB", "amplitude"),
        ("deg", "phase"),
    ]
    path.write_text(
        f'"# Channel 1"\n"# Trace 1"\nFrequency, Formatted Data, Formatted Data\n{rows}\n'
    )
    found = recognised(path)
    assert [c.name for c in found.channels] == ["Frequency", "Formatted Data", "Formatted Data 2"]
    assert is_sweep(found)
    rows = "\n".join(lines(AXIS_HZ, VALUES.real, VALUES.imag, between=";"))
    path.write_text(f"# Version 1.00\nfreq[Hz];re:Trc1_S11;im:Trc1_S11;\n{rows}\n")
    found = recognised(path)
    assert [c.role for c in found.channels] == ["frequency", "re", "im"]
    assert without_unit(found) == ("re", "im")


def test_a_campaign_tells_block_and_columns(tmp_path: Path) -> None:
    """[[complex_sweep]] of the second block; with a layout that knows no blocks it is refused."""
    keysight_two(tmp_path / "a.csv")
    table: dict[str, object] = {
        "file": "a.csv",
        "trace": 2,
        "columns": {"amplitude": "S21", "phase": "S21(DEG)"},
    }
    where = tmp_path / "campaign.toml"
    curve = read_record(ComplexSweepTable, table, where, "complex_sweep").record("")
    f, width = found_line(np.asarray(curve.frequency_hz), np.asarray(curve.values))
    assert f == pytest.approx(F_HZ, abs=1e-5)
    assert width == pytest.approx(WIDTH_HZ, rel=1e-6)
    with pytest.raises(BadInput, match=r'trace: .*layout = "touchstone"'):
        read_record(ComplexSweepTable, table | {"layout": "touchstone"}, where, "complex_sweep")
    two_ports(tmp_path / "a.csv")
    written = read_record(ComplexSweepTable, table, where, "complex_sweep")
    with pytest.raises(BadInput, match=r"layout 'touchstone'; 'trace'"):
        written.record("")


def test_each_block_of_a_fieldfox(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    fieldfox(path)
    assert layout_of(path) == "keysight"
    told = {1: ("S21", "dB", DB), 2: ("S21", "deg", DEGREES)}
    for trace, (name, unit, values) in told.items():
        found = recognised(path, Selection(trace=trace))
        assert [(c.name, c.unit) for c in found.channels] == [("Freq", "Hz"), (name, unit)]
        read = read_trace(path, None, Selection(trace=trace, amplitude=name))
        np.testing.assert_allclose(read.amplitude, values, rtol=1e-11)


OVER_TIME: dict[str, tuple[str, Callable[[Path], object]]] = {
    "Tektronix": (
        "oscilloscope",
        lambda p: p.write_text(
            "Record Length,3.000e+00,,-0.0054,-6.2,\nSample Interval,4e-6,,-0.005396,-6.0,\n"
            "Vertical Units,V,,-0.005392,-6.1,\nHorizontal Units,s,,-0.005388,-6.1,\n"
            "Source,CH1,,-0.005384,-6.0,\n"
        ),
    ),
    "Rigol": (
        "oscilloscope",
        lambda p: p.write_text(
            "X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,-6.0e-05,2.0e-08\n"
            "0,1.2,0.1,,\n1,1.3,0.2,,\n2,1.2,0.3,,\n"
        ),
    ),
    "Keysight oscilloscope": (
        "csv",
        lambda p: p.write_text("x-axis,1,2\nsecond,Volt,Volt\n-1e-3,1,2\n0,2,3\n1e-3,1,2\n"),
    ),
    "PicoScope": (
        "csv",
        lambda p: p.write_text("Time,Channel A\n(ms),(mV)\n\n-5.0,1.0\n-4.9,1.1\n-4.8,1.0\n"),
    ),
    "LeCroy": (
        "lecroy",
        lambda p: p.write_text(
            "LECROYWS432,1234,Waveform\nSegments,2,SegmentSize,3\nSegment,TrigTime,Since\n"
            "#1,05-Mar-2020 10:00:00,0\n#2,05-Mar-2020 10:00:01,1\nTime,Ampl\n"
            "-1e-3,0.5\n0,0.6\n1e-3,0.5\n-1e-3,0.7\n0,0.8\n1e-3,0.9\n"
        ),
    ),
    "LabVIEW": (
        "labview",
        lambda p: p.write_text(
            "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tOne\n"
            "***End_of_Header***\t\n\t\nChannels\t2\t\nY_Unit_Label\tVolts\tg\t\n"
            "X_Dimension\tTime\tTime\t\n***End_of_Header***\t\t\t\n"
            "X_Value\tVoltage\tAcceleration\tComment\n"
            "-1e-3\t0.5\t2\n0\t0.6\t3\n1e-3\t0.5\t4\n"
        ),
    ),
    "Siglent": (
        "siglent",
        lambda p: p.write_text(
            "Record Length,Analog:3\nSample Interval,Analog:0.001\nVertical Units,CH1:A,CH3:V,,\n"
            "Horizontal Units,s\nHorizontal Scale,0.001\nModel Number,SDS2104X Plus\n"
            "Source,CH1,CH3\nSecond,Value,Value\n-1e-3,0.5,2\n0,0.6,3\n1e-3,0.5,4\n"
        ),
    ),
    "older Siglent": (
        "siglent",
        lambda p: p.write_text(
            "Record Length,Analog:3\nSample Rate,1000.0\nVertical Scale,CH1: 0.05\n"
            "Second,Volt\n-1e-3,0.5\n0,0.6\n1e-3,0.5\n"
        ),
    ),
    "TDMS": ("tdms", lambda p: tdms_waveforms(p, "s")),
    "UFF": ("uff", lambda p: uff(p, kind=17, units="s")),
}


def test_times_of_oscilloscopes(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    for name, times, values in (
        ("Rigol", [-6e-5, -5.998e-5, -5.996e-5], [1.2, 1.3, 1.2]),
        ("Tektronix", [-5.4e-3, -5.396e-3, -5.392e-3], [-6.2, -6.0, -6.1]),
    ):
        OVER_TIME[name][1](path)
        recording = read_recording(path, None, Selection())
        time, channel = (recording.numbers(c)[:3] for c in recording.channels[:2])
        np.testing.assert_allclose(time, times, rtol=1e-12)
        np.testing.assert_allclose(channel, values, rtol=1e-12)
        assert [c.unit for c in recording.channels[:2]] == ["s", "V"]


def test_heads_of_lecroy_and_siglent_tell_channels_and_segments(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    for name, trace, wanted in (
        ("LeCroy", 1, {"Ampl": ("V", [0.5, 0.6, 0.5])}),
        ("LeCroy", 2, {"Ampl": ("V", [0.7, 0.8, 0.9])}),
        ("Siglent", 1, {"CH1": ("A", [0.5, 0.6, 0.5]), "CH3": ("V", [2.0, 3.0, 4.0])}),
        ("older Siglent", 1, {"CH1": ("V", [0.5, 0.6, 0.5])}),
    ):
        OVER_TIME[name][1](path)
        recording = read_recording(path, None, Selection(trace=trace))
        time, *others = recording.channels
        assert (time.name, time.unit) == ("Time", "s")
        np.testing.assert_array_equal(recording.numbers(time), [-1e-3, 0.0, 1e-3])
        assert {c.name: (c.unit, list(recording.numbers(c))) for c in others} == wanted
    OVER_TIME["LeCroy"][1](path)
    with pytest.raises(BadInput, match=r"2 segments.* 3"):
        read_recording(path, None, Selection(trace=3))


@pytest.mark.parametrize("name", OVER_TIME)
def test_a_recording_over_time_is_no_sweep(name: str, tmp_path: Path) -> None:
    layout, write = OVER_TIME[name]
    path = tmp_path / "a.dat"
    write(path)
    assert layout_of(path) == layout
    found = recognised(path)
    assert found.role("time") is not None
    assert not is_sweep(found)
    with pytest.raises(BadInput, match=r"\(column '.*'\)"):
        read_trace(path, None)


@pytest.mark.parametrize(
    ("file", "write", "wanted"),
    [
        (
            "a.s2p",
            two_ports,
            r"S11, S21, S12, S22; .* columns = \{ amplitude = \"S21\" \}",
        ),
        ("a.uff", uff, r"1z/1-z, 2z/1-z; "),
        (
            "a.h5",
            hdf5_two,
            r"2 sweeps: cold/frequency \(Hz\) .*warm.* columns = \{ frequency = \"cold",
        ),
        (
            "a.dat",
            lambda p: p.write_text(
                "Experiment\tbias spectroscopy\t\n[DATA]\nBias calc (V)\tCurrent (A)\n1\t2\n2\t3\n"
            ),
            "Nanonis .*'bias spectroscopy'",
        ),
        ("a.cti", lambda p: p.write_text("CITIFILE A.01.00\n1,2\n2,3\n3,4\n"), "CITIfile"),
        (
            "a.mdf",
            lambda p: p.write_text("!\nBEGIN ACDATA\n1 2\n2 3\nEND\n"),
            "MDIF",
        ),
        ("a.txt", lambda p: p.write_text("(1+2j)\n(2+3j)\n3\n"), "one column"),
        ("a.txt", lambda p: p.write_text("Dear all,\nsee below\n"), "no table"),
        ("a.s1p", lambda p: p.write_text("# GHz Z RI R 50\n1 2 3\n2 3 4\n3 4 5\n"), "Z param"),
        ("a.s1p", lambda p: p.write_text("# GHz S RI R 50\n1 2\n"), "Touchstone"),
        ("a.uff", lambda p: p.write_text("    -1\n    58\nnonsense\n    -1\n"), "Universal"),
        ("a.uff", lambda p: p.write_text("    -1\n   164\n    -1\n"), "Universal File"),
        ("a.h5", lambda p: p.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(99)), "HDF5"),
        ("a.mat", lambda p: p.write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200)), "MATLAB"),
        ("a.tdms", lambda p: p.write_bytes(b"TDSm" + bytes(range(60))), "TDMS"),
        ("a.h5", lambda p: h5py.File(p, "w").close(), "HDF5; .*no arrays"),
    ],
)
def test_what_cannot_be_used_is_called_by_its_kind(
    file: str, write: Callable[[Path], object], wanted: str, tmp_path: Path
) -> None:
    path = tmp_path / file
    write(path)
    with pytest.raises(BadInput, match=wanted) as caught:
        read_trace(path, None)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("file", "write", "module", "extra"),
    [
        ("a.s2p", two_ports, "skrf.io.touchstone", "touchstone"),
        ("a.uff", uff, "pyuff", "uff"),
        ("a.h5", hdf5_two, "h5py", "hdf5"),
        ("a.tdms", tdms, "nptdms", "tdms"),
    ],
)
def test_a_missing_library_is_asked_for(
    file: str,
    write: Callable[[Path], object],
    module: str,
    extra: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = tmp_path / file
    write(path)
    monkeypatch.setitem(sys.modules, module, None)  # as Python does where it is not installed
    with pytest.raises(BadInput, match=rf"'fmu-fit\[{extra}\]'") as caught:
        read_trace(path, None)
    assert len(str(caught.value).splitlines()) == 1


def test_a_ratio_is_declared_as_one(tmp_path: Path) -> None:
    """S parameters in [sweep]: "1 peak"; a MATLAB field by the path of its structure."""
    two_ports(tmp_path / "a.s2p")
    trace = read_trace(tmp_path / "a.s2p", None, Selection(amplitude="S21"))
    declared = declared_amplitude("1 peak", None, "")
    peaks = to_peak(trace.amplitude, trace.amplitude_unit, declared, "", trace.places)
    np.testing.assert_allclose(peaks, R, rtol=1e-11)
    savemat(tmp_path / "a.mat", {"run": {"f": AXIS_HZ, "H": VALUES}, "n": np.arange(57.0)})
    told = Selection(frequency="run/f (kHz)", amplitude="run/H (mV)")
    trace = read_trace(tmp_path / "a.mat", None, told)
    assert (trace.frequency_unit, trace.amplitude_unit) == ("kHz", "mV")
    np.testing.assert_array_equal(trace.frequency, AXIS_HZ)
    np.testing.assert_allclose(trace.amplitude, R, rtol=1e-15)


def test_every_layout_is_tried_here() -> None:
    here = {layout for layout, *_ in FILES.values()} | {layout for layout, _ in OVER_TIME.values()}
    assert set(LAYOUTS) - here == {"rohde-schwarz", "zurich"}  # of test_instruments


@pytest.mark.parametrize("name", FILES)
def test_a_damaged_file_is_read_or_refused(name: str, tmp_path: Path) -> None:
    """Cut anywhere, or with bytes exchanged: never anything else than columns or one complaint."""
    _, file, write, columns = FILES[name]
    whole = tmp_path / file
    write(whole)
    data = whole.read_bytes()
    draw = np.random.default_rng(7)
    folder = tmp_path / "damaged"
    folder.mkdir()
    for k in range(24):
        damaged = bytearray(data)
        for at in draw.integers(0, min(len(data), 2000), 1 + k % 5):
            damaged[at] = draw.integers(0, 256)
        cut = int(draw.integers(1, len(data))) if k % 3 == 0 else len(data)
        path = folder / file
        path.write_bytes(damaged[:cut])
        told = Selection(**columns)
        said = complaints(partial(recognised, path))
        said += complaints(partial(read_complex, path, None, told))
        assert all(str(path) in line for line in said)


def test_names_of_matlab_end_in_their_unit(tmp_path: Path) -> None:
    """Names there hold no brackets: f_kHz and z_mV are all that can be written."""
    path = tmp_path / "sweep.mat"
    savemat(path, {"f_kHz": 1e-3 * AXIS_HZ, "z_mV": 1e3 * VALUES})
    read = read_complex(path)
    np.testing.assert_allclose(read.u_hz, AXIS_HZ, rtol=1e-12)
    np.testing.assert_allclose(1e-3 * read.y, VALUES, rtol=1e-12)
    assert read.unit == "mV"


def test_a_head_behind_a_percent_sign_names_its_columns_without_it(tmp_path: Path) -> None:
    path = tmp_path / "sweep.txt"
    path.write_text("\n".join(["% f [Hz]\tR [V]", *lines(AXIS_HZ, R, between="\t")]), "utf-8")
    names = [
        (channel.name, channel.unit) for channel in read_recording(path, None, Selection()).channels
    ]
    assert names == [("f", "Hz"), ("R", "V")]


def test_many_columns_are_not_all_listed(tmp_path: Path) -> None:
    path = tmp_path / "wide.csv"
    head = ",".join(f"c{k} (K)" for k in range(1, 161))
    path.write_text("\n".join([head, *[",".join(["0.5"] * 160)] * 12]), "utf-8")
    with pytest.raises(BadInput, match=r"'c12', \.\.\.; wanted") as caught:
        roles_of(path, LineColumns())
    assert len(str(caught.value)) < 500


def test_a_folder_is_not_meant_where_a_file_is_missing(tmp_path: Path) -> None:
    """The folder of results bore the file's name: 'out_sweep.csv' was proposed."""
    (tmp_path / "out_sweep.csv").mkdir()
    with pytest.raises(BadInput, match=r"[^_]sweep\.csv: [^']*$"):
        read_recording(tmp_path / "sweep.csv", None, Selection())
