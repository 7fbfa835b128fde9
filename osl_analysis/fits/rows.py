"""A fit as columns of a tidy table: estimates with standard errors, then the diagnostics every table shares."""

from itertools import combinations

from osl_analysis.fits.diagnostics import largest_correlation
from osl_analysis.fits.regression import LinearFit


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


def diagnostics_row(fit: LinearFit, rate_hz: float) -> dict[str, float | str]:
    """What the interval is from, VAF [percent], R2 about zero, scaled condition number, the estimates' correlation.

    Then samples, and the residuals' correlation time [s].
    """
    return {
        "interval_method": fit.interval_method,
        "VAF": fit.vaf,
        "R2": fit.r_squared,
        "condition_number": fit.condition_number,
        "largest_correlation": largest_correlation(fit),
        "samples": fit.samples,
        "correlation_s": fit.correlation_samples / rate_hz,
    }
