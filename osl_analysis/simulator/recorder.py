"""What recorders do to true signals: when each channel is sampled, what its sensor makes of it, what stamps it gets;
with everything off the even instants of the simulation."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from osl_analysis.files import atomic_path, write_text
from osl_analysis.simulator.settings import NodeSettings, Scatter, SensorSettings, SimulationSettings, stream
from osl_analysis.trial import Array

SENSORS = {
    "joint_angle": ("", "joint_encoder"),
    "commanded_angle": ("", "joint_encoder"),
    "actuator_angle": ("", "actuator_encoder"),
    "motor_current": ("current_noise", "current_quantisation"),
    **dict.fromkeys(("load_cell_torque", "output_torque"), ("load_cell_noise", "load_cell_quantisation")),
}
"""Effects with the white noise and with the resolution of each channel."""
TrueSignal = Array | Callable[[Array], Array]
"""A true signal, (n,) at the even instants of the simulation; or one that jumps, as friction does, by its values at any
instants [s]: a curve through its samples is not what it is in between."""


def recording_of(
    trial: str, signals: Mapping[str, TrueSignal], settings: SimulationSettings
) -> tuple[dict[str, Array], dict[str, float]]:
    """What the nodes of a bench write of true signals by channel, (n,) each, with its stamps [s]: `time`, and
    `torque_time` of the torque, which equals it if one node records all. And the errors that were drawn for this trial:
    clock start [s], load-cell offset [N*m] and drift [N*m/min], and the joint encoder's zero [rad] if enabled."""
    effects, seed, recorder = settings.effects, settings.seed, settings.recorder
    drawn = {"clock_start_s": float(stream(seed, trial, "clock_start").integers(20, 2000))}
    for name, effect in (("load_cell_offset", effects.load_cell_offset), ("load_cell_drift", effects.load_cell_drift)):
        drawn[name] = effect.value * stream(seed, trial, name).standard_normal()
    if effects.encoder_zero.enabled:
        zero = effects.encoder_zero.value * effects.joint_encoder.value
        drawn["encoder_zero"] = float(zero * stream(seed, trial, "encoder_zero").uniform(-1, 1))
    bench = Bench(trial, settings, drawn, next(len(one) for one in signals.values() if not callable(one)))
    if recorder.torque_node is None:
        log = bench.recording("node", recorder.node, signals)
        return log | {"torque_time": log["time"]}, drawn
    torque = {name: true for name, true in signals.items() if name.endswith("torque")}
    others = {name: true for name, true in signals.items() if name not in torque}
    late = bench.recording("torque_node", recorder.torque_node, torque)
    return bench.recording("node", recorder.node, others) | {"torque_time": late.pop("time"), **late}, drawn


@dataclass(frozen=True)
class Bench:
    """One trial on a bench, with the errors that it keeps."""

    trial: str
    settings: SimulationSettings
    drawn: Mapping[str, float]
    samples: int  # instants of the simulation

    def random(self, name: str) -> np.random.Generator:
        return stream(self.settings.seed, self.trial, name)

    def recording(self, name: str, node: NodeSettings, signals: Mapping[str, TrueSignal]) -> dict[str, Array]:
        """The stamps [s], as `time`, and the channels, (n,) each, that one node writes."""
        instants, even, stamps = self.sampling(name, node)
        rows, time = self.written(name, node, len(instants)), self.drawn["clock_start_s"] + stamps
        if node.decimals.enabled:
            time = np.round(time, int(node.decimals.size))
        read = {channel: self.reading(channel, true, instants, even)[rows] for channel, true in signals.items()}
        return {"time": time[rows], **read}

    def sampling(self, name: str, node: NodeSettings) -> tuple[Array, bool, Array]:
        """When a node takes its samples [s], whether these are the instants of the simulation, and what its clock says
        of them [s]."""
        simulated_hz = self.settings.dynamometer.rate_hz
        duration, rate = self.samples / simulated_hz, node.rate.value or simulated_hz
        instants, scatters = np.arange(round(duration * rate)) / rate, node.phase.enabled or node.jitter.enabled
        if scatters:
            scattered = instants + node.phase.value + self.scatter(f"{name}.jitter", node.jitter, len(instants))
            scattered.sort(kind="stable")  # fast, because few change places
            last = duration - 1 / simulated_hz
            instants = scattered[np.searchsorted(scattered, 0.0) : np.searchsorted(scattered, last, side="right")]
        stamps = instants
        if node.latency.enabled:
            late = self.scatter(f"{name}.latency", node.latency, len(instants))
            queue = 5e-6 * np.arange(len(instants))  # a host stamps one of several waiting messages in 5 us
            stamps = np.maximum.accumulate(instants + late - queue) + queue
        stamps = node.clock_offset.value + (1 + 1e-6 * node.clock_drift.value) * stamps
        return instants, rate == simulated_hz and not scatters, stamps

    def scatter(self, name: str, effect: Scatter, n: int) -> Array:
        """A number per sample, (n,) [s], as the effect is distributed; 0 where it is off."""
        if effect.distribution == "exponential":
            return effect.value * self.random(name).standard_exponential(n)
        normal = effect.value * self.random(name).standard_normal(n)
        return np.abs(normal) if effect.distribution == "half_normal" else normal

    def written(self, name: str, node: NodeSettings, n: int) -> NDArray[np.intp] | slice:
        """The samples of n that a node writes: without the dropped ones, the duplicated ones twice."""
        if not (node.duplicated.enabled or node.dropped.enabled or node.lost_every.enabled):
            return slice(None)
        copies, burst = np.ones(n, dtype=np.intp), int(node.burst.value) or 1
        if node.duplicated.enabled:
            copies += self.random(f"{name}.duplicated").random(n) < node.duplicated.size
        if node.dropped.enabled:
            gaps = max(round(node.dropped.size * n / burst), 1)
            # in slots that leave a sample between two gaps; the first and the last sample stay
            slots = self.random(f"{name}.dropped").permutation((n - 2) // (burst + 1))[:gaps]
            for first in 1 + slots * (burst + 1):
                copies[first : first + burst] = 0
        if node.lost_every.enabled:
            every, scatter = int(node.lost_every.size), node.lost_every.scatter
            number = n // max(every - scatter, 1) + 1
            intervals = self.random(f"{name}.lost_every").integers(every - scatter, every + scatter + 1, number)
            for first in np.cumsum(intervals):
                copies[first : min(first + burst, n - 1)] = 0
        return np.repeat(np.arange(n), copies)

    def reading(self, channel: str, true: TrueSignal, sampled: Array, even: bool) -> Array:
        """What the sensor of a channel reads at the sampled instants: dynamics, errors, noise, range and steps."""
        effects, sensors, n = self.settings.effects, self.settings.recorder.sensors, len(sampled)
        sensor = next((one for name, one in sensors.items() if name == channel), SensorSettings())
        rate, (noise, resolution) = self.settings.dynamometer.rate_hz, SENSORS[channel]
        if sensor.low_pass.enabled:
            # causal and at rest at the first value, in eight steps per sample, its input being straight between them
            signal = true(np.arange(self.samples) / rate) if callable(true) else true
            fine = np.arange((len(signal) - 1) * 8 + 1) / 8
            finer = scipy.interpolate.CubicSpline(np.arange(len(signal)), signal)(fine)
            analogue = scipy.signal.butter(sensor.low_pass.order, 2 * np.pi * sensor.low_pass.size, analog=True)
            numerator, below, _ = scipy.signal.cont2discrete(analogue, 1 / (8 * rate), method="foh")
            above = np.ravel(numerator)
            slow, _ = scipy.signal.lfilter(above, below, finer, zi=scipy.signal.lfilter_zi(above, below) * finer[0])
            true = np.asarray(slow[::8])
        instants = np.maximum(sampled - sensor.delay.value, 0.0) if sensor.delay.value else sampled
        if callable(true):
            reading = true(instants)
        elif even and not sensor.delay.value:
            reading = true
        else:
            reading = np.asarray(scipy.interpolate.CubicSpline(np.arange(len(true)) / rate, true)(instants))
        if channel.endswith("torque"):
            reading = reading + self.torque_errors(sampled)
        if noise:
            reading = reading + getattr(effects, noise).value * self.random(noise).standard_normal(n)
        if channel == "joint_angle" and effects.encoder_zero.enabled:
            reading = reading + self.drawn["encoder_zero"]
        if sensor.clipping.enabled:
            reading = np.clip(reading, -sensor.clipping.size, sensor.clipping.size)
        if sensor.adc.enabled:
            reading = rounded_to(reading, 2 * sensor.clipping.size / 2**sensor.adc.size)
        reading = rounded_to(reading, getattr(effects, resolution).value)
        reading = reading * sensor.gain.size if sensor.gain.enabled else reading
        if sensor.failed.enabled:
            reading = np.where(self.random(f"{channel}.failed").random(n) < sensor.failed.size, np.nan, reading)
        return reading

    def torque_errors(self, instants: Array) -> Array:
        """Offset, drift, hum and 1/f noise [N*m] of a torque sensor at the sampled instants [s]. A power density of
        size^2/(ln 10 f) has the variance size^2 in each decade, for any sampling rate."""
        effects, n = self.settings.effects, len(instants)
        errors = self.drawn["load_cell_offset"] + self.drawn["load_cell_drift"] * instants / 60
        hum, size = effects.load_cell_hum, effects.load_cell_flicker.value
        if hum.enabled:
            phase = self.random("load_cell_hum").uniform(0, 2 * np.pi)
            errors = errors + hum.size * np.sin(2 * np.pi * hum.frequency_hz * instants + phase)
        if size:
            line = np.arange(n // 2 + 1)
            white = self.random("load_cell_flicker").standard_normal((2, len(line)))
            spectrum = size * n / 2 * (white[0] + 1j * white[1]) / np.sqrt(np.log(10) * np.maximum(line, 1))
            spectrum[0] = 0
            errors = errors + np.fft.irfft(spectrum, n)
        return errors


def rounded_to(signal: Array, step: float) -> Array:
    """The signal rounded to the nearest multiple of `step` [unit of the signal]. With step 0 it is not rounded."""
    return np.rint(signal / step) * step if step else signal


def write_truth(
    folder: Path, trial: str, truth: Mapping[str, object], curves: Mapping[str, Array] | None = None
) -> None:
    """Write a trial's truth and its exact curves to the folder `truth`, which ingest never reads."""
    if curves is not None:
        with atomic_path(folder / "truth" / f"{trial}.parquet") as path:
            pl.DataFrame(curves).write_parquet(path)
    write_text(folder / "truth" / f"{trial}.json", json.dumps(truth, indent=1) + "\n")
