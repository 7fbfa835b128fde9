# SPDX-License-Identifier: Apache-2.0
"""The shipped gait laboratory for tests: trials and crossings of it, with and without
imperfections."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np
from conftest import ROOT
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from shipped import LEG

from osl_analysis.base.trial import Array
from osl_analysis.base.yaml_settings import read_yaml
from osl_analysis.model.drivetrain import DrivetrainParameters
from osl_analysis.simulator.bench_trial import drivetrain_effects
from osl_analysis.simulator.laboratory_settings import WalkingSettings
from osl_analysis.simulator.simulated_crossing import SimulatedCrossing, simulate_crossing
from osl_analysis.simulator.simulation_settings import SimulationSettings
from osl_analysis.simulator.step import GaitTrial, draw_step
from osl_analysis.simulator.walking_trial import simulate_walking_trial

PERTURBED = {"trial": "walking_01", "experiment": "walking", "perturbed": True}
UNPERTURBED = {"trial": "walking_01", "experiment": "walking", "perturbed": False}
STATIC = {"trial": "static_1", "experiment": "static"}


def without(effects: Any, *names: str) -> Any:
    """Effects with the named ones off, or with all off if none is named."""
    switched_off = {}
    for name in names or type(effects).model_fields:
        switched_off[name] = getattr(effects, name).model_copy(update={"enabled": False})
    return effects.model_copy(update=switched_off)


@dataclass(frozen=True)
class Setup:
    """The shipped simulation, with paths that hold wherever the tests are started."""

    settings: SimulationSettings
    walking: WalkingSettings
    p: DrivetrainParameters

    def ideal(self) -> "Setup":
        """Without any imperfection."""
        settings = self.settings.model_copy(update={"effects": without(self.settings.effects)})
        return replace(self, settings=settings).lacking()

    def lacking(self, *effects: str) -> "Setup":
        """Without some imperfections of gait laboratory."""
        fewer = without(self.walking.effects, *effects)
        return replace(self, walking=self.walking.model_copy(update={"effects": fewer}))

    def crossing(self, perturbed: bool, trial: str = "walking_01") -> SimulatedCrossing:
        step = draw_step(GaitTrial(trial, self.settings.seed, self.walking))
        effects = drivetrain_effects(self.settings) | {"cancels_friction": True}
        return simulate_crossing(step, perturbed, effects, self.p)

    def record(self, folder: Path, row: dict[str, object]) -> Any:
        simulate_walking_trial(row, self.settings, self.walking, self.p, folder)
        return ezc3d.c3d(str(folder / "vicon" / f"{row['trial']}.c3d"))["data"]


def load_setup() -> Setup:
    """The shipped simulation."""
    settings = read_yaml(ROOT / "config/simulation/default.yaml", SimulationSettings)
    walking = read_yaml(ROOT / "config/simulation/walking.yaml", WalkingSettings)
    walking = walking.model_copy(update={"impedance": ROOT / walking.impedance})
    return Setup(settings, walking, LEG)


def leg_log(folder: Path) -> dict[str, Array]:
    """The fields of the leg's log, by an independent reader."""
    with (folder / "leg/walking_01.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        messages = [m.decoded_message for m in reader.iter_decoded_messages()]
    fields = (
        "joint_angle",
        "actuator_angle",
        "motor_current",
        "stiffness_gain",
        "damping_gain",
        "sync",
    )
    log = {name: np.array([float(getattr(m, name)) for m in messages]) for name in fields}
    return log | {
        "time": np.array([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in messages])
    }


def with_toes_down(setup: Setup) -> Setup:
    """The same with turns of the platform the other way."""
    ramp = setup.walking.perturbation
    down = ramp.model_copy(update={"angle_deg": -ramp.angle_deg})
    return replace(setup, walking=setup.walking.model_copy(update={"perturbation": down}))
