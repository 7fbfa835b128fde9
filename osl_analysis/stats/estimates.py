"""An estimate with its interval, the impedance of a joint, and both as columns of tables."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.stats.linear_fit import NORMAL_HALF_WIDTH, LinearFit

# one row of a result table, by column. None becomes an empty field.
Row = dict[str, float | str | None]

INTERVAL_ENDS = ("", "_low", "_high")
"""Endings of the columns of an estimate: its value and the ends of its 95 % interval."""


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
        return self.of_each(lambda name, each: each.widened_by(known_errors[name]))

    def widened_to_include(self, other: "Impedance") -> "Impedance":
        """K, B and I with intervals that hold those of another impedance, too."""
        return self.of_each(lambda name, each: each.widened_to_include(getattr(other, name)))

    def moved_by(self, before: "Impedance", after: "Impedance") -> "Impedance":
        """K, B and I and their intervals, moved as those of another impedance were."""
        return self.of_each(
            lambda name, each: each.moved_by(getattr(before, name), getattr(after, name))
        )

    def of_each(self, change: Callable[[str, Estimate], Estimate]) -> "Impedance":
        """What becomes of K, B and I, each with its name."""
        return Impedance(**{name: change(name, each) for name, each in vars(self).items()})


def estimates_row(fit: LinearFit, *names: str) -> dict[str, float]:
    """`name`, and the bounds `name_low` and `name_high` of its 95 % interval, for each name, in SI
    units."""
    row: dict[str, float] = {}
    for name in names:
        low, high = fit.interval(name)
        row[name] = fit[name]
        row[f"{name}_low"] = low
        row[f"{name}_high"] = high
    return row


def diagnostics_row(fit: LinearFit, interval_method: str) -> Row:
    """The diagnostics of a fit and its interval in all tables, VAF in percent."""
    return {
        "interval_method": interval_method,
        "VAF": fit.vaf,
        "condition_number": fit.condition_number,
        "largest_correlation": fit.largest_correlation,
    }
