"""Figures, read back: as SVG by another program's parser, and from what was put on the axes."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Annotation, Text
from matplotlib.transforms import Bbox

from fitting.fit.fit import Status
from fitting.inference.likelihood.knowledge import Adequacy, Determined, Scan
from fitting.measurements.figure import Axis, Form, Layer, Panel, Role
from fitting.measurements.figure import Figure as Described
from fitting.report.figures import reconstruction
from fitting.report.figures import style as plots_style
from fitting.report.figures.fit import draw_convergence, draw_derived
from fitting.report.figures.inference import draw_outputs, draw_profiles
from fitting.report.figures.measurements import draw_measurement
from fitting.report.figures.reconstruction import (
    planned_figures,
    write_figures,
)
from fitting.report.figures.style import AFTER, BLACK, MEASURED, SIMULATED, save, style
from fitting.report.figures.tones import (
    draw_drive,
    draw_improvement,
    draw_over_frequency,
    draw_per_experiment,
)
from fitting.report.shown import ShownCampaign
from fitting.result.result import Result
from fitting.text.estimate import Verdict
from tests.support import plots as plot
from tests.support import report_records as records
from tests.support.plot_records import determined

Draw = Callable[[Result, ShownCampaign], Described]

SVG = "{http://www.w3.org/2000/svg}"
HREF = "{http://www.w3.org/1999/xlink}href"


def draw_spectra(result: Result, data: ShownCampaign) -> Described:
    """What the experiments show of themselves."""
    return draw_measurement(records.spectra(data, result), data)


def draw_response(result: Result, data: ShownCampaign) -> Described:
    """What the sweep shows of itself."""
    return draw_measurement(records.response(data, result), data)


def all_of(result: Result, data: ShownCampaign) -> list[Draw]:
    """Everything that is drawn of a reconstruction."""
    spectra = [draw_spectra] if data.tones else []
    names = {figure.name for figure in planned_figures(result, data).values()}
    draws = reconstruction.DRAWS
    return [*(draws[name] for name in draws if name in names), *spectra, draw_response]


DEVIATIONS = (draw_over_frequency, draw_improvement, draw_per_experiment)
ALL = (draw_drive, draw_spectra, *DEVIATIONS, draw_convergence, draw_derived, draw_response)
#: The paper: bullet, triangle, pentagon, diamond, square.
PAPER_MARKERS = ["o", "^", "p", "D", "s"]


@pytest.fixture(scope="module")
def data() -> ShownCampaign:
    return SHAPES["paper"]


@pytest.fixture(scope="module")
def result() -> Result:
    return RESULTS["paper"]


#: Curves, points with marks of their own, panels.
WRITTEN = ("frequency_response", "deviation_over_frequency", "convergence")


@pytest.fixture(scope="module")
def files(
    result: Result, data: ShownCampaign, tmp_path_factory: pytest.TempPathFactory
) -> list[Described]:
    """Some of them: a file takes a second, and what holds of all drawings is asked of these."""
    shown = records.with_figures(data, result)
    every = planned_figures(result, shown)
    planned = {number: figure for number, figure in every.items() if figure.name in WRITTEN}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reconstruction, "planned_figures", lambda *_: planned)
        folder = tmp_path_factory.mktemp("figures")
        return write_figures(result, shown, folder, formats=("png", "pdf"))


def test_a_figure_is_known_by_its_name_before_it_is_drawn(
    result: Result, data: ShownCampaign
) -> None:
    """Its number rests on that; whoever draws one of them draws no other."""
    coupling = replace(result.derived["lambda"], status=Verdict.DETERMINED)
    derived = {**result.derived, "lambda": coupling}
    known = determined().knowledge
    scans = {
        "theta" if name == "d2" else name: replace(s, path={**s.path, "theta": s.path["d2"]})
        for name, s in known.scans.items()
    }
    moved = replace(result, derived=derived, knowledge=replace(known, scans=scans))
    planned = planned_figures(moved, records.with_figures(data, result))
    assert list(map(int, planned)) == list(range(1, 13))
    for number, figure in planned.items():
        with style():
            drawing = figure.drawing(int(number), len(number))
        assert (drawing.name, drawing.number) == (figure.name, int(number))
        assert drawing.stem.startswith(f"{number}_{figure.name}")


def test_panels_title_and_legend_keep_apart(tmp_path: Path) -> None:
    """A map has a bar beside its panel, a legend many rows, a figure for print a mark as title."""
    x, y = np.repeat([0.0, 1.0, 5.0], 4), np.tile([1.0, 2.0, 4.0, 8.0], 3)
    layer = Layer(Role.MEASURED, Form.MAP, x, y, z=np.arange(12.0) ** 2)
    shown = Panel(x=Axis("gate"), y=Axis("f"), z=Axis("height"), layers=(layer,), title="a map")
    for width in (0.0, 7.0):
        with style(paper_width=width):
            figure = plots_style.new_figure("map", "campaign", synthetic=True, height=6.0)
            axes = list(figure.subplots(3, 2).flat)
            for panel in axes:
                plot.panel(shown, ax=panel)
            lines = [Line2D([], [], label=f"{k}: a line of the legend") for k in range(12)]
            plots_style.legend_below(figure, lines, ncols=2)
            drawing = Described(name="map", title="", caption="", alt="", drawn=figure)
            save(drawing, tmp_path, formats=("png",))
        bars = [m.colorbar.ax for panel in axes for m in panel.collections if m.colorbar]
        boxes = [panel.get_tightbbox() for panel in (*axes, *bars)]
        title = next(t for t in figure.findobj(Text) if t.get_text() == figure.get_suptitle())
        boxes += [title.get_window_extent(), figure.legends[0].get_window_extent()]
        for one, other in itertools.combinations(boxes, 2):
            assert not one.overlaps(other)
        for box in boxes:
            assert 0.0 <= box.x0 < box.x1 <= figure.bbox.x1
            assert 0.0 <= box.y0 < box.y1 <= figure.bbox.y1


KEPT: dict[tuple[Draw, int, int], tuple[Figure, Result, ShownCampaign]] = {}


def drawn(draw: Draw, result: Result, data: ShownCampaign) -> Figure:
    """The figure as drawn, laid out; kept, because that takes a second."""
    key = (draw, id(result), id(data))
    if key not in KEPT:
        with style():
            figure = draw(result, data).drawn
            FigureCanvasAgg(figure)
            plots_style.lay_out(figure)
            figure.draw_without_rendering()
        KEPT[key] = (figure, result, data)  # the records too: an id is theirs while they live
    return KEPT[key][0]


def xs(line: Line2D) -> list[float]:
    return [float(v) for v in np.atleast_1d(np.asarray(line.get_xdata(), dtype=float))]


def ys(line: Line2D) -> list[float]:
    return [float(v) for v in np.atleast_1d(np.asarray(line.get_ydata(), dtype=float))]


def svg_texts(file: Described) -> str:
    """All text of an SVG as a reader sees it."""
    root = etree.parse(str(file.file("svg"))).getroot()
    return " ".join("".join(t.itertext()).strip() for t in root.iter(f"{SVG}text"))


def points(axes: Axes) -> list[Line2D]:
    """Single data points of an axes: lines of one vertex with a marker."""
    lines = [line for line in axes.get_lines() if line.get_marker() not in ("None", "", "_")]
    return [line for line in lines if len(xs(line)) == 1]


def test_a_string_campaign_gets_every_figure_in_both_formats(
    files: list[Described], result: Result, data: ShownCampaign
) -> None:
    planned = planned_figures(result, records.with_figures(data, result))
    assert [f"{number}_{figure.name}" for number, figure in planned.items()] == [
        "01_frequency_response",
        "05_drive",
        "06_spectra",
        "07_deviation_over_frequency",
        "08_improvement",
        "09_deviation_per_experiment",
        "10_convergence",
    ]
    assert tuple(file.name for file in files) == WRITTEN
    for file in files:
        assert file.file("pdf").read_bytes().startswith(b"%PDF")
        assert file.file("png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
        assert etree.parse(str(file.file("svg"))).getroot().tag == f"{SVG}svg"


def test_outputs_are_drawn_over_the_experiments_where_one_that_is_known_moves(
    result: Result, data: ShownCampaign
) -> None:
    """lambda drifts by 1.74 Hz with an error of 2.5 Hz, but is open; D11 stays as it is."""
    assert draw_derived not in all_of(result, data)
    known = replace(result.derived["lambda"], status=Verdict.DETERMINED)
    moved = replace(result, derived={**result.derived, "lambda": known})
    assert draw_derived in all_of(moved, data)
    assert len(drawn(draw_derived, moved, data).axes) == 1
    still = replace(known, spread=0.2)
    assert draw_derived not in all_of(replace(moved, derived={"lambda": still}), data)


def test_each_figure_says_what_it_is(
    files: list[Described], result: Result, data: ShownCampaign
) -> None:
    for file in files:
        texts = svg_texts(file)
        assert file.title in texts
        assert "A string" in texts
    for figure in planned_figures(result, records.with_figures(data, result)).values():
        with style():
            drawing = figure.drawing(1)
        assert len(drawing.caption) > 80
        assert drawing.alt
        assert drawing.alt != drawing.caption


def test_figures_of_a_model_that_fails_print_that_its_numbers_are_no_results(
    result: Result, data: ShownCampaign
) -> None:
    """Nor does one of them print what is determined, or where the values are."""
    failed = Adequacy(chi_square=900.0, freedom=30.0, p_value=0.0, describes=False)
    gone = {n: replace(p, status=Verdict.WITHDRAWN) for n, p in result.parameters.items()}
    bad = replace(
        result,
        status=Status.MISFIT,
        ending=replace(result.ending, kind="not_described", adequacy=failed),
        parameters=gone,
        derived={n: replace(d, status=Verdict.WITHDRAWN) for n, d in result.derived.items()},
    )
    for figure in planned_figures(bad, records.with_figures(data, result)).values():
        with style():
            drawing = figure.drawing(1)
        for words in (drawing.caption, drawing.alt):
            assert words.endswith("are no results: the model does not describe the data.")
            assert "most likely" not in words
            assert "determine" not in words


def test_nothing_in_a_figure_is_fetched(files: list[Described]) -> None:
    for file in files:
        for element in (
            etree.parse(str(file.file("svg"))).getroot().iter(f"{SVG}use", f"{SVG}image")
        ):
            assert element.get(HREF, "#").startswith("#")
        assert b"@import" not in file.file("svg").read_bytes()


@pytest.mark.parametrize(
    ("draw", "synthetic"),
    [
        *((draw, True) for draw in ALL),
        (draw_drive, False),
        *(pytest.param(draw, False, marks=pytest.mark.nightly) for draw in ALL[1:]),
    ],
)
def test_the_synthetic_mark_stands_where_it_is_due(draw: Draw, synthetic: bool) -> None:
    data = records.campaign(synthetic=synthetic)
    figure = draw(records.result_for(data), data).drawn
    marks = [t for t in figure.findobj(Text) if t.get_text() == "SYNTHETIC DATA"]
    assert len(marks) == synthetic


def test_the_synthetic_mark_is_in_the_files(files: list[Described]) -> None:
    assert all("SYNTHETIC DATA" in svg_texts(file) for file in files)


def test_the_same_result_gives_the_same_bytes(
    files: list[Described], result: Result, data: ShownCampaign, tmp_path: Path
) -> None:
    with style():
        again = save(draw_over_frequency(result, data), tmp_path, formats=("png",))
    [file] = [file for file in files if file.name == again.name]
    assert file.file("svg").read_bytes() == again.file("svg").read_bytes()
    assert file.file("png").read_bytes() == again.file("png").read_bytes()


def test_no_unfinished_file_is_left(files: list[Described]) -> None:
    assert set(files[0].folder.iterdir()) == {path for file in files for path in file.files}


def test_svg_holds_a_marker_per_peak_before_and_after(files: list[Described]) -> None:
    file = next(f for f in files if f.name == "deviation_over_frequency")
    root = etree.parse(str(file.file("svg"))).getroot()
    axes = next(g for g in root.iter(f"{SVG}g") if g.get("id") == "axes_1")
    lines = [g for g in axes if (g.get("id") or "").startswith("line2d")]
    assert sum(1 for g in lines for _ in g.iter(f"{SVG}use")) == 2 * 10


@pytest.mark.parametrize("draw", DEVIATIONS)
def test_markers_are_the_paper_s_in_every_figure(
    draw: Draw, result: Result, data: ShownCampaign
) -> None:
    shapes = {line.get_marker() for line in points(drawn(draw, result, data).axes[0])}
    assert shapes == set(PAPER_MARKERS)


def test_marker_shapes_follow_the_experiments(result: Result, data: ShownCampaign) -> None:
    over = drawn(draw_over_frequency, result, data).axes[0]
    by_tone = {round(xs(line)[0]): line.get_marker() for line in points(over)}
    offsets = [(-100, 100), (-80, 80), (-60, 60), (-20, 20), (-10, 10)]  # Hz from 6.94026 MHz
    assert [(by_tone[a], by_tone[b]) for a, b in offsets] == [(m, m) for m in PAPER_MARKERS]
    derived = drawn(draw_derived, result, data).axes[0]
    assert [line.get_marker() for line in points(derived)] == PAPER_MARKERS


def test_deviations_are_drawn_where_they_are(result: Result, data: ShownCampaign) -> None:
    axes = drawn(draw_over_frequency, result, data).axes[0]
    for colour, values in (
        (BLACK, [0.3 + 0.01 * k for k in range(10)]),
        (AFTER, [0.01] * 10),
    ):
        lines = [line for line in points(axes) if line.get_color() == colour]
        assert [ys(line)[0] for line in lines] == pytest.approx(values)
        mean = [
            line
            for line in axes.get_lines()
            if line.get_linestyle() == "--" and line.get_color() == colour
        ]
        assert ys(mean[0])[0] == pytest.approx(np.mean(values))


def test_drift_among_the_tones_is_shaded_and_nothing_else(
    result: Result, data: ShownCampaign
) -> None:
    axes = drawn(draw_over_frequency, result, data).axes[0]
    (shaded,) = axes.patches  # eta_plus; a drifting temperature is no frequency
    extent = shaded.get_extents().transformed(axes.transData.inverted())
    assert (extent.x0, extent.x1) == pytest.approx((-50.0, 50.0))


def test_improvement_is_final_over_initial(result: Result, data: ShownCampaign) -> None:
    axes = drawn(draw_improvement, result, data).axes[0]
    shares = [ys(line)[0] for line in points(axes)]
    assert shares == pytest.approx([1.0 / (0.3 + 0.01 * k) for k in range(10)])


def test_a_peak_moved_by_ten_sigma_stands_out(data: ShownCampaign) -> None:
    sigma = records.SIGMA_V / np.concatenate([e.peaks for e in records.measured(data)])
    errors = 0.8 * sigma * (-1.0) ** np.arange(10)
    errors[5] = 10.0 * sigma[5]  # second tone of the third pair
    bad = records.result_for(data, final=list(errors))
    drawing = draw_per_experiment(bad, data)
    notes = [t.get_text() for t in drawing.drawn.findobj(Annotation)]
    assert notes == ["+10.0"]
    for token in ("+10.0 σ", "6.94032 MHz", "pair3"):
        assert token in drawing.caption
    heights = [abs(ys(line)[0]) for line in points(drawing.drawn.axes[1])]
    assert heights[5] == pytest.approx(10.0)
    assert sorted(heights)[-2] == pytest.approx(0.8)


def test_peaks_without_sigma_are_drawn_without_error_bars() -> None:
    bare = [
        replace(records.experiment(f"p{m}", pair, spectrum=False), sigmas=(np.nan, np.nan))
        for m, pair in enumerate(records.PAIRS_HZ[:2])
    ]
    data = records.campaign(bare)
    result = records.result_for(data)
    drawn(draw_per_experiment, result, data)
    drawn(draw_spectra, result, data)
    assert "not known" in draw_per_experiment(result, data).caption


def test_spectra_have_a_panel_per_pair_before_and_after(
    result: Result, data: ShownCampaign
) -> None:
    figure = drawn(draw_spectra, result, data)
    panels = [axes for axes in figure.axes if axes.get_visible()]
    assert len(panels) == 2 * 5
    assert [axes.get_title().splitlines()[0] for axes in panels[:5]] == [
        f"pair{m}" for m in range(1, 6)
    ]
    trace = panels[0].get_lines()[2]  # after the two drive frequencies
    assert max(ys(trace)) == pytest.approx(
        1e6 * float(np.max(records.lorentzian_v(np.array(records.PAIRS_HZ[0]))))
    )
    assert panels[0].get_title().splitlines()[1] == "+30.0 %, +31.0 %"
    assert panels[5].get_title().splitlines()[1] == "+1.00 %, −1.00 %"


def test_the_drive_beats_with_the_difference_of_the_tones(
    result: Result, data: ShownCampaign
) -> None:
    drawing = draw_drive(result, data)
    titles = [axes.get_title(loc="left") for axes in drawing.drawn.axes]
    numbers = [re.findall(r"[\d.]+", titles[k].partition(":")[2]) for k in (0, 4)]
    assert numbers[0] == ["6.94016", "6.94036", "5", "200"]  # MHz, and ms and Hz of the beats
    assert numbers[1] == ["6.94025", "6.94027", "50", "20"]
    outline = np.asarray(drawing.drawn.axes[4].collections[0].get_paths()[0].vertices)
    assert np.max(outline[:, 1]) == pytest.approx(2.0)
    node = outline[np.abs(outline[:, 0] - 25.0) < 0.1]
    assert np.max(np.abs(node[:, 1])) < 0.02  # half a beat after the crest, in ms


def test_no_small_error_where_the_data_give_none(result: Result, data: ShownCampaign) -> None:
    titles = [axes.get_title(loc="left") for axes in drawn(draw_derived, result, data).axes]
    coupling = next(title for title in titles if "λ" in title)
    assert "unconstrained" in coupling
    assert "±" not in coupling
    assert "599.1\u00a0±\u00a01.9" in next(title for title in titles if "D₁₁" in title)


def test_convergence_has_a_panel_per_quantity_and_the_objective(
    result: Result, data: ShownCampaign
) -> None:
    figure = drawn(draw_convergence, result, data)
    labels = [axes.get_ylabel() for axes in figure.axes if axes.get_visible()]
    assert len(labels) == 2 + 2 + 1  # theta, d1, lambda, D11, J
    assert [axes.get_xticklabels()[0].get_text() for axes in figure.axes[:5]] == ["start"] * 5
    lines = figure.axes[0].get_lines()
    assert len(xs(lines[1])) == 3  # theta's start is far off
    assert any("start: 0 rad" in t.get_text() for t in figure.findobj(Annotation))


def test_convergence_tells_what_its_curves_show(result: Result, data: ShownCampaign) -> None:
    """Where the most likely values are reported, the curves end elsewhere: 93.424576, not 99."""
    likely = replace(result.parameters["d1"], value=99.0)
    with style():
        drawing = draw_convergence(
            replace(result, parameters={**result.parameters, "d1": likely}), data
        )
    assert "d1 = 93.4246 Hz" in drawing.alt
    same = {n: replace(p, algorithm2=p.value) for n, p in result.parameters.items()}
    with style():
        own = draw_convergence(replace(result, parameters=same), data)
    assert "most likely" in drawing.caption  # whose the values of the report are
    assert "most likely" not in own.caption


def with_scan(known: Determined, name: str, scan: Scan) -> Determined:
    scans = {**known.scans, name: scan}
    return replace(known, knowledge=replace(known.knowledge, scans=scans))


def test_what_is_not_drawn_of_profiles_is_said() -> None:
    """A flat profile has no panel, and an output no points where it has no value."""
    known = determined()
    with style():
        assert "(flat" not in draw_profiles(known, "", synthetic=False).caption
        flat = replace(known.scans["d2"], delta_chi2=(0.2,) * 7)
        some = with_scan(known, "d2", flat)
        assert "d2 (flat" in draw_profiles(some, "", synthetic=False).caption
        whole = draw_outputs(known, "", synthetic=False).caption
        path = known.scans["lambda"].path
        gaps = {**path, "lambda": (math.nan, *path["lambda"][1:])}
        missing = with_scan(known, "lambda", replace(known.scans["lambda"], path=gaps))
        caption = draw_outputs(missing, "", synthetic=False).caption
        assert "of lambda" in caption
        assert "of lambda" not in whole


def test_parameters_of_one_unit_share_a_panel_of_corrections(data: ShownCampaign) -> None:
    result = records.result_for(data)
    second = replace(result.parameters["d1"], reference=100.0)
    rows = tuple(
        replace(row, parameters={**row.parameters, "d2": row.parameters["d1"] + 5.0})
        for row in result.history
    )
    both = replace(result, parameters={**result.parameters, "d2": second}, history=rows)
    axes = drawn(draw_convergence, both, data).axes[1]
    ends = {line.get_label(): ys(line)[-1] for line in axes.get_lines()}
    assert ends["d₁"] == pytest.approx(93.424576 - 94.0)
    assert ends["d₂"] == pytest.approx(98.424576 - 100.0)


def test_every_level_has_a_tick_of_its_own(result: Result, data: ShownCampaign) -> None:
    for axes in drawn(draw_convergence, result, data).axes[:5]:
        labels = [text.get_text() for text in axes.get_xticklabels()]
        assert len(set(labels)) == len(labels)
        assert labels.count("start") == 1


def test_the_fit_of_the_response_gives_the_line_back(result: Result, data: ShownCampaign) -> None:
    caption = draw_response(result, data).caption
    words = caption.split("full width = ")[1].replace("\u00a0", " ").split()
    assert abs(float(words[0]) - records.WIDTH_HZ) < 3.0 * float(words[2])


# --- every shape of campaign stays readable -------------------------------------------------


VERY_MANY = "very many, long names"
#: What the paper's, many names and hostile ones do not make more likely to overlap.
FURTHER = (VERY_MANY, "many, long names", "one tone", "three tones")


def shapes() -> Iterator[tuple[str, ShownCampaign]]:
    """Campaigns of other shapes than the paper's."""
    yield "paper", records.campaign()
    one = [records.experiment("only", (6940250.0,))]
    yield "one tone", records.campaign(one, drift_hz={})
    three = [records.experiment(f"t{m}", (6940190.0 + m, 6940240.0, 6940350.0)) for m in range(3)]
    yield "three tones", records.campaign(three, drift_hz={}, unit="m")
    for count, name in ((23, VERY_MANY), (9, "many, long names")):
        many = [
            records.experiment(f"experiment number {m}", (6940160.0 + 2 * m, 6940360.0 - 3 * m))
            for m in range(count)
        ]
        yield name, records.campaign(many, title="A long title, " * 20)
    hostile = [records.experiment("a$b_{<&", pair) for pair in records.PAIRS_HZ[:1]]
    yield "hostile names", records.campaign(hostile, title="50 $ & <b> \\frac{ 漢字")
    yield "sweep only", records.campaign(tones=[])


SHAPES = dict(shapes())
RESULTS = {shape: records.result_for(data) for shape, data in SHAPES.items()}


@pytest.mark.parametrize(
    "shape",
    [
        pytest.param(shape, marks=pytest.mark.nightly) if shape in FURTHER else shape
        for shape in SHAPES
    ],
)
def test_labels_keep_apart_and_inside(shape: str) -> None:
    data = SHAPES[shape]
    result = RESULTS[shape]
    for draw in all_of(result, data):
        figure = drawn(draw, result, data)
        boxes = label_boxes(figure)
        page = figure.bbox
        for words, box in boxes:
            assert page.x0 - 1 <= box.x0, (draw.__name__, words)
            assert box.x1 <= page.x1 + 1, (draw.__name__, words)
            assert page.y0 - 1 <= box.y0, (draw.__name__, words)
            assert box.y1 <= page.y1 + 1, (draw.__name__, words)
        for (one, a), (other, b) in itertools.combinations(boxes, 2):
            wide = min(a.x1, b.x1) - max(a.x0, b.x0)
            high = min(a.y1, b.y1) - max(a.y0, b.y0)
            assert not (wide > 1.5 and high > 1.5), (draw.__name__, one, other)


def label_boxes(figure: Figure) -> list[tuple[str, Bbox]]:
    """Every text that is seen, with its box in pixels; turned labels are left out."""
    hidden: set[int] = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            slack = 1e-9 * (high - low)
            for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
                if not low - slack <= tick.get_loc() <= high + slack:
                    hidden |= {id(tick.label1), id(tick.label2)}
        if not axes.get_visible():
            hidden |= {id(text) for text in axes.findobj(Text)}
    found = []
    for text in figure.findobj(Text):
        seen = text.get_visible() and text.get_text().strip() and id(text) not in hidden
        if seen and text.get_rotation() in (0.0, 90.0):  # boxes of slanted ones say nothing
            with style():
                found.append((text.get_text(), text.get_window_extent()))
    return found


@pytest.mark.parametrize("draw", ALL)
def test_ticks_need_no_offset_to_be_read(draw: Draw, result: Result, data: ShownCampaign) -> None:
    for axes in drawn(draw, result, data).axes:
        for axis in (axes.xaxis, axes.yaxis):
            assert axis.get_offset_text().get_text() == ""
            assert all(len(label.get_text()) <= 8 for label in axis.get_ticklabels())


# Machado, Oliveira and Fernandes (2009), severity 1.0, for linear RGB.
BLINDNESS = {
    "protan": (
        (0.152286, 1.052583, -0.204868),
        (0.114503, 0.786281, 0.099216),
        (-0.003882, -0.048116, 1.051998),
    ),
    "deutan": (
        (0.367322, 0.860646, -0.227968),
        (0.280085, 0.672501, 0.047413),
        (-0.011820, 0.042940, 0.968881),
    ),
    "tritan": (
        (1.255528, -0.076749, -0.178779),
        (-0.078411, 0.930809, 0.147602),
        (0.004733, 0.691367, 0.303900),
    ),
}


@pytest.mark.parametrize("kind", list(BLINDNESS))
@pytest.mark.parametrize("pair", [(MEASURED, SIMULATED), (BLACK, AFTER), SIMULATED + AFTER])
def test_colours_that_are_compared_differ_for_every_eye(
    kind: str, pair: tuple[str, str] | str
) -> None:
    one, other = (pair[:7], pair[7:]) if isinstance(pair, str) else pair
    assert np.linalg.norm(seen_lab(one, kind) - seen_lab(other, kind)) > 25.0  # CIE76; 2 is seen


def seen_lab(colour: str, kind: str) -> np.ndarray:
    """A colour in CIELAB as an eye of that kind sees it (sRGB, D65)."""
    srgb = np.array(to_rgb(colour))
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    linear = np.clip(np.array(BLINDNESS[kind]) @ linear, 0.0, 1.0)
    xyz = (
        np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
        @ linear
        / np.array([0.9505, 1.0, 1.089])
    )
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


def test_vanishing_deviations_get_a_logarithmic_axis(data: ShownCampaign) -> None:
    exact = records.result_for(data, final=[1e-7] * 10)
    axes = drawn(draw_over_frequency, exact, data).axes[0]
    assert axes.get_yscale() == "log"


def test_style_does_not_leak() -> None:
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    with plots_style.style():
        assert mpl.rcParams["svg.fonttype"] == "none"
    assert dict(mpl.rcParams) == before


def test_a_run_stopped_at_once_and_values_that_do_not_exist_are_drawn(data: ShownCampaign) -> None:
    result = records.result_for(data)
    nothing = float("nan")
    absent = replace(
        result.derived["lambda"],
        value=nothing,
        values=(nothing,) * 5,
        spread=nothing,
        std=nothing,
        reference=nothing,
        lower=nothing,
        upper=nothing,
    )
    begun = replace(result.history[0], derived={"lambda": nothing})
    odd = replace(result, derived={"lambda": absent}, history=(begun,))
    for draw in (draw_convergence, draw_derived):
        texts = [t.get_text() for t in drawn(draw, odd, data).findobj(Text)]
        assert any("no value" in text for text in texts)
