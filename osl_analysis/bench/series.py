"""The signals of a fitted trial beside its model's torque, thinned out for the report of a run."""

from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.trial import Array

MOST_ROWS = 10_000
"""Rows of a thinned table: two minutes of a stepped sine have some fifteen for a period of its fastest one."""


@dataclass(frozen=True)
class Series:
    """Measured and modelled signals of one trial, shape (n,) each."""

    time: Array  # time [s]
    torque: Array  # measured torque, as it was fitted [N*m]
    torque_model: Array  # torque of the fitted model [N*m]; NaN where the model says nothing
    motion: Array  # angle [rad], or velocity [rad/s] where the bench has no angle
    fitted: NDArray[np.bool_]  # rows that are fitted
    is_velocity: bool = False  # whether `motion` is a velocity

    def table(self, most: int = MOST_ROWS) -> pl.DataFrame:
        """Every k-th sample, `most` or fewer rows, and the range of the residual in the k samples from each on.
        `theta_deg` or `omega`, `torque` and, where the fit uses the sample, `torque_model`; `residual_low` and
        `residual_high` [N*m] are of all k samples that the fit uses, so that no outlier is lost."""
        k = max(-(-len(self.time) // most), 1)
        low, high = self.range_of_residual(k)
        each = slice(None, None, k)
        motion = {"omega": self.motion[each]} if self.is_velocity else {"theta_deg": np.rad2deg(self.motion[each])}
        shown = {"time": self.time[each] - self.time[0], **motion, "torque": self.torque[each]}
        model = np.where(self.fitted[each], self.torque_model[each], np.nan)
        columns = {**shown, "torque_model": model, "residual_low": low, "residual_high": high}
        rounded = {name: pl.Series(values, dtype=pl.Float64).round_sig_figs(7) for name, values in columns.items()}
        return pl.DataFrame(rounded).fill_nan(None)

    def range_of_residual(self, k: int) -> tuple[Array, Array]:
        """Smallest and largest residual [N*m] of each k samples that the fit uses; NaN where it uses none."""
        return extremes(np.where(self.fitted, self.torque - self.torque_model, np.nan), k)


def extremes(values: Array, k: int) -> tuple[Array, Array]:
    """Smallest and largest of each k values (n,) that are not NaN; NaN where all are."""
    whole = np.concatenate([values, np.full(-len(values) % k, np.nan)]).reshape(-1, k)
    columns = np.ascontiguousarray(whole.T)  # along short rows NumPy reduces one by one
    return np.fmin.reduce(columns), np.fmax.reduce(columns)
