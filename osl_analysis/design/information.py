"""What the sines of a plan tell on K, B and I (Eq. 15): Fisher's information, and the covariance by any errors."""

from dataclasses import dataclass

import numpy as np

from osl_analysis.design.plan import Plan, Sines
from osl_analysis.design.sensors import LineVariance, Phasors
from osl_analysis.errors import IdentifiabilityError
from osl_analysis.signals import LowPass
from osl_analysis.spectral.equation_error import gain
from osl_analysis.stats.regression import CONDITION_LIMIT
from osl_analysis.trial import Array

NAMES = ("K", "B", "I")


@dataclass(frozen=True)
class Joint:
    """The impedance that is expected: K [N*m/rad], B [N*m*s/rad], I [kg*m^2]."""

    K: float
    B: float
    I: float

    def impedance(self, w: Array) -> Phasors:
        """Z [N*m/rad] at angular frequencies (n,) [rad/s] (Eq. 15)."""
        return np.asarray(self.K - self.I * w**2 + 1j * w * self.B, dtype=np.complex128)

    @property
    def values(self) -> Array:
        """K, B, I, shape (3,)."""
        return np.array([self.K, self.B, self.I])


@dataclass(frozen=True)
class Weighted:
    """Least squares on filtered signals: what each sine tells on K, B and I.

    With theta = a sin(wt) the columns of Eq. 15 are a sin(wt), a w cos(wt) and -a w^2 sin(wt). Over whole cycles their
    products are a^2/2 times [1, -w^2; -w^2, w^4] (K and I, in phase) and a^2 w^2/2 (B, in quadrature); the offset is
    orthogonal to all. Their sum over sines, each times its duration and 2/S, is Fisher's information for white noise of
    the one-sided density S. The filter weighs the sines, and errors are not the same at all of them: the covariance is
    that of weighted least squares (a sandwich).
    """

    sines: Sines
    weight: Array
    """Squared gain of the zero-phase filter at each sine."""

    def moments(self, each: Array, order: int) -> float:
        """Sum of `each` (n,) times w to the power `order`."""
        return float(np.sum(each * self.sines.w**order))

    def in_and_out(self, in_phase: Array, quadrature: Array) -> Array:
        """Sum over sines of the products of the columns, weighted (n,) in phase and in quadrature; shape (3, 3)."""
        m = [self.moments(in_phase, order) for order in (0, 2, 4)]
        return np.array([[m[0], 0, -m[1]], [0, self.moments(quadrature, 2), 0], [-m[1], 0, m[2]]])

    @property
    def normal(self) -> Array:
        """The normal matrix (3, 3): products of the columns over time."""
        each = self.weight * self.sines.size**2 / 2 * self.sines.duration_s
        return self.in_and_out(each, each)

    def covariance(self, error: LineVariance) -> Array:
        """Covariance (3, 3) of the estimates by errors of the torque's amplitudes."""
        inverse = np.linalg.inv(self.normal)
        each = (self.weight * self.sines.size * self.sines.duration_s / 2) ** 2
        return np.asarray(inverse @ self.in_and_out(each * error.in_phase, each * error.quadrature) @ inverse)

    def share(self, error: LineVariance) -> Array:
        """Part of the variances of K, B, I that the error of each sine makes, shape (n, 3)."""
        inverse, w = np.linalg.inv(self.normal), self.sines.w
        each = (self.weight * self.sines.size * self.sines.duration_s / 2)[:, None]
        in_phase = each * (inverse[:, 0] - np.outer(w**2, inverse[:, 2]))
        quadrature = each * np.outer(w, inverse[:, 1])
        return np.asarray(in_phase**2 * error.in_phase[:, None] + quadrature**2 * error.quadrature[:, None])

    @property
    def condition_number(self) -> float:
        """Condition number of the columns, each scaled to unit length; infinite for a single frequency."""
        scale = np.sqrt(np.diag(self.normal))
        values = np.linalg.eigvalsh(self.normal / np.outer(scale, scale))
        return float(np.sqrt(values[-1] / values[0])) if values[0] > 1e-15 * values[-1] else np.inf

    def fitted(self, impedance: Phasors) -> Array:
        """K, B and I (3,) that are fitted to an impedance [N*m/rad] at the sines, shape (n,)."""
        w, each = self.sines.w, self.weight * self.sines.size**2 / 2 * self.sines.duration_s
        told = [np.sum(each * impedance.real), np.sum(each * w * impedance.imag), -np.sum(each * w**2 * impedance.real)]
        return np.asarray(np.linalg.solve(self.normal, told))


def weighted(plan: Plan, low_pass: LowPass) -> Weighted:
    """The fit of a plan.

    Raises
    ------
    IdentifiabilityError
        K and I cannot be told apart.
    """
    fit = Weighted(plan.sines, gain(low_pass, plan.sines.frequency_hz) ** 2)
    if fit.condition_number > CONDITION_LIMIT:
        low, high = float(fit.sines.frequency_hz.min()), float(fit.sines.frequency_hz.max())
        where = f"{low:.4g} Hz alone" if np.isclose(low, high) else f"{low:.4g} to {high:.4g} Hz"
        raise IdentifiabilityError(
            f"K and I cannot be told apart by {where}, where K - I w^2 is one number; excite down to {low / 2:.3g} Hz "
            f"or up to {2 * high:.3g} Hz too"
        )
    return fit
