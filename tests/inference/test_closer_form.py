"""Sweeps whose residuals tell the noise: is a model that something beside the line refutes told?"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from fitting.inference.adequacy import (
    Model,
    compared,
    compared_complex,
    compared_pair,
)
from fitting.inference.sweeps import LineFits
from fitting.result.result import read_result
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.rendering import phrase
from tests.support.coloured import coloured
from tests.support.complex_data import mode as driven
from tests.support.complex_data import write_xy
from tests.support.in_process import told as command
from tests.support.lines import mode

ETA, WIDTH = 1e6, 400.0
F = ETA + np.linspace(-2000.0, 2000.0, 81)
LINE = np.abs(mode(F, ETA, WIDTH))


def nearest_line(amplitude: FloatArray) -> FloatArray:
    """What the best single line leaves, over the top: of 200 widths, each with its best height."""
    best = math.inf
    left = amplitude
    for width in WIDTH * np.geomspace(0.3, 8.0, 200):
        curve = np.abs(mode(F, ETA, width))
        rows = amplitude - curve * float(curve @ amplitude) / float(curve @ curve)
        if float(rows @ rows) < best:
            best, left = float(rows @ rows), rows
    return np.asarray(left / np.max(amplitude))


@pytest.mark.parametrize(
    ("amplitude", "against"),
    [
        (LINE + 0.3, ("offset",)),
        (LINE + 0.3 + 5e-5 * (F - ETA), ("slope",)),
        # a constant in quadrature adds its power to the line's, too, but for its slope
        (np.hypot(LINE, 0.3), ("floor", "complex")),
        (np.abs(mode(F, ETA, WIDTH) + 0.3 * np.exp(0.7j)), ("complex",)),
    ],
    ids=["offset", "slope", "power", "crosstalk"],
)
def test_a_line_without_what_stands_beside_it_does_not_describe(
    amplitude: FloatArray, against: tuple[str, ...]
) -> None:
    noise = 5e-3 * np.random.default_rng(7).standard_normal(F.size)
    found = compared(F, amplitude + noise, Model(nearest_line(amplitude + noise), 3), LineFits())
    assert found is not None
    assert not found.describes
    assert found.rival is not None
    assert found.rival.background in against
    assert (found.rival.remedy == "background") is (against[0] in ("offset", "slope"))
    # what the true form leaves is the noise: chi square is what is left over its variance
    left = nearest_line(amplitude + noise) * float(np.max(amplitude + noise))
    assert found.chi_square == pytest.approx(float(left @ left) / 5e-3**2, rel=0.4)


def some(sample: int, most: int) -> pytest.MarkDecorator:
    """A count of seeds, and a larger one for the night."""
    night = pytest.param(most, marks=pytest.mark.nightly)
    return pytest.mark.parametrize("count", [sample, night])


@some(6, 40)
def test_noise_is_not_told_to_be_another_form(count: int) -> None:
    """Of honest lines, 1 to 10 % of noise, none: the probability for it is below 1e-4 each."""
    told = 0
    for seed in range(count):
        rng = np.random.default_rng(seed)
        f = ETA + np.linspace(-1500.0, 1500.0, int(rng.integers(9, 41)))
        noise = 10.0 ** rng.uniform(-2.0, -1.0) * rng.standard_normal(f.size)
        seen = np.abs(np.abs(mode(f, ETA, WIDTH)) + noise)
        found = compared(f, seen, Model(noise, 3), LineFits())
        told += found is not None and not found.describes
    assert told == 0


def test_two_lines_are_no_line_with_something_beside_it() -> None:
    """A model of two lines leaves noise, and no form of one line is held against it."""
    rng = np.random.default_rng(3)
    two = np.abs(mode(F, ETA - 500.0, WIDTH) + 0.6 * mode(F, ETA + 500.0, 300.0))
    noise = 5e-3 * rng.standard_normal(F.size)
    found = compared(F, two + noise, Model(noise / float(np.max(two)), 3), LineFits())
    assert found is None or found.describes


def best_amplitudes(amplitude: FloatArray) -> FloatArray:
    """What the best single line beside nothing leaves, over the top: by scipy."""
    top = float(np.max(amplitude))

    def rows(q: FloatArray) -> FloatArray:
        curve = np.abs(mode(F, ETA + WIDTH * q[0], WIDTH * np.exp(q[1])))
        return np.asarray(q[2] * curve - amplitude / top)

    return np.asarray(least_squares(rows, [0.3, 0.3, 1.0]).fun)


def test_two_lines_that_overlap_are_no_single_line() -> None:
    """A shoulder: one line leaves some times what two leave, not 25 times, and is given up."""
    noise = 8e-3 * np.random.default_rng(5).standard_normal(F.size)
    bump = np.abs(mode(F, ETA, WIDTH) + 0.5 * np.exp(0.4j) * mode(F, ETA + 350.0, 450.0)) + noise
    left = best_amplitudes(bump)
    plain = compared(F, bump, Model(left, 3), LineFits())
    assert plain is not None
    assert plain.describes
    found = compared_pair(F, bump, Model(left, 3))
    assert found is not None
    assert not found.describes
    assert found.rival is not None
    assert (found.rival.shape, found.rival.remedy) == ("pair", "output")
    assert found.chi_square == pytest.approx(
        float(left @ left) * (float(np.max(bump)) / 8e-3) ** 2, rel=0.4
    )


@some(3, 40)
def test_one_line_of_amplitudes_is_no_pair(count: int) -> None:
    """Of honest lines, 0.1 to 10 % of noise, none."""
    told = 0
    for seed in range(count):
        rng = np.random.default_rng(seed)
        noise = 10.0 ** rng.uniform(-3.0, -1.0) * rng.standard_normal(F.size)
        seen = np.abs(LINE + noise)
        told += compared_pair(F, seen, Model(best_amplitudes(seen), 3)) is not None
    assert told == 0


# Complex values: what another number of lines, or another background, leaves.

ONE = mode(F, ETA, WIDTH)
OTHER = 0.6 * np.exp(0.8j) * mode(F, ETA + 900.0, 300.0)
#: What stands beside a line, as many as are declared.
GROUND = (np.ones_like(ONE), np.asarray(F - ETA, dtype=complex))
SLOPE = 0.2j * (F - ETA) / 2000.0


def best(y: ComplexArray, beside: tuple[ComplexArray, ...] = (), lines: int = 1) -> FloatArray:
    """What the best lines leave of y beside some columns: by scipy, begun at the true ones."""

    def rows(q: FloatArray) -> FloatArray:
        shapes = [mode(F, ETA + WIDTH * q[2 * k], WIDTH * q[2 * k + 1]) for k in range(lines)]
        design = np.column_stack([*shapes, *beside])
        left = design @ np.linalg.lstsq(design, y, rcond=None)[0] - y
        return np.concatenate([left.real, left.imag]) / float(np.max(np.abs(y)))

    return np.asarray(least_squares(rows, [0.0, 1.0, 900.0 / WIDTH, 0.75][: 2 * lines]).fun)


def in_phase(y: ComplexArray) -> FloatArray:
    """What two lines of which the second is a real share of the first leave of y: by scipy."""

    def rows(q: FloatArray) -> FloatArray:
        one, two = (
            mode(F, ETA + WIDTH * place, WIDTH * np.exp(wide))
            for place, wide in ((q[0], q[1]), (900.0 / WIDTH + q[2], q[3]))
        )
        shape = one + q[4] * two
        left = shape * np.vdot(shape, y) / np.vdot(shape, shape) - y
        return np.concatenate([left.real, left.imag]) / float(np.max(np.abs(y)))

    return np.asarray(least_squares(rows, [0.0, 0.0, 0.0, 0.0, 0.6]).fun)


@pytest.mark.parametrize(
    ("turn", "known"),
    [
        *((0.15, False), (0.15, True), (0.0, True)),
        pytest.param(0.0, False, marks=pytest.mark.nightly),
    ],
)
def test_two_lines_are_not_in_phase_because_a_model_has_them_so(turn: float, known: bool) -> None:
    """By 9 degrees: the model leaves some times the noise (in squares), not 25 times."""
    pair = ONE + 0.6 * np.exp(1j * turn) * mode(F, ETA + 900.0, 300.0)
    y = pair + 5e-3 * noise_of("white", np.random.default_rng(8), pair)
    left = in_phase(y)
    assert float(left @ left) < 10.0 * 2 * F.size * (5e-3 / float(np.max(np.abs(y)))) ** 2
    found = compared_complex(F, y, Model(left, 7, noise_is_known=known))
    if turn == 0.0:
        assert found is None or found.describes
        return
    assert found is not None
    assert not found.describes
    assert found.rival is not None
    assert (found.rival.shape, found.rival.remedy) == ("pair", "coupling")


def noise_of(kind: str, rng: np.random.Generator, exact: ComplexArray) -> ComplexArray:
    """Noise of size one on each quadrature."""
    if kind == "drifting":
        parts = [coloured(rng.uniform(0.3, 0.95), exact.size, rng) for _ in "xy"]
    else:
        parts = list(rng.standard_normal((2, exact.size)))
    both = parts[0] + 1j * parts[1]
    return np.asarray(both * np.abs(exact) if kind == "proportional" else both)


@pytest.mark.parametrize(
    ("exact", "columns", "shape", "background", "key"),
    [
        (ONE + OTHER, 1, "pair", "", ""),
        (ONE + OTHER + 0.3, 2, "pair", "", ""),
        (ONE + 0.3, 1, "line", "complex", 'background = "constant"'),
        (ONE + SLOPE, 2, "line", "complex slope", 'background = "slope"'),
    ],
    ids=["pair", "pair on a constant", "constant", "slope"],
)
def test_complex_values_of_more_than_was_fitted_are_not_described(
    exact: ComplexArray, columns: int, shape: str, background: str, key: str
) -> None:
    sigma = 1e-2
    y = exact + sigma * noise_of("white", np.random.default_rng(4), exact)
    left = best(y, GROUND[: columns - 1])
    model = Model(left, 2 * columns + 2)
    found = compared_complex(F, y, model, columns)
    assert found is not None
    assert not found.describes
    assert found.rival is not None
    assert (found.rival.shape, found.rival.background) == (shape, background)
    assert found.rival.remedy == ("background" if key else "output")
    assert key in phrase("status", "remedy", found.rival, "")
    # what the true form leaves is the noise: chi square is what is left over its variance
    size = float(np.max(np.abs(y)))
    assert found.chi_square == pytest.approx(float(left @ left) * (size / sigma) ** 2, rel=0.3)
    named = compared_complex(F, y, model, columns, label="b")
    assert named is not None
    assert named.rival is not None
    assert named.rival.label == "b"


@pytest.mark.parametrize("kind", ["white", "drifting", "proportional"])
@pytest.mark.parametrize("lines", [1, 2])
@some(2, 25)
def test_a_model_that_describes_complex_values_is_not_told_not_to(
    kind: str, lines: int, count: int
) -> None:
    """Of some of each, 0.1 to 10 % of noise, none."""
    told = 0
    for seed in range(count):
        rng = np.random.default_rng(seed)
        columns = int(rng.integers(1, 4))
        exact = ONE + (OTHER if lines == 2 else 0.0)
        exact = exact + 0.3j * (columns > 1) + SLOPE * (columns > 2)
        y = exact + 10.0 ** rng.uniform(-3.0, -1.0) * noise_of(kind, rng, exact)
        left = best(y, GROUND[: columns - 1], lines)
        model = Model(left, 2 * columns + 2 * lines)
        found = compared_complex(F, y, model, columns)
        told += found is not None and not found.describes
    assert told == 0


def test_what_the_simulation_may_be_off_by_is_no_misfit() -> None:
    """Values without noise, and a simulation that is 1e-4 off: no form says anything against it."""
    left = 1e-4 * np.tile(np.cos(np.arange(F.size) / 9.0), 2)
    plain = compared_complex(F, ONE, Model(left, 4))
    excused = compared_complex(F, ONE, Model(left, 4, resolved=1e-4))
    assert plain is not None
    assert excused is not None
    assert (plain.describes, excused.describes) == (False, True)


def test_few_points_tell_no_pair() -> None:
    """Of 8 points a line alone is tried: a pair would go through most of what there is."""
    f = F[::11]
    y = ONE[::11] + OTHER[::11]
    found = compared_complex(f, y, Model(np.full(2 * f.size, 0.3), 4))
    assert found is None or found.rival is None or found.rival.shape == "line"


@pytest.mark.parametrize(
    ("width", "second", "code", "kind"),
    [(12.0, 0.6, 4, "not_described"), (27.0, 0.0, 0, "described"), (12.0, 0.0, 4, "not_described")],
    ids=["two lines", "one line", "one that is too narrow"],
)
def test_a_sweep_of_two_lines_through_an_output_of_one(
    tmp_path: Path, swift_fmu: Path, width: float, second: float, code: int, kind: str
) -> None:
    """As a user has it: a file, `init`, `reconstruct`. The noise drifts, of 1 % of the top.

    What the model's d1 adds to the upper line is 16 Hz: with d2 alone free none is narrower.
    """
    u = 1000.0 + np.linspace(-60.0, 60.0, 121)
    y = driven(u, 990.0, width) + second * driven(u, 1015.0, 9.0)
    drift = noise_of("drifting", np.random.default_rng(2), y)
    write_xy(tmp_path / "sweep.csv", u, y / np.max(np.abs(y)) + 0.01 * drift)
    begun = command("init", tmp_path / "sweep.csv", "--fmu", swift_fmu, "--out", tmp_path / "one")
    assert begun.code == 0, begun.err
    campaign = tmp_path / "one" / "campaign.toml"
    plain = "--no-profiles", "--no-report"
    ended = command("reconstruct", campaign, *plain, "--out", tmp_path / "out")
    assert ended.code == code, ended.out
    result = read_result(tmp_path / "out" / "result.json")
    ending = result.ending
    rival = None if ending.adequacy is None else ending.adequacy.rival
    assert ending.kind == kind
    assert (rival is not None and rival.shape == "pair") is (second > 0.0)
