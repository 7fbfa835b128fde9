"""The effects of recorders on true signals: sampling instants, sensors and stamps.

With all effects off, samples are at the even instants of the simulation.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from osl_analysis.files import atomic_path, write_text
from osl_analysis.simulator.random_numbers import generator_of
from osl_analysis.simulator.simulation_settings import NodeSettings, SimulationSettings
from osl_analysis.trial import Array

# A true signal: (n,) at the even instants of the simulation; or, for a signal that jumps, as
# friction does, a function of instants [s], because a curve through its samples would be wrong in
# between.
TrueSignal = Array | Callable[[Array], Array]


# the effects of each channel's sensor, white noise and resolution, by their names in the settings
SENSORS = {
    "joint_angle": (None, "joint_encoder"),
    "commanded_angle": (None, "joint_encoder"),
    "actuator_angle": (None, "actuator_encoder"),
    "motor_current": ("current_noise", "current_quantisation"),
    "load_cell_torque": ("load_cell_noise", "load_cell_quantisation"),
    "output_torque": ("load_cell_noise", "load_cell_quantisation"),
}


def recording_of(
    trial: str, signals: Mapping[str, TrueSignal], settings: SimulationSettings
) -> tuple[dict[str, Array], dict[str, float]]:
    """Record true signals with the nodes of a bench.

    Parameters
    ----------
    trial : str
        Its name, which decides the random numbers.
    signals : Mapping
        By channel.
    settings : SimulationSettings

    Returns
    -------
    log : dict
        (n,) by channel, with the stamps [s] `time`, and `torque_time` of the torque, which equals
        it if one node records all.
    drawn : dict
        Errors that were drawn for this trial: clock start [s], load-cell offset [N*m] and drift
        [N*m/min].
    """
    recorder = settings.recorder
    drawn = draw_errors(trial, settings)
    samples = next(len(signal) for signal in signals.values() if not callable(signal))
    bench = Bench(trial, settings, drawn, samples)
    torque = {name: signal for name, signal in signals.items() if is_torque(name)}
    others = {name: signal for name, signal in signals.items() if name not in torque}
    log = bench.recording("node", recorder.node, others)
    if recorder.torque_node is None:
        log_of_torque = bench.recording("node", recorder.node, torque)
    else:
        log_of_torque = bench.recording("torque_node", recorder.torque_node, torque)
    torque_time = log_of_torque.pop("time")
    return {**log, "torque_time": torque_time, **log_of_torque}, drawn


def draw_errors(trial: str, settings: SimulationSettings) -> dict[str, float]:
    """Draw the errors that a bench keeps over a trial."""
    clock = generator_of(settings.seed, trial, "clock_start")
    drawn = {"clock_start_s": float(clock.integers(20, 2000))}
    for name in ("load_cell_offset", "load_cell_drift"):
        deviate = generator_of(settings.seed, trial, name).standard_normal()
        drawn[name] = getattr(settings.effects, name).value * deviate
    return drawn


def is_torque(channel: str) -> bool:
    return channel.endswith("torque")


@dataclass(frozen=True)
class Bench:
    """One trial on a bench, with the errors that it keeps."""

    trial: str
    settings: SimulationSettings
    drawn: Mapping[str, float]
    samples: int  # instants of the simulation

    def random(self, name: str) -> np.random.Generator:
        """The random numbers of an effect."""
        return generator_of(self.settings.seed, self.trial, name)

    def recording(
        self, name: str, node: NodeSettings, signals: Mapping[str, TrueSignal]
    ) -> dict[str, Array]:
        """Record signals with one node: its stamps [s], as `time`, and the channels, (n,) each."""
        instants = self.instants(name, node)
        time = self.drawn["clock_start_s"] + instants
        if node.decimals.enabled:
            time = np.round(time, int(node.decimals.size))
        written = self.written_rows(name, node, len(instants))
        log = {"time": time[written]}
        for channel, signal in signals.items():
            log[channel] = self.reading(channel, signal, instants)[written]
        return log

    def written_rows(self, name: str, node: NodeSettings, n: int) -> NDArray[np.bool_] | slice:
        """The rows of n samples that are not lost: these are in slots that leave a sample between
        two gaps; the first and the last one stay."""
        if not node.dropped.enabled:
            return slice(None)
        slots = self.random(f"{name}.dropped").permutation((n - 2) // 2)
        lost = slots[: max(round(node.dropped.size * n), 1)]
        rows = np.ones(n, dtype=np.bool_)
        rows[1 + 2 * lost] = False
        return rows

    def instants(self, name: str, node: NodeSettings) -> Array:
        """When a node samples, (n,) [s]."""
        simulated_hz = self.settings.dynamometer.rate_hz
        duration = self.samples / simulated_hz
        rate = node.rate.value or simulated_hz
        instants = np.arange(round(duration * rate)) / rate
        if not node.phase.enabled and not node.jitter.enabled:
            return instants
        jitter = self.random(f"{name}.jitter").standard_normal(len(instants))
        scattered = instants + node.phase.value + node.jitter.value * jitter
        scattered.sort(kind="stable")  # fast, because few change places
        first = np.searchsorted(scattered, 0.0)
        stop = np.searchsorted(scattered, duration - 1 / simulated_hz, side="right")
        return scattered[first:stop]

    def values_at(self, signal: TrueSignal, instants: Array) -> Array:
        """True values (n,) at instants [s]."""
        if callable(signal):
            return signal(instants)
        simulated = np.arange(self.samples) / self.settings.dynamometer.rate_hz
        if np.array_equal(instants, simulated):
            return signal
        return np.asarray(scipy.interpolate.CubicSpline(simulated, signal)(instants))

    def reading(self, channel: str, signal: TrueSignal, sampled: Array) -> Array:
        """What the sensor of a channel reads at the sampled instants (n,): errors, noise and steps;
        what a load cell reads is older."""
        effects = self.settings.effects
        noise, resolution = SENSORS[channel]
        if is_torque(channel):
            instants = np.maximum(sampled - effects.load_cell_delay.value, 0.0)
            drift = self.drawn["load_cell_drift"] * sampled / 60
            reading = self.values_at(signal, instants) + (self.drawn["load_cell_offset"] + drift)
        else:
            reading = self.values_at(signal, sampled)
        if noise is not None:
            deviates = self.random(noise).standard_normal(len(sampled))
            reading = reading + getattr(effects, noise).value * deviates
        return rounded_to(reading, getattr(effects, resolution).value)


def rounded_to(signal: Array, step: float) -> Array:
    """The signal rounded to the nearest multiple of `step` [unit of the signal]. With step 0 it is
    not rounded."""
    return np.rint(signal / step) * step if step else signal


def write_truth(
    folder: Path, trial: str, truth: Mapping[str, object], curves: Mapping[str, Array] | None = None
) -> None:
    """Write a trial's truth and its exact curves to the folder `truth`, which ingest never
    reads."""
    if curves is not None:
        with atomic_path(folder / "truth" / f"{trial}.parquet") as path:
            pl.DataFrame(curves).write_parquet(path)
    write_text(folder / "truth" / f"{trial}.json", json.dumps(truth, indent=1) + "\n")
