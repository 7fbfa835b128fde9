# SPDX-License-Identifier: Apache-2.0
"""A second log of a trial on the clock of the first, t_first = offset + (1 + drift) * t_second."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import polars as pl
import scipy

from osl_analysis.errors import InputError
from osl_analysis.ingest import LIMITS
from osl_analysis.ingest.clock import (
    ClockFit,
    Signal,
    common_clock,
    correlate_clocks,
    find_edges,
    fit_clock,
    values_of,
)
from osl_analysis.ingest.conversion import Converted
from osl_analysis.ingest.several_clocks import on_one_clock
from osl_analysis.measured import usual_step
from osl_analysis.signals.plateaus import means_from
from osl_analysis.stats.budget import NORMAL_HALF_WIDTH
from osl_analysis.stats.linear_fit import linear_fit

STEPS = 6  # of a search for offset and drift, each a tenth of the one before or less
UNKNOWN_CLOCK = (
    "no signal shows the clock of log_2 beside that of log: by each ms that it is late B changes by"
    " 0.001 K, by each ppm that it runs fast by 0.5e-6 K per second of the trial; a calibration"
    " tells both"
)


def joined_logs(
    logs: Mapping[str, Converted], clock: str
) -> tuple[pl.DataFrame, ClockFit, list[str]]:
    """Join the `log` and `log_2` of a trial.

    Parameters
    ----------
    logs
        Both recordings, by the cell of the sheet that names them.
    clock
        How the second is aligned, as its source file says.

    Returns
    -------
    samples
        Rows of both, each with its own; a column that both have is the first's.
    fit
        Of the second's clock to the first's.
    remarks
        What aligns the clocks, and what only one of them recorded, a sentence each.

    Raises
    ------
    InputError
        The signal of both does not align the clocks, or another column is in both.
    """
    log, second = logs.values()
    both = [column for column in log.origins if column in second.origins]
    if {*both} - {"sync"} and clock != "shared":
        raise InputError(
            f"{', '.join(both)}: mapped in log and log_2; remove it from one source file, or write"
            " `clock: shared` in that of log_2, where both recorded the same signal"
        )
    fit = second_clock(log, second, clock, both)
    samples = on_one_clock([log.samples, second.samples.drop(both)], [ClockFit(0.0), fit])
    remarks = [UNKNOWN_CLOCK]
    if fit.drift_error is not None:
        fast_ppm = -1e6 * fit.drift
        half_width_ppm = 1e6 * NORMAL_HALF_WIDTH * fit.drift_error
        remarks = [
            f"log_2 begins {1e3 * fit.offset:.3f} ms after log, and runs {fast_ppm:.2f} ppm"
            f" fast (within {half_width_ppm:.2g}), by {both[0]}"
        ]
    longer_s = fit.to_master(second.samples["time"][-1]) - log.samples["time"][-1]
    if abs(longer_s) > LIMITS.longest_cut_s:
        shorter = "log" if longer_s > 0 else "log_2"
        remarks.append(f"{shorter} ends {abs(longer_s):.3f} s before the other, which is cut there")
    return samples, fit, remarks


def second_clock(log: Converted, second: Converted, clock: str, both: Sequence[str]) -> ClockFit:
    """Fit the second log's clock to the first's, by a column of `both`, or as stated."""
    if clock == "common":
        return common_clock(second, log)
    if clock == "start":
        return ClockFit(0.0, method=clock)
    column = "sync" if clock == "sync" else both[0]
    first, other = (values_of(each, "both logs", column) for each in (log, second))
    if clock == "sync":
        return fit_clock(find_edges(*other), find_edges(*first))
    return shared_clock(other, first)


def shared_clock(slave: Signal, master: Signal) -> ClockFit:
    """Fit offset and drift by a signal that both recorded, whose scale and level may differ
    (Gauss-Newton, from the lag that correlates best), of short means."""
    clock = correlate_clocks(slave, master)
    time, values = short_means(slave)
    master_time, master_values = short_means(master)
    spline = scipy.interpolate.CubicSpline(master_time, master_values)
    for _ in range(STEPS):
        at = clock.to_master(time)
        inside = (at >= master_time[0]) & (at <= master_time[-1])
        slope = spline(at[inside], 1)
        since = time[inside] - time[inside].mean()
        columns = {
            "gain": spline(at[inside]),
            "level": np.ones_like(since),
            "late": slope,
            "drift": slope * since,
        }
        fit = linear_fit(values[inside], columns)
        drift = fit["drift"] / fit["gain"]
        late_s = fit["late"] / fit["gain"] - drift * time[inside].mean()
        clock = replace(clock, offset=clock.offset + late_s, drift=clock.drift + drift)
    errors = [fit.se(name) / abs(fit["gain"]) for name in ("late", "drift")]
    return replace(clock, residual=errors[0], drift_error=errors[1])


def short_means(signal: Signal) -> Signal:
    """Means of times and values over `short_mean_s`."""
    rows = max(round(LIMITS.short_mean_s / usual_step(signal[0])), 1)
    begins = np.arange(0, signal[0].size, rows)
    time, values = (means_from(begins, each) for each in signal)
    return time, values
