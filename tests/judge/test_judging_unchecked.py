# SPDX-License-Identifier: Apache-2.0
"""What is told to be unchecked in a row, or to be known: only what could change K much."""

import pytest
from conftest import findings_of

from osl_analysis.judge.limits import Limits

NO_FIXTURE = {"fixture": None}


@pytest.mark.parametrize(
    ("name", "table", "told", "not_told"),
    [
        # a gain is checked by a component's file, from which most components differ by less
        ("wrong_gain", "belt", [{"K_s_ratio": 0.94}, {"K_s_ratio": None}], [{"K_s_ratio": 1.04}]),
        (
            "wrong_gain",
            "actuator",
            [{"k_tau_n_m_ratio": 1.06}, {"k_tau_n_m_ratio": None}],
            [{"k_tau_n_m_ratio": 0.96}],
        ),
        ("wrong_gain", "actuator", [{"speed_alone": True}], [{"speed_alone": None}]),
        ("torque_path", "actuator", [{"torque_from": "iq"}], [{"torque_from": None}]),
        # a fixture is unchecked until something of it is taken off, or it is alone
        ("fixture_inertia", "transmission", [NO_FIXTURE], [{"fixture": "inertia 0.01"}]),
        (
            "fixture_inertia",
            "calibration",
            [NO_FIXTURE | {"rest_deg": None}],
            [NO_FIXTURE | {"rest_deg": 0.1}],
        ),
        # a damping unlike B_d beside a K of K_d
        (
            "damping_unlike_gains",
            "impedance",
            [{"K_over_K_d": 1.0, "B_over_B_d": 2.03}, {"K_over_K_d": 1.0, "B_over_B_d": 0.47}],
            [{"K_over_K_d": 1.0, "B_over_B_d": 1.03}, {"K_over_K_d": 2.03, "B_over_B_d": 2.03}],
        ),
        # N*m read as N*mm, without gains to compare with; and a pure damper
        ("unlikely_size", "impedance", [{"K": 0.15, "B": 0.003}], [{"K": 0.15, "B": 3.0}]),
    ],
)
def test_what_a_row_does_not_show_is_told(name, table, told, not_told):
    def is_told(row):
        findings = findings_of({"trial": "a", **row}, Limits(), table)
        return name in [finding.source for finding in findings]

    assert [row for row in told if not is_told(row)] == []
    assert [row for row in not_told if is_told(row)] == []
