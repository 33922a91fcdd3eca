"""Figures to zoom, read off and toggle: their numbers are the CSV's, and the page is one file."""

from __future__ import annotations

import base64
import csv
import gzip
import io
import json
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import html
from matplotlib.figure import Figure as Canvas

from fitting.measurements.figure import Axis, Form, Layer, Panel, Role
from fitting.report import plot
from fitting.report import table as tables
from fitting.report.figures.data import bare, figure_csv
from fitting.report.figures.file import FigureFile
from fitting.report.figures.numbers import numbered
from fitting.report.figures.style import Drawing
from fitting.report.interactive.document import interactive, library
from fitting.report.interactive.looks import MARKERS
from fitting.report.reconstruction import write_report
from fitting.text.notation import mathtext
from tests.support import report_records as records

#: Bytes that a page has at most: mail programs and browsers take it.
MOST = 5_000_000


SMALL = {
    "svg": b'<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"/>',
    "png": b"\x89PNG\r\n\x1a\n",
    "pdf": b"%PDF-1.4",
}


def written_small(_: Canvas, file: io.BytesIO, **options: Any) -> None:
    """Where a picture takes half a second."""
    file.write(SMALL[options["format"]])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of a series of two pairs, whose labels are no friends of anything."""
    pairs = zip(("$$pair_1$$", "</script>"), records.PAIRS_HZ[:2], strict=True)
    data = records.campaign([records.experiment(label, pair) for label, pair in pairs])
    result = records.result_for(data)
    out = tmp_path_factory.mktemp("report")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Canvas, "savefig", written_small)  # pictures are looked at elsewhere
        write_report(result, records.with_figures(data, result), out)
    return out


@pytest.fixture(scope="module")
def page(folder: Path) -> Any:
    return html.document_fromstring((folder / "report.html").read_bytes())


def unpacked(page: Any, name: str) -> str:
    return gzip.decompress(base64.b64decode(page.get_element_by_id(name).text)).decode()


def objects(plain: Any) -> Iterator[dict[str, Any]]:
    """Every model of a document, wherever it stands."""
    if isinstance(plain, dict):
        if plain.get("type") == "object":
            yield plain
        for value in plain.values():
            yield from objects(value)
    elif isinstance(plain, list):
        for value in plain:
            yield from objects(value)


def held(document: Any, keys: tuple[str, ...] = ("x", "y")) -> Counter[tuple[float, ...]]:
    """Points that a document reads off, however many models hold each."""
    found: Counter[tuple[float, ...]] = Counter()
    for model in objects(document):
        if model["name"] == "ColumnDataSource":
            data = dict(model["attributes"]["data"]["entries"])
            if set(keys) <= set(data):
                found.update(zip(*(map(float, data[key]) for key in keys), strict=True))
            elif "xs" in data:
                for x, y in zip(data["xs"], data["ys"], strict=True):
                    found.update(zip(map(float, x), map(float, y), strict=True))
    return found


def test_what_is_read_off_is_what_the_file_holds(page: Any, folder: Path) -> None:
    count = 0
    for figure in page.iter("figure"):
        live = json.loads(unpacked(page, f"live-{figure.get('data-number')}"))
        number = int(figure.get("data-number"))
        [path] = (folder / "figures").glob(f"{number:02d}_*.csv")
        rows = list(csv.DictReader(path.read_text("utf-8").splitlines()))
        in_file = {(float(row["x"]), float(row["y"])) for row in rows}
        read = set(held(live["document"]))
        assert in_file <= read
        filled = 0 if "drive" not in path.name else len(read - in_file)  # outlines of envelopes
        assert len(read - in_file) == filled
        tips = [m for m in objects(live["document"]) if m["name"] == "HoverTool"]
        said = {tip[0] for tool in tips for tip in tool["attributes"]["tooltips"]}
        assert {row["along x"] for row in rows if row["series"]} <= said
        count += 1
    assert count == 7


def test_the_page_is_one_file_that_asks_for_nothing_and_works_without_scripts(
    page: Any, folder: Path
) -> None:
    assert (folder / "report.html").stat().st_size < MOST
    for element in page.iter():
        for name in ("src", "href", "srcset", "data", "action"):
            target = element.get(name) if isinstance(element.tag, str) else None
            assert target is None or target.startswith(("data:", "#", "figures/")), target
            assert name == "href" or not (target or "").startswith("figures/")
    for script in page.iter("script"):
        packed = script.get("type") == "text/plain"
        assert packed or script.get("type") is None
        assert not packed or re.fullmatch(r"[A-Za-z0-9+/=]+", script.text)
    assert unpacked(page, "bokeh") == library()
    for figure in page.iter("figure"):
        assert figure.find("img").get("src").startswith("data:image/")
        assert figure.get("data-mark") == "SYNTHETIC DATA"
    [style] = page.iter("style")
    assert ".is-live > img { display: block; }" in style.text.partition("@media print")[2]


def test_no_name_is_set_by_a_library_that_would_be_fetched(page: Any) -> None:
    """BokehJS loads MathJax from afar for texts in dollar signs or brackets with backslashes."""
    for figure in page.iter("figure"):
        text = unpacked(page, f"live-{figure.get('data-number')}")
        for sign in ("$$", r"\\(", r"\\["):
            assert sign not in text


def test_legends_switch_what_they_name(page: Any) -> None:
    live = json.loads(unpacked(page, "live-1"))
    labels = [entry["label"] for entry in live["legend"] if entry["switches"]]
    assert "laboratory" in labels
    tags: dict[int, set[str]] = {}
    for model in objects(live["document"]):
        for tag in model.get("attributes", {}).get("tags", []):
            tags.setdefault(tag, set()).add(model["attributes"].get("name") or "")
    for number, entry in enumerate(live["legend"]):
        assert entry["switches"] == (number in tags)
        assert tags[number] <= {entry["label"], ""}


def test_legends_show_the_markers_and_lines_that_are_drawn(page: Any) -> None:
    """The shape of every marker is known to the page; whole lines are no dashes."""
    script = (tables.TEMPLATES / "interactive.js").read_text("utf-8")
    shapes = script.partition("const SHAPES = {")[2].partition("};")[0]
    known = set(re.findall(r"(\w+): \"<", shapes))
    assert set(MARKERS.values()) <= known
    spectra = json.loads(unpacked(page, "live-6"))["legend"]
    looks = {entry["label"]: (entry["marker"], entry["dash"]) for entry in spectra}
    assert looks["difference"] == ("", "solid")
    assert looks["simulated × χ"] == ("circle", "dashed")
    [bars] = [look for label, look in looks.items() if "±" in label]
    assert bars == ("bar", "")


def test_indices_stand_low_without_signs_of_mathematics(page: Any) -> None:
    assert bare("$\\eta_{\\mathrm{+}}$ − 2 (Hz)".replace("\\eta", "η")) == "η₊ − 2 (Hz)"
    assert bare(mathtext("D11")) == "D₁₁"
    assert bare(r"$J_{\mathrm{fit}}$") == "J_fit"
    for figure in page.iter("figure"):
        live = json.loads(unpacked(page, f"live-{figure.get('data-number')}"))
        for model in objects(live["document"]):
            label = str(model.get("attributes", {}).get("axis_label") or "")
            assert not re.search(r"_[\d+−]", label)


def test_markers_on_the_lower_edge_are_whole() -> None:
    """Bokeh cuts at the frame what matplotlib draws beyond it."""
    for cut, low in ((True, 0.0), (False, -0.02)):
        canvas = Canvas(layout="constrained")
        axes = canvas.subplots()
        axes.plot([1.0, 2.0], [0.0, 1.0], "o", clip_on=cut)
        axes.set_ylim(0.0, 1.0)
        canvas.draw_without_rendering()
        ranges = [
            m.get("attributes", {})
            for m in objects(interactive(canvas)["document"])
            if m["name"] == "Range1d"
        ]
        assert low in [found.get("start", 0.0) for found in ranges]


def test_a_map_is_read_off_in_its_own_values() -> None:
    """Places that are not even: a cell's middle is not where its value was taken."""
    x, y = np.repeat([0.0, 1.0, 5.0], 4), np.tile([1.0, 2.0, 4.0, 8.0], 3)
    z = np.arange(12.0) ** 2
    layer = Layer(Role.MEASURED, Form.MAP, x, y, z=z)
    shown = Panel(x=Axis("gate"), y=Axis("f"), z=Axis("height"), layers=(layer,))
    canvas = Canvas(layout="constrained")
    plot.panel(shown, ax=canvas.subplots())
    canvas.draw_without_rendering()
    expected = Counter(zip(x.tolist(), y.tolist(), z.tolist(), strict=True))
    assert held(interactive(canvas)["document"], ("x", "y", "value")) == expected
    rows = list(csv.DictReader(figure_csv(canvas).splitlines()))
    assert Counter((float(r["x"]), float(r["y"]), float(r["value"])) for r in rows) == expected
    assert {row["colours"] for row in rows} == {"height"}


def test_a_page_leaves_figures_still_rather_than_grow_too_long(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from fitting.report import page as pages

    picture = folder / "figures" / "05_drive.svg"
    shown = FigureFile(
        name="05_drive",
        kind="drive",
        number=5,
        title="",
        caption="",
        alt="",
        svg=picture,
        png=picture,
        live="{}",
    )
    made = pages._picture(shown)
    assert pages._live([made])["figures"] == {5: made.live}
    monkeypatch.setattr(pages, "MOST", 1000)
    assert pages._live([made])["figures"] == {}


def test_a_figure_has_one_number_in_every_fit() -> None:
    """With profiles and without, with a corner of nu and without, with moving outputs or not."""
    data = records.campaign()
    result = records.result_for(data)
    always = ("drive", "spectra", "frequency_response", "deviation_per_experiment", "convergence")
    sometimes = ("profiles", "together", "outputs", "nu", "derived_per_experiment")
    measured = ("spectra", "frequency_response")

    def numbers_of(*names: str) -> dict[str, int]:
        drawn = [
            Drawing(name=name, title="", caption="", alt="", figure=Canvas()) for name in names
        ]
        return {d.name: d.number for d in numbered(drawn, result, measured)}

    full = numbers_of(*sometimes, *always)
    assert sorted(full.values()) == list(range(1, 11))
    assert full["frequency_response"] == 1
    for left_out in sometimes:
        kept = [name for name in sometimes if name != left_out]
        assert numbers_of(*always, *kept) == {n: k for n, k in full.items() if n != left_out}
    assert numbers_of(*always) == {name: full[name] for name in always}
    alone = replace(result, parameters={"d1": result.parameters["d1"]}, derived={})
    drawn = [Drawing(name="convergence", title="", caption="", alt="", figure=Canvas())]
    assert [d.number for d in numbered(drawn, alone, ())] == [2]  # after profiles
