# SPDX-License-Identifier: Apache-2.0
"""Where a channel stands, and what friction does to a torque, on both sides of each limit."""

import numpy as np
import pytest
from conftest import white_noise

from osl_analysis.signals.plateaus import run_at_extreme, standing_runs, steps_by_friction

TIME = np.arange(1000) / 100


@pytest.mark.parametrize(("least", "rows"), [(0.03, 0), (0.07, 10)])
def test_a_channel_near_zero_is_unloaded(least, rows):
    """As a share of its range."""
    clipped = np.maximum(np.abs(np.linspace(-1, 1, 201)), 0.05) + least - 0.05

    assert abs(len(clipped[run_at_extreme(clipped)]) - rows) <= 1


@pytest.mark.parametrize(("rows", "clipped"), [(9, False), (17, True)])
def test_a_channel_is_clipped_that_is_far_off_half_a_run_away(rows, clipped):
    """By more than five of its steps, of which it takes one a row."""
    values = np.concatenate([np.arange(50), np.full(rows - 2, 49), np.arange(49, 0, -1)])

    assert (len(values[run_at_extreme(1.0 * values)]) == rows) == clipped


@pytest.mark.parametrize(
    ("rows", "slope", "noise", "stands"),
    [
        # samples of one value, and the reference's change per second, as a share of its range
        (5, 1.0, 0.0, False),
        (8, 1.0, 0.0, True),
        (41, 0.035, 0.0, False),
        (41, 0.065, 0.0, True),
        # and the noise that it has
        (41, 0.2, 7e-3, False),
        (41, 0.2, 3.5e-3, True),
    ],
)
def test_a_channel_stands_while_another_moves(rows, slope, noise, stands):
    """A quarter of 41 rows is a tenth of a second."""
    values = white_noise(1000, 1)
    values[500 : 500 + rows] = values[500]
    reference = np.clip(slope * (TIME - 5.2), -0.5, 0.5) + noise * white_noise(1000, 2)
    reference[[0, -1]] = -0.5, 0.5

    runs = standing_runs(TIME, values, (TIME, reference))

    assert (len(runs) > 0) == stands


@pytest.mark.parametrize(("step", "rubs"), [(4.0, False), (7.0, True)])
def test_a_torque_steps_by_friction_where_the_joint_turns(step, rubs):
    """By more than it changes in five rows."""
    angle = -np.abs(np.arange(1000) - 500.0)
    torque = angle - step * (TIME >= 5)

    assert steps_by_friction(np.array([5.0]), (TIME, angle), (TIME, torque)).tolist() == [rubs]
