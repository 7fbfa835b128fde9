"""Mean, scatter and interval over repeated trials."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
import polars as pl
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured
from osl_analysis.stats.covariance import welch_satterthwaite


@dataclass(frozen=True)
class Repeats:
    """Summary of one estimate per trial, all in the unit of the estimate."""

    n: int
    """Number of trials."""
    mean: float
    sd: float
    """Standard deviation between trials."""
    se: float
    """Standard error of the mean."""
    low: float
    """Lower bound of the 95 % interval of the mean (Student)."""
    high: float
    """Upper bound of the 95 % interval of the mean (Student)."""


@dataclass(frozen=True)
class CommonError:
    """An error that all trials share, so that their scatter does not show it."""

    variance: float
    """Variance of the error, in the squared unit of the estimate."""
    degrees_of_freedom: float
    """Degrees of freedom of this variance."""


def over_repeats(values: ArrayLike, common: Sequence[CommonError] = (), kinds: ArrayLike | None = None) -> Repeats:
    """Summary of one estimate per trial, shape (n,). Standard error and interval include the `common` errors.

    Trials of different `kinds` (n,) count as one mean per kind: their mean is the result, so that what differs from
    kind to kind is no scatter. `sd` is then the scatter within kinds.

    Raises
    ------
    InputError
        Fewer than two trials of a kind: scatter and interval need repeats. Or a value cannot be measured.
    """
    values = np.asarray(values, dtype=float)
    check_measured("the estimate of a trial", values)
    labels = np.zeros(len(values)) if kinds is None else np.asarray(kinds)
    parts = [values[labels == kind] for kind in np.unique(labels)] or [values]
    least = min(len(part) for part in parts)
    if least < 2:
        raise InputError(f"{least} trial cannot give a scatter; repeat the experiment at least twice")
    scatter = [float(np.var(part, ddof=1)) for part in parts]
    freedom = [len(part) - 1 for part in parts]
    mean = float(np.mean([np.mean(part) for part in parts]))
    sd = float(np.sqrt(np.average(scatter, weights=freedom)))
    of_means = [s / len(part) / len(parts) ** 2 for s, part in zip(scatter, parts, strict=True)]
    variances = [*of_means, *(error.variance for error in common)]
    se = float(np.sqrt(sum(variances)))
    each = [*freedom, *(error.degrees_of_freedom for error in common)]
    half = float(stdtrit(welch_satterthwaite(variances, each), 0.975)) * se
    return Repeats(len(values), mean, sd, se, mean - half, mean + half)


def summary_table(table: pl.DataFrame, quantities: Sequence[str]) -> pl.DataFrame:
    """A row per quantity (a column of `table`): n, mean, sd, se and the 95 % interval of the mean over the trials."""
    return pl.DataFrame([{"quantity": name, **summary_row(table[name])} for name in quantities])


def summary_row(values: pl.Series) -> dict[str, float | str | None]:
    """n, mean, sd, se, low, high of one column, and the source of the interval. One trial gives only n and mean."""
    numbers = values.cast(pl.Float64).drop_nulls().drop_nans()
    if len(numbers) >= 2:
        return asdict(over_repeats(numbers.to_numpy())) | {"interval_method": "Student"}
    mean = float(numbers[0]) if len(numbers) else None
    return {"n": len(numbers), "mean": mean, **dict.fromkeys(("sd", "se", "low", "high", "interval_method"))}
