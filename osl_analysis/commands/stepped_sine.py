"""A stepped-sine trial as the fits want it: filtered motion and torque, and where each amplitude lies."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from osl_analysis.bench.drift import drift_rate, without_drift
from osl_analysis.bench.protocol import Block, Segment, SteppedSine, cycles_of, find_blocks, rows_of, settled
from osl_analysis.config import DynamometerAnalysis
from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass, Motion, filtered_motion, sampling_rate
from osl_analysis.stats.covariance import Cycles
from osl_analysis.trial import Array, Trial
from osl_analysis.trial_file import read_trial


@dataclass(frozen=True)
class SteppedSineTrial:
    """Raw angle [rad] and torque [N*m], the same filtered with derivatives, and the blocks of the protocol.

    `command` [rad] is None where no log has it. Fits use the settled cycles of the blocks alone: the first
    `settle_cycles` at each frequency still carry the one before, into the last the filter smears the next. `drift`
    [N*m/s] of the load cell is already taken from the torque.
    """

    name: str
    time: Array
    rate_hz: float
    theta: Array
    torque: Array
    motion: Motion
    filtered_torque: Array
    blocks: tuple[Block, ...]
    command: Array | None
    settle_cycles: int
    low_pass: LowPass
    drift: float

    def parts(self) -> Iterator[tuple[float | None, Motion, Array]]:
        """Amplitude [deg], motion and torque of each block's settled cycles, then of all blocks (amplitude None)."""
        for amplitude in (*(block.amplitude_deg for block in self.blocks), None):
            rows = rows_of(self.segments(amplitude))
            yield amplitude, self.motion[rows], self.filtered_torque[rows]

    def segments(self, amplitude: float | None) -> tuple[Segment, ...]:
        """The settled segments of one amplitude [deg], or of all (None), whose rows `parts` yields."""
        chosen = [b for b in self.blocks if amplitude is None or np.isclose(np.rad2deg(b.amplitude), amplitude)]
        return settled(chosen, self.settle_cycles)

    @property
    def every(self) -> int:
        """Samples after which the filter leaves noise independent."""
        return self.low_pass.independent_samples(self.rate_hz)

    def cycles(self, amplitude: float | None) -> Cycles | None:
        """The cycles among these rows; None where there are too few to tell their spread."""
        return cycles_of(self.segments(amplitude))


def read_stepped_sine(trial: Path, settings: DynamometerAnalysis) -> SteppedSineTrial:
    """Read an ingested trial and find the protocol in it.

    Raises
    ------
    InputError
        A signal is missing, sampled irregularly, or does not follow the protocol; names the trial.
    """
    record = read_trial(trial)
    time, theta, torque = record.signals("theta", "torque")
    protocol = SteppedSine(settings.amplitudes, settings.frequencies_hz, settings.cycles)
    try:
        blocks = find_blocks(time, theta, protocol)
        drift = drift_rate(time, torque, settled(blocks, settings.settle_cycles))
        torque = without_drift(time, torque, drift)
        motion, filtered = filtered_motion(time, theta, torque, settings.low_pass)
    except InputError as error:
        raise InputError(f"trial {record.name}: {error}") from error
    rate = sampling_rate(time)
    command = commanded(record, len(time))
    return SteppedSineTrial(
        record.name,
        time,
        rate,
        theta,
        torque,
        motion,
        filtered,
        blocks,
        command,
        settings.settle_cycles,
        settings.low_pass,
        drift,
    )


def commanded(record: Trial, samples: int) -> Array | None:
    """The commanded angle [rad], where a log has it at the same stamps as angle and torque."""
    if "theta_command" not in record.samples.columns:
        return None
    _, _, _, command = record.signals("theta", "torque", "theta_command")
    return command if len(command) == samples else None
