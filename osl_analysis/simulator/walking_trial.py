# SPDX-License-Identifier: Apache-2.0
"""One trial of the gait laboratory, from the row of the sample sheet to its files."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from osl_analysis.base.trial import Array
from osl_analysis.model.drivetrain import DrivetrainParameters
from osl_analysis.simulator import step as gait
from osl_analysis.simulator.bench_trial import drivetrain_effects
from osl_analysis.simulator.laboratory_files import (
    leg_markers,
    on_body,
    write_capture,
    write_leg_log,
)
from osl_analysis.simulator.laboratory_settings import NOMINAL, WalkingSettings
from osl_analysis.simulator.recorder import write_truth
from osl_analysis.simulator.rigid_body import GRAVITY, Pose, TrueWrench
from osl_analysis.simulator.simulated_crossing import (
    impedance_of_leg,
    leg_clock,
    simulate_crossing,
)
from osl_analysis.simulator.simulation_settings import SimulationSettings


def simulate_walking_trial(
    row: Mapping[str, Any],
    campaign: SimulationSettings,
    walking: WalkingSettings,
    p: DrivetrainParameters,
    raw: Path,
) -> None:
    """Simulate one row of the sample sheet into a campaign's folder.

    Parameters
    ----------
    row : Mapping
        Of a walking, plate or static trial.
    campaign : SimulationSettings
    walking : WalkingSettings
    p : DrivetrainParameters
    raw : Path
        First the truth is written, so that every log has one, then `vicon/<trial>.c3d` and, of a
        walking trial, `leg/<trial>.mcap`.
    """
    trial = gait.GaitTrial(name=row["trial"], seed=campaign.seed, walking=walking)
    if row["experiment"] == "walking":
        simulate_walking(trial, row, campaign, p, raw)
        return
    leg: dict[str, Array] = {}
    zero = np.zeros((len(trial.time), 3))
    load = TrueWrench(zero, zero, zero)
    if row["experiment"] == "plate":
        platform = gait.unloaded_platform(trial)
    else:
        platform = gait.resting_platform(trial)
        leg, load = standing(trial)
    write_truth_of(trial, platform, {}, {}, campaign, raw)
    write_capture(raw, trial, leg, platform, load)


def simulate_walking(
    trial: gait.GaitTrial,
    row: Mapping[str, Any],
    campaign: SimulationSettings,
    p: DrivetrainParameters,
    raw: Path,
) -> None:
    """Simulate a crossing and write its files."""
    step = gait.draw_step(trial)
    effects = drivetrain_effects(campaign)
    effects["cancels_friction"] = True
    unperturbed = simulate_crossing(step, False, effects, p)
    walked = unperturbed
    if row.get("perturbed"):
        walked = simulate_crossing(step, True, effects, p)
    clock = leg_clock(trial)
    offset, drift = clock
    platform = walked.platform
    facts = {
        "heel_strike_s": step.heel_strike,
        "toe_off_s": step.toe_off,
        "foot_yaw_rad": trial.normal("foot_yaw", np.pi / 180),
        "placement_m": step.placement.tolist(),
        "leg_clock": {"offset_s": offset, "drift": drift},
        **impedance_of_leg(walked, unperturbed),
    }
    curves = {
        "phase": step.cycle_phase(trial.time),
        "theta": walked.motion.theta,
        "torque": walked.torque,
    }
    write_truth_of(trial, platform, facts, curves, campaign, raw)
    write_leg_log(raw, walked, clock, campaign)
    markers = leg_markers(walked.foot, walked.shank)
    write_capture(raw, trial, markers, platform, walked.reaction)


def write_truth_of(
    trial: gait.GaitTrial,
    platform: gait.PlatformMotion,
    facts: Mapping[str, object],
    curves: Mapping[str, Array],
    campaign: SimulationSettings,
    raw: Path,
) -> None:
    """Write the platform's motion, facts, settings, and curves at the rate of the analogs."""
    rates = trial.walking.rates
    stride = rates.motion_hz // rates.analogs_hz
    truth = {
        "trial": trial.name,
        "seed": campaign.seed,
        "command_s": platform.command,
        "onset_s": platform.onset,
        **facts,
        "effects": campaign.effects.model_dump(),
        "gait_laboratory": trial.walking.model_dump(mode="json"),
    }
    all_curves = {"time": trial.time, **curves, "platform_angle": platform.angle}
    at_analogs = {name: curve[::stride] for name, curve in all_curves.items()}
    write_truth(raw, trial.name, truth, at_analogs)


def standing(trial: gait.GaitTrial) -> tuple[dict[str, Array], TrueWrench]:
    """Markers and load of quiet standing: foot flat, shank upright, half the body weight vertically
    above the ankle."""
    rows = len(trial.time)
    ankle = np.tile(gait.nominal_ankle(trial.walking), (rows, 1))
    leg = Pose(np.tile(np.eye(3), (rows, 1, 1)), ankle)
    half_a_body_kg = trial.walking.gait.body_mass_kg / 2
    force = np.tile(-half_a_body_kg * GRAVITY, (rows, 1))
    half_width = NOMINAL.ankle_half_width
    axis = {"ANKLE_MED": (0.0, half_width, 0.0), "ANKLE_LAT": (0.0, -half_width, 0.0)}
    markers = {**leg_markers(leg, leg), **on_body(leg, axis)}
    return markers, TrueWrench(force, np.zeros((rows, 3)), ankle)
