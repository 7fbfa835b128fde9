# SPDX-License-Identifier: Apache-2.0
"""Signs, sizes and units that cannot be right: refused or doubtful with the cause, in `fit` as in a
campaign."""

from contextlib import nullcontext

import numpy as np
import polars as pl
import pytest
from bench_recordings import RECORDINGS
from bench_synthetic import PROTOCOL, second_order, true_motion
from conftest import beyond_in, joint_trial, least_squares_alone, refused_with
from shipped import CONFIG, DEVICE, LEG

from osl_analysis.base.errors import InputError
from osl_analysis.base.trial import Trial
from osl_analysis.bench.bench_settings import (
    BenchStiffness,
)
from osl_analysis.bench.evidence import DesiredImpedance, beside_known
from osl_analysis.bench.plausibility import check_stiffer, unit_of_step
from osl_analysis.commands.fit import fit_trial
from osl_analysis.ingest.guard import check_recording
from osl_analysis.stats.budget import Budget, Contribution

SINES = {
    "amplitudes_deg": tuple(np.rad2deg(PROTOCOL.amplitudes)),
    "frequencies_hz": PROTOCOL.frequencies_hz,
}
BENCH = CONFIG.dynamometer.model_copy(update=SINES | {"cycles": PROTOCOL.cycles})


def clipped(signal):
    limit = np.quantile(np.abs(signal), 0.97)
    return np.clip(signal, -limit, limit)


def changed(experiment, **changes):
    """A recording with some signals multiplied by a factor, or changed by a function."""
    recording = dict(RECORDINGS[experiment])
    for name, by in changes.items():
        recording[name] = by(recording[name]) if callable(by) else by * recording[name]
    return recording


def judged(experiment, recording, bench=BENCH, asked=None, fixture=None):
    """The last row of the table by the one door to a fit, which knows K_d if it is `asked`, and
    what is `beyond`."""
    chosen = CONFIG.model_copy(update={"dynamometer": bench})
    trial = Trial("made", pl.DataFrame(recording), {"columns": {"torque": {"fixture": fixture}}})
    fit = fit_trial(experiment, trial, DEVICE, chosen, asked)
    return dict(fit.row) | {"beyond": beyond_in(fit.findings[-1]), "findings": fit.findings[-1]}


KNOWN = DesiredImpedance("compensated", 200, 4)


@least_squares_alone
@pytest.mark.parametrize(
    ("experiment", "changes", "words"),
    [
        ("transmission", {"torque": -1}, "B_j = -0.4.*`sign`"),
        ("belt", {"torque": -1}, "K_s = -68.*`sign`"),
        ("actuator", {"current": -1}, "k_tau_n_m = -1.02, f_C = 0.*;.*`sign`.*current"),
        ("actuator", {"torque_m": -1}, "k_tau_n_m = -1.02, f_C = -0.*;.*`sign`.*torque_m"),
        ("actuator", {"theta_m": -1}, "k_tau_n_m = 1.02, f_C = -0.*;.*`sign`.*theta_m"),
        ("belt", {"theta": 57.3, "theta_m": 57.3}, "theta.*rad.*;.*`unit: deg`.*theta.*: K_s 6"),
    ],
)
def test_what_cannot_be_is_refused_with_its_cause(experiment, changes, words):
    with refused_with(words):
        judged(experiment, changed(experiment, **changes))


@least_squares_alone
def test_a_negative_stiffness_is_a_wrong_sign_where_one_is_stated():
    """The torque is late, too, which would make B negative with the right sign."""
    with refused_with("K = -198.* drives the motion"):
        judged(
            "impedance",
            changed("impedance", torque=lambda torque: -np.roll(torque, 20)),
            asked=KNOWN,
        )


TURNING = np.sin(np.arange(1000) / 10)


@pytest.mark.parametrize(
    ("theta", "words", "is_tried"),
    [
        (7 * TURNING, "theta.*[+-]7 rad.*`largest_angle`", True),
        (TURNING % (2 * np.pi), "`wraps_at: 360`", False),
    ],
)
def test_another_unit_of_a_too_large_angle_is_tried_where_nothing_jumps(theta, words, is_tried):
    trial = joint_trial(np.arange(1000) / 100, theta, 9 * theta)
    with pytest.raises(InputError, match=words) as refused:
        check_recording(trial, BENCH)
    tried = [change.factors["theta"] for change in refused.value.changes]
    assert tried == (pytest.approx([np.pi / 180, 1e-3]) if is_tried else [])  # deg, mrad


@pytest.mark.parametrize(
    ("step", "factor"),
    [
        (2 * np.pi / 2**14, 1.0),
        (np.radians(2 * np.pi / 2**14), 180 / np.pi),
        (0.0, None),
        (1e-3, None),
    ],
)
def test_the_step_of_an_encoder_tells_radians_from_degrees(step, factor):
    assert unit_of_step(step) == factor


@least_squares_alone
def test_the_weight_of_a_foot_is_found_and_told_of_its_inertia():
    recording = dict(RECORDINGS["transmission"])
    recording["torque"] = recording["torque"] + 1.5 * np.sin(recording["theta"])
    row = judged("transmission", recording)
    assert "weight on the joint" in row["remarks"].split("; ")


@least_squares_alone
@pytest.mark.parametrize("experiment", ["impedance", "transmission", "belt"])
def test_inertia_and_weight_of_a_fixture_are_taken_off_the_torque(experiment):
    """The estimates are those of the joint alone, to a thousandth of what the fixture adds to
    them."""
    recording = dict(RECORDINGS[experiment])
    sound = judged(experiment, RECORDINGS[experiment])
    theta = recording["theta"]
    stated = {"inertia": 0.02, "weight": 1.0, "rest_deg": 60.0}
    alpha = true_motion(recording["time"], theta).alpha
    recording["torque"] = recording["torque"] + 0.02 * alpha + np.sin(theta - np.pi / 3)
    added = judged(experiment, recording)
    found = judged(experiment, recording, fixture=stated)
    adds = {
        "impedance": {"K": 0.4, "I": 0.019},
        "transmission": {"J_j": 0.01},
        "belt": {"K_s": 0.4},
    }
    for name, least in adds[experiment].items():
        assert added[name] - sound[name] > least
        assert found[name] == pytest.approx(sound[name], abs=1e-3 * (added[name] - sound[name]))
    assert found["doubtful"] is None


@pytest.mark.parametrize(
    ("experiment", "changes"),
    [
        *((experiment, {}) for experiment in RECORDINGS),
        # a device that differs
        ("belt", {"torque": 0.8}),
        ("belt", {"torque": 1.3}),
        ("actuator", {"torque_m": 1.5**0.5}),
    ],
)
def test_a_sound_recording_is_not_doubtful(experiment, changes):
    row = judged(experiment, changed(experiment, **changes))
    assert row["doubtful"] is None


@least_squares_alone
@pytest.mark.parametrize(
    ("experiment", "changes", "cause", "column", "side"),
    [
        ("actuator", {"theta_m": 180 / np.pi}, "unlikely size", "J_m_ratio", "below"),
        ("actuator", {"torque_m": 0.113}, "another unit", "k_tau_n_m_ratio", "below"),
        ("belt", {"torque": 4.4482}, "another unit", "K_s_ratio", "above"),
        ("transmission", {"torque": 0.01}, "another unit", "B_j_ratio", "below"),
        # within the limits of a device that differs, a factor between units is named where a
        # witness agrees
        ("belt", {"torque": 1 / 1.3558}, "another unit", "K_s_ratio", "near"),
        ("transmission", {"torque": 1.3558}, "another unit", "B_j_ratio", "near"),
        *(
            ("actuator", {"current": factor}, "another unit", "k_tau_n_m_ratio", side)
            for factor, side in ((1.5**0.5, "near"), (2**0.5, "below"), (3**-0.5, "above"))
        ),
        ("impedance", {"torque": 0.01}, "unlikely size", "K_ratio", "below"),
        ("impedance", {"torque": 4.4482}, "unlikely size", "K_over_K_s", "above"),
        ("impedance", {"torque": clipped}, "clipped signal", "saturated_samples", "above"),
        ("actuator", {"current": clipped}, "clipped signal", "saturated_samples", "above"),
        (
            "belt",
            {"theta": lambda x: x.clip(max=0.9 * x.max())},
            "clipped signal",
            "saturated_samples",
            "above",
        ),
        # a delay of 4 ms adds -K_s 4 ms = -2.7 N*m*s/rad to the damping
        (
            "belt",
            {"torque": lambda torque: np.roll(torque, 2)},
            "delay of the torque",
            "B_loading_high",
            "below",
        ),
    ],
)
def test_what_is_not_likely_is_doubtful_with_its_cause(experiment, changes, cause, column, side):
    row = judged(
        experiment,
        changed(experiment, **changes),
        asked=KNOWN if experiment == "impedance" else None,
    )
    (finding,) = (one for one in row["findings"] if column in beyond_in([one]))
    assert (finding.cause, row["beyond"][column]) == (cause, side)


def test_a_shaft_that_yields_against_the_joint_has_the_wrong_sign():
    theta = RECORDINGS["belt"]["theta"]
    n_T = 83 / 18
    for way, cause in ((1, ""), (-1, "impossible estimate")):
        shaft = way * 0.1 * n_T * theta  # which takes a tenth of the joint's angle
        made = {"theta_m": shaft, "torque": RECORDINGS["belt"]["torque"] - 685.6 * 0.1 * theta}
        row = judged("belt", RECORDINGS["belt"] | made)
        assert row["shaft_turn"] == pytest.approx(way * 0.1 * n_T, rel=1e-3)
        assert row["K_s"] == pytest.approx(685.6 * 0.9 / (1 - way * 0.1), rel=1e-3)
        assert (row["doubtful"] or "").partition(";")[0] == cause


OWN = DesiredImpedance("own", 200, None)


@least_squares_alone
@pytest.mark.parametrize(
    ("asked", "column", "factor", "side"),
    [
        (KNOWN, "K_ratio", 0.9, "below"),
        (KNOWN, "K_ratio", 1.356, "above"),
        (KNOWN, "K_ratio", 1.0, None),
        # where gains are not known
        (OWN, "K_over_K_d", 1e-3, "below"),
        (OWN, "K_over_K_d", 0.7, None),
        (OWN, "K_over_K_d", 1.1, "above"),
        (OWN, "K_over_K_d", 1.04, None),
    ],
)
def test_a_stiffness_unlike_what_was_asked_is_doubtful(asked, column, factor, side):
    row = judged("impedance", changed("impedance", torque=factor), asked=asked)
    assert row["beyond"].get(column) == side


@pytest.mark.parametrize(
    ("half_range", "B_viscous", "ratios"),
    [
        (0.0, None, (1.1, 0.9)),
        (12.0, 1.48, (1.04, 0.74)),
        (30.0, None, (1.0, 0.9)),
    ],
)
def test_the_nearest_of_the_range_and_damping_without_friction_are_compared(
    half_range, B_viscous, ratios
):
    """A spring that hardens renders K_d at another amplitude."""
    estimates = {"K": 220.0, "K_without_friction": None, "B": 1.8, "B_viscous": B_viscous}
    row = {"amplitude_deg": None, "K_predicted": None, **estimates}
    motion = Contribution("nonlinear_spring", half_range, part="motion")
    K = Budget(220.0, (motion,))

    found = beside_known(pl.DataFrame([row]), None, DesiredImpedance("own", 200, 2), K)

    assert found.select("K_over_K_d", "B_over_B_d").row(0) == pytest.approx(ratios)


def leg():
    """The impedance recording with the actuator's angle that the belt leaves."""
    recording = RECORDINGS["impedance"]
    motion = true_motion(recording["time"], recording["theta"])
    of_belt = second_order(motion) - LEG.B_j * motion.omega - LEG.J_j * motion.alpha
    return recording | {"theta_m": LEG.n_T * (recording["theta"] - of_belt / LEG.K_s)}


@least_squares_alone
@pytest.mark.parametrize(
    ("changes", "ratio", "causes"),
    [
        ({}, 1.0, []),
        ({"torque": 1.3558}, 1.3558, ["another unit"]),
        ({"torque": 1.2}, 1.2, []),
        ({"theta": 0.8}, None, ["unlikely size"]),
        ({"theta_m": -1.0}, 0.17, ["unlikely size"]),
    ],
)
def test_torque_and_angles_of_a_leg_are_compared_with_its_belt(changes, ratio, causes):
    recording = leg()
    changed_signals = {name: factor * recording[name] for name, factor in changes.items()}
    row = judged("impedance", recording | changed_signals)
    assert ratio is None or row["K_s_ratio"] == pytest.approx(ratio, rel=0.01)
    assert [one.cause for one in row["findings"] if "K_s_ratio" in beyond_in([one])] == causes


@pytest.mark.parametrize(("without_friction", "ratio"), [(None, 0.5), (240.0, 0.6)])
def test_a_stiffness_is_compared_with_the_belt_and_with_what_gains_give(without_friction, ratio):
    """With the latter at the largest amplitude, or without friction."""
    rows = {"trial": "a", "amplitude_deg": [4.0, 2.0, None], "K": [200.0, 100.0, 150.0]}
    known = pl.lit(without_friction, dtype=pl.Float64)
    table = pl.DataFrame(rows).with_columns(K_without_friction=known, K_predicted=400.0)

    found = beside_known(table, LEG, KNOWN, Budget(150.0))

    assert found["K_ratio"].to_list() == [ratio] * 3
    assert (found["K_over_K_s"] * LEG.K_s).to_list() == pytest.approx(rows["K"])


@least_squares_alone
@pytest.mark.parametrize(
    ("experiment", "stiffness", "torque", "words"),
    [
        ("impedance", 300, 1, "300 N"),
        ("belt", 1000, 1, "1000 N"),
        ("impedance", 3000, -1, "`sign`"),
    ],
)
def test_a_bench_that_is_softer_than_what_it_measures_is_refused_as_such(
    experiment, stiffness, torque, words
):
    frame = BenchStiffness(value=f"{stiffness} N*m/rad")
    softer = BENCH.model_copy(update={"bench_stiffness": frame})
    with refused_with(words):
        judged(experiment, changed(experiment, torque=torque), softer)


def test_a_joint_without_stiffness_is_measured_on_a_bench_that_yields():
    """Noise makes K a little negative."""
    check_stiffer("made", "K", -0.1, BenchStiffness(value="3000 N*m/rad"))


@pytest.mark.parametrize(
    ("torque", "reached"),
    [
        (lambda x: x, "2"),
        (lambda x: x - x.max(), "5"),
        (lambda x: x - x.min(), "5"),
    ],
)
def test_a_torque_beyond_the_load_cell_s_range_is_refused(torque, reached):
    stated = BENCH.model_copy(update={"load_cell_range": 20.0})
    words = rf"torque.*{reached}.*N\*m,.*20 N\*m.*`load_cell_range`"
    with refused_with(words):
        judged("impedance", changed("impedance", torque=torque), stated)


@pytest.mark.parametrize(
    ("steps", "refused"),
    [
        ([1e-6] * 50, True),
        ([5e-6] * 40 + [5e-3] * 10, False),  # a late host: five samples at once
        ([0.0] * 30 + [1e-3] * 21, False),  # few decimals were printed
    ],
)
def test_samples_closer_than_any_recorder_takes_them_are_refused(steps, refused):
    time = np.cumsum([0.0, *np.random.default_rng(1).permutation(steps)])
    # below 1.2 rad
    theta = np.linspace(-1.1, 1.1, len(time))
    trial = joint_trial(time, theta, theta)
    said = r"trial made:.*[17](\.\d+)?e-06 s.*`unit`.*`time`"
    with refused_with(said) if refused else nullcontext():
        check_recording(trial, BENCH)
