"""Recordings of the study: ideal and real sensors and recorders, and the trial that ingest would make of a log."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import polars as pl

from osl_analysis.simulator.settings import Effect, Encoder, RecorderSettings, SimulationSettings, stream
from osl_analysis.study import Recording
from osl_analysis.study.trials import StudyInputs
from osl_analysis.trial import Array, Trial

SENSORS = (
    "load_cell_noise", "load_cell_offset", "load_cell_drift", "load_cell_quantisation", "load_cell_hum",
    "load_cell_flicker", "joint_encoder", "actuator_encoder", "current_noise", "current_quantisation", "encoder_zero",
)  # fmt: skip
"""Effects of sensors, which ideal ones do not have."""


def ideal_sensors(settings: SimulationSettings) -> SimulationSettings:
    """The settings without errors of sensors and recorders."""
    # the controller sees the actuator's encoder too, but its motion has been simulated before the sensors read it
    return settings.model_copy(update={"effects": settings.effects.without(*SENSORS), "recorder": RecorderSettings()})


def recorded_trial(
    name: str, time: Array, joint: Mapping[str, Array], torque_time: Array, torque: Mapping[str, Array]
) -> Trial:
    """The trial of two recordings with stamps [s] of their own: what moves and the torque, in canonical columns."""
    samples = pl.DataFrame({"time": time - time[0], **joint})
    if np.array_equal(time, torque_time):
        return Trial(name, samples.with_columns(**{column: pl.Series(values) for column, values in torque.items()}))
    other = pl.DataFrame({"time": torque_time - time[0], **torque})
    return Trial(name, samples.join(other, on="time", how="full", coalesce=True).sort("time"))


def at_any_phase(trial: str, settings: SimulationSettings) -> SimulationSettings:
    """The settings with recorders that start anywhere between two instants of the simulated motion.

    Every trial repeats the motion. With samples at the same phases of it the rounding of an encoder would repeat too.
    """
    later = float(stream(settings.seed, trial, "sampling_phase").random()) / settings.dynamometer.rate_hz
    recorder = settings.recorder
    nodes = {"node": recorder.node, "torque_node": recorder.torque_node}
    moved = {
        name: node.model_copy(update={"phase": Effect(enabled=True, size=node.phase.value + later, unit="s")})
        for name, node in nodes.items()
        if node is not None
    }
    return settings.model_copy(update={"recorder": recorder.model_copy(update=moved)})


def recorded_as(inputs: StudyInputs, recording: Recording) -> StudyInputs:
    """The inputs with another recorder, rate or encoder of the bench."""
    simulation = inputs.simulation
    bench = simulation.dynamometer.model_copy(update={"rate_hz": recording.rate_hz})
    changes: dict[str, object] = {
        "dynamometer": bench,
        "recorder": RecorderSettings.model_validate(recording.recorder),
    }
    if recording.bits is not None:
        encoder = Encoder(enabled=True, size=recording.bits, unit="bit")
        changes["effects"] = simulation.effects.model_copy(update={"joint_encoder": encoder})
    return replace(inputs, simulation=simulation.model_copy(update=changes))
