"""A fit as columns of a tidy table: estimates with standard errors, then the diagnostics every table shares."""

from itertools import combinations

from osl_analysis.bench.diagnostics import Whiteness, largest_correlation, whiteness
from osl_analysis.signals import LowPass
from osl_analysis.stats.regression import LinearFit

Row = dict[str, float | str | None]


def estimates_row(fit: LinearFit, *names: str) -> dict[str, float]:
    """`name`, `name_se` and the 95 % interval's `name_low` and `name_high` for each name, in SI units."""
    row: dict[str, float] = {}
    for name in names:
        low, high = fit.interval(name)
        row |= {name: fit[name], f"{name}_se": fit.se(name), f"{name}_low": low, f"{name}_high": high}
    return row


def covariance_row(fit: LinearFit, *names: str) -> dict[str, float]:
    """`cov_A_B` for each pair of names, in the product of their units."""
    return {f"cov_{a}_{b}": fit.cov(a, b) for a, b in combinations(names, 2)}


def diagnostics_row(fit: LinearFit, rate_hz: float, low_pass: LowPass) -> Row:
    """What the interval is from, VAF [percent], R2 about zero, scaled condition number, the estimates' correlation.

    Then samples, the residuals' correlation time [s], and how white they are. The rows that were fitted are
    `rate_hz` apart, their signals passed `low_pass`.
    """
    return {
        "interval_method": fit.interval_method,
        "VAF": fit.vaf,
        "R2": fit.r_squared,
        "condition_number": fit.condition_number,
        "largest_correlation": largest_correlation(fit),
        "samples": fit.samples,
        "correlation_s": fit.correlation_samples / rate_hz,
        **whiteness_row(whiteness(fit.residual, rate_hz, low_pass)),
    }


def delay_row(lag: float | None, se: float | None, K: float) -> Row:
    """A lag [s] of the torque behind the angle, its error, and its share in B, -K lag [N*m*s/rad]; null without one.

    `certain_lag_damping` is that share where the lag is over two standard errors, and 0 where it is not.
    """
    damping = certain = None
    if lag is not None and se is not None:
        damping = -K * lag
        certain = damping if abs(lag) > 2 * se else 0.0
    return {"lag_s": lag, "lag_se_s": se, "lag_damping": damping, "certain_lag_damping": certain}


def whiteness_row(found: Whiteness | None) -> Row:
    """Autocorrelation, Ljung and Box's statistic per lag and p-value; null where there are too few samples."""
    values = (None, None, None) if found is None else (found.autocorrelation, found.per_lag, found.p)
    return dict(zip(("residual_autocorrelation", "ljung_box_per_lag", "ljung_box_p"), values, strict=True))
