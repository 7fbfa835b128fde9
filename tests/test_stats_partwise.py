"""A regression whose rows come part by part is the regression of all rows."""

from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest

from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.stats.comparison import held_out_vaf
from osl_analysis.stats.covariance import ResidualCorrelation
from osl_analysis.stats.cycle_sums import Cycles
from osl_analysis.stats.partwise import partwise_fit, partwise_vaf, sums_of
from osl_analysis.stats.regression import linear_fit
from osl_analysis.trial import Array

NAMES = ("K", "B", "offset")
EVERY = 7


@dataclass(frozen=True)
class Rows:
    """Seven cycles of 61.3 samples of a noisy sine of its own amplitude, with what a filter took off."""

    X: Array
    y: Array
    taken: Array
    cycles: Cycles

    def rows(self) -> tuple[Array, Array, Array]:
        return self.X, self.y, self.taken


def recorded(number: int) -> Rows:
    rng, n = np.random.default_rng(number), 430
    turn = 2 * np.pi * np.arange(n) / 61.3
    X = np.column_stack([(1 + number) * np.sin(turn), np.cos(turn), np.ones(n)])
    edges = 61.3 * np.arange(8)
    cycles = Cycles(edges[:-1], np.minimum(edges[1:], n), np.zeros(7, dtype=np.intp))
    return Rows(X, X @ [3.0, 0.2, 40.0] + 0.1 * rng.standard_normal(n), 0.05 * rng.standard_normal(n), cycles)


@dataclass(frozen=True)
class Known:
    """An error that cycles repeat, of a covariance that is known."""

    of: float

    def covariance(self, X: Array, inverse: Array) -> Array:
        return self.of * inverse @ inverse


def whole(parts: list[Rows]) -> tuple[dict[str, Array], Array, ResidualCorrelation]:
    """The same rows, and what is known of their residuals, in one piece."""
    begins = np.cumsum([0, *(len(part.y) for part in parts)])
    cycles = Cycles(
        np.concatenate([part.cycles.first + begin for part, begin in zip(parts, begins, strict=False)]),
        np.concatenate([part.cycles.stop + begin for part, begin in zip(parts, begins, strict=False)]),
        np.repeat(np.arange(len(parts)), 7),
    )
    X, y, taken = (np.concatenate(each) for each in zip(*(part.rows() for part in parts), strict=True))
    known = ResidualCorrelation(cycles, EVERY, filtered_off=taken, repeated=(Known(0.1), Known(0.2)))
    return dict(zip(NAMES, X.T, strict=True)), y, known


@pytest.fixture
def parts() -> list[Rows]:
    return [recorded(number) for number in range(4)]


def test_a_fit_in_parts_is_the_fit_to_all_rows(parts: list[Rows]) -> None:
    columns, y, known = whole(parts)
    expected = linear_fit(y, columns, known)
    found = partwise_fit(
        NAMES,
        [(part, sums_of(NAMES, part)) for part in parts],
        EVERY,
        [partial(one.covariance, parts[0].X) for one in known.repeated],
    )
    assert found is not None
    for name in ("estimates", "covariance", "degrees_of_freedom", "residual", "vaf", "r_squared", "condition_number"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-10, atol=1e-11)
    for name in ("names", "samples", "correlation_samples", "interval_method"):
        assert getattr(found, name) == getattr(expected, name)
    assert found.interval_method == "cycles + rounding"
    assert found.largest_correlation == pytest.approx(expected.largest_correlation, rel=1e-10)
    assert 99 < found.vaf < 99.99


def test_without_errors_that_repeat_the_interval_is_of_the_cycles_alone(parts: list[Rows]) -> None:
    columns, y, known = whole(parts)
    expected = linear_fit(y, columns, ResidualCorrelation(known.cycles, EVERY, filtered_off=known.filtered_off))
    found = partwise_fit(NAMES, [(part, sums_of(NAMES, part)) for part in parts], EVERY)
    assert found is not None
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-10)
    assert found.interval_method == "cycles"


def test_the_vaf_of_held_out_parts_is_that_of_their_rows(parts: list[Rows]) -> None:
    columns, y, _ = whole(parts[1:])
    fit = linear_fit(parts[0].y, dict(zip(NAMES, parts[0].X.T, strict=True)))
    assert partwise_vaf(fit, [sums_of(NAMES, part) for part in parts[1:]]) == pytest.approx(
        held_out_vaf(fit, columns, y), rel=1e-12
    )


def test_columns_that_are_alike_are_left_to_the_fit_of_all_rows_at_once(parts: list[Rows]) -> None:
    alike = [Rows(part.X * [1, 1e-3, 1] + part.X[:, :1] * [0, 1, 0], part.y, part.taken, part.cycles) for part in parts]
    assert partwise_fit(NAMES, [(part, sums_of(NAMES, part)) for part in alike], EVERY) is None


def test_what_cannot_be_fitted_is_refused_as_in_one_piece(parts: list[Rows]) -> None:
    still = [Rows(part.X * [1, 0, 1], part.y, part.taken, part.cycles) for part in parts]
    with pytest.raises(IdentifiabilityError, match="'B' cannot be estimated: its column is zero throughout"):
        partwise_fit(NAMES, [(part, sums_of(NAMES, part)) for part in still], EVERY)
    one = parts[0]
    missing = Rows(one.X * [1, np.nan, 1], one.y, one.taken, one.cycles)
    huge = Rows(one.X, 1e300 * one.y, one.taken, one.cycles)
    for broken, name in ((missing, "column 'B'"), (huge, "column 'y'")):
        with pytest.raises(InputError, match=name):
            sums_of(NAMES, broken)


def test_what_varies_little_more_than_its_rounding_is_accounted_for_as_in_one_piece(parts: list[Rows]) -> None:
    """A mean of 1 with changes of 5e-12: its variance is 25 times that of rounding, and its sums must not lose it."""
    still = [Rows(part.X, 1 + 5e-12 * part.X[:, 1], 0 * part.y, part.cycles) for part in parts]
    columns, y, known = whole(still)
    offset = {"offset": columns["offset"]}
    alone = [Rows(part.X[:, 2:], part.y, part.taken, part.cycles) for part in still]
    found = partwise_fit(("offset",), [(part, sums_of(("offset",), part)) for part in alone], EVERY)
    expected = linear_fit(y, offset, ResidualCorrelation(known.cycles, EVERY, filtered_off=known.filtered_off))
    assert found is not None
    assert found.vaf == pytest.approx(expected.vaf, abs=0.1)
    assert expected.vaf == pytest.approx(0, abs=0.1)


def test_a_fit_without_noise_accounts_for_all_and_no_more(parts: list[Rows]) -> None:
    exact = [Rows(part.X, part.X @ [3.0, 0.2, 40.0], 0 * part.y, part.cycles) for part in parts]
    fit = linear_fit(exact[0].y, dict(zip(NAMES, exact[0].X.T, strict=True)))
    assert 100 - 1e-9 < partwise_vaf(fit, [sums_of(NAMES, part) for part in exact]) <= 100
