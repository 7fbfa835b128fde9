"""The tables of a fit: measured and modelled signals over time, the time base, and how a user gets
at them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.dictionary import table_of
from osl_analysis.signals.grid import UniformSignals
from osl_analysis.trial import Array

MOST_SHOWN = 10_000  # rows of a series; two minutes of a stepped sine have 15 per fastest period


@dataclass(frozen=True)
class Series:
    """Measured and modelled signals of one trial, shape (n,) each."""

    time: Array  # time [s]
    torque: Array  # measured torque, as it was fitted [N*m]
    torque_model: Array  # torque of the fitted model [N*m]; NaN where it does not apply
    motion: Array  # angle [rad], or velocity [rad/s] where the bench has no angle
    fitted: NDArray[np.bool_]  # rows that are fitted
    is_velocity: bool = False  # whether `motion` is a velocity

    def table(self, most: int = MOST_SHOWN) -> pl.DataFrame:
        """Every k-th sample, at most `most` rows.

        `torque_model` is null where the fit does not use the sample. `residual_low` and
        `residual_high` [N*m] are the range over the next k samples that it uses, so that no outlier
        is lost.
        """
        k = max(-(-len(self.time) // most), 1)
        modelled = np.where(self.fitted, self.torque_model, np.nan)
        motion = {"theta_deg": np.rad2deg(self.motion)}
        if self.is_velocity:
            motion = {"omega": self.motion}
        samples = pl.DataFrame(
            {
                "part": np.arange(len(self.time)) // k,
                "time": self.time - self.time[0],
                **motion,
                "torque": self.torque,
                "torque_model": modelled,
                "residual": self.torque - modelled,
            }
        ).fill_nan(None)
        parts = samples.group_by("part", maintain_order=True).agg(
            pl.exclude("residual").first(),
            residual_low=pl.col("residual").min(),
            residual_high=pl.col("residual").max(),
        )
        return parts.select(pl.exclude("part").round_sig_figs(7))


@dataclass(frozen=True)
class FitTables:
    """The tables of one fit by name. A user who asks for the estimates alone does not wait for the
    others."""

    estimates: Mapping[str, pl.DataFrame]
    """Estimates and curves; and `torque`, the fitted samples: time [s] from the first, measured and
    modelled torque [N*m]."""
    series: Series | None = None  # of a fit that is drawn over time
    compute_others: Callable[[], Mapping[str, pl.DataFrame]] = dict

    def everything(self) -> dict[str, pl.DataFrame]:
        """All tables: `estimates`, the thinned `series`, and the others, which are computed now."""
        of_series = {"series": self.series.table()} if self.series else {}
        return {**self.estimates, **of_series, **self.compute_others()}


def tables_of_fit(
    series: Series,
    compute_others: Callable[[], Mapping[str, pl.DataFrame]],
    **estimates: pl.DataFrame,
) -> FitTables:
    """`FitTables` of the series of a fit, its other tables, and its estimates by name."""
    modelled = series.torque_model
    samples = pl.DataFrame({"time": series.time, "torque": series.torque, "torque_model": modelled})
    fitted = samples.filter(np.isfinite(modelled))
    fitted = fitted.with_columns(pl.col("time") - pl.col("time").first())
    return FitTables({**estimates, "torque": fitted}, series, compute_others)


def timebase_table(signals: UniformSignals | None) -> pl.DataFrame:
    """The trial's rows of `timebase.csv`, one per stream; none where no grid was needed."""
    rows = []
    if signals is not None:
        rows = [{"trial": signals.trial, **stream} for stream in signals.streams]
    return table_of(rows, "timebase")
