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

from fitting.api.jobs import check_style
from fitting.measurements.figure import Axis, Figure, Form, Layer, Panel, Role
from fitting.report.figures.data import figure_csv
from fitting.report.figures.reconstruction import numbered
from fitting.report.figures.style import Planned
from fitting.report.interactive import document, library
from fitting.report.reconstruction import write_report
from fitting.text.errors import BadInput
from tests.support import plots as plot
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
        write_report(result, records.with_figures(data, result), out, interactive=True)
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
        read = set(held(live["doc"]))
        assert in_file <= read
        filled = 0 if "drive" not in path.name else len(read - in_file)  # outlines of envelopes
        assert len(read - in_file) == filled
        tips = [m for m in objects(live["doc"]) if m["name"] == "HoverTool"]
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
    legends = [m["attributes"] for m in objects(live["doc"]) if m["name"] == "Legend"]
    assert {legend["click_policy"] for legend in legends} == {"hide"}
    labels = [item["attributes"]["label"]["value"] for each in legends for item in each["items"]]
    assert "measured" in labels
    assert all(item["attributes"]["renderers"] for each in legends for item in each["items"])


def test_indices_stand_low_without_signs_of_mathematics(page: Any) -> None:
    for figure in page.iter("figure"):
        live = json.loads(unpacked(page, f"live-{figure.get('data-number')}"))
        for model in objects(live["doc"]):
            label = str(model.get("attributes", {}).get("axis_label") or "")
            assert not re.search(r"_[\d+−]", label)


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
    assert held(json.loads(document(canvas))["doc"], ("x", "y", "value")) == expected
    rows = list(csv.DictReader(figure_csv(canvas).splitlines()))
    assert Counter((float(r["x"]), float(r["y"]), float(r["value"])) for r in rows) == expected
    assert {row["colours"] for row in rows} == {"height"}


def test_a_page_leaves_figures_still_rather_than_grow_too_long(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from fitting.report import page as pages

    words = {"title": "", "caption": "", "alt": ""}
    kinds = ("svg", "png", "csv", "pdf")
    place = {"folder": folder / "figures", "number": 5, "digits": 2}
    shown = Figure(name="drive", kinds=kinds, live="{}", **words, **place)  # type: ignore[arg-type]
    assert pages._live([shown])["figures"] == {5: pages.packed("{}")}
    monkeypatch.setattr(pages, "MOST", 1000)
    assert pages._live([shown])["figures"] == {}


def test_a_page_is_static_unless_bokeh_is_asked_for_and_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    check_style("--style", "report")
    with pytest.raises(BadInput, match=r"fmu-fit\[interactive\]"):
        check_style("--style", "interactive")


def test_a_figure_has_one_number_in_every_fit() -> None:
    """With profiles and without, with a corner of nu and without, with moving outputs or not."""
    data = records.campaign()
    result = records.result_for(data)
    always = ("drive", "spectra", "frequency_response", "deviation_per_experiment", "convergence")
    sometimes = ("profiles", "together", "outputs", "nu", "derived_per_experiment")
    measured = ("spectra", "frequency_response")

    def numbers_of(*names: str) -> dict[str, int]:
        planned = [Planned(name=n, draw=lambda: records.response(data, result)) for n in names]
        return {p.name: int(n) for n, p in numbered(planned, result, measured).items()}

    full = numbers_of(*sometimes, *always)
    assert sorted(full.values()) == list(range(1, 11))
    assert full["frequency_response"] == 1
    for left_out in sometimes:
        kept = [name for name in sometimes if name != left_out]
        assert numbers_of(*always, *kept) == {n: k for n, k in full.items() if n != left_out}
    assert numbers_of(*always) == {name: full[name] for name in always}
    alone = replace(result, parameters={"d1": result.parameters["d1"]}, derived={})
    [(number, _)] = numbered([Planned(name="convergence", draw=list)], alone, ()).items()  # type: ignore[arg-type]
    assert int(number) == 2  # after profiles
