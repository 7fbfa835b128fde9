# SPDX-License-Identifier: Apache-2.0
"""Rendered impedance of a stepped sine, and its lag."""

import bench_synthetic
import numpy as np
import polars as pl
import pytest
from bench_synthetic import (
    FIVE,
    PROTOCOL,
    RATE,
    second_order,
    sine_settings,
    stepped_sine,
    unit_sines,
    with_settings,
)
from conftest import joint_trial, least_squares_alone, marked_by, white_noise
from shipped import CONFIG

from osl_analysis.base.errors import IdentifiabilityError
from osl_analysis.base.table import write_tables
from osl_analysis.bench.bench_settings import Calibration, Fixture
from osl_analysis.bench.evidence import UNSTATED, DesiredImpedance, impedance_table
from osl_analysis.bench.impedance import rendered_impedance
from osl_analysis.bench.motion import record_of_trial
from osl_analysis.commands.figure import fig4
from osl_analysis.commands.fit import fit_impedance_trial
from osl_analysis.judge import judging
from osl_analysis.judge.findings import Finding, findings_table
from osl_analysis.model.compensator import PAPER_WEIGHT
from osl_analysis.spectral.stepped_sine import SteppedSineProtocol

LATENESS = "not checked: delay of the torque"


@least_squares_alone
def test_the_fit_is_to_the_settled_cycles_alone():
    """For the first 0.8 s of each amplitude the torque is three times as large."""

    def disturbed(motion):
        torque = second_order(motion)
        moves = np.flatnonzero(motion.theta)
        begins = moves[np.diff(moves, prepend=-RATE) > RATE]  # after a rest
        for start in begins:
            torque[start : start + round(0.8 * RATE)] *= 3
        return torque

    table = bench_synthetic.table_of(stepped_sine(disturbed))

    assert table["K"].to_list() == pytest.approx([200] * 3, rel=1e-3)
    assert table["B"].to_list() == pytest.approx([4] * 3, rel=1e-3)


@least_squares_alone
def test_the_modelled_torque_has_the_drift_where_the_fit_has_it():
    """The amplitudes follow each other, so that their mean times differ from the recording's."""
    few_cycles = SteppedSineProtocol((0.05, 0.1), (1.0, 3.0, 5.0), 5)
    drift = 0.01  # N*m/s, which is 0.6 N*m over a minute

    def torque_of(motion):
        rendered = second_order(motion)
        return rendered + drift * np.arange(len(rendered)) / RATE

    analysis = rendered_impedance(stepped_sine(torque_of, protocol=few_cycles))

    assert len(analysis.fits) == 3  # two amplitudes and all
    for label in analysis.fits:
        rows = analysis.record.is_fitted(label)
        unexplained = analysis.record.filtered_torque - analysis.modelled(label)
        np.testing.assert_allclose(unexplained[rows], 0, atol=3e-3)


@least_squares_alone
def test_the_range_over_all_amplitudes_holds_each_of_them():
    """K rises with the amplitude, by 3/4 of the cubic's coefficient times its square."""
    record = stepped_sine(lambda m: second_order(m) + 2e3 * m.theta**3)

    small, large, both = bench_synthetic.table_of(record).to_dicts()

    assert small["K"] + 3 < both["K"] < large["K"]
    for name in "KB":
        low, high = sorted((small[name], large[name]))
        assert both[f"{name}_range_low"] <= low
        assert both[f"{name}_range_high"] >= high


def trial_of_steps(steps):
    """Sines between rests, of an amplitude [rad], a frequency [Hz] and a share of Eq. 15's torque
    each."""
    rest = np.zeros(round(2 * RATE))
    angles = [rest]
    shares = [rest]
    for amplitude, frequency, share in steps:
        sine = np.append(amplitude * unit_sines([(frequency, 9)], RATE), rest)
        angles.append(sine)
        shares.append(np.full(len(sine), share))
    theta = np.concatenate(angles)
    time = np.arange(len(theta)) / RATE
    torque = second_order(bench_synthetic.true_motion(time, theta)) * np.concatenate(shares)
    torque += 1e-3 * white_noise(len(theta), 1)
    return joint_trial(time, theta, torque)


def table_of_steps(*steps):
    trial = trial_of_steps([(*step, 1.0) for step in steps])
    record = record_of_trial(trial, sine_settings(None, None))
    return bench_synthetic.table_of(record)


@least_squares_alone
def test_an_amplitude_of_one_frequency_has_no_row_and_refuses_no_trial():
    """A drive with a limit of speed reaches less at high frequencies."""
    table = table_of_steps((0.14, 0.5), (0.14, 1), (0.09, 2), (0.035, 4))
    assert table["amplitude_deg"].to_list() == [8.02, None]
    assert table.row(-1, named=True)["K"] == pytest.approx(200, rel=1e-3)


def test_amplitudes_of_one_frequency_are_refused_with_what_is_missing():
    missing = "2 Hz.*1 Hz"
    with pytest.raises(IdentifiabilityError, match=missing):
        table_of_steps((0.14, 2), (0.09, 2))


@least_squares_alone
def test_amplitudes_that_nest_in_frequencies_are_fitted_alone():
    """A fit to both amplitudes leaves several percent: the small one has half of the stiffness of
    the large one."""
    small, large = PROTOCOL.amplitudes
    steps = [
        (a, f, 1 if a == large else 0.5) for f in PROTOCOL.frequencies_hz for a in (small, large)
    ]
    degrees = [round(np.rad2deg(a), 9) for a in PROTOCOL.amplitudes]

    record = record_of_trial(trial_of_steps(steps), sine_settings(degrees, (1, 3, 5), 9))
    table = bench_synthetic.table_of(record)

    assert table["K"].to_list()[:2] == pytest.approx([100, 200], rel=1e-3)


@least_squares_alone
def test_fig4_shows_the_reported_fit_without_the_fixture(tmp_path):
    record = stepped_sine(second_order, 0.01)
    trial = joint_trial(record.time, record.theta, record.torque)
    settings = sine_settings([round(np.rad2deg(a), 9) for a in PROTOCOL.amplitudes], (1, 3, 5), 9)
    settings = settings.model_copy(update={"fixture": Fixture(inertia=0.02, weight=40.0)})
    tables = fit_impedance_trial(trial, None, UNSTATED, PAPER_WEIGHT, settings).everything()
    table = tables["impedance"].with_columns(doubtful=pl.lit("K: friction"))
    series = tmp_path / f"{trial.name}.zip"
    write_tables({series / "series.csv": tables["series"], tmp_path / "impedance.csv": table})

    findings = [Finding("friction", "impedance", table["trial"][-1], estimates=("K",))]
    findings_table(findings).write_parquet(tmp_path / "findings.parquet")

    shown = fig4([series], tmp_path / "impedance.csv", "the first", [tmp_path / "findings.parquet"])

    theta, torque = shown.drop_nulls("torque_model").select("theta_deg", "torque_model")
    theta = np.deg2rad(theta.to_numpy())
    step = shown["time"][1]
    velocity = np.gradient(theta, step)
    columns = [theta, velocity, np.gradient(velocity, step), np.ones_like(theta)]
    drawn, *_ = np.linalg.lstsq(np.array(columns).T, torque.to_numpy())
    assert drawn[0] == pytest.approx(table["K"][-1], rel=0.01) != pytest.approx(200, rel=0.1)
    assert shown["is_doubtful"].all()
    assert set(shown["doubtful"]) == {"K: friction"}
    assert shown["time"][-1] == pytest.approx(10, abs=step)


def judged(torque_of, noise=0.01, **stated):
    sines = stepped_sine(torque_of, noise, FIVE)
    record = with_settings(sines, calibration=Calibration(**stated))
    ours = DesiredImpedance("ours", None, None)
    tables = impedance_table(rendered_impedance(record), desired=ours)
    table, limits = tables["impedance"], CONFIG.doubtful.of("impedance")
    found = judging.judged(table, limits, "impedance", budget=tables["budget"])
    return marked_by(found, table, "impedance")


@pytest.mark.parametrize(("stated", "is_told"), [({}, True), ({"delay": 1e-4}, False)])
def test_a_torque_in_time_is_not_doubtful_and_tells_an_unstated_delay(stated, is_told):
    table = judged(second_order, **stated)
    assert table["doubtful"].to_list() == [None] * 3
    assert (LATENESS in table["remarks"][-1].split("; ")) == is_told


def test_sines_whose_torque_is_clipped_before_the_noise_are_doubted_for_it():
    def cut(motion):
        torque = second_order(motion)
        return np.clip(torque, 0.7 * torque.min(), 0.7 * torque.max())

    assert judged(cut, noise=0.05)["doubtful"][-1].endswith(": clipped signal")
