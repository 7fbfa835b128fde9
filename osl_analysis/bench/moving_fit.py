"""Eq. 15 over the rows of a record in which the joint moves, some of them at a time: a record of hours has no room for
a column of each parameter."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from osl_analysis.bench.unfiltered_noise import noise_beyond
from osl_analysis.pieces import pieces
from osl_analysis.second_order import impedance_columns
from osl_analysis.signals import LowPass, Motion
from osl_analysis.stats.condensed import condensed
from osl_analysis.stats.covariance import Covariance, correlation_samples, sums_over_window
from osl_analysis.stats.least_squares import largest_correlation
from osl_analysis.stats.regression import LinearFit, Regressors, regressors, variance_accounted_for
from osl_analysis.trial import Array

Column = Callable[[slice], Array]
"""A column of a regression (k,), or several (k, p): the values in some rows of a record."""
METHOD = "HAC"
"""Source of the intervals: the autocorrelation of the noise."""
NAMES = ("K", "B", "I", "offset", "drift")
"""The parameters of every fit."""


class FittedRecord(Protocol):
    """What a fit needs of a record: its signals (n,), and which of its rows are fitted."""

    @property
    def time(self) -> Array:
        """Uniform times (n,) [s]."""
        ...

    @property
    def rate_hz(self) -> float:
        """Samples per second."""
        ...

    @property
    def torque(self) -> Array:
        """Raw resisting torque (n,) [N*m]."""
        ...

    @property
    def filtered_torque(self) -> Array:
        """The torque behind the filter (n,) [N*m]."""
        ...

    @property
    def motion(self) -> Motion:
        """Filtered angle with its derivatives."""
        ...

    @property
    def low_pass(self) -> LowPass:
        """The filter of angle and torque."""
        ...

    @property
    def samples(self) -> int:
        """Number m of fitted rows."""
        ...

    def rows_at(self, fitted: slice) -> list[slice]:
        """The rows of the record behind some of the fitted ones, which are counted from 0 to m."""
        ...

    def fitted_pieces(self) -> Iterable[slice]:
        """All fitted rows, some at a time."""
        ...

    def part(self, signal: Array) -> Array:
        """A signal (n,) in the rows that are fitted (m,)."""
        ...


@dataclass(frozen=True)
class Columns:
    """The columns of Eq. 15 with offset and drift, and `more` of them, by name, of a record."""

    record: FittedRecord
    more: Sequence[tuple[str, Column]] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the p columns."""
        return (*NAMES, *(name for name, _ in self.more))

    def at(self, rows: slice) -> Array:
        """The columns (k, p) in some rows of the record."""
        time = self.record.time
        late = time[rows] - middle(time)
        found = [*impedance_columns(self.record.motion[rows]).values(), late, *(more(rows) for _, more in self.more)]
        return np.array(found).T

    def fitted(self, rows: slice) -> Array:
        """The columns (k, p) in some of the fitted rows."""
        return np.concatenate([self.at(one) for one in self.record.rows_at(rows)])

    def parts(self) -> Iterator[tuple[Array, Array]]:
        """Columns (k, p) and filtered torque (k,) of all fitted rows, some at a time."""
        return parts_of(self.record, self.at, self.record.fitted_pieces())

    def solved(self) -> tuple[Regressors, Array]:
        """The columns' decomposition and the estimates (p,); raises as `linear_fit`."""
        X, y = condensed(self.parts)
        found = regressors(dict(zip(self.names, X.T, strict=True)), y.shape)
        return found, found.solved(y)

    def residual(self, estimates: Array) -> Array:
        """What the estimates leave of the torque in the fitted rows (m,) [N*m]."""
        left, first = np.empty(self.record.samples), 0
        for X, y in self.parts():
            np.subtract(y, X @ estimates, out=left[first : first + len(y)])
            first += len(y)
        return left

    def noise(self, estimates: Array, residual: Array) -> Array:
        """The torque's noise as it was before the filter in the fitted rows (m,) [N*m], beside a `residual` (m,).

        The columns are slow, so that the estimates do not change if the filter is taken off the noise. Behind the
        filter it is correlated with both signs at the frequencies of the columns: Bartlett's weights then lose up to a
        tenth of it. What the filter takes off the torque is noise, but for the motion near the cut-off.
        """
        record = self.record
        off = noise_beyond(
            record.torque,
            record.filtered_torque,
            lambda rows: np.asarray(self.at(rows) @ estimates),
            record.low_pass,
            record.rate_hz,
        )
        found = record.part(off)
        found += residual
        return found


def middle(time: Array) -> float:
    """The mean of uniform times (n,) [s]."""
    return float(time[0] + time[-1]) / 2


def parts_of(record: FittedRecord, columns: Column, rows: Iterable[slice]) -> Iterator[tuple[Array, Array]]:
    """Columns (k, p) and filtered torque (k,) of some rows of a record, a piece of them at a time."""
    for stretch in rows:
        for some in pieces(stretch.stop - stretch.start):
            piece = slice(stretch.start + some.start, stretch.start + some.stop)
            yield columns(piece), record.filtered_torque[piece]


def thinned(record: FittedRecord, step: int, columns: Column) -> Array:
    """Columns (k, p) in every `step`-th of the fitted rows of a record."""
    found, before = [], 0
    for rows in record.fitted_pieces():
        found.append(columns(rows)[-before % step :: step])
        before += rows.stop - rows.start
    return np.concatenate(found)


def fit_of(record: FittedRecord, more: Sequence[tuple[str, Column]] = ()) -> LinearFit:
    """Eq. 15 with offset and drift over the fitted rows, and `more` columns of the record, by name.

    The interval is that of the noise before the filter (`Columns.noise`), HAC.

    Raises
    ------
    InputError, IdentifiabilityError
        As `linear_fit`.
    """
    columns = Columns(record, more)
    found, estimates = columns.solved()
    residual, inverse = columns.residual(estimates), found.inverse
    window = correlation_samples(residual, record.low_pass.independent_samples(record.rate_hz))
    covariance, degrees_of_freedom = spread_of(columns, inverse, columns.noise(estimates, residual), window)
    torque = record.part(record.filtered_torque)
    return LinearFit(
        columns.names,
        estimates,
        covariance,
        variance_accounted_for(torque, residual),
        1 - float(residual @ residual) / max(float(torque @ torque), np.finfo(float).tiny),
        found.condition,
        window,
        record.samples,
        METHOD,
        degrees_of_freedom,
        residual,
        largest_correlation(inverse),
    )


def spread_of(columns: Columns, inverse: Array, noise: Array, window: int) -> Covariance:
    """Covariance of estimates that change by the columns times `inverse` (p, p) with each sample of the noise (m,)."""
    shape = len(noise), len(columns.names)
    return sums_over_window(lambda rows: columns.fitted(rows) @ inverse * noise[rows, None], shape, window, slow=True)


def left_by(record: FittedRecord) -> float:
    """RMS [N*m] of what Eq. 15 with offset and drift leaves of the fitted rows; raises as `fit_of`."""
    columns = Columns(record)
    return float(np.std(columns.residual(columns.solved()[1])))


def estimates_of(record: FittedRecord, more: Sequence[tuple[str, Column]] = ()) -> dict[str, float]:
    """The estimates of `fit_of` by name, without their intervals, for a tenth of the work."""
    columns = Columns(record, more)
    return dict(zip(columns.names, columns.solved()[1].tolist(), strict=True))
