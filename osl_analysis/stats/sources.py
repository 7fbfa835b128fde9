# SPDX-License-Identifier: Apache-2.0
"""The names of sources: what contributes to the uncertainty of an estimate, and what is found in a
recording or a fit.

A source of a budget may become a finding, so both share one list. Their titles and sentences stand
in `judge/words.yaml`; tables hold the values below.
"""

from enum import StrEnum


class Source(StrEnum):
    """A source of an estimate's uncertainty, or of a finding."""

    # In intervals: the scatter of the recording, and errors that no scatter shows
    REPEATABILITY = "repeatability"
    ENCODER = "encoder"
    FRICTION_SIGN = "friction_sign"
    FRICTION_SHAPE = "friction_shape"
    LOADING_BEGINS = "loading_begins"
    SPRING_LOSS = "spring_loss"
    BELT_ERROR = "belt_error"
    THETA_M_DELAY = "theta_m_delay"
    LOAD_CELL_DRIFT = "load_cell_drift"
    KNOWN_PART = "known_part"
    COMPONENT = "component"  # of a drivetrain
    BENCH = "bench"  # all that is stated of it
    TORQUE_GAIN = "torque_gain"
    ANGLE_GAIN = "angle_gain"
    HYSTERESIS = "hysteresis"
    DELAY = "delay"
    HELD_DELAY = "held_delay"  # what the beat of a slower torque leaves open
    FIXTURE = "fixture"
    BENCH_STIFFNESS = "bench_stiffness"
    # ... of crossings
    CROSSINGS = "crossings"
    MEAN_GAIT = "mean_gait"
    ONSET = "onset"
    PLATE_INERTIA = "plate_inertia"
    PLATE_LAG = "plate_lag"
    # In ranges: another motion, or another choice of the analyst
    AMPLITUDE = "amplitude"
    WINDOW = "window"
    OFFSET = "offset"

    # Findings of budgets
    TORQUE_PATH = "torque_path"
    CHANGE_OVER_TIME = "change_over_time"
    PLAY_OR_SPEED = "play_or_speed"
    WEIGHT_ON_JOINT = "weight_on_joint"
    CLIPPED_SIGNAL = "clipped_signal"
    UNDECIDED_TIME_STAMPS = "undecided_time_stamps"
    UNEXPLAINED_TORQUE = "unexplained_torque"
    LATE_TORQUE = "late_torque"
    WRONG_GAIN = "wrong_gain"
    FRICTION = "friction"
    NONLINEAR_SPRING = "nonlinear_spring"
    VISCOELASTIC = "viscoelastic"
    CLOCKS_DISAGREE = "clocks_disagree"
    FIXTURE_INERTIA = "fixture_inertia"
    PLATE_HEIGHT = "plate_height"
    PLATE_UNSEEN = "plate_unseen"
    WALKING_UNSEEN = "walking_unseen"
    WIDE_INTERVAL = "wide_interval"

    # Findings of rules on result tables, and of trials together
    STATED_LIMIT = "stated_limit"  # of the configuration, on a column that no rule names
    UNLIKELY_SIZE = "unlikely_size"
    IMPOSSIBLE_ESTIMATE = "impossible_estimate"
    WRONG_UNIT = "wrong_unit"
    OPEN_LOOP = "open_loop"
    DAMPING_UNLIKE_GAINS = "damping_unlike_gains"
    COLUMNS_CONTRADICT = "columns_contradict"
    MIXED_GROUP = "mixed_group"
    SELECTED_CROSSINGS = "selected_crossings"
    SMOOTHED_MARKERS = "smoothed_markers"
    SLOW_RAMP = "slow_ramp"
    SET_UP_DIFFERS = "set_up_differs"
    UNLIKE_OTHER_TRIALS = "unlike_other_trials"
    COMMON_FACTOR = "common_factor"

    # Findings of checks of recordings
    SLOW_SAMPLING = "slow_sampling"
    GAP_IN_RECORDING = "gap_in_recording"
    FROZEN_SIGNAL = "frozen_signal"
    SIGNAL_JUMPS = "signal_jumps"
    NOT_ZEROED = "not_zeroed"
    ANGLE_WRAPS = "angle_wraps"
    OCCLUDED_MARKER = "occluded_marker"
    WRONG_CENTRE_OF_PRESSURE = "wrong_centre_of_pressure"
    DAMAGED_LOG = "damaged_log"
    OTHER_MOTION = "other_motion"
