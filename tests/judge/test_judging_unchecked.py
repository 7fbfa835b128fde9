"""What is told to be unchecked in a row, or to be known: only what could change K much."""

import pytest
from conftest import noted_in

NO_FIXTURE = {"fixture": None}
HANGING = {"K": 60.6, "offset": 4.503, "fixture_weight": 5.2}
"""By hand: 5.2 N*m about an angle 60 deg off leave 4.503 N*m, and add 2.6 N*m/rad to K."""
OWN_DEVICE = {"gain_error": None, "K_over_K_d": 0.9}
LEG = {"controller": "compensated", "K_predicted": None, "K_over_K_s": 0.4}
JOINT = {
    "fault_probability": 0.0,
    "lag_s": None,
    "delay_se_s": None,
}
SHAFT = {"fault_probability": 0.0, "B_j": 1.0, "J_j": 0.1, "delay_se_s": 1e-3}
STIFF = {"K": 100.0, "I_high": -1e-5, "band_high_hz": 5.0}


@pytest.mark.parametrize(("table", "row", "name", "is_told"), [
    # most components differ from their files by less; losses differ by more
    ("belt", {"K_s_ratio": 1.04}, "parameter_differs", False),
    ("belt", {"K_s_ratio": 0.94}, "parameter_differs", True),
    ("actuator", {"k_tau_n_m_ratio": 0.96}, "parameter_differs", False),
    ("actuator", {"k_tau_n_m_ratio": 1.06}, "parameter_differs", True),
    ("transmission", {"B_j_ratio": 1.09}, "parameter_differs", False),
    ("transmission", {"B_j_ratio": 0.89}, "parameter_differs", True),
    # a gain is checked by a device, or by a component's file
    ("belt", {"K_s_ratio": None}, "wrong_gain_unseen", True),
    ("actuator", {"k_tau_n_m_ratio": None}, "wrong_gain_unseen", True),
    ("impedance", OWN_DEVICE, "wrong_gain_unseen", True),
    ("impedance", OWN_DEVICE | {"gain_error": 0.0}, "wrong_gain_unseen", False),
    # a fixture is unchecked until something of it is taken off, or it is alone
    *((table, NO_FIXTURE, "fixture_inertia", True)
      for table in ("impedance", "transmission", "torque_angle")),
    ("transmission", {"fixture": "inertia 0.01"}, "fixture_inertia", False),
    ("calibration", NO_FIXTURE | {"rest_deg": None}, "fixture_inertia", True),
    ("calibration", NO_FIXTURE | {"rest_deg": 0.1}, "fixture_inertia", False),
    ("impedance", HANGING, "zeros_disagree", True),
    ("impedance", HANGING | {"offset": 2.0}, "zeros_disagree", False),  # 0.4 N*m/rad
    # a damping unlike B_d beside a K of K_d
    ("impedance", {"B": 6.1, "B_over_B_d": 2.03}, "damping_unlike_gains", True),
    ("impedance", {"B": 3.1, "B_over_B_d": 1.03}, "damping_unlike_gains", False),
    ("impedance", {"B": 1.4, "B_over_B_d": 0.47}, "damping_unlike_gains", True),
    # a delay that may change J_j by a tenth
    ("transmission", SHAFT, "late_torque_unseen", False),
    ("transmission", SHAFT | {"delay_se_s": 0.01}, "late_torque_unseen", True),
    ("transmission", SHAFT | {"fault_probability": None}, "late_torque_unseen", True),
    ("impedance", JOINT, "late_torque_unseen", False),
    ("impedance", JOINT | {"delay_se_s": 1e-4}, "late_torque_unseen", True),
    ("impedance", JOINT | {"fault_probability": None}, "late_torque_unseen", True),
    ("impedance", JOINT | {"fault_probability": None, "lag_s": 0.0}, "late_torque_unseen", False),
    ("impedance", LEG, "K_of_gains", True),
    ("impedance", LEG | {"K_over_K_s": None}, "K_of_gains", False),
    ("impedance", {"band_high_hz": 20.0, "cutoff_hz": 15.0}, "motion_above_cutoff", True),
    ("impedance", {"band_high_hz": 5.0, "cutoff_hz": 15.0}, "motion_above_cutoff", False),
    ("impedance", {"clock_ppm": None, "amplitude_deg": None}, "clock_rate_unseen", True),
    ("impedance", {"clock_ppm": 12.0, "amplitude_deg": None}, "clock_rate_unseen", False),
    # N*m read as N*mm, without gains to compare with; and a pure damper
    ("impedance", {"K": 0.15, "B": 0.003}, "unlikely_size", True),
    ("impedance", {"K": 0.15, "B": 3.0}, "unlikely_size", False),
    ("walking_groups", {"K": 340.0}, "walking_unseen", True),
    ("walking_groups", {"K": None}, "walking_unseen", False),
    # 3 and 1 N*m/rad at 5 Hz, beside 2 of K
    ("impedance", STIFF | {"I": -3e-3}, "negative_inertia", True),
    ("impedance", STIFF | {"I": -1e-3}, "negative_inertia", False),
    ("walking_groups", {"I_high": -0.01}, "negative_inertia", True),
    ("transmission", {"J_j_high": 0.01}, "negative_inertia", False),
])  # fmt: skip
def test_what_a_row_does_not_show_is_told(table, row, name, is_told):
    assert (name in [finding.name for finding in noted_in(table, row)]) is is_told
