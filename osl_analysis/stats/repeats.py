# SPDX-License-Identifier: Apache-2.0
"""Mean, scatter and interval over repeated trials.

The interval of a mean is Student's by the scatter of the trials, or that of the trials' own errors
where it is wider. Errors that all trials share are in both.

Example: `summary_of_trials(impedance, ["K", "B"])` has a row for K and one for B.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl
import scipy

from osl_analysis.base.measured import check_measured, rms
from osl_analysis.base.trial import Array
from osl_analysis.stats.budget import NORMAL_HALF_WIDTH, Budget, Contribution, scatter
from osl_analysis.stats.doubts import counted
from osl_analysis.stats.sources import Source

CHANCE = 0.01  # that a reported scatter is noise


def scatter_beyond_noise(values: Array, ses: Array) -> float | None:
    """Standard deviation of values (n,) that their standard errors (n,) do not explain.

    It is a lower bound: noise alone exceeds it in `CHANCE` of cases. It is 0 where noise explains
    all, and None for fewer than two values.
    """
    n = len(values)
    if n < 2:
        return None
    least = (n - 1) * np.var(values, ddof=1) / scipy.special.chdtri(n - 1, CHANCE)
    return float(np.sqrt(max(least - np.mean(np.square(ses)), 0.0)))


OWN_CONDITION = (
    pl.when(pl.col("K_d").is_null()).then("trial").otherwise(pl.lit("")).alias("own_condition")
)
"""The name of a trial without a stated K_d, which is a condition of its own: it may have been asked
for another K than similar trials. Empty for other trials."""


NONE_COUNTS = "none: all trials are doubtful"
RANGE = "lowest to highest"  # the range over conditions, which are chosen and no sample


def summary_row(table: pl.DataFrame, name: str, is_weighted: bool = False) -> dict[str, Any]:
    """n, mean, sd, low and high of one column over trials, and the interval's source.

    The interval is Student's, or the one by the trials' own intervals (`NAME_low`, `NAME_high`)
    where this is wider: trials that agree by chance do not know their mean better than that. Both
    hold the error that all rows share (`NAME_se_bench`). If `is_weighted`, a row's weight is the
    inverse square of its interval. One trial has its own interval, without sd. Raises InputError: a
    value cannot be measured.
    """
    used = table.filter(pl.col(name).cast(pl.Float64).is_not_nan())
    numbers = used[name].cast(pl.Float64)
    n = len(numbers)
    if n < 2:
        first = used.row(0, named=True) if n else {}
        return {
            "n": n,
            "mean": numbers.mean(),
            "sd": None,
            "low": first.get(f"{name}_low"),
            "high": first.get(f"{name}_high"),
            "interval_method": first.get("interval_method"),
        }
    values = numbers.to_numpy()
    check_measured("the estimate of a trial", values)
    low, high, se_bench = (
        used[f"{name}{end}"].to_numpy() if f"{name}{end}" in used.columns else np.zeros(n)
        for end in ("_low", "_high", "_se_bench")
    )
    se_bench = np.nan_to_num(se_bench)
    own_squares = np.nan_to_num(high - low) ** 2 / 4 - (NORMAL_HALF_WIDTH * se_bench) ** 2
    halves = np.sqrt(np.maximum(own_squares, 0.0))
    weights = 1 / np.square(high - low) if is_weighted else np.ones(n)
    shares = weights / weights.sum()

    mean = float(shares @ values)
    se_of_mean = float(np.sqrt(shares @ (values - mean) ** 2 / (n - 1)))
    shared = Contribution(Source.BENCH, rms(se_bench))
    se_by_trials = float(np.linalg.norm(shares * halves)) / NORMAL_HALF_WIDTH
    by_scatter = Budget(mean, (scatter(se_of_mean, n - 1), shared))
    by_trials = Budget(mean, (scatter(se_by_trials, math.inf), shared))
    wider = max(by_scatter, by_trials, key=Budget.half_width)
    method = "Student" if wider is by_scatter else "errors of the trials"
    return {
        "n": n,
        "mean": mean,
        "sd": se_of_mean * math.sqrt(n),
        "low": wider.low,
        "high": wider.high,
        "interval_method": f"{method} + shared errors" if shared.standard else method,
    }


def summary_of_trials(table: pl.DataFrame, quantities: Sequence[str]) -> pl.DataFrame:
    """A row per quantity (a column of `table`): `summary_row` over its sound trials.

    `n_doubtful` is the number of trials that are left out. Where none counts, there is no mean, and
    `interval_method` says why.
    """
    rows = []
    for name in quantities:
        used = counted(table, [name])
        n_doubtful = len(table) - len(used)
        row = {"quantity": name, **summary_row(used, name), "n_doubtful": n_doubtful}
        if used.is_empty():
            row["interval_method"] = NONE_COUNTS
        rows.append(row)
    return pl.DataFrame(rows)
