# SPDX-License-Identifier: Apache-2.0
"""What two clocks do to a fit of a bench: the torque's lag behind the angle goes on with time, and
the error of a clock that was fitted while the logs were joined."""

import numpy as np

from osl_analysis.base.errors import InputError
from osl_analysis.base.trial import Trial
from osl_analysis.bench.bench_settings import Calibration, ImpedanceAnalysis
from osl_analysis.bench.record import Record
from osl_analysis.bench.regression import GroupFit

LEAST_FRICTION = 1e-3  # of the torque's SD; what a sound calibration's friction is negative by


def check_friction(record: Record, fit: GroupFit) -> None:
    """Refuse a calibration whose friction certainly drives the motion, as none does: the lag of its
    torque is no delay, and no clock that drifts."""
    low, high = fit.interval("T_C")
    if high < -LEAST_FRICTION * np.std(record.filtered_torque):
        raise InputError(
            f"trial {record.name}: friction T_C = {fit['T_C']:.3g} N*m ({low:.3g} to {high:.3g})"
            " is certainly negative, as where the torque is late by what changes",
            "see that nothing slips or filters it, and record angle and torque by one device",
        )


class CalibrationOfTwoClocks(Calibration):
    """A calibration whose `delay` holds the error of a clock that was fitted, too, which tells
    nothing of what delays the torque itself."""

    is_stated: bool

    @property
    def tells_delay(self) -> bool:
        """Whether the delay was measured, too."""
        return self.is_stated


def with_clock_error(settings: ImpedanceAnalysis, trial: Trial) -> ImpedanceAnalysis:
    """Settings whose `calibration.delay` holds the standard error of the fit of a trial's second
    clock to the first, in the middle of the trial."""
    clock = trial.provenance.get("clock") or {}
    if clock.get("drift_error") is None:
        return settings
    error_s = clock["residual"] / np.sqrt(max(clock["edges"], 1))
    stated = settings.calibration
    with_clock = {**stated.model_dump(), "delay": np.hypot(stated.delay, error_s)}
    calibration = CalibrationOfTwoClocks(**with_clock, is_stated=stated.tells_delay)
    return settings.model_copy(update={"calibration": calibration})
