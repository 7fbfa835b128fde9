"""What is told to be unchecked in a row, or to be known: only what could change K much."""

import pytest
from conftest import noted_in

NO_FIXTURE = {"fixture": None}
HANGING = {"K": 60.6, "offset": 4.503, "fixture_weight": 5.2}
"""By hand: 5.2 N*m about an angle 60 deg off leave 4.503 N*m, and add 2.6 N*m/rad to K."""
OWN_DEVICE = {"gain_error": None, "K_over_K_d": 0.9}
LEG = {"controller": "compensated", "K_predicted": None, "K_over_K_s": 0.4}
JOINT = {"fault_probability": 0.0, "lag_s": None, "delay_se_s": None}
BELT = {
    "lag_s": 0.0,
    "lag_share": 0.0,
    "lag_s_low": -1e-3,
    "lag_s_high": 1e-3,
    "K": 300.0,
    "B": 5.0,
}
SHAFT = {"fault_probability": 0.0, "B_j": 1.0, "J_j": 0.1, "delay_se_s": 1e-3}
AS_COMMANDED = {"K_over_K_d": 1.0}
CLOCK = {"clock_ppm": None, "amplitude_deg": None}
STIFF = {"K": 100.0, "I_high": -1e-5, "band_high_hz": 5.0}


@pytest.mark.parametrize(("name", "table", "told", "not_told"), [
    # most components differ from their files by less; losses differ by more
    ("parameter_differs", "belt", [{"K_s_ratio": 0.94}], [{"K_s_ratio": 1.04}]),
    ("parameter_differs", "actuator", [{"k_tau_n_m_ratio": 1.06}], [{"k_tau_n_m_ratio": 0.96}]),
    ("parameter_differs", "transmission", [{"B_j_ratio": 0.89}], [{"B_j_ratio": 1.09}]),
    # a gain is checked by a device, or by a component's file
    ("wrong_gain_unseen", "belt", [{"K_s_ratio": None}], []),
    ("wrong_gain_unseen", "actuator", [{"k_tau_n_m_ratio": None}], []),
    ("wrong_gain_unseen", "impedance", [OWN_DEVICE],
     [OWN_DEVICE | {"gain_error": 0.0}, OWN_DEVICE | {"K_over_K_d": 8.85}]),
    # a fixture is unchecked until something of it is taken off, or it is alone
    ("fixture_inertia", "impedance", [NO_FIXTURE], []),
    ("fixture_inertia", "torque_angle", [NO_FIXTURE], []),
    ("fixture_inertia", "transmission", [NO_FIXTURE], [{"fixture": "inertia 0.01"}]),
    ("fixture_inertia", "calibration", [NO_FIXTURE | {"rest_deg": None}],
     [NO_FIXTURE | {"rest_deg": 0.1}]),
    ("zeros_disagree", "impedance", [HANGING], [HANGING | {"offset": 2.0}]),  # 0.4 N*m/rad
    # a damping unlike B_d beside a K of K_d
    ("damping_unlike_gains", "impedance",
     [AS_COMMANDED | {"B_over_B_d": 2.03}, AS_COMMANDED | {"B_over_B_d": 0.47}],
     [AS_COMMANDED | {"B_over_B_d": 1.03}, {"K_over_K_d": 2.03, "B_over_B_d": 2.03},
      AS_COMMANDED | {"B_over_B_d": 2.03, "coulomb_share": 0.5, "amplitude_deg": None}]),
    # a delay that may change J_j by a tenth
    ("late_torque_unseen", "transmission",
     [SHAFT | {"delay_se_s": 0.01}, SHAFT | {"fault_probability": None}], [SHAFT]),
    ("late_torque_unseen", "impedance",
     [JOINT | {"delay_se_s": 1e-4}, JOINT | {"fault_probability": None}],
     [JOINT, JOINT | {"fault_probability": None, "lag_s": 0.0}]),
    # a delay that the belt tells so badly that B may be off by 0.3 of 5 N*m*s/rad
    ("late_torque_unseen", "impedance", [BELT | {"lag_s": 0.0}],
     [BELT | {"lag_s": 0.0, "lag_s_high": -1e-4}, BELT | {"lag_s": 0.0, "lag_share": 0.5}]),
    ("late_torque_unseen", "walking_groups", [{"K": 300.0, "plate_lag_sd_s": None}],
     [{"K": 300.0, "plate_lag_sd_s": 2e-4}]),
    ("K_of_gains", "impedance", [LEG], [LEG | {"K_over_K_s": None}]),
    ("motion_above_cutoff", "impedance", [{"band_high_hz": 20.0, "cutoff_hz": 15.0}],
     [{"band_high_hz": 5.0, "cutoff_hz": 15.0}]),
    ("clock_rate_unseen", "impedance", [CLOCK], [CLOCK | {"clock_ppm": 12.0}]),
    # N*m read as N*mm, without gains to compare with; and a pure damper
    ("unlikely_size", "impedance", [{"K": 0.15, "B": 0.003}], [{"K": 0.15, "B": 3.0}]),
    ("walking_unseen", "walking_groups", [{"K": 340.0}], [{"K": None}]),
    # 3 and 1 N*m/rad at 5 Hz, beside 2 of K
    ("negative_inertia", "impedance", [STIFF | {"I": -3e-3}], [STIFF | {"I": -1e-3}]),
    ("negative_inertia", "walking_groups", [{"I_high": -0.01}], []),
    ("negative_inertia", "transmission", [], [{"J_j_high": 0.01}]),
])  # fmt: skip
def test_what_a_row_does_not_show_is_told(name, table, told, not_told):
    def is_told(row):
        return name in [finding.name for finding in noted_in(table, row)]

    assert [row for row in told if not is_told(row)] == []
    assert [row for row in not_told if is_told(row)] == []
