"""A stiffness that changes while any motion is recorded, as by warming up: Eq. 15 with a K that is linear in time.

A sweep shows each frequency at one time. A stiffness that falls meanwhile looks like inertia: K - I w^2 falls with w.
If K falls by 5 %, I of an ankle rises by half, thirty standard errors, and every other number of the fit looks sound.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.special import stdtrit

from osl_analysis.bench.excitation_lag import MOST, noise_behind
from osl_analysis.bench.moving_record import MovingRecord, eq15_columns
from osl_analysis.bench.phasor_lag import LITTLE_INERTIA
from osl_analysis.bench.stiffness_drift import CERTAIN, OF_DRIFT, UNTOLD
from osl_analysis.bench.torque_lag import ONLY_NOISE
from osl_analysis.errors import OslAnalysisError
from osl_analysis.stats.covariance import ResidualCorrelation
from osl_analysis.stats.fit_row import Row
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.trial import Array

KEPT = 4
"""Samples that are kept in half a period of the cut-off: 120 Hz at 15 Hz. The signals have nothing faster."""
SHOWS_S = 2.0
"""Time [s] over which the size and the frequency of a motion are taken."""
LEAST_MOTION = 0.1
"""Share of the RMS angle, below which a motion is too small to have a frequency."""
CERTAIN_BESIDE_MISFIT = 5.0
"""Standard errors from which a change counts where Eq. 15 does not explain the rest: they know little of friction."""
KeptColumns = Mapping[str, Array]
"""Columns (m,) of a fit by name."""


@dataclass(frozen=True)
class RecordDrift:
    """Change of the stiffness from the first to the last row that is fitted."""

    change: float
    """Change [N*m/rad] beyond what noise can make of a constant stiffness; 0 if it is no more."""
    inertia_share: float
    """Share of I that a certain change makes; 0 if none is certain."""


def record_drift(record: MovingRecord) -> RecordDrift | None:
    """The change of K; None where it cannot be told from noise, or from the way in which K depends on the motion.

    A joint that Eq. 15 with a changing K explains, but for noise or for the better part of the rest, has the
    change of that fit. The stiffness of any other one depends on the frequency and the size of its motion. A change
    counts there only beyond what these explain. A single sweep has nothing beyond: its frequency is its time.
    """
    columns, torque = thinned(record)
    residuals = ResidualCorrelation(every=KEPT)
    try:
        plain, changing = (linear_fit(torque, columns | more, residuals) for more in ({}, in_time(columns)))
        explains = left(changing) < max(ONLY_NOISE * noise_behind(record, record.low_pass), MOST * left(plain))
        if not explains:
            more = in_time(columns) | beside_motion(record, columns)
            changing = linear_fit(torque, columns | more, residuals)
    except OslAnalysisError:
        return None
    dof = float(changing.degrees_of_freedom[changing.names.index("K_1")])
    errors = max(float(stdtrit(dof, CERTAIN)), 0.0 if explains else CERTAIN_BESIDE_MISFIT)
    change, noise = changing["K_1"], errors * changing.se("K_1")
    taken = linear_fit(in_time(columns)["K_1"], columns, residuals)["I"] / float(np.hypot(plain["I"], LITTLE_INERTIA))
    if abs(change) > noise:
        return RecordDrift(float(np.sign(change)) * (abs(change) - noise), abs(taken * change))
    return None if abs(taken) * noise > UNTOLD else RecordDrift(0.0, 0.0)


def left(fit: LinearFit) -> float:
    """RMS [N*m] of what a fit leaves."""
    return float(np.std(fit.residual))


def every(record: MovingRecord) -> int:
    """Rows of the record of which one is kept."""
    return max(record.low_pass.independent_samples(record.rate_hz) // KEPT, 1)


def thinned(record: MovingRecord) -> tuple[dict[str, Array], Array]:
    """The columns (m,) of Eq. 15 with offset and drift in the kept rows, and the filtered torque (m,) [N*m] there."""
    step = every(record)
    columns = {name: record.part(column)[::step] for name, column in eq15_columns(record).items()}
    columns["drift"] = columns["drift"] - columns["drift"].mean()
    return columns, record.part(record.filtered_torque)[::step]


def in_time(columns: KeptColumns) -> dict[str, Array]:
    """The column of K's change from the first kept row to the last: the angle times the time's share, from its mean."""
    time = columns["drift"]
    return {"K_1": columns["K"] * time / np.ptp(time)}


def beside_motion(record: MovingRecord, columns: KeptColumns) -> dict[str, Array]:
    """The columns of a K that depends on the size, and on the frequency, of the motion within seconds around a row."""
    step = every(record)
    rows, theta = record.rows[::step], record.motion.theta[::step]
    omega = record.motion.omega[::step]
    length = max(round(SHOWS_S * record.rate_hz / step), 1)
    angle, velocity = (
        np.sqrt(np.maximum(uniform_filter1d(x**2, length), 0.0))[np.minimum(rows // step, len(x) - 1)]
        for x in (theta - columns["K"].mean(), omega)
    )
    frequency = velocity / np.maximum(angle, LEAST_MOTION * np.std(columns["K"]))
    return {name: columns["K"] * (x - x.mean()) for name, x in (("K_size", angle), ("K_frequency", frequency))}


def record_drift_row(record: MovingRecord, fit: LinearFit) -> Row:
    """`K_drift`, the change as a share of K, and `drift_inertia_share`, the share of I that a certain change makes.

    Null where it cannot be told. `fit` is that of Eq. 15.
    """
    found = record_drift(record)
    if found is None:
        return dict.fromkeys(OF_DRIFT)
    return {"K_drift": found.change / fit["K"], "drift_inertia_share": found.inertia_share}
