"""A fit as columns of a tidy table: estimates with standard errors, then the diagnostics every table shares."""

from osl_analysis.fits.regression import LinearFit


def estimates_row(fit: LinearFit, *names: str) -> dict[str, float]:
    """`name` and `name_se` for each name, in SI units."""
    row: dict[str, float] = {}
    for name in names:
        row |= {name: fit[name], f"{name}_se": fit.se(name)}
    return row


def diagnostics_row(fit: LinearFit, rate_hz: float) -> dict[str, float]:
    """VAF [percent], R2 about zero, scaled condition number, samples, and the residuals' correlation time [s]."""
    return {
        "VAF": fit.vaf,
        "R2": fit.r_squared,
        "condition_number": fit.condition_number,
        "samples": fit.samples,
        "correlation_s": fit.correlation_samples / rate_hz,
    }
