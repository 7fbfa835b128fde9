"""A stepped-sine trial as the fits want it: filtered motion and torque, and where each amplitude lies."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from osl_analysis.config import DynamometerAnalysis
from osl_analysis.errors import InputError
from osl_analysis.fits.protocol import Block, SteppedSine, find_blocks
from osl_analysis.signals import LowPass, Motion, filtered_motion, sampling_rate
from osl_analysis.trial import Array
from osl_analysis.trial_file import read_trial


@dataclass(frozen=True)
class SteppedSineTrial:
    """Raw angle [rad] and torque [N*m], the same filtered with derivatives, and the blocks of the protocol."""

    name: str
    time: Array
    rate_hz: float
    theta: Array
    torque: Array
    motion: Motion
    filtered_torque: Array
    blocks: tuple[Block, ...]

    def parts(self) -> Iterator[tuple[float | None, Motion, Array]]:
        """Amplitude [deg], motion and torque of each block, then of all blocks together (amplitude None)."""
        for block in self.blocks:
            yield float(np.rad2deg(block.amplitude)), self.motion[block.rows], self.filtered_torque[block.rows]
        rows = np.concatenate([np.r_[block.rows] for block in self.blocks])
        yield None, self.motion[rows], self.filtered_torque[rows]


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
        motion, filtered = filtered_motion(time, theta, torque, LowPass(settings.cutoff_hz, settings.order))
        blocks = find_blocks(time, theta, protocol)
    except InputError as error:
        raise InputError(f"trial {record.name}: {error}") from error
    return SteppedSineTrial(record.name, time, sampling_rate(time), theta, torque, motion, filtered, blocks)
