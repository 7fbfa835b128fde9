"""Whether a joint moves by enough, and fast enough, for Eq. 15; refused with the remedy where it does not."""

import numpy as np

from osl_analysis.bench.excitation_limits import angle_noise_share
from osl_analysis.bench.moving_record import MovingRecord
from osl_analysis.errors import InputError
from osl_analysis.stats.rounding import distinct_values

FEWEST_STEPS = 20.0
"""Steps of the encoder that an angle turns by at least; below, its rounding is no noise but a part of the motion."""
HARDLY_MOVES = 0.1
"""Share of the acceleration that is the encoder's noise, from which a record is refused."""
SLOW = 200.0
"""Steps of the encoder from which a motion is not small but slow, if noise makes its acceleration."""


def check_moves(record: MovingRecord) -> float:
    """`angle_noise_share`, refused where the record hardly moves, or slowly.

    Raises
    ------
    InputError
        The noise of the angle is a large share of its motion, or the motion is a few steps of the encoder.
    """
    share, steps = angle_noise_share(record), steps_turned(record)
    if steps < FEWEST_STEPS:
        raise InputError(
            f"trial {record.name}: the joint hardly moves: theta turns by {steps:.0f} steps of its encoder, "
            f"{FEWEST_STEPS:g} are needed; move it by more, and check the unit of theta in the source file"
        )
    if share > HARDLY_MOVES:
        slow = steps >= SLOW
        turn = np.rad2deg(np.std(record.part(record.motion.theta)))
        remedy = (
            "move it faster, by 0.5 to 6 Hz, or take the stiffness alone by experiment 'torque_angle'"
            if slow
            else "move it by more, or faster, and check the unit of theta in the source file"
        )
        raise InputError(
            f"trial {record.name}: the joint {'moves too slowly' if slow else 'hardly moves'}: theta turns by "
            f"{turn:.2g} deg RMS, and noise of the encoder has {share:.2g} times the power of the acceleration's own "
            f"part behind the filter, at most {HARDLY_MOVES:g} is allowed; {remedy}"
        )
    return share


def steps_turned(record: MovingRecord) -> float:
    """Steps of the encoder by which the fitted angle turns, at most as many as there are different values.

    Without end where no step is seen, and more values than a slow motion has.
    """
    measured, step = record.part(record.bench_angle), record.steps[0]
    values = distinct_values(measured, most=int(SLOW))
    levels = np.inf if values is None else len(values)
    return float(levels if step is None else min(np.ptp(measured) / step, levels))
