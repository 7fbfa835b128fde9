"""What components predict of a leg that obeys Eqs. 1-7 and of legs that differ in one component;
torque accuracy in pairs; claims and their verdicts. The truth is the simulator's integrator, a
formula, or a planted fault."""

import importlib  # statsmodels takes half a second of each process that collects tests
from dataclasses import replace
from itertools import product

import numpy as np
import polars as pl
import pytest
from bench_synthetic import FIVE, LOW_PASS, RATE, component_tables, stepped_sine, true_motion
from conftest import ROOT
from polars.testing import assert_frame_equal
from scipy import stats
from scipy.signal import butter, sosfiltfilt

from osl_analysis.bench import prediction, prediction_causes
from osl_analysis.bench.condition_tables import compensation_table
from osl_analysis.bench.impedance import DesiredImpedance, rendered_impedance, torque_error
from osl_analysis.bench.measured_components import COMPONENTS, components_of
from osl_analysis.bench.prediction import (
    Misses,
    model_variance,
    prediction_table,
    prediction_terms,
)
from osl_analysis.bench.record import read_record, record_of, stored_record
from osl_analysis.bench.row_groups import stretches_of
from osl_analysis.errors import InputError
from osl_analysis.judge.campaign import campaign_findings, measured_over_predicted, misfits_of_joint
from osl_analysis.judge.claims import Claims, claims_table, limit_verdict
from osl_analysis.judge.finding import Beyond, findings_frame
from osl_analysis.judge.limits import DoubtfulFits
from osl_analysis.model.actuator_in_time import Controller, belt_responses
from osl_analysis.model.compensator import select_gains
from osl_analysis.model.drivetrain import read_parameters
from osl_analysis.simulator.two_mass_drivetrain import IDEAL, simulate_drivetrain
from osl_analysis.table import read_table, write_table

P = read_parameters(ROOT / "config/parameters/default.yaml")
TRUE = {"k_tau_n_m": P.k_tau * P.n_m, **vars(P)}
HERE = {"joint": "ankle", "side": None}
PAIR = ("compensated", "uncompensated")
NO_VERDICTS = pl.DataFrame(schema={"check": pl.String, "verdict": pl.String})
CONDITIONS = [
    (K, B, name) for name in PAIR for K, B in ((100, 5), (200, 2.5), (300, 5), (400, 7.5))
]
FAULTS = {"K_s": 0.85, "f_C": 2.0, "J_m": 1.3, "torque_gain": 1.05}
LINEAR = {"f_C": 0.25}  # relative error of a change that is taken for linear, where it is not
TYPES = {"side": pl.String, "amplitude_deg": pl.Float64}


EXACT = components_of(component_tables(TRUE, 1e-6), ("ankle", None), P)


def law_of(K_d, B_d, controller, **delays):
    return Controller(select_gains(controller, K_d, B_d, P), P, 0.05, **delays)


def recording(K_d, B_d, controller, p=P, seed=0, gain=1.0, **delays):
    """A stepped sine against a leg with parameters p, with noise of 0.05 N*m, by a load cell with
    this gain."""
    law = law_of(K_d, B_d, controller, **delays)

    def torque(m):
        return gain * (
            belt_responses(m.theta, RATE, [(law, p)])[0] + p.B_j * m.omega + p.J_j * m.alpha
        )

    return stepped_sine(torque, 0.05, FIVE, seed)


def fitted(record, **asked):
    """Its row of `impedance.csv` over all amplitudes, as far as a prediction reads it: no witness,
    which takes long."""
    return rendered_impedance(record)[0].row(None, "K", "B", "I") | asked | {"doubtful": ""}


def predictions(tables, p=P, **delays):
    """`prediction.csv` and its causes of the leg p, as the component tables predict it."""
    components = components_of(tables, ("ankle", None), P)
    terms = {}
    fits = []
    for seed, (K_d, B_d, controller) in enumerate(CONDITIONS):
        name = f"K{K_d}_{controller}"
        record = replace(recording(K_d, B_d, controller, p, seed, **delays), name=name)
        terms[name], _ = prediction_terms(record, law_of(K_d, B_d, controller), components)
        condition = {"controller": controller, "K_d": float(K_d), "B_d": float(B_d)}
        fits.append(fitted(record, trial=name, **HERE, **condition))
    return *prediction_table(terms, pl.DataFrame(fits, infer_schema_length=None), components), fits


def test_a_record_that_was_kept_is_predicted_as_that_of_the_fit(tmp_path):
    record, path = recording(300, 5, "compensated"), tmp_path / "made.parquet"
    write_table(stored_record(record), path)
    law = law_of(300, 5, "compensated")

    of_fit, of_kept = (
        prediction_terms(each, law, EXACT) for each in (record, read_record(path, record.low_pass))
    )

    for terms, kept in zip(of_fit, of_kept, strict=True):
        assert_frame_equal(terms, kept, rel_tol=1e-9)


def test_an_inertia_beyond_the_predicted_is_missed_by_i_w2_rms():
    added_inertia = 0.05
    heavier = recording(300, 5, "compensated", replace(P, J_j=P.J_j + added_inertia))

    _, missed = prediction_terms(heavier, law_of(300, 5, "compensated"), EXACT)

    assert missed["frequency_hz"].to_list() == [1, 2, 3, 4, 5]
    w = 2 * np.pi * missed["frequency_hz"]
    rms_angle = np.sqrt(np.mean(np.square(FIVE.amplitudes)) / 2)
    np.testing.assert_allclose(
        missed["miss"], added_inertia * w**2 * rms_angle, rtol=0.01, atol=0.02
    )
    np.testing.assert_allclose(missed["share"], 100 * missed["miss"] / missed["torque"])


def test_of_a_gain_an_equal_share_is_missed_at_each_frequency_of_noise():
    white = np.random.default_rng(3).standard_normal(round(60 * RATE))
    theta = sosfiltfilt(butter(4, (0.5, 6), "band", fs=RATE, output="sos"), white)
    time = np.arange(len(theta)) / RATE
    motion = true_motion(time, 0.05 * theta / theta.std())
    law = law_of(300, 5, "compensated")
    belt = belt_responses(motion.theta, RATE, [(law, P)])[0]
    torque = 1.25 * (belt + P.B_j * motion.omega + P.J_j * motion.alpha)
    rows = stretches_of([slice(500, len(time) - 500)], RATE)
    record = record_of("noise", time, motion.theta, torque, LOW_PASS, rows)

    _, missed = prediction_terms(record, law, EXACT)

    assert missed["frequency_hz"].is_between(0.4, 8.5).all()
    assert len(missed) > 10
    np.testing.assert_allclose(missed["share"], 20, atol=0.3)


def test_a_late_controller_is_that_of_the_simulator_with_its_delay():
    t = np.arange(4000) / 1000.0
    w = 2 * np.pi * 3.0
    theta = 0.05 * (1 - np.cos(w * t))
    omega = 0.05 * w * np.sin(w * t)
    gains = select_gains("compensated", 300, 5, P)
    commands = np.array([[gains.K_1], [gains.B_1], [0.0]])
    simulated = IDEAL | {
        "friction": True, "cancels_friction": True, "sign_width": 0.05,
        "control_updates": 20, "control_delay": 80,  # 4 ms
    }  # fmt: skip
    truth = simulate_drivetrain(1000.0, theta, omega, commands, simulated, P)["belt_torque"]
    late_law = law_of(300, 5, "compensated", angle_delay=4e-3, velocity_delay=4e-3)

    late, prompt = belt_responses(
        theta, 1000.0, [(late_law, P), (law_of(300, 5, "compensated"), P)]
    )

    assert np.std(late - truth) < 0.25 * np.std(prompt - truth)


def test_components_are_means_with_scatter_of_trials_and_correlations():
    tables = component_tables(TRUE)
    f_C = tables["actuator"]["f_C"].to_numpy()
    se_of_fits = np.sqrt(np.mean(tables["actuator"]["f_C_se"].to_numpy() ** 2))

    components = components_of(tables, ("ankle", None), P)

    se = {name: components.se(name) for name in ("f_C", "J_m")}
    assert components.values["f_C"] == pytest.approx(f_C.mean())
    assert se["f_C"] == pytest.approx(max(f_C.std(ddof=1), se_of_fits) / np.sqrt(3))
    row, same_bench, other_bench = (list(COMPONENTS).index(name) for name in ("f_C", "J_m", "K_s"))
    shared = components.covariance[row, same_bench]
    assert shared == pytest.approx(0.5 * se["f_C"] * se["J_m"], rel=2e-3)
    assert components.covariance[row, other_bench] == 0
    assert components.freedom["K_s"] == 2
    assert components.p.k_tau * P.n_m == pytest.approx(components.values["k_tau_n_m"])
    assert components.p.n_T == P.n_T


@pytest.mark.parametrize(("tables", "side", "words"), [
    ({"actuator": component_tables(TRUE)["actuator"]}, None,
     "no belt and no transmission trials"),
    (component_tables(TRUE), "left", "no actuator and no belt and no transmission"),
    (component_tables(TRUE | {"K_s": -P.K_s}), None, r"belt.csv: K_s = -68\d.* is negative"),
])  # fmt: skip
def test_components_that_are_missing_or_negative_are_refused(tables, side, words):
    with pytest.raises(InputError, match=words):
        components_of(tables, ("ankle", side), P)


def test_a_damping_of_the_actuator_that_is_negative_within_its_error_is_zero():
    tables = component_tables(TRUE)
    doubtful = tables["actuator"].with_columns(B_m=pl.lit(-1e-5), B_m_se=pl.lit(1e-4))
    assert components_of({**tables, "actuator": doubtful}, ("ankle", None), P).p.B_m == 0


def test_the_components_of_a_leg_predict_its_torque_and_nothing_is_named():
    table, causes, fits = predictions(component_tables(TRUE))
    assert table["VAF"].min() > 99.9
    for symbol in "KB":
        measured = table[f"{symbol}_measured"]
        assert measured.to_list() == pytest.approx([fit[symbol] for fit in fits], rel=2e-3)
        inside = measured.is_between(table[f"{symbol}_low"], table[f"{symbol}_high"])
        assert inside.sum() >= 7
    assert (table["K_high"] - table["K_low"]).max() < 0.02 * 400
    assert not causes["named"].any()


@pytest.mark.parametrize(("K_d", "B_d", "outside"), [
    (150, 0, "K_d"), (200, 9, "B_d"), (150, 9, "K_d and B_d"), (300, 5, None),
])  # fmt: skip
def test_a_trial_outside_of_the_others_conditions_is_told(K_d, B_d, outside):
    others = [{"K_d": 200, "B_d": 0}, {"K_d": 400, "B_d": 5}]
    assert prediction.outside_of({"K_d": K_d, "B_d": B_d}, others) == outside


def doubts_about(table, causes):
    tables = {"prediction": table, "prediction_causes": causes}
    findings = findings_frame(campaign_findings(tables, NO_VERDICTS, DoubtfulFits()))
    return findings.filter(grade="doubts").select("cause", "evidence").rows()


@pytest.mark.parametrize(("name", "factor"), FAULTS.items())
def test_a_component_that_is_not_as_its_trials_say_is_named_with_its_size(name, factor):
    if name == "torque_gain":
        leg = {"gain": factor}
    else:
        leg = {"p": replace(P, **{name: getattr(P, name) * factor})}
    table, causes, _ = predictions(component_tables(TRUE), **leg)
    assert causes.filter(pl.col("named"))["component"].to_list() == [name]
    row = causes.row(by_predicate=pl.col("component") == name, named=True)
    assert row["change"] / row["value"] == pytest.approx(factor - 1, rel=LINEAR.get(name, 0.1))
    assert doubts_about(table, causes) == [(f"component {name}", name)] * 8


def test_the_robust_regression_is_that_of_statsmodels():
    theirs = importlib.import_module("statsmodels.robust.robust_linear_model")
    rng = np.random.default_rng(1)
    A = 0.01 * rng.standard_normal((12, len(prediction_causes.TERMS), 3))
    A[:, 0] += 0.5 * A[:, 1]
    A[0, 0] += 3  # a trial that rings
    y, X = A[:, 0].ravel(), A[:, 1:4].transpose(0, 2, 1).reshape(-1, 3)
    expected = theirs.RLM(y, 1e2 * X, theirs.norms.HuberT(1.5)).fit().params * 1e2
    (found,), (left,) = prediction_causes.robust_fit(A, prediction_causes.TERMS[1:4])
    assert (found, left) == (
        pytest.approx(expected, rel=1e-9),
        pytest.approx(np.mean(np.abs(y - X @ expected))),
    )


def test_two_faults_at_once_are_said_and_none_of_them_is_named():
    table, causes, _ = predictions(
        component_tables(TRUE), replace(P, K_s=0.8 * P.K_s, f_C=1.6 * P.f_C)
    )
    assert not causes["named"].any()
    assert doubts_about(table, causes) == [("components that do not predict", "left")] * 8


def test_a_late_controller_is_named_with_its_delay_and_no_component_is():
    table, causes, _ = predictions(component_tables(TRUE), angle_delay=2e-3, velocity_delay=2e-3)
    assert causes.filter(pl.col("named"))["component"].to_list() == ["angle_delay"]
    assert causes["change"][-2:].to_list() == pytest.approx([2e-3, 2e-3], abs=3e-4)
    delays = ("angle_delay", "velocity_delay")
    assert doubts_about(table, causes) == [
        ("late controller", name) for _ in range(8) for name in delays
    ]


def test_the_standard_error_of_a_change_that_is_a_mean_is_the_mean_s():
    of_trials = np.array([0.04, 0.07, 0.05, 0.06])
    without_one = (of_trials.sum() - of_trials) / 3
    changes = {"torque_gain": np.array([of_trials.mean(), *without_one])}
    components = components_of(component_tables(TRUE), ("ankle", None), P)
    explained = prediction_causes.Explained(changes, 0.01)

    row = prediction_causes.cause_row("torque_gain", explained, 0.02, components, 4)

    assert row["change_se"] == pytest.approx(np.std(of_trials, ddof=1) / 2)


def test_an_interval_is_learnt_from_the_other_trials():
    """What a trial itself measured does not change its own interval, and changes that of the
    others."""
    record = recording(300, 5, "compensated")
    components = components_of(component_tables(TRUE), ("ankle", None), P)
    learnt, _ = prediction_terms(record, law_of(300, 5, "compensated"), components)
    terms = {f"t{k}": learnt for k in range(6)}
    fit = fitted(record, **HERE, controller="c", K_d=1.0, B_d=1.0)
    fits = pl.DataFrame([fit | {"trial": trial} for trial in terms])
    missed = learnt.with_columns(K=pl.when(pl.col("term") == "left").then(30.0).otherwise("K"))

    before, after = (
        prediction_table(each, fits, components)[0] for each in (terms, terms | {"t0": missed})
    )
    alone, _ = prediction_table({"t0": learnt}, fits.head(1), components)

    width = (before["K_high"] - before["K_low"]).to_numpy()
    widened = (after["K_high"] - after["K_low"]).to_numpy()
    assert width[0] == widened[0]
    assert (widened[1:] > 5 * width[1:]).all()
    assert alone.select("K_low", "K_high").row(0) == (None, None)


def test_a_prediction_s_interval_has_the_freedom_of_the_other_trials():
    """Without other errors it is Student's, of the mean square of what the others miss."""
    missed = np.array([9.0, 1.0, -2.0, 1.5, -0.5])
    nothing = np.zeros(5)
    misses = Misses(
        predicted=np.full(5, 100.0),
        off=missed,
        size=np.ones(5),
        of_parts=np.zeros((5, 3)),
        of_trial=nothing,
    )
    components = components_of(component_tables(TRUE), ("ankle", None), P)

    found = misses.interval(0, np.arange(5) > 0, components)

    half_width = stats.t.ppf(0.975, 3) * np.sqrt(np.mean(missed[1:] ** 2))
    assert found.high - 100.0 == pytest.approx(half_width)
    assert 100.0 - found.low == pytest.approx(half_width)


def test_what_equations_lack_has_the_scatter_beyond_what_is_known():
    rng = np.random.default_rng(2)
    known = rng.uniform(0.5, 2.0, 40_000)
    assert model_variance(
        rng.standard_normal(40_000) * np.sqrt(known + 3.0), known
    ) == pytest.approx(3.0, rel=0.05)
    assert model_variance(np.array([3.0, -1.0]), np.zeros(2)) == pytest.approx(5.0)
    assert model_variance(np.array([0.1, -0.1]), np.ones(2)) == 0


def test_the_torque_error_is_what_an_offset_and_a_drift_leave():
    record = recording(300, 5, "compensated")
    s, motion = rendered_impedance(record)[0].sums, record.motion
    ends = zip(np.ceil(s.groups.first), np.floor(s.groups.stop), strict=True)
    rows = np.concatenate([np.arange(int(a), int(b)) for a, b in ends])
    left = (record.filtered_torque - 310 * motion.theta - 4 * motion.omega)[rows]
    X = np.column_stack([np.ones(len(rows)), record.time[rows]])
    left -= X @ np.linalg.lstsq(X, left, rcond=None)[0]
    assert torque_error(s, None, DesiredImpedance("x", 310, 4)) == pytest.approx(
        np.sqrt(np.mean(left**2)), rel=2e-3
    )
    assert torque_error(s, None, DesiredImpedance("x", None, 4)) is None


def test_components_that_do_not_predict_are_told_with_how_far_k_and_b_are_off():
    predicted = pl.DataFrame(
        {"K": [100.0, 200.0], "K_measured": [110.0, 220.0],
         "B": [4.0, 5.0], "B_measured": [3.0, 3.75]}
    )  # fmt: skip
    delays = {"component": ["angle_delay", "velocity_delay"], "named": [False, False],
              "change": [0.001, 0.002], "left": [3.0, 3.0]}  # fmt: skip

    (misfit,) = misfits_of_joint(pl.DataFrame(delays), predicted)

    assert misfit.finding.cause == "components that do not predict"
    assert misfit.finding.evidence == (Beyond("left", 3.0, 1.0, "above"),)
    assert measured_over_predicted(predicted, "K") == pytest.approx(10)
    assert measured_over_predicted(predicted, "B") == pytest.approx(-25)


def test_a_doubtful_trial_leaves_the_comparison_beside_sound_ones():
    rows = []
    for controller, K_d, repeat in product(PAIR, (100.0, 200.0), (1, 2, 3)):
        asked = {"controller": controller, "K_d": K_d, "B_d": 5.0, "amplitude_deg": None}
        fit = {"K": 1.1 * K_d, "B": 5.5, "VAF": 99.0, "torque_error": 1.0, "doubtful": ""}
        rows.append({**HERE, "trial": f"{controller}_{K_d}_{repeat}", "commanded_deg": None,
                     **asked, **fit})  # fmt: skip
    sound = pl.DataFrame(rows, schema_overrides={"amplitude_deg": float, "side": pl.String})
    is_spoilt = pl.col("trial") == f"{PAIR[0]}_100.0_2"
    spoilt = sound.with_columns(
        K=pl.when(is_spoilt).then(900.0).otherwise("K"),
        doubtful=pl.when(is_spoilt).then(pl.lit("torque path")).otherwise("doubtful"),
    )

    compared = compensation_table(spoilt)

    assert compared.equals(compensation_table(sound))


def conditions():
    """Trials of two stiffnesses and two dampings by both controllers, with two amplitudes each."""
    rng = np.random.default_rng(3)
    rows = []
    for K, B, name, deg in product((100.0, 200.0), (0.0, 5.0), PAIR, (2.0, 4.0, None)):
        asked = {"controller": name, "K_d": K, "B_d": B, "commanded_deg": deg}
        fit = {"K": K * rng.uniform(0.7, 1.3), "B": B + rng.normal(), "VAF": rng.uniform(90, 99)}
        rows.append({**HERE, **asked, **fit, "torque_error": rng.uniform(1, 2)})
    return pl.DataFrame(rows, schema_overrides={"side": pl.String})


def test_compensation_is_compared_in_pairs_of_trials():
    table = conditions()
    trials = table.filter(pl.col("commanded_deg").is_null())
    pairs = trials.pivot("controller", index=["K_d", "B_d"], values="K")
    off = [100 * (pairs[name] / pairs["K_d"] - 1).abs().to_numpy() for name in PAIR]

    row = compensation_table(table).filter(by="trials", quantity="K_error").row(0, named=True)

    interval = stats.ttest_1samp(off[0] - off[1], 0).confidence_interval(0.95)
    ends = row["difference_low"], row["difference_high"]
    assert ends == pytest.approx((interval.low, interval.high))
    assert (row["pairs"], row["better"]) == (4, np.sum(off[0] < off[1]))
    assert row["compensated"] == pytest.approx(off[0].mean())


def test_the_interval_over_amplitudes_counts_each_trial_once():
    table = conditions()
    single = table.filter(pl.col("commanded_deg").is_not_null())
    means = single.group_by("controller", "K_d", "B_d").agg(pl.col("VAF").mean())
    by_trial = means.pivot("controller", index=["K_d", "B_d"], values="VAF")

    found = compensation_table(table)

    differences = by_trial["compensated"] - by_trial["uncompensated"]
    interval = stats.ttest_1samp(differences, 0).confidence_interval(0.95)
    row = found.filter(by="amplitudes", quantity="VAF").row(0, named=True)
    assert (row["pairs"], row["difference_low"]) == (8, pytest.approx(interval.low))
    of_sizes = found.filter(pl.col("by") == "commanded_deg")["at"]
    assert of_sizes.unique().sort().to_list() == [2.0, 4.0]


def test_friction_is_no_damping_that_a_gain_asks_for():
    table = conditions()
    rubbing = table.with_columns(B=pl.col("B") + 3, B_viscous="B")
    assert compensation_table(rubbing).equals(compensation_table(table))


def test_one_controller_alone_makes_no_pair_and_no_claim(tmp_path):
    alone = compensation_table(conditions().filter(controller="compensated"))
    write_table(alone, path := tmp_path / "compensation.csv")
    assert claimed({"compensation": read_table(path)})[0].is_empty()


def claimed(tables, **settings):
    found = claims_table(tables, Claims(**settings), (1.0, 2.0, 5.0), 340.0, {"ankle": P.n_T})
    return found, {(row["name"], row["subject"]): row for row in found.to_dicts()}


def summary(se=0.01, **means):
    rows = [{**HERE, "quantity": q, "n": 5, "mean": m, "se": se * m} for q, m in means.items()]
    return pl.DataFrame(rows, schema_overrides={"side": pl.String})


IMPEDANCE = {
    **HERE, "trial": "k", "controller": "compensated", "amplitude_deg": None,
    "K_d": 300.0, "B_d": 5.0, "K": 300.0, "K_low": 291.0, "K_high": 309.0,
    "B": 5.0, "B_low": -4.0, "B_high": 14.0, "theta_rms_deg": 3.0,
}  # fmt: skip


def impedance_table(**changes):
    return pl.DataFrame([IMPEDANCE | changes], schema_overrides=TYPES)


def test_claims_of_the_transmission_hold_or_fail_at_either_end_of_the_band():
    _, by = claimed({"transmission_summary": summary(B_j=0.452, J_j=0.005)})
    slow, fast = by["inertia_at_lowest_frequency", None], by["inertia_at_highest_frequency", None]
    shares = [100 * 2 * np.pi * f * 0.005 / 0.452 for f in (1, 5)]
    assert [slow["value"], fast["value"]] == pytest.approx(shares)
    assert (slow["verdict"], fast["verdict"]) == ("holds", "fails")
    half = slow["value"] * 0.01 * 2**0.5 * stats.t.ppf(0.975, 4)
    assert slow["high"] - slow["value"] == pytest.approx(half)


def test_a_claim_of_a_summary_without_scatter_has_no_verdict():
    of_one = summary(B_j=0.452, J_j=0.005).with_columns(se=None)
    _, by = claimed({"transmission_summary": of_one})
    assert by["inertia_at_lowest_frequency", None]["verdict"] is None


def test_shares_of_belt_and_load_are_those_at_the_highest_stiffness():
    actuator = summary(k_tau_n_m=1.02, f_C=0.377, f_G=0.0896)
    tables = {"belt_summary": summary(K_s=685.6), "actuator_summary": actuator}
    _, by = claimed(tables | {"impedance": impedance_table()})
    load = 0.0896 * 300 * np.deg2rad(3) / (P.n_T * 1.02)
    share_of_load = by["load_friction_at_highest_K_d", None]["value"]
    assert share_of_load == pytest.approx(100 * load / (0.377 + load))
    assert by["belt_at_highest_K_d", None]["value"] == pytest.approx(100 * 300 / 685.6)


def test_damping_without_friction_is_compared_with_the_desired_one():
    rubbing = {
        "B": 9.0, "B_low": 8.9, "B_high": 9.1,
        "B_viscous": 5.1, "B_viscous_low": 5.0, "B_viscous_high": 5.2,
    }  # fmt: skip
    of_B = claimed({"impedance": impedance_table(**rubbing)}, B=1.0)[1]["B", "k"]
    told = (of_B["quantity"], of_B["value"], of_B["verdict"])
    assert told == ("B_viscous", 5.1, "equivalent")


@pytest.mark.parametrize(("low", "high", "verdict"), [
    (11, 12, "holds"), (8, 9, "fails"), (9, 11, "undecided"), (None, 1, None),
])  # fmt: skip
def test_a_limit_decides_where_the_whole_interval_is_on_one_side(low, high, verdict):
    assert limit_verdict(low, high, 10, "above") == verdict


@pytest.mark.parametrize(("high", "verdict"), [(0.5, "undecided"), (-0.01, "fails")])
def test_a_joint_is_passive_where_its_damping_is_certainly_not_negative(high, verdict):
    row = {
        **HERE,
        "trial": "k",
        "controller": "compensated",
        "frequency_hz": [1.0, 5.0],
        "damping": [0.5, -0.05],
    }
    row |= {"damping_low": [0.4, -0.1], "damping_high": [0.6, high]}
    _, by = claimed({"frequency_response": pl.DataFrame(row, schema_overrides={"side": pl.String})})
    least = by["passive_compensated", None]
    assert (least["value"], least["verdict"], least["n"]) == (-0.05, verdict, 2)


@pytest.mark.parametrize(
    ("commanded", "verdict"), [(None, "equivalent"), (300.0, "different"), (320.0, "undecided")]
)
def test_the_stiffness_while_walking_is_compared_with_what_was_commanded(commanded, verdict):
    row = {
        "joint": "ankle",
        "side": "left",
        "group": "all",
        "quantity": "K",
        "estimator": "ensemble",
    }
    row |= {
        "commanded": commanded,
        "mean": 337.0,
        "low": 324.0,
        "high": 348.0,
        "n": 30,
        "interval_method": "bootstrap",
    }
    _, by = claimed(
        {"walking_summary": pl.DataFrame([row], schema_overrides={"commanded": pl.Float64})}
    )
    assert by["walking_K_equivalent", None]["verdict"] == verdict
    assert claimed({"walking_summary": pl.DataFrame([row])}, K_percent=None)[0].is_empty()
