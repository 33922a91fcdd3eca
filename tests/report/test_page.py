"""The report, parsed as a browser would: self-contained, complete, and true to the record."""

from __future__ import annotations

import base64
import itertools
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from lxml import etree, html

from fitting.fit.fit import Status
from fitting.measurements.figure import Figure
from fitting.report import reconstruction as report
from fitting.report import table as tables
from fitting.report.page import render
from fitting.report.reconstruction import page_of, write_report
from fitting.report.screen import phrase
from fitting.report.shown import ShownCampaign
from fitting.report.summary import summary_of
from fitting.report.table import table as table_of
from fitting.result.result import Result
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind
from tests.support import plot_records
from tests.support import report_records as records

SVG = '<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"><title>{}</title></svg>'
NAMES = (
    "1_frequency_response",
    "5_drive",
    "6_spectra",
    "7_of_somebody_else",
    "8_deviation_over_frequency",
    "9_improvement",
    "10_deviation_per_experiment",
    "11_convergence",
    "13_derived_per_experiment",
)


@pytest.fixture(scope="module")
def data() -> ShownCampaign:
    return records.campaign()


@pytest.fixture(scope="module")
def result(data: ShownCampaign) -> Result:
    return records.result_for(data)


@pytest.fixture(scope="module")
def figures(tmp_path_factory: pytest.TempPathFactory) -> list[Figure]:
    """Tiny drawings that carry their names."""
    folder = tmp_path_factory.mktemp("tiny")
    made = []
    for name in NAMES:
        number, _, kind = name.partition("_")
        (folder / f"{name}.svg").write_text(SVG.format(name))
        (folder / f"{name}.png").write_bytes(b"PNG" * 1000)
        made.append(
            Figure(
                name=kind,
                number=int(number),
                title=f"Title of {name}",
                caption=f"Caption of {name}.",
                alt=f"Alt {name}",
                folder=folder,
                kinds=("svg", "png"),
            )
        )
    return made


@pytest.fixture(scope="module")
def page(result: Result, data: ShownCampaign, figures: list[Figure]) -> Any:
    return html.document_fromstring(page_of(result, data, figures))


#: Caption of a table.
DEVIATIONS = "Mean relative deviation"


def table(page: Any, caption: str) -> list[list[Any]]:
    """Cells of the body of the table with that caption."""
    for found in page.iter("table"):
        if found.findtext("caption") == caption:
            return [list(row) for row in found.find("tbody")]
    raise AssertionError(f"no table {caption!r}")


def exact(cell: Any) -> float:
    """The number behind a cell."""
    return float(cell.find("data").get("value"))


def words(page: Any) -> str:
    return re.sub(r"\s+", " ", page.text_content())


def test_nothing_is_fetched_from_anywhere(page: Any) -> None:
    for element in page.iter():
        for name in ("src", "href", "srcset", "data", "action", "xlink:href"):
            target = element.get(name) if isinstance(element.tag, str) else None
            assert target is None or target.startswith(("data:", "#")), target
    assert not list(page.iter("script", "link", "iframe", "object"))  # no figure here is live
    styles = " ".join(style.text for style in page.iter("style"))
    assert "url(" not in styles
    assert "@import" not in styles


def test_links_within_the_page_lead_somewhere(page: Any) -> None:
    ids = [element.get("id") for element in page.iter() if element.get("id")]
    assert len(ids) == len(set(ids))
    targets = [a.get("href") for a in page.iter("a")]
    assert {t[1:] for t in targets if t.startswith("#")} <= set(ids)
    labels = [e.get("aria-labelledby") for e in page.iter() if e.get("aria-labelledby")]
    assert set(labels) <= set(ids)


def test_a_page_without_an_answer_begins_with_its_contents() -> None:
    known = plot_records.determined()
    page = html.document_fromstring(
        render(
            "identification.html.j2",
            title="A string",
            kind="what the data determine",
            status="identified",
            message="",
            flat="",
            known=known,
            part=None,
            origin={"seed": "1"},
            words={},
        )
    )
    targets = [a.get("href")[1:] for a in page.find(".//nav").iter("a")]
    assert targets == [h.get("id") for h in page.iter("h2")] == ["knowledge", "provenance"]


def test_the_answer_the_figure_and_the_warnings_come_first_and_the_rest_is_folded(
    page: Any,
) -> None:
    main = page.find(".//main")
    first = [child.get("id") or child.tag for child in main][:3]
    assert first == ["answer", "figure-1", "warnings"]
    assert main.find("figure/img").get("alt") == "Alt 1_frequency_response"
    told = [dt.text_content() for dt in main.iter("dt")]
    assert told == ["Values", "Unconstrained", "Next"]
    shown = [s.text_content().replace("\u00a0", " ") for s in main.find_class("value")]
    assert any("93.42 ± 0.24 Hz" in text for text in shown)
    folded = [found.find("summary/h2").text_content() for found in main.iter("details")]
    assert "Provenance" in folded
    assert "Values" not in folded
    assert not [d for d in main.iter("details") if d.get("open") is not None]
    [style] = page.iter("style")
    assert "prefers-color-scheme: dark" in style.text
    assert "::details-content" in style.text.partition("@media print")[2]


def test_every_figure_is_embedded_once_with_caption_and_words_for_the_blind(page: Any) -> None:
    names = []
    for figure in page.iter("figure"):
        image = figure.find("img")
        kind, _, data = image.get("src").partition(",")
        assert kind == "data:image/svg+xml;base64"
        name = etree.fromstring(base64.b64decode(data)).findtext(
            "{http://www.w3.org/2000/svg}title"
        )
        names.append(name)
        number = name.partition("_")[0]
        assert figure.get("id") == f"figure-{number}"
        assert image.get("alt") == f"Alt {name}"
        assert figure.find("figcaption").text_content() == (
            f"Figure {number}. Title of {name}. Caption of {name}."
        )
    assert tuple(names) == NAMES  # in the order of their numbers


def test_the_page_is_built_for_everybody(page: Any) -> None:
    assert page.get("lang") == "en"
    assert len(list(page.iter("h1"))) == 1
    levels = [int(e.tag[1]) for e in page.iter("h1", "h2", "h3", "h4")]
    assert all(after - before <= 1 for before, after in itertools.pairwise(levels))
    for found in page.iter("table"):
        assert found.find("caption") is not None
        heads = found.findall("thead/tr/th")
        assert heads
        assert all(head.get("scope") == "col" for head in heads)
        for row in found.findall("tbody/tr"):
            assert len(row) == len(heads)
    assert page.find(".//main") is not None


def test_parameters_stand_as_they_are_in_the_record(page: Any, result: Result) -> None:
    rows = table(page, "Fitted parameters")
    for cells, parameter in zip(rows, result.parameters.values(), strict=True):
        found = [exact(cells[k]) for k in (3, 5, 6, 8)]
        assert found == [
            parameter.std,
            parameter.reference,
            parameter.start,
            parameter.algorithm2,
        ]
        assert cells[2].text_content() == parameter.unit
        assert cells[9].text_content() == parameter.status
        if not parameter.status.has_value:
            assert cells[1].text_content() == "–"
            continue
        assert exact(cells[1]) == parameter.value
        shown = float(cells[1].text_content().replace("−", "-"))
        assert shown == pytest.approx(parameter.value, abs=0.05 * parameter.std)
    assert [cells[0].text_content() for cells in rows] == ["θ", "d₁"]
    assert rows[1][4].text_content() == "92.950 to 93.890"


def test_derived_values_stand_per_experiment(page: Any, result: Result) -> None:
    rows = table(page, "Derived outputs per experiment")
    coupling = [exact(cells[1]) for cells in rows]
    expected = result.derived["lambda"]
    assert coupling == [*expected.values, expected.value, expected.spread]


def test_outputs_of_each_experiment_say_at_which_point_they_are_taken(
    result: Result, data: ShownCampaign
) -> None:
    """Two points are reported, and neither tells to nine digits what is open."""

    def note(found: Result) -> str:
        point = phrase("values", "point", found)
        return table_of("per_experiment", result=found, data=data, point=point).note

    papers = {n: replace(d, most_likely=d.value + 1.0) for n, d in result.derived.items()}
    for found, point in (
        (result, "most likely"),
        (replace(result, status=Status.INTERRUPTED), "interrupted"),
        (replace(result, derived=papers), "Algorithm 2"),
    ):
        assert point in note(found)
        assert "lambda" in note(found)


def test_no_error_is_given_for_what_the_data_do_not_determine(page: Any) -> None:
    cells = table(page, "Derived outputs")[0]
    assert cells[4].text_content() == "–"
    assert cells[5].text_content() == "–"
    assert cells[9].text_content() == "unconstrained"
    said = words(page).replace("\u00a0", " ")
    assert "63.3–781 kHz (all that the model allows)" in said
    assert "D₁₁ 599.1 ± 1.9 1/s" in said


def test_every_peak_is_listed(page: Any, result: Result) -> None:
    rows = table(page, "Peaks: measured and simulated amplitudes, relative deviations")
    assert len(rows) == 10
    for cells, peak, before in zip(
        rows, result.peaks, result.deviations.initial.per_peak, strict=True
    ):
        numbers = [exact(cell) for cell in cells[1:]]
        assert numbers[:5] == [
            peak.frequency_hz,
            peak.measured_v,
            peak.sigma_v,
            peak.initial_v,
            peak.final_v,
        ]
        assert numbers[5] == before
        assert numbers[8] == pytest.approx((peak.final_v - peak.measured_v) / peak.sigma_v)
    assert rows[0][1].text_content() == "6.94016"


def test_mean_deviations_per_experiment(page: Any) -> None:
    rows = table(page, DEVIATIONS)
    assert [row[0].text_content() for row in rows] == [*(f"pair{m}" for m in range(1, 6)), "all"]
    assert [exact(row[1]) for row in rows[:5]] == pytest.approx([0.305, 0.325, 0.345, 0.365, 0.385])
    assert exact(rows[5][1]) == pytest.approx(0.345)
    assert exact(rows[5][3]) == pytest.approx(100.0 * 0.01 / 0.345)


def test_history_alternatives_and_minima_are_complete(page: Any, result: Result) -> None:
    levels = table(page, "Algorithm 2: levels of the regularisation")
    assert [row[0].text_content() for row in levels] == ["start", "0", "1", "2"]
    assert [exact(row[2]) for row in levels] == [r.parameters["theta"] for r in result.history]
    verdicts = [row[-1].text_content() for row in table(page, "Discrete alternatives")]
    assert verdicts[0] == "reported"
    assert verdicts[1].startswith("equal ")
    starts = table(page, "Minima of the search")
    assert len(starts) == 2
    assert [exact(row[4]) for row in starts] == [4.2] * 2  # what decides: chi square


def test_the_cost_counts_profiles_where_their_time_is_in_it(
    result: Result, data: ShownCampaign
) -> None:
    known = plot_records.determined().knowledge
    effort = replace(known.effort, evaluations=4903, fmu_runs=32712)
    profiled = replace(result, seconds=34.44, knowledge=replace(known, effort=effort))
    for found, counted, timed in (
        (profiled, ["4903", "32712"], True),
        (replace(profiled, knowledge=None), [], False),
    ):
        shown = html.document_fromstring(page_of(found, data, []))
        [cost] = [row for row in table(shown, "Campaign") if row[0].text_content() == "cost"]
        told, _, time = cost[1].text_content().replace("\u00a0", " ").rpartition("; ")
        assert re.findall(r"\b\d+\b", told)[-2:] == counted or not timed
        assert ("32712" in told, "profiles" in time) == (timed, timed)
        assert time.startswith("34.4 s ")


def test_the_sweep_is_compared_with_the_instrument(page: Any) -> None:
    rows = table(page, "Resonance fitted to the sweep alone, without the FMU")
    assert exact(rows[0][3]) == pytest.approx(1.5)  # Hz: 6940261.5 - 6940260
    assert rows[2][4].text_content() == "−5.191 %"  # 70000/73832.6 - 1


def test_warnings_plan_notes_and_provenance_are_told(page: Any, result: Result) -> None:
    box = page.find(".//section[@class='warnings']")
    assert [item.text_content() for item in box.iter("li")] == [*summary_of(result).warnings]
    said = words(page)
    for sentence in (
        *result.provenance.plan,
        "A note of the binding.",
        result.message,
        "f" * 64,
        "a" * 64,
        "{guid-of-fmu}",
        "fmu-fit reconstruct campaign.toml",
        "9.9.9",
        "120 evaluations",
        "arXiv:2412.07301",
    ):
        assert sentence in said


@pytest.mark.parametrize("synthetic", [True, False])
def test_synthetic_data_are_called_so(synthetic: bool, figures: list[Figure]) -> None:
    data = records.campaign(synthetic=synthetic)
    page = html.document_fromstring(page_of(records.result_for(data), data, figures))
    assert bool(page.find_class("synthetic")) is synthetic
    assert ("synthetic" in page.findtext(".//title")) is synthetic


def test_a_bad_end_is_seen(result: Result, data: ShownCampaign, figures: list[Figure]) -> None:
    message = "The last level stalled."
    ended = replace(result, status=Status.NOT_CONVERGED, message=message, findings=())
    page = html.document_fromstring(page_of(ended, data, figures))
    box = page.get_element_by_id("status")
    assert box.get("class") == "status bad"
    assert box.text_content().startswith(ended.status.capitalize())
    assert ended.message in box.text_content()
    assert page.find(".//section[@class='warnings']") is None


def test_names_from_outside_cannot_become_markup(figures: list[Figure]) -> None:
    evil = "<script>alert(1)</script>&\"'"
    data = records.campaign(
        [records.experiment(evil, pair) for pair in records.PAIRS_HZ[:1]], title=evil
    )
    result = records.result_for(data)
    named = {evil: replace(result.parameters["theta"], unit="<i>Hz</i>")}
    rows = tuple(replace(row, parameters={evil: 1.0}) for row in result.history)
    hostile = replace(
        result,
        parameters=named,
        history=rows,
        message=evil,
        findings=(
            Finding(kind=Kind.file_remark, severity="warning", subject="", names={"text": (evil,)}),
        ),
        alternatives=(),
        correlation=((1.0,),),
    )
    text = page_of(hostile, data, [replace(f, alt=evil, caption=evil) for f in figures])
    page = html.document_fromstring(text)
    assert not list(page.iter("script"))
    assert page.findtext(".//h1") == evil
    assert next(iter(page.iter("img"))).get("alt") == evil
    assert "<i>Hz" not in text


def test_a_sweep_alone_has_no_tables_of_peaks(figures: list[Figure]) -> None:
    data = records.campaign(tones=[])
    result = replace(records.result_for(data), correlation=())
    page = html.document_fromstring(page_of(result, data, figures[7:8]))
    captions = [t.findtext("caption") for t in page.iter("table")]
    assert "Fitted parameters" in captions
    assert not [c for c in captions if "Peaks" in c or "per experiment" in c]
    [deviations] = table(page, DEVIATIONS)
    assert deviations[0].text_content() == "curve"


@dataclass(frozen=True)
class Written:
    """A report that one process wrote; tests share the folder, so nothing is written there."""

    result: Result
    data: ShownCampaign
    folder: Path
    path: Path


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """Of a sweep alone: two figures."""
    data = records.campaign(tones=[])
    result = records.result_for(data)
    data = records.with_figures(data, result)
    folder = tmp_path_factory.mktemp("written")
    return Written(result, data, folder, write_report(result, data, folder, formats=("pdf",)))


def test_the_file_is_written_whole_with_real_figures(written: Written) -> None:
    folder = written.folder
    assert written.path == folder / "report.html"
    page = html.fromstring(written.path.read_bytes())
    assert len(list(page.iter("img"))) == 2
    names = {"report.html", "figures", "values.csv", "values.tex"}
    assert {p.name for p in folder.iterdir()} == names
    links = page.xpath("//figcaption//a")
    stems = ("1_frequency_response", "5_convergence")
    kinds = ("csv", "pdf", "svg")
    assert [a.get("download") for a in links] == [f"{s}.{k}" for s in stems for k in kinds]
    for a in links:
        file = folder / "figures" / a.get("download")
        kind, _, text = a.get("href").partition(",")
        if file.suffix == ".csv":
            assert kind == "data:text/csv;charset=utf-8;base64"
            assert base64.b64decode(text) == file.read_bytes()
        else:
            assert folder / a.get("href") == file
            assert file.read_bytes().startswith((b"%PDF", b"<?xml"))
    assert "2, 3 and 4 " in page.text_content()  # are not drawn here


def test_a_folder_in_the_way_is_bad_input_and_leaves_nothing(
    result: Result,
    data: ShownCampaign,
    figures: list[Figure],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(report, "write_figures", lambda *_, **__: figures)
    (tmp_path / "report.html").mkdir()
    with pytest.raises(BadInput, match=r"report\.html"):
        write_report(result, data, tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"report.html", "values.csv", "values.tex"}


def test_the_template_travels_with_the_package() -> None:
    assert (tables.TEMPLATES / "report.html.j2").is_file()
    assert tables.TEMPLATES.parent == Path(tables.__file__).parent
