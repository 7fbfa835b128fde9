# SPDX-License-Identifier: Apache-2.0
"""The names of the candidate models (`candidate_models.py` explains them)."""

from enum import StrEnum


class ModelName(StrEnum):
    """A candidate model, as budgets and readers call it."""

    EQ_15 = "nothing"  # beside Eq. 15
    DELAY = "delay"
    LOW_PASS = "low-pass"
    SPRING_IN_SERIES = "spring in series"
    CHANGE_OVER_TIME = "change over time"
    CHANGE_AT_ONCE = "change at once"
    DAMPING_BY_SPEED = "damping by speed"
    NONLINEAR_SPRING = "nonlinear spring"
    K_BY_SIDE = "K by side"
    VISCOELASTIC_BRANCH = "viscoelastic branch"
    K_AND_B_BY_DIRECTION = "K and B by direction"
    BACKLASH = "backlash"
    BACKLASH_IN_MOUNT = "backlash in the mount"
    CLIPPING = "clipping"
