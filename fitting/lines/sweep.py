"""The line of a sweep: every model that may describe it, the one that does, and its errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.lines.choice import (
    PLAINLY,
    PRESENT_P,
    SIMPLER,
    chance,
    criteria_of,
    order_of,
    with_rivals,
)
from fitting.lines.form import (
    AMPLITUDE_FORMS,
    COMPLEX_FORMS,
    Form,
    LineFit,
    fit_form,
)
from fitting.lines.names import MIN_SWEEP_POINTS, SQUARED
from fitting.lines.null import Null, NullKind, beyond_ends, null_models
from fitting.lines.record import TriedForm, no_line
from fitting.lines.several import (
    TwoLines,
    TwoResonances,
    as_two,
    not_by_chance,
    shows_all,
    two_line_fits,
    with_one_more,
)
from fitting.lines.starts import (
    Start,
    amplitude_starts,
    bent_starts,
    complex_starts,
    squares_of,
)
from fitting.lines.sweep_model import SQUARE, Place
from fitting.signal.misfit import Misfit, correlation
from fitting.signal.residual_tests import SMALLEST_RESIDUAL, TOGETHER
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import hertz, number, with_error

#: Line widths that a sweep spans at least for a delay to differ from the phase of the line itself.
WIDTHS_FOR_DELAY = 3.0
#: Points at an end of which one is the largest where the end cuts off a line.
AT_END = 3
#: Standard errors that a line is high at least.
HIGH = 5.0
#: Height of a second line over that of the first one up to which the first is the one meant.
WEAK = 0.3
#: Lines beyond the last one that gains, up to which more are looked for.
AHEAD = 2
#: Widths, and logarithm of a factor on the width, by which a line beyond the points may be off the
#: place where it is observed, or supposed.
OBSERVED, SUPPOSED = 1.0, 3.0
#: Error over the width of a line from which its numbers are not printed.
UNRESOLVED = 0.5
#: Least range of weights of noise that grows with the amplitude, rounds of its fit, and least share
#: of a variance.
LEAST_UNEQUAL, ROUNDS, LEAST_VARIANCE = 0.5, 30, 1e-6
#: Forms that are tried with a second line.
WITH_SECOND = {
    True: ("transmission", "fano", "sloped"),
    False: ("transmission", "offset", "sloped", "floor", "rice"),
}


def is_reversed(frequency_hz: FloatArray, values: ComplexArray) -> bool:
    """Whether phases rise over the line, as of values that count Re[values exp(-i 2 pi f t)].

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: shape (n,), any unit.
    """
    here, there = (
        min(squares_of(frequency_hz, y, start) for start in complex_starts(frequency_hz, y))
        for y in (values, np.conj(values))
    )
    return there < here


def single_line_fits(frequency_hz: FloatArray, values: FloatArray | ComplexArray) -> list[LineFit]:
    """Every form of one line of these values that can be fitted.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: amplitudes or complex values, shape (n,).
    """
    search = SweepSearch(frequency_hz, values)
    return [fit for fit in search.singles(search.starts())[0] if fit.name not in SQUARED]


@dataclass(frozen=True, eq=False)
class SweepSearch:
    """The line of a sweep, or several that are fitted together.

    Attributes:
        f: frequencies, rising, shape (n,), Hz.
        values: amplitudes, or complex values with phases as Re[values exp(i 2 pi f t)], (n,).
        wanted: name of the form that is wanted; empty: they are compared.
        elsewhere: lines that are observed beyond the ends.
        source: of the data, for errors.
        delayed: whether complex values have the delay of a cable; None: both are compared.
        weights: relative ones of the values, (n,); None: noise of one size is tried first.
    """

    f: FloatArray
    values: FloatArray | ComplexArray
    wanted: str = ""
    elsewhere: tuple[Place, ...] = ()
    source: str = "sweep"
    delayed: bool | None = None
    weights: FloatArray | None = None

    @property
    def is_complex(self) -> bool:
        """Whether there are phases."""
        return np.iscomplexobj(self.values)

    @property
    def rows(self) -> int:
        """Number of residuals."""
        return self.values.size * (2 if self.is_complex else 1)

    def fit(self) -> LineFit:
        """The one line.

        Raises:
            BadInput: too few points, no line, two of them, or one that the ends cut off.
        """
        if self.f.size < MIN_SWEEP_POINTS:
            raise BadInput(
                f"{self.source}: {self.f.size} points are too few for a resonance fit; wanted at "
                f"least {MIN_SWEEP_POINTS}"
            )
        starts = self.starts()
        singles, failed = self.singles(starts)
        if singles:
            weights = self.noise_weights(min(singles, key=lambda fit: fit.likely_squares))
            if weights is not None:
                return replace(self, weights=weights).fit()
        delays = [start.delay_s for start in starts if start.delay_s]
        nulls = null_models(self.f, self.values, delays, self.elsewhere, self.weights)
        if not singles:
            straight = min(null.squares for null in nulls if null.kind is NullKind.STRAIGHT)
            for null in nulls:
                if null.kind is NullKind.FLANK and null.squares < 0.5 * straight:
                    raise self.cut_off(null)
            raise BadInput(
                f"{self.source}: shows no resonance between {self.ends}: no form of a line can be "
                "fitted"
            )
        criteria = criteria_of(singles, self.rows)
        order = self.order(singles, criteria)
        both = self.with_second([singles[k] for k in order], nulls)
        if not both:
            self.check_present(singles[order[0]], nulls)
        fits = singles
        if both:
            fits, criteria = both, criteria_of(both, self.rows)
            order = self.order(both, criteria)
        chosen = fits[order[0]]
        self.check_describes(chosen)
        self.check_ends(chosen)
        height = chosen.amplitude
        if not height.value > HIGH * height.std and not chosen.mirrored:
            raise BadInput(
                f"{self.source}: shows no resonance between {self.ends}: the height of the best "
                f"line, {with_error(height.value, height.std, '')}, is below "
                f"{HIGH:.0f} of its standard errors"
            )
        tried = [_tried(fits[k], float(criteria[k])) for k in order]
        if both:
            # how far the lowest criterion of one line is above that of two
            closest = min(singles, key=lambda fit: fit.squares)
            least, above = criteria_of([chosen, closest], self.rows)
            single = criteria_of(singles, self.rows) + float(above - least)
            tried += [_tried(fit, float(c)) for fit, c in zip(singles, single, strict=True)]
        if not self.wanted:  # a form that is requested has no rivals
            chosen = with_rivals(fits, criteria, order[0])
        return replace(chosen, forms=(*tried, *failed))

    def fit_several(self, count: int | None) -> LineFit:
        """So many lines, each new one started where the others leave most; None: those that gain.

        A line gains where noise alone does not explain it, by every fit of fewer (`not_by_chance`).

        Args:
            count: number of lines.

        Raises:
            BadInput: as of one line, or fewer lines than are wanted can be fitted.
        """
        singles, _ = self.singles(self.starts())
        if not singles:
            raise BadInput(f"{self.source}: shows no resonance between {self.ends}")
        forms, names = self.forms, WITH_SECOND[self.is_complex]
        criteria = criteria_of(singles, self.rows)
        fits = [singles[k] for k in order_of(singles, criteria)]
        tried = [
            replace(forms[name], delayed=fits[0].delay is not None, tails=())
            for name in ((self.wanted,) if self.wanted in names else names)
        ]
        best, before = fits, [*fits]
        while len(fits[0].others) + 1 < (count or len(best[0].others) + 1 + AHEAD):
            if not count and best[0].structure.is_noise:
                break
            one_top = not fits[0].structure.is_noise
            made = with_one_more(self.f, self.values, fits[0], tried, self.weights, one_top=one_top)
            shown = [fit for fit in made if shows_all(self.f, fit)]
            made = shown or (made if count else [])
            if not made:
                break
            criteria = criteria_of(made, self.rows)
            fits = [made[k] for k in order_of(made, criteria)]
            # while lines are missing residuals of any fit are correlated: the next ones decide
            if count or not_by_chance(self.values, before, fits[0]):
                best = fits
            before += fits
        if count and len(best[0].others) + 1 < count:
            raise BadInput(
                f"{self.source}: {count} lines cannot be fitted between {self.ends}; "
                f"{len(best[0].others) + 1} can"
            )
        fits, criteria = best, criteria_of(best, self.rows)
        if not fits[0].others:
            return self.fit()  # with all that contradicts one line
        self.check_describes(fits[0])
        forms_tried = [_tried(fit, float(c)) for fit, c in zip(fits, criteria, strict=True)]
        return replace(fits[0], forms=tuple(forms_tried))

    @property
    def forms(self) -> dict[str, Form]:
        """Forms of one line by name."""
        return COMPLEX_FORMS if self.is_complex else AMPLITUDE_FORMS

    @property
    def ends(self) -> str:
        """The first and the last frequency, for errors."""
        return hertz(*self.f[[0, -1]], digits=8, joined=" and ")

    def noise_weights(self, closest: LineFit) -> FloatArray | None:
        """Weights of points whose noise grows with the amplitude; None where it has one size.

            sigma_i^2 = a^2 + (r |m_i|)^2        a absolute, r relative, m the curve

        is that of largest likelihood of the residuals. Weights are one over it, one where the curve
        is largest.

        Source: R. Carroll and D. Ruppert, Transformation and Weighting in Regression, chapter 3.
        """
        known = self.weights is not None or closest.form.single  # Rice's noise is unequal
        if known or closest.structure.sizes_p >= PRESENT_P:
            return None
        size = np.abs(closest.curve) / float(np.max(np.abs(closest.curve)))
        squares = np.abs(self.values - closest.curve) ** 2
        design = np.stack([np.ones_like(size), size**2], axis=1)
        mean = float(np.mean(squares))
        variances = np.full(2, mean)
        for _ in range(ROUNDS):
            sizes = np.maximum(design @ variances, LEAST_VARIANCE * mean)
            # squares of normal deviates scatter as their variances
            solved = np.linalg.lstsq(design / sizes[:, None], squares / sizes, rcond=None)[0]
            solved = np.maximum(solved, LEAST_VARIANCE * mean)
            if np.allclose(solved, variances, rtol=1e-3, atol=0.0):
                break
            variances = solved
        sizes = np.maximum(design @ variances, LEAST_VARIANCE * mean)
        weights = np.asarray(np.sqrt(np.sum(variances) / sizes))
        return weights if float(np.ptp(weights)) > LEAST_UNEQUAL else None

    # --- models of one line ----------------------------------------------------------------------

    def starts(self) -> list[Start]:
        """Where fits of one line may start."""
        if self.is_complex:
            return complex_starts(self.f, np.asarray(self.values, dtype=complex))
        return amplitude_starts(self.f, np.asarray(self.values, dtype=float), phased=True)

    def singles(self, starts: Sequence[Start]) -> tuple[list[LineFit], list[TriedForm]]:
        """Every model of one line that could be fitted, and those that could not."""
        made: list[LineFit] = []
        failed: list[TriedForm] = []
        hidden: list[LineFit] = []

        def attempt(form: Form, near: Sequence[Start]) -> None:
            try:
                fit = fit_form(
                    self.f, self.values, form, near, weights=self.weights, source=self.source
                )
            except BadInput as error:
                record = TriedForm(
                    **no_line(), name=form.name, delayed=form.delayed, message=str(error)
                )
                failed.append(record)
                return
            span = float(np.ptp(self.f))
            resolved = not form.delayed or fit.width.value * WIDTHS_FOR_DELAY < span
            (made if resolved else hidden).append(fit)

        if self.is_complex:
            for delayed in (False, True) if self.delayed is None else (self.delayed,):
                for form in COMPLEX_FORMS.values():
                    form = replace(form, delayed=delayed, tails=self.elsewhere)
                    if not form.bent:
                        attempt(form, starts)
        else:
            crest = starts[:1]
            for form in AMPLITUDE_FORMS.values():
                if not form.bent and not (form.single and self.weights is not None):
                    attempt(form, starts if form.phased else crest)
        fits = made or hidden
        noise = any(fit.structure.order == 0 for fit in fits)
        if not noise or self.wanted.startswith("duffing"):
            for form in (form for form in self.forms.values() if form.bent):
                attempt(form, [*starts[:1], *bent_starts(self.f, np.abs(self.values))])
        if not self.is_complex and (self.elsewhere or self.wanted == "tail" or not noise):
            pull = OBSERVED if self.elsewhere else SUPPOSED
            attempt(Form(name="tail", further=1, pull=pull), self.tail_starts(starts[0]))
        if not self.is_complex and not noise:
            for background, name in enumerate(SQUARED):
                attempt(Form(name=name, detector=SQUARE, background=background), starts[:1])
            # a column that was taken for the wrong quantity explains all but noise, or nothing
            made = [f for f in made if f.name not in SQUARED or f.structure.order == 0]
        return made or hidden, failed

    def tail_starts(self, crest: Start) -> list[Start]:
        """Where a line, and another one beyond the ends, may start."""
        chord = np.interp(self.f, self.f[[0, -1]], np.abs(self.values[[0, -1]]))
        over = np.asarray(self.values, dtype=float) - chord
        first = amplitude_starts(self.f, over)[0] if float(np.max(over)) > 0.0 else crest
        return [
            replace(first, others=((place, 0.3 + 0j),))
            for place in self.elsewhere or beyond_ends(self.f)
        ]

    def order(self, fits: Sequence[LineFit], criteria: FloatArray) -> list[int]:
        """The models, the one that is taken first."""
        order = order_of(fits, criteria)
        if self.wanted:
            named = [k for k in order if fits[k].name == self.wanted]
            if not named:
                raise BadInput(f"{self.source}: {self.wanted} cannot be fitted to these points")
            return [*named, *(k for k in order if k not in named)]
        # a line that is observed elsewhere has a tail here, whether noise hides it or not
        tail = [k for k in order if fits[k].name == "tail"] if self.elsewhere else []
        if tail and (criteria[tail[0]] < SIMPLER or fits[tail[0]].structure.order == 0):
            return [*tail, *(k for k in order if k not in tail)]
        return order

    # --- two lines -------------------------------------------------------------------------------

    def with_second(self, singles: Sequence[LineFit], nulls: Sequence[Null]) -> list[LineFit]:
        """Models of a line and a weak one next to it; empty where one line describes the sweep.

        Raises:
            TwoResonances: the second one is about as high, or both have one top.
        """
        if singles[0].name == "tail":
            return []
        forms = self.forms
        names = (self.wanted,) if self.wanted in forms else WITH_SECOND[self.is_complex]
        if not self.wanted and singles[0].name in forms:
            names = tuple(dict.fromkeys((*names, singles[0].name)))
        delayed = singles[0].delay is not None
        tried = [
            replace(forms[name], delayed=delayed, tails=self.elsewhere if self.is_complex else ())
            for name in names
            if not (forms[name].phased or forms[name].single or forms[name].bent)
        ]
        both = two_line_fits(self.f, self.values, singles, tried, self.weights)
        if not both:
            return []
        best = both[self.order(both, criteria_of(both, self.rows))[0]]
        lines = as_two(best, best.second)
        closest = min(null.squares for null in nulls)
        if closest < best.squares:
            return []
        if lines is not None and (lines.overlap or lines.share > WEAK):
            raise self.two(best, lines, min(fit.squares for fit in singles) / best.squares)
        return both

    def two(self, best: LineFit, lines: TwoLines, times: float) -> TwoResonances:
        """The error of a sweep of two lines."""
        lines = replace(lines, times=times)
        if not lines.overlap:
            places = hertz(*lines.frequency_hz, digits=5)
            widths = hertz(*lines.width_hz, digits=3)
            return TwoResonances(
                f"{self.source}: shows two resonances, at {places} ({widths} wide); wanted one, as "
                "--from and --to choose it; fmu-fit init drafts a campaign of both",
                lines=lines,
            )
        return TwoResonances(
            f"{self.source}: two lines that overlap describe its points, and one line does not: "
            f"the best form of one leaves {number(times, 2)} times as much (in squares). "
            f"{_places(lines)} A campaign whose model has two modes fits both, as fmu-fit init "
            "drafts it",
            lines=lines,
        )

    # --- what contradicts one line ---------------------------------------------------------------

    def check_present(self, best: LineFit, nulls: Sequence[Null]) -> None:
        """Refuse a sweep that a model without a line describes as well."""
        count = self.rows / best.structure.widening**2

        def describes(null: Null) -> bool:
            """Whether the line is no better by more than noise makes, at any of the points."""
            if (
                best.squares < self.rows * SMALLEST_RESIDUAL**2
                and null.squares > 2.0 * best.squares
            ):
                return False
            p = self.f.size * chance(
                null.squares, null.unknowns, best.squares, best.unknowns, best.structure, self.rows
            )
            gain = count * math.log(max(null.squares, 1e-300) / max(best.squares, 1e-300))
            return p >= PRESENT_P or gain - 2.0 * (best.unknowns - null.unknowns) <= PLAINLY

        closer = [null for null in nulls if describes(null)]
        if not closer:
            return
        made = [
            self.rows * math.log(max(null.squares, 1e-300)) + 2.0 * null.unknowns for null in closer
        ]
        null = next(n for n, c in zip(closer, made, strict=True) if c <= min(made) + SIMPLER)
        if null.kind is NullKind.FLANK:
            raise self.cut_off(null)
        f, top = self.f, int(np.argmax(np.abs(self.values)))
        if self.is_complex or AT_END <= top < f.size - AT_END:
            raise BadInput(
                f"{self.source}: shows no resonance between {self.ends}: a {null.kind.value} "
                "describes its points as well"
            )
        end, where = ("first", f[0]) if 2 * top < f.size - 1 else ("last", f[-1])
        raise BadInput(
            f"{self.source}: is largest at its {end} point, {hertz(where, digits=8)}, which cuts "
            "off a line, or shows none; wanted half a width on both sides at least"
        )

    def check_describes(self, best: LineFit) -> None:
        """Refuse correlated residuals beyond the limit."""
        shares = (self.values - best.curve) / float(np.max(np.abs(self.values)))
        parts = [shares.real, shares.imag] if self.is_complex else [shares.real]
        if all(correlation(part, part).misfit is not Misfit.REFUSED for part in parts):
            return
        worth = max(1.0, self.f.size / best.structure.together**2)
        raise BadInput(
            f"{self.source}: no form of a line describes its points between {self.ends}: the "
            f"residuals of the best one, {best.name}, at {hertz(best.frequency.value, digits=8)}, "
            f"{TOGETHER}, so that the {self.f.size} points are worth {number(worth, 2)} "
            "independent ones"
        )

    def check_ends(self, best: LineFit) -> None:
        """Refuse a line of which less than half a width is left at an end."""
        f = self.f
        left, right = best.frequency.value - f[0], f[-1] - best.frequency.value
        if min(left, right) < 0.5 * best.width.value:
            end, where = ("first", f[0]) if left < right else ("last", f[-1])
            raise BadInput(
                f"{self.source}: its resonance at {hertz(best.frequency.value, digits=8)}, "
                f"{hertz(best.width.value, digits=3)} wide, is cut off by the {end} point of the "
                f"sweep at {hertz(where, digits=8)}; wanted half a width on both sides at least"
            )

    def cut_off(self, null: Null) -> BadInput:
        """The error of a line beyond an end."""
        f, place = self.f, null.place or Place(math.nan, math.nan)
        below = place.frequency_hz < f[0]
        end, where = ("first", f[0]) if below else ("last", f[-1])
        there = [p for p in self.elsewhere if (p.frequency_hz < f[0]) is below]
        near = f", near {hertz(there[0].frequency_hz, digits=6)}" if there else ""
        return BadInput(
            f"{self.source}: its {end} point at {hertz(where, digits=8)} cuts off a line: the "
            f"points are the flank of one beyond it{near}; "
            "wanted half a width on both sides at least"
        )


def _tried(fit: LineFit, criterion: float) -> TriedForm:
    """A model as it is listed."""
    return fit.tried(criterion, delayed=fit.delay is not None, second=fit.second is not None)


def _places(two: TwoLines) -> str:
    """Where two lines are and how wide, as far as the points determine it."""
    numbers = (*two.frequency_hz, *two.width_hz)
    if not two.std_hz or any(
        std > UNRESOLVED * width for std, width in zip(two.std_hz, two.width_hz * 2, strict=True)
    ):
        return "The points do not determine where each of them is."
    low, up, *widths = (
        with_error(value, std, "Hz") for value, std in zip(numbers, two.std_hz, strict=True)
    )
    return f"They are at {low}, {widths[0]} wide, and at {up}, {widths[1]} wide."
