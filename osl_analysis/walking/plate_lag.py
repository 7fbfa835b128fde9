# SPDX-License-Identifier: Apache-2.0
"""Step 3, plate lag: the lag of the plate behind the markers in each crossing.

The platform turns back after each step with nobody on it, so that each crossing shows its own lag.
The lag of a turn at time t is a + b [in a crossing] + c t. c is the drift of two clocks that run
apart. b and the scatter of crossings count as far as they exceed noise (James and Stein, 1961).

Example: `timing_of(crossings, model, settings).lags["walk_1"]` [s].
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.base.errors import InputError
from osl_analysis.base.trial import Array, Trial
from osl_analysis.stats.repeats import scatter_beyond_noise
from osl_analysis.walking import platform
from osl_analysis.walking import poses as rigid
from osl_analysis.walking.plate import only_stance, zeroed_wrench
from osl_analysis.walking.plate_inertia import (
    CERTAIN_SES,
    LAG_ROUNDING,
    PlateModel,
    TurnLag,
    UnloadedMotion,
    UnloadedRecording,
    resting_noise,
    turn_lags,
    whole_recording,
    without_mean,
)
from osl_analysis.walking.poses import Mask, StaticCalibration
from osl_analysis.walking.walking_settings import CrossingSettings

# When a lag of the crossings replaces that of the unloaded plate.
UNLOADED_SPARE_S = 0.03  # from a stance to the frames in which nobody stands on the plate
LARGEST_MASS_KG = 1.0  # of a plate that is light or compensates its own inertia


@dataclass(frozen=True)
class PlateTiming:
    """The plate's lag in each crossing; all None or empty where it is not known."""

    onsets: dict[str, float]  # of perturbations [s], by trial
    lags: dict[str, float]  # of perturbed crossings [s], by trial
    lag: float | None = None  # of the other crossings [s]
    se: float | None = None  # standard error [s] of the mean of `lags`
    # [s] by which the crossings are later than the unloaded plate, beyond the uncertainty of both
    change: float | None = None
    scatter: float | None = None  # [s] from recording to recording, beyond noise
    drift: float | None = None  # change per time within a recording, beyond noise
    onset_se: float = 0.0  # standard error [s] that all onsets share


def timing_of(
    crossings: Sequence[tuple[Trial, StaticCalibration]],
    model: PlateModel,
    settings: CrossingSettings,
) -> PlateTiming:
    """Find onsets and lags of the perturbed crossings.

    A crossing whose ramp or stance cannot be followed has none; its analysis says why.

    Raises
    ------
    InputError
        The plate has a mass, and no model.
    """
    markers = settings.markers.platform
    ramps = {}
    parts = {}
    for trial, calibration in crossings:
        with suppress(InputError):
            time, poses = rigid.segment_poses(trial, markers, calibration, settings)
            ramp = platform.ramp_of(time, poses, settings.smallest_turn)
            if ramp is not None:
                ramps[trial.name] = ramp
            recordings = [
                whole_recording(trial, calibration, time, poses, poses.seen() & rows, settings)
                for rows in without_load(trial, time, model.lag or 0.0, settings)
            ]
            parts[trial.name] = unloaded_parts([part for part in recordings if part is not None])
    if not model.directions.size:
        check_no_mass([part for parts_of_trial in parts.values() for part in parts_of_trial])
    turns = {
        name: turns_without_load(parts_of_trial, model) for name, parts_of_trial in parts.items()
    }
    onsets, onset_se = platform.ramp_onsets(ramps)
    return replace(plate_timing(model, turns, onsets), onset_se=onset_se)


def without_load(
    trial: Trial, frames: Array, lag: float, settings: CrossingSettings
) -> tuple[Mask, Mask]:
    """The frames of a crossing before heel strike, and those after toe-off.

    Raises
    ------
    InputError
        The recording is not one crossing, or its plate cannot be used.
    """
    force = zeroed_wrench(trial, frames, settings)(lag)[:, 2]
    stance = only_stance(frames, force, settings)
    return (
        frames < stance.heel_strike - UNLOADED_SPARE_S,
        frames > stance.toe_off + UNLOADED_SPARE_S,
    )


def unloaded_parts(parts: Sequence[UnloadedRecording]) -> list[UnloadedMotion]:
    """The motion of the parts of a crossing, along the directions that they share."""
    if not parts:
        return []
    axes = platform.moving_directions([part.track for part in parts])
    return [part.along(axes) for part in parts]


def turns_without_load(parts: Sequence[UnloadedMotion], model: PlateModel) -> list[TurnLag]:
    """The lag in each turn of a crossing's parts."""
    turns = []
    noise = [resting_noise(part, model) for part in parts]
    for part in parts:
        turns += turn_lags(part, model, np.concatenate(noise)) or []
    return turns


def check_no_mass(parts: Sequence[UnloadedMotion]) -> None:
    """Refuse a plate without a model whose force follows the acceleration of its centre."""
    product = 0.0
    square = 0.0
    for part in parts:
        if part.moves.any():
            acceleration = without_mean(part.columns[part.moves, :3, 0])
            product += np.sum(acceleration * without_mean(part.wrench_at(0.0)[part.moves, :3]))
            square += np.sum(acceleration**2)
    mass = product / square if square else 0.0
    if mass > LARGEST_MASS_KG:
        raise InputError(
            f"the unloaded plate's force follows its acceleration with {mass:.1f} kg, expected"
            f" {LARGEST_MASS_KG:g} kg or less with `walking.plate_inertia: none`",
            "record the platform turning unloaded (`plate`), and state `plate_inertia: identified`",
        )


def scattered_fit(X: Array, y: Array, ses: Array) -> tuple[Array, Array, float]:
    """Coefficients (p,), their covariance (p, p), 0 of a column that is 0, and the scatter of y
    (n,) beyond its standard errors (n,), with which it is weighted."""
    scatter = 0.0
    for _ in range(2):
        weights = 1 / (ses**2 + scatter**2)
        covariance = np.asarray(np.linalg.pinv(X.T * weights @ X, hermitian=True), float)
        estimates = covariance @ X.T @ (weights * y)
        scatter = scatter_beyond_noise(y - X @ estimates, ses) or 0.0
    return estimates, covariance, scatter


def certain_part(estimates: Array, covariance: Array) -> Array:
    """Estimates (p,) less `CERTAIN_SES` standard errors; 0 within them."""
    least = np.abs(estimates) - CERTAIN_SES * np.sqrt(np.diag(covariance))
    return np.sign(estimates) * np.maximum(least, 0.0)


def plate_timing(
    model: PlateModel, crossings: Mapping[str, Sequence[TurnLag]], onsets: dict[str, float]
) -> PlateTiming:
    """Find the lag of each crossing from the turns of all recordings.

    Notes
    -----
    The lag of a turn at the time t is a + b [in a crossing] + c t. c counts where it is certain. b
    and what a crossing's own turns leave count as far as they exceed noise (shrinkage, James and
    Stein, 1961), and `se` holds what is left out of b: the lag's errors are within 1.96 `se` in 92
    to 98 % of draws for any b. A lag that takes b for 0 until it is certain was 2 ms off unnoticed.
    """
    crossing_turns = [turn for name in onsets for turn in crossings.get(name, ())]
    turns = [*model.turns, *crossing_turns]
    if model.lag is None:
        return PlateTiming(onsets, {})
    is_crossing = np.arange(len(turns)) >= len(model.turns)
    time, lag, se = np.transpose([(turn.time, turn.lag, turn.se) for turn in turns])
    middle = time.mean()
    X = np.column_stack([np.ones_like(time), is_crossing, time - middle])
    drift = certain_part(*scattered_fit(X, lag, se)[:2])[2]
    if drift == 0:  # it is not certain, and its column is taken out
        X[:, 2] = 0.0
    estimates, covariance, scatter = scattered_fit(X, lag, se)
    _, change, drift = certain_part(estimates, covariance)
    unexplained = lag - X @ estimates
    shares = scatter**2 / (scatter**2 + se**2)
    own_lag = {turn.trial: shares[k] * unexplained[k] for k, turn in enumerate(turns)}

    square_of_b = max(estimates[1] ** 2, covariance[1, 1] + LAG_ROUNDING**2)
    left_out = covariance[1] * estimates[1] / square_of_b
    estimates = estimates - left_out
    at_onset = np.array([1.0, 1.0, np.mean([*onsets.values()] or middle) - middle])
    return PlateTiming(
        onsets,
        {
            name: float(estimates @ [1.0, 1.0, onset - middle] + own_lag.get(name, 0.0))
            for name, onset in onsets.items()
        },
        lag=float(at_onset @ estimates),
        se=float(np.hypot(np.sqrt(at_onset @ covariance @ at_onset), at_onset @ left_out)),
        change=float(change) if crossing_turns else None,
        scatter=scatter if len(turns) > 1 else None,
        drift=float(drift),
    )
