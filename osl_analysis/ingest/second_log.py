"""A second log of a trial on the clock of the first, t_first = offset + (1 + drift) * t_second."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import polars as pl
import scipy

from osl_analysis.errors import InputError, printable
from osl_analysis.ingest import LIMITS
from osl_analysis.ingest.clock import (
    ClockFit,
    Signal,
    correlate_clocks,
    find_edges,
    fit_clock,
    values_of,
)
from osl_analysis.ingest.conversion import Converted
from osl_analysis.ingest.several_clocks import on_one_clock
from osl_analysis.measured import usual_step
from osl_analysis.source_file import Source

STEPS = 6  # of a search for offset and drift, each a tenth of the one before or less


def check_second_clock(log: Source, second: Source) -> None:
    """Refuse source files of two logs of a trial that do not state how the second's clock is
    aligned."""
    clock = getattr(second, "clock", "master")
    shared = getattr(log, "channels", {}).keys() & getattr(second, "channels", {}).keys()
    if (
        clock == "master"
        or (clock == "sync" and "sync" not in shared)
        or not (shared or clock in ("common", "start"))
    ):
        raise InputError(
            f"{second.place('clock')}: '{clock}' does not align it with the other log of the trial;"
            " write clock: sync or shared, and map the column sync, or another signal that both"
            " recorded, in both source files; common, where both count from one time; or start,"
            " where both begin at one instant, and state a `delay`"
        )


def joined_logs(
    logs: Sequence[Converted], files: Sequence[str], source: Source
) -> tuple[pl.DataFrame, dict[str, Any], list[str]]:
    """Join two logs of a trial.

    Parameters
    ----------
    logs, files
        The first, which is the master, and the second.
    source
        The source file of the second, whose `clock` says how it is aligned.

    Returns
    -------
    samples
        Rows of both, each with its own; a column of both is the first's.
    fit
        Of the second's clock to the first's, for the provenance.
    remarks
        What aligns the clocks, and what only one of them recorded, a sentence each.

    Raises
    ------
    InputError
        No signal aligns the clocks, a column of both is no such signal, or no time is in both.
    """
    clock: str = getattr(source, "clock", "")
    log, second = logs
    both = [column for column in log.origins if column in second.origins]
    needless = [column for column in both if column != "sync"]
    if needless and clock != "shared":
        raise InputError(
            f"column '{needless[0]}' is mapped in both logs; remove it from one source file, or"
            " write clock: shared, where it is the same signal"
        )
    fit = second_clock(log, second, clock, both)
    names = [printable(file) for file in files]
    samples = on_one_clock([log.samples, second.samples.drop(both)], [ClockFit(0.0), fit])
    remarks = [clock_remark(names, fit)]
    ends_s = [log.samples["time"][-1], fit.to_master(second.samples["time"][-1])]
    shorter = int(np.argmin(ends_s))
    cut_s = ends_s[1 - shorter] - ends_s[shorter]
    if cut_s > LIMITS.longest_cut_s:
        remarks.append(
            f"{names[shorter]} ends {cut_s:.3f} s before {names[1 - shorter]}: what is behind it is"
            " not used"
        )
    return samples, asdict(fit), remarks


def clock_remark(names: Sequence[str], fit: ClockFit) -> str:
    """What aligns the clock of the second of two files, with an interval, or what it costs that
    nothing does."""
    if fit.drift_error is None:
        return (
            f"no signal shows the clock of {names[1]} beside that of {names[0]} (`clock:"
            f" {fit.method}`): by each ms that it is late B changes by 0.001 K, by each ppm that it"
            " is fast by 0.5e-6 K per second of the trial; a calibration tells both"
        )
    return (
        f"the clock of {names[1]}, by {fit.method}: it begins {fit.offset:.6f} s after that of"
        f" {names[0]} (95 %: within {1.96e3 * fit.residual:.2g} ms), and runs"
        f" {-1e6 * fit.drift:.2f} ppm fast (within {1.96e6 * fit.drift_error:.2g} ppm)"
    )


def second_clock(log: Converted, second: Converted, clock: str, both: Sequence[str]) -> ClockFit:
    """Fit the second log's clock to the first's, by a column of `both`, or as stated."""
    if clock in ("common", "start"):
        starts_s = [each.facts["time"]["start_s"] for each in (log, second)]
        offset_s = starts_s[1] - starts_s[0] if clock == "common" else 0.0
        return ClockFit(offset_s, method=clock)
    column = "sync" if clock == "sync" else both[0]
    first, other = (values_of(each, "one of both logs", column) for each in (log, second))
    if clock == "sync":
        return fit_clock(find_edges(*other), find_edges(*first))
    return shared_clock(other, first)


def shared_clock(slave: Signal, master: Signal) -> ClockFit:
    """Fit offset and drift by a signal that both recorded, whose scale and level may differ
    (Gauss-Newton, from the lag that correlates best), of means over `mean_s`."""
    fit = correlate_clocks(slave, master)
    (time, values), (master_time, master_values) = map(averaged, (slave, master))
    spline = scipy.interpolate.CubicSpline(master_time, master_values)
    for _ in range(STEPS):
        at = fit.to_master(time)
        inside = (at >= master_time[0]) & (at <= master_time[-1])
        slope = spline(at[inside], 1)
        middle = time[inside].mean()
        since = time[inside] - middle
        X = np.column_stack([spline(at[inside]), np.ones_like(since), slope, slope * since])
        of_column, _, _, _ = np.linalg.lstsq(X, values[inside])
        late_s, drift = of_column[2:] / of_column[0]
        fit = replace(fit, offset=fit.offset + late_s - drift * middle, drift=fit.drift + drift)
    left = values[inside] - X @ of_column
    # means that overlap are no others
    independent = np.ptp(time[inside]) / LIMITS.mean_s
    covariance = np.linalg.inv(X.T @ X) * (left @ left) / independent
    errors = np.sqrt(np.diag(covariance)[2:]) / abs(of_column[0])
    return replace(fit, residual=errors[0], drift_error=errors[1])


def averaged(signal: Signal) -> Signal:
    """Means of times and values of neighbouring samples over `mean_s`."""
    rows = max(round(LIMITS.mean_s / usual_step(signal[0])), 1)
    time, values = (np.convolve(each, np.full(rows, 1 / rows), "valid") for each in signal)
    return time, values
