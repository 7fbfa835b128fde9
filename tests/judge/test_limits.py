# SPDX-License-Identifier: Apache-2.0
"""Where each limit on a number of a result table stands: what is still sound, and what is not.

The values are stated here, beside the limit and not from it, so that a limit that is moved by half
no longer parts them.
"""

import pytest
from conftest import findings_of
from shipped import SETTINGS

from osl_analysis.judge.checks import CHECKS
from osl_analysis.judge.limits import DoubtfulFits, Limits
from osl_analysis.judge.rules import Grade, Table, number_rules

DOUBTFUL = DoubtfulFits.model_validate(SETTINGS["doubtful"])

# table, column, the numbers that are still sound, those that are not, and what they are
LIMITS = [
    ("impedance", "saturated_samples", [5], [6], "clipped_signal"),
    ("transmission", "load_cell_drift", [-0.49, 0.49], [-0.51, 0.51], "change_over_time"),
    ("torque_angle", "closure_torque", [0.049], [0.051], "open_loop"),
    ("torque_angle", "returned_share", [1.0], [1.02], "open_loop"),
    ("calibration", "fixture_error", [0.99], [1.01], "fixture_inertia"),
    ("calibration", "certain_clock_drift_ppm", [-0.9, 0.9], [-1.1, 1.1], "clocks_disagree"),
    ("calibration", "certain_lag_s", [-1.9e-5, 1.9e-5], [-2.1e-5, 2.1e-5], "late_torque"),
    ("calibration", "certain_gain_error", [-1.9e-3, 1.9e-3], [-2.1e-3, 2.1e-3], "wrong_gain"),
    ("walking_groups", "marker_noise_ratio", [1.1e-3], [0.9e-3], "smoothed_markers"),
    ("walking_groups", "foot_residual_ratio", [2.9], [3.1], "occluded_marker"),
    ("walking_groups", "turn_share", [0.91], [0.89], "slow_ramp"),
    ("walking", "residual_over_gait", [5.9], [6.1], "unexplained_torque"),
    ("walking_groups", "residual_over_gait", [5.9], [6.1], "unexplained_torque"),
    ("walking_groups", "offset_share", [-0.49, 0.49], [-0.51, 0.51], "unexplained_torque"),
    ("walking_groups", "pace_change", [-0.049, 0.049], [-0.051, 0.051], "mixed_group"),
    ("walking_groups", "onset_phase_sd", [0.049], [0.051], "mixed_group"),
    ("impedance", "K_over_K_s", [0.99], [1.01], "unlikely_size"),
    ("impedance", "K_over_K_d", [0.51, 1.05], [0.49, 1.07], "unlikely_size"),
    ("impedance", "K", [4990.0], [5010.0], "unlikely_size"),
    ("impedance", "angle_too_small", [1.9], [2.1], "wrong_unit"),
    ("impedance", "K_ratio", [0.95, 1.05], [0.93, 1.07], "unlikely_size"),
    ("belt", "shaft_turn", [-0.019], [-0.021], "impossible_estimate"),
    ("walking_groups", "K", [0.01], [-0.01], "impossible_estimate"),
    ("impedance", "B_high", [0.01], [-0.01], "impossible_estimate"),
    ("impedance", "f_C_high", [0.01], [-0.01], "impossible_estimate"),
    ("actuator", "B_m_high", [0.01], [-0.01], "impossible_estimate"),
    ("actuator", "J_m_high", [1e-4], [-1e-4], "impossible_estimate"),
    ("torque_angle", "K", [1.1, 9990.0], [0.9, 10_010.0], "unlikely_size"),
    ("walking_groups", "I_high", [-0.29], [-0.31], "impossible_estimate"),
    ("transmission", "B_j_high", [0.01], [-0.01], "late_torque"),
    ("belt", "B_loading_high", [0.01], [-0.01], "late_torque"),
    ("walking_groups", "plate_drift", [0.9e-3], [1.1e-3], "clocks_disagree"),
    ("walking_groups", "plate_lag_change_s", [-0.9e-3, 0.9e-3], [-1.1e-3, 1.1e-3],
     "clocks_disagree"),
    ("impedance", "gear_ratio", [0.98, 1.02], [0.96, 1.04], "columns_contradict"),
    ("belt", "energy_lost", [0.09], [0.11], "open_loop"),
    ("belt", "K_s_ratio", [0.96, 1.04], [0.5, 1.6], "unlikely_size"),
    ("impedance", "K_s_ratio", [0.7, 1.45], [0.63, 1.55], "unlikely_size"),
    ("transmission", "B_j_ratio", [0.35, 2.9], [0.32, 3.1], "unlikely_size"),
    ("transmission", "J_j_ratio", [0.35, 2.9], [0.32, 3.1], "unlikely_size"),
    ("actuator", "f_C_ratio", [4.9], [5.1], "unlikely_size"),
    ("actuator", "k_tau_n_m_ratio", [0.96, 1.04], [0.79, 1.26], "unlikely_size"),
    ("actuator", "J_m_ratio", [0.35, 2.9], [0.32, 3.1], "unlikely_size"),
    ("impedance", "B_gap_s", [-1.7e-3, 1.7e-3], [-1.8e-3, 1.8e-3], "damping_unlike_gains"),
    ("impedance", "VAF", [71.0], [69.0], "unexplained_torque"),
    ("torque_angle", "VAF", [98.1], [97.9], "unexplained_torque"),
    ("walking_groups", "VAF", [81.0], [79.0], "unexplained_torque"),
    ("walking", "bridged", [0.09], [0.11], "occluded_marker"),
    ("walking_groups", "unperturbed_stance_sd", [0.069], [0.071], "mixed_group"),
    ("walking_groups", "left_out_share", [0.32], [0.34], "selected_crossings"),
    ("walking_groups", "different_mm", [7.9], [8.1], "set_up_differs"),
    ("walking_groups", "plate_height_m", [-0.0099, 0.0099], [-0.0101, 0.0101], "plate_height"),
    ("walking_groups", "plate_lag_sd_s", [0.9e-3], [1.1e-3], "clocks_disagree"),
    ("walking_groups", "cop_outside_m", [0.029], [0.031], "wrong_centre_of_pressure"),
]  # fmt: skip
REMARKS = [
    ("belt", "K_s_ratio", [0.96, 1.04], [0.94, 1.06], "wrong_gain"),
    ("actuator", "k_tau_n_m_ratio", [0.96, 1.04], [0.94, 1.06], "wrong_gain"),
    ("impedance", "B_over_B_d", [0.51, 1.49], [0.49, 1.51], "damping_unlike_gains"),
]
CASES = [(*case, Grade.DOUBTS) for case in LIMITS] + [(*case, Grade.NOTES) for case in REMARKS]


def sources_found(table, row, grade):
    """What is found in a row that has a fit, with this grade."""
    findings = findings_of({"trial": "a", **row}, DOUBTFUL.of(table), table)
    return [finding.source for finding in findings if finding.grade is grade]


@pytest.mark.parametrize(("table", "column", "sound", "beyond", "source", "grade"), CASES)
def test_a_number_is_found_beyond_its_limit_and_not_within(
    table, column, sound, beyond, source, grade
):
    assert [sources_found(table, {column: value}, grade) for value in sound] == [[]] * len(sound)
    assert [sources_found(table, {column: value}, grade) for value in beyond] == [[source]] * len(
        beyond
    )


def test_each_limit_on_a_column_has_such_a_test():
    listed = {(rule.column, rule.source) for rule in number_rules()}
    limited_columns = {column for table in Table for column, _ in DOUBTFUL.of(table).by_column}

    assert listed == {(column, source) for _, column, _, _, source, _ in CASES}
    assert limited_columns <= {column for _, column, *_ in CASES}


@pytest.mark.parametrize(("K", "B", "is_too_soft"), [
    (0.9, 0.09, True), (1.1, 0.09, False), (0.9, 0.11, False), (-0.9, -0.09, True),
    (None, 0.09, False),
])  # fmt: skip
def test_a_joint_that_is_too_soft_has_neither_stiffness_nor_damping(K, B, is_too_soft):
    assert (
        sources_found("impedance", {"K": K, "B": B}, Grade.DOUBTS)
        == ["unlikely_size"] * is_too_soft
    )


@pytest.mark.parametrize(("share", "is_unit"), [(1.035, True), (0.955, False)])
def test_a_ratio_is_one_of_units_within_four_percent(share, is_unit):
    """Of a torque in lbf*ft that is read as N*m, which K and B both tell."""
    ratio = share / 1.3558
    row = {"K_over_K_d": ratio, "B_over_B_d": ratio}

    doubts = sources_found("impedance", row, Grade.DOUBTS)

    assert ("wrong_unit" in doubts) == is_unit


@pytest.mark.parametrize(("check", "sound", "beyond"), [
    ("rate", 100, 99), ("gap", 0.05, 0.051), ("saturation", 5, 6), ("stuck", 0.5, 0.51),
    ("unzeroed_plate", 20, 21), ("marker_gap", 0.2, 0.21), ("cop_outside_plate", 0.03, 0.031),
    ("cop_travel", 0.02, 0.019), ("clock_residual", 1e-3, 1.1e-3), ("damage", 1.0, 1.1),
    ("contradiction", 3.0, 3.1), ("dropout", 0, 1), ("encoder_wrap", 0, 1), ("truncated", 0, 1),
    ("unit", 0, 1), ("protocol", 0, 1),
])  # fmt: skip
def test_a_check_fails_beyond_the_shipped_threshold(check, sound, beyond):
    threshold = CHECKS[check].threshold

    assert not CHECKS[check].failed(sound, threshold)
    assert CHECKS[check].failed(beyond, threshold)


def test_a_limit_that_nobody_states_is_none():
    assert findings_of({"trial": "a", "energy_lost": 0.9}, Limits(), "belt") == []
