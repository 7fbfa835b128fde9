"""Recordings of the study: ideal and real sensors and recorders, and the trial that ingest would make of a log."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import polars as pl

from osl_analysis.simulator.effect import Encoder
from osl_analysis.simulator.recorder_settings import RecorderSettings
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.study.trials import StudyInputs
from osl_analysis.trial import Array, Trial

SENSORS = (
    "load_cell_noise", "load_cell_offset", "load_cell_drift", "load_cell_quantisation", "load_cell_hum",
    "load_cell_flicker", "joint_encoder", "actuator_encoder", "current_noise", "current_quantisation", "encoder_zero",
)  # fmt: skip
"""Effects of sensors, which ideal ones do not have."""
JITTER = {"enabled": True, "size": 20e-6, "unit": "s"}
TWO_NODES = {"node": {"jitter": JITTER}, "torque_node": {"phase": JITTER | {"size": 3e-4}, "jitter": JITTER}}
"""Two nodes that sample 0.3 ms apart, each with 20 us of true jitter."""
PRINTED = {"node": {"decimals": {"enabled": True, "size": 4, "unit": "decimal"}}}
PRINTED_RATE_HZ = 1024.0
"""Four decimals of a second are a tenth of a step of this rate."""
BITS = 14


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


def with_recorder(inputs: StudyInputs, recorder: Mapping[str, object]) -> StudyInputs:
    """The inputs with another recorder of the benches."""
    chosen = RecorderSettings.model_validate(recorder)
    return replace(inputs, simulation=inputs.simulation.model_copy(update={"recorder": chosen}))


def with_jitter(inputs: StudyInputs) -> StudyInputs:
    """The inputs with two nodes that jitter."""
    return with_recorder(inputs, TWO_NODES)


def with_printed_stamps(inputs: StudyInputs) -> StudyInputs:
    """The inputs with stamps of four decimals at 1024 Hz."""
    bench = inputs.simulation.dynamometer.model_copy(update={"rate_hz": PRINTED_RATE_HZ})
    printed = with_recorder(inputs, PRINTED)
    return replace(printed, simulation=printed.simulation.model_copy(update={"dynamometer": bench}))


def with_fewer_bits(inputs: StudyInputs) -> StudyInputs:
    """The inputs with a joint encoder of 14 bits."""
    effects = inputs.simulation.effects
    encoder = Encoder(enabled=True, size=BITS, unit="bit")
    changed = effects.model_copy(update={"joint_encoder": encoder})
    return replace(inputs, simulation=inputs.simulation.model_copy(update={"effects": changed}))
