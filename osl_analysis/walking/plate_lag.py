"""Step 3, plate lag: how late the plate is in each crossing.

The platform turns back after each step, and then nobody stands on it: each crossing shows its own
lag. Together with those of the unloaded recordings they tell whether one lag holds for all, whether
it changes from recording to recording, and whether it grows within one: two clocks that run apart.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.signals import longest_run, sampling_rate
from osl_analysis.stats.repeats import scatter_beyond_noise
from osl_analysis.trial import Trial
from osl_analysis.walking import platform
from osl_analysis.walking import poses as rigid
from osl_analysis.walking.plate import (
    only_stance,
    recorded_corners,
    recorded_wrench,
    wrench_reader,
    zeroed_wrench,
)
from osl_analysis.walking.plate_inertia import (
    PlateModel,
    TurnLag,
    UnloadedMotion,
    UnloadedRecording,
    mean_lag,
    resting_noise,
    turn_lags,
    without_mean,
)
from osl_analysis.walking.poses import StaticCalibration
from osl_analysis.walking.walking_settings import CrossingSettings


class LagLimits:
    """When a lag of the crossings replaces that of the unloaded plate."""

    SPARE_S = 0.03  # from a stance to the frames in which nobody stands on the plate
    SHORTEST_S = 0.4  # of these frames, for the low-pass of the identification
    CERTAIN_SES = 3.0  # standard errors beyond which two lags differ
    LARGEST_MASS_KG = 1.0  # of a plate that is light or compensates its own inertia
    LEAST_SE_S = 1e-6  # of a lag: rounding
    LEAST_SQUARE = 1e-12  # of a drift's normal equation: nothing is known


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


def timing_of(
    crossings: Sequence[tuple[Trial, StaticCalibration]],
    model: PlateModel,
    settings: CrossingSettings,
) -> PlateTiming:
    """Find onsets and lags of the perturbed crossings.

    One whose ramp or stance cannot be followed has none; its own analysis says why.

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
            parts[trial.name] = parts_without_load(trial, calibration, model.lag or 0.0, settings)
    if not model.directions.size:
        check_no_mass([part for of_trial in parts.values() for part in of_trial])
    turns = {name: turns_without_load(of_trial, model) for name, of_trial in parts.items()}
    return plate_timing(model, turns, platform.ramp_onsets(ramps))


def parts_without_load(
    trial: Trial, calibration: StaticCalibration, lag: float, settings: CrossingSettings
) -> list[UnloadedMotion]:
    """A crossing before heel strike and after toe-off, cut before any filter.

    Raises
    ------
    InputError
        The recording is not one crossing, or its plate or markers cannot be used.
    """
    frames, poses = rigid.segment_poses(trial, settings.markers.platform, calibration, settings)
    force = zeroed_wrench(trial, frames, settings)(lag)[:, 2]
    stance = only_stance(frames, force, settings)
    time, wrench = recorded_wrench(trial, settings.plate)
    centre = recorded_corners(trial, settings.plate).mean(axis=0)
    parts: list[UnloadedRecording] = []
    for free in (
        frames < stance.heel_strike - LagLimits.SPARE_S,
        frames > stance.toe_off + LagLimits.SPARE_S,
    ):
        rows = longest_run(free & poses.seen())
        if rows.stop - rows.start < LagLimits.SHORTEST_S * sampling_rate(frames):
            continue
        track = platform.platform_track(
            trial.name, frames[rows], poses[rows], calibration, settings
        )
        inside = (time >= track.time[0]) & (time <= track.time[-1])
        read = wrench_reader(time[inside], wrench[inside], track.time)
        parts.append(UnloadedRecording(track, centre, read, settings.plate_low_pass))
    if not parts:
        return []
    axes = platform.moving_directions([part.track for part in parts])
    return [part.along(axes) for part in parts]


def turns_without_load(parts: Sequence[UnloadedMotion], model: PlateModel) -> list[TurnLag]:
    """The lag in each turn of a crossing's parts, with the noise of the longest rest."""
    if not parts:
        return []
    noise = max((resting_noise(part, model) for part in parts), key=len)
    turns = []
    for part in parts:
        turns += (turn_lags(part, model, noise) or []) if len(noise) else []
    return turns


def check_no_mass(parts: Sequence[UnloadedMotion]) -> None:
    """Refuse a plate without a model whose force follows the acceleration of its centre."""
    product = square = 0.0
    for part in parts:
        acceleration = without_mean(part.columns[part.moves, :3, 0])
        product += np.sum(acceleration * without_mean(part.wrench_at(0.0)[part.moves, :3]))
        square += np.sum(acceleration**2)
    mass = product / square if square else 0.0
    if mass > LagLimits.LARGEST_MASS_KG:
        raise InputError(
            f"the unloaded plate's force follows its acceleration with {mass:.1f} kg, expected"
            f" {LagLimits.LARGEST_MASS_KG:g} kg or less with `walking.plate_inertia: none`; record"
            " the platform turning unloaded (`plate`), and state `plate_inertia: identified`"
        )


def drift_of(turns: Sequence[TurnLag]) -> tuple[float, float]:
    """Change of the lag per time within recordings, and its standard error."""
    product, square = 0.0, LagLimits.LEAST_SQUARE
    for trial in dict.fromkeys(turn.trial for turn in turns):
        of_trial = [turn for turn in turns if turn.trial == trial]
        time, lag, se = np.transpose([(turn.time, turn.lag, turn.se) for turn in of_trial])
        weights = 1 / np.maximum(se, LagLimits.LEAST_SE_S) ** 2
        since = time - np.average(time, weights=weights)
        product += np.sum(weights * since * lag)
        square += np.sum(weights * since**2)
    return product / square, 1 / np.sqrt(square)


def certain(value: float, se: float) -> float:
    """What is left of a value without two standard errors; 0 within `CERTAIN_SES`."""
    return float(np.copysign(abs(value) - 2 * se, value)) * (
        abs(value) > LagLimits.CERTAIN_SES * se
    )


def plate_timing(
    model: PlateModel, crossings: Mapping[str, Sequence[TurnLag]], onsets: Mapping[str, float]
) -> PlateTiming:
    """Find the lag of each crossing from its own turns, the others' and the unloaded plate's.

    A lag that grows within recordings grows in all alike. The mean of the crossings counts where it
    is not that of the unloaded plate, and each one's own as far as they scatter beyond noise.
    """
    if model.lag is None or model.lag_se is None:
        return PlateTiming(dict(onsets), {})
    own = {name: list(turns) for name, turns in crossings.items() if turns and name in onsets}
    every = [turn for turns in own.values() for turn in turns]
    drift, drift_se = drift_of([*model.turns, *every])
    certain_drift = certain(drift, drift_se)
    drift *= certain_drift != 0
    weights = [turn.weight for turn in model.turns]
    middle = np.average([turn.time for turn in model.turns], weights=weights)

    lag, se = model.lag, model.lag_se
    scatter, change = model.lag_scatter, None
    lags = dict.fromkeys(onsets, lag)
    if len(own) > 1:
        values, ses = np.transpose([mean_lag(turns) for turns in own.values()])
        times = [np.mean([turn.time for turn in turns]) for turns in own.values()]
        values = values - drift * (np.array(times) - middle)
        spread = scatter_beyond_noise(values, ses) or 0.0
        scatter = max(scatter or 0.0, spread)
        se_of_own = np.sqrt(max(np.var(values, ddof=1), np.mean(ses**2)) / len(values))
        change = certain(values.mean() - lag, np.hypot(se, se_of_own))
        if change:
            lag, se = float(values.mean()), float(se_of_own)
        shares = spread**2 / (spread**2 + ses**2 + LagLimits.LEAST_SE_S**2)
        lags = dict.fromkeys(onsets, lag) | dict(
            zip(own, lag + shares * (values - lag), strict=True)
        )
    since = {name: onset - middle for name, onset in onsets.items()}
    return PlateTiming(
        dict(onsets),
        {name: float(value + drift * since[name]) for name, value in lags.items()},
        lag=lag + drift * float(np.mean(list(since.values()) or 0.0)),
        se=se,
        change=change,
        scatter=scatter,
        drift=certain_drift,
    )
