# SPDX-License-Identifier: Apache-2.0
"""Scale and zero of a load cell by dead weights, with an uncertainty that holds."""

import numpy as np
import pytest
from command_line import call
from conftest import refused_with

from osl_analysis.bench.dead_weights import STANDARD_GRAVITY, gain_of_weights
from osl_analysis.commands.dead_weights import gain_in_table

SCALE = 2.4e-5  # N*m per count
ZERO = 8400.0
ARM = np.full(7, 0.15)
MASS = np.array([0, 0.5, 1, 2, 1, 0.5, 0])


def counts_of(torque, scale=SCALE):
    return ZERO + torque / scale


@pytest.mark.parametrize("scale", [SCALE, -SCALE])
def test_the_line_through_the_rows_is_scale_and_zero(scale):
    gain = gain_of_weights(ARM, MASS, counts_of(9.81 * MASS * ARM, scale), gravity=9.81)

    assert gain.scale == pytest.approx(scale, rel=1e-12)
    assert gain.zero == pytest.approx(ZERO, rel=1e-12)
    assert gain.gain_error < 1e-12


@pytest.mark.parametrize("rows", [4, 7])
def test_the_interval_of_the_scale_holds_the_truth_in_95_percent(rows):
    """Of few rows, too: Student's quantile is in the standard error."""
    random = np.random.default_rng(11)
    arm, mass = ARM[:rows], MASS[:rows]
    held = []
    for _ in range(2000):
        true_arm = arm + random.normal(0, 0.001)
        true_mass = mass + (mass > 0) * random.normal(0, 0.002)
        counts = counts_of(9.81 * true_mass * true_arm) + random.normal(0, 150, rows)
        gain = gain_of_weights(arm, mass, counts, 0.001, 0.002, gravity=9.81)
        held.append(abs(gain.scale / SCALE - 1) < 1.96 * gain.gain_error)

    assert 0.935 < np.mean(held) < 0.985


def test_what_all_rows_share_is_not_averaged():
    few, many = (
        gain_of_weights(
            np.tile(ARM, n), np.tile(MASS, n), counts_of(np.tile(MASS * ARM, n)), 0.0015, 0.01
        )
        for n in (1, 50)
    )

    # 1.5 mm of 150 mm; 26 mm/s^2 / sqrt(3) of gravity
    for gain in (few, many):
        assert gain.shares["arm"] == pytest.approx(0.01, rel=0.02)
        assert gain.shares["gravity"] == pytest.approx(0.026 / np.sqrt(3) / STANDARD_GRAVITY)
        assert gain.shares["mass"] == pytest.approx(few.shares["mass"])


def test_a_known_gravity_has_no_share():
    gain = gain_of_weights(ARM, MASS, counts_of(9.81 * MASS * ARM), gravity=9.81)

    assert gain.shares["gravity"] == 0


@pytest.mark.parametrize(
    ("mass", "counts"), [(MASS[:2], counts_of(MASS[:2])), (MASS, MASS * 0), (0 * MASS, MASS)]
)
def test_rows_that_tell_no_gain_are_refused(mass, counts):
    with refused_with("tell no gain"):
        gain_of_weights(ARM[: mass.size], mass, counts)


TABLE = "arm [mm],mass [g],counts\n" + "".join(
    f"150,{1000 * mass:g},{counts_of(STANDARD_GRAVITY * mass * 0.15):.3f}\n" for mass in MASS
)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (TABLE.replace("arm [mm]", "arm"), "column 'arm': '' is no unit of length"),
        (TABLE.replace("[g]", "[N]"), "column 'mass': 'N' is no unit of mass"),
        (TABLE.replace("counts", "reading"), "0 columns 'counts' .*reading"),
    ],
)
def test_a_table_without_its_columns_or_units_is_refused_by_name(tmp_path, text, said):
    (tmp_path / "weights.csv").write_text(text)

    with refused_with(said):
        gain_in_table(tmp_path / "weights.csv")


def test_the_command_prints_what_to_state(tmp_path):
    (tmp_path / "weights.csv").write_text(TABLE)

    printed = call("dead-weights", tmp_path / "weights.csv", "--arm-error", "0.3 mm").output

    assert "scale: 0.000024, offset: -8400}" in printed
    # 0.2 % of the arm and 0.153 % of gravity
    assert "torque_gain: 0.0025}" in printed
