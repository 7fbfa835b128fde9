# SPDX-License-Identifier: Apache-2.0
"""Signals of a trial for the plots of the page: over time, and the admittance over frequency.

Each signal is rounded to steps that no pixel shows, and packed into the page (`Signals.packed`).
The modelled admittance is that of Eq. 15, 1 / (K + B s + I s^2) with s = 2 pi i f.

Example: `fit_signals(series, "Joint angle").packed()`.
"""

import math
import zlib
from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
import polars as pl

SIGNALS = ("time", "torque", "model", "residual", "motion")  # columns over time
# columns over frequency
RESPONSE = ("frequency", "magnitude", "low", "high", "phase", "model_magnitude", "model_phase")
ZLIB_LEVEL = 3  # a quarter of the time of the usual level 6, and 8 % more bytes
STEPS = 2000  # in the range of a signal: a step is half of a pixel of the plots
TIME_STEPS = 10**7  # in the range of the times, which must stay even when zoomed
CURVE_POINTS = 60  # of a model over frequency
MOST_DRAWN = 10_000  # samples of a trial


@dataclass(frozen=True)
class Signals:
    """The plotted signals of one trial."""

    table: pl.DataFrame  # some of `SIGNALS`, from the first sample on
    what: str  # a sentence that says what the signals are
    motion: str  # name of the moving part, and unit of its motion
    response: pl.DataFrame = field(default_factory=pl.DataFrame)  # columns of `RESPONSE`

    def packed(self) -> dict[str, Any]:
        """The signals as `page.html.j2` unpacks them.

        Each column is rounded to steps of its range, with -1 for a missing sample. The differences
        of successive steps are compressed.
        """
        columns = {}
        differences = []
        present = [name for name in SIGNALS if name in self.table.columns]
        for signal in self.table.select(pl.col(present).cast(pl.Float64).fill_nan(None)):
            low, high = cast(Any, signal.min()), cast(Any, signal.max())
            if low is None:
                continue
            step = (high - low) / (TIME_STEPS if signal.name == "time" else STEPS) or 1.0
            steps = ((signal - low) / step).round().fill_null(-1).to_numpy()
            differences.append(np.diff(steps, prepend=0).astype("<i4").tobytes())
            columns[signal.name] = [low, step]
        return {
            "columns": columns,
            "motion": self.motion,
            "packed": b64encode(zlib.compress(b"".join(differences), ZLIB_LEVEL)).decode(),
            "response": self.response.to_dict(as_series=False),
        }


FITTED = "Measured torque, the model where it is fitted, and their difference, the residual."
ISOLATED = (
    "The response to the perturbation, this crossing less the unperturbed gait, over the time from"
    " its onset; the model of its own fit, and the residual."
)


def fit_signals(series: pl.DataFrame, motion: str, what: str = FITTED) -> Signals:
    """Torque, model, residual and motion of a fit.

    Parameters
    ----------
    series : polars.DataFrame
        The table `series` of a bench trial, or rows of `walking_responses.csv`.
    motion : str
        Name of the moving part.
    what : str
        A sentence that says what the signals are.
    """
    motion_column = "omega" if "omega" in series.columns else "theta_deg"
    unit = "rad/s" if motion_column == "omega" else "deg"
    residual = pl.col("torque") - pl.col("torque_model")
    table = every_kth(series).select(
        "time", "torque", model="torque_model", residual=residual, motion=motion_column
    )
    return Signals(table, what, f"{motion} ({unit})")


def every_kth(samples: pl.DataFrame) -> pl.DataFrame:
    """Every k-th sample, with the smallest k that leaves `MOST_DRAWN` samples or fewer."""
    k = max(1, math.ceil(len(samples) / MOST_DRAWN))
    return samples.gather_every(k)


def recording_signals(samples: pl.DataFrame, motion: str) -> Signals:
    """Torque and angle of a recording without a fit; one that it does not have is left out."""
    columns = {"time": pl.col("time") - samples["time"][0]}
    if "torque" in samples.columns:
        columns["torque"] = "torque"
    if "theta" in samples.columns:
        columns["motion"] = pl.col("theta").degrees()
    return Signals(
        every_kth(samples).select(**columns), "Signals without a fit of their own.", motion
    )


def measured_response(response: pl.DataFrame, fit: Mapping[str, Any]) -> pl.DataFrame:
    """The measured admittance with its intervals, and that of Eq. 15.

    Eq. 15 has K, B and I of the fit to the whole trial. A stepped sine has the measured admittance
    at each amplitude.
    """
    single_amplitudes = response.drop_nulls("amplitude_deg")
    rows = response if single_amplitudes.is_empty() else single_amplitudes
    measured = rows.select(
        frequency="frequency_hz",
        magnitude="magnitude",
        low="magnitude_low",
        high="magnitude_high",
        phase="phase_deg",
    )
    measured_hz = measured["frequency"].to_numpy()
    hz = np.geomspace(measured_hz.min(), measured_hz.max(), CURVE_POINTS)
    s = 2j * np.pi * hz
    model = 1 / (fit["K"] + fit["B"] * s + fit["I"] * s**2)  # of Eq. 15 [rad/(N*m)]
    curve = pl.DataFrame(
        {
            "frequency": hz,
            "model_magnitude": np.abs(model),
            "model_phase": np.rad2deg(np.unwrap(np.angle(model))),
        }
    )
    both = pl.concat([measured, curve], how="diagonal_relaxed")
    return both.select(pl.col(pl.Float64).round_sig_figs(5))
