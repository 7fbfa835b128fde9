"""The plate's model from plate trials (unloaded platform): its inertia, and its lag behind the markers."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.ankle import Calibrations, calibration_of
from osl_analysis.walking.plate_faults import check_type_on_platform
from osl_analysis.walking.plate_inertia import COMPONENTS, PARAMETERS, PlateInertia, identify_plate_inertia
from osl_analysis.walking.plate_lag import plate_lag
from osl_analysis.walking.platform_motion import shared_directions
from osl_analysis.walking.settings import PlateModelSettings
from osl_analysis.walking.unloaded_plate import UnloadedRecording, unloaded_recording

NOT_ASKED = "not estimated: correct_plate_lag is false"
TOO_LIGHT = "the unloaded plate is too light to show it"
NOT_REMOVED = "walking.plate_inertia is none"


@dataclass(frozen=True)
class PlateModel:
    """The plate's inertia and lag.

    inertia: inertial parameters.
    lag: lag [s] behind the markers, the mean of `lags`; None where it is unknown, and then not corrected.
    lag_se: standard error [s] of the lag; None with fewer than two lags.
    lags: lags (k,) [s] of the trials that show one.
    leave_one_out: the model without each trial in turn, for the jackknife; empty with a single trial.
    lag_reason: why the lag is unknown.
    """

    inertia: PlateInertia
    lag: float | None
    lag_se: float | None
    lags: Array
    leave_one_out: "tuple[PlateModel, ...]" = ()
    lag_reason: str | None = None

    @property
    def delay(self) -> float:
        """The lag [s] that is corrected: 0 where it is unknown."""
        return 0.0 if self.lag is None else self.lag


NO_CORRECTION = PlateModel(
    PlateInertia(*(np.zeros(len(PARAMETERS)),) * 2, *(np.full(len(COMPONENTS), np.nan),) * 2),
    None,
    None,
    np.zeros(0),
    lag_reason=f"not estimated: {NOT_REMOVED}",
)
"""The model of a plate that is light or compensates its own inertia: nothing is removed from its wrench."""


def identify_plate_model(
    trials: Sequence[Trial], calibrations: Calibrations, settings: PlateModelSettings
) -> PlateModel:
    """Lag and inertia from unloaded trials: first the lag of each trial, then one inertia from all at the mean lag.

    Raises
    ------
    InputError
        There are no trials, a foot is on the plate, or the platform did not move or was hidden while it moved.
    """
    if not trials:
        raise InputError("no trials of the unloaded plate; add trials of experiment 'plate' to the sheet")
    for trial in trials:
        check_type_on_platform(trial, settings.plate)
    seen = usable([unloaded_recording(t, calibration_of(calibrations, t.name), settings) for t in trials])
    recordings = along_shared_directions(seen)
    lags = [trial_lag(r) if settings.correct_plate_lag else float("nan") for r in recordings]
    reason = NOT_ASKED if not settings.correct_plate_lag else None if np.isfinite(lags).any() else TOO_LIGHT
    model, every = replace(plate_model(recordings, lags), lag_reason=reason), range(len(recordings))
    if len(recordings) == 1:
        return model
    others = [[i for i in every if i != one] for one in every]
    leave_one_out = [
        plate_model(along_shared_directions([seen[i] for i in kept]), [lags[i] for i in kept], model.inertia)
        for kept in others
    ]
    return with_jackknife(replace(model, leave_one_out=tuple(leave_one_out)))


def along_shared_directions(recordings: Sequence[UnloadedRecording]) -> list[UnloadedRecording]:
    """The recordings with their motions along the directions that they share."""
    axes = shared_directions([r.track for r in recordings])
    return [r.along(own) for r, own in zip(recordings, axes, strict=True)]


def with_jackknife(model: PlateModel) -> PlateModel:
    """The model whose standard errors are no smaller than those of the jackknife over its trials.

    The regression's are blind to what all samples of a trial share: the directions of the motion, and bridged gaps.
    """
    left = np.array([other.inertia.parameters for other in model.leave_one_out])
    jackknife = np.sqrt((len(left) - 1) / len(left) * np.sum((left - left.mean(axis=0)) ** 2, axis=0))
    errors = np.maximum(model.inertia.standard_errors, jackknife)
    return replace(model, inertia=replace(model.inertia, standard_errors=errors))


def plate_model(
    recordings: Sequence[UnloadedRecording], lags: Sequence[float], whole: PlateInertia | None = None
) -> PlateModel:
    """The mean of the recordings' lags [s], and one inertia from all recordings at that lag.

    A lag is NaN if its recording shows none. `whole` is the inertia from more recordings: only what they identified is
    identified, and what these recordings do not show stays as it is there.
    """
    known = np.array([lag for lag in lags if np.isfinite(lag)])
    lag = float(np.mean(known)) if len(known) else None
    pairs, noise = (
        [(r.motion, r.wrench_at(lag or 0.0)) for r in recordings],
        np.sum([r.noise for r in recordings], axis=0),
    )
    limits = (None, noise, None) if whole is None else (whole.identified, noise, whole.parameters)
    inertia = identify_plate_inertia(pairs, recordings[0].smooth, *limits)
    error = float(np.std(known, ddof=1) / np.sqrt(len(known))) if len(known) > 1 else None
    return PlateModel(inertia, lag, error, known)


def usable(recordings: Sequence[UnloadedRecording]) -> list[UnloadedRecording]:
    """The recordings that show a whole motion of the platform. A warning names each of the others.

    Raises
    ------
    InputError
        There is no such recording.
    """
    bad = [r for r in recordings if r.unusable]
    if len(bad) == len(recordings):
        raise InputError(
            f"no unloaded trial shows the plate's inertia; trial {bad[0].name}, as others: {bad[0].unusable}"
        )
    for r in bad:
        warnings.warn(f"trial {r.name}: excluded from the plate's model: {r.unusable}", stacklevel=2)
    return [r for r in recordings if not r.unusable]


def trial_lag(recording: UnloadedRecording) -> float:
    """Lag [s] of the plate in one trial; NaN if the plate is too light to show it."""
    try:
        return plate_lag(recording.motion, recording.wrench_at, recording.smooth)
    except InputError as error:
        raise InputError(f"trial {recording.name}: {error}") from error


def plate_table(model: PlateModel) -> pl.DataFrame:
    """`plate.csv`: RMS [N, N*m] of each component before and after the plate's own wrench is removed, and the lag
    [s]."""
    before, after = model.inertia.rms_before, model.inertia.rms_after
    remaining = [100 * a / b if b > 0 else None for b, a in zip(before.tolist(), after.tolist(), strict=True)]
    rows = {"component": COMPONENTS, "rms_before": before, "rms_after": after, "left_percent": remaining}
    lag = {"lag_s": model.lag, "lag_se_s": model.lag_se, "lag_unknown": model.lag_reason, "trials": len(model.lags)}
    return pl.DataFrame(rows).with_columns(**{name: pl.lit(value) for name, value in lag.items()})
