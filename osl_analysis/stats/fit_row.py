"""A fit as a row of a result table: estimates, standard errors, and the diagnostics that all tables share."""

from itertools import combinations

from osl_analysis.signals import LowPass
from osl_analysis.stats.regression import LinearFit
from osl_analysis.stats.whiteness import Whiteness, whiteness

Row = dict[str, float | str | None]
"""One row of a result table, by column. None becomes an empty field."""


def estimates_row(fit: LinearFit, *names: str) -> dict[str, float]:
    """`name`, `name_se` and the bounds `name_low` and `name_high` of the 95 % interval for each name, in SI units."""
    row: dict[str, float] = {}
    for name in names:
        low, high = fit.interval(name)
        row |= {name: fit[name], f"{name}_se": fit.se(name), f"{name}_low": low, f"{name}_high": high}
    return row


def covariance_row(fit: LinearFit, *names: str) -> dict[str, float]:
    """`cov_A_B` for each pair of names, in the product of their units."""
    return {f"cov_{a}_{b}": fit.cov(a, b) for a, b in combinations(names, 2)}


def diagnostics_row(fit: LinearFit, rate_hz: float, low_pass: LowPass) -> Row:
    """Diagnostics of the fit and of its interval.

    The source of the interval, VAF [percent], R2 about zero, the scaled condition number, the largest correlation of
    two estimates, the number of samples, the correlation time [s] of the residuals, and their whiteness. The fitted
    rows have the rate `rate_hz`; their signals passed `low_pass`.
    """
    return {
        "interval_method": fit.interval_method,
        "VAF": fit.vaf,
        "R2": fit.r_squared,
        "condition_number": fit.condition_number,
        "largest_correlation": fit.largest_correlation,
        "samples": fit.samples,
        "correlation_s": fit.correlation_samples / rate_hz,
        **whiteness_row(whiteness(fit.residual, rate_hz, low_pass)),
    }


def whiteness_row(judged: Whiteness | None) -> Row:
    """Autocorrelation, Ljung and Box's statistic per lag and p-value; None with too few samples."""
    values = (None, None, None) if judged is None else (judged.autocorrelation, judged.per_lag, judged.p)
    return dict(zip(("residual_autocorrelation", "ljung_box_per_lag", "ljung_box_p"), values, strict=True))


def lag_damping_row(lag: float | None, se: float | None, K: float, certain_from: float = 2.0) -> Row:
    """Lag [s] of the torque behind the angle, its standard error, and what it adds to B: -K lag [N*m*s/rad].

    `certain_lag_damping` is the same if the lag is larger than `certain_from` standard errors, else 0. All null without
    a lag.
    """
    damping = certain = None
    if lag is not None and se is not None:
        damping = -K * lag
        certain = damping if abs(lag) > certain_from * se else 0.0
    return {"lag_s": lag, "lag_se_s": se, "lag_damping": damping, "certain_lag_damping": certain}
