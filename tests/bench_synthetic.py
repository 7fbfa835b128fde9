"""A stepped-sine trial whose torque is a function of its motion, for the tests of the bench."""

import numpy as np

from osl_analysis.bench.segments import find_blocks, unit_sines
from osl_analysis.bench.stepped_sine import SteppedSineTrial
from osl_analysis.protocol.runs import SteppedSineProtocol
from osl_analysis.second_order import impedance_torque
from osl_analysis.signals import LowPass, Motion, filtered_motion

RATE, LOW_PASS = 500.0, LowPass(15)
PROTOCOL = SteppedSineProtocol((0.05, 0.1), (1.0, 3.0, 5.0), 9)


def unit_block(protocol, rate):
    """All frequencies of a protocol at unit amplitude, without a rest, at `rate` [Hz]."""
    return unit_sines(list(zip(protocol.frequencies_hz, protocol.cycles_at, strict=True)), rate)


def stepped_sine(torque_of, noise=0.0, protocol=PROTOCOL, seed=1):
    """A stepped-sine trial whose torque [N*m] is a function of its motion, with white noise."""
    rest = np.zeros(round(2 * RATE))
    theta = np.concatenate([rest, *(x for a in protocol.amplitudes for x in (a * unit_block(protocol, RATE), rest))])
    time = np.arange(len(theta)) / RATE
    motion, _ = filtered_motion(time, theta, theta, LowPass(100))
    torque = torque_of(motion) + noise * np.random.default_rng(seed).standard_normal(len(time))
    filtered = filtered_motion(time, theta, torque, LOW_PASS)
    blocks = find_blocks(time, theta, protocol)
    return SteppedSineTrial("made", time, RATE, theta, torque, *filtered, blocks, 2, LOW_PASS, 0.0)


def second_order(motion: Motion):
    return impedance_torque(200, 4, 0.05, motion)
