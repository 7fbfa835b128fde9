"""A trial of the gait laboratory: simulate it, record it as Vicon and the leg would, write the truth beside."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from osl_analysis.config.parameters import DrivetrainParameters
from osl_analysis.errors import InputError
from osl_analysis.simulator.bench import drivetrain_effects
from osl_analysis.simulator.crossing import (
    SimulatedCrossing,
    crossing_curves,
    platform_curves,
    rendered_impedance,
    simulate_crossing,
)
from osl_analysis.simulator.mcap_writer import LEG, write_mcap
from osl_analysis.simulator.plan import Condition, condition_of
from osl_analysis.simulator.plate import plate_load
from osl_analysis.simulator.platform import PlatformMotion, nominal_ankle, resting_platform, unloaded_platform
from osl_analysis.simulator.recorder import rounded_to, write_curves, write_truth
from osl_analysis.simulator.rigid_body import GRAVITY, Pose, TrueWrench, interpolated_at
from osl_analysis.simulator.settings import SimulationSettings, stream
from osl_analysis.simulator.step import draw_step
from osl_analysis.simulator.vicon import (
    ANKLE_AXIS,
    Scene,
    Session,
    draw_sync,
    leg_markers,
    on_body,
    platform_markers,
    vicon_recording,
    write_c3d,
)
from osl_analysis.simulator.walking_settings import WalkingSettings
from osl_analysis.trial import Array


@dataclass(frozen=True)
class LegClock:
    """The leg's clock: its time [s] is offset [s] + (1 + drift) * Vicon's time [s]."""

    offset: float
    drift: float


def draw_clock(trial: str, seed: int, walking: WalkingSettings) -> LegClock:
    """The leg's clock in one trial. Its offset is drawn evenly from 0.5 to 1.5 times its mean."""
    effects = walking.effects
    offset = effects.leg_clock_offset.value * stream(seed, trial, "leg_clock_offset").uniform(0.5, 1.5)
    drift = 1e-6 * effects.leg_clock_drift.value * stream(seed, trial, "leg_clock_drift").standard_normal()
    return LegClock(float(offset), float(drift))


def leg_columns(
    trial: str, crossing: SimulatedCrossing, time: Array, settings: SimulationSettings, walking: WalkingSettings
) -> dict[str, Array]:
    """What the leg logs at times [s] of Vicon's clock, shape (n,) each, in the fields of its message. Gains and current
    are held from one update of the controller to the next."""
    rates, effects, seed = walking.rates, settings.effects, settings.seed
    encoder = walking.effects.leg_joint_encoder
    resolution = 2 * np.pi / 2**encoder.size if encoder.enabled else 0.0
    held = np.floor(time * rates.controller_hz).astype(int)
    ripple = effects.current_noise.value * stream(seed, trial, "current_noise").standard_normal(len(time))
    theta_m = interpolated_at(crossing.drivetrain.theta_m, rates.controller_hz, time)
    return {
        "joint_angle": rounded_to(interpolated_at(crossing.motion.theta, rates.motion_hz, time), resolution),
        "actuator_angle": rounded_to(theta_m, effects.actuator_encoder.value),
        "motor_current": rounded_to(crossing.drivetrain.current[held] + ripple, effects.current_quantisation.value),
        "stiffness_gain": crossing.commands.K_1[held],
        "damping_gain": crossing.commands.B_1[held],
        "sync": draw_sync(trial, seed, walking.gait.recording_s).level(time),
    }


def write_leg_log(
    path: Path, trial: str, crossing: SimulatedCrossing, settings: SimulationSettings, walking: WalkingSettings
) -> LegClock:
    """Write the leg's log, sampled at whole periods of its own clock. Return this clock, for the truth."""
    clock, rate = draw_clock(trial, settings.seed, walking), walking.rates.leg_hz
    first, last = (clock.offset + (1 + clock.drift) * crossing.time[[0, -1]]) * rate
    # the margin excludes a period that rounding put before the first sample or after the last
    leg_time = np.arange(np.ceil(first + 1e-6), np.floor(last - 1e-6) + 1) / rate
    time = (leg_time - clock.offset) / (1 + clock.drift)
    write_mcap(path, LEG, leg_time, leg_columns(trial, crossing, time, settings, walking))
    return clock


@dataclass(frozen=True)
class GaitLaboratory:
    """Settings and raw folder of a campaign, the same for all its trials."""

    settings: SimulationSettings
    walking: WalkingSettings
    folder: Path


def simulate_walking_trial(
    row: Mapping[str, object],
    settings: SimulationSettings,
    walking: WalkingSettings,
    p: DrivetrainParameters,
    folder: Path,
) -> None:
    """Simulate one row of the sample sheet, of experiment walking, plate or static, into a campaign's raw folder.

    Writes the truth first, so that every log has a truth. Then writes `vicon/<trial>.c3d` and, for a walking trial,
    `leg/<trial>.mcap`.
    """
    trial, laboratory = str(row["trial"]), GaitLaboratory(settings, walking, folder)
    if row["experiment"] == "walking":
        record_crossing(row, laboratory, p)
    elif row["experiment"] == "plate":
        record_unloaded(row, laboratory)
    elif row["experiment"] == "static":
        record_standing(row, laboratory)
    else:
        raise InputError(
            f"trial {trial}: experiment '{row['experiment']}' is not one of the gait laboratory; "
            "use walking, plate or static"
        )


def motion_grid(walking: WalkingSettings) -> Array:
    """Times [s] of the motion: whole marker frames, at the motion's rate."""
    rates = walking.rates
    frames = round(walking.gait.recording_s * rates.points_hz)
    return np.arange(frames * (rates.motion_hz // rates.points_hz)) / rates.motion_hz


def record_crossing(row: Mapping[str, object], laboratory: GaitLaboratory, p: DrivetrainParameters) -> None:
    """Record a crossing. It is also simulated without the perturbation: the truth contains the effect of the
    perturbation. The controller compensates unless the row's controller is 'uncompensated'."""
    settings, walking = laboratory.settings, laboratory.walking
    trial, time, condition = str(row["trial"]), motion_grid(walking), condition_of(row, settings)
    step, perturbed = draw_step(trial, settings.seed, time, walking, condition), condition.perturbed
    compensates, effects = str(row.get("controller")) != "uncompensated", drivetrain_effects(settings)
    unperturbed = simulate_crossing(time, step, False, compensates, walking, effects, p)
    walked = simulate_crossing(time, step, True, compensates, walking, effects, p) if perturbed else unperturbed
    write_curves(laboratory.folder, trial, crossing_curves(walked, unperturbed, walking), walking.rates.analog_stride)
    clock = write_leg_log(laboratory.folder / "leg" / f"{trial}.mcap", trial, walked, settings, walking)
    write_facts(trial, laboratory, crossing_facts(walked, unperturbed, clock))
    record_scene(trial, laboratory, scene_of(walked, walking, settings.seed))


def scene_of(walked: SimulatedCrossing, walking: WalkingSettings, seed: int = 0) -> Scene:
    """The quantities of a crossing that Vicon records. The seed decides where markers are in later sessions."""
    motion, step = walked.motion, walked.step
    session = session_of(step.condition, walking, seed)
    markers = leg_markers(motion.foot, motion.shank, session) | platform_markers(motion.platform.pose, walking)
    loads = plate_load(walked, walking)
    return Scene(markers, motion.platform.pose, loads, motion.platform.command, step.body_mass, name_in(step.condition))


def session_of(condition: Condition, walking: WalkingSettings, seed: int) -> Session:
    """The session of a condition; the markers of the first one are where `vicon.py` has them."""
    first = condition.session == 1 and not condition.later_subject
    name = "" if first else f"{name_in(condition)} {condition.session}"
    return Session(1e-3 * walking.effects.marker_placement.value, seed, name)


def name_in(condition: Condition) -> str | None:
    """Name of the person, if the campaign names persons."""
    return condition.subject.name if condition.subject else None


def record_unloaded(row: Mapping[str, object], laboratory: GaitLaboratory) -> None:
    """Record a perturbation of the unloaded platform."""
    walking, settings, trial = laboratory.walking, laboratory.settings, str(row["trial"])
    time = motion_grid(walking)
    platform = unloaded_platform(time, trial, settings.seed, walking, condition_of(row, settings))
    nothing = np.zeros((len(time), 3))
    write_platform_truth(trial, laboratory, time, platform)
    markers = platform_markers(platform.pose, walking)
    record_scene(
        trial, laboratory, Scene(markers, platform.pose, TrueWrench(nothing, nothing, nothing), platform.command)
    )


def record_standing(row: Mapping[str, object], laboratory: GaitLaboratory) -> None:
    """Record quiet standing: foot flat, shank upright, half the body weight vertically above the ankle."""
    walking, settings, trial = laboratory.walking, laboratory.settings, str(row["trial"])
    time, condition = motion_grid(walking), condition_of(row, settings)
    platform = resting_platform(time)
    leg = Pose(platform.pose.rotation, np.tile(nominal_ankle(walking), (len(time), 1)))
    mass = condition.body_mass(walking.gait.body_mass_kg)
    weight = np.tile(-0.5 * mass * GRAVITY, (len(time), 1))
    write_platform_truth(trial, laboratory, time, platform)
    session = session_of(condition, walking, settings.seed)
    markers = leg_markers(leg, leg, session) | on_body(leg, ANKLE_AXIS) | platform_markers(platform.pose, walking)
    load = TrueWrench(weight, np.zeros_like(weight), leg.origin)
    record_scene(trial, laboratory, Scene(markers, platform.pose, load, None, mass, name_in(condition)))


def record_scene(trial: str, laboratory: GaitLaboratory, scene: Scene) -> None:
    """Write the Vicon recording of a scene."""
    recording = vicon_recording(trial, laboratory.settings.seed, scene, laboratory.walking)
    write_c3d(laboratory.folder / "vicon" / f"{trial}.c3d", recording)


def write_platform_truth(trial: str, laboratory: GaitLaboratory, time: Array, platform: PlatformMotion) -> None:
    """Write the exact motion of a platform without a foot on it."""
    curves = platform_curves(time, platform, laboratory.walking)
    write_curves(laboratory.folder, trial, curves, laboratory.walking.rates.analog_stride)
    write_facts(trial, laboratory, {"command_s": platform.command, "onset_s": platform.onset})


def crossing_facts(walked: SimulatedCrossing, unperturbed: SimulatedCrossing, clock: LegClock) -> dict[str, object]:
    """The random quantities of a crossing, and the impedance that the leg rendered in it."""
    step, platform = walked.step, walked.motion.platform
    return {
        "perturbed": platform.onset is not None,
        "command_s": platform.command,
        "onset_s": platform.onset,
        "heel_strike_s": step.heel_strike,
        "toe_off_s": step.toe_off,
        "foot_yaw_rad": step.yaw,
        "placement_m": step.placement.tolist(),
        "condition": step.condition.facts(),
        "change": step.change.model_dump(mode="json", exclude={"of", "share"}),
        "leg_clock": {"offset_s": clock.offset, "drift": clock.drift},
        **rendered_impedance(walked, unperturbed),
    }


def write_facts(trial: str, laboratory: GaitLaboratory, facts: Mapping[str, object]) -> None:
    """Write the random quantities of a trial, and its settings."""
    truth = {"trial": trial, "seed": laboratory.settings.seed, **facts}
    truth["effects"] = laboratory.settings.effects.model_dump()
    truth["gait_laboratory"] = laboratory.walking.model_dump(mode="json")
    write_truth(laboratory.folder, trial, truth)
