"""The actuator's own bench: what is simulated obeys Eqs. 1-2, and the five parameters come back
from its log."""

import re
import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from click.testing import CliRunner
from conftest import ROOT
from scipy.signal import lfilter

from osl_analysis.bench.actuator_alone import ACTUATOR_PARAMETERS as NAMES
from osl_analysis.bench.actuator_alone import actuator_table, actuator_trial
from osl_analysis.bench.bench_settings import ActuatorAnalysis, Calibration
from osl_analysis.bench.component_summary import part_summary
from osl_analysis.bench.measured_components import component_rows
from osl_analysis.cli import main
from osl_analysis.commands.bench import fit_actuator_trial, fit_settings, fit_trial
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.judge.judging import unchecked_in
from osl_analysis.model.drivetrain import read_parameters
from osl_analysis.report.headlines import headline_numbers
from osl_analysis.simulator.bench_trial import simulate_bench_trial
from osl_analysis.simulator.simulation_settings import RecorderSettings, SimulationSettings
from osl_analysis.trial import Trial, read_trial
from osl_analysis.yaml_settings import read_yaml

DEFAULT, DEVICE = ROOT / "config/simulation/default.yaml", ROOT / "config/parameters/default.yaml"
P, RATE = read_parameters(DEVICE), 1000.0
TRUE = {"k_tau_n_m": 0.1133 * 9, "f_C": 0.377, "f_G": 0.0896, "B_m": 5.6e-3, "J_m": 9.211e-3}
ANALYSIS = ActuatorAnalysis(cutoff_hz=15, order=4, sign_width=0.01, slowest=0.5)


def settings(duration_s=20.0, effects=True):
    """The default campaign's bench, recorded by one node that samples evenly."""
    found = read_yaml(DEFAULT, SimulationSettings)
    shorter = found.actuator.model_copy(update={"duration_s": duration_s})
    kept = (
        found.effects
        if effects
        else found.effects.without().model_copy(update={"friction": found.effects.friction})
    )
    return found.model_copy(
        update={"actuator": shorter, "effects": kept, "recorder": RecorderSettings()}
    )


def fit_log(time, theta_m, current, torque_m):
    samples = pl.DataFrame(
        {"time": time, "theta_m": theta_m, "current": current, "torque_m": torque_m}
    )
    return actuator_trial(Trial("made", samples), ANALYSIS).whole


def simulated(number=1, duration_s=20.0):
    """The log of a simulated bench, and the fit to it."""
    log, _ = simulate_bench_trial(
        {"trial": f"actuator_{number}", "experiment": "actuator"}, settings(duration_s), P
    )
    return log, fit_log(
        log["time"], log["actuator_angle"], log["motor_current"], log["output_torque"]
    )


def by_hand(omega, alpha, current):
    """Eqs. 1-2 retyped, for a motion (n,) and I_q [A]."""
    friction = np.sign(omega) * (TRUE["f_C"] + TRUE["f_G"] * np.abs(current))
    return TRUE["k_tau_n_m"] * current - friction - TRUE["B_m"] * omega - TRUE["J_m"] * alpha


def schedule(velocity_offset=0.0):
    """Time, angle, velocity, acceleration, current of sums of sines over 20 s; derivatives by
    hand."""
    t = np.arange(round(20 * RATE)) / RATE
    w, a = 2 * np.pi * np.array([[0.3], [1.1]]), np.array([[8.0], [5.0]])
    theta = (-a / w * np.cos(w * t)).sum(axis=0) + velocity_offset * t
    omega, alpha = (
        (a * np.sin(w * t)).sum(axis=0) + velocity_offset,
        (a * w * np.cos(w * t)).sum(axis=0),
    )
    return (
        t,
        theta,
        omega,
        alpha,
        4 * np.sin(2 * np.pi * 0.17 * t) + 3 * np.sin(2 * np.pi * 0.73 * t),
    )


def test_a_log_without_noise_gives_the_parameters_back():
    """The filter smears friction's jumps on both sides alike; the smooth sign is left, which costs
    B_m most."""
    t, theta, omega, alpha, current = schedule()
    fit = fit_log(t, theta, current, by_hand(omega, alpha, current) + 0.7 + 0.01 * (t - np.mean(t)))
    assert [fit[name] for name in NAMES] == pytest.approx([TRUE[name] for name in NAMES], rel=0.02)
    assert fit["k_tau_n_m"] == pytest.approx(TRUE["k_tau_n_m"], rel=5e-4)
    assert (fit["offset"], fit["drift"]) == (
        pytest.approx(0.7, abs=1e-3),
        pytest.approx(0.01, rel=0.01),
    )


def test_the_offset_is_that_in_the_middle_of_the_fitted_motion():
    """Behind a rest of 20 s, over which the transducer drifts."""
    t, theta, omega, alpha, current = schedule()
    rest = np.zeros(round(20 * RATE))
    time = np.arange(len(rest) + len(t)) / RATE
    angle = np.concatenate([rest + theta[0], theta])
    currents = np.concatenate([rest, current])
    torque = np.concatenate([rest, by_hand(omega, alpha, current)])
    middle = time[len(rest) :].mean()

    fit = fit_log(time, angle, currents, torque + 0.7 + 0.01 * (time - middle))

    assert fit["drift"] == pytest.approx(0.01, rel=0.01)
    assert fit["offset"] == pytest.approx(0.7, abs=2e-3)


def test_a_simulated_bench_gives_them_back_within_their_errors():
    """With every imperfection but the recorder's: of twelve trials none is beyond 5 standard
    errors, few beyond 2."""
    fits = [simulated(number)[1] for number in range(12)]
    z = np.array([[(fit[name] - TRUE[name]) / fit.se(name) for name in NAMES] for fit in fits])
    assert np.abs(z).max() < 5
    assert all(fit.correlation_samples < 0.5 * RATE for fit in fits), (
        "of noise behind a 15 Hz filter, not of seconds"
    )
    assert np.mean(np.abs(z) < 1.96) > 0.8
    means = np.mean([[fit[name] / TRUE[name] for name in NAMES] for fit in fits], axis=0)
    assert (means, means[:3]) == (
        pytest.approx(np.ones(5), abs=0.02),
        pytest.approx(np.ones(3), abs=0.003),
    )
    assert max(fits[0].se(name) / TRUE[name] for name in ("k_tau_n_m", "f_C", "f_G", "J_m")) < 0.02


@pytest.mark.parametrize(("offset", "size", "current_of", "message"), [
    # always in the direction of the motion
    (0.0, 1, lambda omega, current: 0.6 * omega, "cannot be told apart"),
    (0.0, 1, lambda omega, current: np.sign(omega) * (4 + np.tanh(current)), "k_tau_n_m and f_G"),
    (30.0, 1, lambda omega, current: current, "f_C and offset"),  # a motion that never turns round
    (0.0, 1 / 57, lambda omega, current: current,
     r"faster than 0\.5 rad/s in 0 of 20000 samples; drive it faster"),
])  # fmt: skip
def test_refuses_a_schedule_that_does_not_tell_two_parameters_apart_or_hardly_moves(
    offset, size, current_of, message
):
    t, theta, omega, alpha, current = schedule(velocity_offset=offset)
    current = current_of(omega, current)
    with pytest.raises((IdentifiabilityError, InputError), match=f"^trial made: .*{message}"):
        fit_log(t, size * theta, current, by_hand(omega, alpha, current))


def test_a_bench_of_ones_own_gives_the_parameters_of_its_log_by_the_documented_commands(
    tmp_path, monkeypatch
):
    """Velocity in rpm before the 9:1 gear, as text: 0.1 % of the five, which is a tenth of their
    standard errors."""
    log, expected = simulated(duration_s=10.0)
    page = (ROOT / "docs/own_data.md").read_text()
    documentation = page.partition("## Your own actuator bench")[2].partition("\n## ")[0]
    shutil.copytree(ROOT / "config", tmp_path / "config")
    monkeypatch.chdir(tmp_path)
    rpm = np.gradient(np.rad2deg(log["actuator_angle"]) * 9, log["time"]) / 6
    columns = np.column_stack([log["time"], rpm, log["motor_current"], log["output_torque"]])
    header = re.search(r"```\n(.*)\n```", documentation)[1]
    np.savetxt("bench.csv", columns, fmt="%.9g", delimiter=",", header=header, comments="")
    for command in re.findall(r"^osl-analysis (.*)$", documentation, re.MULTILINE):
        said = CliRunner().invoke(main, command.split())
        assert said.exit_code == 0, said.output
    assert re.search(r"J_m +0\.009\d+ ± \S+ +kg·m²", said.output)
    trial, asked = (
        read_trial(Path("bench.parquet")),
        fit_settings("actuator", ROOT / "config/config.yaml"),
    )
    found = fit_trial("actuator", trial, DEVICE, *asked).table
    assert found["motion"][0] == "omega_m"
    assert "omega" in fit_actuator_trial(trial, DEVICE, ANALYSIS).everything()["series"].columns
    assert found.select(NAMES).row(0) == pytest.approx([expected[name] for name in NAMES], rel=1e-3)
    assert found["J_m_se"][0] == pytest.approx(expected.se("J_m"), rel=0.02)


def test_of_angle_and_velocity_the_angle_is_used_and_a_bench_without_either_is_refused():
    t, theta, omega, alpha, current = schedule()
    samples = pl.DataFrame(
        {"time": t, "current": current, "torque_m": by_hand(omega, alpha, current)}
    )
    both = samples.with_columns(theta_m=theta, omega_m=7 * omega)
    fit = actuator_trial(Trial("a", both), ANALYSIS)
    row, rows = actuator_table(fit).row(0, named=True), fit.record.rows()
    assert (row["motion"], row["J_m"]) == ("theta_m", pytest.approx(TRUE["J_m"], rel=0.02))
    assert row["correlation_k_f_G"] * row["k_tau_n_m_se"] * row["f_G_se"] == pytest.approx(
        row["cov_k_tau_n_m_f_G"]
    )
    shown = fit_actuator_trial(Trial("a", both), DEVICE, ANALYSIS).everything()["series"][
        "theta_deg"
    ]
    assert shown[2501] == pytest.approx(np.rad2deg(theta[5002]))
    # 3/15 s at both ends
    assert (rows[0], rows[-1], np.abs(omega[rows]).min() > 0.45) == (200, len(t) - 201, True)
    with pytest.raises(
        InputError, match=r"trial b: the actuator stands, .*name theta_m or omega_m"
    ):
        actuator_trial(Trial("b", samples), ANALYSIS)


def test_actuator_trials_without_a_schedule_are_refused():
    content = settings().model_dump()
    content["experiments"]["actuator"] = 2
    with pytest.raises(
        ValueError, match="2 actuator trials are planned but 'actuator' has no schedule"
    ):
        SimulationSettings.model_validate(content | {"actuator": None})


UP_AND_DOWN = (0, 2, 4, 6, 8, 10, 12, 10, 8, 6, 4, 2, 0, -2, -4, -6, -8, -6, -4, -2, 0)


def staircase(seed, levels=UP_AND_DOWN, friction=0.15, between=0.03, **angle):
    """A clamped actuator of 0.648 N*m/A whose current goes in steps of a second: torque that
    settles in 10 ms, friction that lags behind the steps, an offset, and an error [N*m] of each
    level."""
    rng, n, steps = np.random.default_rng(seed), 250, np.array(levels, dtype=float)
    lags = np.sign(np.diff(steps, prepend=0.0)) * friction - between * rng.standard_normal(
        len(steps)
    )
    wanted, late = np.repeat(steps, n), np.exp(-1 / (0.01 * n))
    current = lfilter([1 - late], [1, -late], wanted)
    noise, time = 0.05 * rng.standard_normal((2, len(wanted))), np.arange(len(wanted)) / n
    torque = 0.648 * current - np.repeat(lags, n) + 0.3 + noise[0]
    columns = {"time": time, "current": current + noise[1], "torque_m": torque, **angle}
    return Trial("stalled", pl.DataFrame(columns))


def test_current_in_steps_at_standstill_gives_the_torque_per_current_alone_and_covers_it():
    one_way = tuple(range(0, 20, 2))
    for made in ({}, {"levels": one_way, "friction": 0.0}):
        z = []
        for seed in range(12):
            fit = actuator_trial(staircase(seed, **made), ANALYSIS).whole
            z.append((fit["k_tau_n_m"] - 0.648) / fit.se("k_tau_n_m"))
        assert 0.3 < np.median(np.abs(z)) < 1.4  # of Student 0.7
    assert abs(fit["k_tau_n_m"] / 0.648 - 1) < 0.02
    still = actuator_trial(staircase(0, between=0.0), ANALYSIS).whole
    assert still["hysteresis"] == pytest.approx(0.15, abs=0.01)
    for trial in (staircase(1), staircase(1, theta_m=np.full(250 * len(UP_AND_DOWN), 0.3))):
        row = fit_actuator_trial(trial, DEVICE, ANALYSIS).estimates["actuator"].to_dicts()[0]
        assert row["k_tau_n_m_low"] < 0.648 < row["k_tau_n_m_high"]
        assert [row[name] for name in ("motion", *NAMES[1:])] == [None] * 5
        assert "f_C, f_G, B_m and J_m" in [one.cause for one in unchecked_in("actuator", row)]
    with pytest.raises(
        InputError, match=r"its current has 4 plateaus of 0\.3 s or more, 8 are needed"
    ):
        actuator_trial(staircase(1, levels=(0, 5, 10, 0)), ANALYSIS)


def test_the_interval_of_a_clamped_actuator_holds_the_stated_error_of_the_load_cell():
    calibrated = ANALYSIS.model_copy(update={"calibration": Calibration(torque_gain=0.01)})
    trial = staircase(1)

    row = actuator_table(actuator_trial(trial, calibrated)).row(0, named=True)

    plain = actuator_table(actuator_trial(trial, ANALYSIS)).row(0, named=True)
    assert row["k_tau_n_m_se_bench"] == pytest.approx(0.01 * row["k_tau_n_m"])
    assert row["k_tau_n_m_se"] == pytest.approx(
        np.hypot(plain["k_tau_n_m_se"], row["k_tau_n_m_se_bench"])
    )


def test_a_shaft_that_twitches_between_the_steps_is_read_where_it_stands():
    """Its twitches of 0.3 rad last 0.2 s: as a motion they would widen the interval five times."""
    time = np.arange(250 * len(UP_AND_DOWN)) / 250
    jumps = np.random.default_rng(3).choice([-0.15, 0.15], len(UP_AND_DOWN) - 1)
    angle = sum(jump * np.tanh((time - k) / 0.1) for k, jump in enumerate(jumps, 1))
    fits = [
        actuator_trial(one, ANALYSIS).whole for one in (staircase(1), staircase(1, theta_m=angle))
    ]
    assert "J_m" not in fits[1].names
    assert fits[1].interval("k_tau_n_m") == pytest.approx(fits[0].interval("k_tau_n_m"), abs=2e-3)


def test_a_campaign_of_clamped_actuators_has_the_headlines_of_what_its_trials_have():
    rows = [
        fit_actuator_trial(staircase(seed), DEVICE, ANALYSIS).estimates["actuator"]
        for seed in range(3)
    ]
    table = pl.concat(rows).with_columns(joint=pl.lit("ankle"), side=pl.lit(None, pl.String))
    numbers = headline_numbers({"actuator_summary": part_summary("actuator", table)})
    assert [(one.name, one.n) for one in numbers] == [("k_tau_n_m", 3)]
    assert numbers[0].value == pytest.approx(0.648, abs=2e-3)
    with pytest.raises(InputError, match="no actuator and no belt and no transmission trials"):
        component_rows({"actuator": table}, ("ankle", None))


def test_a_current_that_is_late_is_refused_for_it_and_not_for_its_sign():
    t, theta, omega, alpha, current = schedule()
    current = current + 6 * np.sin(2 * np.pi * 3.1 * t) + 6 * np.sin(2 * np.pi * 2.7 * t)
    torque = by_hand(omega, alpha, current)
    with pytest.raises(InputError, match=r"negative, .* 170 ms earlier") as refused:
        fit_log(t, theta, np.roll(current, 170), torque)
    assert [change.delays for change in refused.value.changes] == [{"current": 0.17}]
    with pytest.raises(InputError, match=r"k_tau_n_m is 1\.\d+ N\*m/A, .* 10 ms earlier"):
        fit_log(t, theta, np.roll(current, 10), torque)
    # which `plausible` refuses
    assert fit_log(t, theta, -current, torque).interval("k_tau_n_m")[1] < 0


def test_an_inertia_that_is_negative_is_impossible():
    t, theta, omega, alpha, current = schedule()
    torque = by_hand(omega, alpha, current) + 2 * TRUE["J_m"] * alpha
    samples = pl.DataFrame({"time": t, "theta_m": theta, "current": current, "torque_m": torque})
    asked = fit_settings("actuator", ROOT / "config/config.yaml")
    assert (
        "impossible estimate"
        in fit_trial("actuator", Trial("a", samples), DEVICE, *asked).table["doubtful"][0]
    )


def held_by_friction(levels):
    """A clamped actuator whose friction, of constant size and per current, holds the torque within
    a band."""
    current, held, torque = np.repeat(np.array(levels, dtype=float), 250), 0.0, []
    for wanted in current:
        band = 0.15 + 0.06 * abs(wanted)
        held = min(max(held, 0.648 * wanted - band), 0.648 * wanted + band)
        torque.append(held)
    noise = 0.01 * np.random.default_rng(1).standard_normal(len(current))
    columns = {
        "time": np.arange(len(current)) / 250,
        "current": current,
        "torque_m": torque + noise,
    }
    return Trial("stalled", pl.DataFrame(columns))


@pytest.mark.parametrize(
    "levels", [(0, 2, 4, 6, 4, 2, 0, -2, -4, -2, 0), (0, 3, 6, 3, 0, -3, -6, -3, 0)]
)
def test_a_short_staircase_has_an_interval_that_holds_the_friction_of_its_turns(levels):
    fit = actuator_trial(held_by_friction(levels), ANALYSIS).whole
    low, high = fit.interval("k_tau_n_m")
    assert low < 0.648 < high
    assert high - low < 0.5


def test_levels_behind_a_turn_do_not_lower_the_torque_per_current():
    """Friction of constant size and per current holds the torque within a band: taken as they are,
    they cost 3 %."""
    levels = [*range(9), *range(7, -9, -1), *range(-7, 1)]
    fit = actuator_trial(held_by_friction(levels), ANALYSIS).whole
    assert fit["k_tau_n_m"] == pytest.approx(0.648, rel=2e-3)
    assert (fit["hysteresis"], fit["load_hysteresis"]) == pytest.approx((0.15, 0.06), abs=0.01)
