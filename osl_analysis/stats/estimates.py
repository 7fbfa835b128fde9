"""An estimate with its interval, and the impedance of a joint: what every fit gives."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.stats.linear_fit import NORMAL_HALF_WIDTH, LinearFit
from osl_analysis.stats.table_rows import INTERVAL_ENDS, Row


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval, in the SI unit of what it estimates.

    A value is never overwritten: one that is widened is a new value.
    """

    value: float
    standard_error: float
    low: float
    high: float

    @classmethod
    def of_fit(cls, fit: LinearFit, name: str) -> "Estimate":
        """The estimate of a least-squares fit."""
        low, high = fit.interval(name)
        return cls(fit[name], fit.se(name), low, high)

    def widened_by(self, known_error: float) -> "Estimate":
        """The estimate with another, independent standard error in its interval."""
        more = NORMAL_HALF_WIDTH * known_error
        below = float(np.hypot(self.value - self.low, more))
        above = float(np.hypot(self.high - self.value, more))
        error = float(np.hypot(self.standard_error, known_error))
        return Estimate(self.value, error, self.value - below, self.value + above)

    def widened_to_include(self, other: "Estimate") -> "Estimate":
        """The estimate with an interval that holds another one's, too."""
        return replace(self, low=min(self.low, other.low), high=max(self.high, other.high))

    def moved_by(self, before: "Estimate", after: "Estimate") -> "Estimate":
        """The estimate and its interval, moved as another estimate was."""
        by = after.value - before.value
        return replace(self, value=self.value + by, low=self.low + by, high=self.high + by)

    def columns(self, name: str) -> Row:
        """`name`, and the ends of its interval."""
        values = (self.value, self.low, self.high)
        return {f"{name}{end}": x for end, x in zip(INTERVAL_ENDS, values, strict=True)}


@dataclass(frozen=True)
class Impedance:
    """Stiffness [N*m/rad], damping [N*m*s/rad] and inertia [kg*m^2] of a joint (Eq. 15)."""

    K: Estimate
    B: Estimate
    I: Estimate

    @classmethod
    def of_fit(cls, fit: LinearFit) -> "Impedance":
        """K, B and I of a least-squares fit."""
        return cls(*(Estimate.of_fit(fit, name) for name in ("K", "B", "I")))

    def widened_by(self, known_errors: Mapping[str, float]) -> "Impedance":
        """K, B and I with further standard errors, by symbol, in their intervals."""
        return Impedance(
            K=self.K.widened_by(known_errors["K"]),
            B=self.B.widened_by(known_errors["B"]),
            I=self.I.widened_by(known_errors["I"]),
        )

    def widened_to_include(self, other: "Impedance") -> "Impedance":
        """K, B and I with intervals that hold those of another impedance, too."""
        return Impedance(
            K=self.K.widened_to_include(other.K),
            B=self.B.widened_to_include(other.B),
            I=self.I.widened_to_include(other.I),
        )

    def moved_by(self, before: "Impedance", after: "Impedance") -> "Impedance":
        """K, B and I and their intervals, moved as those of another impedance were."""
        return Impedance(
            K=self.K.moved_by(before.K, after.K),
            B=self.B.moved_by(before.B, after.B),
            I=self.I.moved_by(before.I, after.I),
        )
