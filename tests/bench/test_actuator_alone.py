# SPDX-License-Identifier: Apache-2.0
"""The actuator's own bench: what is simulated obeys Eqs. 1-2, and the five parameters come back
from its log."""

import re
import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from bench_synthetic import ACTUATOR as TRUE
from bench_synthetic import by_hand, schedule
from command_line import call
from conftest import ROOT, refused_with, white_noise
from scipy.signal import lfilter
from shipped import CONFIG, DEVICE, LEG

from osl_analysis.base.errors import IdentifiabilityError, InputError
from osl_analysis.base.trial import Trial
from osl_analysis.base.yaml_settings import read_yaml
from osl_analysis.bench.bench_settings import ActuatorAnalysis, Calibration
from osl_analysis.bench.parts_alone import ACTUATOR_PARAMETERS as NAMES
from osl_analysis.bench.parts_alone import actuator_table, actuator_trial, check_prompt
from osl_analysis.commands.fit import fit_actuator_trial, fit_trial
from osl_analysis.commands.trials import checked_trial
from osl_analysis.ingest.quality import Commanded, measure_quality
from osl_analysis.simulator.bench_trial import simulate_bench_trial
from osl_analysis.simulator.simulation_settings import RecorderSettings, SimulationSettings

ANALYSIS = ActuatorAnalysis(cutoff_hz=15, order=4, sign_width=0.01)


def fit_log(time, theta_m, current, torque_m):
    samples = pl.DataFrame(
        {"time": time, "theta_m": theta_m, "current": current, "torque_m": torque_m}
    )
    return actuator_trial(Trial("made", samples), ANALYSIS).whole


def simulated(number=1, duration_s=20.0):
    """The log of the default campaign's bench, recorded by one node that samples evenly, and the
    fit to it."""
    shipped = read_yaml((ROOT / "config/simulation/default.yaml"), SimulationSettings)
    shorter = shipped.actuator.model_copy(update={"duration_s": duration_s})
    log, _ = simulate_bench_trial(
        {"trial": f"actuator_{number}", "experiment": "actuator"},
        shipped.model_copy(update={"actuator": shorter, "recorder": RecorderSettings()}),
        LEG,
    )
    return log, fit_log(
        log["time"], log["actuator_angle"], log["motor_current"], log["output_torque"]
    )


def test_a_simulated_bench_gives_them_back_within_their_errors():
    """With every imperfection but the recorder's: errors over standard errors of five trials."""
    fits = [simulated(number)[1] for number in range(5)]
    z = np.array([[(fit[name] - TRUE[name]) / fit.se(name) for name in NAMES] for fit in fits])
    assert np.abs(z).max() < 5
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1, abs=0.29)
    means = np.mean([[fit[name] / TRUE[name] for name in NAMES] for fit in fits], axis=0)
    assert means == pytest.approx(1, abs=0.03)
    assert means[:3] == pytest.approx(1, abs=0.005)


@pytest.mark.parametrize(
    ("offset", "size", "current_of", "message"),
    [
        # always in the direction of the motion
        (0.0, 1, lambda omega, current: 0.6 * omega, "k_tau_n_m.*f_G"),
        (0.0, 1, lambda omega, current: np.sign(omega) * (4 + np.tanh(current)), "k_tau_n_m.*f_G"),
        (30.0, 1, lambda omega, current: current, "f_C.*offset"),  # a motion that never turns round
        (0.0, 1 / 57, lambda omega, current: current, r"0\.5 rad/s.* 0 .*20000"),
    ],
)
def test_a_schedule_that_tells_no_parameters_apart_is_refused(offset, size, current_of, message):
    t, theta, omega, alpha, current = schedule(velocity_offset=offset)
    current = current_of(omega, current)
    with pytest.raises((IdentifiabilityError, InputError), match=rf"^trial made:.*{message}"):
        fit_log(t, size * theta, current, by_hand(omega, alpha, current))


def test_the_documented_commands_give_the_parameters_of_a_bench_of_ones_own(tmp_path, monkeypatch):
    """Velocity in rpm before the 9:1 gear, as text: 0.1 % of the five, which is a tenth of their
    standard errors."""
    log, expected = simulated(duration_s=10.0)
    page = (ROOT / "docs/recording.md").read_text()
    documentation = page.partition("## Your own actuator bench")[2].partition("\n## ")[0]
    shutil.copytree(ROOT / "config", tmp_path / "config")
    monkeypatch.chdir(tmp_path)
    rpm = np.gradient(np.rad2deg(log["actuator_angle"]) * 9, log["time"]) / 6
    columns = np.column_stack([log["time"], rpm, log["motor_current"], log["output_torque"]])
    header = re.search(r"```\n(.*)\n```", documentation)[1]
    np.savetxt("bench.csv", columns, fmt="%.9g", delimiter=",", header=header, comments="")
    for command in re.findall(r"^osl-analysis (.*)$", documentation, re.MULTILINE):
        said = call(*command.split())
        assert said.exit_code == 0, said.output
    assert re.search(r"J_m +0\.009\d+ \(0\.009\d+.*0\.009\d+\) +kg·m²", said.output)
    source = Path("config/sources/actuator_bench_csv.yaml")
    row = {"trial": "bench", "log": "bench.csv", "log_source": source.stem}
    trial = checked_trial({**row, "experiment": "actuator"}, Path(), source.parent)
    assert {"omega_m", "current", "torque_m"} == trial.clocks.keys()
    found = fit_trial("actuator", trial, DEVICE, CONFIG).table
    assert found["motion"][0] == "omega_m"
    assert "omega" in fit_actuator_trial(trial, DEVICE, ANALYSIS).everything()["series"].columns
    assert found.select(NAMES).row(0) == pytest.approx([expected[name] for name in NAMES], rel=1e-3)
    low, high = expected.interval("J_m")
    assert found["J_m_high"][0] - found["J_m_low"][0] == pytest.approx(high - low, rel=0.02)


def free_samples():
    t, theta, omega, alpha, current = schedule()
    torque = by_hand(omega, alpha, current)
    samples = pl.DataFrame({"time": t, "theta_m": theta, "omega_m": 7 * omega})
    return samples.with_columns(current=current, torque_m=torque)


def test_of_angle_and_velocity_the_angle_is_used():
    row = actuator_table(actuator_trial(Trial("a", free_samples()), ANALYSIS))["actuator"].row(
        0, named=True
    )
    assert (row["motion"], row["J_m"]) == ("theta_m", pytest.approx(TRUE["J_m"], rel=0.02))


def test_rows_near_the_ends_and_of_slow_motion_are_not_fitted():
    record = actuator_trial(Trial("a", free_samples()), ANALYSIS).record
    rows = np.flatnonzero(record.is_fitted())
    omega = schedule()[2]
    # 3/15 s at both ends
    assert (rows[0], rows[-1]) == (200, len(omega) - 201)
    assert np.abs(omega[rows]).min() > 0.45


def test_a_bench_without_a_motion_is_refused():
    still = free_samples().drop("theta_m", "omega_m")
    words = "trial b:.*theta_m.*omega_m"
    with refused_with(words):
        actuator_trial(Trial("b", still), ANALYSIS)


UP_AND_DOWN = (0, 2, 4, 6, 8, 10, 12, 10, 8, 6, 4, 2, 0, -2, -4, -6, -8, -6, -4, -2, 0)


def staircase(seed, levels=UP_AND_DOWN, friction=0.15, between=0.03, rows=250, **angle):
    """A clamped actuator of 0.648 N*m/A whose current goes in steps of a second: torque that
    settles in 10 ms, friction that lags behind the steps, an offset, and an error [N*m] of each
    level."""
    rng = np.random.default_rng(seed)
    n = 250
    steps = np.array(levels, dtype=float)
    lags = np.sign(np.diff(steps, prepend=0.0)) * friction - between * rng.standard_normal(
        len(steps)
    )
    wanted = np.repeat(steps, rows)
    late = np.exp(-1 / (0.01 * n))
    current = lfilter([1 - late], [1, -late], wanted)
    noise = 0.05 * rng.standard_normal((2, len(wanted)))
    time = np.arange(len(wanted)) / n
    torque = 0.648 * current - np.repeat(lags, rows) + 0.3 + noise[0]
    columns = {"time": time, "current": current + noise[1], "torque_m": torque, **angle}
    return Trial("stalled", pl.DataFrame(columns))


def test_current_in_steps_at_standstill_gives_the_torque_per_current_alone():
    one_way = tuple(range(0, 20, 2))
    for made in ({}, {"levels": one_way, "friction": 0.0}):
        z = []
        for seed in range(12):
            fit = actuator_trial(staircase(seed, **made), ANALYSIS).whole
            z.append((fit["k_tau_n_m"] - 0.648) / fit.se("k_tau_n_m"))
        assert 0.3 < np.median(np.abs(z)) < 1.4  # of Student 0.7
    assert abs(fit["k_tau_n_m"] / 0.648 - 1) < 0.02
    still = actuator_trial(staircase(0, between=0.0, rows=125), ANALYSIS).whole
    assert still["hysteresis"] == pytest.approx(0.15, abs=0.01)
    row = fit_actuator_trial(staircase(1), DEVICE, ANALYSIS).estimates["actuator"].to_dicts()[0]
    assert row["k_tau_n_m_low"] < 0.648 < row["k_tau_n_m_high"]
    assert [row[name] for name in ("motion", *NAMES[1:])] == [None] * 5
    with refused_with(r"current.*8 plateaus.*0\.3 s"):
        actuator_trial(staircase(1, levels=(0, 5)), ANALYSIS)


def with_pauses(trial, pause_s):
    """The same with a pause of the logger behind each second."""
    time = trial.samples["time"] + pause_s * trial.samples["time"].floor()
    return Trial(trial.name, trial.samples.with_columns(time=time))


def test_a_current_that_was_off_in_the_pauses_comes_from_zero():
    """Down again from 4 A, friction lags as on the way up: as if it came from 4 A, it would be
    averaged away."""
    levels = np.array([1, 2, 3, 4, 3, 2, 1, -1, -2, -3, -2, -1], dtype=float)
    trial = staircase(4, levels, friction=0.0, between=0.0)
    lag = np.repeat(0.3 * np.sign(levels), 250)
    samples = trial.samples.with_columns(torque_m=pl.col("torque_m") - pl.Series(lag))

    fit = actuator_trial(with_pauses(Trial("off", samples), 20.0), ANALYSIS).whole

    assert fit["hysteresis"] == pytest.approx(0.3, abs=0.02)
    assert fit["k_tau_n_m"] == pytest.approx(0.648, rel=0.01)


def test_checks_of_sampling_do_not_apply_to_a_clamped_actuator():
    clamped = with_pauses(staircase(1), 86.0)

    quality = measure_quality(clamped, "actuator", Commanded(None, None, None))

    assert [quality[name].value for name in ("rate", "gap")] == [None, None]


def test_friction_lags_behind_small_steps_too():
    """Of 3 % of the current's range, each back after a large one."""
    levels = [level for top in range(2, 22, 2) for level in (top, top - 0.6)]

    fit = actuator_trial(staircase(5, levels, between=0.0), ANALYSIS).whole

    assert fit["hysteresis"] == pytest.approx(0.15, abs=0.01)


CLAMPED = np.arange(250 * len(UP_AND_DOWN)) / 250
JUMPS = np.random.default_rng(3).choice([-0.15, 0.15], len(UP_AND_DOWN) - 1)
TWITCHES = sum(jump * np.tanh((CLAMPED - k) / 0.1) for k, jump in enumerate(JUMPS, 1))


@pytest.mark.parametrize(
    "angle",
    [
        0.3 + 0 * CLAMPED,
        0.2 + 0.2 * white_noise(len(CLAMPED), 5),
        TWITCHES,  # of 0.2 s, which as a motion would widen the interval five times
    ],
    ids=["still", "noisy", "twitches"],
)
def test_a_clamped_shaft_stands_whatever_its_angle_shows(angle):
    fits = [
        actuator_trial(each, ANALYSIS).whole for each in (staircase(1), staircase(1, theta_m=angle))
    ]

    assert "J_m" not in fits[1].names
    assert fits[1].interval("k_tau_n_m") == pytest.approx(fits[0].interval("k_tau_n_m"), abs=2e-3)


def test_the_interval_of_a_clamped_actuator_holds_the_load_cell_s_error():
    calibrated = ANALYSIS.model_copy(update={"calibration": Calibration(torque_gain=0.01)})

    row = actuator_table(actuator_trial(staircase(1), calibrated))["actuator"].row(0, named=True)

    k = row["k_tau_n_m"]
    of_bench = row["k_tau_n_m_se_bench"]
    plain = actuator_trial(staircase(1), ANALYSIS).whole
    low, high = plain.interval("k_tau_n_m")
    assert of_bench == pytest.approx(0.01 * k)
    assert (high - low) / 2 < row["k_tau_n_m_high"] - k < (high - low) / 2 + 1.96 * of_bench


def test_a_current_that_is_late_is_refused_for_it_and_not_for_its_sign():
    t, theta, omega, alpha, current = schedule()
    current = current + 6 * np.sin(2 * np.pi * 3.1 * t) + 6 * np.sin(2 * np.pi * 2.7 * t)
    torque = by_hand(omega, alpha, current)
    with pytest.raises(InputError, match="170 ms") as refused:
        fit_log(t, theta, np.roll(current, 170), torque)
    assert "`delay: 170 ms`" in refused.value.remedy
    with refused_with("10 ms"):
        fit_log(t, theta, np.roll(current, 10), torque)
    # which `plausible` refuses
    assert fit_log(t, theta, -current, torque).interval("k_tau_n_m")[1] < 0


@pytest.mark.parametrize(("rows", "says"), [(20, "20 ms earlier"), (-20, "20 ms later")])
def test_a_current_that_was_recorded_late_fits_earlier_and_an_early_one_later(rows, says):
    current, omega, friction = white_noise((3, 4000), 2)
    columns = {
        "k_tau_n_m": current,
        "f_C": friction,
        "B_m": omega,
        "J_m": np.gradient(omega),
        "one": np.ones(4000),
        "ramp": np.linspace(-1, 1, 4000),
    }
    torque = 0.6 * np.roll(current, -rows) + 0.1 * omega

    with refused_with(says):
        check_prompt(columns, torque, np.ones(4000, dtype=bool), 1000.0)
