# SPDX-License-Identifier: Apache-2.0
"""A clamped actuator shows plateaus of its current over most of the range of the current."""

import numpy as np
import pytest

from osl_analysis.signals.plateaus import is_clamped

RATE = 100.0


@pytest.mark.parametrize(("step", "is_one"), [(0.7, False), (0.8, True)])
def test_plateaus_span_half_of_the_current_or_are_rests_between_motions(step, is_one):
    """Nine plateaus, and after them a current of 12 A for a second."""
    levels = step * np.arange(9)
    current = np.append(np.repeat(levels, round(RATE)), np.full(round(RATE), 12.0))
    time = np.arange(len(current)) / RATE
    plateaus = [slice(100 * k, 100 * (k + 1)) for k in range(9)]

    assert is_clamped(time, current, plateaus, None, True, 0.01) == is_one
