"""The corner figure: every value of a posterior alone, and each two against each other."""

from __future__ import annotations

from pathlib import Path

from matplotlib.lines import Line2D

from fitting.inference.posterior.summary import PosteriorSummary
from fitting.report.figures.file import FigureFile
from fitting.report.figures.style import Drawing, legend_below, new_figure, save, style
from fitting.report.plot.axes import BLUE, GREEN, ORANGE, RED
from fitting.report.plot.posterior import alone, marked, together
from fitting.text.arrays import FloatArray
from fitting.text.notation import listed, mathtext, scaling_for

#: Values that are drawn at most: more panels than these tell nothing any more.
MOST = 7


def save_figure(found: PosteriorSummary, draws: FloatArray, folder: Path) -> FigureFile:
    """Draw and write the figure.

    Args:
        found: What the draws say.
        draws: (k, n) in the parameters' units.
        folder: Where the files go.
    """
    with style():
        return save(draw(found, draws), folder)


def draw(found: PosteriorSummary, draws: FloatArray) -> Drawing:
    """The corner figure.

    Args:
        found: What the draws say.
        draws: (k, n) in the parameters' units.
    """
    names = list(found.values)
    shared = [name for name in names if found.values[name].shared]
    shown = (shared or names)[:MOST]
    columns = [draws[:, names.index(name)] for name in shown]
    scalings = [
        scaling_for(c.tolist(), found.values[n].unit) for n, c in zip(shown, columns, strict=True)
    ]
    count = len(shown)
    title = "Draws from the posterior"
    figure = new_figure(
        title, found.title, synthetic=found.synthetic, height=1.2 + max(1.6, 6.4 / count) * count
    )
    grid = figure.subplots(count, count, squeeze=False)
    for i in range(count):
        for k in range(count):
            axes = grid[i][k]
            if k > i:
                axes.set_visible(False)
                continue
            if k == i:
                alone(axes, columns[i], scalings[i], found.values[shown[i]].interval95)
            else:
                together(axes, columns[k], columns[i], (scalings[k], scalings[i]))
            which = (k,) if k == i else (k, i)
            for kind, place in _places(found):
                marked(axes, [scalings[j](place[shown[j]]) for j in which], kind=kind)
            axes.set_xlabel(scalings[k].label(mathtext(shown[k])) if i == count - 1 else "")
            axes.set_ylabel(scalings[i].label(mathtext(shown[i])) if k == 0 < i else "")
            axes.tick_params(labelbottom=i == count - 1, labelleft=k == 0 < i)
    legend_below(figure, _handles(found), ncols=4)
    caption = _caption(found, shown)
    return Drawing(
        name="corner", number=1, title=title, caption=caption, alt=caption, figure=figure
    )


def _places(found: PosteriorSummary) -> list[tuple[str, dict[str, float]]]:
    """Kind and values of what is marked, what matters most last."""
    first, *others = found.modes
    truth = {name: v.truth for name, v in found.values.items()}
    return [
        *(("other", dict(m.parameters)) for m in others),
        ("fit", dict(first.parameters)),
        ("truth", truth),
    ]


def _handles(found: PosteriorSummary) -> list[Line2D]:
    made = [
        Line2D([], [], color=BLUE, lw=0.9, label="outlines of 68 % and 95 % of the draws"),
        Line2D([], [], ls="none", marker="*", color=RED, label="most likely minimum"),
    ]
    if len(found.modes) > 1:
        made.append(Line2D([], [], ls="none", marker="D", color=ORANGE, label="other minima"))
    if any(v.truth == v.truth for v in found.values.values()):
        made.append(Line2D([], [], ls="none", marker="P", color=GREEN, label="truth"))
    return made


def _caption(found: PosteriorSummary, shown: list[str]) -> str:
    told = (
        "On the diagonal how often each value was drawn, the 95 % interval grey; below it each two "
        "values against each other."
    )
    rest = [name for name in found.values if name not in shown]
    if rest:
        told += f" Not drawn: {listed(rest)}, which draws.csv holds."
    if found.status != "converged":
        told += " The draws have not converged: what is seen here is not yet the posterior."
    return told
