"""An estimate with its interval, and both as columns of tables."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.stats.budget import NORMAL_HALF_WIDTH
from osl_analysis.stats.linear_fit import LinearFit

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
    low: float
    high: float

    @classmethod
    def of_fit(cls, fit: LinearFit, name: str) -> "Estimate":
        """The estimate of a least-squares fit."""
        return cls(fit[name], *fit.interval(name))

    def widened_by(self, known_error: float) -> "Estimate":
        """The estimate with another, independent standard error in its interval."""
        more = NORMAL_HALF_WIDTH * known_error
        below = np.hypot(self.value - self.low, more)
        above = np.hypot(self.high - self.value, more)
        return replace(self, low=self.value - below, high=self.value + above)

    def columns(self, name: str) -> Row:
        """`name`, and the ends of its interval."""
        values = (self.value, self.low, self.high)
        return {f"{name}{end}": x for end, x in zip(INTERVAL_ENDS, values, strict=True)}


Impedance = Mapping[str, Estimate]
"""Stiffness K [N*m/rad], damping B [N*m*s/rad] and inertia I [kg*m^2] of a joint (Eq. 15)."""


def estimates_row(fit: LinearFit, *names: str) -> Row:
    """`name`, and the bounds `name_low` and `name_high` of its 95 % interval, for each name, in SI
    units."""
    row: Row = {}
    for name in names:
        row |= Estimate.of_fit(fit, name).columns(name)
    return row
