"""Standard errors and 95 % intervals that a plan will give for K, B and I (Eq. 15)."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from osl_analysis.design.distortion import Distortion
from osl_analysis.design.information import Joint, Weighted, weighted
from osl_analysis.design.plan import Continuous, PeriodicMultisine, Plan
from osl_analysis.design.sensors import LineVariance, Phasors, Sensors
from osl_analysis.signals import LowPass
from osl_analysis.spectral.equation_error import DETECTION, ENOUGH_REALISATIONS, REALISATIONS
from osl_analysis.stats.covariance import FEWEST_CYCLES, FILTER_SPAN, welch_satterthwaite
from osl_analysis.trial import Array

CYCLES = "cycles"
"""Source of the interval of a stepped sine, as in `stats.covariance`."""
NO_DOUBT = 1e5
"""Degrees of freedom from which a variance counts as known."""
COLUMNS = 4
"""Columns of the fit: K, B, I and the offset."""


@dataclass(frozen=True)
class Precision:
    """What a plan will give, for K, B and I: shape (3,) each."""

    causes: Mapping[str, Array]
    """Variances of the estimates by cause; their sum is the squared standard error."""
    noise_half_width: Array
    """Half of the 95 % interval without distortion."""
    half_width: Array
    """Half of the 95 % interval."""
    degrees_of_freedom: Array
    """Degrees of freedom of the standard errors."""
    method: str
    """Source of the interval that the analysis will give."""
    correlation: float
    """Correlation of K and I."""
    condition_number: float
    """Scaled condition number of the fit."""

    @property
    def se(self) -> Array:
        """Standard errors."""
        return np.asarray(np.sqrt(np.sum(list(self.causes.values()), axis=0)))


def precision(
    plan: Plan, joint: Joint, sensors: Sensors, low_pass: LowPass, distortion: Distortion | None = None
) -> Precision:
    """The intervals that a plan will give.

    Raises
    ------
    IdentifiabilityError
        As `weighted`.
    InputError
        As `Distortion.variance`.
    """
    fit = weighted(plan, low_pass)
    Z, stated = joint.impedance(fit.sines.w), distortion or Distortion()
    errors = sensors.variances(fit.sines, Z, plan.record_s)
    causes = {name: np.diag(fit.covariance(error)) for name, error in errors.items()}
    causes["encoder rounding"] = causes["encoder rounding"] + gain_variance(fit, Z, sensors)
    noise = np.sum(list(causes.values()), axis=0)
    errors["distortion"] = stated.variance(plan, fit, Z)
    causes["distortion"] = np.diag(stated.covariance(plan, fit, Z))
    total, seen = noise + causes["distortion"], causes["torque noise"] + causes["angle noise"]
    method, freedom = interval_of(plan, fit, errors, low_pass)
    freedom_of_all, of_noise = (student(method, freedom, seen, variance - seen) for variance in (total, noise))
    normal = fit.normal
    return Precision(
        causes=causes,
        noise_half_width=stdtrit(of_noise, 0.975) * np.sqrt(noise),
        half_width=stdtrit(freedom_of_all, 0.975) * np.sqrt(total),
        degrees_of_freedom=freedom_of_all,
        method=method,
        correlation=float(-normal[0, 2] / np.sqrt(normal[0, 0] * normal[2, 2])),
        condition_number=fit.condition_number,
    )


def interval_of(plan: Plan, fit: Weighted, errors: Mapping[str, LineVariance], low_pass: LowPass) -> tuple[str, Array]:
    """Where the analysis will take the interval from, and the degrees of freedom (3,) of its standard errors.

    The spread of cycles has cycles - 1 of them at each amplitude and frequency, combined by Welch and Satterthwaite;
    the spread of realisations one less than there are; a level at detection lines two at each, which serve the excited
    lines around it; HAC those of `stats.covariance.moving_sums`.
    """
    if isinstance(plan, PeriodicMultisine):
        if plan.realisations >= ENOUGH_REALISATIONS:
            return REALISATIONS, np.full(3, plan.realisations - 1.0)
        shares = [np.sum([fit.share(error) for error in errors.values()], axis=0)]
        near = np.argmin(np.abs(plan.first.lines[:, None] - plan.first.detection[None, :]), axis=1)
        together = [np.bincount(near, share) for share in shares[0].T]
        return DETECTION, np.array([2 * plan.realisations * u.sum() ** 2 / np.sum(u**2) for u in together])
    cycles = fit.sines.cycles
    if isinstance(plan, Continuous) or cycles.min() < FEWEST_CYCLES:
        windows = plan.record_s * 2 * low_pass.cutoff_hz / FILTER_SPAN
        return "HAC", np.full(3, max(1.5 * windows - COLUMNS, 1.0))
    seen = fit.share(errors["torque noise"]) + fit.share(errors["angle noise"])
    return CYCLES, welch_satterthwaite(list(seen), cycles - 1)


def student(method: str, freedom: Array, seen: Array, unseen: Array) -> Array:
    """Degrees of freedom (3,) of a variance of which the spread of cycles shows a part; other methods see all of it."""
    if method != CYCLES:
        return freedom
    each = zip(seen, unseen, freedom, strict=True)
    found = np.array([float(welch_satterthwaite([s, max(u, 0.0)], [f, np.inf])) for s, u, f in each])
    return np.where(found < NO_DOUBT, found, np.inf)


def gain_variance(fit: Weighted, Z: Phasors, sensors: Sensors) -> Array:
    """Variance (3,) of K, B and I by amplitudes that rounding changes by the same share at every frequency."""
    share, size = sensors.rounded_gain(fit.sines), fit.sines.size
    alike = {a: np.isclose(size, a) for a in np.unique(np.round(size[share > 0], 9))}
    each = [share[c].mean() * fit.fitted(np.where(c, Z, 0)) ** 2 for c in alike.values()]
    return np.asarray(np.sum([np.zeros(3), *each], axis=0))
